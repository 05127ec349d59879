"""Reports of experiments: what was claimed, what came out, and every number behind it."""

from cosim.report.model import (
    Claim,
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
    "Claim",
    "Figure",
    "Palette",
    "Panel",
    "Parameter",
    "Report",
    "ReportError",
    "Result",
    "Section",
    "Series",
    "Table",
    "plotly_figure",
    "write_report",
]
