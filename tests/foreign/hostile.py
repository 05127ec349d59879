"""`hostile.c` as FMUs of FMI 2.0 and 3.0: each does one bad deed in one phase."""

from __future__ import annotations

import subprocess
import zipfile
from pathlib import Path

import fmpy

from build_fmus.compile import find_toolchain, host
from cosim.fmu.calls import platform_folder

STEPPING = ("set", "step", "get")
PHASES = (
    "load",
    "instantiate",
    "enter",
    "exit",
    *STEPPING,
    "terminate",
    "free",
    "save",
    "restore",
    "size",
    "serialize",
    "deserialize",
)
"""When it does it. In FMI 2.0 `enter` also stands for fmi2SetupExperiment."""

ENDS = {  # deed -> words of the error
    "segfault": "signal 11",
    "abort": "signal 6",
    "exit": "exit code 3",
    "quit": "exit code 0",
    "hang": "step_timeout",
    "sleep": "step_timeout",
    "devour": "memory_limit",
    "overflow": "signal 11",
    "trap": "signal 4",
    "divide": "signal 8",
    "kill": "signal 9",
    "stop": "step_timeout",
    "terminate": "signal 15",
    "close": "step_timeout|closed the connection|signal 9",
    "fork": "exit code 4",
    "thread": "signal 11",
    "words": "these are my last words",
}
"""Deeds that end the process, or must end it."""

LIES = {
    "greedy": "memory_limit",
    "round": "the rounding mode",
    "flush": "subnormal numbers",
    "status": "77",
    "negative": "-1",
}
"""Deeds that the call survives, and that must be an error all the same."""

HARMLESS = ("chatter", "nothing")


def description(version: int) -> str:
    """modelDescription.xml."""
    variables = [("u", 0, "input", 'start="0"'), ("y", 1, "output", "")]
    saving = " ".join(f'{n}="true"' for n in ("canGetAndSetFMU{}", "canSerializeFMU{}")).format(
        *2 * ["State" if version == 3 else "state"]
    )
    if version == 3:
        listed = "".join(
            f'<Float64 name="{n}" valueReference="{r}" causality="{c}" {more}/>' for n, r, c, more in variables
        )
        head, structure = (
            'fmiVersion="3.0" instantiationToken="hostile"',
            '<Output valueReference="1"/><InitialUnknown valueReference="1"/>',
        )
    else:
        listed = "".join(
            f'<ScalarVariable name="{n}" valueReference="{r}" causality="{c}" variability="continuous"><Real'
            f" {more}/></ScalarVariable>"
            for n, r, c, more in variables
        )
        head = 'fmiVersion="2.0" guid="hostile"'
        structure = '<Outputs><Unknown index="2"/></Outputs><InitialUnknowns><Unknown index="2"/></InitialUnknowns>'
    return (
        f'<?xml version="1.0" encoding="UTF-8"?><fmiModelDescription {head} modelName="Hostile">'
        f'<CoSimulation modelIdentifier="hostile" canHandleVariableCommunicationStepSize="true" {saving}/>'
        f'<DefaultExperiment stepSize="0.001"/><ModelVariables>{listed}</ModelVariables>'
        f"<ModelStructure>{structure}</ModelStructure></fmiModelDescription>"
    )


def compile_library(version: int, folder: Path) -> Path:
    """The library for this machine, in a folder."""
    library = folder / f"hostile{version}{platform_folder(str(version))[1]}"
    if not library.is_file():
        headers = Path(fmpy.__file__).parent / "c-code"
        source = Path(__file__).with_name("hostile.c")
        command = [
            *find_toolchain(host()).command,
            "-O1",
            "-shared",
            "-fPIC",
            "-std=c99",
            "-w",
            f"-DFMI={version}",
            f"-I{headers}",
            source,
            "-o",
            library,
            "-lm",
            "-ldl",
            "-lpthread",
        ]
        subprocess.run(list(map(str, command)), check=True, capture_output=True)
    return library


def build(version: int, folder: Path, phase: str, deed: str) -> Path:
    """The FMU that does this deed in this phase."""
    path = folder / f"Hostile{version}_{phase}_{deed}.fmu"
    where, suffix = platform_folder(str(version))
    library = compile_library(version, folder)
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr("modelDescription.xml", description(version))
        archive.write(library, f"binaries/{where}/hostile{suffix}")
        archive.writestr("resources/deed.txt", f"{phase} {deed}\n")
    return path
