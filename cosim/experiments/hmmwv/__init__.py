"""Paper 001: a HMMWV on hydraulic actuators, from the servo valve to what the driver feels.

`runs` wires, runs and measures the vehicle (`wiring`: what its parts wire too); `published` has the runs that the
paper shows and what stands beside them, `averages` what these come to over the places of a bump; `claims.toml` has
what the paper states, `statements` and `claims` judge it, `pump` and `refinement` look at it under other pumps and
steps; `report` lays out.

Two parts have runs of their own, in folders of the same shape: `tracking`, the force tracking of one corner, and
`preview`, the preview chain.
"""

from cosim.experiments.hmmwv import published, runs
from cosim.experiments.layout import experiment

EXPERIMENT = experiment(
    "hmmwv",
    "HMMWV with hydraulic actuators: comfort over bumps and off road (paper 001)",
    runs,
    published.plan,
    parts=("cosim.experiments.hmmwv.tracking:EXPERIMENT", "cosim.experiments.hmmwv.preview:EXPERIMENT"),
    exchange_error=["car.body.az", "car.body.z", "actuator_*.force"],
)
