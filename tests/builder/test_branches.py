"""Code that only one value of a choice needs stands under its condition.

It is computed once, in an order that holds, and gives bit-identical results.
"""

from __future__ import annotations

import re
import shutil
from pathlib import Path
from typing import Any

import casadi as ca
import numpy as np
import pytest
from same_bits import differences

from build_fmus import generate
from build_fmus.component import Component
from build_fmus.equations.branches import Block, arranged, homes

needs_gcc = pytest.mark.skipif(shutil.which("gcc") is None, reason="needs gcc")


def discrete(name: str, symbols: Any = ca.SX) -> Component:
    return Component(name, kind="discrete", sample_time=0.1, description="a test", source="no paper", symbols=symbols)


def body(c: Component, function: str = "sample") -> str:
    code = generate.generate_c(c.model(), arrays=False, token="t")
    return code.split(f"static void {function}(")[1].split("\n}\n")[0].split("\n\n", 1)[1]


def random_component(seed: int) -> Component:
    """Choices within choices over shared operands.

    Their conditions themselves stand in branches, are negated, or are numbers.
    """
    rng = np.random.default_rng(seed)
    c = discrete("Choices")
    given = [c.input(f"u{k}", "1", "input") for k in range(4)]
    given.append(c.parameter("on", True, None, "a number as a condition", source="none"))
    known: list[Any] = list(given)
    conditions: list[Any] = [given[4], given[0] < given[1]]

    def old(of: list[Any]) -> Any:
        return of[rng.integers(len(of))]

    for _ in range(60):
        kind = rng.integers(6)
        if kind == 0:
            conditions.append(old([old(known) < old(known), ca.logic_not(old(conditions)), old(known) <= old(given)]))
        elif kind == 1:
            known.append(ca.tanh(old(known)) * old(known) + 1 / (2 + old(known) ** 2))
        elif kind == 2:
            known.append(ca.if_else(old(conditions), ca.sin(old(known)) / (3 + ca.fabs(old(known))), 0))
        else:
            a, b = ca.exp(-ca.fabs(old(known))) + old(known), ca.sqrt(ca.fabs(old(known)) + 1) * old(known)
            known.append(ca.if_else(old(conditions), a, b))
    state = c.state("state", "1", "state")
    c.update(state, known[-1])
    c.output("chosen", ca.vertcat(*known[-12:]), "1", "choices")
    return c


@needs_gcc
@pytest.mark.parametrize("seed", range(8))
def test_the_bits_are_those_without_branches(seed: int, tmp_path: Path) -> None:
    c = random_component(seed)
    assert "if (" in body(c)
    assert differences(c.model(), tmp_path) == []


def test_what_only_one_value_needs_is_computed_under_its_condition() -> None:
    c = discrete("One")
    u, v = c.input("u", "1", "u"), c.input("v", "1", "v")
    c.output("y", ca.if_else(u < v, ca.sin(u) + ca.exp(v), ca.cos(v)), "1", "choice")
    text = body(c)
    assert (
        text == "    const condition v1 = u->u < u->v;\n"
        "    scalar v2 = {0};\n"
        "    if (any(v1)) {\n"
        "        v2 = sin(u->u) + exp(u->v);\n"
        "    }\n"
        "    scalar v3 = {0};\n"
        "    if (any(v1 == 0)) {\n"
        "        v3 = cos(u->v);\n"
        "    }\n"
        "    y->y = if_else(v1, v2, v3);"
    )


def test_a_number_is_a_condition_where_it_is_not_0() -> None:
    c = discrete("Number")
    on, u = c.parameter("on", True, None, "on", source="none"), c.input("u", "1", "u")
    c.output("y", ca.if_else(on, ca.sin(u), ca.cos(u)), "1", "choice")
    text = body(c)
    assert "if (any(p->on != 0.0)) {" in text
    assert "if (any(p->on == 0.0)) {" in text


def test_what_both_values_need_or_a_result_shows_is_always_computed() -> None:
    c = discrete("Both")
    u, v = c.input("u", "1", "u"), c.input("v", "1", "v")
    shared, shown = ca.sin(u), ca.exp(v)
    c.output("y", ca.if_else(u < v, shared * 5, shared * 3), "1", "choice")
    c.output("z", ca.if_else(u < v, shown, 1), "1", "choice")
    c.output("shown", shown, "1", "in any case")
    assert "if (" not in body(c)


def test_what_costs_little_has_no_branch() -> None:
    c = discrete("Little")
    u, v = c.input("u", "1", "u"), c.input("v", "1", "v")
    c.output("y", ca.if_else(u < v, u * v + 1, u - v), "1", "choice")
    assert "if (" not in body(c)


def test_choices_with_one_condition_share_a_block() -> None:
    c = discrete("Shared")
    u, v = c.input("u", "1", "u"), c.input("v", "1", "v")
    there = u > 0
    depth = ca.sqrt(u) * ca.sin(v)
    for k in range(4):
        c.output(f"y{k}", ca.if_else(there, depth * ca.exp((k + 2) * v), 0), "1", "choice")
    text = body(c)
    assert text.count("if (") == 1
    assert text.count("sqrt(") == 1
    assert re.search(
        "^        const (scalar|local) v", text, re.M
    )  # what nothing outside reads is a constant of the block


def test_conditions_in_another_order_guard_what_they_have_in_common() -> None:
    c = discrete("Order")
    u, v = c.input("u", "1", "u"), c.input("v", "1", "v")
    near, steep = u > 0, v > 0
    c.output("y", ca.if_else(near, ca.if_else(steep, ca.sin(u), 0), 0), "1", "near, then steep")
    c.output("z", ca.if_else(steep, 3 * ca.if_else(near, ca.sin(u), 0), 0), "1", "steep, then near")
    inner = [line for line in body(c).splitlines() if "sin(" in line]
    assert [len(line) - len(line.lstrip()) for line in inner] == [12]


def test_derivatives_have_no_branches() -> None:
    """Compilers would take half as long again for what is asked for seldom."""
    c = Component("Derived", kind="continuous", description="a test", source="no paper")
    x, u = c.state("x", "1", "x", output=True), c.input("u", "1", "u")
    c.derivative(x, ca.if_else(u > 0, ca.sin(x) * ca.exp(x), 0))
    assert "if (" in body(c, "derivatives")
    assert "if (" not in body(c, "directional")


def test_lines_keep_an_order_that_holds() -> None:
    """Random lines under random conditions: each once, in blocks of its conditions, after all that it needs."""
    for seed in range(60):
        rng = np.random.default_rng(seed)
        n = int(rng.integers(1, 40))
        under, needs = [], []
        for k in range(n):
            guard = tuple(
                (int(c), bool(rng.integers(2))) for c in sorted(rng.choice(3, rng.integers(0, 4), replace=False))
            )
            under.append(guard)
            needs.append(frozenset(int(i) for i in rng.integers(0, k, rng.integers(0, 3))) if k else frozenset())
        items = arranged(under, needs)

        order: list[int] = []

        def visit(
            items: list[int | Block], inside: tuple[Any, ...], order: list[int] = order, under: Any = under
        ) -> None:
            for item in items:
                if isinstance(item, Block):
                    visit(item.items, (*inside, item.branch))
                else:
                    assert under[item] == inside
                    order.append(item)

        visit(items, ())
        assert sorted(order) == list(range(n))
        place = {k: i for i, k in enumerate(order)}
        assert all(place[i] < place[k] for k in range(n) for i in needs[k])
        assert {k: len(h) for k, h in homes(items).items()} == {k: len(g) for k, g in enumerate(under)}
