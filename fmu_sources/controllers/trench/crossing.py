"""Trench crossing: from what the nose lidar sees to cases, pitch reference and effective road (paper 003, section 4.6).

The lidar gives the distances to both edges of the trench. Its own movement with the body is taken out (4.17)-(4.28),
the corrected slopes are compared with those of the lines from lidar to wheels (figures 3.20 and 4.11), and the result
is the number of the axle that is over the trench, or 0. A predictive controller switches its limits and weights with
it, follows the pitch reference, and takes the effective road as its preview.

Signs: the thesis counts pitch positive nose up; here it is positive nose down (ISO 8855), so gamma of (4.18)-(4.27) is
-body.pitch. Distances: dx = x(trench) - x(lidar), dz = z(lidar) - z(trench), in road axes.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import casadi as ca

from build_fmus.component import Component, Model
from build_fmus.reference import Evaluator
from fmu_sources.models.corners import SIX_CORNERS, THREE_AXLES, Corners
from fmu_sources.registration import component

AXLES = tuple(dict.fromkeys(THREE_AXLES.values()))
COUNT, STEP = 50, 5e-3  # samples of preview and reference, and their distance [s]
UNSEEN = 1e3  # m, where a trench is that nobody has seen


@dataclass(frozen=True)
class CrossingGeometry:
    """What the algorithm knows of the vehicle, all at rest on level road and relative to the CG. Meters."""

    axles: tuple[float, float, float]  # ahead of the CG
    drop: tuple[float, float, float]  # wheel centers below the CG
    deflection: tuple[float, float, float]  # static deflection of the tires
    radius: float  # of the wheels
    lidar_ahead: float  # of the CG
    lidar_above: float  # above the CG
    cg_height: float  # above the road

    @classmethod
    def of(cls, plant: Model) -> CrossingGeometry:
        """From the rest position of a declared plant (`ThreeAxleTrench`)."""
        rest = dict(zip((e.name for e in plant.output_elements()), Evaluator(plant).outputs(), strict=True))
        parameters = {e.name: e.start for e in plant.elements("parameter")}
        radius = float(parameters["disc.radius"] or 0.0)
        height = rest["lidar.start.dz"]
        hubs = {a: (rest[f"hub.{a}l.x"] - rest["x"], rest[f"hub.{a}l.z"]) for a in AXLES}
        above = float(parameters["lidar.height"] or 0.0)
        cg = float(height - above)

        def each(value: Callable[[str], float]) -> tuple[float, float, float]:
            one, two, three = (float(value(a)) for a in AXLES)
            return one, two, three

        return cls(
            axles=each(lambda a: hubs[a][0]),
            drop=each(lambda a: cg - hubs[a][1]),
            deflection=each(lambda a: radius - hubs[a][1]),
            radius=radius,
            lidar_ahead=float(rest["lidar.x"] - rest["x"]),
            lidar_above=above,
            cg_height=cg,
        )


@component(
    "TrenchCrossing{s}", "cases, pitch reference and effective road for trenches (paper 003)", of="three_axle_trench"
)
def trench_crossing_of(car: Component, name: str = "TrenchCrossing") -> Component:
    """The algorithm for a car."""
    return trench_crossing(CrossingGeometry.of(car.model()), name)


def trench_crossing(
    geometry: CrossingGeometry, name: str = "TrenchCrossing", *, count: int = COUNT, step: float = STEP
) -> Component:
    """The algorithm as a discrete component; `count` samples of reference and road, `step` [s] apart."""
    c = Component(
        name,
        kind="discrete",
        sample_time=step,
        description="Trench crossing: cases, pitch reference and effective road from lidar distances",
        source="003 section 4.6, equations (4.17) to (4.28), Figure 4.11",
        stop_time=10.0,
        notes=_NOTES,
    )
    g = _geometry_parameters(c, geometry)
    q = _tuning_parameters(c)

    seen = {}
    for end in ("start", "finish"):
        dx = c.input(f"lidar.{end}.dx", "m", f"{end} of the trench ahead of the nose lidar, road axes", start=5.0)
        dz = c.input(
            f"lidar.{end}.dz",
            "m",
            f"nose lidar above the {end} of the trench, road axes",
            start=geometry.cg_height + geometry.lidar_above,
        )
        valid = c.input(f"lidar.{end}.valid", None, f"the lidar sees the {end} of the trench", start=True, type=bool)
        seen[end] = (dx, dz, valid)
    body_z = c.input("body.z", "m", "CG height above its static position")
    pitch = c.input("body.pitch", "rad", "pitch angle, positive nose down", display_unit="deg")
    corners = Corners(THREE_AXLES)
    corners.each(z=lambda k: c.input(f"wheel.{k}.z", "m", f"wheel center {k} above its static height"))
    speed = ca.fmax(0, c.input("speed", "m/s", "forward speed", display_unit="km/h"))

    # ---------------------------------------------------------------- (4.17)-(4.28): the lidar as on a body at rest
    gamma = -pitch
    shift_x = ca.cos(gamma) * g.ahead - ca.sin(gamma) * g.above - g.ahead  # (4.18), (4.24)
    shift_z = ca.sin(gamma) * g.ahead + ca.cos(gamma) * g.above - g.above  # (4.19), (4.25)
    never_seen = c.constant("unseen", UNSEEN, "m", "distance of an edge that was never seen", source="own")
    lowest = c.constant("lowest", 0.01, "m", "lidar above an edge, at least", source="own")
    ahead: dict[str, Any] = {}  # of the lidar of a body at rest; remembered while the lidar sees nothing
    known: dict[str, Any] = {}
    level: dict[str, Any] = {}
    for end, (dx, dz, valid) in seen.items():
        last = c.state(f"memory.{end}", "m", f"{end} of the trench ahead of the lidar, where it was last", start=UNSEEN)
        last_level = c.state(
            f"memory.{end}.level", "m", "lidar above it", start=geometry.cg_height + geometry.lidar_above
        )
        ever = c.state(f"memory.{end}.known", "1", f"1 once the {end} was seen")
        ahead[end] = ca.if_else(valid, dx + shift_x, last)
        level[end] = ca.fmax(lowest, ca.if_else(valid, dz - shift_z - body_z, last_level))
        known[end] = ca.fmax(ever, valid)
        c.update(last, ca.if_else(known[end] > 0.5, ahead[end] - speed * c.period, never_seen))  # dead reckoning
        c.update(last_level, level[end])
        c.update(ever, known[end])
        c.output(
            f"slope.{end}",
            ca.if_else(valid, ca.atan2(dz, dx), 0),
            "rad",
            f"slope of the line from the lidar to the {end}, 0 while the lidar does not see it (4.17), (4.23)",
            display_unit="deg",
        )
    ahead["finish"] = ca.if_else(known["finish"] > 0.5, ahead["finish"], ahead["start"] + q.unknown_length)
    level["finish"] = ca.if_else(known["finish"] > 0.5, level["finish"], level["start"])
    there = ca.logic_and(known["start"] > 0.5, ahead["finish"] > ahead["start"])
    slope = {end: ca.atan2(level[end], ahead[end]) for end in seen}
    for end in seen:
        c.output(
            f"slope.{end}.corrected",
            ca.if_else(there, slope[end], 0),
            "rad",
            f"slope.{end} as from a body at rest (4.22), (4.28)",
            display_unit="deg",
        )

    # --------------------------------------------------- figure 4.11: which axle is between its two lines to the trench

    # A wheel is past a point when the slope exceeds that of the line from the lidar to a point under the wheel.
    cases = []
    for axle in g.axles:
        to_wheel = axle - g.ahead  # from the lidar, negative
        entered = slope["start"] > ca.atan2(level["start"], to_wheel + q.case_distance + q.lead_time * speed)
        left = slope["finish"] > ca.atan2(level["finish"], to_wheel - q.lag)
        cases.append(ca.logic_and(there, ca.logic_and(entered, ca.logic_not(left))))
    case = ca.if_else(cases[0], 1, ca.if_else(cases[1], 2, ca.if_else(cases[2], 3, 0)))

    # ---------------------------------------------------------------------------------------------- pitch reference
    # Distances traveled until axle 1 or 3 stands at the start, and since it left; the speed is taken to stay.
    early = q.lead_distance + q.lead_pitch * speed
    to_start = [ahead["start"] + g.ahead - axle for axle in g.axles]
    to_finish = [ahead["finish"] + g.ahead - axle for axle in g.axles]
    past = c.state("memory.reference", "rad", "reference of the sample before")
    reference, value = [], past
    for i in range(count):
        moved = speed * c.period * i
        entry = ca.logic_and(to_start[0] - moved < early, to_finish[0] - moved > -q.lag)
        exit_ = ca.logic_and(to_start[2] - moved < early, to_finish[2] - moved > -q.lag)
        target = ca.if_else(there, ca.if_else(entry, -q.entry, ca.if_else(exit_, q.exit, 0)), 0)
        value = value + ca.fmax(-q.rate * c.period, ca.fmin(q.rate * c.period, target - value))
        reference.append(value)
    c.update(past, reference[0])

    # ------------------------------------------------------------------------------------------------ effective road
    for k in corners:
        i = AXLES.index(k.axle)
        # Struts act along the body, so wheels move forth and back with pitch.
        below = (g.drop[i] - k.z + body_z - g.axles[i] * ca.sin(pitch)) / ca.fmax(ca.cos(pitch), 0.1)
        leans = g.axles[i] * (ca.cos(pitch) - 1) - below * ca.sin(pitch)
        hanging = k.z - g.deflection[i]  # road under which a linear tire carries nothing
        heights = []
        for j in range(count):
            at = speed * c.period * j + leans
            edge = ca.fmax(_edge(at - to_start[i], g.radius), _edge(to_finish[i] - at, g.radius))
            heights.append(ca.fmax(ca.if_else(there, edge, 0), hanging))
        k.road = ca.vertcat(*heights)

    c.output("case", case, None, "axle over the trench, 0 without one", type=int, min=0, max=3)
    c.output(
        "reference.pitch",
        ca.vertcat(*reference),
        "rad",
        f"pitch reference now, {1e3 * step:g} ms later, ...",
        display_unit="deg",
    )
    for k in corners:
        c.output(f"preview.{k}", k.road, "m", f"effective road under wheel {k} now, {1e3 * step:g} ms later, ...")
    for k in corners:
        c.output(f"road.{k}.height", k.road[0], "m", f"effective road under wheel {k} now")
    c.output("preview.step", ca.SX(step), "s", "time between samples of preview and reference")
    c.output("trench.known", there, None, "a trench has been seen", type=bool)
    c.output(
        "trench.distance",
        ca.if_else(there, to_start[0], never_seen),
        "m",
        "start of the trench ahead of axle 1, 1000 if unknown",
    )
    c.output(
        "trench.length",
        ca.if_else(there, ahead["finish"] - ahead["start"], 0),
        "m",
        "length of the trench, 0 if unknown",
    )
    c.reference_input(_reference_inputs(geometry))
    return c


def _edge(beyond: Any, radius: Any) -> Any:
    """Height [m] of a wheel over a falling edge, its center `beyond` [m] past it.

    0 before the edge, -radius where the wheel no longer touches it.
    """
    depth = radius - ca.sqrt(ca.fmax(0, radius**2 - ca.fmax(0, beyond) ** 2))
    return -depth


# ---------------------------------------------------------------------------------------------------------- parameters


@dataclass(frozen=True)
class _Geometry:
    axles: list[Any]
    drop: list[Any]
    deflection: list[Any]
    radius: Any
    ahead: Any
    above: Any


def _geometry_parameters(c: Component, geometry: CrossingGeometry) -> _Geometry:
    def length(name: str, value: float, text: str) -> Any:
        return c.parameter(name, value, "m", text, min=-10.0, max=10.0, source="vehicle file")

    def each(name: str, values: tuple[float, ...], text: str) -> list[Any]:
        return [length(f"wheel.{a}.{name}", v, f"{text} of axle {a[1]}") for a, v in zip(AXLES, values, strict=True)]

    return _Geometry(
        axles=each("x", geometry.axles, "distance ahead of the CG"),
        drop=each("below", geometry.drop, "distance of the wheel centers at rest below the CG"),
        deflection=each("squeeze", geometry.deflection, "static deflection of the tires"),
        radius=c.parameter(
            "wheel.radius", geometry.radius, "m", "radius of the wheels", min=0.05, max=5.0, source="vehicle file"
        ),
        ahead=length("lidar.x", geometry.lidar_ahead, "nose lidar ahead of the CG (CG2NLX)"),
        above=length("lidar.z", geometry.lidar_above, "nose lidar above the CG (CG2NLZ)"),
    )


@dataclass(frozen=True)
class _Tuning:
    entry: Any
    exit: Any
    rate: Any
    lead_distance: Any
    lead_pitch: Any
    case_distance: Any
    lead_time: Any
    lag: Any
    unknown_length: Any


def _tuning_parameters(c: Component) -> _Tuning:
    """Figure 4.11 gives the logic, no numbers: these are assumed."""

    def parameter(name: str, value: float, unit: str, text: str, high: float, low: float = 0.0) -> Any:
        display = {"rad": "deg", "rad/s": "deg/s"}.get(unit)
        return c.parameter(
            name, value, unit, text, min=low, max=high, tunable=True, source="assumed", display_unit=display
        )

    return _Tuning(
        entry=parameter("pitch.entry", math.radians(4.0), "rad", "nose up while axle 1 crosses", 0.5, -0.5),
        exit=parameter("pitch.exit", math.radians(4.0), "rad", "nose down while axle 3 crosses", 0.5, -0.5),
        rate=parameter("pitch.rate", math.radians(10.0), "rad/s", "rate of the pitch reference", 5.0),
        lead_distance=parameter(
            "pitch.lead_distance", 0.6, "m", "reference starts this far before the trench, and", 10.0
        ),
        lead_pitch=parameter("pitch.lead_time", 0.8, "s", "this much earlier", 10.0),
        case_distance=parameter(
            "case.lead_distance", -0.1, "m", "a case begins this far before the trench, and", 2.0, -2.0
        ),
        lead_time=parameter("case.lead_time", 0.2, "s", "this much earlier", 5.0),
        lag=parameter("case.lag", 0.0, "m", "a case ends this far behind the trench", 2.0, -2.0),
        unknown_length=parameter(
            "trench.unknown_length", 2.0, "m", "length of a trench whose end was never seen", 100.0, 0.01
        ),
    )


def _reference_inputs(geometry: CrossingGeometry) -> Mapping[str, Callable[[float], float]]:
    """A body that pitches and heaves over a trench of 1.6 m at 9 km/h; the lidar loses the trench for a while."""
    v, first, wide = 2.5, 1.0037, 1.6023  # nothing switches right at a sample, where rounding would decide

    def angle(t: float) -> float:
        return 0.06 * math.sin(6.0 * t)

    def heave(t: float) -> float:
        return 0.05 * math.sin(4.0 * t)

    def dx(at: float) -> Callable[[float], float]:
        return lambda t: (
            at - v * t - (geometry.lidar_ahead * math.cos(angle(t)) + geometry.lidar_above * math.sin(angle(t)))
        )

    def dz(t: float) -> float:
        up = -geometry.lidar_ahead * math.sin(angle(t)) + geometry.lidar_above * math.cos(angle(t))
        return geometry.cg_height + heave(t) + up

    begin = geometry.axles[0] + first
    signals: dict[str, Callable[[float], float]] = {
        "lidar.start.dx": dx(begin),
        "lidar.finish.dx": dx(begin + wide),
        "lidar.start.dz": dz,
        "lidar.finish.dz": dz,
        "lidar.start.valid": lambda t: float(not 0.3 < t < 0.6),
        "body.pitch": angle,
        "body.z": heave,
        "speed": lambda t: v,
    }
    for i, k in enumerate(SIX_CORNERS):
        signals[f"wheel.{k}.z"] = lambda t, i=i: 0.04 * math.sin(7.0 * t + i)  # type: ignore[misc]
    return signals


_NOTES = (
    (
        "Between plant and predictive controller: lidar.*, body.z, body.pitch, wheel.*.z and speed come from the plant,"
        " and case, reference.pitch and preview.* go to the controller, all under the same names. Both run every 5 ms;"
        " in that order there is no delay between them."
    ),
    (
        "Cases: axle i is over the trench from case.lead_distance and case.lead_time before it stands at the start (a"
        " negative distance: behind it) until case.lag behind the finish, decided by the corrected slopes. When two"
        " axles are over a long trench, the front one of them counts. A wheel carries on the edge almost as on the"
        " road, so a case may begin a little late and end early: in trenches nearly as long as the axle spacing one"
        " axle then carries before the next one is lifted."
    ),
    (
        "Pitch reference: nose up while the first axle crosses, nose down while the last one does, both begun"
        " pitch.lead_distance and pitch.lead_time early, with a limited rate. reference.pitch[1] is now; the later ones"
        " assume that the speed stays constant."
    ),
    (
        "Effective road: a linear tire model pulls a wheel down to whatever road it is given, so the floor of the"
        " trench is never fed. A wheel that is over an edge sees the circle on which the edge carries its center, and"
        " one that carries nothing sees the height under which a linear tire has no force."
    ),
    (
        "A lidar that does not see an edge sets .valid false: the edge is then where it was, less the distance that the"
        " speed gives. While the start was never seen there is no trench: case 0, level road. When only the finish was"
        " never seen, trench.unknown_length counts. A finish that is not behind the start counts as no trench."
    ),
    (
        "Left out: trenches that are not square to the road (both sides see the same edges) and more than one trench."
        " The numbers behind the flow chart are not in the thesis; they are assumed and tunable."
    ),
)
