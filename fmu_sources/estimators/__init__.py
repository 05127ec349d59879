"""What a vehicle's computer makes of its sensors."""

from fmu_sources.estimators.kalman_hmmwv import kalman_hmmwv, kalman_hmmwv_printed

__all__ = ["kalman_hmmwv", "kalman_hmmwv_printed"]
