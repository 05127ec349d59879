"""Paper 003, linear part: a 6x6 crosses shallow trenches and follows a pitch reference under three controllers.

`runs` wires, runs and measures; `published` has the runs of Table 5.1 and what stands beside them; `claims`
judges; `report` lays out.
"""

from cosim.experiments.three_axle import published, runs
from cosim.study.experiment import Experiment

EXPERIMENT = Experiment(
    "three-axle",
    runs.Case,
    title="6x6 on shallow trenches: LQR and predictive control with preview (paper 003)",
    fmus=runs.FMUS,
    wire=runs.wire,
    structure=runs.structure,
    configure=runs.configure,
    stop_time=runs.DURATION,
    record=runs.recorded,
    record_interval="5 ms",
    measure=runs.measure,
    signals=runs.signals,
    metrics=runs.METRICS,
    baseline=runs.passive,
    plan=published.plan,
    claims="cosim.experiments.three_axle.claims:CLAIMS",
    report="cosim.experiments.three_axle.report:report",
    own_fmus="cosim.experiments.own_files:own_fmus",
    papers="fmu_sources.catalog:PAPERS",
    module=__name__,
)
