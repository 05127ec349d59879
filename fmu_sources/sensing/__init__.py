"""What is measured on the vehicle, and what a rider makes of it.

- `sensor_suite`: sensors of the HMMWV with noise, range sensors included (paper 001)
- `bench_encoders`: encoders of the quarter-car bench (paper 002)
- `preview_sensor`: road ahead from range sensors, corrected for the motion of the body
- `preview_buffer`: the road by distance, from which every wheel is read
- `ride_comfort`: absorbed power, weighted r.m.s. and dose value of a ride
- `random_numbers`: reproducible noise in a component
"""

from fmu_sources.sensing.preview_buffer import preview_buffer
from fmu_sources.sensing.preview_sensor import preview_sensor
from fmu_sources.sensing.ride_comfort import ride_comfort
from fmu_sources.sensing.sensor_suite import sensor_suite

__all__ = ["preview_buffer", "preview_sensor", "ride_comfort", "sensor_suite"]
