"""Test courses of a proving ground: absorbed power, 6 W speed and 2.5 g speed of every car.

Each car runs with every suitable controller.

`runs` wires (as the cars' own experiments do), runs and measures; `course` makes roads of OpenCRG files; `search` finds
the speeds at which a limit is reached; `published` has the plan of the study, `claims` its checks, `report` lays out.
"""

from cosim.experiments.layout import experiment
from cosim.experiments.ride import published, runs

EXPERIMENT = experiment(
    "ride",
    "Every car over the courses of a proving ground: absorbed power, 6 W speed, obstacles at 2.5 g",
    runs,
    published.plan,
)
