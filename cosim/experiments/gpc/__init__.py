"""Paper 000: a nonlinear HMMWV on three roads, passive and under three GPC controllers.

`runs` wires, runs and measures; `matching` looks for the weight that gives a controller another's response;
`published` has the paper's conditions and the plan of the study; `results` reads numbers off it. `claims.toml` has the
claims, `claims` judges them, `report` lays out. `identify` derives the controllers again.
"""

from cosim.experiments.layout import experiment

EXPERIMENT = experiment(
    __name__, "Full car under generalized predictive control on three roads (paper 000)", interval="10 ms"
)
