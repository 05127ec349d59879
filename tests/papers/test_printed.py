"""Numbers that the papers print, against what the FMUs and studies use.

Each file here transcribes the design values of one paper: `[[printed]]` with `place`, `what`, `value` and `unit`. Where
it is used stands in `used`, one text per place, shell patterns allowed:

- `FMU variable`: the start value of a parameter in its model description.
- `FMU /path/in/provenance`: what the FMU was designed with; items of lists are found by their number or their `name`.
- `module attribute`: a constant of the code; `0`, `1`, ... are items.

`factor` and `reading` say how the project reads the number; `weight_of_square` marks a weight of a square, which the
predictive controllers store as the root, times a scale. A number that nothing uses has `unused` with the reason.
"""

from __future__ import annotations

import json
import math
import runpy
import tomllib
import zipfile
from collections.abc import Iterator
from fnmatch import fnmatchcase
from functools import cache
from importlib import import_module
from pathlib import Path
from typing import Any

import pytest
from built import ROOT, BuiltFmus
from fmpy import read_model_description

from build_fmus.base.units import KNOWN

HERE = Path(__file__).parent
PAPERS = ("000", "001", "002", "003", "004")


@cache
def printed(paper: str) -> list[dict[str, Any]]:
    """The numbers of a paper."""
    return tomllib.loads((HERE / f"{paper}.toml").read_text(encoding="utf-8"))["printed"]


CASES = [
    pytest.param(row, used, id=f"{paper}-{row['place']}-{row['what']}-{used}")
    for paper in PAPERS
    for row in printed(paper)
    for used in row.get("used", ())
]


@cache
def variables(file: Path) -> dict[str, tuple[float, str | None]]:
    """Start values and units of an FMU."""
    numbers = (v for v in read_model_description(file).modelVariables if v.type in {"Real", "Integer"} and v.start)
    return {v.name: (float(v.start), v.unit) for v in numbers}


@cache
def provenance(file: Path) -> Any:
    """What an FMU was designed with."""
    with zipfile.ZipFile(file) as z:
        return json.loads(z.read("resources/provenance.json"))


def items(node: Any, pattern: str) -> Iterator[Any]:
    """The items of a dictionary, list or object that fit a pattern."""
    if isinstance(node, dict):
        yield from (v for k, v in node.items() if fnmatchcase(k, pattern))
    elif isinstance(node, list | tuple):
        yield from (v for i, v in enumerate(node) if fnmatchcase(v["name"] if isinstance(v, dict) else str(i), pattern))
    else:
        yield getattr(node, pattern)


OTHER_UNITS = {"kN/m": 1e3, "psi": 6894.757, "N/m5": 1.0, "1/s3": 1.0, "1/s4": 1.0}  # those that no variable has


def factor(name: str | None) -> float:
    """SI units of a unit."""
    return OTHER_UNITS[name] if name in OTHER_UNITS else KNOWN[name or "1"].factor


def values(used: str, fmus: BuiltFmus) -> list[tuple[Any, str | None]]:
    """What stands at a place, with its unit where that is known."""
    owner, _, path = used.partition(" ")
    if "." in owner:
        nodes: list[Any] = [import_module(owner)]
        parts = path.split(".")
    elif path.startswith("/"):
        nodes, parts = [provenance(fmus.path(owner, 2))], path[1:].split("/")
    else:
        found = variables(fmus.path(owner, 2))
        pattern = path.replace("[", "[[]")
        return [v for name, v in found.items() if fnmatchcase(name, pattern)]
    for part in parts:
        nodes = [item for node in nodes for item in items(node, part)]
    return [(node, None) for node in nodes]


def value_of(row: dict[str, Any], item: Any) -> float:
    """The number that stands in an item of the FMU or of the code, as the paper prints it."""
    if row.get("weight_of_square"):
        return (item["weight"] / item["scale"]) ** 2
    if row.get("count"):
        return len(item)
    if "inverse_of" in row:
        return row["inverse_of"] / item
    return item ** row.get("power", 1)


@pytest.mark.parametrize(("row", "used"), CASES)
def test_a_printed_number_is_used(built_fmus: BuiltFmus, row: dict[str, Any], used: str) -> None:
    expected = row["value"] * (1.0 if row.get("unit_ignored") else factor(row["unit"])) * row.get("factor", 1.0)
    found = values(used, built_fmus)
    assert found, f"nothing at {used}"
    for value, its_unit in found:
        used_value = value_of(row, value) * factor(its_unit)
        assert math.isclose(used_value, expected, rel_tol=row.get("relative", 1e-12)), (used_value, expected)


@pytest.mark.parametrize("paper", PAPERS)
def test_each_number_is_used_or_has_a_reason(paper: str) -> None:
    rows = printed(paper)
    for row in rows:
        assert bool(row.get("used")) != bool(row.get("unused")), row
    places = [(r["place"], r["what"], r.get("reading")) for r in rows]
    assert len(places) == len(set(places))


def test_the_page_is_up_to_date() -> None:
    page = runpy.run_path(str(ROOT / "docs" / "write_printed.py"))["page"]()
    written = (ROOT / "docs" / "reference" / "printed-numbers.md").read_text(encoding="utf-8")
    assert written == page, "run `python docs/write_printed.py` and commit docs/reference/printed-numbers.md"
