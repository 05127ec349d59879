"""Lists of published statements: one within another, words that follow the study, verdicts of findings."""

from __future__ import annotations

import pytest

from cosim.study import Band, ClaimList, Distribution, Finding, RunFailed


def of_a_part() -> ClaimList:
    found = ClaimList()

    @found.claim("follows", lambda study: f"Within {study['limit']} N", published="follows", source="Figure 1")
    def _follows(study: dict[str, float]) -> Finding:
        return Finding(f"{study['force']} N", study["force"] <= study["limit"], "beyond")

    @found.check("solved", "Every program is solved", expected="all")
    def _solved(study: dict[str, float]) -> Finding:
        raise RunFailed(f"no run in {len(study)}")

    return found


def test_a_list_within_another_keeps_its_place_and_its_checks(raises) -> None:
    whole = ClaimList()
    whole.claim("first", "One", published="1", source="")(lambda _: Finding("1", True, ""))
    whole.include(of_a_part())
    whole.claim("last", "Two", published="2", source="")(lambda _: Finding("2", True, ""))
    judged = whole.judge({"limit": 8, "force": 9})
    assert [(c.id, c.verdict, c.own) for c in judged] == [
        ("first", "reproduced", False),
        ("follows", "not reproduced", False),
        ("solved", "does not hold", True),
        ("last", "reproduced", False),
    ]
    with raises(ValueError):
        whole.include(of_a_part())


def test_words_follow_the_study() -> None:
    assert of_a_part().judge({"limit": 8, "force": 7})[0].claim == "Within 8 N"
    assert of_a_part().judge({"limit": 30, "force": 7})[0].claim == "Within 30 N"


@pytest.mark.parametrize(
    "finding",
    [
        Finding("x", True, "y"),
        Finding("x", False, "y"),
        Finding("x", True, "y", undecided="too few"),
        Finding("x", True, "y", 3.0, band=Band(2.0, 4.0)),
        Finding("x", True, "y", 5.0, band=Band(2.0, 4.0)),
        Finding("x", False, "y", 3.0, band=Band(2.0, 4.0)),
        Finding("x", True, "y", over=Distribution([1.0, 3.0, 9.0]), band=Band(2.0, 4.0)),
        Finding("x", True, "y", over=Distribution([1.0] * 4 + [3.0] * 5), band=Band(2.0, float("inf"))),
        Finding("x", True, "y", float("nan"), band=Band(2.0, 4.0)),
    ],
)
def test_a_finding_has_the_verdict_that_its_claim_gets(finding: Finding) -> None:
    claims = ClaimList()
    claims.claim("one", "One", published="1", source="")(lambda _: finding)
    assert claims.judge({})[0].verdict == finding.verdict


def test_verdicts_of_findings() -> None:
    assert Finding("x", True, "y", 5.0, band=Band(2.0, 4.0)).verdict == "trend reproduced, magnitude differs"
    assert Finding("x", True, "y", float("nan"), band=Band(2.0, 4.0)).verdict == "trend reproduced, magnitude differs"
    assert Finding("x", True, "y", undecided="too few").verdict == "open"
