"""Rules on the model structure in a model description: its unknowns, and what they depend on."""

from __future__ import annotations

from collections.abc import Iterator

from cosim.check.description_rules import File
from cosim.check.model import Model, Unknown, Var
from cosim.check.rules import Found, file_check, names, warning


@file_check(
    "description.structure",
    "ModelStructure lists every output, derivative and unknown of initialization, once, and nothing else",
    fmi2="2.2.8 Definition of the Model Structure",
    fmi3="2.4.8 Model Structure",
    advice="List exactly the variables that the standard requires in each part of ModelStructure.",
)
def structure(file: File) -> Found:
    m = file.model
    for group in ("Output", "Derivative", "InitialUnknown", "EventIndicator", "ClockedState"):
        seen: set[int | None] = set()
        for u in (u for u in m.structure if u.group == group):
            if u.key not in m.by_key:
                yield u.line, f"{_shown(m, group)}: {_key(m)} {u.key} belongs to no variable"
            elif u.key in seen:
                yield u.line, f"{_shown(m, group)}: {m.by_key[u.key].name!r} is listed twice"
            seen.add(u.key)
    outputs = {m.key(v): v for v in m.of("output")}
    listed = {u.key for u in m.structure if u.group == "Output"}
    missing = [v.name for k, v in outputs.items() if k not in listed]
    if missing:
        which = f"outputs {names(missing)} are" if len(missing) > 1 else f"output {missing[0]!r} is"
        yield f"{which} not among the Outputs of ModelStructure"
    for u, v in m.unknowns():
        if u.group == "Output" and v.causality != "output":
            yield u.line, f"{v.name!r} is among the Outputs of ModelStructure, but is not an output"
        if u.group == "Derivative":
            for line, text in _derivative(m, u, v):
                yield (line, text) if _counts(m) else warning(text, line)
        if u.group == "InitialUnknown" and v.causality in ("input", "parameter", "structuralParameter", "independent"):
            yield u.line, f"{v.name!r} is among the unknowns of initialization, but is known: {v.causality}"
    states = [s.name for s in dict.fromkeys(m.states) if s.causality not in ("local", "output")]
    if states:
        yield warning(f"{names(states)}: states must be local variables or outputs")
    yield from _unknowns_of_initialization(m)


def _counts(m: Model) -> bool:
    """Whether anybody looks at the derivatives: with Co-Simulation only if there are directional derivatives."""
    return "me" in m.interfaces or any(i.directional for i in m.interfaces.values())


def _derivative(m: Model, u: Unknown, v: Var) -> Iterator[tuple[int, str]]:
    state = m.state_of(v)
    if v.derivative is None:
        yield (
            u.line,
            f"{v.name!r} is among the derivatives, but its attribute derivative, which names the state, is missing",
        )
    elif state is None:
        yield v.line, f"{v.name!r} derives {_key(m)} {v.derivative}, which belongs to no variable"
    elif not state.is_float or state.variability != "continuous":
        yield (
            state.line,
            f"{state.name!r} is a continuous state, as {v.name!r} says, but is {state.variability} {state.type}",
        )
    elif state.size != v.size:
        yield v.line, f"{v.name!r} has {v.size} elements, the state {state.name!r} {state.size}"
    elif state is v:
        yield v.line, f"{v.name!r} is its own derivative"


def _unknowns_of_initialization(m: Model) -> Found:
    derivatives = m.listed("Derivative")
    continuous = [v for v in dict.fromkeys((*m.states, *derivatives)) if v.initial in ("approx", "calculated")]
    calculated = [
        v
        for v in m.of("output", "calculatedParameter")
        if v.initial in ("approx", "calculated") and not v.clocked and v.type != "Clock"
    ]
    listed = {u.key for u in m.structure if u.group == "InitialUnknown"}
    # Of an alias set one entry may stand for all, but a derivative has its own.
    there = {m.by_key[k].key for k in listed if k in m.by_key}
    element = "InitialUnknowns" if m.version == "2" else "InitialUnknown elements"
    for group, ignored in ((calculated, False), ([v for v in continuous if v not in calculated], not _counts(m))):
        missing = list(
            dict.fromkeys(v.name for v in group if m.key(v) not in listed and (v.key not in there or v in derivatives))
        )
        if missing:
            text = (
                f"{names(missing)} {'are' if len(missing) > 1 else 'is'} calculated in initialization, but not among"
                f" the {element}"
            )
            # "For Co-Simulation, Derivatives are ignored if providesDirectionalDerivative is false."
            yield warning(f"{text}; importers ignore the derivatives of this Co-Simulation FMU") if ignored else text
    calculated += continuous
    if m.version == "2":
        may = {m.key(v) for v in calculated}
        listed_too = (v for u, v in m.unknowns("InitialUnknown") if u.key not in may)
        found = [v.name for v in listed_too if v.causality in ("output", "local")]
        if found:
            is_ = "are" if len(found) > 1 else "is"
            yield warning(
                f"{names(found)} {is_} among the InitialUnknowns, but not an output, parameter, state or derivative"
                " calculated in initialization"
            )


def _shown(m: Model, group: str) -> str:
    if m.version == "2":
        return {"Output": "Outputs", "Derivative": "Derivatives", "InitialUnknown": "InitialUnknowns"}.get(group, group)
    return {"Derivative": "ContinuousStateDerivative"}.get(group, group)


def _key(m: Model) -> str:
    return "index" if m.version == "2" else "value reference"


@file_check(
    "description.dependencies",
    "declared dependencies refer to valid knowns, each with its kind",
    fmi2="2.2.8 Definition of the Model Structure (dependencies)",
    fmi3="2.4.8 Model Structure (dependencies)",
    advice=(
        "List the knowns only (inputs, states, the independent variable; for initialization also what is exact), with"
        " one kind for each."
    ),
)
def dependencies(file: File) -> Found:
    m = file.model
    states = {m.key(s) for s in m.states}
    for u in m.structure:
        v = m.by_key.get(u.key)  # type: ignore[arg-type]
        name = v.name if v else f"{_key(m)} {u.key}"
        if u.kinds is not None and u.depends is None:
            yield u.line, f"{name!r} has dependenciesKind, but no dependencies"
        elif u.kinds is not None and u.depends is not None and len(u.kinds) != len(u.depends):
            yield u.line, f"{name!r} has {len(u.depends)} dependencies, but {len(u.kinds)} dependenciesKind"
        unknown = [d for d in u.depends or () if d not in m.by_key]
        if unknown:
            yield u.line, f"{name!r} depends on {_key(m)} {unknown[0]}, which belongs to no variable"
        if len(set(u.depends or ())) != len(u.depends or ()):
            yield warning(f"{name!r} has a dependency twice", u.line)
        for d in u.depends or ():
            known = m.by_key.get(d)
            if known is None or d in states or known.causality in ("input", "independent") or known.clocked:
                continue
            if u.group == "InitialUnknown":
                if known.initial == "calculated" and known.causality not in ("output", "local"):
                    yield (
                        u.line,
                        f"{name!r} depends on {known.name!r} in initialization, which is itself calculated there",
                    )
                continue
            tunable = known.causality in ("parameter", "structuralParameter") and known.variability == "tunable"
            if m.version == "3" and (tunable or u.group == "ClockedState"):
                continue
            if known.type == "Clock" or known.variability == "discrete":
                continue
            text = (
                f"{name!r} depends on {known.name!r}, a {known.variability} {known.causality}, which is not a known"
                " there"
            )
            yield warning(text, u.line)
            break
