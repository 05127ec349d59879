"""What is connected with what in the vehicle of paper 001 and in its parts, from the built FMUs."""

from __future__ import annotations

from dataclasses import replace
from fractions import Fraction
from typing import Any

import pytest

from cosim.experiments.hmmwv import EXPERIMENT, preview, runs, tracking, wiring
from cosim.experiments.hmmwv.preview import published as chains
from cosim.experiments.hmmwv.published import estimated, finer
from cosim.experiments.hmmwv.runs import Case, stop_time
from cosim.study import FmuSet, Runner
from cosim.study.case import CaseError
from fmu_sources.models.corners import CORNERS


def test_every_signal_goes_to_the_wheel_it_belongs_to(fmus):
    system = runs.wire(fmus, Case("track", "lqr"))
    made = {c.target_name: c.source_name for c in system.connections.values()}
    for k in CORNERS:
        assert made[f"car.force.{k}"] == f"actuator_{k}.force"
        assert made[f"actuator_{k}.valve.voltage"] == f"tracking_{k}.valve.voltage"
        assert made[f"actuator_{k}.piston.velocity"] == f"car.suspension.{k}.velocity"
        assert made[f"tracking_{k}.force.desired"] == f"controller.force.{k}"
        assert made[f"tracking_{k}.piston.velocity"] == f"car.suspension.{k}.velocity"
        assert made[f"controller.suspension.{k}.deflection"] == f"car.suspension.{k}.deflection"
    assert system.check() == []  # no input is left open
    assert [m.name for m in system.groups["vehicle"].components] == ["car", *(f"actuator_{k}" for k in CORNERS)]
    system.close()


def connections(fmus: FmuSet, case: Case) -> dict[str, str]:
    """Sources by target of a case's system, in which no input is left open."""
    with runs.wire(fmus, case) as system:
        assert system.check() == []
        return {c.target_name: c.source_name for c in system.connections.values()}


def test_how_much_of_the_preview_counts_is_a_parameter(fmus):
    made = connections(fmus, Case("bump", "mpc-preview", preview_steps=3))
    for k in CORNERS:
        assert [made[f"controller.preview.{k}[{i}]"] for i in range(1, 17)] == [
            f"road.preview.{k}[{i}]" for i in range(1, 17)
        ]
    assert made["controller.preview.step"] == "road.preview.step"
    case = Case("bump", "mpc-preview", preview_steps=3)
    with runs.wire(fmus, case) as system:
        runs.configure(system, case)
        assert system["controller"].values["preview.used"] == 3


def test_a_driven_run_has_its_speed_as_an_input(fmus, raises):
    case = Case("bump", "lqr", speed_kmh=36.0, driven=True)
    with runs.wire(fmus, case) as system:
        runs.configure(system, case)
        assert system["speed"].description.name == "SpeedCommand"
        assert system["speed"].values["target.speed"] == 10.0
        assert system["speed"].values["start.x"] == runs.start(system, case)
    with raises(CaseError):
        Case("bump", "mpc-preview", preview_error_ms=5.0, driven=True)


def test_estimated_states_reach_the_controller_instead_of_true_ones(fmus):
    made = connections(fmus, estimated("mpc-preview", "bump", sensed=True))
    for k in CORNERS:
        assert made[f"controller.tire.{k}.deflection"] == f"kalman.tire.{k}.deflection"
        assert made[f"controller.preview.{k}[5]"] == f"buffer.preview.{k}[5]"
        assert made[f"sensors.actuator.{k}.force"] == f"actuator_{k}.force"
        assert made[f"kalman.road.{k}.height"] == f"buffer.road.{k}.height"
    assert made["controller.body.az"] == "kalman.body.az"
    assert made["buffer.x"] == made["preview_sensor.x"] == "sensors.x.measured"
    assert not any(
        s.startswith("car.") for t, s in made.items() if t.startswith(("controller.", "buffer.", "preview_"))
    )
    generated = connections(fmus, estimated("mpc-preview", "bump"))
    assert generated["map.x"] == "sensors.x.measured"
    assert generated["controller.preview.fl[2]"] == "map.preview.fl[2]"


# ---------------------------------------------------------------------------------------------------- what a case sets


@pytest.fixture(scope="module")
def systems(fmus: FmuSet):
    """Values that a case sets in its system, by component and variable."""
    with (
        Runner(EXPERIMENT, fmus) as vehicle,
        Runner(tracking.EXPERIMENT, fmus) as corner,
        Runner(preview.EXPERIMENT, fmus) as chain,
    ):
        of = {Case: vehicle, tracking.runs.Case: corner, preview.runs.Case: chain}
        yield lambda case: of[type(case)].system(case)


def given(system, component: str, *names: str) -> list[float]:
    values = system[component].values
    return [values[n] for n in names]


def test_a_run_begins_ahead_of_the_bumps_and_its_variants_lie_on_the_grid_of_the_controllers(systems):
    """At 36 km/h: 6 m ahead of the front wheels.

    Half a period of 30 ms is 0.15 m, a preview 20 ms late shows 0.2 m too late.
    """
    system = systems(Case("track", "mpc-preview", speed_kmh=36.0, variant=3, preview_error_ms=20.0))
    assert given(system, "speed", "start.speed", "start.x") == pytest.approx([10.0, 10 - 1.651 - 6])
    assert given(system, "map_speed", "start.speed", "start.x") == pytest.approx([10.0, 10 - 1.651 - 6 - 0.2])
    bumps = ("bump.first", "bump.height[1]", "bump.height[2]", "bump.height[7]")
    for road in ("road", "map"):
        assert given(system, road, *bumps) == pytest.approx([10.15, 0.057, 0.0, 0.038])
    system = systems(Case("bump", "lqr", variant=0))
    assert given(system, "road", *bumps) == pytest.approx([10.0, 0.076, 0.0, 0.0])
    assert stop_time(system, Case("bump", "lqr")) == pytest.approx(
        (1.651 + 0.5 + 1.651) / 8.9408 + 0.6 + 1.5, abs=0.051
    )


def test_an_off_road_run_has_a_stretch_of_its_own(systems):
    system = systems(Case("off-road", "lqr", variant=2))
    assert given(system, "road", "offset", "flat", "ramp") == [560.0, 5.0, 10.0]
    assert given(system, "speed", "start.x") == [-2.0]
    assert stop_time(system, Case("off-road", "lqr")) == 22.0
    assert stop_time(system, Case("off-road", "lqr", speed_kmh=90.0)) == pytest.approx(272 / 25)


def test_sensors_have_a_seed_for_each_variant_and_show_a_late_preview_behind(systems):
    case = Case("bump", "mpc-preview", speed_kmh=36.0, states="estimated", variant=4, preview_error_ms=-30.0)
    assert given(systems(case), "sensors", "noise.seed", "x.offset") == pytest.approx([5, 0.3])
    assert given(systems(case), "kalman", "use_road", "road.valid") == [True, True]
    assert given(systems(Case("bump", "mpc", states="estimated")), "kalman", "use_road", "road.valid") == [False, False]


def test_a_case_sets_car_and_actuators(systems):
    plain = systems(Case("bump", "lqr"))
    names = ("supply.running", "supply.limited", "supply.flow_limit", "valve.null_opening", "solver.step")
    assert given(plain, "actuator_rr", *names) == [True, False, 0.00075, 0.005, 0.00025]
    assert given(plain, "car", "tires.lift_off", "friction.acting", "solver.step") == [True, False, 0.0005]
    pump: dict[str, Any] = {"flow_limit": True, "pump_l_min": 120.0, "shared_pump": True, "null_opening_mm": 4.0}
    system = systems(Case("bump", "lqr", lift_off=False, friction=True, solver_parts=2, **pump))
    assert given(system, "actuator_rr", *names) == [True, True, 0.0005, 0.004, 0.000125]
    assert given(system, "car", "tires.lift_off", "friction.acting", "solver.step") == [False, True, 0.00025]
    assert given(systems(Case("bump", "passive")), "actuator_fl", "supply.running", "valve.voltage") == [False, 0.0]
    assert system["car"].step == Fraction(1, 2000)
    assert systems(finer(Case("bump", "lqr")))["actuator_fl"].step == Fraction(1, 4000)


def test_a_run_that_ends_before_its_metrics_begin_is_refused(fmus, raises):
    """Off road they begin where all wheels are beyond the ramp."""
    with Runner(EXPERIMENT, fmus) as runner, raises(CaseError):
        runner.metrics(Case("off-road", "passive", duration=2.0))


def test_what_a_run_is_compared_with():
    """The passive car on the same road, in the same state; nothing that it does not have."""
    kept: dict[str, Any] = {"speed_kmh": 50.0, "variant": 2, "friction": True, "lift_off": False, "driven": True}
    kept |= {"null_opening_mm": 6.0, "duration": 2.0, "solver_parts": 2, "exchange_parts": 2}
    own: dict[str, Any] = {"states": "estimated", "preview": "sensed", "flow_limit": True, "pump_l_min": 60.0}
    assert runs.passive(Case("bump", "mpc-preview", **kept, **own)) == Case("bump", "passive", **kept)


@pytest.mark.parametrize(
    "change",
    [
        {"controller": "lqr"},
        {"actuators": "ideal"},
        {"states": "estimated"},
        {"driven": True},
        {"preview_error_ms": 5.0},
        {"exchange_parts": 2},
        {"road": "off-road"},
    ],
)
def test_what_is_wired_differently_is_another_system(change):
    case = Case("bump", "mpc-preview")
    assert runs.structure(replace(case, **change)) != runs.structure(case)
    assert runs.structure(replace(case, variant=3, speed_kmh=50.0, flow_limit=True, preview_steps=3)) == runs.structure(
        case
    )


def test_what_is_recorded():
    names = runs.recorded(Case("track", "mpc"))
    assert {
        "car.tire.rr.force",
        "actuator_rr.flow",
        "tracking_rr.valve.saturated",
        "controller.force.rr",
        "road.height_above_travel",
        "controller.solver.residual",
    } <= set(names)
    assert not {
        n for n in runs.recorded(Case("off-road", "passive")) if n.startswith(("tracking", "controller", "road.bumps"))
    }
    assert not {
        n for n in runs.recorded(Case("track", "lqr", actuators="ideal")) if n.startswith(("tracking", "actuator"))
    }


# ------------------------------------------------------------------------------------------------------------ the parts


def test_a_corner_is_changed_as_its_case_says(systems):
    case = tracking.runs.Case
    names = ("fluid.density", "cylinder.leakage")
    changes = {
        case(density=0.8, leakage=2.0): {"fluid.density": 2800.0, "cylinder.leakage": 3e-11},
        case(rate_filter=True): {"rate.numerical": False},
        case(average=True): {"average.enabled": True},
        case(integral=0.0): {"lambda_1": 0.0},
        case(notches=True): {"notch.heave_pitch.enabled": True, "notch.roll.enabled": True},
    }
    base = {"fluid.density": 3500.0, "cylinder.leakage": 1.5e-11}
    for one, changed in changes.items():
        assert systems(one)["tracking"].values == pytest.approx({**base, **changed})
    assert given(systems(case(actuator="physical")), "tracking", names[0]) == [850.0]
    system = systems(case(friction=False, solver_parts=2, exchange_parts=2))
    assert given(system, "car", "friction.acting", "solver.step") == [False, 0.00025]
    assert given(system, "actuator", "bypass.area", "solver.step") == [0.0, 0.000125]
    assert {system[n].step for n in ("car", "actuator")} == {Fraction(1, 4000)}
    noisy = systems(case(noise=50.0))
    assert noisy["cell"].values == {"noise": 50.0}
    made = {c.target_name: c.source_name for c in noisy.connections.values()}
    assert (made["tracking.force.measured"], made["cell.force"]) == ("cell.measured", "actuator.force")
    assert list(systems(case("filter")).components) == ["tracking"]
    assert given(systems(case("filter")), "tracking", "force.desired") == [1.0]


def test_a_chain_is_set_as_its_case_says(systems):
    case = preview.runs.Case
    system = systems(case(height_mm=76.0, compensation=True, use_road=False))
    assert given(system, "road", "bump.height[1]", "bump.height[7]", "length") == [0.076, 0.0, 1000.0]
    assert given(system, "sensors", "range.resolution[1]", "noise.scale", "range.dropout.duration") == [0.0, 0.0, 0.0]
    assert given(system, "kalman", "use_road") == [False]
    assert given(system, "preview_sensor", "compensation") == [1]
    assert given(system, "speed", "start.speed", "start.x") == pytest.approx([8.9408, 0.0])
    system = systems(case(road="track", noise=0.5, dropout_start=0.7, dropout=0.2))
    assert given(system, "road", "bump.height[1]", "bump.height[7]") == [0.057, 0.038]
    assert given(
        system, "sensors", "range.resolution[1]", "noise.scale", "range.dropout.start", "range.dropout.duration"
    ) == [0.01, 0.5, 0.7, 0.2]
    assert given(system, "kalman", "use_road") == [True]
    system = systems(chains.generated(2.0))
    assert given(system, "sensors", "speed.gain") == [1.02]
    assert [given(system, n, "bump.height[1]", "bump.height[7]") for n in ("road", "map")] == [[0.057, 0.038]] * 2
    assert {system[n].step for n in ("car", "actuator_fl")} == {Fraction(1, 2000)}
    made = {c.target_name: c.source_name for c in system.connections.values()}
    assert (made["map.x"], made["map.speed"]) == ("sensors.x.measured", "sensors.speed.measured")


@pytest.mark.parametrize("order", ["gauss-seidel", "jacobi"])
def test_car_and_actuator_advance_as_the_case_says(fmus, order):
    with tracking.runs.wire(fmus, tracking.runs.Case("square", order=order)) as system:
        assert [m.name for m in system.groups["strut"].components] == ["car", "actuator"]
        assert system.groups["strut"].method == order


def test_every_place_of_the_bumps_has_a_height():
    found = wiring.bump_parameters({2: 0.038})
    assert found == {
        **{f"bump.height[{i}]": 0.038 if i == 2 else 0.0 for i in range(1, wiring.PLACES + 1)},
        "bump.first": wiring.FIRST_BUMP,
    }
