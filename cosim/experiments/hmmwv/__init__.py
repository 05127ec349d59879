"""Paper 001: a HMMWV on hydraulic actuators, from the servo valve to what the driver feels.

Beside the common layout: `wiring`, of the vehicle and its parts; `averages`, what runs come to over the places of a
bump; `statements`, which judges what the paper says, `claims` the additional checks; `pump` and `refinement`, the
vehicle under other pumps and steps. Two parts have runs of their own: `tracking` and `preview`.
"""

from cosim.experiments.layout import experiment

EXPERIMENT = experiment(
    __name__,
    "HMMWV with hydraulic actuators: comfort over bumps and off road (paper 001)",
    parts=("cosim.experiments.hmmwv.tracking:EXPERIMENT", "cosim.experiments.hmmwv.preview:EXPERIMENT"),
    exchange_error=["car.body.az", "car.body.z", "actuator_*.force"],
)
