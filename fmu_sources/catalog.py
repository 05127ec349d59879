"""The one list of FMUs: name -> how to make the component, and which FMUs it needs first.

Importing this module costs nothing: makers import their modules when called.
"""

from __future__ import annotations

import difflib
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from build_fmus.component import Component


PAPERS = {
    "000": "R. Brown, M. Murugan, M. Mazza: Analytical Evaluation of Generalized Predictive Control Algorithms Using a Full "
    "Vehicle Multi-Body Dynamics Model For Mobility Enhancement",
    "001": "M. D. Donahue, J. K. Hedrick: Implementation of an Active Suspension, Preview Controller for Improved Ride Comfort",
    "003": "A. Kale: Mobility Improvement of Wheeled Military Vehicles Using Preview Controlled Active Ride Height System, "
    "M.Sc. thesis, Hacettepe University, 2020",
    "002": "R. R. Das, E. Vinodh Kumar: Active Suspension with Model Predictive Control",
    "004": "J. Marzbanrad, Y. Hojjat, H. Zohoor, S. K. Nikravesh: Optimal Preview Control Design of an Active Suspension Based "
    "on a Full Car Model",
}
"""What the short names in sources stand for."""


@dataclass(frozen=True)
class Context:
    """What a maker may use: where finished FMUs are, where derived data may be kept."""

    fmus: Path
    cache: Path

    def fmu(self, name: str) -> Path:
        """Path of an FMU that the entry named in ``needs`` (the FMI 3.0 one)."""
        return self.fmus / "fmi3" / f"{name}.fmu"


@dataclass(frozen=True)
class Entry:
    """One FMU of the catalog."""

    name: str
    summary: str
    make: Callable[[Context], Component]
    needs: tuple[str, ...] = ()
    files: tuple[Path, ...] = ()  # user files that determine the component


def default_catalog() -> dict[str, Entry]:
    """The FMUs of this project, with the vehicles they are published for."""
    entries = [
        *(
            Entry(name, f"LQR of paper 001, {summary}", _lqr_hmmwv(weights, name))
            for name, (weights, summary) in _LQR_HMMWV.items()
        ),
        Entry("QuarterCarHmmwv", "quarter car of the HMMWV (paper 001)", _quarter_car),
        Entry("RideCarSedan", "linear 7-DOF ride car of paper 004", _ride_car("sedan", "RideCarSedan")),
        Entry("RideCarHmmwv", "linear 7-DOF ride car, HMMWV (paper 001)", _ride_car("ride_car_hmmwv", "RideCarHmmwv")),
        Entry("ThreeAxleRide", "linear 9-DOF ride model of the 6x6 of paper 003", _three_axle_ride),
        Entry("ThreeAxleTrench", "6x6 of paper 003 over trenches and obstacles, with contact", _three_axle_trench),
        Entry("LqrThreeAxle", "linear-quadratic regulator with pitch reference (paper 003)", _lqr_three_axle),
        Entry("MpcThreeAxle", "MPC with preview of road and pitch for the 6x6 (paper 003)", _mpc_three_axle),
        Entry("TrenchCrossing", "cases, pitch reference and effective road for trenches (paper 003)", _trench_crossing),
        Entry("PitchReference", "pitch that ramps up, holds and ramps down (paper 003)", _pitch_reference),
        Entry("RoadShallowTrench", "shallow trench under the 6x6 of paper 003", _road_shallow_trench),
        *(
            Entry(name, f"electro-hydraulic actuator (paper 001), {summary}", _hydraulic_actuator(parameters, name))
            for name, (parameters, summary) in _ACTUATORS.items()
        ),
        *(
            Entry(name, f"hydraulic force tracking (paper 001), {summary}", _force_tracking(parameters, name))
            for name, (parameters, summary) in _FORCE_TRACKING.items()
        ),
        Entry("QuarterCarBench", "quarter-car bench of paper 002", _bench_plant),
        *(Entry(name, summary, _bench(name)) for name, (_, _, summary) in _BENCH.items()),
        *(Entry(name, summary, _hmmwv_sensors(maker, name)) for name, (maker, summary) in _CHAIN.items()),
        Entry("RideComfort", "absorbed power and ISO 2631-1 (paper 001)", _ride_comfort),
        Entry("MpcHmmwv", "MPC of the HMMWV with or without preview (paper 001)", _mpc_hmmwv),
        Entry("RoadBumps", "test track of speed bumps (paper 001)", _hmmwv_road("road_bumps")),
        Entry("RoadHoleBump", "hole, flat and bump of paper 004", _sedan_road("road_hole_bump")),
        Entry("RoadIso8608", "random road, ISO 8608 class A to H", _sedan_road("road_iso8608")),
        *(
            Entry(name, f"preview LQ law of paper 004, {summary}", _preview_lq(weights, name, period))
            for name, (weights, period, summary) in _PREVIEW_LQ.items()
        ),
        Entry(
            "RoadOffroadHmmwv",
            "off-road terrain under the HMMWV (paper 001)",
            _hmmwv_road("road_offroad", name="RoadOffroadHmmwv"),
        ),
        Entry("Skyhook", "skyhook damping (paper 001)", _skyhook),
        Entry("SpeedProfile", "constant speed or ramp, with travelled distance", _speed_profile),
        *vehicle_catalog("hmmwv", plant="FullCarHmmwv", suffix=None).values(),
        *vehicle_catalog("hmmwv_modified", plant="FullCarHmmwvModified", suffix="").values(),
    ]
    return {e.name: e for e in entries}


def vehicle_catalog(vehicle: str | Path, *, plant: str, suffix: str | None) -> dict[str, Entry]:
    """The full car of a vehicle file, and with ``suffix`` the roads under its wheels and its GPC laws.

    Names are ``plant`` and the contract names with ``suffix`` appended.
    """
    files = (vehicle,) if isinstance(vehicle, Path) else ()

    def full_car(_: Context) -> Component:
        from fmu_sources.plants import full_car as make
        from fmu_sources.vehicles import load_full_car

        return make(load_full_car(vehicle), name=plant)

    entries = [Entry(plant, f"nonlinear full car, vehicle file {vehicle}", full_car, files=files)]
    if suffix is not None:
        for name, (maker, summary) in _ROADS.items():
            entries.append(Entry(name + suffix, summary, _road(maker, vehicle, name + suffix), files=files))
        needs = (plant, "RoadPerryman3" + suffix, "SpeedProfile")
        for name, (summary, variant) in _GPC.items():
            make = _gpc(variant, plant, "RoadPerryman3" + suffix, name + suffix)
            entries.append(Entry(name + suffix, summary, make, needs=needs, files=files))
    return {e.name: e for e in entries}


def road_entry(path: Path, name: str, vehicle: str | Path = "hmmwv_modified") -> Entry:
    """A road from a user's file under the wheels of a vehicle."""

    def make(_: Context) -> Component:
        from fmu_sources.roads import RoadLayout, road_from_file
        from fmu_sources.vehicles import load_full_car

        return road_from_file(path, RoadLayout.of(load_full_car(vehicle)), name=name)

    files = (path, vehicle) if isinstance(vehicle, Path) else (path,)
    return Entry(name, f"road from {path.name}", make, files=files)


def preview_lq_entry(path: Path, name: str, period: float = 1e-3) -> Entry:
    """A preview LQ law of the sedan with a user's weights, at any sample time [s]."""
    return Entry(
        name, f"preview LQ law with the weights of {path.name}", _preview_lq(path, name, period), files=(path,)
    )


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
                f"{path} has no function {maker!r}; name one with FILE.py:FUNCTION (it has {', '.join(known) or 'none'})"
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
        near = difflib.get_close_matches(name, catalog, n=1)
        hint = f"; did you mean {near[0]}?" if near else ""
        raise KeyError(f"no FMU named {name!r}{hint} (build-fmus --list shows all)") from None


_ROADS = {  # name -> maker in fmu_sources.roads, summary
    "RoadSine": ("road_sine", "sine road of paper 000"),
    "RoadCurb": ("road_curb", "curb road of paper 000"),
    "RoadPerryman3": ("road_perryman3", "synthetic stand-in for the Perryman 3 test course"),
}
_PREVIEW_LQ = {
    "PreviewLqComfort": ("comfort", 1e-3, "ride comfort"),
    "PreviewLqRoadHolding": ("road_holding", 1e-3, "road holding"),
    "PreviewLqComfort5ms": ("comfort", 5e-3, "ride comfort, sampled at 5 ms"),
}
_BENCH: dict[str, tuple[str, str, str]] = {  # name -> module, maker, summary
    "LqrBench": ("controllers.bench", "lqr_bench", "LQR of the quarter-car bench (paper 002)"),
    "MpcBench": ("controllers.bench", "mpc_bench", "MPC of the quarter-car bench (paper 002)"),
    "MpcBenchMoves": ("controllers.bench", "mpc_bench_moves", "MPC of the bench, weight on the moves (paper 002)"),
    "BenchEncoders": ("sensing.bench_encoders", "bench_encoders", "encoders of the bench, velocities estimated"),
    "RoadBenchBump": ("roads.bench", "road_bench_bump", "bump of the quarter-car bench over time"),
    "RoadBenchRandom": ("roads.bench", "road_bench_random", "random motion of the bench's plate over time"),
}
_ACTUATORS = {
    "HydraulicActuator": ("actuator_hmmwv", "the paper's parameters"),
    "HydraulicActuatorPhysical": ("actuator_hmmwv_physical", "density of real oil"),
}
_LQR_HMMWV = {
    "LqrHmmwv": ("TABLE_1_1", "force weighted in N, as published"),
    "LqrHmmwvKilonewton": ("TABLE_1_1_KILONEWTON", "force weighted in kN"),
}
_FORCE_TRACKING = {
    "ForceTracking": ("actuator_hmmwv", "the paper's parameters"),
    "ForceTrackingPhysical": ("actuator_hmmwv_physical", "density of real oil"),
}
_HMMWV_SENSORS = "sensors_hmmwv"
_CHAIN = {  # name -> maker in fmu_sources.sensing or .estimators, summary
    "SensorSuite": ("sensor_suite", "sensors of the HMMWV (paper 001, Tables 1.5 and 1.6)"),
    "KalmanHmmwv": ("kalman_hmmwv", "Kalman filter of 15 relative states (paper 001)"),
    "KalmanHmmwvPrinted": ("kalman_hmmwv_printed", "Kalman filter of 14 absolute states, as printed (paper 001)"),
    "PreviewSensor": ("preview_sensor", "road ahead from range sensors, equation (1.18) (paper 001)"),
    "PreviewBuffer": ("preview_buffer", "road ahead by distance, read under each wheel (paper 001)"),
}
_GPC = {
    "GpcImplicit": ("GPC with implicit disturbances (paper 000)", "implicit"),
    "GpcExplicit": ("GPC with explicit disturbances (paper 000)", "explicit"),
    "GpcPreview": ("GPC with preview (paper 000)", "preview"),
}


def _quarter_car(_: Context) -> Component:
    from fmu_sources.plants import quarter_car
    from fmu_sources.vehicles import load_quarter_car

    return quarter_car(load_quarter_car("quarter_car_hmmwv"), name="QuarterCarHmmwv")


def _mpc_hmmwv(_: Context) -> Component:
    from fmu_sources.controllers.mpc_hmmwv import mpc_hmmwv
    from fmu_sources.plants import ride_car
    from fmu_sources.vehicles import load_ride_car

    return mpc_hmmwv(ride_car(load_ride_car("ride_car_hmmwv"), name="RideCarHmmwv"))


def _bench_plant(_: Context | None = None) -> Component:
    from fmu_sources.plants import quarter_car
    from fmu_sources.vehicles import load_quarter_car

    return quarter_car(load_quarter_car("quarter_car_bench"), name="QuarterCarBench", source="002 equations (1), (2)")


def _bench(name: str) -> Callable[[Context], Component]:
    """A component around the quarter-car bench."""
    module, maker, _ = _BENCH[name]

    def make(_: Context) -> Component:
        import importlib

        function = getattr(importlib.import_module(f"fmu_sources.{module}"), maker)
        return function(_bench_plant(), name=name) if module.startswith("controllers") else function(name)

    return make


def _ride_car(vehicle: str, name: str) -> Callable[[Context], Component]:
    def make(_: Context) -> Component:
        from fmu_sources.plants import ride_car
        from fmu_sources.vehicles import load_ride_car

        return ride_car(load_ride_car(vehicle), name=name)

    return make


def _three_axle_trench(_: Context) -> Component:
    from fmu_sources.plants import three_axle_trench
    from fmu_sources.vehicles import load_three_axle_trench

    return three_axle_trench(load_three_axle_trench("three_axle_trench"), name="ThreeAxleTrench")


def _trench_crossing(_: Context) -> Component:
    from fmu_sources.controllers.trench_crossing import CrossingGeometry, trench_crossing

    return trench_crossing(CrossingGeometry.of(_three_axle_trench(_)))


def _three_axle_ride(_: Context | None = None) -> Component:
    from fmu_sources.plants import ride_car
    from fmu_sources.vehicles import load_three_axle

    return ride_car(load_three_axle("three_axle"), name="ThreeAxleRide")


def _lqr_three_axle(_: Context) -> Component:
    from fmu_sources.controllers.lqr_three_axle import lqr_three_axle

    return lqr_three_axle(_three_axle_ride())


def _mpc_three_axle(_: Context) -> Component:
    from fmu_sources.controllers.mpc_three_axle import mpc_three_axle

    return mpc_three_axle(_three_axle_ride())


def _pitch_reference(_: Context) -> Component:
    from fmu_sources.controllers.pitch_reference import pitch_reference

    return pitch_reference()


def _road_shallow_trench(_: Context) -> Component:
    from fmu_sources.roads import RoadLayout, road_shallow_trench
    from fmu_sources.vehicles import load_three_axle

    return road_shallow_trench(RoadLayout.of(load_three_axle("three_axle"), preview_count=50, preview_step=0.005))


def _hydraulic_actuator(parameters: str, name: str) -> Callable[[Context], Component]:
    def make(_: Context) -> Component:
        from fmu_sources.plants import hydraulic_actuator
        from fmu_sources.vehicles import load_actuator

        return hydraulic_actuator(load_actuator(parameters), name=name)

    return make


def _force_tracking(parameters: str, name: str) -> Callable[[Context], Component]:
    def make(_: Context) -> Component:
        from fmu_sources.controllers.force_tracking import force_tracking
        from fmu_sources.vehicles import load_actuator

        return force_tracking(load_actuator(parameters), name=name)

    return make


def _ride_comfort(_: Context) -> Component:
    from fmu_sources.sensing import ride_comfort

    return ride_comfort()


def _sedan_road(maker: str) -> Callable[[Context], Component]:
    """A road under the sedan of paper 004, with the preview that its controllers use."""
    return _ride_car_road(maker, "sedan", count=48, step=0.005)


def _hmmwv_road(maker: str, **options: Any) -> Callable[[Context], Component]:
    """A road under the HMMWV of paper 001, with the preview that its controllers use and what its range sensors see."""
    return _ride_car_road(maker, "ride_car_hmmwv", count=16, step=0.030, sensors=_HMMWV_SENSORS, **options)


def _ride_car_road(
    maker: str, vehicle: str, *, count: int, step: float, sensors: str | None = None, **options: Any
) -> Callable[[Context], Component]:
    def make(_: Context) -> Component:
        from fmu_sources import roads
        from fmu_sources.vehicles import load_ride_car, load_sensors

        scan = None if sensors is None else roads.RoadScan.of(load_sensors(sensors))
        layout = roads.RoadLayout.of(load_ride_car(vehicle), preview_count=count, preview_step=step, scan=scan)
        return getattr(roads, maker)(layout, **options)

    return make


def _hmmwv_sensors(maker: str, name: str) -> Callable[[Context], Component]:
    """A component of the estimation and preview chain of paper 001."""

    def make(_: Context) -> Component:
        from fmu_sources import estimators, roads, sensing
        from fmu_sources.vehicles import load_ride_car, load_sensors

        sensors, vehicle = load_sensors(_HMMWV_SENSORS), load_ride_car("ride_car_hmmwv")
        if maker == "sensor_suite":
            return sensing.sensor_suite(sensors, roads.RoadScan.of(sensors), name)
        if maker == "preview_sensor":
            return sensing.preview_sensor(sensors, vehicle, name)
        if maker == "preview_buffer":
            return sensing.preview_buffer(roads.RoadLayout.of(vehicle, preview_count=16, preview_step=0.030), name)
        return getattr(estimators, maker)(_hmmwv_car(), sensors, name)

    return make


def _hmmwv_car() -> Component:
    """The car that the controllers and the estimator of paper 001 are designed on."""
    from fmu_sources.plants import ride_car
    from fmu_sources.vehicles import load_ride_car

    return ride_car(load_ride_car("ride_car_hmmwv"), name="RideCarHmmwv")


def _skyhook(_: Context) -> Component:
    from fmu_sources.controllers.skyhook import skyhook

    return skyhook(_hmmwv_car())


def _lqr_hmmwv(weights: str, name: str) -> Callable[[Context], Component]:
    def make(_: Context) -> Component:
        from fmu_sources.controllers import lqr_hmmwv as lqr

        return lqr.lqr_hmmwv(_hmmwv_car(), getattr(lqr, weights), name)

    return make


def _preview_lq(weights: str | Path, name: str, period: float) -> Callable[[Context], Component]:
    def make(_: Context) -> Component:
        from fmu_sources.controllers.preview_lq import preview_lq
        from fmu_sources.controllers.preview_lq_weights import load_weights
        from fmu_sources.plants import ride_car
        from fmu_sources.vehicles import load_ride_car

        car = ride_car(load_ride_car("sedan"), name="RideCarSedan")
        return preview_lq(car, load_weights(weights), name=name, period=period)

    return make


def _speed_profile(_: Context) -> Component:
    from fmu_sources.roads import speed_profile

    return speed_profile()


def _road(maker: str, vehicle: str | Path, name: str) -> Callable[[Context], Component]:
    def make(_: Context) -> Component:
        from fmu_sources import roads
        from fmu_sources.vehicles import load_full_car

        return getattr(roads, maker)(roads.RoadLayout.of(load_full_car(vehicle)), name=name)

    return make


def _gpc(variant: str, plant: str, road: str, name: str) -> Callable[[Context], Component]:
    def make(context: Context) -> Component:
        from fmu_sources.controllers.gpc import gpc_controller
        from fmu_sources.controllers.gpc_identification import published_laws

        laws = published_laws(
            plant=context.fmu(plant), road=context.fmu(road), speed=context.fmu("SpeedProfile"), cache=context.cache
        )
        return gpc_controller(laws[variant], name=name)

    return make
