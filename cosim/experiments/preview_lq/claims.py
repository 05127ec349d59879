"""What the claims of paper 004 in `claims.toml` name: places, controllers and quantities of runs; special judges."""

from __future__ import annotations

from itertools import product
from pathlib import Path
from typing import ClassVar

from cosim.experiments.preview_lq.design import DESIGNS, MISSING_ENTRY
from cosim.experiments.preview_lq.published import (
    PAPER_COLUMNS,
    PRINTED_EIGENVALUES,
    WEIGHT_NAMES,
    WEIGHT_SETS,
    corrected,
    over_preview,
)
from cosim.experiments.preview_lq.runs import INPUTS, Case
from cosim.study import ClaimList, Finding, Results
from cosim.study.judges import Quantities, View, Words, compare

Place = tuple[str, str]  # input, weights
INPUT_NAMES = {"both": "both sides", "left": "left side"}
PARTS: dict[Place, str] = dict(zip(product(INPUTS, WEIGHT_SETS), "abcd", strict=True))
"""Of Table 3, by input and weights."""


def eigenvalues(study: Results, design: str) -> list[complex]:
    """Of one of the `DESIGNS`, upper half plane [1/s]."""
    return [complex(*e) for e in study.found(DESIGNS[design])["eigenvalues"]]


def matched(
    computed: list[complex], printed: tuple[complex, ...] = PRINTED_EIGENVALUES
) -> list[tuple[complex, complex, float]]:
    """Triples (printed, computed, |difference| / |printed|), each computed value used once, nearest first."""
    left = list(computed)
    pairs = []
    for p in printed:
        best = min(left, key=lambda e: abs(e - p))
        left.remove(best)
        pairs.append((p, best, abs(best - p) / abs(p)))
    return pairs


def sprung_mass(study: Results) -> str:
    """What was chosen with Table 2 in view."""
    return f"the sprung mass of {study.found(DESIGNS['comfort'])['sprung mass']}"


def relative_index(study: Results, input_: str, weights: str, controller: str) -> float:
    """J, per cent of passive."""
    return float(100 * study[Case(input_, weights, controller)]["J"] / study[Case(input_, weights, "passive")]["J"])


def relative(study: Results, input_: str, weights: str, controller: str) -> list[float | None]:
    """Components in the paper's order and J, per cent of passive; None for 0/0."""
    now, base = study[Case(input_, weights, controller)], study[Case(input_, weights, "passive")]
    row: list[float | None] = [100 * now[n] / base[n] if base[n] > 1e-20 else None for n in PAPER_COLUMNS]
    return [*row, relative_index(study, input_, weights, controller)]


def worst_short_preview(study: Results, place: Place, *, hold_tail: bool = False) -> float:
    """Largest index with 10 to 20 ms of preview over that with none."""
    curve = over_preview(*place, hold_tail=hold_tail)
    return float(max(study[c]["J"] for t, c in curve.items() if 0.005 < t < 0.025) / study[curve[0.0]]["J"])


class PreviewLqView(View):
    """Inputs and weights, as Table 3 names them: "ride comfort, both sides", "ride comfort", "left side"."""

    made = Case
    quantities: ClassVar[Quantities] = {
        "share of the benefit": lambda view, time, place: view.benefit(float(time), place),
        "rise by a short preview": lambda view, tail, place: (
            100 * (worst_short_preview(view.study, place, hold_tail=tail == "last height held") - 1)
        ),
    }

    def __init__(self, study: Results) -> None:
        super().__init__(study)
        self.words = {"mass": Words(lambda _: sprung_mass(study)), "missing": " and ".join(MISSING_ENTRY)}

    def places(self, at: str, road: str) -> list[Place]:  # noqa: ARG002
        """Those whose names have all words of `at`."""
        wanted = set() if at == "everywhere" else set(at.split(", "))
        return [p for p in PARTS if wanted <= {INPUT_NAMES[p[0]], WEIGHT_NAMES[p[1]]}]

    def benefit(self, time: float, place: Place) -> float:
        """What a preview [s] brings of what 0.2 s bring [%]."""
        curve = over_preview(*place)
        none, some, most = (self.study[curve[t]]["J"] for t in (0.0, time, 0.2))
        return float(100 * ((none - some) / (none - most)))


def poles(view: PreviewLqView, *, tolerance: float) -> Finding:
    """Which printed poles have a computed one within the tolerance [%]; the value is their number."""
    pairs, every = matched(eigenvalues(view.study, "comfort")), len(PRINTED_EIGENVALUES)
    off = [(p, o, e) for p, o, e in pairs if 100 * e > tolerance]
    near = [e for *_, e in pairs if 100 * e <= tolerance]
    words = {
        "every": every,
        "within": 100 * max(near, default=0.0),
        "others": "".join(f"; {_pole(o)} for {_pole(p)}, {100 * e:.0f} % away" for p, o, e in off),
        "without": 100 * max(e for *_, e in matched(eigenvalues(view.study, "comfort, one entry missing"))),
    }
    return Finding(holds=len(near) > every / 2, value=len(near), unit=f"of {every}", words={**view.words, **words})


def _pole(value: complex) -> str:
    return f"{value.real:.2f}+{value.imag:.2f}i"


def parts(view: PreviewLqView, *, at: str, of: str, tolerance: float) -> Finding:
    """Whether all cells of a row are on the printed side of passive, where print is further from it than the tolerance.

    The value is the largest deviation from a printed figure [%].
    """
    ((input_, weights),) = view.places(at, "")
    printed = dict(zip((*PAPER_COLUMNS, "J"), corrected(input_, of), strict=True))
    row = dict(zip((*PAPER_COLUMNS, "J"), relative(view.study, input_, weights, of), strict=True))
    both = {c: (o, p) for c, o in row.items() if o is not None and (p := printed[c]) is not None}
    off = {c: 100 * (o / p - 1) for c, (o, p) in both.items()}
    worst = max(off, key=lambda c: abs(off[c]))
    return Finding(
        holds=all((o - 100) * (p - 100) > 0 for o, p in both.values() if abs(p - 100) > tolerance),
        value=abs(off[worst]),
        unit="%",
        words={
            **view.words,
            "near": sum(abs(v) <= tolerance for v in off.values()),
            "count": len(off),
            "off": off[worst],
            "worst": worst,
        },
    )


CLAIMS = ClaimList.read(
    Path(__file__).with_name("claims.toml"), {"compare": compare, "poles": poles, "parts": parts}, PreviewLqView
)
