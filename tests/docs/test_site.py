"""The documentation site.

Every page has its place, every link leads somewhere, and nothing is fetched from elsewhere.
"""

from __future__ import annotations

import json
import re
import runpy
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
import yaml
from built import FMUS, BuiltFmus
from lxml import html
from mkdocs.exceptions import Abort
from pages import PAGES, ROOT

from cosim.experiments import EXPERIMENTS
from cosim.experiments.live_pages import shown
from fmu_sources.catalog import default_catalog

WRITE = runpy.run_path(str(ROOT / "docs" / "write_site.py"))


@pytest.fixture(scope="module")
def site(built_fmus: BuiltFmus, tmp_path_factory: pytest.TempPathFactory) -> Path:  # noqa: ARG001
    """The whole site, with one report."""
    results, place = tmp_path_factory.mktemp("results"), tmp_path_factory.mktemp("site")
    (results / "bench").mkdir()
    (results / "bench" / "report.html").write_text("<title>A quarter car</title>")
    live = tmp_path_factory.mktemp("live")
    (live / "hmmwv.html").write_text('<title>Drive it</title>\n<meta name="description" content="A car, live.">')
    WRITE["build"](FMUS, results, live, place)
    return place / "html"


def test_every_page_has_a_place() -> None:
    """And its links to files lead somewhere, or there was an error."""
    texts, files = WRITE["gather"](FMUS, ROOT / "results", ROOT / "build" / "live", lambda name, text: (name, text))
    nav = yaml.load((ROOT / "docs" / "mkdocs.yml").read_text(), _Loader)["nav"]
    listed = [*_leaves(WRITE["_filled"](nav, list(texts)))]
    assert len(listed) == len(set(listed))
    assert set(listed) == {p for p in texts if p.endswith(".md") and not p.startswith("sources/")}
    assert "images/system.svg" in files


class _Loader(yaml.SafeLoader):
    """Functions that are named in the file are none of ours."""


_Loader.add_multi_constructor("tag:yaml.org,2002:python/", lambda *_: None)


def _leaves(entry: Any) -> Iterator[str]:
    if isinstance(entry, str):
        yield entry
    else:
        for part in entry.values() if isinstance(entry, dict) else entry:
            yield from _leaves(part)


def test_live_pages_are_shown_and_copied(tmp_path: Path) -> None:
    (tmp_path / "a.html").write_text(
        '<title>Drive &amp; see</title>\n<meta name="description" content="A car,\nlive.">'
    )
    files: dict[str, Path] = {}
    cards = WRITE["live_cards"](tmp_path, files)
    assert (
        cards == '<div class="cards">\n<a class="card" href="../live/a.html"><b>Drive &amp; see</b> <span>A'
        " car,\nlive.</span></a>\n</div>"
    )
    assert files == {"live/a.html": tmp_path / "a.html"}
    assert WRITE["with_cards"]("# Live\n\nText.\n", cards, "Here:") == f"# Live\n\nHere:\n\n{cards}\n\nText.\n"
    assert WRITE["live_cards"](tmp_path / "none", {}) == ""
    assert WRITE["with_cards"]("# Live\n", "", "Here:") == "# Live\n"


def test_the_start_page_is_the_beginning_of_the_readme() -> None:
    readme = (ROOT / "README.md").read_text(encoding="utf-8")
    pages = WRITE["start_pages"](readme)
    start, about = pages["index.md"], pages["about.md"]
    assert len(start.splitlines()) < 80
    assert [line for line in readme.splitlines() if line.startswith("#")] == [
        line for line in (start + about).splitlines() if line.startswith("#") and line != about.splitlines()[0]
    ]
    assert WRITE["start_pages"]("# A\n") == {"index.md": "# A\n"}


def test_there_is_a_picture_of_every_live_page_and_report() -> None:
    """In both schemes of colors and at both widths, and none of what there is no more."""
    pictures = WRITE["PICTURES"]
    expected = {job["out"] for job in pictures["jobs"](ROOT, ROOT)}
    assert len(expected) == 4 * len(shown()) + len(EXPERIMENTS)
    assert {p for folder in ("live", "reports") for p in (ROOT / "docs" / "images" / folder).iterdir()} == expected
    assert all(p.read_bytes().startswith(b"\xff\xd8") and p.stat().st_size < 250_000 for p in expected)


@pytest.mark.full
def test_every_page_of_the_repository_is_there(site: Path) -> None:
    for page in PAGES:
        assert (site / WRITE["_place"](page.relative_to(ROOT).as_posix()).replace(".md", ".html")).is_file(), page
    assert {p.stem for p in (site / "fmus").glob("*.html")} == {"index", *default_catalog()}
    listed = html.parse(site / "fmus" / "index.html").findall(".//article//td/a")
    assert [a.get("href") for a in listed] == [f"{n}.html" for n in default_catalog()]


@pytest.mark.full
def test_nothing_is_fetched_from_elsewhere(site: Path) -> None:
    for page in site.rglob("*.html"):
        tree = html.parse(page)
        fetched = [
            *tree.xpath("//script/@src | //img/@src | //iframe/@src"),
            *tree.xpath("//link[@rel='stylesheet' or @rel='preload']/@href"),
        ]
        assert fetched or page.parent.name in ("reports", "live")  # which hold all they need
        for target in fetched:
            assert "//" not in target, f"{page.name}: {target}"
            assert (page.parent / re.split("[?#]", target)[0]).resolve().is_file() or "search/" in target, (
                f"{page.name}: {target}"
            )
        assert not tree.xpath("//*[@role='dialog' and not(@aria-label)]"), page.name


@pytest.mark.full
def test_search_knows_fmus_and_functions(site: Path) -> None:
    found = json.loads((site / "search" / "search_index.json").read_text())["docs"]
    places = {d["location"] for d in found}
    assert {"fmus/MpcHmmwv.html", "python/cosim.html#cosim.System.run"} <= places
    assert [d["location"] for d in found if "own controller" in d["title"].lower()] == [
        "how-to/controller-in-python.html"
    ]


@pytest.mark.full
def test_tutorials_were_run(site: Path) -> None:
    for name in WRITE["NOTEBOOKS"]:
        book = json.loads((site / f"{name}.ipynb").read_text())
        printed = [
            "".join(o["text"])
            for c in book["cells"]
            if c["cell_type"] == "code"
            for o in c["outputs"]
            if o.get("name") == "stdout"
        ]
        assert printed
        shown = [code.text_content().strip() for code in html.parse(site / f"{name}.html").getroot().find_class("out")]
        assert shown == [text.strip() for text in printed]
    page = (site / "tutorials" / "first-component.html").read_text()
    assert re.search(r"body moves 0\.1\d\d m on a road of 0\.040 m", page)


@pytest.mark.full
def test_reports_are_brought_along(site: Path) -> None:
    (link,) = html.parse(site / "reports.html").findall(".//article//a[@class='card']")
    assert (link.findtext("b"), link.get("href"), link.find("img").get("src")) == (
        "A quarter car",
        "reports/bench.html",
        "images/reports/bench.jpg",
    )
    assert (site / "images" / "reports" / "bench.jpg").is_file()
    assert (site / "reports" / "bench.html").read_text() == "<title>A quarter car</title>"


@pytest.mark.full
def test_links_to_files_lead_to_copies_of_them(site: Path) -> None:
    shown = html.parse(site / "sources" / "fmu_sources" / "plants" / "quarter_car.py.html").find(".//article//code")
    assert shown.text_content().strip() == (ROOT / "fmu_sources" / "plants" / "quarter_car.py").read_text().strip()


def test_a_link_that_leads_nowhere_is_an_error(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, raises) -> None:
    page = tmp_path / "docs"
    page.mkdir()
    pages = WRITE["Pages"]()
    with raises(FileNotFoundError):
        pages.add("docs/tutorials/a.md", "See [this](../gone.py).\n")
    texts: dict[str, Any] = {"index.md": "# A\n", "orphan.md": "# B\n"}
    monkeypatch.setitem(WRITE["build"].__globals__, "gather", lambda *_: (texts, {}))
    with pytest.raises(Abort):
        WRITE["build"](FMUS, tmp_path, tmp_path, tmp_path / "site")


def test_code_is_left_as_it_is() -> None:
    pages = WRITE["Pages"]()
    code = "```python\nnames[0](of.py)\n```\n"
    pages.add("docs/how-to/ssp.md", f"[a](../../README.md#run-it), [b](https://example.org/x)\n{code}")
    assert pages.texts["how-to/ssp.md"] == f"[a](../index.md#run-it), [b](https://example.org/x)\n{code}"
