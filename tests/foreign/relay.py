"""`relay.c` as FMUs of FMI 2.0 and 3.0 that offer Model Exchange only."""

from __future__ import annotations

from pathlib import Path

from foreign import making

_VARIABLES = (  # name, causality, variability, start; value references as in relay.c
    ("u", "input", "continuous", "0"),
    ("y", "output", "continuous", ""),
    ("x", "output", "continuous", "0"),
    ("der(x)", "local", "continuous", ""),
    ("gain", "parameter", "fixed", "0.5"),
    ("offset", "parameter", "fixed", "1"),
    ("on", "parameter", "fixed", "1"),
    ("off", "parameter", "fixed", "1"),
    ("open", "output", "discrete", ""),
    ("updates", "output", "discrete", ""),
    ("a", "input", "continuous", "0"),
    ("ends", "parameter", "fixed", "0"),
)


def description(version: int) -> str:
    """modelDescription.xml."""
    three, variables = version == 3, []
    for reference, (name, causality, variability, start) in enumerate(_VARIABLES):
        attributes = f'start="{start}"' if start else f'derivative="{2 if three else 3}"' if name == "der(x)" else ""
        common = f'name="{name}" valueReference="{reference}" causality="{causality}" variability="{variability}"'
        common += ' initial="exact"' if name == "x" else ""
        variables.append(
            f"<Float64 {common} {attributes}/>"
            if three
            else f"<ScalarVariable {common}><Real {attributes}/></ScalarVariable>"
        )
    if three:
        variables.append('<Float64 name="time" valueReference="100" causality="independent" variability="continuous"/>')
        depends = {1: "0 10", 2: "2", 8: "", 9: ""}
        structure = "".join(f'<Output valueReference="{i}" dependencies="{on}"/>' for i, on in depends.items())
        structure += '<ContinuousStateDerivative valueReference="3" dependencies="0 10"/>'
        structure += "".join(f'<InitialUnknown valueReference="{i}" dependencies="0 10"/>' for i in (1, 3))
        structure += "".join(f'<InitialUnknown valueReference="{i}" dependencies=""/>' for i in (8, 9))
        head = 'fmiVersion="3.0" instantiationToken="relay"'
    else:
        depends = {2: "1 11", 3: "3", 9: "", 10: ""}
        outputs = "".join(f'<Unknown index="{i}" dependencies="{on}"/>' for i, on in depends.items())
        derivative = '<Unknown index="4" dependencies="1 11"/>'
        initial = f'<Unknown index="2" dependencies="1 11"/>{derivative}'
        initial += "".join(f'<Unknown index="{i}" dependencies=""/>' for i in (9, 10))
        structure = f"<Outputs>{outputs}</Outputs><Derivatives>{derivative}</Derivatives>"
        structure += f"<InitialUnknowns>{initial}</InitialUnknowns>"
        head = 'fmiVersion="2.0" guid="relay"'
    can = f'canGetAndSetFMU{"S" if three else "s"}tate="true" canSerializeFMU{"S" if three else "s"}tate="true"'
    more = "" if three else 'completedIntegratorStepNotNeeded="true"'
    return (
        f'<?xml version="1.0" encoding="UTF-8"?><fmiModelDescription {head} modelName="Relay{version}">'
        f'<ModelExchange modelIdentifier="relay" {can} {more}/><ModelVariables>{"".join(variables)}</ModelVariables>'
        f"<ModelStructure>{structure}</ModelStructure></fmiModelDescription>"
    )


def build(version: int, folder: Path) -> Path:
    """The FMU for this machine, in a folder."""
    name = f"relay{version}"
    sources = [making.HERE / "relay.c", making.others(folder, name, version)]
    library = making.compile_library(folder, name, version, sources)
    return making.pack(folder / f"Relay{version}.fmu", making.contents(version, "relay", description(version), library))
