"""Encoders of the quarter-car bench: quantized positions, and velocities by a filter (paper 002)."""

from __future__ import annotations

from math import pi, sin
from typing import Any

import casadi as ca
import numpy as np
from scipy import linalg

from build_fmus.component import Component
from fmu_sources.registration import component

SAMPLE_TIME = 1e-3  # s
RESOLUTION = 1e-5  # m per count, assumed
UNITS = ("m", "m/s")  # of the states of the differentiating filter
CUT_OFF, DAMPING = 50.0, 0.9  # Hz, of the differentiating filter; assumed


@component("BenchEncoders", "encoders of the bench, velocities estimated")
def bench_encoders(name: str = "BenchEncoders") -> Component:
    """States of the bench as its controllers would measure them.

    Three encoders (paper 002, section IV): suspension deflection, height of the body, height of the road plate.
    """
    c = Component(
        name,
        kind="discrete",
        sample_time=SAMPLE_TIME,
        description="Encoders of the quarter-car bench: quantized positions and estimated velocities (paper 002)",
        source="002 section IV; resolution and filter assumed",
        notes=(
            (
                "Each encoder rounds to whole counts of resolution (0: no rounding). Velocities come from a"
                f" second-order filter s w2/(s2 + 2 z w s + w2) with {CUT_OFF:g} Hz and z = {DAMPING:g} after the"
                " encoders, sampled with the position held."
            ),
            (
                "Wiring: encoder.suspension from suspension.deflection, encoder.body from body.z and encoder.road from "
                "road.height of plant and road; the outputs go to the inputs of the same name of LqrBench or MpcBench."
            ),
        ),
    )
    resolution = c.parameter(
        "resolution",
        RESOLUTION,
        "m",
        "one count of the encoders",
        min=0.0,
        max=0.01,
        display_unit="mm",
        source="assumed",
    )
    least = c.constant("least.count", 1e-12, "m", "by which at least positions are divided", source="own")
    read = {}
    for n, text in (("suspension", "suspension deflection"), ("body", "height of the body"), ("road", "road height")):
        position = c.input(f"encoder.{n}", "m", text, display_unit="mm")
        count = ca.fmax(resolution, least)
        read[n] = ca.if_else(resolution > 0, count * ca.floor(position / count + 0.5), position)
    wheel = read["body"] - read["suspension"]
    c.output("suspension.deflection", read["suspension"], "m", "body height minus wheel height", display_unit="mm")
    c.output("body.vz", _rate(c, "body", read["body"]), "m/s", "vertical body velocity, estimated")
    c.output("tire.deflection", wheel - read["road"], "m", "wheel height minus road height", display_unit="mm")
    c.output("wheel.vz", _rate(c, "wheel", wheel), "m/s", "vertical wheel velocity, estimated")
    c.reference_input(
        {
            "encoder.suspension": lambda t: 0.004 * sin(30 * t),
            "encoder.body": lambda t: 0.01 * sin(12 * t),
            "encoder.road": lambda t: 0.008 * sin(14 * t),
        }
    )
    return c


def _rate(c: Component, name: str, position: Any) -> Any:
    """Filtered derivative, including the present sample by what it moved since the last one; 0 at the first sample."""
    w = 2 * pi * CUT_OFF
    A = np.array([[0.0, 1.0], [-w * w, -2 * DAMPING * w]])
    step = linalg.expm(A * SAMPLE_TIME)
    gain = linalg.solve(A, (step - np.eye(2)) @ np.array([0.0, w * w]))
    place = c.state(
        f"{name}.filter", None, "filtered position and rate", shape=(2,), start=ca.vertcat(position, 0), rows=UNITS
    )
    A_d = c.constant(f"{name}.step", step, None, "of the filter", rows=UNITS, columns=UNITS, source="own")
    b_d = c.constant(f"{name}.gain", gain, None, "of the filter", rows=("1", "1/s"), source="own")
    nxt = ca.mtimes(A_d, place) + b_d * position
    c.update(place, nxt)
    return nxt[1]
