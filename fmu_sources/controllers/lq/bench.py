"""Controllers of the quarter-car bench: LQR and MPC (paper 002).

Both feed back the states of paper 002: suspension deflection, body velocity, tyre deflection, wheel velocity. The plant's
own states are heights; :func:`bench_model` changes to those of the paper.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Literal

import casadi as ca
import numpy as np
from scipy import linalg

from build_fmus.component import Component, Linearization
from build_fmus.qp import Daqp, Osqp
from fmu_sources.controllers.mpc import Horizon, Input, Mpc, MpcModel, Output, mpc_component
from fmu_sources.models.relative import relative_model

STATES = ("suspension.deflection", "body.vz", "tire.deflection", "wheel.vz")
WEIGHTS = (
    450.0,
    30.0,
    5.0,
    0.01,
)  # of the squares of the states, SI; documentation of the bench's maker, assumed for 002
FORCE_WEIGHT = 0.01  # 1/N2, same source
FORCE_LIMIT = 8.0  # N, 002 section V
LQR_PERIOD, MPC_PERIOD = 2e-3, 10e-3  # s, assumed
_DAQP = Daqp(max_iterations=150)
BACKENDS = (Osqp(max_iterations=300, fallback=_DAQP), _DAQP)
"""The first is the default. A sample at the limits of iterations ends within half the sample time: benchmarks/README.md."""
HORIZON = 50  # periods of the MPC: 0.5 s, the length of the longer bump; assumed


def bench_model(car: Component) -> Linearization:
    """The quarter car in the states of paper 002, equation (3): inputs ``force`` and ``road.rate``, outputs the states."""
    car_in_states = relative_model(car, STATES, forces=["force"], heights=["road.height"], rates=["road.rate"])
    return car_in_states.linearization()


def lqr_gain(car: Component) -> np.ndarray:
    """Gain K (4,) of u = -K x, paper 002 equations (10) to (13): the continuous Riccati equation."""
    lin = bench_model(car)
    B = lin.B[:, [lin.inputs.index("force")]]
    P = linalg.solve_continuous_are(lin.A, B, np.diag(WEIGHTS), [[FORCE_WEIGHT]])
    return (B.T @ P / FORCE_WEIGHT).ravel()


def lqr_bench(car: Component, name: str = "LqrBench") -> Component:
    """State feedback of paper 002, section III A, every 2 ms."""
    c = Component(
        name,
        kind="discrete",
        sample_time=LQR_PERIOD,
        description="LQR of the quarter-car bench (paper 002)",
        source="002 equations (10) to (13)",
        notes=(
            "force = -gain x with x = suspension deflection, body velocity, tyre deflection, wheel velocity. The gain is that "
            f"of the continuous problem with weights {WEIGHTS} and {FORCE_WEIGHT:g} (documentation of the bench's maker; the "
            "paper prints none). limit is far away by default, as in the paper; 8 N makes a clipped LQR of it.",
            "Wiring: the inputs carry the names of the plant's outputs, force that of its input.",
        ),
    )
    gain = c.parameter(
        "gain", lqr_gain(car), "1", "gains [N/m, N.s/m, N/m, N.s/m]", min=-1e5, max=1e5, tunable=True,
        source="002 equation (13); weights assumed",
    )  # fmt: skip
    limit = c.parameter(
        "limit", 38.0, "N", "largest force", min=0.0, max=38.0, tunable=True, source="002 section V: the hardware's"
    )
    x = ca.vertcat(*(c.input(s, car.variable(s).unit, car.variable(s).description) for s in STATES))
    force = -ca.dot(gain, x)
    c.output(
        "force", ca.fmax(-limit, ca.fmin(limit, force)), "N", "actuator force, positive lifts the body and pushes the wheel down"
    )  # fmt: skip
    c.stimulate(stimulus())
    return c


def bench_mpc(car: Component, cost: Literal["force", "moves"] = "force", horizon: int = HORIZON) -> Mpc:
    """Settings of the MPC, see :func:`mpc_bench`."""
    model = MpcModel.sampled(bench_model(car), MPC_PERIOD, inputs=["force"], outputs=STATES)
    weight = math.sqrt(FORCE_WEIGHT)
    force = {"weight": weight} if cost == "force" else {"rate_weight": weight}
    return Mpc(
        model,
        inputs=(Input("force", min=-FORCE_LIMIT, max=FORCE_LIMIT, **force),),
        outputs=tuple(Output(s, weight=math.sqrt(w)) for s, w in zip(STATES, WEIGHTS, strict=True)),
        horizon=Horizon(horizon, horizon),
    )


def mpc_bench(car: Component, name: str = "MpcBench", cost: Literal["force", "moves"] = "force") -> Component:
    """MPC of paper 002, section III B, every 10 ms, |force| <= 8 N.

    ``cost``: the input weight is on the force, as the LQR has it (``"force"``), or on its changes per period as in
    equation (16) (``"moves"``). The paper prints neither weights nor horizons.
    """
    mpc = bench_mpc(car, cost)
    what = "force" if cost == "force" else "changes of the force"
    c = mpc_component(
        mpc,
        car,
        name=name,
        description=f"MPC of the quarter-car bench (paper 002), weight on the {what}",
        source="002 equations (14) to (20); weights and horizons assumed",
        backend=BACKENDS,
        notes=(
            f"The index is that of LqrBench, summed over {HORIZON} periods of {1e3 * MPC_PERIOD:g} ms; its input weight acts "
            f"on the {what}. |force| <= {FORCE_LIMIT:g} N is hard.",
            "Wiring: the inputs carry the names of the plant's outputs, force that of its input.",
        ),
    )
    c.stimulate(stimulus())
    return c


def mpc_bench_moves(car: Component, name: str = "MpcBenchMoves") -> Component:
    """:func:`mpc_bench` with the weight on the moves, as paper 002 writes its index (16)."""
    return mpc_bench(car, name, cost="moves")


def stimulus() -> dict[str, Callable[[float], float]]:
    """States as in a bump, large enough to meet the limit."""

    def wave(amplitude: float, phase: float) -> Callable[[float], float]:
        return lambda t: amplitude * math.sin(12.0 * t + phase)

    return {s: wave(a, float(i)) for i, (s, a) in enumerate(zip(STATES, (0.02, 0.2, 0.02, 0.3), strict=True))}
