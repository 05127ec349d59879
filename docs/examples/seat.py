"""A driver's seat, made with another tool: PythonFMU writes `Seat.fmu` (FMI 2.0) from this file.

    pip install pythonfmu
    pythonfmu build -f docs/examples/seat.py

It stands for any FMU that you already have; `docs/how-to/third-party-fmus.md` connects it to a car.
"""

import math

from pythonfmu import Fmi2Causality, Fmi2Slave, Fmi2Variability, Real


class Seat(Fmi2Slave):
    """A mass on spring and damper on the floor of the car."""

    def __init__(self, **kwargs):
        super().__init__(**kwargs)
        self.floor_acceleration = 0.0  # m/s2
        self.acceleration = 0.0  # m/s2
        self.frequency = 1.5  # Hz
        self.damping_ratio = 0.3
        self.deflection, self.velocity = 0.0, 0.0
        self.register_variable(Real("floor_acceleration", causality=Fmi2Causality.input))
        self.register_variable(Real("acceleration", causality=Fmi2Causality.output))
        for name in ("frequency", "damping_ratio"):
            self.register_variable(Real(name, causality=Fmi2Causality.parameter, variability=Fmi2Variability.tunable))

    def do_step(self, current_time, step_size):  # noqa: ARG002
        omega = 2 * math.pi * self.frequency
        self.acceleration = -(omega**2) * self.deflection - 2 * self.damping_ratio * omega * self.velocity
        self.velocity += step_size * (self.acceleration - self.floor_acceleration)
        self.deflection += step_size * self.velocity
        return True
