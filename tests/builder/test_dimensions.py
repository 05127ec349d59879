"""Expressions that do not have the dimension of their variable are refused; those of the catalog have it."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import casadi as ca
import numpy as np
import pytest
from built import FMUS

from build_fmus.compile import ObjectCache
from build_fmus.component import Component, DeclarationError, Model, Violation
from build_fmus.package import build_fmu
from fmu_sources.catalog import Context, default_catalog
from tests.oracles.dimensions import inconsistent

SYMBOLS = (ca.SX, ca.MX)


class Mass(NamedTuple):
    """A component with mass, force, position and velocity."""

    c: Component
    m: Any
    f: Any
    x: Any
    v: Any


def mass(symbols: Any = ca.SX) -> Mass:
    """A mass that a force pushes; its velocity has no derivative as yet."""
    c = Component("Mass", kind="continuous", description="a mass", source="Newton", symbols=symbols)
    m = c.parameter("mass", 2.0, "kg", "mass", min=0.1, source="none")
    f = c.input("force", "N", "force")
    x, v = c.state("x", "m", "position", output=True), c.state("v", "m/s", "velocity", output=True)
    c.derivative(x, v)
    return Mass(c, m, f, x, v)


def with_equation(equation: Callable[[Mass], None], symbols: Any = ca.SX) -> Model:
    """The mass with one more equation, Newton's unless that is what it is."""
    s = mass(symbols)
    equation(s)
    if "v" not in s.c._changes:
        s.c.derivative(s.v, s.f / s.m)
    return s.c.model()


def wrong(equation: Callable[[Mass], None], symbols: Any) -> list[tuple[str, str, int, float | None]]:
    """Violations of a mass with one more equation."""
    found = with_equation(equation, symbols).dimensions
    assert not found.unchecked
    assert not found.not_exercised
    return [(w.name, w.base, w.declared, w.found) for w in found.violations]


def wrong_unit(s: Mass) -> None:
    s.c.output("a", s.f / s.m, "m/s", "acceleration")


def dropped_mass(s: Mass) -> None:
    s.c.derivative(s.v, s.f)


def literal(s: Mass) -> None:
    s.c.derivative(s.v, s.f / s.m - 9.81)


def alone(s: Mass) -> None:
    s.c.derivative(s.v, -9.81)


def wrong_power(s: Mass) -> None:
    s.c.output("p", (s.m * s.v**2) ** 0.3, "J", "energy")


def wrong_root(s: Mass) -> None:
    s.c.output("w", ca.sqrt(s.f), "N", "force")


def bounded(s: Mass) -> None:
    s.c.output("b", ca.fmax(-1.5, ca.fmin(s.x, 1.5)), "m", "position within bounds")


def switched(s: Mass) -> None:
    s.c.output("b", ca.if_else(s.x > 0.5, s.x, -s.x), "m", "position, turned somewhere")


def unlike(s: Mass) -> None:
    s.c.output("b", ca.if_else(s.x > 0 * s.x, s.x, s.v), "m", "position or velocity")


def regularized(s: Mass) -> None:
    s.c.output("b", s.x / ca.sqrt(s.x**2 + 1e-12), "1", "smooth sign")


def of_a_length(s: Mass) -> None:
    s.c.output("b", ca.sin(s.x), "1", "sine of a length")


def started(s: Mass) -> None:
    s.c.derivative(s.c.state("y", "m", "position", start=s.f / s.m), s.v)


WRONG: dict[str, tuple[Callable[[Mass], None], list[tuple[str, str, int, float | None]]]] = {
    "wrong unit of an output": (wrong_unit, [("a", "s", -1, -2)]),
    "dropped mass": (dropped_mass, [("der(v)", "kg", 0, 1)]),
    "literal in a sum": (literal, [("der(v)", "m", 1, None), ("der(v)", "s", -2, None)]),
    "literal by itself": (alone, [("der(v)", "m", 1, 0), ("der(v)", "s", -2, 0)]),
    "pow": (wrong_power, [("p", "kg", 1, None), ("p", "m", 2, None), ("p", "s", -2, None)]),
    "sqrt": (wrong_root, [("w", "kg", 1, 0.5), ("w", "m", 1, 0.5), ("w", "s", -2, -1)]),
    "fmax and fmin": (bounded, [("b", "m", 1, None)]),
    "condition": (switched, [("b", "m", 1, None)]),
    "branches": (unlike, [("b", "s", 0, -1)]),
    "small literal": (regularized, [("b", "m", 0, None)]),
    "sine": (of_a_length, [("b", "m", 0, None)]),
    "start": (started, [("start of y", "s", 0, -2)]),
}


@pytest.mark.parametrize("symbols", SYMBOLS)
@pytest.mark.parametrize("case", WRONG)
def test_errors_are_found_with_the_power_that_there_is(case: str, symbols: Any) -> None:
    equation, expected = WRONG[case]
    assert wrong(equation, symbols) == expected


def declared_right(s: Mass) -> None:
    g = s.c.constant("g", 9.81, "m/s2", "gravity", source="none")
    least = s.c.constant("least", 1e-6, "m", "regularizes", source="none")
    angle = s.c.parameter("angle", 0.3, "rad", "angle", source="none")
    s.c.derivative(s.v, s.f / s.m - g)
    s.c.output("p", (s.m * s.v**2 / 2) ** 1.3 / ca.sqrt(s.m * s.v**2) ** 0.6, "J", "energy")
    s.c.output("b", ca.fmax(-least, ca.fmin(s.x, 3 * least)), "m", "position within bounds")
    s.c.output("c", ca.if_else(s.x > least, s.x, -least), "m", "position, turned somewhere")
    s.c.output("d", s.x / ca.sqrt(s.x**2 + least**2), "1", "smooth sign")
    s.c.output("e", s.x * ca.sin(angle) + s.x * angle + ca.atan2(s.x, least) * s.x, "m", "angles have no dimension")
    s.c.output("n", 0.01, "m", "a number has the unit of its output")


@pytest.mark.parametrize("symbols", SYMBOLS)
def test_what_is_declared_passes(symbols: Any) -> None:
    assert wrong(declared_right, symbols) == []


def test_pow_may_round_and_nothing_else_may() -> None:
    """1e-13 of a value is found where operations are exact."""

    def nearly(s: Mass) -> None:
        s.c.output("b", s.f + 1e-13 * s.f * s.m / 2.0, "N", "force, a little more")

    assert wrong(nearly, ca.SX) == [("b", "kg", 1, None)]


def test_degrees_are_no_unit_of_a_variable() -> None:
    """What is displayed in degrees is in radians, so no factor of 57 can hide in an equation."""
    c = mass().c
    with pytest.raises(DeclarationError, match="unknown unit 'deg'"):
        c.input("angle", "deg", "angle")


def sampled() -> Component:
    return Component("Filter", kind="discrete", sample_time=0.01, description="a filter", source="none")


def test_the_sample_time_is_a_constant_with_a_unit(raises) -> None:
    def integrated(period: Callable[[Component], Any]) -> Component:
        c = sampled()
        speed, x = c.input("speed", "m/s", "speed"), c.state("x", "m", "distance")
        c.update(x, x + period(c) * speed)
        return c

    assert not integrated(lambda c: c.period).check_dimensions().violations
    with pytest.raises(
        DeclarationError, match=r"Filter: dimensions: x: declared in m, which has s\^0, .*component\.period"
    ):
        integrated(lambda c: 0.01).check_dimensions()
    with raises(DeclarationError):
        _ = mass().c.period


@pytest.mark.parametrize("columns", [("m", "m/s"), ("m/s", "m")])
def test_units_by_row_and_column(columns: tuple[str, str]) -> None:
    c = sampled()
    x = ca.vertcat(c.input("x", "m", "position"), c.input("v", "m/s", "velocity"))
    gain = c.parameter("gain", [[1.0, 2.0], [3.0, 4.0]], None, "gain", rows=("N", "W"), columns=columns, source="none")
    step = c.constant("step", np.eye(2), None, "step", rows=("N", "W"), columns=("N", "W"), source="none")
    memory = c.state("memory", None, "memory", shape=(2,), rows=("N", "W"))
    c.update(memory, step @ memory + gain @ x)
    c.output("power", memory[1], "W", "power")
    found = c.model().dimensions
    assert not found.unchecked
    assert bool(found.violations) == (columns != ("m", "m/s"))
    if found.violations:
        assert found.violations[0] == Violation("memory[1]", "N", "s", -2, None)


def test_units_by_row_and_column_must_fit(raises) -> None:
    for unit, rows, columns in (("N", ["N"] * 2, []), (None, ["N"] * 3, []), (None, ["N"] * 2, ["m"])):
        with raises(DeclarationError):
            sampled().parameter("gain", [1.0, 2.0], unit, "gain", rows=rows, columns=columns, source="none")
    with pytest.raises(DeclarationError, match=r"Filter\.gain: unknown unit 'Nm'"):
        sampled().parameter("gain", [1.0, 2.0], None, "gain", rows=["Nm"] * 2, source="none")


def test_what_depends_on_a_value_without_unit_is_told_apart() -> None:
    c = sampled()
    x, y = c.input("x", "m", "position"), c.input("y", None, "anything")
    c.output("a", x + y, "m", "unknown")
    c.output("b", x + 1, "m", "known, and wrong")
    found = c.model().dimensions
    assert found.unchecked == ("a",)
    assert [v.name for v in found.violations] == ["b"]


def test_builds_refuse_by_name_unit_and_power(tmp_path: Path, raises) -> None:
    s = mass()
    dropped_mass(s)
    with raises(DeclarationError):
        build_fmu(s.c, 3, [], ObjectCache(tmp_path))


# -------------------------------------------------------------------------------------------------------------- catalog

UNCHECKED = {
    "MpcHmmwv": "quadratic program: its data and solution are in units of the scaling",
    "MpcThreeAxle": "quadratic program: its data and solution are in units of the scaling",
    "MpcBench": "quadratic program: its data and solution are in units of the scaling",
    "MpcHmmwvTunable": "quadratic program: its data and solution are in units of the scaling",
    "MpcBenchTunable": "quadratic program: its data and solution are in units of the scaling",
    "MpcBenchMoves": "quadratic program: its data and solution are in units of the scaling",
    "SemiActiveMpc": "quadratic program: its data and solution are in units of the scaling",
    "KalmanHmmwv": "covariance and gain are computed on measurements that are divided by their noise",
    "KalmanHmmwvPrinted": "its matrices are of the design, as numbers",
    "GpcImplicit": "published law in g, degrees and thousands of newtons",
    "GpcExplicit": "published law in g, degrees and thousands of newtons",
    "GpcPreview": "published law in g, degrees and thousands of newtons",
    "PreviewLqTunable": "the design of its law has the car's matrices in numbers",
    "RideComfort": "absorbed power: an empirical filter from ft/s2 to the root of a watt; dose in m/s1.75",
}
"""FMU -> why not everything in it is checked. What is checked altogether must not be here."""

UNSEEN = {
    "BenchEncoders": "the second element of a start is 0",
    "PreviewLqTunable": "nothing rises toward the first node of the road",
    "RoadBumps": "the points lie beside some bumps",
    "RoadHoleBump": "the points lie beside the bump in some previews",
    "RoadCurb": "the points lie beside the steps, 0.1 m long",
    "RoadHalfRoundHmmwvPublic": "the points lie beside the half-round",
    "RoadProvingGroundHmmwvPublic": "the middle height of a contact is 0: the others count from it",
    "ThreeAxleTrench": "the front bumper touches the ground at none of the points",
}
"""FMU -> why some element was 0 at all points."""


@pytest.mark.parametrize("name", default_catalog())
def test_the_catalog_has_the_dimensions_that_it_declares(name: str) -> None:
    model = default_catalog()[name].make(Context(FMUS, FMUS / ".cache")).model()
    found = model.dimensions
    found.check()
    assert bool(found.unchecked) == (name in UNCHECKED), found.unchecked[:5]
    assert bool(found.not_exercised) == (name in UNSEEN), found.not_exercised[:5]
    by_row = any(v.rows for v in model.all_variables)
    if model.symbols is ca.SX and not by_row and not found.unchecked:
        assert inconsistent(model) == []  # in all branches, by algebra
    else:
        assert model.kind == "discrete" or by_row


def test_the_oracle_finds_these_errors_too() -> None:
    for case, (equation, _) in WRONG.items():
        assert inconsistent(with_equation(equation)), case


def test_lists_name_fmus_that_there_are() -> None:
    assert {*UNCHECKED, *UNSEEN} <= {*default_catalog()}
