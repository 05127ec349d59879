"""The scene of a system, from the names that its components' variables have.

Names are a contract: a plant has `body.z`, and `wheel.z` or `wheel.{c}.z` for its corners; what drives
`road.{c}.height` is the road; what reads `preview.{c}[i]` looks ahead. So whatever fills the contract is drawn, ours or
not, and nothing that a system does not have. Dimensions are parameters where a plant has them; the rest stands in
`LOOKS`.
"""

from __future__ import annotations

import math
from collections.abc import Iterator

from cosim.scenes import shapes
from cosim.scenes.scene import (
    VIEWS,
    Arrow,
    Body,
    Face,
    Limit,
    Points,
    Reading,
    Relief,
    Scene,
    Strut,
    Trace,
    Trench,
    Value,
    Wheel,
)
from cosim.scenes.shapes import Outline
from cosim.scenes.signals import GRAVITY, Found, value_of_source
from cosim.system.components import SystemComponent, indices
from cosim.system.wiring import Wiring

_KMH = 3.6


_RIG_RADIUS, _RIG_MASS = 0.55, 1500.0  # m, kg: the wheel of a rig; others of the same density
_RIG_SQUASH = 0.25  # of the radius at most, by the weight: soft tires are large
_PAPER = 3.0  # s of the past are drawn beside a rig

_SAYS = {  # outputs that are true, or above 0, while a component is at a limit; `{}` is the component
    "solver.status": "{}: no solution",
    "command.held": "{}: command held",
    "force.limited": "{}: force at its limit",
    "limit_reached": "{}: force at its limit",
    "horizon_truncated": "{}: preview cut short",
    "valve.saturated": "{}: valve fully open",
    "end_of_road": "end of the road",
}
_TRENCH, _OUTLINE = 1, 2  # obstacle.shape; 0 is level ground
_TOUCHES = {"bumper.front": "front bumper", "bumper.rear": "rear bumper", "belly": "belly"}


def infer_scene(system: Wiring, plant: str | None = None) -> Scene | None:
    """The scene of a system, or None where no component is a plant.

    `plant`: the name of the component to show, by default the first one that is a plant. Positions are those at rest
    where inputs do not say otherwise; parameters count as they are set now, except trenches, which follow their
    parameters. Raises WiringError for a component that there is not.
    """
    components = [system[plant]] if plant is not None else list(system.components.values())
    for component in components:
        found = Found(system, component)
        if found.is_quarter:
            return _quarter(found)
        if found.is_vehicle:
            return _vehicle(found)
    return None


# ------------------------------------------------------------------------------------------------------------- vehicles


def _vehicle(found: Found) -> Scene:
    looks, name = found.looks, found.component.name
    distance = found.distance or Value()
    yaw = found.output("body.yaw") if found.has("body.yaw") else Value()
    y = found.output("y") if found.has("y") else Value()
    body = Body(
        "body",
        _body_faces(found),
        x=distance,
        y=y,
        z=found.output("body.z", offset=found.cg_height),
        roll=found.output("body.roll"),
        pitch=found.output("body.pitch"),
        yaw=yaw,
    )
    wheels = [_wheel(found, c, distance, y) for c in found.corners]
    struts: list[Strut] = []
    arrows: list[Arrow] = []
    load = max(found.loads.values())
    reliefs, trenches = _reliefs(found), _trenches(found)
    is_open = found.distance is not None and found.road is None and not reliefs and not trenches
    for corner, wheel in zip(found.corners, wheels, strict=True):
        inboard = -found.side(corner) * (0.5 * wheel.width + 0.10)
        mount = (found.x[corner], found.side(corner) * found.half_track(corner) + inboard, _mount(found, corner))
        struts.append(Strut("body", mount, wheel.name, (0.0, inboard, 0.0)))
        arrows += _forces(found, corner, wheel, mount)
    return Scene(
        title=f"{looks.what} '{name}'",
        what=looks.what,
        bodies=[body, *_plates(found)],
        wheels=wheels,
        struts=struts,
        arrows=[*arrows, *_touching(found)],
        grounds=list(found.grounds()),
        points=[*_points(found, distance), *_predictions(found, distance)],
        limits=[*_lifted(found), *_stops(found), *_limits(found)],
        readings=_readings(found),
        trenches=trenches,
        reliefs=reliefs,
        follow="body",
        width=round(2.35 * (found.axles[0].x - found.axles[-1].x + 1.2), 1),
        force_scale=_round_up(load / (1.5 * found.axles[0].radius)),
        dimensions=sorted(found.lengths),
        views=("chase", "top", *VIEWS) if is_open else VIEWS,
    )


def _body_faces(found: Found) -> list[Face]:
    """Outlines that a plant has are drawn as they are."""
    if not found.knows("outline.tip_height"):
        return found.looks.faces(found.axles, found.cg_height)
    names = Outline.__dataclass_fields__
    return shapes.carrier(found.axles, Outline(**{n: found.parameter(f"outline.{n}") for n in names}))


def _wheel(found: Found, corner: str, distance: Value, y: Value) -> Wheel:
    x, half_track = found.x[corner], found.half_track(corner)
    across = found.side(corner) * half_track
    squash, rest = found.static_squash(corner), found.wheel_height(corner)
    radius = rest + squash
    heading = Value()
    if found.has(f"wheel.{corner}.steer"):
        heading += found.output(f"wheel.{corner}.steer")
    elif corner in found.front:
        heading += found.steer
    if found.has(f"wheel.{corner}.toe"):  # positive outwards
        heading += found.output(f"wheel.{corner}.toe", float(found.side(corner)))
    contact = None
    if found.has(f"hub.{corner}.x"):
        at, height = found.output(f"hub.{corner}.x"), found.output(f"hub.{corner}.z", rest=rest)
        contact = (found.output(f"contact.{corner}.x"), found.output(f"contact.{corner}.z"))
    else:
        at, height = distance + Value(offset=x), found.output(f"wheel.{corner}.z", offset=rest)
    if found.has(f"wheel.{corner}.half_track"):
        line = found.output(f"wheel.{corner}.half_track", float(found.side(corner)), rest=across)
    else:
        line = Value(offset=across)
    deflection = found.output(f"tire.{corner}.deflection", -1.0, squash)
    if found.knows("tire.radius"):  # counts from the unloaded tire
        deflection = found.output(f"tire.{corner}.deflection", -1.0, 0.0, squash)
    on_body = found.has("body.yaw") and contact is None
    return Wheel(
        corner,
        radius,
        found.looks.tire_width,
        x=Value(offset=x) if on_body else at,
        y=line if on_body else line + y,
        z=height,
        turn=at * (1.0 / (radius - found.parameter("disc.rolling_loss", default=squash / 3))),
        heading=heading,
        squash=deflection,
        contact=contact,
        on="body" if on_body else None,
    )


def _mount(found: Found, corner: str) -> float:
    """Height of a strut's upper end above the CG."""
    return found.wheel_height(corner) + 1.75 * found.axles[0].radius - found.cg_height


def _forces(found: Found, corner: str, wheel: Wheel, mount: tuple[float, float, float]) -> Iterator[Arrow]:
    """Of the ground on a wheel, and of its actuator on the body."""
    if found.has(f"contact.{corner}.fz"):
        at = tuple(found.output(f"contact.{corner}.{n}") for n in "xz")
        yield Arrow(
            f"ground on {corner}",
            "ground",
            found.output(f"contact.{corner}.fz"),
            found.output(f"contact.{corner}.fx"),
            at=(at[0], Value(offset=found.side(corner) * found.half_track(corner)), at[1]),
        )
    elif found.has(f"tire.{corner}.force"):
        below = wheel.squash + Value(offset=-wheel.radius)  # type: ignore[operator]
        yield Arrow(
            f"ground on {corner}", "ground", found.output(f"tire.{corner}.force"), on=corner, at=(0.0, 0.0, below)
        )
    force = found.given(f"force.{corner}")
    if force is not None:
        yield Arrow(f"actuator at {corner}", "actuator", force, on="body", at=mount)


def _touching(found: Found) -> Iterator[Arrow]:
    """What bumpers and belly touch."""
    if not found.knows("outline.tip_height"):
        return
    first, last = found.axles[0].x, found.axles[-1].x
    lower = Outline(**{n: found.parameter(f"outline.{n}") for n in Outline.__dataclass_fields__}).lower(first, last)
    middle = ((first + last) / 2, found.parameter("outline.belly_height"))
    for part, (x, z) in zip(_TOUCHES, (lower[0], lower[-1], middle), strict=True):
        if found.has(f"{part}.force"):
            yield Arrow(_TOUCHES[part], "body", found.output(f"{part}.force"), on="body", at=(x, 0.0, z))


def _plates(found: Found) -> list[Body]:
    """Under the wheels of a vehicle that goes nowhere: what moves them up and down."""
    if found.distance is not None:
        return []
    bodies = []
    for corner in found.corners:
        height = found.given(f"road.{corner}.height") or Value()
        across = found.side(corner) * found.half_track(corner)
        faces = shapes.rig_plate(0.6 * found.axles[0].radius, 0.3 * found.axles[0].radius)
        bodies.append(Body(f"plate {corner}", faces, x=found.x[corner], y=across, z=height))
    return bodies


def _trenches(found: Found) -> list[Trench]:
    if not found.knows("trench.start") or found.parameter("obstacle.shape", default=_TRENCH) != _TRENCH:
        return []
    start, length, depth = (found.output(f"trench.{n}") for n in ("start", "length", "depth"))
    if not found.knows("trench.right_offset"):
        return [Trench(start, length, depth)]
    return [
        Trench(start, length, depth, "left"),
        Trench(start + found.output("trench.right_offset"), length, depth, "right"),
    ]


def _reliefs(found: Found) -> list[Relief]:
    """The ground that a plant carries with it, where that is no trench."""
    shape = found.parameter("obstacle.shape", default=_TRENCH)
    if shape == _OUTLINE:
        count = round(found.parameter("outline.points"))
        outlines = {
            s: [tuple(found.parameter(f"outline.{s}.{n}[{i + 1}]") for n in "xz") for i in range(count)]
            for s in ("left", "right")
        }
        return [Relief(outlines["left"], "left"), Relief(outlines["right"], "right")]  # type: ignore[arg-type]
    return [] if shape == _TRENCH else [Relief([(0.0, 0.0)])]


# ------------------------------------------------------------------------------------------------ what controllers show


_USED = "preview.used"  # beyond the first


def _points(found: Found, distance: Value) -> Iterator[Points]:
    """What is known of the road ahead of the front wheels, by who reads it."""
    if found.speed is None:
        return
    for component in found.system.components.values():
        for corner in found.front:
            heights, source = _preview(found.system, component, corner)
            step = None if source is None else _preview_step(found.system, component, source)
            if source is None or step is None:
                continue
            yield Points(
                f"{component.name} {found.place(corner)}",
                "preview" if source is found.road else "sensed",
                distance + Value(offset=found.x[corner]),
                found.side(corner) * found.half_track(corner),
                found.speed * step,
                heights,
                Value({f"{component.name}.{_USED}": 1.0}, 1.0) if _USED in component.description.parameters else None,
            )


def _preview(system: Wiring, component: SystemComponent, corner: str) -> tuple[list[Value], SystemComponent | None]:
    """What drives `preview.{corner}[1...]` of a component, as far as each is another variable than the one before."""
    heights: list[Value] = []
    source: SystemComponent | None = None
    while True:
        connection = system.connections.get(f"{component.name}.preview.{corner}[{len(heights) + 1}]")
        if connection is None or (heights and value_of_source(connection) == heights[-1]):
            return (heights, source) if len(heights) > 1 else ([], None)
        heights.append(value_of_source(connection))
        source = connection.source


def _preview_step(system: Wiring, reader: SystemComponent, source: SystemComponent) -> float | None:
    """Seconds between heights, a constant of both ends."""
    connection = system.connections.get(f"{reader.name}.preview.step")
    variables = [None if connection is None else connection.output, source.description.outputs.get("preview.step")]
    steps = [v.constant for v in variables if v is not None] + [
        getattr(reader.description.inputs.get("preview.step"), "must_equal", None)
    ]
    return next((step for step in steps if step), None)


def _predictions(found: Found, distance: Value) -> Iterator[Points]:
    """Deflections of the front suspensions that controllers predict, `predicted.suspension.{c}.deflection[i]`.

    They are a sample apart, and drawn at the height of the strut's upper end, which a body at rest keeps above the
    road, starting from the present deflection.
    """
    if found.speed is None:
        return
    for component in found.system.components.values():
        for corner in found.front:
            deflection = f"suspension.{corner}.deflection"
            own = component.description.arrays.get(f"predicted.{deflection}", [])
            if not own or not found.has(deflection):
                continue
            level = _mount(found, corner) + found.cg_height
            later = [Value({f"{component.name}.{name}": 1.0}, level) for name in sorted(own, key=indices)]
            yield Points(
                f"{component.name} predicts {found.place(corner)}",
                "predicted",
                distance + Value(offset=found.x[corner]),
                found.side(corner) * found.half_track(corner),
                found.speed * float(component.step),
                [found.output(deflection, offset=level), *later],
            )


def _limits(found: Found) -> Iterator[Limit]:
    """What components say of themselves."""
    for component in found.system.components.values():
        outputs = component.description.outputs
        for output, words in _SAYS.items():
            if output in outputs:
                yield Limit(words.format(component.name), f"{component.name}.{output}")
        if "preview.valid" in outputs:
            yield Limit(f"{component.name}: preview lost", Value({f"{component.name}.preview.valid": -1.0}, 0.5))
    for part, words in _TOUCHES.items():
        if found.has(f"{part}.force"):
            yield Limit(f"{words} on the ground", found.output(f"{part}.force"))


def _lifted(found: Found) -> Iterator[Limit]:
    """Wheels in the air."""
    for corner in found.corners:
        label = f"{found.place(corner)} wheel in the air"
        if found.has(f"tire.{corner}.force"):
            yield Limit(label, found.output(f"tire.{corner}.force", -1.0, 1e-3 * found.loads[corner]), corner)
        elif found.has(f"contact.{corner}.fz"):
            yield Limit(label, found.output(f"tire.{corner}.deflection", 1.0, -found.static_squash(corner)), corner)


def _stops(found: Found) -> Iterator[Limit]:
    """Suspensions at the end of their travel."""
    for corner in found.corners:
        deflection = f"suspension.{corner}.deflection"
        for sign, word, names in (
            (-1.0, "bump", ("strut.compression", "suspension.stop.travel")),
            (1.0, "rebound", ("strut.extension", "suspension.stop.travel")),
        ):
            travel = found.parameter(*names, default=math.inf)
            if math.isfinite(travel) and found.has(deflection):
                yield Limit(f"{found.place(corner)}: {word} stop", found.output(deflection, sign, -travel), corner)


def _readings(found: Found) -> list[Reading]:
    readings = []
    if found.speed is not None:
        readings.append(Reading("speed", "km/h", found.speed, 1, _KMH))
    if found.distance is not None:
        readings.append(Reading("distance", "m", found.distance, 1))
    degrees = math.degrees(1.0)
    for output, label in (("body.pitch", "pitch, nose down"), ("body.roll", "roll, left side up")):
        if found.has(output):
            readings.append(Reading(label, "deg", found.output(output), 2, degrees))
    if not found.has("body.pitch"):
        readings.append(Reading("body", "mm", found.output("body.z"), 1, 1e3))
    if found.has("body.az"):
        readings.append(Reading("vertical acceleration", "m/s2", found.output("body.az"), 2))
    for component in found.system.components.values():
        if "absorbed_power.window" in component.description.outputs:
            readings.append(Reading("absorbed power", "W", f"{component.name}.absorbed_power.window", 1))
    unique = {r.label: r for r in reversed(readings)}
    return [r for r in readings if unique[r.label] is r]


# --------------------------------------------------------------------------------------------------------- quarter cars


def _quarter(found: Found) -> Scene:
    """A quarter car on a rig, or on a road where there is one."""
    mass = found.parameter("body.mass", default=_RIG_MASS)
    load = GRAVITY * (mass + found.parameter("wheel.mass", default=0.1 * mass))
    squash = load / found.parameter("tire.stiffness", default=400.0 * mass)
    size = max(_RIG_RADIUS * (mass / _RIG_MASS) ** (1 / 3), squash / _RIG_SQUASH)
    height, floor, beam = 2.55 * size, 0.9 * size, 6.0 * size
    distance = found.distance
    at = distance or Value()
    road = found.given("road.height") or Value()
    body = Body("body", shapes.rig_mass(size), x=at, z=found.output("body.z", offset=height))
    wheel = Wheel(
        "wheel",
        size,
        0.55 * size,
        x=at,
        y=0.0,
        z=found.output("wheel.z", offset=size - squash),
        turn=at * (1.0 / (size - squash / 3)),
        squash=_squash(found, squash),
    )
    arrows = []
    force = found.given("force")
    if force is not None:
        arrows.append(Arrow("actuator", "actuator", force, on="body", at=(0.0, 0.0, 0.0)))
    standing: list[Body] = []
    traces: list[Trace] = []
    if distance is None:
        standing = [
            Body("frame", shapes.rig_frame(size, beam), z=-floor),
            Body("plate", shapes.rig_plate(size, floor), z=road),
        ]
        speed = 3.2 * size / _PAPER
        traces = [
            Trace(
                "body",
                "body",
                -2.1 * size,
                0.0,
                found.output("body.z", offset=height + 0.31 * size, rest=height + 0.31 * size),
                speed,
            ),
            Trace("wheel", "wheel", -2.1 * size, 0.0, found.output("wheel.z", offset=size - squash), speed),
            Trace("road", "ground", -2.1 * size, 0.0, road, speed),
        ]
    return Scene(
        title=f"quarter car '{found.component.name}'",
        what="quarter car",
        bodies=[body, *standing],
        wheels=[wheel],
        struts=[Strut("body", (0.0, 0.0, 0.0), "wheel")],
        arrows=arrows,
        grounds=list(found.grounds()),
        limits=list(_limits(found)),
        readings=_readings(found),
        traces=traces,
        follow="frame" if standing else "body",
        width=round(12.0 * size, 2),
        force_scale=_round_up(load / (1.5 * size)),
        dimensions=sorted(found.lengths),
    )


def _squash(found: Found, rest: float) -> Value:
    """From the tire's deflection, or from the heights of wheel and road."""
    if found.has("tire.deflection"):
        return found.output("tire.deflection", -1.0, rest)
    return (found.given("road.height") or Value()) + found.output("wheel.z", -1.0, rest)


# --------------------------------------------------------------------------------------------------------------- pieces


def _round_up(number: float) -> float:
    """The next of 1, 2, 5, 10, ..."""
    power = 10.0 ** math.floor(math.log10(number))
    return next(step * power for step in (1.0, 2.0, 5.0, 10.0) if step * power >= number * (1 - 1e-9))
