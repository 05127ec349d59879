"""Force tracking of paper 001: one corner of the standing HMMWV follows prescribed forces (Figures 1.4 and 1.8).

A part of the experiment `hmmwv`: `runs`, `published`, `claims`, and the section of the report.
"""

from cosim.experiments.hmmwv.tracking import published, runs
from cosim.study.experiment import Experiment, Measures, RunOptions, Study, Wiring

EXPERIMENT = Experiment(
    "force-tracking",
    runs.Case,
    title="Force tracking of one corner of the HMMWV (paper 001)",
    wiring=Wiring(runs.wire, fmus=runs.FMUS),
    measures=Measures(runs.measure, runs.METRICS, signals=runs.signals),
    run=RunOptions(runs.stop_time, record=runs.recorded, interval="1 ms"),
    study=Study(
        published.plan, claims="cosim.experiments.hmmwv.tracking.claims:CLAIMS", papers="fmu_sources.catalog:PAPERS"
    ),
    module=__name__,
)
