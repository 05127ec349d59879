"""Paper 001 on the whole vehicle: claims from a reduced set of runs, the wiring, the report, bad input."""

from __future__ import annotations

import numpy as np
import pytest

from cosim.comfort import absorbed_power_peak
from cosim.experiments import hmmwv, hmmwv_claims, hmmwv_report
from cosim.experiments.cases import CaseError, FmuSet
from cosim.experiments.hmmwv import CONTROLLERS, ROADS, Case, HmmwvBench
from cosim.experiments.hmmwv_study import Plan, Study, averaged_cases, history_cases
from fmu_sources.controllers.hmmwv_states import CORNERS

OFF_ROAD_S = 6.0


@pytest.fixture(scope="module")
def fmus(built_fmus) -> FmuSet:
    return FmuSet(built_fmus.path("RideCarHmmwv", 3).parent.parent)


@pytest.fixture(scope="module")
def bench(fmus):
    bench = HmmwvBench(fmus)
    yield bench
    bench.close()


@pytest.fixture(scope="module")
def power(bench):
    """Absorbed power [W] of cases, each run once."""
    known: dict[Case, float] = {}

    def measure(case: Case) -> float:
        if case not in known:
            known[case] = bench.measure(case)["absorbed_power"]
        return known[case]

    return measure


@pytest.mark.parametrize("controller", ["zero", "skyhook", "lqr"])
def test_the_track_is_at_least_twice_as_comfortable_as_passive(power, controller):
    assert power(Case("track", "passive")) / power(Case("track", controller)) >= 2.0


@pytest.mark.parametrize("controller", ["passive", "skyhook", "lqr"])
def test_off_road_none_of_them_is_bearable(power, controller):
    assert power(Case("off-road", controller, duration=OFF_ROAD_S)) > 6.0


def test_what_hydraulics_cost(power):
    """Ideal forces are far better: the valves saturate on the bumps."""
    assert power(Case("track", "zero", actuators="ideal")) < 0.7 * power(Case("track", "zero"))


def test_zero_force_with_ideal_actuators_is_the_car_alone(bench):
    """The comfort FMU in the loop gives what the function gives on the recording; the forces are 0."""
    recording = bench.record(Case("bump", "zero", actuators="ideal"))
    system = bench.system(Case("bump", "zero", actuators="ideal"))
    assert not any(name.startswith("car.force") for name in system.connections)
    power = recording["comfort.absorbed_power"]
    window = np.convolve(power, np.ones(1000) / 1000)[: len(power)]
    assert window.max() == pytest.approx(absorbed_power_peak(recording["car.body.az"], 1000.0), rel=1e-9)


def test_every_signal_goes_to_the_wheel_it_belongs_to(fmus):
    system = hmmwv.wire(fmus, Case("track", "lqr"))
    made = {c.target_name: c.source_name for c in system.connections.values()}
    for k in CORNERS:
        assert made[f"car.force.{k}"] == f"actuator_{k}.force"
        assert made[f"actuator_{k}.valve.voltage"] == f"tracking_{k}.valve.voltage"
        assert made[f"actuator_{k}.piston.velocity"] == f"car.suspension.{k}.velocity"
        assert made[f"tracking_{k}.force.desired"] == f"controller.force.{k}"
        assert made[f"tracking_{k}.piston.velocity"] == f"car.suspension.{k}.velocity"
        assert made[f"controller.suspension.{k}.deflection"] == f"car.suspension.{k}.deflection"
    assert system.check() == []  # no input is left open
    assert [m.name for m in system.groups["vehicle"].members] == ["car", *(f"actuator_{k}" for k in CORNERS)]
    system.close()


def test_a_case_leaves_nothing_behind_in_its_system(bench):
    """Systems are used again: parameters of one case do not reach the next one."""
    first = bench.measure(Case("bump", "passive", duration=1.2))
    other = bench.measure(Case("bump", "passive", duration=1.2, null_opening_mm=8.0))
    again = bench.measure(Case("bump", "passive", duration=1.2))
    del first["real_time_factor"], again["real_time_factor"]
    assert other["absorbed_power"] < 0.95 * first["absorbed_power"]
    assert again == first


def test_places_of_the_bump_cover_one_control_period():
    cases = hmmwv.over_variants(Case("track", "lqr"))
    assert [c.variant for c in cases] == list(range(6))
    assert [c.variant for c in hmmwv.over_variants(Case("track", "lqr"), 2)] == [0, 3]
    assert len(hmmwv.over_variants(Case("track", "passive"))) == 1  # nothing is sampled
    assert len(hmmwv.over_variants(Case("off-road", "passive"))) == 5


def made_up_study(power: dict[tuple[str, str], float]) -> Study:
    """A study with given absorbed powers by road and controller, in which nothing was run."""
    study = Study(Plan(variants=2))
    for case in averaged_cases():
        for i, run in enumerate(study.plan.expand(case)):
            row = dict.fromkeys(
                ("absorbed_power_peak", "absorbed_power_mean", "iso2631_rms", "vdv", "rms_az", "travel_rms", "travel_peak",
                 "tire_rms", "lift_off", "real_time_factor", "force_rms", "force_peak", "flow_peak", "flow_mean",
                 "power_mean", "tracking_error_rms", "saturation", "saturated_time"), 1.0,
            )  # fmt: skip
            study.rows[run] = {**row, "absorbed_power": power[case.road, case.controller] + 0.1 * i}
    time = np.arange(0, 3, 0.01)
    for case in history_cases():
        study.histories[case] = {
            k: time.tolist()
            for k in ("time", "x", "az", "power_window", "travel_fl", "road_fl", "force", "smoothed", "command")
        }
    return study


@pytest.mark.parametrize("holds", [True, False])
def test_claims_follow_the_numbers(holds, fmus, tmp_path):
    values = {(road, c): (20.0 if c == "passive" else 7.0) for road in ROADS for c in CONTROLLERS}
    if not holds:
        values |= {("track", "zero"): 11.0, ("track", "skyhook"): 11.0, ("track", "lqr"): 15.0}
        values |= {("off-road", c): 5.0 for c in CONTROLLERS}
    study = made_up_study(values)
    found = {c.id: c for c in hmmwv_claims.claims(study)}
    assert {c.reproduced for c in found.values()} == {holds}
    assert all(c.reason for c in found.values()) is not holds
    assert hmmwv_report.write(study, fmus, tmp_path).is_file()
    assert (tmp_path / "tables" / "absorbed-power.csv").is_file()


@pytest.mark.parametrize(
    ("choice", "message"),
    [
        ({"road": "trak"}, "did you mean track"),
        ({"controller": "skyhok"}, "did you mean skyhook"),
        ({"actuators": "electric"}, "no actuators 'electric'"),
        ({"controller": "passive", "actuators": "ideal"}, "--controller zero --actuators ideal"),
        ({"speed_kmh": 0.0}, "speed 0 km/h"),
        ({"speed_kmh": float("nan")}, "speed nan"),
        ({"variant": 6}, "0 to 5 on the road 'track'"),
        ({"road": "off-road", "variant": 5}, "0 to 4"),
        ({"duration": 1e3}, "duration 1000 s"),
        ({"null_opening_mm": 0.0}, "null opening 0 mm"),
    ],
)
def test_cases_that_do_not_exist(choice: dict, message: str) -> None:
    with pytest.raises(CaseError, match=message):
        Case(**choice)
