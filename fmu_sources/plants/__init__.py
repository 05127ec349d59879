"""Plants: one file per family.

- `quarter_car`: linear quarter car, the smallest complete example
- `ride_car`: linear ride cars on four or six wheels
- `ride_interface`: what every ride car shows, whatever its equations
- `linear_car`: the linear ride car of a nonlinear car, near rest
- `full_car`: nonlinear car: body with six degrees of freedom, wheel spin, tires, driver
- `three_axle_trench`: 6x6 over trenches and obstacles, with contact
- `wishbone_car`: nonlinear car on double wishbones: paths of their hardpoints, tables, enveloping tires
- `enveloping`: contact of a tire with a road that is uneven within the length of the contact
- `tables`: tables that are linear in between, as parameters
- `obstacle`: outlines of obstacles, and how far discs touch them
- `hydraulic_actuator`: servo valve, cylinder and bypass of an active strut
- `semi_active_damper`: damper between two curves by current, with hysteresis
- `friction`: Coulomb friction that is smooth where it changes its sign
- `free_body`: body with six degrees of freedom, its driver and what it shows: of every nonlinear full car
- `driving`: steering wheel, pedals, powertrain and brakes of nonlinear full cars
- `gravity`: acceleration of gravity
- `seat`: acceleration of the driver's seat
"""

from fmu_sources.plants.full_car import full_car
from fmu_sources.plants.hydraulic_actuator import hydraulic_actuator
from fmu_sources.plants.linear_car import linear_ride_car
from fmu_sources.plants.quarter_car import quarter_car
from fmu_sources.plants.ride_car import ride_car
from fmu_sources.plants.semi_active_damper import semi_active_damper
from fmu_sources.plants.three_axle_trench import three_axle_trench
from fmu_sources.plants.wishbone_car import wishbone_car

__all__ = [
    "full_car",
    "hydraulic_actuator",
    "linear_ride_car",
    "quarter_car",
    "ride_car",
    "semi_active_damper",
    "three_axle_trench",
    "wishbone_car",
]
