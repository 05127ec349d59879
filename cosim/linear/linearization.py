"""Linear models of systems about where they stand, as matrices with names.

Continuous model (`continuous_model`): the continuous components, linearized by their directional derivatives and
coupled through their connections without the delays of the exchange,

    dx/dt = A x + B u,    y = C x + D u;

the outputs of discrete components are inputs of it.

Sampled model (`cosim.linear.sampled_model`): the map of the whole system over one common period T of all steps, in the
master's own order,

    x[k+1] = A x[k] + B u[k],    y[k] = C x[k] + D u[k].

x[k] is what there is right before the instant k T: states of continuous and of discrete components, and values that are
held (inputs of the latest step of a continuous component that show in its outputs, commands between samples). u[k] is
held over the period; y[k] is what a recording shows at k T. Continuous components are linearized where they stand at
the beginning of the period and made discrete exactly for inputs held over their steps. Discrete components are
linearized at each of their samples of one period, by perturbing their states and inputs (central differences) while the
system runs through it. Then all are replaced by these models (`cosim.linear.linearized`), and the same master with the
same schedule takes every unit deviation through the period.

A state of a discrete component that never changes is a constant of the operating point, and one that acts on nothing (a
counter of samples) is a matter of the period: both are left out. A component with a kink or jump at the operating point
is refused (continuous FMUs: `cosim.fmu.kinks`), and one with too many numbers in its matrices before they are computed.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence

import numpy as np

from build_fmus.base.checks import did_you_mean, glob
from cosim.core.component import Array
from cosim.core.description import Variable
from cosim.core.errors import CosimError, LoopError, WiringError
from cosim.linear.linearized import Model, diagonal, model_of
from cosim.linear.statespace import Matrices
from cosim.system.components import SystemComponent
from cosim.system.names import SystemComponents, elements, fits_any
from cosim.system.schedule import Schedule

Signal = tuple[SystemComponent, Variable]


def name_of(signal: Signal) -> str:
    """Full name of a signal, `component.variable`."""
    return f"{signal[0].name}.{signal[1].name}"


def choose_inputs(
    components: SystemComponents, schedule: Schedule, sampled: bool, patterns: str | Iterable[str] | None
) -> list[Signal]:
    """Inputs of a model by name and pattern; all by default.

    Raises WiringError with the reason for variables that cannot be inputs.
    """
    driven = {(c.target, c.input): c for c in schedule.connections}
    commands = {(c.source, c.output): None for c in schedule.connections if c.source.discrete and not c.target.discrete}
    every = [(m, v) for m in schedule.components for v in m.description.inputs.values()]
    free = [s for s in every if s not in driven and (sampled or not s[0].discrete)]
    usual = [s for s in [*([] if sampled else commands), *free] if s[1].type == "real" and s[1].must_equal is None]
    if patterns is None:
        return usual

    def refuse(signal: Signal) -> None:
        connection = driven.get(signal)
        if signal in usual or (
            connection is not None and not sampled and connection.source.discrete and not signal[0].discrete
        ):
            return
        name = name_of(signal)
        if connection is not None:
            raise WiringError(
                f"{name} is no input of the model: {connection.source_name} drives it; disconnect it first"
            )
        raise WiringError(f"{name} is no input of the model; these are: {', '.join(map(name_of, usual)) or 'none'}")

    chosen: dict[Signal, None] = {}
    for pattern in [patterns] if isinstance(patterns, str) else patterns:
        if set("*?") & set(pattern):
            fits = glob(pattern)
            found = [s for s in usual if fits_any(fits, *s)]
            if not found:
                raise WiringError(f"'{pattern}' fits no input of the model{did_you_mean(pattern, map(name_of, usual))}")
        else:
            component, name = components.split(pattern)
            found = [(component, v) for v in elements(component, name)]
        for signal in found:
            refuse(signal)
            chosen[signal] = None
    return list(chosen)


def choose_outputs(
    components: SystemComponents, schedule: Schedule, sampled: bool, patterns: str | Iterable[str] | None
) -> list[Signal]:
    """Outputs of a model by name and pattern; all Real ones by default. Raises WiringError for what can be none."""
    if patterns is None:
        return [
            (m, v)
            for m in (schedule.components if sampled else schedule.continuous)
            for v in m.description.outputs.values()
            if v.type == "real"
        ]
    chosen: dict[Signal, None] = {}
    for pattern in [patterns] if isinstance(patterns, str) else patterns:
        found = components.select(pattern)
        real = [(m, v) for m, v in found if v.type == "real" and v.causality in ("output", "local")]
        if not real or (len(real) < len(found) and not set("*?") & set(pattern)):
            raise WiringError(f"'{pattern}' is no Real output")
        for m, v in real:
            if m.discrete and not sampled:
                raise WiringError(f"{m.name}.{v.name} belongs to a discrete component: linearize with discrete=True")
            chosen[m, v] = None
    return list(chosen)


def units_by_name(signals: Iterable[Signal]) -> dict[str, str]:
    """Units of the signals that have one, by name."""
    return {name_of(s): s[1].unit_name for s in signals if s[1].unit_name}


def operating_point(signals: Sequence[Signal]) -> dict[str, float]:
    """Present values of signals, by name."""
    return {name_of((m, v)): float(m.implementation.get([v])[0]) for m, v in signals}


def component_models(
    schedule: Schedule, ports: Mapping[SystemComponent, tuple[list[Variable], list[Variable]]]
) -> dict[SystemComponent, Model]:
    """Models of the continuous components for these inputs and outputs.

    Raises CosimError for a component that cannot be linearized, or lies on a kink.
    """
    models = {}
    for m in schedule.continuous:
        if m.description.fmi_version and not m.description.states and not m.description.model_exchange:
            raise CosimError(
                f"'{m.name}' cannot be linearized: its FMU ({m.description.name}) lists no states, and without Model"
                " Exchange it may have some"
            )
        try:
            models[m] = model = model_of(m, *ports[m])
            if hasattr(m.implementation, "refuse_kinks"):
                m.implementation.refuse_kinks(*ports[m], np.block([[model.a, model.b], [model.c, model.d]]))
        except CosimError as error:
            raise CosimError(f"'{m.name}' cannot be linearized: {error}") from None
    return models


def state_signals(m: SystemComponent, count: int) -> list[tuple[str, Variable | None]]:
    """Names of the states of a component, with their variables where its FMU lists them; else numbers them."""
    known = m.description.states
    return (
        [(f"{m.name}.{v.name}", v) for v in known] if known else [(f"{m.name}.x[{i + 1}]", None) for i in range(count)]
    )


def continuous_model(schedule: Schedule, inputs: Sequence[Signal], outputs: Sequence[Signal]) -> Matrices:
    """Model of the continuous components of an initialized system.

    `inputs`: their own inputs that no continuous component drives, or outputs of discrete components; `outputs`: their
    own. Raises CosimError for components and connections without a linear model, LoopError for a singular algebraic
    loop.
    """
    components = schedule.continuous
    if not components:
        raise CosimError("no component is continuous: linearize with discrete=True")
    inner = [
        c for c in schedule.connections if c.source in components and c.target in components and c.output.type == "real"
    ]
    for c in inner:
        if c.delay:
            raise CosimError(
                f"{c} is delayed by one step, which a continuous model has not: linearize with discrete=True"
            )
    reached = [
        (c, (c.source, c.output)) for c in schedule.connections if c.target in components and c.source not in components
    ]
    ports: dict[SystemComponent, tuple[list[Variable], list[Variable]]] = {}
    for m in components:
        wanted = [c.input for c in inner if c.target is m] + [
            c.input for c, s in reached if c.target is m and s in inputs
        ]
        own = [*wanted, *(v for owner, v in inputs if owner is m)]
        shown = [*(c.output for c in inner if c.source is m), *(v for owner, v in outputs if owner is m)]
        ports[m] = (list(dict.fromkeys(own)), list(dict.fromkeys(shown)))
    models = component_models(schedule, ports)
    all_ = diagonal(list(models.values()))
    u = {(m, v): i for i, (m, v) in enumerate((m, v) for m in components for v in ports[m][0])}
    y = {(m, v): i for i, (m, v) in enumerate((m, v) for m in components for v in ports[m][1])}
    coupling = np.zeros((len(u), len(y)))
    for c in inner:
        coupling[u[c.target, c.input], y[c.source, c.output]] = c.scale
    drive = np.zeros((len(u), len(inputs)))
    for column, signal in enumerate(inputs):
        if signal in u:
            drive[u[signal], column] = 1.0
        for c, source in reached:
            if source == signal:
                drive[u[c.target, c.input], column] = c.scale
    a, b, c_, d = _closed(all_, coupling, list(u))
    show = np.zeros((len(outputs), len(y)))
    show[range(len(outputs)), [y[s] for s in outputs]] = 1.0
    states = [s for m in components for s in state_signals(m, len(models[m].a))]
    known = [(m, v) for m in components for v in m.description.states]
    return Matrices(
        a,
        b @ drive,
        show @ c_,
        show @ d @ drive,
        [name for name, _ in states],
        [name_of(s) for s in inputs],
        [name_of(s) for s in outputs],
        units=units_by_name([*known, *inputs, *outputs]),
        point=operating_point([*known, *inputs, *outputs]),
    )


def _closed(model: Model, coupling: Array, inputs: Sequence[Signal]) -> tuple[Array, Array, Array, Array]:
    """The model with its own outputs fed back to its inputs: u = coupling y + r.

    Raises LoopError if y does not follow from r.
    """
    if not coupling.any():
        return model.a, model.b, model.c, model.d
    loop = np.eye(len(coupling)) - coupling @ model.d
    _, singular, right = np.linalg.svd(loop)
    unsolved = singular <= 1e3 * np.finfo(float).eps * singular[0]
    if unsolved.any():
        null = np.linalg.norm(right[unsolved], axis=0)
        names = [name_of(s) for s, part in zip(inputs, null, strict=True) if part > 1e-6 * null.max()]
        raise LoopError(
            f"an algebraic loop has no solution: {', '.join(names)} depend on themselves at the same instant with a"
            " gain of 1; give one of the connections delay=True and linearize with discrete=True"
        )
    import control

    plant = control.StateSpace(model.a, model.b, model.c, model.d, remove_useless_states=False)
    closed = plant.feedback(control.StateSpace([], [], [], coupling), sign=1)
    return closed.A, closed.B, closed.C, closed.D
