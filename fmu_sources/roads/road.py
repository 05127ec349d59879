"""What every road does: from the heights of both tracks to the signals under the wheels and ahead of them."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from typing import Any, Protocol

import casadi as ca
import numpy as np

from build_fmus.component import Component
from fmu_sources.roads.layout import RoadContact, RoadLayout, WheelPosition

NODE_STEP = 0.1  # m, spacing of the road points in paper 000
_NODE_TOLERANCE = 1e-9  # a position this close (in node steps) below a node counts as on it


class Shape(Protocol):
    """Heights along both tracks. `end` may be an expression of the component's parameters."""

    @property
    def end(self) -> Any:
        """Position [m] at which the road ends."""
        ...

    @property
    def note(self) -> str:
        """What a user must know about heights between and beyond given ones."""
        ...

    def at(self, x: Any, side: str) -> tuple[Any, Any]:
        """Height [m] and slope dz/dx at a column of positions [m] on the `"left"` or `"right"` track.

        A shape that smooths its surface for the wheels also has `surface(x, side)`, the height [m] that sensors see.
        """
        ...


@dataclass(frozen=True)
class Profile:
    """Heights at nodes `0 .. last`, `step` meters apart from `start` on; linear in between, held outside.

    `height(node, side)` gives the heights [m] at a column of whole node numbers for `"left"` or `"right"`.
    `step`, `last` and `start` may be parameters of the component; numbers become constants in meters.
    `alike`: both tracks have the same heights, so that those under two wheels of one axle are computed once.
    """

    height: Callable[[Any, str], Any]
    last: Any
    step: Any = NODE_STEP
    start: Any = 0.0
    alike: bool = False

    note = (
        "Heights are given at equidistant nodes and are linear in between; the slope is that of the interval. Before "
        "the first and beyond the last node the nearest height is held and the slope is 0."
    )

    def declared(self, c: Component) -> Profile:
        """The same with constants of `c` in place of numbers."""

        def length(name: str, value: Any, text: str) -> Any:
            return c.constant(name, value, "m", text, source="see the road") if isinstance(value, float) else value

        step = length("node.step", self.step, "distance between nodes")
        return replace(self, step=step, start=length("node.start", self.start, "position of the first node"))

    @property
    def end(self) -> Any:
        """Position of the last node [m]."""
        return self.start + self.last * self.step

    def at(self, x: Any, side: str) -> tuple[Any, Any]:
        """Height [m] and slope dz/dx at a column of positions [m]; at a node the slope of the interval ahead."""
        s = (x - self.start) / self.step
        inside = ca.logic_and(s >= -_NODE_TOLERANCE, s < self.last - _NODE_TOLERANCE)
        s = ca.fmax(0, ca.fmin(self.last, s))
        node = ca.fmin(ca.floor(s + _NODE_TOLERANCE), self.last - 1)
        part = ca.fmax(0, ca.fmin(1, s - node))
        here, next_ = self.height(node, side), self.height(node + 1, side)
        return (1 - part) * here + part * next_, ca.if_else(inside, (next_ - here) / self.step, 0)


def declare_side(c: Component, what: str, source: str) -> Any:
    """Declare the parameter that says on which side the road has something: 0 both, 1 left, 2 right."""
    return c.parameter("side", 0, None, f"where {what}: 0 both sides, 1 left, 2 right", min=0, max=2, source=source)


def is_on(side: str, declared: Any) -> Any:
    """Whether the side of a track is the declared one."""
    return declared != (2 if side == "left" else 1)


def road(
    name: str,
    layout: RoadLayout,
    profile: Callable[[Component], Shape],
    *,
    description: str,
    source: str,
    symbols: Any = ca.SX,
    notes: Iterable[str] = (),
    reference_start: float = 27.0,
) -> Component:
    """A road under the wheels of `layout`. `profile` declares the road's own parameters and gives its heights."""
    c = Component(name, kind="discrete", sample_time=1e-3, description=description, source=source, symbols=symbols)
    shape = profile(c)
    if isinstance(shape, Profile):
        shape = shape.declared(c)
    c.notes = (*notes, shape.note, *_NOTES)
    position = layout.declare_wheels(c)
    x = c.input("x", "m", "distance of the CG along the road")
    speed = c.input("speed", "m/s", "forward speed", display_unit="km/h")

    def common(of: Callable[[WheelPosition], tuple[Any, ...]]) -> dict[str, tuple[Any, ...]]:
        """Something by wheel; where both tracks are alike, a wheel beside another one has what that one has."""
        found: dict[str, tuple[Any, ...]] = {}
        for w in layout.wheels:
            found[w.corner] = of(w)
            beside = next((v for v in layout.wheels if v.x == w.x and v.corner in found), w)
            if getattr(shape, "alike", False) and beside is not w:
                both = zip(found[beside.corner], found[w.corner], strict=True)
                same = position[w.corner] == position[beside.corner]
                found[w.corner] = tuple(ca.if_else(same, other, own) for other, own in both)
        return found

    under = common(lambda w: shape.at(x + position[w.corner], w.side))
    if layout.contact is not None:
        touched, under = _contact(c, layout.contact, shape, x, position, common)
    times = np.arange(1, layout.preview_count) * layout.preview_step
    later = c.constant("later", times, "s", "times of the preview heights", source="road layout")
    for corner, (height, _) in under.items():
        c.output(f"road.{corner}.height", height, "m", f"road height under the {corner} wheel")
    for corner, (_, slope) in under.items():
        c.output(f"road.{corner}.slope", slope, "1", f"slope dz/dx under the {corner} wheel")
    for corner, (_, slope) in under.items():
        c.output(f"road.{corner}.rate", slope * speed, "m/s", f"rate of the road height under the {corner} wheel")
    ahead = common(lambda w: shape.at(x + position[w.corner] + speed * later, w.side))
    for corner, (height, _) in under.items():
        heights = ca.vertcat(height, ahead[corner][0])
        c.output(f"preview.{corner}", heights, "m", f"height under the {corner} wheel now, preview.step later, ...")
    if layout.contact is not None:
        for corner, heights in touched.items():
            c.output(
                f"contact.{corner}",
                heights,
                "m",
                f"heights along the {corner} tire, contact.step apart, above road.{corner}.height",
            )
        c.output("contact.step", layout.contact.step, "m", "distance between heights of contact.*", display_unit="mm")
        c.notes = (*c.notes, _CONTACT_NOTE)
    if layout.scan is not None:
        scan = layout.scan
        first = c.constant("scan_start", scan.start, "m", "first height of the scan", source="road layout")
        places = c.constant("scan", np.arange(scan.count) * scan.step, "m", "heights from there", source="road layout")
        scanned = x + first + places
        for side in ("left", "right"):
            c.output(
                f"scan.{side}",
                _surface(shape, scanned, side),
                "m",
                f"height of the surface of the {side} track, scan.step apart",
            )
        c.output("scan.start", scan.start, "m", "distance of the first height of scan.* ahead of the CG")
        c.output("scan.step", scan.step, "m", "distance between heights of scan.*")
        c.notes = (*c.notes, _SCAN_NOTE)
    c.output("preview.step", layout.preview_step, "s", "time between preview heights", display_unit="ms")
    front = position[max(layout.wheels, key=lambda w: w.x).corner]
    c.output("end_of_road", x + front > shape.end, None, "the front wheels are beyond the end of the road", type=bool)

    c.reference_input({"x": lambda t: reference_start + 30.0 * t, "speed": lambda _: 30.0})
    return c


def _contact(
    c: Component, contact: RoadContact, shape: Shape, x: Any, position: dict[str, Any], common: Callable[..., Any]
) -> tuple[dict[str, Any], dict[str, tuple[Any, Any]]]:
    """Heights along the tire by corner, and height and slope under the wheel.

    Those along the tire [m] are above that under the wheel [m]; the slope is over the next meters.
    """
    offsets = (np.arange(contact.count) - contact.count // 2) * contact.step
    places = c.constant("contact.places", offsets, "m", "heights along a tire", source="road layout")
    base = c.constant(
        "contact.slope_base", contact.slope_base, "m", "length that the slope is taken over", source="road layout"
    )
    heights = common(lambda w: (_surface(shape, x + position[w.corner] + places, w.side),))
    ahead = common(lambda w: (_surface(shape, x + position[w.corner] + base, w.side),))
    below = {corner: found[contact.count // 2] for corner, (found,) in heights.items()}
    return (
        {corner: found - below[corner] for corner, (found,) in heights.items()},
        {corner: (below[corner], (found - below[corner]) / base) for corner, (found,) in ahead.items()},
    )


def _surface(shape: Shape, x: Any, side: str) -> Any:
    """Height [m] of the surface itself at a column of positions [m]."""
    seen = getattr(shape, "surface", lambda x, side: shape.at(x, side)[0])
    return seen(x, side)


_CONTACT_NOTE = (
    "contact.* are what tires touch that envelop short obstacles: heights of the surface along each tire, contact.step"
    " apart, the middle one under the wheel center, counted from there. Under such wheels road.*.slope is that over the"
    " next 50 mm."
)
_SCAN_NOTE = (
    "scan.* is what range sensors may hit: heights of the surface of both tracks at fixed distances ahead of the CG,"
    " not averaged over the contact of a tire. SensorSuite casts its beams against them."
)
_NOTES = (
    (
        "The road has no memory: its outputs at t follow from x and speed at t. preview.* are the heights each wheel"
        " will meet if the speed stays: index 1 is under the wheel now, each further one preview.step later."
    ),
    (
        "Wiring: x and speed come from the vehicle; road.* goes to the inputs of the same name of the vehicle,"
        " preview.* and road.*.height to a controller. The wheel positions must be those of the vehicle."
    ),
)
