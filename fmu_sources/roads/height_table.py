"""Roads from tables of heights: a uniform grid for both sides, held in the FMU as constants."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np

from build_fmus.component import Component
from fmu_sources.roads.layout import RoadLayout
from fmu_sources.roads.road import Profile, road


@dataclass(frozen=True)
class HeightTable:
    """Heights [m] of the left and right track at `start + k * step` [m]."""

    start: float
    step: float
    left: np.ndarray
    right: np.ndarray

    @classmethod
    def resampled(
        cls, distance: np.ndarray, left: np.ndarray, right: np.ndarray, *, finest: float = 0.01, most: int = 50_000
    ) -> HeightTable:
        """Table from points at increasing distances, linear in between.

        Equidistant points are taken as they are. Others are sampled at the smallest distance between two of them, but
        not closer than `finest` [m] and with `most` points at most.
        """
        gaps = np.diff(distance)
        length = distance[-1] - distance[0]
        mean = length / len(gaps)
        if len(distance) <= most and np.allclose(gaps, mean, rtol=1e-6, atol=1e-9):
            return cls(float(distance[0]), float(mean), left, right)
        count = max(1, int(np.ceil(length / max(gaps.min(), finest) - 1e-6)))
        grid = np.linspace(distance[0], distance[-1], min(count, most - 1) + 1)
        return cls(
            float(grid[0]),
            float(length / (len(grid) - 1)),
            np.interp(grid, distance, left),
            np.interp(grid, distance, right),
        )


def node_heights(c: Component, table: HeightTable) -> Callable[[Any, str], Any]:
    """Heights [m] at a column of whole node numbers of a side, as `Profile` wants them; `c` has MX symbols."""
    heights = {
        side: c.constant(f"heights.{side}", values + 0.0, "m", f"heights of the {side} track", source="table")  # no -0
        for side, values in (("left", table.left), ("right", table.right))
    }
    return lambda node, side: heights[side][node]


def road_from_table(
    table: HeightTable, layout: RoadLayout, name: str, *, description: str, source: str, notes: Iterable[str] = ()
) -> Component:
    """A road whose heights are the table's."""
    last = len(table.left) - 1

    return road(
        name,
        layout,
        lambda c: Profile(node_heights(c, table), last, table.step, table.start),
        description=description,
        source=source,
        symbols=ca.MX,
        notes=notes,
        reference_start=table.start + last * table.step / 2,
    )
