"""How a system is executed: its initialization, its instants, its states.

- `plan`: the system as flat arrays, made from its values and clocks;
- `engine.c`: executes these arrays (`engine.h` says what is in them, `instants.h` the order of an instant; nothing in
  these files knows of Python);
- `bound`, `library`: the engine, compiled once per machine and bound to one system;
- `exchange`: the rule in words, the position in time, and what ends a run;
- `initialization`, `loops`: initial values;
- `simulation`: what users step, with states, pace and interrupts;
- `table.c`: the step of a component that plays signals from a table (`cosim.tables`).
"""
