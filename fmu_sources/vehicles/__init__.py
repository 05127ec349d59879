"""Vehicle files: parameter sets in TOML, each value with its unit and source."""

from fmu_sources.vehicles.loader import (
    VehicleError,
    declare,
    load_full_car,
    load_quarter_car,
    load_ride_car,
    load_vehicle,
    vehicle_names,
)
from fmu_sources.vehicles.schema import FullCar, Quantity, QuarterCar, RideCar, Vehicle

__all__ = [
    "FullCar",
    "Quantity",
    "QuarterCar",
    "RideCar",
    "Vehicle",
    "VehicleError",
    "declare",
    "load_full_car",
    "load_quarter_car",
    "load_ride_car",
    "load_vehicle",
    "vehicle_names",
]
