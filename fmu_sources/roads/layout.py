"""Where the wheels of a vehicle stand on a road, and how far ahead its controller looks."""

from __future__ import annotations

from dataclasses import dataclass

from fmu_sources.vehicles import FullCar, RideCar, ThreeAxleCar


@dataclass(frozen=True)
class WheelPosition:
    """A corner and its wheel's position relative to the CG [m]: x forward, y left."""

    corner: str
    x: float
    y: float

    @property
    def side(self) -> str:
        """Track the wheel runs in: ``"left"`` or ``"right"``."""
        return "left" if self.y >= 0 else "right"


@dataclass(frozen=True)
class RoadLayout:
    """Corners of the vehicle on the road, and preview of ``preview_count`` heights ``preview_step`` seconds apart."""

    wheels: tuple[WheelPosition, ...]
    preview_count: int = 8
    preview_step: float = 0.010

    def __post_init__(self) -> None:
        if not self.wheels:
            raise ValueError("a road layout needs at least one wheel")
        if self.preview_count < 2 or not self.preview_step > 0:
            given = f"{self.preview_count} heights {self.preview_step:g} s apart"
            raise ValueError(f"preview of {given}: at least 2 are needed, a positive time apart")

    @classmethod
    def of(
        cls, vehicle: FullCar | RideCar | ThreeAxleCar, *, preview_count: int = 8, preview_step: float = 0.010
    ) -> RoadLayout:
        """Layout of a vehicle."""
        if not isinstance(vehicle, FullCar):
            corners = {c: getattr(vehicle.wheel, axle) for c, axle in vehicle.wheel.axle_of.items()}
            places = tuple(
                WheelPosition(c, w.x.value, (1 if c.endswith("l") else -1) * w.half_track.value)
                for c, w in corners.items()
            )
            return cls(places, preview_count, preview_step)
        body = vehicle.body
        front = body.cg_position.value * body.wheelbase.value
        rear = front - body.wheelbase.value
        half = body.track.value / 2
        wheels = (("fl", front, half), ("fr", front, -half), ("rl", rear, half), ("rr", rear, -half))
        return cls(tuple(WheelPosition(*w) for w in wheels), preview_count, preview_step)
