"""Maps of mobility engineering: speed over roughness at 6 W, over obstacles at 2.5 g, absorbed power over speed."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import wraps
from typing import Any

from cosim.experiments.ride import EXPERIMENT, claims
from cosim.experiments.ride.claims import NRMM
from cosim.experiments.ride.published import HEIGHTS, POWERS, SIDES_COURSE, System
from cosim.experiments.ride.results import CAR_NAMES, Speeds, name, nearest, on, ran, runs, speeds, system_of
from cosim.experiments.ride.runs import CARS, LIMIT_G, METRICS, NUMBER, OBSTACLE
from cosim.experiments.ride.search import LIMITS, TOLERANCE, WITHIN, SpeedLimit
from cosim.report import Figure, Panel, Parameter, Series, Table, level
from cosim.report.model import Color, Dash
from cosim.study import Content, FmuSet, Results, StudyReport, parameters
from fmu_sources.models.comfort import ABSORBED_POWER_LIMIT
from fmu_sources.roads.rms_course import COURSES

_COLORS: dict[str, Color] = {
    "passive": "black",
    "zero": "gray",
    "skyhook": "sky",
    "skyhook-on-off": "vermilion",
    "groundhook": "green",
    "add": "gray",
    "sh-add": "purple",
    "lqr": "orange",
    "lqr-kilonewton": "vermilion",
    "mpc": "blue",
    "mpc-preview": "green",
    "comfort-active": "blue",
    "comfort-delay": "sky",
    "comfort-preview": "green",
    "road-holding-active": "orange",
    "road-holding-delay": "gray",
    "road-holding-preview": "vermilion",
    "implicit": "blue",
    "explicit": "orange",
    "preview": "green",
}
_CAR_COLORS: dict[str, Color] = dict(zip(CARS, ("blue", "orange", "green", "purple", "vermilion", "sky"), strict=True))
_ROUGHNESS = "detrended rms of the course [mm]", "speed of 6 W [km/h]"
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
    for car in {car.plant: car for car in CARS.values()}.values():
        for p in parameters(fmus.path(car.plant)):
            if p.name.startswith("seat."):
                rows.append(Parameter(f"{car.plant} {p.name}", p.value, p.unit, p.source))
        rows.append(
            Parameter(
                f"{car.plant} wheel radius",
                car.radius,
                "m",
                "rolling wheel of the course: tires, vehicle file, or assumed",
            )
        )
    return rows


def _claims(study: Results) -> Any:
    """Claims compare the cars on the synthetic courses, so all of them have to be there."""
    return claims.CLAIMS.judge(study) if not _file(study) and _cars(study) == list(CARS) else []


report = StudyReport(EXPERIMENT, "Absorbed power and obstacles: how fast each car can be driven", _claims, _parameters)


def _file(study: Results) -> str:
    """The course file that was driven; empty for the synthetic ones."""
    return next((s.case.course for s in ran(study) if s.case.course not in NUMBER), "")


def _of(study: Results, car: str, **fields: Any) -> list[SpeedLimit]:
    """Searches of a car that did not fail."""
    return [s for s in on(study, car=car, **fields) if s.label not in study.failures]


def _cars(study: Results) -> list[str]:
    return [c for c in CARS if any(s.case.car == c for s in ran(study))]


def _systems(study: Results, car: str) -> list[System]:
    return list(dict.fromkeys(system_of(s) for s in ran(study) if s.case.car == car))


Fast = tuple[float, System]  # speed of 6 W [km/h]


@report.lead
def _main_result(study: Results) -> Content:
    """How fast each car can be driven, without control and with the controller with which it is fastest."""
    file = _file(study)
    course = file or SIDES_COURSE
    compared = {car: found for car in _cars(study) if (found := _slow_and_fast(study, car, course))}
    texts = [
        f"{CAR_NAMES[car]} {' and '.join(f'{v:.1f} km/h ({name(s)})' for v, s in found)}"
        for car, found in compared.items()
    ]
    where = f"the course {course}" if file else f"the course of {course.removesuffix('in')} in rms"
    yield (
        f"On {where}, the driver absorbs {ABSORBED_POWER_LIMIT:g} W at these speeds: {'; '.join(texts)}."
        if texts
        else f"On {where}, no car was found to reach {ABSORBED_POWER_LIMIT:g} W of absorbed power."
    )
    if not file:
        yield from _over_roughness(study, compared)
    elif panels := [p for car in _cars(study) for p in _curves(study, car, file, CAR_NAMES[car])]:
        yield Figure("power", "Absorbed power over speed", "Third order; points are runs.", panels, columns=2)


def _slow_and_fast(study: Results, car: str, course: str) -> list[Fast]:
    """Of a car without control, and with the controller with which it is fastest."""
    medians = [(speeds(study, s, NRMM).median, system_of(s)) for s in _of(study, car, course=course, sides="alike")]
    known = [(v, system) for v, system in medians if v is not None]
    shown = [(v, system) for v, system in known if system[1] == "passive"][:1]
    return shown + [fastest for fastest in [max(known, default=None)] if fastest is not None and fastest not in shown]


def _over_roughness(study: Results, compared: Mapping[str, Sequence[Fast]]) -> Content:
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
def _about(study: Results) -> Content:
    synthetic = "synthetic courses with the rms and spectrum of a proving ground's, and over half-rounds"
    yield f"""Every car of the project with every controller that fits it drives over
    {f"the course {_file(study)}" if _file(study) else synthetic}. How fast it can be driven is where its driver absorbs
    {ABSORBED_POWER_LIMIT:g} W, and over an obstacle where the seat sees {LIMIT_G:g} g. Everything is of the driver's
    seat, without seat and cushion. Absorbed power is by both definitions in use, which must not be mixed."""


@report.section(lambda study: f"Course {_file(study)}")
def _on_file(study: Results) -> Content:
    """Course."""
    if not _file(study):
        return
    yield "Both tracks are those of the file, as wheels roll over them."
    rows = [
        {"car": CAR_NAMES[car], **_row(study, s), f"{LIMIT_G:g} g [km/h]": speeds(study, s, "seat_peak").words}
        for car in _cars(study)
        for s in _of(study, car)
    ]
    caption = "The other columns are of the run that is nearest to 6 W by the filter of third order."
    yield Table.of("course", "Speeds of 6 W and of 2.5 g", rows, caption)


def _row(study: Results, search: SpeedLimit) -> dict[str, Any]:
    """System, speeds of 6 W by both definitions, and what else there is at the first of them."""
    third, second = (speeds(study, search, m).words for m in POWERS)
    near = nearest(study, search, NRMM) or {}
    shown = {k: round(METRICS[k].factor * near[k], n) if k in near else None for k, n in _SHOWN.items()}
    return {
        "system": name(system_of(search)),
        "6 W, third order [km/h]": third,
        "6 W, second order [km/h]": second,
        **{METRICS[k].heading: value for k, value in shown.items()},
    }


# ------------------------------------------------------------------------------------------------- synthetic courses


def _synthetic(function: Any) -> Any:
    """A section about the synthetic courses, which is left out where the course of a file was driven."""

    @wraps(function)
    def made(study: Results) -> Content:
        if not _file(study):
            yield from function(study)

    return made


def _series(system: System, x: Sequence[float], y: Sequence[float], low: Any = None, high: Any = None) -> Series:
    dash: Dash = "dash" if system[2] == "hydraulic" and system[1] != "passive" else "solid"
    return Series(name(system), x, y, low, high, _COLORS[system[1]], dash, "line+markers")


@report.section("Maps")
@_synthetic
def _maps(study: Results) -> Content:
    """What mobility engineers draw of a vehicle: speed over roughness and over obstacles."""
    for car in _cars(study):
        panels = [*_over_courses(study, car), *_over_obstacles(study, car)]
        if panels:
            caption = "6 W by the filter of third order, bands from the lowest to the highest of the profiles."
            yield Figure(f"map-{car}", f"How fast: {CAR_NAMES[car]}", caption, panels, columns=2)


def _over_courses(study: Results, car: str) -> list[Panel]:
    series = []
    for system in _systems(study, car):
        known = {
            s.case.course: speeds(study, s, NRMM)
            for s in _of(study, car, sides="alike")
            if s.case.course in COURSES and system_of(s) == system
        }
        own = {c: (v.median, min(v.found), max(v.found)) for c, v in known.items() if v.median is not None}
        if own:
            series.append(_series(system, [1e3 * COURSES[c].rms for c in own], *zip(*own.values(), strict=True)))
    return [Panel("over courses", *_ROUGHNESS, series)] if series else []


def _over_obstacles(study: Results, car: str) -> list[Panel]:
    series = []
    for system in _systems(study, car):
        own = {h: v.median for h, v in _heights(study, system).items() if v.median is not None}
        if own:
            series.append(_series(system, [1e3 * h for h in own], list(own.values())))
    labels = "height of the half-round [mm]", f"speed of {LIMIT_G:g} g [km/h]"
    return [Panel("over half-rounds", *labels, series)] if series else []


def _heights(study: Results, system: System) -> dict[float, Speeds]:
    """Speeds of 2.5 g by the height of the half-round [m]."""
    return {
        s.case.height: speeds(study, s, "seat_peak")
        for s in _of(study, system[0], course=OBSTACLE)
        if system_of(s) == system
    }


@report.section("Speeds of 6 W")
@_synthetic
def _speeds(study: Results) -> Content:
    yield f"""Each speed is found by driving the whole course, to {100 * TOLERANCE:g} %. The courses are the same left
    and right, as the measured ones are, so that a car heaves and pitches on them and does not roll.

    Controllers are those of the papers, with their published weights and for their published roads. A controller that
    is tuned for another purpose (pitch of the 6x6 over a trench, road holding of the sedan) may well be worse here than
    no controller."""
    for car in _cars(study):
        searches = [s for course in COURSES for s in _of(study, car, course=course, sides="alike")]
        rows = [{"course": s.case.course, **_row(study, s)} for s in searches]
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


@report.section("Absorbed power over speed")
@_synthetic
def _power(study: Results) -> Content:
    for car in _cars(study):
        panels = [p for course in COURSES for p in _curves(study, car, course, f"{course} rms")]
        if panels:
            title = f"Absorbed power over speed, {CAR_NAMES[car]}"
            yield Figure(f"power-{car}", title, "Third order, first profile; points are runs.", panels, columns=3)


def _curves(study: Results, car: str, course: str, title: str) -> list[Panel]:
    found = {system_of(s): runs(study, s) for s in _of(study, car, course=course, sides="alike")}
    series = [_series(s, [r["speed_kmh"] for r in rows], [r[NRMM] for r in rows]) for s, rows in found.items() if rows]
    if not series:
        return []
    every = [x for s in series for x in s.x_values]
    limit = level("6 W", every, ABSORBED_POWER_LIMIT, color="purple", dash="dot")
    return [Panel(title, "speed [km/h]", "absorbed power [W]", [*series, limit])]


@report.section("Obstacles")
@_synthetic
def _obstacles(study: Results) -> Content:
    yield """Wheels roll over a half-round as rigid discs, which meet its edge harder than a tire does, and the cars but
    for the full cars have no stops: speeds over the higher half-rounds compare controllers rather than tell what a
    vehicle stands. Only the public car has tires that envelop."""
    known = {system: _heights(study, system) for car in _cars(study) for system in _systems(study, car)}
    rows = [
        [CAR_NAMES[s[0]], name(s), *(found[h].words if h in found else "-" for h in HEIGHTS)]
        for s, found in known.items()
        if found
    ]
    yield Table(
        "obstacles",
        f"Speeds of {LIMIT_G:g} g over half-rounds",
        ["car", "system", *(f"{1e3 * h:.0f} mm [km/h]" for h in HEIGHTS)],
        rows,
        "The largest vertical acceleration of the seat either way, of samples 1 ms apart without a filter.",
    )


@report.section("Two absorbed powers")
@_synthetic
def _definitions(study: Results) -> Content:
    yield """The filter of third order is that of the ride-quality literature and of mobility models, the one of second
    order that of paper 001. The same ride has more watts by the former, so its 6 W are reached earlier."""
    rows: list[list[Any]] = []
    for search in (s for s in on(study, sides="alike") if s.metrics == POWERS and s.label not in study.failures):
        car, *_ = system = system_of(search)
        third, second = (speeds(study, search, m).median for m in POWERS)
        if third is not None and second is not None:
            found = round(third, 1), round(second, 1), round(third / second, 3)
            rows.append([CAR_NAMES[car], name(system), search.case.course, *found])
    columns = ["car", "system", "course", "third order [km/h]", "second order [km/h]", "third over second [-]"]
    yield Table("definitions", "Speeds of 6 W by both definitions", columns, rows)


@report.section("Left and right")
@_synthetic
def _sides(study: Results) -> Content:
    yield """The measured courses are the same on both sides. Where the sides differ, each with the same rms and
    spectrum and a correlation that falls with wave number (assumed as on the other random roads of the project), a car
    heaves less and rolls."""
    rows: list[list[Any]] = []
    alike = {system_of(s): s for s in on(study, course=SIDES_COURSE, sides="alike")}
    for search in on(study, course=SIDES_COURSE, sides="apart"):
        car, *_ = system = system_of(search)
        pair = [alike[system], search] if system in alike else []
        if pair and not any(s.label in study.failures for s in pair):
            first, own = (study.found(s)["speeds"][NRMM][0] for s in pair)
            change = None if first is None or own is None else round(100 * (own / first - 1), 1)
            rows.append([CAR_NAMES[car], name(system), first, own, change])
    yield Table(
        "sides",
        f"Speed of 6 W on the {SIDES_COURSE} course, left and right alike and not",
        ["car", "system", "alike [km/h]", "correlated [km/h]", "change [%]"],
        rows,
        "The first seed; third order.",
    )
