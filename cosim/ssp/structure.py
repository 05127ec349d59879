"""Content of the files of an SSP: systems, components, connectors, connections, parameter sets.

Nested descriptions and packages are in their places. This module does not use FMUs.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from fractions import Fraction
from pathlib import Path
from typing import Any

from build_fmus.base.units import Unit


@dataclass(frozen=True)
class Transformation:
    """Linear (factor, offset), or a table of Booleans, integers or names of items."""

    kind: str
    factor: float = 1.0
    offset: float = 0.0
    table: dict[Any, Any] = field(default_factory=dict)


@dataclass(frozen=True)
class Connector:
    """A connector of an element: a named input, output or parameter."""

    name: str
    kind: str
    type: str = ""  # "" where the file says none
    unit: Unit | None = None
    items: dict[str, int] | None = None  # of an enumeration
    shape: tuple[int, ...] = ()


@dataclass(frozen=True)
class End:
    """One end of a connection: an element's connector, or (element "") the system's own."""

    element: str
    connector: str
    indices: tuple[int, ...] = ()

    def __str__(self) -> str:
        return f"{self.element}.{self.connector}" if self.element else self.connector


@dataclass(frozen=True)
class Connection:
    """A connection from one connector to another, with its transformation and the settings of this project."""

    start: End
    end: End
    line: int
    transformation: Transformation | None = None
    suppress: bool = False
    delay: bool = False
    extrapolate: bool = False
    max_size: int | None = None  # bytes of a text


@dataclass(frozen=True)
class Value:
    """One parameter of a parameter set, as its binding applies it to `name`."""

    name: str
    type: str
    texts: tuple[str, ...]
    unit: Unit | None = None
    transformation: Transformation | None = None
    suppress: bool = False


@dataclass
class Element:
    """An element of a system: its connectors and the values that its bindings set."""

    name: str
    connectors: dict[str, Connector]
    values: list[list[Value]]  # of each binding, in their order


@dataclass
class Component(Element):
    """A component: an FMU in a system."""

    fmu: Path
    interface: str | None = None  # "cs", "me", or either
    hint: Fraction | None = None  # for its step [s]
    own: dict[str, str] = field(default_factory=dict)  # what our annotation says
    initial: frozenset[str] = frozenset()  # values that are there for other tools


@dataclass
class Reference(Element):
    """A signal dictionary reference: an element that stands for a dictionary of the system or of one around it."""

    dictionary: str


@dataclass
class System(Element):
    """A system with its elements, connections and signal dictionaries."""

    elements: dict[str, Element]
    connections: list[Connection]
    dictionaries: dict[str, dict[str, Connector]]
    step: Fraction | None = None  # of its components [s]
    groups: list[tuple[str, str, tuple[str, ...]]] = field(default_factory=list)  # name, method, components

    def components(self) -> Iterator[tuple[tuple[str, ...], Component]]:
        """All in it, with their paths."""
        for e in self.elements.values():
            if isinstance(e, Component):
                yield (e.name,), e
            elif isinstance(e, System):
                for path, c in e.components():
                    yield (e.name, *path), c


@dataclass(frozen=True)
class Structure:
    """A description of structure, with all that is nested in it."""

    name: str
    system: System
    start_time: Fraction
    stop_time: Fraction | None
