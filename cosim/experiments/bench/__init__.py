"""Paper 002: a quarter-car bench under LQR and MPC.

`runs` wires, runs and measures; `published` has what the paper prints and the runs that stand beside it; `claims`
judges; `report` lays out.
"""

from cosim.experiments.bench import published, runs
from cosim.study.experiment import Baseline, Experiment, Measures, RunOptions, Study, Wiring

EXPERIMENT = Experiment(
    "bench",
    runs.Case,
    title="LQR and MPC on a quarter-car bench (paper 002)",
    wiring=Wiring(
        runs.wire, runs.structure, runs.configure, fmus=runs.FMUS, own_fmus="cosim.experiments.own_files:own_fmus"
    ),
    measures=Measures(runs.measure, runs.METRICS, signals=runs.signals, remarks=runs.remarks),
    run=RunOptions(runs.stop_time, record=runs.recorded, interval="1 ms"),
    baseline=Baseline(runs.passive),
    study=Study(
        published.plan,
        claims="cosim.experiments.bench.claims:CLAIMS",
        report="cosim.experiments.bench.report:report",
        papers="fmu_sources.catalog:PAPERS",
    ),
    module=__name__,
)
