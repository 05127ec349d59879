"""Recordings in the hands of other libraries: pandas, xarray, plotly, and a page of HTML for notebooks."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from lxml import html
from lxml.html import builder as E  # noqa: N812

from build_fmus.base import escape, extras
from cosim.recording.formats import TIME, FormatError, Recorded, blocks, columns
from cosim.recording.peaks import keep_peaks

if TYPE_CHECKING:
    import pandas as pd
    import plotly.graph_objects as go
    import xarray as xr

_ROWS = 25  # variables that a notebook shows
_POINTS = 4000  # of a curve; more cannot be told apart on a screen


def to_pandas(recorded: Recorded) -> pd.DataFrame:
    """One row per sample over the time [s], one column per variable; integers and Booleans keep their types.

    `attrs["units"]` are the units by name.
    """
    with extras.needed("data", "a recording in pandas"):
        import pandas as pd
    found = list(columns(recorded))
    units = {TIME: "s", **{name: unit for name, _, unit in found if unit}}
    frame = pd.DataFrame(dict(enumerate(v for _, v, _ in found)), index=pd.Index(recorded.time, name=TIME))
    frame.columns = pd.Index([name for name, _, _ in found], dtype=object)
    frame.attrs["units"] = units
    return frame


def to_xarray(recorded: Recorded) -> xr.Dataset:
    """One variable per name over the time [s], with its unit as the attribute `units`.

    An array of which all elements were recorded is one variable, `gain.y` for `gain.y[1,1]` and so on, with dimensions
    `gain.y_1`, `gain.y_2` that count from 1. `attrs["names"]`: names of the columns in order.
    """
    with extras.needed("data", "a recording in xarray"):
        import xarray as xr
    variables: dict[str, Any] = {}
    axes: dict[str, Any] = {TIME: (TIME, recorded.time, {"units": "s"})}
    for block in blocks(recorded):
        if block.name in axes or block.name in variables:
            raise FormatError(f"two variables of the recording would be '{block.name}'")
        own = [f"{block.name}_{k}" for k in range(1, len(block.shape) + 1)]
        axes |= {axis: np.arange(1, n + 1) for axis, n in zip(own, block.shape, strict=True)}
        variables[block.name] = ((TIME, *own), block.values(recorded), {"units": block.unit} if block.unit else {})
    return xr.Dataset(variables, axes, attrs={"names": list(recorded.names)})


def figure(recorded: Recorded, names: Sequence[str], title: str = "") -> go.Figure:
    """Curves over time, those of one unit in one diagram below each other."""
    with extras.needed("reports", "plotting a recording"):
        import plotly.graph_objects as go
        from plotly.subplots import make_subplots
    place = {name: i for i, name in enumerate(recorded.names)}
    units = list(dict.fromkeys(recorded.units.get(name, "") for name in names))
    if not units:
        raise ValueError("there is nothing to plot: no variable was recorded")
    drawn = make_subplots(rows=len(units), shared_xaxes=True, vertical_spacing=0.3 / (len(units) + 5))
    for name in names:
        row = units.index(recorded.units.get(name, "")) + 1
        shape = "hv" if name in recorded.types else "linear"
        time, values = recorded.time, recorded.data[:, place[name]]
        if shape == "linear":
            time, values = keep_peaks(time, values, _POINTS)
        drawn.add_trace(
            go.Scatter(x=time, y=values, name=escape.html(name), line={"shape": shape, "width": 1.5}), row=row, col=1
        )
    for row, unit in enumerate(units, start=1):
        drawn.update_yaxes(title_text=escape.html(f"[{unit}]") if unit else "", row=row, col=1)
    drawn.update_xaxes(title_text="time [s]", row=len(units), col=1)
    drawn.update_layout(
        title=escape.html(title) or None, height=160 + 220 * len(units), template="plotly_white", showlegend=True
    )
    return drawn


def page(recorded: Recorded, about: str) -> str:
    """The recording as a table, for notebooks: unit, first, smallest, largest and last value of each variable."""
    head = E.TR(*(E.TH(text) for text in ("variable", "unit", "first", "smallest", "largest", "last")))
    rows = [
        E.TR(E.TD(escape.xml(n)), E.TD(escape.xml(recorded.units.get(n, ""))), *map(E.TD, _figures(v)))
        for n, v in _shown(recorded)
    ]
    more = len(recorded.names) - len(rows)
    parts = [E.P(escape.xml(about)), E.TABLE(E.THEAD(head), E.TBODY(*rows))]
    if more:
        parts.append(E.P(f"and {more} more"))
    text: str = html.tostring(E.DIV(*parts), encoding="unicode")
    return text


def _shown(recorded: Recorded) -> list[tuple[str, Any]]:
    return [(name, recorded.data[:, i]) for i, name in enumerate(recorded.names[:_ROWS])]


def _figures(values: Any) -> list[str]:
    if not len(values):
        return ["", "", "", ""]
    return [f"{x:.6g}" for x in (values[0], values.min(), values.max(), values[-1])]
