"""The standard's schemas: what they find in a file."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from lxml import etree

from build_fmus.base.checks import one_line
from cosim.fmu.xml import schema as xml_schema

_FILES = {
    "SystemStructureDescription": "SystemStructureDescription",
    "ParameterSet": "SystemStructureParameterValues",
    "ParameterMapping": "SystemStructureParameterMapping",
    "SignalDictionary": "SystemStructureSignalDictionary",
}
_HERE = Path(__file__).parent / "third_party"


def deviation(root: Any) -> str:
    """The first violation of the schema of the file's own version, with its line; "" if the file is valid."""
    name = etree.QName(root).localname
    if name not in _FILES:
        return f"its element is {one_line(name, 60)}; one of {', '.join(_FILES)} is expected"
    major = "1" if str(root.get("version", "")).startswith("1") else "2"
    schema = xml_schema(_HERE / f"ssp{major}" / f"{_FILES[name]}.xsd")
    if schema.validate(root):
        return ""
    error = schema.error_log[0]
    return f"line {error.line}: {one_line(error.message)}"
