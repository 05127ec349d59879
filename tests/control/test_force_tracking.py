"""Force tracking: the law against its equations, its filters against the printed transfer function, its limits."""

from __future__ import annotations

import math

import numpy as np
import pytest
from named import Named
from scipy import signal

from build_fmus.component import Model
from build_fmus.reference import Evaluator
from fmu_sources.controllers.force_tracking import force_tracking, smoothing_filter
from fmu_sources.plants import hydraulic_actuator
from fmu_sources.vehicles import load_actuator

PERIOD = 1e-3
AREA, SUPPLY, LEAKAGE, ALPHA = 0.0044, 20684e3, 15e-12, 2.273e12
TAU, GAIN, WIDTH, DISCHARGE = 3e-3, 1481.0, 8e-3, 0.7
DENSITY = {"actuator_hmmwv": 3500.0, "actuator_hmmwv_physical": 850.0}
STROKE = 10.0 / GAIN


@pytest.fixture(scope="module", params=list(DENSITY))
def controller(request) -> Model:
    return force_tracking(load_actuator(request.param), name=request.param).model()


@pytest.fixture(scope="module")
def paper() -> Model:
    return force_tracking(load_actuator("actuator_hmmwv"), name="actuator_hmmwv").model()


class Law(Named):
    """One controller; each `tick` is a sample and gives its outputs by name."""

    def tick(self, desired=0.0, measured=0.0, spool=0.0, velocity=0.0) -> dict[str, float]:
        self.u[:] = desired, measured, spool, velocity
        self.step(PERIOD)
        return self.shown()


# --------------------------------------------------------------------------------------------------- desired force


def printed_filter() -> signal.TransferFunction:
    return signal.TransferFunction([6.4e9], [1, 950, 385625, 7.6e7, 6.4e9])


def test_smoothing_is_the_printed_filter(paper):
    """Step response of (1.16), exactly, at every sample; its rate is the derivative of the force."""
    law = Law(paper)
    response = np.array([law.tick(desired=2000.0)["force.smoothed"] for _ in range(60)])
    _, expected = signal.step(printed_filter(), T=np.arange(60) * PERIOD)
    np.testing.assert_allclose(response, 2000 * expected, atol=1e-6 * 2000)
    A, B = smoothing_filter(PERIOD)
    pole = np.exp(PERIOD * (-237.5 + 153.6j))  # twice, so numerically of half the precision
    assert np.abs(np.poly(A) - np.poly([pole, pole, pole.conj(), pole.conj()])).max() < 1e-4
    assert np.linalg.solve(np.eye(4) - A, B) == pytest.approx([1, 0, 1, 0], abs=1e-9)


def test_rise_of_the_smoothing():
    """10 to 90 % in 12.9 ms, first crosses 1 at 25 ms, half of the power at 26.75 Hz."""
    t = np.linspace(0, 0.05, 50001)
    _, y = signal.step(printed_filter(), T=t)
    assert t[np.argmax(y > 0.9)] - t[np.argmax(y > 0.1)] == pytest.approx(12.9e-3, abs=0.05e-3)
    assert t[np.argmax(y >= 1)] == pytest.approx(25e-3, abs=0.5e-3)
    w, h = signal.freqresp(printed_filter(), 2 * np.pi * np.linspace(20, 35, 15001))
    assert w[np.argmax(np.abs(h) < math.sqrt(0.5))] / 2 / np.pi == pytest.approx(26.75, abs=0.02)


def test_bypassed_smoothing_passes_the_force_itself(paper):
    law = Law(paper, {"smoothing.enabled": False})
    assert [law.tick(desired=f)["force.smoothed"] for f in (5.0, 700.0, -3.0)] == [5.0, 700.0, -3.0]


# -------------------------------------------------------------------------------------------------------- the law


def spool_for(flow: float, load: float, density: float) -> float:
    """Spool stroke that passes `flow` against load pressure `load`."""
    return flow / (DISCHARGE * WIDTH * math.sqrt((SUPPLY - math.copysign(1, flow) * load) / density))


def test_law_is_that_of_the_paper(controller):
    """(1.10), (1.12), (1.15) written out with numbers, with the force at rest and the integral off."""
    density = DENSITY[controller.name]
    law = Law(controller, {"lambda_1": 0.0})
    samples = [(300.0, 1e-4, 0.05), (-500.0, 2e-4, 0.06), (800.0, -3e-4, -0.04)]
    before = None
    for measured, spool, velocity in samples:
        y = law.tick(measured=measured, spool=spool, velocity=velocity)
        load = measured / AREA
        flow = AREA * velocity + LEAKAGE * load - 300.0 * load / ALPHA
        target = spool_for(flow, load, density)
        rate = 0.0 if before is None else (target - before) / PERIOD
        before = target
        assert y["flow.desired"] == pytest.approx(flow, rel=1e-9)
        assert y["spool.desired"] == pytest.approx(target, rel=1e-9)
        assert y["valve.voltage"] == pytest.approx(
            GAIN * (spool + TAU * rate - 800.0 * TAU * (spool - target)), rel=1e-9
        )
        assert y["force.error"] == measured
        assert not y["saturated"]


def test_integral_of_the_error(paper):
    """(1.8): a lasting error of 100 N adds lambda_1 (1 + eta_1 t) times its pressure to the rate that is asked for."""
    runs = {rate: Law(paper, {"lambda_1": rate}) for rate in (0.0, 0.5)}
    for k in range(50):
        y = {rate: law.tick(measured=100.0) for rate, law in runs.items()}
        extra = 0.5 * 100.0 / AREA * (1 + 300.0 * k * PERIOD)
        assert y[0.0]["flow.desired"] - y[0.5]["flow.desired"] == pytest.approx(extra / ALPHA, rel=1e-9)


def test_filtered_rate(paper):
    """(1.13): Psi follows by forward Euler, its rate replaces the difference."""
    law = Law(paper, {"rate.numerical": False, "lambda_1": 0.0})
    psi = None
    for velocity in (0.02, 0.05, 0.05, -0.03):
        y = law.tick(velocity=velocity)
        target = y["spool.desired"]
        psi = target if psi is None else psi
        rate = (target - psi) / TAU
        psi += PERIOD * rate
        assert y["valve.voltage"] == pytest.approx(GAIN * (TAU * rate + 800.0 * TAU * target), rel=1e-9)


def test_average_of_the_two_before(paper):
    """(1.14): half of the sum of the last two, without the present one; from the first sample on."""
    velocities = [0.01, 0.03, 0.02, 0.05, -0.04]
    plain, averaged = Law(paper), Law(paper, {"average.enabled": True})
    targets = [plain.tick(velocity=v)["spool.desired"] for v in velocities]
    means = [averaged.tick(velocity=v)["spool.desired"] for v in velocities]
    history = [targets[0], targets[0], *targets]
    assert means == pytest.approx([(history[k + 1] + history[k]) / 2 for k in range(len(targets))], rel=1e-12)


@pytest.mark.parametrize(("mode", "frequency"), [("heave_pitch", 2.0), ("roll", 4.0)])
def test_notches(paper, mode, frequency):
    """Half is left at the center, nearly all far from it, and a constant passes from the first sample on."""
    for at, expected in ((frequency, 0.5), (0.0, 1.0), (10 * frequency, 1.0)):
        law, plain = Law(paper, {f"notch.{mode}.enabled": True}), Law(paper)
        n = 1500 if at else 20
        v = [0.02 * math.cos(2 * math.pi * at * k * PERIOD) for k in range(n)]
        through = np.array([law.tick(velocity=x)["spool.desired"] for x in v])
        without = np.array([plain.tick(velocity=x)["spool.desired"] for x in v])
        last = slice(-round(1 / at / PERIOD), None) if at else slice(None)
        ratio = np.linalg.norm(through[last]) / np.linalg.norm(without[last])
        assert ratio == pytest.approx(expected, abs=0.01)


def test_quiet_at_rest(controller):
    law = Law(controller)
    for _ in range(5):
        y = law.tick()
        assert not any(y.values())


# --------------------------------------------------------------------------------------------------------- limits


def test_spool_and_voltage_end_at_the_valve(controller):
    law = Law(controller)
    y = law.tick(velocity=5.0)
    assert y["spool.desired"] == pytest.approx(STROKE)
    assert y["valve.voltage"] == 10.0
    assert y["spool.saturated"]
    assert y["valve.saturated"]
    assert y["saturated"]
    y = Law(controller).tick(velocity=-5.0)
    assert (y["spool.desired"], y["valve.voltage"]) == (pytest.approx(-STROKE), -10.0)


@pytest.mark.parametrize("load", [0.99, 1.0, 1.5, -1.2])
def test_root_of_the_supply_pressure_stays_real(controller, load):
    """Load pressures at and beyond the supply, flow in their direction: flagged, finite, full stroke."""
    sign = math.copysign(1, load)
    y = Law(controller).tick(desired=0.0, measured=load * SUPPLY * AREA, velocity=2.5 * sign)
    assert np.isfinite(list(y.values())).all()
    assert y["supply.saturated"]
    assert y["spool.desired"] * sign > 0


def test_integral_waits_at_a_limit(paper):
    """A second at full voltage with a lasting error leaves no memory: afterwards as if it had not been."""
    stuck, fresh = Law(paper, {"lambda_1": 1.0}), Law(paper, {"lambda_1": 1.0})
    for _ in range(1000):
        y = stuck.tick(desired=20e3, measured=0.0, velocity=2.0)
        assert y["saturated"]
        fresh.tick(desired=20e3, measured=20e3)
    integral = {v.name: v.slot for v in paper.all_variables if v.role == "state"}["error.integral"]
    assert stuck.x[integral] == 0.0
    free = Law(paper, {"lambda_1": 1.0})
    for _ in range(1000):
        free.tick(measured=100.0)
    assert free.x[integral] == pytest.approx(100.0 / AREA, rel=1e-9)


# ------------------------------------------------------------------------------------------------------- in the loop


@pytest.mark.parametrize("pair", [(k, k) for k in DENSITY], ids=str)
def test_tracks_with_a_held_piston(pair):
    """Actuator behind a locked piston: the force follows the smoothed command, also through its steps."""
    actuator = Evaluator(hydraulic_actuator(load_actuator(pair[0])).model())
    names = [e.name for e in actuator.component.output_elements()]
    force, spool = names.index("force"), names.index("spool.position")
    law = Law(force_tracking(load_actuator(pair[1])).model())
    errors, smoothed = [], []
    for k in range(400):
        now = actuator.outputs()
        y = law.tick(desired=2000.0 if k % 200 < 100 else -2000.0, measured=now[force], spool=now[spool])
        errors.append(y["force.error"])
        smoothed.append(y["force.smoothed"])
        actuator.u[0] = y["valve.voltage"]
        actuator.step(PERIOD)
    assert np.linalg.norm(errors) < 0.2 * np.linalg.norm(smoothed)
    assert abs(errors[99]) < 20.0


def test_contract_and_what_the_controller_believes(controller):
    inputs = [e.name for e in controller.elements("input")]
    assert inputs == ["force.desired", "force.measured", "spool.position", "piston.velocity"]
    assert {"valve.voltage", "force.smoothed"} <= {e.name for e in controller.output_elements()}
    plant = hydraulic_actuator(load_actuator(controller.name))
    believed = [e for e in controller.elements("parameter") if e.name.split(".")[0] in ("cylinder", "fluid", "valve")]
    assert len(believed) == 10
    for e in believed:
        same = plant.variable(e.name)
        assert (e.start, e.variable.unit, e.variable.min) == (same.start[0], same.unit, same.min)
    assert controller.variable("fluid.density").start == (DENSITY[controller.name],)
    assert controller.kind == "discrete"
    assert controller.sample_time == PERIOD
