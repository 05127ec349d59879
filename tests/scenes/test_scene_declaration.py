"""What a scene says, and what it refuses to say."""

from __future__ import annotations

import json
from typing import Any

import pytest

from cosim.export.web.scene import (
    Arrow,
    Body,
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
    ("make", "message"),
    [
        (lambda: Value({"speed": 1.0}), "a value names 'speed'; write component.variable"),
        (lambda: Value({"car.": 1.0}), "a value names 'car.'; write component.variable"),
        (lambda: Value({"car.x": float("nan")}), "factor of 'car.x' is nan"),
        (lambda: Value("car.x"), "a value's terms are 'car.x'; give factors"),  # type: ignore[arg-type]
        (lambda: Face([(0, 0, 0), (1, 0, 0)]), "three or more finite points"),
        (lambda: Face([(0, 0, 0), (1, 0, 0), (2, 0, 0)]), "lie on one line"),
        (lambda: Face([(0, 0, 0), (1, 0, 0), (1, 1, 0.1), (0, 1, 0)]), "lie in no plane"),
        (lambda: Face([(0, 0, 0), (2, 0, 0), (0.2, 0.2, 0), (0, 2, 0)]), "is not convex; divide it"),
        (lambda: Face(TRIANGLE.points, "wood"), "no material 'wood'"),  # type: ignore[arg-type]
        (lambda: Body("", [TRIANGLE]), "'name' is empty"),
        (lambda: Body("b", []), "body 'b' has no faces"),
        (lambda: Body("b", [1]), "'faces' holds 1, which is no Face"),  # type: ignore[list-item]
        (lambda: Wheel("w", 0.0, 0.2, 0.0, 0.0, 0.0), "wheel 'w': radius is 0 m"),
        (lambda: Wheel("w", 0.5, -0.2, 0.0, 0.0, 0.0), "wheel 'w': width is -0.2 m"),
        (lambda: Strut("b", (0.0, 1.0), "w"), "at is (0.0, 1.0); give a finite point"),  # type: ignore[arg-type]
        (lambda: Arrow("a", "wind", 1.0), "no role 'wind'"),  # type: ignore[arg-type]
        (lambda: Ground("middle", 0.0, "r", "r.x", "r.h", 0.0), "no side 'middle'"),  # type: ignore[arg-type]
        (lambda: Points("p", "preview", 0.0, 0.0, 0.1, ["a.b"]), "1 heights; a line needs two"),
        (lambda: Reading("speed", "km/h", "a.b", 9), "9 decimals; use 0 to 6"),
        (lambda: Relief([]), "give at least one point"),
        (lambda: Trench(0.0, 1.0, 1.0, "up"), "no side 'up'"),  # type: ignore[arg-type]
        (lambda: Trace("t", "body", 0.0, 0.0, 0.0, 0.0), "speed is 0 m/s"),
        (lambda: made(follow="bodi"), "no body to follow 'bodi'; did you mean 'body'"),
        (lambda: made(width=0), "width is 0"),
        (lambda: made(bodies=[BODY, BODY]), "'body' appears more than once"),
        (
            lambda: made(wheels=[WHEEL, Wheel("body", 0.5, 0.2, 0.0, 0.0, 0.0)]),
            "body or wheel 'body' appears more than once",
        ),
        (lambda: made(struts=[Strut("body", (0, 0, 0), "fr")]), "a strut hangs on no wheel 'fr'"),
        (lambda: made(arrows=[Arrow("a", "body", 1.0, on="roof")]), "arrow 'a' is on no body or wheel 'roof'"),
        (lambda: made(limits=[Limit("stop", 1.0, at="xx")]), "limit 'stop' is at no wheel 'xx'"),
        (lambda: made(limits=[Limit("stop", 1.0), Limit("stop", 2.0)]), "limits 'stop' appears more than once"),
        (lambda: made(wheels=[BODY]), "'wheels' holds Body"),
    ],
)
def test_what_does_not_fit_is_refused(make: Any, message: str) -> None:
    with pytest.raises(ValueError) as caught:  # noqa: PT011
        make()
    assert message in str(caught.value)


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
