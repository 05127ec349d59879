"""Skyhook damping: equation (1.17) at each corner, the sampled command, its limit, and what it does to the car."""

from __future__ import annotations

import numpy as np
import pytest
from named import Named

from build_fmus.reference import Evaluator
from fmu_sources.controllers.skyhook import skyhook
from fmu_sources.models.corners import CORNERS
from fmu_sources.models.hmmwv_states import FORCES, RELATIVE_STATES
from fmu_sources.plants import ride_car
from fmu_sources.vehicles import load_ride_car


@pytest.fixture(scope="module")
def car():
    return ride_car(load_ride_car("ride_car_hmmwv"), name="RideCarHmmwv")


@pytest.fixture(scope="module")
def controller(car):
    return skyhook(car).model()


def command(controller, parameters=None, **inputs):
    """Outputs by name for inputs by name (`__` for `.`), all others 0."""
    return Named(controller, parameters).put(**inputs).shown()


def test_heave_roll_pitch_and_wheel(controller):
    """B_sky 2000, K_vel 1000; half track 0.91 m, wheels 1.651 m before and behind the CG."""
    heave = command(controller, body__vz=0.1)
    assert [heave[n] for n in FORCES] == pytest.approx([-300.0] * 4)
    roll = command(controller, body__roll_rate=0.1)  # left side goes up: pull it down
    assert [roll[n] for n in FORCES] == pytest.approx([-273.0, 273.0, -273.0, 273.0])
    pitch = command(controller, body__pitch_rate=0.1)  # nose goes down: push it up
    assert [pitch[n] for n in FORCES] == pytest.approx([495.3, 495.3, -495.3, -495.3])
    wheel = command(controller, wheel__rl__vz=0.2)  # a rising wheel takes the body along, as the relative damper does
    assert [wheel[n] for n in FORCES] == pytest.approx([0.0, 0.0, 200.0, 0.0])


def test_only_the_sky_damper_acts_when_the_car_moves_as_a_whole(controller):
    """Body and wheels together: the relative damper is silent."""
    moved = command(controller, body__vz=0.1, **{f"wheel__{k}__vz": 0.1 for k in CORNERS})
    assert [moved[n] for n in FORCES] == pytest.approx([-200.0] * 4)


def test_damping_takes_effect_and_the_force_is_limited(controller):
    p = {"damping.sky": 30000.0, "damping.relative": 0.0}
    far = command(controller, p, body__vz=-1.0, body__roll_rate=0.9)
    assert [far[n] for n in FORCES] == pytest.approx([30000 * 0.181, 8000.0, 30000 * 0.181, 8000.0])
    assert far["force.limited"] == 1
    assert command(controller, body__vz=-1.0)["force.limited"] == 0
    assert command(controller, {"force.limit": 0.0}, body__vz=-1.0)["force.fl"] == 0.0


def test_deflections_and_acceleration_are_there_and_do_nothing(controller):
    """The inputs of every higher-level controller, so that one can be exchanged for another."""
    assert [e.name for e in controller.elements("input")] == [*RELATIVE_STATES, "body.az"]
    silent = {n.replace(".", "__"): 1.0 for n in (*RELATIVE_STATES[:8], "body.az")}
    assert [command(controller, **silent)[n] for n in FORCES] == [0.0] * 4
    assert "body.az" not in controller.dependencies["force.fl"]


def test_it_damps_heave_roll_and_pitch_of_the_car(car, controller):
    """With the force at once, the slow modes of the car are damped more than without."""
    lin = car.linearize()
    evaluator = Evaluator(controller)
    columns = [lin.outputs.index(n) for n in RELATIVE_STATES]
    gain = np.zeros((4, len(lin.states)))
    for i in range(len(RELATIVE_STATES)):
        evaluator.u[:] = 0.0
        evaluator.u[i] = 1e-3
        gain += np.outer(evaluator.outputs()[:4] / 1e-3, lin.C[columns[i]])
    B = lin.B[:, [lin.inputs.index(n) for n in FORCES]]

    def slow(A):
        values = np.linalg.eigvals(A)
        return np.sort([-v.real / abs(v) for v in values if v.imag > 0 and abs(v) < 6 * np.pi])

    assert np.all(slow(lin.A + B @ gain) > slow(lin.A) + 0.05)
