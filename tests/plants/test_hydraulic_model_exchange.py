"""The hydraulic actuators under CVode: Model Exchange converges on Co-Simulation, and on an independent solution."""

from __future__ import annotations

import re
from functools import lru_cache
from pathlib import Path

import fmpy
import fmpy.sundials
import numpy as np
import pytest
from built import BuiltFmus
from scipy.integrate import solve_ivp

from build_fmus.component import Model
from build_fmus.reference import Evaluator
from fmu_sources.plants import hydraulic_actuator
from fmu_sources.vehicles import load_actuator

STEP = 5e-4  # s, from row to row
TOLERANCES = (1e-4, 1e-6, 1e-8, 1e-10)
# Global error of CVode in units of its relative tolerance, which bounds the error of one step: 4 to 30 in these runs.
PER_TOLERANCE = 50.0
VEHICLES = {"HydraulicActuator": "actuator_hmmwv", "HydraulicActuatorPhysical": "actuator_hmmwv_physical"}
DOCS = Path(__file__).parents[2] / "docs"


@lru_cache
def component(name: str) -> Model:
    return hydraulic_actuator(load_actuator(VEHICLES[name]), name=name).model()


@pytest.fixture(scope="module", params=list(VEHICLES))
def name(request: pytest.FixtureRequest) -> str:
    return request.param


@pytest.fixture(scope="module")
def path(name: str, built_fmus: BuiltFmus) -> str:
    return str(built_fmus.path(name, 2))


@lru_cache
def rows(name: str) -> np.ndarray:
    """The reference inputs of the component, one row per `STEP`.

    The valve's step is from 0.06 s to the row after it.
    """
    c = component(name)
    table = np.zeros(201, dtype=[("time", float), *((n, float) for n in c.reference_inputs)])
    table["time"] = np.arange(len(table)) * STEP
    for n, signal in c.reference_inputs.items():
        table[n] = [signal(t) for t in table["time"]]
    return table


def held(table: np.ndarray) -> np.ndarray:
    """Each row until the next one, where a doubled row makes an event."""
    result = np.repeat(table, 2)[:-1]
    result["time"][1:] = np.repeat(table["time"], 2)[2:]
    return result


def force(path: str, interface: str, table: np.ndarray, **options: object) -> np.ndarray:
    """Force [N] at the rows, by FMPy."""
    result = fmpy.simulate_fmu(
        path,
        fmi_type=interface,
        stop_time=rows("HydraulicActuator")["time"][-1],
        output_interval=STEP,
        step_size=STEP,
        input=table,
        output=["force"],
        record_events=False,
        **options,
    )
    assert len(result) == 201
    return result["force"]


def by_cvode(path: str, table: np.ndarray, tolerance: float) -> np.ndarray:
    return force(path, "ModelExchange", table, solver="CVode", relative_tolerance=tolerance)


class ReadsInputs(fmpy.sundials.CVodeSolver):
    """FMPy's CVode with the inputs read wherever the right-hand side is evaluated."""

    def f(self, t, y, ydot, user_data):  # type: ignore[no-untyped-def]
        self.input.apply(t)
        return super().f(t, y, ydot, user_data)


def refined(path: str, table: np.ndarray, tolerance: float) -> tuple[np.ndarray, float]:
    """Co-Simulation with solver steps halved until it moves by less than the tolerance.

    At most down to the shortest step there is. Also by how much it moved, in units of its range.
    """
    before = None
    for step in (64e-6, 32e-6, 16e-6, 8e-6, 4e-6, 2e-6, 1e-6):
        now = force(path, "CoSimulation", table, start_values={"solver.step": step})
        moved = np.inf if before is None else np.abs(now - before).max() / np.ptp(now)
        if moved < tolerance:
            break
        before = now
    return now, moved


@lru_cache
def independent(name: str) -> np.ndarray:
    """Force at the rows for inputs that are linear between them: scipy's Radau on the Python evaluation, row by row."""
    table, run = rows(name), Evaluator(component(name))
    slots = {e.name: e.slot for e in component(name).elements("input")}

    def rhs(t: float, x: np.ndarray) -> np.ndarray:
        for n, slot in slots.items():
            run.u[slot] = np.interp(t, table["time"], table[n])
        return run.rhs(t, x)

    x = run.x
    pressure = [x[0]]
    for begin, end in zip(table["time"][:-1], table["time"][1:], strict=True):
        solution = solve_ivp(rhs, (begin, end), x, method="Radau", rtol=1e-11, atol=[1e-4, 1e-14])
        assert solution.success
        x = solution.y[:, -1]
        pressure.append(x[0])
    return component(name).vector("parameter")[_slot(name, "cylinder.area")] * np.array(pressure)


def _slot(name: str, parameter: str) -> int:
    return next(e.slot for e in component(name).elements("parameter") if e.name == parameter)


@pytest.mark.parametrize("tolerance", TOLERANCES)
def test_held_inputs_converge_on_cosimulation(name: str, path: str, tolerance: float) -> None:
    table = held(rows(name))
    expected, moved = refined(path, table, tolerance)
    assert moved < max(tolerance, 2e-8)
    error = np.abs(by_cvode(path, table, tolerance) - expected).max() / np.ptp(expected)
    assert error < PER_TOLERANCE * tolerance + moved


@pytest.mark.parametrize("tolerance", TOLERANCES)
def test_linear_inputs_converge_on_an_independent_solution(
    name: str, path: str, tolerance: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Rows are events, since the slope of the inputs jumps there."""
    monkeypatch.setattr(fmpy.sundials, "CVodeSolver", ReadsInputs)
    expected = independent(name)
    linear = np.repeat(rows(name), 2)[1:-1]
    error = np.abs(by_cvode(path, linear, tolerance) - expected).max()
    assert error < PER_TOLERANCE * tolerance * np.ptp(expected)


def test_kinks_need_no_events(name: str, path: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """The valve's step, its saturation and the spool's crossing of its center inside a solver step.

    No event anywhere.
    """
    monkeypatch.setattr(fmpy.sundials, "CVodeSolver", ReadsInputs)
    expected = independent(name)
    for tolerance in (1e-6, 1e-7, 1e-8):
        error = np.abs(by_cvode(path, rows(name), tolerance) - expected).max()
        assert error < 200 * tolerance * np.ptp(expected)


def documented() -> tuple[float, float]:
    """Part of the range by which such an importer moves the force, from docs/how-to/other-tools.md."""
    text = " ".join((DOCS / "how-to" / "other-tools.md").read_text().split())
    found = re.search(r"moves the force by (\d+) to (\d+) % of its range", text)
    assert found, "docs/how-to/other-tools.md does not say by how much the force is moved"
    return float(found[1]) / 100, float(found[2]) / 100


def test_what_an_importer_adds_that_reads_inputs_between_steps_only(name: str, path: str) -> None:
    """FMPy as it is, on the inputs of the documentation.

    The documented error, and the end below the documented tolerance.
    """
    low, high = documented()
    expected = independent(name)
    for tolerance in (1e-4, 1e-5, 1e-6, 1e-7):
        error = np.abs(by_cvode(path, rows(name), tolerance) - expected).max()
        assert low <= error / np.ptp(expected) <= high, (tolerance, error / np.ptp(expected))
    with pytest.raises(RuntimeError, match="error test failed"):
        by_cvode(path, rows(name), 1e-8)


def test_nominal_values_are_those_of_a_run(name: str) -> None:
    """Tools take the absolute tolerance of a state from its nominal value: a tenth to ten times its largest value."""
    run, table = Evaluator(component(name)), rows(name)
    slots = {e.name: e.slot for e in component(name).elements("input")}
    largest = np.abs(run.x)
    for row in table[:-1]:
        for n, slot in slots.items():
            run.u[slot] = row[n]
        run.step(STEP)
        largest = np.maximum(largest, np.abs(run.x))
    for e in component(name).elements("state"):
        assert 0.1 < largest[e.slot] / e.variable.nominal < 10, e.name
