"""The pitch that a vehicle is to follow, now and over the preview of its controller (paper 003, section 5.3)."""

from __future__ import annotations

from math import radians

import casadi as ca

from build_fmus.component import Component
from fmu_sources.registration import component

COUNT, STEP = 50, 5e-3  # samples of the preview, and their distance [s]


@component("PitchReference", "pitch that ramps up, holds and ramps down (paper 003)")
def pitch_reference(name: str = "PitchReference", *, count: int = COUNT, step: float = STEP) -> Component:
    """Ramp up, hold, ramp down: a closed form of time, evaluated `count` times, `step` seconds apart."""
    c = Component(
        name,
        kind="discrete",
        sample_time=step,
        description="Pitch reference that ramps up, holds and ramps down, with its preview",
        source="003 section 5.3, Figure 5.12",
        stop_time=30.0,
        notes=(
            (
                "reference.pitch[1] is the reference now, [i] the one i - 1 sample times later. Nothing is remembered:"
                " all of it follows from time."
            ),
            (
                "Pitch is positive nose down (ISO 8855). The thesis has it positive nose up; for its sense set a"
                " negative pitch. The linear vehicle answers to both alike."
            ),
            (
                "Wiring: all of reference.pitch to a predictive controller, reference.pitch[1] to one that looks at the"
                " present."
            ),
        ),
    )
    top = c.parameter(
        "pitch",
        radians(3.0),
        "rad",
        "reference during the hold",
        min=-0.5,
        max=0.5,
        display_unit="deg",
        source="003 Figure 5.12",
    )

    rest = c.parameter(
        "rest",
        0.0,
        "rad",
        "reference before the ramp up and after the ramp down",
        min=-0.5,
        max=0.5,
        display_unit="deg",
        source="003 Figure 5.12",
    )

    def time(name: str, start: float, text: str) -> ca.SX:
        return c.parameter(name, start, "s", text, min=0.0, max=1e6, source="003 Figure 5.12")

    begin = time("ramp.start", 15.0, "when the ramp up starts")
    up = time("ramp.duration", 2.0, "duration of the ramp up, 0 for a step")
    hold = time("hold.duration", 5.0, "duration of the hold")
    down = time("return.duration", 2.0, "duration of the ramp down, 0 for a step")

    least = c.constant("least.duration", 1e-9, "s", "of a ramp, for divisions", source="own")

    def ramp(t: ca.SX, start: ca.SX, duration: ca.SX) -> ca.SX:
        """0 before, 1 after; 1 already at the instant of a step."""
        since = t - start
        part = ca.fmax(0, ca.fmin(1, since / ca.fmax(duration, least)))
        return ca.if_else(since >= duration, ca.if_else(since >= 0, 1, 0), part)

    instants = [c.time + i * c.period for i in range(count)]
    values = [rest + (top - rest) * (ramp(t, begin, up) - ramp(t, begin + up + hold, down)) for t in instants]
    c.output(
        "reference.pitch",
        ca.vertcat(*values),
        "rad",
        f"pitch reference now, {1e3 * step:g} ms later, ...",
        display_unit="deg",
    )
    return c
