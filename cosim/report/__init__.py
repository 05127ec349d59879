"""Reports of experiments: what was claimed, what came out, and every number behind it.

What draws and writes is imported when it is used: it needs the extra [reports], and nothing else here does.
"""

import importlib
from typing import TYPE_CHECKING, Any

from cosim.recording.peaks import keep_peaks
from cosim.report.animation import Animation, Phase, Playback, Take
from cosim.report.claims import Band, Claim, Claims, Counts, Distribution, Evidence
from cosim.report.curves import bars, curve, level, over_time
from cosim.report.maps import Layer, Map
from cosim.report.model import Figure, Panel, Parameter, Report, Result, Section, Series, Table

if TYPE_CHECKING:
    from cosim.report.plots import Palette, plotly_figure
    from cosim.report.write import ReportError, write_report

_PLACES = {"Palette": "plots", "plotly_figure": "plots", "ReportError": "write", "write_report": "write"}


def __getattr__(name: str) -> Any:
    if name not in _PLACES:
        raise AttributeError(f"module 'cosim.report' has no attribute {name!r}")
    return getattr(importlib.import_module(f"cosim.report.{_PLACES[name]}"), name)


__all__ = [
    "Animation",
    "Band",
    "Claim",
    "Claims",
    "Counts",
    "Distribution",
    "Evidence",
    "Figure",
    "Layer",
    "Map",
    "Palette",
    "Panel",
    "Parameter",
    "Phase",
    "Playback",
    "Report",
    "ReportError",
    "Result",
    "Section",
    "Series",
    "Table",
    "Take",
    "bars",
    "curve",
    "keep_peaks",
    "level",
    "over_time",
    "plotly_figure",
    "write_report",
]
