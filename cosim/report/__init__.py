"""Reports of experiments: what was claimed, what came out, and every number behind it."""

from cosim.peaks import keep_peaks
from cosim.report.animation import Animation, Body, Force, Phase, Reading, Scene, Strut, Take, Wheel
from cosim.report.claims import Band, Claim, Claims, Counts, Distribution, Evidence
from cosim.report.maps import Layer, Map
from cosim.report.model import (
    Figure,
    Panel,
    Parameter,
    Report,
    Result,
    Section,
    Series,
    Table,
)
from cosim.report.plots import Palette, plotly_figure
from cosim.report.write import ReportError, write_report

__all__ = [
    "Animation",
    "Band",
    "Body",
    "Claim",
    "Claims",
    "Counts",
    "Distribution",
    "Evidence",
    "Figure",
    "Force",
    "Layer",
    "Map",
    "Palette",
    "Panel",
    "Parameter",
    "Phase",
    "Reading",
    "Report",
    "ReportError",
    "Result",
    "Scene",
    "Section",
    "Series",
    "Strut",
    "Table",
    "Take",
    "Wheel",
    "keep_peaks",
    "plotly_figure",
    "write_report",
]
