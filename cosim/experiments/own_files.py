"""Files of a user in the experiments: which vehicles each runs with, and their FMUs, checked before the first run."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from build_fmus.base import escape, surface
from cosim.study import CaseError, FmuSet
from fmu_sources.controllers.lq.preview_weights import load_weights
from fmu_sources.own_catalog import catalog_suffix, no_preview_lq, own_names, weights_name
from fmu_sources.vehicles import RideCar, Vehicle, VehicleError, load_vehicle, vehicle_names

KINDS = {
    "bench": ("quarter_car",),
    "gpc": ("full_car",),
    "handling": ("full_car", "wishbone_car"),
    "hmmwv": ("ride_car", "actuator", "sensors"),
    "preview-lq": ("ride_car",),
    "ride": ("ride_car", "full_car", "three_axle", "wishbone_car", "actuator"),
    "three-axle": ("three_axle", "three_axle_trench"),
    "trench": ("three_axle_trench",),
}
"""Experiment -> kinds of vehicle files that it runs with."""


def enumerated(names: Sequence[str]) -> str:
    """An enumeration in words, "a, b and c"."""
    return " and ".join(filter(None, [", ".join(names[:-1]), *names[-1:]]))


def bases(experiment: str) -> list[str]:
    """Published vehicles that a file for an experiment can start from."""
    return [n for n in vehicle_names() if not unfit(experiment, load_vehicle(n))]


def unfit(experiment: str, vehicle: Vehicle) -> str:
    """Why an experiment does not run with a vehicle, as the end of a sentence about its file; empty when it does."""
    if vehicle.kind not in KINDS[experiment]:
        kinds = " or ".join(repr(k) for k in KINDS[experiment])
        others = [e for e, known in KINDS.items() if vehicle.kind in known]
        return f"describes a {vehicle.kind!r}, with which {enumerated(others)} can run; {experiment} needs a {kinds}"
    return no_preview_lq(vehicle) if experiment == "preview-lq" else ""


def load_own(experiment: str, file: Path) -> Vehicle:
    """A user's vehicle that an experiment runs with.

    Raises:
        VehicleError: the file is missing, has a mistake, or does not fit; the message says which bases do.
    """
    if not file.is_file():
        published = f'; {file} is a vehicle of this project: make a file with base = "{file}"' * (
            str(file) in vehicle_names()
        )
        raise VehicleError(f"{surface.name_of('vehicle')} {file}: no such file{published}")
    vehicle = load_vehicle(file)
    if reason := unfit(experiment, vehicle):
        fitting = ", ".join(f'"{b}"' for b in bases(experiment))
        raise VehicleError(f"{file}: this file {reason} (base = {fitting})")
    return vehicle


def own_fmus(experiment: str, directory: Path, fmi: int, vehicles: Sequence[Path] | None, case: Any = None) -> FmuSet:
    """The FMUs of an experiment, with those of a user's files in place of published ones.

    A user's vehicle files replace vehicles; a controller of a user's weights is added where the case names some
    (`own_weights`).

    Raises:
        VehicleError: a file that cannot be used; see `load_own`.
        WeightsError: a weights file that cannot be used.
        CaseError: two files that make the same FMU, or one without the friction that the case has.
    """
    weights = getattr(case, "own_weights", None)
    own: dict[str, tuple[str, str]] = {}
    by: dict[str, Path] = {}
    for file in vehicles or ():
        own_vehicle = load_own(experiment, file)
        if getattr(case, "friction", False):
            check_friction(file, own_vehicle)
        for published, name in own_names(file, catalog_suffix(file)).items():
            if published in own:
                raise CaseError(f"{by[published]} and {file} both give another {published}; choose one of them")
            own[published], by[published] = (name, f"--vehicle {escape.shell(str(file))}"), file
    if weights is not None:
        load_weights(weights)
        vehicle = next(iter(vehicles or ()), None)
        options = "" if vehicle is None else f"--vehicle {escape.shell(str(vehicle))} "
        name = weights_name(weights, vehicle)
        own[weights_name(weights)] = (name, f"{options}--weights {escape.shell(str(weights))}")
    return FmuSet(directory, fmi, own, vehicles=tuple(file.stem for file in vehicles or ()))


def check_friction(file: Path, vehicle: Vehicle) -> None:
    """Refuse dry friction for a user's ride car whose file gives none.

    Raises:
        CaseError: names the file and the tables that are missing.
    """
    if isinstance(vehicle, RideCar) and not (vehicle.suspension.front.friction or vehicle.suspension.rear.friction):
        raise CaseError(
            f"{surface.given(friction=True)}: {file} gives its suspensions none; add [suspension.front.friction] (and"
            " rear)"
        )
