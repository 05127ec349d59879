"""Paper 003: a 6x6 crosses a trench, passive or under control; any length and speed.

`runs` wires, runs and measures; `linear` is a part with runs of its own, the linear vehicle beside this one;
`published` has what the paper prints (`published.csv`) and the runs that stand beside it; `claims` judges;
`report` lays out.
"""

from cosim.experiments.trench import linear, published, runs
from cosim.study.experiment import Experiment

EXPERIMENT = Experiment(
    "trench",
    runs.Case,
    title="A 6x6 crosses trenches with preview MPC (paper 003)",
    fmus=runs.FMUS,
    wire=runs.wire,
    structure=runs.structure,
    configure=runs.configure,
    stop_time=runs.stop_time,
    stop_when=runs.stop_when,
    record=runs.recorded,
    record_interval=runs.step,
    measure=runs.measure,
    signals=runs.signals,
    metrics=runs.METRICS,
    baseline=runs.passive,
    plan=published.plan,
    parts=[linear.PART],
    claims="cosim.experiments.trench.claims:CLAIMS",
    report="cosim.experiments.trench.report:report",
    page="cosim.experiments.trench.report:page",
    own_fmus="cosim.experiments.own_files:own_fmus",
    web="cosim.experiments.trench.web:live",
    papers="fmu_sources.catalog:PAPERS",
    module=__name__,
)
