"""Verdicts that README and results.md tell: of the statements as they are, and those that whole studies give."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest
from kept_results import is_kept, kept_claims, kept_verdicts

from cosim.experiments import EXPERIMENTS
from cosim.report import write_report
from cosim.study import FmuSet, Results, load, run_study
from cosim.study.experiment import resolved
from cosim.study.pages import report_of

ROOT = Path(__file__).parents[2]


@pytest.mark.parametrize("experiment", list(filter(is_kept, EXPERIMENTS)))
def test_the_verdicts_that_are_told_are_of_these_statements(experiment: str) -> None:
    """All of them, in the order of the report; a statement that comes, goes or changes needs its study run again."""
    told = kept_claims(experiment)
    statements = resolved(load(EXPERIMENTS[experiment]).study.claims)
    assert [c["id"] for c in told] == list(statements.statements)
    assert [(c["published"], c["source"], c["own"]) for c in told] == [
        (s.published, s.source, s.own) for s in statements
    ]
    assert all((c["verdict"] in ("holds", "does not hold")) == c["own"] for c in told)


@pytest.mark.full
@pytest.mark.parametrize("experiment", list(filter(is_kept, EXPERIMENTS)))
def test_the_whole_study_gives_the_verdicts_that_are_told(experiment: str, fmus: FmuSet, tmp_path) -> None:
    made = load(EXPERIMENTS[experiment])
    claims = resolved(made.study.report)(run_study(made, fmus, tmp_path / "runs"), fmus).claims
    assert {c.id: c.verdict for c in claims} == kept_verdicts(experiment)


@pytest.mark.full
@pytest.mark.parametrize("experiment", ["bench", "preview-lq"])
def test_a_study_on_a_cluster_writes_the_same_files(experiment: str, tmp_path: Path) -> None:
    """`cosim study NAME --dask local`: page, tables, figures and summary of processes, byte for byte."""
    written = []
    for place, options in (("processes", ()), ("cluster", ("--dask", "local"))):
        out = tmp_path / place
        command = [sys.executable, "-c", "from cosim.cli import main; main()", "study", experiment, "--processes", "2"]
        command += ["--out", str(out), *options]
        subprocess.run(command, cwd=ROOT, check=True, capture_output=True)
        files = [p for p in sorted((out / experiment).rglob("*")) if p.is_file() and ".runs" not in p.parts]
        written.append({p.relative_to(out).as_posix(): p.read_bytes() for p in files})
    processes, cluster = written
    assert f"{experiment}/summary.json" in processes
    assert any(name.startswith(f"{experiment}/tables/") for name in processes)
    assert list(cluster) == list(processes)
    assert [name for name in cluster if cluster[name] != processes[name]] == []


@pytest.mark.parametrize("experiment", EXPERIMENTS)
def test_where_every_run_failed_there_is_a_page_that_says_so(experiment: str, fmus: FmuSet, tmp_path: Path) -> None:
    """Every published statement is open, and no check of ours holds."""
    made = load(EXPERIMENTS[experiment])
    tasks = made.tasks()
    page = report_of(made, Results(tasks, [{"failed": "ComponentError: it broke"}] * len(tasks)), fmus)
    assert {c.verdict for c in page.claims} <= {"open", "does not hold"}
    write_report(page, tmp_path)
    (failed,) = [t for t in page.tables if t.id == "failed-runs"]
    assert {row[0] for row in failed.rows} == {t.label for t in tasks}
    assert {row[1] for row in failed.rows} == {"ComponentError: it broke"}
