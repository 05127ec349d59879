"""Numbers of a function that keep no derivatives of their own."""

from __future__ import annotations

import re

import casadi as ca
import pytest

from build_fmus import generate
from build_fmus.component import Component
from build_fmus.equations.locals import Statement, without_derivatives


def read_by(count: int, operands: set[str], **of: bool | int) -> list[Statement]:
    """A number of these operands that so many others read, each with one more."""
    depth = of.pop("readers_depth", 0)
    number = Statement("v", set(operands), **{"smooth": True, **of})  # type: ignore[arg-type]
    return [number, *(Statement("", {"v", f"x->own{k}"}, depth) for k in range(count))]


@pytest.mark.parametrize(
    ("statements", "left_out"),
    [
        (read_by(1, {"x->a", "x->b", "x->c"}), True),
        (read_by(3, {"x->a"}), True),
        (read_by(2, {"x->a", "x->b"}), True),
        (read_by(5, {"x->a", "x->b", "x->c"}), False),
        (read_by(2, {"x->a", "x->b", "x->c"}), False),
        (read_by(2, {"x->a", "p->b", "p->c"}), True),  # parameters mostly do not move
        (read_by(5, {"x->a", "x->b", "x->c"}, readers_depth=2), True),  # seldom read
        (read_by(2, {"x->a", "x->b", "x->c", "x->d"}, depth=2), False),  # often read, for what it costs
        (read_by(1, {"x->a"}, smooth=False), False),
    ],
)
def test_a_number_is_left_out_where_that_leaves_fewer_operands(statements: list[Statement], left_out: bool) -> None:
    assert without_derivatives(statements) == ({"v"} if left_out else set())
    operands = statements[0].reads if left_out else {"v"}
    assert all(s.reads == {*operands, f"x->own{k}"} for k, s in enumerate(statements[1:]))


def test_what_readers_have_already_costs_nothing() -> None:
    operands = {"x->a", "x->b", "x->c"}
    statements = [Statement("v", set(operands), smooth=True), *(Statement("", {"v", *operands}) for _ in range(9))]
    assert without_derivatives(statements) == {"v"}
    assert all(s.reads == operands for s in statements[1:])


def test_numbers_that_are_left_out_follow_each_other() -> None:
    chain = [Statement(f"v{k}", {f"v{k - 1}" if k else "x->a"}, smooth=True) for k in range(5)]
    assert without_derivatives([*chain, last := Statement("", {"v4"})]) == {f"v{k}" for k in range(5)}
    assert last.reads == {"x->a"}


def test_a_statement_has_at_most_as_many_operands_as_compilers_bear() -> None:
    numbers = [Statement(f"v{k}", {f"x->a{k}_{i}" for i in range(20)}, smooth=True) for k in range(5)]
    assert len(without_derivatives([*numbers, last := Statement("", {s.name for s in numbers}, 3)])) == 3
    assert len(last.reads) == 62


def test_kinks_infinite_slopes_and_elements_of_arrays_keep_their_numbers() -> None:
    c = Component("Kinds", kind="continuous", description="kinds of numbers", source="a test")
    u, v, w = (c.input(name, "1", name) for name in "uvw")
    table = c.parameter("table", [1.0, 2.0], "1", "an array", source="assumed")
    x = c.state("x", "1", "a state")
    values = {
        "smooth": ca.sin(u * v),
        "kink": ca.fmax(u, v),
        "steep": ca.sqrt(u),
        "of_array": u * table[1],
        "of_array_as_well": x * c.value("of_array", u * table[1]),
    }
    named = {name: c.value(name, value) for name, value in values.items() if name != "of_array"}
    wide = c.value("wide", u * v * w * x)
    c.derivative(x, sum(named.values()) + wide)
    for k in range(5):
        c.output(f"y{k}", (k + 2) * wide, "1", "a multiple")
    code = generate.generate_c(c.model(), arrays=False, token="t")
    derivatives, outputs = (
        code.split(f"static void {name}(")[1].split("\n}\n")[0] for name in ("derivatives", "outputs")
    )
    kinds = {name: kind for kind, name in re.findall(r"const (\w+) ([a-z_]+) =", derivatives)}
    assert kinds == {
        "smooth": "local",
        "kink": "scalar",
        "steep": "scalar",
        "of_array": "scalar",
        "of_array_as_well": "local",
        "wide": "local",
    }
    assert "const scalar wide" in outputs  # five read it


def test_what_functions_read_or_results_copy_keeps_its_derivatives() -> None:
    """Else a number that is compared with itself would be two, each with derivatives of its own."""
    c = Component("Pi", kind="continuous", description="control with a limit", source="a test")
    r, x, i = c.input("r", "1", "wanted"), c.state("x", "1", "position"), c.state("i", "1", "integral")
    wanted = c.value("wanted", r - x + i)
    limited = c.value("limited", ca.fmin(ca.fmax(wanted, -5.0), 5.0))
    c.derivative(x, limited - x)
    c.derivative(i, ca.if_else(limited == wanted, r - x, 0.0))
    copied = c.value("copied", r * x)
    c.output("y", copied, "1", "a copy")
    c.output("z", copied, "1", "another one")
    code = generate.generate_c(c.model(), arrays=False, token="t")
    assert "const scalar wanted =" in code
    assert "const scalar limited =" in code
    assert "const scalar copied =" in code


def test_what_loops_read_keeps_its_derivatives() -> None:
    """Each pass would have its operands."""
    c = Component("Row", kind="continuous", description="a row", source="a test", symbols=ca.MX)
    a, b, row = c.input("a", "1", "a"), c.input("b", "1", "b"), c.input("row", "1", "a row", shape=(9,))
    factor = c.value("factor", a * b)
    c.output("y", factor * row, "1", "products")
    c.output("z", factor + 1.0, "1", "a sum")
    code = generate.generate_c(c.model(), arrays=False, token="t")
    assert "const scalar factor = u->a * u->b;" in code
