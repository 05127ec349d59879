"""Refuse a component whose solver step is too long for its own dynamics."""

from __future__ import annotations

import numpy as np

from build_fmus.component import Component


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


def check_solver(component: Component) -> None:
    """Check every declared operating point.

    A mode fails when its numerical amplification over one step exceeds both 1 and the true growth by more than 1e-6.

    Raises:
        SolverStepError: naming the operating point, the eigenvalue and the longest stable step.
    """
    if component.kind != "continuous":
        return
    for name, eigenvalues in eigenvalues_by_point(component).items():
        bad = _unstable(component.solver, component.solver_step, eigenvalues)
        if bad.size:
            step = component.solver_step
            while _unstable(component.solver, step, eigenvalues).size and step > 1e-9:
                step /= 1.25
            worst = bad[np.argmax(np.abs(bad))]
            raise SolverStepError(
                f"{component.name}: solver {component.solver} with step {component.solver_step:g} s is unstable at "
                f"operating point {name!r} (eigenvalue {worst:.4g} 1/s); a step of {step:.3g} s would do"
            )


def eigenvalues_by_point(component: Component) -> dict[str, np.ndarray]:
    """Eigenvalues [1/s] of the linearized component at each declared operating point."""
    states = {e.name: e.slot for e in component.elements("state")}
    inputs = {e.name: e.slot for e in component.elements("input")}
    result = {}
    for name, values in component.operating_points.items():
        u, p = component.vector("input"), component.vector("parameter")
        for k, v in values.items():
            if k in inputs:
                u[inputs[k]] = v
            elif k not in states:
                raise KeyError(
                    f"{component.name}: operating point {name!r} sets {k!r}, which is neither state nor input"
                )
        x = np.asarray(component.functions["start"](component.vector("state"), u, p)).ravel()
        for k, v in values.items():
            if k in states:
                x[states[k]] = v
        result[name] = np.linalg.eigvals(component.linearize(x, u, p).A) if x.size else np.zeros(0)
    return result


def _unstable(solver: str, step: float, eigenvalues: np.ndarray) -> np.ndarray:
    # ros2 grows a little faster than the truth where the truth grows; its pole at step * eigenvalue = 3.4 must stay far.
    slack = 1.1 if solver == "ros2" else 1.0
    growth = np.exp(slack * np.maximum(eigenvalues.real, 0.0) * step)
    return eigenvalues[amplification(solver, step * eigenvalues) > growth + 1e-6]
