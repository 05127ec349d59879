"""`faulty.c` as FMUs of FMI 2.0 and 3.0 that keep to the standard but for one deliberate fault each.

The fault is in the code, description, archive or library. `ODDITIES` keep to the standard altogether, in a way that a
checker may mistake for a fault.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

from foreign import making

BOTH = (2, 3)


@dataclass(frozen=True)
class Fault:
    """A fault: checks that must find it, and FMI versions that can have it.

    Other checks may notice what follows from it.
    """

    found: tuple[str, ...]
    also: tuple[str, ...] = ()
    versions: tuple[int, ...] = BOTH
    spoil: Callable[[dict[str, bytes], int], None] | None = field(default=None, repr=False)
    """Changes the files of the archive; without, `faulty.c` has the fault."""
    macros: tuple[str, ...] = ()
    coded: bool = False
    """The code has the fault, too, where the files are changed."""


def _replaced(
    pattern: str, new: str, file: str = "modelDescription.xml", count: int = 1
) -> Callable[[dict[str, bytes], int], None]:
    def spoil(files: dict[str, bytes], version: int) -> None:  # noqa: ARG001
        text, n = re.subn(pattern, new, files[file].decode(), count=count)
        assert n, f"{pattern} is not in {file}"
        files[file] = text.encode()

    return spoil


def _without_dependency(unknown: int, known: int, group: str) -> Callable[[dict[str, bytes], int], None]:
    """Take one known out of the dependencies of an unknown."""

    def spoil(files: dict[str, bytes], version: int) -> None:
        text = files["modelDescription.xml"].decode()
        key = f'index="{unknown + 1}"' if version == 2 else f'valueReference="{unknown}"'
        known_ = str(known + 1 if version == 2 else known)
        begin = text.index(f"<{group}" if version == 3 else f"<{group}s>")
        at = text.index(key, begin)
        head, element, tail = text[:at], *text[at:].partition(">")[::2]
        changed = re.sub(rf'(dependencies="[^"]*?)\b{known_}\b ?', r"\1", element).replace(' "', '"')
        assert changed != element
        files["modelDescription.xml"] = (head + changed + ">" + tail).encode()

    return spoil


def _added(element: str) -> Callable[[dict[str, bytes], int], None]:
    """One more variable."""
    return _replaced("</ModelVariables>", f"{element}</ModelVariables>")


def _file(path: str, content: str) -> Callable[[dict[str, bytes], int], None]:
    """A file more in the archive, or another one."""

    def spoil(files: dict[str, bytes], version: int) -> None:  # noqa: ARG001
        files[path] = content.encode()

    return spoil


def _library_of_windows(content: bytes | None) -> Callable[[dict[str, bytes], int], None]:
    """Without `content` it is that of this machine."""

    def spoil(files: dict[str, bytes], version: int) -> None:
        ours = next(p for p in files if p.startswith("binaries/"))
        folder = "win64" if version == 2 else "x86_64-windows"
        files[f"binaries/{folder}/faulty.dll"] = files[ours] if content is None else content

    return spoil


def _no_initial_unknown(files: dict[str, bytes], version: int) -> None:
    """A derivative is not listed."""
    two = (r'(<InitialUnknowns>)<Unknown index="7"[^>]*/>', r"\1")
    _replaced(*(two if version == 2 else (r'<InitialUnknown valueReference="6"[^>]*/>', "")))(files, version)


def _sources(files: dict[str, bytes], version: int) -> None:
    if version == 2:
        _replaced(r"(<CoSimulation [^>]*)/>", r'\1><SourceFiles><File name="lost.c"/></SourceFiles></CoSimulation>')(
            files, version
        )
    else:
        text = (
            '<fmiBuildDescription fmiVersion="3.0"><BuildConfiguration modelIdentifier="faulty"><SourceFileSet>'
            '<SourceFile name="lost.c"/></SourceFileSet></BuildConfiguration></fmiBuildDescription>'
        )
        _file("sources/buildDescription.xml", text)(files, version)


def _terminals(rule: str, members: str, times: int = 1) -> Fault:
    """A terminal with this in it."""
    inner = f'<Terminal name="a" matchingRule="{rule}">{members}</Terminal>' * times
    text = f'<fmiTerminalsAndIcons fmiVersion="3.0"><Terminals>{inner}</Terminals></fmiTerminalsAndIcons>'
    spoil = _file("terminalsAndIcons/terminalsAndIcons.xml", text)
    return Fault(("archive.terminals",), versions=(3,), spoil=spoil)


def _manifest(name: str, root: str, attributes: str) -> Fault:
    """A layered standard with this root element in its manifest."""
    element, end, rest = root.partition(">")
    text = f'<{element} xmlns:fmi-ls="http://fmi-standard.org/fmi-ls-manifest" {attributes}{end}{rest}'
    return Fault(("archive.layered",), spoil=_file(f"extra/{name}/fmi-ls-manifest.xml", text))


_LS_REF = (
    'fmi-ls:fmi-ls-name="org.fmi-standard.fmi-ls-ref" fmi-ls:fmi-ls-version="1.0.0-beta.1" '
    'fmi-ls:fmi-ls-description="Layered Standard providing information on related files included in an FMU."'
)
_LS_STRUCT = (
    'fmi-ls:fmi-ls-name="org.fmi-standard.fmi-ls-struct" fmi-ls:fmi-ls-version="1.0.0" fmi-ls:fmi-ls-description="maps"'
)
_LS_XCP = (
    'fmi-ls:fmi-ls-name="org.fmi-standard.fmi-ls-xcp" fmi-ls:fmi-ls-version="1.0.0" fmi-ls:fmi-ls-description="Layered'
    " standard based on FMI 2.0 and FMI 3.0 for describing and implementing XCP support for FMUs, which can either"
    ' provide an XCP service or allow direct memory access via A2L files."'
)


def _member(variable: str, name: str = 'memberName="a" ') -> str:
    return f'<TerminalMemberVariable variableKind="signal" {name}variableName="{variable}"/>'


def _without_exchange(files: dict[str, bytes], version: int) -> None:
    """Co-Simulation without directional derivatives, for which nobody reads the derivatives.

    One of these is no unknown of initialization.
    """
    _replaced(r"<ModelExchange [^>]*/>", "")(files, version)
    _replaced(r'providesDirectionalDerivatives?="true"( providesAdjointDerivatives="true")?', "")(files, version)
    _no_initial_unknown(files, version)


def _alias_for_derivative(files: dict[str, bytes], version: int) -> None:
    """Among the unknowns of initialization an alias stands for a state derivative."""
    _added('<ScalarVariable name="rate" valueReference="6"><Real/></ScalarVariable>')(files, version)
    _replaced(
        r'(<InitialUnknowns>)<Unknown index="7"([^>]*)/>(.*)(</InitialUnknowns>)', r'\1\3<Unknown index="15"\2/>\4'
    )(files, version)


def _backslashes(files: dict[str, bytes], version: int) -> None:  # noqa: ARG001
    path = next(p for p in files if p.startswith("binaries/"))
    files[path.replace("/", "\\")] = files.pop(path)


def _fixed_step(files: dict[str, bytes], version: int) -> None:
    """FMI 3.0 says that internal steps are fixed, FMI 2.0 cannot."""
    if version == 3:
        _replaced("<CoSimulation ", '<CoSimulation fixedInternalStepSize="0.01" ')(files, version)


def reference(factor: float = 1.0) -> str:
    """The free motion from x = 1, as a table."""
    w, decay = math.sqrt(4.0 - 0.04), 0.2
    rows = ["time,x"]
    for i in range(51):
        t = i * 0.01
        x = math.exp(-decay * t) * (math.cos(w * t) + decay / w * math.sin(w * t))
        rows.append(f"{t:.17g},{factor * x:.17g}")
    return "\n".join(rows) + "\n"


STATES = ("saved.replay", "saved.parameters", "saved.states", "saved.serialize")
FAULTS = {
    # -------------------------------------------------------------------------------------------- description, archive
    "schema": Fault(
        ("description.schema",), spoil=_replaced("<DefaultExperiment ", '<DefaultExperiment color="blue" ')
    ),
    "version": Fault(
        ("description.version",),
        versions=(2,),
        spoil=_replaced('fmiVersion="2.0"', 'fmiVersion="2.0.4"'),
        also=("description.schema",),
    ),
    "identifier": Fault(
        ("description.identifier",),
        ("archive.implementation",),
        spoil=_replaced('modelIdentifier="faulty"', 'modelIdentifier="faulty-1"', count=2),
    ),
    "duplicate-name": Fault(("description.names",), spoil=_replaced('name="gain"', 'name="on"')),
    "unstructured-name": Fault(("description.names",), spoil=_replaced('name="force"', 'name="total force"')),
    "two-starts": Fault(
        ("description.references",),
        versions=(2,),
        spoil=_added(
            '<ScalarVariable name="u2" valueReference="1" causality="input" variability="continuous">'
            '<Real start="0" unit="m"/></ScalarVariable>'
        ),
    ),
    "same-reference": Fault(
        ("description.references",),
        ("values.start", "values.set", "values.reset", "saved.parameters"),
        versions=(3,),
        spoil=_added('<Float64 name="u2" valueReference="1" causality="local" variability="constant" start="0"/>'),
    ),
    "continuous-integer": Fault(
        ("description.variability",),
        spoil=_replaced(
            'name="count" valueReference="9" causality="output" variability="discrete"',
            'name="count" valueReference="9" causality="output" variability="continuous"',
        ),
    ),
    "discrete-parameter": Fault(
        ("description.variability",),
        spoil=_replaced('causality="parameter" variability="tunable"', 'causality="parameter" variability="discrete"'),
    ),
    "no-start": Fault(("description.start",), spoil=_replaced('(name="u"[^>]*>?(?:<Real)?[^>]*) start="0"', r"\1")),
    "start-out-of-range": Fault(
        ("description.start",), spoil=_replaced('max="3"', 'max="1"'), also=("values.discrete",)
    ),
    "unknown-type": Fault(("description.types",), spoil=_replaced(' start="4"', ' start="4" declaredType="Stiffness"')),
    "unknown-unit": Fault(("description.units",), spoil=_replaced('unit="m"', 'unit="ell"')),
    "no-output": Fault(
        ("description.structure",),
        spoil=lambda f, v: _replaced(
            (
                r'<Unknown index="10" dependencies=""/></Outputs>'
                if v == 2
                else r'<Output valueReference="9" dependencies=""/>'
            ),
            "</Outputs>" if v == 2 else "",
        )(f, v),
    ),
    "no-initial-unknown": Fault(("description.structure",), spoil=_no_initial_unknown),
    "kinds": Fault(
        ("description.dependencies",),
        spoil=_replaced('dependencies="5"', 'dependencies="5" dependenciesKind="dependent fixed"'),
    ),
    "clock-without-interval": Fault(
        ("description.clocks",),
        ("description.capabilities",),
        versions=(3,),
        spoil=_added('<Clock name="clock" valueReference="77" causality="input" intervalVariability="constant"/>'),
    ),
    "clocked-continuous": Fault(  # a clock that others would tick, and a clocked variable that may change at any time
        ("description.clocks",),
        ("description.capabilities",),
        versions=(3,),
        spoil=_added(
            '<Clock name="clock" valueReference="77" causality="input" intervalVariability="triggered"/>'
            '<Float64 name="clocked" valueReference="78" causality="local" variability="continuous" clocks="77"/>'
        ),
    ),
    "experiment": Fault(("description.experiment",), spoil=_replaced('stopTime="1"', 'stopTime="-1"')),
    "serialize-without-saving": Fault(
        ("description.capabilities",), spoil=_replaced(r'canGetAndSetFMU[sS]tate="true"', "", count=2)
    ),
    "no-time": Fault(("description.capabilities",), versions=(3,), spoil=_replaced(r'<Float64 name="time"[^>]*/>', "")),
    "license": Fault(
        ("archive.layout",), versions=(3,), spoil=_file("documentation/licenses/readme.txt", "see elsewhere")
    ),
    "sources": Fault(("archive.sources",), spoil=_sources),
    "terminals": _terminals("plug", _member("nobody")),
    "terminal-of-time": _terminals("bus", _member("time")),
    "terminal-rule": _terminals("none", _member("u")),
    "terminal-member": _terminals("bus", _member("u", "")),
    "terminal-twice": _terminals("bus", _member("u") * 2),
    "terminals-alike": _terminals("bus", "", times=2),
    "layered-version": _manifest(
        "com.example.ls",
        "manifest></manifest>",
        'fmi-ls:fmi-ls-name="com.example.ls" fmi-ls:fmi-ls-description="an example"',
    ),
    "related-role": _manifest(
        "org.fmi-standard.fmi-ls-ref",
        'fmiReferences><Related source="../../modelDescription.xml" role="data"/></fmiReferences>',
        _LS_REF,
    ),
    "struct-description": _manifest(
        "org.fmi-standard.fmi-ls-struct", "fmiLayeredStandardManifest></fmiLayeredStandardManifest>", _LS_STRUCT
    ),
    "xcp-definition": _manifest(
        "org.fmi-standard.fmi-ls-xcp",
        'fmiLayeredStandardManifest><Interface supportsDirectMemoryAccess="true"/></fmiLayeredStandardManifest>',
        _LS_XCP,
    ),
    "backslashes": Fault(("archive.zip",), ("archive.layout",), spoil=_backslashes),
    "no-derivative-unknown": Fault(("description.structure",), spoil=_without_exchange),
    "alias-for-derivative": Fault(("description.structure",), versions=(2,), spoil=_alias_for_derivative),
    "known-unknown": Fault(
        ("description.structure",),
        versions=(2,),
        spoil=_replaced("<InitialUnknowns>", '<InitialUnknowns><Unknown index="5"/>'),
    ),
    "lost-library": Fault(
        ("archive.implementation",), spoil=_replaced('modelIdentifier="faulty"', 'modelIdentifier="other"', count=2)
    ),
    # ---------------------------------------------------------------------------------------------------------- binary
    "wrong-folder": Fault(("binary.header",), spoil=_library_of_windows(None)),
    "no-library": Fault(("binary.header",), spoil=_library_of_windows(b"no library at all")),
    "symbol": Fault(("binary.symbols",), macros=("LACKING",)),
    "library-version": Fault(("states.version",), macros=('VERSION="1.0"',)),
    # ---------------------------------------------------------------------------------------------------------- states
    "terminate": Fault(("states.life",), ("states.allowed",)),
    "step-fails": Fault(("states.life",)),
    "step-crash": Fault(("states.life",)),
    "fatal": Fault(("states.allowed",)),
    "step-devour": Fault(("states.life",)),
    "step-exit": Fault(("states.life",)),
    "status": Fault(("states.life",)),
    "endless-events": Fault(("states.life",)),
    "get-terminated": Fault(("states.allowed",)),
    "reset-fails": Fault(("states.allowed", "runs.reset"), ("values.reset", "values.effect")),
    "reset-crash": Fault(("states.allowed", "runs.reset")),
    "logging": Fault(("states.allowed",)),
    "forbidden": Fault(("states.forbidden",), ("states.step",)),
    "wrong-steps": Fault(("states.step",)),
    "beyond-stop": Fault(("states.step",)),
    "free-null": Fault(("states.null",)),
    "token": Fault(("states.token",)),
    # ---------------------------------------------------------------------------------------------------------- values
    "start": Fault(("values.start",), ("references.results",)),
    "setup-loses-parameters": Fault(("values.set",), versions=(2,)),
    "set-ignored": Fault(("values.set",)),
    "input-ignored": Fault(("values.set",), ("derivatives.directional",)),
    "integer-clipped": Fault(("values.discrete",)),
    "readonly": Fault(("values.readonly",)),
    "unknown-accepted": Fault(("values.unknown",)),
    "unknown-crash": Fault(("values.unknown",)),
    "hang-on-nan": Fault(("values.extreme",)),
    "nan": Fault(("values.range",)),
    "reset-keeps-parameter": Fault(("values.reset",), ("values.effect", "values.start")),
    "reset-ignores-parameters": Fault(("values.effect",)),
    # ------------------------------------------------------------------------------------------------------------ runs
    "random": Fault(("runs.repeat",), ("runs.steps", "derivatives.rates", "references.results")),
    "reset-keeps-count": Fault(("runs.reset",), ("values.effect",)),
    "reset-keeps-state": Fault(("runs.reset",), ("values.reset", "values.effect")),
    "shared": Fault(("runs.instances",), ("runs.threads", "runs.reset", *STATES)),
    "threads": Fault(("runs.threads",)),
    "time": Fault(("runs.time",)),
    "steps": Fault(("runs.steps",), ("derivatives.rates", "references.results")),
    "rounding": Fault(("runs.floating_point",)),
    "leak": Fault(("runs.memory",)),
    # ----------------------------------------------------------------------------------------------------- saved states
    "state-forgets-velocity": Fault(("saved.replay",), STATES),
    "state-forgets-count": Fault(("saved.replay",), STATES),
    "state-forgets-input": Fault(("saved.parameters",), STATES),
    "adaptive-forgets-velocity": Fault(
        ("saved.replay",),
        (*STATES, "references.results"),
        spoil=_replaced('stepSize="0.01"', 'stepSize="0.01" tolerance="1e-3"'),
        coded=True,
    ),
    "one-buffer": Fault(("saved.states",), STATES),
    "dangling": Fault(("saved.states",)),
    "serialized-pointer": Fault(("saved.serialize",), STATES),
    "damaged-accepted": Fault(("saved.damaged",)),
    # ---------------------------------------------------------------------------------------- derivatives, dependencies
    "initial-dependency": Fault(("derivatives.initial",), spoil=_without_dependency(8, 2, "InitialUnknown")),
    "dependency": Fault(("derivatives.dependencies",), spoil=_without_dependency(8, 1, "Output")),
    "directional": Fault(("derivatives.directional",), ("derivatives.adjoint",)),
    "adjoint": Fault(("derivatives.adjoint",), versions=(3,)),
    "rate": Fault(("derivatives.rates", "exchange.states"), ("derivatives.directional",)),
    # -------------------------------------------------------------------------------------------------- model exchange
    "order": Fault(("exchange.states",)),
    "stale": Fault(
        ("exchange.pure",),
        (
            "derivatives.directional",
            "derivatives.initial",
            "derivatives.dependencies",
            "exchange.states",
            "runs.instances",
            *STATES,
        ),
    ),
    "nominal": Fault(("exchange.nominals",)),
    "indicators": Fault(("exchange.counts",), versions=(3,)),
    "reference": Fault(("references.results",), spoil=_file("documentation/Faulty_ref.csv", reference(1.02))),
}
"""Name -> what is wrong and which checks say so."""

ODDITIES = {
    "fixed-step": Fault((), spoil=_fixed_step, coded=True),
    "once": Fault(
        (),
        spoil=_replaced(
            'modelIdentifier="faulty"', 'modelIdentifier="faulty" canBeInstantiatedOnlyOncePerProcess="true"', count=2
        ),
        coded=True,
    ),
    "no-early-inputs": Fault((), versions=(2,)),
    "no-early-derivatives": Fault((), ("states.allowed",), versions=(2,)),
    "adaptive": Fault(
        (), ("references.results",), spoil=_replaced('stepSize="0.01"', 'stepSize="0.01" tolerance="1e-3"'), coded=True
    ),
    "empty-token": Fault(
        (), ("description.version",), spoil=_replaced('(guid|instantiationToken)="faulty"', r'\1=""'), coded=True
    ),
    "step-hang": Fault(()),
    "slow": Fault(()),
}
"""Name -> checks that may say something, but no error. Hanging may be slow: that is not judged."""

TIME, U, K, D, X, V, DX, DV, FORCE, COUNT, GAIN, ON, C, Z = range(14)
_VARIABLES = [  # name, type of FMI 3.0, causality, variability, further attributes of the variable, of its value
    ("time", "Float64", "independent", "continuous", "", 'unit="s"'),
    ("u", "Float64", "input", "continuous", "", 'start="0" unit="m"'),
    ("k", "Float64", "parameter", "fixed", "", 'start="4" min="0.1"'),
    ("d", "Float64", "parameter", "tunable", "", 'start="0.4"'),
    ("x", "Float64", "output", "continuous", 'initial="exact"', 'start="1" unit="m"'),
    ("v", "Float64", "local", "continuous", 'initial="exact"', 'start="0"'),
    ("der(x)", "Float64", "local", "continuous", "", f'derivative="{X}"'),
    ("der(v)", "Float64", "local", "continuous", "", f'derivative="{V}"'),
    ("force", "Float64", "output", "continuous", "", ""),
    ("count", "Int32", "output", "discrete", "", ""),
    ("gain", "Int32", "parameter", "fixed", "", 'start="2" min="1" max="3"'),
    ("on", "Boolean", "input", "discrete", "", 'start="true"'),
    ("c", "Float64", "local", "constant", "", 'start="3.5"'),
    ("z", "Float64", "local", "continuous", "", ""),
]
_OUTPUTS = {X: [X], FORCE: [U, X, ON], COUNT: []}
_DERIVATIVES = {DX: [V], DV: [U, X, V, ON]}
_INITIAL = {DX: [V], DV: [U, K, D, X, V, GAIN, ON], FORCE: [U, K, X, GAIN, ON], COUNT: []}


def description(version: int) -> str:
    """modelDescription.xml, without a fault."""
    three = version == 3
    old = {"Float64": "Real", "Int32": "Integer", "Boolean": "Boolean"}
    variables = []
    for reference_, (name, kind, causality, variability, more, given) in enumerate(_VARIABLES):
        typed = given if three else re.sub(r'derivative="(\d+)"', lambda m: f'derivative="{int(m[1]) + 1}"', given)
        head = f'name="{name}" valueReference="{reference_}" causality="{causality}" variability="{variability}" {more}'
        variables.append(
            f"<{kind} {head} {typed}/>" if three else f"<ScalarVariable {head}><{old[kind]} {typed}/></ScalarVariable>"
        )

    def listed(group: str, unknowns: dict[int, list[int]]) -> str:
        elements = []
        for unknown, knowns in unknowns.items():
            key = f'valueReference="{unknown}"' if three else f'index="{unknown + 1}"'
            depends = " ".join(str(k if three else k + 1) for k in knowns)
            elements.append(f'<{group if three else "Unknown"} {key} dependencies="{depends}"/>')
        return "".join(elements) if three else f"<{group}s>{''.join(elements)}</{group}s>"

    structure = (
        listed("Output", _OUTPUTS)
        + listed("ContinuousStateDerivative" if three else "Derivative", _DERIVATIVES)
        + listed("InitialUnknown", _INITIAL)
    )
    if three:
        structure += f'<EventIndicator valueReference="{Z}"/>'
    state = "State" if three else "state"
    flags = f'modelIdentifier="faulty" canGetAndSetFMU{state}="true" canSerializeFMU{state}="true" '
    flags += (
        'providesDirectionalDerivatives="true" providesAdjointDerivatives="true"'
        if three
        else 'providesDirectionalDerivative="true"'
    )
    head = (
        'fmiVersion="3.0" instantiationToken="faulty"'
        if three
        else 'fmiVersion="2.0" guid="faulty" numberOfEventIndicators="1"'
    )
    return (
        f'<?xml version="1.0" encoding="UTF-8"?>\n<fmiModelDescription {head} modelName="Faulty"'
        f' variableNamingConvention="structured">\n<ModelExchange {flags}/>\n<CoSimulation {flags}'
        ' canHandleVariableCommunicationStepSize="true"/>\n<UnitDefinitions><Unit name="m"><BaseUnit'
        ' m="1"/></Unit><Unit name="s"><BaseUnit s="1"/></Unit></UnitDefinitions>\n<LogCategories><Category'
        ' name="logStatusError"/></LogCategories>\n<DefaultExperiment startTime="0" stopTime="1"'
        ' stepSize="0.01"/>\n<ModelVariables>\n'
        + "\n".join(variables)
        + f"\n</ModelVariables>\n<ModelStructure>{structure}</ModelStructure>\n</fmiModelDescription>\n"
    )


def compile_library(version: int, folder: Path, macros: tuple[str, ...] = ()) -> Path:
    """The library for this machine. Functions that `faulty.c` lacks return an error."""
    name = re.sub(r"\W", "_", "_".join(macros))
    left_out = {"fmi2GetStatus", "fmi3GetClock"} if "LACKING" in macros else set()
    others = making.others(folder, f"faulty{version}{name}", version, scheduled=False, without=left_out)
    given = [f"-D{m}" for m in macros if "=" not in m]
    given.append('-DVERSION="1.0"' if any(m.startswith("VERSION") for m in macros) else f'-DVERSION="{version}.0"')
    sources = [making.HERE / "faulty.c", others]
    return making.compile_library(folder, f"faulty{version}{name}", version, sources, "-std=gnu99", *given)


def build(version: int, folder: Path, fault: str = "") -> Path:
    """The FMU with this fault; without, it has none."""
    about = {**FAULTS, **ODDITIES}.get(fault)
    library = compile_library(version, folder, about.macros if about else ())
    files = making.contents(version, "faulty", description(version), library) | {
        "documentation/index.html": b"<!DOCTYPE html><title>Faulty</title>",
        "documentation/Faulty_ref.csv": reference().encode(),
        "resources/fault.txt": f"{fault or 'none'}\n".encode(),
    }
    if about and about.spoil:
        about.spoil(files, version)
        if not about.coded:
            files["resources/fault.txt"] = b"none\n"
    return making.pack(folder / f"Faulty{version}_{fault or 'none'}.fmu", files)
