"""What a vehicle's computer makes of its sensors.

- `kalman_hmmwv`: Kalman filters of the HMMWV as components (paper 001)
- `kalman_design`: their gains
"""

from fmu_sources.estimators.kalman_hmmwv import kalman_hmmwv, kalman_hmmwv_printed

__all__ = ["kalman_hmmwv", "kalman_hmmwv_printed"]
