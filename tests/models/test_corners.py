"""Corners of a declaration: their order, their sides, and kind after kind of variables."""

from __future__ import annotations

from build_fmus.component import Component
from fmu_sources.models.corners import CORNERS, SIX_CORNERS, THREE_AXLES, TWO_AXLES, Corners


def test_names_axles_sides_and_order() -> None:
    for axle_of, names in ((TWO_AXLES, CORNERS), (THREE_AXLES, SIX_CORNERS)):
        corners = Corners(axle_of)
        assert tuple(corners.all("name")) == names
        assert corners.all("place") == list(range(len(names)))
        assert corners.all("side") == [1, -1] * (len(names) // 2)
        assert {k.name: k.axle for k in corners} == dict(axle_of)
        assert [f"road.{k}" for k in corners] == [f"road.{n}" for n in names]


def test_variables_are_declared_kind_after_kind() -> None:
    c = Component("Wheels", kind="continuous", description="four wheels", source="none")
    corners = Corners(TWO_AXLES)
    corners.each(
        z=lambda k: c.state(f"wheel.{k}.z", "m", "height"),
        vz=lambda k: c.state(f"wheel.{k}.vz", "m/s", "velocity"),
        pair=lambda k: (k.z, k.vz),  # sees what was declared before it
    )
    for k in corners:
        c.derivative(*k.pair)
        c.derivative(k.vz, 0)
    states = [v.name for v in c.model().variables if v.role == "state"]
    assert states == [f"wheel.{k}.{what}" for what in ("z", "vz") for k in CORNERS]
