"""Control of the suspension in handling: metrics of hand-written recordings, wiring, design, checks and report."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import made_up
import numpy as np
import pytest

from cosim import Record
from cosim.core.signals import rms
from cosim.experiments.handling import EXPERIMENT, design, metrics, runs
from cosim.experiments.handling.claims import CLAIMS, SuspensionView
from cosim.experiments.handling.published import (
    RolloverAngle,
    at,
    controlled,
    controlled_rollover,
    plan,
    rollover,
)
from cosim.experiments.handling.report import LAWS, report
from cosim.experiments.handling.runs import CONTROLLERS, CORNERS, REDESIGNED, Case, measure, passive
from cosim.study import CaseError, FmuSet, Results
from cosim.study.experiment import Run
from fmu_sources.controllers.lq.hmmwv import TABLE_1_1, TABLE_1_1_KILONEWTON, lqr_gain
from fmu_sources.models.comfort import weighted_acceleration
from fmu_sources.vehicles import load_full_car

T = np.arange(0.0, 20.0, 1e-3)

# ------------------------------------------------------------------------------------------------------------- metrics


def test_load_transfer_is_a_part_of_the_static_load() -> None:
    """2 and 3 kN at the start; then 1.5 kN go from left to right, then 0.5 kN back to the left, and one wheel lifts."""
    left, right = np.array([2e3, 0.5e3, 2.5e3, 0.0]), np.array([3e3, 4.5e3, 2.5e3, 7e3])
    assert metrics.load_transfer(left, right).tolist() == pytest.approx([0.2, 0.8, 0.0, 1.4])


def test_a_car_follows_its_circle_until_its_velocity_turns_at_another_rate() -> None:
    """Near zero the quotient means nothing; 5 % is a slow rise of the side slip, 11 % of 4 m/s2 is none."""
    ay = np.array([0.0, 0.1, 2.0, 4.0, 4.0, 4.0, 4.0])
    share = np.array([1.0, 0.5, 0.8, 0.95, 1.05, 1.11, 1.0])
    assert metrics.follows_until(ay, share * ay / 10, np.full(7, 10.0)) == 5
    assert metrics.follows_until(-ay, -share * ay / 10, np.full(7, 10.0)) == 5
    assert metrics.follows_until(ay[:5], share[:5] * ay[:5] / 10, np.full(5, 10.0)) == 5


def by_hand(case: Case, **more: Any) -> Run:
    """A car that leaves its road at 10 s: before, nothing but what the signals below say."""
    wave = np.sin(2 * np.pi * T)
    signals = {f"car.{n}": 0.0 for n in runs._BODY}
    signals |= {"car.x": 10.0 * T - 20.0, "car.speed": 10.0, "driver.steering.wheel": 0.1, "driver.path.offset": 0.3}
    signals |= {"car.body.roll": 0.05 * wave, "car.body.roll_rate": -0.2 * wave, "car.body.ay": 2.0}
    signals |= {"car.tire.fl.force": 4e3 - 1e3 * wave, "car.tire.fr.force": 4e3 + 1e3 * wave}
    signals |= {"car.tire.rl.force": 6e3 - 4.5e3 * wave, "car.tire.rr.force": 6e3 + 4.5e3 * wave}
    if case.controller != "passive":
        for k, size in zip(CORNERS, (100.0, 200.0, 300.0, 400.0), strict=True):
            signals |= {runs.force_name(case).format(k): size * np.sign(wave + 0.1), f"car.actuator.{k}.power": size}
    starts = {"road.wheel.rl.x": -1.5, "road.flat": 10.0, "road.ramp": 20.0}
    return made_up.run(case, T, signals | more, starts)


@pytest.mark.parametrize("actuators", ["ideal", "hydraulic"])
def test_metrics_of_a_lane_change(actuators: str) -> None:
    row = measure(by_hand(controlled("skyhook", "lane-change", actuators)))
    assert (row["roll_peak"], row["roll_rate_peak"], row["offset"]) == pytest.approx((0.05, 0.2, 0.3), rel=1e-5)
    assert (row["transfer_front"], row["transfer_rear"]) == pytest.approx((0.25, 0.75), rel=1e-5)
    assert row["rollover"] == pytest.approx(11e3 / 20e3, rel=1e-5)
    assert (row["force_peak"], row["power_peak"], row["power_rms"]) == pytest.approx((400.0, 1000.0, 1000.0))
    assert row["force_rms"] == pytest.approx(np.sqrt(7.5e4))


def test_the_passive_car_has_no_forces_and_a_step_its_roll_gradient() -> None:
    row = measure(by_hand(at("hmmwv", "step"), **{"car.body.roll": 0.05}))
    assert row["roll_gradient"] == pytest.approx(0.025)
    assert not {"force_peak", "power_peak", "iso2631_rms"} & set(row)


@pytest.mark.parametrize(("road", "begin"), [("1in", 1.5), ("iso8608", 31.5)])
def test_comfort_counts_where_all_wheels_are_on_the_road(road: str, begin: float) -> None:
    """The seat is shaken on the road only, and before it the more; the CG half as much."""
    x = 10.0 * T - 20.0
    az = np.where(x >= begin, 1.0, 10.0) * np.sin(2 * np.pi * 5 * T)
    made = by_hand(at("hmmwv", "straight", road=road), **{"car.seat.az": az, "car.body.az": az / 2})
    row, counts = measure(made), x >= begin
    assert row["seat_rms"] == pytest.approx(np.sqrt(0.5), rel=2e-3)
    assert row["iso2631_rms"] == pytest.approx(rms(weighted_acceleration(az, 1000.0)[counts]))
    assert row["iso2631_rms_cg"] == pytest.approx(row["iso2631_rms"] / 2)
    assert {"absorbed_power", "absorbed_power_nrmm"} <= set(row)
    assert "seat_rms" not in measure(by_hand(at("hmmwv", "straight", road="flat")))


def test_steady_cornering_ends_where_the_car_spins() -> None:
    """The yaw rate fits 4 m/s2 at 10 m/s until 8 s; the largest values come later."""
    late = T >= 8.0
    signals = {"car.body.ay": np.where(late, 5.0, 4.0), "car.body.yaw_rate": np.where(late, 2.0, 0.4)}
    made = by_hand(at("hmmwv", "steady"), **signals)
    shown = runs.signals(made)
    assert max(shown["time"]) < 8.0
    assert (max(shown["ay"]), max(shown["yaw_rate"])) == (4.0, 0.4)


class Lifting:
    """Stands in for a runner: all wheels lift from an angle on; above 300 deg the car turns over."""

    def __init__(self, angle: float) -> None:
        self.angle, self.asked = angle, []

    def metrics(self, case: Case) -> dict[str, Any]:
        self.asked.append(case)
        if case.wheel_deg > 300:
            return {"reason": "it turned over"}
        return {"rollover": 1.0 if case.wheel_deg >= self.angle else case.wheel_deg / self.angle}


@pytest.mark.parametrize("angle", [20.0, 90.0, 163.7, 250.0])
def test_rollover_angle_is_within_a_degree(angle: float) -> None:
    runner = Lifting(angle)
    found = rollover("modified")(runner)
    assert found is not None
    assert angle <= found <= angle + 1.0
    assert len(runner.asked) < 15
    assert {replace(c, wheel_deg=0.0) for c in runner.asked} == {replace(at("modified", "j-turn"), wheel_deg=0.0)}


def test_rollover_of_a_car_that_only_turns_over_or_slides() -> None:
    assert rollover("hmmwv")(Lifting(1000.0)) == pytest.approx(300.0, abs=1.0)

    class Sliding:
        def metrics(self, _: Case) -> dict[str, Any]:
            return {"rollover": 0.9}

    assert rollover("hmmwv")(Sliding()) is None


# --------------------------------------------------------------------------------------------------------------- cases


def test_cases_that_make_no_sense_are_refused() -> None:
    with pytest.raises(CaseError, match="the random road has no preview for mpc-preview"):
        Case("modified", "straight", road="iso8608", controller="mpc-preview")
    with pytest.raises(CaseError, match="no control law is designed on the car public: hmmwv, modified"):
        Case("public", controller="lqr", design="car")
    with pytest.raises(CaseError, match="design is for LQR and MPC only"):
        Case("modified", controller="skyhook", design="car")
    case = controlled("mpc", "lane-change", "hydraulic")
    assert passive(case) == at("modified", "lane-change")
    assert runs.called(replace(passive(case), actuators="hydraulic")) == "pump off"
    assert runs.called(case) == "mpc"


def test_plan_has_every_control_law_and_each_run_once() -> None:
    tasks = plan()
    assert len({t.label for t in tasks}) == len(tasks)
    cases = {t.case for t in tasks if not isinstance(t, RolloverAngle)}
    for c in CONTROLLERS:
        assert {controlled(c, m) for m in ("lane-change", "obstacle", "step", "straight")} <= cases
        assert {controlled(c, m, "hydraulic") for m in ("lane-change", "straight")} <= cases
        assert controlled_rollover(c) in tasks
    assert set(LAWS) == set(CONTROLLERS)
    speeds = {m: controlled("mpc", m).speed_kmh for m in ("lane-change", "obstacle", "step", "straight")}
    assert speeds == {"lane-change": 60.0, "obstacle": 40.0, "step": 60.0, "straight": 30.0}
    assert (controlled("mpc", "step").wheel_deg, at("public", "steady").wheel_deg) == (30.0, 180.0)
    assert {controlled(c, "step", design="paper") for c in REDESIGNED} <= cases


# -------------------------------------------------------------------------------------------------------------- wiring


def run(fmus: FmuSet, case: Case, seconds: float, *more: str) -> Run:
    system = EXPERIMENT.wiring.wire(fmus, case)
    with system:
        record = Record([*runs.recorded(case), *more], "1 ms")
        return Run(case, system.run(seconds, record=record), system)


def test_skyhook_acts_on_the_car_by_its_equation(fmus: FmuSet) -> None:
    """F = -B_sky v_s + K_vel (v_u - v_s) at each corner of this car, held for 30 ms."""
    names = [*(f"car.body.{n}" for n in ("vz", "pitch_rate")), "car.wheel.fl.vz", "car.wheel.rr.vz"]
    found = run(fmus, controlled("skyhook", "step"), 1.6, *names)
    r = found.recording
    base, part = (load_full_car("hmmwv_modified").body.model_dump()[n]["value"] for n in ("wheelbase", "cg_position"))
    for k, x, y in (("fl", base * part, 0.91), ("rr", base * (part - 1), -0.91)):
        corner = r["car.body.vz"] + y * r["car.body.roll_rate"] - x * r["car.body.pitch_rate"]
        force = -2000.0 * corner + 1000.0 * (r[f"car.wheel.{k}.vz"] - corner)
        at_samples = np.arange(1200, 1600, 30)
        assert np.abs(force).max() > 50.0
        assert r[f"controller.force.{k}"][at_samples] == pytest.approx(force[at_samples], rel=0.02, abs=0.5)


def test_the_mpc_sees_the_road_that_it_drives_on(fmus: FmuSet) -> None:
    """The map of another FMU, whose wheels have another radius, is the same course under the same wheels."""
    names = [f"{of}.road.{k}.height" for of in ("road", "map") for k in ("fl", "rr")]
    r = run(fmus, controlled("mpc-preview", "straight"), 4.0, *names, "map.preview.fl[2]").recording
    for k in ("fl", "rr"):
        assert np.abs(r[f"road.road.{k}.height"]).max() > 0.02
        assert r[f"map.road.{k}.height"] == pytest.approx(r[f"road.road.{k}.height"], abs=2e-3)
    ahead = r["map.preview.fl[2]"][:-30]
    assert ahead == pytest.approx(r["map.road.fl.height"][30:], abs=2e-3)
    assert np.abs(r["controller.force.fl"]).max() > 100.0


@pytest.mark.parametrize("controller", ["passive", "lqr-kilonewton", "explicit"])
def test_hydraulic_actuators(controller: str, fmus: FmuSet) -> None:
    """They give what is requested in a slow turn; without a controller their pump is off, and they resist."""
    r = run(fmus, controlled(controller, "step", "hydraulic"), 2.0).recording
    force = np.column_stack([r[f"actuator_{k}.force"] for k in CORNERS])
    assert np.isfinite(force).all()
    assert np.abs(force).max() > 100.0
    power = sum(r[f"car.actuator.{k}.power"] for k in CORNERS)
    if controller == "passive":
        assert power[1100:].mean() < 0.0
    else:
        system = EXPERIMENT.wiring.wire(fmus, controlled(controller, "step", "hydraulic"))
        with system:
            requested = system.run(2.0, record=Record(["controller.force.*"], "1 ms"))
        wanted = np.column_stack([requested[f"controller.force.{k}"] for k in CORNERS])
        assert rms(force[1500:] - wanted[1500:]) < 0.1 * rms(wanted[1500:])


def test_the_rough_roads_are_under_the_wheels(fmus: FmuSet) -> None:
    """The rear wheels meet what the front wheels met, a wheelbase later; each class is twice as rough as the last."""
    case = at("modified", "lane-change", road="iso8608")
    names = [f"road.road.{k}.height" for k in ("fl", "rl")]
    found = run(fmus, case, 5.0, *names, "road.*.height")
    x, (front, rear) = found.recording["car.x"], (found.recording[n] for n in names)
    later = np.interp(x, x + 3.302, front)
    assert np.abs(front).max() > 5e-3
    assert rear[1000:] == pytest.approx(later[1000:], abs=1e-3)
    rougher = run(fmus, replace(case, terrain="D", manoeuvre="straight"), 2.0, *names).recording
    smooth = run(fmus, replace(case, terrain="C", manoeuvre="straight"), 2.0, *names).recording
    assert rougher[names[0]] == pytest.approx(2 * smooth[names[0]], rel=0.02, abs=1e-4)


# -------------------------------------------------------------------------------------------------------------- design


def test_the_linear_car_of_a_design_is_the_car_that_is_driven(fmus: FmuSet) -> None:
    """Heave stiffness and inertia by hand, from springs through the motion ratio."""
    file = fmus.path("FullCarHmmwvModified")
    car, vehicle = design.near_rest("modified", file), load_full_car("hmmwv_modified")
    lin, ratio = car.linearize(), vehicle.suspension.motion_ratio.value
    springs = sum(2 * getattr(vehicle.suspension, a).spring.value * ratio**2 for a in ("front", "rear"))
    dampers = sum(2 * getattr(vehicle.suspension, a).damper.value * ratio**2 for a in ("front", "rear"))
    row, mass = lin.states.index("body.vz"), vehicle.body.mass.value
    assert lin.A[row, lin.states.index("body.z")] == pytest.approx(-springs / mass)
    assert lin.A[row, row] == pytest.approx(-dampers / mass)
    assert lin.B[row, lin.inputs.index("force.rl")] == pytest.approx(1 / mass)
    for cheap, weights in ((False, TABLE_1_1), (True, TABLE_1_1_KILONEWTON)):
        gain = design.lqr_parameters("modified", file, cheap=cheap)
        assert gain["gain[2,13]"] == pytest.approx(lqr_gain(car, weights)[0][1, 12])
        assert len(gain) == 60


def test_the_gain_of_a_design_is_set_where_it_is_chosen(fmus: FmuSet) -> None:
    own, papers = (
        EXPERIMENT.wiring.wire(fmus, controlled("lqr-kilonewton", "step", design=d)) for d in ("car", "paper")
    )
    file = fmus.path("FullCarHmmwvModified")
    assert own["controller"].values["gain[1,1]"] == design.lqr_parameters("modified", file, cheap=True)["gain[1,1]"]
    assert "gain[1,1]" not in papers["controller"].values


def test_a_car_with_other_equations_has_no_design(fmus: FmuSet) -> None:
    with pytest.raises(CaseError, match=r"FullCarHmmwvPublic has no parameter body\.wheelbase"):
        design.near_rest("modified", fmus.path("FullCarHmmwvPublic"))


# -------------------------------------------------------------------------------------------------------- study, claims


def theory(case: Case) -> dict[str, Any]:
    """Every expectation holds."""
    found: dict[str, Any] = dict.fromkeys(runs.METRICS, 1.0)
    c = case.controller
    if c in ("skyhook", "mpc", "mpc-preview"):
        found["roll_rate_peak"] = 0.9
    if c in ("implicit", "explicit", "preview"):
        found["roll_peak"] = 0.8
    if c == "lqr-kilonewton":
        found["roll_gradient"] = 2.0
    found["iso2631_rms"] = {"passive": 2.0, "mpc-preview": 1.0, "preview": 0.9}.get(c, 1.5)
    return found


def shown(case: Case) -> dict[str, Any]:
    size = 1.0 + list(CONTROLLERS).index(case.controller)
    return {n: [0.0, size] for n in ("wheel", "yaw_rate", "ay", "ax", "roll", "x", "y")} | {"time": [0.0, 1.0]}


def found(search: RolloverAngle) -> float | None:
    return {"passive": 185.4, "lqr": 150.0}.get(search.case.controller)


@pytest.fixture(scope="module")
def study() -> Results:
    return made_up.study(EXPERIMENT, theory, shown, found)


def verdicts(study: Results) -> dict[str, str]:
    return {c.id: c.verdict for c in CLAIMS.judge(study)}


def test_checks_hold_where_theory_does(study: Results) -> None:
    assert set(verdicts(study).values()) == {"holds"}


@pytest.mark.parametrize(
    ("check", "case", "worse"),
    [
        ("skyhook-roll-rate", controlled("skyhook", "obstacle"), {"roll_rate_peak": 1.01}),
        ("skyhook-roll-gradient", controlled("skyhook", "step"), {"roll_gradient": 0.97}),
        ("lqr", controlled("lqr", "lane-change"), {"roll_peak": 1.03}),
        ("lqr-kilonewton", controlled("lqr-kilonewton", "step"), {"roll_gradient": 0.99}),
        ("mpc-roll-rate", controlled("mpc", "lane-change"), {"roll_rate_peak": 1.01}),
        ("gpc-roll", controlled("explicit", "obstacle"), {"roll_peak": 1.01}),
        ("load-transfer", controlled("preview", "obstacle"), {"rollover": 0.84}),
        ("load-transfer", controlled("mpc-preview", "lane-change"), {"rollover": 1.16}),
        ("comfort", controlled("explicit", "straight", seed=5), {"iso2631_rms": 2.1}),
        ("preview", controlled("mpc-preview", "straight"), {"iso2631_rms": 1.6}),
        ("preview", controlled("preview", "straight"), {"iso2631_rms": 1.6}),
    ],
)
def test_each_check_can_fail(check: str, case: Case, worse: dict[str, float]) -> None:
    """Of the runs with ideal actuators, designed on the car that is driven."""
    changed = made_up.study(EXPERIMENT, lambda c: theory(c) | (worse if c == case else {}), shown, found)
    assert [c for c, v in verdicts(changed).items() if v != "holds"] == [check]


def test_places_of_the_checks_in_words(study: Results) -> None:
    view = SuspensionView(study)
    words = [view.label(p) for p in view.places(["step", "straight"], "")]
    assert words == ["step", *(f"straight, profile {i}" for i in (1, 2, 3, 4, 5))]


def test_report(fmus: FmuSet) -> None:
    def metrics_of(case: Case) -> dict[str, Any]:
        size = 1.0 + list(CONTROLLERS).index(case.controller) + 10 * (case.actuators == "hydraulic")
        size += 100 * (case.manoeuvre == "straight") + 1000 * (case.controller in REDESIGNED and case.design == "paper")
        return {n: size / m.factor for n, m in runs.METRICS.items()}

    page = report(made_up.study(EXPERIMENT, metrics_of, shown, found), fmus)
    rows = {r["control law"]: r for r in made_up.table(page, "control-ideal")}
    assert rows["passive (baseline)"]["largest roll angle [deg]"] == "1.00"
    assert rows["GPC with preview"]["largest load transfer at the rear [% of the load]"] == "9.0"
    assert rows["MPC"]["ISO 2631-1 weighted rms [m/s2]"] == "105.000"
    rows = {r["control law"]: r for r in made_up.table(page, "control-hydraulic")}
    assert rows["pump off"]["largest actuator force [kN]"] == "11.00"
    assert rows["skyhook"]["absorbed power, third order [W]"] == "112.00"
    designs = {(r["control law"], r["designed on"]): r for r in made_up.table(page, "control-designs")}
    assert designs["MPC", "the car of paper 001"]["largest roll rate [deg/s]"] == "1005.0"
    assert designs["MPC", "this car"]["ISO 2631-1 weighted rms of the CG [m/s2]"] == "105.000"
    turns = {r["control law"]: [*r.values()][-1] for r in made_up.table(page, "control-turns")}
    assert (turns["passive (baseline)"], turns["LQR, force in N"], turns["skyhook"]) == ("185", "150", "none")
    assert {r["car"]: r["steering wheel [deg]"] for r in made_up.table(page, "rollover-thresholds")}["HMMWV"] == "185"
    axes = made_up.axes(page, "comfort-and-handling")[""]
    assert axes == ("ISO 2631-1 weighted rms of the CG [m/s2]", "largest roll angle [deg]")
    dot = made_up.series(page, "comfort-and-handling", "", "MPC")
    assert ([*dot.x], [*dot.y]) == ([105.0], pytest.approx([5.0]))
    roll = made_up.series(page, "roll-obstacle", "", "skyhook")
    assert [*roll.y] == pytest.approx([0.0, np.degrees(2.0)])
