"""SSP files of somebody else's making, put together by hand."""

from __future__ import annotations

import zipfile
from pathlib import Path

NAMESPACES = " ".join(
    f'xmlns:{p}="http://ssp-standard.org/SSP1/SystemStructure{n}"'
    for p, n in {
        "ssd": "Description",
        "ssc": "Common",
        "ssv": "ParameterValues",
        "ssm": "ParameterMapping",
        "ssb": "SignalDictionary",
    }.items()
)
OSP = 'xmlns:osp="http://opensimulationplatform.com/SSP/OSPAnnotations"'
UNITS = (
    '<ssc:Unit name="rad"><ssc:BaseUnit rad="1"/></ssc:Unit><ssc:Unit name="deg"><ssc:BaseUnit rad="1"'
    ' factor="0.017453292519943295"/></ssc:Unit><ssc:Unit name="kg"><ssc:BaseUnit kg="1"/></ssc:Unit>'
)
STEP = (
    f'<ssd:Annotations><ssc:Annotation type="com.opensimulationplatform"><osp:StepSizeHint {OSP}'
    ' value="0.002"/></ssc:Annotation></ssd:Annotations>'
)


def connectors(*given: str) -> str:
    """`u:input:Real:deg` as a connector; type and unit may be left out, and `T[3]` is an array."""
    made = []
    for text in given:
        name, kind, type_, unit = (*text.split(":"), "", "")[:4]
        type_, _, size = type_.rstrip("]").partition("[")
        more = f' unit="{unit}"' if unit and type_ != "Enumeration" else f' name="{unit}"' if unit else ""
        inner = (f"<ssc:{type_}{more}/>" if type_ else "") + (f'<ssc:Dimension size="{size}"/>' if size else "")
        made.append(f'<ssd:Connector name="{name}" kind="{kind}">{inner}</ssd:Connector>')
    return f"<ssd:Connectors>{''.join(made)}</ssd:Connectors>" if made else ""


def component(name: str, source: str, *given: str, bindings: str = "", step: str = STEP, more: str = "") -> str:
    bound = f"<ssd:ParameterBindings>{bindings}</ssd:ParameterBindings>" if bindings else ""
    return f'<ssd:Component name="{name}" source="{source}" {more}>{connectors(*given)}{bound}{step}</ssd:Component>'


def connection(start: str, end: str, inner: str = "", more: str = "") -> str:
    ends = []
    for which, text in (("start", start), ("end", end)):
        element, dot, name = text.rpartition(".")
        ends.append((f'{which}Element="{element}" ' if dot else "") + f'{which}Connector="{name}"')
    return f"<ssd:Connection {' '.join(ends)} {more}>{inner}</ssd:Connection>"


def system(
    name: str,
    elements: str,
    connections: str = "",
    *given: str,
    bindings: str = "",
    dictionaries: str = "",
    more: str = "",
) -> str:
    bound = f"<ssd:ParameterBindings>{bindings}</ssd:ParameterBindings>" if bindings else ""
    wires = f"<ssd:Connections>{connections}</ssd:Connections>" if connections else ""
    books = f"<ssd:SignalDictionaries>{dictionaries}</ssd:SignalDictionaries>" if dictionaries else ""
    return (
        f'<ssd:System name="{name}"'
        f" {more}>{connectors(*given)}{bound}<ssd:Elements>{elements}</ssd:Elements>{wires}{books}</ssd:System>"
    )


def structure(top: str, after: str = "", version: str = "1.0", name: str = "Foreign", enumerations: str = "") -> str:
    listed = f"<ssd:Enumerations>{enumerations}</ssd:Enumerations>" if enumerations else ""
    return (
        f'<?xml version="1.0" encoding="UTF-8"?><ssd:SystemStructureDescription {NAMESPACES} version="{version}"'
        f' name="{name}">{top}{listed}<ssd:Units>{UNITS}</ssd:Units>{after}</ssd:SystemStructureDescription>'
    )


def values(version: str = "1.0", **given: str) -> str:
    """A parameter set: `rate="Real 3"`, `u="Real 90 deg"`."""
    made = []
    for name, text in given.items():
        type_, _, rest = text.partition(" ")
        value, _, unit = rest.partition("@")
        made.append(
            f'<ssv:Parameter name="{name.replace("__", ".")}"><ssv:{type_}'
            f' value="{value}"{f" unit={chr(34)}{unit}{chr(34)}" if unit else ""}/></ssv:Parameter>'
        )
    units = f"<ssv:Units>{UNITS}</ssv:Units>"
    return (
        f'<ssv:ParameterSet {NAMESPACES} version="{version}"'
        f' name="set"><ssv:Parameters>{"".join(made)}</ssv:Parameters>{units}</ssv:ParameterSet>'
    )


def inline(set_: str, mapping: str = "", more: str = "") -> str:
    return (
        "<ssd:ParameterBinding"
        f" {more}><ssd:ParameterValues>{set_}</ssd:ParameterValues>{mapping}</ssd:ParameterBinding>"
    )


def mapping(*entries: str) -> str:
    inner = "".join(entries)
    return (
        f"<ssd:ParameterMapping><ssm:ParameterMapping {NAMESPACES}"
        f' version="1.0">{inner}</ssm:ParameterMapping></ssd:ParameterMapping>'
    )


def package(path: Path, files: dict[str, str | bytes | Path]) -> Path:
    """An SSP of these files; a text alone is SystemStructure.ssd's."""
    path.parent.mkdir(parents=True, exist_ok=True)
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, content in files.items():
            archive.writestr(name, content.read_bytes() if isinstance(content, Path) else content)
    return path
