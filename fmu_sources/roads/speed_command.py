"""Speed as commanded while it runs: followed with limited acceleration, with the distance that belongs to it."""

from __future__ import annotations

import casadi as ca

from build_fmus.component import Component
from fmu_sources.plants.free_body import MAX_SPEED
from fmu_sources.registration import component


@component("SpeedCommand", "speed that follows a command, with traveled distance")
def speed_command(name: str = "SpeedCommand") -> Component:
    """A driver's foot: the speed goes to the target as fast as the limits let it.

    The distance is integrated by the trapezoidal rule, which is exact for it.
    """
    c = Component(
        name,
        kind="discrete",
        sample_time=1e-3,
        description="Speed that follows a command with limited acceleration, with traveled distance",
        source="own",
        notes=(
            (
                "speed begins at the first target.speed, then follows it, by at most acceleration.max where it grows"
                " and deceleration.max where it falls. x is its integral from start.x on."
            ),
            (
                "Wiring: as SpeedProfile, for runs whose speed is decided while they run: by a person, a page, a"
                " controller."
            ),
        ),
    )
    target = c.input(
        "target.speed",
        "m/s",
        "requested speed; its first value is the start speed",
        start=50.0 / 3.6,
        min=0.0,
        max=MAX_SPEED,
        display_unit="km/h",
    )
    start_x = c.parameter("start.x", 5.0, "m", "distance at time 0", min=-1e6, max=1e6, source="assumed")
    faster = c.parameter(
        "acceleration.max", 2.0, "m/s2", "largest acceleration", min=0.0, max=50.0, tunable=True, source="assumed"
    )
    slower = c.parameter(
        "deceleration.max", 4.0, "m/s2", "largest deceleration", min=0.0, max=50.0, tunable=True, source="assumed"
    )
    speed = c.state("speed.now", "m/s", "speed", start=target, nominal=10.0)
    x = c.state("x.now", "m", "distance", start=start_x, nominal=100.0)
    change = ca.fmin(ca.fmax(target - speed, -slower * c.period), faster * c.period)
    c.update(speed, speed + change)
    c.update(x, x + c.period * (speed + change / 2))
    c.output("x", x, "m", "distance along the road")
    c.output("speed", speed, "m/s", "speed", display_unit="km/h")
    c.reference_input({"target.speed": lambda t: 5.0 if t < 1.0 else 25.0 if t < 3.0 else 12.0})
    return c
