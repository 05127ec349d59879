"""Curves, bars and tables from rows of numbers, with answers by hand."""

import numpy as np

from cosim.report import Distribution, Figure, Panel, Report, Section, Series, Table, bars, curve, level, over_time

RUN = {"time": [0.0, 1.0, 2.0, 3.0], "x": [0.0, 10.0, 20.0, 30.0], "z": [0.001, 0.002, 0.003, 0.004]}


def points(series):
    return [*series.x], [*series.y]


def test_a_curve_is_a_signal_in_the_unit_of_its_axis():
    drawn = curve("body", RUN, "z", 1e3, color="blue", mode="markers")
    assert points(drawn) == ([0.0, 1.0, 2.0, 3.0], [1.0, 2.0, 3.0, 4.0])
    assert (drawn.name, drawn.color, drawn.dash, drawn.mode) == ("body", "blue", None, "markers")
    assert points(curve("body", RUN, "z", x="x")) == ([0.0, 10.0, 20.0, 30.0], RUN["z"])


def test_a_part_of_a_curve_has_its_ends():
    assert points(curve("body", RUN, "z", start=1.0, end=2.0)) == ([1.0, 2.0], [0.002, 0.003])
    assert points(curve("body", RUN, "z", x="x", end=5.0)) == ([0.0], [0.001])


def test_a_curve_that_is_thinned_keeps_its_peaks():
    long = {"time": np.arange(5000.0), "z": np.where(np.arange(5000) == 3333, 9.0, 0.0)}
    assert len(curve("body", long, "z").x) == 5000
    thinned = curve("body", long, "z", thin=True)
    assert len(thinned.x) <= 2000
    assert thinned.x[np.argmax(thinned.y)] == 3333


def test_a_level_has_the_extent_of_what_it_is_drawn_over():
    limit = level("limit", [5.0, 2.0, 9.0], 6.0, color="black")
    assert (points(limit), limit.color) == (([2.0, 9.0], [6.0, 6.0]), "black")


def test_signals_over_time_leave_out_runs_that_lack_them():
    runs = {"passive": RUN, "active": {**RUN, "force": [0.0, 1e3, 2e3, 3e3]}}
    body, force = over_time(runs, [("Body", "z [mm]", "z", 1e3), ("Force", "force [kN]", "force", 1e-3)])
    assert (body.title, body.x_label, body.y_label) == ("Body", "time [s]", "z [mm]")
    assert [s.name for s in body.series] == ["passive", "active"]
    assert [(s.name, [*s.y]) for s in force.series] == [("active", [0.0, 1.0, 2.0, 3.0])]


def test_bars_are_numbers_or_distributions():
    spread = [Distribution([1.0, 2.0, 9.0]), Distribution([4.0, 5.0, 6.0])]
    panel = bars("road [?]", "power [W]", ["track", "bump"], {"LQR": [3.0, 4.0], "MPC": spread})
    lqr, mpc = panel.series
    assert (panel.x_label, panel.y_label, panel.x_names) == ("road [?]", "power [W]", ("track", "bump"))
    assert (points(lqr), lqr.low, lqr.mode) == (([0.0, 1.0], [3.0, 4.0]), None, "bar")
    assert (points(mpc), [*mpc.low], [*mpc.high]) == (([0.0, 1.0], [2.0, 5.0]), [1.0, 4.0], [9.0, 6.0])


def test_a_table_of_rows_by_heading(raises):
    table = Table.of("t", "T", ({"n": n, "n2 [-]": n * n} for n in (1, 2)), "Squares.")
    assert (table.columns, table.rows, table.caption) == (("n", "n2 [-]"), ((1, 1), (2, 4)), "Squares.")
    for rows in ([{"n": 1}, {"m": 2}], [{"n": 1, "m": 1}, {"n": 1}], []):
        with raises(ValueError):
            Table.of("t", "T", rows)


def test_looks_belong_to_the_names_of_series(raises):
    def figure(id_, *series):
        return Figure(id_, "Title", "", [Panel("", "time [s]", "pitch [deg]", series)])

    first, other = Series("a", [0], [0]), Series("b", [0], [0], dash="dot")
    report = Report(
        "e",
        "T",
        "",
        figure=figure("f", first, Series("c", [0], [0], color="black")),
        sections=[Section("S", figures=[figure("g", other, first)])],
        looks={"a": ("green", "dash"), "b": "blue", "c": "sky"},
    )
    assert [(s.name, s.color, s.dash) for f in report.drawn for s in f.panels[0].series] == [
        ("a", "green", "dash"),
        ("c", "black", None),
        ("b", "blue", "dot"),
        ("a", "green", "dash"),
    ]
    with raises(ValueError):
        Report("e", "T", "", figure=figure("f", first), looks={"a": "pink"})
