"""Linear algebra with one thread in the processes of the commands.

Matrices here have tens to hundreds of rows: a second thread of the BLAS library costs five times the processor time and
saves none, beside workers that use every core already. And sums are added up in one order, however many cores a machine
has.
"""

from __future__ import annotations

import os

VARIABLES = ("OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "OMP_NUM_THREADS")
"""What the BLAS libraries of numpy and scipy read when they are loaded."""


def one_thread() -> None:
    """In this process, if numpy is not loaded yet, and in those that it starts; a user's own setting stays."""
    for name in VARIABLES:
        os.environ.setdefault(name, "1")
