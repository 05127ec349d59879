"""Force tracking of paper 001: one corner of the standing HMMWV follows prescribed forces (Figures 1.4 and 1.8)."""

from cosim.experiments.layout import experiment

EXPERIMENT = experiment(
    __name__,
    "Force tracking of one corner of the HMMWV (paper 001)",
    name="force-tracking",
    takes_files=False,
    report=None,
)
