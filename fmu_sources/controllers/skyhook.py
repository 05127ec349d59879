"""Skyhook damping of the HMMWV: four dampers between the corners of the body and the sky (paper 001, equation (1.17)).

F = -B_sky dx_s/dt + K_vel (dx_u/dt - dx_s/dt) at each corner, with body velocity dx_s/dt and wheel velocity dx_u/dt
there. The body's corners follow from the velocities of the rigid body.
"""

from __future__ import annotations

from build_fmus.component import Component
from fmu_sources.models.hmmwv_states import (
    BODY_SPEED,
    RELATIVE_STATES,
    SAMPLE_TIME,
    at_corner,
    car_corners,
    force_outputs,
    relative_inputs,
    sines,
)
from fmu_sources.registration import component

SKY_DAMPING, RELATIVE_DAMPING = 2000.0, 1000.0  # N.s/m


@component("Skyhook{s}", "skyhook damping (paper 001)", of="ride_car_hmmwv")
def skyhook(car: Component, name: str = "Skyhook", *, period: float = SAMPLE_TIME) -> Component:
    """The controller FMU for a ride car with four wheels."""
    c = Component(
        name,
        kind="discrete",
        sample_time=period,
        description="Skyhook damping, four corners",
        source="001 equation (1.17)",
        notes=_NOTES,
    )
    sky = c.parameter(
        "damping.sky",
        SKY_DAMPING,
        "N.s/m",
        "B_sky: force per velocity of the body's corner",
        min=-1e6,
        max=1e6,
        tunable=True,
        source="001 section 1.4",
    )
    relative = c.parameter(
        "damping.relative",
        RELATIVE_DAMPING,
        "N.s/m",
        "K_vel: force per velocity of the wheel relative to the body",
        min=-1e6,
        max=1e6,
        tunable=True,
        source="001 section 1.4",
    )
    corners = car_corners(c, car)
    x = relative_inputs(c, car)
    value = {n: x[i] for i, n in enumerate(RELATIVE_STATES)}
    forces = []
    for k in corners:
        body = at_corner(k, *(value[n] for n in BODY_SPEED))
        c.value(f"body_velocity_{k}", body)
        forces.append(-sky * body + relative * (value[f"wheel.{k}.vz"] - body))
    force_outputs(c, forces)
    c.reference_input(sines(dict.fromkeys(RELATIVE_STATES[8:], 0.3)))
    return c


_NOTES = (
    (
        "Inputs carry the names of the car's outputs, and of the estimator's: connect all of equal name. They are the"
        " 15 relative states and body.az of every higher-level controller of this vehicle, so that one can be exchanged"
        " for another; skyhook damping uses the velocities alone."
    ),
    (
        "The command holds for 30 ms. After the smoothing filter of the force tracking and this hold, much of the"
        " damping is lost: the paper's gains are those of a slow loop."
    ),
)
