"""Force tracking of paper 001: one corner of the standing HMMWV follows prescribed forces (Figures 1.4 and 1.8).

A part of the experiment `hmmwv`: `runs`, `published`, `claims`, and the section of the report.
"""

from cosim.experiments.hmmwv.tracking import published, runs
from cosim.experiments.layout import experiment

EXPERIMENT = experiment(
    "force-tracking",
    "Force tracking of one corner of the HMMWV (paper 001)",
    runs,
    published.plan,
    takes_files=False,
    report=None,
)
