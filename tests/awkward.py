"""FMUs that behave as no conformant one does, made here.

They are `awkward.c`, compiled, and archives with a description by hand.
"""

from __future__ import annotations

from pathlib import Path

from foreign import making

from cosim.fmu.calls import platform_folder

NONE, FREEZE, STATUS, GET_STATUS, NOT_FINITE, END, END_EARLY, END_UNTOLD = range(8)

_VARIABLES = (  # name, type, value reference, causality, variability, start
    ("u", "Real", 0, "input", "continuous", "0"),
    ("y", "Real", 1, "output", "continuous", None),
    ("at", "Real", 2, "parameter", "tunable", "1e9"),
    ("value", "Real", 3, "parameter", "tunable", "0"),
    ("trouble", "Integer", 10, "parameter", "tunable", "0"),
    ("flags", "Integer", 11, "output", "discrete", None),
)
_FMI3 = {"Real": "Float64", "Integer": "Int32"}


def description(
    version: int,
    variables: str | None = None,
    *,
    name: str = "Awkward",
    identifier: str = "Awkward",
    simulation: str = "",
    experiment: str = 'stepSize="0.1"',
    more: str = "",
    structure: str | None = None,
) -> bytes:
    """A modelDescription.xml; `variables` are elements below ModelVariables.

    By default those of `awkward.c`, whose outputs are then in the model structure.
    """
    if structure is None:
        structure = _outputs(version) if variables is None else ""
    if variables is None:
        variables = "".join(variable(version, *v) for v in _VARIABLES)
    token, version_text = ("guid", "2.0") if version == 2 else ("instantiationToken", "3.0")
    save = "canGetAndSetFMUstate" if version == 2 else "canGetAndSetFMUState"
    return (
        f'<?xml version="1.0" encoding="UTF-8"?>\n<fmiModelDescription fmiVersion="{version_text}" modelName="{name}" '
        f'{token}="awkward"><CoSimulation modelIdentifier="{identifier}" {save}="true" {simulation}/>{more}'
        f"<DefaultExperiment {experiment}/><ModelVariables>{variables}</ModelVariables>"
        f"<ModelStructure>{structure}</ModelStructure>"
        "</fmiModelDescription>"
    ).encode()


def _outputs(version: int) -> str:
    places = [(i, v[2]) for i, v in enumerate(_VARIABLES, start=1) if v[3] == "output"]
    if version == 3:
        return "".join(f'<Output valueReference="{reference}"/>' for _, reference in places)
    listed = "".join(f'<Unknown index="{index}"/>' for index, _ in places)
    return f"<Outputs>{listed}</Outputs>"


def variable(
    version: int, name: str, kind: str, reference: int, causality: str, variability: str, start: str | None
) -> str:
    """An element below ModelVariables."""
    common = f'name="{name}" valueReference="{reference}" causality="{causality}" variability="{variability}"'
    value = "" if start is None else f'start="{start}"'
    if version == 2:
        return f"<ScalarVariable {common}><{kind} {value}/></ScalarVariable>"
    return f"<{_FMI3[kind]} {common} {value}/>"


def library(version: int, folder: Path, *macros: str) -> bytes:
    """`awkward.c` as a shared library of this machine."""
    flags = [f"-D{macro}" for macro in macros]
    name = f"awkward{version}{'_'.join(macros)}"
    return making.compile_library(folder, name, version, [Path(__file__).with_suffix(".c")], *flags).read_bytes()


def archive(path: Path, xml: bytes, *, binary: bytes | None = None, **components: bytes) -> Path:
    """An FMU file; `binary` is the library of this machine."""
    files = {"modelDescription.xml": xml}
    if binary is not None:
        folder, suffix = platform_folder("3" if b'fmiVersion="3' in xml else "2")
        files[f"binaries/{folder}/Awkward{suffix}"] = binary
    return making.pack(path, files | components)
