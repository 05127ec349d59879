"""A report that is declared section by section, from results by hand."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import pytest

from cosim.report import Figure, Panel, Parameter, Report, Result, Series, Table
from cosim.study import (
    Case,
    ClaimList,
    Content,
    Experiment,
    Finding,
    FmuSet,
    Measures,
    Results,
    StudyReport,
    Task,
    Wiring,
    option,
)
from cosim.study.study_report import paragraphs, section_of


@dataclass(frozen=True)
class Ride(Case):
    speed: float = option(10.0, unit="km/h", help="speed")


FAST, FAILED = Ride(), Ride(20.0)
RESULTS = Results([Task(FAST), Task(FAILED)], [{"metrics": {"peak": 3.0}}, {"failed": "the solver gave up"}])
EXPERIMENT = Experiment("rides", Ride, Wiring(lambda *_: None), Measures(lambda _: {}))
CLAIMS = ClaimList()


@CLAIMS.check("low", "the peak is low", expected="at most 5")
def _low(study: Results) -> Finding:
    return Finding(f"{study[FAST]['peak']:g}", study[FAST]["peak"] <= 5)


def figure(id_: str) -> Figure:
    return Figure(id_, "Peak", "", [Panel("", "speed [km/h]", "peak [-]", [Series("peak", [10.0], [3.0])])])


def declared(**fields: object) -> StudyReport:
    """A report with a section that draws, one that has nothing to show, and one that needs a failed run."""
    report = StudyReport(EXPERIMENT, "Rides", **fields)  # type: ignore[arg-type]

    @report.lead
    def _lead(study: Results) -> Content:
        yield f"""The peak
        is {study[FAST]["peak"]:g}."""
        yield figure("main-result")

    @report.section("All rides")
    def _rides(study: Results) -> Content:
        yield Table.of("rides", "Rides", [{"speed [km/h]": FAST.speed, "peak [-]": study[FAST]["peak"]}])
        yield """One
        ride.

        No more."""
        yield figure("over-speed")

    @report.section("Nothing")
    def _nothing(_: Results) -> Content:
        yield from ()

    @report.section("Fast rides")
    def _fast(study: Results) -> Content:
        yield "Fast."
        yield f"{study[FAILED]['peak']}"

    @report.section(lambda study: f"{len(study)} runs")
    def _count(_: Results) -> Content:
        yield "Counted."

    return report


@pytest.fixture
def fmus(tmp_path: Path) -> FmuSet:
    return FmuSet(tmp_path)


def test_sections_show_what_they_yield_in_the_order_of_their_declaration(fmus: FmuSet) -> None:
    page = declared(claims=CLAIMS)(RESULTS, fmus)
    assert (page.experiment, page.title, page.lead) == ("rides", "Rides", "The peak is 3.")
    assert [(s.title, list(s.paragraphs)) for s in page.sections] == [
        ("All rides", ["One ride.", "No more."]),
        ("Fast rides", ["Left out: the run speed-20 failed: the solver gave up"]),
        ("2 runs", ["Counted."]),
    ]
    assert [f.id for f in page.figures] == ["main-result", "over-speed"]
    assert [t.rows for t in page.tables] == [((10.0, 3.0),)]
    assert [(c.id, c.verdict) for c in page.claims] == [("low", "holds")]
    assert (page.animation, page.parameters, page.results) == (None, (), ())


def test_everything_sees_the_view_of_the_results(fmus: FmuSet) -> None:
    report = StudyReport(
        EXPERIMENT,
        "Rides",
        claims=lambda peaks: CLAIMS.judge(RESULTS) if peaks == [3.0] else [],
        parameters=lambda _: [Parameter("mass", 1.0, "kg", "assumed")],
        looks={"peak": ("green", "dash")},
        view=lambda results, _: [results[c]["peak"] for c in results.ran],
        results=lambda peaks, claims: [Result("highest", max(peaks)), Result("checks", len(claims))],
        provenance=lambda peaks: {"runs": len(peaks)},
    )

    @report.lead
    def _lead(peaks: list[float]) -> Content:
        yield f"At most {max(peaks):g}."
        yield figure("main-result")

    page: Report = report(RESULTS, fmus)
    assert page.lead == "At most 3."
    assert [(r.name, r.value) for r in page.results] == [("highest", 3.0), ("checks", 1)]
    assert [p.name for p in page.parameters] == ["mass"]
    assert page.provenance["runs"] == 1
    (series,) = page.drawn[0].panels[0].series
    assert (series.color, series.dash) == ("green", "dash")


def test_a_lead_that_needs_a_failed_run_says_so(fmus: FmuSet) -> None:
    report = StudyReport(EXPERIMENT, "Rides")

    @report.lead
    def _lead(study: Results) -> Content:
        yield str(study[FAILED])

    page = report(RESULTS, fmus)
    assert page.lead == "The main result is left out: the run speed-20 failed: the solver gave up"
    assert page.figure is None


def test_an_empty_line_begins_a_paragraph() -> None:
    assert paragraphs("One\n    line.\n\n    Another one.\n") == ["One line.", "Another one."]
    assert section_of("S", ["a\nb", "c"]).paragraphs == ("a b", "c")
