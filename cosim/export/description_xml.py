"""modelDescription.xml of a system's FMU, FMI 2.0 and 3.0."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from fractions import Fraction
from typing import Any

from lxml import etree

from build_fmus import description_xml as base
from build_fmus.base import escape
from cosim.export.variables import Exported, feedthrough, units_of
from cosim.system.schedule import Schedule

_FMI2_TYPES = {"Float64": "Real", "Int32": "Integer", "Boolean": "Boolean", "String": "String"}


@dataclass(frozen=True)
class Facts:
    """What the description says beside the variables."""

    name: str
    text: str
    kind: str
    step: Fraction  # what tools are proposed [s]
    stop_time: float
    can_save: bool
    can_serialize: bool
    only_once: bool
    needs_tool: bool


def model_description(
    fmi: int, facts: Facts, schedule: Schedule, variables: Sequence[Exported], *, token: str, sources: Sequence[str]
) -> bytes:
    """The description as UTF-8 XML. Value references count from 0, time, in the order of `variables`."""
    identity = {"guid" if fmi == 2 else "instantiationToken": token}
    root = base.root_element(facts.name, escape.xml(facts.text), f"{fmi}.0", **identity)
    state = "FMUstate" if fmi == 2 else "FMUState"
    flags: dict[str, str | bool] = {
        "modelIdentifier": facts.name,
        f"canGetAndSet{state}": facts.can_save,
        f"canSerialize{state}": facts.can_serialize,
        "canHandleVariableCommunicationStepSize": True,
        "canBeInstantiatedOnlyOncePerProcess": facts.only_once,
        "needsExecutionTool": facts.needs_tool,
    }
    if fmi == 2:
        root.set("numberOfEventIndicators", "0")
        flags["canNotUseMemoryManagementFunctions"] = True
    simulation = etree.SubElement(
        root, "CoSimulation", **{k: v if isinstance(v, str) else _flag(v) for k, v in flags.items()}
    )
    if fmi == 2:
        files = etree.SubElement(simulation, "SourceFiles")
        for name in sources:
            etree.SubElement(files, "File", name=name)
    else:
        simulation.set("hasEventMode", "false")
        simulation.set("fixedInternalStepSize", repr(float(schedule.tick)))
    base.add_common(root, units_of(variables), facts.stop_time, float(facts.step))
    if fmi == 2:
        _annotate(root, fmi, facts, schedule, variables)
    listed = etree.SubElement(root, "ModelVariables")
    _time(listed, fmi)
    for i, e in enumerate(variables, start=1):
        _variable(listed, fmi, i, e)
    _structure(etree.SubElement(root, "ModelStructure"), fmi, facts, schedule, variables)
    if fmi == 3:
        _annotate(root, fmi, facts, schedule, variables)
    return base.serialize(root)


def _flag(value: bool) -> str:
    return base.text(value, "Boolean")


def _time(listed: etree._Element, fmi: int) -> None:
    common = {
        "name": "time",
        "valueReference": "0",
        "description": "simulation time",
        "causality": "independent",
        "variability": "continuous",
    }
    if fmi == 2:
        etree.SubElement(etree.SubElement(listed, "ScalarVariable", **common), "Real", unit="s")
    else:
        etree.SubElement(listed, "Float64", **common, unit="s")


def _variable(listed: etree._Element, fmi: int, reference: int, e: Exported) -> None:
    v = e.variable
    variability = (
        ("tunable" if e.tunable else "fixed")
        if e.causality == "parameter"
        else (
            "continuous"
            if e.type == "Float64"
            and v.variability == "continuous"
            and not (e.causality == "output" and e.component.discrete)
            else "discrete"
        )
    )
    common = {
        "name": e.name,
        "valueReference": str(reference),
        "description": e.description,
        "causality": e.causality,
        "variability": variability,
    }
    if e.causality != "input":
        common["initial"] = "exact" if e.causality == "parameter" else "calculated"
    values: dict[str, Any] = {}
    if e.type == "Float64" and v.unit is not None:
        values["unit"] = v.unit.name
        if v.relative:
            values["relativeQuantity"] = "true"
    if e.type not in ("Boolean", "String"):
        for key, limit in (("min", v.minimum), ("max", v.maximum)):
            if limit is not None:
                values[key] = base.text(limit, e.type)
    if e.causality != "output":
        values["start"] = e.start if e.type == "String" else base.text(e.start, e.type)
    if fmi == 2:
        scalar = etree.SubElement(listed, "ScalarVariable", **common)
        etree.SubElement(scalar, _FMI2_TYPES[e.type], **values)
    elif e.type == "String":
        etree.SubElement(etree.SubElement(listed, "String", **common), "Start", value=values["start"])
    else:
        etree.SubElement(listed, e.type, **common, **values)


def _structure(
    structure: etree._Element, fmi: int, facts: Facts, schedule: Schedule, variables: Sequence[Exported]
) -> None:
    """Outputs, with the inputs that act on them within a step.

    Only outputs of sampled systems have such inputs; outputs of others show the values that the last step has reached.
    """
    place = {e.name: i for i, e in enumerate(variables, start=1)}  # in FMI 2.0 counted from 1, and time is the first
    through = feedthrough(schedule, variables) if facts.kind == "discrete" else {}
    outputs = [e.name for e in variables if e.causality == "output"]
    if not outputs:
        return
    first = etree.SubElement(structure, "Outputs") if fmi == 2 else structure
    second = etree.SubElement(structure, "InitialUnknowns") if fmi == 2 else structure
    shift = 1 if fmi == 2 else 0
    key = "index" if fmi == 2 else "valueReference"
    for name in outputs:
        on = " ".join(str(place[n] + shift) for n in sorted(through.get(name, ()), key=place.__getitem__))
        etree.SubElement(
            first, "Unknown" if fmi == 2 else "Output", **{key: str(place[name] + shift), "dependencies": on}
        )
    for name in outputs:
        etree.SubElement(second, "Unknown" if fmi == 2 else "InitialUnknown", **{key: str(place[name] + shift)})


def _annotate(root: etree._Element, fmi: int, facts: Facts, schedule: Schedule, variables: Sequence[Exported]) -> None:
    """Kind and tick of the system, constants that a source and its target must agree on, and sources."""
    sampled = {"sampleTime": repr(float(schedule.tick))} if facts.kind == "discrete" else {}
    known = [(e.name, e.causality, e.variable) for e in variables]
    base.annotate(
        root,
        fmi,
        {"kind": facts.kind, "tick": str(schedule.tick), **sampled},
        {n: told for n, c, v in known if c == "input" and (told := base.input_annotation(v))},
        {n: v.constant for n, c, v in known if c == "output" and v.constant is not None},
        {n: v.source for n, c, v in known if c == "parameter" and v.source},
    )
