"""The page of compatibility: each of its rows names a test that there is, and a version that the project asks for."""

from __future__ import annotations

import re
import tomllib

import pytest
from packaging.requirements import Requirement
from pages import ROOT, section

TRIED = (
    "FMUs of this project in other programs",
    "Systems as SSP in other programs",
    "Third-party FMUs in this master",
    "Platforms",
)
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
REQUIRED = {
    r.name: r.specifier
    for line in [
        *PROJECT["dependencies"],
        *(line for extra in PROJECT["optional-dependencies"].values() for line in extra),
    ]
    if (r := Requirement(line)).name != PROJECT["name"]
}


def rows(title: str) -> list[dict[str, str]]:
    """Cells of the table below a heading, by column."""
    table = [line for line in section("reference/compatibility.md", title).splitlines() if line.startswith("|")]
    head, _, *body = ([cell.strip() for cell in line.strip("|").split("|")] for line in table)
    return [dict(zip(head, cells, strict=True)) for cells in body]


ROWS = [row for title in TRIED for row in rows(title)]


@pytest.mark.parametrize("row", ROWS, ids=lambda row: " ".join(list(row.values())[:3])[:60])
def test_every_row_names_a_test_that_there_is(row: dict[str, str]) -> None:
    assert all(row.values())
    found = re.fullmatch(r"\[`(test_\w+)`\]\(\.\./\.\./(tests/[\w/]+\.py)\)", row["test"])
    assert found is not None, row["test"]
    name, file = found.groups()
    assert f"\ndef {name}(" in (ROOT / file).read_text(encoding="utf-8")


@pytest.mark.parametrize(
    "row",
    [r for r in ROWS if next(iter(r.values())).startswith("`")],
    ids=lambda row: " ".join(list(row.values())[:3])[:60],
)
def test_versions_are_those_that_the_project_asks_for(row: dict[str, str]) -> None:
    package, version = next(iter(row.values())).strip("`"), row["version"]
    least = version.removesuffix(" and newer")
    assert REQUIRED[package].contains(least)
    assert least == version or f">={least}" in str(REQUIRED[package])  # the oldest is named where none is


def test_pythons_are_those_of_the_project() -> None:
    pythons = [
        c.rpartition(" ")[2]
        for c in PROJECT["classifiers"]
        if re.fullmatch(r"Programming Language :: Python :: 3\.\d+", c)
    ]
    assert [r["platform"] for r in ROWS if r.get("platform", "").startswith("Python")] == [
        f"Python {', '.join(pythons)}"
    ]
