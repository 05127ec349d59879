"""`clocked.c` as FMI 3.0 FMUs, one for each kind of clock, as somebody else would make them."""

from __future__ import annotations

from pathlib import Path

from foreign import making

KINDS = ("constant", "fixed", "tunable", "changing", "countdown", "early", "endless")
CLOCK = {
    "constant": (
        'intervalVariability="constant" intervalDecimal="0.00333333" supportsFraction="false" resolution="300"'
        ' intervalCounter="1"'
    ),
    "fixed": 'intervalVariability="fixed"',
    "tunable": 'intervalVariability="tunable"',
    "changing": 'intervalVariability="changing"',
    "countdown": 'intervalVariability="countdown"',
    "triggered": 'intervalVariability="triggered"',
    "early": 'intervalVariability="constant" intervalDecimal="0.01"',
    "endless": 'intervalVariability="constant" intervalDecimal="0.01"',
}


def description(kind: str, *, variable_step: bool = True, event_mode: bool = True, fractions: bool = False) -> str:
    """modelDescription.xml."""
    variability = "tunable" if kind == "tunable" else "fixed"
    clock = CLOCK[kind] + ' supportsFraction="true"' * fractions
    return f"""<?xml version="1.0" encoding="UTF-8"?>
<fmiModelDescription fmiVersion="3.0" modelName="Clocked" instantiationToken="clocked">
  <CoSimulation modelIdentifier="clocked" canHandleVariableCommunicationStepSize="{str(variable_step).lower()}"
    canGetAndSetFMUState="true" canSerializeFMUState="true" hasEventMode="{str(event_mode).lower()}"/>
  <ModelVariables>
    <Float64 name="time" valueReference="100" causality="independent" variability="continuous"/>
    <Float64 name="u" valueReference="0" causality="input" variability="discrete" start="0" clocks="8"/>
    <Float64 name="y" valueReference="1" causality="output" variability="discrete" clocks="8"/>
    <Float64 name="z" valueReference="2" causality="output" variability="continuous"/>
    <Int32 name="ticks" valueReference="3" causality="output" variability="discrete" clocks="8"/>
    <Float64 name="last" valueReference="4" causality="output" variability="discrete" clocks="8"/>
    <Float64 name="period" valueReference="5" causality="parameter" variability="{variability}" start="{
        0.02 if kind == "fixed" else 0.01
    }"/>
    <Float64 name="shift" valueReference="6" causality="parameter" variability="fixed" start="0"/>
    <Boolean name="begin" valueReference="7" causality="input" variability="discrete" start="false"/>
    <Clock name="clock" valueReference="8" causality="input" {clock}/>
    <Clock name="pulse" valueReference="9" causality="output" intervalVariability="triggered"/>
    <Float64 name="w" valueReference="10" causality="output" variability="discrete" clocks="9"/>
  </ModelVariables>
  <ModelStructure>
    <Output valueReference="1" dependencies="0"/><Output valueReference="2"/><Output valueReference="3"/>
    <Output valueReference="4"/>
    <Output valueReference="9"/><Output valueReference="10"/>
    <InitialUnknown valueReference="1"/><InitialUnknown valueReference="2"/><InitialUnknown valueReference="3"/>
    <InitialUnknown valueReference="4"/>
  </ModelStructure>
</fmiModelDescription>"""


def build(
    kind: str, folder: Path, *, variable_step: bool = True, event_mode: bool = True, fractions: bool = False
) -> Path:
    """The FMU for this machine, in a folder.

    `kind`: that of its clock, or "early", which returns early though it may not, or "endless". `fractions`: a countdown
    gives its interval as a fraction.
    """
    number = KINDS.index(kind) if kind in KINDS else 0
    flags = f"-DKIND={number}", f"-DFRACTIONS={int(fractions)}"
    library = making.compile_library(folder, f"clocked_{kind}", 3, [making.HERE / "clocked.c"], *flags)
    text = description(kind, variable_step=variable_step, event_mode=event_mode, fractions=fractions)
    return making.pack(folder / f"Clocked{kind.capitalize()}.fmu", making.contents(3, "clocked", text, library))
