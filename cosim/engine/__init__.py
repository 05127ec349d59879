"""The compiled engine: the schedule as flat arrays, and C that executes them, bit-identical to the Python master.

- `plan`: the flat arrays, made from the values and the clocks of an exchange;
- `library`: the C engine, compiled once per machine;
- `table.c`: the step of a component that plays signals from a table (`cosim.tables`);
- `compiled`: an exchange whose instants the engine executes.

`engine.h` says what is in a plan, `engine.c` executes it; nothing in both knows of Python.
"""
