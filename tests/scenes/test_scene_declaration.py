"""What a scene says, and what it refuses to say."""

from __future__ import annotations

import json
from typing import Any

import pytest

from cosim.scenes.scene import (
    Arrow,
    Body,
    Cone,
    Face,
    Ground,
    Limit,
    Points,
    Reading,
    Relief,
    Scene,
    Strut,
    Trace,
    Trench,
    Value,
    Wheel,
    scene_data,
    value,
)

TRIANGLE = Face([(0, 0, 0), (1, 0, 0), (0, 0, 1)])
BODY = Body("body", [TRIANGLE], x="car.x", z=Value({"car.z": 1.0}, 0.8))
WHEEL = Wheel("fl", 0.5, 0.2, x=Value({"car.x": 1.0}, 1.5), y=0.8, z=0.5)


def made(**parts: Any) -> Scene:
    return Scene(
        **{"title": "t", "bodies": [BODY], "follow": "body", "width": 9.0, "force_scale": 1e4, "wheels": [WHEEL]}
        | parts
    )


def test_values_are_sums() -> None:
    total = value("car.x") * 2.0 + Value({"car.x": 1.0, "car.y": -1.0}, 0.5)
    assert total.of({"car.x": 10.0, "car.y": 4.0}) == 26.5
    assert total == Value({"car.x": 3.0, "car.y": -1.0}, 0.5)
    assert value(2).of({}) == 2.0
    assert Value({"car.x": 0.0}).terms == {}


def test_rest_is_the_offset_unless_given() -> None:
    assert Value({"a.b": 1.0}, 0.4).at_rest == 0.4
    absolute = Value({"a.b": 1.0}, rest=0.6)
    assert absolute.at_rest == 0.6
    assert (absolute + 0.1).at_rest == pytest.approx(0.7)
    assert (absolute * -2.0).at_rest == -1.2


@pytest.mark.parametrize(
    "make",
    [
        lambda: Value({"speed": 1.0}),
        lambda: Value({"car.": 1.0}),
        lambda: Value({"car.x": float("nan")}),
        lambda: Value("car.x"),  # type: ignore[arg-type]
        lambda: Face([(0, 0, 0), (1, 0, 0)]),
        lambda: Face([(0, 0, 0), (1, 0, 0), (2, 0, 0)]),
        lambda: Face([(0, 0, 0), (1, 0, 0), (1, 1, 0.1), (0, 1, 0)]),
        lambda: Face([(0, 0, 0), (2, 0, 0), (0.2, 0.2, 0), (0, 2, 0)]),
        lambda: Face(TRIANGLE.points, "wood"),  # type: ignore[arg-type]
        lambda: Body("", [TRIANGLE]),
        lambda: Body("b", []),
        lambda: Body("b", [1]),  # type: ignore[list-item]
        lambda: Wheel("w", 0.0, 0.2, 0.0, 0.0, 0.0),
        lambda: Wheel("w", 0.5, -0.2, 0.0, 0.0, 0.0),
        lambda: Strut("b", (0.0, 1.0), "w"),  # type: ignore[arg-type]
        lambda: Arrow("a", "wind", 1.0),  # type: ignore[arg-type]
        lambda: Ground("middle", 0.0, "r", "r.x", "r.h", 0.0),  # type: ignore[arg-type]
        lambda: Points("p", "preview", 0.0, 0.0, 0.1, ["a.b"]),
        lambda: Reading("speed", "km/h", "a.b", 9),
        lambda: Relief([]),
        lambda: Trench(0.0, 1.0, 1.0, "up"),  # type: ignore[arg-type]
        lambda: Trace("t", "body", 0.0, 0.0, 0.0, 0.0),
        lambda: made(follow="bodi"),
        lambda: made(width=0),
        lambda: made(bodies=[BODY, BODY]),
        lambda: made(wheels=[WHEEL, Wheel("body", 0.5, 0.2, 0.0, 0.0, 0.0)]),
        lambda: made(struts=[Strut("body", (0, 0, 0), "fr")]),
        lambda: made(arrows=[Arrow("a", "body", 1.0, on="roof")]),
        lambda: made(limits=[Limit("stop", 1.0, at="xx")]),
        lambda: made(limits=[Limit("stop", 1.0), Limit("stop", 2.0)]),
        lambda: made(wheels=[BODY]),
        lambda: made(wheels=[Wheel("fl", 0.5, 0.2, 1.5, 0.8, 0.5, on="bodi")]),
        lambda: made(views=("side", "below", "three-quarter")),
        lambda: made(views=("side", "top")),
        lambda: Cone(float("nan"), 0.0),
        lambda: Cone(0.0, 0.0, radius=0.0),
    ],
)
def test_what_does_not_fit_is_refused(make: Any, raises) -> None:
    with raises(ValueError):
        make()


def test_variables_are_all_that_is_needed() -> None:
    scene = made(
        arrows=[Arrow("a", "ground", "car.fz", on="fl", at=(0.0, 0.0, "car.dz"))],
        points=[Points("p", "sensed", "car.x", 0.0, "car.v", ["map.h[1]", "map.h[2]"])],
        limits=[Limit("stop", "car.limit")],
        readings=[Reading("speed", "m/s", "car.v")],
        trenches=[Trench("car.start", 1.0, 1.0)],
        reliefs=[Relief([("car.edge", 0.0)])],
        grounds=[Ground("left", 0.8, "road", "road.x", "road.h", 0.0)],
        traces=[Trace("t", "body", 0.0, 0.0, "car.z", 1.0)],
    )
    assert set(scene.variables) == {
        "car.x",
        "car.z",
        "car.fz",
        "car.dz",
        "car.v",
        "map.h[1]",
        "map.h[2]",
        "car.limit",
        "car.start",
        "car.edge",
    }
    assert len(set(scene.variables)) == len(scene.variables)


def test_data_is_what_the_script_reads() -> None:
    scene = made(
        struts=[Strut("body", (0.0, 0.0, 0.2), "fl")],
        limits=[Limit("stop", "car.z", at="fl")],
        arrows=[
            Arrow("a", "body", Value({"car.z": -2.0}, 1.0, rest=0.5), on="body"),
            Arrow("b", "ground", 1.0, on="fl"),
            Arrow("c", "ground", 1.0),
        ],
    )
    data = scene_data(scene)
    assert json.loads(json.dumps(data)) == data
    assert data["names"] == ["car.x", "car.z"]
    assert data["wheels"][0]["x"] == [1.5, 1.5, 0, 1.0]
    assert data["wheels"][0]["z"] == 0.5
    assert data["arrows"][0]["fz"] == [1.0, 0.5, 1, -2.0]
    assert [(a["body"], a["wheel"]) for a in data["arrows"]] == [(0, None), (None, 0), (None, None)]
    assert (data["struts"][0]["body"], data["struts"][0]["wheel"], data["limits"][0]["at"]) == (0, 0, 0)
    assert (data["follow"], data["forceScale"], data["width"]) == (0, 1e4, 9.0)


def test_the_footprint_is_that_of_body_and_wheels() -> None:
    plate = Body("body", [Face([(2, 0.7, 0), (2, -0.7, 0), (-1, -0.7, 0), (-1, 0.7, 0)])], x="car.x")
    there = [Wheel(n, 0.5, 0.2, x, y, 0.5, on="body") for n, x, y in (("fr", 1.2, -0.8), ("rl", -0.9, 0.8))]
    assert made(bodies=[plate], wheels=[]).footprint == (-1.0, 2.0, 0.7)
    assert made(bodies=[plate], wheels=there).footprint == pytest.approx((-1.4, 2.0, 0.9))
