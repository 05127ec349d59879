"""Readings: which cases are run in the place of which, and what the claims make of them."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest

from cosim.study import (
    Case,
    CaseError,
    ClaimList,
    Experiment,
    Finding,
    FmuSet,
    Measures,
    Results,
    RunFailed,
    Task,
    Wiring,
    option,
)
from cosim.study import Study as Runs
from cosim.study.claims import under_conditions
from cosim.study.readings import AS_READ, Change, Reading, ReadingsStudy, read_as
from cosim.study.readings_report import came_out, judge, unreached


@dataclass(frozen=True)
class Ride(Case):
    speed: float = option(10.0, within=(1, 100), help="speed")
    driver: str = option("calm", choices=("calm", "brisk", "wild"), help="driver")
    friction: bool = option(False, help="dry friction")


@dataclass(frozen=True)
class Corner(Case):
    friction: bool = option(True, help="dry friction")


CLAIMS = ClaimList()


@CLAIMS.claim("slow", "At 10 the car stays below 5", published="below 5", source="1")
def _slow(study: Results) -> Finding:
    value = study[Ride(10.0)]["peak"]
    return Finding(f"{value:g}", value < 5, "above")


@CLAIMS.claim("drivers", "Brisk and wild drivers stay below 50", published="below 50", source="2")
def _drivers(study: Results) -> Finding:
    each = {d: study[Ride(20.0, d)]["peak"] for d in ("brisk", "wild")}
    return under_conditions({d: Finding(f"{v:g}", v < 50, "above") for d, v in each.items()})


@CLAIMS.claim("corner", "The corner stays below 1", published="below 1", source="3")
def _corner(study: Results) -> Finding:
    value = study[Corner()]["peak"]
    return Finding(f"{value:g}", value < 1, "above")


@CLAIMS.check("own", "Nobody counts this", expected="nothing")
def _own(study: Results) -> Finding:
    raise AssertionError(study)


def peak(case: Any) -> float:
    if isinstance(case, Corner):
        return 2.0
    return case.speed * {"calm": 1.0, "brisk": 2.0, "wild": 3.0}[case.driver] * (0.3 if case.friction else 1.0)


MAIN = Experiment("ride", Ride, Wiring(lambda _fmus, _case: None), Measures(lambda _run: {}))
CORNER = Experiment("corner", Corner, Wiring(lambda _fmus, _case: None), Measures(lambda _run: {}))
MAIN = Experiment("ride", Ride, MAIN.wiring, MAIN.measures, study=Runs([Ride(99.0)], parts=[CORNER]))
READINGS: dict[str, Reading] = {
    AS_READ: (),
    "friction": (Change(Ride, {"friction": True}),),
    "nobody is wild": (Change(Ride, {"driver": "calm"}, {"driver": ("wild", "brisk")}),),
}
NEEDED = [Ride(10.0), Ride(20.0, "brisk"), Ride(20.0, "wild"), Corner()]
STUDY = ReadingsStudy(
    MAIN,
    lambda: NEEDED,
    [CLAIMS],
    READINGS,
    "fast, too",
    {"fast": (Change(Ride, {"speed": 50.0}, {"speed": 10.0}),)},
    notes=["Wind: there is none."],
)
EXPERIMENT = STUDY.experiment("ride-readings", "Rides read otherwise", __name__)


def ran(full: bool = False, broken: Any = None) -> Results:
    tasks = EXPERIMENT.tasks(full=full)
    entries = [{"failed": "broke"} if t.case == broken else {"metrics": {"peak": peak(t.case)}} for t in tasks]
    return Results(tasks, entries)


def test_a_change_is_made_where_it_belongs() -> None:
    change = Change(Ride, {"speed": 30.0}, {"driver": ("brisk", "wild"), "friction": False})
    assert change(Ride(driver="wild")) == Ride(30.0, "wild")
    assert change(Ride()) == Ride()
    assert change(Ride(driver="brisk", friction=True)) == Ride(driver="brisk", friction=True)
    assert change(Corner()) == Corner()
    both = (Change(Corner, {"friction": False}), change)
    assert read_as(both, Corner()) == Corner(friction=False)
    with pytest.raises(CaseError, match="speed"):
        Change(Ride, {"speed": 1000.0})(Ride())


def test_each_run_once_and_the_parts_with_their_names() -> None:
    tasks = EXPERIMENT.tasks()
    cases = [t.case for t in tasks]
    assert len(cases) == len(set(cases)) == len(STUDY.cases(full=False))
    assert set(cases) == {*NEEDED, *(Ride(c.speed, c.driver, True) for c in NEEDED[:3]), Ride(20.0)}  # type: ignore[attr-defined]
    assert {t.part for t in tasks if isinstance(t.case, Corner)} == {"corner"}
    assert Ride(50.0) in {t.case for t in EXPERIMENT.tasks(full=True)}
    (full,) = EXPERIMENT.study.plan.__click_params__  # type: ignore[union-attr]
    assert full.help == "fast, too"


def test_what_the_short_study_leaves_out() -> None:
    short = ReadingsStudy(
        MAIN, lambda: [Ride(), Ride(20.0)], [CLAIMS], READINGS, "", short=(Change(Ride, {"speed": 5.0}),)
    )
    assert short.cases(full=False)[0] == Ride(5.0)
    assert {c.speed for c in short.cases(full=False)} == {5.0}
    assert {c.speed for c in short.cases(full=True)} == {10.0, 20.0}


def test_runs_are_seen_in_the_place_of_those_of_the_main_study() -> None:
    results = ran()
    seen = STUDY.seen(results, READINGS["friction"])
    assert seen[Ride(10.0)] == results[Ride(10.0, friction=True)]
    assert seen[Corner()] is results[Corner()]
    assert seen.of("corner")[Corner()] == {"peak": 2.0}
    assert {c: STUDY.seen(results, ())[c] for c in NEEDED} == {c: results[c] for c in NEEDED}
    broken = STUDY.seen(ran(broken=Ride(10.0, friction=True)), READINGS["friction"])
    with pytest.raises(RunFailed, match="broke"):
        broken[Ride(10.0)]
    with pytest.raises(RunFailed, match="leaves out the run speed-77"):
        seen[Ride(77.0)]


def test_verdicts_by_reading() -> None:
    judged = {name: [c.verdict for c in claims] for name, claims in judge(STUDY, ran()).items()}
    assert judged == {
        AS_READ: ["not reproduced", "open", "not reproduced"],
        "friction": ["reproduced", "reproduced", "not reproduced"],
        "nobody is wild": ["not reproduced", "reproduced", "not reproduced"],
    }
    assert [c.id for c in unreached(judge(STUDY, ran()))] == ["corner"]
    assert list(judge(STUDY, ran(full=True))) == [AS_READ, "friction", "nobody is wild", "fast"]
    assert judge(STUDY, ran(broken=Ride(10.0)))[AS_READ][0].verdict == "open"


def test_the_page(tmp_path: Path) -> None:
    page = EXPERIMENT.study.report(ran(), FmuSet(tmp_path))  # type: ignore[operator, misc]
    tables = {t.id: t.rows for t in page.tables}
    assert [list(row) for row in tables["map"]] == [
        ["slow", "At 10 the car stays below 5", "no", "→ yes", "no"],
        ["drivers", "Brisk and wild drivers stay below 50", "open", "→ yes", "→ yes"],
        ["corner", "The corner stays below 1", "no", "no", "no"],
        ["in full", "claims that hold in full", 0, 2, 1],
    ]
    assert [list(row[:4]) for row in tables["turns"]] == [
        ["slow", "friction", "no", "yes"],
        ["drivers", "friction", "open", "yes"],
        ["drivers", "nobody is wild", "open", "yes"],
    ]
    assert list(tables["turns"][0][4:]) == ["10", "3"]
    assert list(tables["turns"][1][4:]) == ["brisk: 40 (yes); wild: 60 (no)", "brisk: 12 (yes); wild: 18 (yes)"]
    words = {s.title: " ".join(s.paragraphs) for s in page.sections}
    assert words["Claims that turn"] == "2 of 3 claims turn under some reading."
    assert words["Claims that no reading reaches"].endswith("in full: corner (no).")
    assert words["Left out"].startswith("Wind: there is none. Half the steps: ")
    assert page.lead == (
        "As read today, 0 of 3 published claims hold in full; of 2 other readings the best one (friction) holds 2. No"
        " reading reaches 1 of them."
    )
    assert page.figure is not None
    assert list(page.figure.panels[0].series[0].y) == [0, 2, 1]


def test_conditions_that_came_out_alike_are_said_once() -> None:
    same = under_conditions({n: Finding("12", True) for n in ("calm", "wild")})
    statement = next(iter(CLAIMS))
    assert came_out(same.claim(statement)) == "12 (yes)"
    assert isinstance(STUDY.main.placed([Corner()])[0], Task)
