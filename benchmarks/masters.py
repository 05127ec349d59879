"""Errors of the exchange, estimated and true, and what masters need for them, on five coupled systems.

Of each system: the estimate of `System.exchange_error` beside the true error, which is the difference from a run with a
tolerance of 1e-6; then the largest error of a signal, relative to its largest value, with the calls of doStep, by fixed
steps and by steps that follow a tolerance. The FMUs integrate with at most a quarter of the communication step, so the
exchange makes nearly all of the error. CoFmuPy runs the same FMUs (its `DefaultMaster`, Jacobi) where a Python that has
it is given.
"""

from __future__ import annotations

import json
import math
import subprocess
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from fractions import Fraction
from functools import partial
from pathlib import Path
from typing import Any

import casadi as ca
import numpy as np

from build_fmus.compile import ObjectCache, resolve_platforms
from build_fmus.component import Component
from build_fmus.package import build_fmu
from cosim import Execution, Record, Recording, System
from cosim.study import FmuSet
from fmu_sources.models.corners import CORNERS

REFERENCE = 1e-6  # tolerance of the run that is taken for the truth
TOLERANCES = (1e-3, 1e-4)
PLAIN, EXTRAPOLATED = "fixed steps", "fixed steps, extrapolated"
DIVERGED = 1.0  # an error as large as the signal
ROUNDING = 1e-9  # errors below this share of the largest value are none
BUILT = Path("build") / "masters"


# ------------------------------------------------------------------------------------------------------- the components


def continuous(name: str, text: str, step: float) -> Component:
    """A component whose solver takes a quarter of the communication step [s]."""
    return Component(name, kind="continuous", description=text, source="none", solver="rk4", solver_step=step / 4)


def constant(c: Component, name: str, value: float, unit: str) -> Any:
    """A parameter of the benchmark."""
    return c.parameter(name, value, unit, name.replace(".", " "), source="assumed")


def oscillator(name: str, step: float, start: float) -> Component:
    """A mass on a spring, pulled by another one: m x'' = -k x - d x' + c x_other."""
    c = continuous(name, "Mass on a spring, pulled by another mass", step)
    m, k = constant(c, "mass", 1.0, "kg"), constant(c, "stiffness", 100.0, "N/m")
    d, pull = constant(c, "damping", 0.2, "N.s/m"), constant(c, "coupling", 50.0, "N/m")
    other = c.input("other.x", "m", "position of the other mass")
    x = c.state("x", "m", "position", start=constant(c, "start", start, "m"), output=True)
    v = c.state("v", "m/s", "velocity", output=True)
    c.derivative(x, v)
    c.derivative(v, (-k * x - d * v + pull * other) / m)
    return finished(c, {"other.x": 0.5})


def truck_body(step: float) -> Component:
    """The sprung mass of a quarter truck, with its suspension."""
    c = continuous("TruckBody", "Sprung mass and suspension of a quarter truck", step)
    m, k = constant(c, "mass", 4000.0, "kg"), constant(c, "stiffness", 3e5, "N/m")
    d = constant(c, "damping", 2e4, "N.s/m")
    wheel, rate = c.input("wheel.z", "m", "wheel height"), c.input("wheel.vz", "m/s", "wheel velocity")
    z = c.state("z", "m", "height", output=True, nominal=0.1)
    v = c.state("vz", "m/s", "velocity", output=True, nominal=0.1)
    force = k * (wheel - z) + d * (rate - v)
    c.derivative(z, v)
    c.derivative(v, force / m)
    c.output("suspension.force", force, "N", "force of the suspension on the body")
    return finished(c, {"wheel.z": 0.01, "wheel.vz": 0.0})


def truck_wheel(step: float) -> Component:
    """The wheel of a quarter truck on a road that has stepped up by 5 cm."""
    c = continuous("TruckWheel", "Wheel of a quarter truck on a step of the road", step)
    m, k = constant(c, "mass", 400.0, "kg"), constant(c, "stiffness", 1.5e6, "N/m")
    d, road = constant(c, "damping", 1e3, "N.s/m"), constant(c, "road", 0.05, "m")
    force = c.input("suspension.force", "N", "force of the suspension on the body")
    z = c.state("z", "m", "height", output=True, nominal=0.1)
    v = c.state("vz", "m/s", "velocity", output=True, nominal=0.1)
    c.derivative(z, v)
    c.derivative(v, (k * (road - z) - d * v - force) / m)
    return finished(c, {"suspension.force": 10.0})


def rotor(name: str, step: float, inertia: float, drive: float, capacity: float) -> Component:
    """A rotor with the clutch between it and the next one, whose friction follows tanh of the slip."""
    c = continuous(name, "Rotor and the clutch behind it", step)
    j, torque = constant(c, "inertia", inertia, "kg.m2"), constant(c, "drive", drive, "N.m")
    most, slow = constant(c, "capacity", capacity, "N.m"), constant(c, "slow", 2.0, "rad/s")
    drag, hertz = constant(c, "drag", 50.0, "N.m"), constant(c, "frequency", 8.0, "rad/s")
    full = constant(c, "drag.speed", 100.0, "rad/s")
    before = c.input("torque", "N.m", "torque of the clutch before it")
    following = c.input("next.speed", "rad/s", "speed of the next rotor")
    w = c.state("speed", "rad/s", "speed", output=True, nominal=10.0)
    passed = most * ca.tanh((w - following) / slow)
    c.derivative(w, (torque * (1 + ca.sin(hertz * c.time)) + before - passed - drag * w / full) / j)
    c.output("passed.torque", passed, "N.m", "torque that its clutch passes on")
    return finished(c, {"torque": 1.0, "next.speed": 0.0})


def ball(step: float) -> Component:
    """A ball above an elastic plate: while it touches the plate, a spring and a damper push it."""
    c = continuous("Ball", "Ball that bounces on a plate", step)
    m, k = constant(c, "mass", 0.2, "kg"), constant(c, "stiffness", 2e3, "N/m")
    d, g = constant(c, "damping", 1.0, "N.s/m"), constant(c, "gravity", 9.81, "m/s2")
    plate, rate = c.input("plate.z", "m", "height of the plate"), c.input("plate.vz", "m/s", "velocity of the plate")
    z = c.state("z", "m", "height", start=constant(c, "start", 0.3, "m"), output=True, nominal=0.1)
    v = c.state("vz", "m/s", "velocity", output=True)
    force = ca.fmax(0, ca.if_else(z < plate, k * (plate - z) + d * (rate - v), 0))
    c.derivative(z, v)
    c.derivative(v, force / m - g)
    c.output("contact.force", force, "N", "force on the ball")
    return finished(c, {"plate.z": 0.0, "plate.vz": 0.0})


def plate(step: float) -> Component:
    """A plate on a spring and a damper, shaken by a force."""
    c = continuous("Plate", "Plate on a spring, shaken by a force", step)
    m, k = constant(c, "mass", 2.0, "kg"), constant(c, "stiffness", 4e3, "N/m")
    d, shaken = constant(c, "damping", 4.0, "N.s/m"), constant(c, "force", 20.0, "N")
    w = constant(c, "frequency", 12.0, "rad/s")
    contact = c.input("contact.force", "N", "force on the ball")
    z = c.state("z", "m", "height", output=True, nominal=0.1)
    v = c.state("vz", "m/s", "velocity", output=True, nominal=0.1)
    c.derivative(z, v)
    c.derivative(v, (shaken * ca.sin(w * c.time) - k * z - d * v - contact) / m)
    return finished(c, {"contact.force": 1.0})


def _held(value: float, _: float) -> float:
    return value


def finished(c: Component, inputs: Mapping[str, float]) -> Component:
    """With constant inputs of the reference result."""
    c.reference_input({name: partial(_held, value) for name, value in inputs.items()})
    return c


# ---------------------------------------------------------------------------------------------------------- the systems


@dataclass(frozen=True, eq=False)
class Subject:
    """A coupled system of FMUs.

    Attributes:
        step: communication step [s].
        stop: stop time [s].
        components: makes those that are built for it.
        files: FMU of each component of the system, a name of one that is built or of the catalog.
        connections: (output, input) by names.
        start: start values of inputs that nobody drives, by component.
    """

    name: str
    step: Fraction
    stop: Fraction
    components: Callable[[float], Sequence[Component]]
    files: Mapping[str, str]
    connections: Sequence[tuple[str, str]]
    start: Mapping[str, Mapping[str, float]]

    def paths(self, folder: Path) -> dict[str, Path]:
        """Files of the FMUs by component; those of the benchmark are built in `folder`."""
        built = {c.name: folder / f"{c.name}.fmu" for c in self.components(float(self.step))}
        return {name: built[fmu] if fmu in built else FmuSet().path(fmu) for name, fmu in self.files.items()}

    def build(self, folder: Path) -> None:
        """Build its FMUs."""
        folder.mkdir(parents=True, exist_ok=True)
        for c in self.components(float(self.step)):
            data = build_fmu(c, 3, resolve_platforms("host"), ObjectCache(folder / "objects"))
            (folder / f"{c.name}.fmu").write_bytes(data)

    @contextmanager
    def wired(self, folder: Path, *, extrapolate: bool = False) -> Iterator[System]:
        """The system, connected."""
        with System(allow_unconnected=True) as system:
            for name, path in self.paths(folder).items():
                system.add(name, path, step=self.step, start=self.start.get(name, {}))
                if float(system[name].description.parameters["solver.step"].start or 0.0) > float(self.step) / 4:
                    system[name].set({"solver.step": float(self.step) / 4})
            for source, target in self.connections:
                system.connect(source, target, extrapolate=extrapolate)
            if extrapolate:
                system.group("all", list(self.files), "gauss-seidel")
            yield system

    @property
    def record(self) -> Record:
        """All outputs, at the communication step."""
        return Record(None, self.step)


SUBJECTS = (
    Subject(
        "two-mass oscillator",
        Fraction(2, 1000),
        Fraction(2),
        lambda h: [oscillator("MassA", h, 1.0), oscillator("MassB", h, 0.0)],
        {"a": "MassA", "b": "MassB"},
        (("a.x", "b.other.x"), ("b.x", "a.other.x")),
        {},
    ),
    Subject(
        "quarter truck",
        Fraction(1, 1000),
        Fraction(2),
        lambda h: [truck_body(h), truck_wheel(h)],
        {"body": "TruckBody", "wheel": "TruckWheel"},
        (
            ("wheel.z", "body.wheel.z"),
            ("wheel.vz", "body.wheel.vz"),
            ("body.suspension.force", "wheel.suspension.force"),
        ),
        {},
    ),
    Subject(
        "car with hydraulic actuators",
        Fraction(1, 4000),
        Fraction(1),
        lambda _: [],
        {"car": "RideCarHmmwv", **{f"actuator_{k}": "HydraulicActuator" for k in CORNERS}},
        [
            pair
            for k in CORNERS
            for pair in (
                (f"car.suspension.{k}.velocity", f"actuator_{k}.piston.velocity"),
                (f"actuator_{k}.force", f"car.force.{k}"),
            )
        ],
        {"car": {"road.fl.height": 0.02, "road.fr.height": 0.01}},
    ),
    Subject(
        "coupled clutches",
        Fraction(1, 1000),
        Fraction(2),
        lambda h: [
            rotor("Motor", h, 0.2, 40.0, 30.0),
            rotor("Gearbox", h, 0.05, 0.0, 25.0),
            rotor("Load", h, 0.8, 0.0, 0.0),
        ],
        {"motor": "Motor", "gearbox": "Gearbox", "load": "Load"},
        (
            ("motor.passed.torque", "gearbox.torque"),
            ("gearbox.speed", "motor.next.speed"),
            ("gearbox.passed.torque", "load.torque"),
            ("load.speed", "gearbox.next.speed"),
        ),
        {},
    ),
    Subject(
        "ball on a moving plate",
        Fraction(1, 2000),
        Fraction(1),
        lambda h: [ball(h), plate(h)],
        {"ball": "Ball", "plate": "Plate"},
        (("plate.z", "ball.plate.z"), ("plate.vz", "ball.plate.vz"), ("ball.contact.force", "plate.contact.force")),
        {},
    ),
)


# --------------------------------------------------------------------------------------------------- what they measure


@dataclass(frozen=True)
class Cost:
    """A run.

    Attributes:
        error: the largest of all signals, relative to the largest value of the signal.
        calls: of doStep.
    """

    error: float
    calls: int


@dataclass(frozen=True)
class Result:
    """What was measured of one system.

    Attributes:
        ratios: estimated by true error of each signal, with fixed steps, by the kind of exchange; those of a run that
            diverges are not there.
        costs: by the way in which it was run.
    """

    ratios: Mapping[str, Sequence[float]]
    costs: Mapping[str, Cost]

    def within(self, what: str) -> int:
        """Signals whose estimate is within a factor of two."""
        return sum(0.5 <= ratio <= 2.0 for ratio in self.ratios[what])


def errors(run: Mapping[str, Any] | Recording, true: Recording) -> dict[str, float]:
    """Largest difference of each real signal, relative to its largest value; signals that are always 0 are left out.

    It is infinite if the run has ended early.
    """
    names = [n for n in true if n not in true.types and np.abs(true[n]).max() > 0.0]
    if any(len(run[n]) < len(true) for n in names):
        return dict.fromkeys(names, math.inf)
    return {n: float(np.abs(run[n] - true[n]).max() / np.abs(true[n]).max()) for n in names}


def measured(subject: Subject, folder: Path = BUILT, peer: Path | None = None) -> Result:
    """Everything of one system; `peer`: a Python that has CoFmuPy."""
    subject.build(folder)
    stop, record, n = subject.stop, subject.record, len(subject.files)
    with subject.wired(folder) as system:
        true = system.run(stop, record=record, execution=Execution(tolerance=REFERENCE))
    costs, ratios, steps = {}, {}, int(stop / subject.step)
    for what, extrapolate in ((PLAIN, False), (EXTRAPOLATED, True)):
        with subject.wired(folder, extrapolate=extrapolate) as system:
            found = errors(system.run(stop, record=record), true)
            costs[what] = Cost(max(found.values()), n * steps)
            if costs[what].error < DIVERGED:
                estimate = system.exchange_error(stop, record=record, contributions=False)
                told = {s.name: s.relative for s in estimate.signals}
                ratios[what] = [told[n] / error for n, error in found.items() if error > ROUNDING]
    with subject.wired(folder) as system:
        for tolerance in TOLERANCES:
            run = system.run(stop, record=record, execution=Execution(tolerance=tolerance))
            assert run.steps is not None
            tried = run.steps.accepted + run.steps.rejected
            costs[f"tolerance {tolerance:g}"] = Cost(max(errors(run, true).values()), 2 * n * tried)
    if peer is not None:
        costs["CoFmuPy"] = by_cofmupy(subject, folder, peer, true)
    return Result(ratios, costs)


_PEER = """
import fmpy.fmi1, json, sys
from cofmupy.master import DefaultMaster
job = json.load(sys.stdin)
connections = {}
for source, target in job["connections"]:
    connections.setdefault(tuple(source), []).append(tuple(target))
fmus = [{"id": n, "path": p, "initialization": job["start"].get(n, {})} for n, p in job["files"].items()]
print_, sys.stdout = sys.stdout, sys.stderr
master = DefaultMaster(fmus, connections, [list(job["files"])])
master.init_simulation({})
try:
    for _ in range(job["steps"]):
        master.do_step(job["step"])
except fmpy.fmi1.FMICallException as error:
    print(error)
values = master.get_results()
json.dump({f"{m}.{v}": values[m, v] for m, v in job["record"]}, print_)
"""


def by_cofmupy(subject: Subject, folder: Path, python: Path, true: Recording) -> Cost:
    """The same FMUs with fixed steps by CoFmuPy; its results are those at the end of each step."""
    steps = int(subject.stop / subject.step)
    job = {
        "files": {n: str(p.resolve()) for n, p in subject.paths(folder).items()},
        "connections": [[source.split(".", 1), target.split(".", 1)] for source, target in subject.connections],
        "start": subject.start,
        "record": [name.split(".", 1) for name in true],
        "step": float(subject.step),
        "steps": steps,
    }
    done = subprocess.run([str(python), "-c", _PEER], input=json.dumps(job), capture_output=True, text=True, check=True)
    run = {n: np.concatenate([true[n][:1], values]) for n, values in json.loads(done.stdout).items()}
    return Cost(max(errors(run, true).values()), len(subject.files) * steps)


def measure() -> dict[str, dict[str, float]]:
    """Of each system: signals within a factor of two, and errors and calls of each way to run it."""
    found = {}
    for subject in SUBJECTS:
        result = measured(subject)
        shares = {
            f"{what}: within a factor of two": result.within(what) / len(of) for what, of in result.ratios.items()
        }
        found[subject.name] = shares | {
            f"{what}: {name}": getattr(cost, name) for what, cost in result.costs.items() for name in ("error", "calls")
        }
    return found
