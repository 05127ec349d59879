"""Whole studies, run in ``make test-full``, give the verdicts that README and results.md tell."""

from __future__ import annotations

import pytest
from kept_results import is_kept, kept_verdicts

from cosim.experiments import EXPERIMENTS
from cosim.study import FmuSet, load, run_study
from cosim.study.experiment import resolved


@pytest.mark.full
@pytest.mark.parametrize("experiment", filter(is_kept, EXPERIMENTS))
def test_the_whole_study_gives_the_verdicts_that_are_told(experiment: str, fmus: FmuSet, tmp_path) -> None:
    made = load(EXPERIMENTS[experiment])
    claims = resolved(made.report)(run_study(made, fmus, tmp_path / "runs"), fmus).claims
    assert {c.id: c.verdict for c in claims} == kept_verdicts(experiment)
