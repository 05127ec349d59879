"""Where every value lies in the master's one vector of floats.

An output owns a visible slot. A continuous component writes its outputs to a second, latest slot, which is copied to
the visible one when its step ends. Sources of delayed or extrapolated connections own a previous slot as well.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
import numpy.typing as npt

from build_fmus.base.units import DisplayUnit
from cosim.core.component import Array
from cosim.core.description import WIDE, Variable
from cosim.core.errors import NotFinite
from cosim.fmu.transfers import slots
from cosim.system.components import Connection, SystemComponent
from cosim.system.schedule import Schedule

Index = npt.NDArray[np.intp]
Key = tuple[str, str, str]

EXACT = 2**53  # integers below it are doubles


@dataclass
class PortLayout:
    """Slots and buffers of one component.

    Inputs come from values[index], then scale and offset; `u` and `y` are its buffers, `y` a slice of the values.
    """

    inputs: list[Variable]
    outputs: list[Variable]
    u: Array
    y: Array
    index: Index
    scale: Array | None = None
    offset: Array | None = None
    extrapolations: list[tuple[int, int, int, int]] = field(
        default_factory=list
    )  # extrapolated: input, now, previous, time
    periods: list[float] = field(default_factory=list)  # of the sources of `extrapolations` [s]
    ahead: list[float] = field(default_factory=list)  # from when `now` was reached to the time of the value [s]
    in_place: bool = False  # `u` is a slice of the values too: nothing to copy
    first: int = 0  # slot of its first output
    sizes: dict[Variable, int] = field(default_factory=dict)  # bytes at most, of those that have more than one slot

    def numbers(self, variables: Sequence[Variable], values: Array) -> Iterable[tuple[Variable, float]]:
        """Each of its inputs or outputs with its number in `values`, which is `u` or `y`."""
        listed = values.tolist()
        return [(variable, listed[at]) for variable, at in self.places(variables)]

    def places(self, variables: Sequence[Variable]) -> Iterable[tuple[Variable, int]]:
        """Each of its inputs or outputs with its place in `u` or `y`."""
        at = 0
        for variable in variables:
            yield variable, at
            at += slots(self.sizes.get(variable, 0))

    def extrapolated(self) -> list[tuple[int, int, int, int, float, float]]:
        """Each extrapolated input: number, slots of now, previous and time, period of its source, and time ahead [s].

        The time ahead is from the slot's time to the middle of the next step, or to its begin if the input follows the
        line inside of the step.
        """
        known = zip(self.extrapolations, self.periods, self.ahead, strict=True)
        return [(*extrapolation, period, ahead) for extrapolation, period, ahead in known]


class Layout:
    """Slots, buffers and the copies between them; see `make_layout`."""

    def __init__(self) -> None:
        self.values: Array = np.empty(0)
        self.ports: dict[SystemComponent, PortLayout] = {}
        self.visible: dict[tuple[SystemComponent, Variable], int] = {}
        self.latest: dict[tuple[SystemComponent, Variable], int] = {}
        self.previous: dict[tuple[SystemComponent, Variable], int] = {}
        self.sample_times: dict[SystemComponent, int] = {}  # slot of the time at which the visible outputs were reached
        self.constants: dict[
            tuple[SystemComponent, Variable], int
        ] = {}  # unconnected inputs that are recorded or watched
        self.sizes: dict[tuple[SystemComponent, Variable], int] = {}  # bytes of outputs with more than one slot
        self.wide: dict[str, int] = {}  # full name -> slot, of integers that are rounded where doubles do not hold them
        self.readable: dict[str, tuple[int, float, float]] = {}  # full name -> slot, scale, offset
        self.record_names: list[str] = []
        self.aliases: dict[str, str] = {}  # further names of what is recorded
        self.record_units: dict[str, str] = {}
        self.record_types: dict[str, str] = {}  # of what is recorded and no real number
        self.record_display: dict[str, DisplayUnit] = {}
        self.record_index: list[int] = []
        self.record_conversion: tuple[Array, Array] = (np.empty(0), np.empty(0))

    def not_finite(
        self, components: Sequence[SystemComponent], t: float | None = None, h: float | None = None
    ) -> NotFinite | None:
        """The first output of the components that is NaN or infinite.

        After a step from `t` on, of length `h` or their own, or after initialization.
        """
        for m in components:
            port = self.ports[m]
            for variable, value in port.numbers(port.outputs, port.y):
                if not math.isfinite(value):
                    reached = t if t is None or m.discrete else t + (float(m.step) if h is None else h)
                    return NotFinite(m.name, variable.name, value, reached)
        return None

    def copies(self, component: SystemComponent) -> tuple[list[tuple[int, int]], list[tuple[int, int]]]:
        """Copies at a component's arrival, as slots (to, from).

        Published values become previous values, and reached values become published ones.
        """
        previous = [(s, self.visible[key], key) for key, s in self.previous.items() if key[0] is component]
        published = [(self.visible[key], s, key) for key, s in self.latest.items() if key[0] is component]
        return self._all_slots(previous), self._all_slots(published)

    def _all_slots(self, copies: Iterable[tuple[int, int, tuple[SystemComponent, Variable]]]) -> list[tuple[int, int]]:
        return [(to + k, source + k) for to, source, key in copies for k in range(self.width(key))]

    def reached(self, key: tuple[SystemComponent, Variable]) -> int:
        """Slot that the component writes to: a discrete one shows its outputs at once."""
        return self.latest.get(key, self.visible[key])

    def width(self, key: tuple[SystemComponent, Variable]) -> int:
        """Slots of a value."""
        return slots(self.sizes.get(key, 0))

    @cached_property
    def keys(self) -> tuple[Key, ...]:
        """What each value is: which part, of which component, of which variable (of `sample_time` none)."""
        found: list[Key] = [("", "", "")] * len(self.values)
        parts = {"visible": self.visible, "latest": self.latest, "previous": self.previous, "constant": self.constants}
        for part, places in parts.items():
            for (component, variable), slot in places.items():
                found[slot] = (part, component.name, variable.name)
                for k in range(1, self.width((component, variable))):
                    found[slot + k] = (part, component.name, f"{variable.name}#{k}")
        for component, slot in self.sample_times.items():
            found[slot] = ("sample_time", component.name, "")
        return tuple(found)

    def owners(self) -> list[str]:
        """Name of the component each value belongs to."""
        return [component for _, component, _ in self.keys]


def make_layout(
    schedule: Schedule,
    record: Sequence[tuple[SystemComponent, Variable]],
    watch: Sequence[tuple[SystemComponent, Variable]],
) -> Layout:
    """Slots for every output that is connected, recorded or watched; no other output is ever read."""
    layout = Layout()
    by_input = {(c.target, c.input): c for c in schedule.connections}
    needed: dict[SystemComponent, set[Variable]] = {m: set() for m in schedule.components}
    for c in schedule.connections:
        needed[c.source].add(c.output)
    constants: dict[
        tuple[SystemComponent, Variable], None
    ] = {}  # each once, also where it is both recorded and watched
    for component, variable in [*record, *watch]:
        if (component, variable) in by_input:
            c = by_input[component, variable]
            needed[c.source].add(c.output)
        elif variable.causality in ("input", "parameter", "structuralParameter"):
            constants[component, variable] = None
        else:
            needed[component].add(variable)
    outputs = {m: sorted(vs, key=_storage_order) for m, vs in needed.items()}
    for c in schedule.connections:
        if c.size:
            layout.sizes[c.source, c.output] = max(c.size, layout.sizes.get((c.source, c.output), 0))
    count = 0
    for places, components in ((layout.visible, schedule.components), (layout.latest, schedule.continuous)):
        for m in components:
            for v in outputs[m]:
                places[m, v] = count
                count += layout.width((m, v))
    for c in schedule.connections:
        if (c.delay or c.extrapolate) and (c.source, c.output) not in layout.previous:
            layout.previous[c.source, c.output] = count
            count += layout.width((c.source, c.output))
        if c.extrapolate and c.source not in layout.sample_times:
            layout.sample_times[c.source] = count
            count += 1
    for key in constants:
        layout.constants[key] = count
        count += 1
    layout.values = np.zeros(count)
    rounded = {(c.source, c.output) for c in schedule.connections if not c.size}
    driven = {key: (c.source, c.output) for key, c in by_input.items()}
    seen = {driven.get(key, key) for key in (*record, *watch)}
    layout.wide = {
        f"{m.name}.{v.name}": i
        for places in (layout.visible, layout.constants)
        for (m, v), i in places.items()
        if v.fmi_type in WIDE and ((m, v) in rounded | seen or (m, v) in layout.constants)
    }
    for m in schedule.components:
        layout.ports[m] = _port(layout, schedule, m, outputs[m])
    _recorded(layout, by_input, record, watch)
    return layout


def _storage_order(variable: Variable) -> tuple[str, int, int, str]:
    """Variables of one FMI call side by side, array elements in order; those of Python components by name."""
    return variable.fmi_type, variable.reference, variable.index, variable.name


def _port(layout: Layout, schedule: Schedule, component: SystemComponent, outputs: list[Variable]) -> PortLayout:
    incoming = sorted((c for c in schedule.connections if c.target is component), key=lambda c: _storage_order(c.input))
    ahead = _ahead(schedule, component)
    places = layout.visible if component.discrete else layout.latest
    first = places[component, outputs[0]] if outputs else 0
    sizes = {v: size for v in outputs if (size := layout.sizes.get((component, v), 0))}
    sizes |= {c.input: c.size for c in incoming if c.size}
    n_outputs = sum(slots(sizes.get(v, 0)) for v in outputs)
    extrapolations: list[tuple[int, int, int, int]] = []
    periods: list[float] = []
    to_value: list[float] = []
    wide = [(c, k) for c in incoming for k in range(slots(c.size))]
    for i, (c, _) in enumerate(wide):
        if c.extrapolate:
            # Of a source ahead of it in its group a component sees what that has just reached, one step of the source
            # after what is visible: the line through both is interpolated.
            key, early = (c.source, c.output), c.source in ahead
            now, before = (layout.latest, layout.visible) if early else (layout.visible, layout.previous)
            extrapolations.append((i, now[key], before[key], layout.sample_times[c.source]))
            periods.append(float(c.source.step))
            middle = 0.0 if c.input.follows else float(component.step) / 2
            to_value.append(middle - (float(c.source.step) if early else 0.0))
    scale, offset = (np.array([getattr(c, of) for c, _ in wide], dtype=float) for of in ("scale", "offset"))
    converts = bool(np.any(scale != 1.0) or np.any(offset != 0.0))
    index = np.array([_source_slot(layout, c, ahead) + k for c, k in wide], dtype=np.intp)
    begin = int(index[0]) if len(index) else 0
    in_place = not converts and not extrapolations and np.array_equal(index, begin + np.arange(len(index)))
    return PortLayout(
        inputs=[c.input for c in incoming],
        outputs=outputs,
        u=layout.values[begin : begin + len(index)] if in_place else np.zeros(len(index)),
        y=layout.values[first : first + n_outputs],
        index=index,
        scale=scale if converts else None,
        offset=offset if converts else None,
        extrapolations=extrapolations,
        periods=periods,
        ahead=to_value,
        in_place=in_place,
        first=first,
        sizes=sizes,
    )


def _ahead(schedule: Schedule, component: SystemComponent) -> tuple[SystemComponent, ...]:
    """Components of its Gauss-Seidel group that advance before it."""
    for group in schedule.groups:
        if group.method == "gauss-seidel" and component in group.components:
            return group.components[: group.components.index(component)]
    return ()


def _source_slot(layout: Layout, connection: Connection, ahead: Iterable[SystemComponent]) -> int:
    key = (connection.source, connection.output)
    if connection.delay:
        return layout.previous[key]
    return layout.latest[key] if connection.source in ahead else layout.visible[key]


def _recorded(
    layout: Layout,
    by_input: dict[tuple[SystemComponent, Variable], Connection],
    record: Sequence[tuple[SystemComponent, Variable]],
    watch: Sequence[tuple[SystemComponent, Variable]],
) -> None:
    """Fill in what is recorded and readable. A connected input is what its source shows, converted."""
    for component, variable in [*record, *watch]:
        name = f"{component.name}.{variable.name}"
        c = by_input.get((component, variable))
        if c is not None:
            slots = layout.previous if c.delay else layout.visible
            layout.readable[name] = (slots[c.source, c.output], c.scale, c.offset)
        elif (component, variable) in layout.constants:
            layout.readable[name] = (layout.constants[component, variable], 1.0, 0.0)
        else:
            layout.readable[name] = (layout.visible[component, variable], 1.0, 0.0)
    layout.record_names = [f"{m.name}.{v.name}" for m, v in record]
    layout.aliases = {f"{m.name}.{a}": f"{m.name}.{v.name}" for m, v in record for a in m.description.names(v)[1:]}
    layout.record_units = {f"{m.name}.{v.name}": v.unit_name for m, v in record}
    layout.record_types = {f"{m.name}.{v.name}": v.type for m, v in record if v.type != "real"}
    layout.record_display = {f"{m.name}.{v.name}": v.display for m, v in record if v.display is not None}
    chosen = [layout.readable[name] for name in layout.record_names]
    layout.record_index = [slot for slot, _, _ in chosen]
    layout.record_conversion = (np.array([s for _, s, _ in chosen]), np.array([o for _, _, o in chosen]))
