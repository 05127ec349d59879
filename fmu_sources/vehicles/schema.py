"""What a vehicle file must contain: every field with its unit, meaning and limits, declared here and nowhere else.

The FMI parameters of the plants are made from these declarations (`fmu_sources.vehicles.declare`), so name, unit,
limits and description of a parameter are those of the field in the file.
"""

from __future__ import annotations

from collections.abc import Mapping
from functools import lru_cache
from pathlib import Path
from typing import Any, ClassVar, Generic, TypeVar

from pydantic import Field, field_validator, model_validator
from pydantic_core import PydanticCustomError

from fmu_sources.models.corners import THREE_AXLES, TWO_AXLES
from fmu_sources.models.double_wishbone import POINTS, DoubleWishbone, HardpointError, WheelMotion, wheel_motion
from fmu_sources.tires.tir_file import Tire, TireError, read_tire
from fmu_sources.vehicles.devices import Actuator, SensorSet
from fmu_sources.vehicles.quantities import Numbers, Quantity, Section, Vehicle, quantity

_S = TypeVar("_S", bound=Section)


class Axles(Section):
    """A table with a field for each axle: values of one wheel of that axle, the same left and right.

    In the FMU each wheel has parameters of its own (`fl fr rl rr`), so that a car may differ from side to side.
    """

    axle_of: ClassVar[Mapping[str, str]]
    """Corner of the vehicle -> field of its axle."""


class TwoAxles(Axles, Generic[_S]):
    """A table with `front` and `rear`."""

    axle_of = TWO_AXLES
    front: _S
    rear: _S


class ThreeAxles(Axles, Generic[_S]):
    """A table with `a1`, `a2` and `a3`, counted from the front."""

    axle_of = THREE_AXLES
    a1: _S
    a2: _S
    a3: _S


class _Seat(Section):
    x: Quantity = quantity("m", -50.0, 50.0, "position of the driver's seat ahead of the CG", nominal=1.0)
    y: Quantity = quantity("m", -10.0, 10.0, "position of the driver's seat to the left of the CG", nominal=1.0)
    z: Quantity = quantity("m", -10.0, 10.0, "height of the driver's seat above the CG at rest", nominal=1.0)

    @classmethod
    def at_cg(cls) -> _Seat:
        """Of a file that does not say where it is."""
        here = Quantity(value=0.0, unit="m", source="assumed: no [seat] in the vehicle file, so the seat is at the CG")
        return cls(x=here, y=here, z=here)


# ---------------------------------------------------------------------------------------------------------- quarter car


class _QuarterBody(Section):
    mass: Quantity = quantity("kg", 1.0, 1e6, "sprung mass")


class _QuarterWheel(Section):
    mass: Quantity = quantity("kg", 0.1, 1e5, "unsprung mass")


class _Friction(Section):
    force: Quantity = quantity("N", 0.0, 1e6, "dry friction of the suspension", nominal=100.0)
    speed: Quantity = quantity("m/s", 1e-4, 1.0, "suspension velocity below which the sign of the friction is smoothed")


class _QuarterSuspension(Section):
    stiffness: Quantity = quantity("N/m", 0.0, 1e8, "suspension stiffness", display_unit="N/mm")
    damping: Quantity = quantity("N.s/m", 0.0, 1e7, "suspension damping", display_unit="kN.s/m")
    friction: _Friction | None = None


class _Tire(Section):
    stiffness: Quantity = quantity("N/m", 1.0, 1e8, "vertical tire stiffness", display_unit="N/mm")
    damping: Quantity = quantity("N.s/m", 0.0, 1e6, "vertical tire damping", display_unit="kN.s/m", nominal=100.0)


class QuarterCar(Vehicle):
    """Two masses above one tire."""

    body: _QuarterBody
    wheel: _QuarterWheel
    suspension: _QuarterSuspension
    tire: _Tire


# ------------------------------------------------------------------------------------------------------------- ride car


class _RideBody(Section):
    mass: Quantity = quantity("kg", 10.0, 1e6, "sprung mass")
    roll_inertia: Quantity = quantity("kg.m2", 1.0, 1e8, "roll inertia of the sprung mass about its CG")
    pitch_inertia: Quantity = quantity("kg.m2", 1.0, 1e8, "pitch inertia of the sprung mass about its CG")


class _RideWheel(Section):
    mass: Quantity = quantity("kg", 0.1, 1e5, "unsprung mass of one corner")
    x: Quantity = quantity("m", -50.0, 50.0, "position of the wheel ahead of the CG")
    half_track: Quantity = quantity("m", 0.0, 10.0, "distance of the wheel to the side of the CG")


# Named at module level, so that vehicles can be pickled.
_RideWheels = TwoAxles[_RideWheel]
_RideSuspensions = TwoAxles[_QuarterSuspension]
_RideTires = TwoAxles[_Tire]
_ThreeWheels = ThreeAxles[_RideWheel]
_ThreeSuspensions = ThreeAxles[_QuarterSuspension]
_ThreeTires = ThreeAxles[_Tire]


class RideCar(Vehicle):
    """A body that heaves, rolls and pitches above four wheels; all values act at the wheels."""

    tires_lift_off: bool = False  # start of the parameter of that name: tires take no tension
    body: _RideBody
    seat: _Seat = Field(default_factory=_Seat.at_cg)
    wheel: _RideWheels
    suspension: _RideSuspensions
    tire: _RideTires


class ThreeAxleCar(Vehicle):
    """A body that heaves, rolls and pitches above six wheels on three axles; all values act at the wheels."""

    tires_lift_off: bool = False  # start of the parameter of that name: tires take no tension
    body: _RideBody
    seat: _Seat = Field(default_factory=_Seat.at_cg)
    wheel: _ThreeWheels
    suspension: _ThreeSuspensions
    tire: _ThreeTires


# -------------------------------------------------------------------------------------------- three axles, with contact


class _TrenchBody(_RideBody):
    cg_height: Quantity = quantity("m", 0.0, 5.0, "height of the CG above the mean of the wheel centers at rest")
    cg_offset: Quantity = quantity(
        "m", -1.0, 1.0, "CG ahead of where wheel.*.x has it; wheels, seat and outline stay together", nominal=0.01
    )
    half_width: Quantity = quantity("m", 0.0, 5.0, "distance of the body's outline to the side of the CG")


class _Outline(Section):
    front_overhang: Quantity = quantity("m", 0.65, 5.0, "front bumper tip ahead of the first axle")
    rear_overhang: Quantity = quantity("m", 0.65, 5.0, "rear bumper tip behind the last axle")
    tip_height: Quantity = quantity("m", -5.0, 5.0, "height of the bumper tips above the CG")
    knee_distance: Quantity = quantity("m", 0.3, 0.6, "knee of the outline beyond the outer axles")
    knee_height: Quantity = quantity("m", -5.0, 5.0, "height of the knees above the CG")
    belly_distance: Quantity = quantity("m", -1.0, 0.3, "end of the flat belly beyond the outer axles")
    belly_height: Quantity = quantity("m", -5.0, 5.0, "height of the belly above the CG")


class _Contact(Section):
    stiffness: Quantity = quantity("N/m", 1e3, 1e9, "stiffness of the body where it touches the ground")
    damping: Quantity = quantity("N.s/m", 0.0, 1e7, "damping of the body where it touches the ground")
    onset: Quantity = quantity("m", 1e-5, 0.1, "penetration over which the damping sets in", display_unit="mm")
    friction: Quantity = quantity("1", 0.0, 5.0, "friction coefficient of the body on the ground")


class _Disc(Section):
    radius: Quantity = quantity("m", 0.1, 3.0, "radius of the unloaded wheel")
    rolling_loss: Quantity = quantity(
        "m", 0.0, 0.09, "unloaded radius minus rolling radius", display_unit="mm", nominal=0.01
    )
    bottoming: Quantity = quantity("m", 0.01, 1.0, "penetration at which the tire bottoms")
    bottoming_stiffness: Quantity = quantity("N/m", 0.0, 1e8, "stiffness that bottoming adds")
    onset: Quantity = quantity("m", 1e-5, 0.1, "penetration over which the tire damping sets in", display_unit="mm")
    friction: Quantity = quantity("1", 0.01, 5.0, "friction coefficient of the tires")
    slip_speed: Quantity = quantity("m/s", 0.01, 10.0, "sliding speed of the friction model tanh(sliding / slip_speed)")


class _StrutTravel(Section):
    extension: Quantity = quantity("m", 0.005, 1.0, "extension from rest at which a stop begins")
    compression: Quantity = quantity("m", 0.005, 1.0, "compression from rest at which a stop begins")
    stiffness: Quantity = quantity("N/m", 0.0, 1e8, "stiffness of the stops", display_unit="N/mm")
    damping: Quantity = quantity("N.s/m", 0.0, 1e6, "damping of the stops", display_unit="kN.s/m")
    onset: Quantity = quantity("m", 1e-5, 0.1, "travel over which the damping of a stop sets in", display_unit="mm")
    gas_exponent: Quantity = quantity("1", 1.0, 2.0, "polytropic exponent of the gas in a hydropneumatic strut")


class _Lidar(Section):
    ahead: Quantity = quantity("m", -5.0, 5.0, "nose lidar ahead of the first axle")
    height: Quantity = quantity("m", -5.0, 5.0, "height of the nose lidar above the CG")


class ThreeAxleTrenchCar(ThreeAxleCar):
    """The three-axle car with disc wheels, strut stops and a body that can touch the ground."""

    body: _TrenchBody
    outline: _Outline
    contact: _Contact
    disc: _Disc
    strut: _StrutTravel
    lidar: _Lidar

    def linear(self) -> ThreeAxleCar:
        """The car of small motions: without what only obstacles need, the wheels where `body.cg_offset` has them."""
        data = {n: value for n, value in self.model_dump().items() if n in ThreeAxleCar.model_fields}
        data |= {"kind": "three_axle", "body": {n: data["body"][n] for n in _RideBody.model_fields}}
        for part in (*data["wheel"].values(), data["seat"]):
            part["x"]["value"] -= self.body.cg_offset.value
        return ThreeAxleCar.model_validate(data)


# ------------------------------------------------------------------------------------------------------------- full car


class _Body(_RideBody):
    yaw_inertia: Quantity = quantity("kg.m2", 1.0, 1e8, "yaw inertia of the sprung mass about its CG")
    wheelbase: Quantity = quantity("m", 0.5, 20.0, "distance between the axles")
    track: Quantity = quantity("m", 0.3, 10.0, "distance between left and right wheels")
    cg_position: Quantity = quantity("1", 0.05, 0.95, "CG behind the front axle, as a part of the wheelbase")
    cg_height: Quantity = quantity("m", 0.05, 5.0, "height of the CG above the road at rest")


class _Wheel(Section):
    mass: Quantity = quantity("kg", 1.0, 1e5, "unsprung mass of one corner")
    radius: Quantity = quantity("m", 0.05, 3.0, "rolling radius")
    hub_height: Quantity = quantity("m", 0.05, 3.0, "height of the wheel center above the road at rest")
    spin_inertia: Quantity = quantity("kg.m2", 0.1, 1e4, "spin inertia of one wheel and its share of driveline")


class _Strut(Section):
    spring: Quantity = quantity("N/m", 0.0, 1e8, "stiffness of one spring, at the spring", display_unit="N/mm")
    damper: Quantity = quantity("N.s/m", 0.0, 1e7, "rate of one damper, at the damper", display_unit="kN.s/m")


class _Stop(Section):
    travel: Quantity = quantity("m", 0.005, 1.0, "wheel travel from ride height at which a stop begins")
    stiffness: Quantity = quantity("N/m", 0.0, 1e8, "linear stop stiffness, at the wheel", display_unit="N/mm")
    cubic: Quantity = quantity("N/m3", 0.0, 1e10, "cubic stop stiffness, at the wheel")


class _Suspension(Section):
    motion_ratio: Quantity = quantity("1", 0.01, 5.0, "spring (and damper) travel per wheel travel")
    front: _Strut
    rear: _Strut
    stop: _Stop


class _FormulaTire(Section):
    """Part of a tire: a tire property file may take the place of some fields."""

    by_file: ClassVar[tuple[str, ...]]
    """Fields that a file takes the place of; `declare` leaves them out then."""
    file: Tire | None = None

    @field_validator("file", mode="before")
    @classmethod
    def _read(cls, given: Any) -> Any:
        try:
            return read_tire(Path(given)) if isinstance(given, str) else given
        except TireError as error:
            raise PydanticCustomError("row", "{text}", {"text": str(error)}) from None


class _RollingTire(_FormulaTire, _Tire):
    by_file = ("slip_stiffness", "cornering_stiffness", "friction", "longitudinal_relaxation", "lateral_relaxation")
    slip_stiffness: Quantity = quantity("1", 0.0, 200.0, "longitudinal force per slip and load")
    cornering_stiffness: Quantity = quantity("1", 0.0, 200.0, "lateral force per slip angle and load")
    friction: Quantity = quantity("1", 0.01, 5.0, "friction coefficient")
    longitudinal_relaxation: Quantity = quantity("m", 0.05, 5.0, "relaxation length of the longitudinal slip")
    lateral_relaxation: Quantity = quantity("m", 0.05, 5.0, "relaxation length of the lateral slip")


class _SpeedControl(Section):
    gain: Quantity = quantity("1/s", 0.0, 50.0, "drive force per mass and speed error")
    integral_gain: Quantity = quantity("1/s2", 0.0, 50.0, "drive force per mass and integral of speed error")
    max_torque: Quantity = quantity("N.m", 0.0, 1e6, "largest drive or brake torque of one wheel")


class _Table(Section):
    """A table of two rows that have as many values each."""

    @model_validator(mode="after")
    def _as_long(self) -> Any:
        rows = {n: len(v.value) for n in type(self).model_fields if isinstance(v := getattr(self, n), Numbers)}
        if len(set(rows.values())) > 1:
            told = ", ".join(f"{n} has {size} values" for n, size in rows.items())
            raise PydanticCustomError("row", "{text}", {"text": f"{told}; rows of a table have the same number"})
        return self


class _Steering(Section):
    offset_gain: Quantity = quantity("rad/m", 0.0, 10.0, "steer angle per lateral offset")
    heading_gain: Quantity = quantity("1", 0.0, 10.0, "steer angle per heading error")
    yaw_rate_gain: Quantity = quantity("s", 0.0, 10.0, "steer angle per yaw rate")
    max_angle: Quantity = quantity("rad", 0.0, 1.2, "largest steer angle", display_unit="deg")
    ratio: Quantity = quantity("1", 1.0, 100.0, "angle of the steering wheel per steer angle", default=15.0)


class _AckermannSteering(_Steering):
    ackermann: Quantity = quantity(
        "1",
        0.0,
        1.0,
        "with steering.wheel: 0 steers both wheels alike, 1 toward one center of turn",
        nominal=1.0,
        default=1.0,
    )


def _bar(axle: str) -> Any:
    return quantity(
        "N/m",
        0.0,
        1e7,
        f"anti-roll bar of the {axle} axle: force at each wheel per difference of the travels left and right",
        nominal=1e4,
        display_unit="N/mm",
        default=0.0,
    )


class _AntiRoll(Section):
    front: Quantity = _bar("front")
    rear: Quantity = _bar("rear")


def _lock(of: str) -> Any:
    return quantity(
        "N.m.s/rad", 0.0, 2e3, f"{of} per difference of the speeds that it joins; 0: open", nominal=100.0, default=0.0
    )


class _Powertrain(_Table):
    speed: Numbers = quantity(
        "rad/s",
        0.0,
        1e4,
        "mean speed of the driven wheels, increasing from 0; the torque is linear between and constant beyond",
        increasing=True,
        nominal=10.0,
        default=(0.0, 20.0, 30.0, 40.0, 60.0, 80.0),
    )
    torque: Numbers = quantity(
        "N.m",
        0.0,
        1e6,
        "torque of all wheels together with full throttle, at that speed",
        display_unit="kN.m",
        nominal=1e3,
        default=(4500.0, 4500.0, 3000.0, 2300.0, 1550.0, 0.0),
    )
    front_share: Quantity = quantity(
        "1", 0.0, 1.0, "part of the torque that goes to the front axle", nominal=0.5, default=0.5
    )
    front_lock: Quantity = _lock("torque of the front differential lock")
    rear_lock: Quantity = _lock("torque of the rear differential lock")
    center_lock: Quantity = _lock("torque of the lock between the axles")


class _Brakes(Section):
    max_torque: Quantity = quantity(
        "N.m", 0.0, 1e6, "torque of all brakes together with the pedal down", display_unit="kN.m", default=1e4
    )
    front_share: Quantity = quantity(
        "1", 0.0, 1.0, "part of the brake torque that acts on the front axle", nominal=0.5, default=0.6
    )


class FullCar(Vehicle):
    """Two axles, four wheels, driver included."""

    body: _Body
    seat: _Seat = Field(default_factory=_Seat.at_cg)
    wheel: _Wheel
    suspension: _Suspension
    tire: _RollingTire
    speed_control: _SpeedControl
    steering: _AckermannSteering
    antiroll: _AntiRoll = Field(default_factory=_AntiRoll)
    powertrain: _Powertrain = Field(default_factory=_Powertrain)
    brakes: _Brakes = Field(default_factory=_Brakes)


# ----------------------------------------------------------------------------------------------------- double wishbones


class _SpringTable(_Table):
    free_length: Quantity = quantity("m", 0.01, 5.0, "length of the spring without load")
    compression: Numbers = quantity(
        "m",
        0.0,
        5.0,
        "compression of the spring from its free length, increasing from 0; the force is linear between and odd",
        increasing=True,
        display_unit="mm",
        nominal=0.1,
    )
    force: Numbers = quantity("N", 0.0, 1e7, "force of the spring at that compression", display_unit="kN", nominal=1e4)


class _LengthStop(Section):
    bump: Quantity = quantity("m", 0.0, 5.0, "length of the spring below which the bump stop is compressed")
    rebound: Quantity = quantity("m", 0.0, 5.0, "length of the spring above which the rebound stop is compressed")


class _StopTable(_Table):
    penetration: Numbers = quantity(
        "m",
        0.0,
        1.0,
        "compression of a stop, increasing from 0; the force is linear between and constant beyond",
        increasing=True,
        display_unit="mm",
        nominal=0.01,
    )
    force: Numbers = quantity("N", 0.0, 1e7, "force of a stop at that compression", display_unit="kN", nominal=1e4)


class _SwitchedDamper(Section):
    compression: Quantity = quantity(
        "N.s/m", 0.0, 1e7, "rate in compression within the range of lengths", display_unit="kN.s/m"
    )
    rebound: Quantity = quantity(
        "N.s/m", 0.0, 1e7, "rate in rebound within the range of lengths", display_unit="kN.s/m"
    )
    outer_compression: Quantity = quantity(
        "N.s/m", 0.0, 1e7, "rate in compression outside of the range", display_unit="kN.s/m"
    )
    outer_rebound: Quantity = quantity("N.s/m", 0.0, 1e7, "rate in rebound outside of the range", display_unit="kN.s/m")


class _DamperRange(Section):
    least: Quantity = quantity("m", 0.0, 5.0, "length at which the range of the inner rates begins")
    most: Quantity = quantity("m", 0.0, 5.0, "length at which it ends")
    blend: Quantity = quantity("m", 1e-5, 0.1, "length over which the rates change at either end", display_unit="mm")


def _point(what: str) -> Any:
    return quantity(
        "m", -50.0, 50.0, f"{what}, left side: forward, left, up from the reference point of the axle", size=3
    )


class _Hardpoints(Section):
    wheel_centre: Numbers = _point("wheel center")
    upright_com: Numbers = _point("center of mass of the upright")
    upper_front: Numbers = _point("front pivot of the upper arm")
    upper_rear: Numbers = _point("rear pivot of the upper arm")
    upper_ball: Numbers = _point("upper ball joint")
    upper_com: Numbers = _point("center of mass of the upper arm")
    lower_front: Numbers = _point("front pivot of the lower arm")
    lower_rear: Numbers = _point("rear pivot of the lower arm")
    lower_ball: Numbers = _point("lower ball joint")
    lower_com: Numbers = _point("center of mass of the lower arm")
    damper_top: Numbers = _point("damper on the chassis")
    damper_bottom: Numbers = _point("damper on the lower arm")
    spring_top: Numbers = _point("spring on the chassis")
    spring_bottom: Numbers = _point("spring on the lower arm")
    tierod_inner: Numbers = _point("tierod on the chassis")
    tierod_outer: Numbers = _point("tierod on the upright")


class _Travel(Section):
    least: Quantity = quantity(
        "m", -2.0, -0.01, "travel of the wheel from design to which the kinematics are computed, down"
    )
    most: Quantity = quantity(
        "m", 0.01, 2.0, "travel of the wheel from design to which the kinematics are computed, up"
    )


class _WishboneAxle(Section):
    reference: Quantity = quantity(
        "m", -50.0, 50.0, "reference point of the axle's hardpoints ahead of the chassis frame"
    )
    travel: _Travel
    points: _Hardpoints
    spring: _SpringTable
    stop: _LengthStop
    damper: _SwitchedDamper

    @property
    def mechanism(self) -> DoubleWishbone:
        """The kinematics of the left side, in the frame of the reference point."""
        return _mechanism(tuple(getattr(self.points, n).value for n in POINTS))

    @property
    def motion(self) -> WheelMotion:
        """The motion of the left wheel over its travel."""
        return _motion(self.mechanism, self.travel.least.value, self.travel.most.value)

    @model_validator(mode="after")
    def _closes(self) -> Any:
        try:
            self.motion  # noqa: B018 -- computing it is the check
        except HardpointError as error:
            raise PydanticCustomError("row", "{text}", {"text": f"points: {error}"}) from None
        return self


@lru_cache(maxsize=16)
def _mechanism(points: tuple[tuple[float, ...], ...]) -> DoubleWishbone:
    return DoubleWishbone(dict(zip(POINTS, points, strict=True)))


@lru_cache(maxsize=16)
def _motion(mechanism: DoubleWishbone, least: float, most: float) -> WheelMotion:
    return wheel_motion(mechanism, least, most)


class _Wishbones(Section):
    front: _WishboneAxle
    rear: _WishboneAxle
    stop: _StopTable
    damper_range: _DamperRange


class _FramedBody(Section):
    mass: Quantity = quantity("kg", 10.0, 1e6, "mass of the chassis body")
    com_x: Quantity = quantity(
        "m", -50.0, 50.0, "its center of mass ahead of the origin of the chassis frame", nominal=0.1
    )
    com_z: Quantity = quantity(
        "m", -10.0, 10.0, "its center of mass above the origin of the chassis frame", nominal=0.1
    )
    roll_inertia: Quantity = quantity("kg.m2", 1.0, 1e8, "roll inertia of the chassis body about its center of mass")
    pitch_inertia: Quantity = quantity("kg.m2", 1.0, 1e8, "pitch inertia of the chassis body about its center of mass")
    yaw_inertia: Quantity = quantity("kg.m2", 1.0, 1e8, "yaw inertia of the chassis body about its center of mass")


class _Mounted(Section):
    mass: Quantity = quantity("kg", 0.0, 1e5, "mass of a part on the chassis")
    position: Numbers = quantity("m", -50.0, 50.0, "its position in the chassis frame", size=3)


class _SteeringGear(Section):
    link: _Mounted
    pitman: _Mounted


class _SolidWheel(Section):
    mass: Quantity = quantity("kg", 1.0, 1e5, "mass of wheel, tire and spindle")
    spin_inertia: Quantity = quantity("kg.m2", 0.01, 1e4, "inertia of wheel, tire and spindle about the axle")
    tilt_inertia: Quantity = quantity("kg.m2", 0.0, 1e4, "inertia of wheel, tire and spindle about a diameter")
    shaft_inertia: Quantity = quantity("kg.m2", 0.0, 1e4, "inertia of the axle shaft, reduced to the wheel")


class _Solid(Section):
    mass: Quantity = quantity("kg", 0.0, 1e5, "mass")
    inertia: Numbers = quantity(
        "kg.m2", 0.0, 1e6, "moments of inertia about its center of mass, along its axes", size=3
    )


class _TableTire(_FormulaTire, _Table):
    by_file = (
        *("slip_stiffness", "cornering_stiffness", "longitudinal_friction", "lateral_friction"),
        *("rolling_resistance", "relaxation"),
    )
    radius: Quantity = quantity("m", 0.05, 3.0, "radius of the unloaded tire")
    deflection: Numbers = quantity(
        "m",
        0.0,
        3.0,
        "deflection of the tire on a flat road, increasing from 0; the force is linear between and continues so beyond",
        increasing=True,
        display_unit="mm",
        nominal=0.1,
    )
    force: Numbers = quantity("N", 0.0, 1e7, "vertical force at that deflection", display_unit="kN", nominal=1e4)
    damping: Quantity = quantity("N.s/m", 0.0, 1e6, "vertical damping in contact", display_unit="kN.s/m", nominal=100.0)
    slip_stiffness: Quantity = quantity("1", 0.0, 200.0, "longitudinal force per slip and load")
    cornering_stiffness: Quantity = quantity("1", 0.0, 200.0, "lateral force per slip angle and load")
    longitudinal_friction: Quantity = quantity("1", 0.01, 5.0, "largest longitudinal force per load")
    lateral_friction: Quantity = quantity("1", 0.01, 5.0, "largest lateral force per load")
    rolling_resistance: Quantity = quantity("1", 0.0, 1.0, "rolling resistance per load")
    relaxation: Quantity = quantity("m", 0.05, 5.0, "relaxation length of the longitudinal slip")


class _ForceDriver(Section):
    gain: Quantity = quantity("N.s/m", 0.0, 1e7, "drive force per speed error")
    integral_gain: Quantity = quantity("N/m", 0.0, 1e7, "drive force per integral of the speed error")
    max_force: Quantity = quantity("N", 0.0, 1e7, "largest drive or brake force", display_unit="kN")
    lever: Quantity = quantity("m", 0.01, 5.0, "torque of all wheels per drive force")


class WishboneCar(Vehicle):
    """Two axles of double wishbones with hardpoints, tables of springs, stops and tires; driver included.

    The chassis frame has its origin where the file counts positions from, x forward, y left, z up.
    """

    body: _FramedBody
    steering_gear: _SteeringGear
    seat: _Seat = Field(default_factory=_Seat.at_cg)
    wheel: _SolidWheel
    upright: _Solid
    upper_arm: _Solid
    lower_arm: _Solid
    suspension: _Wishbones
    tire: _TableTire
    speed_control: _ForceDriver
    steering: _Steering
    antiroll: _AntiRoll = Field(default_factory=_AntiRoll)
    powertrain: _Powertrain = Field(default_factory=_Powertrain)
    brakes: _Brakes = Field(default_factory=_Brakes)

    def wheel_place(self, axle: str) -> tuple[float, float]:
        """Where the left wheel of an axle is at design: ahead of the CG and to its left [m]."""
        given = getattr(self.suspension, axle)
        forward, left, _ = given.points.wheel_centre.value
        return given.reference.value + forward - self.body.com_x.value, left


KINDS: dict[str, type[Vehicle]] = {
    "quarter_car": QuarterCar,
    "ride_car": RideCar,
    "three_axle": ThreeAxleCar,
    "three_axle_trench": ThreeAxleTrenchCar,
    "full_car": FullCar,
    "wishbone_car": WishboneCar,
    "actuator": Actuator,
    "sensors": SensorSet,
}
