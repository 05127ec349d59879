"""Steering wheel and pedals of the full cars: kinematics, powertrain, brakes, energy, symmetry, steps, old files."""

import re
import tomllib

import casadi as ca
import numpy as np
import pytest
from named import Named
from plants.test_full_car import CORNERS, Car, energy

from fmu_sources.models.double_wishbone import DoubleWishbone
from fmu_sources.plants import full_car, wishbone_car
from fmu_sources.tires.magic_formula import MagicFormula
from fmu_sources.vehicles import load_full_car, load_wishbone_car
from fmu_sources.vehicles.loader import _HERE

ODD = (
    "y",
    "body.roll",
    "body.yaw",
    "body.roll_rate",
    "body.yaw_rate",
    "body.ay",
    "body.roll_acceleration",
    "body.yaw_acceleration",
)
EXTERNAL, WHEEL = {"driver.mode": 1}, {"driver.mode": 2}


@pytest.fixture(scope="module")
def car():
    return Car("hmmwv")


@pytest.fixture(scope="module")
def models(car):
    public = wishbone_car(load_wishbone_car("hmmwv_public"), "FullCarTest").model()
    return {"hmmwv": car.c, "public": public}


def driven(model, parameters, seconds, inputs, speed=15.0, every=10, step=None):
    """Outputs [name -> (n,)] of a drive in steps of 1 ms, each 10 ms; `inputs` of the time."""
    run = Named(model, parameters)
    if step:
        run.p[0] = step
    run.put({"target.speed": speed})
    run.x = run.x
    rows = []
    for i in range(round(seconds * 1e3)):
        run.put(inputs(i * 1e-3)).step(1e-3)
        if i % every == every - 1:
            rows.append(run.shown())
    return {n: np.array([r[n] for r in rows]) for n in rows[0]}


def slalom(side):
    def inputs(t):
        return {
            "steering.wheel": side * 1.5 * np.sin(4 * t),
            "throttle": 0.5 if t < 0.8 else 0.0,
            "brake": 0.4 if t > 1.0 else 0.0,
        }

    return inputs


@pytest.mark.parametrize("name", ["hmmwv", "public"])
def test_left_and_right_mirror(models, name):
    """Rounding of sums over the corners, from front left to rear right, is all that differs."""
    left, right = (driven(models[name], EXTERNAL, 1.6, slalom(side)) for side in (1, -1))
    assert np.ptp(left["y"]) > 0.2
    assert np.abs(left["body.ay"]).max() > 2.0
    for n, values in left.items():
        if n.startswith("body.") or n in ("x", "y", "speed"):
            assert (-1 if n in ODD else 1) * right[n] == pytest.approx(
                values, rel=1e-9, abs=1e-9 + 1e-9 * np.ptp(values)
            )
        if ".fl." in n:
            sign = -1 if n.startswith(("steering",)) else 1
            assert sign * right[n.replace(".fl.", ".fr.")] == pytest.approx(
                values, rel=1e-8, abs=1e-8 + 1e-9 * np.ptp(values)
            )


@pytest.mark.parametrize(("name", "rigid"), [("hmmwv", 1), ("hmmwv_tires", 0), ("hmmwv_tires", 1)])
def test_left_and_right_mirror_to_the_last_bit(name, rigid):
    """On tires of a file, or with wheels as rigid bodies: sums over the corners are by left and right."""
    model = full_car(load_full_car(name), "FullCarTest").model()
    left, right = (driven(model, {**EXTERNAL, "wheel.rigid_body": rigid}, 1.2, slalom(side)) for side in (1, -1))
    assert np.abs(left["body.ay"]).max() > 2.0
    for n, values in left.items():
        if n.startswith("seat."):  # left of the middle
            continue
        odd = n in (*ODD, "body.vy") or "steer" in n or "slip_angle" in n
        swapped = re.sub(r"\.([fr])([lr])\.", lambda m: f".{m[1]}{'r' if m[2] == 'l' else 'l'}.", n)
        assert (right[swapped] == (-values if odd else values)).all(), n


@pytest.mark.parametrize("name", ["hmmwv", "public"])
def test_turns_slowly_about_the_center_of_its_axles(models, name):
    """Near standstill there is no slip: yaw rate = speed x tangent of the steer angle / wheelbase."""
    vehicle = load_full_car("hmmwv") if name == "hmmwv" else load_wishbone_car("hmmwv_public")
    angle = 0.1
    run = driven(models[name], WHEEL, 8.0, lambda _: {"steering.wheel": 15 * angle}, speed=2.0, every=100)
    base = 3.302 if name == "hmmwv" else 2 * 1.688965 + (-1.59 - 1.40) * 0.0254
    yaw_rate = vehicle.body.mass.value and run["body.yaw_rate"][-1] * base / run["speed"][-1]
    assert yaw_rate == pytest.approx(np.tan(angle), rel=0.03)


def test_without_external_mode_the_inputs_do_nothing(models):
    for model in models.values():
        quiet, loud = (driven(model, {}, 0.2, i) for i in (lambda _: {}, slalom(1)))
        assert all((quiet[n] == loud[n]).all() for n in quiet)


def values(model, run):
    """Intermediate values by name."""
    names = list(model.value_sources)
    return dict(zip(names, model.functions["values"](0, run.x, run.u, run.p), strict=True))


def test_differentials_are_open_or_locked(car):
    fast = {f"wheel.{k}.spin": 20.0 + i for i, k in enumerate(("fl", "fr", "rl", "rr"))}
    torques = {}
    for lock in (0.0, 100.0):
        locks = {f"powertrain.{n}_lock": lock for n in ("front", "rear", "center")}
        run = Named(car.c, {**EXTERNAL, **locks, "powertrain.front_share": 0.4})
        run.put({"target.speed": 10.0, "throttle": 0.5, "steering.wheel": 0.0})
        x = run.x.copy()
        for n, v in fast.items():
            x[car.states.index(n)] = v
        run.x = x
        torques[lock] = np.array([float(values(car.c, run)[f"pedal_torque_{k}"]) for k in CORNERS])
    mean = 0.4 * 20.5 + 0.6 * 22.5
    full = 4500 + (mean - 20) * (3000 - 4500) / 10
    assert torques[0.0] == pytest.approx(0.5 * full * np.array([0.2, 0.2, 0.3, 0.3]))
    added = torques[100.0] - torques[0.0]
    assert added == pytest.approx([100 + 100, -100 + 100, 100 - 100, -100 - 100])
    assert added @ np.array(list(fast.values())) < 0  # locks only take energy


def test_brakes_stop_the_car_and_do_not_chatter(models):
    for model in models.values():
        stop = driven(model, EXTERNAL, 4.0, lambda _: {"brake": 1.0, "throttle": 0.0}, speed=8.0)
        hard = stop["body.ax"][20:40].mean()
        assert -10.0 < hard < -5.0
        assert abs(stop["speed"][-1]) < 0.05
        late = stop["body.ax"][-50:]
        assert np.abs(late).max() < 0.05
        assert (np.diff(np.sign(np.diff(late))) != 0).sum() < 12  # pitching fades; no alternation from sample to sample


@pytest.mark.parametrize(
    ("name", "rigid", "throttle", "laps"),
    [("hmmwv", 0, 0.35, 0.5), ("hmmwv", 1, 0.35, 0.5), ("hmmwv_tires", 1, 0.5, 1)],
)
def test_energy_of_laps_with_brakes_and_slip(name, rigid, throttle, laps):
    """What pedals give equals the change of energy and what dampers and slips take; the error is the solver's.

    Wheels as rigid bodies: what leans out of the vertical gives and takes too, in sum next to nothing.
    """
    car = Car(name)
    powers, of = balance(car, rigid), energy(car, dict.fromkeys(CORNERS, 0.0), rigid)
    errors = []
    for step in (1e-3, 5e-4):
        run = Named(car.c, {**EXTERNAL, "suspension.stop.travel": 1.0, "wheel.rigid_body": rigid})
        run.p[0] = step
        run.put({"target.speed": 8.0})
        run.x = run.x
        before, yaw, i, rows, least = float(of(run.x)[0]), 0.0, 0, [], []
        while yaw < 2 * np.pi * laps:
            t = i * step
            run.put(
                {
                    "steering.wheel": 3.5,
                    "throttle": throttle if t % 4 < 2.5 else 0.0,
                    "brake": 0.3 if t % 4 > 3 else 0.0,
                }
            )
            first = powers(run.x, run.u, run.p)
            run.step(step)
            rows.append((first + powers(run.x, run.u, run.p)).full().ravel()[:3] / 2)
            least.append(float(first[3]))
            yaw, i = run.x[car.states.index("body.yaw")], i + 1
            assert i < 60_000
        assert min(least) > 0  # no tire lifts
        given, taken, leaning = np.sum(rows, axis=0) * step
        turned_over = np.abs(rows).sum(axis=0) * step
        work = float(of(run.x)[0]) - before
        assert taken < -0.3 * turned_over[:2].sum() / 2  # the lap is no free rolling
        assert abs(leaning) < 0.02 * abs(taken)
        assert (turned_over[2] > 0) == rigid
        errors.append(abs(work - given - taken - leaning) / turned_over[1])
    assert errors[0] < 1e-5
    assert errors[1] < 0.4 * errors[0]


def balance(car, rigid):
    """Function of state, inputs, parameters: powers [W] on a level road, and the least tire force [N].

    Powers of wheel torques, of dampers and slips, and of struts and tires on what leans. Moments of tires are those of
    `MagicFormula` alone.
    """
    v, f = car.vehicle, car.f
    x, u, p = (ca.SX.sym(n, car.c.size(role)) for n, role in (("x", "state"), ("u", "input"), ("p", "parameter")))
    of = dict(zip(car.c.value_sources, f["values"].call([0, x, u, p]), strict=True))
    s = dict(zip(car.states, ca.vertsplit(x), strict=True))
    y = dict(zip([e.name for e in car.c.elements("output")], ca.vertsplit(f["out"](0, x, u, p)), strict=True))
    tire = MagicFormula(v.tire.file) if v.tire.file else None
    velocity = ca.vertcat(*(s[f"body.v{i}"] for i in "xyz"))
    tangent = ca.tan(u[car.inputs.index("steering.wheel")] / v.steering.ratio.value)
    narrower = v.steering.ackermann.value * v.body.track.value / (2 * v.body.wheelbase.value)
    given = taken = leaning = 0
    for k in CORNERS:
        side = 1 if k[1] == "l" else -1
        turn, omega, strut, hub, patch = (of[n] for n in ("turn", "omega", f"strut_{k}", f"hub_{k}", f"patch_{k}"))
        heading = s["body.yaw"] + (ca.atan(tangent / (1 - side * narrower * tangent)) if k[0] == "f" else 0)
        forward = ca.vertcat(ca.cos(heading), ca.sin(heading), 0)
        sideways = ca.vertcat(-forward[1], forward[0], 0)
        along, across = of[f"drive_force_{k}"] * forward, of[f"side_force_{k}"] * sideways
        at_hub, at_patch = (velocity + ca.cross(omega, r) for r in (hub, patch))
        spin, load = s[f"wheel.{k}.spin"], y[f"tire.{k}.force"]
        given += of[f"wheel_torque_{k}"] * (spin - s["body.pitch_rate"])
        damper = (v.suspension.front if k[0] == "f" else v.suspension.rear).damper.value
        taken -= v.suspension.motion_ratio.value**2 * damper * y[f"suspension.{k}.velocity"] ** 2
        taken -= v.tire.damping.value * s[f"wheel.{k}.vz"] ** 2
        taken += ca.dot(along, at_hub) + ca.dot(across, at_patch)
        taken -= of[f"drive_force_{k}"] * v.wheel.radius.value * spin
        if tire:
            slips = s[f"tire.{k}.slip"], -s[f"tire.{k}.slip_angle"]
            ground = tire.forces(load, *slips, s["body.roll"], ca.dot(at_hub, forward), side)
            taken += ground.my * spin + ca.dot(omega, ground.mx * forward + ground.mz * ca.vertcat(0, 0, 1))
        if rigid:
            taken -= ca.dot(along + across, turn[:, 2]) * (at_hub[2] - s[f"wheel.{k}.vz"])  # the wheel slides there
            leaning += of[f"strut_force_{k}"] * ca.cross(omega, hub - strut)[2] + load * ca.cross(omega, patch - hub)[2]
    least = ca.mmin(ca.vertcat(*(y[f"tire.{k}.force"] for k in CORNERS)))
    return ca.Function("balance", [x, u, p], [ca.vertcat(given, taken, leaning, least)])


@pytest.mark.parametrize("name", ["hmmwv", "public"])
def test_halving_the_solver_step_changes_a_step_steer_by_its_order(models, name):
    def steer(t):
        return {"steering.wheel": min(t / 0.2, 1.0), "throttle": 0.2}

    coarse, fine, finest = (
        driven(models[name], EXTERNAL, 1.2, steer, step=h)["body.ay"] for h in (5e-4, 2.5e-4, 1.25e-4)
    )
    errors = [np.abs(r - finest).max() / np.abs(finest).max() for r in (coarse, fine)]
    assert errors[0] < 2e-3
    assert errors[1] < 0.5 * errors[0]


def test_antiroll_bars_stiffen_roll(car):
    """In a steady turn the roll angle falls as the roll stiffness grows: that of springs and bars, tires in series."""
    roll, moment = [], []
    for bar in (0.0, 4e4):
        run = driven(
            car.c, {**WHEEL, "antiroll.front": bar, "antiroll.rear": bar}, 5.0, lambda _: {"steering.wheel": 0.5}
        )
        roll.append(run["body.roll"][-1])
        moment.append(run["body.ay"][-1])
    v = car.vehicle
    springs = v.suspension.motion_ratio.value**2 * v.suspension.front.spring.value
    tire, half = v.tire.stiffness.value, v.body.track.value / 2
    stiffness = [4 * half**2 * c * tire / (c + tire) for c in (springs, springs + 2 * 4e4)]
    assert (roll[1] / moment[1]) / (roll[0] / moment[0]) == pytest.approx(stiffness[0] / stiffness[1], rel=0.03)


def test_files_without_the_new_groups_load(car, tmp_path):
    data = tomllib.loads((_HERE / "hmmwv.toml").read_text())
    lines, skip = [], False
    for line in (_HERE / "hmmwv.toml").read_text().splitlines():
        skip = line.startswith(("[powertrain", "[brakes", "[antiroll")) or (skip and not line.startswith("["))
        if not skip and not line.startswith(("ratio", "ackermann")):
            lines.append(line)
    assert {"powertrain", "brakes"} <= set(data)
    old = tmp_path / "old.toml"
    old.write_text("\n".join(lines))
    vehicle = load_full_car(old)
    assert vehicle.steering.ratio.source == "assumed: not in the vehicle file"
    model = full_car(vehicle, "FullCarTest").model()
    assert (model.vector("parameter") == car.c.vector("parameter")).mean() > 0.9
    first, second = (driven(m, {}, 0.1, lambda _: {"target.y": 1.0}) for m in (model, car.c))
    assert all((first[n] == second[n]).all() for n in first)


def test_linkage_of_hardpoints():
    """The row has the slope 1 at design, ends where the joints do, and keeps the length of the rod."""
    vehicle = load_wishbone_car("hmmwv_public")
    mechanism = vehicle.suspension.front.mechanism
    nominal, angle = mechanism.steered(0.5, 101)
    middle = len(angle) // 2
    slope = np.gradient(angle, nominal)
    assert slope[middle] == pytest.approx(1.0, abs=1e-4)
    assert (np.diff(angle) > 0).all()
    assert np.abs(angle - nominal).max() < 0.1
    few, _ = mechanism.steered(2.0, 41)  # beyond where the joints close
    assert 0 < few[-1] < 2.0
    # against the mechanism with the inner end of its tierod elsewhere, but for the length of the rod
    moved = dict(mechanism.points)
    rod = np.linalg.norm(moved["tierod_outer"] - moved["tierod_inner"])
    wheel, turn = mechanism._closed(0.0, mechanism.points["wheel_centre"], np.eye(3), shift=0.02)
    outer = wheel + turn @ (moved["tierod_outer"] - moved["wheel_centre"])
    assert np.linalg.norm(outer - moved["tierod_inner"] - [0, 0.02, 0]) == pytest.approx(rod, abs=1e-12)
    assert isinstance(mechanism, DoubleWishbone)
