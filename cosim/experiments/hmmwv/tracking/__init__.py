"""Force tracking of paper 001: one corner of the standing HMMWV follows prescribed forces (Figures 1.4 and 1.8).

A part of the experiment `hmmwv`: `runs`, `published`, `claims`, and the section of the report.
"""

from cosim.experiments.hmmwv.tracking import published, runs
from cosim.study.experiment import Experiment

EXPERIMENT = Experiment(
    "force-tracking",
    runs.Case,
    title="Force tracking of one corner of the HMMWV (paper 001)",
    fmus=runs.FMUS,
    wire=runs.wire,
    stop_time=runs.stop_time,
    record=runs.recorded,
    record_interval="1 ms",
    measure=runs.measure,
    signals=runs.signals,
    metrics=runs.METRICS,
    plan=published.plan,
    claims="cosim.experiments.hmmwv.tracking.claims:CLAIMS",
    papers="fmu_sources.catalog:PAPERS",
    module=__name__,
)
