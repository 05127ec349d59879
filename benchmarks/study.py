"""The whole published study of paper 000 from nothing, on all cores."""

from __future__ import annotations

import tempfile
import time
from pathlib import Path

from cosim.experiments.gpc import EXPERIMENT
from cosim.study import FmuSet, run_study
from cosim.study.store import Store


def measure() -> dict[str, float]:
    """Wall time and numbers of runs and tasks."""
    with tempfile.TemporaryDirectory() as tmp:
        begin = time.perf_counter()
        result = run_study(EXPERIMENT, FmuSet(), Path(tmp))
        wall_time = time.perf_counter() - begin
        return {"wall time [s]": wall_time, "runs": len(Store(Path(tmp))), "tasks": len(result.tasks)}
