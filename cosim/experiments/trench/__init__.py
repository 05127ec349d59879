"""Paper 003: a 6x6 crosses a trench, passive or under control; any length and speed.

`runs` wires, runs and measures; `linear` is a part with runs of its own, the linear vehicle beside this one;
`published` has what the paper prints (`published.csv`) and the runs that stand beside it; `claims` judges;
`report` lays out.
"""

from cosim.experiments.trench import linear, published, runs
from cosim.study.experiment import Baseline, Experiment, Measures, RunOptions, Study, Wiring

EXPERIMENT = Experiment(
    "trench",
    runs.Case,
    title="A 6x6 crosses trenches with preview MPC (paper 003)",
    wiring=Wiring(
        runs.wire, runs.structure, runs.configure, fmus=runs.FMUS, own_fmus="cosim.experiments.own_files:own_fmus"
    ),
    measures=Measures(runs.measure, runs.METRICS, signals=runs.signals),
    run=RunOptions(runs.stop_time, record=runs.recorded, interval=runs.step, stop_when=runs.stop_when),
    baseline=Baseline(runs.passive),
    study=Study(
        published.plan,
        parts=[linear.PART],
        claims="cosim.experiments.trench.claims:CLAIMS",
        report="cosim.experiments.trench.report:report",
        papers="fmu_sources.catalog:PAPERS",
    ),
    page="cosim.experiments.trench.report:page",
    web="cosim.experiments.trench.web:live",
    module=__name__,
)
