"""Paper 000: a nonlinear HMMWV on three roads, passive and under three GPC controllers.

`runs` wires, runs and measures; `matching` looks for the weight that gives a controller another's response;
`published` has the paper's conditions and the plan of the study; `results` reads numbers off it. `claims.toml` has the
claims, `judge` judges them, `report` lays out. `identify` derives the controllers again.
"""

from cosim.experiments.gpc import published, runs
from cosim.study.experiment import Experiment

EXPERIMENT = Experiment(
    "gpc",
    runs.Case,
    title="Full car under generalized predictive control on three roads (paper 000)",
    fmus=runs.FMUS,
    wire=runs.wire,
    structure=runs.structure,
    configure=runs.configure,
    stop_time=runs.stop_time,
    stop_when=runs.stop_when,
    record=runs.recorded,
    record_interval="10 ms",
    measure=runs.measure,
    signals=runs.signals,
    failed=runs.diverged,
    metrics=runs.METRICS,
    baseline=runs.passive,
    compared=runs.compared,
    remarks=runs.remarks,
    plan=published.plan,
    claims="cosim.experiments.gpc.judge:CLAIMS",
    report="cosim.experiments.gpc.report:report",
    own_fmus="cosim.experiments.own_files:own_fmus",
    papers="fmu_sources.catalog:PAPERS",
    module=__name__,
)
