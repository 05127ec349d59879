"""Control laws of semi-active dampers: each finds the current of four dampers from the motion of a ride car.

At each corner, with the velocity w of the body's corner, u of the wheel and v = w - u of the damper, a control law
requests a resistance D (force on the body -D). The damper can only give what lies between its curves at v, of the sign
of v. Continuous control laws get the nearest resistance there is; on-off ones switch between the curves.

| FMU | control law | source |
|---|---|---|
| SemiActiveSkyhook | D = b_sky w + b_rel v; on-off: most if w v >= 0 | Karnopp, Crosby, Harwood 1974 |
| SemiActiveGroundhook | D = -b_ground u + b_rel v; on-off: most if -u v >= 0 | Valasek, Novak, Sika, Vaculin 1997 |
| SemiActiveAdd | most if a v >= 0, with a = dw/dt | Savaresi, Silani, Bittanti 2005 |
| SemiActiveShAdd | as skyhook if a^2 <= alpha^2 w^2, else as ADD | Savaresi, Spelta 2007 |
| SemiActiveLqr | D = c v + (K x) at the corner, clipped | Tseng, Hedrick 1994; 001 Table 1.1 |
| SemiActiveMpc | a quadratic program with the damper's range as bounds, `mpc.semi_active` | Giorgetti et al. 2006 |

**Why on-off skyhook switches so.** A damper between body and sky takes w (b_sky w) of power from the body. The real one
takes w D. Of all D that it can give, the most is largest for w D if w and v agree in sign, otherwise the least.
**Why groundhook is the same below.** The wheel feels +D, so its power u D is negative, and most is taken from it with
the most if -u v >= 0.
**Why ADD switches by the acceleration.** Over one sample the spring forces S hardly change, so that with m a = S - D
the square of a at its end is least with the most if a v >= 0, and with the least otherwise: the optimum of a^2 one
sample ahead. It is best above the resonance of the body, skyhook near it.
**Why SH-ADD mixes so.** a^2 - alpha^2 w^2 is negative where slow motion below alpha dominates: for a single wave,
|a| = omega |w|. Skyhook acts below the frequency alpha, ADD above.
**Why clipping.** Completing the square with the optimal cost-to-go turns the index of the regulator into the sum of
(D - D*)' R (D - D*) over all samples. The nearest available D makes each term least by itself, but not the sum, since
it changes the motion that follows: Tseng and Hedrick call it clipped optimal, and not optimal.

Sources: D. Karnopp, M. J. Crosby, R. A. Harwood: Vibration control using semi-active force generators, J. Eng. Ind.
96 (1974). H. E. Tseng, J. K. Hedrick: Semi-active control laws, optimal and sub-optimal, Veh. Syst. Dyn. 23 (1994).
M. Valasek, M. Novak, Z. Sika, O. Vaculin: Extended ground-hook, Veh. Syst. Dyn. 27 (1997). S. M. Savaresi, E. Silani,
S. Bittanti: Acceleration-driven-damper (ADD), J. Dyn. Syst. Meas. Control 127 (2005). S. M. Savaresi, C. Spelta:
Mixed sky-hook and ADD, J. Dyn. Syst. Meas. Control 129 (2007). The source of
SemiActiveMpc is in its module.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import casadi as ca

from build_fmus.component import Component
from fmu_sources.controllers.lq.hmmwv import TABLE_1_1, declare_gain, lqr_gain
from fmu_sources.models.hmmwv_states import (
    BODY_SPEED,
    RELATIVE_STATES,
    at_corner,
    car_corners,
    car_parameter,
    force_outputs,
    relative_inputs,
    sines,
    usual_motion,
)
from fmu_sources.plants.semi_active_damper import DamperCurves
from fmu_sources.registration import component

PERIOD = 5e-3  # s, assumed
HOOKS = {"sky": (10e3, 0.0), "ground": (0.0, 6e3)}  # N.s/m, assumed: about half of critical, of body and wheel
RELATIVE = 1.5e3  # N.s/m, assumed: the slope of the damper's lower curve
WEIGHTS = replace(TABLE_1_1, force=1e-7)
"""Of the clipped LQR and the MPC: 001 Table 1.1, but 1 kN counts as 0.1 m/s2 do. This force weight is assumed, between
both readings of the table: one in N requests hardly any force, one in kN far more than a damper can give.
"""
CROSSOVER = 2 * math.pi * 2.8  # rad/s, 1.5 times the resonance of the body; assumed


class DampedCar:
    """What the control laws have in common: inputs, motion of the corners, curves of the dampers, and outputs.

    Attributes:
        x: the 15 relative states.
        corners: each with `body`, `wheel` and `velocity` [m/s].
    """

    def __init__(self, c: Component, car: Component) -> None:
        self.c, self.car = c, car
        self.curves = DamperCurves.declare(c)
        self.unit = c.constant("curve.gap", 1.0, "N", "in place of no difference between the curves", source="own")
        self.x = relative_inputs(c, car)
        self.value = {n: self.x[i] for i, n in enumerate(RELATIVE_STATES)}
        self.corners = car_corners(c, car)
        for k in self.corners:
            k.body = at_corner(k, *(self.value[n] for n in BODY_SPEED))
            k.wheel = self.value[f"wheel.{k}.vz"]
            k.velocity = k.body - k.wheel
            c.value(f"damper_velocity_{k}", k.velocity)

    def own_damping(self, k: Any) -> Any:
        """Declare the damping that a control law was designed with; the semi-active damper takes its place."""
        name = f"suspension.{k}.damping"
        return self.c.parameter(
            name,
            car_parameter(self.car, name),
            "N.s/m",
            f"damping at {k} that the design of this control law takes for granted, so that the damper has to give it",
            min=0.0,
            max=1e6,
            source="vehicle file",
        )

    def switch(self) -> Any:
        """Declare `passive`."""
        return self.c.parameter(
            "passive",
            True,
            None,
            "whether forces are kept within the range of a damper; off: the request to an ideal actuator",
            tunable=True,
            source="option",
        )

    def nearest(self, k: Any, resistance: Any) -> Any:
        """Part of the largest current, 0 to 1, that brings the damper at `k` nearest to a resistance [N]."""
        return self.curves.share(k.velocity, resistance, self.unit)

    def outputs(self, shares: Sequence[Any], requested: Sequence[Any] = (), passive: Any = True) -> None:
        """Declare currents and forces.

        Args:
            shares: part of the largest current, 0 to 1, of each damper.
            requested: resistances [N] of ideal actuators, in effect while `passive` is false.
            passive: symbol of the switch.
        """
        forces = []
        for k, share in zip(self.corners, shares, strict=True):
            text = f"current of the damper at {k}"
            self.c.output(f"current.{k}", ca.if_else(passive, share, 0) * self.curves.current, "A", text)
            least, most = self.curves.resistance(k.velocity)
            forces.append(-(least + share * (most - least)))
        if requested:
            forces = [ca.if_else(passive, f, -d) for f, d in zip(forces, requested, strict=True)]
        force_outputs(self.c, forces)


def _component(name: str, description: str, source: str, *notes: str) -> Component:
    return Component(
        name,
        kind="discrete",
        sample_time=PERIOD,
        description=f"Semi-active dampers, four corners: {description}",
        source=source,
        notes=(*notes, *NOTES),
    )


@component("SemiActiveSkyhook{s}", "semi-active skyhook, on-off or continuous (Karnopp 1974)", of="ride_car_hmmwv")
@component(
    "SemiActiveGroundhook{s}",
    "semi-active groundhook, on-off or continuous (Valasek 1997)",
    of="ride_car_hmmwv",
    hook="ground",
)
def semi_active_hook(car: Component, name: str = "SemiActiveSkyhook", *, hook: str = "sky") -> Component:
    """Skyhook, groundhook and what lies between: D = b_sky w - b_ground u + b_rel v.

    `hook`: which of `HOOKS` the parameters start with.
    """
    sky, ground = HOOKS[hook]
    c = _component(
        name,
        "skyhook and groundhook, on-off or continuous",
        "Karnopp, Crosby, Harwood 1974; Valasek et al. 1997; dampings assumed",
        (
            "on_off: the most current while b_sky w - b_ground u has the sign of v, otherwise none; dampings then act"
            " by their ratio alone. Continuous: the resistance nearest to b_sky w - b_ground u + b_rel v. Both dampings"
            " at once make the hybrid between comfort and road holding."
        ),
    )
    law = DampedCar(c, car)
    damping: dict[str, Any] = {"unit": "N.s/m", "min": 0.0, "max": 1e6, "tunable": True, "source": "assumed"}
    b_sky = c.parameter("damping.sky", sky, description="b_sky: force per velocity of the body's corner", **damping)
    b_ground = c.parameter("damping.ground", ground, description="b_ground: force per velocity of the wheel", **damping)
    b_rel = c.parameter("damping.relative", RELATIVE, description="b_rel: force per velocity of the damper", **damping)
    on_off = c.parameter(
        "on_off", False, None, "whether the control law switches between the curves", tunable=True, source="option"
    )
    passive = law.switch()
    hooks = [b_sky * k.body - b_ground * k.wheel for k in law.corners]
    requested = [h + b_rel * k.velocity for h, k in zip(hooks, law.corners, strict=True)]
    shares = [
        ca.if_else(on_off, h * k.velocity >= 0, law.nearest(k, d))
        for h, d, k in zip(hooks, requested, law.corners, strict=True)
    ]
    law.outputs(shares, requested, passive)
    c.reference_input(sines(dict.fromkeys(RELATIVE_STATES[8:], 0.3)))
    return c


@component("SemiActiveAdd{s}", "acceleration-driven damper, ADD (Savaresi 2005)", of="ride_car_hmmwv")
@component("SemiActiveShAdd{s}", "mixed skyhook and ADD (Savaresi, Spelta 2007)", of="ride_car_hmmwv", mixed=True)
def semi_active_add(car: Component, name: str = "SemiActiveAdd", *, mixed: bool = False) -> Component:
    """ADD: the most if a v >= 0; `mixed`: skyhook instead where a^2 <= alpha^2 w^2."""
    c = _component(
        name,
        "mixed skyhook and acceleration-driven damper" if mixed else "acceleration-driven damper",
        "Savaresi, Spelta 2007; crossover assumed" if mixed else "Savaresi, Silani, Bittanti 2005",
        "Accelerations of heave, roll and pitch give that of each corner of the body, as sensors there would.",
    )
    law = DampedCar(c, car)
    motion = ("body.az", "body.roll_acceleration", "body.pitch_acceleration")
    rates = [c.input(n, car.variable(n).unit, car.variable(n).description) for n in motion]
    alpha = (
        c.parameter(
            "crossover",
            CROSSOVER,
            "rad/s",
            "alpha: skyhook acts on slower motion, ADD on faster",
            min=0.0,
            max=1e3,
            tunable=True,
            source="assumed: 1.5 times the resonance of the body",
        )
        if mixed
        else None
    )
    shares = []
    for k in law.corners:
        a = c.value(f"body_acceleration_{k}", at_corner(k, *rates))
        add = a * k.velocity >= 0
        if alpha is not None:
            add = ca.if_else(a**2 <= (alpha * k.body) ** 2, k.body * k.velocity >= 0, add)
        shares.append(add)
    law.outputs(shares)
    c.reference_input(sines({**dict.fromkeys(RELATIVE_STATES[8:], 0.3), **dict.fromkeys(motion, 3.0)}))
    return c


@component("SemiActiveLqr{s}", "clipped-optimal semi-active dampers, LQR of paper 001", of="ride_car_hmmwv")
def semi_active_lqr(car: Component, name: str = "SemiActiveLqr") -> Component:
    """The regulator of the car with its own damping and `WEIGHTS`, clipped to the range of the dampers."""
    gain, _ = lqr_gain(car, WEIGHTS, PERIOD)
    c = _component(
        name,
        "clipped linear-quadratic regulator",
        "Tseng, Hedrick 1994; 001 section 1.4, Table 1.1 with another force weight",
        (
            "gain is designed as that of LqrHmmwv, on the car with its own dampers, with a force weight of"
            f" {WEIGHTS.force:g} 1/N2. The dampers here take the place of its own, so the request is D = c v + K x at"
            " each corner, which is the same force between body and wheel. passive off: exactly that regulator."
        ),
    )
    law = DampedCar(c, car)
    K = declare_gain(c, car, gain, "001 Table 1.1 with another force weight, designed on the car")
    passive = law.switch()
    forces = ca.vertsplit(K @ law.x)
    requested = [law.own_damping(k) * k.velocity + f for k, f in zip(law.corners, forces, strict=True)]
    law.outputs([law.nearest(k, d) for k, d in zip(law.corners, requested, strict=True)], requested, passive)
    c.reference_input(usual_motion())
    return c


NOTES = (
    (
        "Wiring: the inputs carry the names of RideCarHmmwv's outputs; current.* go to four SemiActiveDamper, whose"
        " forces go to the car. Set the damping of the car's own suspension to 0: these dampers take its place."
    ),
    (
        "force.* is the force that the curves promise at the velocity now, without lag and hysteresis. Where the"
        " control law has the parameter passive: off, force.* is the request within force.limit, for an ideal"
        " actuator, and the currents are 0."
    ),
    "curve.* and current.max are those of the dampers: give both the same values.",
)
