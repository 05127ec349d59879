"""What readers see of trench, from recordings and runs made by hand whose answers are known."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import made_up
import numpy as np
import pytest
from altered import altered, failed

from cosim.experiments.metrics.crossing import LIMITS, cost
from cosim.experiments.trench import EXPERIMENT, linear, published
from cosim.experiments.trench.claims import CLAIMS
from cosim.experiments.trench.published import BETWEEN, BOLD, GRID, LENGTHS, SPECTRUM, SPEEDS, matrix, refined
from cosim.experiments.trench.report import playback, report
from cosim.experiments.trench.runs import (
    CURVES,
    METRICS,
    MOVING,
    SIDE,
    Case,
    Course,
    bands,
    configure,
    measure,
    signals,
    wire,
)
from cosim.experiments.trench.web import live
from cosim.report import Map, Report, write_report
from cosim.scenes.scene import value
from cosim.study import FmuSet, Results

# ----------------------------------------------------------------------------------------------- a run: loads by hand

STARTS = {"car.wheel.a1l.x": 2.0, "car.wheel.a3l.x": -1.9, "car.outline.front_overhang": 1.0}
UNITS = {"car.body.pitch": "rad", "car.body.z": "m", "car.hub.a1l.fx": "N", "car.hub.a1l.z": "m", "car.body.az": "m/s2"}
T = np.arange(2001) / 4000  # s


def recording(case: Case, time: np.ndarray = T, **other: Any) -> made_up.MadeUpRun:
    """Half a second; samples at 1 kHz count for root mean squares, all for peaks."""
    at_1_khz = np.arange(len(time)) % round(1e-3 / time[1]) == 0
    shown = {
        "car.x": 8.8 + time / 5,
        "car.speed": 1.0,
        "car.body.az": np.where(at_1_khz, 2.0, -9.0),
        "car.body.ax": np.where(at_1_khz, -1.5, 0.5),
        "car.body.pitch": -0.03 * np.sin(np.pi * time),
        "car.body.roll": 0.5,
        "car.body.z": -0.012345 * time,
        "car.bumper.front.force": 0.0,
        "car.bumper.rear.force": 0.0,
        "car.belly.force": 0.5,
        "car.hub.a1l.fx": 5000.4 + time,
        "car.hub.a1r.fx": -7e3,
        "car.hub.a2l.fx": 8e3,
        "car.hub.a2r.fx": 2e3,
        "car.hub.a3l.fx": -9e3,
        "car.hub.a3r.fx": 3e3,
        "car.hub.a1l.x": 1.0,
        "car.hub.a1l.z": 0.58,
        **{f"controller.force.{k}": 1e3 * i for i, k in enumerate(("a1l", "a1r", "a2l", "a3l", "a3r"))},
        "controller.force.a2r": -130e3,
        "controller.solver.status": np.where(time < 0.00999, 1, 0),
        "controller.solver.iterations": 5,
        "controller.solver.residual": 1e-9 * time,
        "crossing.case": np.where(time < 0.25, 0, 2),
    } | {n.replace("_", "."): v for n, v in other.items()}
    shown["car.body.az"][5] = -40.0  # peaks between the samples at 1 kHz
    shown["car.body.ax"][7] = 12.0
    return made_up.run(case, time, shown, STARTS, UNITS)


LOADS = {
    "az": 40.0,
    "ax": 12.0,
    "az_rms": 2.0,
    "ax_rms": 1.5,
    "pitch": math.degrees(0.03),
    "hub_front": 7.0,
    "hub_middle": 8.0,
    "hub_rear": 9.0,
}
SHARES = {
    "az": 12.5,
    "ax": 17.5,
    "az_rms": 12.5,
    "ax_rms": 15.0,
    "pitch": 17.5,
    "hub_front": 10.0,
    "hub_middle": 7.5,
    "hub_rear": 7.5,
}


def test_metrics_of_a_run() -> None:
    found = measure(recording(Case(1.5, 3.6)))
    assert found.pop("failures") == []
    assert found == pytest.approx(
        {
            **LOADS,
            "cost": sum(SHARES[n] * v for n, v in LOADS.items()),
            "trench_start": 3.9,
            "passed": True,
            "outcome": "passed",
            "belly_kn": 0.0005,
            "bumper_front_kn": 0.0,
            "bumper_rear_kn": 0.0,
            "solver_failures": 2,
            "solver_residual": 0.5e-9,
            "force": 130.0,
        }
    )
    assert {m.heading: m.shown(found[k]) for k, m in METRICS.items()} == {
        "peak vertical acceleration, limit 150 [m/s2]": "40",
        "peak longitudinal acceleration, limit 100 [m/s2]": "12",
        "vertical acceleration rms, limit 5 [m/s2]": "2",
        "longitudinal acceleration rms, limit 5 [m/s2]": "1.5",
        "peak pitch, limit 15 [deg]": "1.719",
        "peak front hub force, limit 225 [kN]": "7",
        "peak middle hub force, limit 225 [kN]": "8",
        "peak rear hub force, limit 225 [kN]": "9",
        "cost [-]": "985",
        "largest actuator force [kN]": "130",
        "largest force on the front bumper [kN]": "0",
        "largest force on the rear bumper [kN]": "0",
        "largest force on the belly [kN]": "0.0005",
        "outcome": "passed",
    }


def test_finer_steps_are_the_same_seconds() -> None:
    """Half the step: twice the samples, of which every eighth counts for root mean squares; the solver's time stays."""
    time = np.arange(4001) / 8000
    case = refined(Case(1.5, 3.6))
    coarse, fine = measure(recording(Case(1.5, 3.6))), measure(recording(case, time))
    assert fine["az_rms"] == pytest.approx(2.0)
    assert fine["solver_failures"] == coarse["solver_failures"]
    assert signals(recording(case, time))["frames"]["car.x"] == signals(recording(Case(1.5, 3.6)))["frames"]["car.x"]


@pytest.mark.parametrize(
    ("changed", "outcome"),
    [
        ({"car_bumper_front_force": 700.0, "car_bumper_rear_force": 300.0}, "passed, on its bumpers"),
        ({"car_belly_force": 2000.0}, "failed: belly contact"),
        ({"car_x": 8.7}, "failed: stuck"),
        ({"car_hub_a2r_fx": -226e3, "car_hub_a3r_fx": 226e3}, "failed: hub force"),
        ({"car_belly_force": 2000.0, "car_hub_a2r_fx": 226e3}, "failed: belly contact, hub force"),
        ({"car_body_pitch": 0.3}, "failed: pitch"),
    ],
)
def test_what_became_of_a_crossing(changed: dict[str, float], outcome: str) -> None:
    row = measure(recording(Case(1.5, 3.6), **changed))
    assert row["outcome"] == outcome
    assert row["passed"] == outcome.startswith("passed") == (not row["failures"])
    assert [row[f"{n}_kn"] for n in ("bumper_front", "bumper_rear", "belly")] == [
        changed.get(f"car_{n}_force", 0.5 if n == "belly" else 0.0) / 1e3
        for n in ("bumper_front", "bumper_rear", "belly")
    ]


def test_course() -> None:
    """Flat road until the pitch reference begins.

    Here 0.6 m and 0.8 s, then 0.2 s and 0.3 m, ahead of the first axle.
    """
    course = Course.of(recording(Case(1.5, 3.6)))
    assert (course.start, course.end) == (3.9, pytest.approx(3.9 + 1.5 + 1.9 + 1.5))
    assert course.patience == pytest.approx(1.25 * 8.8 / 1.0 + 2.0)
    assert Course.of(recording(Case(1.5, 7.2))).start == pytest.approx(2.0 + 0.6 + 0.8 * 2 + 0.2 * 2 + 0.3)
    assert Course.of(recording(Case(1.5, 0.5))).start == pytest.approx(3.3)  # slow: the nose decides


def test_a_touch_counts_however_short() -> None:
    found = measure(recording(Case(1.5, 3.6), car_belly_force=np.where(T[77] == T, 2000.0, 0.0)))
    assert (found["belly_kn"], found["failures"]) == (2.0, ["belly contact"])


def test_bands_of_a_spectrum_begin_at_0_3_hz() -> None:
    frequency = np.arange(0.32, 400.0, 0.02)
    found, density = bands(frequency, 1.0 / frequency)
    assert found[0] == pytest.approx(10 ** (-0.5 + 1 / 24))
    assert found[-1] < 400
    assert density == pytest.approx([1 / f for f in found], rel=0.05)


def test_signals_of_a_run() -> None:
    found = signals(recording(Case(1.5, 3.6)))
    frames = found["frames"]
    assert frames["car.x"] == [round(8.8 + 0.02 * i / 5, 3) for i in range(26)]  # every 20 ms
    assert frames["car.body.pitch"][5] == round(-0.03 * math.sin(math.pi * 0.1), 5)
    assert frames["car.body.z"][25] == -0.0062
    assert frames["car.hub.a1l.fx"][0] == 5000.0
    assert frames["crossing.case"] == [0.0] * 13 + [2.0] * 13
    assert "car.body.roll" not in frames
    time, pitch = found["curves"]["car.body.pitch"]
    assert time[-1] == 0.5
    assert pitch[-1] == -0.03
    az, ax = (found["curves"][f"car.body.{axis}"] for axis in ("az", "ax"))
    assert (min(az[1]), max(ax[1])) == (-40.0, 12.0)
    assert az[0][az[1].index(-40.0)] == 0.00125
    assert found["curves"].keys() == {"car.body.pitch", "car.body.az", "car.body.ax", "car.hub.a1l.fx"}


def test_spectra_are_those_of_their_axes_at_1_khz() -> None:
    time = np.arange(8000) / 4000
    run = recording(
        Case(1.5, 3.6), time, car_body_az=np.sin(2 * np.pi * 10 * time), car_body_ax=np.sin(2 * np.pi * 100 * time)
    )
    found = signals(run)["spectra"]
    for axis, tone in (("az", 10.0), ("ax", 100.0)):
        frequency, density = found[axis]
        assert frequency[int(np.argmax(density))] == pytest.approx(tone, rel=0.15)


def test_signals_of_the_linear_comparison() -> None:
    time = np.arange(4) / 100
    for vehicle, speed in (("linear", "speed.speed"), ("nonlinear", "car.speed")):
        given = {"car.body.z": -0.1 * time, "car.body.pitch": 0.01 + time, speed: 1.5 + time}
        found = linear.signals(made_up.run(linear.Shallow(vehicle), time, given, {}))
        assert found["time"] == time.tolist()
        assert found["z"] == (-0.1 * time).tolist()
        assert found["pitch"] == pytest.approx((0.01 + time) * 180 / math.pi)
        assert found["speed"] == pytest.approx((1.5 + time) * 3.6)


# ----------------------------------------------------------------------------------------------- a scene by hand


def drawn(number: float) -> dict[str, Any]:
    """Signals over four frames, no two alike."""
    frames = {n: [number + i + 0.001 * j for j in range(4)] for i, n in enumerate(MOVING)}
    frames |= {"car.body.pitch": [0.0, 0.1, 0.2, 0.3], "crossing.case": [0.0, 1.0, 2.0, 3.0]}
    curves = {n: [[0.0, 1.0, 2.0], [number + i, 10.0 * i, -number]] for i, n in enumerate(CURVES)}
    return {
        "frames": frames,
        "curves": curves,
        "spectra": {a: ([1.0, 10.0], [number, i + 1.0]) for i, a in enumerate(("az", "ax"))},
    }


def test_a_playback_is_what_was_recorded(fmus: FmuSet) -> None:
    signal = drawn(5.0)
    frame = {n: np.array(v) for n, v in signal["frames"].items()}
    row = {"trench_start": 4.0, "outcome": "passed", "passed": True}
    found = playback("controlled", Case(1.7, 3.0, cg_offset=0.05), row, signal, fmus)
    looks, series = found.scene, found.series
    assert {"car.hub.a3r.x", "car.contact.a1r.fz", "car.tire.a2l.deflection"} < set(looks.variables)
    for name in set(looks.variables) & set(MOVING):
        np.testing.assert_array_equal(series[name], frame[name])
    for k in SIDE:
        for name in ("hub.{}.z", "contact.{}.fz", "tire.{}.deflection"):  # the other side moves alike
            assert series[f"car.{name.format(k[:-1] + 'r')}"] is series[f"car.{name.format(k)}"]
    assert series["car.body.roll"] == 0.0
    assert [series[f"car.trench.{n}"] for n in ("start", "length", "right_offset")] == [4.0, 1.7, 0.0]
    last = {n: np.ravel(v)[-1] for n, v in series.items()}
    (body,) = looks.bodies
    assert value(body.x).of(last) == frame["car.x"][-1]
    assert value(body.pitch).of(last) == 0.3
    readings = {f"{r.label} [{r.unit}]": r.factor * value(r.value).of(last) for r in looks.readings}
    assert readings == {
        "pitch, nose down [deg]": pytest.approx(math.degrees(0.3)),
        "speed [km/h]": pytest.approx(3.6 * frame["car.speed"][-1]),
        "vertical acceleration [m/s2]": frame["car.body.az"][-1],
        "front hub force [kN]": pytest.approx(frame["car.hub.a1l.fx"][-1] / 1e3),
    }
    arrows = {a.name: value(a.fz).of(last) for a in looks.arrows if a.role == "body"}
    assert sorted(arrows.values()) == sorted(
        frame[f"car.{n}.force"][-1] for n in ("bumper.front", "bumper.rear", "belly")
    )
    assert found.phase is not None
    assert found.phase.names[1] == "case 1: front axle over the trench"
    assert (found.step, found.outcome, found.good, looks.force_scale) == (0.02, "passed", True, 1e5)


# ----------------------------------------------------------------------------------------------- systems


MPC = {"estimator": 0, "retraction": 1, "hold_height": True, "printed_limits": False, "use_preview": True}


@pytest.mark.parametrize(
    ("controller", "set_to"),
    [
        ("mpc", MPC),
        ("mpc-no-preview", MPC | {"use_preview": False}),
        ("mpc-offsets", MPC | {"estimator": 1, "use_preview": False}),
        ("mpc-free", MPC | {"retraction": 0}),
        ("mpc-printed-sign", MPC | {"retraction": 2}),
        ("mpc-no-height", MPC | {"hold_height": False}),
        ("mpc-printed-limits", MPC | {"printed_limits": True}),
        ("lqr", {}),
    ],
)
def test_the_controller_of_a_case(fmus: FmuSet, controller: str, set_to: dict[str, Any]) -> None:
    case = Case(1.4, 9.0, controller, friction=0.3, mass_factor=1.1)
    with wire(fmus, case) as system:
        configure(system, case)
        name = "LqrThreeAxle" if controller == "lqr" else "MpcThreeAxle"
        assert {f.stem for f in system.fmu_files} == {"ThreeAxleTrench", "TrenchCrossing", name}
        assert {n: system["controller"].values.get(n) for n in set_to} == set_to
        car = system["car"].values
        assert (car["trench.length"], car["disc.friction"], car["solver.step"]) == (1.4, 0.3, 0.00025)
        assert car["target.speed"] == pytest.approx(2.5)
        assert car["body.mass"] == pytest.approx(1.1 * float(system["car"].description.parameters["body.mass"].start))
        wires = {target: c.source_name for target, c in system.connections.items()}
        assert wires["car.force.a2r"] == "controller.force.a2r"
        reference = "controller.reference.pitch" + "[1]" * (controller != "lqr")
        assert wires.get(reference, wires.get("controller.reference.pitch", "")).startswith("crossing.reference.pitch")


def test_the_two_vehicles_of_the_linear_comparison_meet_one_trench(fmus: FmuSet) -> None:
    """2 m long from 6 m on, 0.15 m deep, at 5 km/h; its edges are slopes over 0.2 m to either side."""
    with linear.wire(fmus, linear.Shallow("linear")) as system:
        assert {f.stem for f in system.fmu_files} == {"SpeedProfile", "RoadShallowTrench", "ThreeAxleRide"}
        assert system["speed"].values["start.speed"] == pytest.approx(5 / 3.6)
        road = system["road"].values
        assert [road[f"trench.{n}"] for n in ("start", "length", "depth", "edge")] == [6.0, 2.0, 0.15, 0.2]
    with linear.wire(fmus, linear.Shallow("nonlinear")) as system:
        car = system["car"]
        assert [f.stem for f in system.fmu_files] == ["ThreeAxleTrench"]
        assert car.values["target.speed"] == pytest.approx(5 / 3.6)
        for side in ("left", "right"):
            x, z = ([car.values[f"outline.{side}.{n}[{i}]"] for i in (1, 2, 3, 4)] for n in "xz")
            assert x == pytest.approx([5.8, 6.2, 7.8, 8.2])
            assert z == [0.0, -0.15, -0.15, 0.0]
        assert (car.values["wheel.a1l.x"], car.values["wheel.a3r.x"]) == (1.98, -2.02)  # of the linear vehicle
        assert car.values["tire.a2l.damping"] == 1500.0


def test_the_linear_comparison_lasts_until_5_m_behind_the_trench() -> None:
    assert linear.PART.name == "shallow"
    assert linear.PART.run.stop_time == pytest.approx((6 + 2 + 5) / (5 / 3.6), abs=1e-3)


# ------------------------------------------------------------------------------------------ a study: every cell by hand


def metrics(case: Any) -> dict[str, Any]:
    """Loads grow with length and speed; costs by hand: passive 2000 to 2350, controlled 1000 to 1175."""
    if isinstance(case, linear.Shallow):
        return {}
    key, passive = (case.length, case.speed_kmh), case.controller == "passive"
    index = GRID.index(key) if key in GRID else 10
    factor = (
        (1 + 0.1 * index) * (3.0 if passive else 1.0) * (1.05 if case.solver_parts == case.exchange_parts == 2 else 1.0)
    )
    factor *= (
        1 + (case.cg_offset or 0.0) + (case.mass_factor - 1) + 0.3 * case.hydropneumatic + 0.1 * (case.friction or 0.0)
    )
    loads = {n: factor * (i + 1) for i, n in enumerate(SHARES)}
    good = published.passed(*key) if passive else case.controller != "lqr"
    row = {
        **loads,
        "cost": 2000 + 10 * index if passive else 1000 + 5 * index,
        "passed": good,
        "failures": [] if good else ["stuck"],
        "outcome": "passed" if good else "failed: stuck",
        "trench_start": 4.0,
    }
    if not passive:
        row |= {"force": 100.0 + index}
    if case.controller.startswith("mpc"):
        row |= {"solver_failures": 0, "solver_residual": 1e-12}
    return row


def shown(case: Any) -> dict[str, Any]:
    if isinstance(case, linear.Shallow):
        number = 1.0 if case.vehicle == "linear" else 2.0
        return {"time": [0.0, 1.0], "z": [number, 0.1], "pitch": [number, 0.2], "speed": [number, 0.3]}
    return drawn(round(100 * case.length) + case.speed_kmh + 0.5 * (case.controller == "mpc"))


@pytest.fixture(scope="module")
def study() -> Results:
    return made_up.study(EXPERIMENT, metrics, shown)


def test_cells_of_the_crossings(page: Report) -> None:
    loads = [
        "az [m/s2]",
        "ax [m/s2]",
        "rms az [m/s2]",
        "rms ax [m/s2]",
        "pitch [deg]",
        "hub front [kN]",
        "hub middle [kN]",
    ]
    names = [*loads, "hub rear [kN]"]
    rows = made_up.table(page, "passive-crossings")
    assert [(r["length [m]"], r["speed [km/h]"]) for r in rows] == list(GRID)
    at = GRID.index((1.4, 3.0))
    assert rows[at] == pytest.approx(
        {
            "length [m]": 1.4,
            "speed [km/h]": 3.0,
            **{n: 3 * (1 + 0.1 * at) * (i + 1) for i, n in enumerate(names)},
            "outcome": "failed: stuck",
            "at half the step": "the same",
            "Table 5.4": "failed",
        }
    )
    assert rows[0]["Table 5.4"] == "passed"
    rows = made_up.table(page, "mpc-crossings")
    assert rows[at] == pytest.approx(
        {
            "length [m]": 1.4,
            "speed [km/h]": 3.0,
            **{n: (1 + 0.1 * at) * (i + 1) for i, n in enumerate(names)},
            "outcome": "passed",
            "at half the step": "the same",
            "largest actuator force [kN]": 100.0 + at,
        }
    )


def test_a_verdict_that_changes_is_told(study: Results, fmus: FmuSet) -> None:
    case = Case(1.4, 3.0, "mpc")
    other = {"passed": False, "failures": ["pitch"], "outcome": "failed: pitch"}
    changed = report(altered(study, {refined(case): other}), fmus)
    rows = made_up.table(changed, "mpc-crossings")
    assert [r["at half the step"] for r in rows if r["at half the step"] != "the same"] == ["failed: pitch"]
    assert rows[GRID.index((1.4, 3.0))]["outcome"] == "passed"
    (text,) = next(s.paragraphs for s in changed.sections if s.title == "Steps")
    assert text == "Halving the step changes 1 of 72 verdicts: 1.4 m at 3 km/h, controlled; these are open."


def test_cells_of_what_control_takes_off(page: Report) -> None:
    row = made_up.table(page, "reductions")[GRID.index((1.2, 3.0))]
    assert row == {
        "length [m]": 1.2,
        "speed [km/h]": 3.0,
        "az [%]": 67,
        "az, thesis [%]": 84,
        "ax [%]": 67,
        "ax, thesis [%]": 66,
        "pitch [%]": 67,
        "pitch, thesis [%]": 38,
        "az rms [%]": 67,
        "az rms, thesis [%]": 22,
        "ax rms [%]": 67,
        "ax rms, thesis [%]": 27,
    }


def test_what_control_takes_off_is_that_of_each_quantity(study: Results, fmus: FmuSet) -> None:
    loads = {"az": 1.0, "ax": 2.0, "pitch": 3.0, "az_rms": 4.0, "ax_rms": 5.0}
    changed = altered(study, {Case(1.2, 3.0, "passive"): dict.fromkeys(loads, 10.0), Case(1.2, 3.0): loads})
    row = made_up.table(report(changed, fmus), "reductions")[1]
    assert [row[f"{n} [%]"] for n in ("az", "ax", "pitch", "az rms", "ax rms")] == [90, 80, 70, 60, 50]


def test_cells_of_the_costs(page: Report) -> None:
    rows = made_up.table(page, "costs")
    assert rows[-1] == {
        "length [m]": 2.0,
        "speed [km/h]": 9.0,
        "passive": 2350,
        "passive, thesis": 19597.1,
        "controlled": 1175,
        "controlled, thesis": 1177.5,
        "passive, normalized": 1.0,
        "controlled, normalized": 0.13,
        "improvement [%]": 87.0,
        "improvement, thesis [%]": 100.0,
        "score": 1.0,
        "score, thesis": 5.0,
    }
    assert (rows[0]["controlled, normalized"], rows[0]["passive, normalized"], rows[0]["score"]) == (0.0, 0.741, 5.0)
    assert rows[GRID.index((1.6, 3.0))]["score, thesis"] is None


def test_nothing_is_a_share_of_the_cheapest_crossing(study: Results, fmus: FmuSet) -> None:
    changed = report(altered(study, {Case(1.2, 1.0, "passive"): {"cost": 900.0}}), fmus)
    assert made_up.table(changed, "costs")[0]["improvement [%]"] is None


def test_cells_of_finer_steps(page: Report) -> None:
    rows = made_up.table(page, "refinement")
    assert [r["system"] for r in rows] == ["passive"] * 8 + ["controlled"] * 8
    row = rows[12]  # the fifth quantity under control
    assert (row["quantity"], row["median change [%]"]) == ("peak pitch [deg]", pytest.approx(5.0))
    length, speed = row["where"].split(", ")
    index = GRID.index((float(length.split()[0]), float(speed.split()[0])))
    assert (row["as run"], row["at half the step"]) == pytest.approx(
        (5 * (1 + 0.1 * index), 1.05 * 5 * (1 + 0.1 * index))
    )


def test_one_crossing_moves_most(study: Results, fmus: FmuSet) -> None:
    changed = report(altered(study, {refined(Case(1.7, 6.0)): {"pitch": 20.0}, Case(1.7, 6.0): {"pitch": 10.0}}), fmus)
    row = made_up.table(changed, "refinement")[12]
    assert list(row.values())[2:] == [pytest.approx(5.0), pytest.approx(100.0), "1.7 m, 6 km/h", 10.0, 20.0]


def test_cells_beyond_the_published_runs(page: Report) -> None:
    rows = made_up.table(page, "between")
    assert [(r["length [m]"], r["speed [km/h]"]) for r in rows] == list(BETWEEN)
    assert list(rows[0].values())[2:] == pytest.approx([2.0, 4.0, 10.0, 12.0, 14.0, 16.0, 1050, "passed"])
    steepest = 5 * (1 + 0.1 * 35)
    rows = made_up.table(page, "without")
    assert [r["change"] for r in rows] == ["as it is", *published.WITHOUT.values()]
    assert rows[0] == pytest.approx(
        {
            "change": "as it is",
            "passed": 12,
            "of": 12,
            "stuck": 0,
            "belly contact": 0,
            "largest pitch [deg]": steepest,
            "largest az [m/s2]": steepest / 5,
            "mean cost [-]": round(1000 + 5 * np.mean([0, 1, 2, 3, 16, 17, 18, 19, 32, 33, 34, 35])),
            "failed [m]/[km/h]": "–",
        }
    )
    assert [rows[-1][n] for n in ("change", "passed", "of", "stuck", "belly contact")] == [
        "LQR (Table 4.1)",
        0,
        12,
        12,
        0,
    ]
    assert rows[-1]["failed [m]/[km/h]"].startswith("1.2/1, 1.6/1, 2/1, 1.2/3")
    rows = made_up.table(page, "vehicles")
    factors = [1, 1.02, 0.98, 1.05, 0.95, 1.06, 1.04, 1.1, 1.2, 1.3]
    assert [r["largest pitch [deg]"] for r in rows] == pytest.approx([steepest * f for f in factors])
    assert [r["vehicle"] for r in rows] == ["as the controller knows it", *published.OTHER_VEHICLES]


def test_belly_contact_is_counted_apart(study: Results, fmus: FmuSet) -> None:
    changed = altered(study, {Case(1.6, 3.0, "lqr"): {"failures": ["belly contact"]}})
    row = made_up.table(report(changed, fmus), "without")[-1]
    assert (row["stuck"], row["belly contact"]) == (11, 1)


def test_figures_draw_what_they_say(page: Report) -> None:
    number = "5-29", (1.5, 3.0)
    for name, controller in (("passive", "passive"), ("controlled", "mpc")):
        own = shown(Case(*number[1], controller))["curves"]
        for title, signal, factor in (
            ("Pitch, nose down", "car.body.pitch", 180 / math.pi),
            ("Vertical acceleration", "car.body.az", 1.0),
            ("Longitudinal acceleration", "car.body.ax", 1.0),
            ("Front hub force", "car.hub.a1l.fx", 1e-3),
        ):
            curve = made_up.series(page, f"figure-{number[0]}", title, name)
            assert list(curve.x) == own[signal][0]
            np.testing.assert_allclose(curve.y, factor * np.array(own[signal][1]))
        for word, axis in (("Vertical", "az"), ("Longitudinal", "ax")):
            curve = made_up.series(page, "figure-5-39", f"{word} acceleration", name)
            assert (list(curve.x), list(curve.y)) == shown(Case(*SPECTRUM, controller))["spectra"][axis]
    for name in ("linear", "nonlinear"):
        own = shown(linear.Shallow(name))
        for title, signal in (
            ("Body height (figure 5.1)", "z"),
            ("Pitch, nose down (figure 5.2)", "pitch"),
            ("Speed (figure 5.3)", "speed"),
        ):
            curve = made_up.series(page, "figure-5-1", title, name)
            assert (list(curve.x), list(curve.y)) == (own["time"], own[signal])


def test_map_of_the_cost(page: Report) -> None:
    (made,) = (f for f in page.figures if isinstance(f, Map))
    assert made.reference == pytest.approx((cost(LIMITS) - 1000) / 1350)
    assert made.value_range == (0.0, max(1.0, made.reference or 0.0))
    assert (list(made.x), list(made.y)) == ([1.2, 1.3, 1.4, 1.5, 1.6, 1.7, 1.8, 1.9, 2.0], [1.0, 3.0, 6.0, 9.0])
    layers = {layer.name: np.asarray(layer.values) for layer in made.layers}
    at = GRID.index((1.4, 6.0))
    assert layers["passive"][2, 2] == pytest.approx((1000 + 10 * at) / 1350)
    assert layers["controlled"][2, 2] == pytest.approx(5 * at / 1350)


def test_the_animation_shows_the_crossings_of_section_5_5(page: Report) -> None:
    takes = page.animations[0].takes
    assert [t.title for t in takes] == [f"{a:g} m, {v:g} km/h" for a, v in BOLD[::-1]]
    for take, key in zip(takes, BOLD[::-1], strict=True):
        for seen, controller in zip(take.scenes, ("passive", "mpc"), strict=True):
            assert list(seen.series["car.x"]) == shown(Case(*key, controller))["frames"]["car.x"]
            assert seen.outcome == metrics(Case(*key, controller))["outcome"]


def test_main_result(page: Report) -> None:
    """The numbers, and a point for each crossing."""
    good = [k for k in GRID if published.passed(*k)]
    assert page.lead == (
        "With predictive control the 6x6 passes 36 of 36 crossings of trenches 1.2 to 2 m long at 1 to 9 km/h, within"
        " the limits of acceleration, pitch and hub force and without contact of the belly; without control it passes"
        f" {len(good)} of 36."
    )
    for panel, name, keys in (
        ("passive", "passes", good),
        ("passive", "fails", [k for k in GRID if k not in good]),
        ("controlled", "passes", GRID),
    ):
        marks = made_up.series(page, "main-result", panel, name)
        assert list(zip(marks.x, marks.y, strict=True)) == list(keys)  # type: ignore[arg-type]


def test_a_crossing_that_fails_is_drawn_and_counted_as_such(study: Results, fmus: FmuSet) -> None:
    made = report(altered(study, {Case(1.6, 3.0): {"passed": False}}), fmus)
    assert "passes 35 of 36 crossings" in made.lead
    marks = made_up.series(made, "main-result", "controlled", "fails")
    assert (list(marks.x), list(marks.y)) == ([1.6], [3.0])


def test_a_failed_run_is_left_out_of_the_page(study: Results, fmus: FmuSet, tmp_path: Path) -> None:
    made = report(failed(study, Case(2.0, 9.0)), fmus)
    assert made.lead == "The main result is left out: the run 2m-9kmh-mpc failed: ComponentError: it broke"
    assert made.figure is None
    assert made.animation is not None
    assert [t.title for t in made.animation.takes] == [
        f"{a:g} m, {v:g} km/h" for a, v in BOLD[::-1] if (a, v) != (2, 9)
    ]
    text = write_report(made, tmp_path).read_text(encoding="utf-8")
    assert "Left out: the run 2m-9kmh-mpc failed: ComponentError: it broke" in text
    assert [s.title for s in made.sections if s.paragraphs and s.paragraphs[0].startswith("Left out")] == [
        "Verdicts",
        "Peaks, pitch and spectra",
        "Cost",
        "Time histories and spectra",
        "Steps",
        "Ablation",
        "Robustness to the vehicle",
    ]


def test_a_study_of_the_published_runs_has_no_other_sections(fmus: FmuSet) -> None:
    made = report(made_up.study(EXPERIMENT, metrics, shown, published_only=True), fmus)
    titles = {s.title for s in made.sections}
    assert not titles & {"Between the grid points", "Ablation", "Robustness to the vehicle"}
    assert titles > {"Linear compared with nonlinear vehicle", "Verdicts"}


def test_words_where_control_does_not_help(study: Results) -> None:
    worse = {Case(1.2, v): {"az": 99.0, "cost": 5000.0} for v in (1.0, 3.0)} | {Case(1.3, 9.0): {"ax": 99.0}}
    found = {c.id: c.result for c in CLAIMS.judge(altered(study, worse))}
    assert found["peak-az"] == "34 of 36; not 1.2 m at 1, 3 km/h"
    assert found["peak-ax"] == "35 of 36; not 1.3 m at 9 km/h"
    assert found["cost-below-passive"].endswith("; not 1.2 m at 1, 3 km/h")


def test_words_where_many_crossings_do_not_count(study: Results) -> None:
    """Up to half of them are named, more are not."""
    some, many = ({Case(a, v): {"az": 99.0} for a in LENGTHS for v in speeds} for speeds in (SPEEDS[:2], SPEEDS[:3]))
    found = {c.id: c.result for c in CLAIMS.judge(altered(study, some))}["peak-az"]
    assert found == f"18 of 36; not {', '.join(f'{a:g} m at 1, 3 km/h' for a in LENGTHS)}"
    assert {c.id: c.result for c in CLAIMS.judge(altered(study, many))}["peak-az"] == "9 of 36"


def test_nine_of_ten_verdicts_are_the_magnitude(study: Results) -> None:
    for wrong, verdict in ((3, "calibrated"), (4, "trend reproduced, magnitude differs"), (13, "not reproduced")):
        turned = {}
        for k in GRID[:wrong]:
            passed = not published.passed(*k)
            row = {"passed": passed, "failures": [] if passed else ["stuck"]}
            turned |= dict.fromkeys((Case(*k, "passive"), refined(Case(*k, "passive"))), row)
        found = {c.id: c for c in CLAIMS.judge(altered(study, turned))}["passive-verdicts"]
        assert (found.verdict, found.value) == (verdict, 36 - wrong)


def test_the_least_improvement_is_the_magnitude(study: Results) -> None:
    """63.5 % in print: 57.15 % are near enough."""
    costs = [row["cost"] for row in (study[c] for s in ("passive", "mpc") for c in matrix(s))]
    key = GRID[20]
    base, low = study[Case(*key, "passive")]["cost"], min(costs)
    for taken, verdict in ((0.58, "reproduced"), (0.56, "trend reproduced, magnitude differs")):
        changed = altered(study, {Case(*key): {"cost": base - taken * (base - low)}})
        found = {c.id: c for c in CLAIMS.judge(changed)}["cost-below-passive"]
        assert (found.verdict, found.value) == (verdict, pytest.approx(100 * taken))


def test_one_step_that_is_not_solved_counts(study: Results) -> None:
    for change in ({"solver_residual": 2e-6}, {"solver_failures": 1}):
        found = {c.id: c.verdict for c in CLAIMS.judge(altered(study, {Case(1.5, 3.0): change}))}
        assert found["solver"] == "does not hold"


def test_a_crossing_that_fails_at_one_step_alone_decides_nothing(study: Results) -> None:
    """One of 36 that halving the step turns leaves the claim open; one that fails at both makes it false."""
    fails = {"passed": False, "failures": ["stuck"]}
    one = altered(study, {refined(Case(1.7, 6.0)): fails})
    found = {c.id: c for c in CLAIMS.judge(one)}["controlled-pass"]
    assert (found.verdict, found.reason) == ("open", "halving the step changes the verdict of 1.7 m at 6 km/h: stuck")
    both = altered(study, {Case(1.7, 6.0): fails, refined(Case(1.7, 6.0)): fails})
    found = {c.id: c for c in CLAIMS.judge(both)}["controlled-pass"]
    assert (found.verdict, found.reason) == ("not reproduced", "see the failures in the table of controlled runs")


def test_dear_slow_crossings_score_lower(study: Results) -> None:
    dear = altered(study, {Case(k[0], k[1]): {"cost": 1999.0} for k in GRID if k[1] <= 3})
    assert {c.id: c.verdict for c in CLAIMS.judge(dear)}["scores"] == "reproduced"


def test_slow_crossings_and_small_steps_cost_most_and_the_passive_vehicle_least() -> None:
    costs = {t.case: t.cost for t in published.plan()}
    assert costs[Case(1.6, 1.0)] == 1.0
    assert costs[Case(1.6, 1.0, "passive")] == 0.3
    assert costs[refined(Case(1.6, 1.0))] == 2.0
    assert costs[Case(1.6, 6.0)] == pytest.approx(1 / 6)


def test_matrix_is_by_length_and_speed() -> None:
    assert [(c.length, c.speed_kmh) for c in matrix("passive")] == list(GRID)


@pytest.mark.parametrize(
    ("figure", "metric", "printed"),
    [
        ("az-over-length", "az", "az [m/s2]"),
        ("pitch-over-length", "pitch", "pitch [deg]"),
        ("cost-over-length", "cost", "cost"),
    ],
)
def test_what_the_thesis_prints_is_drawn_under_ours(
    page: Report, study: Results, figure: str, metric: str, printed: str
) -> None:
    points = 0
    for speed in SPEEDS:
        for name, system in (("passive", "passive"), ("controlled", "mpc")):
            ours = made_up.series(page, figure, f"{speed:g} km/h", name)
            assert list(ours.x) == list(LENGTHS)
            assert list(ours.y) == [study[Case(a, speed, system)][metric] for a in LENGTHS]
            theirs = made_up.series(page, figure, f"{speed:g} km/h", f"{name}, thesis")
            cells = [float(published.rows()[a, speed][f"{name} {printed}"] or "nan") for a in LENGTHS]
            assert np.array_equal(np.asarray(theirs.y), cells, equal_nan=True)
            points += int(np.isfinite(cells).sum())
    known = [r[f"{n} {printed}"] for r in published.rows().values() for n in ("passive", "controlled")]
    assert points == sum(map(bool, known)) > 36


def test_columns_of_the_thesis() -> None:
    row = published.rows()[1.5, 3.0]
    found = published.passive(1.5, 3.0)
    for name, column in (
        ("az", "az [m/s2]"),
        ("ax", "ax [m/s2]"),
        ("az_rms", "az rms [m/s2]"),
        ("ax_rms", "ax rms [m/s2]"),
        ("pitch", "pitch [deg]"),
    ):
        assert getattr(found, name) == float(row[f"passive {column}"])


# -------------------------------------------------------------------------------------------------------- the live page


def test_words(page: Report, sentence) -> None:
    sentence(made_up.words(page))


def test_the_live_page(sentence) -> None:
    sentence(made_up.live_words(live(Case())))


@pytest.mark.parametrize("speed", [0.5, 3.6, 9.0])
def test_the_live_page_drives_the_course_of_the_study(speed: float) -> None:
    """Where the trench begins and where the run is over, from the same parameters."""
    page, case = live(Case()).page, Case(1.5, speed)
    values = {f"car.wheel.{k}{side}.x": x for k, x in (("a1", 2.0), ("a3", -1.9)) for side in "lr"}
    values |= {"car.outline.front_overhang": 1.0, "car.target.speed": case.speed, "car.trench.length": 1.5}

    course = Course.of(recording(case))
    (starts,) = next(c for c in page.controls if c.label == "speed").follows.values()
    assert max(v.of(values) for v in starts) == pytest.approx(course.start, abs=1e-3)
    assert page.finish is not None
    assert page.finish.when is not None
    values |= {"car.trench.start": course.start, "car.x": course.end}
    assert page.finish.when.of(values) == pytest.approx(0.0, abs=1e-9)
