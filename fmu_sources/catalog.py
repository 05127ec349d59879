"""The catalog: every FMU of this project, with how its component is made and which FMUs it needs first.

What there is stands at the makers (`fmu_sources.registration`). Listing the catalog imports none of them; an entry
imports its maker when it makes the component.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from importlib import import_module
from inspect import signature
from pathlib import Path
from typing import TYPE_CHECKING, Any

from build_fmus.base.checks import did_you_mean
from fmu_sources.registration import Declaration, declarations

if TYPE_CHECKING:
    from build_fmus.component import Component
    from fmu_sources.roads import RoadLayout

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

Preview = tuple[int, float]  # heights ahead, and the time between them [s]
GPC_PREVIEW, MPC_PREVIEW, LQ_PREVIEW, CROSSING_PREVIEW = (8, 0.010), (16, 0.030), (48, 0.005), (50, 0.005)


@dataclass(frozen=True)
class Published:
    """A vehicle file of this project that FMUs are made of.

    Attributes:
        called: what the vehicle is called in their names.
        preview: what its controllers read of the road.
        radius: of its wheels as they roll over a course [m]; 0: its tires envelop, and get the course as it is;
            None: that of the vehicle file.
        about: end of the summaries.
        listed: false for what only vehicle files of users are made into.
    """

    called: str = ""
    preview: Preview = GPC_PREVIEW
    radius: float | None = None
    about: str = ""
    listed: bool = True


PUBLISHED = {
    "ride_car_hmmwv": Published("Hmmwv", MPC_PREVIEW, 0.47),  # 37 x 12.5 tires
    "sensors_hmmwv": Published("Hmmwv"),
    "own_sensors": Published("Hmmwv", MPC_PREVIEW, listed=False),  # the HMMWV with sensors of a user
    "sedan": Published("Sedan", LQ_PREVIEW, 0.31),  # assumed
    "quarter_car_hmmwv": Published("Hmmwv"),
    "quarter_car_bench": Published("Bench"),
    "": Published(),  # components without a vehicle
    "three_axle": Published("", CROSSING_PREVIEW, 0.62),  # files of obstacle runs
    "three_axle_trench": Published("", CROSSING_PREVIEW),
    "actuator_hmmwv": Published(),
    "actuator_hmmwv_physical": Published("Physical", about=", density of real oil"),
    "hmmwv_public": Published("HmmwvPublic", radius=0.0),
    "hmmwv": Published("Hmmwv"),
    "hmmwv_modified": Published("HmmwvModified"),
    "hmmwv_tires": Published("HmmwvTires", about=", tires by file"),
}
"""By name of the vehicle file, in the order of the catalog."""

KINDS = {
    "full_car": ("hmmwv_modified",),
    "ride_car": ("ride_car_hmmwv", "sedan"),
    "three_axle": ("three_axle",),
    "three_axle_trench": ("three_axle_trench", "three_axle"),
    "wishbone_car": ("hmmwv_public",),
    "quarter_car": ("quarter_car_hmmwv", "quarter_car_bench"),
    "actuator": ("actuator_hmmwv", "actuator_hmmwv_physical"),
    "sensors": ("sensors_hmmwv", "own_sensors"),
}
"""By kind of a user's vehicle file: the published files whose FMUs are made of it too."""


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
    files: tuple[Path, ...] = ()  # beside the code, that determine the component
    choices: str = ""  # options of the user that determine it


@dataclass(frozen=True)
class Source:
    """A vehicle file that components are made of.

    Attributes:
        of: the published file, a key of `PUBLISHED`, whose components are made.
        file: the name of a published file, or a file of the user in its place.
        called: what the vehicle is called in names of FMUs.
    """

    of: str
    file: str | Path
    called: str

    def name(self, template: str) -> str:
        """The name of an FMU, see `Declaration.name`."""
        return template.format(v=self.called, s=self.called if isinstance(self.file, Path) else "")

    def entry(self, declaration: Declaration) -> Entry:
        """The FMU of a declaration, made of this file."""
        needs = tuple(map(self.name, declaration.needs))
        summary = declaration.summary.format(file=self.file)
        return Entry(self.name(declaration.name), summary, partial(self.make, declaration), needs)

    def make(self, declaration: Declaration, context: Context) -> Component:
        """The component of a declaration: calls the maker with the arguments that its parameters name."""
        from fmu_sources.roads import RoadScan
        from fmu_sources.vehicles import load_sensors, load_vehicle

        car, sensors = (_HMMWV, self.file) if self.of in KINDS["sensors"] else (self, SENSORS)
        published = PUBLISHED[self.of]
        given: dict[str, Callable[[], Any]] = {
            "name": lambda: self.name(declaration.name),
            "vehicle": lambda: load_vehicle(car.file),
            "sensors": lambda: load_sensors(sensors),
            "car": lambda: car.plant(context),
            "layout": lambda: layout(car.file, published.preview, sensors if declaration.scanned else None),
            "scan": lambda: RoadScan.of(load_sensors(sensors)),
            "radius": lambda: wheel_radius(self.of, car.file),
            "fmus": lambda: [context.fmu(self.name(n)) for n in declaration.needs],
            "cache": lambda: context.cache,
        }
        maker = getattr(import_module(f"fmu_sources.{declaration.module}"), declaration.maker)
        taken = {p: given[p]() for p in signature(maker).parameters if p in given}
        made: Component = maker(**taken, **declaration.options)
        return made

    def plant(self, context: Context) -> Component:
        """The vehicle itself, on which controllers and estimators are designed."""
        return self.make(next(d for d in declarations(self.of) if d.module.startswith("plants.")), context)


SENSORS = "sensors_hmmwv"  # of every car without sensors of a user
_HMMWV = Source("ride_car_hmmwv", "ride_car_hmmwv", "Hmmwv")  # the car with sensors of a user


def layout(vehicle: str | Path, preview: Preview, sensors: str | Path | None = None) -> RoadLayout:
    """Wheels of a vehicle on a road, with preview and what range sensors see."""
    from fmu_sources.roads import RoadLayout, RoadScan
    from fmu_sources.vehicles import load_sensors, load_vehicle

    scan = None if sensors is None else RoadScan.of(load_sensors(sensors))
    count, step = preview
    return RoadLayout.of(load_vehicle(vehicle), preview_count=count, preview_step=step, scan=scan)  # type: ignore[arg-type]


def wheel_radius(of: str, vehicle: str | Path) -> float:
    """Radius of the wheels of a vehicle as they roll over a course [m], see `Published.radius`."""
    from fmu_sources.vehicles import load_full_car

    radius = PUBLISHED[of].radius
    return load_full_car(vehicle).wheel.radius.value if radius is None else radius


def default_catalog() -> dict[str, Entry]:
    """The FMUs of this project, with the vehicles they are published for."""
    entries: dict[str, Entry] = {}
    for vehicle, published in PUBLISHED.items():
        for declaration in declarations(vehicle) if published.listed else ():
            entry = Source(vehicle, vehicle, published.called).entry(declaration)
            entries[entry.name] = replace(entry, summary=entry.summary + published.about)
    return entries


def find(catalog: dict[str, Entry], name: str) -> Entry:
    """Entry by name; KeyError that proposes the nearest one."""
    try:
        return catalog[name]
    except KeyError:
        raise KeyError(f"no FMU named {name!r}{did_you_mean(name, catalog)} (build-fmus --list shows all)") from None
