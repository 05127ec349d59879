"""Reports as readers have them: in Chromium at two widths and in both color schemes, their downloads, and on paper.

`make test-pages` runs these. They need Node.js with npm, and Chromium (`CHROMIUM` names another one); what is
missing is said.
"""

from __future__ import annotations

import csv
import re
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest
from browsers import looked_at

from cosim.report import (
    Animation,
    Claim,
    Figure,
    Layer,
    Map,
    Panel,
    Playback,
    Section,
    Series,
    Table,
    Take,
    write_report,
)
from cosim.scenes.scene import Arrow, Body, Face, Reading, Relief, Scene

pytestmark = pytest.mark.pages

LOOK = Path(__file__).with_name("look.mjs")
ROOT = Path(__file__).parents[2]
REPORTS = sorted((ROOT / "results").glob("*/report.html"))
LONG = "MPC with preview, weight on the moves, estimated states, sensed road"
SVG = "{http://www.w3.org/2000/svg}"


@pytest.fixture(scope="session")
def look(tmp_path_factory):
    """Calls look.mjs on a page."""

    def run(page: Path) -> dict:
        folder = tmp_path_factory.mktemp("look")
        return {**looked_at(LOOK, page, folder), "folder": folder}

    return run


def every_kind(make_report):
    """One of each thing that a report may have, with names as long as they come."""
    t = np.linspace(0.0, 2.0, 201)
    curves = Figure(
        "curves",
        "Curves",
        "Caption.",
        [
            Panel(
                f"panel {k}",
                "time [s]",
                "force, on the left side [kN]",
                [Series("passive", t, np.sin(t + k)), Series(LONG, t, 1e4 * np.cos(t)), Series(f"{LONG}, other", t, t)],
            )
            for k in range(4)
        ],
        columns=2,
    )
    grid = Map(
        "map",
        "Map",
        "Caption.",
        "length [m]",
        "speed [km/h]",
        "cost [-]",
        [1.0, 2.0, 3.0],
        [10.0, 20.0],
        [Layer("a", np.arange(6.0).reshape(2, 3)), Layer("b", np.arange(6.0).reshape(2, 3) / 2)],
        reference=2.2,
    )
    wide = Table(
        "wide",
        "Wide",
        [f"a quantity with a name, number {i} [m/s2]" for i in range(14)],
        [[k / 3 + i for i in range(14)] for k in range(3)],
    )
    looks = Scene(
        "body",
        [Body("body", [Face([(-1, 0, 0), (1, 0, 0), (1, 0, 1)])], x="car.x", z=1.0)],
        "body",
        9.0,
        1e5,
        arrows=[Arrow("f", "ground", "car.f", on="body"), Arrow("b", "body", 1e3, on="body")],
        readings=[Reading("pitch", "deg", "car.x")],
        reliefs=[Relief([(0.0, 0.0)])],
    )
    scene = Playback("passive", 0.01, looks, {"car.x": t, "car.f": 1e4 * np.sin(t) ** 2}, outcome="crosses")
    base = make_report()
    claims = [
        *base.claims,
        Claim(
            "near",
            "It is near",
            "10 %",
            "",
            "trend reproduced, magnitude differs",
            "r " * 80,
            "Table 1",
            12.0,
            "%",
            "within 1 %",
            "the mass",
        ),
        Claim("unknown", "It is not known", "many", "few", "open", "too few runs"),
        Claim("own", "It adds up", "0", "0", "holds"),
    ]
    more = Section(
        "More", ["Text."], [curves, grid], [wide], [Animation("motion", "Motion", "Caption.", [Take("t", [scene])])]
    )
    return make_report(claims=claims, sections=[*base.sections, more])


@pytest.fixture(scope="session")
def pages(look):
    """What was seen of a page, looked at once."""
    kept: dict[Path, dict] = {}
    return lambda page: kept[page] if page in kept else kept.setdefault(page, look(page))


@pytest.fixture(scope="session")
def folder(tmp_path_factory):
    return tmp_path_factory.mktemp("page")


@pytest.fixture
def page(folder, make_report):
    return (
        folder / "report.html" if (folder / "report.html").exists() else write_report(every_kind(make_report), folder)
    )


@pytest.fixture
def seen(page, pages):
    return pages(page)


def harms(found):
    return [
        (v["width"], v["scheme"], x)
        for v in found["views"]
        for x in v["violations"]
        if x["impact"] in ("serious", "critical")
    ]


def test_axe_finds_nothing_serious_and_the_page_no_error(seen):
    assert len(seen["views"]) == 4
    assert harms(seen) == []
    assert seen["errors"] == []


def test_nothing_is_clipped(seen):
    for view in seen["views"]:
        assert view["overflow"] <= 0, view["width"]
        assert view["figures"]
        for figure in view["figures"]:
            assert (figure["clipped"], figure["covered"]) == ([], False), (view["width"], figure["id"])
    names = [
        "".join(f["names"]).replace(" ", "") for f in seen["views"][0]["figures"]
    ]  # lines that were broken lose the space
    assert any(LONG.replace(" ", "") in n for n in names)


def test_figures_follow_the_colors_of_the_page(seen):
    """rgb(...) of the page and of the paper below the curves."""
    for view in seen["views"]:
        assert (view["page"] == "rgb(255, 255, 255)") == (view["scheme"] == "light")
        for figure in view["figures"]:
            assert figure["paper"].startswith(view["page"])


def test_the_readers_choice_is_kept(seen):
    """A light system, the button pressed, and the page read again."""
    dark = next(v["page"] for v in seen["views"] if v["scheme"] == "dark")
    assert seen["chosen"]["page"] == seen["kept"] == dark
    assert all(f["paper"].startswith(dark) for f in seen["chosen"]["figures"])


def rows(path):
    with path.open(newline="", encoding="utf-8") as file:
        return list(csv.reader(file))


def test_csv_out_of_the_page_is_the_file_beside_it(seen, folder):
    """Figures to the seven digits that the page has, tables to the last byte."""
    files = {p.name: p for p in map(Path, seen["files"])}
    for beside in (*folder.glob("figures/*.csv"), *folder.glob("tables/*.csv")):
        if beside.parent.name == "tables":
            assert files[beside.name].read_bytes() == beside.read_bytes()
            continue
        (header, *got), (expected_header, *expected) = rows(files[beside.name]), rows(beside)
        assert header == expected_header
        assert [[c == "" for c in row] for row in got] == [[c == "" for c in row] for row in expected]
        numbers = [[float(c or "nan") for row in table for c in row] for table in (got, expected)]
        np.testing.assert_allclose(*numbers, rtol=1.3e-7, atol=0.0)


def test_svg_of_every_figure_has_its_curves_and_names(seen):
    drawings = {p.stem: p for p in map(Path, seen["files"]) if p.suffix == ".svg"}
    assert set(drawings) == {"histories", "speeds", "curves", "map"}
    for name, path in drawings.items():
        root = ElementTree.parse(path).getroot()
        assert root.tag == f"{SVG}svg"
        assert not list(root.iter(f"{SVG}image"))
        assert len([e for e in root.iter(f"{SVG}path") if e.get("d")]) > 3, name
    text = " ".join(ElementTree.parse(drawings["curves"]).getroot().itertext())
    assert all(words in text for words in ("time [s]", "panel 3", "passive", LONG))


def test_on_paper_figures_are_vectors_on_white_and_within_the_page(seen):
    pdf = (seen["folder"] / "page.pdf").read_bytes()
    images = len(re.findall(rb"/Subtype\s*/Image", pdf))
    assert images <= 2 * 2  # canvases of the animation: its picture and its track, each with a mask at most
    assert 3 <= len(re.findall(rb"/Type\s*/Page\b", pdf)) <= 14


@pytest.mark.parametrize("report", REPORTS, ids=lambda p: p.parent.name)
def test_reports_that_studies_have_left(report, pages):
    found = pages(report)
    assert harms(found) == []
    assert found["errors"] == []
    clipped = [
        (v["width"], v["scheme"], f["id"], f["clipped"])
        for v in found["views"]
        for f in v["figures"]
        if f["clipped"] or f["covered"]
    ]
    assert clipped == []
    assert [v["overflow"] for v in found["views"]] == [0] * 4
