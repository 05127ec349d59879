"""`failing.c` as FMUs of FMI 2.0 and 3.0: each of its functions can return any status, at any call."""

from __future__ import annotations

from pathlib import Path

from foreign import making

FUNCTIONS = (
    *("nothing", "SetReal", "GetReal", "SetupExperiment", "EnterInitializationMode", "ExitInitializationMode"),
    *("DoStep", "Terminate", "Reset", "GetFMUState", "SetFMUState", "SetTime", "SetContinuousStates"),
    *("GetContinuousStates", "GetDerivatives", "GetEventIndicators", "GetNominalsOfContinuousStates"),
    *("EnterEventMode", "UpdateDiscreteStates", "EnterContinuousTimeMode", "CompletedIntegratorStep"),
)
_VARIABLES = (  # name, causality, variability, further attributes; value references as in failing.c
    ("u", "input", "continuous", 'start="0"'),
    ("x", "output", "continuous", 'start="1" initial="exact"'),
    ("der(x)", "local", "continuous", 'derivative="{x}"'),
    ("function", "parameter", "fixed", 'start="0"'),
    ("status", "parameter", "fixed", 'start="0"'),
    ("after", "parameter", "fixed", 'start="0"'),
)


def description(version: int) -> str:
    """modelDescription.xml."""
    three, variables = version == 3, []
    for reference, (name, causality, variability, more) in enumerate(_VARIABLES):
        common = f'name="{name}" valueReference="{reference}" causality="{causality}" variability="{variability}"'
        attributes = more.format(x=1 if three else 2)
        if three:
            variables.append(f"<Float64 {common} {attributes}/>")
            continue
        initial, attributes = (
            (' initial="exact"', attributes.replace('initial="exact"', "")) if "exact" in more else ("", attributes)
        )
        variables.append(f"<ScalarVariable {common}{initial}><Real {attributes}/></ScalarVariable>")
    can = f'canGetAndSetFMU{"S" if three else "s"}tate="true"'
    if three:
        variables.append('<Float64 name="time" valueReference="100" causality="independent" variability="continuous"/>')
        structure = (
            '<Output valueReference="1" dependencies="1"/>'
            '<ContinuousStateDerivative valueReference="2" dependencies="0 1"/>'
            '<InitialUnknown valueReference="2" dependencies="0 1"/><EventIndicator valueReference="1"/>'
        )
        head, me = 'fmiVersion="3.0" instantiationToken="failing"', 'needsCompletedIntegratorStep="true"'
    else:
        derivative = '<Unknown index="3" dependencies="1 2"/>'
        structure = (
            f'<Outputs><Unknown index="2" dependencies="2"/></Outputs><Derivatives>{derivative}</Derivatives>'
            f"<InitialUnknowns>{derivative}</InitialUnknowns>"
        )
        head, me = 'fmiVersion="2.0" guid="failing" numberOfEventIndicators="1"', ""
    cs = 'canHandleVariableCommunicationStepSize="true"'
    return (
        f'<?xml version="1.0" encoding="UTF-8"?><fmiModelDescription {head} modelName="Failing{version}">'
        f'<ModelExchange modelIdentifier="failing" {can} {me}/><CoSimulation modelIdentifier="failing" {can} {cs}/>'
        f"<ModelVariables>{''.join(variables)}</ModelVariables>"
        f"<ModelStructure>{structure}</ModelStructure></fmiModelDescription>"
    )


def build(version: int, folder: Path, *, states: int = 1, indicators: int = 1) -> Path:
    """The FMU for this machine, in a folder, whose code has so many values; its description lists one of each."""
    name = f"failing{version}" + f"_{states}_{indicators}" * ((states, indicators) != (1, 1))
    sources = [making.HERE / "failing.c", making.others(folder, name, version)]
    library = making.compile_library(folder, name, version, sources, f"-DINDICATORS={indicators}", f"-DSTATES={states}")
    return making.pack(
        folder / f"{name.title()}.fmu", making.contents(version, "failing", description(version), library)
    )
