"""Report of a study under several readings: claims over readings, what turns, and what no reading reaches."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

from cosim.report import Figure, Panel, Report, Result, Section, Series, Table
from cosim.report.claims import OUTCOMES, Claim, Claims, Verdict
from cosim.study.experiment import Experiment
from cosim.study.fmus import FmuSet
from cosim.study.pages import provenance, sections
from cosim.study.readings import AS_READ, ReadingsStudy
from cosim.study.results import Results

IN_FULL: tuple[Verdict, ...] = ("reproduced", "calibrated")
TURNS = "→"
SHORT: dict[Verdict, str] = dict(zip(OUTCOMES, ("yes", "calibrated", "trend", "open", "no"), strict=True))
_LEGEND = (
    f"yes: reproduced; trend: reproduced in another size. {TURNS}: another verdict than as read today. Criteria are"
    " those of the main study."
)

HALF_THE_STEP = (
    "Half the step: verdicts are those at the steps of the main study, which also judges at half of them; so does"
    " --full."
)

Judged = dict[str, Claims]


def judge(study: ReadingsStudy, results: Results) -> Judged:
    """The published claims in every reading, by its name."""
    claims = study.published()
    readings = study.chosen(study.is_full(results))
    return {name: claims.judge(study.seen(results, reading)) for name, reading in readings.items()}


def report_readings(
    study: ReadingsStudy, experiment: Experiment, results: Results, fmus: FmuSet, notes: Iterable[str]
) -> Report:
    """The page; `notes` say what the readings leave out."""
    judged = judge(study, results)
    counts = {name: sum(c.verdict in IN_FULL for c in claims) for name, claims in judged.items()}
    total, others = len(judged[AS_READ]), {n: k for n, k in counts.items() if n != AS_READ}
    if not study.is_full(results) and study.short:
        notes = [HALF_THE_STEP, *notes]
    best = max(others, key=lambda n: others[n])
    never = unreached(judged)
    lead = (
        f"As read today, {counts[AS_READ]} of {total} published claims hold in full; of {len(others)} other readings"
        f" the best one ({best}) holds {others[best]}. No reading reaches {len(never)} of them."
    )
    bars = Series("claims that hold in full", range(len(counts)), list(counts.values()), mode="bar")
    panel = Panel("", "reading [-]", "claims [-]", [bars], x_names=list(counts))
    return Report(
        experiment=experiment.name,
        title=experiment.title,
        lead=lead,
        figure=Figure("main-result", "Claims that hold in full, by reading", _LEGEND, [panel]),
        claims=[],
        results=[Result("readings", len(judged)), Result("published claims", total)],
        sections=sections(judged, (_map, _turns, _never, lambda _: Section("What is not tried", list(notes)))),
        parameters=[],
        provenance=provenance(experiment, fmus),
    )


def unreached(judged: Judged) -> list[Claim]:
    """Claims as read today that hold in full in no reading."""
    return [
        claim
        for i, claim in enumerate(judged[AS_READ])
        if not any(claims[i].verdict in IN_FULL for claims in judged.values())
    ]


def _map(judged: Judged) -> Section:
    """Claims over readings."""
    others = [name for name in judged if name != AS_READ]
    rows: list[list[Any]] = []
    for i, claim in enumerate(judged[AS_READ]):
        found = [judged[name][i].verdict for name in others]
        cells = [SHORT[v] if v == claim.verdict else f"{TURNS} {SHORT[v]}" for v in found]
        rows.append([claim.id, claim.claim, SHORT[claim.verdict], *cells])
    rows.append(
        ["in full", "claims that hold in full", *(sum(c.verdict in IN_FULL for c in cs) for cs in judged.values())]
    )
    columns = ["claim", "sentence", AS_READ, *others]
    return Section("Claims by reading", tables=[Table("map", "Verdicts by reading", columns, rows, _LEGEND)])


def _turns(judged: Judged) -> Section:
    """What turns."""
    rows: list[list[Any]] = [
        [claim.id, name, SHORT[claim.verdict], SHORT[other.verdict], came_out(claim), came_out(other)]
        for i, claim in enumerate(judged[AS_READ])
        for name, claims in judged.items()
        for other in [claims[i]]
        if other.verdict != claim.verdict
    ]
    columns = ["claim", "reading", AS_READ, "becomes", "result as read", "result in this reading"]
    text = f"{len({row[0] for row in rows})} of {len(judged[AS_READ])} claims turn under some reading."
    return Section("What turns", [text], tables=[Table("turns", "Claims that turn", columns, rows)] if rows else [])


def came_out(claim: Claim) -> str:
    """The result of a claim, under each condition where these differ."""
    parts = {f"{c.result} ({SHORT[c.verdict]})": c.name for c in claim.conditions}
    if len(parts) == 1:
        return next(iter(parts))
    return "; ".join(f"{name}: {text}" for text, name in parts.items()) or claim.result


def _never(judged: Judged) -> Section:
    """Claims that no reading reaches."""
    never = unreached(judged)
    names = ", ".join(f"{c.id} ({SHORT[c.verdict]})" for c in never) or "none"
    text = f"Under none of the {len(judged)} readings do these hold in full: {names}."
    return Section("Claims that no reading reaches", [text])
