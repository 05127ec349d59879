"""The words of the README and of results.md on results are those of the kept summaries.

The kept summaries are those of the studies.
"""

from __future__ import annotations

import json
import re
import runpy

import pytest
from pages import ROOT, headings

from cosim.cli import NAMES
from cosim.experiments.gpc_readings.report import CURB, SMOOTH
from fmu_sources.catalog import PAPERS

WRITER = runpy.run_path(str(ROOT / "docs" / "write_results.py"))
STUDIES, READINGS = WRITER["kept"](), WRITER["kept"]("readings")
PAPERS_PAGE = WRITER["PAPERS_PAGE"].read_text(encoding="utf-8")
FULL, TREND = ("yes", "calibrated"), ("yes", "calibrated", "trend")
EXCLUSIVE = (
    ("gpc-readings", "no reading in `gpc-readings` holds both blocks", ((CURB, TREND), (SMOOTH, TREND))),
    (
        "hmmwv-readings",
        "The two readings of the pump exclude each other",
        ((("bump-threefold",), FULL), (("track-twofold",), FULL)),
    ),
    (
        "trench-readings",
        "The order of the scores (`scores`) and the claims on cost and peaks (`cost-below-passive`, `peak-az`) exclude",
        ((("scores",), TREND), (("cost-below-passive", "peak-az"), TREND)),
    ),
)
"""Experiment, sentence of the page, and both sides: claims, and in which words they hold."""


def test_every_experiment_is_there_or_said_to_be_missing() -> None:
    there = [s["experiment"] for s in STUDIES]
    assert there == sorted(set(there))
    assert set(NAMES) - set(WRITER["JUDGED"]) == {*WRITER["READINGS"]}
    for name in WRITER["JUDGED"]:
        assert (f"`cosim study {name}`" in WRITER["missing"](STUDIES)) == (name not in there)
    assert WRITER["missing"]([{"experiment": name} for name in NAMES]) == ""


def test_the_pages_are_up_to_date() -> None:
    hint = "run `make studies && python docs/write_results.py` and commit docs/results, docs/results.md and README.md"
    readme = (ROOT / "README.md").read_text(encoding="utf-8")
    assert readme == WRITER["with_section"](readme, WRITER["section"](STUDIES)), hint
    assert (ROOT / "docs" / "results.md").read_text(encoding="utf-8") == WRITER["page"](STUDIES), hint


@pytest.mark.parametrize("experiment", WRITER["TABLES"])
def test_the_page_of_a_study_has_its_tables(experiment: str) -> None:
    study = next(s for s in STUDIES if s["experiment"] == experiment)
    page = WRITER["page_of"](experiment).read_text(encoding="utf-8")
    assert list(study["tables"]) == sorted(WRITER["TABLES"][experiment])
    assert WRITER["with_tables"](page, study) == page
    changed = json.loads(json.dumps(study))
    *_, table = changed["tables"].values()
    table["rows"][0][-1] = "quite another figure"
    assert "quite another figure |" in WRITER["with_tables"](page, changed)


@pytest.mark.parametrize("study", READINGS, ids=lambda s: s["experiment"])
def test_a_verdict_that_changes_changes_the_table_of_readings(study: dict) -> None:
    changed = json.loads(json.dumps(study))
    claim, found = next((c, f) for c, f in changed["claims"].items() if not {*FULL} & {*f.values()})
    *_, last = found
    assert f"`{claim}`" in " ".join(WRITER["readings_section"](study).split()).partition("hold in full: ")[2]
    found[last] = "yes"
    assert f"→ yes: `{claim}`" in WRITER["turned"](changed, last)
    assert f"`{claim}`" not in " ".join(WRITER["readings_section"](changed).split()).partition("hold in full: ")[2]


def test_the_page_on_papers_has_the_tables_of_all_combinations() -> None:
    """And no combination holds both blocks, or many more claims on hold-out seeds than the printed text, as it says."""
    (study,) = WRITER["kept"]("combinations")
    assert WRITER["combinations_section"](study) in PAPERS_PAGE
    assert len(study["rows"]) == 2**4
    assert not any(int(curb) == len(CURB) and int(smooth) == len(SMOOTH) for _, curb, smooth, *_ in study["rows"])
    held_out = [int(row[-1]) for row in study["rows"]]
    assert max(held_out) - held_out[0] <= 2
    study["rows"][5][-1] = 12
    assert f'The most are 12, in "{study["rows"][5][0]}".' in " ".join(WRITER["combinations_section"](study).split())


def test_the_page_on_papers_has_the_tables_of_all_readings() -> None:
    assert WRITER["READINGS"] == ["gpc-readings", "hmmwv-readings", "trench-readings"]
    assert WRITER["with_readings"](PAPERS_PAGE) == PAPERS_PAGE
    for study in READINGS:
        assert WRITER["readings_section"](study) in PAPERS_PAGE


def test_names_of_claims_on_the_page_on_papers() -> None:
    """Each name in code marks that is not of a command, a parameter or a file is of a claim of that paper."""
    papers = re.split(r"^## Paper (\d+)", PAPERS_PAGE, flags=re.MULTILINE)
    for number, text in zip(papers[1::2], papers[2::2], strict=True):
        claims = {c["id"] for s in STUDIES if WRITER["paper"](s["experiment"]) == number for c in s["claims"]}
        named = set(re.findall(r"`([a-z0-9]+(?:-[a-z0-9]+)*)`", text.partition("\n## ")[0]))
        assert named - claims <= {*NAMES}, number


def test_what_the_page_on_papers_says_of_claims_that_exclude_each_other() -> None:
    """In no reading do both sides hold; each does in one."""
    found = {s["experiment"]: s for s in READINGS}
    text = " ".join(PAPERS_PAGE.split())
    for experiment, sentence, sides in EXCLUSIVE:
        assert sentence in text
        claims = found[experiment]["claims"]
        names = [
            {n for n in found[experiment]["in full"] if all(claims[c][n] in told for c in side)} for side, told in sides
        ]
        assert all(names), sentence
        assert not set.intersection(*names), sentence


def test_the_page_names_the_pump_with_which_a_claim_holds() -> None:
    hmmwv = next(s for s in STUDIES if s["experiment"] == "hmmwv")
    reasons = [p["reason"] for c in hmmwv["claims"] for p in c["conditions"] if "holds with: " in p["reason"]]
    text = WRITER["page"]([hmmwv])
    assert reasons
    assert [reason for reason in reasons if reason not in text] == []


def test_the_readme_shows_one_number_of_each_paper_and_its_reproduced_claims() -> None:
    rows = [[cell.strip() for cell in line.strip("|").split("|")] for line in WRITER["section"](STUDIES).splitlines()]
    head, _, *rows = [row for row in rows if len(row) > 1]
    assert "(docs/results.md)" in head[5]
    assert [row[0].split()[0] for row in rows] == sorted(PAPERS)
    for title, _, _, published, here, reproduced, names in rows:
        number, _, authors = title.partition(" ")
        assert all(name in PAPERS[number] for name in authors.removesuffix(" et al.").split(", "))
        own = [s for s in STUDIES if f"`{s['experiment']}`" in names]
        assert [s for s in STUDIES if WRITER["paper"](s["experiment"]) == number] == own
        claims = [c for s in own for c in s["claims"] if not c["own"]]
        counts = {v: sum(c["verdict"] == v for c in claims) for v in ("reproduced", "calibrated")}
        assert reproduced.startswith(f"{counts['reproduced']} of {len(claims)}")
        assert reproduced.endswith(f", {counts['calibrated']} calibrated") == (counts["calibrated"] > 0)
        assert [c for c in claims if c["published"] == published and shows(here, c)]


def shows(text: str, claim: dict) -> bool:
    """Whether a cell has a claim's number to three digits, or its words where it has no number.

    Of one judged under several conditions, the first's.
    """
    claim = claim["conditions"][0] if claim["conditions"] else claim
    if claim["value"] is None:
        return text == claim["result"]
    number = float(re.match(r"[\d.]+", text)[0])  # type: ignore[index]
    return number == pytest.approx(claim["value"], rel=5e-3) and text.endswith(claim["unit"])


def test_counts_are_those_of_the_claims() -> None:
    text = WRITER["table"](STUDIES).splitlines()[2:]
    for line, study in zip(text, STUDIES, strict=True):
        _, name, published, reproduced, *rest, checks, _ = (cell.strip() for cell in line.split("|"))
        claims = [c for c in study["claims"] if not c["own"]]
        assert name == f"`{study['experiment']}`"
        assert int(published) == len(claims)
        assert int(reproduced) == sum(c["verdict"] == "reproduced" for c in claims)
        assert int(reproduced) + sum(map(int, rest)) == len(claims)
        assert checks.endswith(f"of {len(study['claims']) - len(claims)}")


@pytest.mark.parametrize("study", STUDIES, ids=lambda s: s["experiment"])
def test_a_claim_that_changes_changes_the_pages(study: dict) -> None:
    changed = json.loads(json.dumps(study))
    claim = next(
        (c for c in changed["claims"] if not c["own"]), changed["claims"][0]
    )  # of no paper: one of our own checks
    claim["conditions"] = []
    claim["result"], claim["verdict"] = "quite another figure", "does not hold" if claim["own"] else "not reproduced"
    assert "quite another figure" in WRITER["page"]([changed])
    assert ("quite another figure" in WRITER["one_table"]([changed])) == (not claim["own"])


@pytest.mark.parametrize("number", sorted(PAPERS))
def test_a_number_or_verdict_that_changes_changes_the_readme(number: str) -> None:
    *_, experiment, identifier = WRITER["FEATURED"][number]
    claims = next(s for s in STUDIES if s["experiment"] == experiment)["claims"]
    now = next(c for c in claims if c["id"] == identifier)["verdict"]
    other = "open" if now == "reproduced" else "reproduced"
    for change in ({"value": 123.0}, {"published": "quite another figure"}, {"verdict": other}):
        changed = json.loads(json.dumps(STUDIES))
        claims = next(s for s in changed if s["experiment"] == experiment)["claims"]
        claim = next(c for c in claims if c["id"] == identifier)
        claim.update(change)
        for part in claim["conditions"][:1]:
            part.update({k: v for k, v in change.items() if k in part})
        assert WRITER["section"](changed) != WRITER["section"](STUDIES)


def test_every_published_claim_is_in_the_one_table() -> None:
    """With its paper, and a link to where its criterion stands."""
    text = WRITER["one_table"](STUDIES)
    rows = [
        [cell.strip() for cell in line.strip("|").split("|")] for line in text.splitlines() if line.startswith("| 0")
    ]
    claims = [(s["experiment"], c) for s in STUDIES for c in s["claims"] if not c["own"]]
    assert len(rows) == len(claims) > 80
    assert f"All {len(claims)} published claims" in text
    papers = {
        "gpc": "000",
        "gpc-readings": "000",
        "hmmwv": "001",
        "hmmwv-readings": "001",
        "bench": "002",
        "handling": "",
        "three-axle": "003",
        "trench": "003",
        "trench-readings": "003",
        "preview-lq": "004",
        "ride": "",
        "semi-active": "",
    }
    assert {name: WRITER["paper"](name) for name in NAMES} == papers
    expected = {
        (papers[name], c["claim"], c["source"], c["published"], WRITER["_result"](c), c["verdict"])
        for name, c in claims
    }
    assert {tuple(row[:6]) for row in rows} == expected
    anchors = headings(ROOT / "docs" / "results.md")
    for number, *_, link in rows:
        name, anchor = re.fullmatch(r"\[([\w-]+)\]\(results\.md#([\w-]+)\)", link).groups()  # type: ignore[union-attr]
        assert papers[name] == number
        assert anchor in anchors
    said = {
        v: int(n)
        for n, v in re.findall(
            r"(\d+) (reproduced|calibrated|open|not reproduced|trend reproduced, magnitude differs)[;.]", text
        )
    }
    assert said == {v: sum(c["verdict"] == v for _, c in claims) for v in WRITER["OUTCOMES"]}
