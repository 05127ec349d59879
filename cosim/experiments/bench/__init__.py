"""Paper 002: a quarter-car bench under LQR and MPC.

`runs` wires, runs and measures; `published` has what the paper prints and the runs that stand beside it; `claims`
judges; `report` lays out.
"""

from cosim.experiments.bench import published, runs
from cosim.study.experiment import Experiment

EXPERIMENT = Experiment(
    "bench",
    runs.Case,
    title="LQR and MPC on a quarter-car bench (paper 002)",
    fmus=runs.FMUS,
    wire=runs.wire,
    structure=runs.structure,
    configure=runs.configure,
    stop_time=runs.stop_time,
    record=runs.recorded,
    record_interval="1 ms",
    measure=runs.measure,
    signals=runs.signals,
    metrics=runs.METRICS,
    baseline=runs.passive,
    remarks=runs.remarks,
    plan=published.plan,
    claims="cosim.experiments.bench.claims:CLAIMS",
    report="cosim.experiments.bench.report:report",
    own_fmus="cosim.experiments.own_files:own_fmus",
    papers="fmu_sources.catalog:PAPERS",
    module=__name__,
)
