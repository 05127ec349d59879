"""Directional derivatives against differences of the very functions they are derivatives of."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import casadi as ca
import numpy as np
import pytest
from api import ERROR, OK, Instance, Library, Refused
from applies import applies_to, continuous, discrete
from built import OBJECTS

from build_fmus.compile import resolve_platforms
from build_fmus.component import Component
from build_fmus.package import build_fmu

TOLERANCE = 1e-6  # of the largest element of a column
STEPS = (10.0, 1.0, 0.1, 1e-2, 1e-3, 1e-4, 1e-5)  # relative difference steps; the most consistent one is used


def reals(fmu: Library, names: list[str]) -> list[str]:
    """Those of the names that are Real."""
    return [n for n in names if fmu.variables[n].kind == "real"]


def difference(f: Callable[[float], np.ndarray], at: float, size: float) -> tuple[np.ndarray, float]:
    """Derivative of `f` at `at` by extrapolated central differences, and the step that it is from.

    Of several difference steps the one counts for which a step and half of it agree best: large ones suffer from
    curvature, kinks and limits, small ones from rounding.
    """
    best, disagreement, step = np.zeros(0), np.inf, size
    for relative in STEPS:
        h = relative * size
        try:
            coarse, fine = ((f(at + d) - f(at - d)) / (2 * d) for d in (h, h / 2))
        except Refused:  # outside the range of the variable
            continue
        gap = np.abs(coarse - fine).max(initial=0.0)
        if gap < disagreement:
            best, disagreement, step = (4 * fine - coarse) / 3, gap, h
    return best, step


def noise(f: Callable[[float], np.ndarray], at: float, size: float) -> np.ndarray:
    """Rounding noise of each value of `f` near `at`, whatever large numbers it subtracts inside.

    Over so short a distance a smooth function is a line, so its sixth differences are noise; a white one of deviation s
    has some of variance 924 s2. Source: J. J. More, S. M. Wild, Estimating computational noise, SIAM J. Sci. Comput. 33
    (2011).
    """
    values = np.array([f(at + 1e-9 * k * size) for k in range(-6, 7)])
    return np.sqrt((np.diff(values, 6, axis=0) ** 2).mean(axis=0) / 924) + np.finfo(float).eps * np.abs(values).max(
        axis=0
    )


def check(a: Instance, unknowns: list[str], known: str, f: Callable[[float], np.ndarray], at: float) -> None:
    """One column, given `f`: value of the known -> values of the unknowns."""
    v = a.library.variables[known]
    size = max(abs(at), v.nominal or 1e-2)
    expected, step = difference(f, at, size)
    rounding = 8 * noise(f, at, size) / step  # four deviations of the extrapolated difference
    f(at)
    column = a.column(unknowns, known)
    error = np.abs(column - expected)
    scale = max(np.abs(expected).max(initial=0.0), np.abs(column).max(initial=0.0))
    excess = error - (TOLERANCE * scale + rounding + 1e-12)
    worst = int(excess.argmax()) if len(excess) else 0
    assert excess.max(initial=0.0) <= 0.0, (
        f"d {unknowns[worst]} / d {known}: {error[worst]:g} of {scale:g}, rounding {rounding[worst]:g}"
    )


def start_point(fmu: Library) -> dict[str, float]:
    """Inputs and start values off symmetric points, where kinks are."""
    values = {
        n: v + 1e-3 * (k + 1) for k, (n, v) in enumerate(fmu.stimulus.row(3).items()) if fmu.variables[n].kind == "real"
    }
    exact = [n for n in reals(fmu, fmu.states) if fmu.variables[n].initial == "exact"]
    for k, n in enumerate(exact):
        v = fmu.variables[n]
        size = max(1.0, v.nominal or 1.0)  # so that the shift is seen in every derivative
        values[n] = (v.start_value or 0.0) + 1e-3 * (k + 1) * size
    return values


@applies_to(continuous)
def test_initialization_mode(fmu: Library) -> None:
    """With respect to inputs, parameters and start values: calculated starts are differentiated through."""
    structure = fmu.structure("InitialUnknown")
    unknowns = reals(fmu, list(structure))
    with fmu.instance() as a:
        a.enter_initialization()
        a.set(start_point(fmu))
        knowns = sorted({d for n in unknowns for d in structure[n] if d != "time" and fmu.variables[d].kind == "real"})
        for known in knowns:
            at = float(a.get([known])[0])
            v = fmu.variables[known]
            margin = 1.1e-2 * max(abs(at), v.nominal or 1e-2)
            if v.low is not None:
                at = max(at, v.low + margin)
            if v.high is not None:
                at = min(at, v.high - margin)

            def f(value: float, known: str = known) -> np.ndarray:
                a.set({known: value})
                return a.get(unknowns)

            original = float(a.get([known])[0])
            check(a, unknowns, known, f, at)
            a.set({known: original})


@applies_to(continuous)
def test_step_mode_and_continuous_time_mode(fmu: Library) -> None:
    """With respect to inputs (Co-Simulation) and to inputs and states (Model Exchange)."""
    outputs = reals(fmu, fmu.outputs)
    inputs = reals(fmu, fmu.inputs)
    with fmu.instance() as a, fmu.instance("me") as b:
        a.initialize(fmu.stimulus.row(0))
        a.run(11)
        point = {n: v for n, v in start_point(fmu).items() if n in inputs}
        a.set(point)
        for known in inputs:

            def held(value: float, known: str = known) -> np.ndarray:
                a.set({known: value})
                return a.get(outputs)

            check(a, outputs, known, held, float(a.get([known])[0]))
            a.set({known: point[known]})
        x = a.get(fmu.states)
        b.initialize(fmu.stimulus.row(0)).continuous_time()
        b.set(point)
        b.must("SetTime", a.time)
        b.set_states(x)
        unknowns = fmu.derivatives + outputs
        for known in inputs:

            def moved(value: float, known: str = known) -> np.ndarray:
                b.set({known: value})
                return np.concatenate([b.get_derivatives(), b.get(outputs)])

            check(b, unknowns, known, moved, float(b.get([known])[0]))
            b.set({known: point[known]})
        for i, known in enumerate(fmu.states):

            def shifted(value: float, i: int = i) -> np.ndarray:
                b.set_states([*x[:i], value, *x[i + 1 :]])
                return np.concatenate([b.get_derivatives(), b.get(outputs)])

            check(b, unknowns, known, shifted, float(x[i]))
            b.set_states(x)


@applies_to(continuous)
def test_several_knowns_at_once(fmu: Library) -> None:
    """The derivative is linear in its seed, and unknowns come back in the order they were asked for."""
    outputs, knowns = reals(fmu, fmu.outputs)[::-1], [*fmu.states, *reals(fmu, fmu.inputs)]
    seed = np.cos(np.arange(len(knowns)) + 1.0)
    with fmu.instance() as a:
        a.initialize(fmu.stimulus.row(0))
        a.run(5)
        status, together = a.try_directional(outputs, knowns, seed)
        assert status == OK
        one_by_one = sum(s * a.column(outputs, k) for s, k in zip(seed, knowns, strict=True))
        np.testing.assert_allclose(together, one_by_one, rtol=1e-9, atol=1e-9 * np.abs(one_by_one).max())


@applies_to(continuous)
def test_the_adjoint_is_the_transpose(pair: tuple[Library, Library]) -> None:
    """FMI 2.0 has none."""
    fmu = pair[1]
    v = fmu.variables
    unknowns = [*reals(fmu, fmu.outputs), *fmu.derivatives]
    parameters = fmu.names("parameter", "real")[:8]
    knowns = [*reals(fmu, fmu.inputs), *fmu.states, *parameters]
    weights = np.sin(np.arange(len(unknowns)) + 1.0)
    with fmu.instance() as a:
        a.initialize(fmu.stimulus.row(0))
        a.run(5)
        found = a.directional([v[n] for n in unknowns], [v[n] for n in knowns], weights, adjoint=True)
        exact = [a.column(unknowns, k) @ weights for k in knowns]
        np.testing.assert_allclose(found, exact, rtol=1e-12)
        for known in [k for k in knowns if np.abs(a.column(unknowns, k)).max() > 2.0][:1]:  # the sum overflows
            with pytest.raises(Refused):
                a.directional([v[n] for n in unknowns], [v[known]], [1e308] * len(unknowns), adjoint=True)
            assert known in a.last_message


@applies_to(discrete)
def test_sampled_components_have_none(fmu: Library) -> None:
    with fmu.instance() as a:
        a.enter_initialization()
        assert a.try_directional([], [], [])[0] == ERROR
        a.reset()
        a.initialize(fmu.stimulus.row(0))
        assert a.try_directional(fmu.outputs[:1], fmu.outputs[:1], [1.0])[0] == ERROR
        assert "discrete" in a.last_message


@applies_to(continuous)
def test_wrong_requests(fmu: Library) -> None:
    with fmu.instance() as a:
        a.initialize(fmu.stimulus.row(0))
        output = reals(fmu, fmu.outputs)[-1]
        for unknown, known, seed in (
            (output, output, 1.0),
            ("time", fmu.states[0], 1.0),
            (output, fmu.states[0], np.nan),
        ):
            assert a.try_directional([unknown], [known], [seed])[0] == ERROR
            assert unknown in a.last_message or known in a.last_message


@pytest.mark.parametrize("fmi", [2, 3])
def test_derivatives_and_starts_that_are_not_finite(fmi: int, tmp_path: Path, raises) -> None:
    """A root has no derivative at 0, and 1/0 is no start.

    Each time an error that names the variable, never a number.
    """
    c = Component("Root", kind="continuous", description="root of a level", source="none")
    level = c.input("level", "m", "level", start=1.0)
    x = c.state("x", None, "lagged", start=1 / level, output=True)
    c.derivative(x, -x)
    c.output("flow", ca.sqrt(level), None, "root of the level")
    c.output("level.seen", 2 * level, "m", "twice the level")
    c.output("bounded", ca.tanh(x), "1", "finite, whatever x is")
    path = tmp_path / "Root.fmu"
    path.write_bytes(build_fmu(c, fmi, resolve_platforms("host"), OBJECTS))
    fmu = Library(path)
    with fmu.instance() as a:
        a.initialize()
        a.set({"level": 0.0})
        assert a.column(["level.seen"], "level") == [2.0]
        for unknowns in (["flow"], ["level.seen", "flow"]):
            status, data = a.try_directional(unknowns, ["level"], [1.0])
            assert status == ERROR
            assert "flow is not finite" in a.last_message
            assert not data.any(), "nothing is written"
        a.reset()
        a.enter_initialization()
        a.set({"level": 0.0})
        for _ in range(2):
            for function in (a.get, lambda names: a.column(names, "level")):
                with raises(Refused):
                    function(["bounded"])
        a.set({"level": 2.0})
        assert a.get(["x"]) == [0.5]
