"""Linear-quadratic regulator of the HMMWV (paper 001, Table 1.1), sampled at 30 ms.

The index is the mean of weighted squares of heave acceleration, roll and pitch rate, suspension travel, hub velocity,
tire deflection and force. It is minimized on the 14 absolute states of the car, with the exact integral between
samples, and the gain is mapped to the 15 relative states that a controller knows, `K_relative T = K_absolute`: no
force reaches the warp of the four road heights, so an index in relative states would have no finite optimum. Of all
such gains this is the smallest one (least squares), which leaves the warp of the road out.
"""

from __future__ import annotations

from dataclasses import astuple, dataclass, fields, replace
from typing import Any

import casadi as ca
import numpy as np

from build_fmus.base.checks import number
from build_fmus.component import Component
from fmu_sources.controllers.lq.design import LinearPlant, output_index, sampled_lq
from fmu_sources.models.hmmwv_states import (
    FORCES,
    RELATIVE_STATES,
    ROAD_HEIGHTS,
    SAMPLE_TIME,
    SUSPENSION,
    TIRE,
    WHEEL_SPEED,
    force_outputs,
    relative_inputs,
    relative_model,
    usual_motion,
)
from fmu_sources.registration import component

_WEIGHTED = {
    "acceleration": ("body.az",),
    "rates": ("body.roll_rate", "body.pitch_rate"),
    "travel": SUSPENSION,
    "hub_velocity": WHEEL_SPEED,
    "tire": TIRE,
}


@dataclass(frozen=True)
class LqrWeights:
    """Weights of the squares, one per kind of output; `force` is per squared newton."""

    acceleration: float  # heave of the CG, 1/(m/s2)2
    rates: float  # pitch and roll, 1/(rad/s)2
    travel: float  # 1/m2
    hub_velocity: float  # 1/(m/s)2
    tire: float  # deflection, 1/m2
    force: float  # 1/N2

    def __post_init__(self) -> None:
        for field, value in zip(fields(self), astuple(self), strict=True):
            may_be_zero = field.name != "force"
            number(f"weight {field.name}", value, above=None if may_be_zero else 0, least=0 if may_be_zero else None)


TABLE_1_1 = LqrWeights(acceleration=10.0, rates=10.0, travel=1.0, hub_velocity=1.0, tire=0.1, force=1e-4)
"""001 Table 1.1 in SI units, force in N: the reading behind the published comparison. It requests 200 N at most."""

TABLE_1_1_KILONEWTON = replace(TABLE_1_1, force=1e-4 / 1000.0**2)
"""001 Table 1.1 with the force in kN, everything else in SI: a million times cheaper forces, which saturate."""


def weighted_outputs(weights: LqrWeights) -> dict[str, float]:
    """Outputs of the car in the index -> weights of their squares."""
    return {n: getattr(weights, kind) for kind, group in _WEIGHTED.items() for n in group}


def lqr_gain(car: Component, weights: LqrWeights, period: float = SAMPLE_TIME) -> tuple[np.ndarray, np.ndarray]:
    """`K` (4, 15) on the relative states, and the gain (4, 14) on the car's own states that it stands for; u = -K x.

    Raises:
        LqError: the index has no optimum on this car.
        ValueError: a weight, or a car without the outputs that are weighted.
    """
    rho = weighted_outputs(weights)
    plant = LinearPlant.of(car.linearize(), FORCES, ROAD_HEIGHTS, [*rho])
    absolute = sampled_lq(plant, output_index(plant, [*rho.values()], [weights.force] * len(FORCES)), period).K
    return absolute @ np.linalg.pinv(relative_model(car).T), absolute


def declare_gain(c: Component, car: Component, gain: Any, source: str) -> Any:
    """Declare the gain (4, 15) of a regulator of the car on its relative states."""
    return c.parameter(
        "gain",
        gain,
        None,
        "force -gain x; rows fl fr rl rr [N], columns the relative states in the order of the inputs",
        tunable=True,
        source=source,
        rows=["N"] * len(FORCES),
        columns=[car.variable(n).unit or "1" for n in RELATIVE_STATES],
    )


@component("Lqr{v}", "LQR of paper 001, force weighted in N, as published", of="ride_car_hmmwv")
def lqr_hmmwv(
    car: Component, weights: LqrWeights = TABLE_1_1, name: str = "LqrHmmwv", *, period: float = SAMPLE_TIME
) -> Component:
    """The controller FMU for a ride car with four wheels. Raises as `lqr_gain` does."""
    gain, _ = lqr_gain(car, weights, period)
    c = Component(
        name,
        kind="discrete",
        sample_time=period,
        description="Linear-quadratic regulator of a car with seven degrees of freedom, on its relative states",
        source="001 section 1.4, Table 1.1",
        notes=_NOTES,
    )
    K = declare_gain(c, car, gain, "001 Table 1.1, designed on the car")
    x = relative_inputs(c, car)
    force_outputs(c, ca.vertsplit(-K @ x))
    c.provenance = {"weights": weights.__dict__, "car": car.name, "period": period, "gain": gain.tolist()}
    c.reference_input(usual_motion())
    return c


@component("Lqr{v}Kilonewton", "LQR of paper 001, force weighted in kN", of="ride_car_hmmwv")
def lqr_hmmwv_kilonewton(car: Component, name: str = "LqrHmmwvKilonewton") -> Component:
    """`lqr_hmmwv` with the weights `TABLE_1_1_KILONEWTON`."""
    return lqr_hmmwv(car, TABLE_1_1_KILONEWTON, name)


_NOTES = (
    (
        "Inputs carry the names of the car's outputs, and of the estimator's: connect all of equal name. body.az is"
        " there as on every higher-level controller of this vehicle, so that one can be exchanged for another; this"
        " control law does not use it."
    ),
    (
        "LqrHmmwv has the weights of Table 1.1 in SI units with the force in N: the control law requests some 200 N at"
        " most and hardly differs from zero force. LqrHmmwvKilonewton reads the force in kN: it requests"
        " thousands of newtons and reaches force.limit. The published comparison is with the first."
    ),
    (
        "The design minimizes the exact integral of the index between samples, on the car's 14 absolute states; gain"
        " acts on the 15 relative states. A flat road is assumed, as in the paper: the road is a disturbance."
    ),
)
