"""Paper 004: value of preview on a car with seven degrees of freedom, by LQ control with three information patterns.

`runs` wires, runs and measures; `design` has the poles of the continuous design, which need no run; `published` has the
printed values of the paper and the runs compared with them; `claims` judges; `report` lays out.
"""

from cosim.experiments.preview_lq import published, runs
from cosim.study.experiment import Baseline, Experiment, Measures, RunOptions, Study, Wiring

EXPERIMENT = Experiment(
    "preview-lq",
    runs.Case,
    title="Optimal preview LQ control of a car with seven degrees of freedom (paper 004)",
    wiring=Wiring(
        runs.wire, runs.structure, runs.configure, fmus=runs.FMUS, own_fmus="cosim.experiments.own_files:own_fmus"
    ),
    measures=Measures(runs.measure, runs.METRICS, signals=runs.signals, remarks=runs.remarks),
    run=RunOptions(runs.stop_time, record=runs.recorded, interval=runs.INTERVAL),
    baseline=Baseline(runs.passive, relative=True),
    study=Study(
        published.plan,
        claims="cosim.experiments.preview_lq.claims:CLAIMS",
        report="cosim.experiments.preview_lq.report:report",
        papers="fmu_sources.catalog:PAPERS",
    ),
    web="cosim.experiments.preview_lq.web:live",
    module=__name__,
)
