"""Commands of the experiment ``three-axle``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from build_fmus.terminal import OneOf, show
from cosim.experiments.cli_options import (
    Fmus,
    Force,
    Out,
    Processes,
    Vehicles,
    Version,
    fmu_set,
    kept_recording,
    make_folder,
    metric_table,
    study_page,
    write_summary,
)

TITLE = "6x6 on shallow trenches: LQR and predictive control with preview (paper 003)"
_ROWS = {
    "peak pitch error at the trench [deg]": ("peak_error_deg", "{:.4f}"),
    "rms pitch error at the trench [deg]": ("rms_error_deg", "{:.4f}"),
    "rms pitch error on the ramp [deg]": ("ramp_error_deg", "{:.4f}"),
    "steady pitch error [deg]": ("steady_error_deg", "{:.4f}"),
    "peak heave [m]": ("peak_heave_m", "{:.3f}"),
    "rms vertical acceleration at the trench [m/s2]": ("rms_az", "{:.3f}"),
    "peak force [kN]": ("peak_force_kN", "{:.1f}"),
    "force before the edge [kN]": ("force_before_edge_kN", "{:.2f}"),
    "largest slack [-]": ("slack", "{:.3f}"),
}


def run(
    speed: Annotated[float, typer.Option(help="speed [km/h]")] = 5.0,
    depth: Annotated[float, typer.Option(help="depth of the trench [m]")] = 0.15,
    system: Annotated[
        str, typer.Option(metavar=OneOf("cosim.experiments.three_axle:SYSTEMS"), help="control law")
    ] = "mpc-preview",
    estimator: Annotated[
        str,
        typer.Option(
            metavar=OneOf("cosim.experiments.three_axle:ESTIMATORS"), help="observer of the predictive controllers"
        ),
    ] = "offsets",
    hold_height: Annotated[bool, typer.Option(help="weigh the height of the body too")] = False,
    fmus: Fmus = Path("fmus"),
    fmi: Version = 3,
    vehicle: Vehicles = None,
    out: Out = Path("results"),
) -> None:
    """One run over a shallow trench and a pitch reference; metrics beside the passive vehicle's, time histories as CSV."""
    from cosim.experiments.three_axle import Case, ThreeAxleBench, metrics

    case = Case(speed, depth, system, estimator, hold_height)
    bench = ThreeAxleBench(fmu_set("three-axle", fmus, fmi, vehicle))
    path = make_folder(out / "three-axle") / f"{case.label}.csv"
    with kept_recording(path):
        recording = bench.record(case, csv=path)
    measured = {system: metrics(recording, case)}
    if system != "passive":
        measured = {"passive": bench.measure(Case(speed, depth, "passive")), **measured}
    show(metric_table(measured, _ROWS))
    write_summary(path, measured, f"; {recording.real_time_factor:.0f}x real time")
    bench.close()


def study(
    fmus: Fmus = Path("fmus"),
    fmi: Version = 3,
    out: Out = Path("results"),
    force: Force = False,
    processes: Processes = None,
) -> None:
    """Table 5.1, Figures 5.4 to 5.14 and the claims on them; writes results/three-axle/report.html."""
    from cosim.experiments import three_axle_report, three_axle_study
    from cosim.experiments.cases import FmuSet
    from cosim.experiments.three_axle import FMUS

    chosen = FmuSet(fmus, fmi)
    chosen.paths(FMUS)  # every file is there before the work begins
    study_page(
        "three-axle", out,
        lambda runs, progress: three_axle_study.study(chosen, runs, processes=processes, progress=progress),
        lambda result, folder: three_axle_report.write(result, chosen, folder),
        force=force,
    )  # fmt: skip
