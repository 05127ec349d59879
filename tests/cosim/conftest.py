"""Foreign FMUs for the tests: real shared libraries made by PythonFMU (FMI 2.0) and PythonFMU3 (FMI 3.0)."""

from __future__ import annotations

from pathlib import Path

import pytest
import pythonfmu.builder as pythonfmu
import pythonfmu3.builder as pythonfmu3

ADD_ONE_2 = """
from pythonfmu import Boolean, Fmi2Causality, Fmi2Slave, Fmi2Variability, Integer, Real, String


class AddOne2(Fmi2Slave):
    '''y = gain * u + 1 at every step.'''

    def __init__(self, **kwargs):
        super().__init__(**kwargs)
        self.u = 0.0
        self.enable = True
        self.y = 0.0
        self.steps = 0
        self.busy = False
        self.gain = 1.0
        self.fail_at = 1e9
        self.how = "raise"
        self.register_variable(Real("u", causality=Fmi2Causality.input))
        self.register_variable(Boolean("enable", causality=Fmi2Causality.input))
        self.register_variable(Real("y", causality=Fmi2Causality.output))
        self.register_variable(Integer("steps", causality=Fmi2Causality.output))
        self.register_variable(Boolean("busy", causality=Fmi2Causality.output))
        for name in ("gain", "fail_at"):
            self.register_variable(
                Real(name, causality=Fmi2Causality.parameter, variability=Fmi2Variability.tunable))
        self.register_variable(
            String("how", causality=Fmi2Causality.parameter, variability=Fmi2Variability.tunable))

    def do_step(self, t, h):
        if t > self.fail_at - 1e-9:
            if self.how == "raise":
                raise ValueError("the spring is broken")
            return False
        if self.enable:
            self.y = self.gain * self.u + 1.0
        self.steps += 1
        self.busy = self.steps % 2 == 1
        return True
"""

ADD_ONE_3 = """
from pythonfmu3 import Boolean, Float64, Fmi3Causality, Fmi3Slave, Fmi3Variability, Int32


class AddOne3(Fmi3Slave):
    '''y = u + 1 at every step.'''

    def __init__(self, **kwargs):
        super().__init__(**kwargs)
        self.time = 0.0
        self.u = 0.0
        self.enable = True
        self.y = 0.0
        self.steps = 0
        self.register_variable(
            Float64("time", causality=Fmi3Causality.independent, variability=Fmi3Variability.continuous))
        self.register_variable(Float64("u", causality=Fmi3Causality.input))
        self.register_variable(Boolean("enable", causality=Fmi3Causality.input, variability=Fmi3Variability.discrete))
        self.register_variable(Float64("y", causality=Fmi3Causality.output))
        self.register_variable(Int32("steps", causality=Fmi3Causality.output, variability=Fmi3Variability.discrete))

    def do_step(self, t, h):
        if self.enable:
            self.y = self.u + 1.0
        self.steps += 1
        return True
"""


REFUSES_2 = """
from pythonfmu import Fmi2Slave


class Refuses2(Fmi2Slave):
    def __init__(self, **kwargs):
        super().__init__(**kwargs)
        if kwargs["instance_name"] == "strut":
            raise RuntimeError("the license of 100 % of the springs has expired")

    def do_step(self, t, h):
        return True
"""


@pytest.fixture(scope="session")
def foreign(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    """Paths of `AddOne2` (FMI 2.0), `AddOne3` (FMI 3.0) and `Refuses2`.

    `Refuses2` does not let itself be instantiated as 'strut'.
    """
    folder = tmp_path_factory.mktemp("foreign")
    for name, source, builder in (
        ("AddOne2", ADD_ONE_2, pythonfmu.FmuBuilder),
        ("AddOne3", ADD_ONE_3, pythonfmu3.FmuBuilder),
        ("Refuses2", REFUSES_2, pythonfmu.FmuBuilder),
    ):
        script = folder / f"{name.lower()}.py"
        script.write_text(source)
        builder.build_FMU(script, dest=folder)
    return {name: folder / f"{name}.fmu" for name in ("AddOne2", "AddOne3", "Refuses2")}
