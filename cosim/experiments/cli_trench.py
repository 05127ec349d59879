"""Commands of the experiment ``trench``."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated

import typer
from rich.table import Table

from build_fmus import safe_files
from build_fmus.terminal import OneOf, show
from cosim.experiments.cli_options import (
    Fmus,
    Force,
    Out,
    Processes,
    Vehicles,
    Version,
    console,
    fmu_set,
    kept_recording,
    make_folder,
    study_page,
)

TITLE = "A 6x6 crosses trenches with preview MPC (paper 003)"


def run(
    length: Annotated[float, typer.Option(help="length of the trench [m]")] = 1.6,
    speed: Annotated[float, typer.Option(help="speed [km/h]")] = 6.0,
    control: Annotated[
        str,
        typer.Option(
            metavar=OneOf("cosim.experiments.trench:CONTROLS"), help="control law; mpc-...: mpc with one thing changed"
        ),
    ] = "mpc",
    depth: Annotated[float | None, typer.Option(help="depth of the trench [m]")] = None,
    friction: Annotated[float | None, typer.Option(help="friction coefficient of the tyres")] = None,
    mass: Annotated[float | None, typer.Option(help="sprung mass [kg]")] = None,
    cg_offset: Annotated[float | None, typer.Option(help="CG ahead of where the vehicle file has it [m]")] = None,
    hydropneumatic: Annotated[bool, typer.Option(help="gas springs instead of linear ones")] = False,
    fmus: Fmus = Path("fmus"),
    fmi: Version = 3,
    vehicle: Vehicles = None,
    out: Out = Path("results"),
) -> None:
    """One crossing beside that of the passive vehicle: quantities, time histories as CSV, and a page that plays it."""
    from dataclasses import replace

    from cosim.experiments import trench, trench_report
    from cosim.metrics_crossing import LABELS, LIMITS, WEIGHTS
    from cosim.report import write_report

    case = trench.Case(length, speed, control, depth, friction, mass, cg_offset, hydropneumatic)
    chosen = fmu_set("trench", fmus, fmi, vehicle)
    folder = make_folder(out / "trench" / case.label)
    bench = trench.TrenchBench(chosen)
    rows, frames = {}, {}
    for system in dict.fromkeys(("passive", control)):
        one = replace(case, control=system)
        with kept_recording(path := folder / f"{system}.csv"):
            recording = bench.record(one, csv=path, progress=True)
        rows[system] = trench.evaluate(one, trench.Course.of(bench.system(one), one), recording)
        frames[system] = trench.frames(one, recording)
    bench.close()
    table = Table("quantity", "limit", *rows, box=None)
    for name in WEIGHTS:
        table.add_row(LABELS[name], f"{getattr(LIMITS, name):g}", *(f"{r[name]:.4g}" for r in rows.values()))
    table.add_row("cost", "", *(f"{r['cost']:.0f}" for r in rows.values()))
    table.add_row("outcome", "", *(trench.outcome(r) for r in rows.values()))
    show(table)
    safe_files.write(folder / "metrics.json", json.dumps(rows, indent=1) + "\n")
    path = write_report(trench_report.single(case, rows, frames, chosen), folder)
    console.print(f"page with animation: {path}")


def study(
    published_only: Annotated[
        bool, typer.Option(help="the 36 passive and 36 controlled crossings only, nothing left out or changed")
    ] = False,
    fmus: Fmus = Path("fmus"),
    fmi: Version = 3,
    out: Out = Path("results"),
    force: Force = False,
    processes: Processes = None,
) -> None:
    """Tables 5.4 to 5.11, what the crossing depends on, and the animation; writes results/trench/report.html."""
    from cosim.experiments import trench_report, trench_study
    from cosim.experiments.cases import FmuSet

    chosen = FmuSet(fmus, fmi)
    chosen.paths(trench_study.fmu_names())  # every file is there before the work begins
    study_page(
        "trench", out,
        lambda runs, progress: trench_study.study(chosen, runs, published_only=published_only, processes=processes, progress=progress),
        lambda result, folder: trench_report.write(result, chosen, folder),
        force=force,
    )  # fmt: skip
