"""What a vehicle file must contain: every field with its unit, meaning and limits, declared here and nowhere else.

The FMI parameters of the plants are made from these declarations (`fmu_sources.vehicles.declare`), so name, unit,
limits and description of a parameter are those of the field in the file.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache
from itertools import pairwise
from pathlib import Path
from typing import Annotated, Any, ClassVar

from pydantic import BaseModel, ConfigDict, Field, ValidationInfo, field_validator, model_validator
from pydantic_core import PydanticCustomError

from build_fmus.base import units
from build_fmus.component import source_fault, text_fault
from fmu_sources.models.corners import THREE_AXLES, TWO_AXLES
from fmu_sources.models.double_wishbone import POINTS, DoubleWishbone, HardpointError, WheelMotion, wheel_motion
from fmu_sources.tires.tir_file import Tire, TireError, read_tire


@dataclass(frozen=True)
class Declared:
    """Unit, limits, display unit and usual size of a field; the description stands in the pydantic field."""

    unit: str
    min: float
    max: float
    display_unit: str | None = None
    nominal: float | None = None
    size: int | None = None
    increasing: bool = False


class Quantity(BaseModel):
    """One value of a vehicle file. `value` is in the unit of the field's declaration once the file is loaded."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    value: float = Field(allow_inf_nan=False)
    unit: str
    source: str

    @field_validator("source")
    @classmethod
    def _is_one(cls, given: str) -> str:
        if fault := source_fault(given):
            raise PydanticCustomError("source", "{text}", {"text": fault})
        return given


class Numbers(BaseModel):
    """Several values of one unit in a vehicle file: the coordinates of a point, or a row of a table."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    value: tuple[Annotated[float, Field(allow_inf_nan=False)], ...]
    unit: str
    source: str

    _is_one = field_validator("source")(Quantity._is_one.__func__)  # type: ignore[attr-defined]


def quantity(
    unit: str,
    description: str,
    *,
    min: float,
    max: float,
    display_unit: str | None = None,
    nominal: float | None = None,
    size: int | None = None,
    increasing: bool = False,
    default: float | tuple[float, ...] | None = None,
) -> Any:
    """Declare a field of type `Quantity` or `Numbers`.

    `nominal` is for values that may well be 0. Of `Numbers`, `size`: how many (None: two at least); `increasing`: where
    a table relies on it. `default`: of files without this field, in `unit`; None: every file has it.
    """
    declared = Declared(unit, min, max, display_unit, nominal, size, increasing)
    given: dict[str, Any] = {}
    if default is not None:
        kind = Numbers if isinstance(default, tuple) else Quantity
        given["default"] = kind(value=default, unit=unit, source="assumed: not in the vehicle file")  # type: ignore[arg-type]
    return Field(description=description, json_schema_extra={"declared": declared}, **given)  # type: ignore[dict-item]


class Section(BaseModel):
    """A table of a vehicle file. Unknown fields are refused; units are converted; limits are checked."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    @classmethod
    def declared(cls, field: str) -> Declared | None:
        """Declaration of a quantity field, None for anything else."""
        extra = cls.model_fields[field].json_schema_extra
        return extra.get("declared") if isinstance(extra, dict) else None  # type: ignore[return-value]

    @field_validator("*", mode="after")
    @classmethod
    def _in_declared_unit(cls, given: Any, info: ValidationInfo) -> Any:
        if not isinstance(given, Quantity | Numbers):
            return given
        declared = cls.declared(info.field_name or "")
        assert declared is not None, f"{cls.__name__}.{info.field_name}: declare it with quantity()"
        if isinstance(given, Quantity):
            return Quantity(
                value=_converted(declared, given.value, given.unit), unit=declared.unit, source=given.source
            )
        values = tuple(_converted(declared, v, given.unit, f"value {i}: ") for i, v in enumerate(given.value, 1))
        if fault := _row_fault(declared, values):
            raise PydanticCustomError("row", "{text}", {"text": fault})
        return Numbers(value=values, unit=declared.unit, source=given.source)


def _converted(declared: Declared, given: float, unit: str, where: str = "") -> float:
    """A value of a file in the declared unit; what is wrong with it as a pydantic error."""
    try:
        value = units.convert(given, unit, declared.unit)
    except KeyError as error:
        raise PydanticCustomError("unit", "{text}", {"text": error.args[0]}) from None
    if not declared.min <= value <= declared.max:
        word, bound = ("least", declared.min) if value < declared.min else ("most", declared.max)
        text = f"{where}{given:g} {unit} is out of range: it must be at {word} {bound:g} {declared.unit}"
        raise PydanticCustomError("limit", "{text}", {"text": text})
    return value


def _row_fault(declared: Declared, values: tuple[float, ...]) -> str:
    """What is wrong with the values of a row together; empty when nothing is."""
    if declared.size is not None and len(values) != declared.size:
        return f"{len(values)} values; {declared.size} are needed"
    if len(values) < 2:
        return f"{len(values)} value(s); two at least are needed"
    if declared.increasing:
        for i, (before, after) in enumerate(pairwise(values), 1):
            if after <= before:
                return (
                    f"value {i + 1} is {after:g} {declared.unit} after {before:g} {declared.unit}; the values of this"
                    " row must increase"
                )
    return ""


class Axles(Section):
    """A table with `front` and `rear`: values of one wheel of that axle, the same left and right.

    In the FMU each wheel has parameters of its own (`fl fr rl rr`), so that a car may differ from side to side.
    """

    axle_of: ClassVar[Mapping[str, str]] = TWO_AXLES
    """Corner of the vehicle -> field of its axle."""


class ThreeAxles(Axles):
    """A table with `a1`, `a2` and `a3`, counted from the front: values of one wheel of that axle."""

    axle_of = THREE_AXLES


class Vehicle(Section):
    """Head of every vehicle file."""

    kind: str
    name: str = Field(min_length=1)
    description: str = Field(min_length=1)

    @field_validator("name", "description")
    @classmethod
    def _can_be_held(cls, given: str) -> str:
        if fault := text_fault(given):
            raise PydanticCustomError("source", "{text}", {"text": fault})
        return given


class _Seat(Section):
    x: Quantity = quantity("m", "position of the driver's seat ahead of the CG", min=-50.0, max=50.0, nominal=1.0)
    y: Quantity = quantity("m", "position of the driver's seat to the left of the CG", min=-10.0, max=10.0, nominal=1.0)
    z: Quantity = quantity("m", "height of the driver's seat above the CG at rest", min=-10.0, max=10.0, nominal=1.0)

    @classmethod
    def at_cg(cls) -> _Seat:
        """Of a file that does not say where it is."""
        here = Quantity(value=0.0, unit="m", source="assumed: no [seat] in the vehicle file, so the seat is at the CG")
        return cls(x=here, y=here, z=here)


# ---------------------------------------------------------------------------------------------------------- quarter car


class _QuarterBody(Section):
    mass: Quantity = quantity("kg", "sprung mass", min=1.0, max=1e6)


class _QuarterWheel(Section):
    mass: Quantity = quantity("kg", "unsprung mass", min=0.1, max=1e5)


class _Friction(Section):
    force: Quantity = quantity("N", "dry friction of the suspension", min=0.0, max=1e6, nominal=100.0)
    speed: Quantity = quantity(
        "m/s", "suspension velocity below which the sign of the friction is smoothed", min=1e-4, max=1.0
    )


class _QuarterSuspension(Section):
    stiffness: Quantity = quantity("N/m", "suspension stiffness", min=0.0, max=1e8, display_unit="N/mm")
    damping: Quantity = quantity("N.s/m", "suspension damping", min=0.0, max=1e7, display_unit="kN.s/m")
    friction: _Friction | None = None


class _Tire(Section):
    stiffness: Quantity = quantity("N/m", "vertical tire stiffness", min=1.0, max=1e8, display_unit="N/mm")
    damping: Quantity = quantity(
        "N.s/m", "vertical tire damping", min=0.0, max=1e6, display_unit="kN.s/m", nominal=100.0
    )


class QuarterCar(Vehicle):
    """Two masses above one tire."""

    body: _QuarterBody
    wheel: _QuarterWheel
    suspension: _QuarterSuspension
    tire: _Tire


# ------------------------------------------------------------------------------------------------------------- ride car


class _RideBody(Section):
    mass: Quantity = quantity("kg", "sprung mass", min=10.0, max=1e6)
    roll_inertia: Quantity = quantity("kg.m2", "roll inertia of the sprung mass about its CG", min=1.0, max=1e8)
    pitch_inertia: Quantity = quantity("kg.m2", "pitch inertia of the sprung mass about its CG", min=1.0, max=1e8)


class _RideWheel(Section):
    mass: Quantity = quantity("kg", "unsprung mass of one corner", min=0.1, max=1e5)
    x: Quantity = quantity("m", "position of the wheel ahead of the CG", min=-50.0, max=50.0)
    half_track: Quantity = quantity("m", "distance of the wheel to the side of the CG", min=0.0, max=10.0)


class _RideWheels(Axles):
    front: _RideWheel
    rear: _RideWheel


class _RideSuspensions(Axles):
    front: _QuarterSuspension
    rear: _QuarterSuspension


class _RideTires(Axles):
    front: _Tire
    rear: _Tire


class RideCar(Vehicle):
    """A body that heaves, rolls and pitches above four wheels; all values act at the wheels."""

    tires_lift_off: bool = False  # start of the parameter of that name: tires take no tension
    body: _RideBody
    seat: _Seat = Field(default_factory=_Seat.at_cg)
    wheel: _RideWheels
    suspension: _RideSuspensions
    tire: _RideTires


class _ThreeWheels(ThreeAxles):
    a1: _RideWheel
    a2: _RideWheel
    a3: _RideWheel


class _ThreeSuspensions(ThreeAxles):
    a1: _QuarterSuspension
    a2: _QuarterSuspension
    a3: _QuarterSuspension


class _ThreeTires(ThreeAxles):
    a1: _Tire
    a2: _Tire
    a3: _Tire


class ThreeAxleCar(Vehicle):
    """A body that heaves, rolls and pitches above six wheels on three axles; all values act at the wheels."""

    tires_lift_off: bool = False  # start of the parameter of that name: tires take no tension
    body: _RideBody
    seat: _Seat = Field(default_factory=_Seat.at_cg)
    wheel: _ThreeWheels
    suspension: _ThreeSuspensions
    tire: _ThreeTires


# ------------------------------------------------------------------------------------------------ three axles, with
# contact


class _TrenchBody(_RideBody):
    cg_height: Quantity = quantity(
        "m", "height of the CG above the mean of the wheel centers at rest", min=0.0, max=5.0
    )
    cg_offset: Quantity = quantity(
        "m",
        "CG ahead of where wheel.*.x has it; wheels, seat and outline stay together",
        min=-1.0,
        max=1.0,
        nominal=0.01,
    )
    half_width: Quantity = quantity("m", "distance of the body's outline to the side of the CG", min=0.0, max=5.0)


class _Outline(Section):
    front_overhang: Quantity = quantity("m", "front bumper tip ahead of the first axle", min=0.65, max=5.0)
    rear_overhang: Quantity = quantity("m", "rear bumper tip behind the last axle", min=0.65, max=5.0)
    tip_height: Quantity = quantity("m", "height of the bumper tips above the CG", min=-5.0, max=5.0)
    knee_distance: Quantity = quantity("m", "knee of the outline beyond the outer axles", min=0.3, max=0.6)
    knee_height: Quantity = quantity("m", "height of the knees above the CG", min=-5.0, max=5.0)
    belly_distance: Quantity = quantity("m", "end of the flat belly beyond the outer axles", min=-1.0, max=0.3)
    belly_height: Quantity = quantity("m", "height of the belly above the CG", min=-5.0, max=5.0)


class _Contact(Section):
    stiffness: Quantity = quantity("N/m", "stiffness of the body where it touches the ground", min=1e3, max=1e9)
    damping: Quantity = quantity("N.s/m", "damping of the body where it touches the ground", min=0.0, max=1e7)
    onset: Quantity = quantity("m", "penetration over which the damping sets in", min=1e-5, max=0.1, display_unit="mm")
    friction: Quantity = quantity("1", "friction coefficient of the body on the ground", min=0.0, max=5.0)


class _Disc(Section):
    radius: Quantity = quantity("m", "radius of the unloaded wheel", min=0.1, max=3.0)
    rolling_loss: Quantity = quantity(
        "m", "unloaded radius minus rolling radius", min=0.0, max=0.09, display_unit="mm", nominal=0.01
    )
    bottoming: Quantity = quantity("m", "penetration at which the tire bottoms", min=0.01, max=1.0)
    bottoming_stiffness: Quantity = quantity("N/m", "stiffness that bottoming adds", min=0.0, max=1e8)
    onset: Quantity = quantity(
        "m", "penetration over which the tire damping sets in", min=1e-5, max=0.1, display_unit="mm"
    )
    friction: Quantity = quantity("1", "friction coefficient of the tires", min=0.01, max=5.0)
    slip_speed: Quantity = quantity(
        "m/s", "sliding speed of the friction model tanh(sliding / slip_speed)", min=0.01, max=10.0
    )


class _StrutTravel(Section):
    extension: Quantity = quantity("m", "extension from rest at which a stop begins", min=0.005, max=1.0)
    compression: Quantity = quantity("m", "compression from rest at which a stop begins", min=0.005, max=1.0)
    stiffness: Quantity = quantity("N/m", "stiffness of the stops", min=0.0, max=1e8, display_unit="N/mm")
    damping: Quantity = quantity("N.s/m", "damping of the stops", min=0.0, max=1e6, display_unit="kN.s/m")
    onset: Quantity = quantity(
        "m", "travel over which the damping of a stop sets in", min=1e-5, max=0.1, display_unit="mm"
    )
    gas_exponent: Quantity = quantity("1", "polytropic exponent of the gas in a hydropneumatic strut", min=1.0, max=2.0)


class _Lidar(Section):
    ahead: Quantity = quantity("m", "nose lidar ahead of the first axle", min=-5.0, max=5.0)
    height: Quantity = quantity("m", "height of the nose lidar above the CG", min=-5.0, max=5.0)


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
    yaw_inertia: Quantity = quantity("kg.m2", "yaw inertia of the sprung mass about its CG", min=1.0, max=1e8)
    wheelbase: Quantity = quantity("m", "distance between the axles", min=0.5, max=20.0)
    track: Quantity = quantity("m", "distance between left and right wheels", min=0.3, max=10.0)
    cg_position: Quantity = quantity("1", "CG behind the front axle, as a part of the wheelbase", min=0.05, max=0.95)
    cg_height: Quantity = quantity("m", "height of the CG above the road at rest", min=0.05, max=5.0)


class _Wheel(Section):
    mass: Quantity = quantity("kg", "unsprung mass of one corner", min=1.0, max=1e5)
    radius: Quantity = quantity("m", "rolling radius", min=0.05, max=3.0)
    hub_height: Quantity = quantity("m", "height of the wheel center above the road at rest", min=0.05, max=3.0)
    spin_inertia: Quantity = quantity("kg.m2", "spin inertia of one wheel and its share of driveline", min=0.1, max=1e4)


class _Strut(Section):
    spring: Quantity = quantity("N/m", "stiffness of one spring, at the spring", min=0.0, max=1e8, display_unit="N/mm")
    damper: Quantity = quantity("N.s/m", "rate of one damper, at the damper", min=0.0, max=1e7, display_unit="kN.s/m")


class _Stop(Section):
    travel: Quantity = quantity("m", "wheel travel from ride height at which a stop begins", min=0.005, max=1.0)
    stiffness: Quantity = quantity("N/m", "linear stop stiffness, at the wheel", min=0.0, max=1e8, display_unit="N/mm")
    cubic: Quantity = quantity("N/m3", "cubic stop stiffness, at the wheel", min=0.0, max=1e10)


class _Suspension(Section):
    motion_ratio: Quantity = quantity("1", "spring (and damper) travel per wheel travel", min=0.01, max=5.0)
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
    slip_stiffness: Quantity = quantity("1", "longitudinal force per slip and load", min=0.0, max=200.0)
    cornering_stiffness: Quantity = quantity("1", "lateral force per slip angle and load", min=0.0, max=200.0)
    friction: Quantity = quantity("1", "friction coefficient", min=0.01, max=5.0)
    longitudinal_relaxation: Quantity = quantity("m", "relaxation length of the longitudinal slip", min=0.05, max=5.0)
    lateral_relaxation: Quantity = quantity("m", "relaxation length of the lateral slip", min=0.05, max=5.0)


class _SpeedControl(Section):
    gain: Quantity = quantity("1/s", "drive force per mass and speed error", min=0.0, max=50.0)
    integral_gain: Quantity = quantity("1/s2", "drive force per mass and integral of speed error", min=0.0, max=50.0)
    max_torque: Quantity = quantity("N.m", "largest drive or brake torque of one wheel", min=0.0, max=1e6)


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
    offset_gain: Quantity = quantity("rad/m", "steer angle per lateral offset", min=0.0, max=10.0)
    heading_gain: Quantity = quantity("1", "steer angle per heading error", min=0.0, max=10.0)
    yaw_rate_gain: Quantity = quantity("s", "steer angle per yaw rate", min=0.0, max=10.0)
    max_angle: Quantity = quantity("rad", "largest steer angle", min=0.0, max=1.2, display_unit="deg")
    ratio: Quantity = quantity("1", "angle of the steering wheel per steer angle", min=1.0, max=100.0, default=15.0)


class _AckermannSteering(_Steering):
    ackermann: Quantity = quantity(
        "1",
        "with steering.wheel: 0 steers both wheels alike, 1 toward one center of turn",
        min=0.0,
        max=1.0,
        nominal=1.0,
        default=1.0,
    )


class _AntiRoll(Section):
    front: Quantity = quantity(
        "N/m",
        "anti-roll bar of the front axle: force at each wheel per difference of the travels left and right",
        min=0.0,
        max=1e7,
        nominal=1e4,
        display_unit="N/mm",
        default=0.0,
    )
    rear: Quantity = quantity(
        "N/m",
        "anti-roll bar of the rear axle: force at each wheel per difference of the travels left and right",
        min=0.0,
        max=1e7,
        nominal=1e4,
        display_unit="N/mm",
        default=0.0,
    )


def _lock(of: str) -> Any:
    return quantity(
        "N.m.s/rad",
        f"{of} per difference of the speeds that it joins; 0: open",
        min=0.0,
        max=2e3,
        nominal=100.0,
        default=0.0,
    )


class _Powertrain(_Table):
    speed: Numbers = quantity(
        "rad/s",
        "mean speed of the driven wheels, increasing from 0; the torque is linear between and constant beyond",
        min=0.0,
        max=1e4,
        increasing=True,
        nominal=10.0,
        default=(0.0, 20.0, 30.0, 40.0, 60.0, 80.0),
    )
    torque: Numbers = quantity(
        "N.m",
        "torque of all wheels together with full throttle, at that speed",
        min=0.0,
        max=1e6,
        display_unit="kN.m",
        nominal=1e3,
        default=(4500.0, 4500.0, 3000.0, 2300.0, 1550.0, 0.0),
    )
    front_share: Quantity = quantity(
        "1", "part of the torque that goes to the front axle", min=0.0, max=1.0, nominal=0.5, default=0.5
    )
    front_lock: Quantity = _lock("torque of the front differential lock")
    rear_lock: Quantity = _lock("torque of the rear differential lock")
    center_lock: Quantity = _lock("torque of the lock between the axles")


class _Brakes(Section):
    max_torque: Quantity = quantity(
        "N.m", "torque of all brakes together with the pedal down", min=0.0, max=1e6, display_unit="kN.m", default=1e4
    )
    front_share: Quantity = quantity(
        "1", "part of the brake torque that acts on the front axle", min=0.0, max=1.0, nominal=0.5, default=0.6
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


# ------------------------------------------------------------------------------------------------------ double
# wishbones


class _SpringTable(_Table):
    free_length: Quantity = quantity("m", "length of the spring without load", min=0.01, max=5.0)
    compression: Numbers = quantity(
        "m",
        "compression of the spring from its free length, increasing from 0; the force is linear between and odd",
        min=0.0,
        max=5.0,
        increasing=True,
        display_unit="mm",
        nominal=0.1,
    )
    force: Numbers = quantity(
        "N", "force of the spring at that compression", min=0.0, max=1e7, display_unit="kN", nominal=1e4
    )


class _LengthStop(Section):
    bump: Quantity = quantity("m", "length of the spring below which the bump stop is compressed", min=0.0, max=5.0)
    rebound: Quantity = quantity(
        "m", "length of the spring above which the rebound stop is compressed", min=0.0, max=5.0
    )


class _StopTable(_Table):
    penetration: Numbers = quantity(
        "m",
        "compression of a stop, increasing from 0; the force is linear between and constant beyond",
        min=0.0,
        max=1.0,
        increasing=True,
        display_unit="mm",
        nominal=0.01,
    )
    force: Numbers = quantity(
        "N", "force of a stop at that compression", min=0.0, max=1e7, display_unit="kN", nominal=1e4
    )


class _SwitchedDamper(Section):
    compression: Quantity = quantity(
        "N.s/m", "rate in compression within the range of lengths", min=0.0, max=1e7, display_unit="kN.s/m"
    )
    rebound: Quantity = quantity(
        "N.s/m", "rate in rebound within the range of lengths", min=0.0, max=1e7, display_unit="kN.s/m"
    )
    outer_compression: Quantity = quantity(
        "N.s/m", "rate in compression outside of the range", min=0.0, max=1e7, display_unit="kN.s/m"
    )
    outer_rebound: Quantity = quantity(
        "N.s/m", "rate in rebound outside of the range", min=0.0, max=1e7, display_unit="kN.s/m"
    )


class _DamperRange(Section):
    least: Quantity = quantity("m", "length at which the range of the inner rates begins", min=0.0, max=5.0)
    most: Quantity = quantity("m", "length at which it ends", min=0.0, max=5.0)
    blend: Quantity = quantity(
        "m", "length over which the rates change at either end", min=1e-5, max=0.1, display_unit="mm"
    )


def _point(what: str) -> Any:
    return quantity(
        "m", f"{what}, left side: forward, left, up from the reference point of the axle", min=-50.0, max=50.0, size=3
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
        "m", "travel of the wheel from design to which the kinematics are computed, down", min=-2.0, max=-0.01
    )
    most: Quantity = quantity(
        "m", "travel of the wheel from design to which the kinematics are computed, up", min=0.01, max=2.0
    )


class _WishboneAxle(Section):
    reference: Quantity = quantity(
        "m", "reference point of the axle's hardpoints ahead of the chassis frame", min=-50.0, max=50.0
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
    mass: Quantity = quantity("kg", "mass of the chassis body", min=10.0, max=1e6)
    com_x: Quantity = quantity(
        "m", "its center of mass ahead of the origin of the chassis frame", min=-50.0, max=50.0, nominal=0.1
    )
    com_z: Quantity = quantity(
        "m", "its center of mass above the origin of the chassis frame", min=-10.0, max=10.0, nominal=0.1
    )
    roll_inertia: Quantity = quantity(
        "kg.m2", "roll inertia of the chassis body about its center of mass", min=1.0, max=1e8
    )
    pitch_inertia: Quantity = quantity(
        "kg.m2", "pitch inertia of the chassis body about its center of mass", min=1.0, max=1e8
    )
    yaw_inertia: Quantity = quantity(
        "kg.m2", "yaw inertia of the chassis body about its center of mass", min=1.0, max=1e8
    )


class _Mounted(Section):
    mass: Quantity = quantity("kg", "mass of a part on the chassis", min=0.0, max=1e5)
    position: Numbers = quantity("m", "its position in the chassis frame", min=-50.0, max=50.0, size=3)


class _SteeringGear(Section):
    link: _Mounted
    pitman: _Mounted


class _SolidWheel(Section):
    mass: Quantity = quantity("kg", "mass of wheel, tire and spindle", min=1.0, max=1e5)
    spin_inertia: Quantity = quantity("kg.m2", "inertia of wheel, tire and spindle about the axle", min=0.01, max=1e4)
    tilt_inertia: Quantity = quantity("kg.m2", "inertia of wheel, tire and spindle about a diameter", min=0.0, max=1e4)
    shaft_inertia: Quantity = quantity("kg.m2", "inertia of the axle shaft, reduced to the wheel", min=0.0, max=1e4)


class _Solid(Section):
    mass: Quantity = quantity("kg", "mass", min=0.0, max=1e5)
    inertia: Numbers = quantity(
        "kg.m2", "moments of inertia about its center of mass, along its axes", min=0.0, max=1e6, size=3
    )


class _TableTire(_FormulaTire, _Table):
    by_file = (
        *("slip_stiffness", "cornering_stiffness", "longitudinal_friction", "lateral_friction"),
        *("rolling_resistance", "relaxation"),
    )
    radius: Quantity = quantity("m", "radius of the unloaded tire", min=0.05, max=3.0)
    deflection: Numbers = quantity(
        "m",
        "deflection of the tire on a flat road, increasing from 0; the force is linear between and continues so beyond",
        min=0.0,
        max=3.0,
        increasing=True,
        display_unit="mm",
        nominal=0.1,
    )
    force: Numbers = quantity(
        "N", "vertical force at that deflection", min=0.0, max=1e7, display_unit="kN", nominal=1e4
    )
    damping: Quantity = quantity(
        "N.s/m", "vertical damping in contact", min=0.0, max=1e6, display_unit="kN.s/m", nominal=100.0
    )
    slip_stiffness: Quantity = quantity("1", "longitudinal force per slip and load", min=0.0, max=200.0)
    cornering_stiffness: Quantity = quantity("1", "lateral force per slip angle and load", min=0.0, max=200.0)
    longitudinal_friction: Quantity = quantity("1", "largest longitudinal force per load", min=0.01, max=5.0)
    lateral_friction: Quantity = quantity("1", "largest lateral force per load", min=0.01, max=5.0)
    rolling_resistance: Quantity = quantity("1", "rolling resistance per load", min=0.0, max=1.0)
    relaxation: Quantity = quantity("m", "relaxation length of the longitudinal slip", min=0.05, max=5.0)


class _ForceDriver(Section):
    gain: Quantity = quantity("N.s/m", "drive force per speed error", min=0.0, max=1e7)
    integral_gain: Quantity = quantity("N/m", "drive force per integral of the speed error", min=0.0, max=1e7)
    max_force: Quantity = quantity("N", "largest drive or brake force", min=0.0, max=1e7, display_unit="kN")
    lever: Quantity = quantity("m", "torque of all wheels per drive force", min=0.01, max=5.0)


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


# ------------------------------------------------------------------------------------------------------------- actuator


class _Cylinder(Section):
    area: Quantity = quantity("m2", "piston area", min=1e-6, max=1.0)
    volume: Quantity = quantity("m3", "volume of both cylinder chambers", min=1e-6, max=1.0, display_unit="l")
    leakage: Quantity = quantity(
        "m5/(N.s)", "leakage flow past the piston per load pressure", min=0.0, max=1e-8, nominal=1e-11
    )


class _Fluid(Section):
    density: Quantity = quantity("kg/m3", "density of the fluid", min=100.0, max=1e4)
    bulk_modulus: Quantity = quantity(
        "Pa", "effective bulk modulus of the fluid", min=1e6, max=1e11, display_unit="MPa"
    )


class _Supply(Section):
    pressure: Quantity = quantity(
        "Pa", "supply pressure of the running pump", min=1e5, max=1e9, display_unit="bar", nominal=1e7
    )
    flow_limit: Quantity = quantity(
        "m3/s", "largest flow of the pump, where supply.limited", min=1e-7, max=1.0, display_unit="l/min"
    )


class _Valve(Section):
    discharge: Quantity = quantity("1", "discharge coefficient of the spool valve", min=0.01, max=1.0)
    width: Quantity = quantity("m", "area gradient of the spool valve", min=1e-5, max=1.0, display_unit="mm")
    time_constant: Quantity = quantity("s", "time constant of the spool", min=1e-5, max=1.0, display_unit="ms")
    gain: Quantity = quantity("V/m", "voltage per spool position", min=1.0, max=1e7)
    max_voltage: Quantity = quantity("V", "voltage at which the valve saturates", min=0.1, max=1e3)
    null_opening: Quantity = quantity(
        "m", "where the spool rests when the pump is off", min=0.0, max=0.1, display_unit="mm", nominal=1e-3
    )
    smoothing: Quantity = quantity(
        "Pa", "pressure drop below which orifice flow becomes linear", min=1.0, max=1e7, display_unit="bar"
    )


class _Bypass(Section):
    discharge: Quantity = quantity("1", "discharge coefficient of the bypass valve", min=0.01, max=1.0)


class Actuator(Vehicle):
    """Electro-hydraulic actuator: pump, spool valve, cylinder, bypass valve."""

    cylinder: _Cylinder
    fluid: _Fluid
    supply: _Supply
    valve: _Valve
    bypass: _Bypass


# -------------------------------------------------------------------------------------------------------------- sensors


class _Noise(Section):
    load_cell: Quantity = quantity("N", "noise of a load cell, standard deviation", min=0.0, max=1e6, nominal=10.0)
    lvdt: Quantity = quantity("m", "noise of an LVDT", min=0.0, max=0.1, display_unit="mm", nominal=1e-3)
    hub: Quantity = quantity("m/s2", "noise of a hub accelerometer", min=0.0, max=1e3, nominal=0.1)
    chassis: Quantity = quantity("m/s2", "noise of a chassis accelerometer", min=0.0, max=1e3, nominal=0.1)
    gyro: Quantity = quantity("rad/s", "noise of a rate gyro", min=0.0, max=10.0, display_unit="deg/s", nominal=1e-2)
    range: Quantity = quantity("m", "noise of a range sensor", min=0.0, max=1.0, display_unit="mm", nominal=1e-3)
    speed: Quantity = quantity("m/s", "noise of the speedometer", min=0.0, max=10.0, nominal=1e-2)


class _Place(Section):
    x: Quantity = quantity("m", "position ahead of the CG", min=-50.0, max=50.0)
    y: Quantity = quantity("m", "position to the left of the CG", min=-10.0, max=10.0)


class _Chassis(Section):
    front: _Place
    rear: _Place


class _RangeMount(Section):
    x: Quantity = quantity("m", "position of the range sensors ahead of the CG", min=-50.0, max=50.0)
    y: Quantity = quantity("m", "distance of the range sensors to the side of the CG", min=0.0, max=10.0)
    height: Quantity = quantity("m", "height of the range sensors above the road at rest", min=0.05, max=10.0)
    bias: Quantity = quantity(
        "m",
        "D_bias: from the mount along the beam, upwards, to where ranges count from",
        min=-2.0,
        max=2.0,
        nominal=0.1,
    )


class _RangeSensor(Section):
    near: Quantity = quantity("m", "shortest range", min=0.0, max=100.0)
    far: Quantity = quantity("m", "longest range", min=0.01, max=100.0)
    resolution: Quantity = quantity("m", "resolution", min=0.0, max=1.0, display_unit="mm", nominal=1e-2)
    spot: Quantity = quantity("m", "length of road over which the range is a mean", min=0.0, max=0.6, nominal=0.1)
    response: Quantity = quantity("s", "response time", min=0.0, max=7e-3, display_unit="ms", nominal=1e-3)
    tilt: Quantity = quantity(
        "rad", "angle of the beam, forward from straight down", min=0.0, max=1.4, display_unit="deg"
    )


class _Estimator(Section):
    road: Quantity = quantity("m2/s", "intensity of the road's rate as white noise", min=1e-12, max=100.0, nominal=1e-2)
    known_road: Quantity = quantity(
        "m2/s", "intensity that remains where the road is known", min=1e-12, max=100.0, nominal=1e-2
    )
    pose_leak: Quantity = quantity("s", "time in which heave, pitch and roll fade without road", min=0.05, max=1e4)
    pose_correction: Quantity = quantity(
        "s", "time in which heave, pitch and roll follow a known road", min=0.05, max=1e4
    )


class SensorSet(Vehicle):
    """Where sensors sit on a vehicle, how good they are, and what an estimator makes of them."""

    noise: _Noise
    chassis: _Chassis
    mount: _RangeMount
    radar: _RangeSensor
    optical: _RangeSensor
    estimator: _Estimator


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
