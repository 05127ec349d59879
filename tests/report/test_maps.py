"""Maps: mistakes, values on the page and in the CSV file."""

from __future__ import annotations

import csv
import json

import numpy as np
import pytest
from packed import packed_texts

from cosim.report import Layer, Map, Report, Section, maps, write_report

X, Y = (1.0, 2.0, 3.0), (10.0, 20.0)
LOW, HIGH = np.arange(6.0).reshape(2, 3), 10 + np.arange(6.0).reshape(2, 3)


def made(**changes) -> Map:
    parts = {
        "id": "cost",
        "title": "Cost",
        "caption": "",
        "x_label": "length [m]",
        "y_label": "speed [km/h]",
        "value_label": "cost [-]",
        "x": X,
        "y": Y,
        "layers": [Layer("a <b>", LOW), Layer("c", HIGH)],
    }
    return Map(**parts | changes)


@pytest.mark.parametrize(
    "make",
    [
        lambda: Layer("a", [1.0, 2.0]),
        lambda: Layer("a", [[1.0, np.nan]]),
        lambda: made(layers=[]),
        lambda: made(layers=[Layer("a", LOW.T)]),
        lambda: made(layers=[Layer("a", LOW), Layer("a", HIGH)]),
        lambda: made(x_label="length"),
        lambda: made(x=[[1.0, 2.0]]),
        lambda: made(y=[[1.0, 2.0]]),
        lambda: made(value_range=(0.0, 14.0)),
        lambda: made(reference=16.0, value_range=(0.0, 15.0)),
        lambda: made(x_names=["a", "b"], y_names=["c", "d"]),
        lambda: made(x_names=["a", "b", "b"], y_names=["c", "d"]),
        lambda: made(x_names=["a", "b", "c"]),
    ],
)
def test_refuses(make, raises):
    with raises(ValueError):
        make()


def test_page_has_the_layers_on_one_scale_and_the_reference_as_a_line(tmp_path):
    report = Report("demo", "Demo", "Lead.", sections=[Section("Maps", figures=[made(reference=7.0)])])
    text = write_report(report, tmp_path).read_text(encoding="utf-8")
    data = json.loads(packed_texts(text)["data-cost"])["data"]
    filled, lines = data[::2], data[1::2]
    assert [(t["zmin"], t["zmax"]) for t in filled] == [(0.0, 15.0)] * 2
    assert [(t["contours"]["start"], t["contours"]["end"], t["contours"]["coloring"]) for t in lines] == [
        (7.0, 7.0, "lines")
    ] * 2
    assert [(t.get("xaxis"), t["z"]) for t in lines] == [(t.get("xaxis"), t["z"]) for t in filled]
    assert data[0]["name"] == "a &lt;b&gt;"
    with (tmp_path / "figures" / "cost.csv").open() as file:
        rows = list(csv.reader(file))
    assert rows[0] == ["length [m]", "speed [km/h]", "a <b>: cost [-]", "c: cost [-]"]
    assert [float(v) for v in rows[5]] == [2.0, 20.0, 4.0, 14.0]


def plotted(figure: Map, *, narrow: bool = False) -> dict:
    return maps.map_plot(figure, narrow=narrow)


def test_names_make_a_grid_with_the_first_at_the_top() -> None:
    made_of = plotted(made(x_names=["a", "b", "c"], y_names=["d", "e"]))
    first = made_of["data"][0]
    assert (first["type"], list(first["x"]), list(first["y"])) == ("heatmap", ["a", "b", "c"], ["d", "e"])
    assert made_of["layout"]["yaxis"]["autorange"] == "reversed"
    assert {t["type"] for t in plotted(made())["data"]} == {"contour"}


def test_contours_have_a_dozen_steps_and_one_bar_of_colors() -> None:
    """Twelve between the lowest and the highest of all layers; the bar stands at the right of the last one."""
    data = plotted(made())["data"]
    assert [(t["contours"]["start"], t["contours"]["end"], t["contours"]["size"]) for t in data] == [
        (0.0, 15.0, 1.25)
    ] * 2
    assert [t["showscale"] for t in data] == [False, True]


def test_maps_that_are_compared_have_one_scale() -> None:
    data = plotted(made(value_range=(-5.0, 19.0)))["data"]
    assert [(t["zmin"], t["zmax"], t["contours"]["size"]) for t in data] == [(-5.0, 19.0, 2.0)] * 2


def test_panels_lie_within_the_page():
    """Side by side where it is wide, one below the other where it is narrow.

    Below them is more room than above: axes have titles there.
    """
    figure = made(layers=[Layer(name, LOW) for name in "abc"])
    wide, narrow = (plotted(figure, narrow=n)["layout"] for n in (False, True))
    across = [wide[f"xaxis{i}"]["domain"] for i in ("", 2, 3)]
    down = [narrow[f"yaxis{i}"]["domain"] for i in ("", 2, 3)]
    for domains in (across, down[::-1]):
        edges = [edge for domain in domains for edge in domain]
        assert edges == sorted(edges)
        assert (edges[0], edges[-1]) == (pytest.approx(0.0, abs=1e-9), pytest.approx(1.0))
        sizes = [high - low for low, high in domains]
        assert sizes == pytest.approx([sizes[0]] * 3)
        assert sizes[0] > 0.15
    assert wide["margin"]["b"] > wide["margin"]["t"]


def test_values_of_a_layer_cannot_be_changed():
    with pytest.raises(ValueError, match="read-only"):
        Layer("a", [[1.0, 2.0]]).values[0, 0] = 3.0
