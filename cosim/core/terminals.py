"""Terminals: what of a component belongs together, so that one connection wires it (FMI 3.0, 2.4.9.2)."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

from build_fmus.base.quantities import place
from cosim.core.description import Description, split_index

BUS, PLUG, SEQUENCE = "bus", "plug", "sequence"
RULES = (PLUG, BUS, SEQUENCE)
TRANSCEIVER = "org.fmi-ls-bus.transceiver"  # FMI-LS-BUS: each side receives what the other one transmits
FLOWS = ("inflow", "outflow")  # kinds of variables that add up to zero where terminals are connected
KINDS = ("signal", *FLOWS)
DEEPEST = 16  # terminals within each other


@dataclass(frozen=True)
class TerminalMember:
    """A variable of a terminal, by the name that counts for matching: its own, or those of all elements of an array.

    Elements are row major. `kind`: "signal", "inflow" or "outflow", or a value that another standard defines.
    """

    name: str
    variables: tuple[str, ...]
    kind: str = "signal"


@dataclass(frozen=True)
class Stream:
    """A quantity that the terminal's flow carries, leaving and entering, by the names that count for matching."""

    entering: TerminalMember
    leaving: TerminalMember


@dataclass(frozen=True)
class Terminal:
    """A terminal of an FMU.

    `path`: its name, after those of the terminals that it is in (`road.fl`). `rule` says how variables match: "plug",
    "bus", "sequence", or a value that another standard defines; `kind` is of a domain, and may be empty. `declared`:
    the FMU declares it; otherwise the names of variables do.
    """

    path: str
    rule: str
    kind: str = ""
    members: tuple[TerminalMember, ...] = ()
    streams: tuple[Stream, ...] = ()
    nested: tuple[Terminal, ...] = ()
    declared: bool = True

    def all(self) -> Iterator[Terminal]:
        """It and all that are in it."""
        yield self
        for terminal in self.nested:
            yield from terminal.all()


def by_path(terminals: tuple[Terminal, ...]) -> dict[str, Terminal]:
    """Terminals, and those in them, by their paths."""
    return {t.path: t for terminal in reversed(terminals) for t in terminal.all()}


def by_names(about: Description) -> tuple[Terminal, ...]:
    """The terminals of a component that declares none: inputs and outputs by the structure of their names, each a bus.

    The FMUs of this project declare the same terminals in FMI 3.0 (FMI 2.0 has no terminals). Names of more than
    `DEEPEST` parts are left out.
    """
    members: dict[tuple[str, ...], dict[str, TerminalMember]] = {}
    within: dict[tuple[str, ...], list[tuple[str, ...]]] = {}
    for name in (*about.inputs, *about.outputs):
        path, own = place(name)
        if len(path) > DEEPEST:
            continue
        for length in range(1, len(path) + 1):
            if path[:length] not in members:
                members[path[:length]] = {}
                within.setdefault(path[: length - 1], []).append(path[:length])
        members[path].setdefault(own, TerminalMember(own, (name,)))

    def made(path: tuple[str, ...]) -> Terminal:
        inner = tuple(made(p) for p in within.get(path, ()))
        return Terminal(".".join(path), BUS, members=tuple(members[path].values()), nested=inner, declared=False)

    return tuple(made(path) for path in within.get((), ()))


def expanded(members: tuple[TerminalMember, ...]) -> tuple[TerminalMember, ...]:
    """Arrays as their elements, `fl` as `fl[1]`, `fl[2]`, ..., which match elements that are declared as scalars."""
    return tuple(
        TerminalMember(
            m.name + variable[len(split_index(variable)[0]) :] if len(m.variables) > 1 else m.name, (variable,), m.kind
        )
        for m in members
        for variable in m.variables
    )
