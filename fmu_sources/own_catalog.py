"""Catalogs of a user's files: vehicles, roads, weights, and Python files with components."""

from __future__ import annotations

import importlib.util
import re
from dataclasses import replace
from functools import partial
from pathlib import Path

from build_fmus.base.escape import NO_XML
from build_fmus.component import Component
from fmu_sources.catalog import KINDS, PUBLISHED, SENSORS, Context, Entry, Preview, Source, layout
from fmu_sources.registration import declarations
from fmu_sources.vehicles import RideCar, Vehicle, VehicleError, load_vehicle, vehicle_files

_PREVIEW_LQ = "PreviewLq"  # begins the names of these controllers
_ON_ROADS = ("full_car", "ride_car", "three_axle", "three_axle_trench", "wishbone_car")


def own_catalog(path: Path, suffix: str) -> dict[str, Entry]:
    """All that is made of a user's vehicle file, by its kind; `suffix` ends the names.

    Raises:
        VehicleError: the file is missing or has a mistake.
    """
    vehicle = load_vehicle(path)
    files = vehicle_files(path)
    words = partial(_own_words, path, vehicle.kind, suffix)

    def reworded(entry: Entry) -> Entry:
        def make(context: Context) -> Component:
            component = entry.make(context)
            component.reword(words)
            component.description += f"; made for {path.name}"
            return component

        return replace(entry, summary=f"{words(entry.summary)}, {path.name}", make=make)

    entries: dict[str, Entry] = {}
    for of in KINDS[vehicle.kind]:
        for declaration in declarations(of):
            entry = replace(Source(of, path, suffix).entry(declaration), files=files)
            if not (entry.name.startswith(_PREVIEW_LQ) and no_preview_lq(vehicle)):
                entries.setdefault(entry.name, entry if vehicle.kind == "full_car" else reworded(entry))
    return entries


def no_preview_lq(vehicle: Vehicle) -> str:
    """Why a vehicle has no preview LQ controller, as the end of a sentence about its file; empty when it has one."""
    if not isinstance(vehicle, RideCar):
        return f"describes a {vehicle.kind!r}, and preview LQ controllers are made of a 'ride_car'"
    damped = {axle: tire.damping for axle in ("front", "rear") if (tire := getattr(vehicle.tire, axle)).damping.value}
    if damped:
        # These controllers take the height of the road for the only disturbance; tire damping adds its rate.
        values = ", ".join(f"tire.{axle}.damping = {d.value:g} {d.unit}" for axle, d in damped.items())
        return f"gives tires damping ({values}), and preview LQ controllers are for tires without"
    return ""


def catalog_suffix(path: Path) -> str:
    """What names of FMUs made of a file end in, UpperCamelCase of its name: `my_truck.toml` -> `MyTruck`."""
    words = re.findall(r"[A-Za-z0-9]+", path.stem)
    if not words:
        raise ValueError(f"{path}: FMUs are named after this file, so its name needs letters or digits; rename it")
    bad = NO_XML.search(path.name)
    if bad and not "\udc80" <= bad[0] <= "\udcff":  # bytes that the locale could not decode are refused later
        raise ValueError(
            f"{path}: the file name becomes part of the FMU, and XML cannot contain its character {bad[0]!a}; rename"
            " the file"
        )
    return "".join(w[0].upper() + w[1:] for w in words)


def weights_name(weights: Path, vehicle: Path | None = None) -> str:
    """Name of the preview LQ controller with a user's weights, of the sedan or of a user's vehicle."""
    return f"{_PREVIEW_LQ}{catalog_suffix(weights)}{'' if vehicle is None else catalog_suffix(vehicle)}"


def road_name(road: Path, vehicle: Path | str | None = None) -> str:
    """Name of the road FMU of a user's road file.

    With a vehicle the name holds the vehicle's file too, since wheels and preview are the vehicle's.
    """
    return f"Road{catalog_suffix(road)}{'' if vehicle is None else catalog_suffix(Path(vehicle))}"


def own_names(path: Path, suffix: str) -> dict[str, str]:
    """Published names -> names of what `own_catalog` makes in their place, for experiments on a user's vehicle.

    Raises:
        VehicleError: the file is missing or has a mistake.
    """
    made = own_catalog(path, suffix)
    return {published: own for published, own in _names(load_vehicle(path).kind, suffix).items() if own in made}


def _names(kind: str, suffix: str) -> dict[str, str]:
    """Published names -> names of what is made of a file of this kind in their place."""
    return {
        d.name.format(v=PUBLISHED[of].called, s=""): d.name.format(v=suffix, s=suffix)
        for of in KINDS[kind]
        for d in declarations(of)
    }


def _own_words(path: Path, kind: str, suffix: str, text: str) -> str:
    """A text about a published vehicle and its FMUs as one about the vehicle of a user's file."""
    for published, own in sorted(_names(kind, suffix).items(), key=lambda n: -len(n[0])):
        if re.search("Hmmwv|Sedan|Bench|ThreeAxle", published):  # others, such as Skyhook, are words as well
            text = re.sub(rf"\b{published}\b", own, text)
    if kind == "sensors":
        text = text.replace("fmu_sources/vehicles/sensors_hmmwv.toml", path.name)
        return re.sub("(?<=ensors of )the HMMWV", lambda _: path.name, text)  # the car is still the HMMWV
    text = text.replace(", as that of the HMMWV does", "").replace("Three-axle 6x6", "Three-axle vehicle")
    text = re.sub(
        r"\bthe (HMMWV|6x6|sedan)\b( of paper 003)?|^6x6 of paper 003", lambda _: f"the vehicle of {path.name}", text
    )
    return text.replace("ride car, HMMWV (paper 001)", "ride car")


def road_entry(path: Path, name: str, vehicle: str | Path = "hmmwv_modified", preview: Preview | None = None) -> Entry:
    """A road from a user's file under the wheels of a vehicle, with the preview that its controllers read.

    `preview`: how many heights and how far apart [s]; without it what the vehicle's own controllers read, and under a
    ride car also what the HMMWV's range sensors see.
    """

    def make(_: Context) -> Component:
        from fmu_sources.roads import road_from_file

        kind = load_vehicle(vehicle).kind
        if kind not in _ON_ROADS:
            raise ValueError(
                f"vehicle {vehicle} is of kind {kind}, which has no wheels on a road (have: {', '.join(_ON_ROADS)})"
            )
        sensors = SENSORS if kind == "ride_car" else None
        return road_from_file(path, layout(vehicle, preview or PUBLISHED[KINDS[kind][0]].preview, sensors), name=name)

    return Entry(
        name, f"road from {path.name}", make, files=(path, *vehicle_files(vehicle)), choices=f"{vehicle} {preview}"
    )


def preview_lq_entry(path: Path, name: str, period: float = 1e-3, vehicle: Path | None = None) -> Entry:
    """A preview LQ controller with a user's weights, at any sample time [s], of the sedan or of a user's `vehicle`.

    Raises:
        VehicleError: the vehicle's file has a mistake, or there is no such controller of it.
    """
    if vehicle is not None and (reason := no_preview_lq(load_vehicle(vehicle))):
        raise VehicleError(f"{vehicle}: this file {reason}; --weights needs another one, or none for the sedan")
    source = Source("sedan", vehicle or "sedan", "Sedan" if vehicle is None else catalog_suffix(vehicle))

    def make(context: Context) -> Component:
        from fmu_sources.controllers.lq.preview import preview_lq

        component = preview_lq(source.plant(context), path, name=name, period=period)
        if vehicle is not None:
            component.description += f"; made for {vehicle.name}"
        return component

    summary = f"preview LQ controller with the weights of {path.name}{'' if vehicle is None else f', {vehicle.name}'}"
    return Entry(name, summary, make, files=(path, *vehicle_files(source.file)), choices=f"{period} {source.called}")


def own_entry(path: Path, maker: str = "make") -> Entry:
    """A component that a function of a user's Python file returns.

    Raises:
        ValueError: the file cannot be run, has no such function, or it returns something else.
    """

    def make(_: Context | None = None) -> Component:
        spec = importlib.util.spec_from_file_location(path.stem, path)
        if spec is None or spec.loader is None:
            raise ValueError(f"{path}: not a Python file")
        module = importlib.util.module_from_spec(spec)
        try:
            spec.loader.exec_module(module)
        except Exception as error:
            raise ValueError(f"{path}: {type(error).__name__}: {error}") from error
        function = getattr(module, maker, None)
        if not callable(function):
            known = [n for n, v in vars(module).items() if callable(v) and getattr(v, "__module__", "") == path.stem]
            raise ValueError(
                f"{path} has no function {maker!r}; name one with FILE.py:FUNCTION (it has"
                f" {', '.join(known) or 'none'})"
            )
        component = function()
        if not isinstance(component, Component):
            raise ValueError(f"{path}: {maker}() returned {type(component).__name__}, not a Component")
        return component

    return Entry(make().name, f"component of {path.name}", make, files=(path,))
