"""`messages.c` as FMUs of FMI 2.0 and 3.0, which exchange texts, bytes and 64-bit integers."""

from __future__ import annotations

from pathlib import Path

from foreign import making

_TEXTS = [("text_in", 0, "input"), ("text", 1, "output")]
_PARAMETERS = [("length", 8), ("source", 9)]


def description(version: int, mime_type: str, max_size: int | None, event_mode: bool) -> str:
    """modelDescription.xml."""
    save = {2: "canGetAndSetFMUstate", 3: "canGetAndSetFMUState"}[version]
    serialize = {2: "canSerializeFMUstate", 3: "canSerializeFMUState"}[version]
    events = ' hasEventMode="true"' if event_mode else ""
    able = 'modelIdentifier="messages" canHandleVariableCommunicationStepSize="true"'
    able += f' {save}="true" {serialize}="true"{events}'
    if version == 2:
        variables = [
            *(
                (name, reference, f'causality="{c}" variability="discrete"', "String", c)
                for name, reference, c in _TEXTS
            ),
            *((n, r, 'causality="parameter" variability="fixed"', "Integer", "start") for n, r in _PARAMETERS),
            ("hash", 11, 'causality="output" variability="discrete"', "Real", "output"),
        ]
        starts = {"input": 'start=""', "output": "", "start": 'start="0"'}
        listed = "".join(
            f'<ScalarVariable name="{n}" valueReference="{r}" {more}><{kind} {starts[c]}/></ScalarVariable>'
            for n, r, more, kind, c in variables
        )
        unknowns = "".join(f'<Unknown index="{i}" dependencies=""/>' for i in (2, 5))
        structure = f"<Outputs>{unknowns}</Outputs><InitialUnknowns>{unknowns}</InitialUnknowns>"
        head = 'fmiVersion="2.0" guid="messages"'
    else:
        binary = f'mimeType="{mime_type}"' + (f' maxSize="{max_size}"' if max_size is not None else "")
        listed = f"""
        <String name="text_in" valueReference="0" causality="input"><Start value=""/></String>
        <String name="text" valueReference="1" causality="output"/>
        <Binary name="data_in" valueReference="2" causality="input" {binary}><Start value=""/></Binary>
        <Binary name="data" valueReference="3" causality="output" {binary}/>
        <Int64 name="whole_in" valueReference="4" causality="input" start="0"/>
        <Int64 name="whole" valueReference="5" causality="output"/>
        <UInt64 name="unsigned_in" valueReference="6" causality="input" start="0"/>
        <UInt64 name="unsigned" valueReference="7" causality="output"/>
        <Int32 name="length" valueReference="8" causality="parameter" variability="fixed" start="0"/>
        <Int32 name="source" valueReference="9" causality="parameter" variability="fixed" start="0"/>
        <Int64 name="first" valueReference="10" causality="parameter" variability="fixed" start="0"/>
        <Int64 name="list_in" valueReference="20" causality="input" start="0 0 0"><Dimension start="3"/></Int64>
        <Int64 name="list" valueReference="21" causality="output"><Dimension start="3"/></Int64>
        <String name="words_in" valueReference="22" causality="input"><Dimension start="3"/></String>
        <String name="words" valueReference="23" causality="output"><Dimension start="3"/></String>
        <Float64 name="hash" valueReference="11" causality="output" variability="discrete"/>"""
        structure = "".join(
            f'<{e} valueReference="{i}" dependencies=""/>'
            for e in ("Output", "InitialUnknown")
            for i in (1, 3, 5, 7, 11, 21, 23)
        )
        head = 'fmiVersion="3.0" instantiationToken="messages"'
    return (
        f'<?xml version="1.0" encoding="UTF-8"?><fmiModelDescription {head} modelName="Messages{version}">'
        f"<CoSimulation {able}/><ModelVariables>{listed}</ModelVariables>"
        f"<ModelStructure>{structure}</ModelStructure></fmiModelDescription>"
    )


def build(
    folder: Path,
    version: int = 3,
    *,
    mime_type: str = "text/plain",
    max_size: int | None = None,
    event_mode: bool = False,
) -> Path:
    """The FMU for this machine, in a folder; with event mode in FMI 3.0 only."""
    name = f"messages{version}"
    library = making.compile_library(
        folder, name, version, [making.HERE / "messages.c", making.others(folder, name, version)]
    )
    text = description(version, mime_type, max_size, event_mode)
    file = f"Messages{version}-{mime_type.replace('/', '-')}-{max_size}{'-events' * event_mode}.fmu"
    return making.pack(folder / file, making.contents(version, "messages", text, library))
