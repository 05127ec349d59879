"""Paper 004: value of preview on a car with seven degrees of freedom, by LQ control with three information patterns.

`runs` wires, runs and measures; `design` has the poles of the continuous design, which need no run; `published` has the
printed values of the paper and the runs compared with them; `claims` judges; `report` lays out.
"""

from cosim.experiments.layout import experiment
from cosim.experiments.preview_lq import runs

EXPERIMENT = experiment(
    __name__,
    "Optimal preview LQ control of a car with seven degrees of freedom (paper 004)",
    interval=runs.INTERVAL,
    relative=True,
)
