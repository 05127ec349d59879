"""A study is run, broken off, continued, retried; a failure costs its own row only."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from concurrent.futures import ProcessPoolExecutor, ThreadPoolExecutor
from dataclasses import dataclass, replace
from pathlib import Path

import pytest
from sweep_tables import made as made_sweep

from cosim import CosimError, Execution
from cosim.report import write_report
from cosim.study import CaseError, FmuSet, Results, RunFailed, Runner, Study, Task, load, run_study
from cosim.study.dispatch import DIED
from cosim.study.pages import report_of
from cosim.study.sweep import run_sweep

HERE = Path(__file__).parent
FILE = HERE / "mine.py"
ROOT = HERE.parents[1]
FMUS = FmuSet()


@pytest.fixture
def experiment():
    return load(str(FILE))


@pytest.fixture
def notes(tmp_path, monkeypatch):
    """Which rates were run, and how often; this process's runs too."""
    folder = tmp_path / "notes"
    folder.mkdir()
    monkeypatch.setattr(sys.modules["_experiment_mine"], "NOTES", str(folder))
    monkeypatch.setenv("NOTES_OF_RUNS", str(folder))
    return lambda: {float(p.name): len(p.read_text().split()) for p in folder.iterdir()}


def test_every_case_has_its_row_and_a_failed_one_says_why(experiment, tmp_path, raises) -> None:
    seen = []
    results = run_study(
        experiment, FMUS, tmp_path, processes=2, progress=lambda done, total: seen.append((done, total))
    )
    assert [c.rate for c in results] == [1.0, 2.0, 3.0, 13.0, 5.0]
    assert results[experiment.case(1.0)]["last"] == pytest.approx(0.99**100)
    assert results[experiment.case(2.0)]["last"] == pytest.approx(0.98**100)
    assert list(results.failures) == ["rate13"]
    assert "thirteen is not for me" in results.failures["rate13"]
    with pytest.raises(RunFailed, match=r"the run rate13 failed: ComponentError: .*thirteen"):
        results[experiment.case(13.0)]
    with raises(KeyError):
        results[experiment.case(4.0)]
    assert results.signals(experiment.case(1.0))["z"][0] == 1.0
    with raises(KeyError):
        results.signals(experiment.case(2.0))
    assert seen == [(i, 5) for i in range(6)]
    rows = results.rows()
    assert rows[1] == {"rate": 2.0, "note": "", **results[experiment.case(2.0)]}
    assert set(rows[3]) == {"rate", "note", "failed"}


def test_one_of_a_hundred(experiment, tmp_path) -> None:
    """One process that dies, in a study of 100 cases, costs that row only."""
    cases = [experiment.case(666.0 if i == 37 else i / 100) for i in range(100)]
    results = run_study(experiment, FMUS, tmp_path, tasks=cases, processes=2)
    assert results.failures == {"rate666": DIED}
    assert len(results.ran) == 99
    assert all(results[c]["last"] == pytest.approx((1 - c.rate / 100) ** 100) for c in results.ran)


def test_what_is_stored_is_not_run_again(experiment, tmp_path, notes) -> None:
    with ThreadPoolExecutor(1) as here:
        for retry, again in ((False, 1), (False, 1), (True, 2)):
            run_study(experiment, FMUS, tmp_path / "runs", executor=here, retry_failed=retry)
            assert notes() == {1.0: 1, 2.0: 1, 3.0: 1, 5.0: 1, 13.0: again}
        run_study(experiment, FMUS, tmp_path / "runs", executor=here, force=True)
    assert notes() == {1.0: 2, 2.0: 2, 3.0: 2, 5.0: 2, 13.0: 3}


@pytest.mark.parametrize("kind", [ThreadPoolExecutor, ProcessPoolExecutor])
def test_any_executor_gives_the_same(experiment, tmp_path, kind) -> None:
    ours = run_study(experiment, FMUS, tmp_path / "ours", processes=1)
    with kind(2) as executor:
        theirs = run_study(experiment, FMUS, tmp_path / "theirs", executor=executor)
    assert theirs.rows() == ours.rows()


def pages(folder: Path) -> dict[str, bytes]:
    return {
        p.relative_to(folder).as_posix(): p.read_bytes()
        for p in folder.rglob("*")
        if p.is_file() and ".runs" not in p.parts
    }


def test_a_tolerance_has_stored_runs_of_its_own(tmp_path, refused) -> None:
    """Its numbers are those of a run with the tolerance; both kinds are found again, and the report names it."""
    ride = load(str(HERE / "lane_ride.py"))
    cases, how = [ride.case(python=True)], Execution(tolerance=1e-3)

    def made(execution: Execution | None) -> dict[str, float]:
        return run_study(ride, FMUS, tmp_path, tasks=cases, processes=1, execution=execution)[cases[0]]

    fixed, adaptive = made(None), made(how)
    kept = stored(tmp_path)
    with Runner(ride, FMUS, execution=how) as runner:
        assert runner.metrics(cases[0]) == adaptive
    assert adaptive["rms"] != fixed["rms"]
    assert adaptive["rms"] == pytest.approx(fixed["rms"], rel=0.05)
    assert (made(None), made(how), stored(tmp_path)) == (fixed, adaptive, kept)
    results = run_study(ride, FMUS, tmp_path, tasks=cases, processes=1, execution=how)
    assert "a tolerance of 0.001" in report_of(ride, results, FMUS, how).lead
    sweep = made_sweep(ride, "car.body.mass=2300:3400", samples=1)
    refused(CosimError, lambda: run_sweep(sweep, FMUS, tmp_path / "sweep", execution=how))


def stored(runs: Path) -> int:
    """Results in a store."""
    return sum(p.read_bytes().count(b"\n") for p in runs.glob("*.lines"))


def test_a_killed_study_continues_to_the_same_report(tmp_path) -> None:
    """Killed in the middle, without a word to anybody, and started again: the same bytes as in one go."""
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    values = [f"--rate={r}" for r in (1, 2, 3, 99, 98)]
    whole, broken = tmp_path / "whole", tmp_path / "broken"
    program = "import sys; from cosim.cli import main; sys.exit(main())"
    command = [sys.executable, "-c", program, "study", str(planless(tmp_path)), *values, "--processes", "1", "--out"]

    def start(out: Path) -> subprocess.Popen[bytes]:
        return subprocess.Popen([*command, str(out)], env=environment, cwd=tmp_path, stdout=-3, stderr=-3)

    assert start(whole).wait() == 0
    process = start(broken)
    runs = broken / "fall" / ".runs"
    end = time.monotonic() + 300
    while stored(runs) < 2:
        assert time.monotonic() < end
        time.sleep(0.01)
    process.send_signal(signal.SIGKILL)
    process.wait()
    kept = stored(runs)
    assert 0 < kept < len(values)
    assert not (broken / "fall" / "report.html").exists()
    assert start(broken).wait() == 0
    assert pages(broken) == pages(whole)


def planless(folder: Path) -> Path:
    """The experiment without a plan of its own, in which long runs are long: 99 sleeps."""
    text = FILE.read_text()
    a = text.index("    study=")
    text = text[:a] + text[text.index("\n", a) + 1 :]
    file = folder / "planless.py"
    file.write_text(text.replace("self.rate == 99", "self.rate > 95"))
    return file


def test_claims_that_need_a_failed_run_are_open(experiment, tmp_path) -> None:
    results = run_study(experiment, FMUS, tmp_path / "runs", processes=1)
    assert {c.id: c.verdict for c in experiment.study.claims.judge(results)} == {"falls": "reproduced", "slow": "holds"}
    tasks = [Task(c) for c in results]
    for rate, verdicts in ((2.0, ("open", "holds")), (1.0, ("open", "does not hold"))):
        entries = [{"failed": "it broke"} if t.case.rate in (rate, 13) else {"metrics": results[t.case]} for t in tasks]
        broken = Results(tasks, entries)
        claims = experiment.study.claims.judge(broken)
        assert tuple(c.verdict for c in claims) == verdicts
        assert f"the run rate{rate:g} failed: it broke" in claims[0].reason


def test_a_report_by_default(experiment, tmp_path) -> None:
    """Numbers in the table and the curves are the metrics, in the unit that the heading names."""
    results = run_study(experiment, FMUS, tmp_path / "runs", processes=1)
    report = report_of(experiment, results, FMUS)
    (table, failed) = report.tables
    assert list(table.columns) == ["rate [1/s]", "last height [mm]", "mean height [m]"]
    last, mean = (results[experiment.case(2.0)][k] for k in ("last", "mean"))
    assert table.rows[1] == (2.0, 1e3 * last, mean)
    assert [row[0] for row in failed.rows] == ["rate13"]
    (figure,) = report.figures
    assert [(p.title, p.x_label, p.y_label) for p in figure.panels] == [
        ("last height", "rate [1/s]", "last height [mm]"),
        ("mean height", "rate [1/s]", "mean height [m]"),
    ]
    (curve,) = figure.panels[0].series
    assert curve.x_values.tolist() == [1.0, 2.0, 3.0, 5.0]
    assert list(curve.y)[1] == pytest.approx(1e3 * last)
    assert write_report(report, tmp_path).is_file()


def test_systems_are_wired_once_and_set_for_every_case(experiment) -> None:
    with Runner(experiment, FMUS) as runner:
        first = runner.run(experiment.case(1.0))
        second = runner.run(experiment.case(2.0))
        assert first.system is second.system
        assert second.start("mass.rate") == 2.0
        assert runner.metrics(experiment.case(1.0)) == runner.metrics(experiment.case(1.0))


@dataclass(frozen=True)
class Other:
    rate: float = 1.0


def test_plans(experiment, raises) -> None:
    import dataclasses

    with raises(CaseError):
        dataclasses.replace(experiment, study=Study()).tasks()
    twice = dataclasses.replace(experiment, study=Study([experiment.case(1.0), Task(experiment.case(1.0))]))
    assert twice.tasks() == [Task(experiment.case(1.0))]


def test_a_study_tells_the_error_of_the_exchange_in_its_default_run(experiment, tmp_path) -> None:
    told = replace(experiment, study=replace(experiment.study, exchange_error=["mass.z"]))
    report = report_of(told, run_study(told, FMUS, tmp_path / "runs", processes=1), FMUS)
    with Runner(told, FMUS) as runner:
        found = runner.exchange_error(told.case(), ["mass.z"])
    (text,) = next(s.paragraphs for s in report.sections if s.title == "Error of the exchange")
    assert [s.name for s in found.signals] == ["mass.z"]
    assert text == (
        f"In the run with default options, of mass.z: {found.advice()} The command `error` tells it for every case and"
        " variable."
    )
