"""The page that compares checkers has a row for every fault, and its sums are those of its rows."""

from __future__ import annotations

import re
import runpy

from foreign.faulty import FAULTS
from pages import ROOT

WRITER = runpy.run_path(str(ROOT / "docs" / "write_scoreboard.py"))
PAGE = (ROOT / "docs" / "reference" / "check-scoreboard.md").read_text()
FAULTY, CLEAN = (WRITER["rows_of"](part) for part in PAGE.split("\n## ")[1:])


def test_every_fault_has_its_row_in_the_versions_that_can_have_it() -> None:
    hint = (
        "run `build-fmus && python docs/write_scoreboard.py NAME ...` for the faults that are new or changed, and"
        " commit docs/reference/check-scoreboard.md"
    )
    assert list(FAULTY) == list(FAULTS), hint
    versions = {name: tuple(map(int, row.split("|")[2].split(","))) for name, row in FAULTY.items()}
    assert versions == {name: fault.versions for name, fault in FAULTS.items()}, hint


def test_the_sums_are_those_of_the_rows() -> None:
    written = re.findall(r"\| (\d+) of (\d+) \| (\d+) of (\d+) \|", PAGE)
    expected = zip(*(WRITER["counted"](part.values()) for part in (FAULTY, CLEAN)), strict=True)
    assert [tuple(map(int, row)) for row in written] == [(*faults, *clean) for faults, clean in expected]


def test_cosim_check_finds_every_fault_and_accuses_nobody() -> None:
    assert [name for name, row in FAULTY.items() if not row.split("|")[3].strip()] == []
    assert [name for name, row in CLEAN.items() if row.split("|")[3].strip()] == []
