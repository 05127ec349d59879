"""Handling of the full cars: steady cornering, steps, sines, lane changes, braking in a turn, rollover.

`runs` wires and measures manoeuvres, open loop from tables or closed loop with `Driver`; `design` fits controllers of
the suspension to a car; `metrics` defines what is measured of signals; `published` has the plan of the study; `claims`
what theory leads one to expect; `report` lays out; `web` is the page on which people drive.
"""

from cosim.experiments.handling import published, runs
from cosim.experiments.layout import experiment

EXPERIMENT = experiment(
    "handling",
    "Handling of the full cars: steering, lane changes, braking in a turn, rollover",
    runs,
    published.plan,
)
