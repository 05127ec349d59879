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
from typing import Any

import numpy as np

from cosim.core.component import Array
from cosim.core.description import Variable
from cosim.core.errors import CosimError, IsolationCrashed, StabilityWarning
from cosim.core.time import seconds_text
from cosim.engine.clock import cycle
from cosim.engine.exchange import Exchange, Phase
from cosim.engine.initialization import initialize
from cosim.linear.linearized import LinearizedContinuous, Model, diagonal, model_of
from cosim.system.components import Connection, Group, SystemComponent
from cosim.system.loops import numeric
from cosim.system.schedule import Schedule, make_schedule

TOLERANCE = 1e-5


@dataclass(frozen=True)
class Stability:
    """Stability of the coupled continuous components.

    `radius`: growth of a deviation per cycle of `cycle` [s]; `coupled_radius`: the same for the components coupled
    without delay; `dominant`: components in the growing mode with their shares (participation, sum 1), largest first;
    `unchecked`: continuous components left out, with the reason.
    """

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
        text = (
            f"spectral radius {self.radius:.6g} per cycle of {seconds_text(self.cycle)}, dominated by"
            f" {names or 'nothing'}"
        )
        if self.coupled_radius > 1.0:
            text += f" (coupled without delay: {self.coupled_radius:.6g})"
        for name, reason in self.unchecked.items():
            text += f"\n  not checked: {name}, {reason}"
        return text


def warn_if_unstable(schedule: Schedule) -> None:
    """Issue a StabilityWarning when the exchange makes the system grow; silent when nothing can be checked."""
    try:
        result = coupled_spectral_radius(schedule)
    except IsolationCrashed:
        raise
    except CosimError:
        return
    if not result.stable:
        warnings.warn(
            f"the coupling is unstable with these steps: {result}. Use a Gauss-Seidel group or smaller steps",
            StabilityWarning,
            stacklevel=3,
        )


def coupled_spectral_radius(schedule: Schedule) -> Stability:
    """Spectral radius of the continuous components over one cycle of their schedule, linearized at the present values.

    The components must be initialized. Those without directional derivatives are reported in `unchecked`; raises
    CosimError when none is left.
    """
    components = schedule.continuous
    inner = [c for c in numeric(schedule.connections) if c.source in components and c.target in components]
    models: dict[SystemComponent, Model] = {}
    unchecked: dict[str, str] = {}
    ports: dict[SystemComponent, tuple[list[Variable], list[Variable]]] = {}
    for m in components:
        inputs = [c.input for c in inner if c.target is m]
        outputs = list(dict.fromkeys(c.output for c in inner if c.source is m))
        ports[m] = (inputs, outputs)
        try:
            models[m] = model_of(m, inputs, outputs)
        except IsolationCrashed:
            raise
        except CosimError as error:
            unchecked[m.name] = str(error)
    if not models:
        reasons = "; ".join(f"{name}: {reason}" for name, reason in unchecked.items())
        raise CosimError(f"no continuous component can be linearized ({reasons or 'there is none'})")
    inner = [c for c in inner if c.source in models and c.target in models]
    matrix, owners, cycle = _cycle_map(_linear_schedule(schedule, models, ports, inner))
    if not len(matrix):
        return Stability(0.0, 0.0, cycle, _shares(np.zeros(0), owners), unchecked)  # nothing remembers a deviation
    radius = float(np.abs(np.linalg.eigvals(matrix)).max())
    coupled = np.exp(np.max(_coupled(models, ports, inner).real, initial=-np.inf) * cycle)
    return Stability(radius, float(coupled), cycle, _shares(_participation(matrix, radius), owners), unchecked)


def _participation(matrix: Array, radius: float) -> Array:
    """Participation of each value in the modes that grow by `radius`, conjugate modes taken as one.

    It is the diagonal of the projector on their subspace. For a single mode these are the products of the entries of
    its left and right eigenvectors; for modes of equal growth they do not depend on which eigenvectors LAPACK chooses.
    """
    from scipy.linalg import schur  # slow to import, and few runs need it

    def fastest(growth: complex) -> bool:
        return abs(growth) >= radius * (1 - TOLERANCE) and growth.imag >= -TOLERANCE * radius

    _, right, size = schur(matrix, output="complex", sort=fastest)
    _, left, _ = schur(matrix.conj().T, output="complex", sort=lambda growth: fastest(growth.conjugate()))
    right, left = right[:, :size], left[:, :size]
    return np.abs(np.einsum("ij,ji->i", right, np.linalg.pinv(left.conj().T @ right) @ left.conj().T))


def _linear_schedule(
    schedule: Schedule,
    models: dict[SystemComponent, Model],
    ports: dict[SystemComponent, tuple[list[Variable], list[Variable]]],
    connections: Sequence[Connection],
) -> Schedule:
    """The same schedule with linear models in the place of the components."""
    linearized: dict[SystemComponent, SystemComponent] = {}
    for m, model in models.items():
        linearized[m] = SystemComponent(
            m.name, LinearizedContinuous(model, *ports[m], float(m.step)), m.step, m.offset, "continuous"
        )
    copies = [
        Connection(linearized[c.source], c.output, linearized[c.target], c.input, c.delay, scale=c.scale)
        for c in connections
    ]
    groups = [
        Group(g.name, tuple(linearized[m] for m in g.components if m in linearized), g.method)
        for g in schedule.groups
        if g.name
    ]
    return make_schedule(linearized.values(), copies, groups)


def _cycle_map(schedule: Schedule) -> tuple[Array, list[str], float]:
    """Matrix of one cycle over (all states, all exchanged values), the component each belongs to, the cycle [s].

    It is computed column by column: a unit deviation is run through the master.
    """
    exchange = Exchange(schedule, allow_nan=True)
    initialize(exchange)
    states = [m.implementation.x for m in schedule.components]  # type: ignore[attr-defined]
    owners = [m.name for m, x in zip(schedule.components, states, strict=True) for _ in x]
    owners += exchange.layout.owners()
    begin, length = cycle(exchange.clocks)
    size = len(owners)
    matrix = np.zeros((size, size))
    vector = np.zeros(size)
    bounds = np.cumsum([0, *(len(x) for x in states), len(exchange.values)])
    parts = list(zip([*states, exchange.values], bounds[:-1], bounds[1:], strict=True))
    for column in range(size):
        vector[:] = 0.0
        vector[column] = 1.0
        for part, low, high in parts:
            part[:] = vector[low:high]
        exchange.tick, exchange.phase = begin, Phase.NOTHING
        exchange.run_instants(begin + length)
        matrix[:, column] = np.concatenate([part for part, _, _ in parts])
    return matrix, owners, exchange.base.seconds(begin + length) - exchange.base.seconds(begin)


def _coupled(
    models: dict[SystemComponent, Model],
    ports: dict[SystemComponent, tuple[list[Variable], list[Variable]]],
    connections: Sequence[Connection],
) -> Any:
    """Eigenvalues [1/s] of the components coupled without delay: A + B K (I - D K)^-1 C."""
    inputs = [(m, v) for m in models for v in ports[m][0]]
    outputs = [(m, v) for m in models for v in ports[m][1]]
    k = np.zeros((len(inputs), len(outputs)))
    for c in connections:
        k[inputs.index((c.target, c.input)), outputs.index((c.source, c.output))] = c.scale
    all_ = diagonal(list(models.values()))
    closed = all_.a + all_.b @ k @ np.linalg.solve(np.eye(len(outputs)) - all_.d @ k, all_.c)
    return np.linalg.eigvals(closed) if len(closed) else np.zeros(0)


def _shares(participation: Array, owners: list[str]) -> tuple[tuple[str, float], ...]:
    totals: dict[str, float] = {}
    for name, amount in zip(owners, participation, strict=True):
        totals[name] = totals.get(name, 0.0) + float(amount)
    whole = sum(totals.values()) or 1.0
    ordered = sorted(totals.items(), key=lambda item: (-item[1], item[0]))
    return tuple((name, amount / whole) for name, amount in ordered)
