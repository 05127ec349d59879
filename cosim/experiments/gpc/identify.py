"""Command `cosim identify gpc`: derive the GPC controllers from their plant FMU."""

from __future__ import annotations

import json
import zipfile
from pathlib import Path
from typing import Annotated

import typer
from rich.table import Table

from build_fmus.base import safe_files
from build_fmus.base.checks import number
from build_fmus.base.layout import FMUS
from build_fmus.base.terminal import console, show
from cosim.experiments.gpc.runs import CONTROLLERS, PLANT, R_PUBLISHED, SPEED, road_file
from cosim.experiments.own_files import own_fmus
from cosim.study.commands import Fmus, Out, Vehicles, Version, make_folder
from fmu_sources.controllers.gpc.control_law import GpcLaw
from fmu_sources.controllers.gpc.identification import VARIANTS, DesignSettings, IdentificationSettings
from fmu_sources.controllers.gpc.identification import identify as identify_models

_FOUND, _DESIGN = IdentificationSettings(), DesignSettings()


def identify(
    seed: Annotated[int, typer.Option(help="seed of the excitation", min=0)] = _FOUND.seed,
    order: Annotated[int, typer.Option(help="ARX order p")] = _FOUND.order,
    samples: Annotated[int, typer.Option(help="identification samples L")] = _FOUND.samples,
    excitation: Annotated[float, typer.Option(help="standard deviation of the excitation [N]")] = _FOUND.excitation,
    weight: Annotated[float, typer.Option(help="control weight R [1/N2]")] = R_PUBLISHED,
    horizon: Annotated[int, typer.Option(help="prediction horizon h_p")] = _DESIGN.h_p,
    control_horizon: Annotated[int, typer.Option(help="control horizon h_c")] = _DESIGN.h_c,
    fmus: Fmus = FMUS,
    fmi: Version = 3,
    vehicle: Vehicles = None,
    out: Out = Path("results"),
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
