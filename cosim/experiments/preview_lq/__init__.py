"""Paper 004: value of preview on a car with seven degrees of freedom, by LQ control with three information patterns.

`runs` wires, runs and measures; `design` has the poles of the continuous design, which need no run; `published` has the
printed values of the paper and the runs compared with them; `claims` judges; `report` lays out.
"""

from cosim.experiments.preview_lq import published, runs
from cosim.study.experiment import Experiment

EXPERIMENT = Experiment(
    "preview-lq",
    runs.Case,
    title="Optimal preview LQ control of a car with seven degrees of freedom (paper 004)",
    fmus=runs.FMUS,
    wire=runs.wire,
    structure=runs.structure,
    configure=runs.configure,
    stop_time=runs.stop_time,
    record=runs.recorded,
    record_interval=runs.INTERVAL,
    measure=runs.measure,
    signals=runs.signals,
    metrics=runs.METRICS,
    baseline=runs.passive,
    relative=True,
    remarks=runs.remarks,
    plan=published.plan,
    claims="cosim.experiments.preview_lq.claims:CLAIMS",
    report="cosim.experiments.preview_lq.report:report",
    own_fmus="cosim.experiments.own_files:own_fmus",
    web="cosim.experiments.preview_lq.web:live",
    papers="fmu_sources.catalog:PAPERS",
    module=__name__,
)
