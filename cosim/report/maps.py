"""Quantities over two others, as filled contours side by side; over names, as fields of a grid."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from build_fmus.base import escape
from cosim.core.content_checks import Array, assign, check_id, check_text, check_unique, curve, items, split_label

_REFERENCE = "#d55e00"
INK, FONT = "#1a2330", "'Helvetica Neue', Helvetica, Arial, sans-serif"


@dataclass(frozen=True, eq=False)
class Layer:
    """Values (len(y), len(x)) of one system."""

    name: str
    values: npt.ArrayLike

    def __post_init__(self) -> None:
        where = f"layer '{self.name}'"
        check_text(where, name=self.name)
        values = np.array(self.values, dtype=float)
        if values.ndim != 2 or not np.isfinite(values).all():
            raise ValueError(f"{where}: values need two dimensions and no gaps")
        values.setflags(write=False)
        assign(self, "values", values)


@dataclass(frozen=True, eq=False)
class Map:
    """Layers over the same grid, on one scale of values.

    `reference`: a value whose contour is drawn as a line, if a layer has it. `value_range`: the scale (lowest,
    highest), the same for maps that are to be compared; None for the extent of the values. `x_names`, `y_names`: what
    stands at x and at y, the first at the top, where these are no quantities.
    """

    id: str
    title: str
    caption: str
    x_label: str
    y_label: str
    value_label: str
    x: npt.ArrayLike
    y: npt.ArrayLike
    layers: Sequence[Layer]
    reference: float | None = None
    value_range: tuple[float, float] | None = None
    x_names: Sequence[str] = ()
    y_names: Sequence[str] = ()

    def __post_init__(self) -> None:
        where = f"map '{self.id}'"
        check_id(where, self.id)
        check_text(where, title=self.title)
        for label in (self.x_label, self.y_label, self.value_label):
            split_label(label, where)
        assign(self, "x", curve(where, "x", self.x))
        assign(self, "y", curve(where, "y", self.y))
        assign(self, "layers", items(where, "layers", self.layers, Layer))
        if not self.layers:
            raise ValueError(f"{where} has no layers")
        check_unique(where, "layer", (layer.name for layer in self.layers))
        shape = (len(np.asarray(self.y)), len(np.asarray(self.x)))
        for name, length in (("x_names", shape[1]), ("y_names", shape[0])):
            assign(self, name, items(where, name, getattr(self, name), str))
            if (self.x_names or self.y_names) and len(set(getattr(self, name))) != length:
                raise ValueError(f"{where}: {name} needs {length} different names")
        for layer in self.layers:
            if np.shape(layer.values) != shape:
                raise ValueError(f"{where}: layer '{layer.name}' has shape {np.shape(layer.values)}, the grid {shape}")
        low, high = self.extent
        if self.value_range is not None and not self.value_range[0] <= low <= high <= self.value_range[1]:
            raise ValueError(f"{where}: values from {low:g} to {high:g} exceed value_range {self.value_range}")

    @property
    def extent(self) -> tuple[float, float]:
        """Lowest and highest of all that is drawn."""
        drawn = [np.asarray(layer.values).ravel() for layer in self.layers]
        drawn += [] if self.reference is None else [np.array([self.reference])]
        every = np.concatenate(drawn)
        return float(every.min()), float(every.max())

    def columns(self) -> list[tuple[str, Array]]:
        """(header, values) of a CSV file, one row per grid point."""
        x, y = np.meshgrid(np.asarray(self.x), np.asarray(self.y))
        quantity, unit = split_label(self.value_label)
        layers = [(f"{n.name}: {quantity} [{unit}]", np.asarray(n.values).ravel()) for n in self.layers]
        return [(self.x_label, x.ravel()), (self.y_label, y.ravel()), *layers]


def map_plot(figure: Map, *, narrow: bool) -> dict[str, Any]:
    """Data and layout for the page's script."""
    import plotly.graph_objects as go

    made: dict[str, Any] = json.loads(go.Figure(*_contours(figure, narrow)).to_json())
    return made


def _base(height: int) -> dict[str, Any]:
    return {
        "template": "none",
        "autosize": True,
        "height": height,
        "paper_bgcolor": "#ffffff",
        "plot_bgcolor": "#ffffff",
        "font": {"family": FONT, "size": 13, "color": INK},
        "separators": ".\u202f",
        "annotations": [],
    }


def _contours(figure: Map, narrow: bool) -> tuple[list[dict[str, Any]], dict[str, Any]]:
    values = [np.asarray(layer.values) for layer in figure.layers]
    low, high = figure.value_range or (min(v.min() for v in values), max(v.max() for v in values))
    count = len(values)
    traces: list[dict[str, Any]] = []
    rows = count if narrow else 1
    named, down_labels = bool(figure.x_names), {"autorange": "reversed"} if figure.y_names else {}
    layout = _base(max(300 if narrow else 380, 160 + 24 * len(figure.y_names)) * rows)
    x, y = list(figure.x_names) or figure.x, list(figure.y_names) or figure.y
    drawn = {"type": "heatmap", "xgap": 1, "ygap": 1} if named else {"type": "contour"}
    lines = {
        "line": {"width": 0.6, "color": "rgba(255,255,255,.7)"},
        "contours": {"start": low, "end": high, "size": (high - low) / 12 or 1.0},
    }
    layout["margin"] = {"t": 34, "b": 58, "l": 66, "r": 12}
    gap = 0.09
    for i, (layer, grid) in enumerate(zip(figure.layers, values, strict=True)):
        name = "" if i == 0 else str(i + 1)
        across, down = (0, i) if narrow else (i, 0)
        columns = 1 if narrow else count
        width, height = (1 - gap * (columns - 1)) / columns, (1 - 0.22 * (rows - 1)) / rows
        left, top = across * (width + gap), 1 - down * (height + 0.22)
        common = {**drawn, "x": x, "y": y, "z": grid, "xaxis": f"x{name}", "yaxis": f"y{name}"}
        traces.append(
            {
                **common,
                "name": escape.html(layer.name),
                "zmin": low,
                "zmax": high,
                "colorscale": "Viridis",
                "reversescale": True,
                "showscale": i == count - 1,
                **({} if named else lines),
                "colorbar": {"title": {"text": escape.html(figure.value_label), "side": "right"}, "thickness": 14},
                "hovertemplate": f"{'%{x}, %{y}' if named else '%{x:~g}, %{y:~g}'}: %{{z:.4~g}}<extra></extra>",
            }
        )
        if figure.reference is not None:
            traces.append(
                {
                    **common,
                    "name": f"{escape.html(layer.name)}: {figure.reference:.4g}",
                    "showscale": False,
                    "hoverinfo": "skip",
                    "colorscale": [[0, _REFERENCE], [1, _REFERENCE]],
                    "line": {"width": 2.5},
                    "contours": {"start": figure.reference, "end": figure.reference, "size": 1.0, "coloring": "lines"},
                }
            )
        axis = {"showline": False, "ticks": "outside", "ticklen": 4, "automargin": True, "zeroline": False}
        layout[f"xaxis{name}"] = {**axis, "title": {"text": escape.html(figure.x_label)}, "anchor": f"y{name}"}
        layout[f"xaxis{name}"] |= {"domain": [left, min(1.0, left + width)]}
        layout[f"yaxis{name}"] = {**axis, "title": {"text": escape.html(figure.y_label)}, "anchor": f"x{name}"}
        layout[f"yaxis{name}"] |= {"domain": [max(0.0, top - height), top], **down_labels}
        layout["annotations"].append(panel_title(layer.name, left, top, yshift=5))
    return traces, layout


def panel_title(text: str, x: float, y: float, **more: Any) -> dict[str, Any]:
    """The annotation above the upper left corner (x, y) of a panel."""
    place = {"x": x, "y": y, "xref": "paper", "yref": "paper", "xanchor": "left", "yanchor": "bottom"}
    return {"text": f"<b>{escape.html(text)}</b>", **place, "showarrow": False, **more}
