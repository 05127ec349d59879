"""Tables of plants: rows of values that are linear in between, as parameters of an FMU."""

from __future__ import annotations

from typing import Any

import casadi as ca

from build_fmus.component import Component


def check_increasing(c: Component, row: Any, name: str) -> None:
    """Let initialization refuse a row of parameters `name` whose values do not increase."""
    for i in range(1, row.numel()):
        c.check(
            row[i] - row[i - 1],
            f"{name}[{i + 1}] must be larger than {name}[{i}]: the values of this row must increase",
        )


def linear_table(at: Any, row: Any, values: Any, *, beyond: bool) -> Any:
    """The function through `values` at increasing `row`, linear in between.

    Before the first point it is constant; after the last one it continues along the last line if `beyond`, else it is
    constant.
    """
    total = values[0]
    last = row.numel() - 1
    for i in range(last):
        reached = ca.fmax(0, at - row[i])
        if i < last - 1 or not beyond:
            reached = ca.fmin(row[i + 1] - row[i], reached)
        gap = row[i + 1] - row[i]
        # finite for rows that check_increasing refuses, so that they are refused by its message
        gap += (gap == 0) * (row[last] - row[0])
        total += (values[i + 1] - values[i]) / gap * reached
    return total
