"""Declarations that cannot become an FMU are refused with a message that says where and what."""

from __future__ import annotations

import math
import re
from collections.abc import Callable

import casadi as ca
import numpy as np
import pytest

from build_fmus.component import Component, DeclarationError
from build_fmus.generate import generate_c
from build_fmus.reference import Evaluator
from build_fmus.stability import SolverStepError, check_solver


def mass(**options: object) -> Component:
    """A component to spoil."""
    return Component("Mass", kind="continuous", description="a mass", source="Newton", **options)  # type: ignore[arg-type]


def sampled() -> Component:
    return Component("Filter", kind="discrete", sample_time=0.01, description="a filter", source="none")


def no_derivative() -> None:
    c = mass()
    c.state("x", "m")
    _ = c.model().functions


def no_update() -> None:
    c = sampled()
    c.state("held", "m")
    _ = c.model().functions


def undeclared_symbol() -> None:
    c = mass()
    c.derivative(c.state("x", "m"), ca.SX.sym("stranger"))
    _ = c.model().functions


def twice() -> None:
    c = mass()
    x = c.state("x", "m")
    c.derivative(x, 0)
    c.derivative(x, 1)


CASES: dict[str, Callable[[], object]] = {
    "unknown unit": lambda: mass().input("f", "Nm", "torque"),
    "unknown display unit": lambda: mass().input("f", "N", "force", display_unit="lbf"),
    "duplicate name": lambda: [c := mass(), c.state("x", "m"), c.state("x", "m")],
    "name of the standard": lambda: mass().input("time", "s", "time"),
    "illegal name": lambda: mass().input("2x", "m", "x"),
    "not ascii": lambda: mass().input("höhe", "m", "height"),
    "index in the name": lambda: mass().input("x[1]", "m", "x"),
    "missing derivative": no_derivative,
    "missing update": no_update,
    "derivative twice": twice,
    "derivative of no state": lambda: mass().derivative(ca.SX.sym("x"), 0),
    "derivative of a discrete one": lambda: [c := sampled(), c.derivative(c.state("x", "m"), 0)],
    "update of a continuous one": lambda: [c := mass(), c.update(c.state("x", "m"), 0)],
    "start below min": lambda: mass().parameter("m", -1.0, "kg", "mass", min=0.0, source="none"),
    "start above max": lambda: mass().input("f", "N", "force", start=2.0, max=1.0),
    "start not finite": lambda: mass().parameter("m", math.nan, "kg", "mass", source="none"),
    "start infinite": lambda: mass().parameter("m", math.inf, "kg", "mass", source="none"),
    "calculated start of another size": lambda: [c := mass(), c.state("x", "m", start=ca.SX.sym("s", 2), shape=(3,))],
    "derivative of another size": lambda: [c := mass(), c.derivative(c.state("x", "m", shape=(3,)), ca.SX.sym("s", 2))],
    "transposed matrix": lambda: [c := sampled(), c.update(c.state("x", "m", shape=(2, 3)), ca.SX.sym("s", 3, 2))],
    "three dimensions": lambda: mass().parameter("a", np.zeros((2, 2, 2)), "1", "a", source="none"),
    "empty vector": lambda: mass().input("u", "1", "u", shape=(0,)),
    "undeclared symbol": undeclared_symbol,
    "sample time of a continuous one": lambda: mass(sample_time=0.01),
    "component name": lambda: Component("9 lives", kind="continuous", description="", source="none"),
    "component without a source": lambda: Component("Mass", kind="continuous", description="a mass", source=" "),
    "constant without a source": lambda: mass().constant("g", 9.81, "m/s2", "gravity", source=""),
    "constant that is not finite": lambda: mass().constant("g", math.inf, "m/s2", "gravity", source="none"),
    "initial_value of a continuous one": lambda: mass().initial_value("x0", 1.0, "m"),
    "operating point of no state": lambda: mass().operating_point("far", {"x": 1.0}),
    "no source": lambda: mass().parameter("m", 1.0, "kg", "mass"),
    "blank source": lambda: mass().parameter("m", 1.0, "kg", "mass", source=" \n"),
    "source without an end": lambda: mass().parameter("m", 1.0, "kg", "mass", source="x" * 4097),
    "source that is no text": lambda: mass().parameter("m", 1.0, "kg", "mass", source="Table\x07 2"),
    "value with a dot": lambda: mass().value("strut.force", 0),
    "two values of a name": lambda: [c := mass(), c.value("f", 0), c.value("f", 1)],
    "reference input of no input": lambda: mass().reference_input({"f": math.sin}),
}


@pytest.mark.parametrize("case", CASES)
def test_refusals(case: str, raises) -> None:
    with raises(DeclarationError):
        CASES[case]()


def test_intermediate_values_are_functions_of_what_was_declared() -> None:
    c = mass()
    f, x = c.input("f", "N", "force"), c.state("x", "m", "position")
    pull = c.value("pull", f - 2 * x, source="Hooke")
    c.derivative(x, pull, source="Newton")
    c.output("twice", 2 * pull, "N", "twice the pull", source="arithmetic")
    assert c.model().value_sources == {"pull": "Hooke"}
    assert c.equations == {"x": "Newton", "twice": "arithmetic"}
    assert float(c.model().functions["values"](0.0, 3.0, 10.0, c.model().vector("parameter"))) == 4.0


def test_unknown_variables_come_with_the_nearest_name(raises) -> None:
    c = mass()
    c.input("force", "N", "force")
    with raises(KeyError):
        c.variable("forse")


@pytest.mark.parametrize("solver", ["rk4", "am2"])
def test_an_unstable_solver_step_is_refused_with_one_that_works(solver: str) -> None:
    def stiff(step: float) -> Component:
        c = mass(solver=solver, solver_step=step)
        x = c.state("x", "m")
        c.derivative(x, -5000 * x)
        return c

    with pytest.raises(SolverStepError, match=r"'start' \(eigenvalue -5000") as error:
        check_solver(stiff(1e-3).model())
    advised = float(re.search(r"a step of ([\d.e-]+) s", str(error.value))[1])  # type: ignore[index]
    check_solver(stiff(advised).model())
    run = Evaluator(stiff(advised).model())
    run.x = np.ones(1)
    run.step(200 * advised)
    assert abs(run.x[0]) < 1


def test_an_unstable_point_other_than_the_start_is_found() -> None:
    c = mass(solver_step=1e-3)
    x, v = c.state("x", "m"), c.state("v", "m/s")
    c.derivative(x, v)
    c.derivative(v, ca.if_else(x < 0, -1e8 * x, 0) - v)  # contact
    c.operating_point("contact", {"x": -0.01})
    with pytest.raises(SolverStepError, match="'contact'"):
        check_solver(c.model())


LATE: dict[str, Callable[[Component], object]] = {
    "a variable": lambda c: c.parameter("late", 1.0, "1", "late", source="none"),
    "an output": lambda c: c.output("late", c.time, "s", "late"),
    "a check": lambda c: c.check(1.0, "late"),
    "a reference input": lambda c: c.reference_input({"f": math.sin}),
    "an operating point": lambda c: c.operating_point("late", {}),
    "a solver": lambda c: c.choose_backend("osqp"),
    "an attribute": lambda c: setattr(c, "description", "late"),
}


@pytest.mark.parametrize("what", LATE)
def test_nothing_is_declared_once_the_model_is_made(what: str, raises) -> None:
    """What was read from the model stays true: there is one, and what comes later is refused, not lost."""
    c = mass()
    c.output("y", c.input("f", "N", "force"), "N", "force")
    model = c.model()
    assert model.dependencies == {"y": ["f"]}
    with raises(DeclarationError):
        LATE[what](c)
    assert c.model() is model
    assert c.linearize().D == 1.0


def test_a_model_does_not_change() -> None:
    c = mass()
    c.provenance = {"gain": 1.0}
    model = c.model()
    with pytest.raises(AttributeError):
        model.name = "Other"  # type: ignore[misc]
    with pytest.raises(TypeError):
        model.provenance["gain"] = 2.0  # type: ignore[index]


def falling(gravity: Callable[[Component], object], symbols: object) -> Component:
    """A mass that falls from below a ceiling that the input lowers; gravity is in everything, units set aside."""
    c = mass(symbols=symbols)
    g, lowered = gravity(c), c.input("lowered", "m", "how far the ceiling is lowered", min=0.0, max=2.0)
    x, v = c.state("x", "m", start=g - lowered), c.state("v", "m/s")
    c.derivative(x, v)
    c.derivative(v, -g)
    c.output("weight", 2.0 * g, "N", "weight of 2 kg")
    c.output("below", 4.0 * g - lowered - x, "m", "distance to the ceiling")
    c.check(g - lowered, "the ceiling is too low")
    return c


@pytest.mark.parametrize("symbols", [ca.SX, ca.MX])
def test_a_constant_is_a_number_in_the_code(symbols: object) -> None:
    """No variable, no symbol in any function: the same C as with the bare number."""
    declared = falling(lambda c: c.constant("g", 9.81, "m/s2", "gravity", source="none"), symbols).model()
    bare = falling(lambda c: 9.81, symbols).model()
    assert [e.name for e in declared.elements()] == [e.name for e in bare.elements()]
    assert declared.constant_outputs == {"weight": 19.62}
    assert generate_c(declared, arrays=False, token="") == generate_c(bare, arrays=False, token="")


def test_a_latched_value_stays() -> None:
    c = sampled()
    y = c.input("y", "m", "heights", shape=(3,))
    c.output("moved", y - c.initial_value("y0", y, "m", "heights at the start"), "m", "since the start")
    run = Evaluator(c.model())
    run.u[:] = 1.0, 2.0, 3.0
    for _ in range(3):
        np.testing.assert_array_equal(run.outputs(), 0.0 if run.time == 0 else [4.0, 3.0, 2.0])
        run.step(0.01)
        run.u[:] = 5.0
        run.step(0.01)


def test_elements_are_row_major_everywhere() -> None:
    """A matrix state keeps its orientation through start, update and output."""
    c = sampled()
    k = c.parameter("k", [[1.0, 2.0, 3.0], [4.0, 5.0, 6.0]], "1", "k", source="none")
    m = c.state("m", "1", start=2 * k, shape=(2, 3))
    n = c.state("n", "1", start=[[1, 2, 3], [4, 5, 6]], shape=(2, 3))
    c.update(m, m + k)
    c.update(n, n * 10)
    c.output("sum", m + n, "1", "sum")
    assert c.variable("sum").element_names()[:4] == ["sum[1,1]", "sum[1,2]", "sum[1,3]", "sum[2,1]"]
    run, matrix = Evaluator(c.model()), np.arange(1.0, 7.0)
    np.testing.assert_array_equal(run.outputs(), 3 * matrix)
    run.step(0.02)  # two samples; the outputs are those of the second
    np.testing.assert_array_equal(run.outputs(), 3 * matrix + 10 * matrix)
    np.testing.assert_array_equal(run.x, np.concatenate([4 * matrix, 100 * matrix]))


def test_vectors_have_the_values_that_are_given_by_name(raises) -> None:
    component = mass().model()
    names = [e.name for e in component.elements("parameter")]
    changed = component.vector("parameter", {names[-1]: 7.5})
    assert changed[-1] == 7.5
    assert (changed[:-1] == component.vector("parameter")[:-1]).all()
    with raises(KeyError, match=f"(?s)'{names[-1]}x'.*'{names[-1]}'"):
        component.vector("parameter", {f"{names[-1]}x": 7.5})
