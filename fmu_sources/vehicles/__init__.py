"""Vehicle files: parameter sets in TOML, each value with its unit and source.

==========  =============================================================
``schema``  what a file must contain: fields, units, limits, descriptions
``loader``  files to vehicles, and vehicles to parameters of a component
==========  =============================================================
"""

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
    vehicle_files,
    vehicle_names,
)
from fmu_sources.vehicles.schema import (
    Actuator,
    FullCar,
    Quantity,
    QuarterCar,
    RideCar,
    SensorSet,
    ThreeAxleCar,
    ThreeAxleTrenchCar,
    Vehicle,
)

__all__ = [
    "Actuator",
    "FullCar",
    "Quantity",
    "QuarterCar",
    "RideCar",
    "SensorSet",
    "ThreeAxleCar",
    "ThreeAxleTrenchCar",
    "Vehicle",
    "VehicleError",
    "declare",
    "load_actuator",
    "load_full_car",
    "load_quarter_car",
    "load_ride_car",
    "load_sensors",
    "load_three_axle",
    "load_three_axle_trench",
    "load_vehicle",
    "vehicle_files",
    "vehicle_names",
]
