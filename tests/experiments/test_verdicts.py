"""Verdicts that README and results.md tell: of the statements as they are, and those that whole studies give."""

from __future__ import annotations

import pytest
from kept_results import is_kept, kept_claims, kept_verdicts

from cosim.experiments import EXPERIMENTS
from cosim.study import FmuSet, load, run_study
from cosim.study.experiment import resolved


@pytest.mark.parametrize("experiment", list(filter(is_kept, EXPERIMENTS)))
def test_the_verdicts_that_are_told_are_of_these_statements(experiment: str) -> None:
    """All of them, in the order of the report; a statement that comes, goes or changes needs its study run again."""
    told = kept_claims(experiment)
    statements = resolved(load(EXPERIMENTS[experiment]).claims)
    assert [c["id"] for c in told] == list(statements.statements)
    assert [(c["published"], c["source"], c["own"]) for c in told] == [
        (s.published, s.source, s.own) for s in statements
    ]
    assert all((c["verdict"] in ("holds", "does not hold")) == c["own"] for c in told)


@pytest.mark.full
@pytest.mark.parametrize("experiment", list(filter(is_kept, EXPERIMENTS)))
def test_the_whole_study_gives_the_verdicts_that_are_told(experiment: str, fmus: FmuSet, tmp_path) -> None:
    made = load(EXPERIMENTS[experiment])
    claims = resolved(made.report)(run_study(made, fmus, tmp_path / "runs"), fmus).claims
    assert {c.id: c.verdict for c in claims} == kept_verdicts(experiment)
