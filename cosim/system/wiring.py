"""Components, connections and rates, checked while they are put together."""

from __future__ import annotations

import os
import threading
import warnings
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import replace
from fractions import Fraction
from pathlib import Path
from typing import Any, Literal

from build_fmus.base.checks import did_you_mean, glob, number, unknown
from build_fmus.base.escape import NO_XML
from build_fmus.base.units import KNOWN, UnitMismatchError, conversion
from cosim.core.component import Component, PythonComponent
from cosim.core.description import LONGEST_TEXT, RECORDABLE, TEXTS, WIDE, Description, Variable, split_index
from cosim.core.errors import FmuWarning, WiringError
from cosim.core.time import TimeLike, positive, rational, seconds_text
from cosim.fmu.component import FmuComponent
from cosim.fmu.file import FmuFile
from cosim.fmu.find import find
from cosim.fmu.isolation import Isolation
from cosim.fmu.isolation import require as require_isolation
from cosim.fmu.model_exchange import ModelExchange
from cosim.system import terminal_wires
from cosim.system.components import Connection, Group, SystemComponent, article, structural
from cosim.system.names import SystemComponents, elements, fits_any
from cosim.system.renewal import PythonSource
from cosim.system.schedule import Schedule, make_schedule, unconnected

Kind = Literal["discrete", "continuous"]


class Wiring:
    """Components by name, connections by the name of their target, and groups by name."""

    def __init__(self, *, allow_unconnected: bool = False) -> None:
        self.allow_unconnected = allow_unconnected
        """Inputs that nothing drives are meant so; otherwise a run warns of them (UnconnectedInputsWarning)."""
        self.experiment: tuple[Fraction, Fraction | None] = Fraction(0), None
        """Start and stop time [s] that an SSP proposes."""
        self.components = SystemComponents()
        self.connections: dict[str, Connection] = {}
        self.groups: dict[str, Group] = {}
        self.lock = threading.RLock()
        """For calls of the components, by simulations, their saved states and gradients."""
        self._fmus: dict[tuple[Path, str | None], FmuFile] = {}

    def __getitem__(self, name: str) -> SystemComponent:
        return self.components[name]

    def end_simulation(self) -> None:
        """End the simulation that runs on this system, if there is one: its components are free for something else."""

    # Putting it together.

    def add(
        self,
        name: str,
        fmu: str | os.PathLike[str] | FmuFile | Component | Callable[[], PythonComponent],
        *,
        step: TimeLike | None = None,
        offset: TimeLike = 0,
        kind: Kind | None = None,
        parameters: Mapping[str, Any] | None = None,
        start: Mapping[str, Any] | None = None,
        strict: bool = False,
        isolated: bool = False,
        step_timeout: float | None = None,
        memory_limit: int | None = None,
        interface: Literal["cs", "me"] | ModelExchange | None = None,
    ) -> SystemComponent:
        """Add a component.

        It is the path of an FMU, the name of a built FMU of the catalog (`FullCarHmmwv`), a loaded `Fmu`, any
        `Component`, or a class or function without arguments that makes a `PythonComponent`.

        Each run executes a copy of a `PythonComponent` as it was added, or what the class or function makes for it. The
        object that ran last is `system["name"].implementation`.

        `step` and `offset` [s] are exact: 0.001, "1/60", "10 ms". Without `step` a discrete component uses its sample
        time, a continuous one the step size of its default experiment. `kind` is needed only for discrete third-party
        FMUs (they do not say it). `parameters` and `start` set variables by name before every initialization;
        structural parameters (FMI 3.0) among them give arrays their sizes, and cannot be changed afterwards. `strict`
        refuses an FMU that deviates from the standard (FmuError), which otherwise is warned of (FmuWarning).
        `isolated`, with `step_timeout` and `memory_limit`: as in `isolate`. `interface` chooses between Co-Simulation
        ("cs", the default where an FMU offers it) and Model Exchange ("me", or `ModelExchange` with tolerance and
        solver), in which the master integrates the FMU.
        """
        if not isinstance(name, str):
            raise WiringError(f"a component's name is a text, not {name!r}")
        if not all(name.split(".")) or any(c.isspace() or c in "*?" for c in name) or NO_XML.search(name):
            raise WiringError(
                "a component's name must not contain blanks, control characters or the * and ? of patterns; dots may"
                f" only separate its parts: {name!a}"
            )
        if name in self.components:
            raise WiringError(f"there is already a component '{name}'")
        other = next((n for n in self.components if n.startswith(f"{name}.") or name.startswith(f"{n}.")), None)
        if other is not None:
            raise WiringError(f"a component '{name}' beside '{other}' would make names of variables ambiguous")
        source = PythonSource.of(fmu)
        implementation = self._component(fmu if source is None else source.added, strict, interface)
        if structure := structural(name, implementation.description, {**(parameters or {}), **(start or {})}):
            assert isinstance(implementation, FmuComponent)  # nothing else has structural parameters
            own, variables = implementation.description.canonical, implementation.description.variables
            if changed := {n: v for n, v in structure.items() if v != variables[n].start}:
                implementation.restructure(changed)
            parameters, start = (
                {n: v for n, v in (values or {}).items() if own(n) not in structure} for values in (parameters, start)
            )
        about = implementation.description
        kind = kind or about.kind or "continuous"  # type: ignore[assignment]
        if kind not in ("discrete", "continuous"):
            raise WiringError(f"component '{name}': kind is 'discrete' or 'continuous', not {kind!r}")
        period = step if step is not None else (about.sample_time if kind == "discrete" else None) or about.default_step
        if period is None:
            raise WiringError(f"component '{name}' ({about.name}) declares no step: give one, for example step='1 ms'")
        period = positive(period, f"step of '{name}'")
        begin = rational(offset, f"offset of '{name}'")
        if begin < 0:
            raise WiringError(f"component '{name}': the offset must not be negative, it is {offset}")
        _check_internal_step(name, about, period)
        component = SystemComponent(name, implementation, period, begin, kind, source=source)
        component.set(parameters)
        component.set(start)
        if isolated not in (True, False):
            raise WiringError(f"component '{name}': isolated is {isolated!r}; give True or False")
        if isolated and _can_be_isolated(component, required=True):
            _isolate(component, _limits(step_timeout, memory_limit))
        elif step_timeout is not None or memory_limit is not None:
            raise WiringError(
                f"component '{name}': step_timeout and memory_limit are limits of isolated FMUs (isolated=True)"
            )
        self.components[name] = component
        return component

    def isolate(
        self, *names: str, step_timeout: float | None = None, memory_limit: int | None = None, missing_ok: bool = False
    ) -> None:
        """Run these FMUs (names and patterns, `"*"` for all) each in its own process from the next initialization on.

        A crash, a hang or endless allocation there ends the run with ComponentError and hurts nothing else. Numbers
        stay the same.

        `step_timeout`: wall time of one call [s], default 60; `memory_limit`: bytes that an FMU may allocate, default
        half of the machine's memory. Raises WiringError for unknown names (unless `missing_ok`) and for components that
        are no FMUs.
        """
        limits = _limits(step_timeout, memory_limit)
        chosen: list[SystemComponent] = []
        for pattern in names:
            found = [m for m in self.components.values() if glob(pattern)(m.name)]
            if not found and not missing_ok:
                raise WiringError(unknown("component", pattern, self.components))
            chosen += [m for m in found if _can_be_isolated(m, required=m.name == pattern)]
        for component in chosen:
            _isolate(component, limits)

    def _component(self, fmu: Any, strict: bool, interface: str | ModelExchange | None) -> Component:
        exchange = interface if isinstance(interface, ModelExchange) else None
        kind = "me" if isinstance(interface, ModelExchange) else interface
        if isinstance(fmu, FmuFile) and kind not in (None, fmu.description.interface):
            fmu = fmu.path
        if isinstance(fmu, str | os.PathLike):
            file = find(fmu)
            key = file.absolute(), kind
            if key not in self._fmus:
                self._fmus[key] = FmuFile(file, strict=strict, interface=kind)
            fmu = self._fmus[key]
        if isinstance(fmu, FmuFile):
            if strict:
                fmu.require_standard()
            fmu.check_platform()
            return FmuComponent(fmu, exchange=exchange)
        if interface is not None:
            raise WiringError(
                "interface chooses an interface of an FMU, and this component is not an FMU: leave it out"
            )
        if not (hasattr(fmu, "bind") and isinstance(getattr(fmu, "description", None), Description)):
            raise WiringError(
                f"cannot use {fmu!r}: give the path of an .fmu file, the name of a built FMU, an Fmu or a Component"
            )
        if any(fmu is m.implementation or (m.source and fmu is m.source.added) for m in self.components.values()):
            raise WiringError("this component object is already in the system; make a second one")
        return fmu  # type: ignore[no-any-return]

    def connect(
        self,
        source: str,
        target: str,
        *,
        delay: bool = False,
        extrapolate: bool = False,
        linear: tuple[float, float] | None = None,
        max_size: int | None = None,
    ) -> list[Connection]:
        """Connect an output to an input, or an array to an array by their names without index.

        Units are checked and converted. `delay` gives the input the value of the source's step before (one step of
        the source). `extrapolate` lets a continuous target see the line through the source's last two values, at the
        middle of its step, instead of the last value (of a source ahead of it in a Gauss-Seidel group: interpolated
        between the value before and the one just reached). Extrapolated both ways a coupling is of second order in the
        communication step, otherwise of first. `linear`: factor and offset by which the target's value follows from the
        source's, instead of the conversion of units. `max_size`: bytes that a String or Binary may have; default what
        the FMUs declare (`maxSize`), else 1024. A calculated parameter can be connected to a parameter, which gets its
        value in initialization. Raises WiringError naming what does not fit.
        """
        from_component, output = self.components.split(source)
        to_component, input_ = self.components.split(target)
        outputs, inputs = elements(from_component, output), elements(to_component, input_)
        if len(outputs) != len(inputs):
            raise WiringError(f"{source} has {len(outputs)} element(s), {target} has {len(inputs)}")
        shapes = [
            [len(set(places)) for places in zip(*(split_index(v.name)[1] for v in found), strict=True)]
            for found in (outputs, inputs)
            if len(found) > 1
        ]
        if len(shapes) == 2 and len(shapes[0]) == len(shapes[1]) > 1 and shapes[0] != shapes[1]:
            sizes = [" x ".join(map(str, shape)) for shape in shapes]
            raise WiringError(f"{source} has {sizes[0]} elements, {target} has {sizes[1]}: connect element by element")
        made = [
            self._connection(
                (from_component, o),
                (to_component, i),
                delay=delay,
                extrapolate=extrapolate,
                linear=linear,
                max_size=max_size,
            )
            for o, i in zip(outputs, inputs, strict=True)
        ]
        return self._connected(made)

    def _connected(self, made: list[Connection]) -> list[Connection]:
        self.connections.update((c.target_name, c) for c in made)
        return made

    def connect_matching(
        self, source: str, target: str, pattern: str = "*", *, delay: bool = False, extrapolate: bool = False
    ) -> list[Connection]:
        """Connect every output of `source` whose name matches `pattern` (wildcards * and ?) to its input of `target`.

        The input has the same name; inputs that are connected already are skipped. Returns the connections; raises
        WiringError, and connects nothing, if no pair matches or a pair does not fit.

        Where an FMU declares terminals, names are also those that its variables have there (`terminal.name`), and two
        terminals of one name must fit, see `connect_terminals`; WiringError says what does not.
        """
        from_component, to_component, fits = self[source], self[target], glob(pattern)
        offered, needed = from_component.description, to_component.description
        named = [(o.name, n) for o in offered.outputs.values() for n in offered.names(o) if fits(n)]
        pairs: dict[str, str] = {}  # output by input
        for output, name in sorted(
            named, key=lambda pair: pair[0] != pair[1]
        ):  # aliases after the variables' own names
            input_ = needed.canonical(name)
            if input_ in needed.inputs and f"{target}.{input_}" not in self.connections:
                pairs.setdefault(input_, output)
        further = [
            wire
            for first, second in terminal_wires.common(from_component, to_component)
            if any(fits(n) for place in (first, second) for n in terminal_wires.names(place.terminal))
            for wire in terminal_wires.wires(first, second, nested=False)
            if wire.source is from_component
            and wire.input not in pairs
            and f"{target}.{wire.input}" not in self.connections
            if any(fits(n) for n in (*wire.labels, wire.output))
        ]
        if not pairs and not further:
            raise WiringError(
                f"no output of '{source}' that fits '{pattern}' has a free input of the same name in '{target}'; "
                f"outputs: {_some(from_component.description.outputs)};"
                f" inputs: {_some(to_component.description.inputs)}"
            )
        made = [
            self._connection(
                (from_component, offered.variables[o]),
                (to_component, needed.variables[i]),
                delay=delay,
                extrapolate=extrapolate,
            )
            for i, o in pairs.items()
        ]
        return self._connected(made + self._wired(further, delay=delay, extrapolate=extrapolate))

    def connect_terminals(
        self, first: str, second: str, *, delay: bool = False, extrapolate: bool = False
    ) -> list[Connection]:
        """Connect two terminals, `component.terminal` (`road.road.fl`, `car.road.fl`), in both directions.

        Terminals in them are connected too; `delay` and `extrapolate` as in `connect`, of every connection made.
        Returns the connections.

        Variables match as FMI 3.0 says (2.4.9.2): by name, all of a `plug`, those that both have of a `bus`; by order
        in a `sequence`. Flows change their sign where both sides count alike, and what a stream carries out of one side
        enters the other. Of an FMU without terminals (FMI 2.0), and of a component in Python, names make them:
        `road.fl.height` is the variable `height` of `road.fl`, a bus. Parameters are not wired. Raises WiringError
        naming terminal and variable that do not fit, FmuError for an FMU whose terminals cannot be understood.
        """
        found = list(
            terminal_wires.wires(
                terminal_wires.find(self.components, first), terminal_wires.find(self.components, second)
            )
        )
        if not found:
            raise WiringError(f"terminals {first} and {second}: no output of one is an input of the other")
        return self._connected(self._wired(found, delay=delay, extrapolate=extrapolate))

    def _wired(self, found: Iterable[terminal_wires.Wire], *, delay: bool, extrapolate: bool) -> list[Connection]:
        """The connections that terminals say, which are not made yet."""
        made: dict[str, Connection] = {}
        flows = {c.source_name: c for c in self.connections.values() if c.flow}
        for wire in found:
            ends = [
                (m, m.description.find(v, m.name)) for m, v in ((wire.source, wire.output), (wire.target, wire.input))
            ]
            new = self._connection(ends[0], ends[1], delay=delay, extrapolate=extrapolate)
            if wire.flow:
                sign = -1.0 if wire.negated else 1.0
                new = replace(new, flow=True, scale=sign * new.scale, offset=sign * new.offset)
                if new.source_name in flows:
                    raise WiringError(
                        f"{wire.at}: {new.source_name} flows into {flows[new.source_name].target_name} already, and"
                        " flows add up to zero where they meet; put a component between them that adds"
                    )
                flows[new.source_name] = new
            if new.target_name in made:
                raise WiringError(f"{wire.at}: {new.target_name} would be connected twice")
            made[new.target_name] = new
        return list(made.values())

    def disconnect(self, pattern: str) -> list[str]:
        """Remove the connections into the inputs whose full names match `pattern` (`car.force.*`); returns the names.

        Raises WiringError when no such connection exists.
        """
        fits = glob(pattern)
        removed = [name for name, c in self.connections.items() if fits_any(fits, c.target, c.input)]
        if not removed:
            raise WiringError(f"'{pattern}' fits no connected input{did_you_mean(pattern, self.connections)}")
        for name in removed:
            del self.connections[name]
        return removed

    def group(
        self,
        name: str,
        components: Sequence[str],
        method: Literal["gauss-seidel", "jacobi"] = "gauss-seidel",
        *,
        extrapolate: bool = False,
    ) -> Group:
        """Let continuous components advance in the declared order (Gauss-Seidel), or side by side (Jacobi).

        In the declared order each uses the values that those before it have just computed. `extrapolate` marks every
        connection from a continuous component into the group made so far.
        """
        if method not in ("gauss-seidel", "jacobi"):
            raise WiringError(f"group '{name}': method is 'gauss-seidel' or 'jacobi', not {method!r}")
        if NO_XML.search(name):
            raise WiringError(f"a group's name must not contain control characters: {name!a}")
        chosen = tuple(self[m] for m in components)
        for component in chosen:
            if component.discrete:
                raise WiringError(
                    f"group '{name}': '{component.name}' is discrete; groups are for continuous components"
                )
            other = next((g.name for g in self.groups.values() if component in g.components and g.name != name), None)
            if other is not None:
                raise WiringError(f"group '{name}': '{component.name}' is already in group '{other}'")
        if len(set(components)) != len(components):
            raise WiringError(f"group '{name}' names a component twice")
        self.groups[name] = Group(name, chosen, method)
        if extrapolate:
            for target, c in list(self.connections.items()):
                numbers = c.input.type in RECORDABLE and not c.sets_parameter
                if c.target in chosen and not c.source.discrete and not c.delay and numbers:
                    self.connections[target] = replace(c, extrapolate=True, size=0)
        return self.groups[name]

    def _connection(
        self,
        origin: tuple[SystemComponent, Variable],
        end: tuple[SystemComponent, Variable],
        *,
        delay: bool,
        extrapolate: bool,
        linear: tuple[float, float] | None = None,
        max_size: int | None = None,
    ) -> Connection:
        (source, output), (target, input_) = origin, end
        names = f"{source.name}.{output.name} -> {target.name}.{input_.name}"
        swapped = output.causality == "input" and input_.causality in ("output", "local")
        by_itself = output.fmi_type == "Clock" and output.name not in source.description.triggered
        passed_on = output.causality == "calculatedParameter" and input_.causality == "parameter"
        for full, variable, taken in (
            (f"{source.name}.{output.name}", output, ("output", "local", *(("input",) if by_itself else ()))),
            (f"{target.name}.{input_.name}", input_, ("input",)),
        ):
            if variable.causality not in taken and not passed_on:
                remedy = "; swap the two ends?" if swapped else ""
                raise WiringError(
                    f"'{full}' is {article(variable.causality)}, not {article(taken[0])}{remedy} ({names})"
                )
        already = self.connections.get(f"{target.name}.{input_.name}")
        if already is not None:
            raise WiringError(f"{names}: this {input_.causality} is already connected to {already.source_name}")
        allowed = {("real", "real"), ("integer", "integer"), ("boolean", "boolean"), ("integer", "real")}
        if passed_on and (delay or extrapolate or max_size is not None):
            raise WiringError(f"{names}: a parameter has no delay, extrapolation or size")
        if output.fmi_type == input_.fmi_type and output.fmi_type in TEXTS:
            size = _text_size(names, origin, end, max_size)
            if extrapolate or linear is not None:
                raise WiringError(f"{names}: {article(output.fmi_type)} has no extrapolation, factor or offset")
            return Connection(source, output, target, input_, delay, size=0 if passed_on else size)
        if output.fmi_type == input_.fmi_type == "Clock":
            if delay or extrapolate or linear is not None or max_size is not None:
                raise WiringError(f"{names}: a clock has no delay, extrapolation, factor, offset or size")
            _check_clocks(names, source, target, input_)
            return Connection(source, output, target, input_)
        if max_size is not None:
            raise WiringError(f"{names}: max_size is for String and Binary, and this is {article(output.fmi_type)}")
        if (output.type, input_.type) not in allowed:
            raise WiringError(f"{names}: types differ, {output.fmi_type} to {input_.fmi_type}")
        if extrapolate and (source.discrete or target.discrete):
            raise WiringError(f"{names}: extrapolation needs two continuous components")
        if extrapolate and delay:
            raise WiringError(f"{names}: choose delay or extrapolation")
        try:
            scale, offset = (
                conversion(output.unit, input_.unit, output.relative and input_.relative)
                if linear is None
                else (
                    float(number(f"{names}: {what}", x, error=WiringError))
                    for what, x in zip(("factor", "offset"), linear, strict=True)
                )
            )
        except UnitMismatchError as error:
            for component, variable in ((source, output), (target, input_)):
                if isinstance(component.implementation, PythonComponent):
                    _check_unit_known(f"{component.name}.{variable.name}", variable)
            raise WiringError(
                f"units differ: {source.name}.{output.name} [{output.unit_name}] -> "
                f"{target.name}.{input_.name} [{input_.unit_name}]: {error}"
            ) from None
        if output.constant is not None and not input_.accepts(value := scale * output.constant + offset):
            raise WiringError(f"{names}: the input {input_.refusal(value)}")
        exact = {output.fmi_type, input_.fmi_type} <= {*WIDE} and (scale, offset, extrapolate) == (1.0, 0.0, False)
        exact = exact and not passed_on
        size = 8 if exact and all(isinstance(m.implementation, FmuComponent) for m in (source, target)) else 0
        return Connection(source, output, target, input_, delay, extrapolate, scale, offset, size=size)

    # Looking at it.

    @property
    def fmu_files(self) -> list[Path]:
        """The FMU files behind its components."""
        return sorted({path for path, _ in self._fmus})

    def canonical(self, full: str) -> str:
        """`component.variable` with the variable's own name where that is an alias; other texts as they are."""
        return self.components.canonical(full)

    def select(self, patterns: str | Iterable[str] | None) -> list[tuple[SystemComponent, Variable]]:
        """Variables by full name or pattern (`*`, `?`).

        A pattern selects outputs; if it matches none, it selects inputs, then local variables. None: every output that
        is no array element. Text variables are left out.
        """
        return self.components.select(patterns)

    def unconnected(self) -> list[str]:
        """Inputs that nothing drives and that were given no start value: they keep the FMU's own."""
        return unconnected(self.components.values(), self.connections)

    def schedule(self, *extra: Fraction) -> Schedule:
        """The order of execution; print it.

        Raises LoopError for a loop among discrete components, or an algebraic one among continuous components that
        cannot be solved. `extra` are further periods the base tick must divide.
        """
        return make_schedule(self.components.values(), self.connections.values(), self.groups.values(), extra)

    def check(self) -> list[str]:
        """Raise what is wrong with the system; returns `unconnected()`."""
        self.schedule()
        return self.unconnected()


def _check_clocks(names: str, source: SystemComponent, target: SystemComponent, clock: Variable) -> None:
    """Raise WiringError for clocks that cannot tick together."""
    for m in (source, target):
        isolated = getattr(m.implementation, "isolation", None) is not None
        if not (isinstance(m.implementation, FmuComponent) and m.implementation.in_event_mode):
            why = "counts its samples itself where it is isolated: run it without isolation"
            no_events = "is executed without event mode, in which clocks tick: use another component"
            raise WiringError(f"{names}: '{m.name}' {why if isolated else no_events}")
    if clock.name not in target.description.triggered:
        raise WiringError(f"{names}: {target.name}.{clock.name} ticks by itself: connect a clock of the kind triggered")


def _text_size(
    names: str,
    origin: tuple[SystemComponent, Variable],
    end: tuple[SystemComponent, Variable],
    max_size: int | None,
) -> int:
    """Bytes that a String or Binary may have on its way. Raises WiringError for two that do not fit."""
    for component, variable in (origin, end):
        if not isinstance(component.implementation, FmuComponent):
            raise WiringError(
                f"{names}: {component.name}.{variable.name} is {article(variable.fmi_type)}, which only FMUs exchange,"
                f" and '{component.name}' is not an FMU: give the receiver a start value instead"
            )
    types = ["".join(v.mime_type.split()).lower() for _, v in (origin, end)]
    if types[0] != types[1]:
        raise WiringError(
            f"{names}: MIME types differ, {origin[1].mime_type} to {end[1].mime_type}: choose FMUs of one type"
        )
    declared = [v.max_size for _, v in (origin, end) if v.max_size is not None]
    size = max_size if max_size is not None else min(declared, default=LONGEST_TEXT)
    number(f"{names}: max_size", size, "bytes", least=1, most=2**24, error=WiringError)
    return int(size)


def _check_unit_known(name: str, variable: Variable) -> None:
    """Raise WiringError for a unit that a component in Python declares and that there is not."""
    if variable.unit is not None and variable.unit.exponents is None:
        raise WiringError(f"{name}: {unknown('unit', variable.unit_name, KNOWN)}")


def _some(names: Iterable[str], count: int = 8) -> str:
    listed = list(names)
    return ", ".join(listed[:count]) + (", ..." if len(listed) > count else "") if listed else "none"


def _limits(step_timeout: float | None, memory_limit: int | None) -> Isolation:
    given = {"step_timeout": step_timeout, "memory_limit": memory_limit}
    return Isolation(**{k: v for k, v in given.items() if v is not None})  # type: ignore[arg-type]


def _check_internal_step(name: str, about: Description, step: Fraction) -> None:
    """Issue a FmuWarning for steps between which the FMU's own steps do not fit."""
    if about.internal_step is None:
        return
    steps = step / about.internal_step
    if abs(steps - max(1, round(steps))) > 1e-6 * steps:
        warnings.warn(
            f"component '{name}' ({about.name}): its step of {seconds_text(step)} is not a multiple of"
            f" {seconds_text(about.internal_step)}, the fixed internal step of its FMU (fixedInternalStepSize), which"
            " may refuse it or reach other times than requested",
            FmuWarning,
            stacklevel=3,
        )


def _can_be_isolated(component: SystemComponent, *, required: bool) -> bool:
    """Whether it is an FMU.

    Raises WiringError if it must be one and is not, and if this machine cannot isolate any.
    """
    if not isinstance(component.implementation, FmuComponent):
        if required:
            raise WiringError(f"component '{component.name}' is not an FMU, so it cannot be isolated")
        return False
    require_isolation(f"component '{component.name}'")
    return True


def _isolate(component: SystemComponent, limits: Isolation) -> None:
    if isinstance(component.implementation, FmuComponent):
        component.implementation.isolation = limits
