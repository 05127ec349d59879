"""Passive, semi-active and active suspension of one car: comfort against road holding, frequency responses, energy.

`runs` wires, runs and measures; `published` has the plan of the study; `claims` compares it with theory; `report` lays
out; `web` is the live page.
"""

from cosim.experiments.semi_active import published, runs
from cosim.study.experiment import Baseline, Experiment, Measures, RunOptions, Study, Wiring

EXPERIMENT = Experiment(
    "semi-active",
    runs.Case,
    title="Passive, semi-active and active suspension of one car: comfort, road holding, energy",
    wiring=Wiring(runs.wire, runs.structure, runs.configure, fmus=runs.FMUS),
    measures=Measures(runs.measure, runs.METRICS, signals=runs.signals, remarks=runs.remarks),
    run=RunOptions(runs.stop_time, record=runs.recorded, interval="1 ms"),
    baseline=Baseline(runs.passive),
    study=Study(
        published.plan,
        claims="cosim.experiments.semi_active.claims:CLAIMS",
        report="cosim.experiments.semi_active.report:report",
        papers="fmu_sources.catalog:PAPERS",
    ),
    web="cosim.experiments.semi_active.web:live",
    module=__name__,
)
