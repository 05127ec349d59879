"""Parameter sets: values of one component in a file of their own, and the items of enumerations."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from lxml import etree

from build_fmus.base import escape
from cosim.core.description import TEXTS, Variable
from cosim.core.errors import SspError
from cosim.fmu.file import FmuFile
from cosim.ssp import names
from cosim.ssp.names import SSV
from cosim.ssp.schema import deviation
from cosim.system.components import indices

SET = "initialValues"
"""Name of every parameter set: some readers apply those of one name in all components."""


def parameter_set(name: str, values: Mapping[str, Any], fmu: FmuFile, version: str) -> etree._Element:
    """The parameter set of the component `name`.

    In SSP 2.0 all elements of an array of the FMU are one parameter, row-major.
    """
    root = etree.Element(
        f"{SSV}ParameterSet", nsmap={p: names.PREFIXES[p] for p in ("ssv", "ssc")}, version=version, name=SET
    )
    parameters = etree.SubElement(root, f"{SSV}Parameters")
    variables, arrays = fmu.description.variables, fmu.description.arrays
    done: set[str] = set()
    for key in values:
        v = variables[key]
        whole = v.size > 1 and fmu.major == "3"
        if whole and v.declared in done:
            continue
        done.add(v.declared)
        listed = [variables[n] for n in sorted(arrays[v.declared], key=indices)] if whole else [v]
        texts = [_text(e, values.get(e.name, e.start)) for e in listed]
        if None in texts:
            raise SspError(
                f"'{name}': set all of {v.declared}; the FMU has no start value for {listed[texts.index(None)].name}"
            )
        if any(escape.NO_XML.search(t or "") for t in texts):
            raise SspError(
                f"'{name}': the value of {v.name} has a character that XML cannot hold: set it in the tool that runs"
                " the SSP"
            )
        parameter = etree.SubElement(parameters, f"{SSV}Parameter", name=v.declared if whole else v.name)
        typed = etree.SubElement(parameter, f"{SSV}{_type(v, version)}")
        if v.mime_type:
            typed.set("mime-type", v.mime_type)
        if v.fmi_type == "Enumeration":
            _enumerated(typed, v, fmu, [int(t or 0) for t in texts])
        elif v.fmi_type in TEXTS and whole:
            for text in texts:
                etree.SubElement(typed, f"{SSV}Value", value=text or "")
        else:
            typed.set("value", " ".join(t or "" for t in texts))
        if whole:
            for n in (max(indices(e.name)[k] for e in listed) for k in range(len(indices(v.name)))):
                etree.SubElement(parameter, f"{names.SSC}Dimension", size=str(n))
    wrong = deviation(etree.fromstring(etree.tostring(root)))
    if wrong:
        raise SspError(f"the values of '{name}' cannot be written in SSP {version}: {wrong}")
    return root


def _type(v: Variable, version: str) -> str:
    if version == "2.0" or v.fmi_type in ("Real", "Integer", "Boolean", "String", "Enumeration"):
        return v.fmi_type
    return {"real": "Real", "integer": "Integer", "boolean": "Boolean"}.get(v.type, "String")


def _text(v: Variable, value: Any) -> str | None:
    if value is None:
        return None
    if v.fmi_type == "Binary":
        return bytes(value).hex() if isinstance(value, bytes | bytearray) else str(value)
    if v.type == "boolean":
        return "true" if value else "false"
    return repr(float(value)) if v.type == "real" else str(value)


def _enumerated(typed: etree._Element, v: Variable, fmu: FmuFile, values: list[int]) -> None:
    """Enumerations are written by the names of their items."""
    by_value = {n: item for item, n in items_of(fmu, v)[1].items()}
    missing = [n for n in values if n not in by_value]
    if missing:
        raise SspError(
            f"{fmu.path}: '{v.name}' is {missing[0]}, which is not an item of its enumeration:"
            f" {', '.join(by_value.values())}"
        )
    if len(values) == 1:
        typed.set("value", by_value[values[0]])
    else:
        for n in values:
            etree.SubElement(typed, f"{SSV}Value", value=by_value[n])


def items_of(fmu: FmuFile, v: Variable) -> tuple[str, dict[str, int]]:
    """Name and items of the enumeration that is a variable's type. Raises SspError where the FMU does not define it."""
    found = fmu.enumeration(v.declared)
    if found is None:
        raise SspError(f"{fmu.path}: the enumeration of '{v.declared}' is not defined")
    return found
