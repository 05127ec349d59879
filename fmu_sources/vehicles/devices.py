"""What a file of an actuator or of sensors must contain: its fields, as `schema` declares those of vehicles."""

from __future__ import annotations

from fmu_sources.vehicles.quantities import Quantity, Section, Vehicle, quantity

# ------------------------------------------------------------------------------------------------------------- actuator


class _Cylinder(Section):
    area: Quantity = quantity("m2", 1e-6, 1.0, "piston area")
    volume: Quantity = quantity("m3", 1e-6, 1.0, "volume of both cylinder chambers", display_unit="l")
    leakage: Quantity = quantity("m5/(N.s)", 0.0, 1e-8, "leakage flow past the piston per load pressure", nominal=1e-11)


class _Fluid(Section):
    density: Quantity = quantity("kg/m3", 100.0, 1e4, "density of the fluid")
    bulk_modulus: Quantity = quantity("Pa", 1e6, 1e11, "effective bulk modulus of the fluid", display_unit="MPa")


class _Supply(Section):
    pressure: Quantity = quantity(
        "Pa", 1e5, 1e9, "supply pressure of the running pump", display_unit="bar", nominal=1e7
    )
    flow_limit: Quantity = quantity(
        "m3/s", 1e-7, 1.0, "largest flow of the pump, where supply.limited", display_unit="l/min"
    )


class _Valve(Section):
    discharge: Quantity = quantity("1", 0.01, 1.0, "discharge coefficient of the spool valve")
    width: Quantity = quantity("m", 1e-5, 1.0, "area gradient of the spool valve", display_unit="mm")
    time_constant: Quantity = quantity("s", 1e-5, 1.0, "time constant of the spool", display_unit="ms")
    gain: Quantity = quantity("V/m", 1.0, 1e7, "voltage per spool position")
    max_voltage: Quantity = quantity("V", 0.1, 1e3, "voltage at which the valve saturates")
    null_opening: Quantity = quantity(
        "m", 0.0, 0.1, "where the spool rests when the pump is off", display_unit="mm", nominal=1e-3
    )
    smoothing: Quantity = quantity(
        "Pa", 1.0, 1e7, "pressure drop below which orifice flow becomes linear", display_unit="bar"
    )


class _Bypass(Section):
    discharge: Quantity = quantity("1", 0.01, 1.0, "discharge coefficient of the bypass valve")


class Actuator(Vehicle):
    """Electro-hydraulic actuator: pump, spool valve, cylinder, bypass valve."""

    cylinder: _Cylinder
    fluid: _Fluid
    supply: _Supply
    valve: _Valve
    bypass: _Bypass


# -------------------------------------------------------------------------------------------------------------- sensors


class _Noise(Section):
    load_cell: Quantity = quantity("N", 0.0, 1e6, "noise of a load cell, standard deviation", nominal=10.0)
    lvdt: Quantity = quantity("m", 0.0, 0.1, "noise of an LVDT", display_unit="mm", nominal=1e-3)
    hub: Quantity = quantity("m/s2", 0.0, 1e3, "noise of a hub accelerometer", nominal=0.1)
    chassis: Quantity = quantity("m/s2", 0.0, 1e3, "noise of a chassis accelerometer", nominal=0.1)
    gyro: Quantity = quantity("rad/s", 0.0, 10.0, "noise of a rate gyro", display_unit="deg/s", nominal=1e-2)
    range: Quantity = quantity("m", 0.0, 1.0, "noise of a range sensor", display_unit="mm", nominal=1e-3)
    speed: Quantity = quantity("m/s", 0.0, 10.0, "noise of the speedometer", nominal=1e-2)


class _Place(Section):
    x: Quantity = quantity("m", -50.0, 50.0, "position ahead of the CG")
    y: Quantity = quantity("m", -10.0, 10.0, "position to the left of the CG")


class _Chassis(Section):
    front: _Place
    rear: _Place


class _RangeMount(Section):
    x: Quantity = quantity("m", -50.0, 50.0, "position of the range sensors ahead of the CG")
    y: Quantity = quantity("m", 0.0, 10.0, "distance of the range sensors to the side of the CG")
    height: Quantity = quantity("m", 0.05, 10.0, "height of the range sensors above the road at rest")
    bias: Quantity = quantity(
        "m", -2.0, 2.0, "D_bias: from the mount along the beam, upwards, to where ranges count from", nominal=0.1
    )


class _RangeSensor(Section):
    near: Quantity = quantity("m", 0.0, 100.0, "shortest range")
    far: Quantity = quantity("m", 0.01, 100.0, "longest range")
    resolution: Quantity = quantity("m", 0.0, 1.0, "resolution", display_unit="mm", nominal=1e-2)
    spot: Quantity = quantity("m", 0.0, 0.6, "length of road over which the range is a mean", nominal=0.1)
    response: Quantity = quantity("s", 0.0, 7e-3, "response time", display_unit="ms", nominal=1e-3)
    tilt: Quantity = quantity("rad", 0.0, 1.4, "angle of the beam, forward from straight down", display_unit="deg")


class _Estimator(Section):
    road: Quantity = quantity("m2/s", 1e-12, 100.0, "intensity of the road's rate as white noise", nominal=1e-2)
    known_road: Quantity = quantity(
        "m2/s", 1e-12, 100.0, "intensity that remains where the road is known", nominal=1e-2
    )
    pose_leak: Quantity = quantity("s", 0.05, 1e4, "time in which heave, pitch and roll fade without road")
    pose_correction: Quantity = quantity("s", 0.05, 1e4, "time in which heave, pitch and roll follow a known road")


class SensorSet(Vehicle):
    """Where sensors sit on a vehicle, how good they are, and what an estimator makes of them."""

    noise: _Noise
    chassis: _Chassis
    mount: _RangeMount
    radar: _RangeSensor
    optical: _RangeSensor
    estimator: _Estimator
