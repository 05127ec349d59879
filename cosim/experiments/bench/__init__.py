"""Paper 002: a quarter-car bench under LQR and MPC.

`runs` wires, runs and measures; `published` has what the paper prints and the runs that stand beside it; `claims`
judges; `report` lays out.
"""

from cosim.experiments.layout import experiment

EXPERIMENT = experiment(__name__, "LQR and MPC on a quarter-car bench (paper 002)")
