"""Model predictive control as a discrete component: any plant, weights, bounds, preview, cases.

- `model`: prediction models: plant, delay and filters, sampled
- `settings`: weights, bounds, horizon, cases; every mistake is refused when the objects are made
- `observer`: state estimation
- `qp`: the condensed quadratic program
- `component`: inputs, outputs and solver of a control law in a component; `mpc_component` makes a whole one
- `bench`: the published control laws of the quarter-car bench (paper 002)
- `hmmwv`: the published control law of the HMMWV (paper 001)
- `semi_active`: semi-active dampers of the HMMWV: bounds that change with the velocity
- `three_axle`: the published control laws of the 6x6 (paper 003)

Public names are imported from here. `tests/oracles/mpc.py` computes the same step by another solver.

Example: a quarter car with preview of the road, all states measured:

    car = quarter_car(load_quarter_car("quarter_car_bench"), name="QuarterCarBench")
    model = MpcModel.sampled(
        car.linearize(), 0.010, inputs=["force"], outputs=["body.az", "suspension.deflection"],
        disturbances=[Disturbance("road", "road.height", "road.rate")],
    )
    mpc = Mpc(
        model,
        inputs=(Input("force", scale=8.0, rate_weight=0.1, min=-8.0, max=8.0),),
        outputs=(Output("body.az", weight=1.0), Output("suspension.deflection", scale=0.04, min=-0.02, max=0.02)),
        horizon=Horizon(prediction=20, control=5),
        cases=(Case("comfort"), Case("travel", {"suspension.deflection": {"weight": 5.0}})),
    )
    c = mpc_component(
        mpc, car, name="MyMpc", description="...", source="own", preview=Preview({"road": "preview"}, count=21,
        step=0.010)
    )

Without all states: design an `Observer` on the model of the plant, make the Mpc with `observer.model`, and
give the observer to `mpc_component`. With states from elsewhere, or more than one control law in a component:
`add_mpc`.
"""

from fmu_sources.controllers.mpc.component import (
    COMMAND_NOTE,
    MpcSolution,
    Preview,
    add_mpc,
    case_input,
    command_outputs,
    mpc_component,
    preview_inputs,
    previous_command,
    reference_inputs,
)
from fmu_sources.controllers.mpc.model import Disturbance, Filter, MpcError, MpcModel, filter_inputs, filter_output
from fmu_sources.controllers.mpc.observer import Observer
from fmu_sources.controllers.mpc.settings import Case, Horizon, Input, Mpc, Output

__all__ = [
    "COMMAND_NOTE",
    "Case",
    "Disturbance",
    "Filter",
    "Horizon",
    "Input",
    "Mpc",
    "MpcError",
    "MpcModel",
    "MpcSolution",
    "Observer",
    "Output",
    "Preview",
    "add_mpc",
    "case_input",
    "command_outputs",
    "filter_inputs",
    "filter_output",
    "mpc_component",
    "preview_inputs",
    "previous_command",
    "reference_inputs",
]
