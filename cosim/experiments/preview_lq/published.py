"""What paper 004 prints (Tables 2 and 3), and the runs that stand beside it."""

from __future__ import annotations

from cosim.experiments.preview_lq.design import DESIGNS
from cosim.experiments.preview_lq.runs import CONTROLLERS, INPUTS, Case
from cosim.experiments.steps import halved
from cosim.study.experiment import Search, Task

PAPER_CORNERS = ("fl", "rl", "fr", "rr")  # LF, LR, RF, RR
PAPER_COLUMNS = (
    "body.az",
    "body.pitch_acceleration",
    "body.roll_acceleration",
    *(f"suspension.{k}.deflection" for k in PAPER_CORNERS),
    *(f"tire.{k}.deflection" for k in PAPER_CORNERS),
)
WEIGHT_NAMES = {"comfort": "ride comfort", "road-holding": "road holding"}
WEIGHT_SETS = tuple(WEIGHT_NAMES)
CONTROLLED = tuple(c for c in CONTROLLERS if c != "passive")
PREVIEW_TIMES = tuple(round(0.01 * i, 2) for i in range(21))  # s

PRINTED_EIGENVALUES = (
    -28.22 + 72.25j,
    -10.77 + 67.53j,
    -9.23 + 70.13j,
    -8.59 + 67.64j,
    -5.31 + 6.14j,
    -4.00 + 5.07j,
    -3.51 + 4.52j,
)
"""Table 2, ride comfort (upper half plane), 1/s."""

PRINTED = {
    ("both", "active"): (49.6, 47.5, 100, 111.0, 141.0, 111.0, 1370.0, 149.0, 245.0, 159.0, 245.0, 72.7),
    ("both", "delay"): (21.1, 52.4, 100, 108.0, 103.0, 114.0, 105.0, 156.0, 96.2, 159.0, 101.0, 58.9),
    ("both", "preview"): (20.3, 39.4, 100, 78.3, 98.3, 84.6, 100.0, 66.6, 93.3, 65.7, 100.0, 48.3),
    ("left", "active"): (50.7, 47.9, 31.2, 101.0, 123.0, 212.0, 154.0, 126.0, 140.0, 550, 482, 62.8),
    ("left", "delay"): (21.4, 53.0, 12.0, 99.4, 109.0, 99.3, 71.4, 131.0, 64.8, 263, 221, 48.8),
    ("left", "preview"): (20.9, 39.6, 10.2, 79.2, 104.0, 127.0, 48.6, 64.1, 64.2, 335, 141, 40.8),
}
"""Table 3, ride comfort, per cent of passive, as printed: (input, controller) -> columns of the paper and J."""

CORRECTED = {("both", "active", 6): 137.0, **{("left", c, i): None for c in CONTROLLED for i in (9, 10)}}
"""Misprints of Table 3: a factor of ten in one cell of a), and in t3 and t4 of c) (None: ten times the printed value).
Roll with both sides equal is 0/0."""

COARSE = Case("both", "comfort-5ms", "preview")


def corrected(input_: str, controller: str) -> list[float | None]:
    """A row of Table 3 with its misprints corrected; None for 0/0."""
    row: list[float | None] = []
    for column, value in enumerate(PRINTED[input_, controller]):
        key = (input_, controller, column)
        if key in CORRECTED:
            row.append(CORRECTED[key] or 10.0 * value)
        else:
            row.append(None if column == 2 and input_ == "both" else float(value))
    return row


def over_preview(input_: str, weights: str, *, hold_tail: bool = False) -> dict[float, Case]:
    """Runs over preview time [s] (figure 3)."""
    return {t: Case(input_, weights, "preview", preview_time=t, hold_tail=hold_tail) for t in PREVIEW_TIMES}


def plateau(*, hold_tail: bool) -> Case:
    """The run onto a road that does not return to zero."""
    return Case("both", "comfort", "preview", shape="plateau", hold_tail=hold_tail)


def plan() -> list[Task | Search]:
    """Every run and design of the study."""
    seen = [Case(i, w, c) for i in INPUTS for w in WEIGHT_SETS for c in CONTROLLERS]
    seen += [plateau(hold_tail=h) for h in (False, True)]
    others = [
        case
        for hold in (False, True)
        for i in INPUTS
        for w in WEIGHT_SETS
        for case in over_preview(i, w, hold_tail=hold).values()
    ]
    others += [COARSE, *(case for c in CONTROLLERS for case in halved(Case("both", "comfort", c)).values())]
    return [*(Task(c, signals=True) for c in seen), *(Task(c) for c in others if c not in seen), *DESIGNS.values()]
