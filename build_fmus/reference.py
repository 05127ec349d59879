"""Python reference evaluation of a component, with the semantics of its FMU's `doStep`.

It evaluates the same declaration with CasADi's virtual machine and integrates in numpy: an independent path to the
numbers that the compiled FMU must reproduce.
"""

from __future__ import annotations

import csv
import io
import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from build_fmus import solvers
from build_fmus.component import Model
from build_fmus.qp_solve import CompiledPrograms


@dataclass(frozen=True)
class ReferenceResult:
    """Sampled signals: `time` (n,), `inputs` (n, inputs), `outputs` (n, outputs) with element names."""

    time: np.ndarray
    inputs: np.ndarray
    outputs: np.ndarray
    input_names: list[str]
    output_names: list[str]

    def input_csv(self) -> str:
        """`NAME_in.csv` of the FMI cross-check."""
        return _csv(self.time, self.inputs, self.input_names)

    def output_csv(self) -> str:
        """`NAME_ref.csv` of the FMI cross-check."""
        return _csv(self.time, self.outputs, self.output_names)


def _csv(time: np.ndarray, values: np.ndarray, names: list[str]) -> str:
    out = io.StringIO()
    writer = csv.writer(out, lineterminator="\n")
    writer.writerow(["time", *names])
    for t, row in zip(time, values, strict=True):
        writer.writerow([f"{t:.9g}", *(f"{x:.12g}" for x in row)])
    return out.getvalue()


class _Called:
    """A CasADi function with arrays of its own for its dense arguments and results.

    Same numbers as a call with arrays, in a thirtieth of the time where the function is small.
    """

    def __init__(self, function: Any) -> None:
        self._buffer, self._evaluate = function.buffer()
        self._name = function.name()
        self._arguments: list[Any] = [np.zeros(function.numel_in(i)) for i in range(function.n_in())]
        self._results: list[Any] = [np.zeros(function.numel_out(i)) for i in range(function.n_out())]
        self._shapes = [function.size_out(i) for i in range(function.n_out())]
        for i, argument in enumerate(self._arguments):
            assert function.sparsity_in(i).is_dense(), f"{self._name}: argument {i} is not dense"
            self._buffer.set_arg(i, memoryview(argument))
        for i, result in enumerate(self._results):
            assert function.sparsity_out(i).is_dense(), f"{self._name}: result {i} is not dense"
            self._buffer.set_res(i, memoryview(result))

    def __call__(self, *arguments: Any) -> list[np.ndarray]:
        """The results: columns as vectors, others as matrices."""
        for own, given in zip(self._arguments, arguments, strict=True):
            own[:] = given
        self._evaluate()
        if self._buffer.ret():
            raise ArithmeticError(f"{self._name} cannot be evaluated")
        return [
            result.copy() if columns == 1 else result.reshape((rows, columns), order="F").copy()
            for result, (rows, columns) in zip(self._results, self._shapes, strict=True)
        ]


class Evaluator:
    """One instance of a component in Python: set `u` and `p`, then `step`."""

    def __init__(self, component: Model, parameters: Mapping[str, float] | None = None) -> None:
        self.component = component
        self.p = component.vector("parameter", parameters)
        self.u = component.vector("input")
        self._called: dict[str, _Called] = {}
        shown = ((component.size("state") * (e.variable.role != "state") + e.slot) for e in component.output_elements())
        self._shown = np.array(list(shown), dtype=int)  # among states and outputs
        self.time, self._sample, self._y = 0.0, 0, np.zeros(component.size("output"))
        self._x: np.ndarray | None = None
        self._programs = CompiledPrograms(component) if component.programs else None
        self._profiles: tuple[bytes, list[np.ndarray]] = (b"", [])

    def _call(self, name: str, *arguments: Any) -> list[np.ndarray]:
        if name not in self._called:
            self._called[name] = _Called(self.component.functions[name])
        return self._called[name](*arguments)

    def _solutions(self, t: float, x: np.ndarray, *, commit: bool) -> list[np.ndarray]:
        """Solutions of the quadratic programs, and random profiles, as further arguments of `out` and `tick`."""
        if self._programs is None:
            return self.random_profiles()
        (data,) = self._call("programs", t, x, self.u, self.p)
        return [self._programs.solve(data, commit=commit), *self.random_profiles()]

    def random_profiles(self) -> list[np.ndarray]:
        """Random profiles of the parameters as they are, in a list of one; empty for components without."""
        if self.component.profiles and self._profiles[0] != self.p.tobytes():
            x, (q,) = self.component.vector("state"), self.component.profiles
            (settings,) = self._call("profile_settings", 0.0, x, self.u, self.p)

            def spectra(k: np.ndarray) -> np.ndarray:
                return np.array([self._call("spectra", n, x, self.u, self.p)[0] for n in k]).T

            self._profiles = self.p.tobytes(), [q.evaluate(settings, spectra)]
        return self._profiles[1]

    @property
    def x(self) -> np.ndarray:
        """State; until the first step it follows inputs and parameters (calculated starts)."""
        if self._x is None:
            return self._call("start", self.component.vector("state"), self.u, self.p)[0]
        return self._x

    @x.setter
    def x(self, value: np.ndarray) -> None:
        self._x = np.array(value, dtype=float)

    def rhs(self, t: float, x: np.ndarray) -> np.ndarray:
        """State derivative (continuous components)."""
        return self._call("rhs", t, x, self.u, self.p)[0]

    def outputs(self) -> np.ndarray:
        """All output elements in order (states declared as outputs, then declared outputs)."""
        if self.component.kind == "continuous" or self._x is None:
            x = self.x
            solutions = self._solutions(self.time, x, commit=False)
            (y,) = self._call("out", self.time, x, self.u, self.p, *solutions)
        else:
            y = self._y
        return np.concatenate([self.x, y])[self._shown]

    def step(self, h: float) -> None:
        """Advance by `h` [s] with the inputs held."""
        c = self.component
        if self._x is None and (failed := c.failed_checks(self.u, self.p)):
            raise ValueError(f"{c.name}: {failed[0]}")
        x = self.x
        if c.kind == "discrete":
            assert c.sample_time is not None
            while (instant := self._sample * c.sample_time) < self.time + h - 1e-6 * c.sample_time:
                solutions = self._solutions(instant, x, commit=True)
                x, self._y = self._call("tick", instant, x, self.u, self.p, *solutions)
                self._sample += 1
        else:
            n = max(1, math.ceil(h / self.p[0] * (1 - 1e-9)))
            dt = h / n
            before: np.ndarray | None = None
            for i in range(n):
                t = self.time + i * dt
                if c.solver == "rk4":
                    x = solvers.rk4(self.rhs, t, x, dt)
                elif c.solver == "semi_implicit":
                    x = solvers.semi_implicit(self.rhs, t, x, dt, c.velocity_of)
                elif c.solver == "ros2":
                    x = self._ros2(t, x, dt)
                else:
                    x, before = solvers.am2(self.rhs, t, x, dt, before)
        self._x = x
        self.time += h

    def _ros2(self, t: float, x: np.ndarray, h: float) -> np.ndarray:
        c = self.component
        nominal = np.array([v.nominal or 1.0 for v in c.all_variables if v.role == "state" for _ in range(v.size)])

        def jacobian(t: float, x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
            by_state, by_time = self._call("jac", t, x, self.u, self.p)
            return by_state, by_time

        try:
            return solvers.ros2(self.rhs, jacobian, t, x, h, nominal)
        except np.linalg.LinAlgError:
            raise ArithmeticError(f"{c.name}: the matrix of solver ros2 is singular at time {t:.9g} s") from None


def sampled_inputs(
    component: Model, h: float, n: int, signals: Mapping[str, Callable[[float], float]] | None = None
) -> np.ndarray:
    """Inputs (n, inputs) at the times 0, h, ... [s]: `signals` (the reference inputs by default), else start values."""
    moving = component.reference_inputs if signals is None else signals
    base, elements = component.vector("input"), component.elements("input")
    rows = [[moving[e.name](k * h) if e.name in moving else base[e.slot] for e in elements] for k in range(n)]
    return np.array(rows, dtype=float).reshape(n, len(elements))


def simulate(
    component: Model,
    *,
    signals: Mapping[str, Callable[[float], float]] | None = None,
    parameters: Mapping[str, float] | None = None,
    step: float | None = None,
    steps: int = 200,
) -> ReferenceResult:
    """Run a component alone, driven by `signals` (its reference inputs by default) sampled at each step and held.

    Row k holds the inputs that act from t_k on and the outputs at t_k, read before those inputs are set (row 0: after
    initialization with the first inputs), which is what a tool sees that sets inputs, steps, and reads.
    """
    h = step or component.sample_time or component.exchange_step
    names = [e.name for e in component.elements("input")]
    slots = [e.slot for e in component.elements("input")]
    run = Evaluator(component, parameters)
    inputs, outputs = (
        sampled_inputs(component, h, steps + 1, signals),
        np.zeros((steps + 1, len(component.output_elements()))),
    )

    for k in range(steps + 1):
        t = k * h
        if k:
            outputs[k] = run.outputs()
        run.u[slots] = inputs[k]
        if k == 0:
            outputs[0] = run.outputs()
        if k < steps:
            run.time = t
            run.step(h)
    time = np.arange(steps + 1) * h
    return ReferenceResult(time, inputs, outputs, names, [e.name for e in component.output_elements()])
