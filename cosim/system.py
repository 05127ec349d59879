"""A system: components, connections and rates, checked while it is put together.

    system = System()
    system.add("road", "RoadSine.fmu")
    system.add("car", "FullCarHmmwv.fmu", step="1 ms")
    system.connect_matching("road", "car", "road.*")
    system.connect("car.x", "road.x")
    recording = system.run(5.0, record=["car.body.*"])

A name is `component.variable`; the component's name ends at the first dot.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import replace
from fractions import Fraction
from pathlib import Path
from types import TracebackType
from typing import TYPE_CHECKING, Any, Literal

from cosim.component import Component
from cosim.description import RECORDABLE, Description, Variable, split_index
from cosim.errors import CosimError, WiringError, did_you_mean
from cosim.fmu import Fmu
from cosim.members import Connection, Group, Member, article, glob, indices
from cosim.recording import Recording
from cosim.schedule import Schedule, make_schedule
from cosim.stops import StopCondition, watched_names
from cosim.timebase import TimeLike, positive, rational
from cosim.units import UnitMismatchError, conversion

if TYPE_CHECKING:
    from cosim.master import Simulation, SystemState
    from cosim.stability import Stability

Kind = Literal["discrete", "continuous"]


class System:
    """Components, connections and rates. See the module's docstring for an example.

    One simulation at a time runs on a system; every `run` and `initialize` starts from reset components, so
    repeated runs reuse the loaded FMUs. `close()` (or `with System() as system:`) frees them.
    """

    def __init__(self) -> None:
        self.members: dict[str, Member] = {}
        self.connections: dict[str, Connection] = {}  # by target name
        self.groups: dict[str, Group] = {}
        self._fmus: dict[Path, Fmu] = {}
        self._simulation: Simulation | None = None

    def __getitem__(self, name: str) -> Member:
        try:
            return self.members[name]
        except KeyError:
            raise WiringError(f"no component '{name}'{did_you_mean(name, self.members)}") from None

    def __enter__(self) -> System:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, at: TracebackType | None) -> None:
        self.close()

    # Putting it together.

    def add(
        self,
        name: str,
        fmu: str | os.PathLike[str] | Fmu | Component,
        *,
        step: TimeLike | None = None,
        offset: TimeLike = 0,
        kind: Kind | None = None,
        parameters: Mapping[str, Any] | None = None,
        start: Mapping[str, Any] | None = None,
    ) -> Member:
        """Add a component: the path of an FMU, a loaded `Fmu` or any `Component`.

        `step` and `offset` [s] are exact: 0.001, "1/60", "10 ms". Without `step` a discrete component uses its sample
        time, a continuous one the step size of its default experiment. `kind` is needed only for discrete foreign FMUs
        (they do not say it). `parameters` and `start` set variables by name before every initialization.
        """
        if not name or "." in name or any(c.isspace() for c in name):
            raise WiringError(f"a component's name may hold neither dots nor blanks: {name!r}")
        if name in self.members:
            raise WiringError(f"there is already a component '{name}'")
        component = self._component(fmu)
        about = component.description
        kind = kind or about.kind or "continuous"  # type: ignore[assignment]
        if kind not in ("discrete", "continuous"):
            raise WiringError(f"component '{name}': kind is 'discrete' or 'continuous', not {kind!r}")
        period = step if step is not None else (about.sample_time if kind == "discrete" else None) or about.default_step
        if period is None:
            raise WiringError(
                f"component '{name}' ({about.name}) states no step of its own: give one, e.g. step='1 ms'"
            )
        begin = rational(offset, f"offset of '{name}'")
        if begin < 0:
            raise WiringError(f"component '{name}': the offset must not be negative, it is {offset}")
        member = Member(name, component, positive(period, f"step of '{name}'"), begin, kind)
        member.set(parameters)
        member.set(start)
        self.members[name] = member
        return member

    def _component(self, fmu: Any) -> Component:
        if isinstance(fmu, str | os.PathLike):
            path = Path(fmu).absolute()
            if path not in self._fmus:
                self._fmus[path] = Fmu(fmu)
            fmu = self._fmus[path]
        if isinstance(fmu, Fmu):
            fmu.check_platform()
            return fmu.instance()
        if not (hasattr(fmu, "bind") and isinstance(getattr(fmu, "description", None), Description)):
            raise WiringError(f"cannot use {fmu!r}: give the path of an .fmu file, an Fmu or a Component")
        if any(member.component is fmu for member in self.members.values()):
            raise WiringError("this component object is already in the system; make a second one")
        return fmu  # type: ignore[no-any-return]

    def connect(self, source: str, target: str, *, delay: bool = False, extrapolate: bool = False) -> list[Connection]:
        """Connect an output to an input, or an array to an array by their names without index.

        Units are checked and converted. `delay` gives the input the value of the source's step before (one step of
        the source). `extrapolate` lets a continuous target see the line through the source's last two values, at the
        middle of its step, instead of the last value (of a source ahead of it in a Gauss-Seidel group: interpolated
        between the value before and the one just reached). Extrapolated both ways a coupling is of second order in the
        exchange step, otherwise of first. Raises WiringError naming what does not fit.
        """
        from_member, output = self._split(source)
        to_member, input_ = self._split(target)
        outputs, inputs = self._elements(from_member, output), self._elements(to_member, input_)
        if len(outputs) != len(inputs):
            raise WiringError(f"{source} has {len(outputs)} element(s), {target} has {len(inputs)}")
        made = [
            self._connection((from_member, o), (to_member, i), delay=delay, extrapolate=extrapolate)
            for o, i in zip(outputs, inputs, strict=True)
        ]
        self.connections.update((c.target_name, c) for c in made)
        return made

    def connect_matching(
        self, source: str, target: str, pattern: str = "*", *, delay: bool = False, extrapolate: bool = False
    ) -> list[Connection]:
        """Connect every output of `source` whose name fits `pattern` (wildcards * and ?) to the input of the same name
        of `target`, unless that input is connected already. Returns the connections; raises if there is none."""
        from_member, to_member, fits = self[source], self[target], glob(pattern)
        about, wanted = from_member.description, to_member.description
        named = [(o.name, n) for o in about.outputs.values() for n in about.names(o) if fits(n)]
        pairs: dict[str, str] = {}  # output by input
        for output, name in sorted(
            named, key=lambda pair: pair[0] != pair[1]
        ):  # aliases after the variables' own names
            input_ = wanted.canonical(name)
            if input_ in wanted.inputs and f"{target}.{input_}" not in self.connections:
                pairs.setdefault(input_, output)
        if not pairs:
            raise WiringError(
                f"no output of '{source}' that fits '{pattern}' has a free input of the same name in '{target}'; "
                f"outputs: {_some(from_member.description.outputs)}; inputs: {_some(to_member.description.inputs)}"
            )
        return [
            c
            for i, o in pairs.items()
            for c in self.connect(f"{source}.{o}", f"{target}.{i}", delay=delay, extrapolate=extrapolate)
        ]

    def disconnect(self, pattern: str) -> list[str]:
        """Remove the connections into the inputs whose full names fit `pattern` (`car.force.*`); returns the names.
        Raises WiringError when there is none."""
        fits = glob(pattern)
        removed = [name for name, c in self.connections.items() if _fits_any(fits, c.target, c.input)]
        if not removed:
            raise WiringError(f"'{pattern}' fits no connected input{did_you_mean(pattern, self.connections)}")
        for name in removed:
            del self.connections[name]
        return removed

    def group(
        self,
        name: str,
        members: Sequence[str],
        method: Literal["gauss-seidel", "jacobi"] = "gauss-seidel",
        *,
        extrapolate: bool = False,
    ) -> Group:
        """Let continuous components advance in the declared order, each using what those before it have just computed
        (Gauss-Seidel), or side by side (Jacobi). `extrapolate` marks every connection from a continuous component
        into the group made so far."""
        if method not in ("gauss-seidel", "jacobi"):
            raise WiringError(f"group '{name}': method is 'gauss-seidel' or 'jacobi', not {method!r}")
        chosen = tuple(self[m] for m in members)
        for member in chosen:
            if member.discrete:
                raise WiringError(f"group '{name}': '{member.name}' is discrete; groups are for continuous components")
            other = next((g.name for g in self.groups.values() if member in g.members and g.name != name), None)
            if other is not None:
                raise WiringError(f"group '{name}': '{member.name}' is already in group '{other}'")
        if len(set(members)) != len(members):
            raise WiringError(f"group '{name}' names a component twice")
        self.groups[name] = Group(name, chosen, method)
        if extrapolate:
            for target, c in list(self.connections.items()):
                if c.target in chosen and not c.source.discrete and not c.delay:
                    self.connections[target] = replace(c, extrapolate=True)
        return self.groups[name]

    def _split(self, full: str) -> tuple[Member, str]:
        component, dot, variable = full.partition(".")
        if not dot:
            raise WiringError(f"'{full}': write component.variable")
        return self[component], self[component].description.canonical(variable)

    def canonical(self, full: str) -> str:
        """`component.variable` with the variable's own name where that is an alias; other texts as they are."""
        component, _, variable = full.partition(".")
        member = self.members.get(component)
        return full if member is None else f"{component}.{member.description.canonical(variable)}"

    def _elements(self, member: Member, name: str) -> list[Variable]:
        about = member.description
        if name in about.variables or name not in about.arrays:
            return [about.find(name, member.name)]
        return [about.variables[n] for n in sorted(about.arrays[name], key=indices)]

    def _connection(
        self, origin: tuple[Member, Variable], goal: tuple[Member, Variable], *, delay: bool, extrapolate: bool
    ) -> Connection:
        (source, output), (target, input_) = origin, goal
        names = f"{source.name}.{output.name} -> {target.name}.{input_.name}"
        if output.causality not in ("output", "local"):
            raise WiringError(f"{names}: '{output.name}' is no output but {article(output.causality)}")
        if input_.causality != "input":
            raise WiringError(f"{names}: '{input_.name}' is no input but {article(input_.causality)}")
        already = self.connections.get(f"{target.name}.{input_.name}")
        if already is not None:
            raise WiringError(f"{names}: this input is already connected to {already.source_name}")
        allowed = {("real", "real"), ("integer", "integer"), ("boolean", "boolean"), ("integer", "real")}
        if (output.type, input_.type) not in allowed:
            raise WiringError(f"{names}: types differ, {output.fmi_type} to {input_.fmi_type}")
        if extrapolate and (source.discrete or target.discrete):
            raise WiringError(f"{names}: extrapolation is between continuous components")
        if extrapolate and delay:
            raise WiringError(f"{names}: choose delay or extrapolation")
        try:
            scale, offset = conversion(output.unit, input_.unit, output.relative and input_.relative)
        except UnitMismatchError as error:
            raise WiringError(
                f"units differ: {source.name}.{output.name} [{output.unit_name}] -> "
                f"{target.name}.{input_.name} [{input_.unit_name}]: {error}"
            ) from None
        if output.constant is not None and not input_.accepts(value := scale * output.constant + offset):
            raise WiringError(f"{names}: the input {input_.refusal(value)}")
        return Connection(source, output, target, input_, delay, extrapolate, scale, offset)

    # Looking at it.

    def unconnected(self) -> list[str]:
        """Inputs that nothing drives and that were given no start value: they keep the FMU's own."""
        return [
            f"{m.name}.{i}"
            for m in self.members.values()
            for i in m.description.inputs
            if f"{m.name}.{i}" not in self.connections and i not in m.values
        ]

    def schedule(self, *extra: Fraction) -> Schedule:
        """The order in which everything runs; print it. Raises LoopError for a loop among discrete components.
        `extra` are further periods the base tick must divide."""
        return make_schedule(self, extra)

    def check(self) -> list[str]:
        """Raise what is wrong with the system; returns `unconnected()`."""
        if not self.members:
            raise WiringError("the system has no components")
        self.schedule()
        return self.unconnected()

    def select(self, patterns: str | Iterable[str] | None) -> list[tuple[Member, Variable]]:
        """Variables by full name or pattern (`*`, `?`). A pattern selects outputs; where it fits none it selects
        inputs, then local variables. None: every output that is no array element. Text variables are left out."""
        if patterns is None:
            return [
                (m, v)
                for m in self.members.values()
                for v in m.description.outputs.values()
                if not split_index(v.name)[1] and v.type in RECORDABLE
            ]
        chosen: dict[str, tuple[Member, Variable]] = {}
        for pattern in [patterns] if isinstance(patterns, str) else patterns:
            chosen.update((f"{m.name}.{v.name}", (m, v)) for m, v in self._fitting(pattern))
        return list(chosen.values())

    def _fitting(self, pattern: str) -> list[tuple[Member, Variable]]:
        if not set("*?") & set(pattern):
            member, name = self._split(pattern)
            found = [(member, v) for v in self._elements(member, name)]
            for _, variable in found:
                if variable.type not in RECORDABLE:
                    raise WiringError(f"'{pattern}' is {article(variable.fmi_type)} and cannot be recorded")
            return found
        fits = glob(pattern)
        for causality in ("output", "input", "local"):
            matching = [
                (m, v)
                for m in self.members.values()
                for v in m.description.variables.values()
                if v.causality == causality and v.type in RECORDABLE and _fits_any(fits, m, v)
            ]
            if matching:
                return matching
        names = [f"{m.name}.{o}" for m in self.members.values() for o in m.description.outputs]
        raise WiringError(f"'{pattern}' fits no variable{did_you_mean(pattern.replace('*', ''), names)}")

    # Running it.

    def initialize(
        self,
        start_time: TimeLike = 0,
        *,
        record: str | Iterable[str] | None = None,
        record_interval: TimeLike | None = None,
        watch: Iterable[str] = (),
        stop_time: TimeLike | None = None,
        check_stability: bool = False,
        state: SystemState | None = None,
        allow_nan: bool = False,
    ) -> Simulation:
        """Reset and initialize all components and return the `Simulation` at `start_time`.

        `record`: names and patterns as in `select`; `record_interval` [s], default the smallest step; `watch`: further
        variables that can be read while it runs (`simulation["car.x"]`). `stop_time` is only told to the FMUs. With
        `state`, saved in this system, the components in it continue from there (start_time is not used) while wiring,
        rates and parameters of the others may have changed: several controllers can be tried from one instant.
        Outputs that are NaN or infinite end the run with ComponentError unless `allow_nan`.
        """
        from cosim.master import Simulation

        if self._simulation is not None:
            self._simulation.close()
        self._simulation = Simulation(
            self,
            start_time,
            record=record,
            record_interval=record_interval,
            watch=watch,
            stop_time=stop_time,
            state=state,
            allow_nan=allow_nan,
        )
        if check_stability:
            from cosim.stability import warn_if_unstable

            warn_if_unstable(self)
        return self._simulation

    def run(
        self,
        stop_time: TimeLike,
        *,
        start_time: TimeLike = 0,
        record: str | Iterable[str] | None = None,
        record_interval: TimeLike | None = None,
        stop_when: Sequence[StopCondition] = (),
        watch: Iterable[str] = (),
        csv: str | os.PathLike[str] | None = None,
        progress: bool = False,
        check_stability: bool = False,
        state: SystemState | None = None,
        allow_nan: bool = False,
    ) -> Recording:
        """Initialize, run to `stop_time` [s], to the first of `stop_when` or to where a component asks to end, and return
        the recording, whose `stopped_by` tells which.

        A failing component raises ComponentError, Ctrl-C raises Interrupted; both carry the recording so far, and with
        `csv` it is on disk in any case.
        """
        if csv is not None:
            _check_writable(Path(csv))
        with self.initialize(
            start_time,
            record=record,
            record_interval=record_interval,
            watch=[*watch, *watched_names(stop_when)],
            stop_time=stop_time,
            check_stability=check_stability,
            state=state,
            allow_nan=allow_nan,
        ) as simulation:
            try:
                simulation.advance(stop_time, stop_when=stop_when, progress=progress)
            finally:
                if csv is not None:
                    simulation.recording.to_csv(csv)
            return simulation.recording

    def coupled_spectral_radius(self) -> Stability:
        """How the coupled continuous components, linearized at their initial state, amplify a deviation over one cycle
        of the schedule; see `cosim.stability`."""
        from cosim.stability import coupled_spectral_radius

        return coupled_spectral_radius(self)

    def reset(self) -> None:
        """End the simulation that is running, if any. The next `run` or `initialize` resets every component and sets
        its parameters again."""
        if self._simulation is not None:
            self._simulation.close()
            self._simulation = None

    def close(self) -> None:
        """Free all instances and remove unpacked FMUs."""
        self.reset()
        for member in self.members.values():
            member.component.close()
        for fmu in self._fmus.values():
            fmu.close()


def _check_writable(path: Path) -> None:
    """Raise CosimError now rather than after a long run."""
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        path.open("a").close()
    except OSError as error:
        raise CosimError(f"cannot write the recording to {path}: {error.strerror or error}") from None


def _fits_any(fits: Callable[[str], Any], member: Member, variable: Variable) -> bool:
    """Whether the full name, or one with an alias, fits."""
    return any(fits(f"{member.name}.{n}") for n in member.description.names(variable))


def _some(names: Iterable[str], count: int = 8) -> str:
    listed = list(names)
    return ", ".join(listed[:count]) + (", ..." if len(listed) > count else "") if listed else "none"
