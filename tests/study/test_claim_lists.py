"""Lists of published statements: one within another, words that follow the study, verdicts of findings."""

from __future__ import annotations

import pytest

from cosim.report.claims import Claim
from cosim.study import Band, ClaimList, Distribution, Finding, RunFailed
from cosim.study.claims import under_conditions


def of_a_part() -> ClaimList:
    found = ClaimList()

    @found.claim("follows", "Within the limit", published="follows", source="Figure 1")
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


FILE = """
[texts]
mass = "the mass of {mass:g} kg"

[[claim]]
id = "within"
claim = "The force stays within {limit:g} N"
published = "within 8 N"
source = "Figure 9"
judge = "bound"
limit = 8.0
result = "at most {value:.1f} {unit}"
criterion = "in all {runs} runs"
reason = "it is {value:.1f} N"
band = { low = 2.0, high = 9.0 }
fitted = ["mass"]

[[check]]
id = "pumps"
claim = "Under both pumps"
expected = "twice"
judge = "pumps"
criterion = "as said"
result = "{value:.1f} {unit}"
reason = "too much"
"""


def bound(study, *, limit):
    return Finding(
        holds=study["force"] <= limit, value=study["force"], unit="N", words={"runs": study["runs"], "mass": 70.0}
    )


def pumps(study):
    return under_conditions({name: bound(study, limit=x) for name, x in (("small", 6.0), ("large", 60.0))})


JUDGES = {"bound": bound, "pumps": pumps}


def read(tmp_path, text=FILE):
    path = tmp_path / "claims.toml"
    path.write_text(text)
    return ClaimList.read(path, JUDGES)


def test_a_file_has_the_sentences_and_a_judge_the_numbers(tmp_path) -> None:
    within, pumped = read(tmp_path).judge({"force": 7.0, "runs": 3})
    assert within == Claim(
        "within",
        "The force stays within 8 N",
        "within 8 N",
        "at most 7.0 N",
        "reproduced",
        source="Figure 9",
        value=7.0,
        unit="N",
        criterion="in all 3 runs; magnitude between 2 and 9 N",
        fitted="the mass of 70 kg",
    )
    assert (pumped.own, pumped.verdict, pumped.reason) == (True, "does not hold", "small: too much")
    assert [(c.name, c.result, c.verdict, c.value) for c in pumped.conditions] == [
        ("small", "7.0 N", "not reproduced", 7.0),
        ("large", "7.0 N", "reproduced", 7.0),
    ]
    assert read(tmp_path).judge({"force": 9.5, "runs": 3})[0].reason == "it is 9.5 N"


def test_with_how_many_samples_alone_a_claim_holds(tmp_path) -> None:
    samples = [{"force": f, "runs": 1} for f in (7.0, 7.5, 8.5, 1.0)]
    found = read(tmp_path, FILE.split("[[check]]", maxsplit=1)[0]).judge({"force": 7.0, "runs": 4}, samples, "drives")
    assert found[0].share == "holds in full with 2 of 4 drives alone"
    assert found.by_sample == [1, 1, 0, 0]


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ("[texts]", "[texts"),
        ("[texts]", "[text]"),
        ('judge = "bound"', 'judge = "bond"'),
        ("limit = 8.0", "limits = 8.0"),
        ('id = "pumps"', 'id = "within"'),
        ('published = "within 8 N"', ""),
        ('fitted = ["mass"]', 'fitted = ["weight"]'),
        ("{limit:g} N", "{limits:g} N"),
        ("low = 2.0", "low = 20.0"),
    ],
)
def test_mistakes_in_a_file_are_named_with_their_entry(tmp_path, raises, old, new) -> None:
    with raises(ValueError):
        read(tmp_path, FILE.replace(old, new))


def test_a_word_that_no_judge_has_is_named(tmp_path, raises) -> None:
    with raises(ValueError):
        read(tmp_path, FILE.replace("{runs} runs", "{run} runs")).judge({"force": 7.0, "runs": 3})


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
