"""Paper 000: a nonlinear HMMWV on three roads, passive and under three GPC controllers.

`runs` wires, runs and measures; `matching` looks for the weight that gives a controller another's response;
`published` has the paper's conditions and the plan of the study; `results` reads numbers off it. `claims.toml` has the
claims, `judge` judges them, `report` lays out. `identify` derives the controllers again.
"""

from cosim.experiments.gpc import published, runs
from cosim.study.experiment import Baseline, Experiment, Measures, RunOptions, Study, Wiring

EXPERIMENT = Experiment(
    "gpc",
    runs.Case,
    title="Full car under generalized predictive control on three roads (paper 000)",
    wiring=Wiring(
        runs.wire, runs.structure, runs.configure, fmus=runs.FMUS, own_fmus="cosim.experiments.own_files:own_fmus"
    ),
    measures=Measures(runs.measure, runs.METRICS, signals=runs.signals, failed=runs.diverged, remarks=runs.remarks),
    run=RunOptions(runs.stop_time, record=runs.recorded, interval="10 ms", stop_when=runs.stop_when),
    baseline=Baseline(runs.passive, compared=runs.compared),
    study=Study(
        published.plan,
        claims="cosim.experiments.gpc.judge:CLAIMS",
        report="cosim.experiments.gpc.report:report",
        papers="fmu_sources.catalog:PAPERS",
    ),
    module=__name__,
)
