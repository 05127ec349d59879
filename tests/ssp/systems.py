"""Systems of the experiments, as their default cases wire them."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

from built import FMUS

from cosim import System
from cosim.experiments import EXPERIMENTS
from cosim.study import FmuSet, Runner
from cosim.study.experiment import Experiment
from cosim.study.loading import load


def _all() -> dict[str, Experiment]:
    return {e.name: e for place in EXPERIMENTS.values() for e in load(place).every}


IN_PYTHON = "force-tracking"
"""The one whose signal is a component in Python."""
EVERY = sorted(_all().keys() - {IN_PYTHON})


@contextmanager
def experiment_system(name: str, fmi: int = 3) -> Iterator[System]:
    experiment = _all()[name]
    with Runner(experiment, FmuSet(FMUS, fmi)) as runner:
        yield runner.system(experiment.case())
