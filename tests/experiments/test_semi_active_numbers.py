"""What the study of semi-active dampers measures and says, by hand-written runs; and short runs of its systems."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import made_up
import numpy as np
import pytest

from cosim import Record
from cosim.experiments.semi_active import EXPERIMENT, published, runs
from cosim.experiments.semi_active.claims import CLAIMS, best
from cosim.experiments.semi_active.published import FAMILIES, SYSTEMS, at, family
from cosim.experiments.semi_active.report import report
from cosim.experiments.semi_active.runs import INDEX, SETTLED, Case, invariant, measure, passive, signals
from cosim.study import CaseError, FmuSet, Results
from cosim.study.experiment import Run
from fmu_sources.models.corners import CORNERS

T = np.linspace(0.0, 23.0, 23001)
HALF = T % 2.0 < 1.0


def by_hand(case: Case, **others: Any) -> made_up.MadeUpRun:
    """Every signal of the index is 0.5, velocities 0.2 and -0.2 m/s in turn, everything before the metrics is large."""
    started = SETTLED[case.road] > T
    found: dict[str, Any] = {f"car.{n}": np.where(started, 99.0, 0.5) for n in INDEX}
    found |= {"road.road.fl.rate": 0.1, "car.seat.az": 0.0}
    found |= {f"car.suspension.{k}.velocity": np.where(HALF, 0.2, -0.2) for k in CORNERS}
    if case.controller != "passive" and case.actuators == "dampers":
        for k in CORNERS:
            found |= {f"damper_{k}.force": -100.0, f"damper_{k}.power": np.where(HALF, -20.0, 20.0)}
            found[f"damper_{k}.coil.power"] = 1.5
    elif case.controller != "passive":
        found |= {f"controller.force.{k}": np.where(HALF, 300.0, 600.0) for k in CORNERS}
    starts = {f"car.suspension.{k}.damping": 6000.0 for k in CORNERS}
    return made_up.run(case, T, {**found, **others}, starts)


def test_passive_dampers_take_power_and_need_none() -> None:
    row = measure(by_hand(Case("passive")))
    assert row["force_rms"] == pytest.approx(1200.0)
    assert row["power_taken"] == pytest.approx(4 * 6000.0 * 0.2**2)
    assert (row["power_given"], row["power_bought"], row["power_coil"]) == (0.0, 0.0, 0.0)
    assert (row["body_rms"], row["tire_rms"], row["travel_rms"]) == pytest.approx((0.5, 0.5, 0.5))
    assert row["index"] == pytest.approx(0.25 * sum(INDEX.values()))


def test_power_of_dampers_and_of_ideal_actuators() -> None:
    """Dampers by their own power, half of the time either way, and their coils; actuators by force times velocity."""
    row = measure(by_hand(Case("skyhook")))
    assert row["power_taken"] == pytest.approx(40.0, rel=1e-3)
    assert row["power_given"] == pytest.approx(40.0, rel=1e-3)
    assert row["power_bought"] == row["power_coil"] == pytest.approx(6.0)
    row = measure(by_hand(Case("skyhook", "ideal")))
    assert row["power_given"] == row["power_bought"] == pytest.approx(4 * 300 * 0.2 / 2, rel=1e-3)
    assert row["power_taken"] == pytest.approx(4 * 600 * 0.2 / 2, rel=1e-3)
    assert row["power_coil"] == 0.0


def test_gains_on_the_rig_are_square_roots_of_ratios_of_spectra() -> None:
    """Acceleration 6 times the rate of the road, tire deflection a hundredth of it, at every frequency."""
    road = np.random.default_rng(1).normal(size=len(T))
    made = by_hand(
        Case("passive", road="rig"),
        **{"road.road.fl.rate": road, "car.body.az": 6 * road, "car.tire.fl.deflection": 0.01 * road},
    )
    row, drawn = measure(made), signals(made)
    for band in runs.BANDS:
        assert row[f"acceleration_{band}"] == pytest.approx(6.0, rel=1e-9)
        assert row[f"tire_{band}"] == pytest.approx(0.01, rel=1e-9)
    assert row["acceleration_invariant"] == pytest.approx(6.0, rel=1e-9)
    assert (min(drawn["frequency"]), max(drawn["frequency"])) == (0.5, 20.0)
    assert set(np.round(drawn["acceleration"], 9)) == {6.0}


def test_invariant_frequency() -> None:
    """sqrt(500 kN/m / 135 kg), and 500 kN/m / 700 kg / omega."""
    omega = np.sqrt(500e3 / 135)
    assert invariant() == pytest.approx((omega / 2 / np.pi, 500e3 / 700 / omega))


def test_cases_that_make_no_sense_are_refused() -> None:
    with pytest.raises(CaseError, match="add does not damp the car without dampers"):
        Case("add", "ideal")
    with pytest.raises(CaseError, match="mpc is not tuned between comfort and road holding"):
        Case("mpc", road_holding=0.5)
    assert passive(Case("lqr", "ideal", road_holding=0.5, stretch=2)) == Case("passive", stretch=2)


# -------------------------------------------------------------------------------------------------------- study, claims


def metrics(case: Case) -> dict[str, Any]:
    """Theory as it is expected: active before semi-active before passive, and each control law good at its purpose."""
    kind = "passive" if case.controller == "passive" else "active" if case.actuators == "ideal" else "semi-active"
    level = {"passive": 3.0, "semi-active": 2.0, "active": 1.0}[kind]
    t = 0.5 if case.road_holding is None else case.road_holding
    found = dict.fromkeys(runs.METRICS, level)
    found |= {"body_rms": level * (1 + 0.1 * t), "tire_rms": 1e-3 * level * (2 - t)}
    found |= {"power_given": 0.0 if not case.hysteresis else 0.1, "power_bought": 100.0 if kind == "active" else 5.0}
    found |= {"solver.status": 0.0, "solver.residual": 1e-9}
    found["index"] = {"mpc": 1.0, "lqr": 1.1}.get(case.controller, 2.0)
    found["acceleration_invariant"] = invariant()[1]
    body = {"passive": 4.0, "add": 5.0, "skyhook-on-off": 2.0, "skyhook": 2.5, "sh-add": 2.1}
    between = {"skyhook-on-off": 4.0, "add": 1.0, "sh-add": 1.5}
    wheel = {"groundhook": 1.0, "groundhook-on-off": 1.0}
    for band, values in (("body", body), ("between", between), ("wheel", wheel)):
        found[f"acceleration_{band}"] = found[f"tire_{band}"] = values.get(case.controller, 3.0)
    return found


def drawn(case: Case) -> dict[str, Any]:
    if case.road == "rig":
        return {"frequency": [1.0, 2.0], "acceleration": [3.0, 4.0], "tire": [0.005, 0.006]}
    return {"velocity": [0.1, -0.1], "force": [-2000.0, 1000.0], "acceleration": [0.0, 1.0], "time": [0.0, 0.004]}


def verdicts(study: Results) -> dict[str, str]:
    return {c.id: c.verdict for c in CLAIMS.judge(study)}


def test_checks_hold_where_theory_does(study: Results) -> None:
    assert set(verdicts(study).values()) == {"holds"}


@pytest.mark.parametrize(
    ("check", "worse"),
    [
        ("passivity", lambda c, _: {"power_given": 1e-3} if c.controller == "add" and not c.hysteresis else {}),
        ("comfort-order", lambda c, _: {"body_rms": 9.0} if c.actuators == "ideal" else {}),
        ("road-holding-order", lambda c, _: {"tire_rms": 9.0} if c.actuators == "ideal" else {}),
        (
            "invariant",
            lambda c, r: (
                {"acceleration_invariant": 1.06 * r["acceleration_invariant"]}
                if c.road == "rig" and c.controller == "lqr"
                else {}
            ),
        ),
        ("skyhook", lambda c, _: {"acceleration_body": 4.1} if c.controller == "skyhook" else {}),
        ("add", lambda c, _: {"acceleration_between": 4.1} if c.controller == "add" else {}),
        ("sh-add", lambda c, _: {"acceleration_body": 2.3} if c.controller == "sh-add" else {}),
        ("groundhook", lambda c, _: {"tire_wheel": 3.1} if c.controller == "groundhook" else {}),
        ("mpc", lambda c, _: {"index": 1.2} if c.controller == "mpc" and c.stretch == 2 else {}),
        ("energy", lambda c, _: {"power_bought": 11.0} if c == at("lqr", stretch=1) else {}),
        ("solver", lambda c, _: {"solver.status": 1.0} if c == at("mpc", stretch=2) else {}),
    ],
)
def test_each_check_can_fail(check: str, worse: Any) -> None:
    def changed(case: Case) -> dict[str, Any]:
        row = metrics(case)
        return {**row, **worse(case, row)}

    assert verdicts(made_up.study(EXPERIMENT, changed, drawn))[check] == "does not hold"


def test_best_of_a_kind_is_no_worse_than_the_passive_car_elsewhere() -> None:
    """A run with less acceleration but more tire deflection than the HMMWV does not count."""
    soft = replace(at("skyhook"), road_holding=0.0)

    def changed(case: Case) -> dict[str, Any]:
        return {**metrics(case), **({"body_rms": 0.1, "tire_rms": 1.0} if case == soft else {})}

    found = made_up.study(EXPERIMENT, changed, drawn)
    assert best(found, "semi-active", "body_rms", "tire_rms") > 1.0
    assert soft in family("semi-active")
    assert {s for kind in FAMILIES.values() for s in kind} == set(SYSTEMS)
    assert len({t.label for t in published.plan()}) == len(published.plan())


def test_report(study: Results, fmus: FmuSet) -> None:
    page = report(study, fmus)
    (panel,) = page.figure.panels
    assert [s.name for s in panel.series] == list(FAMILIES)
    rows = {r["system"]: r for r in made_up.table(page, "random")}
    assert rows["passive"]["rms acceleration of the body [m/s2]"] == "3.150"
    assert rows["SH-ADD"]["rms tire deflection [mm]"] == "3.00"
    assert rows["LQR, active"]["power from outside, of coils or actuators [W]"] == "100.0"
    bands = {r["system"]: r for r in made_up.table(page, "bands")}
    assert bands["ADD"]["acceleration 3 to 7 Hz [1/s]"] == "1.00"
    given = {r["system"]: r for r in made_up.table(page, "passivity")}
    assert given["MPC"] == {
        "system": "MPC",
        "power given to the car, with hysteresis [W]": "0.1",
        "power given to the car, without [W]": "0",
    }
    gain = made_up.series(page, "responses", "hooks and ADD", "SH-ADD")
    assert list(gain.y) == [3.0, 4.0]
    force = made_up.series(page, "force", "MPC", "MPC")
    assert (list(force.x), list(force.y)) == ([0.1, -0.1], [-2.0, 1.0])


# ---------------------------------------------------------------------------------------------------------- short runs


def run(fmus: FmuSet, case: Case, seconds: float) -> Run:
    system = runs.wire(fmus, case)
    runs.configure(system, case)
    return Run(case, system.run(seconds, record=Record(runs.recorded(case), "1 ms")), system)


def test_dampers_take_power_without_hysteresis(fmus: FmuSet) -> None:
    """At every sample, whatever the control law does."""
    for name in ("skyhook-on-off", "sh-add", "mpc"):
        r = run(fmus, replace(at(name), hysteresis=False), 4.0).recording
        power = np.column_stack([r[f"damper_{k}.power"] for k in CORNERS])
        assert power.max() <= 0.0
        assert power.min() < -100.0


def test_on_the_rig_the_car_only_heaves(fmus: FmuSet) -> None:
    """All wheels get one road, and the HMMWV is the same at the front and at the rear: a quarter car four times."""
    r = run(fmus, at("sh-add", "rig"), 4.0).recording
    assert np.abs(r["car.body.az"]).max() > 1.0
    assert max(np.abs(r[f"car.body.{n}"]).max() for n in ("roll_rate", "pitch_rate")) < 1e-9
    for k in CORNERS[1:]:
        assert np.allclose(r[f"damper_{k}.force"], r["damper_fl.force"], atol=1e-6)


def test_the_car_of_a_run_has_one_kind_of_damper(fmus: FmuSet) -> None:
    """Its own, tuned or not, or none where others take their place; a shared system is set anew for each case."""
    own = run(fmus, replace(at("passive"), road_holding=0.0), 0.1)
    assert own.start("car.suspension.fl.damping") == runs.SOFTEST
    assert run(fmus, at("passive"), 0.1).start("car.suspension.rr.damping") == 6000.0
    tuned = run(fmus, replace(at("lqr"), road_holding=1.0), 0.1)
    assert tuned.start("car.suspension.fl.damping") == 0.0
    gain = runs.tuned_gain(1.0)
    assert tuned.start("controller.gain[2,3]") == gain[1, 2] != run(fmus, at("lqr"), 0.1).start("controller.gain[2,3]")
