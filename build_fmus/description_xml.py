"""`modelDescription.xml` for FMI 2.0 and FMI 3.0, and the FMI 3 terminals, from one component declaration."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from importlib import metadata
from typing import Any

from lxml import etree

from build_fmus import generate
from build_fmus.base import quantities, units
from build_fmus.compile import PLATFORMS, SOURCE_FLAGS
from build_fmus.component import DeclarationError, Model, Variable
from build_fmus.generate import Reference, is_exact, references

CLOCK = "sample.clock"  # name of the variable
TOOL = "suspension-fmus"  # also the key of our vendor annotation, which the master reads
LOG_CATEGORIES = {
    "logEvents": "events of the instance's life cycle",
    "logStatusWarning": "warnings",
    "logStatusDiscard": "calls that were discarded",
    "logStatusError": "errors, with the variable concerned and the reason",
    "logStatusFatal": "fatal errors",
}
_FMI2_TYPES = {"Float64": "Real", "Int32": "Integer", "Boolean": "Boolean"}


def model_description(
    component: Model, fmi: int, *, token: str, sources: Iterable[str], arrays: bool = False, clocks: bool = False
) -> bytes:
    """The model description as UTF-8 XML.

    Args:
        component: model of the FMU.
        fmi: 2 or 3.
        token: instantiation token (GUID in FMI 2.0) compiled into the binary.
        sources: C files below `sources/` (FMI 2.0 lists them here).
        arrays: real FMI 3 arrays instead of scalar elements.
        clocks: of FMI 3.0, a discrete component has a clock, and its inputs and outputs belong to it.

    Raises:
        DeclarationError: a variable has the name of the clock.
    """
    clocks = clocks and component.kind == "discrete"
    root = _fmi2(component, token, list(sources)) if fmi == 2 else _fmi3(component, token, arrays, clocks)
    return serialize(root)


def build_description(name: str, sources: Iterable[str]) -> bytes:
    """`sources/buildDescription.xml` of FMI 3.0.

    The first configuration is for any platform and C99 compiler. Those of platforms whose compilers are gcc and clang
    name options too, with which the code is as fast as the binaries; the numbers are the same (what decides on them is
    in the sources).
    """
    root = etree.Element("fmiBuildDescription", fmiVersion="3.0")
    names = list(sources)
    for platform in (None, *(p for p in PLATFORMS.values() if p.compiler)):
        configuration = etree.SubElement(root, "BuildConfiguration", modelIdentifier=name)
        files = etree.SubElement(configuration, "SourceFileSet", language="C99")
        if platform:
            configuration.set("platform", platform.name)
            files.set("compiler", platform.compiler)
            files.set("compilerOptions", " ".join(SOURCE_FLAGS))
        for source in names:
            etree.SubElement(files, "SourceFile", name=source)
    return serialize(root)


def terminals_and_icons(component: Model, *, arrays: bool = False) -> bytes:
    """`terminalsAndIcons/terminalsAndIcons.xml` of FMI 3.0: the icon, and inputs and outputs by what they belong to.

    `road.fl.height` is the variable `height` of the terminal `fl` in the terminal `road`
    (`quantities.place`). The rule is `bus`: what both sides have is connected, since a vehicle feels the slope
    of a road whose rate of height it does not need.
    """
    root = etree.Element("fmiTerminalsAndIcons", fmiVersion="3.0")
    graphics = etree.SubElement(root, "GraphicalRepresentation")
    box = {"x1": "-100", "y1": "-100", "x2": "100", "y2": "100"}
    etree.SubElement(graphics, "CoordinateSystem", **box, suggestedScalingFactorTo_mm="0.1")
    etree.SubElement(graphics, "Icon", **box)
    members: dict[tuple[str, ...], dict[str, str]] = {}  # by the names of the terminals around them
    for r in references(component, arrays=arrays):
        if r.variable.role == "input" or r.variable.output:
            path, name = quantities.place(r.name, array=bool(r.shape))
            for length in range(1, len(path) + 1):
                members.setdefault(path[:length], {})
            members[path].setdefault(name, r.name)
    if members:
        _terminals(etree.SubElement(root, "Terminals"), (), members)
    return serialize(root)


def _terminals(parent: etree._Element, around: tuple[str, ...], members: dict[tuple[str, ...], dict[str, str]]) -> None:
    """The terminals directly within those that are around, and what they hold."""
    for path in [p for p in members if p[:-1] == around]:
        text = f"inputs and outputs of {'.'.join(path)}"
        terminal = etree.SubElement(parent, "Terminal", name=path[-1], matchingRule="bus", description=text)
        for name, variable in members[path].items():
            etree.SubElement(
                terminal, "TerminalMemberVariable", variableName=variable, memberName=name, variableKind="signal"
            )
        _terminals(terminal, path, members)


def serialize(root: etree._Element) -> bytes:
    """A document as UTF-8 XML."""
    return etree.tostring(root, xml_declaration=True, encoding="UTF-8", pretty_print=True)


def text(x: float, kind: str = "Float64") -> str:
    """A value as XML has it."""
    if kind == "Int32":
        return str(int(x))
    if kind == "Boolean":
        return "true" if x else "false"
    return repr(float(x))


def _causality(v: Variable) -> str:
    if v.role in ("parameter", "input"):
        return v.role
    if v.role == "time":
        return "independent"
    return "output" if v.output else "local"


def _variability(component: Model, v: Variable) -> str:
    if v.role == "parameter":
        return "tunable" if v.tunable else "fixed"
    if v.type != "Float64" or (component.kind == "discrete" and v.role in ("output", "state")):
        return "discrete"
    return "continuous"


def _initial(v: Variable) -> str | None:
    if v.role in ("time", "input"):
        return None
    return "exact" if is_exact(v) else "calculated"


def _root(component: Model, version: str, **identity: str) -> etree._Element:
    return root_element(component.name, component.description, version, **identity)


def root_element(name: str, description: str, version: str, **identity: str) -> etree._Element:
    """`fmiModelDescription` of an FMU that this software has made.

    `identity` is its token under the name that the version gives it.
    """
    return etree.Element(
        "fmiModelDescription",
        fmiVersion=version,
        modelName=name,
        **identity,
        description=description,
        version=metadata.version(TOOL),
        license="BSD-3-Clause",
        generationTool=f"{TOOL} {metadata.version(TOOL)}",
        variableNamingConvention="structured",
    )


def _common(root: etree._Element, component: Model) -> None:
    """Units, log categories and default experiment: the same elements in both versions."""
    used = dict.fromkeys(v.unit for v in component.variables if v.unit)
    step = component.sample_time if component.kind == "discrete" else component.exchange_step
    add_common(root, map(units.unit, used), component.stop_time, step)


def add_common(root: etree._Element, used: Iterable[units.Unit], stop_time: float, step: float | None) -> None:
    """Unit definitions, log categories and default experiment below `root`."""
    definitions = etree.SubElement(root, "UnitDefinitions")
    for u in used:
        element = etree.SubElement(definitions, "Unit", name=u.name)
        if u.exponents is not None:
            powers = {k: str(n) for k, n in u.powers.items()}
            more = {
                k: repr(x) for k, x, default in (("factor", u.factor, 1.0), ("offset", u.offset, 0.0)) if x != default
            }
            etree.SubElement(element, "BaseUnit", **powers, **more)
        for d in u.display:
            etree.SubElement(element, "DisplayUnit", name=d.name, factor=repr(d.factor))
    categories = etree.SubElement(root, "LogCategories")
    for name, description in LOG_CATEGORIES.items():
        etree.SubElement(categories, "Category", name=name, description=description)
    etree.SubElement(root, "DefaultExperiment", startTime="0.0", stopTime=repr(stop_time), stepSize=repr(step))


def annotate(
    root: etree._Element,
    fmi: int,
    attributes: Mapping[str, str],
    inputs: Mapping[str, dict[str, str]],
    outputs: Mapping[str, float],
    sources: Mapping[str, str],
) -> None:
    """Annotation with what FMI has no place for, by names of variables.

    `attributes`: kind, sample time; attributes of `inputs` (`input_annotation`); constants of `outputs` that a source
    and its target must agree on; `sources` of values. Beside each variable a source would stand once per element of an
    array.
    """
    holder = etree.SubElement(root, "VendorAnnotations" if fmi == 2 else "Annotations")
    tool = etree.SubElement(holder, *(("Tool", {"name": TOOL}) if fmi == 2 else ("Annotation", {"type": TOOL})))
    element = etree.SubElement(tool, "Component", dict(attributes))
    for name, told in inputs.items():
        etree.SubElement(element, "Input", name=name, **told)
    for name, constant in outputs.items():
        etree.SubElement(element, "Output", name=name, constant=repr(constant))
    for name, source in sources.items():
        etree.SubElement(element, "Variable", name=name, source=source)


def input_annotation(v: Any) -> dict[str, str]:
    """Attributes of an input in the annotation: the constant that its source must have, or that it may stay open."""
    if v.must_equal is not None:
        return {"mustEqual": repr(v.must_equal), "tolerance": repr(v.tolerance)}
    return {"optional": "true"} if v.optional else {}


def _annotate(root: etree._Element, fmi: int, component: Model) -> None:
    sampled = {} if component.sample_time is None else {"sampleTime": repr(component.sample_time)}
    inputs = {v.name: told for v in component.variables if (told := input_annotation(v))}
    sources = {v.name: v.source for v in component.variables if v.source}
    annotate(root, fmi, {"kind": component.kind, **sampled}, inputs, component.constant_outputs, sources)


def _attributes(component: Model, r: Reference, value_reference: int) -> dict[str, str]:
    """Those of a variable that both versions have, in the order of the elements."""
    v = r.variable
    attributes = {"name": r.name, "valueReference": str(value_reference), "description": v.description}
    attributes |= {"causality": _causality(v), "variability": _variability(component, v)}
    initial = _initial(v)
    return attributes | ({"initial": initial} if initial else {})


def _value_attributes(r: Reference) -> dict[str, str]:
    v, out = r.variable, {}
    if v.unit and v.type == "Float64":
        out["unit"] = v.unit
        if v.display_unit:
            out["displayUnit"] = v.display_unit
    for key in ("min", "max", "nominal"):
        x = getattr(v, key)
        if x is not None and v.type != "Boolean" and not (key == "nominal" and v.type != "Float64"):
            out[key] = text(x, v.type)
    if r.start is not None:
        out["start"] = " ".join(text(x, v.type) for x in r.start)
    return out


# ---------------------------------------------------------------------- FMI 2.0


def _fmi2(component: Model, token: str, sources: list[str]) -> etree._Element:
    root = _root(component, "2.0", guid=token)
    root.set("numberOfEventIndicators", "0")
    continuous = component.kind == "continuous"
    common = {
        "modelIdentifier": component.name,
        "canNotUseMemoryManagementFunctions": "true",
        "canGetAndSetFMUstate": "true",
        "canSerializeFMUstate": "true",
        "providesDirectionalDerivative": text(continuous, "Boolean"),
    }
    interfaces = []
    if continuous:
        interfaces.append(etree.SubElement(root, "ModelExchange", **common, completedIntegratorStepNotNeeded="true"))
    interfaces.append(etree.SubElement(root, "CoSimulation", **common, canHandleVariableCommunicationStepSize="true"))
    for interface in interfaces:
        files = etree.SubElement(interface, "SourceFiles")
        for name in sources:
            etree.SubElement(files, "File", name=name)
    _common(root, component)
    _annotate(root, 2, component)

    refs = references(component, arrays=False)
    index = {r.name: i + 1 for i, r in enumerate(refs)}
    variables = etree.SubElement(root, "ModelVariables")
    for vr, r in enumerate(refs):
        v = r.variable
        attributes = _attributes(component, r, vr)
        scalar = etree.SubElement(variables, "ScalarVariable", **attributes)
        values = _value_attributes(r)
        if v.role == "derivative":
            values["derivative"] = str(index[r.name[4:-1]])
        etree.SubElement(scalar, _FMI2_TYPES[v.type], **values)

    structure = etree.SubElement(root, "ModelStructure")
    dependencies, initial_dependencies = component.dependencies, component.initial_dependencies

    def unknowns(tag: str, names: list[str], known: dict[str, list[str]]) -> None:
        if not names:
            return
        group = etree.SubElement(structure, tag)
        for name in names:
            on = " ".join(str(i) for i in sorted(index[d] for d in known[name]))
            etree.SubElement(group, "Unknown", index=str(index[name]), dependencies=on)

    outputs = [r.name for r in refs if r.variable.output]
    derivatives = [r.name for r in refs if r.variable.role == "derivative"]
    unknowns("Outputs", outputs, dependencies)
    unknowns("Derivatives", derivatives, dependencies)
    unknowns("InitialUnknowns", _initial_unknowns(component, refs), initial_dependencies)
    return root


def _initial_unknowns(component: Model, refs: list[Reference]) -> list[str]:
    roles = ("state", "derivative") if component.kind == "continuous" else ()
    return [r.name for r in refs if (r.variable.output or r.variable.role in roles) and not is_exact(r.variable)]


# ---------------------------------------------------------------------- FMI 3.0


def _fmi3(component: Model, token: str, arrays: bool, clocks: bool) -> etree._Element:
    root = _root(component, "3.0", instantiationToken=token)
    continuous = component.kind == "continuous"
    common = {
        "modelIdentifier": component.name,
        "canGetAndSetFMUState": "true",
        "canSerializeFMUState": "true",
        "providesDirectionalDerivatives": text(continuous, "Boolean"),
        "providesAdjointDerivatives": text(continuous, "Boolean"),
    }
    if continuous:
        etree.SubElement(root, "ModelExchange", **common)
    has_events = {"canHandleVariableCommunicationStepSize": "true", "hasEventMode": text(clocks, "Boolean")}
    etree.SubElement(root, "CoSimulation", **common, **has_events)
    _common(root, component)

    refs = references(component, arrays=arrays)
    value_reference = {r.name: i for i, r in enumerate(refs)}
    owner = {n: i for i, r in enumerate(refs) for n in r.element_names}  # scalar element -> value reference
    variables = etree.SubElement(root, "ModelVariables")
    for vr, r in enumerate(refs):
        v = r.variable
        attributes = _attributes(component, r, vr) | _value_attributes(r)
        if v.role == "derivative":
            attributes["derivative"] = str(value_reference[r.name[4:-1]])
        if clocks and v.role in ("input", "state", "output"):
            attributes |= {"variability": "discrete", "clocks": str(len(refs))}
        element = etree.SubElement(variables, v.type, **attributes)
        for n in r.shape:
            etree.SubElement(element, "Dimension", start=str(n))

    if clocks:
        _clock(variables, component, len(refs))

    structure = etree.SubElement(root, "ModelStructure")
    dependencies, initial_dependencies = component.dependencies, component.initial_dependencies

    def unknown(tag: str, r: Reference, known: dict[str, list[str]]) -> None:
        on = sorted({owner[d] for n in r.element_names for d in known[n]})
        etree.SubElement(
            structure, tag, valueReference=str(value_reference[r.name]), dependencies=" ".join(map(str, on))
        )

    # what belongs to a clock begins at its first tick
    initial_names = set() if clocks else set(_initial_unknowns(component, refs))
    for r in refs:
        if r.variable.output:
            unknown("Output", r, dependencies)
    for r in refs:
        if r.variable.role == "derivative":
            unknown("ContinuousStateDerivative", r, dependencies)
    for r in refs:
        if r.name in initial_names:
            unknown("InitialUnknown", r, initial_dependencies)
    _annotate(root, 3, component)
    return root


def _clock(variables: etree._Element, component: Model, reference: int) -> None:
    """The clock at whose ticks a discrete component is sampled."""
    if any(v.get("name") == CLOCK for v in variables):
        raise DeclarationError(
            f"{component.name}: the variable name {CLOCK!r} is reserved for the clock; rename the variable, or build"
            " without clocks"
        )
    every = generate.ticks(component)
    etree.SubElement(
        variables,
        "Clock",
        name=CLOCK,
        valueReference=str(reference),
        description="ticks at each sample",
        causality="input",
        intervalVariability="constant",
        intervalDecimal=repr(component.sample_time),
        supportsFraction="true",
        resolution=str(every.denominator),
        intervalCounter=str(every.numerator),
    )


def variable_rows(component: Model) -> list[dict[str, str]]:
    """One row per declared variable for documentation pages: name, role, shape, unit, range, start, description, ..."""
    rows = []
    for v in component.variables:
        low, high = ("-∞" if v.min is None else f"{v.min:g}"), ("∞" if v.max is None else f"{v.max:g}")
        start = "calculated" if v.start is None else ""
        if v.start is not None:
            start = ", ".join(f"{x:.6g}" for x in v.start[:4]) + (" …" if len(v.start) > 4 else "")
        role = v.role + (", output" if v.output and v.role != "output" else "")
        rows.append(
            {
                "name": v.name,
                "role": role,
                "shape": "×".join(map(str, v.shape)),
                "unit": v.unit or "",
                "range": (
                    f"{v.must_equal:.6g}, or 0"
                    if v.must_equal is not None
                    else ""
                    if v.min is None and v.max is None
                    else f"[{low}, {high}]"
                ),
                "start": "" if v.role in ("time", "output", "derivative") else start,
                "description": v.description,
                "source": v.source,
            }
        )
    return rows
