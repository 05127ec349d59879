"""Handling of the full cars: steady cornering, steps, sines, lane changes, braking in a turn, rollover.

`runs` wires and measures manoeuvres, open loop from tables or closed loop with `Driver`; `design` fits controllers of
the suspension to a car; `metrics` defines what is measured of signals; `published` has the plan of the study; `claims`
what theory leads one to expect; `report` lays out; `web` is the page on which people drive.
"""

from cosim.experiments.handling import published, runs
from cosim.experiments.semi_active.runs import remarks
from cosim.study.experiment import Baseline, Experiment, Measures, RunOptions, Study, Wiring

EXPERIMENT = Experiment(
    "handling",
    runs.Case,
    title="Handling of the full cars: steering, lane changes, braking in a turn, rollover",
    wiring=Wiring(runs.wire, fmus=runs.FMUS, own_fmus="cosim.experiments.own_files:own_fmus"),
    measures=Measures(runs.measure, runs.METRICS, signals=runs.signals, failed=runs.failed, remarks=remarks),
    baseline=Baseline(runs.passive, called=runs.called),
    run=RunOptions(runs.stop_time, record=runs.recorded, interval="1 ms"),
    study=Study(
        published.plan,
        claims="cosim.experiments.handling.claims:CLAIMS",
        report="cosim.experiments.handling.report:report",
        papers="fmu_sources.catalog:PAPERS",
    ),
    web="cosim.experiments.handling.web:live",
    module=__name__,
)
