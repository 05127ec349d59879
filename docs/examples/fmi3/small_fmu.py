"""Builds the FMUs of these examples: one C file and a list of its variables."""

from __future__ import annotations

import subprocess
import zipfile
from collections.abc import Sequence
from pathlib import Path
from xml.sax.saxutils import quoteattr

import fmpy

from build_fmus.compile import find_toolchain, host
from cosim.fmu.calls import platform_folder

HERE = Path(__file__).parent
Variable = tuple[str, str, int, dict[str, str]]
"""Name, type, value reference, and further attributes of modelDescription.xml."""


def element(variable: Variable) -> str:
    """A variable in modelDescription.xml; its `dimension` is the value reference of a structural parameter."""
    name, kind, reference, attributes = variable
    own = dict(attributes)
    dimension = own.pop("dimension", "")
    inside = f'<Dimension valueReference="{dimension}"/>' if dimension else ""
    if kind == "Binary" and "start" in own:
        inside += f'<Start value="{own.pop("start")}"/>'
    text = " ".join(f"{k}={quoteattr(v)}" for k, v in {"name": name, "valueReference": str(reference), **own}.items())
    return f"<{kind} {text}>{inside}</{kind}>"


def terminals(names: Sequence[str]) -> str:
    """terminalsAndIcons.xml with connections to a bus: NAME.Rx_Data, NAME.Tx_Data and their clocks."""
    own = "".join(
        f'<Terminal name="{n}" terminalKind="org.fmi-ls-bus.network-terminal"'
        ' matchingRule="org.fmi-ls-bus.transceiver">'
        + "".join(
            f'<TerminalMemberVariable variableKind="signal" variableName="{n}.{m}" memberName="{m}"/>'
            for m in ("Rx_Data", "Tx_Data", "Rx_Clock", "Tx_Clock")
        )
        + "</Terminal>"
        for n in names
    )
    return f'<fmiTerminalsAndIcons fmiVersion="3.0"><Terminals>{own}</Terminals></fmiTerminalsAndIcons>'


def build(name: str, variables: Sequence[Variable], folder: Path, channels: Sequence[str] = (), **options: str) -> Path:
    """The FMU NAME.fmu of NAME.c, for this machine, in `folder`.

    `channels`: its connections to a bus; `options`: attributes of CoSimulation.
    """
    where, suffix = platform_folder("3")
    library = folder / f"{name}{suffix}"
    flags = ["-O2", "-shared", "-fPIC", "-std=c99", f"-I{HERE}", f"-I{Path(fmpy.__file__).parent / 'c-code'}"]
    command = [*find_toolchain(host()).command, *flags, str(HERE / f"{name}.c"), "-o", str(library), "-lm"]
    subprocess.run(command, check=True)
    attributes = {
        "modelIdentifier": name,
        "canHandleVariableCommunicationStepSize": "true",
        "canGetAndSetFMUState": "true",
        "hasEventMode": "true",
        **options,
    }
    outputs = "".join(
        f'<Output valueReference="{reference}" dependencies=""/>'
        for _, _, reference, a in variables
        if a["causality"] == "output"
    )
    description = f"""<?xml version="1.0" encoding="UTF-8"?>
<fmiModelDescription fmiVersion="3.0" modelName="{name}" instantiationToken="{name}">
  <CoSimulation {" ".join(f'{k}="{v}"' for k, v in attributes.items())}/>
  <ModelVariables>
    <Float64 name="time" valueReference="1000" causality="independent" variability="continuous"/>
    {"".join(map(element, variables))}
  </ModelVariables>
  <ModelStructure>{outputs}</ModelStructure>
</fmiModelDescription>
"""
    path = folder / f"{name}.fmu"
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr("modelDescription.xml", description)
        if channels:
            archive.writestr("terminalsAndIcons/terminalsAndIcons.xml", terminals(channels))
        archive.writestr(f"binaries/{where}/{library.name}", library.read_bytes())
    return path


def number(name: str, kind: str, reference: int, causality: str, start: str = "", **more: str) -> Variable:
    """A number: discrete, or fixed for a parameter."""
    variability = {"parameter": "fixed", "structuralParameter": "fixed"}.get(causality, "discrete")
    given = {"start": start} if start else {}
    return name, kind, reference, {"causality": causality, "variability": variability, **given, **more}
