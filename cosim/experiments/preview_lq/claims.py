"""What paper 004 prints in Tables 2 and 3 and says of preview, judged by the runs."""

from __future__ import annotations

from itertools import product

from cosim.experiments.preview_lq.design import DESIGNS, MISSING_ENTRY
from cosim.experiments.preview_lq.published import (
    CONTROLLED,
    PAPER_COLUMNS,
    PRINTED,
    PRINTED_EIGENVALUES,
    WEIGHT_SETS,
    corrected,
    over_preview,
)
from cosim.experiments.preview_lq.runs import INPUTS, Case
from cosim.study import Band, ClaimList, Finding, Results

INPUT_NAMES = {"both": "both sides", "left": "left side"}
WEIGHT_NAMES = {"comfort": "ride comfort", "road-holding": "road holding"}
PARTS = {
    ("both", "comfort"): "a",
    ("both", "road-holding"): "b",
    ("left", "comfort"): "c",
    ("left", "road-holding"): "d",
}
"""Of Table 3, by input and weights."""
J_TOLERANCE, COMPONENT_TOLERANCE, POLE_TOLERANCE = 0.05, 0.10, 0.02  # relative
MOST = 0.8  # of a benefit
CLEAR = 0.1  # by which one of two forces is larger
NOTICEABLE = 0.02  # by which an index is worse
POLES = (
    f"all within {100 * POLE_TOLERANCE:g} %: poles are computed, so equal data give equal poles up to rounding in print"
)

CLAIMS = ClaimList()


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


def short_preview(study: Results, *, hold_tail: bool = False) -> list[float]:
    """Largest index with 10 to 20 ms of preview over that with none, by input and weights."""
    curves = (over_preview(i, w, hold_tail=hold_tail) for i, w in product(INPUTS, WEIGHT_SETS))
    return [
        max(study[c]["J"] for t, c in curve.items() if 0.005 < t < 0.025) / study[curve[0.0]]["J"] for curve in curves
    ]


# -------------------------------------------------------------------------------------------------------------- poles


@CLAIMS.claim(
    "poles",
    "Closed-loop poles of the ride-comfort design",
    published=f"{len(PRINTED_EIGENVALUES)} pairs",
    source="Table 2",
)
def _poles(study: Results) -> Finding:
    pairs, every = matched(eigenvalues(study, "comfort")), len(PRINTED_EIGENVALUES)
    off = [(p, o, e) for p, o, e in pairs if e > POLE_TOLERANCE]
    within = max((e for *_, e in pairs if e <= POLE_TOLERANCE), default=0.0)
    missing = max(e for *_, e in matched(eigenvalues(study, "comfort, one entry missing")))
    return Finding(
        f"{every - len(off)} of {every} within {100 * within:.1f} %"
        + "".join(f"; {_pole(o)} for {_pole(p)}, {100 * e:.0f} % away" for p, o, e in off),
        every - len(off) > every / 2,
        f"with one entry of the cross weight N left out ({' and '.join(MISSING_ENTRY)}) all {every} printed pairs come"
        f" out within {100 * missing:.1f} %; the index as printed gives ours",
        every - len(off),
        f"of {every}",
        Band(every, every, POLES),
        criterion="more than half of the pairs",
        fitted=sprung_mass(study),
        calibrated=True,
    )


def _pole(value: complex) -> str:
    return f"{value.real:.2f}+{value.imag:.2f}i"


# ------------------------------------------------------------------------------------------------------------ Table 3


def _claims_of_table_3(input_: str, controller: str) -> None:
    printed, source = PRINTED[input_, controller][-1], f"Table 3{PARTS[input_, 'comfort']}"

    @CLAIMS.claim(
        f"index-{input_}-{controller}",
        f"The {controller} system lowers the index of ride comfort, {INPUT_NAMES[input_]}",
        published=f"{printed:g} % of passive",
        source=source,
    )
    def _index(study: Results) -> Finding:
        j = relative_index(study, input_, "comfort", controller)
        return Finding(
            f"{j:.1f} %",
            j < 100,
            "the printed design has other low poles",
            j,
            "%",
            Band.around(printed, J_TOLERANCE, "computed from printed data, so half of the usual 10 %"),
            criterion="below the passive car's",
            fitted=sprung_mass(study),
        )

    both = {c: p for c, p in zip((*PAPER_COLUMNS, "J"), corrected(input_, controller), strict=True) if p is not None}

    @CLAIMS.claim(
        f"parts-{input_}-{controller}",
        f"The {controller} system raises and lowers the components as printed, ride comfort, {INPUT_NAMES[input_]}",
        published=f"{len(both) - 1} mean squares and J (misprints corrected)",
        source=source,
    )
    def _parts(study: Results) -> Finding:
        row = dict(zip((*PAPER_COLUMNS, "J"), relative(study, input_, "comfort", controller), strict=True))
        computed = {c: o for c in both if (o := row[c]) is not None}
        off = {c: o / both[c] - 1 for c, o in computed.items()}
        worst = max(off, key=lambda c: abs(off[c]))
        near = sum(abs(v) <= COMPONENT_TOLERANCE for v in off.values())
        clear = [c for c in computed if abs(both[c] - 100) > 100 * COMPONENT_TOLERANCE]
        return Finding(
            f"{near} of {len(off)} within {100 * COMPONENT_TOLERANCE:g} %; largest deviation {100 * off[worst]:+.0f} %"
            f" ({worst})",
            all((computed[c] - 100) * (both[c] - 100) > 0 for c in clear),
            "the printed design lacks one entry of the cross weight N, which moves its low poles and what depends on"
            " them",
            100 * abs(off[worst]),
            "%",
            Band(0.0, 100 * COMPONENT_TOLERANCE, "every printed figure within 10 %"),
            criterion=(
                f"all on the printed side of passive, where print is more than {100 * COMPONENT_TOLERANCE:g} % from it"
            ),
            fitted=sprung_mass(study),
        )


def _claim_of_order(input_: str, weights: str) -> None:
    part = PARTS[input_, weights]

    @CLAIMS.claim(
        f"order-{part}",
        f"Each kind of information lowers the index, {WEIGHT_NAMES[weights]}, {INPUT_NAMES[input_]}",
        published="active > delay > preview",
        source=f"Table 3{part}",
    )
    def _order(study: Results) -> Finding:
        row = [relative_index(study, input_, weights, c) for c in CONTROLLED]
        return Finding(
            " > ".join(f"{x:.1f}" for x in row),
            row[0] > row[1] > row[2],
            "the order differs",
            criterion="in this order; nothing is random here",
        )


for _row in PRINTED:
    _claims_of_table_3(*_row)
for _part in PARTS:
    _claim_of_order(*_part)


# -------------------------------------------------------------------------------------------------------- the figures


def _claim_of_preview_time(weights: str, time: float) -> None:
    @CLAIMS.claim(
        f"preview-time-{weights}",
        f"A preview of {time:g} s brings most of the benefit, {WEIGHT_NAMES[weights]}",
        published=f"about {time:g} s",
        source="Figure 3",
    )
    def _preview_time(study: Results) -> Finding:
        shares = []
        for curve in (over_preview(i, weights) for i in INPUTS):
            none, some, most = (study[curve[t]]["J"] for t in (0.0, time, 0.2))
            shares.append((none - some) / (none - most))
        return Finding(
            f"{100 * min(shares):.0f} % of the benefit of 0.2 s",
            min(shares) >= MOST,
            f"less than {100 * MOST:g} % of the benefit of 0.2 s",
            criterion=f"most: at least {100 * MOST:g} % of what 0.2 s brings, for both inputs",
        )


_claim_of_preview_time("comfort", 0.10)
_claim_of_preview_time("road-holding", 0.04)


@CLAIMS.claim(
    "one-side-force",
    "With input on one side the actuators of the other side work less",
    published="less force",
    source="Figure 7",
)
def _one_side_force(study: Results) -> Finding:
    runs = [study[Case("left", w, "preview")] for w in WEIGHT_SETS]
    ratio = min(r["force.fl"] / r["force.fr"] for r in runs)
    return Finding(
        f"left over right front force {ratio:.1f} or more",
        ratio >= 1 + CLEAR,
        "the other side works as hard",
        criterion=f"rms force on the driven side at least {100 * CLEAR:g} % larger, with both sets of weights",
    )


@CLAIMS.claim(
    "rear-rate",
    "The forces at the rear change faster than at the front",
    published="higher rate at the rear, all cases",
    source="Figures 6, 7",
)
def _rear_rate(study: Results) -> Finding:
    runs = [study[Case(i, w, "preview")] for i in INPUTS for w in WEIGHT_SETS]
    rates = [r["force.rl.rate"] / r["force.fl.rate"] for r in runs]
    return Finding(
        f"rear over front {min(rates):.2f} to {max(rates):.2f}",
        min(rates) > 1,
        "with preview ahead the front forces rise as fast as the rear ones in at least one of the four cases",
        criterion="rms rate of the force, rear over front, above 1 in all four cases",
    )


@CLAIMS.check(
    "short-preview",
    "A preview of 10 to 20 ms is worse than none, and it is the horizon that does it",
    expected="the index rises; not if the road is taken to continue at its last height",
    source="Figure 3",
)
def _short_preview(study: Results) -> Finding:
    cut, held = short_preview(study), short_preview(study, hold_tail=True)
    return Finding(
        f"index up by {100 * (min(cut) - 1):.0f} to {100 * (max(cut) - 1):.0f} % at its worst; with the last height"
        f" held {100 * (max(held) - 1):+.0f} % at most",
        min(cut) > 1 + NOTICEABLE and max(held) < 1,
        "a short preview lowers the index, or holding the last height does not change that",
        criterion=(
            f"in all four cases more than {100 * NOTICEABLE:g} % above no preview at 10 or 20 ms, and below it with"
            " hold_tail"
        ),
    )
