"""`eventful.c` as FMI 3.0 FMUs with event mode, or without it."""

from __future__ import annotations

from pathlib import Path

from foreign import making

KINDS = (
    *("announced", "early", "paused", "at_end", "endless", "ending", "backward", "stuck", "discards"),
    *("nowhere", "passed", "twice", "upward"),
)


def description(*, event_mode: bool, variable_step: bool, internal: str, token: str) -> str:
    """modelDescription.xml."""
    flags = {
        "canHandleVariableCommunicationStepSize": variable_step,
        "canGetAndSetFMUState": True,
        "canSerializeFMUState": True,
        "hasEventMode": event_mode,
        "mightReturnEarlyFromDoStep": variable_step,
    }
    able = " ".join(f'{name}="{str(value).lower()}"' for name, value in flags.items())
    return f"""<?xml version="1.0" encoding="UTF-8"?>
<fmiModelDescription fmiVersion="3.0" modelName="Eventful" instantiationToken="{token}">
  <CoSimulation modelIdentifier="eventful" {able}{f' fixedInternalStepSize="{internal}"' if internal else ""}/>
  <ModelVariables>
    <Float64 name="time" valueReference="100" causality="independent" variability="continuous"/>
    <Float64 name="u" valueReference="0" causality="input" variability="continuous" start="1"/>
    <Int32 name="k" valueReference="1" causality="input" variability="discrete" start="1"/>
    <Float64 name="z" valueReference="2" causality="output" variability="continuous"/>
    <Int32 name="level" valueReference="3" causality="output" variability="discrete"/>
    <Int32 name="count" valueReference="4" causality="output" variability="discrete"/>
    <Float64 name="last" valueReference="5" causality="output" variability="discrete"/>
    <Int32 name="steps" valueReference="6" causality="output" variability="discrete"/>
    <Float64 name="period" valueReference="7" causality="parameter" variability="fixed" start="0.03"/>
    <Int32 name="kind" valueReference="8" causality="parameter" variability="fixed" start="0"/>
  </ModelVariables>
  <ModelStructure>
    {"".join(f'<Output valueReference="{i}" dependencies=""/>' for i in (2, 3, 4, 5, 6))}
    {"".join(f'<InitialUnknown valueReference="{i}" dependencies="1"/>' for i in (2, 3, 4, 5, 6))}
  </ModelStructure>
</fmiModelDescription>"""


def build(
    folder: Path,
    *,
    event_mode: bool = True,
    variable_step: bool = True,
    internal: str = "",
    token: str = "eventful",
    near: str = "1e-9",
) -> Path:
    """The FMU for this machine, in a folder. With the token "refuses" it has no event mode, whatever it declares."""
    sources = [making.HERE / "eventful.c", making.others(folder, "eventful", 3)]
    library = making.compile_library(folder, f"eventful{near}", 3, sources, f"-DNEAR={near}")
    text = description(event_mode=event_mode, variable_step=variable_step, internal=internal, token=token)
    name = f"Eventful{int(event_mode)}{int(variable_step)}{internal}{token}{near}.fmu"
    return making.pack(folder / name, making.contents(3, "eventful", text, library))
