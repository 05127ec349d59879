"""Many copies of one system, stepped together on all cores.

- `copies`: `Batch`, the interface for users;
- `initial_states`: how the copies are initialized, in lanes or one after the other;
- `structs`: the plan of all copies for the engine, and the failures;
- `source`: the sources that an FMU carries, and why it is not vectorizable;
- `library`: the compiled library, for one kind of processor;
- `adjoint`: a run and the way back, for derivatives by many parameters.

In `runtime/` are the vectors (`lanes.h`), the generated functions over them (`lane_equations.h`), steps and samples
in lanes (`lane_component.h`), the engine of groups (`batch.c`), and what a number with derivatives takes in place of a
vector (`numbers.h` over `tangents.h` or `adjoints.h`, `programs.h`).
"""

from cosim.batch.copies import Batch, BatchRecording, CopyFailedWarning
from cosim.batch.structs import CopyFailure

__all__ = ["Batch", "BatchRecording", "CopyFailedWarning", "CopyFailure"]
