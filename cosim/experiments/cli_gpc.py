"""Commands of the experiment ``gpc``."""

from __future__ import annotations

import json
import math
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
    Version,
    console,
    kept_recording,
    make_folder,
    metric_table,
    study_page,
    write_summary,
)

TITLE = "Full car under generalized predictive control on three roads (paper 000)"

Vehicle = Annotated[Path | None, typer.Option(help="vehicle file that the FMUs were built for (build-fmus --vehicle)")]


def _fmu_set(fmus: Path, fmi: int, vehicle: Path | None):  # type: ignore[no-untyped-def]
    from cosim.experiments.gpc import GpcFmuSet
    from cosim.experiments.own_files import load_own
    from fmu_sources.catalog import catalog_suffix

    if vehicle is None:
        return GpcFmuSet(fmus, fmi=fmi)
    load_own("gpc", vehicle)  # names a missing file or a mistake in it
    suffix = catalog_suffix(vehicle)
    return GpcFmuSet(fmus, plant=f"FullCar{suffix}", suffix=suffix, vehicle=vehicle, fmi=fmi)


def run(
    road: Annotated[
        str,
        typer.Option(
            metavar=OneOf("cosim.experiments.gpc:ROADS", "FILE.fmu"),
            help="road under the wheels, or the path of a road FMU of your own",
        ),
    ] = "sine",
    speed: Annotated[float, typer.Option(help="speed [km/h]")] = 50.0,
    controller: Annotated[
        str, typer.Option(metavar=OneOf("cosim.experiments.gpc:CONTROLLERS"), help="control law")
    ] = "preview",
    weight: Annotated[float, typer.Option(help="control weight R [1/N2]")] = 1e-7,
    seed: Annotated[int, typer.Option(help="seed of the identification run", min=0)] = 0,
    hold: Annotated[bool, typer.Option(help="explicit only: let the last road height continue ahead")] = False,
    fmus: Fmus = Path("fmus"),
    fmi: Version = 3,
    vehicle: Vehicle = None,
    out: Out = Path("results"),
) -> None:
    """One run over 150 m: prints the published metrics beside the passive car's, writes the time histories as CSV."""
    from cosim.experiments.gpc import GpcBench, Scenario, evaluate
    from cosim.metrics import improvement

    scenario = Scenario(road, speed, controller, R=weight, seed=seed, hold=hold)
    bench = GpcBench(_fmu_set(fmus, fmi, vehicle))
    path = make_folder(out / "gpc") / f"{scenario.label}.csv"
    with kept_recording(path):
        recording = bench.record(scenario, progress=True, csv=path)
    measured = {controller: evaluate(recording)}
    if controller != "passive":
        measured = {"passive": evaluate(bench.record(Scenario(road, speed, "passive"))), **measured}
    rows = {
        "response objective J": ("response", "{:.4f}"), "actuator force [N]": ("force", "{:.0f}"),
        "actuator power [W]": ("power", "{:.0f}"), "peak force [N]": ("peak_force", "{:.0f}"),
        "rms vertical acceleration [m/s2]": ("rms_az", "{:.3f}"), "rms pitch [rad]": ("rms_pitch", "{:.5f}"),
        "rms roll [rad]": ("rms_roll", "{:.5f}"),
    }  # fmt: skip
    table = metric_table(measured, rows)
    if controller != "passive":
        gain = improvement(measured[controller]["response"], measured["passive"]["response"])
        table.add_row("response improvement", "", f"{gain:.3f}")
    show(table)
    write_summary(path, measured, f"; {recording.real_time_factor:.0f}x real time")


def study(
    fmus: Fmus = Path("fmus"),
    fmi: Version = 3,
    vehicle: Vehicle = None,
    out: Out = Path("results"),
    force: Force = False,
    processes: Processes = None,
) -> None:
    """Figures 6 to 12 of the paper and every published claim; writes results/gpc/report.html."""
    from cosim.experiments import gpc_report, gpc_study

    chosen = _fmu_set(fmus, fmi, vehicle)
    chosen.all_paths()  # every file is there before the work begins
    study_page(
        "gpc", out,
        lambda runs, progress: gpc_study.study(chosen, runs, processes=processes, progress=progress),
        lambda result, folder: gpc_report.write(result, chosen, folder),
        force=force,
    )  # fmt: skip


def identify(
    seed: Annotated[int, typer.Option(help="seed of the excitation", min=0)] = 0,
    order: Annotated[int, typer.Option(help="ARX order p")] = 8,
    samples: Annotated[int, typer.Option(help="identification samples L")] = 400,
    excitation: Annotated[float, typer.Option(help="standard deviation of the excitation [N]")] = 2000.0,
    weight: Annotated[float, typer.Option(help="control weight R [1/N2]")] = 1e-7,
    horizon: Annotated[int, typer.Option(help="prediction horizon h_p")] = 8,
    control_horizon: Annotated[int, typer.Option(help="control horizon h_c")] = 8,
    fmus: Fmus = Path("fmus"),
    fmi: Version = 3,
    vehicle: Vehicle = None,
    out: Out = Path("results"),
) -> None:
    """Identify the plant again and design the three laws; says whether they equal those in the controller FMUs."""
    import zipfile

    from fmu_sources.controllers.gpc_design import GpcLaw
    from fmu_sources.controllers.gpc_identification import (
        VARIANTS,
        DesignSettings,
        IdentificationSettings,
        identify,
    )

    chosen = _fmu_set(fmus, fmi, vehicle)
    for option, value in (("excitation", excitation), ("weight", weight)):
        if not (math.isfinite(value) and value > 0):
            raise ValueError(f"--{option} {value:g}: it must be a positive number")
    settings = IdentificationSettings(seed=seed, order=order, samples=samples, excitation=excitation)
    folder = make_folder(out / "gpc" / "laws")
    models = identify(chosen.car, chosen.road("perryman3"), chosen.speed, settings)
    table = Table("law", "condition", "residual rms (g, deg, deg)", "equals the FMU's", box=None)
    for variant in VARIANTS:
        law = models.law(variant, DesignSettings(h_p=horizon, h_c=control_horizon, R=weight))
        safe_files.write(folder / f"{variant}-seed{seed}.json", law.to_json())
        with zipfile.ZipFile(chosen.controller(variant)) as z:  # type: ignore[arg-type]
            stored = GpcLaw.from_dict(json.loads(z.read("resources/provenance.json")))
        fit = models.implicit if variant == "implicit" else models.explicit
        same = "yes" if stored.to_dict() == json.loads(law.to_json()) else "no"
        residual = ", ".join(f"{x:.2g}" for x in fit.residual_rms)
        table.add_row(variant, f"{fit.condition:.3g}", residual, same)
    show(table)
    console.print(f"{folder}/: the laws with their gains and provenance as JSON")
