"""Read a vehicle file; every mistake in it becomes one sentence that names the file, the field and the remedy."""

from __future__ import annotations

import tomllib
from collections.abc import Callable, Collection, Iterable, Mapping
from pathlib import Path
from types import NoneType, SimpleNamespace, UnionType
from typing import Any, TypeVar, cast, get_args

from pydantic import BaseModel, ValidationError

from build_fmus.base.checks import did_you_mean, plain
from build_fmus.component import Component
from fmu_sources.vehicles.devices import Actuator, SensorSet
from fmu_sources.vehicles.quantities import Numbers, Quantity, Section, Vehicle
from fmu_sources.vehicles.schema import (
    KINDS,
    Axles,
    FullCar,
    QuarterCar,
    RideCar,
    ThreeAxleCar,
    ThreeAxleTrenchCar,
    WishboneCar,
)

_HERE = Path(__file__).parent
V = TypeVar("V", bound=Vehicle)


class VehicleError(ValueError):
    """A vehicle file that cannot be used. The message names the file, the field and what to do."""

    def __init__(self, message: str) -> None:
        super().__init__(plain(message))


def vehicle_names() -> list[str]:
    """Names of the vehicle files that come with the project."""
    return sorted(p.stem for p in _HERE.glob("*.toml"))


def load_vehicle(name_or_path: str | Path, kind: str | None = None) -> Vehicle:
    """Load a vehicle by the name of a file of this package, or by a path.

    `kind` (a key of `fmu_sources.vehicles.schema.KINDS`) is what the caller needs; None takes what the file
    says.

    Raises:
        VehicleError: no such file, TOML syntax, unknown, missing or misspelt field, wrong unit, value out of limits,
            or a file of another kind.
    """
    path = _find(name_or_path, kind)
    data = _read(path)
    given = data.get("kind")
    if given is None:
        raise VehicleError(
            f'{path}: kind is missing: give `kind = "..."` or `base = "..."` (kinds: {", ".join(KINDS)}; bases:'
            f" {', '.join(vehicle_names())})"
        )
    if not isinstance(given, str) or given not in KINDS:
        raise VehicleError(
            f"{path}: kind = {given!r} is not one of {', '.join(map(repr, KINDS))}{did_you_mean(given, KINDS)}"
        )
    if kind is not None and given != kind:
        raise VehicleError(f"{path}: this file describes a {given!r}, but a {kind!r} is needed here")
    model = KINDS[given]
    try:
        return model.model_validate(data)
    except ValidationError as error:
        raise VehicleError("\n".join(f"{path}: {_sentence(model, e)}" for e in error.errors())) from None


def _loader(model: type[V]) -> Callable[[str | Path], V]:
    """`load_vehicle` for files of one kind."""
    kind = next(k for k, of_kind in KINDS.items() if of_kind is model)
    return lambda name_or_path: cast(V, load_vehicle(name_or_path, kind))


load_quarter_car = _loader(QuarterCar)
load_ride_car = _loader(RideCar)
load_three_axle = _loader(ThreeAxleCar)
load_three_axle_trench = _loader(ThreeAxleTrenchCar)
load_full_car = _loader(FullCar)
load_wishbone_car = _loader(WishboneCar)
load_actuator = _loader(Actuator)
load_sensors = _loader(SensorSet)


def declare(c: Component, section: Section, prefix: str = "", leave_out: Collection[str] = ()) -> Any:
    """Declare every quantity of a vehicle as an FMI parameter of `c` under its path in the file.

    `leave_out`: paths of fields or tables that the component has no use for.

    Returns the symbols in the shape of the file: `p.suspension.front.spring`. Of `Axles` tables each wheel
    gets its own parameters: `p.suspension.fl.stiffness`.
    """
    symbols = SimpleNamespace()
    replaced = section.by_file if getattr(section, "file", None) else ()  # type: ignore[attr-defined]
    for name, info in type(section).model_fields.items():
        if prefix + name in leave_out or name in replaced:
            continue
        value, declared = getattr(section, name), type(section).declared(name)
        if isinstance(value, Quantity | Numbers) and declared is not None:
            symbol = c.parameter(
                prefix + name,
                value.value,
                declared.unit,
                info.description or "",
                min=declared.min,
                max=declared.max,
                nominal=declared.nominal,
                display_unit=declared.display_unit,
                source=value.source,
            )
            setattr(symbols, name, symbol)
        elif isinstance(value, Axles):
            wheels = {
                k: declare(c, getattr(value, axle), f"{prefix}{name}.{k}.", leave_out)
                for k, axle in value.axle_of.items()
            }
            setattr(symbols, name, SimpleNamespace(**wheels))
        elif isinstance(value, Section):
            setattr(symbols, name, declare(c, value, f"{prefix}{name}.", leave_out))
    return symbols


def _find(name_or_path: str | Path, kind: str | None = None) -> Path:
    bundled = _HERE / f"{name_or_path}.toml"
    if isinstance(name_or_path, str) and name_or_path in vehicle_names():
        return bundled
    path = Path(name_or_path)
    if _is_file(path):
        return path
    word = str(name_or_path)
    known = [n for n in vehicle_names() if kind is None or _read(_HERE / f"{n}.toml").get("kind") == kind]
    raise VehicleError(f"no vehicle {word!r}: neither a file nor one of {', '.join(known)}{did_you_mean(word, known)}")


def _is_file(path: Path) -> bool:
    """Whether it exists. Finding out may fail: a name that is too long, a folder that may not be read."""
    try:
        return path.is_file()
    except OSError as error:
        raise VehicleError(f"{path}: cannot be read: {error.strerror}") from None


def vehicle_files(name_or_path: str | Path) -> tuple[Path, ...]:
    """The file of a vehicle, then the files that it builds on.

    Raises:
        VehicleError: as `load_vehicle`, as far as the files can be read at all.
    """
    parsed = _chain(_find(name_or_path))
    tires = (data["tire"]["file"] for data in parsed.values() if _names_tire(data))
    return (*parsed, *(Path(tire) for tire in tires))


def _chain(path: Path | None) -> dict[Path, dict[str, Any]]:
    """What a vehicle file and those that it builds on say themselves, from the file on."""
    found: dict[Path, dict[str, Any]] = {}
    while path is not None:
        if path.resolve() in [f.resolve() for f in found]:
            raise VehicleError(f"{path}: base = leads back to this file; a vehicle cannot be based on itself")
        found[path], path = _parse(path)
    return found


def _names_tire(data: Mapping[str, Any]) -> bool:
    return isinstance(data.get("tire"), dict) and "file" in data["tire"]


def _read(path: Path) -> dict[str, Any]:
    """All that a vehicle file says, with what it builds on.

    A file without a name is called as the file is, not as what it builds on.
    """
    data: dict[str, Any] = {}
    for file, said in reversed(_chain(path).items()):
        data = _merge(data, {"name": file.stem, **said} if data else said)
    return data


def _parse(path: Path) -> tuple[dict[str, Any], Path | None]:
    """What one file says itself, and the file that it builds on."""
    try:
        data = tomllib.loads(path.read_text(encoding="utf-8"))
    except (ValueError, RecursionError) as error:  # syntax, encoding; numbers and tables without an end
        raise VehicleError(f"{path}: not a TOML file: {error}") from None
    except OSError as error:
        raise VehicleError(f"{path}: cannot be read: {error.strerror}") from None
    if _names_tire(data):
        if not isinstance(tire := data["tire"]["file"], str):
            raise VehicleError(f"{path}: tire.file = {tire!r} must be the path of a tire property file (.tir)")
        data["tire"]["file"] = str(path.parent / tire)
    base = data.pop("base", None)
    if base is None:
        return data, None
    if not isinstance(base, str):
        raise VehicleError(f"{path}: base = {base!r} must be the name of a vehicle or a path")
    beside = path.parent / base
    try:
        return data, beside if _is_file(beside) else _find(base)
    except VehicleError as error:
        raise VehicleError(f"{path}: base: {error}") from None


def _merge(base: Mapping[str, Any], changes: Mapping[str, Any]) -> dict[str, Any]:
    """`base` with `changes`; tables merge, values (tables with a `value`) are replaced whole."""
    merged = dict(base)
    for key, new in changes.items():
        old = merged.get(key)
        tables = isinstance(old, dict) and isinstance(new, dict) and "value" not in new
        merged[key] = _merge(cast(dict[str, Any], old), new) if tables else new
    return merged


def _sentence(model: type[BaseModel], error: Any) -> str:
    """One pydantic error as a sentence about the file."""
    loc = [str(part) for part in error["loc"]]
    field, kind = ".".join(loc), error["type"]
    if kind == "extra_forbidden":
        known = list(_model_at(model, loc[:-1]).model_fields)
        near = did_you_mean(loc[-1], known)
        return f"{field}: unknown field{near or '; known here: ' + ', '.join(known)}"
    if kind == "missing":
        if loc[-1] == "source":
            return f'{field}: missing; say where the value comes from, or "assumed"'
        return f"{field}: missing{_expected(model, loc)}"
    if kind in ("model_type", "model_attributes_type"):
        return f"{field}: {error['input']!r} is not a table{_expected(model, loc)}"
    if kind == "finite_number":
        return f"{field}: {error['input']} is not a finite number"
    if kind in ("unit", "limit", "source", "row"):
        return f"{field}: {error['msg']}"
    return f"{field}: {error['msg'][0].lower()}{error['msg'][1:]} (given: {error['input']!r})"


def _expected(model: type[BaseModel], loc: list[str]) -> str:
    parent = _model_at(model, loc[:-1])
    if loc[-1] in parent.model_fields and issubclass(parent, Section) and (declared := parent.declared(loc[-1])):
        return f'; write {loc[-1]} = {{ value = ..., unit = "{declared.unit}", source = "..." }}'
    return ""


def _model_at(model: type[BaseModel], loc: Iterable[str]) -> type[BaseModel]:
    for part in loc:
        annotation = model.model_fields[part].annotation
        if isinstance(annotation, UnionType):  # an optional table
            annotation = next(a for a in get_args(annotation) if a is not NoneType)
        assert isinstance(annotation, type)
        assert issubclass(annotation, BaseModel)
        model = annotation
    return model
