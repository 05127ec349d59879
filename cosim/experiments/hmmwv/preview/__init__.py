"""The preview chain of paper 001: what the range sensors' heights are worth under each filter (Figures 1.5, 1.7).

Range sensors, filter, correction (1.18) and buffer on a car without control forces; and a known profile at the measured
distance beside the loads of the passive hydraulic car. A part of the experiment `hmmwv`: `runs`, `published`,
`claims`, and the sections of the report.
"""

from cosim.experiments.hmmwv.preview import published, runs
from cosim.experiments.layout import experiment

EXPERIMENT = experiment(
    "preview-chain",
    "Preview chain of the HMMWV (paper 001)",
    runs,
    published.plan,
    interval="5 ms",
    takes_files=False,
    report=None,
)
