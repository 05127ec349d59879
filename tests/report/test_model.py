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
    return Claim(**{"id": "c", "claim": "it", "published": "1", "result": "1", "verdict": "reproduced", **fields})


@pytest.mark.parametrize(
    "make",
    [
        lambda: claim(verdict="not reproduced"),
        lambda: claim(verdict="not reproduced", reason="  "),
        lambda: claim(verdict="partly"),
        lambda: claim(verdict="trend reproduced, magnitude differs"),
        lambda: claim(verdict="open"),
        lambda: claim(verdict="does not hold"),
        lambda: claim(result=""),
        lambda: claim(value="1"),
        lambda: claim(id="../c"),
        lambda: claim(published=""),
        lambda: panel(series(), y_label="pitch"),
        lambda: panel(series(), x_label="[s]"),
        lambda: panel(series(), x_label="time []"),
        lambda: panel(series(), x_scale="dB"),
        panel,
        lambda: panel(title="left"),
        lambda: panel(series(), series()),
        lambda: Series("a", [0, 1], [0]),
        lambda: Series("a", [0, 1], [[0, 1]]),
        lambda: Series("a", [0, 1], ["x", "y"]),
        lambda: series(low=[0, 1]),
        lambda: series(color="pink"),
        lambda: series(dash="wavy"),
        lambda: panel(series(mode="bar")),
        lambda: panel(series(mode="bar"), x_names=["off road"]),
        lambda: panel(series(), x_names=["left", "left"]),
        lambda: Report("e", "T", "", figure=figure(), sections=[Section("S", [], [figure()])]),
        lambda: Figure("F 1", "T", "", [panel(series())]),
        lambda: Figure("f", "T", "", []),
        lambda: Figure("f", "T", "", [panel(series())], columns=0),
        lambda: Table("t", "T", ["a"], [[1], [1, 2]]),
        lambda: Table("t", "T", ["a", "a"], []),
        lambda: Table("t", "T", "ab", []),
        lambda: Table("t", "T", ["a"], [[object()]]),
        lambda: Section("S", paragraphs="text"),
        lambda: Section("S", figures=[panel(series())]),
        lambda: Parameter("m", 1.0, "kg", ""),
        lambda: Report("e", "T", "", [claim(), claim()]),
        lambda: Report("e", "T", "", [], [Section("S", [], [figure(), figure()])]),
        lambda: Report("e", "T", "", provenance={"now": {"a": object()}}),
    ],
)
def test_mistakes_are_refused_by_name(make, raises):
    with raises(ValueError):
        make()


def test_a_name_has_one_look_in_a_report(raises):
    figures = [figure("f", series(color="blue")), figure("g", series(color="green"))]
    with raises(ValueError):
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
