"""The car on double wishbones beside an independent multibody code: rest, rates, half-rounds and a course."""

import numpy as np
import pytest
from built import OBJECTS
from oracles.multibody import MultibodyCar, level
from oracles.tire_contact import half_round
from scipy.integrate import solve_ivp

from build_fmus.compile import resolve_platforms
from build_fmus.package import build_fmu
from build_fmus.reference import Evaluator
from cosim import Record, System
from fmu_sources.plants import wishbone_car
from fmu_sources.roads import RoadLayout, road_from_file
from fmu_sources.vehicles import load_wishbone_car

CORNERS = ("fl", "fr", "rl", "rr")
INCH, MPH = 0.0254, 0.44704
EDGE = 9.0  # m, where obstacles begin
FORCE = 500.0  # N, of the actuators that lift or roll the car
BLEND = 2e-3  # m: with the jump of the file the tests would compare the instants at which it happens


@pytest.fixture(scope="module")
def vehicle():
    """The public car with damper rates that change over `BLEND`."""
    car = load_wishbone_car("hmmwv_public")
    span = car.suspension.damper_range
    span = span.model_copy(update={"blend": span.blend.model_copy(update={"value": BLEND})})
    return car.model_copy(update={"suspension": car.suspension.model_copy(update={"damper_range": span})})


@pytest.fixture(scope="module")
def car(vehicle):
    return wishbone_car(vehicle, "FullCarTest").model()


def named(model, role):
    return [e.name for e in model.elements(role)]


def test_falls_from_its_design_position_as_rigid_bodies_do(vehicle, car):
    """Springs pressed, dampers through both ranges, wheels through the air onto the road.

    Accelerations, instant by instant.
    """
    judge = MultibodyCar(vehicle).run(0.1, 2.5e-4)
    p, u = car.vector("parameter"), car.vector("input")
    u[named(car, "input").index("target.speed")] = 0.0
    x = np.asarray(car.functions["start"](car.vector("state"), u, p)).ravel()
    value = dict(zip(named(car, "parameter"), p, strict=True))
    states = named(car, "state")
    x[states.index("body.z")], x[states.index("body.pitch")] = 0.8 - value["rest.height"], 0.0
    for k in CORNERS:
        x[states.index(f"wheel.{k}.travel")] = 0.0
    ours = solve_ivp(
        lambda t, x: np.asarray(car.functions["rhs"](0, x, u, p)).ravel(),
        (0.0, 0.1),
        x,
        max_step=5e-4,
        t_eval=judge.time[judge.time <= 0.1],
        rtol=1e-7,
        atol=1e-9,
    )
    run, outputs = Evaluator(car), [e.name for e in car.output_elements()]
    run.u, run.p = u, p
    shown = []
    for state in ours.y.T:
        run.x = state
        shown.append(dict(zip(outputs, run.outputs(), strict=True)))
    for name, close in (("body.az", 0.1), ("seat.az", 0.15)):  # m/s2, of up to 36
        apart = np.abs(np.array([s[name] for s in shown]) - judge[name][: len(shown)])
        assert apart.max() < close, (name, judge.time[apart.argmax()])
    for k in ("fl", "rl"):
        height = value[f"rest.{'front' if k == 'fl' else 'rear'}.wheel_height"]
        assert (
            np.abs([s[f"wheel.{k}.z"] + height for s in shown] - judge[f"wheel.{k}.height"][: len(shown)]).max() < 1e-4
        )
    assert np.abs([s["body.az"] for s in shown]).max() > 30


def drive(built_fmus, road, *, speed, start, duration, force=(0.0,) * 4, parameters=None):
    """Our FMU over a road's FMU; signals by the names of the judge."""
    with System() as system:
        system.add("road", road, parameters=parameters or {})
        inputs = {
            "target.speed": speed,
            "target.y": 0.0,
            **{f"force.{k}": f for k, f in zip(CORNERS, force, strict=True)},
        }
        changed = {"start.x": start, "suspension.damper_range.blend": BLEND}
        system.add("car", built_fmus.path("FullCarHmmwvPublic", 3), step="1 ms", start=inputs, parameters=changed)
        system.connect("car.x", "road.x")
        system.connect("car.speed", "road.speed")
        system.connect_matching("road", "car", "*")
        record = ["body.az", "seat.az", "x", "body.z", "body.roll", "body.pitch", "tire.fl.force", "tire.rl.force"]
        result = system.run(duration, record=Record([f"car.{n}" for n in record], "1 ms"))
    return {n: np.array(result[f"car.{n}"]) for n in record}


def ours_at_rest(built_fmus, force):
    road = built_fmus.path("RoadHalfRoundHmmwvPublic", 3)
    return {n: v[-1] for n, v in drive(built_fmus, road, speed=0.0, start=0.0, duration=2.5, force=force).items()}


def test_stands_where_rigid_bodies_stand(vehicle, built_fmus, car):
    judge = MultibodyCar(vehicle).run(1.5)
    ours = ours_at_rest(built_fmus, (0.0,) * 4)
    height = dict(zip(named(car, "parameter"), car.vector("parameter"), strict=True))["rest.height"]
    assert ours["body.z"] + height == pytest.approx(judge["height"][-1], rel=1e-3)
    assert ours["body.pitch"] == pytest.approx(judge["pitch"][-1], abs=1e-4)
    for k in ("fl", "rl"):
        assert ours[f"tire.{k}.force"] == pytest.approx(judge[f"tire.{k}.force"][-1], rel=2e-3)


@pytest.mark.full
@pytest.mark.parametrize(
    ("signs", "what", "judged"),
    [((1, 1, 1, 1), "body.z", "height"), ((1, -1, 1, -1), "body.roll", "roll")],
    ids=["bounce", "roll"],
)
def test_bounce_and_roll_rates_are_those_of_rigid_bodies(vehicle, built_fmus, signs, what, judged):
    """How far actuators of a force lift or roll the car: the rates of springs, stops, tires and paths in series."""
    force = tuple(FORCE * s for s in signs)
    moved = ours_at_rest(built_fmus, force)[what] - ours_at_rest(built_fmus, (0.0,) * 4)[what]
    judge = [MultibodyCar(vehicle, force=f).run(2.5)[judged][-1] for f in (force, (0.0,) * 4)]
    assert moved == pytest.approx(judge[0] - judge[1], rel=0.02)
    assert abs(moved) > 1e-3


def compared(judge, ours, after, until):
    """Peaks and standard deviations of both [m/s2], by signal."""
    found = {}
    for name in ("body.az", "seat.az"):
        pair = [np.array(s[name])[(np.array(s["x"]) >= after) & (np.array(s["x"]) <= until)] for s in (judge, ours)]
        found[name] = [(a.max(), a.min(), a.std()) for a in pair]
    return found


def assert_alike(found):
    for name, (judge, ours) in found.items():
        peak = max(judge[0], -judge[1])
        assert ours[0] == pytest.approx(judge[0], abs=0.1 * peak), name
        assert ours[1] == pytest.approx(judge[1], abs=0.1 * peak), name
        assert ours[2] == pytest.approx(judge[2], rel=0.05), name


def over_half_round(vehicle, built_fmus, inches, speed, until):
    height, start = inches * INCH, 4.0
    duration = (until - start) / speed * 1.1
    judge = MultibodyCar(vehicle, half_round(height, EDGE - height), speed=speed, start=start).run(duration)
    ours = drive(
        built_fmus,
        built_fmus.path("RoadHalfRoundHmmwvPublic", 3),
        speed=speed,
        start=start,
        duration=duration,
        parameters={"height": height, "position": EDGE},
    )
    assert_alike(compared(judge, ours, 6.0, until))


def test_crosses_a_half_round_as_rigid_bodies_do(vehicle, built_fmus):
    over_half_round(vehicle, built_fmus, 4, 10 * MPH, 12.5)


@pytest.mark.full
@pytest.mark.parametrize(("inches", "mph"), [(4, 5), (4, 20), (8, 10), (8, 15), (8, 20)])
def test_crosses_half_rounds_as_rigid_bodies_do(vehicle, built_fmus, inches, mph):
    over_half_round(vehicle, built_fmus, inches, mph * MPH, 15.0)


@pytest.mark.full
@pytest.mark.parametrize("mph", [10, 20])
def test_rides_over_a_course_as_rigid_bodies_do(vehicle, built_fmus, tmp_path, mph):
    """40 m of a rough course.

    Waves of 0.5 to 20 m with the spectrum of a proving ground's, an inch rms, from a seed.
    """
    random = np.random.default_rng(11)
    at = np.arange(0.0, 60.01, 0.05)
    waves = np.geomspace(0.05, 2.0, 60)  # cycles/m
    heights = sum(w**-1.0 * np.sin(2 * np.pi * (w * at + random.random())) for w in waves)
    heights *= np.clip((at - 8.0) / 4.0, 0.0, 1.0)
    heights *= INCH / heights[at > 12].std()
    file = tmp_path / "course.csv"
    file.write_text(
        "distance [m],left [m],right [m]\n"
        + "".join(f"{x:.2f},{z:.9f},{z:.9f}\n" for x, z in zip(at, heights, strict=True))
    )
    road = tmp_path / "RoadUser.fmu"
    road.write_bytes(build_fmu(road_from_file(file, RoadLayout.of(vehicle)), 3, resolve_platforms("host"), OBJECTS))
    datum = heights[0]
    speed, start, until = mph * MPH, 5.0, 52.0
    duration = (until - start) / speed * 1.1
    judge = MultibodyCar(vehicle, lambda x: np.interp(x, at, heights - datum), speed=speed, start=start).run(duration)
    ours = drive(built_fmus, road, speed=speed, start=start, duration=duration)
    assert_alike(compared(judge, ours, 10.0, until))


def test_judge_has_no_other_road_than_the_one_it_is_given():
    assert level(np.array([1.0, 2.0])).tolist() == [0.0, 0.0]
    assert half_round(0.1, 5.0)(np.array([4.99, 5.1, 5.2])) == pytest.approx([0.0, 0.1, 0.0], abs=1e-9)
