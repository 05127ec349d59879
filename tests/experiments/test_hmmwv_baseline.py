"""What a run of the HMMWV is shown beside: the paper's passive car, or a user's vehicle without actuators."""

from __future__ import annotations

import pytest

from cosim.experiments.hmmwv import EXPERIMENT, runs
from cosim.experiments.hmmwv.runs import Case
from cosim.experiments.ride import EXPERIMENT as RIDE
from cosim.study import FmuSet

OWN = FmuSet(own={"RideCarHmmwv": ("RideCarVan", "--vehicle van.toml")}, vehicles=("van",))
ACTUATOR = FmuSet(own={"HydraulicActuator": ("HydraulicActuatorStrong", "--vehicle strong.toml")}, vehicles=("strong",))


@pytest.mark.parametrize("fmus", [FmuSet(), ACTUATOR], ids=["published", "own actuators"])
def test_the_published_car_is_compared_with_its_actuators_with_the_pump_off(fmus: FmuSet) -> None:
    case = Case("bump", "lqr", null_opening_mm=3.0)
    baseline = EXPERIMENT.baseline.beside(case, fmus)
    assert baseline == runs.passive(case) == Case("bump", "passive", null_opening_mm=3.0)
    said = "passive is the baseline: the car on its hydraulic actuators with the pump off, as in paper 001"
    assert EXPERIMENT.baseline.sentence(baseline, case) == said


def test_a_users_vehicle_is_compared_with_itself_without_actuators() -> None:
    case = Case(
        "bump", "lqr", speed_kmh=40.0, friction=True, lift_off=False, null_opening_mm=3.0, variant=2, duration=2.0
    )
    baseline = EXPERIMENT.baseline.beside(case, OWN)
    assert baseline == Case(
        "bump", "zero", "ideal", speed_kmh=40.0, friction=True, lift_off=False, variant=2, duration=2.0
    )
    assert EXPERIMENT.baseline.name_of(baseline) == "no actuators"
    assert (
        EXPERIMENT.baseline.sentence(baseline, case)
        == "no actuators is the baseline: the same car on its springs and dampers alone"
    )
    assert EXPERIMENT.baseline.beside(baseline, OWN) == baseline  # which is shown alone
    assert EXPERIMENT.baseline.name_of(Case("bump", "zero")) == "zero"


def test_rides_of_a_users_vehicle() -> None:
    case = RIDE.case("hmmwv", "lqr")
    assert (RIDE.baseline.beside(case, OWN).controller, RIDE.baseline.beside(case, OWN).actuators) == ("zero", "ideal")
    assert RIDE.baseline.name_of(RIDE.baseline.beside(case, OWN)) == "no actuators"
    assert RIDE.baseline.beside(case, FmuSet()) == RIDE.case("hmmwv", "passive", "hydraulic")
    sedan = RIDE.case("sedan", "comfort-active")
    assert (
        RIDE.baseline.sentence(RIDE.baseline.beside(sedan, OWN), sedan)
        == "passive is the baseline: the same car without control forces"
    )


def test_results_of_a_users_vehicle_have_a_folder_of_their_own(tmp_path) -> None:
    assert FmuSet().results(tmp_path, "hmmwv") == tmp_path / "hmmwv"
    assert OWN.results(tmp_path, "hmmwv") == tmp_path / "hmmwv-van"
