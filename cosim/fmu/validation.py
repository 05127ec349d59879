"""What is wrong with a modelDescription.xml that can be run nevertheless: findings, known quirks among them.

What cannot be read or run safely is refused by the parser (`xml`, `model_description`) at every opening. What is looked
for here is advice: deviations from the schemas of FMI 2.0 and 3.0, and values that contradict each other. It depends on
the file alone, so the verdict is kept by the hash of the file and of everything that it is made with.
"""

from __future__ import annotations

import hashlib
import math
import re
import tomllib
from collections.abc import Iterable, Iterator
from contextlib import suppress
from dataclasses import astuple, dataclass
from functools import cache
from pathlib import Path
from typing import Any

from lxml import etree

from build_fmus.base import safe_files
from build_fmus.base.checks import one_line
from cosim.core.description import Description, Variable
from cosim.fmu.calls import accessed_as
from cosim.fmu.model_description import nominal_size
from cosim.fmu.xml import schema as xml_schema

MOST = 200  # findings of each kind that are kept; of the others only the number
WORTH_KEEPING = 8192  # bytes of XML from which on a verdict is read sooner than it is found
_SLICE = 4000  # elements and attributes that are compared with the schema at a time
_NAMED = 50  # findings of the schema whose variable is looked up

_HERE = Path(__file__).parent
_QUIRKS = _HERE / "quirks.toml"
_XSI = "http://www.w3.org/2001/XMLSchema-instance"
_CONTINUOUS = ("Real", "Float32", "Float64")


@dataclass(frozen=True)
class Finding:
    """An error at a line of modelDescription.xml.

    `quirk`: for a known quirk of a tool, the reason why it does no harm.
    """

    line: int
    text: str
    quirk: str = ""

    def __str__(self) -> str:
        return f"line {self.line}: {self.text}"


@dataclass(frozen=True)
class Verdict:
    """Findings that matter and known quirks, by line, and how many more there are of each."""

    findings: tuple[Finding, ...] = ()
    quirks: tuple[Finding, ...] = ()
    more_findings: int = 0
    more_quirks: int = 0

    def __bool__(self) -> bool:
        """Whether there is anything that matters."""
        return bool(self.findings)

    def summary(self, longest: int = 4) -> str:
        """The first findings and the number of the others, in a line."""
        shown = [*map(str, self.findings[:longest])]
        if left := len(self.findings) + self.more_findings - len(shown):
            shown.append(f"and {left} more")
        return "; ".join(shown)


@dataclass(frozen=True)
class Quirk:
    """A known deviation of a tool: wildcards for tool and finding, why it does no harm, and where it is documented."""

    tool: str
    finding: str
    reason: str
    source: str

    def fits(self, tool: str, finding: str) -> bool:
        """Whether the entry applies to a finding about an FMU of a tool."""
        return bool(_wildcard(self.tool).fullmatch(tool) and _wildcard(self.finding).fullmatch(finding))


@cache
def quirks() -> tuple[Quirk, ...]:
    """The table of `quirks.toml`."""
    return tuple(Quirk(**entry) for entry in tomllib.loads(_QUIRKS.read_text(encoding="utf-8"))["quirk"])


def harmless(tool: str, finding: str) -> str:
    """Why a finding about an FMU of a tool does no harm, if it is a known quirk; empty otherwise."""
    return next((q.reason for q in quirks() if q.fits(tool, finding)), "")


@cache
def _wildcard(pattern: str) -> re.Pattern[str]:
    text = re.escape(pattern).replace(r"\*", ".*").replace(r"\?", ".")
    return re.compile(text, re.IGNORECASE | re.DOTALL)


def verdict(xml: bytes, root: Any, about: Description) -> Verdict:
    """What is wrong with a description that has been read: the one that was kept, or found now and kept."""
    if len(xml) < WORTH_KEEPING:
        return judge(root, about)
    path = safe_files.cache_directory() / "verdicts" / f"{_key(xml)}.json"
    with suppress(safe_files.CacheMiss, OSError, ValueError, TypeError):
        found, known, *more = safe_files.kept_json(path)
        return Verdict(tuple(Finding(*f) for f in found), tuple(Finding(*f) for f in known), *more)
    made = judge(root, about)
    with suppress(OSError):  # a place where nothing can be kept
        safe_files.keep_json(path, astuple(made))
    return made


def _key(xml: bytes) -> str:
    return hashlib.sha256(_makers() + xml).hexdigest()[:32]


@cache
def _makers() -> bytes:
    """Hash of what verdicts are made with: the code of this package, the quirks and the schemas."""
    files = [*_HERE.glob("*.py"), _QUIRKS, *_HERE.glob("third_party/*/*.xsd")]
    return hashlib.sha256(b"\0".join(f.name.encode() + b"\0" + f.read_bytes() for f in sorted(files))).digest()


def judge(root: Any, about: Description) -> Verdict:
    """What is wrong with a description that has been read. Nothing of the tree is left afterwards."""
    major = about.fmi_version[0]
    found = [
        *_structure(root, about, major),
        *_values(root, about, major),
        *_schema(root, major),
    ]  # the last takes the tree apart
    ordered = sorted(found, key=lambda f: f.line)
    sorted_out: tuple[list[Finding], list[Finding]] = [], []
    for finding in ordered:
        reason = harmless(about.tool, finding.text)
        sorted_out[bool(reason)].append(Finding(finding.line, finding.text, reason))
    plain, known = sorted_out
    return Verdict(tuple(plain[:MOST]), tuple(known[:MOST]), max(0, len(plain) - MOST), max(0, len(known) - MOST))


# ------------------------------------------------------------------------------------------------------------- schema


def _schema(root: Any, major: str) -> Iterator[Finding]:
    """Deviations from the schema, one for each element."""
    for element in root.xpath("//*[@xsi:*]", namespaces={"xsi": _XSI}):
        for hint in ("schemaLocation", "noNamespaceSchemaLocation"):  # the validator would open what they name
            element.attrib.pop(f"{{{_XSI}}}{hint}", None)
    schema = xml_schema(_HERE / "third_party" / f"fmi{major}" / f"fmi{major}ModelDescription.xsd")
    found: dict[tuple[int, str], Finding] = {}
    for slice_ in _slices(root):
        for element, children in slice_:
            element[:] = children
        if schema.validate(root):
            continue
        seen: set[str] = set()
        for error in schema.error_log:
            if error.path in seen:
                continue  # one wrong value breaks several rules
            seen.add(error.path)
            text = one_line(error.message).rstrip(".")
            text = text[:1].lower() + text[1:]
            if (key := (error.line, text)) not in found:
                owner = _owner(root, error.path) if len(found) < _NAMED else ""
                found[key] = Finding(error.line, owner + text)
        if len(found) > MOST:
            break  # the rest is not better
    yield from found.values()


def _slices(root: Any) -> Iterator[list[tuple[Any, list[Any]]]]:
    """The children to leave in each long element, a slice of the description after another.

    Slices are needed because the place of each error is found by counting all elements that stand before it. Sections
    are shown side by side, since the schema requires all; of a long section one part at a time.
    """
    parts = [_parts(section) for section in root]
    for i in range(max(map(len, parts), default=1)):
        yield [step for part in parts for step in part[min(i, len(part) - 1)]]


def _parts(element: Any) -> list[list[tuple[Any, list[Any]]]]:
    """What to show of an element, part by part."""
    if _weight(element) <= _SLICE:
        return [[]]
    parts: list[list[tuple[Any, list[Any]]]] = []
    group: list[Any] = []
    weight = 0
    for child in element:
        of_child = _weight(child)
        if group and weight + of_child > _SLICE:
            parts.append([(element, group)])
            group, weight = [], 0
        if of_child > _SLICE:
            parts += [[(element, [child]), *part] for part in _parts(child)]
        else:
            group.append(child)
            weight += of_child
    return [*parts, [(element, group)]] if group else parts


def _weight(element: Any) -> int:
    """Elements and attributes of it."""
    if not len(element):
        return 1 + len(element.attrib)
    return int(element.xpath("count(descendant-or-self::*) + count(descendant-or-self::*/@*)"))


def _owner(root: Any, path: str | None) -> str:
    """`variable 'x': ` for the place of an element of that variable."""
    match = re.match(r"(/fmiModelDescription/ModelVariables/[^/]+)", path or "")
    with suppress(etree.XPathError, IndexError):
        return f"variable {one_line(root.xpath(match[1])[0].get('name', ''), 80)!r}: " if match else ""
    return ""


# ------------------------------------------------------------------------------------------------------------- values


def _values(root: Any, about: Description, major: str) -> Iterator[Finding]:
    """Each variable by itself: limits, start, type, unit; and variables that share a place."""
    definitions = "TypeDefinitions/SimpleType" if major == "2" else "TypeDefinitions/*"
    known = {
        kind: _names(root.iterfind(where)) for kind, where in (("type", definitions), ("unit", "UnitDefinitions/Unit"))
    }
    for kind, lines in known.items():
        for name, (origin, *others) in lines.items():
            for again in others:
                yield Finding(
                    again,
                    f"{kind} {one_line(name, 80)!r} is already defined in line {origin}; the last definition is used",
                )
    for definition in root.iterfind(definitions):
        typed = definition[0] if major == "2" and len(definition) else definition
        for text in _of_nominal(typed):
            yield Finding(definition.sourceline, f"type {one_line(definition.get('name', ''), 80)!r}: {text}")
    settable: dict[tuple[str, int], str] = {}
    arrays: dict[str, list[Variable]] = {}
    for variable in about.variables.values():
        arrays.setdefault(variable.declared, []).append(variable)
    for element in root.iterfind("ModelVariables/*"):
        variables = arrays.get(element.get("name", ""))
        if not variables:  # an array without elements
            continue
        first, line = variables[0], element.sourceline
        what = f"variable {one_line(first.declared, 80)!r}"
        for text in _of_variable(element, variables, known, major):
            yield Finding(line, f"{what}: {text}")
        if major == "2" and first.causality in ("input", "parameter"):
            place = accessed_as(major, first.fmi_type), first.reference
            if place in settable:
                other = one_line(settable[place], 80)
                yield Finding(
                    line, f"{what}: it shares the value reference of {other!r}; both have the value that is set last"
                )
            settable.setdefault(place, first.declared)
    experiment = root.find("DefaultExperiment")
    if experiment is not None and experiment.get("stepSize") and about.default_step is None:
        yield Finding(experiment.sourceline, "DefaultExperiment: stepSize is not above 0; it is ignored")
    if experiment is not None and experiment.get("stopTime") and about.default_stop is None:
        yield Finding(experiment.sourceline, "DefaultExperiment: stopTime is not a time; it is ignored")


def _names(elements: Iterable[Any]) -> dict[str, list[int]]:
    lines: dict[str, list[int]] = {}
    for element in elements:
        lines.setdefault(element.get("name", ""), []).append(element.sourceline)
    return lines


def _of_nominal(element: Any) -> Iterator[str]:
    """Tell of a nominal value that is not a positive, finite number; the schema tells of text that is no number."""
    with suppress(ValueError):
        given = float(element.get("nominal", "1"))
        if not 0 < given < math.inf:
            yield f"nominal is {given:g}; {nominal_size(given):g} is used"


def _of_variable(
    element: Any, variables: list[Variable], known: dict[str, dict[str, list[int]]], major: str
) -> Iterator[str]:
    first = variables[0]
    low, high = first.limits
    if not low <= high:
        yield f"min is {low:g} and max is {high:g}"
    elif first.type in ("real", "integer"):
        outside = next((v for v in variables if v.start is not None and not low <= v.start <= high), None)
        if outside is not None:
            yield f"start is {outside.start:g}, outside of its range {low:g} to {high:g}"
    typed = element if major == "3" else element[0] if len(element) else element
    yield from _of_nominal(typed)
    if (declared := typed.get("declaredType")) is not None and declared not in known["type"]:
        yield f"type {one_line(declared, 80)!r} is not among the TypeDefinitions"
    if first.unit is not None and first.unit.name not in known["unit"]:
        yield f"unit {one_line(first.unit.name, 80)!r} is not among the UnitDefinitions"
    elif typed.get("unit") == "" and "" not in known["unit"]:
        yield "unit '' is not among the UnitDefinitions"
    variability = element.get("variability", "continuous" if major == "2" else first.variability)
    if variability == "continuous" and first.fmi_type not in _CONTINUOUS:
        kind = first.fmi_type
        yield (
            f"{'an' if kind[0] in 'AEIOU' else 'a'} {kind} is continuous, which only"
            f" {'Real' if major == '2' else 'Float32 and Float64'} may be"
        )
    needs = (
        first.causality in ("input", "parameter")
        or first.initial in ("exact", "approx")
        or first.variability == "constant"
    )
    if needs and first.start is None and first.fmi_type != "Clock" and element.find("Start") is None:
        yield f"{'an' if first.causality == 'input' else 'a'} {first.causality} has no start value"
    if first.start is not None and (first.initial == "calculated" or first.causality == "independent"):
        yield "it has a start value, although it is calculated or independent; the value is ignored"


# ---------------------------------------------------------------------------------------------------------- structure


def _structure(root: Any, about: Description, major: str) -> Iterator[Finding]:
    """The model structure: outputs that are not in it, that are none, that depend on themselves."""
    structure = root.find("ModelStructure")
    if structure is None:
        return
    where, key = ("Outputs/Unknown", "index") if major == "2" else ("Output", "valueReference")
    elements = [*structure.iterfind(where)]
    by_key: dict[str, Variable] = {}
    for position, variable in enumerate(about.variables.values(), start=1):
        by_key.setdefault(str(position if major == "2" else variable.reference), variable)
    listed: dict[str, int] = {}
    for element in elements:
        variable = by_key.get(_plain(element.get(key)))  # type: ignore[assignment]
        if variable is None:
            continue
        name = variable.declared
        if variable.causality != "output":
            yield Finding(
                element.sourceline,
                f"{one_line(name, 80)!r} is listed as an output in ModelStructure, but has another causality",
            )
        if name in listed:
            yield Finding(
                element.sourceline, f"{one_line(name, 80)!r} is listed twice among the outputs of ModelStructure"
            )
        listed.setdefault(name, element.sourceline)
    for name in dict.fromkeys(v.declared for v in about.outputs.values()):
        if name not in listed:
            text = f"output {one_line(name, 80)!r} is not in ModelStructure; it is taken to depend on all inputs"
            yield Finding(structure.sourceline, text)
    for cycle in _cycles(about):
        line = listed.get(cycle[0], structure.sourceline)
        path = " -> ".join(one_line(n, 40) for n in [*cycle[:5], *(["..."] if len(cycle) > 5 else []), cycle[0]])
        yield Finding(line, f"output {one_line(cycle[0], 80)!r} depends on itself: {path}")


def _plain(text: str | None) -> str:
    """A whole number, as it is written without signs around it."""
    return str(int(text)) if text else ""


def _cycles(about: Description) -> Iterator[list[str]]:
    """Outputs that depend on themselves, directly or through others: one cycle for each way back.

    A state may: its value is known. An array counts as one.
    """
    states = {v.declared for v in about.states}
    declared = {name: v.declared for name, v in about.outputs.items() if v.declared not in states}
    needed: dict[str, dict[str, None]] = {name: {} for name in declared.values()}
    looked_at: set[tuple[str, int]] = set()  # elements of an array share their dependencies
    for name, output in declared.items():
        known = about.dependencies.get(name, frozenset())
        if (output, id(known)) not in looked_at:
            looked_at.add((output, id(known)))
            needed[output].update(dict.fromkeys(declared[n] for n in known if n in declared))
    done: set[str] = set()
    for start in needed:
        path: list[str] = []
        on_path: dict[str, int] = {}
        ways: list[Iterator[str]] = [iter([start])]
        while ways:
            name = next(ways[-1], "")
            if not name:
                ways.pop()
                if path:
                    done.add(last := path.pop())
                    del on_path[last]
            elif name in on_path:
                yield path[on_path[name] :]
            elif name not in done:
                on_path[name] = len(path)
                path.append(name)
                ways.append(iter(sorted(needed[name])))
