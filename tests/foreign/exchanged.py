"""`exchanged.c` as FMUs of FMI 2.0 and 3.0 that offer Model Exchange only."""

from __future__ import annotations

from pathlib import Path

from foreign import making

_VARIABLES = (  # name, causality, variability, further attributes of the type; value references as in exchanged.c
    ("u", "input", "continuous", 'start="0"'),
    ("x", "output", "continuous", 'start="1"'),
    ("der(x)", "local", "continuous", 'derivative="{x}"'),
    ("v", "output", "continuous", 'start="0"'),
    ("der(v)", "local", "continuous", 'derivative="{v}"'),
    ("k", "parameter", "tunable", 'start="1"'),
    ("kind", "parameter", "tunable", 'start="0"'),
    ("count", "output", "discrete", ""),
    ("steps", "output", "discrete", ""),
    ("last", "output", "discrete", ""),
)
INDICATOR = 1  # value reference of x


def description(version: int) -> str:
    """modelDescription.xml."""
    three, variables = version == 3, []
    for reference, (name, causality, variability, more) in enumerate(_VARIABLES):
        attributes = more.format(x=1 if three else 2, v=3 if three else 4)
        exact = ' initial="exact"' if name in ("x", "v") else ""
        common = (
            f'name="{name}" valueReference="{reference}" causality="{causality}" variability="{variability}"{exact}'
        )
        variables.append(
            f"<Float64 {common} {attributes}/>"
            if three
            else f"<ScalarVariable {common}><Real {attributes}/></ScalarVariable>"
        )
    if three:
        variables.append('<Float64 name="time" valueReference="100" causality="independent" variability="continuous"/>')
        outputs = "".join(f'<Output valueReference="{i}"/>' for i in (1, 3, 7, 8, 9))
        rates = "".join(f'<ContinuousStateDerivative valueReference="{i}"/>' for i in (2, 4))
        initial = "".join(f'<InitialUnknown valueReference="{i}"/>' for i in (2, 4, 7, 8, 9))
        structure = f'{outputs}{rates}{initial}<EventIndicator valueReference="{INDICATOR}"/>'
        head = 'fmiVersion="3.0" instantiationToken="exchanged"'
        can = 'needsCompletedIntegratorStep="true" canGetAndSetFMUState="true" canSerializeFMUState="true"'
    else:
        unknowns = {"Outputs": (2, 4, 8, 9, 10), "Derivatives": (3, 5), "InitialUnknowns": (3, 5, 8, 9, 10)}
        structure = "".join(
            f"<{group}>{''.join(f'<Unknown index={chr(34)}{i}{chr(34)}/>' for i in members)}</{group}>"
            for group, members in unknowns.items()
        )
        head = 'fmiVersion="2.0" guid="exchanged" numberOfEventIndicators="1"'
        can = 'canGetAndSetFMUstate="true" canSerializeFMUstate="true"'
    return (
        f'<?xml version="1.0" encoding="UTF-8"?><fmiModelDescription {head} modelName="Exchanged{version}">'
        f'<ModelExchange modelIdentifier="exchanged" {can}/>'
        f"<ModelVariables>{''.join(variables)}</ModelVariables>"
        f"<ModelStructure>{structure}</ModelStructure></fmiModelDescription>"
    )


def build(version: int, folder: Path, *, slope: str | None = None, returned: str = "OK") -> Path:
    """The FMU for this machine, in a folder; all its directional derivatives are `slope`, if that is given."""
    name, text = f"exchanged{version}", description(version)
    options, without = ["-O2"], []
    if slope is not None:
        offer = f"providesDirectionalDerivative{'s' * (version == 3)}"
        text = text.replace("<ModelExchange ", f'<ModelExchange {offer}="true" ')
        options += [f"-DSLOPE={slope}", f"-DRETURNED=fmi{version}{returned}"]
        without.append(f"fmi{version}GetDirectionalDerivative")
    others = making.others(folder, name, version, without=without)  # FMPy looks for every function
    library = making.compile_library(folder, name, version, [making.HERE / "exchanged.c", others], *options)
    return making.pack(folder / f"Exchanged{version}.fmu", making.contents(version, "exchanged", text, library))
