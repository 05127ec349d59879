"""The documentation site as readers have it.

In Chromium at two widths and in both color schemes, from a folder, without a network.

`make test-pages` runs these; see `browsers`.
"""

from __future__ import annotations

import runpy
from pathlib import Path
from typing import Any

import pytest
from browsers import looked_at
from built import FMUS, BuiltFmus
from pages import ROOT

pytestmark = pytest.mark.pages
SCRIPT = Path(__file__).with_name("browse.mjs")
PAGES = (
    "index",
    "tutorials/first-component",
    "results",
    "claims",
    "reference/compatibility",
    "reports",
    "how-to/live",
    "fmus/index",
    "fmus/FullCarHmmwv",
    "python/cosim",
    "explanation/architecture",
    "how-to/sweeps",
)
"""One of every kind."""


@pytest.fixture(scope="module")
def found(built_fmus: BuiltFmus, tmp_path_factory: pytest.TempPathFactory) -> dict[str, Any]:  # noqa: ARG001
    """What was seen of the pages of a whole site, with the reports and live pages that there are."""
    place = tmp_path_factory.mktemp("site")
    runpy.run_path(str(ROOT / "docs" / "write_site.py"))["build"](
        FMUS, ROOT / "results", ROOT / "build" / "live", place
    )
    pictures = tmp_path_factory.mktemp("pictures")
    seen: dict[str, Any] = looked_at(SCRIPT, pictures, *(place / "html" / f"{page}.html" for page in PAGES))
    return seen


def test_everyone_can_read_it(found: dict[str, Any]) -> None:
    assert len(found["views"]) == 4 * len(PAGES)
    assert [v for v in found["views"] if v["harms"]] == []


def test_it_says_and_asks_nothing_and_fits(found: dict[str, Any]) -> None:
    assert [(v["page"], v["errors"], v["asked"]) for v in found["views"] if v["errors"] or v["asked"]] == []
    assert [(v["page"], v["width"], v["overflow"]) for v in found["views"] if v["overflow"] > 0] == []
    assert len({(v["scheme"], v["dark"]) for v in found["views"]}) == 2  # it follows the colors that are asked for


def test_the_start_page_fits_three_screens_of_a_phone(found: dict[str, Any]) -> None:
    assert 1 < found["screens"] <= 3


def test_search_needs_no_network(found: dict[str, Any]) -> None:
    assert found["hits"]
    assert all(hit.startswith("file:") for hit in found["hits"])


def test_the_table_of_claims_is_narrowed_down(found: dict[str, Any]) -> None:
    narrowed = found["narrowed"]
    assert narrowed["paper"] == [row for row in narrowed["all"] if row[0] == "003"]
    assert narrowed["both"] == [row for row in narrowed["paper"] if row[1] == "not reproduced"] != []
    assert narrowed["said"] == f"{len(narrowed['both'])} of {len(narrowed['all'])} claims"
