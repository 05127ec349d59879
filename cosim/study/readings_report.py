"""Report of a study under several readings: claims over readings, what turns, and what no reading reaches."""

from __future__ import annotations

from collections.abc import Mapping

from cosim.report import Figure, Panel, Report, Result, Section, Series, Table
from cosim.report.claims import OUTCOMES, Claim, Claims, Verdict
from cosim.report.model import Scalar
from cosim.study.experiment import Experiment
from cosim.study.fmus import FmuSet
from cosim.study.pages import provenance, sections
from cosim.study.readings import AS_READ, ReadingsStudy
from cosim.study.results import Results

SHORT: dict[Verdict, str] = dict(zip(OUTCOMES, ("yes", "calibrated", "trend", "open", "no"), strict=True))
_IN_FULL = OUTCOMES[:2]
_TURNS = "→"
LEGEND = "yes: reproduced; trend: reproduced in another size."
_LEGEND = f"{LEGEND} {_TURNS}: another verdict than as read today. Criteria are those of the main study."
_STEPS = "Half the steps: the main study judges at these too, this one only with --full."

Judged = dict[str, Claims]


def judge(study: ReadingsStudy, results: Results) -> Judged:
    """The published claims in every reading, by its name."""
    claims, full = study.published(), _is_full(study, results)
    return {name: claims.judge(study.seen(results, reading)) for name, reading in study.chosen(full).items()}


def _is_full(study: ReadingsStudy, results: Results) -> bool:
    return all(case in results for case in study.cases(full=True))


def in_full(claims: Claims) -> int:
    """How many hold in full."""
    return sum(c.verdict in _IN_FULL for c in claims)


def unreached(judged: Judged) -> list[Claim]:
    """Claims as read today that hold in full in no reading."""
    return [
        claim
        for i, claim in enumerate(judged[AS_READ])
        if not any(claims[i].verdict in _IN_FULL for claims in judged.values())
    ]


def report_readings(study: ReadingsStudy, experiment: Experiment, results: Results, fmus: FmuSet) -> Report:
    """The page."""
    judged = judge(study, results)
    counts = {name: in_full(claims) for name, claims in judged.items()}
    best = max((n for n in counts if n != AS_READ), key=counts.__getitem__)
    notes = [*study.notes, *[_STEPS] * (not _is_full(study, results))]
    return Report(
        experiment=experiment.name,
        title=experiment.title,
        lead=(
            f"As read today, {counts[AS_READ]} of {len(judged[AS_READ])} published claims hold in full; of"
            f" {len(counts) - 1} other readings the best one ({best}) holds {counts[best]}. No reading reaches"
            f" {len(unreached(judged))} of them."
        ),
        figure=counts_figure(counts, _LEGEND),
        results=[Result("readings", len(judged)), Result("published claims", len(judged[AS_READ]))],
        sections=[*sections(judged, (_map, _turns, _never)), Section("Left out", notes)],
        provenance=provenance(experiment, fmus),
    )


def counts_figure(counts: Mapping[str, int], caption: str) -> Figure:
    """Bars of how many claims hold in full, by reading."""
    bars = Series("claims that hold in full", range(len(counts)), list(counts.values()), mode="bar")
    panel = Panel("", "reading [-]", "claims [-]", [bars], x_names=list(counts))
    return Figure("main-result", "Claims that hold in full, by reading", caption, [panel])


def _map(judged: Judged) -> Section:
    rows: list[list[Scalar]] = []
    for i, claim in enumerate(judged[AS_READ]):
        found = [claims[i].verdict for claims in judged.values()]
        cells = [SHORT[v] if v == claim.verdict else f"{_TURNS} {SHORT[v]}" for v in found]
        rows.append([claim.id, claim.claim, *cells])
    rows.append(["in full", "claims that hold in full", *map(in_full, judged.values())])
    columns = ["claim", "sentence", *judged]
    return Section("Claims by reading", tables=[Table("map", "Verdicts by reading", columns, rows, _LEGEND)])


def _turns(judged: Judged) -> Section:
    rows: list[list[Scalar]] = [
        [claim.id, name, SHORT[claim.verdict], SHORT[other.verdict], came_out(claim), came_out(other)]
        for i, claim in enumerate(judged[AS_READ])
        for name, other in ((name, claims[i]) for name, claims in judged.items())
        if other.verdict != claim.verdict
    ]
    columns = ["claim", "reading", AS_READ, "becomes", "result as read", "result in this reading"]
    text = f"{len({row[0] for row in rows})} of {len(judged[AS_READ])} claims turn under some reading."
    return Section(
        "Claims that turn",
        [text],
        tables=[Table("turns", "Results of claims that turn", columns, rows)] if rows else [],
    )


def came_out(claim: Claim) -> str:
    """The result of a claim, under each condition where these differ."""
    parts = {f"{c.result} ({SHORT[c.verdict]})": c.name for c in claim.conditions}
    if len(parts) == 1:
        return next(iter(parts))
    return "; ".join(f"{name}: {text}" for text, name in parts.items()) or claim.result


def _never(judged: Judged) -> Section:
    names = ", ".join(f"{c.id} ({SHORT[c.verdict]})" for c in unreached(judged)) or "none"
    text = f"Under none of the {len(judged)} readings do these hold in full: {names}."
    return Section("Claims that no reading reaches", [text])
