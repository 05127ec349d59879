"""`sloped.c` as FMUs of FMI 2.0 and 3.0: outputs that depend directly on inputs, with directional derivatives."""

from __future__ import annotations

from pathlib import Path

from foreign import making

_VARIABLES = (  # name, causality, variability; value references as in sloped.c
    ("p", "input", "continuous"),
    ("q", "input", "continuous"),
    ("a", "output", "continuous"),
    ("b", "output", "continuous"),
    ("k", "parameter", "tunable"),
    ("trouble", "parameter", "tunable"),
    ("calls", "local", "discrete"),
)


_KINDS = {
    "clock": 'intervalVariability="constant" intervalDecimal="0.03"',
    "ticked": 'intervalVariability="triggered"',
}


def description(version: int, *, offers: bool = True, events: str = "", multiples: bool = False) -> str:
    """modelDescription.xml; `offers` directional derivatives. `events`: what it has event mode for, of FMI 3.0.

    `multiples`: with the array of this name, `whole` and `less`, of FMI 3.0.
    "clock" or "ticked": an input clock that ticks by itself, or that a connection ticks; "discrete": the input q.
    """
    three, variables = version == 3, []
    for reference, (name, causality, variability) in enumerate(_VARIABLES):
        start = "" if causality in ("output", "local") else f'start="{float(name == "k")}"'
        how = "discrete" if (name, events) == ("q", "discrete") else variability
        common = f'name="{name}" valueReference="{reference}" causality="{causality}" variability="{how}"'
        variables.append(
            f"<Float64 {common} {start}/>" if three else f"<ScalarVariable {common}><Real {start}/></ScalarVariable>"
        )
    if events in _KINDS:
        variables.append(f'<Clock name="clock" valueReference="7" causality="input" {_KINDS[events]}/>')
    if multiples:
        array = 'name="multiples" valueReference="8" causality="output" variability="continuous"'
        variables.append(f'<Float64 {array}><Dimension start="2"/></Float64>')
        for reference, name in ((9, "whole"), (10, "less")):
            variables.append(f'<Int64 name="{name}" valueReference="{reference}" causality="output"/>')
    if three:
        variables.append('<Float64 name="time" valueReference="100" causality="independent" variability="continuous"/>')
        structure = "".join(
            f'<{kind} valueReference="{i}" dependencies="0 1"/>'
            for kind in ("Output", "InitialUnknown")
            for i in (2, 3, *[8, 9, 10] * multiples)
        )
        head, can = 'fmiVersion="3.0" instantiationToken="sloped"', 'canGetAndSetFMUState="true"'
        offered = 'providesDirectionalDerivatives="true"'
        can += ' hasEventMode="true"' * bool(events)
    else:
        unknowns = "".join(f'<Unknown index="{i}" dependencies="1 2"/>' for i in (3, 4))
        structure = f"<Outputs>{unknowns}</Outputs><InitialUnknowns>{unknowns}</InitialUnknowns>"
        head, can = 'fmiVersion="2.0" guid="sloped"', 'canGetAndSetFMUstate="true"'
        offered = 'providesDirectionalDerivative="true"'
    return (
        f'<?xml version="1.0" encoding="UTF-8"?><fmiModelDescription {head} modelName="Sloped{version}"><CoSimulation'
        f' modelIdentifier="sloped" canHandleVariableCommunicationStepSize="true" {can} {offered if offers else ""}/>'
        f"<ModelVariables>{''.join(variables)}</ModelVariables>"
        f"<ModelStructure>{structure}</ModelStructure></fmiModelDescription>"
    )


def build(
    version: int,
    folder: Path,
    *,
    offers: bool = True,
    lacking: bool = False,
    events: str = "",
    multiples: bool = False,
) -> Path:
    """The FMU for this machine, in a folder; `lacking`: the function for derivatives is not in its library."""
    name = f"sloped{version}{events}" + "lacking" * lacking
    function = f"fmi{version}GetDirectionalDerivative"
    sources = [making.HERE / "sloped.c", making.others(folder, name, version, without=[function])]
    flags = [*["-DLACKING"] * lacking, f"-DDISCRETE={int(events == 'discrete')}"]
    library = making.compile_library(folder, name, version, sources, *flags)
    text = description(version, offers=offers, events=events, multiples=multiples)
    path = folder / f"{name.capitalize()}{'' if offers else 'Silent'}{'Multiples' * multiples}.fmu"
    return making.pack(path, making.contents(version, "sloped", text, library))
