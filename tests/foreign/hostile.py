"""`hostile.c` as FMUs of FMI 2.0 and 3.0: each does one bad deed in one phase."""

from __future__ import annotations

from pathlib import Path

import awkward
from foreign import making

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


VARIABLES = (("u", "input", "0"), ("y", "output", None))  # name, causality, start


def description(version: int) -> str:
    """modelDescription.xml."""
    three, unknown = version == 3, '<Unknown index="2"/>'
    u, y = (awkward.variable(version, n, "Real", i, c, "continuous", s) for i, (n, c, s) in enumerate(VARIABLES))
    return awkward.description(
        version,
        u + y,
        name="Hostile",
        identifier="hostile",
        simulation=f'canHandleVariableCommunicationStepSize="true" canSerializeFMU{"S" if three else "s"}tate="true"',
        experiment='stepSize="0.001"',
        structure='<Output valueReference="1"/><InitialUnknown valueReference="1"/>'
        if three
        else f"<Outputs>{unknown}</Outputs><InitialUnknowns>{unknown}</InitialUnknowns>",
    ).decode()


def compile_library(version: int, folder: Path) -> Path:
    """The library for this machine, in a folder."""
    return making.compile_library(
        folder, f"hostile{version}", version, [making.HERE / "hostile.c"], "-ldl", "-lpthread"
    )


def build(version: int, folder: Path, phase: str, deed: str) -> Path:
    """The FMU that does this deed in this phase."""
    files = making.contents(version, "hostile", description(version), compile_library(version, folder))
    files["resources/deed.txt"] = f"{phase} {deed}\n".encode()
    return making.pack(folder / f"Hostile{version}_{phase}_{deed}.fmu", files)
