"""Refuse a component whose solver step is too long for its own dynamics.

The FMU repeats this check with the parameters that a user sets (`runtime/stability.c`): both must come to the same
verdict.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from build_fmus import solvers
from build_fmus.component import Model


class SolverStepError(ValueError):
    """The fixed-step solver is unstable at an operating point; the message names it and a step that works."""


def amplification(solver: str, z: np.ndarray) -> np.ndarray:
    """Largest modulus of the solver's amplification factor for `z = step * eigenvalue` (elementwise).

    The factor is what one step of length 1 makes of x = 1 with dx/dt = z x. am2 has two: the predictor is Euler in the
    first step after an exchange and Adams-Bashforth-2 later, so the larger of both counts.
    """
    z = np.asarray(z, dtype=complex)
    one = np.ones_like(z)

    def f(_: float, x: np.ndarray) -> np.ndarray:
        return z * x

    if solver == "rk4":
        return np.abs(solvers.rk4(f, 0.0, one, 1.0))
    if solver == "ros2":
        return np.abs(np.reshape([_ros2_factor(k) for k in z.ravel()], z.shape))
    first, before = solvers.am2(f, 0.0, one, 1.0)
    # Later steps make b x + c x_before of two states in a row: from x = 0 after 1, and from x = 1 after 0.
    c, rest = solvers.am2(f, 0.0, 0 * one, 1.0, before)
    b, _ = solvers.am2(f, 0.0, one, 1.0, rest)
    root = np.sqrt(b**2 / 4 + c)  # of r^2 = b r + c
    return np.maximum(np.abs(first), np.maximum(np.abs(b / 2 + root), np.abs(b / 2 - root)))


def _ros2_factor(z: complex) -> complex:
    one = np.ones(1)
    matrix = np.array([[z]])
    try:
        return complex(solvers.ros2(lambda _, x: z * x, lambda *_: (matrix, 0 * one), 0.0, one, 1.0, one)[0])
    except np.linalg.LinAlgError:
        return complex(np.inf)  # its pole


def step_matrix(matrix: np.ndarray, velocity_of: np.ndarray, h: float) -> np.ndarray:
    """One step of solver semi_implicit for `dx/dt = matrix x`.

    It has no scalar amplification factor, because positions and velocities advance differently.
    """
    return solvers.semi_implicit(lambda _, x: matrix @ x, 0.0, np.eye(len(matrix)), h, velocity_of)


@dataclass(frozen=True)
class Instability:
    """What a solver step cannot follow: the eigenvalue [1/s] of largest modulus, and where.

    Also the longest step [s] that is stable at all points; None when no step is.
    """

    point: str
    eigenvalue: complex
    step: float | None


def find_instability(component: Model, matrices: Mapping[str, np.ndarray], step: float) -> Instability | None:
    """The worst of the given points, or None when the component's solver follows all of them with this step [s].

    A mode fails when its numerical amplification over one step exceeds both 1 and the true growth by more than 1e-6. Of
    shorter steps those shorter by a power of 1.25 are tried, down to the least that `solver.step` may have.

    Raises:
        LinAlgError: a matrix is not finite.
    """
    bad = [(name, w) for name, matrix in matrices.items() for w in _unstable(component, step, matrix)]
    if not bad:
        return None
    largest = max(abs(w) for _, w in bad)
    name, worst = next(b for b in bad if abs(b[1]) >= largest * (1 - 1e-9))  # of equal ones the first point's
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
            f"a step of {wrong.step:.3g} s is stable"
            if wrong.step
            else "no step within the range of solver.step is stable"
        )
        raise SolverStepError(
            f"{component.name}: solver {component.solver} with step {component.solver_step:g} s is unstable at "
            f"operating point {wrong.point!r} (eigenvalue {wrong.eigenvalue:.4g} 1/s); {advice}"
        )


def matrices_by_point(component: Model, parameters: np.ndarray | None = None) -> dict[str, np.ndarray]:
    """System matrix A of the linearized component at each declared operating point.

    `parameters`: the vector of their values, the start values by default.
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
    """Eigenvalues [1/s] that the solver cannot follow with this step.

    Solver semi_implicit: the fastest one stands for all.
    """
    if not matrix.size:
        return np.zeros(0)
    eigenvalues, solver = np.linalg.eigvals(matrix), component.solver
    if solver == "semi_implicit":
        radius = np.abs(np.linalg.eigvals(step_matrix(matrix, component.velocity_of, step))).max()
        stable = radius <= np.exp(max(0.0, eigenvalues.real.max()) * step) + 1e-6
        return np.zeros(0) if stable else eigenvalues[[np.argmax(np.abs(eigenvalues))]]
    # ros2 grows a little faster than the truth where the truth grows; its pole at step * eigenvalue = 3.4 must stay
    # far.
    slack = 1.1 if solver == "ros2" else 1.0
    growth = np.exp(slack * np.maximum(eigenvalues.real, 0.0) * step)
    return eigenvalues[amplification(solver, step * eigenvalues) > growth + 1e-6]
