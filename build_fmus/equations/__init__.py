"""C code that reads like the equations: CasADi functions of a component, with the names of its declaration.

Modules of the package, lowest first:

- `operators`: how each operation of CasADi is written in C;
- `names`: C identifiers, and C structs over the runtime's vectors (`p->suspension_stiffness`);
- `graph`: operations of all functions of a component, each different one once, so that what has a name has it
  everywhere;
- `values`: how nodes of the graph are written in C, and constant arrays;
- `lines`: the lines of a function: their order, work arrays, blocks under conditions (`branches`), numbers without
  derivatives (`locals`);
- `statements`: one C function from its operations;
- `functions`: all functions of a component;
- `casadi_code`: CasADi's own code, for functions with operations that the others do not know.

The order of operations is the declaration's: the code gives the bits that CasADi's would.
"""
