"""FMUs at arm's length: each in a process of its own, over shared memory.

`process` starts it and says how it was lost; `client.c` has FMI's functions for the master, the engine included,
which hand every call over; `worker.c` is the process; `link.h` and `shared.h` say what the two share.
"""

from cosim.fmu.isolation.process import IsolatedLibrary, Isolation, NoIsolation, WorkerCrashed, require

__all__ = ["IsolatedLibrary", "Isolation", "NoIsolation", "WorkerCrashed", "require"]
