"""A system as C: its plan as constants, the engine, and the sources of its components under names of their own."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from itertools import accumulate
from pathlib import Path
from typing import Any

from build_fmus import generate, package
from build_fmus.base import extras, safe_files, surface
from build_fmus.base.escape import c_identifier, c_number, c_string
from build_fmus.compile import find_toolchain, host
from cosim.core.description import INTEGER_RANGE, RECORDABLE, TEXTS, WIDE, Variable
from cosim.core.errors import CosimError, WiringError
from cosim.engine.clock_networks import NetworkPlan, clock_networks
from cosim.engine.library import CLOCKED_STEPS, EVENT_STEPS, EXACT_VALUES, INTEGRATOR, INTERMEDIATE
from cosim.engine.loops import RepeatedStep
from cosim.engine.plan import ComponentPlan, LoopPlan, Plan, Setup, make_plan
from cosim.engine.values import PortLayout
from cosim.export.parts import Part, part_of
from cosim.export.variables import Exported
from cosim.fmu.clocked_steps import ClockedGroup, ClockedValues
from cosim.fmu.component import FmuComponent
from cosim.fmu.environment import HEADER as ENVIRONMENT
from cosim.fmu.event_steps import steps_with_events
from cosim.fmu.intermediate import followed, following
from cosim.fmu.model_exchange import function_names, integrator_setup
from cosim.fmu.transfers import Arrangement, arrangements, by_reference, slots
from cosim.system.components import Connection, Group, SystemComponent
from cosim.system.loops import sampled_loops
from cosim.system.schedule import Schedule, make_schedule, only_numbers
from cosim.system.wiring import Wiring

with extras.needed("build", extras.BUILDING):
    import jinja2

_HERE = Path(__file__).parent
_RUNTIME = _HERE / "runtime"
_ENGINE = _HERE.parent / "engine"
CONTAINER = tuple(sorted(_RUNTIME.glob("container*.[ch]")))  # what carries out the plan of one system
_OWN = (
    *CONTAINER,
    *(_RUNTIME / n for n in ("component.c", "component.h", "system.h")),
    *(_ENGINE / n for n in ("engine.c", "engine.h", "hints.h", "instants.h", "algebraic_loop.c")),
    ENVIRONMENT,
    *(generate.RUNTIME_DIR / n for n in ("fmu_base.c", "fmu_base.h", "fmu_core.h", "fmu_model.h")),
)
_FOREIGN = _RUNTIME / "foreign.c"
_EXCHANGE = (_RUNTIME / "model_exchange.c", INTEGRATOR, INTEGRATOR.with_suffix(".c"))  # where components are integrated
_EVENTS = (_RUNTIME / "events.c", EVENT_STEPS, EVENT_STEPS.with_suffix(".c"))  # where they report events
# where they have clocks
_CLOCKS = (_RUNTIME / "clocks.c", CLOCKED_STEPS, CLOCKED_STEPS.with_suffix(".c"), _ENGINE / "adaptive.h")
# where inputs follow inside steps
_UPDATES = (_RUNTIME / "updates.c", INTERMEDIATE, INTERMEDIATE.with_suffix(".c"), _ENGINE / "adaptive.h")
_TEXTS = (_RUNTIME / "texts.c", EXACT_VALUES, EXACT_VALUES.with_suffix(".c"))  # where they exchange such
_KINDS = {"Real": "FLOAT64", "Integer": "INT32"}
_ENUMERATION = {2: "INT32", 3: "INT64"}
_ROLES = {"parameter": "FMU_PARAMETER", "input": "FMU_INPUT", "output": "FMU_OUTPUT"}
_TYPES = {"Float64": "FMU_FLOAT64", "Int32": "FMU_INT32", "Boolean": "FMU_BOOLEAN", "String": "FMU_STRING"}
_BYTES = 8  # of one value in a buffer, whatever its type


def exported_schedule(wiring: Wiring, without: Iterable[str] = (), *, page: bool = False) -> Schedule:
    """The schedule of the exported system, without the components in `without` and their connections.

    `page`: export a web page, which must contain every component; otherwise an FMU.
    """
    left_out = {wiring.components[name] for name in without}
    components = [m for m in wiring.components.values() if m not in left_out]
    what = "a web page" if page else "the FMU of a system"
    for m in components:
        option = surface.hint(f"without=['{m.name}']", f"--without {m.name}")
        remedy = "" if page else f"leave it out ({option}), or "
        if not isinstance(m.implementation, FmuComponent):
            raise CosimError(
                f"'{m.name}' is written in Python, and {what} holds compiled components only: {remedy}write it as a"
                " component that build-fmus compiles"
            )
        if m.implementation.structure:
            sizes = ", ".join(m.implementation.structure)
            raise CosimError(
                f"'{m.name}' was added with {sizes}, and {what} keeps the FMU's own array sizes: {remedy}set none"
            )
    connections = [c for c in wiring.connections.values() if not {c.source, c.target} & left_out]
    groups = [
        Group(g.name, tuple(m for m in g.components if m not in left_out), g.method) for g in wiring.groups.values()
    ]
    schedule = make_schedule(components, connections, [g for g in groups if g.components])
    schedule = replace(schedule, late_loops=sampled_loops(schedule.connections))
    return only_numbers(schedule, what, "use other components") if page else schedule


@dataclass(frozen=True)
class _Start:
    """What the system sets before initialization."""

    kind: str
    reference: int
    numbers: list[str]
    text: str | None = None
    type: str = "double"


class SystemCode:
    """The C files of one system, as derived from its schedule: for a library, or for WebAssembly.

    Attributes:
        variables: of the system; the value reference of each is its place here, counted from 1 (0 is time).
        fmi: version of the functions that it has, 2 or 3.
        parts: how each component travels.

    Args:
        known: how FMUs travel, by path and token, filled here; for systems that are linked together and share what they
            have in common.
        repeated: components of loops whose steps are repeated.
    """

    def __init__(
        self,
        name: str,
        schedule: Schedule,
        variables: Sequence[Exported],
        fmi: int,
        known: dict[tuple[str, str], Part] | None = None,
        repeated: Mapping[SystemComponent, RepeatedStep] | None = None,
    ):
        self.name, self.schedule, self.variables, self.fmi = name, schedule, variables, fmi
        outputs = [(e.component, e.variable) for e in variables if e.causality == "output"]
        self.setup = Setup(schedule, record=outputs)
        self.setup.repeated = {} if repeated is None else repeated
        self.plan: Plan = make_plan(self.setup)
        self.clocked = {m: self._clocked(m) for m in schedule.components if _has_clocks(m)}
        self.parts = self._parts({} if known is None else known)

    def _parts(self, found: dict[tuple[str, str], Part]) -> dict[SystemComponent, Part]:
        """One part per FMU file, whatever number of components is made of it."""
        parts: dict[SystemComponent, Part] = {}
        for m in self.schedule.components:
            fmu = m.implementation.fmu  # type: ignore[attr-defined]
            key = (str(fmu.path), fmu.description.token)
            other = next((o.name for o, p in parts.items() if p is found.get(key)), None)
            if other and m.description.only_once:
                option = surface.hint(f" (without=['{m.name}'])", f" (--without {m.name})")
                raise WiringError(
                    f"'{other}' and '{m.name}' are instances of {fmu.path}, which allows one per process: leave one of"
                    f" them out of the export{option}"
                )
            if key not in found:
                found[key] = part_of(c_identifier(fmu.description.identifier, [p.name for p in found.values()]), fmu)
            parts[m] = found[key]
        return parts

    @property
    def distinct(self) -> list[Part]:
        """Parts of the system, each FMU once."""
        return list(dict.fromkeys(self.parts.values()))

    def _clocked(self, m: SystemComponent) -> ClockedValues:
        port = self.setup.layout.ports[m]
        inputs = [e.variable for e in self.variables if e.component is m and e.causality == "input"]
        return ClockedValues(m.description, port.inputs, port.outputs, port.sizes, inputs)

    @property
    def can_save(self) -> bool:
        """Whether all components can save their states."""
        return all(m.description.can_save for m in self.schedule.components)

    @property
    def _exact(self) -> bool:
        """Whether texts, bytes or 64-bit integers are exchanged."""
        return any(c.size for c in self.schedule.connections)

    def files(self, platform: str = "") -> dict[str, bytes]:
        """All C files and headers except plan.c, by path below `sources/`.

        `platform`: the platform whose compiler determines the names that components have in common; default this
        machine's.
        """
        linked = [p for p in self.distinct if p.linked]
        files = {p.name: p.read_bytes() for p in _OWN}
        if len(linked) < len(self.distinct):
            files[_FOREIGN.name] = _FOREIGN.read_bytes()
        integrated = {p for m, p in self.parts.items() if m.implementation.integrated}  # type: ignore[attr-defined]
        if integrated:
            files |= {p.name: p.read_bytes() for p in _EXCHANGE}
        if any(steps_with_events(m.description) for m in self.parts):
            files |= {p.name: p.read_bytes() for p in _EVENTS}
        if self.clocked:
            files |= {p.name: p.read_bytes() for p in _CLOCKS}
        if any(followed(m.description) for m in self.parts):
            files |= {p.name: p.read_bytes() for p in _UPDATES}
        if self._exact:
            files |= {p.name: p.read_bytes() for p in _TEXTS}
        files[f"fmi{self.fmi}.c"] = (generate.RUNTIME_DIR / f"fmi{self.fmi}.c").read_bytes()
        files |= package.fmi_headers(2) | package.fmi_headers(3)
        files = generate.with_mathematics(files)
        toolchain = find_toolchain(platform or host())
        for part in linked:
            own = part.sources()
            with safe_files.scratch_files(own) as folder:
                names = part.names(folder / part.name, toolchain)
            files |= own | part.wrappers(names, _exchange_calls(part) if part in integrated else ())
        return dict(sorted(files.items()))

    @staticmethod
    def c_files(files: Iterable[str]) -> list[str]:
        """Those to compile, plan.c among them."""
        return sorted({"plan.c", *(n for n in files if n.endswith(".c") and ("/" not in n or n.startswith("musl/")))})

    def plan_c(self, token: str) -> str:
        """The plan as constants; `token` tells it from other systems'."""
        a, _, d = self.plan.time
        buffers = _Room()
        room_u = _Room()
        components = [self._component(i, p, buffers, room_u) for i, p in enumerate(self.plan.components)]
        return template("plan.c.j2").render(
            name=self.name,
            token=token,
            components=components,
            loops=[_loop(p) for p in self.plan.loops],
            tolerance=c_number(self.setup.loop_tolerance),
            n_running=self.plan.n_running,
            n_late=self.plan.n_late,
            followers=self.plan.followers,
            n_discrete=self.plan.n_discrete,
            linked=[p for p in self.distinct if p.linked],
            clocks=self.plan.clocks[:-1],
            owners=self._owners(),
            variables=[
                {"name": "time", "type": "FMU_FLOAT64", "role": "FMU_TIME", "slot": -1},
                *map(self._variable, self.variables),
            ],
            passed=[*map(self._passed, self.schedule.parameters)],
            a=a,
            d=d,
            n_values=self.plan.size,
            n_u=room_u.used,
            n_buffer=buffers.used,
            n_published=sum(len(p.published) for p in self.plan.components),
            fmi=self.fmi,
            can_save=self.can_save,
            carried=any(not p.linked for p in self.distinct),
            steps={m["steps"] for m in components},
            networks=[*map(_network, clock_networks(self.schedule, self.clocked.__getitem__))],
            updates=any(m["follows"] for m in components),
            texts=self._exact,
        )

    def _component(self, i: int, p: ComponentPlan, buffers: _Room, room_u: _Room) -> dict[str, Any]:
        m, part = p.component, self.parts[p.component]
        port = self.setup.layout.ports[m]
        index = [int(k) for k in p.index]
        u = (index[0] if index else 0) if p.in_place else room_u.take(len(index))
        copies = [*p.previous, *p.published]
        clocked = self.clocked.get(m)
        if clocked is None:
            sets = _sets(m, part.version, port, buffers)
            moves = arrangements(part.version, port.outputs, sizes=port.sizes)
        else:
            sets = [_transfer(m, part.version, how, buffers) | {"waits": False} for how in clocked.sets]
            moves = clocked.gets
        places = [v for v in port.inputs for _ in range(slots(port.sizes.get(v, 0)))]
        return {
            "id": f"m{i}",
            "name": m.name,
            "token": m.description.token,
            "version": part.version,
            "linked": part.linked,
            "prefix": part.prefix,
            "folder": part.name,
            "identifier": m.description.identifier,
            "resources": part.resources,
            "clock": p.clock,
            "step": c_number(p.step),
            "check_before": p.check_before,
            "repeats": m in self.setup.repeated,
            "begins_with_events": p.begins_with_events,
            "copies": [f"{{{c.to}, {c.source}, {c.n}}}" for c in copies],
            "n_previous": len(p.previous),
            "timestamp_slot": -1 if p.timestamp_slot is None else p.timestamp_slot,
            "index": index,
            "in_place": p.in_place,
            "u": u,
            "scale": [] if p.scale is None else list(map(c_number, p.scale.tolist())),
            "offset": [] if p.offset is None else list(map(c_number, p.offset.tolist())),
            "extrapolations": [*map(_extrapolation, p.extrapolations)],
            "sets": sets,
            "gets": [_transfer(m, part.version, how, buffers) | {"waits": False} for how in moves],
            "starts": _starts(m, part.version),
            "first": p.first,
            "n_outputs": p.n_outputs,
            "follows": _follows(m, places, p),
            **(_clocks(clocked) if clocked is not None else _events(m, sets) or _exchange(m)),
            "tolerance": None if m.description.tolerance is None else c_number(m.description.tolerance),
        }

    def _variable(self, e: Exported) -> dict[str, Any]:
        layout, version = self.setup.layout, self.parts[e.component].version
        found: dict[str, Any] = {"name": e.name, "type": _TYPES[e.type], "role": _ROLES[e.causality]}
        if e.causality == "output":
            slot, scale, offset = layout.readable[e.name]
            return {**found, "slot": slot, "scale": c_number(scale), "shift": c_number(offset)}
        low, high = e.variable.limits
        return {
            **found,
            "slot": layout.constants.get((e.component, e.variable), -1),
            "kind": _kind(version, e.variable.fmi_type),
            "component": self.schedule.components.index(e.component),
            "reference": e.variable.reference,
            "tunable": e.tunable,
            "min": c_number(low),
            "max": c_number(high),
        }

    def _passed(self, c: Connection) -> dict[str, Any]:
        """A parameter that another component calculates."""
        text, types = c.input.type not in RECORDABLE, {c.input.fmi_type, c.output.fmi_type}
        wide = types in ({"Int64"}, {"UInt64"}) and (c.scale, c.offset) == (1.0, 0.0)
        if text and max(c.input.size, c.output.size) > 1:
            raise WiringError(
                f"{c.source_name} -> {c.target_name} is an element of an array of {c.input.fmi_type}, which the FMU of"
                " a system does not pass on to parameters: set the parameter instead, and take this connection out"
            )
        ends = [
            [self.schedule.components.index(m), _kind(self.parts[m].version, v.fmi_type), v.reference, v.size, v.index]
            for m, v in ((c.source, c.output), (c.target, c.input))
        ]
        low, high = c.input.limits
        if c.input.type != "real":
            least, most = INTEGER_RANGE.get(c.input.fmi_type, (0, 1))
            low, high = max(low, float(least)), min(high, float(most))
        numbers = {"scale": c.scale, "offset": c.offset, "min": low, "max": high}
        return {"name": c.target_name, "source": ends[0], "target": ends[1], "exact": text or wide} | {
            k: c_number(x) for k, x in numbers.items()
        }

    def _owners(self) -> list[str]:
        """What each of the values is."""
        names = [""] * self.plan.size
        layout = self.setup.layout
        for known in (layout.visible, layout.latest, layout.previous, layout.constants):
            for (component, variable), slot in known.items():
                names[slot] = f"{component.name}.{variable.name}"
        for component, slot in layout.sample_times.items():
            names[slot] = f"time of {component.name}"
        return names


def _loop(plan: LoopPlan) -> dict[str, Any]:
    derivatives = [d and {**asdict(d), "i": i} for i, d in enumerate(plan.derivatives)]
    numbers = {"nominal": list(map(c_number, plan.nominal)), "start": list(map(c_number, plan.start))}
    return {**asdict(plan), **numbers, "derivatives": derivatives}


def _exchange_calls(part: Part) -> list[str]:
    """Functions of a linked FMU that its integrator needs, and that makes an instance for it."""
    return function_names(part.version) + (["InstantiateModelExchange"] if part.version == 3 else [])


def _exchange(m: SystemComponent) -> dict[str, Any]:
    """Setup and value references of an integrator, of a component that has one."""
    implementation = m.implementation
    assert isinstance(implementation, FmuComponent)
    if not implementation.integrated:
        return {"setup": [], "steps": ""}
    fields, references = integrator_setup(m.description, implementation.exchange)
    setup = [*map(int, fields[:-1]), c_number(fields[-1])]
    return {"setup": setup, "exchange_references": references or [0], "steps": "exchange"}


def _events(m: SystemComponent, sets: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    """`EventSetup` of a component that reports events or returns early; empty for another one."""
    about = m.description
    if not steps_with_events(about):
        return {}
    waiting = [s["n_data"] for s in sets if s["waits"]]
    flags, internal = [int(about.event_mode), int(about.variable_step)], c_number(float(about.internal_step or 0))
    return {"setup": [*flags, internal, len(waiting), sum(waiting)], "steps": "events"}


def _has_clocks(m: SystemComponent) -> bool:
    """Whether clocks are ticked: sampled FMUs of this project count their samples themselves."""
    implementation = m.implementation
    return isinstance(implementation, FmuComponent) and implementation.in_event_mode and m.description.kind is None


def _clocks(values: ClockedValues) -> dict[str, Any]:
    """`ClockedSetup` of a component with clocks."""

    def listed(groups: Sequence[ClockedGroup]) -> list[dict[str, Any]]:
        return [{"calls": [g.first, g.n], "clocks": g.clocks, "how": [*map(int, g.how)]} for g in groups]

    clocks = []
    for c, (*numbers, interval, shift) in zip(values.clocks, values.clock_setups(), strict=True):
        times = [f"{{{n}, {d}, {c_number(x)}}}" for n, d, x in (interval, shift)]
        clocks.append([c_string(c.name), *map(int, numbers), *times])
    groups = {"inputs": listed(values.inputs), "outputs": listed(values.outputs)}
    return {"setup": [*map(int, values.numbers())], "clocks": clocks, "groups": groups, "steps": "clocks"}


def _network(plan: NetworkPlan) -> dict[str, Any]:
    """`PlanNetwork`, but for the numbers of its components."""
    wires = [
        {"numbers": [*w.numbers[:5], *map(c_number, w.numbers[5:])], "clocks": w.clocks, "plain": int(w.plain)}
        for w in plan.wires
    ]
    return {"names": [m.name for m in plan.components], "ticks": plan.ticks, "wires": wires}


def _follows(m: SystemComponent, places: Sequence[Variable], p: ComponentPlan) -> dict[str, Any] | None:
    """`UpdateSetup` of a component; `places`: the variable of each of its connected inputs."""
    inputs = followed(m.description)
    lines = {line[0]: line for line in p.extrapolations}
    if not inputs:
        return None
    found = following(inputs, dict(enumerate(places)), lines)
    held = {i: (i, int(p.index[i]), 0, 0, 0.0, 0.0) for i, _ in found.driven}
    return {
        "required": [*by_reference(inputs)],
        "references": found.references,
        "n": found.n,
        "lines": [_extrapolation(lines.get(i, held[i])) for i, _ in found.driven],
        "element": [element for _, element in found.driven],
        "free": [f"{{{place}, {v.reference}, {v.size}, {v.index}}}" for v, place in found.free.items()],
    }


def _extrapolation(line: Sequence[float]) -> str:
    """`EngineExtrapolation`."""
    return f"{{{', '.join(map(str, line[:4]))}, {c_number(line[4])}, {c_number(line[5])}}}"


def _sets(m: SystemComponent, version: int, port: PortLayout, buffers: _Room) -> list[dict[str, Any]]:
    """Calls that set inputs; discrete ones wait for event mode."""

    def waits(v: Variable) -> bool:
        return steps_with_events(m.description) and m.description.waits(v)

    return [
        {**_transfer(m, version, how, buffers), "waits": late}
        for late in (False, True)
        for how in arrangements(version, port.inputs, lambda v, late=late: waits(v) is late, port.sizes)  # type: ignore[misc]
    ]


class _Room:
    """Places one after the other."""

    def __init__(self) -> None:
        self.used = 0

    def take(self, n: int) -> int:
        begin, self.used = self.used, self.used + n
        return begin


def _transfer(m: SystemComponent, version: int, how: Arrangement, buffers: _Room) -> dict[str, Any]:
    if how.sizes:
        return _exact_transfer(m, version, how, buffers)
    return {
        "exact": None,
        "kind": _kind(version, how.fmi_type),
        "references": list(how.arrays),
        "widths": [] if how.widths is None else how.widths.tolist(),
        "n_data": how.total,
        "in_place": how.in_place,
        "at": int(how.place[0]),
        "element": how.element.tolist(),
        "place": how.place.tolist(),
        "keeps": how.keeps,
        "buffer": 0 if how.in_place else buffers.take(_BYTES * how.total),
    }


def _exact_transfer(m: SystemComponent, version: int, how: Arrangement, buffers: _Room) -> dict[str, Any]:
    """A call of texts, bytes or 64-bit integers."""
    if how.keeps:
        names = sorted({elements[0].declared for elements in how.arrays.values()})
        raise WiringError(
            f"'{m.name}': {', '.join(names)}: connect all elements of this array, or none: the FMU of a system does not"
            " keep the others"
        )
    widths = [slots(size) for size in how.sizes]
    places = [int(p) + k for p, w in zip(how.place, widths, strict=True) for k in range(w)]
    begins, texts = (list(accumulate(n, initial=0)) for n in (widths, [size + 1 for size in how.sizes]))
    in_place = places == list(range(places[0], places[0] + len(places)))
    return {
        "exact": {
            "kind": f"EXACT_{how.fmi_type.upper()}",
            "n_values": how.total,
            "items": list(zip(how.element.tolist(), begins, how.sizes, texts, strict=False)),
            "n_texts": texts[-1],
        },
        "kind": _kind(version, how.fmi_type),
        "references": list(how.arrays),
        "widths": [],
        "n_data": len(places),
        "in_place": in_place,
        "at": places[0],
        "element": list(range(len(places))),
        "place": places,
        "keeps": False,
        "buffer": 0 if in_place else buffers.take(_BYTES * len(places)),
    }


def start_values(component: SystemComponent) -> Iterator[tuple[Variable, Any]]:
    """Start values of a component, each as a variable and its text or numbers.

    Of an array, the variable is the first element, and the numbers are those of all elements. Raises WiringError if a
    part of an array is given and the FMU does not tell the other elements.
    """
    variables = component.description.variables
    given = {variables[n]: v for n, v in component.values.items()}
    for elements in by_reference(given).values():
        one = elements[0]
        if one.fmi_type in TEXTS:
            if one.size > 1:
                raise WiringError(
                    f"'{component.name}': {one.declared} is an array of texts, whose start values the FMU of a system"
                    " does not set: set none"
                )
            yield one, bytes(given[one]) if one.fmi_type == "Binary" else str(given[one])
            continue
        whole = [variables[n] for n in component.description.arrays.get(one.declared, [])] if one.size > 1 else [one]
        values = {v.index: given.get(v, v.start) for v in whole}
        missing = [v.name for v in whole if values[v.index] is None]
        if missing:
            raise WiringError(
                f"'{component.name}': set all of {one.declared}; the FMU has no start value for {missing[0]}"
            )
        number = int if one.fmi_type in WIDE else float
        yield one, [number(values[k]) for k in sorted(values)]


def _starts(component: SystemComponent, version: int) -> list[_Start]:
    """The same as C."""
    found = []
    for variable, values in start_values(component):
        if isinstance(values, str):
            found.append(_Start("KIND_STRING", variable.reference, [], values))
        elif isinstance(values, bytes):
            found.append(_Start("KIND_BINARY", variable.reference, list(map(str, values)), type="unsigned char"))
        elif variable.fmi_type in WIDE:
            words = [f"{x % 2**64}ull" for x in values]
            found.append(_Start(_kind(version, variable.fmi_type), variable.reference, words, type="uint64_t"))
        else:
            found.append(_Start(_kind(version, variable.fmi_type), variable.reference, [c_number(x) for x in values]))
    return found


def _kind(version: int, fmi_type: str) -> str:
    kind = _ENUMERATION[version] if fmi_type == "Enumeration" else _KINDS.get(fmi_type, fmi_type.upper())
    return f"KIND_{kind}"


def template(name: str) -> jinja2.Template:
    """One of the templates of this package, by its file name."""
    environment = jinja2.Environment(
        loader=jinja2.PackageLoader("cosim.export", "templates"),
        autoescape=name.endswith(".html"),
        trim_blocks=True,
        lstrip_blocks=True,
        undefined=jinja2.StrictUndefined,
    )
    environment.filters["c"] = c_string
    return environment.get_template(name)
