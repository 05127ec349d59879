"""The picture of the exchange rule: what it shows is what a run does, and what the text says."""

from __future__ import annotations

import runpy
from itertools import pairwise
from pathlib import Path
from typing import Any

import pytest
from lxml import etree

IMAGES = Path(__file__).parents[2] / "docs" / "images"


@pytest.fixture(scope="module")
def drawing() -> dict[str, Any]:
    return runpy.run_path(str(IMAGES / "draw_exchange.py"))


def test_the_picture_is_of_a_run(drawing: dict[str, Any], tmp_path: Path) -> None:
    drawing["draw"](tmp_path / "exchange.svg")
    assert (tmp_path / "exchange.svg").read_bytes() == (IMAGES / "exchange.svg").read_bytes()


@pytest.mark.parametrize("group", [False, True])
def test_who_reads_what(drawing: dict[str, Any], group: bool) -> None:
    """At each instant discrete components in the order of the chain, with what counts at that instant.

    Then continuous ones, which hold what they read, and see each other as of the beginning of the step, or in a group
    what the one before has reached.
    """
    samples = {t: [("filter", t, "car", t), ("law", t, "filter", t)] for t in (0, 2, 4)}
    steps = {t: [("actuator", t, "law", t - t % 2), ("car", t, "actuator", t + group)] for t in range(4)}
    expected = [read for t in range(5) for read in (*samples.get(t, ()), *steps.get(t, ()))]
    assert [(r.reader, r.time, r.source, r.of) for r in drawing["reads"](group=group)] == expected


def test_arrows_go_from_where_a_value_is_of_to_where_it_is_read(drawing: dict[str, Any]) -> None:
    """With a color for its age, and the same in words for those who do not see it."""
    root = etree.parse(IMAGES / "exchange.svg").getroot()
    panels = root.findall("{*}g")
    assert [p.findtext("{*}text") for p in panels] == list(drawing["TITLES"].values())
    for group, panel in zip((False, True), panels, strict=True):
        arrows = [p for p in panel.findall("{*}path") if p.get("marker-end")]
        reads = drawing["reads"](group=group)
        assert [a.findtext("{*}title") for a in arrows] == [
            f"{r.reader} at {float(r.time):g} ms reads {r.source} of {float(r.of):g} ms" for r in reads
        ]
        for arrow, read in zip(arrows, reads, strict=True):
            begin, end = arrow.get("d").removeprefix("M").split(" L")
            x, to = float(begin.split()[0]), float(end.split()[0])
            assert to - x == pytest.approx(drawing["PER_MS"] * float(read.time - read.of))
            assert (
                arrow.get("stroke")
                == drawing["COLORS"]["same" if read.of == read.time else "held" if read.of < read.time else "ahead"]
            )


def test_rows_are_in_the_order_of_the_chain(drawing: dict[str, Any]) -> None:
    places = [drawing["_y"](name) for name in ("filter", "law", "actuator", "car")]
    assert all(lower - upper == drawing["ROW"] for upper, lower in pairwise(places))
