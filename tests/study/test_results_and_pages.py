"""Results by hand.

What is read of them, and what a report by default, its parameters and its provenance make of them.
"""

from __future__ import annotations

import zipfile
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from cosim.report import Section
from cosim.study import (
    Band,
    Case,
    ClaimList,
    Distribution,
    Evidence,
    Experiment,
    Finding,
    FmuSet,
    Measures,
    Metric,
    Results,
    RunFailed,
    Study,
    Task,
    Wiring,
    default_report,
    option,
    parameters,
    provenance,
)
from cosim.study.pages import cells, compared, failed_section, make_lead, report_of, sections


@dataclass(frozen=True)
class Ride(Case):
    speed: float = option(10.0, unit="km/h", help="speed", label="{:g}kmh", always=True)
    road: str = option("sine", choices=("sine", "curb"), help="road", label="{}")
    gain: float = option(1.0, help="gain")


@dataclass(frozen=True)
class Match:
    target: float
    part: str = ""

    @property
    def label(self) -> str:
        return f"match-{self.target:g}"

    def __call__(self, runner: Any) -> None:
        """Nothing that these tests run."""


def measure(run: Any) -> Any:
    return run


METRICS = {"heave": Metric("peak heave", "mm", 1e3), "count": Metric("steps")}
FMU_XML = """<fmiModelDescription fmiVersion="3.0" modelName="Car" instantiationToken="t">
<CoSimulation modelIdentifier="Car"/>
<UnitDefinitions><Unit name="kg"><BaseUnit kg="1"/></Unit></UnitDefinitions><ModelVariables>
<Float64 name="mass" valueReference="1" causality="parameter" variability="fixed" unit="kg" start="7.5"/>
<Int32 name="axles" valueReference="2" causality="parameter" variability="fixed" start="2"/>
<Boolean name="lifted" valueReference="3" causality="parameter" variability="fixed" start="true"/>
<String name="maker" valueReference="4" causality="parameter" variability="fixed"><Start value="x"/></String>
<Float64 name="z" valueReference="5" causality="output"/></ModelVariables>
<ModelStructure><Output valueReference="5"/></ModelStructure><Annotations><Annotation type="suspension-fmus">
<Component kind="continuous"><Variable name="mass" source="weighed"/></Component></Annotation></Annotations>
</fmiModelDescription>"""


@pytest.fixture
def fmus(tmp_path: Path) -> FmuSet:
    """A folder with a car that has nothing but a description."""
    (tmp_path / "fmi3").mkdir()
    with zipfile.ZipFile(tmp_path / "fmi3" / "Car.fmu", "w") as z:
        z.writestr("modelDescription.xml", FMU_XML)
    return FmuSet(tmp_path)


def experiment(metrics: dict[str, Metric] = METRICS, title: str = "Rides", **study: Any) -> Experiment:
    return Experiment(
        "ride", Ride, Wiring(measure, fmus=("Car",)), Measures(measure, metrics), study=Study(**study), title=title
    )


def results(failed: bool = True) -> Results:
    """Two roads at three speeds; over the curb at 30 km/h the car broke, and so did a search."""
    cases = [Ride(v, r) for r in ("sine", "curb") for v in (30.0, 10.0, 20.0)]
    entries: list[dict[str, Any]] = [
        {"metrics": {"heave": c.speed / 1e3 + (c.road == "curb"), "count": i}} for i, c in enumerate(cases)
    ]
    if failed:
        entries[3] = {"failed": "ComponentError: it broke"}
    entries[0]["signals"] = {"time": [0.0, 1.0]}
    tasks: list[Any] = [Task(c, signals=i == 0) for i, c in enumerate(cases)]
    return Results(
        [*tasks, Match(3.0), Match(4.0)], [*entries, {"found": {"weight": 2.5}}, {"failed": "no weight does"}]
    )


# ------------------------------------------------------------------------------------------------------------ results


def test_what_comes_one_after_the_other_is_kept(raises) -> None:
    """Tasks and entries may be given as iterators."""
    tasks, entries = [Task(Ride(v)) for v in (10.0, 20.0)], [{"metrics": {"heave": v}} for v in (0.1, 0.2)]
    found = Results(iter(tasks), iter(entries))
    assert [found[t.case]["heave"] for t in tasks] == [0.1, 0.2]
    with raises(ValueError):
        Results(iter(tasks), iter(entries[1:]))


def test_what_is_read_of_results() -> None:
    study = results()
    assert len(study) == len(list(study)) == 6
    assert study[Ride(20.0, "curb")] == {"heave": 1.02, "count": 5}
    assert study.signals(Ride(30.0)) == {"time": [0.0, 1.0]}
    assert study.found(Match(3.0)) == {"weight": 2.5}
    assert study.ran == [c for c in study if c != Ride(30.0, "curb")]
    assert study.failures == {"30kmh-curb": "ComponentError: it broke", "match-4": "no weight does"}
    assert study.rows()[2] == {"speed": 20.0, "road": "sine", "gain": 1.0, "heave": 0.02, "count": 2}
    assert study.rows()[3] == {"speed": 30.0, "road": "curb", "gain": 1.0, "failed": "ComponentError: it broke"}


def test_failures_are_counted_where_labels_are_alike() -> None:
    tasks = [Task(Ride(50.00001)), Task(Ride(50.00002)), Match(3.0000001), Match(3.0000002)]
    study = Results(tasks, [{"failed": str(i)} for i in range(4)])
    assert list(study.failures.values()) == ["0", "1", "2", "3"]
    assert list(study.failures)[2:] == ["match-3", "match-3 (2)"]
    assert study.failure(Ride(50.00002)) == "1"


def test_what_cannot_be_read_says_why(raises) -> None:
    study = results()
    for read, kind in (
        (lambda: study[Ride(40.0)], KeyError),
        (lambda: study[3], KeyError),
        (lambda: study[Ride(30.0, "curb")], RunFailed),
        (lambda: study.signals(Ride(30.0, "curb")), RunFailed),
        (lambda: study.signals(Ride(10.0)), KeyError),
        (lambda: study.found(Match(4.0)), RunFailed),
        (lambda: study.found(Match(9.0)), KeyError),
    ):
        with raises(kind):
            read()


def test_a_case_that_two_tasks_ask_for_has_what_both_found() -> None:
    case = Ride(10.0)
    study = Results(
        [Task(case), Task(case, signals=True)], [{"metrics": {"a": 1}}, {"metrics": {"a": 1}, "signals": {"time": [0]}}]
    )
    assert (study[case], study.signals(case), len(study)) == ({"a": 1}, {"time": [0]}, 1)


def test_results_of_a_part() -> None:
    tasks = [Task(Ride(1.0)), Task(Ride(2.0), part="more"), Match(1.0, part="more"), Match(2.0)]
    whole = Results(tasks, [{"metrics": {"a": 1}}, {"failed": "broke"}, {"found": 3}, {"found": 4}])
    more, own = whole.of("more"), whole.of()
    assert (list(more), more.found(Match(1.0, "more")), more.failures) == ([Ride(2.0)], 3, {"more: 2kmh": "broke"})
    assert (list(own), own.found(Match(2.0)), own.failures) == ([Ride(1.0)], 4, {})
    assert whole.failures == more.failures


# -------------------------------------------------------------------------------------------------------------- claims


def test_what_a_claim_carries_to_the_report(raises) -> None:
    claims = ClaimList()
    band = Band(2.0, 4.0, "as printed")

    @claims.claim("size", "The size", published="3 mm", source="Figure 2")
    def _size(_: Results) -> Finding:
        evidence = Evidence()
        evidence.is_significant("sizes", distribution, lambda v: v > 2, "mm")
        assert not evidence.is_significant("none", None, lambda _: True)
        return Finding(
            "5 mm", True, "too large", 5.0, "mm", band, criterion="a size", fitted="the mass", evidence=evidence
        )

    @claims.check("done", "All done", expected="6 runs", source="here")
    def _done(study: Results) -> Finding:
        return Finding(
            f"{len(study)} runs", len(study) == 7, "not seven", 6.0, "runs", criterion="seven", fitted="nothing"
        )

    distribution = Distribution([1.0, 3.0, 3.0])
    judged = claims.judge(results())
    assert len(claims) == 2
    size, done = judged
    assert (size.id, size.claim, size.published, size.result, size.verdict, size.reason, size.source) == (
        "size",
        "The size",
        "3 mm",
        "5 mm",
        "trend reproduced, magnitude differs",
        "too large",
        "Figure 2",
    )
    assert (size.value, size.unit, size.criterion, size.fitted, size.own) == (
        5.0,
        "mm",
        "a size; magnitude between 2 and 4 mm (as printed)",
        "the mass",
        False,
    )
    assert (done.id, done.claim, done.published, done.result, done.verdict, done.reason, done.source) == (
        "done",
        "All done",
        "6 runs",
        "6 runs",
        "does not hold",
        "not seven",
        "here",
    )
    assert (done.value, done.unit, done.criterion, done.fitted, done.own) == (6.0, "runs", "seven", "nothing", True)
    with raises(ValueError):
        claims.check("size", "Again", expected="")
    (kept,) = judged.evidence
    assert (kept.claim, kept.quantity, kept.unit) == ("size", "sizes", "mm")


# --------------------------------------------------------------------------------------------------------------- pages


def test_parameters_of_an_fmu(fmus: FmuSet) -> None:
    file = fmus.path("Car")
    found = {p.name: (p.value, p.unit, p.source) for p in parameters(file)}
    unsaid = "the FMU does not say"
    assert found == {"mass": (7.5, "kg", "weighed"), "axles": (2, "-", unsaid), "lifted": (True, "-", unsaid)}
    (chosen,) = parameters(file, ["mass"], prefix="car.", set_to={"mass": 9.0, "axles": 3})
    assert (chosen.name, chosen.value, chosen.unit, chosen.source) == ("car.mass", 9.0, "kg", "set by the study")


def test_sections_that_survive_a_failed_run() -> None:
    def _first(study: Results) -> Section:  # noqa: ARG001
        return Section("First")

    def _wheel_loads(study: Results) -> Section:
        return Section(str(study[Ride(30.0, "curb")]))

    def _told(study: Results) -> Section:
        """What is told of it.

        More words.
        """
        return Section(str(study[Ride(30.0, "curb")]))

    def _two(study: Results) -> list[Section]:  # noqa: ARG001
        return [Section("Third"), Section("Fourth")]

    made = sections(results(), (_first, _wheel_loads, _told, _two))
    assert [s.title for s in made] == ["First", "Wheel loads", "What is told of it", "Third", "Fourth"]
    assert [list(s.paragraphs) for s in made[1:3]] == [
        ["Left out: the run 30kmh-curb failed: ComponentError: it broke"]
    ] * 2


def test_a_lead_that_survives_a_failed_run() -> None:
    assert make_lead(results(), lambda study: (f"{len(study)} runs", None)) == ("6 runs", None)
    assert make_lead(results(), lambda study: (str(study[Ride(30.0, "curb")]), None)) == (
        "The main result is left out: the run 30kmh-curb failed: ComponentError: it broke",
        None,
    )


@pytest.mark.parametrize(
    ("value", "words"), [(0.75, "25 % lower"), (1.5, "50 % higher"), (1.0, "0 % higher"), (0.996, "0 % lower")]
)
def test_a_value_compared_in_words(value: float, words: str) -> None:
    assert compared(2 * value, 2.0) == words


def test_cells_of_a_run() -> None:
    assert cells(METRICS, {"heave": 0.0123456, "other": 1.0}) == {"peak heave [mm]": "12.35", "steps": "-"}
    assert cells(METRICS, {"heave": 0.01, "count": 3}, ["count"]) == {"steps": "3"}


def test_the_section_of_what_failed() -> None:
    (section,) = failed_section(results())
    assert section.paragraphs[0].startswith("2 of 8 runs failed.")
    (table,) = section.tables
    assert table.rows == (("30kmh-curb", "ComponentError: it broke"), ("match-4", "no weight does"))
    assert (list(table.columns), table.id) == (["run", "message"], "failed-runs")
    tasks = [Task(Ride(1.0))]
    assert failed_section(Results(tasks, [{"metrics": {}}])) == []


def test_a_report_by_default(fmus: FmuSet) -> None:
    claims = ClaimList()
    claims.claim("one", "One", published="1", source="")(lambda study: Finding(f"{len(study)}", True, ""))
    page = report_of(experiment(claims=claims), results(), fmus)
    assert (page.experiment, page.title, page.lead) == ("ride", "Rides", "6 runs over speed, road.")
    assert [c.result for c in page.claims] == ["6"]
    assert [s.title for s in page.sections] == ["Runs", "Dependence of the metrics", "Failed runs"]
    table = page.tables[0]
    assert (table.id, table.title) == ("runs", "All runs")
    assert list(table.columns) == ["speed [km/h]", "road", "peak heave [mm]", "steps"]
    assert table.rows == (
        (30.0, "sine", 30.0, 0),
        (10.0, "sine", 10.0, 1),
        (20.0, "sine", 20.0, 2),
        (10.0, "curb", 1010.0, 4),
        (20.0, "curb", 1020.0, 5),
    )
    (figure,) = page.drawn
    assert (figure.id, figure.title, figure.columns) == ("over-speed", "Metrics over speed", 2)
    assert [(p.title, p.x_label, p.y_label) for p in figure.panels] == [
        ("peak heave", "speed [km/h]", "peak heave [mm]"),
        ("steps", "speed [km/h]", "steps [?]"),
    ]
    curves = {s.name: (list(s.x_values), np.asarray(s.y).tolist(), s.mode) for s in figure.panels[0].series}
    assert curves == {
        "road sine": ([10.0, 20.0, 30.0], [10.0, 20.0, 30.0], "line+markers"),
        "road curb": ([10.0, 20.0], [1010.0, 1020.0], "line+markers"),
    }
    assert np.asarray(figure.panels[1].series[1].y).tolist() == [4, 5]


def test_a_report_by_default_of_runs_that_say_nothing_of_themselves(fmus: FmuSet) -> None:
    """Every number that was measured is shown under its own name.

    Without a title the experiment's name stands there.
    """
    tasks = [Task(Ride(10.0, gain=g)) for g in (3.0, 2.0)]
    entries = [{"metrics": {"rms": 0.1 * t.case.gain, "well": True, "note": "fine"}} for t in tasks]
    page = default_report(experiment(metrics={}, title=""), Results(tasks, entries), fmus)
    assert page.title == "ride"
    assert list(page.tables[0].columns) == ["gain", "rms"]
    assert page.tables[0].rows == ((3.0, pytest.approx(0.3)), (2.0, 0.2))
    (curve,) = page.drawn[0].panels[0].series
    assert (curve.name, list(curve.x_values)) == ("runs", [2.0, 3.0])
    assert (page.drawn[0].panels[0].x_label, page.drawn[0].panels[0].y_label) == ("gain [?]", "rms [?]")
    assert page.claims == ()


def test_a_report_by_default_of_one_run(fmus: FmuSet) -> None:
    page = default_report(experiment(), Results([Task(Ride())], [{"metrics": {"heave": 0.5}}]), fmus)
    assert page.lead == "1 runs."
    assert page.tables[0].rows == ((500.0, None),)
    assert [s.title for s in page.sections] == ["Runs"]
    empty = default_report(experiment(metrics={}), Results([Task(Ride())], [{"metrics": {}}]), fmus)
    assert (list(empty.tables[0].columns), empty.tables[0].rows) == (["run"], (("ride",),))


def test_more_metrics_than_are_drawn(fmus: FmuSet) -> None:
    tasks = [Task(Ride(v)) for v in (1.0, 2.0)]
    study = Results(tasks, [{"metrics": {f"m{i}": i + t.case.speed for i in range(15)}} for t in tasks])
    page = default_report(experiment(metrics={}), study, fmus)
    assert len(page.tables[0].columns) == 16
    assert (
        page.sections[0].paragraphs[0].startswith("Figures show the first 12 of 15 metrics. The table has all of them")
    )
    assert [p.title for p in page.drawn[0].panels] == [f"m{i}" for i in range(12)]
    told = {f"m{i}": Metric(f"metric {i}") for i in range(15)}
    page = default_report(experiment(metrics=told), study, fmus)
    assert [p.title for p in page.drawn[0].panels] == [m.text for m in told.values()]
    assert page.sections[0].paragraphs == ()
    named = Results(tasks, [{"metrics": {"peak force [N]": 1.0}} for _ in tasks])
    (panel,) = default_report(experiment(metrics={}), named, fmus).drawn[0].panels
    assert (panel.title, panel.y_label) == ("peak force", "peak force [N]")


def test_a_metric_that_some_runs_do_not_have(fmus: FmuSet) -> None:
    tasks = [Task(Ride(v)) for v in (1.0, 2.0)]
    study = Results(tasks, [{"metrics": {"heave": 1.0}}, {"metrics": {"heave": 2.0, "count": 3}}])
    page = default_report(experiment(), study, fmus)
    assert page.tables[0].rows == ((1.0, 1000.0, None), (2.0, 2000.0, 3))
    assert list(page.drawn[0].panels[1].series[0].x_values) == [2.0]


def test_provenance(fmus: FmuSet, tmp_path: Path) -> None:
    more = tmp_path / "More.fmu"
    more.write_bytes(b"1")
    found = provenance(experiment(papers={"001": "A paper"}), fmus, [more, fmus.path("Car")])
    assert list(found) == ["versions", "papers", "FMI version", "FMUs (SHA-256)"]
    assert (found["papers"], found["FMI version"]) == ({"001": "A paper"}, "3.0")
    assert list(found["FMUs (SHA-256)"]) == ["Car", "More"]
    assert len(set(found["FMUs (SHA-256)"].values())) == 2
    assert {"python", "numpy"} <= set(found["versions"])
    assert "papers" not in provenance(experiment(), fmus)
