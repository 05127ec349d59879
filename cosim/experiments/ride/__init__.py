"""Test courses of a proving ground: absorbed power, 6 W speed and 2.5 g speed of every car.

Each car runs with every suitable controller.

`runs` wires (as the cars' own experiments do), runs and measures; `course` makes roads of OpenCRG files; `search` finds
the speeds at which a limit is reached; `published` has the plan of the study, `claims` its checks, `report` lays out.
"""

from cosim.experiments.ride import published, runs
from cosim.study.experiment import Baseline, Experiment, Measures, RunOptions, Study, Wiring

EXPERIMENT = Experiment(
    "ride",
    runs.Case,
    title="Every car over the courses of a proving ground: absorbed power, 6 W speed, obstacles at 2.5 g",
    wiring=Wiring(
        runs.wire, runs.structure, runs.configure, fmus=runs.FMUS, own_fmus="cosim.experiments.own_files:own_fmus"
    ),
    measures=Measures(runs.measure, runs.METRICS, failed=runs.diverged, remarks=runs.remarks),
    run=RunOptions(runs.stop_time, record=runs.recorded, interval="1 ms", stop_when=runs.stop_when),
    baseline=Baseline(runs.passive, own=runs.own_baseline, called=runs.called, about=runs.about),
    study=Study(
        published.plan,
        claims="cosim.experiments.ride.claims:CLAIMS",
        report="cosim.experiments.ride.report:report",
        papers="fmu_sources.catalog:PAPERS",
    ),
    web="cosim.experiments.ride.web:live",
    module=__name__,
)
