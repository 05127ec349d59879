"""Figures of reports: curves, panels, colors and legends in Plotly."""

import itertools
import re

import numpy as np

from cosim.report import Figure, Palette, Panel, Section, Series, plotly_figure
from cosim.report.maps import INK
from cosim.report.plots import (
    COLORS,
    GRID,
    LEGEND_ROW,
    MUTED,
    PAPER,
    RULE,
    _legend_height,
    dark_colors,
    placed_columns,
    series_columns,
)


def one_panel(*names):
    return Figure("f", "F", "", [Panel("", "time [s]", "force [N]", [Series(n, [0, 1], [0, 1]) for n in names])])


def test_a_name_looks_the_same_in_every_figure(make_report):
    report = make_report()
    palette = Palette(report.figures)
    looks = {}
    for figure in report.figures:
        for trace in plotly_figure(figure, palette).data:
            if trace.line.width:
                looks.setdefault(trace.name, set()).add((trace.line.color, trace.line.dash, trace.marker.symbol))
    assert set(looks) == {"passive", "explicit", "preview"}
    assert all(len(look) == 1 for look in looks.values())
    assert palette["passive"].color == COLORS["gray"]


def test_different_names_look_different():
    names = [f"law {i}" for i in range(30)]
    palette = Palette([one_panel(*names)])
    assert all(palette[a] != palette[b] for a, b in itertools.combinations(names, 2))
    assert len({(palette[n].color, palette[n].dash) for n in names}) == len(names)


def test_a_name_that_brings_its_dash_does_not_look_like_another():
    """Figure 3 of paper 004 has "index J, last height held" dashed.

    The colors had come round to a dashed line there.
    """
    for mine in ("dash", "dot"):
        curves = [Series(f"curve {i}", [0, 1], [0, 1]) for i in range(len(COLORS) - 1)]
        curves.insert(len(curves) // 2, Series("held", [0, 1], [0, 1], dash=mine))
        looks = Palette([Figure("f", "F", "", [Panel("", "time [s]", "force [N]", curves)])])
        assert looks["held"].dash == mine
        assert len({(looks[c.name].color, looks[c.name].dash) for c in curves}) == len(curves)
    hinted = [Series(f"h{c}", [0, 1], [0, 1], color=c) for c in ("black", "gray", "orange", "blue", "green")]
    curves = [*hinted, *(Series(n, [0, 1], [0, 1]) for n in "abcd"), Series("held", [0, 1], [0, 1], dash="dash")]
    for swapped in range(5):
        order = curves[swapped:] + curves[:swapped]
        looks = Palette([Figure("f", "F", "", [Panel("", "time [s]", "force [N]", order)])])
        assert len({(looks[c.name].color, looks[c.name].dash) for c in order}) == len(order)


def test_axes_carry_their_units_and_the_legend_each_name_once(make_report):
    figure = plotly_figure(make_report().figures[0])
    assert figure.layout.yaxis.title.text == "pitch [deg]"
    assert figure.layout.yaxis2.title.text == "force [kN]"
    assert figure.layout.xaxis2.title.text == "time [s]"
    assert figure.layout.xaxis2.matches == "x"
    assert [trace.name for trace in figure.data if trace.showlegend] == ["passive", "explicit"]
    assert figure.layout.hovermode == "x unified"
    assert figure.data[0].hovertemplate.endswith(" deg")


def test_panels_over_different_ranges_zoom_apart(make_report):
    figure = plotly_figure(make_report().figures[1])
    assert figure.layout.xaxis2.matches is None


def test_a_narrow_figure_stacks_its_panels(make_report):
    source = make_report().figures[1]
    wide, narrow = plotly_figure(source).layout, plotly_figure(source, narrow=True).layout
    assert wide.xaxis.domain[1] < wide.xaxis2.domain[0]
    assert wide.yaxis.domain == wide.yaxis2.domain
    assert narrow.xaxis.domain == narrow.xaxis2.domain == (0, 1)
    assert narrow.yaxis2.domain[1] < narrow.yaxis.domain[0]
    assert narrow.height > wide.height


def test_panels_lie_inside_the_figure_without_overlap():
    panels = [Panel(f"{i}", "time [s]", "force [N]", [Series("a", [0, 1], [0, 1])]) for i in range(7)]
    for columns in (1, 2, 3, 4):
        layout = plotly_figure(Figure("f", "F", "", panels, columns=columns)).layout
        boxes = [(*layout[f"xaxis{n}"].domain, *layout[f"yaxis{n}"].domain) for n in ["", 2, 3, 4, 5, 6, 7]]
        assert all(0 <= edge <= 1 for box in boxes for edge in box)
        for (l1, r1, b1, t1), (l2, r2, b2, t2) in itertools.combinations(boxes, 2):
            assert r1 < l2 or r2 < l1 or t1 < b2 or t2 < b1


def stacked(*panels, **fields):
    """Layout of a figure of panels, each (x label, x)."""
    made = [Panel("", label, "force [N]", [Series("a", x, np.zeros(len(x)))]) for label, x in panels]
    return plotly_figure(Figure("f", "F", "", made, **fields)).layout


def test_panels_stand_one_below_the_other_unless_columns_are_given():
    two = [("time [s]", [0, 1])] * 2
    assert stacked(*two).xaxis.domain == stacked(*two).xaxis2.domain == (0, 1)
    assert stacked(*two, columns=2).xaxis2.domain[0] > 0.5


def test_an_x_label_stands_once_below_panels_that_share_it():
    """The lowest panel has it; where labels differ each has its own, and the figure is as much taller."""
    shared, apart = stacked(*[("time [s]", [0, 1])] * 2), stacked(("time [s]", [0, 1]), ("speed [km/h]", [0, 1]))
    assert [a.title.text for a in (shared.xaxis, shared.xaxis2)] == [None, "time [s]"]
    assert [a.showticklabels for a in (shared.xaxis, shared.xaxis2)] == [False, True]
    assert [a.title.text for a in (apart.xaxis, apart.xaxis2)] == ["time [s]", "speed [km/h]"]
    assert [a.showticklabels for a in (apart.xaxis, apart.xaxis2)] == [True, True]
    assert apart.height > shared.height
    assert [(a.yaxis2.anchor, a.xaxis2.anchor) for a in (shared, apart)] == [("x2", "y2")] * 2


def test_panels_zoom_together_over_the_same_range_alone():
    first = ("time [s]", [0, 1])
    assert stacked(first, first).xaxis2.matches == "x"
    assert [stacked(first, ("time [s]", x)).xaxis2.matches for x in ([0.5, 1], [0, 2])] == [None, None]


def test_infinite_values_leave_gaps():
    figure = Figure("f", "F", "", [Panel("", "time [s]", "force [N]", [Series("a", [0, 1], [1, float("inf")])])])
    assert np.isnan(plotly_figure(figure).data[0].y[1])


def test_a_band_is_drawn_behind_its_curve_and_toggles_with_it(make_report):
    low, high, curve = plotly_figure(make_report().figures[1]).data[:3]
    assert high.fill == "tonexty"
    assert low.legendgroup == high.legendgroup == curve.legendgroup
    assert curve.mode == "lines+markers"


def test_a_band_has_the_color_of_its_curve_but_paler():
    """Blue of Okabe and Ito is (0, 114, 178)."""
    curve = Series("a", [0, 1], [1, 2], low=[0, 1], high=[2, 3], color="blue")
    low, *_ = plotly_figure(Figure("f", "F", "", [Panel("", "time [s]", "force [N]", [curve])])).data
    assert low.fillcolor == "rgba(0,114,178,0.16)"


BARS = Figure(
    "bars",
    "Bars",
    "",
    [
        Panel(
            "",
            "road [?]",
            "power [W]",
            [
                Series("passive", [0, 1], [46.0, 18.0], color="gray", dash="dash", mode="bar"),
                Series("MPC", [0, 1], [5.0, 4.0], [4.0, 3.5], [5.75, 4.5], mode="bar"),
                Series("limit", [-0.5, 1.5], [6.0, 6.0]),
            ],
            x_names=["off road, class E", "track"],
        )
    ],
)


def test_bars_stand_at_their_names_with_their_values_or_their_spread():
    drawn = plotly_figure(BARS)
    plain, spread, line = drawn.data
    assert [(t.type, t.name, list(t.x), list(t.y)) for t in (plain, spread, line)] == [
        ("bar", "passive", [0, 1], [46.0, 18.0]),
        ("bar", "MPC", [0, 1], [5.0, 4.0]),
        ("scatter", "limit", [-0.5, 1.5], [6.0, 6.0]),
    ]
    assert (plain.texttemplate, plain.error_y.array, plain.marker.pattern.shape) == ("%{y:.3~g}", None, "/")
    assert plain.marker.pattern.fillmode == "overlay"  # lines on the color of the marker, not instead of it
    assert (spread.texttemplate, spread.error_y.array, spread.error_y.arrayminus) == (None, (0.75, 0.5), (1.0, 0.5))
    axis = drawn.layout.xaxis
    assert (axis.tickvals, axis.ticktext, axis.range) == ((0, 1), ("off road,<br>class E", "track"), (-0.5, 1.5))
    assert drawn.layout.hovermode == "closest"


def test_bars_in_files_say_what_their_positions_are():
    columns, places = placed_columns(BARS)
    assert [header for header, _ in columns] == [
        "road (0: off road, class E, 1: track)",
        "passive: power [W]",
        "MPC: power [W]",
        "MPC: power low [W]",
        "MPC: power high [W]",
        "limit: road (0: off road, class E, 1: track)",
        "limit: power [W]",
    ]
    assert places == [(0, 1), (0, 2), (5, 6)]


class TestColumns:
    def test_one_x_for_all_that_share_it(self, make_report):
        assert [header for header, _ in series_columns(make_report().figures[0])] == [
            "time [s]",
            "passive: pitch [deg]",
            "explicit: pitch [deg]",
            "explicit: force [kN]",
        ]

    def test_own_x_bands_and_panels_that_repeat_a_quantity(self, make_report):
        assert [header for header, _ in series_columns(make_report().figures[1])] == [
            "speed [km/h]",
            "Sine: preview: ratio [-]",
            "preview: ratio low [-]",
            "preview: ratio high [-]",
            "passive: speed [km/h]",
            "passive: ratio [-]",
            "Curb: preview: ratio [-]",
        ]

    def test_headers_are_unique_whatever_the_titles(self):
        panels = [Panel("same", "time [s]", "force [N]", [Series("a", [0, i], [0, 1])]) for i in range(1, 5)]
        headers = [header for header, _ in series_columns(Figure("f", "F", "", panels))]
        assert len(set(headers)) == len(headers) == 8


def test_markup_in_names_is_text():
    figure = plotly_figure(one_panel("<a href='https://example.org'>x</a>"))
    assert figure.data[0].name.startswith("&lt;a")


def test_sections_without_figures_have_a_palette():
    assert Palette(Section("S").figures) is not None


def luminance(color):
    """Relative luminance (WCAG 2.2)."""
    channels = [int(color[i : i + 2], 16) / 255 for i in (1, 3, 5)]
    linear = [c / 12.92 if c <= 0.04045 else ((c + 0.055) / 1.055) ** 2.4 for c in channels]
    return float(np.dot(linear, [0.2126, 0.7152, 0.0722]))


def contrast(a, b):
    high, low = sorted((luminance(a), luminance(b)), reverse=True)
    return (high + 0.05) / (low + 0.05)


def test_colors_of_a_dark_page_can_be_seen_and_told_apart():
    dark = dark_colors()
    assert set(dark) >= {*COLORS.values(), INK, MUTED, RULE, GRID, PAPER}
    page = dark[PAPER]
    assert min(contrast(dark[c], page) for c in COLORS.values()) > 3  # WCAG 2.2, 1.4.11: graphics
    assert min(contrast(dark[c], page) for c in (INK, MUTED)) > 4.5  # 1.4.3: text
    shown = [dark[c] for c in COLORS.values()]
    assert len(set(shown)) == len(shown)


def test_every_color_of_a_figure_has_a_dark_one(make_report):
    """A color that is forgotten stays as it is, which may be black on black."""
    dark = dark_colors()
    for figure in make_report().figures:
        found = set(re.findall(r'"(#[0-9a-f]{6}|rgba\([^)]*\))"', plotly_figure(figure).to_json())) - {"rgba(0,0,0,0)"}
        assert found
        assert found <= set(dark)


def test_each_trace_is_drawn_from_its_columns(make_report):
    for figure in make_report().figures:
        columns, places = placed_columns(figure)
        assert [h for h, _ in columns] == [h for h, _ in series_columns(figure)]
        for trace, (x, y) in zip(plotly_figure(figure).data, places, strict=True):
            np.testing.assert_array_equal(columns[x][1], trace.x)
            np.testing.assert_array_equal(columns[y][1], trace.y)
            assert columns[y][0].removeprefix("Sine: ").removeprefix("Curb: ").startswith(f"{trace.name}: ")


def test_a_colour_that_is_asked_for_is_nobody_elses():
    for color in COLORS:
        curves = [Series("asked", [0, 1], [0, 1], color=color), *(Series(n, [0, 1], [0, 1]) for n in "abc")]
        looks = Palette([Figure("f", "F", "", [Panel("", "time [s]", "force [N]", curves)])])
        assert looks["asked"].color == COLORS[color]
        assert not {COLORS[color], COLORS["gray"]} & {looks[n].color for n in "abc"}


def test_a_legend_has_as_many_rows_as_its_widest_name_needs():
    """54 px and 7 for each letter: of 20 letters three fit into 600 px."""
    names = ["a", *(f"a name of 20 letters{i}"[-20:] for i in range(6))]
    assert _legend_height(one_panel(*names), 600) == 3 * LEGEND_ROW + 14
    assert _legend_height(one_panel(*names), 100) == 7 * LEGEND_ROW + 14
    assert _legend_height(one_panel(*names[:3]), 600) == LEGEND_ROW + 14


def test_a_label_without_a_unit_has_no_brackets():
    curves = [Series("run 1", [0, 1], [0, 1])]
    figure = Figure(
        "f", "F", "", [Panel("", "gain [?]", "peak [?]", curves), Panel("", "ratio [-]", "force [N]", curves)]
    )
    drawn = plotly_figure(figure)
    assert [drawn.layout[a].title.text for a in ("xaxis", "yaxis", "xaxis2", "yaxis2")] == [
        "gain",
        "peak",
        "ratio [-]",
        "force [N]",
    ]
    assert [t.hovertemplate.count("?") for t in drawn.data] == [0, 0]
    assert [name for name, _ in series_columns(figure)] == ["gain", "run 1: peak", "ratio [-]", "run 1: force [N]"]
