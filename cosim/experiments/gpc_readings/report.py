"""Claims of paper 000 by reading, the blocks that exclude each other, and why."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

from cosim.experiments.gpc.judge import CLAIMS, Judge
from cosim.experiments.gpc.published import SEEDS
from cosim.experiments.gpc.results import Study
from cosim.experiments.gpc.runs import Reading
from cosim.experiments.gpc_readings import (
    COMBINATIONS,
    EXPERIMENT,
    HELD_OUT,
    PRINTED,
    READINGS,
    StaticGain,
    readings,
    seeds,
)
from cosim.report import Claims, Figure, Layer, Map, Panel, Report, Result, Section, Series, Table
from cosim.study import FmuSet, Results, RunFailed, make_lead, provenance, sections

CURB = ("curb-explicit-force", "curb-preview-200", "curb-preview-power")
SMOOTH = ("sine-same-force", "implicit-power", "perryman-same", "perryman-implicit")
"""Two blocks of claims: what explicit costs on the curb, and that it costs no more than preview on smooth roads."""
HOLDS = ("reproduced", "calibrated", "trend reproduced, magnitude differs")


# -------------------------------------------------------------------------------------------------------------- judging


@dataclass(frozen=True)
class Judged:
    """The claims in every reading, by its words, and once more with the seeds that were held out."""

    results: Results
    seeds: tuple[int, ...]
    claims: dict[str, Claims]
    held_out: dict[str, Claims]

    @classmethod
    def of(cls, results: Results) -> Judged:
        """Judge a study."""
        found = {t.reading for t in results.tasks if isinstance(t, StaticGain)}
        tried = {name: reading for name, reading in readings(True).items() if reading in found}
        run = dict.fromkeys(t.seed for t in results.tasks if isinstance(t, StaticGain))
        first, others = tuple(s for s in run if s in SEEDS), tuple(s for s in run if s in HELD_OUT)
        return cls(
            results,
            first,
            {name: _claims(results, reading, first) for name, reading in tried.items()},
            {n: _claims(results, r, others) for n, r in tried.items() if others and set(seeds(True, r)) >= set(others)},
        )

    def verdict(self, name: str, claim: str) -> str:
        """Verdict on a claim in a reading."""
        return next(c.verdict for c in self.claims[name] if c.id == claim)

    def holding(self, name: str, block: Iterable[str]) -> list[str]:
        """Claims of a block that hold in a reading, in the published size or not."""
        return [claim for claim in block if self.verdict(name, claim) in HOLDS]

    def count(self, claims: Claims) -> int:
        """Published claims that hold in full."""
        return sum(c.passed for c in claims if not c.own)


def _claims(results: Results, reading: Reading, seeds: Sequence[int]) -> Claims:
    judge = Judge(Study.of(results, reading, seeds))
    return CLAIMS.judge(judge, judge.singles(), "identifications")


# --------------------------------------------------------------------------------------------------------------- report


def report(results: Results, fmus: FmuSet) -> Report:
    """Claims by reading, the blocks that exclude each other, and why."""
    judged = Judged.of(results)
    makers: list[Callable[[Judged], Section]] = [_counts, partial(_map, alone=True), _blocks, _gains, _never]
    if len(judged.claims) > len(READINGS):
        makers.insert(2, partial(_map, alone=False))
    lead, figure = make_lead(judged, _main_result)
    return Report(
        experiment=EXPERIMENT.name,
        title="Generalized predictive control under other readings of the paper",
        lead=lead,
        figure=figure,
        claims=[],
        results=[Result("readings", len(judged.claims)), Result("identification seeds", len(judged.seeds))],
        sections=sections(judged, makers),
        parameters=[],
        provenance=provenance(EXPERIMENT, fmus),
    )


def _main_result(judged: Judged) -> tuple[str, Figure]:
    counts = {name: judged.count(claims) for name, claims in judged.claims.items()}
    total, best = next(iter(judged.claims.values())).published, max(counts, key=lambda name: counts[name])
    together = "some reading holds" if _hold_both(judged) else "no reading holds"
    lead = (
        f"With {len(judged.seeds)} identification seeds the control laws hold {counts[PRINTED]} of {total} claims in"
        f" full as printed; of {len(counts)} readings the best one ({best}) holds {counts[best]}. The claims about the"
        f" costs of explicit on the curb and those about smooth roads {together} together."
    )
    names = list(counts)
    bars = Series("claims that hold in full", range(len(names)), list(counts.values()), mode="bar")
    panel = Panel("", "reading [-]", "claims [-]", [bars], x_names=names)
    return lead, Figure("main-result", "Claims that hold in full, by reading", _JUDGED, [panel])


_JUDGED = "Judged on the median identification by the criteria of the main study."


def _counts(judged: Judged) -> Section:
    """How many claims hold, and with single identifications."""
    rows: list[list[Any]] = []
    alone = judged.claims[PRINTED].by_sample
    for name, claims in judged.claims.items():
        held = judged.count(judged.held_out[name]) if name in judged.held_out else None
        rows.append([name, judged.count(claims), min(claims.by_sample), max(claims.by_sample), held])
    return Section(
        "How many claims hold",
        [
            "The paper had one identification, so the count with each seed alone stands beside that of the median. As"
            f" printed it is {min(alone)} to {max(alone)} with one of {len(alone)} seeds: readings whose counts differ"
            " by no more than that are not told apart. A reading counts as better than the printed one only if it is"
            " so with seeds that were held out.",
            f"The study has {len(judged.results.tasks)} tasks.",
        ],
        tables=[
            Table(
                "counts",
                f"Claims that hold in full, of {next(iter(judged.claims.values())).published}",
                ["reading", "median of the seeds", "least of one seed", "most of one seed", "held-out seeds"],
                rows,
                f"Seeds {_span(judged.seeds)}; held out: {_span(HELD_OUT) if judged.held_out else 'none'}.",
            )
        ],
    )


def _span(seeds: Sequence[int]) -> str:
    return f"{seeds[0]} to {seeds[-1]}"


def _map(judged: Judged, *, alone: bool) -> Section:
    """Claims over readings: verdict, and with how many identifications alone each holds in full."""
    names = [n for n in judged.claims if n in (READINGS if alone else COMBINATIONS)]
    rows, shares = [], list[list[float]]()
    for claim in (s.id for s in CLAIMS if not s.own):
        cells: list[str] = []
        shares.append([])
        for name in names:
            found = next(c for c in judged.claims[name] if c.id == claim)
            passed = judged.claims[name].passed[list(judged.claims[name]).index(found)]
            cells.append(f"{_SHORT[found.verdict]} {sum(passed)}/{len(passed)}")
            shares[-1].append(sum(passed) / len(passed))
        rows.append([claim, *cells])
    title = "One assumption at a time" if alone else "Combinations"
    shown = Map(
        "shares" if alone else "shares-of-combinations",
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
        y_names=[row[0] for row in rows],
    )
    return Section(
        title,
        figures=[shown],
        tables=[
            Table(
                "map" if alone else "combinations",
                f"Claims by reading: {title.lower()}",
                ["claim", *names],
                rows,
                "yes: holds in full; trend: holds, in another size; open; no. Beside it with how many identifications"
                " alone the claim holds in full.",
            )
        ],
    )


_SHORT = {
    "reproduced": "yes",
    "calibrated": "yes",
    "trend reproduced, magnitude differs": "trend",
    "open": "open",
    "not reproduced": "no",
}


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


def _blocks(judged: Judged) -> Section:
    """Two blocks of claims that exclude each other."""
    rows: list[list[Any]] = []
    for name in judged.claims:
        curb, smooth = (judged.holding(name, block) for block in (CURB, SMOOTH))
        rows.append([name, len(curb), len(smooth), ", ".join(smooth) or "none"])
    first, second = (_most(judged, *blocks) for blocks in ((CURB, SMOOTH), (SMOOTH, CURB)))
    both = _hold_both(judged)
    told = f"Both hold as {', '.join(both)}." if both else "No reading holds both."
    return Section(
        "Two blocks of claims" + " that exclude each other" * (not both),
        [
            f"On the curb explicit is the dearest and preview the cheapest ({', '.join(CURB)}). On smooth roads"
            f" explicit costs what preview does, and implicit more ({', '.join(SMOOTH)}). {first} {second}"
            f" {told}"
        ],
        tables=[
            Table(
                "blocks",
                "Claims of both blocks that hold",
                ["reading", f"curb, of {len(CURB)}", f"smooth roads, of {len(SMOOTH)}", "smooth roads, which"],
                rows,
                "Whether what is claimed holds, in the published size or not. " + _JUDGED,
            )
        ],
    )


def _gains(judged: Judged) -> Section:
    """Static gain of the control laws."""
    rows: list[list[Any]] = []
    found = {(t.reading, t.seed): judged.results.found(t) for t in judged.results.tasks if isinstance(t, StaticGain)}
    for name, reading in readings(True).items():
        if name not in judged.claims:
            continue
        each = [found[reading, seed] for seed in judged.seeds if (reading, seed) in found]
        spans = [(min(values), max(values)) for c in ("explicit", "preview") for values in [[e[c] for e in each]]]
        rows.append([name, *(float(f"{x / 1e3:.3g}") for span in spans for x in span)])
    return Section(
        "Why: the static gain",
        [
            "A control law that leaves the road ahead out of its prediction fights every height that it measures for as"
            " long as it lasts. Its gain on a road that is higher under all wheels says how much; a"
            " controller that knows that the road stays as high has almost none."
        ],
        tables=[
            Table(
                "static-gain",
                "Force of an actuator for a road that is higher under all wheels",
                [
                    "reading",
                    "explicit, lowest [kN/m]",
                    "explicit, highest [kN/m]",
                    "preview, lowest [kN/m]",
                    "preview, highest [kN/m]",
                ],
                rows,
                "Root mean square over the four actuators, over the seeds. Where the road's rate or slope is measured,"
                " per unit of that.",
            )
        ],
    )


def _never(judged: Judged) -> Section:
    """Claims that no reading reaches."""
    never = [
        s.id for s in CLAIMS if not s.own and not any(judged.verdict(name, s.id) in HOLDS for name in judged.claims)
    ]
    if not judged.claims:
        raise RunFailed("no reading was run")
    return Section(
        "Claims that no reading reaches",
        [f"Under none of the {len(judged.claims)} readings do these hold, in any size: {', '.join(never) or 'none'}."],
    )
