"""Vehicle plants: one file per family."""

from fmu_sources.plants.quarter_car import quarter_car

__all__ = ["quarter_car"]
