"""Model predictive control of the quarter-car bench (paper 002), with the index of its regulator."""

from __future__ import annotations

import math
from typing import Literal

from build_fmus.component import Component
from build_fmus.qp import Daqp, Osqp
from fmu_sources.controllers.lq.bench import FORCE_WEIGHT, WEIGHTS
from fmu_sources.controllers.mpc.component import TUNABLE_NOTE, mpc_component
from fmu_sources.controllers.mpc.model import MpcModel
from fmu_sources.controllers.mpc.settings import Horizon, Input, Mpc, Output
from fmu_sources.models.bench_states import STATES, bench_model, reference_inputs
from fmu_sources.registration import component

FORCE_LIMIT = 8.0  # N, 002 section V
MPC_PERIOD = 10e-3  # s, assumed
_DAQP = Daqp(max_iterations=150)
BACKENDS = (Osqp(max_iterations=300, fallback=_DAQP), _DAQP)
"""The first is the default. A sample at the limits of iterations ends within half the sample time:
benchmarks/README.md.
"""
HORIZON = 50  # periods of the MPC: 0.5 s, the length of the longer bump; assumed


def bench_mpc(car: Component, cost: Literal["force", "moves"] = "force", horizon: int = HORIZON) -> Mpc:
    """Settings of the MPC, see `mpc_bench`."""
    model = MpcModel.sampled(bench_model(car), MPC_PERIOD, inputs=["force"], outputs=STATES)
    weight = math.sqrt(FORCE_WEIGHT)
    force = {"weight": weight} if cost == "force" else {"rate_weight": weight}
    return Mpc(
        model,
        inputs=(Input("force", min=-FORCE_LIMIT, max=FORCE_LIMIT, **force),),
        outputs=tuple(Output(s, weight=math.sqrt(w)) for s, w in zip(STATES, WEIGHTS, strict=True)),
        horizon=Horizon(horizon, horizon),
    )


@component("Mpc{v}", "MPC of the quarter-car bench (paper 002)", of="quarter_car_bench")
@component(
    "Mpc{v}Tunable",
    "MPC of the quarter-car bench (paper 002), its weights parameters",
    of="quarter_car_bench",
    tunable=True,
)
@component("Mpc{v}Moves", "MPC of the bench, weight on the moves (paper 002)", of="quarter_car_bench", cost="moves")
def mpc_bench(
    car: Component, name: str = "MpcBench", cost: Literal["force", "moves"] = "force", *, tunable: bool = False
) -> Component:
    """MPC of paper 002, section III B, every 10 ms, |force| <= 8 N.

    `cost`: the input weight is on the force, as the LQR has it (`"force"`), or on its changes per period as in
    equation (16) (`"moves"`). The paper prints neither weights nor horizons. `tunable`: the weights of the states and
    of the force are parameters.
    """
    mpc = bench_mpc(car, cost)
    what = "force" if cost == "force" else "changes of the force"
    c = mpc_component(
        mpc,
        car,
        name=name,
        description=f"MPC of the quarter-car bench (paper 002), weight on the {what}",
        source="002 equations (14) to (20); weights and horizons assumed",
        backend=_DAQP if tunable else BACKENDS,
        weighted={n: [n] for n in (*STATES, "force")} if tunable else None,
        notes=(
            (
                f"The index is that of LqrBench, summed over {HORIZON} periods of {1e3 * MPC_PERIOD:g} ms; its input"
                f" weight acts on the {what}. |force| <= {FORCE_LIMIT:g} N is hard."
            ),
            "Wiring: the inputs carry the names of the plant's outputs, force that of its input.",
            *([TUNABLE_NOTE] if tunable else []),
        ),
    )
    c.reference_input(reference_inputs())
    return c
