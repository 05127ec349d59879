"""Ride car: a body that heaves, rolls and pitches on wheels that hop, derived from its energies.

Lagrange's equations in the coordinates `q`: body height, roll and pitch at the CG, and one height per wheel,

    d/dt dT/dq' = Q - dV/dq - dR/dq'

with kinetic energy T, energy of springs and tires V, half of the power lost in dampers and tires R, and the generalized
forces Q of the actuators by virtual work. All four follow from two lengths per corner, suspension and tire deflection,
paper 004 equation (12). Nothing else is written down, so the equations cannot disagree with each other. How many axles
there are is up to the vehicle: two make the car of papers 004 and 001 with seven degrees of freedom, three the 6x6 of
paper 003 with nine.

The car is linear but for two options: friction in the suspensions, and tires that lift off.
"""

from __future__ import annotations

from typing import Any

import casadi as ca

from build_fmus.component import Component
from fmu_sources.models.corners import Corner, Corners
from fmu_sources.plants.friction import declare_friction, friction_loss
from fmu_sources.plants.gravity import gravity
from fmu_sources.plants.ride_interface import bump_at_an_angle, ride_inputs, ride_outputs, ride_states
from fmu_sources.plants.seat import SEAT_NOTE
from fmu_sources.registration import component
from fmu_sources.vehicles import RideCar, ThreeAxleCar, ThreeAxleTrenchCar, declare

_SOURCES = {
    RideCar: "004 equations (1) to (9), (12)",
    ThreeAxleCar: "003 equations (3.1) to (3.35), (3.42), (3.43), (3.45) to (3.49); axes of ISO 8855",
}


def _numbers_004(corners: list[str]) -> list[str]:
    """Equation numbers of the accelerations of body height, roll, pitch and wheels.

    Only (7) is readable in the copy at hand.
    """
    others = "004, one of equations (1) to (6)"
    return [others, "004 (7)", others, *(others for _ in corners)]


def _numbers_003(corners: list[str]) -> list[str]:
    """As `_numbers_004`.

    Roll and pitch have the other sign there; the paper counts the right wheel of an axle first.
    """
    printed = [f"a{axle}{side}" for axle in (1, 2, 3) for side in "rl"]
    body = ["003 (3.13)", "003 (3.14), roll of the other sign", "003 (3.15), pitch of the other sign"]
    return [*body, *(f"003 (3.{7 + printed.index(n)})" for n in corners)]


_EQUATIONS = {RideCar: _numbers_004, ThreeAxleCar: _numbers_003}


@component("RideCar{v}", "linear 7-DOF ride car, HMMWV (paper 001)", of="ride_car_hmmwv")
@component("RideCar{v}", "linear 7-DOF ride car of paper 004", of="sedan")
@component("ThreeAxleRide{s}", "linear 9-DOF ride model of the 6x6 of paper 003", of="three_axle")
def ride_car(vehicle: RideCar | ThreeAxleCar | ThreeAxleTrenchCar, name: str = "RideCarSedan") -> Component:
    """Ride car with tire damping: of papers 004 (equations (1) to (9)) and 001 with two axles, of paper 003 with three.

    Displacements are measured from static equilibrium. Actuator forces push the body up and the wheel down. Paper 003
    has roll positive to the left and pitch positive nose up: both signs are those of ISO 8855 here, the other way
    round. Of a car for trenches it is the linear part.
    """
    if isinstance(vehicle, ThreeAxleTrenchCar):
        vehicle = vehicle.linear()
    corners = Corners(vehicle.wheel.axle_of)
    c = Component(
        name,
        kind="continuous",
        description=f"Ride car, {3 + len(corners)} degrees of freedom: {vehicle.name}",
        source=f"{_SOURCES[type(vehicle)]}; derived from energies in the source of this component",
        solver="rk4",
        solver_step=5e-4,
        notes=(*_NOTES, SEAT_NOTE),
    )
    p = declare(c, vehicle)
    corners.each(
        wheel=lambda k: getattr(p.wheel, k.name),
        suspension=lambda k: getattr(p.suspension, k.name),
        tire=lambda k: getattr(p.tire, k.name),
    )
    with_friction = [k for k in corners if hasattr(k.suspension, "friction")]
    acting = declare_friction(c) if with_friction else None
    lifting = c.parameter(
        "tires.lift_off",
        vehicle.tires_lift_off,
        None,
        "whether tires lift off: they take no tension once their static load is gone",
        tunable=True,
        source="vehicle file, tires_lift_off",
    )

    # ------------------------------------------------------------------------------------------------------ inputs

    ride_inputs(c, corners)

    # --------------------------------------------------------------------------------- coordinates and their rates

    q, dq = ride_states(c, corners)

    def lengths(k: Corner, q: list[Any], road: Any) -> tuple[Any, Any]:
        """Suspension and tire deflection of a corner; their rates when given rates. 004 equation (12)."""
        z, roll, pitch, *wheels = q
        wheel = wheels[k.place]
        top = z + k.side * k.wheel.half_track * roll - k.wheel.x * pitch
        return top - wheel, wheel - road

    for k in corners:
        k.travel, k.deflection = lengths(k, q, k.road)
        k.travel_rate, k.deflection_rate = lengths(k, dq, k.road_rate)

    # ---------------------------------------------------------------------------------------------------- energies

    def half(factor: Any, value: Any) -> Any:
        return factor * value * value / 2

    masses = [p.body.mass, p.body.roll_inertia, p.body.pitch_inertia, *(k.wheel.mass for k in corners)]
    kinetic = sum(half(m, v) for m, v in zip(masses, dq, strict=True))
    potential = sum(half(k.suspension.stiffness, k.travel) for k in corners)
    potential += sum(half(k.tire.stiffness, k.deflection) for k in corners)
    lost = sum(half(k.suspension.damping, k.travel_rate) for k in corners)
    lost += sum(half(k.tire.damping, k.deflection_rate) for k in corners)
    if acting is not None:
        lost += sum(friction_loss(k.suspension.friction, k.travel_rate, acting) for k in with_friction)
    work = sum(k.force * k.travel for k in corners)  # virtual: its gradient is the generalized force

    # ------------------------------------------------------------------------------------------ equations of motion

    position, velocity = ca.vertcat(*q), ca.vertcat(*dq)
    inertia = ca.hessian(kinetic, velocity)[0]
    assert inertia.sparsity().is_diag(), "coordinates at the CG along principal axes"
    drive = ca.gradient(work, position) - ca.gradient(potential, position) - ca.gradient(lost, velocity)
    _static_loads(c, p.body.mass, corners)
    for k in corners:
        k.dynamic = -k.tire.stiffness * k.deflection - k.tire.damping * k.deflection_rate  # beyond the static load
        k.tension = ca.if_else(lifting, ca.fmin(k.dynamic + k.static, 0), 0)  # that the tire does not take
    tension, deflection = (ca.vertcat(*corners.all(n)) for n in ("tension", "deflection"))
    drive -= ca.jtimes(deflection, position, tension, True)
    acceleration = ca.vertsplit(drive / ca.diag(inertia))
    numbers = _EQUATIONS[type(vehicle)](corners.all("name"))
    for place, rate, value, number in zip(q, dq, acceleration, numbers, strict=True):
        c.derivative(place, rate)
        c.derivative(rate, value, source=number)

    # ----------------------------------------------------------------------------------------------------- outputs

    az, roll_acceleration, pitch_acceleration, *_ = acceleration
    for k in corners:
        k.tire_force = k.dynamic + k.static - k.tension
    # Small angles: the seat rises with y roll - x pitch and moves ahead with z pitch.
    seat_az = az + p.seat.y * roll_acceleration - p.seat.x * pitch_acceleration
    ride_outputs(c, corners, acceleration, p.seat.z * pitch_acceleration, seat_az)
    c.reference_input(bump_at_an_angle(corners.all("name")))
    return c


def _static_loads(c: Component, mass: Any, corners: Corners) -> None:
    """Give each corner `static`, the load [N] of its tire at rest: its wheel's weight and its share of the body's.

    The body is in equilibrium on equal springs: with a car that is the same left and right, the lever rule.
    """
    corners.each(arms=lambda k: ca.vertcat(1, k.side * k.wheel.half_track, -k.wheel.x))
    least = 1e-9  # keeps it solvable for wheels in one line or point
    area = c.constant("least.area", least, "m2", "added to the second moments of the wheel positions", source="own")
    rest = sum((k.arms @ k.arms.T for k in corners), ca.diag(ca.vertcat(least, area, area)))
    g = gravity(c)
    share = ca.inv_minor(rest) @ ca.vertcat(mass * g, 0, 0)
    corners.each(static=lambda k: ca.dot(k.arms, share) + k.wheel.mass * g)


_NOTES = (
    (
        "The body heaves, rolls and pitches about its CG, small angles; the wheels hop. All stiffnesses and dampings"
        " act at the wheels. Displacements count from static equilibrium, so weight does not appear in the linear"
        " model."
    ),
    (
        "tires.lift_off: a tire that has lost its static load (its wheel's weight and its share of the body's) takes no"
        " tension. On by default where the vehicle file says so, as that of the HMMWV does. Off, tires are springs and"
        " dampers in tension too. The linear model about rest is the same."
    ),
    (
        "friction.acting, where the vehicle file gives a friction: dry friction of the suspensions, its sign smoothed."
        " Off by default, so that the linear model about rest is that without friction, which controllers are"
        " designed on."
    ),
    (
        "The vehicle file gives values of each axle; in the FMU each wheel has its own, so that the sides may differ"
        " (one soft damper, a load to one side). wheel.*.x is the position ahead of the CG, negative at the rear;"
        " moving the CG changes all of them."
    ),
    (
        "Every state is an output and may be set before the start. A, B, C and D of the linear model are the "
        "directional derivatives, at any point as long as both options are off."
    ),
    (
        "Wiring: connect a road's outputs road.*.height and road.*.rate to the inputs of the same name; a controller"
        " drives force.*. The rate matters only where the tires have damping. Exchange at 1 ms."
    ),
)
