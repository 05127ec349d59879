"""Reads the structure of a package: its description with all that is nested in it."""

from __future__ import annotations

import math
import warnings
from dataclasses import replace
from fractions import Fraction
from pathlib import Path
from typing import Any

from lxml import etree

from build_fmus.base.checks import did_you_mean, one_line, unknown
from build_fmus.base.units import Unit, meant
from cosim.core.errors import SspError, SspWarning, TimeError
from cosim.core.time import positive, rational
from cosim.ssp import names
from cosim.ssp.elements import enumerations_of, is_true, transformation_of, units_of
from cosim.ssp.names import OMS, OSP, OWN, SSB, SSC, SSD, SSM, SSV
from cosim.ssp.package import Package
from cosim.ssp.structure import Component, Connection, Connector, Element, End, Reference, Structure, System, Value

DEEPEST = 20  # systems in systems
MOST = 10_000  # components in all
_LARGEST = 1_000_000  # elements of one array

KINDS = (
    "input",
    "output",
    "parameter",
    "calculatedParameter",
    "structuralParameter",
    "constant",
    "local",
    "inout",
    "unspecified",
)


def read(package: Package, variant: str | None) -> Structure:
    """The structure of a package: its main description, or a variant by its name or that of its file.

    Raises SspError.
    """
    files = package.descriptions()
    if variant is None:
        return _File(package, files[0], _Count(), ()).structure()
    if not variant.endswith(".ssd"):
        for file in files:
            if file.stem == variant or package.root(file).get("name") == variant:
                return _File(package, file, _Count(), ()).structure()
    for file in files:
        if file.name == variant:
            return _File(package, file, _Count(), ()).structure()
    raise SspError(f"{package.title}: {unknown('variant', variant, (f.name for f in files))}")


class _Count:
    """Components so far."""

    def __init__(self) -> None:
        self.components = 0


class _File:
    """One description of structure. `above`: what it is nested in, of the same package."""

    def __init__(self, package: Package, file: Path, count: _Count, above: tuple[tuple[Path, str], ...]):
        self.package, self.file, self.count, self.above = package, file, count, above
        self.where = f"{package.title}: {file.relative_to(package.folder).as_posix()}"
        self.root = package.root(file)
        if self.root.tag != f"{SSD}SystemStructureDescription":
            raise self.error(
                self.root, f"its element is {etree.QName(self.root).localname}, not SystemStructureDescription"
            )
        self.units = units_of(self.root, f"{SSD}Units/{SSC}Unit", self.where)
        self.items = enumerations_of(self.root, f"{SSD}Enumerations/{SSC}Enumeration", self.where)
        self.warned: set[str] = set()  # units that it was warned of
        self.own: dict[str, Any] = {}  # what our annotation of the system says about its components, by their names

    def error(self, element: Any, text: str) -> SspError:
        return SspError(f"{self.where}, line {element.sourceline}: {text}")

    def text(self, element: Any, attribute: str) -> str:
        """An attribute that must be there."""
        value: str | None = element.get(attribute)
        if not value:
            raise self.error(element, f"{etree.QName(element).localname} has no {attribute}")
        return value

    def structure(self) -> Structure:
        experiment = self.root.find(f"{SSD}DefaultExperiment")
        start, stop, step = Fraction(0), None, None
        if experiment is not None:
            start = self.time(experiment, "startTime") or Fraction(0)
            stop = self.time(experiment, "stopTime")
            hint = experiment.find(f".//{OSP}FixedStepAlgorithm")
            step = None if hint is None else self.time(hint, "baseStepSize", above_zero=True)
        made = self.system(self.top(), step)
        return Structure(self.root.get("name", self.file.stem), made, start, stop)

    def top(self) -> Any:
        system = self.root.find(f"{SSD}System")
        if system is None:
            raise self.error(self.root, "it has no System")
        return system

    def time(self, element: Any, attribute: str, *, above_zero: bool = False) -> Fraction | None:
        text = element.get(attribute)
        if text is None:
            return None
        what = f"{etree.QName(element).localname} {attribute}"
        try:
            seconds = float(text) if "/" not in text else text
            return positive(seconds, what) if above_zero else rational(seconds, what)
        except (TimeError, ValueError) as error:
            reason = (
                str(error)
                if isinstance(error, TimeError)
                else f"{what}: {one_line(text, 40)!r} is not a number of seconds"
            )
            raise self.error(element, reason) from None

    # Systems and what is in them.

    def system(self, element: Any, step: Fraction | None) -> System:
        """A system. `step`: what the one around it says."""
        key = (self.file, element.getroottree().getpath(element))
        if key in self.above:
            raise self.error(element, f"cyclic nesting: the system '{element.get('name', '')}' is part of itself")
        if len(self.above) >= DEEPEST:
            raise self.error(element, f"systems are nested more than {DEEPEST} deep")
        above, self.above = self.above, (*self.above, key)
        master = element.find(
            f"{SSD}Annotations/{SSC}Annotation[@type='{names.OF_OPENMODELICA}']//{OMS}FixedStepMaster"
        )
        if master is not None:
            step = self.time(master, "stepSize", above_zero=True) or step
        own = element.find(f"{SSD}Annotations/{SSC}Annotation[@type='{names.OURS}']/{OWN}System")
        around, self.own = (
            self.own,
            {c.get("component"): c for c in own.iterfind(f"{OWN}Component")} if own is not None else {},
        )
        made = System(
            **self.element(element),
            elements={},
            dictionaries=self.dictionaries(element),
            step=step,
            connections=[self.connection(c) for c in element.iterfind(f"{SSD}Connections/{SSD}Connection")],
        )
        for child in element.iterfind(f"{SSD}Elements/*"):
            found = self.child(child, step)
            if found.name in made.elements:
                raise self.error(child, f"there is already an element '{found.name}' in '{made.name}'")
            made.elements[found.name] = found
        for group in own.iterfind(f"{OWN}Group") if own is not None else ():
            components = tuple(self.text(m, "name") for m in group.iterfind(f"{OWN}Member"))
            made.groups.append((self.text(group, "name"), group.get("method", "jacobi"), components))
        self.above, self.own = above, around
        return made

    def child(self, element: Any, step: Fraction | None) -> Element:
        kind = etree.QName(element).localname
        if kind == "System":
            return self.system(element, step)
        if kind == "SignalDictionaryReference":
            return Reference(**self.element(element), dictionary=self.text(element, "dictionary"))
        if kind != "Component":
            raise self.error(
                element, f"{kind} is not an element of a system; use Component, System or SignalDictionaryReference"
            )
        return self.component(element, step)

    def element(self, element: Any) -> dict[str, Any]:
        """What all elements have."""
        connectors: dict[str, Connector] = {}
        for c in element.iterfind(f"{SSD}Connectors/{SSD}Connector"):
            connector = self.connector(c)
            if connector.name in connectors:
                raise self.error(c, f"there is already a connector '{connector.name}' of '{element.get('name', '')}'")
            connectors[connector.name] = connector
        bindings = [self.binding(b, element) for b in element.iterfind(f"{SSD}ParameterBindings/{SSD}ParameterBinding")]
        return {"name": self.text(element, "name"), "connectors": connectors, "values": bindings}

    def component(self, element: Any, step: Fraction | None) -> Element:
        name, kind = self.text(element, "name"), element.get("type", names.FMU)
        self.count.components += 1
        if self.count.components > MOST:
            raise self.error(element, f"more than {MOST} components")
        source = element.get("source")
        if source is None:
            raise self.error(element, f"component '{name}' has no source: there is nothing to run")
        if kind in (names.DEFINITION, names.PACKAGE):
            return self.nested(element, name, kind, source, step)
        if kind != names.FMU:
            known = (names.FMU, names.DEFINITION, names.PACKAGE)
            raise self.error(
                element, f"component '{name}' is of type {one_line(kind, 80)!r}; cosim runs {', '.join(known)}"
            )
        implementation = element.get("implementation", "any")
        if implementation not in names.IMPLEMENTATIONS:
            raise self.error(
                element,
                f"component '{name}' has the implementation {one_line(implementation, 40)}; cosim runs FMUs by"
                " Co-Simulation and Model Exchange",
            )
        hint = element.find(f"{SSD}Annotations/{SSC}Annotation[@type='{names.OF_OSP}']//{OSP}StepSizeHint")
        own = self.own.get(name)
        return Component(
            **self.element(element),
            fmu=self.package.file(source, self.file, f"component '{name}'"),
            interface=names.IMPLEMENTATIONS[implementation],
            hint=None if hint is None else self.time(hint, "value", above_zero=True),
            own={} if own is None else dict(own.attrib),
            initial=frozenset(i.get("name", "") for i in (() if own is None else own.iterfind(f"{OWN}Initial"))),
        )

    def nested(self, element: Any, name: str, kind: str, source: str, step: Fraction | None) -> System:
        """A component that is a description of this or a nested package, or a system of this file by its id."""
        path, _, fragment = source.partition("#")
        what = f"component '{name}'"
        if not path:
            found = [e for e in self.root.iter(f"{SSD}System") if e.get("id") == fragment]
            if not found:
                raise self.error(element, f"{what}: there is no System with the id {one_line(fragment, 60)!r}")
            inner = self.system(found[0], step)
        elif kind == names.DEFINITION:
            file = _File(self.package, self.package.file(path, self.file, what), self.count, self.above)
            inner = file.system(file.top(), step)
        else:
            if len(self.above) >= DEEPEST:
                raise self.error(element, f"systems are nested more than {DEEPEST} deep")
            packed = self.package.file(path, self.file, what)
            package = Package(packed, self.package.folder.parent, f"{self.package.title}: {path}")
            files = {f.name: f for f in package.descriptions()}
            if fragment and fragment not in files:
                raise SspError(f"{package.title}: {unknown('variant', fragment, files)}")
            file = _File(package, files[fragment or names.ENTRY], self.count, self.above)
            inner = file.system(file.top(), step)
        outer = self.element(element)
        return replace(
            inner,
            name=name,
            connectors={**outer["connectors"], **inner.connectors},
            values=[*inner.values, *outer["values"]],
        )

    # Connectors and connections.

    def connector(self, element: Any) -> Connector:
        name, kind = self.text(element, "name"), self.text(element, "kind")
        if kind not in KINDS:
            raise self.error(element, f"connector '{name}': {unknown('kind', kind, KINDS)}")
        return self.typed(element, name, kind)

    def typed(self, element: Any, name: str, kind: str) -> Connector:
        """A connector, or an entry of a dictionary: its type, unit and size."""
        typed = next((e for e in element if e.tag.startswith(SSC) and not e.tag.endswith("}Dimension")), None)
        shape = tuple(
            self.whole(d, "size") for d in element.iterfind(f"{SSC}Dimension") if d.get("sizeConnector") is None
        )
        if len(shape) < len(element.findall(f"{SSC}Dimension")):
            raise self.error(element, f"'{name}' takes its size from another connector, which cosim does not support")
        if math.prod(shape) > _LARGEST:
            raise self.error(element, f"'{name}' has {math.prod(shape)} elements")
        if typed is None:
            return Connector(name, kind, shape=shape)
        items = typed.get("name")
        return Connector(
            name,
            kind,
            etree.QName(typed).localname,
            self.unit(typed, f"'{name}'"),
            self.items.get(items) if items is not None else None,
            shape,
        )

    def unit(self, element: Any, what: str) -> Unit | None:
        """The unit that an element names: one of the Units.

        Other spellings of a known unit (`[m]`) and an empty text give a warning, once each.
        """
        text = element.get("unit")
        if text is None or text in self.units:
            return None if text is None else self.units[text]
        none = text.strip() in ("", "-", "[]", "[-]")
        found = self.units.get(text.strip(" []")) or meant(text)
        if not none and found is None:
            raise self.error(
                element,
                f"{what} has the unit {one_line(text, 40)!r}, which is not among the"
                f" Units{did_you_mean(text, self.units)}",
            )
        if text not in self.warned:
            self.warned.add(text)
            taken = "no unit" if none or found is None else f"'{found.name}'"
            warnings.warn(
                f"{self.where}, line {element.sourceline}: {what} has the unit {one_line(text, 40)!r}, which is not"
                f" among the Units; it is read as {taken}",
                SspWarning,
                stacklevel=2,
            )
        return None if none else found

    def whole(self, element: Any, attribute: str) -> int:
        text = self.text(element, attribute)
        if not text.strip().isdecimal() or len(text) > 18:
            raise self.error(
                element,
                (
                    f"{etree.QName(element).localname} {attribute} is {one_line(text, 40)!r}, which is not a whole"
                    " number"
                ),
            )
        return int(text)

    def connection(self, element: Any) -> Connection:
        ends = []
        for which in ("start", "end"):
            texts = element.get(f"{which}Indices", "").split()
            if not all(t.isdecimal() and len(t) < 10 for t in texts):
                raise self.error(element, f"{which}Indices are not whole numbers")
            ends.append(
                End(
                    element.get(f"{which}Element") or "",
                    self.text(element, f"{which}Connector"),
                    tuple(map(int, texts)),
                )
            )
        own = element.find(f"{SSD}Annotations/{SSC}Annotation[@type='{names.OURS}']/{OWN}Connection")
        flags: dict[str, Any] = {} if own is None else {k: own.get(k) == "true" for k in ("delay", "extrapolate")}
        if own is not None and own.get("maxSize") is not None:
            flags["max_size"] = self.whole(own, "maxSize")
        return Connection(
            ends[0],
            ends[1],
            element.sourceline,
            transformation_of(element, self.where),
            is_true(element, "suppressUnitConversion"),
            **flags,
        )

    def dictionaries(self, element: Any) -> dict[str, dict[str, Connector]]:
        found: dict[str, dict[str, Connector]] = {}
        for d in element.iterfind(f"{SSD}SignalDictionaries/{SSD}SignalDictionary"):
            name = self.text(d, "name")
            if name in found:
                raise self.error(d, f"there is already a signal dictionary '{name}'")
            root, base = self.content(d, f"signal dictionary '{name}'", names.DICTIONARY, f"{SSB}SignalDictionary")
            reader = self.beside(root, base, f"{SSB}Units/{SSC}Unit", f"{SSB}Enumerations/{SSC}Enumeration")
            entries: dict[str, Connector] = {}
            for e in root.iterfind(f"{SSB}DictionaryEntry"):
                entry = reader.typed(e, reader.text(e, "name"), "inout")
                if entry.name in entries:
                    raise reader.error(e, f"there is already an entry '{entry.name}' in the signal dictionary '{name}'")
                entries[entry.name] = entry
            found[name] = entries
        return found

    def beside(self, root: Any, file: Path, units: str, items: str) -> _File:
        """A reader of another file's elements, with that file's units and enumerations."""
        other = object.__new__(_File)
        other.__dict__.update(self.__dict__)
        other.file = file
        other.where = f"{self.package.title}: {file.relative_to(self.package.folder).as_posix()}"
        other.units = units_of(root, units, other.where) or self.units
        other.items = enumerations_of(root, items, other.where) or self.items
        return other

    def content(self, element: Any, what: str, kind: str, tag: str, source: Any = None) -> tuple[Any, Path]:
        """What an element holds inline, or the file that it names."""
        if (found := element.get("type", kind)) != kind:
            raise self.error(element, f"{what} is of type {one_line(found, 80)!r}; it must be {kind}")
        uri = element.get("source")
        if uri is None:
            inline = (element if source is None else source).find(tag)
            if inline is None:
                raise self.error(element, f"{what} has neither a source nor a {tag.split('}')[1]}")
            return inline, self.file
        if element.get("sourceBase", "SSD") != "SSD":
            raise self.error(element, f"{what}: its file is inside the component, where cosim cannot read it")
        path = self.package.file(uri, self.file, what)
        root = self.package.root(path)
        if root.tag != tag:
            raise SspError(f"{self.package.title}: {uri} holds {etree.QName(root).localname}, not {tag.split('}')[1]}")
        return root, path

    # Parameters.

    def binding(self, element: Any, owner: Any) -> list[Value]:
        what = f"a parameter binding of '{owner.get('name', '')}'"
        root, base = self.content(
            element, what, names.PARAMETERS, f"{SSV}ParameterSet", element.find(f"{SSD}ParameterValues")
        )
        reader = self.beside(root, base, f"{SSV}Units/{SSC}Unit", f"{SSV}Enumerations/{SSC}Enumeration")
        prefix = element.get("prefix", "")
        values: dict[str, Value] = {}
        for p in root.iterfind(f"{SSV}Parameters/{SSV}Parameter"):
            value = reader.value(p, prefix)
            if value.name in values:
                raise reader.error(p, f"there is already a parameter '{value.name}'")
            values[value.name] = value
        mapping = element.find(f"{SSD}ParameterMapping")
        if mapping is None:
            return list(values.values())
        entries, base = self.content(mapping, f"the mapping of {what}", names.MAPPING, f"{SSM}ParameterMapping")
        reader = self.beside(entries, base, f"{SSM}none", f"{SSM}none")
        found: dict[str, Value] = {}
        for e in entries.iterfind(f"{SSM}MappingEntry"):
            source, target = reader.text(e, "source"), reader.text(e, "target")
            if target in found:
                raise reader.error(e, f"'{target}' is mapped twice")
            change = transformation_of(e, reader.where)
            if source in values:
                found[target] = replace(
                    values[source], name=target, transformation=change, suppress=is_true(e, "suppressUnitConversion")
                )
        return list(found.values())

    def value(self, element: Any, prefix: str) -> Value:
        name = self.text(element, "name")
        typed = next((e for e in element if e.tag.startswith(SSV)), None)
        if typed is None:
            raise self.error(element, f"parameter '{name}' has no type")
        kind = etree.QName(typed).localname
        single, listed = typed.get("value"), [v.get("value", "") for v in typed.iterfind(f"{SSV}Value")]
        if single is None and not listed:
            raise self.error(element, f"parameter '{name}' has no value")
        texts = listed or ([single] if kind in ("String", "Enumeration", "Binary") else single.split())
        if not texts:
            raise self.error(element, f"parameter '{name}' has no value")
        return Value(prefix + name, kind, tuple(texts), self.unit(typed, f"parameter '{name}'"))
