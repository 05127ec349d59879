"""Signals of a system that a scene shows, found by the names of the variables of FMUs."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from cosim.scenes import shapes
from cosim.scenes.scene import Face, Ground, Side, Value
from cosim.scenes.shapes import Axle, Outline
from cosim.system.components import Connection, SystemComponent
from cosim.system.wiring import Wiring

_FRONT, _REAR = ("front", "rear"), ("front", "middle", "rear")
_CORNER = re.compile(r"wheel\.(?P<corner>[a-z][a-z0-9]*[lr])\.z")
GRAVITY = 9.81  # m/s2


@dataclass(frozen=True)
class Looks:
    """Defaults for dimensions that the parameters of a plant may not give [m, kg].

    They are loaded radius and width of a tire, height of the CG above the road, and the largest mass of a body of this
    shape; `what` is its name in sentences.
    """

    what: str
    mass: float
    wheel_height: float
    tire_width: float
    cg_height: float
    faces: Callable[[Sequence[Axle], float], list[Face]]


def _carrier(axles: Sequence[Axle], _: float) -> list[Face]:
    return shapes.carrier(axles, Outline())


LOOKS = (
    Looks("car", 2000.0, 0.31, 0.20, 0.55, shapes.sedan),
    Looks("off-road vehicle", math.inf, 0.45, 0.32, 0.85, shapes.off_road),
)
"""Vehicles on two axles, lightest first."""

CARRIER = Looks("6x6", math.inf, 0.58, 0.40, 1.23, _carrier)
"""On three axles and more."""


@dataclass(frozen=True)
class Found:
    """A component that may be a plant, and what is around it."""

    system: Wiring
    component: SystemComponent
    lengths: set[str] = field(default_factory=set, compare=False)
    """Names of the parameters in meters that were read: the picture has their values as they are now."""

    @property
    def is_quarter(self) -> bool:
        return {"body.z", "wheel.z"} <= self.component.description.outputs.keys()

    @property
    def is_vehicle(self) -> bool:
        return {"body.z", "body.roll", "body.pitch"} <= self.component.description.outputs.keys() and len(
            self.corners
        ) >= 4

    @cached_property
    def corners(self) -> list[str]:
        """Names of the corners, left ahead of right, front to rear as the plant has them."""
        matches = map(_CORNER.fullmatch, self.component.description.outputs)
        return [m["corner"] for m in matches if m]

    def name(self, variable: str) -> str:
        return f"{self.component.name}.{variable}"

    def has(self, output: str) -> bool:
        return output in self.component.description.outputs

    def output(self, variable: str, factor: float = 1.0, offset: float = 0.0, rest: float | None = None) -> Value:
        return Value({self.name(variable): factor}, offset, rest)

    def parameter(self, *names: str, default: float | None = None) -> float:
        """The first parameter that there is, as it is set, else the default."""
        for name in names:
            if name in self.component.description.parameters:
                known = self.component.description.parameters[name]
                if known.unit is not None and known.unit.name == "m":
                    self.lengths.add(self.name(name))
                return float(self.component.start(name))
        if default is None:
            raise KeyError(names[0])
        return default

    def knows(self, parameter: str) -> bool:
        return parameter in self.component.description.parameters

    def driven(self, input_: str) -> Connection | None:
        return self.system.connections.get(self.name(input_))

    def given(self, input_: str) -> Value | None:
        """What drives an input, None where nothing does."""
        connection = self.driven(input_)
        return None if connection is None else value_of_source(connection)

    # ------------------------------------------------------------------------------------------------ dimensions

    @cached_property
    def looks(self) -> Looks:
        if len(self.corners) > 4:
            return CARRIER
        mass = self.parameter("body.mass", default=LOOKS[0].mass)
        return next(looks for looks in LOOKS if mass <= looks.mass)

    @cached_property
    def x(self) -> dict[str, float]:
        """Wheel centers ahead of the CG [m]."""
        given = {c: self._x(c) for c in self.corners}
        if None not in given.values():
            return {c: x for c, x in given.items() if x is not None}
        rows = sorted({c[:-1] for c in self.corners})
        spread = np.linspace(1.6, -1.6, len(rows)).tolist()
        return {c: spread[rows.index(c[:-1])] for c in self.corners}

    def _x(self, corner: str) -> float | None:
        if self.knows(f"wheel.{corner}.x"):
            return self.parameter(f"wheel.{corner}.x") - self.parameter("body.cg_offset", default=0.0)
        end = "front" if corner.startswith("f") else "rear"
        if self.knows(f"suspension.{end}.wheel[1]"):
            return self.parameter(f"suspension.{end}.wheel[1]")
        if self.knows("body.wheelbase"):
            ahead = self.parameter("body.cg_position", default=0.5)  # of the front axle, in wheelbases
            return self.parameter("body.wheelbase") * (ahead if end == "front" else ahead - 1.0)
        return None

    def half_track(self, corner: str) -> float:
        end = "front" if corner.startswith("f") else "rear"
        default = 0.5 * self.parameter("body.track", default=1.6)
        return abs(self.parameter(f"wheel.{corner}.half_track", f"suspension.{end}.wheel[2]", default=default))

    def side(self, corner: str) -> int:
        """1 on the left."""
        return 1 if corner.endswith("l") else -1

    @cached_property
    def loads(self) -> dict[str, float]:
        """Static tire forces [N], as of a stiff body on equal springs."""
        mass = self.parameter("body.mass", default=self.looks.mass if math.isfinite(self.looks.mass) else 3000.0)
        x = np.array([self.x[c] for c in self.corners])
        shares = np.linalg.lstsq(np.array([np.ones(len(x)), x]), np.array([mass, 0.0]), rcond=None)[0]
        wheel = [self.parameter(f"wheel.{c}.mass", "wheel.mass", default=0.0) for c in self.corners]
        return {c: GRAVITY * float(s + w) for c, s, w in zip(self.corners, shares, wheel, strict=True)}

    def static_squash(self, corner: str) -> float:
        """How far the weight presses in a tire [m]."""
        if self.knows("tire.radius") and self._rest_height(corner) is not None:
            return self.parameter("tire.radius") - (self._rest_height(corner) or 0.0)
        stiffness = self.parameter(f"tire.{corner}.stiffness", "tire.stiffness", default=4e5)
        return self.loads[corner] / stiffness

    def _rest_height(self, corner: str) -> float | None:
        end = "front" if corner.startswith("f") else "rear"
        for name in (f"rest.{end}.wheel_height", "wheel.hub_height"):
            if self.knows(name):
                return self.parameter(name)
        return None

    def wheel_height(self, corner: str) -> float:
        """Of the wheel's center above the road at rest [m]."""
        known = self._rest_height(corner)
        if known is None and self.knows("disc.radius"):
            known = self.parameter("disc.radius") - self.static_squash(corner)
        return self.looks.wheel_height if known is None else known

    @cached_property
    def cg_height(self) -> float:
        """Of the CG above the road at rest [m]."""
        if self.knows("disc.radius"):  # body.cg_height counts from the wheels there
            centers = [self.wheel_height(c) for c in self.corners]
            return self.parameter("body.cg_height") + float(np.mean(centers))
        return self.parameter("rest.height", "body.cg_height", default=self.looks.cg_height)

    @cached_property
    def axles(self) -> list[Axle]:
        """Front to rear, with the dimensions of their left wheels."""
        left = sorted((c for c in self.corners if self.side(c) > 0), key=lambda c: -self.x[c])
        width = self.looks.tire_width
        return [Axle(self.x[c], self.half_track(c), self.wheel_height(c) + self.static_squash(c), width) for c in left]

    def place(self, corner: str) -> str:
        """`front left`."""
        rows = sorted({self.x[c] for c in self.corners}, reverse=True)
        words = _FRONT if len(rows) == 2 else _REAR if len(rows) == 3 else [f"axle {i + 1}" for i in range(len(rows))]
        return f"{words[rows.index(self.x[corner])]} {'left' if self.side(corner) > 0 else 'right'}"

    # ---------------------------------------------------------------------------------------------------- the road

    @cached_property
    def road(self) -> SystemComponent | None:
        """The component whose heights are under the wheels, if these follow from a place along it."""
        for corner in [f".{c}" for c in self.corners] or [""]:
            connection = self.driven(f"road{corner}.height")
            if connection is not None and "x" in connection.source.description.inputs:
                return connection.source
        return None

    @cached_property
    def distance(self) -> Value | None:
        """Where the CG is along the road, None where it stands on a rig."""
        if self.has("x"):
            return self.output("x")
        return self._of_road("x")

    @cached_property
    def speed(self) -> Value | None:
        return self.output("speed") if self.has("speed") else self._of_road("speed")

    def _of_road(self, input_: str) -> Value | None:
        if self.road is None:
            return None
        connection = self.system.connections.get(f"{self.road.name}.{input_}")
        return None if connection is None else value_of_source(connection)

    def grounds(self) -> Iterator[Ground]:
        """The road on both sides, as the front wheels see it; of a quarter car, its only line."""
        if self.road is None:
            return
        for corner in self.front:
            connection = self.driven(f"road.{corner}.height" if corner else "road.height")
            if connection is None or connection.source is not self.road:
                continue
            own = connection.output.name.removeprefix("road.").removesuffix(".height")
            ahead = self.road.description.parameters.get(f"wheel.{own}.x")
            at = float(self.road.start(ahead.name)) if ahead else self.x.get(corner, 0.0)
            side: Side = "left" if not corner or self.side(corner) > 0 else "right"
            y = self.side(corner) * self.half_track(corner) if corner else 0.0
            yield Ground(side, y, self.road.name, f"{self.road.name}.x", connection.source_name, at)

    @property
    def steer(self) -> Value:
        """Angle [rad] of the front wheels under a steering wheel, of a linkage without differences left and right."""
        name = "steering.wheel"
        if name not in self.component.description.inputs or not self.parameter("driver.mode", default=0.0):
            return Value()
        wheel = self.given(name) or Value({self.name(name): 1.0})
        return wheel * (1.0 / self.parameter("steering.ratio"))

    @cached_property
    def front(self) -> list[str]:
        """The corners of the first axle; the one of a quarter car has no name."""
        most = max(self.x.values(), default=0.0)
        return [c for c in self.corners if self.x[c] == most] or [""]


def value_of_source(connection: Connection) -> Value:
    """What a connection carries."""
    return Value({connection.source_name: connection.scale}, connection.offset)
