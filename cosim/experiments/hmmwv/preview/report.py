"""The preview chain as sections of the report: text, figures and tables."""

from __future__ import annotations

import numpy as np

from cosim.experiments.hmmwv.preview.claims import extremes
from cosim.experiments.hmmwv.preview.published import (
    CHAINS,
    COMPENSATED,
    DRIFTING,
    DROPOUT,
    FED,
    HEIGHTS_MM,
    PRINTED,
    SHOWN,
    SPEEDOMETER_ERRORS,
    TWICE,
    generated,
    long,
    on_track,
    words,
)
from cosim.experiments.hmmwv.preview.runs import WINDOW, Case
from cosim.report import Figure, Panel, Section, Series, Table
from cosim.report.model import Color, Dash, Scalar
from cosim.study import Results

_LOOKS: dict[Case, tuple[Color, Dash]] = {
    PRINTED: ("orange", "dash"),
    COMPENSATED: ("purple", "dot"),
    FED: ("green", "solid"),
}
_FRONT = "distance of the front wheels [m]"


def curves(study: Results, case: Case) -> dict[str, np.ndarray]:
    """Signals of a run over time; `front`: distance of the front wheels [m]."""
    found = {name: np.array(values) for name, values in study.signals(case).items()}
    return {**found, "front": found["x"] + study[case]["front"]}


def generated_section(study: Results) -> Section:
    """Generated preview."""
    panels = []
    rows: list[list[Scalar]] = []
    for error in SPEEDOMETER_ERRORS:
        case = generated(error)
        row = curves(study, case)
        panels.append(
            Panel(
                f"speedometer {error:+g} %",
                _FRONT,
                "height [mm]",
                [
                    Series("known profile, at the measured distance", row["front"], 1e3 * row["map"], color="blue"),
                    Series("road under the wheel", row["front"], 1e3 * row["road"], color="black", dash="dot"),
                    Series("load cell, N / 100", row["front"], row["load"] / 100, color="vermilion"),
                ],
            )
        )
        rows.append([f"{error:+g}", *(round(1e3 * o) for o in study[case]["offsets"])])
    return Section(
        "Generated preview",
        [
            (
                "The test track is known beforehand and laid at the distance that the speedometer has counted. Load"
                " cells of the passive car show where the bumps are. An error of the speedometer moves the prediction"
                " further off with every meter."
            ),
        ],
        [
            Figure(
                "preview-generated",
                "Generated preview and loads (figure 1.5 of the paper)",
                "Front left wheel, passive hydraulic car at 20 mph on the test track.",
                panels,
            )
        ],
        [
            Table(
                "preview-offsets",
                "Largest load after the predicted crest",
                ["speedometer error [%]", "first bump [mm]", "second bump [mm]"],
                rows,
                "The load peaks where the strut moves fastest, not on the crest; what changes from row to row is the"
                " drift.",
            )
        ],
    )


def chain_section(study: Results) -> Section:
    """Sensed preview."""
    row = study[on_track(FED)]
    ahead, front = row["ahead"], row["front"]
    tilted = 0.5 + (ahead + front) / (2 * front)  # height where the sensors look, per height under the front axle
    return Section(
        "Sensed preview",
        [
            (
                f"Two range sensors see the road {ahead:.1f} m ahead of the front axle. Their heights are only as good"
                " as the pose of the body that is taken off them (1.18). A filter that assumes a flat road takes"
                " the climb over a bump for something else, and the road after the bump gets a dip that is not there."
            ),
            (
                "The paper adds the response of quarter cars to the pose, since feeding the road back into the filter"
                " was unstable. Both come out here. The reason for the instability is geometric: an error of the"
                " buffered road tilts the pose when the wheels reach it, and the sensors, ahead of the front axle, put"
                f" {tilted:.1f} times that error into the buffer again. A filter of relative states integrates the pose"
                " from rates and lets it follow the buffered road within a second: short errors die out, long ones"
                " fade by two slow leaks, and the dip is gone. Most of that is due to the relative states: without any"
                " road their dip is as small. Quarter cars added to their pose count the motion twice:"
                f" {extremes(study, TWICE, HEIGHTS_MM[0])[1]:.0f} mm of road that is not there, after a bump of"
                f" {HEIGHTS_MM[0]:.0f} mm."
            ),
        ],
        [
            Figure(
                "preview-chain",
                "Range, corrected road and its rate (figure 1.7 of the paper)",
                f"Test track at 20 mph, radar with noise and its resolution of {1e3 * row['resolution']:g} mm, car"
                " without control forces.",
                _track_panels(study),
            ),
            Figure(
                "preview-dropout",
                "A sensor that fails",
                "While the ranges are not valid the buffer continues with the last height; preview.valid is false until"
                " all wheels have passed that stretch.",
                [_dropout_panel(study)],
            ),
        ],
        [_dips(study), _drift(study)],
    )


def _track_panels(study: Results) -> list[Panel]:
    runs = {c: curves(study, on_track(c)) for c in SHOWN}
    first = runs[SHOWN[0]]

    def compared(title: str, label: str, scale: float, true: str, found: str) -> Panel:
        shown = [Series("true", first["front"], scale * first[true], color="black")]
        for chain, run in runs.items():
            color, dash = _LOOKS[chain]
            shown.append(Series(words(chain), first["front"], scale * run[found], color=color, dash=dash))
        return Panel(title, _FRONT, label, shown)

    return [
        Panel(
            "range sensor, left", _FRONT, "range [m]", [Series("range", first["front"], first["range"], color="black")]
        ),
        compared("road under the front left wheel, from the buffer", "height [mm]", 1e3, "true", "buffered"),
        compared("its rate, mean over the 30 ms ahead", "rate [m/s]", 1.0, "true rate", "rate"),
    ]


def _dropout_panel(study: Results) -> Panel:
    row = curves(study, DROPOUT)
    shown = [
        Series("true", row["time"], 1e3 * row["true"], color="black"),
        Series("buffered", row["time"], 1e3 * row["buffered"], color="green"),
        Series("preview.valid, 10 mm for true", row["time"], 10 * row["preview valid"], color="gray"),
    ]
    return Panel(f"range sensors fail for {DROPOUT.dropout:g} s", "time [s]", "height [mm]", shown)


def _dips(study: Results) -> Table:
    rows: list[list[Scalar]] = [
        [words(c), *(round(v, 1) for h in HEIGHTS_MM for v in extremes(study, c, h))] for c in CHAINS
    ]
    heights = [f"{h:.0f} mm bump, {what} [mm]" for h in HEIGHTS_MM for what in ("lowest", "highest")]
    return Table(
        "preview-dips",
        "Lowest and highest sensed height on the flat road after one bump, no noise",
        ["correction", *heights],
        rows,
    )


def _drift(study: Results) -> Table:
    rows: list[list[Scalar]] = [[words(c), *(round(1e3 * v, 1) for v in study[long(c)]["spread"])] for c in DRIFTING]
    windows = [f"{a:g} to {a + WINDOW:g} s [mm]" for a in WINDOW * np.arange(len(rows[0]) - 1)]
    return Table(
        "preview-drift",
        "Standard deviation of the buffered road's error with noise",
        ["correction", *windows],
        rows,
        "One bump of 30 mm at the beginning, then a flat road.",
    )
