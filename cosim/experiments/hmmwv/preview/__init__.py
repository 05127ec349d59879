"""The preview chain of paper 001: what the range sensors' heights are worth under each filter (Figures 1.5, 1.7).

Range sensors, filter, correction (1.18) and buffer on a car without control forces; and a known profile at the measured
distance beside the loads of the passive hydraulic car. A part of the experiment `hmmwv`: `runs`, `published`,
`claims`, and the sections of the report.
"""

from cosim.experiments.hmmwv.preview import published, runs
from cosim.study.experiment import Experiment, Measures, RunOptions, Study, Wiring

EXPERIMENT = Experiment(
    "preview-chain",
    runs.Case,
    title="Preview chain of the HMMWV (paper 001)",
    wiring=Wiring(runs.wire, runs.structure, runs.configure, fmus=runs.FMUS),
    measures=Measures(runs.measure, runs.METRICS, signals=runs.signals),
    run=RunOptions(runs.stop_time, record=runs.recorded, interval="5 ms"),
    study=Study(
        published.plan, claims="cosim.experiments.hmmwv.preview.claims:CLAIMS", papers="fmu_sources.catalog:PAPERS"
    ),
    module=__name__,
)
