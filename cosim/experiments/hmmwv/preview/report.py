"""The preview chain as sections of the report: text, figures and tables."""

from __future__ import annotations

import numpy as np

from cosim.experiments.hmmwv.preview import published
from cosim.experiments.hmmwv.preview.claims import extremes
from cosim.experiments.hmmwv.preview.published import HEIGHTS_MM, words
from cosim.experiments.hmmwv.preview.runs import WINDOW, Case
from cosim.report import Figure, Panel, Series, Table, curve
from cosim.report.model import Color, Dash
from cosim.study import Content, Results

_LOOKS: dict[Case, tuple[Color, Dash]] = {
    published.PRINTED: ("orange", "dash"),
    published.COMPENSATED: ("purple", "dot"),
    published.FED: ("green", "solid"),
}
_FRONT = "distance of the front wheels [m]"


def curves(study: Results, case: Case) -> dict[str, np.ndarray]:
    """Signals of a run over time; `front`: distance of the front wheels [m]."""
    found = {name: np.array(values) for name, values in study.signals(case).items()}
    return {**found, "front": found["x"] + study[case]["front"]}


def generated_section(study: Results) -> Content:
    """Generated preview."""
    yield """The test track is known beforehand and laid at the distance that the speedometer has counted. Load cells of
    the passive car show where the bumps are. An error of the speedometer moves the prediction further off with every
    meter."""
    panels, rows = [], []
    for error in published.SPEEDOMETER_ERRORS:
        case = published.generated(error)
        row = curves(study, case)
        drawn = [
            curve("known profile, at the measured distance", row, "map", 1e3, x="front", color="blue"),
            curve("road under the wheel", row, "road", 1e3, x="front", color="black", dash="dot"),
            Series("load cell, N / 100", row["front"], row["load"] / 100, color="vermilion"),
        ]
        panels.append(Panel(f"speedometer {error:+g} %", _FRONT, "height [mm]", drawn))
        bumps = zip(("first", "second"), study[case]["offsets"], strict=True)
        rows.append({"speedometer error [%]": f"{error:+g}"} | {f"{n} bump [mm]": round(1e3 * o) for n, o in bumps})
    yield Figure(
        "preview-generated",
        "Generated preview and loads (figure 1.5 of the paper)",
        "Front left wheel, passive hydraulic car at 20 mph on the test track.",
        panels,
    )
    yield Table.of(
        "preview-offsets",
        "Largest load after the predicted crest",
        rows,
        "The load peaks where the strut moves fastest, not on the crest; what changes from row to row is the drift.",
    )


def chain_section(study: Results) -> Content:
    """Sensed preview."""
    row = study[published.on_track(published.FED)]
    ahead, front = row["ahead"], row["front"]
    tilted = 0.5 + (ahead + front) / (2 * front)  # height where the sensors look, per height under the front axle
    yield f"""Two range sensors see the road {ahead:.1f} m ahead of the front axle. Their heights are only as good as
    the pose of the body that is taken off them (1.18). A filter that assumes a flat road takes the climb over a bump
    for something else, and the road after the bump gets a dip that is not there.

    The paper adds the response of quarter cars to the pose, since feeding the road back into the filter was unstable.
    Both come out here. The reason for the instability is geometric: an error of the buffered road tilts the pose when
    the wheels reach it, and the sensors, ahead of the front axle, put {tilted:.1f} times that error into the buffer
    again. A filter of relative states integrates the pose from rates and lets it follow the buffered road within a
    second: short errors die out, long ones fade by two slow leaks, and the dip is gone. Most of that is due to the
    relative states: without any road their dip is as small. Quarter cars added to their pose count the motion twice:
    {extremes(study, published.TWICE, HEIGHTS_MM[0])[1]:.0f} mm of road that is not there, after a bump of
    {HEIGHTS_MM[0]:.0f} mm."""
    yield Figure(
        "preview-chain",
        "Range, corrected road and its rate (figure 1.7 of the paper)",
        f"Test track at 20 mph, radar with noise and its resolution of {1e3 * row['resolution']:g} mm, car without"
        " control forces.",
        _track_panels(study),
    )
    dropout = study.signals(published.DROPOUT)
    shown = [
        curve("true", dropout, "true", 1e3, color="black"),
        curve("buffered", dropout, "buffered", 1e3, color="green"),
        curve("preview.valid, 10 mm for true", dropout, "preview valid", 10.0, color="gray"),
    ]
    yield Figure(
        "preview-dropout",
        "A sensor that fails",
        "While the ranges are not valid the buffer continues with the last height; preview.valid is false until all"
        " wheels have passed that stretch.",
        [Panel(f"range sensors fail for {published.DROPOUT.dropout:g} s", "time [s]", "height [mm]", shown)],
    )
    dips = [
        {"correction": words(c)}
        | {
            f"{height:.0f} mm bump, {what} [mm]": round(value, 1)
            for height in HEIGHTS_MM
            for what, value in zip(("lowest", "highest"), extremes(study, c, height), strict=True)
        }
        for c in published.CHAINS
    ]
    yield Table.of("preview-dips", "Lowest and highest sensed height on the flat road after one bump, no noise", dips)
    drift = [
        {"correction": words(c)}
        | {
            f"{i * WINDOW:g} to {i * WINDOW + WINDOW:g} s [mm]": round(1e3 * v, 1)
            for i, v in enumerate(study[published.long(c)]["spread"])
        }
        for c in published.DRIFTING
    ]
    title = "Standard deviation of the buffered road's error with noise"
    yield Table.of("preview-drift", title, drift, "One bump of 30 mm at the beginning, then a flat road.")


def _track_panels(study: Results) -> list[Panel]:
    """What the sensor sees, and the road and its rate that each correction makes of it, over those of the first run."""
    runs = {c: curves(study, published.on_track(c)) for c in published.SHOWN}
    first = runs[published.SHOWN[0]]
    ranges = [curve("range", first, "range", x="front", color="black")]
    panels = [Panel("range sensor, left", _FRONT, "range [m]", ranges)]
    for title, label, factor, true, found in (
        ("road under the front left wheel, from the buffer", "height [mm]", 1e3, "true", "buffered"),
        ("its rate, mean over the 30 ms ahead", "rate [m/s]", 1.0, "true rate", "rate"),
    ):
        shown = [curve("true", first, true, factor, x="front", color="black")]
        for chain, run in runs.items():
            color, dash = _LOOKS[chain]
            over = {**run, "front": first["front"]}
            shown.append(curve(words(chain), over, found, factor, x="front", color=color, dash=dash))
        panels.append(Panel(title, _FRONT, label, shown))
    return panels
