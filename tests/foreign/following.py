"""`following.c` as an FMI 3.0 FMU with intermediate update."""

from __future__ import annotations

from pathlib import Path

from foreign import making

KINDS = (
    *("follows", "silent", "reads", "not_a_time", "late", "outside", "unsettable", "no_pointers", "crashes"),
    "upward",
)


def build(folder: Path, *, early_return: bool = False) -> Path:
    """The FMU for this machine, in a folder; its steps may end early on request."""
    able = str(early_return).lower()
    text = f"""<?xml version="1.0" encoding="UTF-8"?>
<fmiModelDescription fmiVersion="3.0" modelName="Following" instantiationToken="following">
  <CoSimulation modelIdentifier="following" canHandleVariableCommunicationStepSize="true" canGetAndSetFMUState="true"
    canSerializeFMUState="true" providesIntermediateUpdate="true" canReturnEarlyAfterIntermediateUpdate="{able}"/>
  <ModelVariables>
    <Float64 name="time" valueReference="100" causality="independent" variability="continuous"/>
    <Float64 name="u" valueReference="0" causality="input" start="0" intermediateUpdate="true"/>
    <Float64 name="free" valueReference="6" causality="input" start="0"/>
    <Float64 name="x" valueReference="1" causality="output" initial="exact" start="0"/>
    <Float64 name="y" valueReference="2" causality="output"/>
    <Int32 name="asked" valueReference="3" causality="output" variability="discrete"/>
    <Int32 name="early" valueReference="4" causality="output" variability="discrete"/>
    <Float64 name="w" valueReference="7" causality="input" start="0 0 7" intermediateUpdate="true">
      <Dimension start="3"/></Float64>
    <Float64 name="xs" valueReference="8" causality="output" initial="exact" start="0"><Dimension start="3"/></Float64>
    <Float64 name="energy" valueReference="9" causality="output" initial="exact" start="0"/>
    <Int32 name="kind" valueReference="5" causality="parameter" variability="fixed" start="0"/>
  </ModelVariables>
  <ModelStructure>
    <Output valueReference="1" dependencies=""/><Output valueReference="2" dependencies="0"/>
    <Output valueReference="3" dependencies=""/><Output valueReference="4" dependencies=""/>
    <Output valueReference="8" dependencies=""/><Output valueReference="9" dependencies=""/>
    <InitialUnknown valueReference="2" dependencies="0"/>
    <InitialUnknown valueReference="3" dependencies=""/><InitialUnknown valueReference="4" dependencies=""/>
  </ModelStructure>
</fmiModelDescription>"""
    sources = [making.HERE / "following.c", making.others(folder, "following", 3)]
    library = making.compile_library(folder, "following", 3, sources)
    return making.pack(folder / f"Following{able}.fmu", making.contents(3, "following", text, library))
