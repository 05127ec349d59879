"""Many copies of one system, stepped together on all cores.

- ``batch``: :class:`Batch`, what users see;
- ``structs``: the plan of all copies for the compiled engine, and what failed;
- ``source``: the sources that an FMU carries, and why it has no lanes;
- ``statements``: its generated functions, read back;
- ``lanes``: these functions over several copies at once, in C;
- ``library``: what is compiled of them, for one kind of processor.

In ``runtime/`` are the vectors (``lanes.h``), solvers and samples in lanes (``lane_member.h``), and the engine of
groups (``batch.c``).
"""

from cosim.batch.batch import Batch, BatchRecording, CopyFailedWarning
from cosim.batch.structs import CopyFailure

__all__ = ["Batch", "BatchRecording", "CopyFailedWarning", "CopyFailure"]
