"""An SSP of a system: the description of its structure, its FMUs, its parameter sets.

The same system gives the same bytes.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from fractions import Fraction
from importlib import metadata
from pathlib import Path
from typing import Any

from lxml import etree

from build_fmus.base import escape, safe_files
from build_fmus.base.archives import zipped
from build_fmus.base.checks import did_you_mean
from build_fmus.base.units import BASE_UNITS, Unit, UnitMismatchError, conversion
from cosim.core.description import TEXTS, Variable
from cosim.core.errors import SspError, WiringError
from cosim.core.time import gcd
from cosim.fmu.component import FmuComponent
from cosim.fmu.file import FmuFile
from cosim.fmu.interface import INTERFACES
from cosim.fmu.model_exchange import ModelExchange
from cosim.picture.layout import Picture, arrange
from cosim.ssp import names
from cosim.ssp.names import OMS, OSP, OWN, SSC, SSD, version_of
from cosim.ssp.schema import deviation
from cosim.ssp.values import items_of, parameter_set
from cosim.system.components import Connection, SystemComponent, indices
from cosim.system.names import SystemComponents
from cosim.system.schedule import Schedule

_MILLIMETRE = 0.1  # of the drawing, for a point of the picture
_TOLERANCE = "1e-4"  # that OMSimulator wants to read and a fixed step does not use
_TYPES1 = {"Real", "Integer", "Boolean", "String", "Enumeration"}

Name = tuple[SystemComponent, str]


def export_ssp(
    components: Iterable[SystemComponent],
    schedule: Schedule,
    path: Path,
    *,
    version: str,
    stop_time: Fraction | None,
    inputs: Iterable[str],
    initial: Mapping[str, float],
    text: str = "",
) -> Path:
    """Write a system as an SSP; see `System.export_ssp`.

    All components come in their order; `inputs`: full names of inputs that become inputs of the system; `initial`:
    values of connected inputs after initialization, by name. Raises SspError naming components that an SSP cannot
    contain.
    """
    version = version_of(version)
    if path.suffix != ".ssp" or not path.stem:
        raise SspError(f"{path}: name the file NAME.ssp")
    exporter = _Exporter(path.stem, list(components), schedule, version, stop_time, sorted(inputs), initial, text)
    with safe_files.named(path):
        return safe_files.write(path, exporter.archive())


def files_of(schedule: Schedule, version: str) -> dict[SystemComponent, FmuFile]:
    """The file of every component, in the version of FMI that the SSP takes.

    Raises SspError for a component without such a file, and for connected clocks.
    """
    for c in schedule.ticks:
        raise SspError(
            f"{c.source_name} -> {c.target_name} connects clocks, which cosim does not write into an SSP: take this"
            " connection out"
        )
    found = {}
    for m in schedule.components:
        if not isinstance(m.implementation, FmuComponent):
            raise SspError(
                f"'{m.name}' is written in Python, and an SSP holds FMUs only: leave it out, or declare it as a"
                " component that build-fmus makes an FMU of"
            )
        if m.implementation.isolation is not None:
            raise SspError(
                f"'{m.name}' is isolated, which an SSP cannot express: add it without isolation, and isolate it when"
                " you run the SSP"
            )
        if m.implementation.structure:
            raise SspError(
                f"'{m.name}' was added with {', '.join(m.implementation.structure)}, and in an SSP it has the FMU's own"
                " array sizes: add it without these"
            )
        found[m] = _file_of(m, m.implementation.fmu, schedule, names.FMI_OF[version_of(version)])
    return found


def _file_of(m: SystemComponent, fmu: FmuFile, schedule: Schedule, major: str) -> FmuFile:
    if fmu.major == major:
        return fmu
    sibling = _sibling(fmu, major)
    if sibling is not None:
        _require_same(m, fmu, sibling, schedule)
        return sibling
    if fmu.major == "3":
        raise SspError(
            f"'{m.name}' ({fmu.path}) is an FMU of FMI 3.0, which SSP 1.0 does not support, and there is no "
            f"{fmu.path.parent.parent / 'fmi2' / fmu.path.name}: export the system as SSP 2.0"
        )
    return fmu  # SSP 2.0 knows FMI 2.0 too


def _require_same(m: SystemComponent, fmu: FmuFile, sibling: FmuFile, schedule: Schedule) -> None:
    """The other version of a component's FMU has what the system uses."""
    every = schedule.value_connections
    used = {c.output for c in every if c.source is m} | {c.input for c in every if c.target is m}
    used |= {m.description.variables[n] for n in m.values}
    for v in sorted(used, key=lambda v: v.name):
        other = sibling.description.variables.get(v.name)
        if other is None or (other.causality, other.type, other.unit_name) != (v.causality, v.type, v.unit_name):
            raise SspError(f"'{m.name}': {sibling.path} has no {v.causality} '{v.name}' like that of {fmu.path}")


def open_inputs(schedule: Schedule, patterns: Iterable[str]) -> list[str]:
    """Full names of inputs that nothing drives, by names and patterns. Raises WiringError for one that fits none."""
    components = SystemComponents((m.name, m) for m in schedule.components)
    driven = {c.target_name for c in schedule.connections}
    found: dict[str, None] = {}
    for pattern in patterns:
        fitting = [
            f"{m.name}.{v.name}"
            for m, v in components.fitting(pattern, "input")
            if v.causality == "input" and v.size == 1
        ]
        free = [n for n in fitting if n not in driven]
        if not free:
            raise WiringError(f"'{pattern}' is not an unconnected input{did_you_mean(pattern, schedule.unconnected)}")
        found.update(dict.fromkeys(free))
    return list(found)


def identifiers(texts: Iterable[str]) -> dict[str, str]:
    """An identifier for each text, its own where it is one already; no two are the same."""
    found: dict[str, str] = {}
    for text in sorted(texts, key=lambda t: (not (t.isascii() and t.isidentifier()), t)):
        found[text] = escape.c_identifier(text, found.values())
    return found


@dataclass(frozen=True, eq=False)
class _Wire:
    """A connection of the file: of scalars, whole arrays, or elements of arrays."""

    connection: Connection  # the first of those that it stands for
    start: str
    end: str
    start_indices: tuple[int, ...] = ()
    end_indices: tuple[int, ...] = ()


@dataclass
class _Exporter:
    name: str
    components: list[SystemComponent]
    schedule: Schedule
    version: str
    stop_time: Fraction | None
    open: list[str]
    initial: Mapping[str, float]
    text: str
    fmus: dict[SystemComponent, FmuFile] = field(init=False)
    units: dict[str, Unit] = field(default_factory=dict)
    enumerations: dict[str, dict[str, int]] = field(default_factory=dict)

    def __post_init__(self) -> None:
        self.ids = identifiers(m.name for m in self.components)
        self.fmus = files_of(self.schedule, self.version)
        files = {f.path: f for f in self.fmus.values()}
        stems = identifiers(str(p) for p in files)
        short = identifiers(p.stem for p in files)
        several = len({p.stem for p in files}) < len(files)
        self.sources = {p: f"resources/{(_short(stems[str(p)], p) if several else short[p.stem])}.fmu" for p in files}
        self.driven = {c.target_name: c for c in self.schedule.value_connections}
        self.open_ids = identifiers(self.open)

    def _variable(self, full: str) -> Variable:
        component, name = next((m, full[len(m.name) + 1 :]) for m in self.components if full.startswith(f"{m.name}."))
        return component.description.variables[name]

    def archive(self) -> bytes:
        """The bytes of the package."""
        files = {names.ENTRY: self._structure()}
        for m in self.components:
            if values := self._values(m):
                made = parameter_set(m.name, values, self.fmus[m], self.version)
                files[self._values_file(m)] = serialize(made)
        for path, name in self.sources.items():
            files[name] = _packed(path)
        return zipped(files, names.ENTRY)

    # Its values.

    def _values_file(self, m: SystemComponent) -> str:
        return f"resources/{self.ids[m.name]}.ssv"

    def _values(self, m: SystemComponent) -> dict[str, Any]:
        """What is set before initialization: what the system sets, and what its connected inputs then show."""
        shown = {
            v.name: self.initial[f"{m.name}.{v.name}"]
            for v in m.description.inputs.values()
            if v.name not in m.values and f"{m.name}.{v.name}" in self.initial
        }
        return {n: self._typed(m, n, v) for n, v in sorted({**m.values, **shown}.items())}

    def _typed(self, m: SystemComponent, name: str, value: Any) -> Any:
        v = m.description.variables[name]
        if v.fmi_type == "Binary":
            return value
        return {"real": float, "integer": int, "boolean": bool}.get(v.type, str)(value)

    def _only_initial(self, m: SystemComponent) -> list[str]:
        """Values of connected inputs for tools that step before they exchange, and values that complete arrays."""
        about, written = m.description, set(self._values(m))
        if self.fmus[m].major == "3":
            written |= {
                e for n in written if about.variables[n].size > 1 for e in about.arrays[about.variables[n].declared]
            }
        return sorted(written - m.values.keys())

    # The description of the structure.

    def _structure(self) -> bytes:
        root = etree.Element(
            f"{SSD}SystemStructureDescription", nsmap=names.PREFIXES, version=self.version, name=escape.xml(self.name)
        )
        root.set("generationTool", f"{names.OURS} {metadata.version(names.OURS)}")
        if self.text:
            root.set("description", escape.xml(self.text))
        system = etree.SubElement(root, f"{SSD}System", name=identifiers([self.name])[self.name])
        picture = arrange(self.schedule)
        if self.open:
            connectors = etree.SubElement(system, f"{SSD}Connectors")
            for n in self.open:
                self._connector(connectors, self.open_ids[n], "input", self._variable(n), None)
        elements = etree.SubElement(system, f"{SSD}Elements")
        for m in self.components:
            self._component(elements, m, picture)
        wires = self._wires()
        if wires or self.open:
            connections = etree.SubElement(system, f"{SSD}Connections")
            for n in self.open:
                variable = self._variable(n).name
                etree.SubElement(
                    connections,
                    f"{SSD}Connection",
                    startConnector=self.open_ids[n],
                    endElement=self.ids[n.removesuffix(f".{variable}")],
                    endConnector=variable,
                )
            for wire in wires:
                self._connection(connections, wire)
        etree.SubElement(
            system, f"{SSD}SystemGeometry", x1="0", y1="0", x2=_length(picture.width), y2=_length(picture.height)
        )
        self._system_annotations(system)
        if self.enumerations:
            self._enumerations(etree.SubElement(root, f"{SSD}Enumerations"))
        if self.units:
            listed = etree.SubElement(root, f"{SSD}Units")
            for unit in sorted(self.units.values(), key=lambda u: u.name):
                unit_element(listed, unit)
        self._experiment(root)
        wrong = deviation(etree.fromstring(etree.tostring(root)))
        if wrong:
            raise SspError(f"the system cannot be described in SSP {self.version}: {wrong}")
        return serialize(root)

    def _component(self, elements: etree._Element, m: SystemComponent, picture: Picture) -> None:
        fmu, box = self.fmus[m], picture.boxes[m]
        element = etree.SubElement(
            elements,
            f"{SSD}Component",
            name=self.ids[m.name],
            type=names.FMU,
            source=self.sources[fmu.path],
            implementation=INTERFACES[m.description.interface],
        )
        if m.description.text:
            element.set("description", m.description.text)
        connectors = self._connectors(m)
        if connectors:
            parent = etree.SubElement(element, f"{SSD}Connectors")
            sides = {
                "input": [c for c in connectors if c[1] == "input"],
                "output": [c for c in connectors if c[1] != "input"],
            }
            for declared, kind, v in connectors:
                side = sides["input" if kind == "input" else "output"]
                y = 1 - (side.index((declared, kind, v)) + 1) / (len(side) + 1)
                place = None if kind == "parameter" else (0.0 if kind == "input" else 1.0, y)
                self._connector(parent, declared, kind, v, place)
        etree.SubElement(
            element,
            f"{SSD}ElementGeometry",
            x1=_length(box.x),
            y1=_length(picture.height - box.bottom),
            x2=_length(box.right),
            y2=_length(picture.height - box.y),
        )
        if self._values(m):
            bindings = etree.SubElement(element, f"{SSD}ParameterBindings")
            etree.SubElement(bindings, f"{SSD}ParameterBinding", source=self._values_file(m))
        if m.step not in (self._step, m.description.sample_time):  # a sampled FMU keeps its sample time at any step
            annotations = etree.SubElement(element, f"{SSD}Annotations")
            hint = etree.SubElement(annotations, f"{SSC}Annotation", type=names.OF_OSP)
            etree.SubElement(hint, f"{OSP}StepSizeHint", value=repr(float(m.step)))

    def _connectors(self, m: SystemComponent) -> list[tuple[str, str, Variable]]:
        """Name, kind and (first) variable of each connector: all outputs, connected inputs, parameters that are set.

        Inputs that keep their start values get no connector: several readers drive every connector, by 0 or by another
        one's source.
        """
        fed = {*self.driven, *self.open}
        found: dict[str, tuple[str, str, Variable]] = {}
        local = {c.output.name for c in self.schedule.connections if c.source is m and c.output.causality == "local"}
        if local and self.version == "1.0":
            raise SspError(
                f"'{m.name}.{min(local)}' is a local variable that drives something, for which SSP 1.0 has no"
                " connector: export it as SSP 2.0"
            )
        passed_on = {c.output.name for c in self.schedule.parameters if c.source is m}
        for v in m.description.variables.values():
            kind = "local" if v.name in local else v.causality
            wanted = {
                "input": f"{m.name}.{v.name}" in fed,
                "output": True,
                "local": v.name in local,
                "parameter": v.name in m.values or f"{m.name}.{v.name}" in fed,
                "calculatedParameter": v.name in passed_on,
            }
            if wanted.get(kind, False) and v.fmi_type != "Clock":
                found.setdefault(self._declared(m, v)[0], (self._declared(m, v)[0], kind, v))
        return list(found.values())

    def _declared(self, m: SystemComponent, v: Variable) -> tuple[str, tuple[int, ...]]:
        """Name of the connector that a variable belongs to, and its indices in it."""
        if v.size == 1 or self.fmus[m].major == "2":
            return v.name, ()
        return v.declared, indices(v.name)

    def _connector(
        self, parent: etree._Element, name: str, kind: str, v: Variable, place: tuple[float, float] | None
    ) -> None:
        element = etree.SubElement(parent, f"{SSD}Connector", name=name, kind=kind)
        if v.description:
            element.set("description", v.description)
        typed = etree.SubElement(element, f"{SSC}{self._type(v)}")
        unit = v.unit
        if v.type == "real" and unit is not None and unit.exponents is not None:
            known = self.units.setdefault(unit.name, unit)
            if (known.exponents, known.factor, known.offset) == (unit.exponents, unit.factor, unit.offset):
                typed.set("unit", unit.name)
        if v.mime_type:
            typed.set("mime-type", v.mime_type)
        if typed.tag == f"{SSC}Enumeration":
            typed.set("name", self._enumeration(v))
        if v.size > 1 and name == v.declared:
            for n in self._shape(v):
                etree.SubElement(element, f"{SSC}Dimension", size=str(n))
        if place is not None:
            etree.SubElement(element, f"{SSD}ConnectorGeometry", x=_number(place[0]), y=_number(place[1]))

    def _type(self, v: Variable) -> str:
        if self.version == "2.0" or v.fmi_type in _TYPES1:
            return v.fmi_type
        return {"real": "Real", "integer": "Integer", "boolean": "Boolean"}.get(v.type, "String")

    def _owner(self, v: Variable) -> SystemComponent:
        return next(m for m in self.components if m.description.variables.get(v.name) is v)

    def _shape(self, v: Variable) -> tuple[int, ...]:
        all_names = self._owner(v).description.arrays[v.declared]
        return tuple(max(indices(n)[k] for n in all_names) for k in range(len(indices(v.name))))

    def _enumeration(self, v: Variable) -> str:
        name, items = items_of(self._owner(v).implementation.fmu, v)  # type: ignore[attr-defined]
        unique = next(
            n
            for n in (name, *(f"{name}_{k}" for k in range(2, len(self.enumerations) + 3)))
            if self.enumerations.get(n, items) == items
        )
        self.enumerations[unique] = items
        return unique

    def _enumerations(self, parent: etree._Element) -> None:
        for name, items in sorted(self.enumerations.items()):
            element = etree.SubElement(parent, f"{SSC}Enumeration", name=name)
            for item, value in items.items():
                etree.SubElement(element, f"{SSC}Item", name=item, value=str(value))

    # Connections.

    def _wires(self) -> list[_Wire]:
        """Connections of the file; arrays whose elements are all connected in order are connected as a whole."""
        found: list[_Wire] = []
        whole: dict[tuple[Name, Name], list[Connection]] = {}
        for c in self.schedule.value_connections:
            (start, si), (end, ei) = self._declared(c.source, c.output), self._declared(c.target, c.input)
            if si and ei:
                whole.setdefault(((c.source, start), (c.target, end)), []).append(c)
            else:
                found.append(_Wire(c, start, end, si, ei))
        for ((source, start), (target, end)), listed in whole.items():
            pairs = {(c.output.index, c.input.index) for c in listed}
            alike = len({(c.delay, c.extrapolate, c.scale, c.offset, c.size) for c in listed}) == 1
            shapes = self._shape(listed[0].output), self._shape(listed[0].input)
            if alike and shapes[0] == shapes[1] and pairs == {(k, k) for k in range(listed[0].output.size)}:
                found.append(_Wire(listed[0], start, end))
            else:
                found += [
                    _Wire(c, start, end, self._declared(source, c.output)[1], self._declared(target, c.input)[1])
                    for c in listed
                ]
        return sorted(found, key=lambda w: (w.connection.target_name, w.connection.source_name))

    def _connection(self, parent: etree._Element, wire: _Wire) -> None:
        c = wire.connection
        element = etree.SubElement(
            parent,
            f"{SSD}Connection",
            startElement=self.ids[c.source.name],
            startConnector=wire.start,
            endElement=self.ids[c.target.name],
            endConnector=wire.end,
        )
        for key, values in (("startIndices", wire.start_indices), ("endIndices", wire.end_indices)):
            if values:
                element.set(key, " ".join(map(str, values)))
        try:
            by_units = conversion(c.output.unit, c.input.unit, c.output.relative and c.input.relative)
        except UnitMismatchError:
            by_units = None
        if by_units != (c.scale, c.offset):
            element.set("suppressUnitConversion", "true")
            etree.SubElement(element, f"{SSC}LinearTransformation", factor=repr(c.scale), offset=repr(c.offset))
        text = c.output.fmi_type in TEXTS and c.size
        if c.delay or c.extrapolate or text:
            annotations = etree.SubElement(element, f"{SSD}Annotations")
            own = etree.SubElement(annotations, f"{SSC}Annotation", type=names.OURS)
            how = {"delay": _flag(c.delay), "extrapolate": _flag(c.extrapolate)}
            etree.SubElement(own, f"{OWN}Connection", **how, **({"maxSize": str(c.size)} if text else {}))

    # What is of the whole system.

    @property
    def _step(self) -> Fraction:
        """The longest step that divides all."""
        return gcd([m.step for m in self.components])

    def _system_annotations(self, system: etree._Element) -> None:
        """OMSimulator's annotations first, since it reads only the first one; then ours.

        Ours are here because OMSimulator rejects any annotation in a component.
        """
        annotations = etree.SubElement(system, f"{SSD}Annotations")
        oms = etree.SubElement(annotations, f"{SSC}Annotation", type=names.OF_OPENMODELICA)
        information = etree.SubElement(etree.SubElement(oms, f"{OMS}Annotations"), f"{OMS}SimulationInformation")
        etree.SubElement(
            information,
            f"{OMS}FixedStepMaster",
            description="oms-ma",
            stepSize=repr(float(self._step)),
            absoluteTolerance=_TOLERANCE,
            relativeTolerance=_TOLERANCE,
        )
        own = etree.SubElement(etree.SubElement(annotations, f"{SSC}Annotation", type=names.OURS), f"{OWN}System")
        for m in self.components:
            about = {
                "component": self.ids[m.name],
                "name": m.name,
                "kind": m.kind,
                "step": str(m.step),
                "offset": str(m.offset),
            }
            implementation = m.implementation
            assert isinstance(implementation, FmuComponent)
            if implementation.integrated and implementation.exchange != ModelExchange():
                how = {"tolerance": implementation.exchange.tolerance, "solver": implementation.exchange.solver}
                about |= {k: str(v) for k, v in how.items() if v is not None}
            element = etree.SubElement(own, f"{OWN}Component", **about)
            for n in self._only_initial(m):
                etree.SubElement(element, f"{OWN}Initial", name=n)
        for group in self.schedule.groups:
            if not group.name:
                continue
            element = etree.SubElement(own, f"{OWN}Group", name=group.name, method=group.method)
            for m in group.components:
                etree.SubElement(element, f"{OWN}Member", name=m.name)

    def _experiment(self, root: etree._Element) -> None:
        ends = [m.description.default_stop for m in self.components if m.description.default_stop]
        stop = self.stop_time if self.stop_time is not None else max(ends, default=None)
        element = etree.SubElement(root, f"{SSD}DefaultExperiment", startTime="0.0")
        if stop is not None:
            element.set("stopTime", repr(float(stop)))
        annotations = etree.SubElement(element, f"{SSD}Annotations")
        osp = etree.SubElement(annotations, f"{SSC}Annotation", type=names.OF_OSP)
        algorithm = etree.SubElement(osp, f"{OSP}Algorithm")
        etree.SubElement(algorithm, f"{OSP}FixedStepAlgorithm", baseStepSize=repr(float(self._step)))


def _sibling(fmu: FmuFile, major: str) -> FmuFile | None:
    """The same FMU in another version of FMI, where `build-fmus` puts it: fmi2/NAME.fmu beside fmi3/NAME.fmu."""
    path = fmu.path.absolute()
    if path.parent.name != f"fmi{fmu.major}":
        return None
    other = path.parent.parent / f"fmi{major}" / path.name
    if not other.is_file():
        return None
    found = FmuFile(other, quiet=True)
    return found if (found.major, found.description.name) == (major, fmu.description.name) else None


def unit_element(parent: etree._Element, unit: Unit) -> None:
    """A unit by its exponents, factor and offset."""
    powers = {b: str(n) for b, n in zip(BASE_UNITS, unit.exponents or (), strict=False) if n}
    more = {
        k: repr(x) for k, x, default in (("factor", unit.factor, 1.0), ("offset", unit.offset, 0.0)) if x != default
    }
    etree.SubElement(etree.SubElement(parent, f"{SSC}Unit", name=unit.name), f"{SSC}BaseUnit", **powers, **more)


def _packed(path: Path) -> bytes:
    """The bytes of an FMU, which may be the folder of an unpacked one."""
    try:
        if path.is_file():
            return path.read_bytes()
        return zipped({p.relative_to(path).as_posix(): p.read_bytes() for p in path.rglob("*") if p.is_file()})
    except OSError as error:
        raise SspError(f"{path}: cannot be read again ({error.strerror or error})") from None


def serialize(root: etree._Element) -> bytes:
    """A file of the package, without namespaces that it does not use."""
    etree.cleanup_namespaces(root, keep_ns_prefixes=["ssd", "ssc", "ssv"])
    etree.indent(root)
    return bytes(etree.tostring(root, encoding="UTF-8", xml_declaration=True)) + b"\n"


def _short(identifier: str, path: Path) -> str:
    """A file's name when another one has the same."""
    return f"{path.parent.name}_{path.stem}" if path.parent.name else identifier


def _length(points: float) -> str:
    return _number(points * _MILLIMETRE)


def _number(x: float) -> str:
    return f"{x:.4g}"


def _flag(value: bool) -> str:
    return "true" if value else "false"
