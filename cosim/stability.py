"""Does the exchange itself blow up? The spectral radius of the coupled continuous components.

Two stiff components that exchange once per step can diverge although each is stable and accurate alone. Each
component is linearized at its initial state by the FMU's directional derivatives,

    dx/dt = A x + B u,    y = C x + D u,

made discrete exactly for inputs held over its step (matrix exponential), and put in the place of the FMU in the same
master with the same schedule. One cycle of that schedule is a linear map of states and exchanged values; its
spectral radius says how much a deviation grows per cycle. Discrete components are held, extrapolation is off.

A plant may be unstable by nature, so the radius is compared with that of the same components coupled without any
delay, exp(max Re(lambda) * cycle). Integrators give exactly 1; repeated ones split by rounding, hence TOLERANCE.
"""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from scipy.linalg import eig, expm

from cosim.component import Array, Ports
from cosim.description import Description, Variable
from cosim.errors import CosimError, StabilityWarning
from cosim.master import Phase, Simulation
from cosim.members import Connection, Group, Member
from cosim.system import System

if TYPE_CHECKING:
    from cosim.schedule import Schedule

TOLERANCE = 1e-5


@dataclass(frozen=True)
class Stability:
    """`radius`: growth of a deviation per cycle of `cycle` [s]; `coupled_radius`: the same for the components coupled
    without delay; `dominant`: components in the growing mode with their shares (participation, sum 1), largest first;
    `unchecked`: continuous components left out, with the reason."""

    radius: float
    coupled_radius: float
    cycle: float
    dominant: tuple[tuple[str, float], ...]
    unchecked: dict[str, str]

    @property
    def stable(self) -> bool:
        """The exchange adds no growth of its own."""
        return self.radius <= max(1.0, self.coupled_radius) + TOLERANCE

    def __str__(self) -> str:
        names = ", ".join(f"{name} ({share:.0%})" for name, share in self.dominant if share >= 0.05)
        text = f"spectral radius {self.radius:.6g} per cycle of {self.cycle:g} s, dominated by {names or 'nothing'}"
        if self.coupled_radius > 1.0:
            text += f" (coupled without delay: {self.coupled_radius:.6g})"
        for name, reason in self.unchecked.items():
            text += f"\n  not checked: {name}, {reason}"
        return text


@dataclass(frozen=True)
class _Model:
    """Linear model of one member, inputs and outputs those of its connections."""

    a: Array
    b: Array
    c: Array
    d: Array


class _Linear:
    """A component that steps a linear model exactly."""

    def __init__(self, model: _Model, inputs: Sequence[Variable], outputs: Sequence[Variable], step: float):
        n = len(model.a)
        block = np.zeros((n + len(inputs), n + len(inputs)))
        block[:n, :n], block[:n, n:] = model.a, model.b
        self._map = expm(block * step)[:n]
        self._out = np.hstack([model.c, model.d])
        self.x = np.zeros(n)
        self.inputs, self.outputs = list(inputs), list(outputs)
        self.description = Description("linear", {v.name: v for v in [*inputs, *outputs]}, kind="continuous")

    def bind(self, inputs: Sequence[Variable], outputs: Sequence[Variable], u: Array, y: Array) -> Ports:
        columns = [self.inputs.index(v) for v in inputs]
        rows = [self.outputs.index(v) for v in outputs]
        held = np.zeros(len(self.inputs))

        def set_inputs() -> None:
            held[columns] = u

        def step(_: float, __: float) -> None:
            self.x[:] = self._map @ np.concatenate([self.x, held])

        def get_outputs() -> None:
            y[:] = (self._out @ np.concatenate([self.x, held]))[rows]

        return Ports.of(set_inputs, step, get_outputs)

    def get(self, variables: Sequence[Variable]) -> list[Any]:
        return [0.0 for _ in variables]

    def __getattr__(self, name: str) -> Any:
        if name in ("instantiate", "enter_initialization", "exit_initialization", "terminate", "close", "set"):
            return lambda *_: None
        raise AttributeError(name)


def coupled_spectral_radius(system: System) -> Stability:
    """Spectral radius of the system's continuous components over one cycle of its schedule.

    Uses the simulation that is running, or initializes one. Components without directional derivatives are
    reported in `unchecked`; raises CosimError when none is left.
    """
    running = system._simulation
    if running is None or running.finished:
        with system.initialize(record=[]) as simulation:
            return _analyse(simulation.schedule)
    return _analyse(running.schedule)


def warn_if_unstable(system: System) -> None:
    """Issue a StabilityWarning when the exchange makes the system grow; silent when nothing can be checked."""
    try:
        result = coupled_spectral_radius(system)
    except CosimError:
        return
    if not result.stable:
        warnings.warn(
            f"the coupling is unstable with these steps: {result}. Use a Gauss-Seidel group or smaller steps",
            StabilityWarning,
            stacklevel=3,
        )


def _analyse(schedule: Schedule) -> Stability:
    members = schedule.continuous
    inner = [c for c in schedule.connections if c.source in members and c.target in members]
    models: dict[Member, _Model] = {}
    unchecked: dict[str, str] = {}
    ports: dict[Member, tuple[list[Variable], list[Variable]]] = {}
    for m in members:
        inputs = [c.input for c in inner if c.target is m]
        outputs = list(dict.fromkeys(c.output for c in inner if c.source is m))
        ports[m] = (inputs, outputs)
        try:
            models[m] = _Model(*m.component.linearize(inputs, outputs))  # type: ignore[attr-defined]
        except (CosimError, AttributeError) as error:
            unchecked[m.name] = str(error) if isinstance(error, CosimError) else "it offers no linear model"
    if not models:
        reasons = "; ".join(f"{name}: {reason}" for name, reason in unchecked.items())
        raise CosimError(f"no continuous component can be linearized ({reasons or 'there is none'})")
    inner = [c for c in inner if c.source in models and c.target in models]
    linear = _linear_system(schedule, models, ports, inner)
    matrix, owners, cycle = _cycle_map(linear)
    values, left, right = eig(matrix, left=True)
    largest = int(np.argmax(np.abs(values)))
    coupled = np.exp(np.max(_coupled(models, ports, inner).real, initial=-np.inf) * cycle)
    shares = _shares(np.abs(left[:, largest].conj() * right[:, largest]), owners)
    return Stability(float(np.abs(values[largest])), float(coupled), cycle, shares, unchecked)


def _linear_system(
    schedule: Schedule,
    models: dict[Member, _Model],
    ports: dict[Member, tuple[list[Variable], list[Variable]]],
    connections: Sequence[Connection],
) -> System:
    """The same schedule with linear models in the place of the components."""
    system = System()
    twin: dict[Member, Member] = {}
    for m, model in models.items():
        component: Any = _Linear(model, *ports[m], float(m.step))
        twin[m] = Member(m.name, component, m.step, m.offset, "continuous")
        system.members[m.name] = twin[m]
    for c in connections:
        copy = Connection(twin[c.source], c.output, twin[c.target], c.input, c.delay, scale=c.scale)
        system.connections[c.target_name] = copy
    for group in schedule.groups:
        if group.name:
            chosen = tuple(twin[m] for m in group.members if m in twin)
            system.groups[group.name] = Group(group.name, chosen, group.method)
    return system


def _cycle_map(system: System) -> tuple[Array, list[str], float]:
    """Matrix of one cycle over (all states, all exchanged values), the component each belongs to, the cycle [s].
    Column by column: a unit deviation is run through the master."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        simulation = Simulation(system, record=[], allow_nan=True)
    states = [m.component.x for m in simulation.schedule.members]  # type: ignore[attr-defined]
    owners = [m.name for m, x in zip(simulation.schedule.members, states, strict=True) for _ in x]
    values = simulation._values
    owners += simulation._layout.owners()
    begin, length = simulation._timetable.cycle()
    size = len(owners)
    matrix = np.zeros((size, size))
    vector = np.zeros(size)
    bounds = np.cumsum([0, *(len(x) for x in states), len(values)])
    parts = list(zip([*states, values], bounds[:-1], bounds[1:], strict=True))
    for column in range(size):
        vector[:] = 0.0
        vector[column] = 1.0
        for part, low, high in parts:
            part[:] = vector[low:high]
        simulation._tick, simulation._phase = begin, Phase.NOTHING
        simulation._run_instants(begin + length)
        matrix[:, column] = np.concatenate([part for part, _, _ in parts])
    return matrix, owners, simulation._base.seconds(begin + length) - simulation._base.seconds(begin)


def _coupled(
    models: dict[Member, _Model],
    ports: dict[Member, tuple[list[Variable], list[Variable]]],
    connections: Sequence[Connection],
) -> Any:
    """Eigenvalues [1/s] of the components coupled without delay: A + B K (I - D K)^-1 C."""
    inputs = [(m, v) for m in models for v in ports[m][0]]
    outputs = [(m, v) for m in models for v in ports[m][1]]
    k = np.zeros((len(inputs), len(outputs)))
    for c in connections:
        k[inputs.index((c.target, c.input)), outputs.index((c.source, c.output))] = c.scale
    a, b, c_, d = (_diagonal([getattr(model, name) for model in models.values()]) for name in "abcd")
    closed = a + b @ k @ np.linalg.solve(np.eye(len(outputs)) - d @ k, c_)
    return np.linalg.eigvals(closed) if len(closed) else np.zeros(0)


def _diagonal(blocks: list[Array]) -> Array:
    result = np.zeros((sum(b.shape[0] for b in blocks), sum(b.shape[1] for b in blocks)))
    row = column = 0
    for block in blocks:
        result[row : row + block.shape[0], column : column + block.shape[1]] = block
        row, column = row + block.shape[0], column + block.shape[1]
    return result


def _shares(participation: Array, owners: list[str]) -> tuple[tuple[str, float], ...]:
    totals: dict[str, float] = {}
    for name, amount in zip(owners, participation, strict=True):
        totals[name] = totals.get(name, 0.0) + float(amount)
    whole = sum(totals.values()) or 1.0
    ordered = sorted(totals.items(), key=lambda item: (-item[1], item[0]))
    return tuple((name, amount / whole) for name, amount in ordered)
