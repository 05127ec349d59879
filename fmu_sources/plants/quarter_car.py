"""Quarter car: two masses, one suspension, one tire (paper 001, equation 1.1; paper 002, equations 1 and 2)."""

from __future__ import annotations

from math import pi, sin

from build_fmus.component import Component
from fmu_sources.plants.friction import declare_friction, friction_force
from fmu_sources.registration import component
from fmu_sources.vehicles import QuarterCar, declare


@component("QuarterCar{v}", "quarter car of the HMMWV (paper 001)", of="quarter_car_hmmwv")
@component(
    "QuarterCar{v}",
    "quarter-car bench of paper 002",
    of="quarter_car_bench",
    source="002 equations (1), (2)",
    masses=("002 equation (1)", "002 equation (2), with the spring of matrix (6)"),
)
def quarter_car(
    vehicle: QuarterCar,
    name: str = "QuarterCarHmmwv",
    *,
    source: str = "001 equation (1.1)",
    masses: tuple[str, str] = ("001 (1.1), forces on m_s", "001 (1.1), forces on m_u"),
) -> Component:
    """Sprung and unsprung mass above one tire, with friction as an option.

    Source: paper 001 equation (1.1), paper 002 (1), (2). Equation (2) of paper 002 is printed without the spring
    between the masses; its matrices (6) and (7) have it.

    Displacements are measured from static equilibrium. The actuator force pushes the body up and the wheel down.
    `masses`: equations of the sprung and of the unsprung mass.
    """
    c = Component(
        name,
        kind="continuous",
        description=f"Quarter car, linear: {vehicle.name}",
        source=source,
        solver="rk4",
        solver_step=5e-4,
        notes=(
            (
                "Both masses move vertically. Displacements count from static equilibrium, so weight does not appear."
                " The tire is a linear spring and damper that also takes tension: for a tire that lifts off use the"
                " full car."
            ),
            (
                "friction.acting, where the vehicle file gives a friction: dry friction of the suspension, its sign"
                " smoothed. Off by default, as in the paper's own state space (1.6); the plant of force tracking"
                " has it."
            ),
            (
                "Wiring: road.height and road.rate are the height under the tire and its time derivative; both are"
                " needed because the tire has damping. A force controller drives force."
            ),
        ),
    )
    p = declare(c, vehicle)

    friction = getattr(p.suspension, "friction", None)
    acting = None if friction is None else declare_friction(c)

    r = c.input("road.height", "m", "road height under the tire")
    dr = c.input("road.rate", "m/s", "time derivative of the road height under the tire")
    f = c.input("force", "N", "actuator force, positive lifts the body and pushes the wheel down")

    zb = c.state("body.z", "m", "body height above static equilibrium", output=True, nominal=0.1)
    vb = c.state("body.vz", "m/s", "vertical body velocity", output=True)
    zw = c.state("wheel.z", "m", "wheel height above static equilibrium", output=True, nominal=0.1)
    vw = c.state("wheel.vz", "m/s", "vertical wheel velocity", output=True)

    strut = f - p.suspension.stiffness * (zb - zw) - p.suspension.damping * (vb - vw)  # on the body, upwards
    if friction is not None:
        strut -= friction_force(friction, vb - vw, acting)
    tire = p.tire.stiffness * (r - zw) + p.tire.damping * (dr - vw)  # on the wheel, upwards
    c.value("strut_force", strut, source="on the body, upwards")
    c.value("tire_force", tire, source="on the wheel, upwards, beyond the static load")
    ab = strut / p.body.mass
    aw = (tire - strut) / p.wheel.mass

    c.derivative(zb, vb)
    c.derivative(vb, ab, source=masses[0])
    c.derivative(zw, vw)
    c.derivative(vw, aw, source=masses[1])

    c.output("body.az", ab, "m/s2", "vertical body acceleration", source=masses[0])
    c.output("suspension.deflection", zb - zw, "m", "body height minus wheel height", display_unit="mm")
    c.output("suspension.velocity", vb - vw, "m/s", "rate of the suspension deflection")
    c.output("tire.deflection", zw - r, "m", "wheel height minus road height", display_unit="mm")

    c.reference_input(
        {
            "road.height": lambda t: 0.02 * sin(2 * pi * 1.5 * t),
            "road.rate": lambda t: 0.02 * 2 * pi * 1.5 * (1.0 - 2 * sin(pi * 1.5 * t) ** 2),
            "force": lambda t: 1000.0 * sin(2 * pi * 3.0 * t) if t > 0.05 else 0.0,
        }
    )
    return c
