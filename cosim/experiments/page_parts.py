"""Controls and measures that live pages of several experiments have."""

from __future__ import annotations

from collections.abc import Iterable

from cosim.export.web.page import Control, How, Measure
from cosim.study import Metric
from fmu_sources.models.corners import CORNERS
from fmu_sources.roads.iso8608 import CLASSES

SPRUNG_MASS = Control("sprung mass", ["car.body.mass"], 1500.0, 4500.0)
ROUGHNESS = Control("roughness, ISO 8608 class", ["road.class"], choices={c: float(i) for i, c in enumerate(CLASSES)})


def at_corners(variable: str, corners: Iterable[str] = CORNERS) -> list[str]:
    """A variable at each corner, "car.tire.{}.force"."""
    return [variable.format(k) for k in corners]


def speed_control(variable: str, slowest_kmh: float, fastest_kmh: float, label: str = "speed") -> Control:
    """A speed that the arrow keys change."""
    return Control(label, [variable], slowest_kmh / 3.6, fastest_kmh / 3.6, keys=("ArrowDown", "ArrowUp"))


def largest_travel(corners: Iterable[str] = CORNERS) -> Measure:
    """Travel of the suspensions."""
    names = at_corners("car.suspension.{}.deflection", corners)
    return Measure("suspension travel, largest", names, "peak", "mm", 1e3, decimals=0)


def shown_as(metric: Metric, names: list[str], how: How = "peak", label: str = "", decimals: int = 2) -> Measure:
    """Outputs in the words and the unit of a metric."""
    return Measure(label or metric.text, names, how, metric.unit, metric.factor, decimals=decimals)
