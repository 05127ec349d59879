"""Test courses of a proving ground: absorbed power, 6 W speed and 2.5 g speed of every car.

Each car runs with every suitable controller.

`runs` wires (as the cars' own experiments do), runs and measures; `course` makes roads of OpenCRG files; `search` finds
the speeds at which a limit is reached; `published` has the plan of the study, `claims` its checks, `report` lays out.
"""

from cosim.experiments.ride import published, runs
from cosim.study.experiment import Experiment

EXPERIMENT = Experiment(
    "ride",
    runs.Case,
    title="Every car over the courses of a proving ground: absorbed power, 6 W speed, obstacles at 2.5 g",
    fmus=runs.FMUS,
    wire=runs.wire,
    structure=runs.structure,
    configure=runs.configure,
    stop_time=runs.stop_time,
    stop_when=runs.stop_when,
    record=runs.recorded,
    record_interval="1 ms",
    measure=runs.measure,
    failed=runs.diverged,
    metrics=runs.METRICS,
    baseline=runs.passive,
    own_baseline=runs.own_baseline,
    called=runs.called,
    about=runs.about,
    remarks=runs.remarks,
    plan=published.plan,
    claims="cosim.experiments.ride.claims:CLAIMS",
    report="cosim.experiments.ride.report:report",
    web="cosim.experiments.ride.web:live",
    own_fmus="cosim.experiments.own_files:own_fmus",
    papers="fmu_sources.catalog:PAPERS",
    module=__name__,
)
