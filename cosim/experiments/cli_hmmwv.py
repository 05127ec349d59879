"""Commands of the experiment ``hmmwv``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from build_fmus.terminal import OneOf, show
from cosim.experiments.cli_options import (
    Fmus,
    Force,
    MetricRows,
    Out,
    Processes,
    Vehicles,
    Version,
    console,
    fmu_set,
    kept_recording,
    make_folder,
    metric_table,
    study_page,
    write_summary,
)

TITLE = "HMMWV with hydraulic actuators: comfort over bumps and off road (paper 001)"
_ROWS: MetricRows = {
    "absorbed power (published figure) [W]": ("absorbed_power", "{:.2f}"),
    "absorbed power, peak over 1 s [W]": ("absorbed_power_peak", "{:.2f}"),
    "absorbed power, mean [W]": ("absorbed_power_mean", "{:.2f}"),
    "ISO 2631 weighted rms [m/s2]": ("iso2631_rms", "{:.3f}"),
    "suspension travel, rms [mm]": ("travel_rms", "{:.1f}", 1e3),
    "suspension travel, largest [mm]": ("travel_peak", "{:.1f}", 1e3),
    "tyre off the ground [% of the time]": ("lift_off", "{:.1f}", 100.0),
    "actuator force, rms [N]": ("force_rms", "{:.0f}"),
    "actuator force, largest [N]": ("force_peak", "{:.0f}"),
    "force error, rms [N]": ("tracking_error_rms", "{:.0f}"),
    "valve saturated [% of the time]": ("saturation", "{:.1f}", 100.0),
    "flow of the pump, mean [l/min]": ("flow_mean", "{:.0f}"),
}


def run(
    road: Annotated[
        str, typer.Option(metavar=OneOf("cosim.experiments.hmmwv:ROADS"), help="road under the wheels")
    ] = "track",
    controller: Annotated[
        str,
        typer.Option(
            metavar=OneOf("cosim.experiments.hmmwv:CONTROLLERS"),
            help="control law; zero: actuators that are asked for no force",
        ),
    ] = "mpc-preview",
    actuators: Annotated[
        str,
        typer.Option(
            metavar=OneOf("cosim.experiments.hmmwv:ACTUATORS"), help="ideal ones give the force that is asked for"
        ),
    ] = "hydraulic",
    states: Annotated[
        str,
        typer.Option(
            metavar=OneOf("cosim.experiments.hmmwv:STATES"),
            help="states that the controller gets; estimated: by the Kalman filter from noisy sensors",
        ),
    ] = "true",
    preview: Annotated[
        str,
        typer.Option(
            metavar=OneOf("cosim.experiments.hmmwv:PREVIEWS"),
            help="where the preview is from: a known profile, or range sensors",
        ),
    ] = "generated",
    speed: Annotated[float, typer.Option(help="speed [km/h]; the paper drives 20 mph")] = 32.18688,
    variant: Annotated[
        int, typer.Option(help="place of the bump between two control samples, or off-road stretch")
    ] = 0,
    preview_steps: Annotated[int, typer.Option(help="heights ahead that mpc-preview gets, 30 ms apart")] = 15,
    preview_error: Annotated[float, typer.Option(help="the preview shows the road this much too late [ms]")] = 0.0,
    friction: Annotated[bool, typer.Option(help="dry friction in the suspensions")] = False,
    flow_limit: Annotated[bool, typer.Option(help="limit the pump's flow to each actuator")] = False,
    fmus: Fmus = Path("fmus"),
    fmi: Version = 3,
    vehicle: Vehicles = None,
    out: Out = Path("results"),
) -> None:
    """One run: absorbed power and the rest beside the passive car's; time histories as CSV."""
    from cosim.experiments.hmmwv import Case, HmmwvBench, evaluate, remarks
    from cosim.experiments.own_files import check_friction

    case = Case(
        road, controller, actuators, states, preview, speed, variant, preview_steps, preview_error, flow_limit, friction
    )
    if friction and vehicle:
        check_friction(vehicle)
    bench = HmmwvBench(fmu_set("hmmwv", fmus, fmi, vehicle))
    path = make_folder(out / "hmmwv") / f"{case.label}.csv"
    with kept_recording(path):
        recording = bench.record(case, progress=True, csv=path)
    measured = {controller: evaluate(case, recording)}
    if controller != "passive":
        passive = Case(road, "passive", speed_kmh=speed, variant=variant, friction=friction)
        measured = {"passive": bench.measure(passive), **measured}
    show(metric_table(measured, _ROWS))
    for remark in remarks(recording):
        console.print(f"note: {remark}")
    write_summary(path, measured, f"; {recording.real_time_factor:.0f}x real time")
    bench.close()


def study(
    fmus: Fmus = Path("fmus"),
    fmi: Version = 3,
    out: Out = Path("results"),
    force: Force = False,
    processes: Processes = None,
) -> None:
    """The vehicle runs of the paper and its claims; writes results/hmmwv/report.html."""
    from cosim.experiments import hmmwv, hmmwv_report, hmmwv_study
    from cosim.experiments.cases import FmuSet

    chosen = FmuSet(fmus, fmi)
    chosen.paths(hmmwv.all_fmus())  # every file is there before the work begins
    study_page(
        "hmmwv", out,
        lambda runs, progress: hmmwv_study.study(chosen, runs, processes=processes, progress=progress),
        lambda result, folder: hmmwv_report.write(result, chosen, folder),
        force=force,
    )  # fmt: skip
