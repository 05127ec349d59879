"""MPC of semi-active dampers: the index of the clipped LQR, with the passivity of the dampers as a constraint.

A damper's force F and velocity v satisfy F v <= 0 and lie between its curves: a set that is not convex, two regions
joined at v = 0. With the sign of v as a logic variable that is a mixed-integer program (Giorgetti, Bemporad, Tseng,
Hrovat 2006). Here the logic is fixed before the program is solved: the first move by the velocity now, which is known,
later moves by the velocities that come while the last command stays (the free response). What is left are bounds on
each move,

    -f_most(v) <= F <= -f_least(v)  for v > 0,    -f_least(v) <= F <= -f_most(v)  for v < 0

and a convex quadratic program, solved by DAQP. The first move, which alone is applied, obeys the constraint exactly.

The program's input is the force on top of the car's own dampers, u = F + c v, as the LQR has it. Without the
constraint the command is that of dynamic programming for the index summed over the samples of the horizon.

Source: N. Giorgetti, A. Bemporad, H. E. Tseng, D. Hrovat, on hybrid model predictive control of semi-active
suspensions, Int. J. Control 79 (2006); the logic is simplified as above.
"""

from __future__ import annotations

import math
from typing import Any

import casadi as ca

from build_fmus.component import Component
from build_fmus.qp import Daqp
from fmu_sources.controllers.lq.hmmwv import weighted_outputs
from fmu_sources.controllers.mpc.component import add_mpc, previous_command
from fmu_sources.controllers.mpc.model import MpcModel
from fmu_sources.controllers.mpc.settings import Horizon, Input, Mpc, Output
from fmu_sources.controllers.semi_active import NOTES, WEIGHTS, DampedCar
from fmu_sources.models.corners import CORNERS
from fmu_sources.models.hmmwv_states import FORCE_LIMIT, FORCES, RELATIVE_STATES, relative_model, usual_motion
from fmu_sources.registration import component

PERIOD = 5e-3  # s, assumed
BLOCKS = (1, 1, 2, 4, 8, 16, 28)  # periods between moves, 0.3 s together; assumed
VELOCITY = tuple(f"suspension.{k}.velocity" for k in CORNERS)
_BACKEND = Daqp(max_iterations=150)


def semi_active_settings(car: Component, blocks: tuple[int, ...] = BLOCKS) -> Mpc:
    """The index of `SemiActiveLqr` over a horizon; damper velocities are predicted too, without weight."""
    weights = weighted_outputs(WEIGHTS)
    lin = relative_model(car).linearization([n for n in (*weights, *VELOCITY) if n not in RELATIVE_STATES])
    unit = 1e3  # N
    root = math.sqrt(WEIGHTS.force)
    return Mpc(
        MpcModel.sampled(lin, PERIOD, inputs=FORCES, outputs=[*weights, *VELOCITY]),
        inputs=tuple(Input(f, scale=unit, weight=root * unit) for f in FORCES),
        outputs=(*(Output(n, weight=math.sqrt(w)) for n, w in weights.items()), *(Output(n) for n in VELOCITY)),
        horizon=Horizon(sum(blocks), blocks=blocks),
    )


@component("SemiActiveMpc{s}", "MPC of semi-active dampers with their passivity (Giorgetti 2006)", of="ride_car_hmmwv")
def semi_active_mpc(car: Component, name: str = "SemiActiveMpc", *, blocks: tuple[int, ...] = BLOCKS) -> Component:
    """The controller FMU. `blocks`: periods between moves."""
    mpc = semi_active_settings(car, blocks)
    c = Component(
        name,
        kind="discrete",
        sample_time=PERIOD,
        description="Semi-active dampers, four corners: model predictive control with the passivity constraint",
        source="Giorgetti, Bemporad, Tseng, Hrovat 2006, simplified; 001 Table 1.1 with another force weight",
        symbols=ca.MX,
        notes=(*_NOTES, *NOTES),
    )
    law = DampedCar(c, car)
    passive = law.switch()
    damping = ca.vertcat(*(law.own_damping(k) for k in law.corners))
    velocity = ca.vertcat(*law.corners.all("velocity"))
    previous = previous_command(c, mpc, "N")
    limit = c.constant("request.max", FORCE_LIMIT, "N", "of an ideal actuator", source="001 Table 1.3")
    starts = mpc.horizon.moves

    def bounds(free: Any) -> tuple[Any, Any]:
        """Least and largest u of each move, by the velocity then."""
        sides = []
        for start in starts:
            v = velocity if start == 0 else free[-len(VELOCITY) :, start - 1]
            curves = [law.curves.resistance(v[i]) for i in range(len(VELOCITY))]
            one, other = (damping * v - ca.vertcat(*(f[i] for f in curves)) for i in (0, 1))
            active = damping * v
            low = ca.if_else(passive, ca.fmin(one, other), active - limit)
            high = ca.if_else(passive, ca.fmax(one, other), active + limit)
            sides.append((low, high))
        return ca.horzcat(*(s[0] for s in sides)), ca.horzcat(*(s[1] for s in sides))

    solution = add_mpc(c, mpc, state=law.x, previous=previous, backend=_BACKEND, bounds=bounds)
    c.update(previous, solution.command)
    requested = [damping[i] * velocity[i] - solution.command[i] for i in range(len(FORCES))]
    law.outputs([law.nearest(k, d) for k, d in zip(law.corners, requested, strict=True)], requested, passive)
    c.output("command.held", solution.held, None, "the solver found no solution: the last command is kept", type=bool)
    c.provenance = {"car": car.name, "mpc": mpc.as_dict()}
    c.reference_input(usual_motion())
    return c


_NOTES = (
    (
        f"Index: that of SemiActiveLqr, over {sum(BLOCKS)} periods of {1e3 * PERIOD:g} ms with"
        f" {len(BLOCKS)} moves. The road is a disturbance that is not known."
    ),
    (
        "Bounds on each move are the damper's range at the velocity now, and for later moves at the velocity that is"
        " predicted while the last command stays. passive off: force.limit instead, of ideal actuators."
    ),
)
