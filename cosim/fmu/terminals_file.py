"""Reads terminalsAndIcons/terminalsAndIcons.xml of an FMI 3.0 FMU into `Terminal`s.

The file is validated; the size limits are those of a modelDescription.xml.
"""

from __future__ import annotations

from typing import Any

from build_fmus.base.checks import did_you_mean, one_line
from cosim.core.description import Description
from cosim.core.errors import FmuError
from cosim.core.terminals import BUS, DEEPEST, PLUG, Stream, Terminal, TerminalMember
from cosim.fmu.limits import Limits
from cosim.fmu.xml import tree

FILE = "terminalsAndIcons/terminalsAndIcons.xml"


def read(xml: bytes, where: str, about: Description, limits: Limits) -> tuple[Terminal, ...]:
    """Read the terminals that the file declares.

    Raises FmuError naming file, line and terminal for a malformed file.
    """
    root = tree(xml, where, limits, FILE)
    return tuple(_Reader(where, about).terminals(root.iterfind("Terminals/Terminal"), ()))


class _Reader:
    def __init__(self, where: str, about: Description):
        self.where = where
        self.about = about

    def refused(self, element: Any, what: str) -> FmuError:
        return FmuError(f"{self.where}: {FILE}, line {element.sourceline}: {what}")

    def terminals(self, elements: Any, around: tuple[str, ...]) -> list[Terminal]:
        """Those of one level."""
        made: dict[str, Terminal] = {}
        for element in elements:
            name = self.attribute(element, "name")
            if name in made:
                raise self.refused(element, f"terminal {_quoted(name)} is defined twice")
            if len(around) >= DEEPEST:
                raise self.refused(element, f"terminals are nested more than {DEEPEST} deep")
            made[name] = self.terminal(element, (*around, name))
        return list(made.values())

    def terminal(self, element: Any, path: tuple[str, ...]) -> Terminal:
        rule, name = self.attribute(element, "matchingRule"), ".".join(path)
        members = []
        for member in element.iterfind("TerminalMemberVariable"):
            variable = self.attribute(member, "variableName")
            own = member.get("memberName") or ("" if rule not in (BUS, PLUG) else self.attribute(member, "memberName"))
            members.append(
                TerminalMember(own, self.variables(member, variable), self.attribute(member, "variableKind"))
            )
        streams = []
        for stream in element.iterfind("TerminalStreamMemberVariable"):
            pair = [
                TerminalMember(
                    self.attribute(stream, f"{side}StreamMemberName"),
                    self.variables(stream, self.attribute(stream, f"{side}StreamVariableName")),
                )
                for side in ("in", "out")
            ]
            streams.append(Stream(*pair))
        names = [m.name for m in members if m.name] + [n for s in streams for n in (s.entering.name, s.leaving.name)]
        if len(set(names)) < len(names):
            twice = next(n for k, n in enumerate(sorted(names)[1:]) if sorted(names)[k] == n)
            raise self.refused(element, f"terminal {_quoted(name)} has two variables {_quoted(twice)}")
        nested = self.terminals(element.iterfind("Terminal"), path)
        return Terminal(name, rule, element.get("terminalKind", ""), tuple(members), tuple(streams), tuple(nested))

    def attribute(self, element: Any, name: str) -> str:
        text: str | None = element.get(name)
        if not text:
            raise self.refused(element, f"a {element.tag} without {name}")
        return text

    def variables(self, element: Any, name: str) -> tuple[str, ...]:
        """The names of a variable, or of all elements of an array."""
        about = self.about
        name = about.canonical(name)
        if name in about.variables:
            return (name,)
        if name in about.arrays and about.variables[about.arrays[name][0]].declared == name:
            return tuple(about.arrays[name])
        raise self.refused(element, f"there is no variable {_quoted(name)}{did_you_mean(name, about.variables)}")


def _quoted(text: str) -> str:
    return repr(one_line(text, 80))
