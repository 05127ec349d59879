"""`calculating.c` as FMUs of FMI 2.0 and 3.0, with calculated parameters."""

from __future__ import annotations

from pathlib import Path

from foreign import making

_NUMBERS = (  # name, type of FMI 3.0, value reference, causality, start, further attributes
    ("p", "Float64", 0, "parameter", "1", 'unit="kg" max="100"'),
    ("factor", "Float64", 1, "parameter", "2", ""),
    ("scaled", "Float64", 2, "calculatedParameter", "", 'unit="g"'),
    ("n", "Int32", 3, "parameter", "3", ""),
    ("next", "Int32", 4, "calculatedParameter", "", ""),
    ("y", "Float64", 5, "output", "", ""),
    ("name", "String", 8, "parameter", "", ""),
    ("greeting", "String", 9, "calculatedParameter", "", ""),
    ("seen", "Float64", 12, "output", "", ""),
)
_MORE = (
    ("q", "Float64", 6, "parameter", "0 0", ""),
    ("sums", "Float64", 7, "calculatedParameter", "", ""),
    ("key", "Binary", 10, "parameter", "", 'mimeType="application/x-key"'),
    ("lock", "Binary", 11, "calculatedParameter", "", 'mimeType="application/x-key"'),
    ("large", "Int64", 13, "parameter", "0", ""),
    ("larger", "Int64", 14, "calculatedParameter", "", ""),
    ("mode", "Enumeration", 15, "parameter", "1", 'declaredType="Mode"'),
)
_OLD = {"Float64": "Real", "Int32": "Integer", "String": "String"}
_MODES = '<EnumerationType name="Mode"><Item name="off" value="1"/><Item name="on" value="2"/></EnumerationType>'


def _variable(version: int, name: str, kind: str, reference: int, causality: str, start: str, more: str) -> str:
    variability = "continuous" if causality == "output" else "fixed"
    common = f'name="{name}" valueReference="{reference}" causality="{causality}" variability="{variability}"'
    begin = f'start="{start}"' if start else ""
    if version == 2 and (kind, causality) == ("String", "parameter"):
        begin = 'start=""'
    if version == 2:
        return f"<ScalarVariable {common}><{_OLD[kind]} {begin} {more}/></ScalarVariable>"
    size = '<Dimension start="2"/>' if name in ("q", "sums") else ""
    inside = size + ('<Start value=""/>' if kind in ("String", "Binary") and causality == "parameter" else "")
    return f"<{kind} {common} {begin} {more}>{inside}</{kind}>"


def build(folder: Path, version: int) -> Path:
    """The FMU, made once."""
    path = folder / f"calculating{version}.fmu"
    if path.is_file():
        return path
    variables = [*_NUMBERS, *(_MORE if version == 3 else ())]
    listed = "".join(_variable(version, *v) for v in variables)
    if version == 2:
        save, head = "canGetAndSetFMUstate", 'fmiVersion="2.0" guid="calculating"'
        outputs, unknowns = ("".join(f'<Unknown index="{i}"/>' for i in of) for of in ((6, 9), (3, 5, 6, 8, 9)))
        structure = f"<Outputs>{outputs}</Outputs><InitialUnknowns>{unknowns}</InitialUnknowns>"
    else:
        save, head = "canGetAndSetFMUState", 'fmiVersion="3.0" instantiationToken="calculating"'
        outputs = "".join(f'<Output valueReference="{i}" dependencies=""/>' for i in (5, 12))
        calculated = (2, 4, 5, 7, 9, 11, 12, 14)
        structure = outputs + "".join(f'<InitialUnknown valueReference="{i}"/>' for i in calculated)
    units = '<Unit name="kg"><BaseUnit kg="1"/></Unit><Unit name="g"><BaseUnit kg="1" factor="0.001"/></Unit>'
    text = (
        f'<?xml version="1.0" encoding="UTF-8"?><fmiModelDescription {head} modelName="calculating">'
        f'<CoSimulation modelIdentifier="calculating" canHandleVariableCommunicationStepSize="true" {save}="true"/>'
        f"<UnitDefinitions>{units}</UnitDefinitions>{f'<TypeDefinitions>{_MODES}</TypeDefinitions>' * (version == 3)}"
        f"<ModelVariables>{listed}</ModelVariables>"
        f"<ModelStructure>{structure}</ModelStructure></fmiModelDescription>"
    )
    source = making.HERE / "calculating.c"
    others = making.others(folder, f"calculating{version}", version)
    library = making.compile_library(folder, f"calculating{version}", version, [source, others])
    return making.pack(path, making.contents(version, "calculating", text, library))
