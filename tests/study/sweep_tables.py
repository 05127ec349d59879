"""Tables of sweeps whose metrics are known functions of what varies: nothing is run."""

from __future__ import annotations

from typing import Any

import numpy as np

from cosim.study import FmuSet
from cosim.study.design import Design, axis
from cosim.study.sweep import SweepTable, prepare

FMUS = FmuSet()


def made(experiment: Any, *texts: str, base: Any = None, **options: Any) -> Any:
    """A sweep over axes as on the command line."""
    return prepare(experiment, FMUS, Design(tuple(map(axis, texts)), **options), base)


def table_of(experiment: Any, function: Any, *texts: str, **options: Any) -> SweepTable:
    """The table of a sweep whose metric "y", or metrics by name, are a function of what varies."""
    sweep = made(experiment, *texts, **options)
    axes = {a.name: [sweep.point(i)[k] for i in range(len(sweep))] for k, a in enumerate(sweep.design.axes)}
    values = function(*(np.array(v, dtype=float) for v in axes.values()))
    return SweepTable(sweep, axes, values if isinstance(values, dict) else {"y": values}, {})
