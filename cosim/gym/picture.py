"""An episode as a figure: what was set, and what was seen."""

from __future__ import annotations

from typing import Any

from cosim import Recording
from cosim.core.content_checks import label_of
from cosim.gym.signals import Signals
from cosim.recording.peaks import keep_peaks
from cosim.report.model import Figure, Panel, Series


def picture(recording: Recording, actions: Signals, observations: Signals) -> Any:
    """A plotly figure with one panel per unit, actions first. MissingExtraError without the extra [reports]."""
    from cosim.report.plots import plotly_figure

    panels = []
    for what, signals in (("set", actions), ("seen", observations)):
        for unit in dict.fromkeys(signals.units.values()):
            series = [
                Series(name, *keep_peaks(recording.time, recording[name]))
                for name, own in signals.units.items()
                if own == unit
            ]
            panels.append(Panel(what, "time [s]", label_of("value", unit), series))
    return plotly_figure(Figure("episode", "Episode", "", panels))
