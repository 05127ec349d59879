"""A report that can be made can be written: mistakes are refused where they are made, by name."""

import numpy as np
import pytest

from cosim.report import Claim, Figure, Panel, Parameter, Report, Section, Series, Table


def series(name="a", **fields):
    return Series(name, [0, 1], [0, 1], **fields)


def panel(*curves, **fields):
    return Panel(**{"title": "", "x_label": "time [s]", "y_label": "pitch [deg]", **fields, "series": curves})


def figure(identifier="f", *curves):
    return Figure(identifier, "Title", "", [panel(*(curves or [series()]))])


def claim(**fields):
    return Claim(**{"id": "c", "claim": "it", "published": "1", "ours": "1", "verdict": "reproduced", **fields})


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: claim(verdict="not reproduced"), "claim 'c' has verdict 'not reproduced'; say why"),
        (lambda: claim(verdict="not reproduced", reason="  "), "say why"),
        (lambda: claim(verdict="partly"), "verdict 'partly' is not one of 'reproduced', 'trend"),
        (lambda: claim(verdict="trend reproduced, magnitude differs"), "say why"),
        (lambda: claim(verdict="open"), "has verdict 'open'; say why"),
        (lambda: claim(verdict="does not hold"), "say why"),
        (lambda: claim(ours=""), "says nothing about our result"),
        (lambda: claim(value="1"), "value '1' is not a number"),
        (lambda: claim(id="../c"), "an id names a file"),
        (lambda: claim(published=""), "'published' is empty"),
        (lambda: panel(series(), y_label="pitch"), r"label 'pitch' carries no unit; write 'pitch \[deg\]'"),
        (lambda: panel(series(), x_label="[s]"), "carries no unit"),
        (lambda: panel(series(), x_label="time []"), "carries no unit"),
        (lambda: panel(series(), x_scale="dB"), "x_scale 'dB'"),
        (panel, "has no series"),
        (lambda: panel(title="left"), "panel 'left' has no series"),
        (panel, r"panel 'pitch \[deg\]' has no series"),
        (lambda: panel(series(), series()), "series 'a' appears more than once"),
        (lambda: Series("a", [0, 1], [0]), "series 'a': y has 1 points, x has 2"),
        (lambda: Series("a", [0, 1], [[0, 1]]), "one dimension"),
        (lambda: Series("a", [0, 1], ["x", "y"]), "y is not a list of numbers"),
        (lambda: series(low=[0, 1]), "needs both 'low' and 'high'"),
        (lambda: series(color="pink"), "color 'pink' is not one of"),
        (lambda: series(dash="wavy"), "dash 'wavy'"),
        (lambda: panel(series(mode="bar")), "series 'a' has bars at positions without a name in 'x_names'"),
        (lambda: panel(series(mode="bar"), x_names=["off road"]), "bars at positions without a name"),
        (lambda: panel(series(), x_names=["left", "left"]), "x name 'left' appears more than once"),
        (lambda: Report("e", "T", "", figure=figure(), sections=[Section("S", [], [figure()])]), "figure 'f' appears"),
        (lambda: Figure("F 1", "T", "", [panel(series())]), "figure 'F 1': an id names a file"),
        (lambda: Figure("f", "T", "", []), "has no panels"),
        (lambda: Figure("f", "T", "", [panel(series())], columns=0), "0 columns"),
        (lambda: Table("t", "T", ["a"], [[1], [1, 2]]), "table 't': row 2 has 2 cells for 1 columns"),
        (lambda: Table("t", "T", ["a", "a"], []), "column 'a' appears more than once"),
        (lambda: Table("t", "T", "ab", []), "'columns' is one text"),
        (lambda: Table("t", "T", ["a"], [[object()]]), "neither text nor a number"),
        (lambda: Section("S", paragraphs="text"), "'paragraphs' is one text; give a list"),
        (lambda: Section("S", figures=[panel(series())]), "which is no Figure"),
        (lambda: Parameter("m", 1.0, "kg", ""), "parameter 'm': 'source' is empty"),
        (lambda: Report("e", "T", "", [claim(), claim()]), "claim 'c' appears more than once"),
        (lambda: Report("e", "T", "", [], [Section("S", [], [figure(), figure()])]), "figure 'f' appears more"),
        (lambda: Report("e", "T", "", provenance={"now": {"a": object()}}), "provenance, 'now', 'a'"),
    ],
)
def test_mistakes_are_refused_by_name(make, message):
    with pytest.raises(ValueError, match=message):
        make()


def test_a_name_has_one_look_in_a_report():
    figures = [figure("f", series(color="blue")), figure("g", series(color="green"))]
    with pytest.raises(ValueError, match="series 'a' has color 'blue' in figure 'f' and 'green' in figure 'g'"):
        Report("e", "T", "", sections=[Section("S", [], figures)])


def test_a_series_keeps_its_own_copy():
    y = np.array([0.0, 1.0])
    kept = Series("a", [0, 1], y)
    y[0] = 9.0
    assert np.asarray(kept.y)[0] == 0.0
    assert not kept.y.flags.writeable


def test_numpy_scalars_become_numbers():
    table = Table("t", "T", ["a", "b"], [[np.float64(0.5), np.int64(3)]])
    assert [type(cell) for cell in table.rows[0]] == [float, int]


@pytest.mark.parametrize("part", ["paragraphs", "figures", "tables", "animations"])
def test_a_section_names_what_does_not_belong_to_it(part):
    with pytest.raises(ValueError, match=f"section 'S': '{part}' holds 1"):
        Section("S", **{part: [1]})
