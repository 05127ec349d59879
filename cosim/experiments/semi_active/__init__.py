"""Passive, semi-active and active suspension of one car: comfort against road holding, frequency responses, energy.

`runs` wires, runs and measures; `published` has the plan of the study; `claims` compares it with theory; `report` lays
out; `web` is the live page.
"""

from cosim.experiments.layout import experiment
from cosim.experiments.semi_active import published, runs

EXPERIMENT = experiment(
    "semi-active",
    "Passive, semi-active and active suspension of one car: comfort, road holding, energy",
    runs,
    published.plan,
    takes_files=False,
)
