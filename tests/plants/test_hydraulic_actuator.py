"""Hydraulic actuator of paper 001: steady states, dynamics, energy, limits, and what a user may set."""

from __future__ import annotations

import math
import re

import casadi as ca
import numpy as np
import pytest
from named import Named
from oracles.eigenvalues import eigenvalues_by_point
from scipy.optimize import brentq

from build_fmus.base import units
from build_fmus.component import Model
from build_fmus.reference import simulate
from build_fmus.stability import check_solver
from fmu_sources.plants import hydraulic_actuator, quarter_car
from fmu_sources.vehicles import load_actuator, load_quarter_car, load_vehicle

AREA, SUPPLY, LEAKAGE, ALPHA = 0.0044, 20684e3, 15e-12, 2.273e12
TAU, GAIN, WIDTH, DISCHARGE = 3e-3, 1481.0, 8e-3, 0.7
DENSITY = {"actuator_hmmwv": 3500.0, "actuator_hmmwv_physical": 850.0}
OIL_COLUMN = AREA**2 * ALPHA  # 44 MN/m


@pytest.fixture(scope="module", params=list(DENSITY))
def actuator(request) -> Model:
    return hydraulic_actuator(load_actuator(request.param), name=request.param).model()


class Run(Named):
    def get(self, name: str) -> float:
        return float(self.outputs()[self.names.index(name)])

    def settle(self, seconds: float = 0.5) -> Run:
        for _ in range(round(seconds / 5e-4)):
            self.step(5e-4)
        return self


def gradient(component: Model) -> float:
    """Flow per spool stroke and root of pressure."""
    return DISCHARGE * WIDTH / math.sqrt(DENSITY[component.name])


# -------------------------------------------------------------------------------------------------------- steady state


@pytest.mark.parametrize("voltage", [0.01, 0.05, 0.3, 2.0, 10.0])
def test_steady_force_against_leakage(actuator, voltage):
    """Without motion the valve feeds the leak: C_d1 w u sqrt((P_s - P)/rho) = C_tm P."""
    flow = gradient(actuator) * voltage / GAIN
    expected = AREA * brentq(lambda p: flow * math.sqrt(SUPPLY - p) - LEAKAGE * p, 0.0, SUPPLY)
    run = Run(actuator).put(valve__voltage=voltage).settle(1.0)
    assert run.get("force") == pytest.approx(expected, rel=2e-5)
    assert run.get("flow") == pytest.approx(LEAKAGE * expected / AREA, rel=1e-4)
    assert run.get("load_pressure") == pytest.approx(expected / AREA, rel=2e-5)


def test_stall_force(actuator):
    """91 kN: supply pressure on the piston; leakage takes 0.3 to 1.2 % of it at full voltage."""
    tight = Run(actuator, {"cylinder.leakage": 0.0}).put(valve__voltage=10.0).settle()
    assert tight.get("force") == pytest.approx(91.0e3, rel=5e-4)
    leaking = Run(actuator).put(valve__voltage=10.0).settle()
    assert 0.985 * 91.0e3 < leaking.get("force") < 0.998 * 91.0e3


def test_symmetric_in_sign(actuator):
    one, other = Run(actuator), Run(actuator)
    for k in range(400):
        t = k * 5e-4
        u = {"valve.voltage": 6 * math.sin(40 * t) + 3, "piston.velocity": 0.2 * math.cos(90 * t)}
        one.put(bypass__area=1e-6 * k, **u).step(5e-4)
        other.put(bypass__area=1e-6 * k, **{n: -x for n, x in u.items()}).step(5e-4)
        for odd in ("force", "spool.position", "valve.flow", "bypass.flow"):
            assert one.get(odd) == pytest.approx(-other.get(odd), rel=1e-9, abs=1e-12)
        for even in ("flow", "power", "piston.power", "loss.valve", "stored_energy"):
            assert one.get(even) == pytest.approx(other.get(even), rel=1e-9, abs=1e-12)


def test_signs(actuator):
    """Positive voltage extends the strut; extension lowers the load pressure."""
    assert Run(actuator).put(valve__voltage=1.0).settle(0.01).get("force") > 0
    assert Run(actuator).put(piston__velocity=0.01).settle(0.01).get("force") < 0


def test_oil_column_is_a_spring_of_44_meganewton_per_meter(actuator):
    """With valve and leak closed the force falls by 44 MN/m times the extension."""
    run = Run(actuator, {"cylinder.leakage": 0.0}).put(piston__velocity=0.02)
    run.settle(0.05)
    assert run.get("force") == pytest.approx(-OIL_COLUMN * 0.02 * 0.05, rel=1e-6)
    assert pytest.approx(44e6, rel=1e-3) == OIL_COLUMN


# ------------------------------------------------------------------------------------------------------------ dynamics


def test_spool_follows_with_its_time_constant(actuator):
    run = Run(actuator).put(valve__voltage=2.0)
    for k in range(1, 40):
        run.step(5e-4)
        expected = 2.0 / GAIN * (1 - math.exp(-k * 5e-4 / TAU))
        assert run.get("spool.position") == pytest.approx(expected, rel=1e-3)
    assert np.isclose(eigenvalues_by_point(actuator)["start"], -1 / TAU).any()


def test_voltage_saturates_and_says_so(actuator):
    full, beyond, back = Run(actuator), Run(actuator), Run(actuator)
    full.put(valve__voltage=10.0).settle(0.02)
    beyond.put(valve__voltage=37.0).settle(0.02)
    back.put(valve__voltage=-37.0).settle(0.02)
    assert beyond.x.tobytes() == full.x.tobytes()
    assert [r.get("valve.saturated") for r in (full, beyond, back)] == [0.0, 1.0, 1.0]
    assert back.get("spool.position") == -full.get("spool.position")


@pytest.mark.parametrize("fraction", [0.25, 0.5])
def test_steps_are_fine_enough(actuator, fraction):
    """Reference run: the solver step moves the force by less than 0.1 % of its range."""
    coarse = simulate(actuator)
    fine = simulate(actuator, parameters={"solver.step": 2.5e-4 * fraction})
    force = coarse.output_names.index("force")
    difference = coarse.outputs[:, force] - fine.outputs[:, force]
    assert np.sqrt(np.mean(difference**2)) < 1e-3 * np.ptp(fine.outputs[:, force])


def test_solver_is_stable_where_the_component_is_stiff(actuator):
    check_solver(actuator)
    stiffest = min(e.real.min() for e in eigenvalues_by_point(actuator).values())
    assert stiffest * 2.5e-4 < -2.8  # rk4 would not do


# -------------------------------------------------------------------------------------------------------------- energy


@pytest.mark.parametrize("bypass", [0.0, 2e-5])
@pytest.mark.parametrize("parameters", [{}, {"supply.limited": 1.0}, {"supply.running": 0.0}], ids=str)
def test_energy_balance(actuator, parameters, bypass):
    """Supply = piston + losses + change of stored energy: exact at each instant, and in sum over a run to 1 %."""
    run, h = Run(actuator, parameters).put(bypass__area=bypass), 5e-4
    supplied = used = throughput = 0.0
    stored_before = run.get("stored_energy")
    sinks = ("piston.power", "loss.valve", "loss.bypass", "loss.leakage")
    shown = [run.names.index(n) for n in ("power", *sinks)]

    def powers() -> np.ndarray:
        return run.outputs()[shown]

    for k in range(1500):
        t = k * h
        run.put(valve__voltage=3 * math.sin(2 * math.pi * 2 * t), piston__velocity=0.08 * math.cos(2 * math.pi * 3 * t))
        before = powers()
        pressure_rate = run.rhs(t, run.x)[0]
        stored_rate = run.get("load_pressure") * pressure_rate / ALPHA
        assert before[0] == pytest.approx(before[1:].sum() + stored_rate, abs=1e-6 * (1 + np.abs(before).max()))
        assert min(before[2:]) >= -1e-9
        run.step(h)
        mean = (before + powers()) / 2 * h
        supplied += mean[0]
        used += mean[1:].sum()
        throughput += np.abs(mean).max()
    change = run.get("stored_energy") - stored_before
    assert abs(supplied - used - change) < 0.01 * max(abs(supplied), throughput / 2)
    assert throughput > 5.0  # [J]: the run is not empty


# -------------------------------------------------------------------------------------------------------------- limits


def top_speed(component: Model, voltage: float, parameters: dict[str, float]) -> tuple[float, float]:
    """Steady speed [m/s] and supply flow [m3/s] of a free piston with 300 kg on it (car first, then actuator)."""
    run, v, h = Run(component, {"solver.step": 1e-4, **parameters}), 0.0, 1e-4
    speeds, flows = [], []
    for _ in range(2500):
        v += h / 300.0 * run.get("force")
        run.put(valve__voltage=voltage, piston__velocity=v).step(h)
        speeds.append(v)
        flows.append(run.get("flow"))
    return float(np.mean(speeds[-500:])), float(np.mean(flows[-500:]))


@pytest.mark.parametrize("voltage", [10.0, -10.0])
def test_flow_limit_caps_the_piston_speed(actuator, voltage):
    """45 l/min through 44 cm2 are 0.17 m/s."""
    speed, flow = top_speed(actuator, voltage, {"supply.limited": 1.0})
    assert abs(speed) == pytest.approx(45 / 60000 / AREA, rel=5e-3)
    assert abs(speed) == pytest.approx(0.17, abs=0.002)
    assert flow == pytest.approx(45 / 60000, rel=5e-3)
    free, _ = top_speed(actuator, voltage, {})
    assert abs(free) == pytest.approx(gradient(actuator) * 10 / GAIN * math.sqrt(SUPPLY) / AREA, rel=0.02)
    assert abs(free) > 3 * abs(speed)


def test_flow_limit_does_nothing_below_it(actuator):
    runs = [Run(actuator, {"supply.limited": x}).put(valve__voltage=0.5).settle(0.1) for x in (0.0, 1.0)]
    assert runs[0].x.tobytes() == runs[1].x.tobytes()


def test_pump_off_is_a_damper(actuator):
    """No supply pressure, spool at its null opening: force = -A_p P with C_d1 w u0 sqrt(P/rho) + C_tm P = A_p v."""
    run = Run(actuator, {"supply.running": 0.0})
    assert run.get("spool.position") == pytest.approx(5e-3)
    run.put(valve__voltage=8.0)  # without effect
    for v in (0.3, -0.3, 1.0):
        run.put(piston__velocity=v).settle(0.3)
        pressure = brentq(
            lambda p, v=v: gradient(actuator) * 5e-3 * math.sqrt(p) + LEAKAGE * p - AREA * abs(v), 0.0, 1e10
        )
        assert run.get("force") == pytest.approx(-math.copysign(AREA * pressure, v), rel=1e-4)
        assert run.get("power") == 0.0
        assert run.get("spool.position") == pytest.approx(5e-3)


def test_bypass_is_a_variable_damper(actuator):
    """Spool centered: C_d2 a sqrt(2 P/rho) + C_tm P = A_p v; a wider bypass damps less."""
    forces = []
    for area in (1e-5, 2e-5, 5e-5):
        run = Run(actuator).put(bypass__area=area, piston__velocity=0.4).settle(0.3)
        pressure = brentq(
            lambda p, area=area: (
                DISCHARGE * area * math.sqrt(2 * p / DENSITY[actuator.name]) + LEAKAGE * p - AREA * 0.4
            ),
            0.0,
            1e10,
        )
        assert run.get("force") == pytest.approx(-AREA * pressure, rel=1e-4)
        forces.append(-run.get("force"))
    assert forces == sorted(forces, reverse=True)


def test_a_load_above_the_supply_drives_fluid_back(actuator):
    run = Run(actuator).put(valve__voltage=10.0).settle(0.2)
    run.put(piston__velocity=-0.3).settle(0.2)
    assert run.get("load_pressure") > SUPPLY
    assert run.get("flow") < 0
    assert run.get("power") < 0
    assert run.get("loss.valve") > 0


# -------------------------------------------------------------------------------------------- derivatives, everywhere


def test_finite_everywhere(actuator):
    """Derivatives of all orders used (Jacobian of the solver, directional) at every awkward combination."""
    f = actuator.functions
    x, u, p = (ca.SX.sym(n, actuator.size(r)) for n, r in (("x", "state"), ("u", "input"), ("p", "parameter")))
    y = ca.vertcat(f["rhs"](0, x, u, p), f["out"](0, x, u, p))
    everything = ca.vertcat(x, u, p)
    slopes = ca.Function("slopes", [x, u, p], [y, ca.jacobian(y, everything)])
    names = [e.name for e in actuator.elements("parameter")]
    for running in (0.0, 1.0):
        for limited in (0.0, 1.0):
            values = actuator.vector("parameter")
            values[names.index("supply.running")], values[names.index("supply.limited")] = running, limited
            for pressure in (0.0, SUPPLY, -SUPPLY, 1e-300, 1e9, -1e9):
                for spool in (0.0, 1e-300, 6.752e-3, -6.752e-3):
                    for command in ([0.0, 0.0, 0.0], [10.0, 1e-4, 1.0], [-10.0, 0.0, -1.0], [1e6, 1.0, 100.0]):
                        for matrix in slopes([pressure, spool], command, values):
                            assert np.isfinite(matrix.full()).all(), (running, limited, pressure, spool, command)


def test_pressure_slope_at_the_supply_limit_is_that_of_the_smoothing(actuator):
    """At P = P_s the paper's root has an infinite slope; here it is 1/sqrt(smoothing)."""
    slope = actuator.linearize(np.array([SUPPLY, 1e-3]), np.zeros(3)).A[0, 0]
    assert slope == pytest.approx(-ALPHA * (gradient(actuator) * 1e-3 / math.sqrt(2e3) + LEAKAGE), rel=1e-6)


# --------------------------------------------------------------------------------------------- with the car, at 0.5 ms


def coupled(component: Model, h: float) -> tuple[np.ndarray, np.ndarray]:
    """Quarter car (1.1) and actuator, car first; force [N] at every millisecond of 1 s."""
    car = Run(quarter_car(load_quarter_car("quarter_car_hmmwv")).model())
    actuator = Run(component)
    forces = []
    for k in range(round(1.0 / h)):
        t = k * h
        car.put(force=actuator.get("force")).step(h)
        actuator.put(
            valve__voltage=0.5 * math.sin(2 * math.pi * 2.0 * t), piston__velocity=car.get("suspension.velocity")
        ).step(h)
        if (k + 1) % round(1e-3 / h) == 0:
            forces.append(actuator.get("force"))
    return np.arange(1, 1001) * 1e-3, np.array(forces)


def test_coupled_with_the_car_at_half_a_millisecond(actuator):
    """Stable in Gauss-Seidel order, and the communication step hardly matters."""
    _, coarse = coupled(actuator, 5e-4)
    _, fine = coupled(actuator, 2.5e-4)
    rms = math.sqrt(np.mean(fine**2))
    assert rms > 500.0
    assert math.sqrt(np.mean((coarse - fine) ** 2)) < 0.01 * rms


# --------------------------------------------------------------------------------------------------- files and units


def test_limits_hold_for_the_fmi_parameters_too(actuator):
    for name in ("supply.pressure", "cylinder.volume", "fluid.density", "valve.time_constant", "cylinder.area"):
        assert actuator.variable(name).min > 0
    assert actuator.variable("bypass.area").min == 0.0


def test_parameter_sets():
    paper, physical = load_actuator("actuator_hmmwv"), load_actuator("actuator_hmmwv_physical")
    assert (paper.fluid.density.value, physical.fluid.density.value) == (3500.0, 850.0)
    assert 4 * paper.fluid.bulk_modulus.value / paper.cylinder.volume.value == pytest.approx(ALPHA, rel=1e-8)
    assert (paper.cylinder.area.value, paper.supply.pressure.value) == (AREA, SUPPLY)
    assert paper.supply.flow_limit.value == pytest.approx(45 / 60000)
    assert physical.cylinder == paper.cylinder
    assert load_vehicle("actuator_hmmwv_physical").kind == "actuator"


def exponents(text: str) -> dict[str, int]:
    """Base units of a product like `Pa` or `m3/s`; several factors separated by spaces."""
    total: dict[str, int] = {}
    for part in text.split():
        for base, n in units.unit(part).powers.items():
            total[base] = total.get(base, 0) + n
    return {b: n for b, n in total.items() if n}


def test_every_term_has_the_unit_of_its_sum(actuator):
    """Terms of (1.3) are flows, those of the balance are powers, the spool moves at m/s."""

    def unit(name: str) -> str:
        return actuator.variable(name).unit or "1"

    flow, power = exponents("m3/s"), exponents("W")
    assert exponents(f"{unit('cylinder.area')} {unit('piston.velocity')}") == flow
    assert exponents(f"{unit('cylinder.leakage')} {unit('load_pressure')}") == flow
    # width times stroke times root of pressure per density: the root is a velocity
    root = exponents(f"{unit('load_pressure')}")
    density = exponents(unit("fluid.density"))
    squared = {b: root.get(b, 0) - density.get(b, 0) for b in root | density}
    assert {b: n for b, n in squared.items() if n} == {"m": 2, "s": -2}
    assert exponents(f"{unit('valve.width')} {unit('spool.position')} m/s") == flow
    assert exponents(f"{unit('bypass.area')} m/s") == flow
    assert exponents(f"{unit('valve.gain')} {unit('spool.position')}") == exponents(unit("valve.voltage"))
    assert exponents(f"{unit('cylinder.area')} {unit('load_pressure')}") == exponents(unit("force"))
    assert exponents(f"{unit('force')} {unit('piston.velocity')}") == power
    assert exponents(f"{unit('load_pressure')} {unit('flow')}") == power
    for name in ("power", "piston.power", "loss.valve", "loss.bypass", "loss.leakage"):
        assert exponents(unit(name)) == power
    # alpha (flow) = bulk modulus / volume * flow is a pressure rate
    assert exponents(f"{unit('fluid.bulk_modulus')} {unit('flow')}") == exponents(f"Pa/s {unit('cylinder.volume')}")


def test_contract_of_names(actuator):
    assert [e.name for e in actuator.elements("input")] == ["valve.voltage", "bypass.area", "piston.velocity"]
    outputs = {e.name for e in actuator.output_elements()}
    assert {"force", "load_pressure", "spool.position", "flow", "power", "valve.saturated"} <= outputs
    assert all(re.fullmatch(r"[a-z_.]+", n) for n in outputs)
