"""Plants: one file per family."""

from fmu_sources.plants.full_car import full_car
from fmu_sources.plants.hydraulic_actuator import hydraulic_actuator
from fmu_sources.plants.quarter_car import quarter_car
from fmu_sources.plants.ride_car import ride_car
from fmu_sources.plants.three_axle_trench import three_axle_trench

__all__ = ["full_car", "hydraulic_actuator", "quarter_car", "ride_car", "three_axle_trench"]
