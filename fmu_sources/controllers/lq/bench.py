"""Linear-quadratic regulator of the quarter-car bench (paper 002).

Its states are those of `fmu_sources.models.bench_states`.
"""

from __future__ import annotations

import casadi as ca
import numpy as np
from scipy import linalg

from build_fmus.component import Component
from fmu_sources.models.bench_states import STATES, bench_model, reference_inputs
from fmu_sources.registration import component

# of the squares of the states, SI; documentation of the bench's maker, assumed for 002
WEIGHTS = (450.0, 30.0, 5.0, 0.01)
FORCE_WEIGHT = 0.01  # 1/N2, same source
LQR_PERIOD = 2e-3  # s, assumed


def lqr_gain(car: Component) -> np.ndarray:
    """Gain K (4,) of u = -K x, paper 002 equations (10) to (13): the continuous Riccati equation."""
    lin = bench_model(car)
    B = lin.B[:, [lin.inputs.index("force")]]
    P = linalg.solve_continuous_are(lin.A, B, np.diag(WEIGHTS), [[FORCE_WEIGHT]])
    return (B.T @ P / FORCE_WEIGHT).ravel()


@component("Lqr{v}", "LQR of the quarter-car bench (paper 002)", of="quarter_car_bench")
def lqr_bench(car: Component, name: str = "LqrBench") -> Component:
    """State feedback of paper 002, section III A, every 2 ms."""
    c = Component(
        name,
        kind="discrete",
        sample_time=LQR_PERIOD,
        description="LQR of the quarter-car bench (paper 002)",
        source="002 equations (10) to (13)",
        notes=(
            (
                "force = -gain x with x = suspension deflection, body velocity, tire deflection, wheel velocity. The"
                f" gain is that of the continuous problem with weights {WEIGHTS} and {FORCE_WEIGHT:g} (documentation of"
                " the bench's maker; the paper prints none). limit is far away by default, as in the paper; 8 N makes"
                " a clipped LQR of it."
            ),
            "Wiring: the inputs carry the names of the plant's outputs, force that of its input.",
        ),
    )
    gain = c.parameter(
        "gain",
        lqr_gain(car),
        None,
        "gains [N/m, N.s/m, N/m, N.s/m]",
        min=-1e5,
        max=1e5,
        tunable=True,
        source="002 equation (13); weights assumed",
        rows=["N/m", "N.s/m", "N/m", "N.s/m"],
    )
    limit = c.parameter(
        "limit", 38.0, "N", "largest force", min=0.0, max=38.0, tunable=True, source="002 section V: the hardware's"
    )
    x = ca.vertcat(*(c.input(s, car.variable(s).unit, car.variable(s).description) for s in STATES))
    force = -ca.dot(gain, x)
    c.output(
        "force",
        ca.fmax(-limit, ca.fmin(limit, force)),
        "N",
        "actuator force, positive lifts the body and pushes the wheel down",
    )
    c.reference_input(reference_inputs())
    return c
