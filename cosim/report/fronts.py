"""Fronts of several objectives: what nothing else is better than in all respects, and how a page shows it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import combinations

import numpy as np
import numpy.typing as npt

from cosim.report.model import Figure, Panel, Section, Series, Table

Scalar = float | str
TRIED, FRONT = "tried", "front"


def non_dominated(values: npt.ArrayLike) -> npt.NDArray[np.bool_]:
    """Which of the points (n, objectives), all to be minimized, are Pareto-optimal.

    No other point is at least as small in all objectives and smaller in one.

    Raises:
        ValueError: the points are no table, or one is not finite.
    """
    points = np.asarray(values, dtype=float)
    if points.ndim != 2 or not np.isfinite(points).all():
        raise ValueError(
            f"points of a front are a table of finite numbers, not of shape {points.shape} or with NaN in it"
        )
    found = np.ones(len(points), dtype=np.bool_)
    for i, point in enumerate(points):
        found[i] = not ((points <= point).all(axis=1) & (points < point).any(axis=1)).any()
    return found


def front_section(
    title: str,
    labels: Mapping[str, str],
    directions: Mapping[str, str],
    tried: Sequence[Mapping[str, float]],
    parameters: Sequence[Mapping[str, Scalar]],
    beside: Mapping[str, Mapping[str, float]] | None = None,
) -> Section:
    """A figure with a panel for each pair of objectives, and the front as a table.

    Args:
        title: of the section.
        labels: of the objectives by name, with their unit: `{"comfort": "acceleration [m/s2]"}`.
        directions: "min" or "max" of each.
        tried: objectives of each trial.
        parameters: what was tried, of each.
        beside: points for comparison by name, such as what is published.
    """
    names = list(labels)
    if len(names) < 2 or not tried:
        raise ValueError(f"a front takes two objectives and a trial: there are {len(names)} and {len(tried)}")
    signs = np.array([-1.0 if directions[n] == "max" else 1.0 for n in names])
    points = np.array([[row[n] for n in names] for row in tried])
    best = non_dominated(points * signs)
    panels = []
    for x, y in combinations(range(len(names)), 2):
        series = [
            Series(TRIED, points[~best, x], points[~best, y], color="gray", mode="markers"),
            Series(FRONT, points[best, x], points[best, y], color="blue", mode="markers"),
        ]
        series += [Series(n, [row[names[x]]], [row[names[y]]], mode="markers") for n, row in (beside or {}).items()]
        panels.append(Panel("", labels[names[x]], labels[names[y]], [s for s in series if len(s.x_values)]))
    order = np.flatnonzero(best)[np.argsort(points[best, 0], kind="stable")]
    columns = [*(labels[n] for n in names), *parameters[0]]
    rows = [[*points[i].tolist(), *parameters[i].values()] for i in order.tolist()]
    count = f"{int(best.sum())} of {len(points)} trials are Pareto-optimal."
    figure = Figure("front", title, count, panels, columns=min(2, len(panels)))
    return Section(title, [count], [figure], [Table("front", f"{title}: the front", columns, rows)])
