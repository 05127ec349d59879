"""Inputs in the declaration: clipped to their limits in everything derived.

Constants of a source that are only compared.
"""

from __future__ import annotations

import math
from typing import Any

import casadi as ca
import numpy as np
import pytest

from build_fmus.component import Component, DeclarationError
from build_fmus.description_xml import model_description, variable_rows
from build_fmus.reference import Evaluator

BEYOND, LIMIT, INSIDE = [-5.0, 7.0], [-1.0, 2.0], [-0.5, 1.5]


def pushed(symbols: Any = ca.SX, solver: str = "rk4") -> Component:
    """A mass with two forces within [-1, 2] N, whose start follows them."""
    c = Component(
        "Mass",
        kind="continuous",
        description="a mass",
        source="Newton",
        symbols=symbols,
        solver=solver,  # type: ignore[arg-type]
    )
    force = c.input("force", "N", "forces", shape=(2,), min=-1.0, max=2.0)
    x = c.state("x", "m", "position", start=0.1 * force[0], output=True)
    v = c.state("v", "m/s", "velocity", output=True)
    c.derivative(x, v)
    c.derivative(v, force[0] + 10 * force[1] ** 3 - x)
    c.output("power", force[0] * v + force[1], "W", "power")
    return c


def values(f: ca.Function, *arguments: Any) -> np.ndarray:
    """All outputs of a function in one vector."""
    return np.concatenate([np.ravel(ca.DM(y).full()) for y in f.call([ca.DM(a) for a in arguments])])


@pytest.mark.parametrize("symbols", [ca.SX, ca.MX])
def test_real_inputs_are_clipped_in_everything_derived(symbols: Any) -> None:
    f = pushed(symbols).model().functions
    x, p = [0.3, -0.2], [5e-4]
    for name in ("rhs", "out"):
        np.testing.assert_array_equal(values(f[name], 0.0, x, BEYOND, p), values(f[name], 0.0, x, LIMIT, p))
        assert not np.array_equal(values(f[name], 0.0, x, LIMIT, p), values(f[name], 0.0, x, INSIDE, p))
    np.testing.assert_array_equal(values(f["start"], x, BEYOND, p), values(f["start"], x, LIMIT, p))
    for du in ([1.0, 0.0], [0.0, 1.0]):
        seeds = [0.0, 0.0], du, [0.0]
        assert not values(f["fwd"], 0.0, x, BEYOND, p, *seeds).any()
        assert not values(f["fwd_start"], x, BEYOND, p, *seeds).any()
        assert values(f["fwd"], 0.0, x, LIMIT, p, *seeds).any(), (
            "at the limit itself the derivative is that of the inside"
        )


@pytest.mark.parametrize("symbols", [ca.SX, ca.MX])
def test_linear_models_beyond_a_limit(symbols: Any) -> None:
    c = pushed(symbols)
    at, beyond = (c.linearize(u=np.array(u)) for u in (LIMIT, BEYOND))
    np.testing.assert_array_equal(beyond.A, at.A)
    assert not beyond.B.any()
    assert not beyond.D.any()
    np.testing.assert_allclose(at.B, [[0.0, 0.0], [1.0, 120.0]])


@pytest.mark.parametrize("solver", ["rk4", "am2", "ros2", "semi_implicit"])
def test_the_python_evaluation_clips(solver: str) -> None:
    runs = [Evaluator(pushed(solver=solver).model()) for _ in range(2)]
    for run, u in zip(runs, (LIMIT, BEYOND), strict=True):
        run.u[:] = u
        for _ in range(5):
            run.step(1e-3)
    np.testing.assert_array_equal(runs[0].outputs(), runs[1].outputs())


def test_one_limit_and_no_limit() -> None:
    c = Component("Mass", kind="continuous", description="a mass", source="Newton")
    low, high, free = (
        c.input(n, "N", "a force", **limits)
        for n, limits in (("low", {"min": 0.0}), ("high", {"max": 0.0}), ("free", {}))
    )
    c.output("sum", ca.vertcat(low, high, free), "N", "forces")
    for u, expected in (([-3.0] * 3, [0.0, -3.0, -3.0]), ([3.0] * 3, [3.0, 0.0, 3.0])):
        np.testing.assert_array_equal(values(c.model().functions["out"], 0.0, [], u, [5e-4]), expected)
    assert [v.name for v in c.model().clipped_inputs] == ["low", "high"]


def test_selectors_are_not_clipped() -> None:
    """An Integer outside its range is refused by the FMU, so that the equations need not know."""
    c = Component("Mass", kind="continuous", description="a mass", source="Newton")
    case = c.input("case", None, "selector", type=int, min=0, max=3)
    c.output("y", 1.0 * case, "1", "its value")
    assert values(c.model().functions["out"], 0.0, [], [7.0], [5e-4]) == [7.0]
    assert c.model().clipped_inputs == []


def reader() -> Component:
    c = Component("Reader", kind="discrete", sample_time=0.01, description="reads heights", source="none")
    c.constant_input("height.step", "s", "time between heights", must_equal=0.03)
    c.output("grid.step", 0.02, "s", "a constant")
    c.output("table", ca.SX([[1.0, 2.0], [3.0, 4.0]]), "s", "constants")
    c.output("clock", c.time, "s", "no constant")
    return c


def test_a_constant_input_has_no_limits_and_starts_unconnected() -> None:
    c = reader()
    v = c.model().variable("height.step")
    assert (v.name, v.must_equal, v.start, v.min, v.max) == ("height.step", 0.03, (0.0,), None, None)
    assert v.tolerance == pytest.approx(3e-8)
    assert c.reference_inputs["height.step"](0.0) == 0.03, "the reference result shows it connected"
    assert c.model().dependencies == {
        "grid.step": [],
        "clock": [],
        **{f"table[{i},{k}]": [] for i in (1, 2) for k in (1, 2)},
    }
    (row,) = (r for r in variable_rows(c.model()) if r["name"] == "height.step")
    assert row["range"] == "0.03, or 0"
    with pytest.raises(DeclarationError, match=r"Reader\.other: must_equal is nan"):
        reader().constant_input("other", "s", "other", must_equal=math.nan)


@pytest.mark.parametrize("fmi", [2, 3])
def test_the_annotation_tells_constants_of_inputs_and_outputs(fmi: int) -> None:
    text = model_description(reader().model(), fmi, token="t", sources=["model.c"]).decode()
    assert '<Input name="height.step" mustEqual="0.03" tolerance="' in text
    for line in ('<Output name="grid.step" constant="0.02"/>', '<Output name="table[2,1]" constant="3.0"/>'):
        assert line in text
    assert 'name="clock" constant' not in text
