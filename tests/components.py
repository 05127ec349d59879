"""Components that exist for the tests only: small, and with everything the declaration language offers.

They go through the conformance suite beside the catalog, because no published component has all of it: Integer and
Boolean parameters and inputs, calculated starts, matrices, hidden state, both kinds of solver.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import casadi as ca
import numpy as np

from build_fmus.builder import Options
from build_fmus.compile import ObjectCache, resolve_platforms
from build_fmus.component import Component, Solver
from build_fmus.package import build_fmu
from build_fmus.qp import Backend, Daqp, Osqp


def oscillator(name: str = "ProbeRk4", solver: Solver = "rk4", fastest: float = 0.05) -> Component:
    """A nonlinear oscillator that starts in equilibrium under its inputs, with a vector of first-order lags.

    `fastest` [s] is the first lag: short of the solver step the component is stiff.
    """
    c = Component(
        name,
        kind="continuous",
        description="Nonlinear oscillator of the tests",
        source="none",
        solver=solver,
        stop_time=1.0,
    )
    mass = c.parameter("mass", 2.0, "kg", "mass", min=0.1, max=1e3, source="none")
    stiffness = c.parameter("stiffness", 150.0, "N/m", "linear stiffness", min=1.0, source="none")
    cubic = c.parameter("cubic", 40.0, "N/m3", "cubic stiffness", min=0.0, source="none")
    damping = c.parameter("damping", 3.0, "N.s/m", "damping", min=0.0, tunable=True, source="none")
    lag = c.parameter(
        "lag", [fastest, 0.1, 0.2], "s", "time constants of the lags", min=min(1e-3, fastest / 10), source="assumed"
    )
    order = c.parameter("order", 1, None, "harmonic of the forcing", min=0, max=5, source="none")
    forced = c.parameter("forced", True, None, "whether the harmonic forcing acts", source="none")
    force = c.input("force", "N", "force", min=-1e4, max=1e4)
    kick = c.input("corner.fl.kick", "N", "three more forces", shape=(3,))
    brake = c.input("brake", None, "whether the brake is on", type=bool, start=False)
    gear = c.input("gear", None, "gear", type=int, start=1, min=0, max=6)

    newton = c.constant("newton", 1.0, "N", "size of the harmonic forcing", source="none")
    hertz = c.constant("hertz", 1.0, "Hz", "its lowest frequency", source="none")
    total = force + kick[0] + 2 * kick[1] - kick[2]
    x = c.state("x", "m", "position", start=total / stiffness, output=True, nominal=0.1)
    v = c.state("v", "m/s", "velocity", start=0.1, output=True, min=-100, max=100)
    w = c.state("w", "N", "lagged forces", start=[1.0, 2.0, 3.0], shape=(3,))
    harmonic = ca.if_else(forced, newton * ca.sin(2 * math.pi * order * hertz * c.time), 0)
    a = (total + harmonic - stiffness * x - cubic * x**3 - damping * (1 + 4 * brake) * v) / mass
    c.derivative(x, v)
    c.derivative(v, a)
    c.derivative(w, (gear * kick - w) / lag)
    c.output("a", a, "m/s2", "acceleration")
    c.output("corner.fl.lagged", w, "N", "lagged forces", display_unit="kN")
    quarter = c.constant("quarter", 0.25, "m", "length of a sector", source="none")
    slow = c.constant("slow", 1e-2, "m/s", "up to here the mass counts as at rest", source="none")
    c.output("sector", ca.floor(x / quarter), None, "quarter meter the mass is in", type=int)
    c.output("moving", v * v > slow**2, None, "whether the mass moves", type=bool)
    c.reference_input(
        {
            "force": lambda t: 10.0 * math.sin(5.0 * t),
            "corner.fl.kick[2]": lambda t: 3.0 if t > 0.05 else 0.5,
            "brake": lambda t: 0.08 < t < 0.12,
            "gear": lambda t: 1 + int(20 * t),
        }
    )
    return c


def filter_bank(name: str = "ProbeDiscrete") -> Component:
    """A sampled filter with hidden state, a matrix gain, flags and counters."""
    c = Component(
        name,
        kind="discrete",
        sample_time=0.005,
        description="Sampled filter of the tests",
        source="none",
        stop_time=1.0,
    )
    gain = c.parameter(
        "gain.y", [[1.0, 2.0, 3.0], [4.0, 5.0, 6.0]], "1", "gain", min=-100.0, max=100.0, source="counted: 1 to 6"
    )
    pole = c.parameter("pole", 0.8, "1", "pole of the filter", min=0.0, max=0.999, tunable=True, source="assumed")
    limit = c.parameter("limit", 20.0, "N", "limit of the outputs", min=0.0, source="none")
    y = c.input("y", "N", "measurements", shape=(3,))
    valid = c.input("y.valid", None, "whether the measurements are valid", type=bool, start=True)
    offset = c.input("offset", None, "offset", type=int, start=0, min=-5, max=5)
    trim = c.input("trim", "N", "added to all", min=-1.0, max=2.0, shape=(2,))
    c.constant_input("y.step", "s", "time between measurements", must_equal=0.03)

    newton = c.constant("newton", 1.0, "N", "1 N", source="none")
    held = c.state("held", "N", shape=(3,), start=y)  # the first measurement
    table = c.state(
        "table", "N", shape=(2, 2), start=ca.horzcat(ca.vertcat(y[0], y[1]), ca.vertcat(y[2], 7.0 * newton))
    )
    count = c.state("count", "1", start=0.0)
    filtered = ca.if_else(valid, pole * held + (1 - pole) * y, held)
    raw = gain @ filtered + offset * newton + trim
    u = ca.fmin(ca.fmax(raw, -limit), limit)
    c.update(held, filtered)
    c.update(table, ca.vertcat(table[1, :], table[0, :] + 0.01 * newton * count))
    c.update(count, count + 1)
    c.output("u", u, "N", "filtered and amplified measurements")
    c.output("turned", table, "N", "a matrix that turns over")
    c.output("clock", c.time, "s", "time of the sample")
    c.output("u.step", 0.005, "s", "time between outputs")
    c.output("samples", count, None, "samples before this one", type=int)
    c.output("saturated", ca.mmax(ca.fabs(raw)) > limit, None, "whether a limit is active", type=bool)
    c.reference_input(
        {
            "y[1]": lambda t: math.sin(40 * t),
            "y[2]": lambda t: math.cos(25 * t),
            "y[3]": lambda t: 8 * t,
            "y.valid": lambda t: not 0.2 < t < 0.3,
            "offset": lambda t: int(3 * math.sin(9 * t)),
        }
    )
    return c


def optimizer(name: str = "ProbeQpDaqp", backend: Backend = Daqp()) -> Component:  # noqa: B008 (frozen)
    """A sampled law with a quadratic program: two cases, an equation, a row that makes it infeasible for a while."""
    c = Component(
        name,
        kind="discrete",
        sample_time=0.01,
        description="Quadratic program of the tests",
        source="none",
        stop_time=1.0,
    )
    limit = c.parameter("limit", 1.5, "N", "limit of each command", min=0.1, tunable=True, source="none")
    requested = c.input("requested", "N", "requested commands", shape=(3,), min=-1e3, max=1e3)
    total = c.input("total", "N", "what the first two commands add up to", min=-1e3, max=1e3)
    stiff = c.input("stiff", None, "case", type=int, start=0, min=0, max=1)
    last = c.state("last", "N", shape=(3,), start=[0.1, 0.2, 0.3])
    failures = c.state("count", "1", start=0.0)

    soft = np.array([[2.0, 0.5, 0.0], [0.5, 1.0, 0.2], [0.0, 0.2, 3.0]])
    rows = np.array([[1.0, 0, 0], [0, 1.0, 0], [0, 0, 1.0], [1.0, 1.0, 0], [0.3, -1.0, 2.0]])
    s = c.quadratic_program(
        "solver",
        hessians=[soft, soft + np.diag([5.0, 0.0, 1.0])],
        constraints=[rows],
        linear=-(soft @ requested) - 0.3 * last,
        lower=ca.vertcat(*[-limit] * 3, total, -1e30),
        upper=ca.vertcat(*[limit] * 3, total, 2.0 + 0.1 * last[0]),
        case=stiff,
        backend=backend,
    )
    command = ca.if_else(s.status > 0, last, s.z)
    c.update(last, command)
    c.update(failures, failures + (s.status > 0))
    c.output("command", ca.fmin(ca.fmax(command, -limit), limit), "N", "best commands within the limits")
    c.output("price", s.multipliers[3], "1", "multiplier of the equation")
    c.output("failures", failures, None, "samples without a solution", type=int)
    c.reference_input(
        {
            "requested[1]": lambda t: 3 * math.sin(12 * t),
            "requested[2]": lambda t: 2 * math.cos(31 * t),
            "requested[3]": lambda t: 5 * t - 2,
            "total": lambda t: 4.0 if 0.145 < t < 0.185 else 0.5 + t,  # infeasible
            "stiff": lambda t: int(t > 0.165),
        }
    )
    return c


class Program(NamedTuple):
    """Numbers of a quadratic program."""

    hessian: np.ndarray
    rows: np.ndarray
    linear: np.ndarray
    lower: np.ndarray
    upper: np.ndarray


MISJUDGED = Program(  # of a random search: feasible, badly scaled, and found infeasible by OSQP as built by default
    np.diag([0.01, 100.0]),
    np.array([[-50.0, -4.0], [-10.0, -4.0], [0.0, 1.0]]),
    np.array([400.0, 5.0]),
    np.array([-251.0, 109.99, -51.0]),
    np.array([-249.0, 110.01, -50.0]),
)


MAKERS = {
    "ProbeRk4": oscillator,
    "ProbeAm2": lambda: oscillator("ProbeAm2", "am2"),
    "ProbeRos2": lambda: oscillator("ProbeRos2", "ros2", fastest=1e-4),
    "ProbeDiscrete": filter_bank,
    "ProbeQpDaqp": optimizer,
    "ProbeQpOsqp": lambda: optimizer("ProbeQpOsqp", Osqp(rho=1.0)),
}


@dataclass(frozen=True)
class ProbeEntry:
    """A test component as the builder sees it."""

    name: str
    needs: tuple[str, ...] = ()
    files: tuple[Path, ...] = (Path(__file__),)
    choices: str = ""


CATALOG = {name: ProbeEntry(name) for name in MAKERS}


def build_entry(name: str, options: Options, versions: tuple[int, ...]) -> None:
    """Make and write the FMUs of one test component."""
    cache = ObjectCache(options.cache / "objects")
    for fmi in versions:
        target = options.target(name, fmi)
        target.parent.mkdir(parents=True, exist_ok=True)
        target.write_bytes(
            build_fmu(MAKERS[name](), fmi, resolve_platforms(options.platform), cache, arrays=options.arrays)
        )
