"""What is measured on the vehicle, and what a rider makes of it."""

from fmu_sources.sensing.preview_buffer import preview_buffer
from fmu_sources.sensing.preview_sensor import preview_sensor
from fmu_sources.sensing.ride_comfort import ride_comfort
from fmu_sources.sensing.sensor_suite import sensor_suite

__all__ = ["preview_buffer", "preview_sensor", "ride_comfort", "sensor_suite"]
