"""A predictive controller of your own: a quarter car with preview, comfort or travel first, as an FMU.

    build-fmus --from docs/examples/quarter_car_mpc.py

The model comes from the plant's declaration. Weights are per square of (signal / scale); bounds on the force are hard,
those on the suspension soft.
"""

from build_fmus.component import Component
from fmu_sources.controllers.mpc import Case, Disturbance, Horizon, Input, Mpc, MpcModel, Output, Preview, mpc_component
from fmu_sources.plants import quarter_car
from fmu_sources.vehicles import load_quarter_car

PERIOD = 0.010  # s


def make() -> Component:
    """The component; its inputs carry the names of the car's states."""
    car = quarter_car(load_quarter_car("quarter_car_bench"), name="QuarterCarBench")
    model = MpcModel.sampled(
        car.linearize(),
        PERIOD,
        inputs=["force"],
        outputs=["body.az", "suspension.deflection", "tire.deflection"],
        disturbances=[Disturbance("road", height="road.height", rate="road.rate")],
    )
    mpc = Mpc(
        model,
        inputs=(
            Input("force", scale=8.0, weight=0.1, rate_weight=0.1, min=-8.0, max=8.0, rate_min=-2.0, rate_max=2.0),
        ),
        outputs=(
            Output("body.az", scale=1.0, weight=1.0),
            Output("suspension.deflection", scale=0.01, weight=0.1, min=-0.015, max=0.015),
            Output("tire.deflection", scale=0.01, weight=0.1),
        ),
        horizon=Horizon(prediction=30, blocks=(1, 1, 1, 2, 5, 10)),
        cases=(Case("comfort"), Case("travel first", {"suspension.deflection": {"weight": 1.0, "max": 0.010}})),
    )
    return mpc_component(
        mpc,
        car,
        name="MpcWithPreview",
        description="Predictive control of the bench with preview",
        source="own",
        preview=Preview({"road": "preview"}, count=31, step=PERIOD),
    )
