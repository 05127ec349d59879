"""Claims of paper 000 by reading, the blocks that exclude each other, and why."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

from cosim.experiments import gpc, gpc_readings
from cosim.experiments.gpc.claims import CLAIMS, Judge
from cosim.experiments.gpc.published import SEEDS
from cosim.experiments.gpc.results import Results as Numbers
from cosim.experiments.gpc.runs import Assumed
from cosim.experiments.gpc_readings import COMBINATIONS, HELD_OUT, PRINTED, READINGS, needs, reading, readings
from cosim.experiments.gpc_readings.static_gain import StaticGain
from cosim.report import Claims, Layer, Map, Result, Table
from cosim.report.claims import OUTCOMES
from cosim.report.model import Scalar
from cosim.study import Content, Results, StudyReport
from cosim.study.readings import seen
from cosim.study.readings_report import LEGEND, SHORT, counts_figure, in_full

CURB = ("curb-explicit-force", "curb-preview-200", "curb-preview-power")
SMOOTH = ("sine-same-force", "implicit-power", "perryman-same", "perryman-implicit")
"""Two blocks of claims: what explicit costs on the curb, and that it costs no more than preview on smooth roads."""
HOLDS = OUTCOMES[:3]
_JUDGED = "Judged on the median identification by the criteria of the main study."


@dataclass(frozen=True)
class Judged:
    """The claims in every reading, by its words, and once more with the seeds that were held out."""

    results: Results
    seeds: tuple[int, ...]
    gains: dict[str, list[StaticGain]]
    claims: dict[str, Claims]
    held_out: dict[str, Claims]

    @classmethod
    def of(cls, results: Results) -> Judged:
        """Judge a study."""
        found = [t for t in results.tasks if isinstance(t, StaticGain)]
        run = {name: [t for t in found if t.assumed == assumed] for name, assumed in readings(True).items()}
        first, others = ({name: [t for t in ts if t.seed in s] for name, ts in run.items()} for s in (SEEDS, HELD_OUT))
        return cls(
            results,
            tuple(dict.fromkeys(t.seed for t in found if t.seed in SEEDS)),
            {name: ts for name, ts in first.items() if ts},
            *({name: _claims(results, ts) for name, ts in chosen.items() if ts} for chosen in (first, others)),
        )

    def verdict(self, name: str, claim: str) -> str:
        """Verdict on a claim in a reading."""
        return next(c.verdict for c in self.claims[name] if c.id == claim)

    def holding(self, name: str, block: Iterable[str]) -> list[str]:
        """Claims of a block that hold in a reading, in the published size or not."""
        return [claim for claim in block if self.verdict(name, claim) in HOLDS]


def _claims(results: Results, gains: Sequence[StaticGain]) -> Claims:
    """The claims in the reading of these tasks, on their seeds."""
    tasks = gpc.EXPERIMENT.placed(needs([t.seed for t in gains]))
    judge = Judge(Numbers(seen(results, reading(gains[0].assumed), tasks)))
    return CLAIMS.judge(judge, judge.singles(), "identifications")


report = StudyReport(
    gpc_readings.EXPERIMENT,
    "Generalized predictive control under other readings of the paper",
    view=lambda results, _: Judged.of(results),
    results=lambda judged, _: [
        Result("readings", len(judged.claims)),
        Result("identification seeds", len(judged.seeds)),
    ],
)


@report.lead
def main_result(judged: Judged) -> Content:
    """How many claims hold in full by reading, and whether a reading holds both blocks."""
    counts = {name: in_full(claims) for name, claims in judged.claims.items()}
    best = max(counts, key=counts.__getitem__)
    yield f"""With {len(judged.seeds)} identification seeds {counts[PRINTED]} of {judged.claims[PRINTED].published}
    claims hold in full as printed; of {len(counts)} readings the best one ({best}) holds {counts[best]}.
    {"A reading holds" if _hold_both(judged) else "No reading holds"} both the claims about the costs of explicit on the
    curb and those about smooth roads."""
    yield counts_figure(counts, _JUDGED)


@report.section("How many claims hold")
def counts(judged: Judged) -> Content:
    """With the median identification, and with single ones."""
    alone = judged.claims[PRINTED].by_sample
    rows = [
        {
            "reading": name,
            "median of the seeds": in_full(claims),
            "least of one seed": min(claims.by_sample),
            "most of one seed": max(claims.by_sample),
            "held-out seeds": in_full(judged.held_out[name]) if name in judged.held_out else None,
        }
        for name, claims in judged.claims.items()
    ]
    yield f"""The paper had one identification, so the count with each seed alone stands beside that of the median. As
    printed it is {min(alone)} to {max(alone)} with one of {len(alone)} seeds: readings whose counts differ by no more
    than that are not told apart. A reading counts as better than the printed one only if it is so with seeds that were
    held out.

    The study has {len(judged.results.tasks)} tasks."""
    title = f"Claims that hold in full, of {judged.claims[PRINTED].published}"
    held_out = _span(HELD_OUT) if judged.held_out else "none"
    yield Table.of("counts", title, rows, f"Seeds {_span(judged.seeds)}; held out: {held_out}.")


def _span(seeds: Sequence[int]) -> str:
    return f"{seeds[0]} to {seeds[-1]}"


@report.section("One assumption at a time")
def alone(judged: Judged) -> Content:
    """Claims over readings."""
    yield from _map(judged, READINGS, "One assumption at a time", "shares", "map")


@report.section("Combinations")
def combinations(judged: Judged) -> Content:
    """Claims over readings with several assumptions."""
    if COMBINATIONS.keys() & judged.claims.keys():
        yield from _map(judged, COMBINATIONS, "Combinations", "shares-of-combinations", "combinations")


def _map(judged: Judged, among: dict[str, Assumed], title: str, figure: str, table: str) -> Content:
    """Claims over readings: verdict, and with how many identifications alone each holds in full."""
    names = [n for n in judged.claims if n in among]
    rows, shares = list[list[Scalar]](), list[list[float]]()
    for i, claim in enumerate(judged.claims[PRINTED]):
        if claim.own:
            continue
        passed = [judged.claims[name].passed[i] for name in names]
        cells = [f"{SHORT[judged.claims[n][i].verdict]} {sum(p)}/{len(p)}" for n, p in zip(names, passed, strict=True)]
        rows.append([claim.id, *cells])
        shares.append([sum(p) / len(p) for p in passed])
    yield Map(
        figure,
        f"Share of identifications with which a claim holds: {title.lower()}",
        "Each identification judged alone, claim in full. The table below has the verdict on their median.",
        "reading [-]",
        "claim [-]",
        "share of identifications [-]",
        range(len(names)),
        range(len(rows)),
        [Layer("share of identifications", shares)],
        value_range=(0.0, 1.0),
        x_names=names,
        y_names=[str(row[0]) for row in rows],
    )
    legend = f"{LEGEND} Beside it with how many identifications alone the claim holds in full."
    yield Table(table, f"Claims by reading: {title.lower()}", ["claim", *names], rows, legend)


def _hold_both(judged: Judged) -> list[str]:
    """Readings in which all claims of both blocks hold."""
    return [name for name in judged.claims if len(judged.holding(name, (*CURB, *SMOOTH))) == len(CURB) + len(SMOOTH)]


def _most(judged: Judged, block: Sequence[str], other: Sequence[str]) -> str:
    """Where a block holds best, and how much of the other one holds there, as a sentence."""
    counts = {name: len(judged.holding(name, block)) for name in judged.claims}
    most = max(counts.values())
    where = [name for name, count in counts.items() if count == most]
    there = max(len(judged.holding(name, other)) for name in where)
    return (
        f"The most that holds of {', '.join(block)} is {most} of {len(block)} ({'; '.join(where)}), with at most"
        f" {there} of {len(other)} of the other block."
    )


@report.section(lambda judged: "Two blocks of claims" + " that exclude each other" * (not _hold_both(judged)))
def blocks(judged: Judged) -> Content:
    """Two blocks of claims."""
    rows = []
    for name in judged.claims:
        curb, smooth = (judged.holding(name, block) for block in (CURB, SMOOTH))
        counts = {f"curb, of {len(CURB)}": len(curb), f"smooth roads, of {len(SMOOTH)}": len(smooth)}
        rows.append({"reading": name, **counts, "smooth roads, which": ", ".join(smooth) or "none"})
    first, second = (_most(judged, *blocks) for blocks in ((CURB, SMOOTH), (SMOOTH, CURB)))
    both = _hold_both(judged)
    yield f"""On the curb explicit is the dearest and preview the cheapest ({", ".join(CURB)}). On smooth roads
    explicit costs what preview does, and implicit more ({", ".join(SMOOTH)}). {first} {second}
    {f"Both hold as {', '.join(both)}." if both else "No reading holds both."}"""
    caption = f"Whether what is claimed holds, in the published size or not. {_JUDGED}"
    yield Table.of("blocks", "Claims of both blocks that hold", rows, caption)


@report.section("Why: the static gain")
def gains(judged: Judged) -> Content:
    """Static gain of the control laws."""
    ends = [(c, *end) for c in ("explicit", "preview") for end in (("lowest", min), ("highest", max))]
    rows = []
    for name, tasks in judged.gains.items():
        each = [judged.results.found(t) for t in tasks]
        found = {f"{c}, {word} [kN/m]": end(e[c] for e in each) / 1e3 for c, word, end in ends}
        rows.append({"reading": name} | {heading: float(f"{gain:.3g}") for heading, gain in found.items()})
    yield """A control law that leaves the road ahead out of its prediction fights every height that it measures for as
    long as it lasts. Its gain on a road that is higher under all wheels says how much; a controller that knows that the
    road stays as high has almost none."""
    yield Table.of(
        "static-gain",
        "Force of an actuator for a road that is higher under all wheels",
        rows,
        "Root mean square over the four actuators, over the seeds. Where the road's rate or slope is measured, per unit"
        " of that.",
    )


@report.section("Claims that no reading reaches")
def never(judged: Judged) -> Content:
    """In no size."""
    claims = [c.id for c in judged.claims[PRINTED] if not c.own]
    found = [claim for claim in claims if not any(judged.holding(name, [claim]) for name in judged.claims)]
    yield f"Under none of the {len(judged.claims)} readings do these hold, in any size: {', '.join(found) or 'none'}."
