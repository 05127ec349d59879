"""Maps of mobility engineering: speed over roughness at 6 W, over obstacles at 2.5 g, absorbed power over speed."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import wraps
from typing import Any

from cosim.experiments.ride import EXPERIMENT
from cosim.experiments.ride.claims import CLAIMS, NRMM
from cosim.experiments.ride.published import HEIGHTS, POWERS, SIDES_COURSE, CarSystem
from cosim.experiments.ride.results import CAR_NAMES, Driven, Searches, Speeds, name
from cosim.experiments.ride.runs import CARS, LIMIT_G, METRICS, OBSTACLE
from cosim.experiments.ride.search import LIMITS, TOLERANCE, WITHIN
from cosim.report import Figure, Panel, Parameter, Series, Table, level
from cosim.report.model import Color
from cosim.study import Content, FmuSet, StudyReport, parameters
from fmu_sources.models.comfort import ABSORBED_POWER_LIMIT
from fmu_sources.roads.rms_course import COURSES

_CONTROLLERS: dict[Color, tuple[str, ...]] = {
    "black": ("passive",),
    "gray": ("zero", "add", "road-holding-delay"),
    "sky": ("skyhook", "comfort-delay"),
    "vermilion": ("skyhook-on-off", "lqr-kilonewton", "road-holding-preview"),
    "green": ("groundhook", "mpc-preview", "comfort-preview", "preview"),
    "purple": ("sh-add",),
    "orange": ("lqr", "road-holding-active", "explicit"),
    "blue": ("mpc", "comfort-active", "implicit"),
}
_COLORS = {controller: color for color, controllers in _CONTROLLERS.items() for controller in controllers}
_CAR_COLORS: dict[str, Color] = dict(zip(CARS, ("blue", "orange", "green", "purple", "vermilion", "sky"), strict=True))
_ROUGHNESS = "detrended rms of the course [mm]", "speed of 6 W [km/h]"
_OBSTACLES = "height of the half-round [mm]", f"speed of {LIMIT_G:g} g [km/h]"
_SHOWN: Mapping[str, int] = {  # beside a speed of 6 W, with these decimals
    "iso2631_rms": 2,
    "travel_rms": 1,
    "travel_peak": 0,
    "force_rms": 2,
    "power_given": 2,
    "power_supply": 1,
}


def _parameters(fmus: FmuSet) -> list[Parameter]:
    rows = [
        Parameter("limit of absorbed power", LIMITS[NRMM], "W", "ride-quality literature; 001 section 1.6"),
        Parameter("limit of the seat's acceleration", LIMIT_G, "g", "mobility models"),
        Parameter("closeness of speeds", TOLERANCE, "1", "own"),
    ]
    rolling = "rolling wheel of the course: tires, vehicle file, or assumed"
    for plant, car in {car.plant: car for car in CARS.values()}.items():
        rows += [p for p in parameters(fmus.path(plant), prefix=f"{plant} ") if p.name.startswith(f"{plant} seat.")]
        rows.append(Parameter(f"{plant} wheel radius", car.radius, "m", rolling))
    return rows


def _claims(study: Searches) -> Any:
    """Claims compare the cars on the synthetic courses, so all of them have to be there."""
    return CLAIMS.judge(study.results) if not study.file and study.cars == list(CARS) else []


report = StudyReport(
    EXPERIMENT,
    "Absorbed power and obstacles: how fast each car can be driven",
    _claims,
    _parameters,
    view=lambda results, _: Searches(results),
)


def _synthetic(title: str) -> Callable[[Any], Any]:
    """A section about the synthetic courses, which is left out where the course of a file was driven."""

    def keep(function: Any) -> Any:
        return report.section(title)(wraps(function)(lambda study: iter(()) if study.file else function(study)))

    return keep


Fast = tuple[float, CarSystem]  # speed of 6 W [km/h]


@report.lead
def _main_result(study: Searches) -> Content:
    """How fast each car can be driven, without control and with the controller with which it is fastest."""
    course = study.file or SIDES_COURSE
    compared = {car: found for car in study.cars if (found := _slow_and_fast(study, car, course))}
    texts = [
        f"{CAR_NAMES[car]} {' and '.join(f'{v:.1f} km/h ({name(s)})' for v, s in found)}"
        for car, found in compared.items()
    ]
    where = f"the course {course}" if study.file else f"the course of {course.removesuffix('in')} in rms"
    yield (
        f"On {where}, the driver absorbs {ABSORBED_POWER_LIMIT:g} W at these speeds: {'; '.join(texts)}."
        if texts
        else f"On {where}, no car was found to reach {ABSORBED_POWER_LIMIT:g} W of absorbed power."
    )
    if not study.file:
        yield from _over_roughness(study, compared)
    elif panels := [p for car in study.cars for p in _curves(study, car, course, CAR_NAMES[car])]:
        yield Figure("power", "Absorbed power over speed", "Third order; points are runs.", panels, columns=2)


def _slow_and_fast(study: Searches, car: str, course: str) -> list[Fast]:
    """Of a car without control, and with the controller with which it is fastest."""
    medians = [(d.speeds(NRMM).median, d.case.system) for d in study.known(car=car, course=course, sides="alike")]
    known = [(v, system) for v, system in medians if v is not None]
    shown = [(v, system) for v, system in known if system[1] == "passive"][:1]
    return shown + [fastest for fastest in [max(known, default=None)] if fastest is not None and fastest not in shown]


def _over_roughness(study: Searches, compared: Mapping[str, Sequence[Fast]]) -> Content:
    """Speed over roughness of the systems that are compared, those without control dashed."""
    curves = []
    for car, found in compared.items():
        drawn = {s.name: s for panel in _over_courses(study, car) for s in panel.series}
        for _, system in found if drawn else ():
            look: dict[str, Any] = {"color": _CAR_COLORS[car], "dash": "dash" if system[1] == "passive" else "solid"}
            curves.append(replace(drawn[name(system)], name=f"{CAR_NAMES[car]}, {name(system)}", **look))
    if curves:
        yield Figure(
            "main-result",
            f"Speed at which the driver absorbs {ABSORBED_POWER_LIMIT:g} W, over roughness",
            "Without control (dashed), and with the controller with which the car is fastest on the course of"
            f" {SIDES_COURSE} rms. Absorbed power by the filter of third order; bands from the lowest to the highest of"
            " the profiles.",
            [Panel("", *_ROUGHNESS, curves)],
        )


@report.section("Runs of the study")
def _about(study: Searches) -> Content:
    synthetic = "synthetic courses with the rms and spectrum of a proving ground's, and over half-rounds"
    yield f"""Every car of the project with every controller that fits it drives over
    {f"the course {study.file}" if study.file else synthetic}. How fast it can be driven is where its driver absorbs
    {ABSORBED_POWER_LIMIT:g} W, and over an obstacle where the seat sees {LIMIT_G:g} g. Everything is of the driver's
    seat, without seat and cushion. Absorbed power is by both definitions in use, which must not be mixed."""


@report.section(lambda study: f"Course {study.file}")
def _on_file(study: Searches) -> Content:
    """Course."""
    if not study.file:
        return
    yield "Both tracks are those of the file, as wheels roll over them."
    rows = [
        {"car": CAR_NAMES[car], **_row(d), f"{LIMIT_G:g} g [km/h]": d.speeds("seat_peak").words}
        for car in study.cars
        for d in study.known(car=car)
    ]
    caption = "The other columns are of the run that is nearest to 6 W by the filter of third order."
    yield Table.of("course", "Speeds of 6 W and of 2.5 g", rows, caption)


def _row(made: Driven) -> dict[str, Any]:
    """Controller, speeds of 6 W by both definitions, and what else there is at the first of them."""
    third, second = (made.speeds(m).words for m in POWERS)
    near = made.nearest(NRMM) or {}
    return {
        "system": name(made.case.system),
        "6 W, third order [km/h]": third,
        "6 W, second order [km/h]": second,
        **{METRICS[k].heading: round(METRICS[k].factor * near[k], n) if k in near else None for k, n in _SHOWN.items()},
    }


# ------------------------------------------------------------------------------------------------- synthetic courses


def _series(system: CarSystem, x: Sequence[float], y: Sequence[float], low: Any = None, high: Any = None) -> Series:
    dash = "dash" if system[2] == "hydraulic" and system[1] != "passive" else "solid"
    return Series(name(system), x, y, low, high, _COLORS[system[1]], dash, "line+markers")  # type: ignore[arg-type]


@_synthetic("Maps")
def _maps(study: Searches) -> Content:
    """What mobility engineers draw of a vehicle: speed over roughness and over obstacles."""
    for car in study.cars:
        panels = [*_over_courses(study, car), *_over_obstacles(study, car)]
        if panels:
            caption = "6 W by the filter of third order, bands from the lowest to the highest of the profiles."
            yield Figure(f"map-{car}", f"How fast: {CAR_NAMES[car]}", caption, panels, columns=2)


def _over_courses(study: Searches, car: str) -> list[Panel]:
    series = []
    for system in study.systems(car):
        driven = [
            (d.case.course, d.speeds(NRMM))
            for d in study.known(system=system, sides="alike")
            if d.case.course in COURSES
        ]
        own = {c: (v.median, min(v.found), max(v.found)) for c, v in driven if v.median is not None}
        if own:
            series.append(_series(system, [1e3 * COURSES[c].rms for c in own], *zip(*own.values(), strict=True)))
    return [Panel("over courses", *_ROUGHNESS, series)] if series else []


def _over_obstacles(study: Searches, car: str) -> list[Panel]:
    series = []
    for system in study.systems(car):
        own = {h: v.median for h, v in _heights(study, system).items() if v.median is not None}
        if own:
            series.append(_series(system, [1e3 * h for h in own], list(own.values())))
    return [Panel("over half-rounds", *_OBSTACLES, series)] if series else []


def _heights(study: Searches, system: CarSystem) -> dict[float, Speeds]:
    """Speeds of 2.5 g by the height of the half-round [m]."""
    return {d.case.height: d.speeds("seat_peak") for d in study.known(system=system, course=OBSTACLE)}


@_synthetic("Speeds of 6 W")
def _speeds(study: Searches) -> Content:
    yield f"""Each speed is found by driving the whole course, to {100 * TOLERANCE:g} %. The courses are the same left
    and right, as the measured ones are, so that a car heaves and pitches on them and does not roll.

    Controllers are those of the papers, with their published weights and for their published roads. A controller that
    is tuned for another purpose (pitch of the 6x6 over a trench, road holding of the sedan) may well be worse here than
    no controller."""
    for car in study.cars:
        driven = [d for course in COURSES for d in study.known(car=car, course=course, sides="alike")]
        rows = [{"course": d.case.course, **_row(d)} for d in driven]
        used = {heading for row in rows for heading, cell in row.items() if cell is not None}
        if rows:
            yield Table.of(
                f"six-watts-{car}",
                f"Speeds of 6 W, {CAR_NAMES[car]}",
                [{heading: cell for heading, cell in row.items() if heading in used} for row in rows],
                "Speeds are medians over the profiles of a course, with the lowest and the highest where several were"
                " driven. The other columns are of the run on the first profile that is nearest to 6 W by the filter of"
                " third order. Power given: the positive power of all actuators together; regenerated power is lost. A"
                f" speed is 'never' where {WITHIN[1]:g} km/h stays below 6 W, 'at any speed' where {WITHIN[0]:g} km/h"
                " is above.",
            )


@_synthetic("Absorbed power over speed")
def _power(study: Searches) -> Content:
    for car in study.cars:
        panels = [p for course in COURSES for p in _curves(study, car, course, f"{course} rms")]
        if panels:
            title = f"Absorbed power over speed, {CAR_NAMES[car]}"
            yield Figure(f"power-{car}", title, "Third order, first profile; points are runs.", panels, columns=3)


def _curves(study: Searches, car: str, course: str, title: str) -> list[Panel]:
    driven = {d.case.system: d.runs() for d in study.known(car=car, course=course, sides="alike")}
    series = [_series(s, [r["speed_kmh"] for r in rows], [r[NRMM] for r in rows]) for s, rows in driven.items() if rows]
    if not series:
        return []
    every = [x for s in series for x in s.x_values]
    limit = level("6 W", every, ABSORBED_POWER_LIMIT, color="purple", dash="dot")
    return [Panel(title, "speed [km/h]", "absorbed power [W]", [*series, limit])]


@_synthetic("Obstacles")
def _obstacles(study: Searches) -> Content:
    yield """Wheels roll over a half-round as rigid discs, which meet its edge harder than a tire does, and the cars but
    for the full cars have no stops: speeds over the higher half-rounds compare controllers rather than tell what a
    vehicle stands. Only the public car has tires that envelop."""
    driven = {system: _heights(study, system) for car in study.cars for system in study.systems(car)}
    rows = [
        [CAR_NAMES[s[0]], name(s), *(found[h].words if h in found else "-" for h in HEIGHTS)]
        for s, found in driven.items()
        if found
    ]
    yield Table(
        "obstacles",
        f"Speeds of {LIMIT_G:g} g over half-rounds",
        ["car", "system", *(f"{1e3 * h:.0f} mm [km/h]" for h in HEIGHTS)],
        rows,
        "The largest vertical acceleration of the seat either way, of samples 1 ms apart without a filter.",
    )


@_synthetic("Two absorbed powers")
def _definitions(study: Searches) -> Content:
    yield """The filter of third order is that of the ride-quality literature and of mobility models, the one of second
    order that of paper 001. The same ride has more watts by the former, so its 6 W are reached earlier."""
    rows: list[list[Any]] = []
    for made in (d for d in study.known(sides="alike") if d.search.metrics == POWERS):
        third, second = (made.speeds(m).median for m in POWERS)
        if third is not None and second is not None:
            found = round(third, 1), round(second, 1), round(third / second, 3)
            rows.append([CAR_NAMES[made.case.car], name(made.case.system), made.case.course, *found])
    columns = ["car", "system", "course", "third order [km/h]", "second order [km/h]", "third over second [-]"]
    yield Table("definitions", "Speeds of 6 W by both definitions", columns, rows)


@_synthetic("Left and right")
def _sides(study: Searches) -> Content:
    yield """The measured courses are the same on both sides. Where the sides differ, each with the same rms and
    spectrum and a correlation that falls with wave number (assumed as on the other random roads of the project), a car
    heaves less and rolls."""
    rows: list[list[Any]] = []
    alike = {d.case.system: d for d in study.known(course=SIDES_COURSE, sides="alike")}
    for apart in study.known(course=SIDES_COURSE, sides="apart"):
        if (system := apart.case.system) in alike:
            first, own = (d.found["speeds"][NRMM][0] for d in (alike[system], apart))
            change = None if first is None or own is None else round(100 * (own / first - 1), 1)
            rows.append([CAR_NAMES[system[0]], name(system), first, own, change])
    columns = ["car", "system", "alike [km/h]", "correlated [km/h]", "change [%]"]
    title = f"Speed of 6 W on the {SIDES_COURSE} course, left and right alike and not"
    yield Table("sides", title, columns, rows, "The first seed; third order.")
