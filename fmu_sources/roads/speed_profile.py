"""Speed over time: constant, or one ramp; with the distance that belongs to it."""

from __future__ import annotations

import casadi as ca

from build_fmus.component import Component
from fmu_sources.plants.free_body import MAX_SPEED
from fmu_sources.registration import component


@component("SpeedProfile", "constant speed or ramp, with traveled distance")
def speed_profile(name: str = "SpeedProfile") -> Component:
    """Speed and its exact integral, both closed forms of time: no state, no drift."""
    c = Component(
        name,
        kind="discrete",
        sample_time=1e-3,
        description="Constant speed or one ramp, with traveled distance",
        source="own",
        notes=(
            "speed is start.speed until ramp.start, then changes by ramp.change within ramp.duration (0: at once) and "
            "stays. x is its exact integral from start.x on, evaluated from the time of the sample, so nothing drifts.",
            "Wiring: speed to target.speed of a vehicle, or x and speed straight to a road when there is no vehicle "
            "that moves.",
        ),
    )
    start = c.parameter(
        "start.speed",
        50.0 / 3.6,
        "m/s",
        "speed before the ramp",
        min=0.0,
        max=MAX_SPEED,
        display_unit="km/h",
        source="assumed; as in 000 Figures 8 and 10",
    )
    change = c.parameter(
        "ramp.change",
        0.0,
        "m/s",
        "speed gained in the ramp",
        min=-MAX_SPEED,
        max=MAX_SPEED,
        display_unit="km/h",
        source="option",
    )
    begin = c.parameter("ramp.start", 0.0, "s", "time at which the ramp starts", min=0.0, max=1e6, source="option")
    duration = c.parameter("ramp.duration", 0.0, "s", "duration of the ramp", min=0.0, max=1e6, source="option")
    start_x = c.parameter("start.x", 5.0, "m", "distance at time 0", min=-1e6, max=1e6, source="assumed")

    # Time since the ramp began, split into the part on the ramp and the part after it.
    since = ca.fmax(0, c.time - begin)
    least = c.constant("least.duration", 1e-9, "s", "of the ramp, for divisions", source="own")
    climbing = ca.fmin(since, duration)
    gained = ca.if_else(
        since >= duration, ca.if_else(c.time >= begin, change, 0), change * climbing / ca.fmax(duration, least)
    )
    on_ramp = change * climbing**2 / (2 * ca.fmax(duration, least))

    c.output("x", start_x + start * c.time + on_ramp + change * (since - climbing), "m", "distance along the road")
    c.output("speed", start + gained, "m/s", "speed", display_unit="km/h")
    return c
