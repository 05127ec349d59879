"""What is wired when two terminals are connected, by the rules of FMI 3.0 (2.4.9.2), and what does not fit.

| rule | variables match by | connected |
|---|---|---|
| `plug` | name | only if both sides have all of them |
| `bus` | name | those that both sides have |
| `sequence` | their order | only if both sides have as many |

A plug may be connected to a bus that has all its variables. Two terminals by FMI-LS-BUS (`org.fmi-ls-bus.transceiver`)
are connected crosswise: `Tx_Data` and `Tx_Clock` of each to `Rx_Data` and `Rx_Clock` of the other. The rule is about
one level: terminals within terminals are connected by their own rules where both sides have one of that name.
"""

from __future__ import annotations

import warnings
from collections.abc import Iterator
from dataclasses import dataclass

from build_fmus.base.checks import did_you_mean
from cosim.core.errors import FmuError, FmuWarning, WiringError
from cosim.core.terminals import (
    BUS,
    FLOWS,
    KINDS,
    PLUG,
    RULES,
    SEQUENCE,
    TRANSCEIVER,
    Terminal,
    TerminalMember,
    by_names,
    by_path,
    expanded,
)
from cosim.fmu.component import FmuComponent
from cosim.system.components import SystemComponent, article
from cosim.system.names import SystemComponents


@dataclass(frozen=True)
class Place:
    """A terminal of a component."""

    component: SystemComponent
    terminal: Terminal

    def __str__(self) -> str:
        return f"{self.component.name}.{self.terminal.path}"


@dataclass(frozen=True)
class Wire:
    """Two variables to be connected.

    `labels`: their names in the terminals; `at`: these, for messages. `flow`: they are flows, which add up to zero;
    `negated`: both sides count what flows toward them, or both what flows away.
    """

    source: SystemComponent
    output: str
    target: SystemComponent
    input: str
    at: str
    labels: tuple[str, ...]
    flow: bool = False
    negated: bool = False


def of(component: SystemComponent, *, tolerant: bool = False) -> dict[str, Terminal]:
    """The terminals of a component by path: those that it declares, else those by the structure of its names.

    Raises FmuError for a malformed terminals file; if `tolerant` that is a warning, and names count.
    """
    declared: tuple[Terminal, ...] = ()
    if isinstance(component.implementation, FmuComponent):
        try:
            declared = component.implementation.fmu.terminals
        except FmuError as error:
            if not tolerant:
                raise
            warnings.warn(f"{error}; terminals follow from the names of variables instead", FmuWarning, stacklevel=4)
    return by_path(declared or by_names(component.description))


def find(components: SystemComponents, full: str) -> Place:
    """`component.terminal`, with the names of the terminals around it. Raises WiringError with the nearest name."""
    name, path = components.parts(full)
    if name == full:
        raise WiringError(f"'{full}': write component.terminal")
    component = components[name]
    there = of(component)
    if path not in there:
        listed = (
            f"; it has {', '.join(list(there)[:12])}{', ...' if len(there) > 12 else ''}" if there else "; it has none"
        )
        raise WiringError(f"component '{name}' has no terminal '{path}'{did_you_mean(path, there) or listed}")
    return Place(component, there[path])


def wires(first: Place, second: Place, *, nested: bool = True) -> Iterator[Wire]:
    """Connections between two terminals of different components, in both directions.

    If `nested`, terminals in them are included. Raises WiringError naming variables that do not fit.
    """
    at = f"terminals {first} and {second}"
    if first.component is second.component:
        raise WiringError(f"{at}: both are of component '{first.component.name}'")
    a, b = first.terminal, second.terminal
    if a.kind and b.kind and a.kind != b.kind:
        raise WiringError(f"{at}: their kinds differ, {a.kind!r} and {b.kind!r}")
    if a.rule == b.rule == TRANSCEIVER:
        yield from _crosswise(first, second, at)
        yield from _crosswise(second, first, at)
    for one, other in _matches(a, b, at) if {a.rule, b.rule} != {TRANSCEIVER} else ():
        yield from _wire(first, second, one, other, at, strict=BUS not in (a.rule, b.rule))
    yield from _streams(first, second, at)
    there = {t.path.rsplit(".", 1)[-1]: t for t in b.nested}
    for inner in a.nested if nested else ():
        if (name := inner.path.rsplit(".", 1)[-1]) in there:
            yield from wires(Place(first.component, inner), Place(second.component, there[name]))


def common(source: SystemComponent, target: SystemComponent) -> list[tuple[Place, Place]]:
    """Terminals that two components both have by name, and whose kinds and rules are compatible, those in others too.

    None if neither component declares any: the names of their variables give the same result.
    """
    ours, theirs = of(source, tolerant=True), of(target, tolerant=True)
    if not any(t.declared for t in (*ours.values(), *theirs.values())):
        return []
    return [
        (Place(source, t), Place(target, theirs[path]))
        for path, t in ours.items()
        if path in theirs and _may_meet(t, theirs[path])
    ]


def _may_meet(a: Terminal, b: Terminal) -> bool:
    known = {a.rule, b.rule} <= set(RULES) or a.rule == b.rule == TRANSCEIVER
    return known and (not a.kind or not b.kind or a.kind == b.kind)


def _crosswise(first: Place, second: Place, at: str) -> Iterator[Wire]:
    """What the first bus node transmits is what the second one receives."""
    ours, theirs = ({m.name: m.variables[0] for m in p.terminal.members} for p in (first, second))
    for what in ("Data", "Clock"):
        for place, own, name in ((first, ours, f"Tx_{what}"), (second, theirs, f"Rx_{what}")):
            if name not in own:
                raise WiringError(f"{at}: {place} lacks {name!r}, which a terminal of a bus node has")
        labels = (f"{first.terminal.path}.Tx_{what}", f"{second.terminal.path}.Rx_{what}")
        yield Wire(first.component, ours[f"Tx_{what}"], second.component, theirs[f"Rx_{what}"], at, labels)


def _matches(a: Terminal, b: Terminal, at: str) -> list[tuple[TerminalMember, TerminalMember]]:
    """Pairs of variables that the rule connects."""
    for terminal in (a, b):
        if terminal.rule not in RULES:
            raise WiringError(
                f"{at}: the matching rule {terminal.rule!r} is not supported; supported are {', '.join(RULES)}"
            )
    if (a.rule == SEQUENCE) != (b.rule == SEQUENCE):
        raise WiringError(f"{at}: their matching rules differ, {a.rule!r} and {b.rule!r}")
    if a.rule == SEQUENCE:
        if len(a.members) != len(b.members):
            raise WiringError(f"{at}: a sequence of {len(a.members)} variables and one of {len(b.members)}")
        pairs = []
        for i, (one, other) in enumerate(zip(a.members, b.members, strict=True), start=1):
            if len(one.variables) != len(other.variables):
                raise WiringError(
                    f"{at}: variables number {i} have {len(one.variables)} and {len(other.variables)} elements"
                )
            pairs += list(zip(expanded((one,)), expanded((other,)), strict=True))
        return pairs
    ours, theirs = ({m.name: m for m in expanded(t.members)} for t in (a, b))
    for rule, own, there, whose in ((a.rule, ours, theirs, "second"), (b.rule, theirs, ours, "first")):
        missing = [name for name in own if name not in there]
        if rule == PLUG and missing:
            raise WiringError(
                f"{at}: a plug needs all its variables, and the {whose} lacks {', '.join(map(repr, missing[:5]))}"
            )
    return [(m, theirs[name]) for name, m in ours.items() if name in theirs]


def _wire(
    first: Place, second: Place, one: TerminalMember, other: TerminalMember, at: str, *, strict: bool
) -> Iterator[Wire]:
    """The connection of two variables, from the output to the input. Parameters are not wired."""
    (name,), (opposite,) = one.variables, other.variables
    kinds = [p.component.description.variables[v].causality for p, v in ((first, name), (second, opposite))]
    if any("arameter" in kind for kind in kinds):
        return
    what = f"{at}: variable {one.name or other.name or name!r}"
    for m in (one, other):
        if m.kind not in KINDS:
            raise WiringError(
                f"{what} is of the kind {m.kind!r}, which is not supported; supported are {', '.join(KINDS)}"
            )
    flow = one.kind in FLOWS
    if flow != (other.kind in FLOWS):
        raise WiringError(f"{what} is {article(one.kind)} on one side and {article(other.kind)} on the other")
    if sorted(kinds) != ["input", "output"]:
        if strict:
            sides = f"{article(kinds[0])} on one side and {article(kinds[1])} on the other"
            raise WiringError(f"{what} is {sides}; one must be an output and one an input")
        return
    ends = [(first, name, one), (second, opposite, other)]
    (source, output, _), (target, input_, _) = ends if kinds[0] == "output" else ends[::-1]
    labels = tuple(f"{p.terminal.path}.{m.name}" for p, _, m in ends if m.name)
    yield Wire(source.component, output, target.component, input_, at, labels, flow, flow and one.kind == other.kind)


def _streams(first: Place, second: Place, at: str) -> Iterator[Wire]:
    """What leaves one side with the flow enters the other, where two terminals are connected."""
    ours, theirs = ({(s.entering.name, s.leaving.name): s for s in p.terminal.streams} for p in (first, second))
    if ours.keys() != theirs.keys() and BUS not in (first.terminal.rule, second.terminal.rule):
        odd = sorted(name for _, name in ours.keys() ^ theirs.keys())
        raise WiringError(f"{at}: only one of them has the stream {odd[0]!r}")
    for key in [k for k in ours if k in theirs]:
        for source, leaving, target, entering in (
            (first, ours[key].leaving, second, theirs[key].entering),
            (second, theirs[key].leaving, first, ours[key].entering),
        ):
            if len(leaving.variables) != len(entering.variables):
                sizes = f"{len(leaving.variables)} and {len(entering.variables)} elements"
                raise WiringError(f"{at}: the two sides of stream {leaving.name!r} have {sizes}")
            labels = (f"{source.terminal.path}.{leaving.name}", f"{target.terminal.path}.{entering.name}")
            for o, i in zip(leaving.variables, entering.variables, strict=True):
                yield Wire(source.component, o, target.component, i, at, labels)


def names(terminal: Terminal) -> Iterator[str]:
    """Names that patterns are compared with: `terminal.name` in the terminal, and the variables' own names."""
    for m in (*expanded(terminal.members), *(m for s in terminal.streams for m in (s.entering, s.leaving))):
        yield f"{terminal.path}.{m.name}"
        yield from m.variables
