"""`follower.c` as FMUs of FMI 2.0 and 3.0: archives as somebody else would make them."""

from __future__ import annotations

import re
from pathlib import Path

from cosim.fmu.calls import platform_folder

from . import making

SMALL = ("Float32", "Int8", "UInt8", "Int16", "UInt16", "UInt32", "Int64", "UInt64")
SAVING = {2: ("canGetAndSetFMUstate", "canSerializeFMUstate"), 3: ("canGetAndSetFMUState", "canSerializeFMUState")}
TYPED = tuple(name.lower() for name in SMALL)


def _variables() -> list[tuple[str, str, int, str, str]]:
    """(name, FMI 3.0 type, value reference, causality, further attributes)."""
    real = [
        ("time", "Float64", 100, "independent", ""),
        ("u", "Float64", 0, "input", 'start="0" unit="deg"'),
        ("y", "Float64", 1, "output", 'unit="rad"'),
        ("rate", "Float64", 2, "parameter", 'start="1" variability="tunable"'),
        ("count_in", "Int32", 3, "input", 'start="0"'),
        ("count", "Int32", 4, "output", ""),
        ("on", "Boolean", 5, "input", 'start="false"'),
        ("off", "Boolean", 6, "output", ""),
        ("w", "Float64", 7, "input", 'start="0 0 0" unit="degC"'),
        ("total", "Float64", 8, "output", 'unit="K"'),
    ]
    small = [
        (f"{t.lower()}{end}", t, 9 + 2 * i + k, causality, 'start="0"' if causality == "input" else "")
        for i, t in enumerate(SMALL)
        for k, (end, causality) in enumerate((("_in", "input"), ("_out", "output")))
    ]
    return real + small


def description(version: int, name: str) -> str:
    """modelDescription.xml."""
    three, elements, outputs = version == 3, [], []
    for variable, kind, reference, causality, more in _variables():
        old = {"Float64": "Real", "Int32": "Integer", "Boolean": "Boolean"}.get(kind)
        size = '<Dimension start="3"/>' if variable in ("w", "total") else ""
        if not three and (old is None or size or causality == "independent"):
            continue
        variability = (
            ""
            if "variability" in more
            else ' variability="continuous"'
            if kind.startswith("Float")
            else ' variability="discrete"'
        )
        tunable = ' variability="tunable"' if "tunable" in more else variability
        rest = more.replace(' variability="tunable"', "")
        common = f'name="{variable}" valueReference="{reference}" causality="{causality}"{tunable}'
        elements.append(
            f"<{kind} {common} {rest}>{size}</{kind}>"
            if three
            else f"<ScalarVariable {common}><{old} {rest}/></ScalarVariable>"
        )
        if causality == "output":
            outputs.append(f'valueReference="{reference}"' if three else f'index="{len(elements)}"')
    units = (
        '<Unit name="rad"><BaseUnit rad="1"/></Unit><Unit name="deg"><BaseUnit rad="1"'
        ' factor="0.017453292519943295"/></Unit>'
    )
    units += '<Unit name="K"><BaseUnit K="1"/></Unit><Unit name="degC"><BaseUnit K="1" offset="273.15"/></Unit>'
    lists = ("Output", "InitialUnknown") if three else ("Unknown", "Unknown")
    listed = ["".join(f"<{element} {which}/>" for which in outputs) for element in lists]
    structure = (
        "".join(listed) if three else "<Outputs>{}</Outputs><InitialUnknowns>{}</InitialUnknowns>".format(*listed)
    )
    head = 'fmiVersion="3.0" instantiationToken="follower"' if three else 'fmiVersion="2.0" guid="follower"'
    save = " ".join(f'{can}="true"' for can in SAVING[version])
    return (
        f'<?xml version="1.0" encoding="UTF-8"?><fmiModelDescription {head} modelName="{name}">'
        f'<CoSimulation modelIdentifier="follower" canHandleVariableCommunicationStepSize="true" {save}/>'
        f"<UnitDefinitions>{units}</UnitDefinitions><ModelVariables>{''.join(elements)}</ModelVariables>"
        f"<ModelStructure>{structure}</ModelStructure></fmiModelDescription>"
    )


def unpacked(version: int, folder: Path, text: str) -> Path:
    """A folder as of an unpacked archive with this description, whose library is empty."""
    where, suffix = platform_folder(str(version))
    binary = folder / "binaries" / where / f"follower{suffix}"
    binary.parent.mkdir(parents=True)
    binary.touch()
    (folder / "modelDescription.xml").write_text(text, encoding="utf-8")
    return folder


def build(version: int, folder: Path, *, units: bool = True) -> Path:
    """The FMU for this machine, in a folder. Without `units` values are exchanged as they are."""
    sources = [making.HERE / "follower.c", making.others(folder, f"follower{version}", version)]
    library = making.compile_library(folder, f"follower{version}", version, sources)
    text = description(version, f"Follower{version}")
    text = text if units else re.sub(r' unit="\w+"', "", text)
    return making.pack(folder / f"Follower{version}.fmu", making.contents(version, "follower", text, library))
