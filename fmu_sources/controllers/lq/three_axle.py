"""Linear-quadratic regulator of the 6x6 with a pitch reference (paper 003, section 4.2), every millisecond."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import casadi as ca

from build_fmus.component import Component
from fmu_sources.controllers.lq.design import ContinuousLq, LinearPlant, continuous_lq, output_index
from fmu_sources.registration import component

SAMPLE_TIME = 1e-3  # s


@dataclass(frozen=True)
class LqrThreeAxleWeights:
    """Weights of the squares of states and forces, equations (4.6) to (4.9)."""

    state: float = 1e5  # every body state but pitch, per m2, (m/s)2, rad2 or (rad/s)2: (4.8)
    pitch: float = 50e5  # 1/rad2: (4.8)
    wheel: float = 1e5 * 1e-4  # wheel heights and velocities, per m2 or (m/s)2
    force: float = 1.0 / 1000.0**2  # 1/N2: 1 per squared kN, (4.9)

    def of(self, state: str) -> float:
        """Weight of a state by its name."""
        if state.startswith("wheel."):
            return self.wheel
        return self.pitch if state == "body.pitch" else self.state


def design(car: Component, weights: LqrThreeAxleWeights) -> ContinuousLq:
    """The regulator of paper 003, equations (4.1) to (4.5), u = -K x, on a ride car's linear model.

    Raises:
        LqError: the weights have no stabilizing solution on this car.
    """
    lin = car.linearize()
    forces, roads = ([n for n in lin.inputs if n.startswith(kind)] for kind in ("force.", "road."))
    plant = LinearPlant.of(lin, forces, roads, lin.states)
    return continuous_lq(plant, output_index(plant, [weights.of(s) for s in lin.states], [weights.force] * len(forces)))


@component("LqrThreeAxle{s}", "linear-quadratic regulator with pitch reference (paper 003)", of="three_axle")
def lqr_three_axle(car: Component, weights: LqrThreeAxleWeights | None = None, name: str = "LqrThreeAxle") -> Component:
    """The controller FMU for a ride car: force = -gain (x - x_reference), the reference of all states but pitch 0.

    Raises:
        LqError: the weights have no stabilizing solution on this car.
    """
    weights = weights or LqrThreeAxleWeights()
    law = design(car, weights)
    states = list(law.plant.states)
    c = Component(
        name,
        kind="discrete",
        sample_time=SAMPLE_TIME,
        description="Linear-quadratic regulator of the 6x6 with a pitch reference",
        source="003 equations (4.1) to (4.9), u = -K x in (4.2)",
        notes=_NOTES,
    )
    gain = c.parameter(
        "gain",
        law.K,
        None,
        "state feedback: rows the forces, columns the states in the order of the inputs",
        tunable=True,
        source="003 (4.5), weights (4.8) and (4.9) as in the documentation",
        rows=["N"] * len(law.K),
        columns=[car.variable(s).unit or "1" for s in states],
    )
    limit = c.parameter(
        "force.limit",
        150e3,
        "N",
        "largest force of one actuator",
        min=0.0,
        max=1e7,
        display_unit="kN",
        tunable=True,
        source="003 Table 4.5, as of the predictive controllers",
    )
    x = [c.input(s, car.variable(s).unit, car.variable(s).description) for s in states]
    reference = c.input("reference.pitch", "rad", "requested pitch now", display_unit="deg")
    x[states.index("body.pitch")] -= reference
    requested = ca.vertsplit(-gain @ ca.vertcat(*x))
    for corner, force in zip(law.plant.controls, requested, strict=True):
        clipped = ca.fmax(-limit, ca.fmin(limit, force))
        c.output(corner, clipped, "N", f"actuator force at {corner.removeprefix('force.')}", display_unit="kN")
    beyond = ca.mmax(ca.fabs(ca.vertcat(*requested))) > limit
    c.output("limit_reached", beyond, None, "a force is clipped at force.limit", type=bool)
    c.provenance = {"weights": vars(weights), "car": car.name, "gain": law.K.tolist()}
    c.reference_input({n: _wave(i) for i, n in enumerate([*states, "reference.pitch"])})
    return c


def _wave(i: int) -> Callable[[float], float]:
    return lambda t: 0.01 * math.sin((5.0 + i) * t + 0.3 * i)


_NOTES = (
    (
        "Weights: 1e5 on every body state and 50e5 on pitch as printed, forces counted in kN, and the wheels' states"
        " weighed 1e-4 as much. With the printed weights in SI units throughout the regulator does nothing visible;"
        " with the wheels weighed as printed it holds the wheels still instead of the body."
    ),
    (
        "The gain is that of continuous time, evaluated every millisecond, the communication step of the plant: close"
        " enough that the loop's decay rates stay within 3.5 % (20 % at the 5 ms of the predictive controllers)."
    ),
    (
        "There is no integral action and no feed-forward of the reference, so a requested pitch is reached only in"
        " part: the struts' springs resist it. The thesis reports the same."
    ),
    (
        "States and forces carry the names of the vehicle's outputs and inputs. reference.pitch is the present"
        " reference: connect reference.pitch[1] of PitchReference."
    ),
)
