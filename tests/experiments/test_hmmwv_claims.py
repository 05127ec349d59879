"""Paper 001 on the whole vehicle: claims from a reduced set of runs, the wiring, the report, bad input."""

from __future__ import annotations

from dataclasses import replace
from fractions import Fraction

import numpy as np
import pytest

from cosim import Record
from cosim.experiments.hmmwv import EXPERIMENT, runs  # noqa: F401 (of the fixture `runner`)
from cosim.experiments.hmmwv.published import estimated, finer
from cosim.experiments.hmmwv.runs import ROADS, Case
from fmu_sources.models.comfort import absorbed_power_peak
from fmu_sources.models.corners import CORNERS

OFF_ROAD_S = 6.0


@pytest.fixture(scope="module")
def power(runner):
    """Absorbed power [W] of cases, each run once."""
    known: dict[Case, float] = {}

    def measure(case: Case) -> float:
        if case not in known:
            known[case] = runner.metrics(case)["absorbed_power"]
        return known[case]

    return measure


@pytest.mark.parametrize("controller", ["zero", "skyhook", "lqr"])
def test_the_track_is_at_least_twice_as_comfortable_as_passive(power, controller):
    assert power(Case("track", "passive")) / power(Case("track", controller)) >= 2.0


@pytest.mark.parametrize("controller", ["passive", "skyhook", "lqr"])
def test_off_road_none_of_them_is_bearable(power, controller):
    assert power(Case("off-road", controller, duration=OFF_ROAD_S)) > 6.0


def test_mpc_is_best_without_preview_and_alone_bearable_off_road(power):
    assert power(Case("track", "mpc")) <= 0.9 * min(power(Case("track", c)) for c in ("zero", "skyhook", "lqr"))
    assert power(Case("off-road", "mpc", duration=OFF_ROAD_S)) < 6.0


def test_preview_helps_on_one_big_bump(runner, power):
    passive, mpc, preview = (Case("bump", c) for c in ("passive", "mpc", "mpc-preview"))
    assert power(preview) <= 0.85 * power(mpc)
    assert power(passive) >= 2.7 * power(preview)
    late = Case("bump", "mpc-preview", preview_error_ms=40.0)
    assert power(late) > 1.2 * power(preview)  # at the wrong place it is worth less
    rows = {c: runner.metrics(c) for c in (mpc, preview)}
    assert rows[preview]["saturation"] < rows[mpc]["saturation"]
    assert all(r["solver_failures"] == 0 and r["solver_residual"] <= 1e-6 for r in rows.values())


def test_estimates_and_sensed_preview_cost_little(power):
    assert power(estimated("mpc", "track")) <= 1.1 * power(Case("track", "mpc"))
    assert power(estimated("mpc-preview", "bump", sensed=True)) <= 0.85 * power(Case("bump", "mpc"))


def test_the_filter_stays_with_the_car_off_road(runner):
    """A whole stretch with wheels in the air, where a correction for tire tension once fed on its own estimate."""
    case = Case("off-road", "lqr", states="estimated", variant=3)
    recording = runner.record(case, record=Record(["car.*", "kalman.*"], "5 ms"))
    lifted = np.column_stack([recording[f"car.tire.{k}.force"] for k in CORNERS]) <= 0
    assert lifted.any()
    for signal, share, largest in (("tire.{}.deflection", 0.35, 0.06), ("suspension.{}.deflection", 0.05, 0.006)):
        for k in CORNERS:
            true, found = (recording[f"{source}.{signal.format(k)}"] for source in ("car", "kalman"))
            assert np.abs(found - true).max() < largest
            assert np.std(found - true) < share * np.std(true)


def test_what_hydraulics_cost(power):
    """Ideal forces are far better: the valves saturate on the bumps."""
    assert power(Case("track", "zero", actuators="ideal")) < 0.8 * power(Case("track", "zero"))


def test_zero_force_with_ideal_actuators_is_the_car_alone(runner):
    """The comfort FMU in the loop gives what the function gives on the recording; the forces are 0."""
    recording = runner.record(Case("bump", "zero", actuators="ideal"))
    system = runner.system(Case("bump", "zero", actuators="ideal"))
    assert not any(name.startswith("car.force") for name in system.connections)
    power = recording["comfort.absorbed_power"]
    window = np.convolve(power, np.ones(1000) / 1000)[: len(power)]
    assert window.max() == pytest.approx(absorbed_power_peak(recording["car.body.az"], 1000.0), rel=1e-9)


def test_a_displaced_preview_comes_from_the_same_road_elsewhere(runner):
    late = Case("bump", "mpc-preview", preview_error_ms=30.0)
    runner.metrics(late)
    system = runner.system(late)
    recording = system.run(1.2, record=Record(["road.road.fl.height", "map.preview.fl[1]"], "1 ms"))
    true, shown = recording["road.road.fl.height"], recording["map.preview.fl[1]"]
    assert true.max() > 0.05
    np.testing.assert_allclose(shown[30:], true[:-30], atol=1e-9)


def test_a_case_leaves_nothing_behind_in_its_system(runner):
    """Systems are used again: parameters of one case do not reach the next one."""
    first = runner.metrics(Case("bump", "passive", duration=1.2))
    other = runner.metrics(Case("bump", "passive", duration=1.2, null_opening_mm=8.0))
    again = runner.metrics(Case("bump", "passive", duration=1.2))
    assert other["absorbed_power"] < 0.95 * first["absorbed_power"]
    assert again == first


def test_a_bump_above_the_travel_is_reported(runner):
    duration = {road: 2.5 if road == "off-road" else 0.5 for road in ROADS}  # off road metrics begin later
    told = {
        road: EXPERIMENT.measures.remarks(runner.run(Case(road, "passive", duration=t))) for road, t in duration.items()
    }
    assert told == {"track": [], "bump": ["a bump is higher than the travel of the suspension"], "off-road": []}


# ------------------------------------------------------------------------------------------- conditions in real runs


def test_a_pump_and_finer_steps_reach_the_fmus(runner):
    case = Case("bump", "zero", duration=1.2)
    limited = replace(case, flow_limit=True)
    flows = {c: runner.metrics(c)["flow_peak"] for c in (limited, replace(limited, pump_l_min=20.0), case)}
    plain, sized, free = flows.values()
    assert plain == pytest.approx(4 * 45.0, rel=1e-6)
    assert sized == pytest.approx(4 * 20.0, rel=1e-6)
    assert free > plain
    assert runner.metrics(limited)["flow_peak"] == plain  # the size does not stay in the system
    shared = replace(limited, shared_pump=True)
    assert runner.metrics(shared)["flow_peak"] == pytest.approx(45.0, rel=1e-6)
    assert {runner.metrics(c)["flow_limit"] for c in (case, limited)} == {45.0}
    assert runner.metrics(shared)["flow_limit"] == 45.0 / 4
    fine = runner.system(finer(case))
    assert {m.step for m in fine.groups["vehicle"].components} == {Fraction("0.25e-3")}
    for m in fine.groups["vehicle"].components:
        published = m.description.parameters["solver.step"].start
        assert m.values["solver.step"] == published / 2


def test_halving_the_steps_moves_the_power_by_less_than_one_percent(power):
    for case in (Case("bump", "mpc"), Case("bump", "mpc", flow_limit=True)):
        assert power(finer(case)) == pytest.approx(power(case), rel=0.01)
        assert power(finer(case)) != power(case)


def test_with_the_pump_of_the_paper_lqr_does_not_halve_the_power(power):
    """The larger of its two readings: 45 l/min at each actuator."""
    times = power(Case("track", "passive")) / power(Case("track", "lqr", flow_limit=True))
    assert 1.0 < times < 1.5
