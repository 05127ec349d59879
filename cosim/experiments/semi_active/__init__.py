"""Passive, semi-active and active suspension of one car: comfort against road holding, frequency responses, energy."""

from cosim.experiments.layout import experiment

EXPERIMENT = experiment(
    __name__, "Passive, semi-active and active suspension of one car: comfort, road holding, energy", takes_files=False
)
