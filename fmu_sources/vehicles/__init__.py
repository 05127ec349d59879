"""Vehicle files: parameter sets in TOML, each value with its unit and source.

- `quantities`: values, tables and heads of files
- `schema`: what a vehicle's file must contain: fields, units, limits, descriptions
- `devices`: the same of an actuator and of sensors
- `loader`: files to vehicles, and vehicles to parameters of a component
"""

from fmu_sources.vehicles.devices import Actuator, SensorSet
from fmu_sources.vehicles.loader import (
    VehicleError,
    declare,
    load_actuator,
    load_full_car,
    load_quarter_car,
    load_ride_car,
    load_sensors,
    load_three_axle,
    load_three_axle_trench,
    load_vehicle,
    load_wishbone_car,
    vehicle_files,
    vehicle_names,
)
from fmu_sources.vehicles.quantities import Numbers, Quantity, Vehicle
from fmu_sources.vehicles.schema import FullCar, QuarterCar, RideCar, ThreeAxleCar, ThreeAxleTrenchCar, WishboneCar

__all__ = [
    "Actuator",
    "FullCar",
    "Numbers",
    "Quantity",
    "QuarterCar",
    "RideCar",
    "SensorSet",
    "ThreeAxleCar",
    "ThreeAxleTrenchCar",
    "Vehicle",
    "VehicleError",
    "WishboneCar",
    "declare",
    "load_actuator",
    "load_full_car",
    "load_quarter_car",
    "load_ride_car",
    "load_sensors",
    "load_three_axle",
    "load_three_axle_trench",
    "load_vehicle",
    "load_wishbone_car",
    "vehicle_files",
    "vehicle_names",
]
