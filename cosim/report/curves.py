"""Curves, bars and panels from rows of numbers by name, such as the signals of a run."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from cosim.recording.peaks import keep_peaks
from cosim.report.claims import Distribution
from cosim.report.model import Panel, Series

Signals = Mapping[str, Any]
"""Numbers by name, (n,) each."""


def curve(
    name: str,
    signals: Signals,
    y: str,
    factor: float = 1.0,
    *,
    x: str = "time",
    start: float = -math.inf,
    end: float = math.inf,
    thin: bool = False,
    **look: Any,
) -> Series:
    """One signal over another one.

    Args:
        name: in the legend.
        signals: of one run.
        y: which signal is drawn.
        factor: from the unit of the signal to that of the axis.
        x: signal of the x axis.
        start: first x that is drawn, in the unit of x; `end`: the last one.
        end: see `start`.
        thin: leave out samples, but keep all peaks.
        look: `color`, `dash` and `mode` of a `Series`.
    """
    across, values = np.asarray(signals[x], dtype=float), factor * np.asarray(signals[y], dtype=float)
    kept = (across >= start) & (across <= end)
    across, values = across[kept], values[kept]
    return Series(name, *(keep_peaks(across, values) if thin else (across, values)), **look)


def level(name: str, across: npt.ArrayLike, value: float, **look: Any) -> Series:
    """A horizontal line over the extent of these abscissae, such as a limit."""
    ends = np.asarray(across, dtype=float)
    return Series(name, [ends.min(), ends.max()], [value] * 2, **look)


def over_time(runs: Mapping[str, Signals], panels: Iterable[tuple[str, str, str, float]], **look: Any) -> list[Panel]:
    """A panel for each signal, a curve for each run that has it.

    Args:
        runs: signals by the name of the run in the legend.
        panels: title, label of the y axis, signal, and the factor to the unit of the label.
        look: as of `curve`.
    """
    return [
        Panel(title, "time [s]", label, [curve(n, s, signal, factor, **look) for n, s in runs.items() if signal in s])
        for title, label, signal, factor in panels
    ]


def bars(quantity: str, label: str, names: Sequence[str], heights: Mapping[str, Sequence[Any]], *more: Series) -> Panel:
    """Groups of bars.

    Args:
        quantity: label of the x axis, of what `names` are.
        label: label of the y axis.
        names: of the groups.
        heights: of the bars in each group, by series; numbers, or distributions (median, low and high).
        more: series that are drawn over the bars.
    """
    series = []
    for name, values in heights.items():
        spread = all(isinstance(v, Distribution) for v in values)
        middle, low, high = ([getattr(v, at) for v in values] if spread else None for at in ("median", "low", "high"))
        series.append(Series(name, range(len(names)), middle or values, low, high, mode="bar"))
    return Panel("", quantity, label, [*series, *more], x_names=names)
