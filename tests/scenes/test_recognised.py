"""Scenes of systems, found by the names of their variables.

Of every experiment, and in which places things are then.
"""

from __future__ import annotations

import json
import math
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from fractions import Fraction
from typing import Any

import numpy as np
import pytest
from built import FMUS, BuiltFmus
from scenes.watching import Values, values_at
from ssp.systems import EVERY, experiment_system

from cosim import System
from cosim.core.description import Description, Variable
from cosim.core.errors import WiringError
from cosim.experiments import EXPERIMENTS
from cosim.scenes import infer_scene
from cosim.scenes.scene import Body, Scene, Value, scene_data
from cosim.study import FmuSet, Runner
from cosim.study.experiment import resolved
from cosim.study.loading import load

MILLIMETRE = 1e-3
DRIVEN = ("hmmwv", "trench", "gpc", "preview-lq", "three-axle", "bench", "ride")
WHEELS = {"bench": 1, "three-axle": 6, "shallow": 6, "trench": 6, "trench-readings": 6}


@pytest.fixture(autouse=True)
def _built(built_fmus: BuiltFmus) -> None:
    """The FMUs of all systems."""


@contextmanager
def wired(name: str, **options: Any) -> Iterator[System]:
    """The system of a case of an experiment, as it is run."""
    experiment = resolved(load(EXPERIMENTS[name]))
    with Runner(experiment, FmuSet(FMUS, 3)) as runner:
        case = replace(experiment.case(), **options)
        system = runner.system(case)
        yield system


def scene_of(system: System, plant: str | None = None) -> Scene:
    scene = infer_scene(system, plant)
    assert scene is not None
    return scene


def fmu(name: str) -> str:
    return str(FmuSet(FMUS, 3).path(name))


def at(body: Body, point: tuple[float, ...], values: Values) -> np.ndarray:
    """A point of a body's frame on the road (ISO 8855: yaw, pitch and roll about z, y and x, in this order)."""
    r, p, y = ((getattr(body, n)).of(values) for n in ("roll", "pitch", "yaw"))
    about_x = np.array([[1, 0, 0], [0, math.cos(r), -math.sin(r)], [0, math.sin(r), math.cos(r)]])
    about_y = np.array([[math.cos(p), 0, math.sin(p)], [0, 1, 0], [-math.sin(p), 0, math.cos(p)]])
    about_z = np.array([[math.cos(y), -math.sin(y), 0], [math.sin(y), math.cos(y), 0], [0, 0, 1]])
    return about_z @ about_y @ about_x @ np.array(point) + [getattr(body, n).of(values) for n in "xyz"]


@pytest.mark.parametrize("name", EVERY)
def test_every_experiment_is_drawn(name: str) -> None:
    with experiment_system(name) as system:
        scene = scene_of(system)
        assert len(scene.wheels) == WHEELS.get(name, 4)
        assert {v for _, v in (system.components.split(n) for n in scene.variables)}  # all of them exist
        for variable in scene.variables:
            component, own = system.components.split(variable)
            assert own in component.description.variables
        data = scene_data(scene)
        assert json.loads(json.dumps(data)) == data
        assert data["names"] == list(scene.variables)


@pytest.mark.parametrize("name", DRIVEN)
def test_at_rest_wheels_stand_on_the_road(name: str) -> None:
    with wired(name) as system:
        scene = scene_of(system)
        plant = scene.bodies[0].z.terms  # type: ignore[union-attr]
        (body_z,) = plant
        component = system[body_z.partition(".")[0]]
        heights = {}
        for wheel in scene.wheels:
            input_ = "road.height" if wheel.name == "wheel" else f"road.{wheel.name}.height"
            heights[wheel.name] = f"{component.name}.{input_}" if input_ in component.description.inputs else None
        values = values_at(system, scene, 0.0, *filter(None, heights.values()))
        for wheel in scene.wheels:
            ground = values[heights[wheel.name]] if heights[wheel.name] else 0.0
            lowest = wheel.z.of(values) - (wheel.radius - wheel.squash.of(values))  # type: ignore[union-attr]
            assert lowest == pytest.approx(ground, abs=MILLIMETRE)
            assert wheel.squash.of(values) > 0  # type: ignore[union-attr]


@pytest.mark.parametrize(("name", "time"), [("hmmwv", 1.4), ("preview-lq", 0.4), ("three-axle", 2.2), ("gpc", 2.4)])
def test_struts_are_as_long_as_suspensions_say(name: str, time: float) -> None:
    """Deflection is body height minus wheel height.

    What the ends of the drawn struts do, without any number of the scene's own.
    """
    with wired(name) as system:
        scene = scene_of(system)
        names = {w.name: f"car.suspension.{w.name}.deflection" for w in scene.wheels}
        values = values_at(system, scene, time, *names.values())
        calm = dict.fromkeys(values, 0.0)
        moved = 0.0
        for strut in scene.struts:
            wheel = next(w for w in scene.wheels if w.name == strut.wheel)
            length = [at(scene.bodies[0], strut.at, v)[2] - wheel.z.of(v) for v in (values, calm)]  # type: ignore[union-attr]
            deflection = values[names[wheel.name]]
            moved = max(moved, abs(deflection))
            assert length[0] - length[1] == pytest.approx(deflection, abs=0.02 * abs(deflection) + MILLIMETRE)
        assert moved > 3 * MILLIMETRE


def test_wheels_stand_where_the_parameters_have_them() -> None:
    with wired("hmmwv") as system:
        system["car"].set({"wheel.fl.x": 1.7, "wheel.fl.half_track": 0.95})
        scene = scene_of(system)
        values = dict.fromkeys(scene.variables, 0.0) | {"speed.x": 12.0}
        corner = next(w for w in scene.wheels if w.name == "fl")
        assert [v.of(values) for v in (corner.x, corner.y)] == pytest.approx([13.7, 0.95])  # type: ignore[union-attr]
        assert [w.y.of(values) > 0 for w in scene.wheels] == [w.name.endswith("l") for w in scene.wheels]  # type: ignore[union-attr]
        ahead = {w.name: w.x.of(values) - 12.0 for w in scene.wheels}  # type: ignore[union-attr]
        assert ahead["fr"] > 0 > ahead["rr"]


@pytest.mark.parametrize("name", EVERY)
def test_dimensions_that_the_picture_keeps_are_told(name: str) -> None:
    """Each changes the picture when it is another one before the scene is made, and nothing in the scene follows it."""
    with experiment_system(name) as system:
        scene = scene_of(system)
        assert not set(scene.dimensions) & set(scene.variables)
        for dimension in scene.dimensions:
            component, variable = dimension.split(".", 1)
            declared = system[component].description.parameters[variable]
            assert declared.unit is not None
            assert declared.unit.name == "m"
    with wired("hmmwv") as system:
        before = scene_of(system)
        system["car"].set({"wheel.fl.x": 1.7})
        assert "car.wheel.fl.x" in before.dimensions
        assert scene_data(scene_of(system)) != scene_data(before)


def test_pitch_and_roll_have_the_signs_of_iso_8855() -> None:
    with wired("hmmwv") as system:
        body = scene_of(system).bodies[0]
        still = {"speed.x": 0.0, "car.body.z": 0.0, "car.body.pitch": 0.0, "car.body.roll": 0.0}
        front, left = (2.0, 0.0, 0.0), (0.0, 1.0, 0.0)
        assert at(body, front, still | {"car.body.pitch": 0.05})[2] < at(body, front, still)[2]
        assert at(body, left, still | {"car.body.roll": 0.05})[2] > at(body, left, still)[2]


def test_the_nonlinear_car_is_where_it_says() -> None:
    with wired("gpc") as system:
        scene = scene_of(system)
        values = values_at(system, scene, 1.0, "car.x", "car.y", "car.body.yaw")
        assert scene.bodies[0].x.of(values) == values["car.x"] > 15  # type: ignore[union-attr]
        turned = dict(values) | {"car.x": 0.0, "car.y": 0.0, "car.body.yaw": 0.01}
        wheels = {w.name: w for w in scene.wheels}
        x, y = (getattr(wheels["fl"], n).of(turned) for n in "xy")
        assert (x, y) == pytest.approx((1.98, 0.91), abs=2 * MILLIMETRE)
        assert wheels["fl"].on == scene.follow  # with which it turns
        assert wheels["fl"].heading.of(turned) == 0  # type: ignore[union-attr]


def test_the_public_hmmwv() -> None:
    with System() as system:
        system.add("hmmwv", fmu("FullCarHmmwvPublic"))
        scene = scene_of(system)
        values = values_at(system, scene, 0.0)
        front, rear = (next(w for w in scene.wheels if w.name == n) for n in ("fl", "rr"))
        assert front.x.of(values) - rear.x.of(values) == pytest.approx(3.302, abs=0.02)  # type: ignore[union-attr]
        assert front.z.of(values) - front.radius + front.squash.of(values) == pytest.approx(0, abs=MILLIMETRE)  # type: ignore[union-attr]
        assert front.heading.of(dict.fromkeys(values, 0.0) | {"hmmwv.wheel.fl.toe": 0.02}) == 0.02  # type: ignore[union-attr]
        right = next(w for w in scene.wheels if w.name == "fr")
        assert right.heading.of(dict.fromkeys(values, 0.0) | {"hmmwv.wheel.fr.toe": 0.02}) == -0.02  # type: ignore[union-attr]


# ------------------------------------------------------------------------------------------------- only what there is


def test_what_a_system_has_not_is_not_drawn() -> None:
    with wired("gpc", controller="passive") as system:
        scene = scene_of(system)
        assert {a.role for a in scene.arrows} == {"ground"}
        assert not scene.points
        assert {g.side for g in scene.grounds} == {"left", "right"}
    with wired("trench", controller="passive") as system:
        scene = scene_of(system)
        assert not scene.points
        assert {a.role for a in scene.arrows} == {"ground", "body"}


def test_no_plant_no_scene(raises) -> None:
    with System() as system:
        system.add("road", fmu("RoadSine"))
        system.add("filter", fmu("KalmanHmmwv"))
        assert infer_scene(system) is None
        assert infer_scene(system, "filter") is None
        with raises(WiringError):
            infer_scene(system, "raod")


def test_one_of_several_plants() -> None:
    with System() as system:
        system.add("first", fmu("RideCarHmmwv"))
        system.add("second", fmu("QuarterCarBench"))
        assert scene_of(system).title == "off-road vehicle 'first'"
        assert scene_of(system, "second").title == "quarter car 'second'"


def test_what_a_vehicle_is() -> None:
    with System() as system:
        for name in ("RideCarSedan", "RideCarHmmwv", "ThreeAxleRide", "QuarterCarHmmwv"):
            system.add(name, fmu(name))
        assert [scene_of(system, n).what for n in system.components] == [
            "car",
            "off-road vehicle",
            "6x6",
            "quarter car",
        ]


def test_previews_are_where_they_are_true() -> None:
    with wired("hmmwv", controller="mpc-preview") as system:
        scene = scene_of(system)
        assert [p.role for p in scene.points] == ["preview", "preview", "predicted", "predicted"]
        left = scene.points[0]
        values = dict.fromkeys(scene.variables, 0.0) | {"speed.x": 20.0, "speed.speed": 10.0}
        assert left.x.of(values) == pytest.approx(21.651)  # type: ignore[union-attr]
        assert left.spacing.of(values) == pytest.approx(0.3)  # type: ignore[union-attr]
        assert list(left.heights) == [Value({f"road.preview.fl[{i + 1}]": 1.0}) for i in range(16)]


def test_a_preview_that_sensors_give_is_not_the_road() -> None:
    with wired("hmmwv", states="estimated", preview="sensed") as system:
        scene = scene_of(system)
        assert [p.role for p in scene.points] == ["sensed", "sensed", "predicted", "predicted"]
        assert "buffer.preview.fr[16]" in scene.variables
        labels = [limit.label for limit in scene.limits]
        assert {"controller: no solution", "buffer: preview lost"} <= set(labels)


def test_as_much_of_a_preview_is_drawn_as_counts() -> None:
    with wired("hmmwv", controller="mpc-preview", preview_steps=5) as system:
        points = [p for p in scene_of(system).points if p.role == "preview"]
        assert [len(p.heights) for p in points] == [16, 16]
        assert [p.count.of({"controller.preview.used": 5.0}) for p in points] == [6.0, 6.0]  # type: ignore[union-attr]


class _Predicting:
    """A component of which only the description matters: the next three samples of a suspension."""

    def __init__(self, corner: str) -> None:
        names = [f"predicted.suspension.{corner}.deflection[{i}]" for i in (1, 2, 3)]
        outputs = {n: Variable(n, "real", causality="output") for n in names}
        self.description = Description("Predicting", outputs, kind="discrete", sample_time=Fraction(1, 50))

    def bind(self) -> None:
        """Never run."""

    def close(self) -> None:
        """Holds nothing."""


def test_predicted_travel_begins_with_that_of_now() -> None:
    with wired("hmmwv", controller="lqr") as system:
        system.add("law", _Predicting("fl"))
        scene = scene_of(system)
        (line,) = (p for p in scene.points if p.role == "predicted")
        values = dict.fromkeys(scene.variables, 0.0) | {
            "speed.x": 20.0,
            "speed.speed": 10.0,
            "car.suspension.fl.deflection": 0.01,
            "law.predicted.suspension.fl.deflection[1]": 0.02,
            "law.predicted.suspension.fl.deflection[3]": -0.03,
        }
        (strut,) = (s for s in scene.struts if s.wheel == "fl")
        level = strut.at[2] + scene.bodies[0].z.at_rest  # type: ignore[union-attr]
        assert [h.of(values) - level for h in line.heights] == pytest.approx([0.01, 0.02, 0.0, -0.03])  # type: ignore[union-attr]
        assert line.x.of(values) == pytest.approx(21.651)  # type: ignore[union-attr]
        assert line.spacing.of(values) == pytest.approx(0.2)  # type: ignore[union-attr]


def test_actuators_show_the_force_that_reaches_the_car() -> None:
    with wired("hmmwv", actuators="hydraulic") as system:
        arrows = [a for a in scene_of(system).arrows if a.role == "actuator"]
        assert [dict(a.fz.terms) for a in arrows] == [{f"actuator_{c}.force": 1.0} for c in ("fl", "fr", "rl", "rr")]  # type: ignore[union-attr]
    with wired("hmmwv", actuators="ideal") as system:
        arrows = [a for a in scene_of(system).arrows if a.role == "actuator"]
        assert [dict(a.fz.terms) for a in arrows] == [{f"controller.force.{c}": 1.0} for c in ("fl", "fr", "rl", "rr")]  # type: ignore[union-attr]


def test_wheels_in_the_air() -> None:
    with wired("gpc") as system:
        scene = scene_of(system)
        (limit,) = (one for one in scene.limits if one.label == "rear right wheel in the air")
        assert limit.at == "rr"
        assert limit.value.of({"car.tire.rr.force": 0.0}) > 0  # type: ignore[union-attr]
        assert limit.value.of({"car.tire.rr.force": 500.0}) < 0  # type: ignore[union-attr]


def test_trenches_follow_their_parameters() -> None:
    with wired("trench") as system:
        scene = scene_of(system)
        left, right = scene.trenches
        values = {
            "car.trench.start": 6.0,
            "car.trench.length": 1.5,
            "car.trench.depth": 2.0,
            "car.trench.right_offset": 0.4,
        }
        assert [v.of(values) for v in (left.start, left.length, left.depth)] == [6.0, 1.5, 2.0]  # type: ignore[union-attr]
        assert right.start.of(values) == 6.4  # type: ignore[union-attr]
        assert not scene.reliefs


def test_other_ground_of_the_trench_vehicle() -> None:
    with wired("trench") as system:
        system["car"].set({"obstacle.shape": 2, "outline.points": 3, "outline.left.z": [0.0, 0.2, 0.25, 0, 0, 0]})
        left, right = scene_of(system).reliefs
        assert [z.offset for _, z in left.points] == [0.0, 0.2, 0.25]  # type: ignore[union-attr]
        assert [x.offset for x, _ in right.points] == [5.0, 5.5, 6.5]  # type: ignore[union-attr]
        system["car"].set({"obstacle.shape": 0})
        scene = scene_of(system)
        assert [len(r.points) for r in scene.reliefs] == [1]
        assert not scene.trenches


def test_the_hull_has_the_belly_that_touches() -> None:
    with wired("trench") as system:
        system["car"].set({"outline.belly_height": -0.55})
        scene = scene_of(system)
        lowest = min(z for face in scene.bodies[0].faces for _, _, z in face.points)
        assert lowest == -0.55
        (belly,) = (a for a in scene.arrows if a.name == "belly")
        assert belly.at[2] == Value(offset=-0.55)


def test_grounds_say_how_to_ask_the_road() -> None:
    """The output of the road is that under a wheel, ahead of the place that the road is told."""
    with wired("gpc") as system:
        scene = scene_of(system)
        left = next(g for g in scene.grounds if g.side == "left")
        assert (left.component, left.input, left.output) == ("road", "road.x", "road.road.fl.height")
        x = 38.0  # the CG; the road is a sine from 30 m on, and steep under the wheel
        with System() as alone:
            alone.add("road", fmu("RoadSine"), start={"x": x, "speed": 0.0})
            height = float(alone.run(0.001, record=[left.output])[left.output][0])
        assert height == pytest.approx(_sine(system, x + left.ahead), abs=2e-5)
        assert abs(height - _sine(system, x + left.ahead + 0.01)) > 1e-4


def _sine(system: System, x: float) -> float:
    p = {n: float(v.start) for n, v in system["road"].description.parameters.items() if isinstance(v.start, float)}
    return 0.0 if x < p["flat"] else p["amplitude"] * math.sin(2 * math.pi * (x - p["flat"]) / p["wavelength"])


def test_a_rig_shakes_what_stands_on_it() -> None:
    with wired("bench") as system:
        scene = scene_of(system)
        assert scene.follow == "frame"
        plate = next(b for b in scene.bodies if b.name == "plate")
        assert plate.z == Value({"road.road.height": 1.0})
        assert max(z for face in plate.faces for _, _, z in face.points) == 0.0  # the tire stands on it
        assert {t.role for t in scene.traces} == {"ground", "wheel", "body"}


def test_a_car_on_four_posts() -> None:
    with System() as system:
        system.add("car", fmu("RideCarSedan"))
        system.add("post", fmu("RoadBenchBump"))
        system.connect("post.road.height", "car.road.fl.height")
        scene = scene_of(system)
        plates = {b.name: b for b in scene.bodies[1:]}
        assert plates["plate fl"].z == Value({"post.road.height": 1.0})
        assert plates["plate rr"].z == Value()
        assert not scene.grounds


def test_forces_are_drawn_on_a_scale_of_round_numbers() -> None:
    with wired("hmmwv") as system:
        assert scene_of(system).force_scale in {step * 10.0**power for step in (1, 2, 5) for power in range(7)}
