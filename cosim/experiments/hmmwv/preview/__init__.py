"""The preview chain of paper 001: what the range sensors' heights are worth under each filter (Figures 1.5, 1.7).

Range sensors, filter, correction (1.18) and buffer on a car without control forces; and a known profile at the measured
distance beside the loads of the passive hydraulic car.
"""

from cosim.experiments.layout import experiment

EXPERIMENT = experiment(
    __name__,
    "Preview chain of the HMMWV (paper 001)",
    name="preview-chain",
    interval="5 ms",
    takes_files=False,
    report=None,
)
