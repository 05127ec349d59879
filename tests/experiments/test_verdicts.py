"""Whole studies, run in ``make test-full``, give the verdicts that README and results.md tell."""

from __future__ import annotations

from collections.abc import Callable

import pytest
from kept_results import is_kept, kept_verdicts

from cosim.experiments import (
    gpc_claims,
    gpc_study,
    hmmwv_claims,
    hmmwv_study,
    three_axle_report,
    three_axle_study,
    trench_claims,
    trench_study,
)
from cosim.experiments.cases import FmuSet
from cosim.experiments.gpc import GpcFmuSet
from cosim.report import Claims

WHOLE: dict[str, Callable] = {
    "gpc": lambda fmus, runs: gpc_claims.claims(gpc_study.study(GpcFmuSet(fmus.directory), runs)),
    "hmmwv": lambda fmus, runs: hmmwv_claims.claims(hmmwv_study.study(fmus, runs)),
    "three-axle": lambda fmus, runs: three_axle_report.claims(three_axle_study.study(fmus, runs)),
    "trench": lambda fmus, runs: trench_claims.claims(trench_study.study(fmus, runs)),
}


@pytest.mark.full
@pytest.mark.parametrize("experiment", filter(is_kept, WHOLE))
def test_the_whole_study_gives_the_verdicts_that_are_told(experiment: str, fmus: FmuSet, tmp_path) -> None:
    claims: Claims = WHOLE[experiment](fmus, tmp_path / "runs")
    assert {c.id: c.verdict for c in claims} == kept_verdicts(experiment)
