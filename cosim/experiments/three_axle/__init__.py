"""Paper 003, linear part: a 6x6 crosses shallow trenches and follows a pitch reference under three controllers.

`runs` wires, runs and measures; `published` has the runs of Table 5.1 and what stands beside them; `claims`
judges; `report` lays out.
"""

from cosim.experiments.layout import experiment

EXPERIMENT = experiment(
    __name__, "6x6 on shallow trenches: LQR and predictive control with preview (paper 003)", interval="5 ms"
)
