"""Command `cosim identify gpc`: derive the GPC controllers from their plant FMU."""

from __future__ import annotations

import json
import zipfile
from collections.abc import Sequence
from pathlib import Path

import click
from rich.table import Table

from build_fmus.base import safe_files
from build_fmus.base.checks import number
from build_fmus.base.terminal import Command, console, show
from cosim.experiments.gpc.runs import CONTROLLERS, PLANT, R_PUBLISHED, SPEED, road_file
from cosim.experiments.own_files import own_fmus
from cosim.study.commands import make_folder
from cosim.study.options import FMU_FILES, OUT, VEHICLE
from fmu_sources.controllers.gpc.control_law import GpcLaw
from fmu_sources.controllers.gpc.identification import VARIANTS, DesignSettings, IdentificationSettings
from fmu_sources.controllers.gpc.identification import identify as identify_models

_FOUND, _DESIGN = IdentificationSettings(), DesignSettings()


OPTIONS = (
    click.Option(["--seed"], type=click.IntRange(min=0), default=_FOUND.seed, help="seed of the excitation"),
    click.Option(["--order"], type=int, default=_FOUND.order, help="ARX order p"),
    click.Option(["--samples"], type=int, default=_FOUND.samples, help="identification samples L"),
    click.Option(
        ["--excitation"], type=float, default=_FOUND.excitation, help="standard deviation of the excitation [N]"
    ),
    click.Option(["--weight"], type=float, default=R_PUBLISHED, help="control weight R [1/N2]"),
    click.Option(["--horizon"], type=int, default=_DESIGN.h_p, help="prediction horizon h_p"),
    click.Option(["--control-horizon"], type=int, default=_DESIGN.h_c, help="control horizon h_c"),
)


@click.command(
    "gpc", cls=Command, groups={"Identification": OPTIONS, "FMUs": (VEHICLE, *FMU_FILES), "Inputs and results": (OUT,)}
)
def identify(
    seed: int,
    order: int,
    samples: int,
    excitation: float,
    weight: float,
    horizon: int,
    control_horizon: int,
    fmus: Path,
    fmi: int,
    vehicle: Sequence[Path],
    out: Path,
) -> None:
    """Identify the plant, design the three controllers and report whether they equal those in the FMUs."""
    chosen = own_fmus("gpc", fmus, fmi, vehicle)
    for option, value in (("excitation", excitation), ("weight", weight)):
        number(f"--{option}", value, above=0)
    settings = IdentificationSettings(seed=seed, order=order, samples=samples, excitation=excitation)
    folder = make_folder(out / "gpc" / "laws")
    models = identify_models(chosen.path(PLANT), road_file(chosen, "perryman3"), chosen.path(SPEED), settings)
    table = Table("controller", "condition", "residual rms (g, deg, deg)", "equals the FMU's", box=None)
    for variant in VARIANTS:
        law = models.law(variant, DesignSettings(h_p=horizon, h_c=control_horizon, R=weight))
        safe_files.write(folder / f"{variant}-seed{seed}.json", law.to_json())
        with zipfile.ZipFile(chosen.path(CONTROLLERS[variant])) as z:  # type: ignore[arg-type]
            stored = GpcLaw.from_dict(json.loads(z.read("resources/provenance.json")))
        fit = models.implicit if variant == "implicit" else models.explicit
        same = "yes" if stored.to_dict() == json.loads(law.to_json()) else "no"
        residual = ", ".join(f"{x:.2g}" for x in fit.residual_rms)
        table.add_row(variant, f"{fit.condition:.3g}", residual, same)
    show(table)
    console.print(f"{folder}/: the controllers with their gains and provenance as JSON")
