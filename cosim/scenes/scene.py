"""Scenes that a live page draws while the system in it runs: what stands where, by the variables that say so.

A `Scene` is the live cousin of `cosim.report`'s `Animation`: nothing in it is recorded, every moving quantity is
a `Value`, which the page computes from the system's variables at each frame. One description serves all views:
it is in three dimensions, SI units, axes of ISO 8855 (x ahead along the road, y to the left, z up; roll positive left
side up, pitch positive nose down, yaw positive to the left). `scene_script` draws it; `scene_data` is what
that reads.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, fields
from pathlib import Path
from typing import Any, Literal, TypeVar

import numpy as np

from build_fmus.base.checks import number, unknown, whole_number
from cosim.core.content_checks import assign, check_choice, check_text, check_unique, items

Side = Literal["left", "right"]
Sides = Literal["left", "right", "both"]
Material = Literal["body", "panel", "glass", "dark", "steel", "lamp", "tail", "mass", "paint", "bonnet"]
ArrowRole = Literal["ground", "actuator", "body"]
PointsRole = Literal["preview", "sensed", "predicted"]
TraceRole = Literal["ground", "wheel", "body"]
View = Literal["side", "three-quarter", "rear", "chase", "top"]
T = TypeVar("T")

_ASSETS = Path(__file__).parent / "assets"
_SCRIPTS = ("faces.js", "camera.js", "road.js", "bodies.js", "scene.js")  # each extends the class of the one before
VIEWS: tuple[View, ...] = ("side", "three-quarter", "rear")
"""Those of a scene, unless it has its own."""
_FLAT = 1e-3  # m, how far a point of a face may lie from its plane


@dataclass(frozen=True)
class Value:
    """A number that moves: `offset` plus a sum of variables, each times its factor.

    Variables are those of the exported system, `component.variable`; parameters too. `rest` is the value at rest, from
    which a page counts where it exaggerates motion: `offset` unless given.
    """

    terms: Mapping[str, float] = field(default_factory=dict)
    offset: float = 0.0
    rest: float | None = None

    def __post_init__(self) -> None:
        given = self.terms.items() if isinstance(self.terms, Mapping) else None
        if given is None:
            raise ValueError(f"a value's terms are {self.terms!r}; give factors by variable name")
        for name, factor in given:
            component, _, variable = name.partition(".") if isinstance(name, str) else ("", "", "")
            if not component or not variable:
                raise ValueError(f"a value names {name!r}; write component.variable")
            number(f"value: factor of '{name}'", factor)
        assign(self, "terms", {name: float(factor) for name, factor in given if factor})
        assign(self, "offset", float(number("value: offset", self.offset)))
        if self.rest is not None:
            assign(self, "rest", float(number("value: rest", self.rest)))

    def __hash__(self) -> int:
        return hash((frozenset(self.terms.items()), self.offset, self.rest))

    def __add__(self, other: Quantity) -> Value:
        """The sum, variable by variable."""
        other = value(other)
        terms = Counter(self.terms)
        terms.update(other.terms)
        rest = None if self.rest is None and other.rest is None else self.at_rest + other.at_rest
        return Value(dict(terms), self.offset + other.offset, rest)

    def __mul__(self, factor: float) -> Value:
        return Value(
            {name: factor * f for name, f in self.terms.items()},
            factor * self.offset,
            None if self.rest is None else factor * self.rest,
        )

    @property
    def at_rest(self) -> float:
        """The value at rest; if none was given, the offset."""
        return self.offset if self.rest is None else self.rest

    def of(self, variables: Mapping[str, float]) -> float:
        """The value where the variables have these values."""
        return self.offset + sum(factor * variables[name] for name, factor in self.terms.items())


Quantity = Value | str | float
"""What parts accept for a value: a `Value`, the name of a variable, or a number."""


def value(quantity: Quantity) -> Value:
    """The quantity as a `Value`."""
    if isinstance(quantity, Value):
        return quantity
    return Value({quantity: 1.0}) if isinstance(quantity, str) else Value(offset=quantity)


# ---------------------------------------------------------------------------------------------------------------- parts


@dataclass(frozen=True)
class Face:
    """A flat, convex polygon (x, y, z) [m] in the frame of its body; either side may be seen."""

    points: Sequence[tuple[float, float, float]]
    material: Material = "body"

    def __post_init__(self) -> None:
        assign(self, "points", _polygon(self.points))
        check_choice("face", "material", self.material, Material)


@dataclass(frozen=True)
class Body:
    """A rigid body: faces in a frame with its origin at (x, y, z), turned by yaw, then pitch, then roll [rad]."""

    name: str
    faces: Sequence[Face]
    x: Quantity = 0.0
    y: Quantity = 0.0
    z: Quantity = 0.0
    roll: Quantity = 0.0
    pitch: Quantity = 0.0
    yaw: Quantity = 0.0

    def __post_init__(self) -> None:
        where = f"body '{self.name}'"
        check_text(where, name=self.name)
        assign(self, "faces", items(where, "faces", self.faces, Face))
        if not self.faces:
            raise ValueError(f"{where} has no faces")
        _values(self, "x", "y", "z", "roll", "pitch", "yaw")


@dataclass(frozen=True)
class Wheel:
    """A wheel, its center at (x, y, z).

    `radius` is that of the unloaded tire, which the ground presses in by `squash` [m] (0 or less: it is in the air),
    from straight below or from the point `contact` (x, z). `turn` [rad] grows while it rolls ahead; `heading` [rad] is
    positive to the left, as of a body. With a body `on`, x, y and `heading` count from its origin and its yaw.
    """

    name: str
    radius: float
    width: float
    x: Quantity
    y: Quantity
    z: Quantity
    turn: Quantity = 0.0
    heading: Quantity = 0.0
    squash: Quantity = 0.0
    contact: tuple[Quantity, Quantity] | None = None
    on: str | None = None

    def __post_init__(self) -> None:
        where = f"wheel '{self.name}'"
        check_text(where, name=self.name)
        number(f"{where}: radius", self.radius, "m", above=0)
        number(f"{where}: width", self.width, "m", above=0)
        _values(self, "x", "y", "z", "turn", "heading", "squash")
        if self.contact is not None:
            x, z = self.contact
            assign(self, "contact", (value(x), value(z)))


@dataclass(frozen=True)
class Strut:
    """A spring with its damper from a point of a body's frame to a point beside the center of a wheel."""

    body: str
    at: tuple[float, float, float]
    wheel: str
    to: tuple[float, float, float] = (0.0, 0.0, 0.0)

    def __post_init__(self) -> None:
        for end in ("at", "to"):
            assign(self, end, _point(f"strut to wheel '{self.wheel}'", end, getattr(self, end)))


@dataclass(frozen=True)
class Arrow:
    """A force (fx, fy, fz) [N] drawn from a point.

    The point is `at` in the frame of the body `on`, the center of the wheel `on`, or the road's origin if `on` is None.
    `role` gives its color and its description: of the ground on a tire, of an actuator, of something on the body.
    """

    name: str
    role: ArrowRole
    fz: Quantity
    fx: Quantity = 0.0
    fy: Quantity = 0.0
    on: str | None = None
    at: tuple[Quantity, Quantity, Quantity] = (0.0, 0.0, 0.0)

    def __post_init__(self) -> None:
        where = f"arrow '{self.name}'"
        check_text(where, name=self.name)
        check_choice(where, "role", self.role, ArrowRole)
        _values(self, "fx", "fy", "fz")
        x, y, z = self.at
        assign(self, "at", (value(x), value(y), value(z)))


@dataclass(frozen=True)
class Ground:
    """The road under the wheels of one side, at `y`.

    Its height at a place x is the value of `output` when `input` is x - `ahead`: the page queries it with the probe
    that it passes to the scene. A height that was never queried is unknown.
    """

    side: Side
    y: float
    component: str
    input: str
    output: str
    ahead: float

    def __post_init__(self) -> None:
        where = f"ground on the {self.side}"
        check_choice("ground", "side", self.side, Side)
        check_text(where, component=self.component, input=self.input, output=self.output)
        number(f"{where}: y", self.y, "m")
        number(f"{where}: ahead", self.ahead, "m")


@dataclass(frozen=True)
class Points:
    """Heights of a road as known or expected by a component, on the line y.

    The first is at x, the next `spacing` [m] further. `count` of them are valid, by default all.
    """

    name: str
    role: PointsRole
    x: Quantity
    y: Quantity
    spacing: Quantity
    heights: Sequence[Quantity]
    count: Quantity | None = None

    def __post_init__(self) -> None:
        where = f"points '{self.name}'"
        check_text(where, name=self.name)
        check_choice(where, "role", self.role, PointsRole)
        _values(self, "x", "y", "spacing")
        heights = tuple(value(h) for h in self.heights)
        if len(heights) < 2:
            raise ValueError(f"{where}: {len(heights)} heights; a line needs two")
        assign(self, "heights", heights)
        assign(self, "count", value(float(len(heights)) if self.count is None else self.count))


@dataclass(frozen=True)
class Limit:
    """A few words that light up while a value is above 0, beside the scene and, with `at`, on a wheel."""

    label: str
    value: Quantity
    at: str | None = None

    def __post_init__(self) -> None:
        check_text("limit", label=self.label)
        _values(self, "value")


@dataclass(frozen=True)
class Reading:
    """A number beside the scene: `factor` times the value, in `unit` ("" without one).

    The value is divided by `per`; with `largest` it is the largest magnitude of the run so far.
    """

    label: str
    unit: str
    value: Quantity
    decimals: int = 1
    factor: float = 1.0
    per: Quantity = 1.0
    largest: bool = False

    def __post_init__(self) -> None:
        where = f"reading '{self.label}'"
        check_text(where, label=self.label)
        if not isinstance(self.unit, str):
            raise ValueError(f"{where}: unit {self.unit!r} is no text")
        if whole_number(f"{where}: decimals", self.decimals, least=0) > 6:
            raise ValueError(f"{where}: {self.decimals} decimals; use 0 to 6")
        number(f"{where}: factor", self.factor)
        _values(self, "value", "per")


@dataclass(frozen=True)
class Trench:
    """A box cut into level ground, under the wheels of one side or both.

    Dimensions [m] are values, since they may be changed.
    """

    start: Quantity
    length: Quantity
    depth: Quantity
    side: Sides = "both"

    def __post_init__(self) -> None:
        check_choice("trench", "side", self.side, Sides)
        _values(self, "start", "length", "depth")


@dataclass(frozen=True)
class Relief:
    """Ground with a known outline (x, z) [m] from point to point, level ahead of the first and after the last.

    Two points at one x are a wall. One point is level ground.
    """

    points: Sequence[tuple[Quantity, Quantity]]
    side: Sides = "both"

    def __post_init__(self) -> None:
        check_choice("relief", "side", self.side, Sides)
        points = tuple((value(x), value(z)) for x, z in self.points)
        if not points:
            raise ValueError("relief: give at least one point (x, z)")
        assign(self, "points", points)


@dataclass(frozen=True)
class Trace:
    """History of the height z [m] at a fixed place, drawn backwards from (x, y) at `speed` [m/s]."""

    name: str
    role: TraceRole
    x: float
    y: float
    z: Quantity
    speed: float

    def __post_init__(self) -> None:
        where = f"trace '{self.name}'"
        check_text(where, name=self.name)
        check_choice(where, "role", self.role, TraceRole)
        number(f"{where}: speed", self.speed, "m/s", above=0)
        for name in ("x", "y"):
            number(f"{where}: {name}", getattr(self, name), "m")
        _values(self, "z")


@dataclass(frozen=True)
class Cone:
    """A traffic cone at (x, y) [m], which falls where the vehicle touches the circle of its base."""

    x: float
    y: float
    radius: float = 0.15
    height: float = 0.5

    def __post_init__(self) -> None:
        for name in ("x", "y"):
            number(f"cone: {name}", getattr(self, name), "m")
        for name in ("radius", "height"):
            number(f"cone: {name}", getattr(self, name), "m", above=0)


@dataclass(frozen=True)
class Scene:
    """The picture of one system.

    The camera follows the body `follow`; `width` [m] of the road are in view, and `force_scale` [N] are drawn as long
    as a meter. `what` names the system in sentences, "HMMWV". `dimensions` are variables whose values are in the
    picture as they were when it was made: if they change, the picture says so. `views`: those to choose from, the one
    that is shown first at the front. A body that moves without a road is on open ground, where cones may stand.
    """

    title: str
    bodies: Sequence[Body]
    follow: str
    width: float
    force_scale: float
    what: str = "vehicle"
    wheels: Sequence[Wheel] = ()
    struts: Sequence[Strut] = ()
    arrows: Sequence[Arrow] = ()
    grounds: Sequence[Ground] = ()
    points: Sequence[Points] = ()
    limits: Sequence[Limit] = ()
    readings: Sequence[Reading] = ()
    trenches: Sequence[Trench] = ()
    reliefs: Sequence[Relief] = ()
    traces: Sequence[Trace] = ()
    cones: Sequence[Cone] = ()
    dimensions: Sequence[str] = ()
    views: Sequence[View] = VIEWS

    def __post_init__(self) -> None:
        where = f"scene '{self.title}'"
        check_text(where, title=self.title, what=self.what)
        for name in ("width", "force_scale"):
            number(f"{where}: {name}", getattr(self, name), above=0)
        for name, kind in _PARTS.items():
            parts = items(where, name, getattr(self, name), kind)
            assign(self, name, parts)
            check_unique(
                where,
                name,
                (
                    str(part.side if kind is Ground else _label(part))
                    for part in parts
                    if kind not in (Strut, Trench, Relief, Cone)
                ),
            )
        bodies, wheels = ([part.name for part in parts] for parts in (self.bodies, self.wheels))
        check_unique(where, "body or wheel", (*bodies, *wheels))
        if self.follow not in bodies:
            raise ValueError(f"{where}: {unknown('body to follow', self.follow, bodies)}")
        for strut in self.struts:
            for end, named, there in (("body", strut.body, bodies), ("wheel", strut.wheel, wheels)):
                if named not in there:
                    raise ValueError(f"{where}: a strut hangs on {unknown(end, named, there)}")
        for arrow in self.arrows:
            if arrow.on is not None and arrow.on not in (*bodies, *wheels):
                raise ValueError(
                    f"{where}: arrow '{arrow.name}' is on {unknown('body or wheel', arrow.on, (*bodies, *wheels))}"
                )
        for limit in self.limits:
            if limit.at is not None and limit.at not in wheels:
                raise ValueError(f"{where}: limit '{limit.label}' is at {unknown('wheel', limit.at, wheels)}")
        for wheel in self.wheels:
            if wheel.on is not None and wheel.on not in bodies:
                raise ValueError(f"{where}: wheel '{wheel.name}' is on {unknown('body', wheel.on, bodies)}")
        for view in self.views:
            check_choice(where, "views", view, View)
        if "three-quarter" not in self.views:
            raise ValueError(f"{where}: views need 'three-quarter', which a picture has where a person turns it")

    @property
    def footprint(self) -> tuple[float, float, float]:
        """The rectangle around the followed body and its wheels in its frame [m]: rear and front end, half width."""
        body = next(b for b in self.bodies if b.name == self.follow)
        points = [(x, abs(y)) for face in body.faces for x, y, _ in face.points]
        for w in self.wheels:
            if w.on == self.follow:
                x, y = (value(q).at_rest for q in (w.x, w.y))
                points += [(x + end, abs(y) + w.width / 2) for end in (-w.radius, w.radius)]
        xs, ys = zip(*points, strict=True)
        return min(xs), max(xs), max(ys)

    @property
    def variables(self) -> tuple[str, ...]:
        """Names of all variables that the scene needs, each once.

        These are outputs, inputs and parameters, elements of arrays too. Those of the road (`grounds`) are not among
        them: a page queries them through its probe.
        """
        return tuple(dict.fromkeys(name for v in _all_values(self) for name in v.terms))


_PARTS: dict[str, Any] = {
    "bodies": Body,
    "wheels": Wheel,
    "struts": Strut,
    "arrows": Arrow,
    "grounds": Ground,
    "points": Points,
    "limits": Limit,
    "readings": Reading,
    "trenches": Trench,
    "reliefs": Relief,
    "traces": Trace,
    "cones": Cone,
}


# ----------------------------------------------------------------------------------------------------------------- data


def scene_script() -> str:
    """The script with the class `SceneView`, which draws a scene on a canvas."""
    return "".join((_ASSETS / name).read_text(encoding="utf-8") for name in _SCRIPTS)


def scene_style() -> str:
    """The style sheet with the colors of scenes."""
    return (_ASSETS / "scene.css").read_text(encoding="utf-8")


def scene_data(scene: Scene) -> dict[str, Any]:
    """What the page's script reads, as JSON has it: variables by their place in `names`.

    A value is a number, or `[offset, rest, place, factor, place, factor, ...]`. Names of bodies and wheels stay names;
    what hangs on them has their place among the `bodies` or `wheels`.
    """
    names = {name: i for i, name in enumerate(scene.variables)}
    bodies = {body.name: i for i, body in enumerate(scene.bodies)}
    wheels = {wheel.name: i for i, wheel in enumerate(scene.wheels)}

    def plain(part: Any) -> Any:
        if isinstance(part, Value):
            packed = [part.offset, part.at_rest, *(p for name, f in part.terms.items() for p in (names[name], f))]
            return packed if part.terms else part.offset
        if isinstance(part, tuple | list):
            return [plain(p) for p in part]
        if isinstance(part, Face):
            return {"material": part.material, "points": [[round(x, 4) for x in p] for p in part.points]}
        if isinstance(part, tuple(_PARTS.values())):
            return {name: plain(inner) for name, inner in _fields(part)}
        return part

    data = {"names": list(names)} | {name: plain(inner) for name, inner in _fields(scene)}
    data["forceScale"] = data.pop("force_scale")
    data["follow"] = bodies[scene.follow]
    data["footprint"] = list(scene.footprint)
    for wheel in data["wheels"]:
        wheel["on"] = bodies.get(wheel["on"])
    for strut in data["struts"]:
        strut |= {"body": bodies[strut["body"]], "wheel": wheels[strut["wheel"]]}
    for arrow in data["arrows"]:
        on = arrow.pop("on")
        arrow |= {"body": bodies.get(on), "wheel": wheels.get(on)}
    for limit in data["limits"]:
        limit["at"] = wheels.get(limit["at"])
    return data


def _all_values(part: Any) -> Iterator[Value]:
    """Every value in a part and in what it holds."""
    if isinstance(part, Value):
        yield part
    elif isinstance(part, tuple):
        for inner in part:
            yield from _all_values(inner)
    elif isinstance(part, (Scene, *_PARTS.values())):
        for _, inner in _fields(part):
            yield from _all_values(inner)


def _fields(part: Any) -> Iterator[tuple[str, Any]]:
    return ((f.name, getattr(part, f.name)) for f in fields(part))


# --------------------------------------------------------------------------------------------------------------- checks


def _label(part: Any) -> str:
    return part.name if hasattr(part, "name") else part.label


def _values(part: object, *names: str) -> None:
    for name in names:
        assign(part, name, value(getattr(part, name)))


def _point(where: str, name: str, given: Sequence[float]) -> tuple[float, ...]:
    array = np.array(given, dtype=float)
    if array.shape != (3,) or not np.isfinite(array).all():
        raise ValueError(f"{where}: {name} is {given!r}; give a finite point (x, y, z)")
    return tuple(array.tolist())


def _polygon(given: Sequence[Sequence[float]]) -> tuple[tuple[float, ...], ...]:
    """Points of a flat, convex polygon."""
    array = np.array(given, dtype=float)
    if array.ndim != 2 or array.shape[1] != 3 or len(array) < 3 or not np.isfinite(array).all():
        raise ValueError("face: give three or more finite points (x, y, z)")
    sides = np.roll(array, -1, axis=0) - array
    turns = np.cross(sides, np.roll(sides, -1, axis=0))
    normal = turns.sum(axis=0)
    size = float(np.linalg.norm(normal))
    if not size:
        raise ValueError(f"face: the points {array.tolist()} lie on one line")
    normal /= size
    if np.abs((array - array.mean(axis=0)) @ normal).max() > _FLAT:
        raise ValueError(f"face: the points {array.tolist()} lie in no plane")
    if (turns @ normal).min() < -1e-9:
        raise ValueError(f"face: the polygon {array.tolist()} is not convex; divide it")
    return tuple(tuple(p) for p in array.tolist())
