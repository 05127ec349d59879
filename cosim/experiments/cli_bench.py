"""Commands of the experiment ``bench``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer
from rich.markup import escape
from rich.table import Table

from build_fmus.terminal import OneOf, show
from cosim.experiments.cli_options import (
    Fmus,
    Force,
    Out,
    Vehicles,
    Version,
    console,
    fmu_set,
    kept_recording,
    make_folder,
    study_page,
    write_summary,
)

TITLE = "LQR and MPC on a quarter-car bench (paper 002)"


def run(
    controller: Annotated[
        str, typer.Option(metavar=OneOf("cosim.experiments.bench:SYSTEMS"), help="control of the bench")
    ] = "mpc",
    road: Annotated[
        str, typer.Option(metavar=OneOf("cosim.experiments.bench:ROADS"), help="motion of the road")
    ] = "bump",
    duration: Annotated[float, typer.Option(help="duration of the bump [s]")] = 0.5,
    height: Annotated[float, typer.Option(help="height of the bump [mm]")] = 20.0,
    encoders: Annotated[bool, typer.Option(help="states from quantised encoders")] = False,
    fmus: Fmus = Path("fmus"),
    fmi: Version = 3,
    vehicle: Vehicles = None,
    out: Out = Path("results"),
) -> None:
    """One run beside the passive bench: metrics on the screen, time histories as CSV."""
    from dataclasses import replace

    from cosim.experiments import bench as experiment

    case = experiment.Case(controller, road, duration, height / 1e3, encoders)
    bench = experiment.Bench(fmu_set("bench", fmus, fmi, vehicle))
    path = make_folder(out / "bench") / f"{case.label}.csv"
    measured = {"passive": experiment.metrics(bench.record(replace(case, system="passive", encoders=False)))}
    with kept_recording(path):
        recording = bench.record(case, csv=path)
    measured[controller] = experiment.metrics(recording)
    bench.close()
    table = Table("metric", *measured, box=None)
    for key, (text, unit, factor) in experiment.UNITS.items():
        table.add_row(escape(f"{text} [{unit}]"), *(f"{factor * m[key]:.4g}" for m in measured.values()))
    show(table)
    if "controller.command.held" in recording and recording["controller.command.held"].any():
        console.print("command.held: the solver found no solution at some samples; the last force was kept")
    write_summary(path, measured)


def study(fmus: Fmus = Path("fmus"), fmi: Version = 3, out: Out = Path("results"), force: Force = False) -> None:
    """Figures 6 to 10 of the paper and its claims; writes results/bench/report.html."""
    from cosim.experiments import bench_report, bench_study
    from cosim.experiments.cases import FmuSet

    chosen = FmuSet(fmus, fmi)
    chosen.paths(bench_report.FMUS)  # every file is there before the work begins
    study_page(
        "bench", out,
        lambda _, progress: bench_study.study(chosen, progress),
        lambda result, folder: bench_report.write(result, chosen, folder),
        force=force,
        resumes=False,
    )  # fmt: skip
