"""Paper 003, linear part: a 6x6 crosses shallow trenches and follows a pitch reference under three controllers.

`runs` wires, runs and measures; `published` has the runs of Table 5.1 and what stands beside them; `claims`
judges; `report` lays out.
"""

from cosim.experiments.three_axle import published, runs
from cosim.study.experiment import Baseline, Experiment, Measures, RunOptions, Study, Wiring

EXPERIMENT = Experiment(
    "three-axle",
    runs.Case,
    title="6x6 on shallow trenches: LQR and predictive control with preview (paper 003)",
    wiring=Wiring(
        runs.wire, runs.structure, runs.configure, fmus=runs.FMUS, own_fmus="cosim.experiments.own_files:own_fmus"
    ),
    measures=Measures(runs.measure, runs.METRICS, signals=runs.signals),
    run=RunOptions(runs.DURATION, record=runs.recorded, interval="5 ms"),
    baseline=Baseline(runs.passive),
    study=Study(
        published.plan,
        claims="cosim.experiments.three_axle.claims:CLAIMS",
        report="cosim.experiments.three_axle.report:report",
        papers="fmu_sources.catalog:PAPERS",
    ),
    module=__name__,
)
