"""Derivatives carried from the end of a run to its beginning, beside those carried forward."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import pytest
from built import BuiltFmus
from rides import RIDES, system_of
from same import bits

from cosim import Record, System
from cosim.batch import adjoint
from cosim.experiments.bench import EXPERIMENT as BENCH
from cosim.experiments.bench.runs import Case as BenchCase
from cosim.experiments.gpc import EXPERIMENT as GPC
from cosim.experiments.gpc.runs import Case as GpcCase
from cosim.experiments.hmmwv import EXPERIMENT as HMMWV
from cosim.experiments.hmmwv.runs import Case as HmmwvCase
from cosim.experiments.preview_lq import EXPERIMENT as RIDE
from cosim.experiments.preview_lq.runs import Case as RideCase
from cosim.gradient import Final, Gradient, GradientError, Mean, Metric, Peak, QuadraticCost, Rms
from cosim.gradient.gradient import DIRECTIONS
from cosim.tables import Table

pytestmark = [
    pytest.mark.filterwarnings("ignore::cosim.UnconnectedInputsWarning"),
    pytest.mark.usefixtures("built_fmus"),
]
METRICS: Mapping[str, Metric] = {**RIDES, "J": QuadraticCost({"car.body.az": 1.0, "car.body.z": 1e4})}


def both(system: System, metrics: Mapping[str, Metric], parameters: Any, **arguments: Any) -> tuple[Gradient, Gradient]:
    """The adjoint, which agrees with the derivatives carried forward, and these."""
    forward = system.gradient(metrics, parameters, mode="forward", **arguments)
    found = system.gradient(metrics, parameters, mode="adjoint", **arguments)
    assert [found.mode, forward.mode] == ["adjoint", "forward"]
    assert found.parameters == forward.parameters
    np.testing.assert_array_equal(bits(found.values), bits(forward.values))
    np.testing.assert_array_equal(bits(found.recording.data), bits(forward.recording.data))
    np.testing.assert_array_equal(bits(found.recording.time), bits(forward.recording.time))
    size = np.abs(forward.jacobian * forward.at).max(axis=1, keepdims=True)
    assert (size > 0.0).all()
    assert (np.abs(found.jacobian - forward.jacobian) * np.abs(forward.at) < 1e-12 * size).all()
    assert not found.by_difference
    assert found.tangents.shape == (0, *forward.tangents.shape[1:])
    return found, forward


@pytest.fixture
def quarter_car(built_fmus: BuiltFmus) -> System:
    system = System()
    system.add("car", built_fmus.path("QuarterCarBench", 3), step="1 ms")
    system["car"].set({"body.z": 0.01, "wheel.vz": -0.2, "force": 3.0})
    return system


def test_steps_without_a_sample_keep_the_outputs(quarter_car: System, built_fmus: BuiltFmus) -> None:
    """Of a controller that nothing depends on, stepped twice as often as it samples."""
    time = np.linspace(0.0, 0.4, 101)
    quarter_car.add("ramp", Table({"time": time, "v": np.sin(40.0 * time)}, units={"v": "m/s"}))
    quarter_car.add("law", built_fmus.path("LqrBench", 3), step="0.25 ms")
    quarter_car.connect("ramp.v", "law.wheel.vz")
    quarter_car.connect("law.force", "car.force")
    both(quarter_car, METRICS, ["car.body.mass", "car.body.z"], stop_time="0.4 s")
    force = quarter_car.run("0.4 s", record=Record(["law.force"], interval="0.25 ms"))["law.force"]
    assert 0 < np.count_nonzero(np.diff(force)) <= len(force) / 2


def test_a_linear_run(quarter_car: System) -> None:
    names = ["car.*.mass", "car.*.stiffness", "car.*.damping", "car.body.z", "car.wheel.vz", "car.force"]
    found, _ = both(quarter_car, METRICS, names, stop_time="0.4 s")
    assert len(found.parameters) == 9


@pytest.mark.parametrize("segments", [1, 7, 400])
def test_the_number_of_segments_does_not_matter(
    quarter_car: System, monkeypatch: pytest.MonkeyPatch, segments: int
) -> None:
    names = ["car.*.mass", "car.body.z"]
    found = quarter_car.gradient(METRICS, names, stop_time="0.4 s", mode="adjoint")
    monkeypatch.setattr(adjoint, "SEGMENTS", segments)
    monkeypatch.setattr(adjoint, "_ENTRIES", 1 << 9)  # a tape that must grow
    again = quarter_car.gradient(METRICS, names, stop_time="0.4 s", mode="adjoint")
    np.testing.assert_allclose(again.jacobian, found.jacobian, rtol=1e-13)
    assert again.changes == found.changes


def test_a_tape_grows_with_what_is_active(quarter_car: System, monkeypatch: pytest.MonkeyPatch) -> None:
    """At first it has space for fewer numbers than depend on the parameters."""
    monkeypatch.setattr(adjoint, "_ENTRIES", 4)
    both(quarter_car, METRICS, ["car.*mass", "car.*.stiffness", "car.body.z"], stop_time="0.1 s")


def test_more_metrics_than_go_side_by_side(quarter_car: System) -> None:
    metrics: dict[str, Metric] = {f"power {p}": Peak("car.body.az", power=float(p)) for p in range(2, 12)}
    found, _ = both(quarter_car, metrics, "car.*.mass", stop_time="0.2 s", interval="3 ms")
    one = quarter_car.gradient(
        {"power 7": metrics["power 7"]}, "car.*.mass", stop_time="0.2 s", interval="3 ms", mode="adjoint"
    )
    np.testing.assert_allclose(one.jacobian[0], found.jacobian[5], rtol=1e-13)


def test_a_full_car_under_gpc() -> None:
    """Components at several rates, delays of the exchange, a road that begins to matter after the begin."""
    system = system_of(GPC, GpcCase())
    names = ["car.body.*", "car.tire.stiffness", "controller.gain.preview[?,9]", "car.suspension.*", "road.*.x"]
    found, forward = both(system, RIDES, names, stop_time=2.5, interval="10 ms")
    assert DIRECTIONS < len(found.parameters) <= 2 * DIRECTIONS  # two copies
    assert found.changes["road"] >= forward.changes["road"] > 0


def test_many_parameters_take_the_adjoint() -> None:
    system = system_of(GPC, GpcCase())
    gains = [f"controller.gain.preview[{i},{j}]" for i in range(1, 5) for j in range(1, 5)]
    few = system.gradient(RIDES, gains, stop_time=0.5, interval="10 ms")
    many = system.gradient(RIDES, [*gains, "car.body.mass"], stop_time=0.5, interval="10 ms")
    assert (few.mode, many.mode) == ("forward", "adjoint")
    np.testing.assert_allclose(many.jacobian[:, : len(gains)], few.jacobian, rtol=1e-9, atol=1e-14)


def test_a_ride_car_under_preview() -> None:
    both(system_of(RIDE, RideCase()), RIDES, ["car.*.mass", "car.*.stiffness", "car.body.z"], stop_time=1.5)


def test_a_random_road(built_fmus: BuiltFmus) -> None:
    """Its profile is no part of the saved states."""
    with System(allow_unconnected=True) as system:
        for name, fmu in {"speed": "SpeedProfile", "road": "RoadRandom", "car": "QuarterCarBench"}.items():
            system.add(name, built_fmus.path(fmu, 3), step="1 ms")
        system["speed"].set({"start.x": 40.0})
        system.connect("speed.x", "road.x")
        system.connect("road.road.fl.height", "car.road.height")
        both(system, METRICS, ["car.*.mass", "car.*.stiffness", "speed.start.*"], stop_time="0.5 s")


@pytest.mark.parametrize("rule", [{"delay": True}, {"extrapolate": True}, {"linear": (2.0, 0.001)}])
def test_rules_of_exchange(built_fmus: BuiltFmus, rule: Mapping[str, Any]) -> None:
    with System(allow_unconnected=True) as system:
        system.add("car", built_fmus.path("QuarterCarBench", 3), step="1 ms")
        system.add("second", built_fmus.path("QuarterCarBench", 3), step="5 ms")
        system["car"].set({"body.z": 0.01})
        system.connect("car.body.z", "second.road.height", **rule)
        system.connect("second.body.z", "car.road.height")
        both(system, METRICS, ["*.body.mass", "*.*.stiffness", "second.body.z"], stop_time="0.3 s")


def test_quadratic_programs() -> None:
    """Warm starts of the solver, OSQP, are restored where segments begin: the run keeps its bits."""
    system = system_of(BENCH, BenchCase())
    metrics: Mapping[str, Metric] = {"ride": Rms("plant.body.az"), "mean": Mean("plant.body.z")}
    found, _ = both(system, metrics, ["plant.body.mass", "plant.wheel.mass"], stop_time=0.4, interval="2 ms")
    assert found.changes["controller"] > 0


def test_a_stiff_solver(built_fmus: BuiltFmus) -> None:
    system = System()
    system.add("actuator", built_fmus.path("HydraulicActuator", 3), step="1 ms")
    system["actuator"].set({"valve.voltage": 1.0, "piston.velocity": 0.01})
    names = ["actuator.fluid.bulk_modulus", "actuator.valve.time_constant", "actuator.piston.velocity"]
    metrics: Mapping[str, Metric] = {"force": Rms("actuator.force"), "end": Final("actuator.flow")}
    found, _ = both(system, metrics, names, stop_time="0.2 s")
    assert np.abs(found.trust().deviation).max() < 1e-8


@pytest.mark.full
def test_a_car_with_actuators_under_preview_control() -> None:
    system = system_of(HMMWV, HmmwvCase())
    names = ["car.body.mass", "actuator_fl.cylinder.area", "tracking_rr.*"]
    both(system, {"ride": Rms("car.body.az"), "mean": Mean("car.body.z")}, names, stop_time=1.0, interval="2 ms")


def test_components_without_an_adjoint_are_named() -> None:
    system = system_of(RIDE, RideCase())
    system.isolate("controller")
    refusal = "'controller' has no adjoint (it is isolated in a process of its own): take mode='forward'"
    for mode, message in {"adjoint": refusal, "reverse": "no mode 'reverse' (there are: forward, adjoint)"}.items():
        with pytest.raises(GradientError) as raised:
            system.gradient({"ride": Rms("car.body.az")}, "car.body.mass", stop_time=0.1, mode=mode)
        assert str(raised.value) == message
    system.close()


def test_a_run_that_fails_has_no_adjoint(quarter_car: System) -> None:
    quarter_car["car"].set({"body.z": 1e9, "suspension.stiffness": 1e-3})
    with pytest.raises(GradientError, match=r"^the run has no derivatives, since it ends"):
        quarter_car.gradient({"end": Final("car.body.z")}, "car.body.mass", stop_time="0.3 s", mode="adjoint")
