"""Refuse a component whose solver step is too long for its own dynamics.

The FMU repeats this check with the parameters that a user sets (``runtime/stability.c``): both must come to the same verdict.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from build_fmus.component import Model


class SolverStepError(ValueError):
    """The fixed-step solver is unstable at an operating point; the message names it and a step that works."""


def amplification(solver: str, z: np.ndarray) -> np.ndarray:
    """Largest modulus of the solver's amplification factor for ``z = step * eigenvalue`` (elementwise).

    rk4: the degree-4 Taylor polynomial. am2: predictor-corrector in PECE mode; the predictor is Euler in the first step
    after an exchange and Adams-Bashforth-2 later, so the larger of both factors counts. ros2: the rational function of
    the L-stable Rosenbrock method, at most 1 in the whole left half plane.
    """
    z = np.asarray(z, dtype=complex)
    if solver == "rk4":
        return np.abs(1 + z + z**2 / 2 + z**3 / 6 + z**4 / 24)
    if solver == "ros2":
        gamma = 1 - np.sqrt(0.5)
        return np.abs((1 + (1 - 2 * gamma) * z) / (1 - gamma * z) ** 2)
    first = np.abs(1 + z + z**2 / 2)
    # x+ = x + z/2 (x + x + 1.5 z x - 0.5 z x_before): r^2 = b r + c
    b, c = 1 + z + 0.75 * z**2, -0.25 * z**2
    root = np.sqrt(b**2 / 4 + c)
    return np.maximum(first, np.maximum(np.abs(b / 2 + root), np.abs(b / 2 - root)))


def step_matrix(matrix: np.ndarray, velocity_of: np.ndarray, h: float) -> np.ndarray:
    """One step of solver semi_implicit for ``dx/dt = matrix x``: drift, kick with the midpoint rule, drift.

    It has no scalar amplification factor, because positions and velocities advance differently.
    """
    n = len(matrix)
    moving = velocity_of >= 0
    drift = np.eye(n)
    drift[np.flatnonzero(moving), velocity_of[moving]] = h / 2
    slope = np.where(moving[:, None], 0.0, matrix)
    return drift @ (np.eye(n) + h * slope @ (np.eye(n) + h / 2 * slope)) @ drift


@dataclass(frozen=True)
class Instability:
    """What a solver step cannot follow: the eigenvalue [1/s] of largest modulus, where, and the longest step [s] that
    would do at all points, None when there is none."""

    point: str
    eigenvalue: complex
    step: float | None


def find_instability(component: Model, matrices: Mapping[str, np.ndarray], step: float) -> Instability | None:
    """The worst of the given points, or None when the component's solver follows all of them with this step [s].

    A mode fails when its numerical amplification over one step exceeds both 1 and the true growth by more than 1e-6. Of
    shorter steps those shorter by a power of 1.25 are tried, down to the least that ``solver.step`` may have.

    Raises:
        LinAlgError: a matrix is not finite.
    """
    bad = [(name, w) for name, matrix in matrices.items() for w in _unstable(component, step, matrix)]
    if not bad:
        return None
    name, worst = max(bad, key=lambda b: abs(b[1]))
    shortest, shorter = component.variable("solver.step").min or 0.0, step / 1.25
    while shorter >= shortest and any(_unstable(component, shorter, m).size for m in matrices.values()):
        shorter /= 1.25
    return Instability(name, complex(worst.real, abs(worst.imag)), shorter if shorter >= shortest else None)


def check_solver(component: Model) -> None:
    """Check every declared operating point.

    Raises:
        SolverStepError: naming the operating point, the eigenvalue and the longest stable step.
    """
    if component.kind != "continuous":
        return
    wrong = find_instability(component, matrices_by_point(component), component.solver_step)
    if wrong:
        advice = (
            f"a step of {wrong.step:.3g} s would do" if wrong.step else "no step that solver.step may have would do"
        )
        raise SolverStepError(
            f"{component.name}: solver {component.solver} with step {component.solver_step:g} s is unstable at "
            f"operating point {wrong.point!r} (eigenvalue {wrong.eigenvalue:.4g} 1/s); {advice}"
        )


def eigenvalues_by_point(component: Model) -> dict[str, np.ndarray]:
    """Eigenvalues [1/s] of the linearized component at each declared operating point."""
    return {n: np.linalg.eigvals(a) if a.size else np.zeros(0) for n, a in matrices_by_point(component).items()}


def matrices_by_point(component: Model, parameters: np.ndarray | None = None) -> dict[str, np.ndarray]:
    """System matrix A of the linearized component at each declared operating point.

    ``parameters``: the vector of their values, the start values by default.
    """
    states = {e.name: e.slot for e in component.elements("state")}
    inputs = {e.name: e.slot for e in component.elements("input")}
    result = {}
    for name, values in component.operating_points.items():
        u = component.vector("input")
        p = component.vector("parameter") if parameters is None else parameters
        for k, v in values.items():
            if k in inputs:
                u[inputs[k]] = v
        x = np.asarray(component.functions["start"](component.vector("state"), u, p)).ravel()
        for k, v in values.items():
            if k in states:
                x[states[k]] = v
        result[name] = component.linearize(x, u, p).A
    return result


def _unstable(component: Model, step: float, matrix: np.ndarray) -> np.ndarray:
    """Eigenvalues [1/s] that the solver cannot follow with this step; solver semi_implicit: the fastest as a stand-in."""
    if not matrix.size:
        return np.zeros(0)
    eigenvalues, solver = np.linalg.eigvals(matrix), component.solver
    if solver == "semi_implicit":
        radius = np.abs(np.linalg.eigvals(step_matrix(matrix, component.velocity_of, step))).max()
        stable = radius <= np.exp(max(0.0, eigenvalues.real.max()) * step) + 1e-6
        return np.zeros(0) if stable else eigenvalues[[np.argmax(np.abs(eigenvalues))]]
    # ros2 grows a little faster than the truth where the truth grows; its pole at step * eigenvalue = 3.4 must stay far.
    slack = 1.1 if solver == "ros2" else 1.0
    growth = np.exp(slack * np.maximum(eigenvalues.real, 0.0) * step)
    return eigenvalues[amplification(solver, step * eigenvalues) > growth + 1e-6]
