"""`pulses.c` as an FMI 3.0 FMU whose clocks can be connected."""

from __future__ import annotations

from pathlib import Path

from foreign import making

DESCRIPTION = """<?xml version="1.0" encoding="UTF-8"?>
<fmiModelDescription fmiVersion="3.0" modelName="Pulses" instantiationToken="pulses">
  <CoSimulation modelIdentifier="pulses" canHandleVariableCommunicationStepSize="true" canGetAndSetFMUState="true"
    canSerializeFMUState="true" hasEventMode="true"/>
  <ModelVariables>
    <Float64 name="time" valueReference="100" causality="independent" variability="continuous"/>
    <Float64 name="x" valueReference="0" causality="input" variability="discrete" start="0" clocks="7"/>
    <Float64 name="y" valueReference="1" causality="output" variability="discrete" clocks="8"/>
    <Int32 name="count" valueReference="2" causality="output" variability="discrete"/>
    <Float64 name="last" valueReference="3" causality="output" variability="discrete"/>
    <Float64 name="got" valueReference="4" causality="output" variability="discrete"/>
    <Float64 name="period" valueReference="5" causality="parameter" variability="fixed" start="0"/>
    <Int32 name="relay" valueReference="6" causality="parameter" variability="fixed" start="0"/>
    <Clock name="in" valueReference="7" causality="input" intervalVariability="triggered"/>
    <Clock name="out" valueReference="8" causality="output" intervalVariability="triggered"/>
  </ModelVariables>
  <ModelStructure>
    <Output valueReference="1" dependencies="0"/><Output valueReference="2" dependencies=""/>
    <Output valueReference="3" dependencies=""/><Output valueReference="4" dependencies=""/>
    <Output valueReference="8"/>
    <InitialUnknown valueReference="2"/><InitialUnknown valueReference="3"/><InitialUnknown valueReference="4"/>
  </ModelStructure>
</fmiModelDescription>"""
HOW = ("whole", "discarded", "early", "in event mode")
ENDING = """
    <Float64 name="end" valueReference="9" causality="parameter" variability="fixed" start="1e9"/>
    <Int32 name="how" valueReference="10" causality="parameter" variability="fixed" start="0"/>
  </ModelVariables>"""


def build(folder: Path, *, early_return: bool = False, ends: bool = False, near: str = "1e-9") -> Path:
    """The FMU for this machine, in a folder; its steps may end early. `ends`: with the parameters `end` and `how`."""
    sources = [making.HERE / "pulses.c", making.others(folder, "pulses", 3)]
    library = making.compile_library(folder, f"pulses{near}", 3, sources, f"-DNEAR={near}")
    able = f'hasEventMode="true" mightReturnEarlyFromDoStep="{str(early_return).lower()}"'
    text = DESCRIPTION.replace('hasEventMode="true"', able)
    if ends:
        text = text.replace("\n  </ModelVariables>", ENDING)
    name = f"Pulses{int(early_return)}{int(ends)}{near}.fmu"
    return making.pack(folder / name, making.contents(3, "pulses", text, library))
