"""The one list of FMUs: name -> how to make the component, and which FMUs it needs first.

Importing this module costs nothing: makers import their modules when called.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from build_fmus.base.checks import did_you_mean
from build_fmus.base.escape import NO_XML

if TYPE_CHECKING:
    from build_fmus.component import Component
    from fmu_sources.roads import RoadLayout
    from fmu_sources.vehicles import Vehicle


PAPERS = {
    "000": (
        "R. Brown, M. Murugan, M. Mazza: Analytical Evaluation of Generalized Predictive Control Algorithms Using a"
        " Full Vehicle Multi-Body Dynamics Model For Mobility Enhancement"
    ),
    "001": (
        "M. D. Donahue, J. K. Hedrick: Implementation of an Active Suspension, Preview Controller for Improved Ride"
        " Comfort"
    ),
    "003": (
        "A. Kale: Mobility Improvement of Wheeled Military Vehicles Using Preview Controlled Active Ride Height System,"
        " M.Sc. thesis, Hacettepe University, 2020"
    ),
    "002": "R. R. Das, E. Vinodh Kumar: Active Suspension with Model Predictive Control",
    "004": (
        "J. Marzbanrad, Y. Hojjat, H. Zohoor, S. K. Nikravesh: Optimal Preview Control Design of an Active Suspension"
        " Based on a Full Car Model"
    ),
}
"""What the short names in sources stand for."""


@dataclass(frozen=True)
class Context:
    """What a maker may use: where finished FMUs are, where derived data may be kept."""

    fmus: Path
    cache: Path

    def fmu(self, name: str) -> Path:
        """Path of an FMU that the entry named in `needs` (the FMI 3.0 one)."""
        return self.fmus / "fmi3" / f"{name}.fmu"


@dataclass(frozen=True)
class Entry:
    """One FMU of the catalog."""

    name: str
    summary: str
    make: Callable[[Context], Component]
    needs: tuple[str, ...] = ()
    files: tuple[Path, ...] = ()  # of the user, that determine the component
    choices: str = ""  # options of the user that determine it


def default_catalog() -> dict[str, Entry]:
    """The FMUs of this project, with the vehicles they are published for."""
    entries = [
        *_family(_HMMWV, _HMMWV_FILE, "Hmmwv"),
        *_family(_SENSORS, _SENSOR_FILE, "Hmmwv"),
        *_family(_SEDAN, "sedan", "Sedan"),
        *_family(_QUARTER_CAR, "quarter_car_hmmwv", "Hmmwv"),
        *_family(_BENCH | _BENCH_LAWS, "quarter_car_bench", "Bench"),
        *(Entry(name, summary, _plain(module, maker)) for name, (module, maker, summary) in _PLAIN.items()),
        *_family(_THREE_AXLE, "three_axle", ""),
        *_family(_TRENCH, "three_axle_trench", ""),
        *_family(_ACTUATOR, "actuator_hmmwv", ""),
        *_family(_ACTUATOR, "actuator_hmmwv_physical", "Physical", about=", density of real oil"),
        *_family(_WISHBONE, "hmmwv_public", "HmmwvPublic"),
        *vehicle_catalog("hmmwv", plant="FullCarHmmwv", suffix=None).values(),
        *vehicle_catalog("hmmwv_modified", plant=_GPC_PLANT, suffix="").values(),
    ]
    return {e.name: e for e in entries}


def own_catalog(path: Path, suffix: str) -> dict[str, Entry]:
    """All that is made of a user's vehicle file, by its kind; `suffix` ends the names.

    Raises:
        VehicleError: the file is missing or has a mistake.
    """
    from fmu_sources.vehicles import load_vehicle

    vehicle = load_vehicle(path)
    if vehicle.kind == "full_car":
        return vehicle_catalog(path, plant=f"FullCar{suffix}", suffix=suffix)
    words = partial(_own_words, path, vehicle.kind, suffix)
    families = [_family(parts, path, suffix, words=words, about=f", {path.name}") for parts, _ in _KINDS[vehicle.kind]]
    entries = {e.name: e for family in families for e in family}
    if no_preview_lq(vehicle):
        entries = {n: e for n, e in entries.items() if not n.startswith(_PREVIEW_LQ)}
    return entries


def no_preview_lq(vehicle: Vehicle) -> str:
    """Why a vehicle has no preview LQ controller, as the end of a sentence about its file; empty when it has one."""
    from fmu_sources.vehicles import RideCar

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
    if (
        bad and not "\udc80" <= bad[0] <= "\udcff"
    ):  # bytes that the locale could not decode: refused with the remedy later
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
    from fmu_sources.vehicles import load_vehicle

    made = own_catalog(path, suffix)
    if load_vehicle(path).kind == "full_car":
        return {_GPC_PLANT: f"FullCar{suffix}", **{name: name + suffix for name in (*_ROADS, *_GPC)}}
    return {published: own for published, own in _names(load_vehicle(path).kind, suffix).items() if own in made}


def _names(kind: str, suffix: str) -> dict[str, str]:
    """Published names -> names of what is made of a file of this kind in their place."""
    return {
        template.format(v=called, s=""): template.format(v=suffix, s=suffix)
        for parts, published in _KINDS[kind]
        for template in parts
        for called in published
    }


def _own_words(path: Path, kind: str, suffix: str, text: str) -> str:
    """A text about a published vehicle and its FMUs as one about the vehicle of a user's file."""
    for published, own in sorted(_names(kind, suffix).items(), key=lambda n: -len(n[0])):
        if re.search(
            r"(Hmmwv|Sedan|Bench|ThreeAxle|HmmwvPublic)", published
        ):  # others, such as Skyhook, are words as well
            text = re.sub(rf"\b{published}\b", own, text)
    if kind == "sensors":
        text = text.replace("fmu_sources/vehicles/sensors_hmmwv.toml", path.name)
        return re.sub("(?<=ensors of )the HMMWV", lambda _: path.name, text)  # the car is still the HMMWV
    text = text.replace(", as that of the HMMWV does", "").replace("Three-axle 6x6", "Three-axle vehicle")
    text = re.sub(
        r"\bthe (HMMWV|6x6|sedan)\b( of paper 003)?|^6x6 of paper 003", lambda _: f"the vehicle of {path.name}", text
    )
    return text.replace("ride car of paper 004", "ride car")


def vehicle_catalog(vehicle: str | Path, *, plant: str, suffix: str | None) -> dict[str, Entry]:
    """The full car of a vehicle file, and with `suffix` the roads under its wheels and its GPC controllers.

    Names are `plant` and the contract names with `suffix` appended.
    """
    files = _files(vehicle)

    def full_car(_: Context) -> Component:
        from fmu_sources.plants import full_car as make
        from fmu_sources.vehicles import load_full_car

        return make(load_full_car(vehicle), name=plant)

    entries = [Entry(plant, f"nonlinear full car, vehicle file {vehicle}", full_car, files=files)]
    if suffix is not None:
        for name, (maker, summary) in _ROADS.items():
            make_road = _road(maker, GPC_PREVIEW) if maker else _proving_ground(GPC_PREVIEW)
            entries.append(Entry(name + suffix, summary, partial(make_road, vehicle, name + suffix), files=files))
        needs = (plant, "RoadPerryman3" + suffix, "SpeedProfile")
        for name, (summary, variant) in _GPC.items():
            make = _gpc(variant, plant, "RoadPerryman3" + suffix, name + suffix)
            entries.append(Entry(name + suffix, summary, make, needs=needs, files=files))
    return {e.name: e for e in entries}


def road_entry(path: Path, name: str, vehicle: str | Path = "hmmwv_modified", preview: Preview | None = None) -> Entry:
    """A road from a user's file under the wheels of a vehicle, with the preview that its controllers read.

    `preview`: how many heights and how far apart [s]; without it what the vehicle's own controllers read, and under a
    ride car also what the HMMWV's range sensors see.
    """

    def make(_: Context) -> Component:
        from fmu_sources.roads import road_from_file
        from fmu_sources.vehicles import load_vehicle

        kind = load_vehicle(vehicle).kind
        if kind not in _PREVIEWS:
            raise ValueError(
                f"vehicle {vehicle} is of kind {kind}, which has no wheels on a road (have: {', '.join(_PREVIEWS)})"
            )
        sensors = _SENSOR_FILE if kind == "ride_car" else None
        return road_from_file(path, _layout(vehicle, preview or _PREVIEWS[kind], sensors), name=name)

    files = (path, *_files(vehicle))
    return Entry(name, f"road from {path.name}", make, files=files, choices=f"{vehicle} {preview}")


def preview_lq_entry(path: Path, name: str, period: float = 1e-3, vehicle: Path | None = None) -> Entry:
    """A preview LQ controller with a user's weights, at any sample time [s], of the sedan or of a user's `vehicle`.

    Raises:
        VehicleError: the vehicle's file has a mistake, or there is no such controller of it.
    """
    from fmu_sources.vehicles import VehicleError, load_vehicle

    if vehicle is not None and (reason := no_preview_lq(load_vehicle(vehicle))):
        raise VehicleError(f"{vehicle}: this file {reason}; --weights needs another one, or none for the sedan")
    source, called = ("sedan", "Sedan") if vehicle is None else (vehicle, catalog_suffix(vehicle))
    about = "" if vehicle is None else f", {vehicle.name}"

    def make(_: Context) -> Component:
        component = _preview_lq(source, name, called, weights=path, period=period)
        if vehicle is not None:
            component.description += f"; made for {vehicle.name}"
        return component

    summary = f"preview LQ controller with the weights of {path.name}{about}"
    return Entry(name, summary, make, files=(path, *_files(source)), choices=f"{period} {called}")


def own_entry(path: Path, maker: str = "make") -> Entry:
    """A component that a function of a user's Python file returns.

    Raises:
        ValueError: the file cannot be run, has no such function, or it returns something else.
    """

    def make(_: Context | None = None) -> Component:
        import importlib.util

        from build_fmus.component import Component

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


def find(catalog: dict[str, Entry], name: str) -> Entry:
    """Entry by name; KeyError that proposes the nearest one."""
    try:
        return catalog[name]
    except KeyError:
        raise KeyError(f"no FMU named {name!r}{did_you_mean(name, catalog)} (build-fmus --list shows all)") from None


# ---------------------------------------------------------------------- families: what is made of one vehicle file

Source = str | Path  # of a vehicle: the name of a published file, or a file of the user
Preview = tuple[int, float]  # heights ahead, and the time between them [s]
Make = Callable[..., "Component"]  # called with the vehicle's source, the FMU's name, and what the vehicle is called

_PREVIEW_LQ = "PreviewLq"  # begins the names of these controllers
_SENSOR_FILE = "sensors_hmmwv"
_HMMWV_FILE = "ride_car_hmmwv"
GPC_PREVIEW, MPC_PREVIEW, LQ_PREVIEW, CROSSING_PREVIEW = (8, 0.010), (16, 0.030), (48, 0.005), (50, 0.005)
WHEEL_RADIUS = {
    "hmmwv": 0.47,
    "sedan": 0.31,
    "6x6": 0.62,
    "full-car": 0.45,
}  # m: 37 x 12.5 tires, assumed, files of obstacle runs, vehicle file
_PREVIEWS: dict[str, Preview] = {  # by kind of vehicle: what its controllers read
    "full_car": GPC_PREVIEW,
    "ride_car": MPC_PREVIEW,
    "three_axle": CROSSING_PREVIEW,
    "three_axle_trench": CROSSING_PREVIEW,
    "wishbone_car": GPC_PREVIEW,
}


def _family(
    parts: Mapping[str, tuple[str, Make]],
    vehicle: Source,
    called: str,
    *,
    words: Callable[[str], str] | None = None,
    about: str = "",
) -> list[Entry]:
    """Entries of the FMUs made of one vehicle file.

    Args:
        parts: template of the name -> summary, maker. `{v}` in a template is where what the vehicle is called belongs
            in the published names, `{s}` where only the names of FMUs of a user's vehicle have it.
        vehicle: the vehicle file.
        called: what the vehicle is called.
        words: of a user's vehicle, which makes texts about published vehicles texts about this one.
        about: end of all summaries.
    """
    files = _files(vehicle)

    def entry(template: str, summary: str, make: Make) -> Entry:
        name = template.format(v=called, s=called if words else "")

        def made(_: Context) -> Component:
            component = make(vehicle, name, called)
            if words and isinstance(vehicle, Path):
                component.reword(words)
                component.description += f"; made for {vehicle.name}"
            return component

        return Entry(name, (words(summary) if words else summary) + about, made, files=files)

    return [entry(template, *part) for template, part in parts.items()]


def _files(vehicle: Source) -> tuple[Path, ...]:
    """Files of the user that a vehicle is read from; none for a published one."""
    from fmu_sources.vehicles import vehicle_files

    return vehicle_files(vehicle) if isinstance(vehicle, Path) else ()


def _load(kind: str, vehicle: Source) -> Any:
    from fmu_sources import vehicles

    return getattr(vehicles, f"load_{kind}")(vehicle)


def _call(module: str, maker: str, *args: Any, **options: Any) -> Component:
    import importlib

    made: Component = getattr(importlib.import_module(f"fmu_sources.{module}"), maker)(*args, **options)
    return made


def _plain(module: str, maker: str) -> Callable[[Context], Component]:
    """A component of no vehicle."""
    return lambda _: _call(module, maker)


def _layout(vehicle: Source, preview: Preview, sensors: Source | None = None) -> RoadLayout:
    """Wheels of a vehicle on a road, with preview and what range sensors see."""
    from fmu_sources.roads import RoadLayout, RoadScan
    from fmu_sources.vehicles import load_vehicle

    scan = None if sensors is None else RoadScan.of(_load("sensors", sensors))
    count, step = preview
    return RoadLayout.of(load_vehicle(vehicle), preview_count=count, preview_step=step, scan=scan)  # type: ignore[arg-type]


def _road(maker: str, preview: Preview, sensors: Source | None = None) -> Make:
    return lambda vehicle, name, _: _call("roads", maker, _layout(vehicle, preview, sensors), name=name)


def _proving_ground(preview: Preview, radius: float | None = None) -> Make:
    """Courses under wheels of that `radius` [m]; None: that of the vehicle file."""

    def make(vehicle: Source, name: str, _: str = "") -> Component:
        of_file = _load("full_car", vehicle).wheel.radius.value if radius is None else radius
        return _call("roads", "road_proving_ground", _layout(vehicle, preview), name=name, radius=of_file)

    return make


def _car(vehicle: Source, name: str, _: str = "") -> Component:
    return _call("plants", "ride_car", _load("ride_car", vehicle), name=name)


def _on_car(module: str, maker: str, *args: Any) -> Make:
    """A controller or estimator that is designed on a ride car."""
    return lambda vehicle, name, called: _call(module, maker, _car(vehicle, f"RideCar{called}"), *args, name=name)


def _lqr_hmmwv(weights: str) -> Make:
    def make(vehicle: Source, name: str, called: str) -> Component:
        from fmu_sources.controllers.lq import hmmwv as lqr

        return lqr.lqr_hmmwv(_car(vehicle, f"RideCar{called}"), getattr(lqr, weights), name)

    return make


def _kalman(maker: str) -> Make:
    def make(vehicle: Source, name: str, called: str, sensors: Source = _SENSOR_FILE) -> Component:
        return _call("estimators", maker, _car(vehicle, f"RideCar{called}"), _load("sensors", sensors), name)

    return make


def _preview_sensor(vehicle: Source, name: str, _: str = "", sensors: Source = _SENSOR_FILE) -> Component:
    return _call("sensing", "preview_sensor", _load("sensors", sensors), _load("ride_car", vehicle), name)


def _preview_buffer(vehicle: Source, name: str, _: str) -> Component:
    return _call("sensing", "preview_buffer", _layout(vehicle, MPC_PREVIEW), name)


def _sensor_suite(sensors: Source, name: str, _: str) -> Component:
    from fmu_sources.roads import RoadScan

    chosen = _load("sensors", sensors)
    return _call("sensing", "sensor_suite", chosen, RoadScan.of(chosen), name)


def _preview_lq(
    vehicle: Source, name: str, called: str, *, weights: str | Path, period: float = 1e-3, tunable: bool = False
) -> Component:
    from fmu_sources.controllers.lq.preview_weights import load_weights

    car = _car(vehicle, f"RideCar{called}")
    return _call(
        "controllers.lq.preview", "preview_lq", car, load_weights(weights), name=name, period=period, tunable=tunable
    )


def _lq(weights: str, period: float = 1e-3, *, tunable: bool = False) -> Make:
    return lambda vehicle, name, called: _preview_lq(
        vehicle, name, called, weights=weights, period=period, tunable=tunable
    )


def _with_sensors(make: Make) -> Make:
    """Of a sensors file instead of a vehicle: what is made around the HMMWV with them."""
    return lambda sensors, name, _: make(_HMMWV_FILE, name, "Hmmwv", sensors=sensors)


def _seen_road(maker: str) -> Make:
    """A road with what the range sensors of a sensors file see of it."""
    return lambda sensors, name, _: _call("roads", maker, _layout(_HMMWV_FILE, MPC_PREVIEW, sensors), name=name)


def _bench_controller(method: str, maker: str) -> Make:
    return lambda vehicle, name, called: _call(
        f"controllers.{method}.bench", maker, _bench(vehicle, f"QuarterCar{called}"), name=name
    )


def _bench(vehicle: Source, name: str, _: str = "") -> Component:
    masses = ("002 equation (1)", "002 equation (2), with the spring of matrix (6)")
    source = "002 equations (1), (2)"
    return _call("plants", "quarter_car", _load("quarter_car", vehicle), name=name, source=source, masses=masses)


def _quarter_car(vehicle: Source, name: str, _: str) -> Component:
    return _call("plants", "quarter_car", _load("quarter_car", vehicle), name=name)


def _three_axle(vehicle: Source, name: str, _: str = "") -> Component:
    """The linear ride car of a file with three axles, with or without what trenches need besides."""
    from fmu_sources.plants import ride_car
    from fmu_sources.vehicles import ThreeAxleCar, ThreeAxleTrenchCar, load_vehicle

    loaded = load_vehicle(vehicle)
    linear = loaded.linear() if isinstance(loaded, ThreeAxleTrenchCar) else loaded
    assert isinstance(linear, ThreeAxleCar)
    return ride_car(linear, name=name)


def _on_three_axle(module: str, maker: str) -> Make:
    return lambda vehicle, name, called: _call(module, maker, _three_axle(vehicle, f"ThreeAxleRide{called}"), name=name)


def _trench_plant(vehicle: Source, name: str, _: str = "") -> Component:
    return _call("plants", "three_axle_trench", _load("three_axle_trench", vehicle), name=name)


def _wishbone_car(vehicle: Source, name: str, _: str = "") -> Component:
    return _call("plants", "wishbone_car", _load("wishbone_car", vehicle), name=name)


def _linear_car(vehicle: Source, name: str, _: str = "") -> Component:
    return _call("plants", "linear_ride_car", _load("wishbone_car", vehicle), name=name)


def _half_round(vehicle: Source, name: str, _: str) -> Component:
    return _call("roads", "road_half_round", _layout(vehicle, GPC_PREVIEW), name=name)


def _trench_crossing(vehicle: Source, name: str, called: str) -> Component:
    from fmu_sources.controllers.trench.crossing import CrossingGeometry, trench_crossing

    return trench_crossing(CrossingGeometry.of(_trench_plant(vehicle, f"ThreeAxleTrench{called}").model()), name)


def _of_actuator(module: str, maker: str) -> Make:
    return lambda vehicle, name, _: _call(module, maker, _load("actuator", vehicle), name=name)


_SENSORS: dict[str, tuple[str, Make]] = {
    "SensorSuite{s}": ("sensors of the HMMWV (paper 001, Tables 1.5 and 1.6)", _sensor_suite),
}
_AROUND_SENSORS: dict[str, tuple[str, Make]] = {  # what else a user's sensors change
    "Kalman{v}": (
        "Kalman filter of the HMMWV's 15 relative states with these sensors",
        _with_sensors(_kalman("kalman_hmmwv")),
    ),
    "PreviewSensor{s}": ("road ahead from these range sensors, equation (1.18)", _with_sensors(_preview_sensor)),
    "RoadBumps{s}": ("test track of speed bumps as these sensors see it", _seen_road("road_bumps")),
    "RoadOffroad{v}": ("off-road terrain as these sensors see it", _seen_road("road_offroad")),
}
_HMMWV: dict[str, tuple[str, Make]] = {
    "RideCar{v}": ("linear 7-DOF ride car, HMMWV (paper 001)", _car),
    "Lqr{v}": ("LQR of paper 001, force weighted in N, as published", _lqr_hmmwv("TABLE_1_1")),
    "Lqr{v}Kilonewton": ("LQR of paper 001, force weighted in kN", _lqr_hmmwv("TABLE_1_1_KILONEWTON")),
    "Skyhook{s}": ("skyhook damping (paper 001)", _on_car("controllers.skyhook", "skyhook")),
    "Mpc{v}": ("MPC of the HMMWV with or without preview (paper 001)", _on_car("controllers.mpc.hmmwv", "mpc_hmmwv")),
    "Kalman{v}": ("Kalman filter of 15 relative states (paper 001)", _kalman("kalman_hmmwv")),
    "Kalman{v}Printed": (
        "Kalman filter of 14 absolute states, as printed (paper 001)",
        _kalman("kalman_hmmwv_printed"),
    ),
    "PreviewSensor{s}": ("road ahead from range sensors, equation (1.18) (paper 001)", _preview_sensor),
    "PreviewBuffer{s}": ("road ahead by distance, read under each wheel (paper 001)", _preview_buffer),
    "RoadBumps{s}": ("test track of speed bumps (paper 001)", _road("road_bumps", MPC_PREVIEW, _SENSOR_FILE)),
    "RoadOffroad{v}": (
        "off-road terrain under the HMMWV (paper 001)",
        _road("road_offroad", MPC_PREVIEW, _SENSOR_FILE),
    ),
    "RoadProvingGround{v}": (
        "synthetic RMS courses and a half-round under the HMMWV",
        _proving_ground(MPC_PREVIEW, WHEEL_RADIUS["hmmwv"]),
    ),
}
_SEDAN: dict[str, tuple[str, Make]] = {
    "RideCar{v}": ("linear 7-DOF ride car of paper 004", _car),
    "PreviewLqComfort{s}": ("preview LQ controller of paper 004, ride comfort", _lq("comfort")),
    "PreviewLqComfort5ms{s}": (
        "preview LQ controller of paper 004, ride comfort, sampled at 5 ms",
        _lq("comfort", 5e-3),
    ),
    "PreviewLqRoadHolding{s}": ("preview LQ controller of paper 004, road holding", _lq("road_holding")),
    "PreviewLqTunable{s}": ("preview LQ controller of paper 004, its weights parameters", _lq("comfort", tunable=True)),
    "RoadHoleBump{s}": ("hole, flat and bump of paper 004", _road("road_hole_bump", LQ_PREVIEW)),
    "RoadIso8608{s}": ("random road, ISO 8608 class A to H", _road("road_iso8608", LQ_PREVIEW)),
    "RoadProvingGround5ms{s}": (
        "synthetic RMS courses and a half-round under the sedan",
        _proving_ground(LQ_PREVIEW, WHEEL_RADIUS["sedan"]),
    ),
}
_QUARTER_CAR: dict[str, tuple[str, Make]] = {"QuarterCar{v}": ("quarter car of the HMMWV (paper 001)", _quarter_car)}
_BENCH: dict[str, tuple[str, Make]] = {
    "QuarterCar{v}": ("quarter-car bench of paper 002", _bench),
}
_BENCH_LAWS: dict[str, tuple[str, Make]] = {
    "Lqr{v}": ("LQR of the quarter-car bench (paper 002)", _bench_controller("lq", "lqr_bench")),
    "Mpc{v}": ("MPC of the quarter-car bench (paper 002)", _bench_controller("mpc", "mpc_bench")),
    "Mpc{v}Moves": ("MPC of the bench, weight on the moves (paper 002)", _bench_controller("mpc", "mpc_bench_moves")),
}
_PLAIN = {  # name -> module, maker, summary
    "BenchEncoders": ("sensing.bench_encoders", "bench_encoders", "encoders of the bench, velocities estimated"),
    "RoadBenchBump": ("roads.bench", "road_bench_bump", "bump of the quarter-car bench over time"),
    "RoadBenchRandom": ("roads.bench", "road_bench_random", "random motion of the bench's plate over time"),
    "RideComfort": ("sensing", "ride_comfort", "absorbed power and ISO 2631-1 (paper 001)"),
    "SpeedCommand": ("roads", "speed_command", "speed that follows a command, with traveled distance"),
    "SpeedProfile": ("roads", "speed_profile", "constant speed or ramp, with traveled distance"),
    "PitchReference": (
        "controllers.trench.pitch_reference",
        "pitch_reference",
        "pitch that ramps up, holds and ramps down (paper 003)",
    ),
}
_THREE_AXLE: dict[str, tuple[str, Make]] = {
    "ThreeAxleRide{s}": ("linear 9-DOF ride model of the 6x6 of paper 003", _three_axle),
    "LqrThreeAxle{s}": (
        "linear-quadratic regulator with pitch reference (paper 003)",
        _on_three_axle("controllers.lq.three_axle", "lqr_three_axle"),
    ),
    "MpcThreeAxle{s}": (
        "MPC with preview of road and pitch for the 6x6 (paper 003)",
        _on_three_axle("controllers.mpc.three_axle", "mpc_three_axle"),
    ),
    "RoadShallowTrench{s}": (
        "shallow trench under the 6x6 of paper 003",
        _road("road_shallow_trench", CROSSING_PREVIEW),
    ),
    "RoadProvingGroundThreeAxle{s}": (
        "synthetic RMS courses and a half-round under the 6x6",
        _proving_ground(CROSSING_PREVIEW, WHEEL_RADIUS["6x6"]),
    ),
}
_TRENCH: dict[str, tuple[str, Make]] = {
    "ThreeAxleTrench{s}": ("6x6 of paper 003 over trenches and obstacles, with contact", _trench_plant),
    "TrenchCrossing{s}": ("cases, pitch reference and effective road for trenches (paper 003)", _trench_crossing),
}
_ACTUATOR: dict[str, tuple[str, Make]] = {
    "HydraulicActuator{v}": ("electro-hydraulic actuator (paper 001)", _of_actuator("plants", "hydraulic_actuator")),
    "ForceTracking{v}": (
        "hydraulic force tracking (paper 001)",
        _of_actuator("controllers.force_tracking", "force_tracking"),
    ),
}
_WISHBONE: dict[str, tuple[str, Make]] = {
    "FullCar{v}": ("full car on double wishbones by their hardpoints, tables, enveloping tires", _wishbone_car),
    "RideCar{v}": ("linear 7-DOF ride car of that car near rest, by its own derivatives", _linear_car),
    "RoadHalfRound{v}": ("half-round under tires that envelop it", _half_round),
    "RoadProvingGround{v}": (
        "synthetic RMS courses and a half-round under tires that envelop them",
        _proving_ground(GPC_PREVIEW, 0.0),
    ),
}
_KINDS: dict[str, tuple[tuple[dict[str, tuple[str, Make]], tuple[str, ...]], ...]] = {
    "quarter_car": ((_QUARTER_CAR, ("Hmmwv", "Bench")), (_BENCH_LAWS, ("Bench",))),
    "ride_car": ((_HMMWV, ("Hmmwv",)), (_SEDAN, ("Sedan",))),
    "three_axle": ((_THREE_AXLE, ("",)),),
    "three_axle_trench": ((_TRENCH, ("",)), (_THREE_AXLE, ("",))),
    "wishbone_car": ((_WISHBONE, ("HmmwvPublic",)),),
    "actuator": ((_ACTUATOR, ("", "Physical")),),
    "sensors": ((_SENSORS, ("Hmmwv",)), (_AROUND_SENSORS, ("Hmmwv",))),
}
"""By kind of vehicle file: what is made of it, and what the vehicles are called that this is published for."""

_ROADS = {  # name -> maker in fmu_sources.roads (none: with the wheels of the vehicle file), summary
    "RoadSine": ("road_sine", "sine road of paper 000"),
    "RoadCurb": ("road_curb", "curb road of paper 000"),
    "RoadPerryman3": ("road_perryman3", "synthetic stand-in for the Perryman 3 test course"),
    "RoadProvingGround": ("", "synthetic RMS courses and a half-round under the full car"),
    "RoadRandom": ("road_random", "random road, ISO 8608: class, seed and length are parameters"),
}
_GPC_PLANT = "FullCarHmmwvModified"
_GPC = {
    "GpcImplicit": ("GPC with implicit disturbances (paper 000)", "implicit"),
    "GpcExplicit": ("GPC with explicit disturbances (paper 000)", "explicit"),
    "GpcPreview": ("GPC with preview (paper 000)", "preview"),
}


def _gpc(variant: str, plant: str, road: str, name: str) -> Callable[[Context], Component]:
    def make(context: Context) -> Component:
        from fmu_sources.controllers.gpc.component import gpc_controller
        from fmu_sources.controllers.gpc.identification import published_laws

        laws = published_laws(
            plant=context.fmu(plant), road=context.fmu(road), speed=context.fmu("SpeedProfile"), cache=context.cache
        )
        return gpc_controller(laws[variant], name=name)

    return make
