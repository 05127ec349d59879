"""What is measured on the vehicle, and what a rider makes of it."""

from fmu_sources.sensing.ride_comfort import ride_comfort

__all__ = ["ride_comfort"]
