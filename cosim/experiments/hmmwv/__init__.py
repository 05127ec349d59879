"""Paper 001: a HMMWV on hydraulic actuators, from the servo valve to what the driver feels.

`runs` wires, runs and measures the vehicle (`wiring`: what its parts wire too); `published` has the runs that the
paper shows and what stands beside them, `averages` what these come to over the places of a bump; `claims.toml` has
what the paper states, `statements` and `claims` judge it, `pump` and `refinement` look at it under other pumps and
steps; `report` lays out.

Two parts have runs of their own, in folders of the same shape: `tracking`, the force tracking of one corner, and
`preview`, the preview chain.
"""

from cosim.experiments.hmmwv import published, runs
from cosim.study.experiment import Baseline, Experiment, Measures, RunOptions, Study, Wiring

EXPERIMENT = Experiment(
    "hmmwv",
    runs.Case,
    title="HMMWV with hydraulic actuators: comfort over bumps and off road (paper 001)",
    wiring=Wiring(
        runs.wire, runs.structure, runs.configure, fmus=runs.FMUS, own_fmus="cosim.experiments.own_files:own_fmus"
    ),
    measures=Measures(runs.measure, runs.METRICS, signals=runs.signals, remarks=runs.remarks),
    run=RunOptions(runs.stop_time, record=runs.recorded, interval="1 ms", begin=runs.begin),
    baseline=Baseline(runs.passive, own=runs.own_baseline, called=runs.called, about=runs.about),
    study=Study(
        published.plan,
        parts=("cosim.experiments.hmmwv.tracking:EXPERIMENT", "cosim.experiments.hmmwv.preview:EXPERIMENT"),
        claims="cosim.experiments.hmmwv.claims:CLAIMS",
        exchange_error=["car.body.az", "car.body.z", "actuator_*.force"],
        report="cosim.experiments.hmmwv.report:report",
        papers="fmu_sources.catalog:PAPERS",
    ),
    web="cosim.experiments.hmmwv.web:live",
    module=__name__,
)
