"""Commands of the experiment ``preview-lq``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer
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

TITLE = "Optimal preview LQ control of a seven-degree car (paper 004)"


def run(
    input: Annotated[
        str, typer.Option(metavar=OneOf("cosim.experiments.preview_lq:INPUTS"), help="wheels that meet hole and bump")
    ] = "both",
    weights: Annotated[
        str,
        typer.Option(
            metavar=OneOf("cosim.experiments.preview_lq:CONTROLLERS", "FILE.toml"),
            help="weights of the law, or a file of your own (build-fmus --weights)",
        ),
    ] = "comfort",
    system: Annotated[
        str,
        typer.Option(
            metavar=OneOf("cosim.experiments.preview_lq:SYSTEMS"), help="what the controller uses of the road"
        ),
    ] = "preview",
    preview_time: Annotated[float, typer.Option(help="preview ahead of the front wheels [s]")] = 0.12,
    speed: Annotated[float, typer.Option(help="speed [km/h]")] = 75.0,
    shape: Annotated[
        str, typer.Option(metavar=OneOf("cosim.experiments.preview_lq:SHAPES"), help="shape of hole and bump")
    ] = "haversine",
    hold_tail: Annotated[bool, typer.Option(help="take the road to continue at its last height")] = False,
    fmus: Fmus = Path("fmus"),
    fmi: Version = 3,
    vehicle: Vehicles = None,
    out: Out = Path("results"),
) -> None:
    """One run over hole and bump: mean squares and index beside the passive car's; time histories as CSV."""
    from dataclasses import replace

    from cosim.experiments import preview_lq as experiment

    case = experiment.Case(input, weights, system, preview_time, speed, shape, hold_tail)
    fmu_files = fmu_set("preview-lq", fmus, fmi, vehicle, case.own_weights)
    experiment.check_weights(fmu_files, case)
    bench = experiment.PreviewLqBench(fmu_files)
    path = make_folder(out / "preview-lq") / f"{case.label}.csv"
    with kept_recording(path):
        recording = bench.record(case, csv=path)
    passive = bench.record(replace(case, system="passive"))
    chosen = experiment.weights_of(case)
    measured = {}
    for name, r in {"passive": passive, system: recording}.items():
        measured[name] = {**experiment.components(r), "J": experiment.index(r, chosen)}
    table = Table("mean square", *measured, "per cent of passive", box=None)
    for key, base in measured["passive"].items():
        value = measured[system][key]
        share = f"{100 * value / base:.1f}" if base > 1e-20 else "-"
        table.add_row(key, *(f"{m[key]:.4g}" for m in measured.values()), share)
    show(table)
    if system != "passive" and recording["controller.horizon_truncated"].any():
        console.print("horizon_truncated: preview or memory end before the horizon that was asked for")
    write_summary(path, measured)
    bench.close()


def study(fmus: Fmus = Path("fmus"), fmi: Version = 3, out: Out = Path("results"), force: Force = False) -> None:
    """Tables 2 and 3, figures 3 to 7 of the paper and its claims; writes results/preview-lq/report.html."""
    from cosim.experiments import preview_lq_report, preview_lq_study
    from cosim.experiments.cases import FmuSet

    chosen = FmuSet(fmus, fmi)
    chosen.paths(preview_lq_report.FMUS)  # every file is there before the work begins
    study_page(
        "preview-lq", out,
        lambda _, progress: preview_lq_study.study(chosen, progress),
        lambda result, folder: preview_lq_report.write(result, chosen, folder),
        force=force,
        resumes=False,
    )  # fmt: skip
