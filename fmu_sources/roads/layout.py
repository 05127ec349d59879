"""Where the wheels of a vehicle stand on a road, and how far ahead its controller looks."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from build_fmus.base.checks import number, whole_number
from build_fmus.component import Component
from fmu_sources.plants.enveloping import CONTACT_COUNT, CONTACT_STEP, SLOPE_BASE
from fmu_sources.vehicles import FullCar, RideCar, SensorSet, ThreeAxleCar, WishboneCar

_HEAVE, _PITCH = 0.12, 0.08  # m, rad: motion of a range sensor that a scan allows for
_STEEPEST = 1.4  # rad, largest angle of a beam that a scan follows


@dataclass(frozen=True)
class WheelPosition:
    """A corner and its wheel's position relative to the CG [m]: x forward, y left."""

    corner: str
    x: float
    y: float

    @property
    def side(self) -> str:
        """Track the wheel runs in: `"left"` or `"right"`."""
        return "left" if self.y >= 0 else "right"


@dataclass(frozen=True)
class RoadScan:
    """What range sensors see of both tracks.

    `count` heights `step` m apart, the first `start` m ahead of the CG.
    """

    start: float
    step: float
    count: int

    def __post_init__(self) -> None:
        whole_number("number of heights in a scan", self.count, least=4)
        number("distance between heights in a scan", self.step, "m", above=0)

    @classmethod
    def of(cls, sensors: SensorSet, *, step: float = 0.05) -> RoadScan:
        """Where the beams of both range sensors can meet the road while the car moves on its springs."""
        mount = sensors.mount
        near, far = [], []
        for sensor in (sensors.radar, sensors.optical):
            tilt, half_spot = sensor.tilt.value, sensor.spot.value / 2
            near.append((mount.height.value - _HEAVE) * math.tan(max(tilt - _PITCH, 0.0)) - half_spot)
            far.append((mount.height.value + _HEAVE) * math.tan(min(tilt + _PITCH, _STEEPEST)) + half_spot)
        start = math.floor((mount.x.value + min(near)) / step) * step - step
        end = mount.x.value + max(far)
        return cls(round(start, 9), step, math.ceil((end - start) / step) + 2)


@dataclass(frozen=True)
class RoadContact:
    """What a tire that envelops short obstacles touches.

    `count` heights `step` m apart along it, the middle one under the wheel. The slope under such a wheel is that
    over the next `slope_base` meters.
    """

    step: float
    count: int
    slope_base: float

    def __post_init__(self) -> None:
        whole_number("number of heights along a tire", self.count, least=3)
        number("distance between heights along a tire", self.step, "m", above=0)
        number("length that the slope under a wheel is taken over", self.slope_base, "m", above=0)
        if self.count % 2 == 0:
            raise ValueError(f"{self.count} heights along a tire have no middle one; take an odd number")


ENVELOPING = RoadContact(CONTACT_STEP, CONTACT_COUNT, SLOPE_BASE)
"""What tires touch that envelop as `fmu_sources.plants.enveloping` has it."""


@dataclass(frozen=True)
class RoadLayout:
    """Corners of the vehicle on the road, and preview of `preview_count` heights `preview_step` seconds apart.

    With `scan` the road also shows what range sensors see, with `contact` what tires touch that envelop it.
    """

    wheels: tuple[WheelPosition, ...]
    preview_count: int = 8
    preview_step: float = 0.010
    scan: RoadScan | None = None
    contact: RoadContact | None = None

    def __post_init__(self) -> None:
        if not self.wheels:
            raise ValueError("a road layout needs at least one wheel")
        whole_number("number of previewed heights", self.preview_count, least=2)
        number("time between previewed heights", self.preview_step, "s", above=0)

    @classmethod
    def of(
        cls,
        vehicle: FullCar | RideCar | ThreeAxleCar | WishboneCar,
        *,
        preview_count: int = 8,
        preview_step: float = 0.010,
        scan: RoadScan | None = None,
    ) -> RoadLayout:
        """Layout of a vehicle: wheels at design, and what its tires touch where they envelop."""
        if isinstance(vehicle, WishboneCar):
            places = tuple(
                WheelPosition(f"{axle[0]}{side[0]}", x, sign * y)
                for axle in ("front", "rear")
                for x, y in [vehicle.wheel_place(axle)]
                for side, sign in (("left", 1), ("right", -1))
            )
            return cls(places, preview_count, preview_step, scan, ENVELOPING)
        if not isinstance(vehicle, FullCar):
            corners = {c: getattr(vehicle.wheel, axle) for c, axle in vehicle.wheel.axle_of.items()}
            places = tuple(
                WheelPosition(c, w.x.value, (1 if c.endswith("l") else -1) * w.half_track.value)
                for c, w in corners.items()
            )
            return cls(places, preview_count, preview_step, scan)
        body = vehicle.body
        front = body.cg_position.value * body.wheelbase.value
        rear = front - body.wheelbase.value
        half = body.track.value / 2
        wheels = (("fl", front, half), ("fr", front, -half), ("rl", rear, half), ("rr", rear, -half))
        return cls(tuple(WheelPosition(*w) for w in wheels), preview_count, preview_step, scan)

    def declare_wheels(self, c: Component) -> dict[str, Any]:
        """Declare the positions of the wheels as parameters of `c`; their symbols by corner."""
        return {
            w.corner: c.parameter(
                f"wheel.{w.corner}.x",
                w.x,
                "m",
                f"position of the {w.corner} wheel ahead of the CG",
                min=-50.0,
                max=50.0,
                source="vehicle file",
            )
            for w in self.wheels
        }

    @property
    def track(self) -> float:
        """Distance of the wheels on the left from those on the right, on average [m]; 0 if one side has none."""
        left, right = ([w.y for w in self.wheels if w.side == side] for side in ("left", "right"))
        return float(np.mean(left) - np.mean(right)) if left and right else 0.0
