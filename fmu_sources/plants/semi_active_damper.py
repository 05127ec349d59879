"""Semi-active (magnetorheological) damper: its force lies between two measured curves, by the current in its coil.

With the curves f_least (no current) and f_most (largest current) over the velocity of the strut, the lagged current i,
and deflection x and velocity v of the suspension (body minus wheel),

    F = -(f_least(w) + i / i_max (f_most(w) - f_least(w))),    w = v + v_h x / sqrt(x^2 + x_h^2)
    T di/dt = command - i

The shift v_h of the velocity is the hysteresis of Kwok et al. (2006): their damper force is
c v + k x + alpha tanh(beta v + delta sign(x)) + f_0, so that the branch of the force over velocity is chosen by the
sign of the deflection. Here the measured curves stand in for the hyperbolic tangent and the line c v,
v_h is delta / beta, and the sign is smoothed. The accumulator's spring k and preload f_0 belong to the spring of the
car.

Source: N. M. Kwok, Q. P. Ha, T. H. Nguyen, J. Li, B. Samali: A novel hysteretic model for magnetorheological fluid
dampers and parameter identification using particle swarm optimization, Sensors and Actuators A 132 (2006).
"""

from __future__ import annotations

from dataclasses import dataclass
from math import cos, pi, sin
from typing import Any

import casadi as ca

from build_fmus.component import Component
from fmu_sources.plants.tables import check_increasing, linear_table
from fmu_sources.registration import component

VELOCITY = (0.05, 0.2, 0.5, 1.0, 2.0)  # m/s
LEAST, MOST = (75.0, 300.0, 700.0, 1200.0, 2000.0), (700.0, 2400.0, 4800.0, 7200.0, 10500.0)  # N
"""Resistance without and with the largest current, the same in both directions: from a quarter to about twice the
damping of the HMMWV of paper 001 (6000 N.s/m); assumed.
"""
LARGEST_CURRENT = 2.0  # A, assumed


@dataclass(frozen=True)
class DamperCurves:
    """The parameters of a damper that its plant and its controllers declare: its curves, and the largest current.

    `forces`: direction -> (resistance without current, with the largest one) at the velocities.
    """

    velocity: Any
    forces: dict[str, tuple[Any, Any]]
    current: Any

    @classmethod
    def declare(cls, c: Component) -> DamperCurves:
        """Declare the parameters, and refuse curves that would not make a damper."""
        velocity = c.parameter(
            "curve.velocity",
            VELOCITY,
            "m/s",
            "velocities of the curves, increasing; at 0 there is no force, and beyond the last one its force holds",
            min=1e-3,
            max=20.0,
            source="assumed",
        )
        texts = {"least": "without current", "most": "with the largest current"}
        forces = {
            direction: tuple(
                c.parameter(
                    f"curve.{direction}.{name}",
                    values,
                    "N",
                    f"resistance to {direction} {text}, by curve.velocity",
                    min=0.0,
                    max=1e6,
                    display_unit="kN",
                    source="assumed, about the damping of the HMMWV of paper 001",
                )
                for (name, text), values in zip(texts.items(), (LEAST, MOST), strict=True)
            )
            for direction in ("extension", "compression")
        }
        current = c.parameter(
            "current.max",
            LARGEST_CURRENT,
            "A",
            "current of curve.*.most; the damper saturates there",
            min=1e-3,
            max=100.0,
            source="assumed",
        )
        check_increasing(c, velocity, "curve.velocity")
        for direction, (least, most) in forces.items():
            for i in range(len(VELOCITY)):
                c.check(
                    most[i] >= least[i],
                    f"curve.{direction}.most[{i + 1}] must not be less than curve.{direction}.least[{i + 1}]: the"
                    " current adds resistance; correct the curves",
                )
        return cls(velocity, forces, current)  # type: ignore[arg-type]

    def resistance(self, velocity: Any) -> tuple[Any, Any]:
        """Force [N] against a velocity [m/s] without and with the largest current."""
        extension, compression = self.forces["extension"], self.forces["compression"]
        least, most = (
            ca.if_else(velocity < 0, -self._curve(-velocity, down), self._curve(velocity, up))
            for up, down in zip(extension, compression, strict=True)
        )
        return least, most

    def _curve(self, speed: Any, force: Any) -> Any:
        """The curve of a direction, from no force at rest to its first point, and on."""
        first = force[0] / self.velocity[0] * ca.fmin(speed, self.velocity[0])
        return first + linear_table(speed, self.velocity, force, beyond=False) - force[0]

    def share(self, velocity: Any, resistance: Any, unit: Any) -> Any:
        """Part of the largest current, 0 to 1, that brings the resistance nearest to the requested one [N].

        `unit`: any positive force, where both curves meet.
        """
        least, most = self.resistance(velocity)
        gap = most - least
        return ca.fmax(0, ca.fmin(1, (resistance - least) / (gap + (gap == 0) * unit)))


@component("SemiActiveDamper", "semi-active damper between two curves by current, with hysteresis (Kwok 2006)")
def semi_active_damper(name: str = "SemiActiveDamper") -> Component:
    """Damper of one wheel. Force positive pushes the body up; power is what it gives to the car, so negative."""
    c = Component(
        name,
        kind="continuous",
        description="Semi-active damper: force between two curves by current, with lag and hysteresis",
        source="Kwok et al. 2006 (hysteresis); curves assumed",
        solver="ros2",
        solver_step=5e-4,
        notes=_NOTES,
    )
    curves = DamperCurves.declare(c)
    lag = c.parameter(
        "lag", 10e-3, "s", "time constant of coil and fluid", min=1e-6, max=1.0, display_unit="ms", source="assumed"
    )
    speed = c.parameter(
        "hysteresis.speed",
        0.02,
        "m/s",
        "shift v_h of the velocity by the deflection, delta / beta of Kwok et al.; 0: no hysteresis",
        min=0.0,
        max=1.0,
        source="assumed",
    )
    travel = c.parameter(
        "hysteresis.travel",
        1e-3,
        "m",
        "deflection over which the shift changes its sign",
        min=1e-6,
        max=1.0,
        display_unit="mm",
        source="assumed",
    )
    loss = c.parameter(
        "coil.loss", 6.0, "W", "electrical power of the coil at current.max", min=0.0, max=1e4, source="assumed"
    )
    command = c.input("current", "A", "requested current; above current.max it counts as that", min=0.0)
    v = c.input("suspension.velocity", "m/s", "body velocity minus wheel velocity, positive extends the damper")
    x = c.input("suspension.deflection", "m", "body height minus wheel height", display_unit="mm")
    coil = c.state("coil.current", "A", "current in the coil", output=True, nominal=1.0)
    inside = ca.if_else(command > curves.current, curves.current, command)
    c.derivative(coil, (inside - coil) / lag)
    shifted = v + speed * x / ca.sqrt(x**2 + travel**2)
    c.value("shifted_velocity", shifted, source="Kwok et al. 2006, delta sign(x) / beta; sign smoothed")
    least, most = curves.resistance(shifted)
    force = -(least + coil / curves.current * (most - least))
    c.output("force", force, "N", "force, positive lifts the body", nominal=1e3, display_unit="kN")
    c.output("power", force * v, "W", "power that the damper gives to the car; without hysteresis never positive")
    c.output("coil.power", loss * (coil / curves.current) ** 2, "W", "electrical power of the coil")
    c.reference_input(
        {
            "current": lambda t: 1.5 if 0.03 < t < 0.07 else 0.4,
            "suspension.velocity": lambda t: 0.6 * cos(2 * pi * 12.0 * t),
            "suspension.deflection": lambda t: 0.6 / (2 * pi * 12.0) * sin(2 * pi * 12.0 * t),
        }
    )
    return c


_NOTES = (
    (
        "Wiring: suspension.velocity and suspension.deflection are those of the car, force goes to its force input. Set"
        " the damping of the car's own suspension to 0 where this damper replaces its own. The force follows the"
        " velocity at once: exchange at 1 ms or less, and let the car advance first (Gauss-Seidel)."
    ),
    (
        "curve.*: the resistance of a measured damper over velocity without and with the largest current, linear in"
        " between and, between the curves, in the current. Beyond the last velocity its force holds."
    ),
    (
        "hysteresis.speed: a sine of the deflection gives a loop of force over velocity that is twice as wide."
        " The model of Kwok et al. chooses the branch by the sign of the deflection, so hysteresis assumes motion about"
        " the static position. Where the shift reverses the sign of the velocity the force may drive the car: power is"
        " positive there, as in the published model."
    ),
    (
        "Passive: without hysteresis power is never positive, whatever the current, since both curves resist and meet"
        " where the damper rests."
    ),
    (
        "Left out: temperature (a hot damper has less force), the accumulator's spring and preload, cavitation, end"
        " stops, friction, dynamics of the current driver beyond one lag."
    ),
)
