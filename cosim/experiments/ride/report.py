"""Maps of mobility engineering: speed over roughness at 6 W, over obstacles at 2.5 g, absorbed power over speed."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from cosim.experiments.ride import EXPERIMENT
from cosim.experiments.ride.claims import CLAIMS, NRMM
from cosim.experiments.ride.published import HEIGHTS, POWERS, SIDES_COURSE, System
from cosim.experiments.ride.results import CAR_NAMES, Speeds, name, nearest, on, ran, runs, speeds, system_of
from cosim.experiments.ride.runs import CARS, LIMIT_G, METRICS, NUMBER, OBSTACLE
from cosim.experiments.ride.search import LIMITS, TOLERANCE, WITHIN, SpeedLimit
from cosim.report import Figure, Panel, Parameter, Report, Section, Series, Table
from cosim.report.model import Color, Dash, Scalar
from cosim.study import FmuSet, Results, make_lead, parameters, provenance, sections
from fmu_sources.models.comfort import ABSORBED_POWER_LIMIT
from fmu_sources.roads.rms_course import COURSES

_COLORS = {
    "passive": "black",
    "zero": "gray",
    "skyhook": "sky",
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
_SHOWN = ("iso2631_rms", "travel_rms", "travel_peak", "force_rms", "power_given", "power_supply")  # beside a 6 W speed
_NUMBER: Mapping[str, int] = {
    "iso2631_rms": 2,
    "travel_rms": 1,
    "travel_peak": 0,
    "force_rms": 2,
    "power_given": 2,
    "power_supply": 1,
}


def report(study: Results, fmus: FmuSet) -> Report:
    """The whole report of a study."""
    file = _file(study)
    makers = (_on_file,) if file else (_maps, _speeds, _power, _obstacles, _definitions, _sides)
    course = (
        f"the course {file}"
        if file
        else "synthetic courses with the rms and spectrum of a proving ground's, and over half-rounds"
    )
    lead, figure = make_lead(study, _main_result)
    about = Section(
        "Runs of the study",
        [
            f"Every car of the project with every controller that fits it drives over {course}. How fast it can be"
            f" driven is where its driver absorbs {ABSORBED_POWER_LIMIT:g} W, and over an obstacle where"
            f" the seat sees {LIMIT_G:g} g. Everything is of the driver's seat, without seat and cushion."
            " Absorbed power is by both"
            " definitions in use, which must not be mixed."
        ],
    )
    return Report(
        experiment=EXPERIMENT.name,
        title="Absorbed power and obstacles: how fast each car can be driven",
        lead=lead,
        figure=figure,
        claims=CLAIMS.judge(study) if not file and _cars(study) == list(CARS) else [],  # they compare cars
        sections=[about, *sections(study, makers)],
        parameters=_parameters(fmus),
        provenance=provenance(EXPERIMENT, fmus),
    )


def _file(study: Results) -> str:
    """The course file that was driven; empty for the synthetic ones."""
    return next((s.case.course for s in ran(study) if s.case.course not in NUMBER), "")


def _main_result(study: Results) -> tuple[str, Figure | None]:
    """How fast each car can be driven, without control and with the controller with which it is fastest."""
    course = _file(study) or SIDES_COURSE
    compared = {car: found for car in _cars(study) if (found := _slow_and_fast(study, car, course))}
    texts = [
        f"{CAR_NAMES[car]} {' and '.join(f'{v:.1f} km/h ({name(s)})' for v, s in found)}"
        for car, found in compared.items()
    ]
    where = f"the course {course}" if _file(study) else f"the course of {course.removesuffix('in')} in rms"
    lead = (
        f"On {where}, the driver absorbs {ABSORBED_POWER_LIMIT:g} W at these speeds: {'; '.join(texts)}."
        if texts
        else f"On {where}, no car was found to reach {ABSORBED_POWER_LIMIT:g} W of absorbed power."
    )
    return lead, _over_power(study) if _file(study) else _over_roughness(study, compared)


Fast = tuple[float, System]  # speed of 6 W [km/h]


def _slow_and_fast(study: Results, car: str, course: str) -> list[Fast]:
    """Of a car without control, and with the controller with which it is fastest."""
    medians = [(speeds(study, s, NRMM).median, system_of(s)) for s in _of(study, car, course=course, sides="alike")]
    known = [(v, system) for v, system in medians if v is not None]
    shown = [(v, system) for v, system in known if system[1] == "passive"][:1]
    return shown + [fastest for fastest in [max(known, default=None)] if fastest is not None and fastest not in shown]


def study_failed(study: Results, search: SpeedLimit) -> bool:
    """Whether a search failed, so that nothing is known of it."""
    return search.label in study.failures


def _of(study: Results, car: str, **fields: Any) -> list[SpeedLimit]:
    return [s for s in on(study, car=car, **fields) if not study_failed(study, s)]


def _cars(study: Results) -> list[str]:
    return [c for c in CARS if any(s.case.car == c for s in ran(study))]


# ------------------------------------------------------------------------------------------------------------- tables


def _speeds(study: Results) -> Section:
    tables = []
    for car in _cars(study):
        searches = [s for course in COURSES for s in _of(study, car, course=course, sides="alike")]
        rows = [[s.case.course, *_row(study, s)] for s in searches]
        columns = ("course", *_HEADINGS)
        used = [i for i in range(len(columns)) if any(row[i] is not None for row in rows)]
        if rows:
            shown = [[row[i] for i in used] for row in rows]
            tables.append(
                Table(
                    f"six-watts-{car}",
                    f"Speeds of 6 W, {CAR_NAMES[car]}",
                    [columns[i] for i in used],
                    shown,
                    _ABOUT_SPEEDS,
                )
            )
    return Section(
        "Speeds of 6 W",
        [
            (
                f"Each speed is found by driving the whole course, to {100 * TOLERANCE:g} %. The courses are the same"
                " left and right, as the measured ones are, so that a car heaves and pitches on them and does not"
                " roll."
            ),
            (
                "Controllers are those of the papers, with their published weights and for their published roads. A"
                " controller that is tuned for another purpose (pitch of the 6x6 over a trench, road"
                " holding of the sedan) may well be worse here than no controller."
            ),
        ],
        [],
        tables,
    )


_ABOUT_SPEEDS = (
    "Speeds are medians over the profiles of a course, with the lowest and the highest where several were driven. The"
    " other columns are of the run on the first profile that is nearest to 6 W by the filter of third order. Power"
    " given: the positive power of all actuators together; regenerated power is lost. A speed is 'never' where"
    f" {WITHIN[1]:g} km/h stays below 6 W, 'at any speed' where {WITHIN[0]:g} km/h is above."
)
_HEADINGS = ("system", "6 W, third order [km/h]", "6 W, second order [km/h]", *(METRICS[k].heading for k in _SHOWN))


def _row(study: Results, search: SpeedLimit) -> list[Scalar]:
    """System, speeds of 6 W by both definitions, and what else there is at the first of them."""
    words = [speeds(study, search, m).words for m in POWERS]
    near = nearest(study, search, NRMM) or {}
    more = [round(METRICS[k].factor * near[k], _NUMBER[k]) if k in near else None for k in _SHOWN]
    return [name(system_of(search)), *words, *more]


def _definitions(study: Results) -> Section:
    rows: list[list[Scalar]] = []
    for search in (
        s for s in ran(study) if s.metrics == POWERS and not study_failed(study, s) and s.case.sides == "alike"
    ):
        third, second = (speeds(study, search, m).median for m in POWERS)
        if third is not None and second is not None:
            system = system_of(search)
            rows.append(
                [
                    CAR_NAMES[system[0]],
                    name(system),
                    search.case.course,
                    round(third, 1),
                    round(second, 1),
                    round(third / second, 3),
                ]
            )
    table = Table(
        "definitions",
        "Speeds of 6 W by both definitions",
        ["car", "system", "course", "third order [km/h]", "second order [km/h]", "third over second [-]"],
        rows,
    )
    return Section(
        "Two absorbed powers",
        [
            "The filter of third order is that of the ride-quality literature and of mobility models, the one of second"
            " order that of paper 001. The same ride has more watts by the former, so its 6 W are reached earlier."
        ],
        [],
        [table],
    )


def _sides(study: Results) -> Section:
    rows: list[list[Scalar]] = []
    for search in on(study, course=SIDES_COURSE, sides="apart"):
        alike = next(
            (s for s in on(study, course=SIDES_COURSE, sides="alike") if system_of(s) == system_of(search)), None
        )
        if alike is None or study_failed(study, search) or study_failed(study, alike):
            continue
        system = system_of(search)
        first = study.found(alike)["speeds"][NRMM][0]
        own = study.found(search)["speeds"][NRMM][0]
        change = None if first is None or own is None else round(100 * (own / first - 1), 1)
        rows.append([CAR_NAMES[system[0]], name(system), first, own, change])
    table = Table(
        "sides",
        f"Speed of 6 W on the {SIDES_COURSE} course, left and right alike and not",
        ["car", "system", "alike [km/h]", "correlated [km/h]", "change [%]"],
        rows,
        "The first seed; third order.",
    )
    return Section(
        "Left and right",
        [
            "The measured courses are the same on both sides. Where the sides differ, each with the same rms and"
            " spectrum and a correlation that falls with wave number (assumed as on the other random roads of the"
            " project), a car heaves less and rolls."
        ],
        [],
        [table],
    )


# ------------------------------------------------------------------------------------------------------------ figures


def _series(system: System, x: Sequence[float], y: Sequence[float], **band: Any) -> Series:
    dash = "dash" if system[2] == "hydraulic" and system[1] != "passive" else "solid"
    return Series(name(system), x, y, color=_COLORS[system[1]], dash=dash, mode="line+markers", **band)  # type: ignore[arg-type]


def _systems(study: Results, car: str) -> list[System]:
    return list(dict.fromkeys(system_of(s) for s in ran(study) if s.case.car == car))


def _maps(study: Results) -> Section:
    """What mobility engineers draw of a vehicle: speed over roughness and over obstacles."""
    figures = []
    for car in _cars(study):
        panels = [p for p in (_over_courses(study, car), _over_obstacles(study, car)) if p is not None]
        if panels:
            caption = "6 W by the filter of third order, bands from the lowest to the highest of the profiles."
            figures.append(Figure(f"map-{car}", f"How fast: {CAR_NAMES[car]}", caption, panels, columns=2))
    return Section("Maps", [], figures)


def _over_courses(study: Results, car: str) -> Panel | None:
    series = []
    for system in _systems(study, car):
        known = {
            s.case.course: speeds(study, s, NRMM)
            for s in _of(study, car, sides="alike")
            if s.case.course in COURSES and system_of(s) == system
        }
        own = {c: v for c, v in known.items() if v.median is not None}
        if own:
            band = {"low": [min(v.found) for v in own.values()], "high": [max(v.found) for v in own.values()]}
            medians = [v.median for v in own.values() if v.median is not None]
            series.append(_series(system, [1e3 * COURSES[c].rms for c in own], medians, **band))
    return Panel("over courses", *_ROUGHNESS, series) if series else None


_ROUGHNESS = "detrended rms of the course [mm]", "speed of 6 W [km/h]"
_CAR_COLORS: dict[str, Color] = dict(zip(CARS, ("blue", "orange", "green", "purple", "vermilion"), strict=True))


def _over_roughness(study: Results, compared: Mapping[str, Sequence[Fast]]) -> Figure | None:
    """Speed over roughness of the systems that are compared, those without control dashed."""
    curves = []
    for car, found in compared.items():
        if (panel := _over_courses(study, car)) is None:
            continue
        for _, system in found:
            curve = next(s for s in panel.series if s.name == name(system))
            dash: Dash = "dash" if system[1] == "passive" else "solid"
            label = f"{CAR_NAMES[car]}, {curve.name}"
            curves.append(replace(curve, name=label, color=_CAR_COLORS[car], dash=dash))
    if not curves:
        return None
    caption = (
        "Without control (dashed), and with the controller with which the car is fastest on the course of"
        f" {SIDES_COURSE} rms. Absorbed power by the filter of third order; bands from the lowest to the highest of the"
        " profiles."
    )
    return Figure(
        "main-result",
        f"Speed at which the driver absorbs {ABSORBED_POWER_LIMIT:g} W, over roughness",
        caption,
        [Panel("", *_ROUGHNESS, curves)],
    )


def _over_obstacles(study: Results, car: str) -> Panel | None:
    series = []
    for system in _systems(study, car):
        own = {h: v.median for h, v in _heights(study, system).items() if v.median is not None}
        if own:
            series.append(_series(system, [1e3 * h for h in own], list(own.values())))
    return (
        Panel("over half-rounds", "height of the half-round [mm]", f"speed of {LIMIT_G:g} g [km/h]", series)
        if series
        else None
    )


def _heights(study: Results, system: System) -> dict[float, Speeds]:
    """Speeds of 2.5 g by the height of the half-round [m]."""
    return {
        s.case.height: speeds(study, s, "seat_peak")
        for s in _of(study, system[0], course=OBSTACLE)
        if system_of(s) == system
    }


def _power(study: Results) -> Section:
    figures = []
    for car in _cars(study):
        panels = [p for course in COURSES if (p := _curves(study, car, course, f"{course} rms")) is not None]
        if panels:
            figures.append(
                Figure(
                    f"power-{car}",
                    f"Absorbed power over speed, {CAR_NAMES[car]}",
                    "Third order, first profile; points are runs.",
                    panels,
                    columns=3,
                )
            )
    return Section("Absorbed power over speed", [], figures)


def _curves(study: Results, car: str, course: str, title: str) -> Panel | None:
    series = []
    for search in _of(study, car, course=course, sides="alike"):
        rows = runs(study, search)
        if rows:
            series.append(_series(system_of(search), [r["speed_kmh"] for r in rows], [r[NRMM] for r in rows]))
    if not series:
        return None
    ends = [min(float(np.min(s.x_values)) for s in series), max(float(np.max(s.x_values)) for s in series)]
    limit = Series("6 W", ends, [ABSORBED_POWER_LIMIT] * 2, color="purple", dash="dot")
    return Panel(title, "speed [km/h]", "absorbed power [W]", [*series, limit])


def _obstacles(study: Results) -> Section:
    rows = []
    for car in _cars(study):
        for system in _systems(study, car):
            known = _heights(study, system)
            if known:
                rows.append([CAR_NAMES[car], name(system), *(known[h].words if h in known else "-" for h in HEIGHTS)])
    table = Table(
        "obstacles",
        f"Speeds of {LIMIT_G:g} g over half-rounds",
        ["car", "system", *(f"{1e3 * h:.0f} mm [km/h]" for h in HEIGHTS)],
        rows,
        "The largest vertical acceleration of the seat either way, of samples 1 ms apart without a filter.",
    )
    return Section(
        "Obstacles",
        [
            "Wheels roll over a half-round as rigid discs, which meet its edge harder than a tire does, and the cars"
            " but for the full cars have no stops: speeds over the higher half-rounds compare controllers rather than"
            " tell what a vehicle stands. Only the public car has tires that envelop."
        ],
        [],
        [table],
    )


def _on_file(study: Results) -> Section:
    rows: list[list[Scalar]] = []
    for car in _cars(study):
        for search in _of(study, car):
            words = speeds(study, search, "seat_peak").words
            rows.append([CAR_NAMES[car], *_row(study, search), words])
    table = Table(
        "course",
        "Speeds of 6 W and of 2.5 g",
        ["car", *_HEADINGS, f"{LIMIT_G:g} g [km/h]"],
        rows,
        "The other columns are of the run that is nearest to 6 W by the filter of third order.",
    )
    text = "Both tracks are those of the file, as wheels roll over them."
    return Section(f"Course {_file(study)}", [text], tables=[table])


def _over_power(study: Results) -> Figure | None:
    """Absorbed power over speed on the course of a file."""
    file = _file(study)
    panels = [p for car in _cars(study) if (p := _curves(study, car, file, CAR_NAMES[car])) is not None]
    caption = "Third order; points are runs."
    return Figure("power", "Absorbed power over speed", caption, panels, columns=2) if panels else None


def _parameters(fmus: FmuSet) -> list[Parameter]:
    rows = [
        Parameter("limit of absorbed power", LIMITS[NRMM], "W", "ride-quality literature; 001 section 1.6"),
        Parameter("limit of the seat's acceleration", LIMIT_G, "g", "mobility models"),
        Parameter("closeness of speeds", TOLERANCE, "1", "own"),
    ]
    for car in CARS.values():
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
