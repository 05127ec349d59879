"""SSP files of this project in other tools: FMPy, Ecos and libcosim.

They run them, and their numbers are those of their rule of exchange.

All three step every component with the inputs of before and exchange afterwards. FMPy's inputs are 0 in the first step,
whatever the file says; the others set the values of the file, and libcosim and Ecos step each component at its own
rate.
"""

from __future__ import annotations

import json
import re
import subprocess
import sys
import zipfile
from fractions import Fraction
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from built import NAMES, BuiltFmus
from fmpy.ssp.simulation import simulate_ssp
from fmpy.ssp.ssd import Parameter, ParameterSet, read_ssd
from same import bits
from systems import EVERY, experiment_system

from cosim import Record, System
from cosim.fmu.component import FmuComponent
from cosim.ssp.names import ENTRY
from cosim.system.components import SystemComponent

HERE = Path(__file__).parent


class Late:
    """A system as others step it.

    Each component from t to t + h with what its inputs were, then all values are exchanged.
    """

    def __init__(self, system: System, *, zero: bool, every: dict[str, int] | None = None):
        self.components: list[SystemComponent] = list(system.components.values())
        self.every = every or {}
        self.u: dict[str, np.ndarray] = {}
        self.y: dict[str, np.ndarray] = {}
        self.ports: dict[str, Any] = {}
        self.moves: list[tuple[str, int, str, int, float, float]] = []
        initial: dict[str, float] = {}
        system.allow_unconnected = True
        with system.initialize(record=Record([], watch=list(system.connections))) as started:
            initial = {n: started[n] for n in system.connections}
        for m in self.components:
            about = m.description
            driven = [v for v in about.inputs.values() if f"{m.name}.{v.name}" in system.connections]
            outputs = list(about.outputs.values())
            self.u[m.name] = np.array([0.0 if zero else initial[f"{m.name}.{v.name}"] for v in driven])
            self.y[m.name] = np.zeros(len(outputs))
            component = m.implementation
            assert isinstance(component, FmuComponent)
            component.instantiate(m.name)
            component.set({about.variables[n]: v for n, v in m.values.items()})
            component.set({v: initial[f"{m.name}.{v.name}"] for v in driven})
            component.enter_initialization(0.0, None)
            component.exit_initialization()
            self.ports[m.name] = component.bind(driven, outputs, self.u[m.name], self.y[m.name])
            for i, v in enumerate(driven):
                c = system.connections[f"{m.name}.{v.name}"]
                k = list(c.source.description.outputs.values()).index(c.output)
                self.moves.append((m.name, i, c.source.name, k, c.scale, c.offset))

    def run(self, step: float, count: int, names: list[str]) -> np.ndarray:
        """(samples, names) after each step."""
        places = []
        for full in names:
            m = next(m for m in self.components if full.startswith(f"{m.name}."))
            places.append((m.name, [v.name for v in m.description.outputs.values()].index(full[len(m.name) + 1 :])))
        rows, t = [], 0.0
        for k in range(count):
            for m in self.components:
                n = self.every.get(m.name, 1)
                if k % n == 0:
                    self.ports[m.name].run(t, n * step)
            for target, i, source, j, scale, offset in self.moves:
                if (k + 1) % self.every.get(source, 1) == 0:
                    value = self.y[source][j]
                    self.u[target][i] = value if (scale, offset) == (1.0, 0.0) else scale * value + offset
            rows.append([self.y[name][j] for name, j in places])
            t += step
        return np.array(rows)


def base_step(system: System) -> float:
    steps = [m.step for m in system.components.values()]
    common = steps[0]
    while any((s / common).denominator != 1 for s in steps):
        common = Fraction(common.numerator, common.denominator) / 2
    return float(common)


def own_values(path: Path) -> ParameterSet:
    """The parameter sets of a file as FMPy wants them: it does not apply them by itself."""
    found = ParameterSet(name="all")
    for c in read_ssd(str(path)).system.elements:
        for p in (p for b in c.parameterBindings for s in b.parameterValues for p in s.parameters):
            value = {"true": "1", "false": "0"}.get(p.value, p.value)
            found.parameters.append(Parameter(name=f"{c.name}.{p.name}", type=p.type, value=float(value), unit=p.unit))
    return found


@pytest.mark.parametrize("name", EVERY)
def test_fmpy_shows_what_its_lag_gives(built_fmus: BuiltFmus, tmp_path: Path, name: str) -> None:  # noqa: ARG001
    """Bit by bit, of every output: one step late, and 0 before the first exchange."""
    with experiment_system(name, fmi=2) as system:
        path = system.export_ssp(tmp_path / "Case.ssp")
        names = [
            f"{m.name}.{v.name}"
            for m in system.components.values()
            for v in m.description.outputs.values()
            if v.type == "real"
        ]
        step = base_step(system)
        expected = Late(system, zero=True).run(step, 40, names)
        system.reset()
    found = simulate_ssp(str(path), stop_time=39.5 * step, step_size=step, parameter_set=own_values(path))
    np.testing.assert_array_equal(bits(np.column_stack([found[n] for n in names])), bits(expected))


@pytest.mark.full
@pytest.mark.parametrize("name", EVERY)
def test_fmpy_runs_every_file_to_its_end(built_fmus: BuiltFmus, tmp_path: Path, name: str) -> None:  # noqa: ARG001
    with experiment_system(name, fmi=2) as system:
        path = system.export_ssp(tmp_path / "Case.ssp")
        step = base_step(system)
    stop = System.from_ssp(path).experiment[1]
    assert stop is not None
    found = simulate_ssp(str(path), stop_time=float(stop), step_size=step, parameter_set=own_values(path))
    assert abs(found["time"][-1] - float(stop)) <= 1.5 * step


RIDE = ["car.body.az", "car.x", "speed.speed", "road.road.fl.height"]


def ride(built_fmus: BuiltFmus) -> System:
    """A car on a road that it drives along itself: all at 1 ms but the speed, at 2 ms."""
    system = System()
    system.add("speed", built_fmus.path("SpeedProfile", 2), step="2 ms", parameters={"start.speed": 15.0})
    system.add("road", built_fmus.path("RoadSine", 2))
    system.add("car", built_fmus.path("FullCarHmmwv", 2), start={"target.y": 0.0})
    system.connect("speed.speed", "car.target.speed")
    system.connect("car.x", "road.x")
    system.connect("car.speed", "road.speed")
    system.connect_matching("road", "car", "road.*")
    return system


@pytest.mark.parametrize("reader", ["ecos", "libcosim"])
def test_others_show_what_their_lag_gives(built_fmus: BuiltFmus, tmp_path: Path, reader: str) -> None:
    """Each at its own rate, from the start values of the file on; in a process of its own."""
    count = 60
    with ride(built_fmus) as system:
        path = system.export_ssp(tmp_path / "Ride.ssp")
        expected = Late(system, zero=False, every={"speed": 2}).run(1e-3, count, RIDE)
    job = {
        "reader": reader,
        "ssp": str(path),
        "steps": count,
        "outputs": RIDE,
        "entry": ENTRY,
        "folder": str(tmp_path / "unpacked"),
    }
    done = subprocess.run(
        [sys.executable, HERE / "run_in_others.py"],
        input=json.dumps(job),
        capture_output=True,
        text=True,
        cwd=tmp_path,
        check=False,
    )
    assert done.returncode == 0, done.stdout[-2000:] + done.stderr[-2000:]
    found = np.array(json.loads(done.stdout.splitlines()[-1]))
    np.testing.assert_allclose(found, expected, rtol=1e-9, atol=1e-12)


LOAD = """
import sys
from libcosimpy.CosimLogging import CosimLogLevel, log_output_level
from libcosimpy.CosimSlave import CosimLocalSlave
log_output_level(CosimLogLevel.INFO)
for path in sys.argv[1:]:
    CosimLocalSlave(fmu_path=path, instance_name="a")
"""


def test_fmi_library_complains_of_the_independent_variable_only(built_fmus: BuiltFmus) -> None:
    """The FMI Library in libcosim reads each FMU of FMI 2.0 twice.

    It wants a start value of `time` although the standard forbids it.
    """
    paths = [built_fmus.path(name, 2) for name in NAMES]
    done = subprocess.run(
        [sys.executable, "-c", LOAD, *paths], stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, check=True
    )
    assert len(re.findall(r"\[(?:warning|error|fatal)\]", done.stdout)) == 2 * len(paths), done.stdout[-2000:]
    start = "Start attribute is required for this causality, variability and initial combination"
    lines = re.findall(rf"\[Line:(\d+)\] Detected during parsing:\n.*\[error\].*\] {start}\n", done.stdout)
    for path, line in zip((p for p in paths for _ in range(2)), lines, strict=True):
        with zipfile.ZipFile(path) as archive:
            assert 'name="time"' in archive.read("modelDescription.xml").decode().splitlines()[int(line) - 2]
