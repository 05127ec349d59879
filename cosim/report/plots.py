"""A `Figure` as a plotly figure. A series name has one color, dash and marker in the whole report."""

from __future__ import annotations

import itertools
import math
import textwrap
from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

import numpy as np

from build_fmus.base import escape, extras
from cosim.core.content_checks import UNKNOWN, Array, drawn_label, label_of, split_label
from cosim.report.maps import FONT, INK, panel_title
from cosim.report.model import Color, Dash, Figure, Panel, Series

with extras.needed("reports", extras.WRITING):
    import plotly.graph_objects as go

# Okabe and Ito, "Color Universal Design" (2008), without its yellow, which is invisible on white
COLORS: dict[Color, str] = {
    "blue": "#0072b2",
    "vermilion": "#d55e00",
    "green": "#009e73",
    "purple": "#b5578f",  # darkened for contrast
    "orange": "#e69f00",
    "sky": "#56b4e9",
    "black": "#000000",
    "gray": "#767676",
}
DASHES: tuple[Dash, ...] = ("solid", "dash", "dashdot", "longdash", "dot")
PATTERNS: dict[str, str] = {"solid": "", "dash": "/", "dashdot": "\\", "longdash": "-", "dot": "."}  # of bars
MARKERS = ("circle", "square", "diamond", "triangle-up", "x", "triangle-down", "cross", "star")

MUTED, RULE, GRID, PAPER = "#55606e", "#aab3be", "#e7eaee", "#ffffff"
_TICK = 12  # characters of a line below a bar: four bars fit a phone
_ON_DARK = {
    **dict(
        zip(
            COLORS.values(),
            ("#4a9ede", "#f2803d", "#2fc49a", "#e08cc0", "#e69f00", "#9ad7fb", "#f4f6f8", "#9aa3ad"),
            strict=True,
        )
    ),
    INK: "#e4e8ee",
    MUTED: "#a7b0bc",
    RULE: "#5d6875",
    GRID: "#2a323d",
    PAPER: "#12171e",
}

# Pixels. Heights are absolute, so a figure looks the same with one panel or six.
PANEL_HEIGHT = {1: 320, 2: 240}
MANY_PANELS_HEIGHT = 190
NARROW_PANEL_HEIGHT = 230
TITLE_HEIGHT = 26
X_LABEL_HEIGHT = 54
LEGEND_ROW = 22
WIDE_LEGEND, NARROW_LEGEND = 820, 330


def dark_colors() -> dict[str, str]:
    """Each color of figures, and its tint under a band, and what stands for it on a dark page."""
    return {**_ON_DARK, **{_faint(light): _faint(_ON_DARK[light]) for light in COLORS.values()}}


@dataclass(frozen=True)
class Look:
    """Color, dash and marker of the series of one name."""

    color: str
    dash: str
    marker: str


class Palette:
    """The look of every series name in some figures.

    Hints come first; the remaining names take the colors that no hint names, in order of appearance. Color and dash
    differ together, so that curves stay apart on a gray print.
    """

    def __init__(self, figures: Iterable[Figure]):
        hints: dict[str, tuple[Color | None, Dash | None]] = {}
        for figure in figures:
            for panel in figure.panels:
                for series in panel.series:
                    earlier = hints.get(series.name, (None, None))
                    hints[series.name] = (earlier[0] or series.color, earlier[1] or series.dash)
        hinted = {hint for hint, _ in hints.values()}
        free: list[Color] = [color for color in COLORS if color not in hinted and color != "gray"] or [*COLORS]
        colors = itertools.cycle(free)
        self._looks: dict[str, Look] = {}
        taken: set[tuple[Color, Dash]] = set()
        for number, (name, (hint, dash)) in enumerate(hints.items()):
            color: Color = next(colors) if hint is None else hint
            if hint is None and (color, dash) in taken:  # a name that brings its dash is distinguished by its color
                color = next((c for c in free if (c, dash) not in taken), color)
            # where the colors have run out, the dash tells two names apart
            dashes = [d for d in DASHES if (color, d) not in taken] or DASHES
            chosen = dash or dashes[0 if hint else number % len(dashes)]
            taken.add((color, chosen))
            self._looks[name] = Look(COLORS[color], chosen, MARKERS[number % len(MARKERS)])

    def __getitem__(self, name: str) -> Look:
        return self._looks[name]


def plotly_figure(figure: Figure, palette: Palette | None = None, *, narrow: bool = False) -> go.Figure:
    """The figure for a wide page, or for a narrow one (a phone): the same traces, the panels in one column."""
    traces = _traces(figure, palette or Palette([figure]))
    return go.Figure(traces, _layout(figure, narrow))


def _traces(figure: Figure, palette: Palette) -> list[go.Scatter | go.Bar]:
    traces: list[go.Scatter | go.Bar] = []
    named: set[str] = set()
    for number, panel in enumerate(figure.panels, start=1):
        axes = {"xaxis": _axis("x", number), "yaxis": _axis("y", number)}
        _, unit = split_label(panel.y_label)
        for series in panel.series:
            look = palette[series.name]
            # plotly reads names as markup
            common: dict[str, Any] = {**axes, "name": escape.html(series.name), "legendgroup": series.name}
            x = series.x_values
            value = "%{y:.4~g}" + ("" if unit in ("-", "1", UNKNOWN) else f" {escape.html(unit)}")
            if series.mode == "bar":
                traces.append(_bar(series, look, common, value, showlegend=series.name not in named))
                named.add(series.name)
                continue
            if series.low is not None:
                for values, fill in ((series.low, None), (series.high, "tonexty")):
                    traces.append(
                        go.Scatter(
                            **common,
                            x=x,
                            y=_gaps(np.asarray(values)),
                            mode="lines",
                            line={"width": 0},
                            fill=fill,
                            fillcolor=_faint(look.color),
                            hoverinfo="skip",
                            showlegend=False,
                        )
                    )
            traces.append(
                go.Scatter(
                    **common,
                    x=x,
                    y=_gaps(np.asarray(series.y)),
                    mode=series.mode.replace("line", "lines"),
                    line={"color": look.color, "dash": look.dash, "width": 1.8},
                    marker={"color": look.color, "symbol": look.marker, "size": 7},
                    hovertemplate=value,
                    showlegend=series.name not in named,
                )
            )
            named.add(series.name)
    return traces


def _bar(series: Series, look: Look, common: dict[str, Any], value: str, *, showlegend: bool) -> go.Bar:
    """Bars with their values written at them, or with error bars where the series has a band."""
    y = _gaps(np.asarray(series.y))
    label: dict[str, Any] = {"texttemplate": "%{y:.3~g}", "textposition": "outside", "cliponaxis": False}
    if series.low is not None:
        above, below = (np.abs(np.asarray(edge, dtype=float) - y) for edge in (series.high, series.low))
        spread = {"array": above.tolist(), "arrayminus": below.tolist(), "symmetric": False, "color": INK, "width": 3}
        label = {"error_y": {"type": "data", "thickness": 1.2, **spread}}
    return go.Bar(
        **common,
        **label,
        x=series.x_values,
        y=y,
        marker={
            "color": look.color,
            "pattern": {"shape": PATTERNS[look.dash], "fillmode": "overlay", "fgcolor": PAPER},
        },
        hovertemplate=f"%{{fullData.name}}: {value}<extra></extra>",
        showlegend=showlegend,
    )


def _layout(figure: Figure, narrow: bool) -> dict[str, Any]:
    columns = 1 if narrow else min(figure.columns, len(figure.panels))
    rows = math.ceil(len(figure.panels) / columns)
    groups = _shared_x(figure.panels)
    labeled = [_has_x_label(groups, i, columns) for i in range(len(figure.panels))]

    # rows from the top: title, panel, space for the x label where a panel of the row has one
    panel_height = NARROW_PANEL_HEIGHT if narrow else PANEL_HEIGHT.get(rows, MANY_PANELS_HEIGHT)
    tops, y = [], 0
    for row in range(rows):
        cells = range(row * columns, min((row + 1) * columns, len(figure.panels)))
        y += TITLE_HEIGHT if any(figure.panels[i].title for i in cells) else 6
        tops.append(y)
        y += panel_height
        if row < rows - 1:
            y += X_LABEL_HEIGHT if any(labeled[i] for i in cells) else 14
    total = y
    legend = _legend_height(figure, NARROW_LEGEND if narrow else WIDE_LEGEND)
    gap = 0.0 if columns == 1 else 0.11  # space for tick labels such as -10 000 and a label

    layout: dict[str, Any] = {
        "template": "none",
        "autosize": True,
        "height": total + legend + X_LABEL_HEIGHT,
        "margin": {"t": legend, "b": X_LABEL_HEIGHT, "l": 56 if narrow else 72, "r": 12},
        "font": {"family": FONT, "size": 12 if narrow else 13, "color": INK},
        "separators": ".\u202f",
        "paper_bgcolor": PAPER,
        "plot_bgcolor": PAPER,
        "hovermode": "closest" if any(panel.x_names for panel in figure.panels) else "x unified",
        "hoverlabel": {"bgcolor": PAPER, "bordercolor": RULE, "font": {"size": 12, "color": INK}, "namelength": -1},
        "legend": {
            "orientation": "h",
            "x": 0,
            "xanchor": "left",
            "y": 1,
            "yref": "container",
            "yanchor": "top",
            "tracegroupgap": 0,
            "bgcolor": "rgba(0,0,0,0)",
        },
        "showlegend": True,
        "annotations": [],
    }
    width = (1 - gap * (columns - 1)) / columns
    for i, panel in enumerate(figure.panels):
        row, column = divmod(i, columns)
        left = column * (width + gap)
        top, bottom = 1 - tops[row] / total, 1 - (tops[row] + panel_height) / total
        first = groups.index(groups[i])
        x_axis = {
            **_axis_style(panel.x_label, panel.x_scale, narrow),
            "domain": [left, left + width],
            "anchor": _axis("y", i + 1),
            "hoverformat": ".5~g",
            "showticklabels": labeled[i],
        }
        if panel.x_names:
            x_axis |= {
                "tickvals": list(range(len(panel.x_names))),
                "ticktext": ["<br>".join(map(escape.html, textwrap.wrap(name, _TICK))) for name in panel.x_names],
                "range": [-0.5, len(panel.x_names) - 0.5],
                "ticks": "",
            }
        if not labeled[i]:
            del x_axis["title"]
        if first != i:
            x_axis["matches"] = _axis("x", first + 1)
        layout[_axis("xaxis", i + 1)] = x_axis
        layout[_axis("yaxis", i + 1)] = {
            **_axis_style(panel.y_label, panel.y_scale, narrow),
            "domain": [max(bottom, 0.0), top],
            "anchor": _axis("x", i + 1),
        }
        if panel.title:
            font = {"size": 12 if narrow else 13}
            layout["annotations"].append(panel_title(panel.title, left, top, yshift=3, font=font))
    return layout


def _axis_style(label: str, scale: str, narrow: bool) -> dict[str, Any]:
    style: dict[str, Any] = {
        "title": {
            "text": escape.html(drawn_label(label)),
            "font": {"color": MUTED, "size": 12 if narrow else 13},
            "standoff": 8,
        },
        "type": scale,
        "automargin": True,
        "showline": True,
        "linecolor": RULE,
        "gridcolor": GRID,
        "zeroline": False,
        "ticks": "outside",
        "ticklen": 4,
        "tickcolor": RULE,
        "exponentformat": "power",
        "minexponent": 4,
    }
    if scale == "log":
        style["dtick"] = 1
        style["tickfont"] = {"size": 11}  # plotly draws powers a quarter larger
        style["minor"] = {"ticks": "outside", "ticklen": 2, "tickcolor": RULE}
    return style


def _shared_x(panels: Iterable[Panel]) -> list[tuple[object, ...]]:
    """One key per panel; panels with the same key have the same quantity over the same range, and zoom together."""
    keys: list[tuple[object, ...]] = []
    for panel in panels:
        x = np.concatenate([s.x_values for s in panel.series])
        x = x[np.isfinite(x)]
        extent = (float(x.min()), float(x.max())) if len(x) else ()
        keys.append((panel.x_label, panel.x_scale, panel.x_names, *extent))
    return keys


def _has_x_label(groups: list[tuple[object, ...]], i: int, columns: int) -> bool:
    """A panel leaves its x label to the panel below when the two share their x axis."""
    below = i + columns
    return below >= len(groups) or groups[below] != groups[i]


def _legend_height(figure: Figure, width: int) -> int:
    names = {series.name for panel in figure.panels for series in panel.series}
    widest = 54 + 7 * max(len(name) for name in names)
    per_row = max(1, width // widest)
    return LEGEND_ROW * math.ceil(len(names) / per_row) + 14


def _axis(letter: str, number: int) -> str:
    return letter if number == 1 else f"{letter}{number}"


def _gaps(values: Array) -> Array:
    return np.where(np.isfinite(values), values, np.nan)


def _faint(color: str) -> str:
    red, green, blue = (int(color[i : i + 2], 16) for i in (1, 3, 5))
    return f"rgba({red},{green},{blue},0.16)"


def series_columns(figure: Figure) -> list[tuple[str, Array]]:
    """Every number of the figure as (header, values), headers `name [unit]`.

    Each x column stands before the curves drawn over it and is written once where several share it. A header that
    several columns would have is preceded by the panel's title (its number if it has none); x by the curve's name.
    """
    return placed_columns(figure)[0]


def placed_columns(figure: Figure) -> tuple[list[tuple[str, Array]], list[tuple[int, int]]]:
    """The same columns, and for each trace of `plotly_figure` which of them are its x and its y."""
    found: list[tuple[str, str, Array]] = []  # panel, header, values
    grids: list[tuple[str, Array, int]] = []  # label, values, place
    places: list[tuple[int, int]] = []
    for number, panel in enumerate(figure.panels, start=1):
        title = panel.title or f"panel {number}"
        quantity, unit = split_label(panel.y_label)
        for series in panel.series:
            x = series.x_values
            alike = (
                p for label, grid, p in grids if label == panel.x_label and np.array_equal(x, grid, equal_nan=True)
            )
            place = next(alike, None)
            if place is None:
                place = len(found)
                known = any(label == panel.x_label for label, _, _ in grids)
                grids.append((panel.x_label, x, place))
                shown = drawn_label(panel.x_label)
                if panel.x_names:
                    shown += f" ({', '.join(f'{i}: {name}' for i, name in enumerate(panel.x_names))})"
                found.append((title, f"{series.name}: {shown}" if known else shown, x))
            own = {}
            for kind, values in series.columns():
                suffix = "" if kind == "y" else f" {kind}"
                own[kind] = len(found)
                found.append((title, drawn_label(label_of(f"{series.name}: {quantity}{suffix}", unit)), values))
            kinds = ("y",) if series.mode == "bar" else ("low", "high", "y")
            places += [(place, own[kind]) for kind in kinds if kind in own]

    count = Counter(header for _, header, _ in found)
    columns: dict[str, Array] = {}
    for title, header, values in found:
        full = header if count[header] == 1 else f"{title}: {header}"
        numbered = (f"{n}: {full}" for n in itertools.count(2))
        unique = next(h for h in itertools.chain([full], numbered) if h not in columns)
        columns[unique] = values
    return list(columns.items()), places
