"""Traces signals through nested systems and signal dictionaries: the source of each input, and changes on the way.

A place is a connector of an element, by the path of systems to it, or an entry of a signal dictionary; of arrays each
element by itself. At most one connection leads to a place. The kinds of the connectors say which end is the source.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass, field

from build_fmus.base.checks import did_you_mean
from build_fmus.base.units import Unit, UnitMismatchError, conversion
from cosim.core.errors import SspError
from cosim.ssp.structure import Connection, Connector, Element, End, Reference, System, Transformation

Path = tuple[str, ...]
_GIVES = ("output", "calculatedParameter", "local", "constant")
_TAKES = ("input", "parameter", "structuralParameter")


@dataclass(frozen=True)
class Place:
    """An element of a connector; `inside`: a signal dictionary of the system at `path`, whose entry it is."""

    path: Path
    connector: str
    indices: tuple[int, ...] = ()
    inside: str = ""

    def __str__(self) -> str:
        index = f"[{','.join(map(str, self.indices))}]" if self.indices else ""
        return ".".join((*self.path, *((self.inside,) if self.inside else ()), self.connector)) + index


@dataclass(frozen=True)
class Step:
    """A connection on a signal's way."""

    connection: Connection
    source: Connector
    target: Connector


@dataclass
class Signals:
    """All connections of a structure: what leads to each place, and the connectors by place."""

    title: str
    leads: dict[Place, tuple[Place, Step]] = field(default_factory=dict)
    kinds: dict[Place, Connector] = field(default_factory=dict)

    def way(self, to: Place) -> tuple[Place, list[Step]]:
        """Where a place's value comes from, and the connections on the way, from there on."""
        steps: list[Step] = []
        seen = {to}
        at = to
        while at in self.leads:
            at, step = self.leads[at]
            if at in seen:
                raise SspError(f"{self.title}: the value of {to} comes from itself, by way of {at}")
            seen.add(at)
            steps.append(step)
        return at, steps[::-1]


def trace(top: System, title: str) -> Signals:
    """Everything that connections of a system and of those in it say. Raises SspError."""
    found = Signals(title)
    _trace(top, (), ((top, ()),), found, title)
    return found


def _trace(system: System, path: Path, around: tuple[tuple[System, Path], ...], found: Signals, title: str) -> None:
    for connector in system.connectors.values():
        for place in _places(path, connector, ""):
            found.kinds[place] = connector
    for e in system.elements.values():
        if isinstance(e, System):
            _trace(e, (*path, e.name), (*around, (e, (*path, e.name))), found, title)
        else:
            for connector in e.connectors.values():
                for place in _places((*path, e.name), connector, ""):
                    found.kinds[place] = connector
    for connection in system.connections:
        _connect(connection, system, path, around, found, title)


def _connect(
    c: Connection, system: System, path: Path, around: tuple[tuple[System, Path], ...], found: Signals, title: str
) -> None:
    here = f"{title}, line {c.line}: {c.start} to {c.end}"
    ends = [_end(end, system, path, around, here) for end in (c.start, c.end)]
    gives = [_gives(connector, own=not end.element) for (connector, _), end in zip(ends, (c.start, c.end), strict=True)]
    if gives[0] is not None and gives[0] == gives[1]:
        words = "give a value" if gives[0] else "take a value"
        kinds = " and ".join(connector.kind for connector, _ in ends)
        raise SspError(f"{here}: both ends {words} ({kinds})")
    (source, sources), (target, targets) = (
        ends if gives[0] or gives[1] is False or gives == [None, None] else ends[::-1]
    )
    if len(sources) != len(targets):
        raise SspError(f"{here}: {len(sources)} element(s) to {len(targets)}")
    for a, b in zip(sources, targets, strict=True):
        if b in found.leads:
            raise SspError(f"{here}: {b} already has its value from {found.leads[b][0]}")
        found.leads[b] = a, Step(c, source, target)


def _gives(connector: Connector, *, own: bool) -> bool | None:
    """Whether a connection takes a value from here; None for either.

    The inputs of a system are sources inside it.
    """
    if connector.kind in _GIVES:
        return not own
    return own if connector.kind in _TAKES else None


def _end(
    end: End, system: System, path: Path, around: tuple[tuple[System, Path], ...], here: str
) -> tuple[Connector, list[Place]]:
    """The connector at one end of a connection, and its places."""
    owner: Element = system
    at, inside = path, ""
    if end.element:
        if end.element not in system.elements:
            raise SspError(f"{here}: there is no element '{end.element}'{did_you_mean(end.element, system.elements)}")
        owner = system.elements[end.element]
        at = (*path, end.element)
    connector = owner.connectors.get(end.connector)
    if connector is None:
        whose = f"'{end.element}'" if end.element else "the system"
        raise SspError(
            f"{here}: {whose} has no connector '{end.connector}'{did_you_mean(end.connector, owner.connectors)}"
        )
    if isinstance(owner, Reference):
        connector, at, inside = _entry(owner, connector, around, here)
    places = _places(at, connector, inside)
    if end.indices:
        places = [p for p in places if p.indices == end.indices]
        if not places:
            raise SspError(f"{here}: {end} has no element {' '.join(map(str, end.indices))}")
    return connector, places


def _entry(
    reference: Reference, connector: Connector, around: tuple[tuple[System, Path], ...], here: str
) -> tuple[Connector, Path, str]:
    """The entry of a signal dictionary that a reference's connector stands for, in the nearest system that has one."""
    for system, path in reversed(around):
        entries = system.dictionaries.get(reference.dictionary)
        if entries is None:
            continue
        if connector.name not in entries:
            raise SspError(
                f"{here}: the signal dictionary '{reference.dictionary}' has no entry"
                f" '{connector.name}'{did_you_mean(connector.name, entries)}"
            )
        entry = entries[connector.name]
        made = Connector(entry.name, connector.kind, entry.type, entry.unit or connector.unit, entry.items, entry.shape)
        return made, path, reference.dictionary
    raise SspError(f"{here}: there is no signal dictionary '{reference.dictionary}'")


def _places(path: Path, connector: Connector, inside: str) -> list[Place]:
    """One place, or one for each element of an array, row-major."""
    if not connector.shape:
        return [Place(path, connector.name, (), inside)]
    indices = itertools.product(*(range(1, n + 1) for n in connector.shape))
    return [Place(path, connector.name, i, inside) for i in indices]


@dataclass(frozen=True)
class Change:
    """What becomes of a value on its way: factor and offset, then, of integers, a table."""

    factor: float = 1.0
    offset: float = 0.0
    table: tuple[tuple[int, int], ...] = ()


def change(steps: list[Step], first: Unit | None, last: Unit | None, relative: bool, title: str) -> Change | None:
    """Unit conversions and transformations one after the other.

    None if the only change is the conversion of the first unit into the last. Raises SspError for units and
    transformations that do not match.
    """
    if all(s.connection.transformation is None and not s.connection.suppress for s in steps):
        units = [u for u in (first, *(s.target.unit for s in steps[:-1]), last) if u is not None]
        for a, b in itertools.pairwise(units):
            _converted(a, b, relative, title, steps)
        return None
    total, unit = Change(), first
    for s in steps:
        following = last if s is steps[-1] and last is not None else s.target.unit
        if not s.connection.suppress:
            factor, offset = _converted(unit, following, relative, title, steps)
            total = _after(total, factor, offset)
        unit = following or unit
        t = s.connection.transformation
        if t is not None:
            total = _transformed(total, t, s, f"{title}, line {s.connection.line}")
    return total


def _converted(a: Unit | None, b: Unit | None, relative: bool, title: str, steps: list[Step]) -> tuple[float, float]:
    try:
        return conversion(a, b, relative)
    except UnitMismatchError as error:
        names = f"[{a.name if a else ''}] to [{b.name if b else ''}]"
        line = f", line {steps[-1].connection.line}" if steps else ""
        raise SspError(f"{title}{line}: units differ, {names}: {error}") from None


def _after(c: Change, factor: float, offset: float) -> Change:
    if (factor, offset) == (1.0, 0.0):
        return c
    if c.table:
        raise SspError("a number is converted after a mapping of integers, which cosim does not support")
    return Change(factor * c.factor, factor * c.offset + offset)


def _transformed(c: Change, t: Transformation, step: Step, here: str) -> Change:
    if t.kind == "Linear":
        return _after(c, t.factor, t.offset)
    if t.kind == "BooleanMapping":
        if len(t.table) < 2:
            (known,) = t.table
            raise SspError(f"{here}: the mapping defines {str(known).lower()}, but not {str(not known).lower()}")
        low, high = float(t.table[False]), float(t.table[True])
        return _after(c, high - low, low)
    table = t.table if t.kind == "IntegerMapping" else _by_items(t.table, step, here)
    if (c.factor, c.offset) != (1.0, 0.0):
        raise SspError(f"{here}: integers are mapped after a conversion, which cosim does not support")
    if c.table:
        return Change(table=tuple((a, table[b]) for a, b in c.table if b in table))
    return Change(table=tuple(sorted(table.items())))


def _by_items(table: dict[str, str], step: Step, here: str) -> dict[int, int]:
    """A mapping of items as one of their values; the connectors say which."""
    found = {}
    for name, connector, texts in (("start", step.source, list(table)), ("end", step.target, list(table.values()))):
        if connector.items is None:
            raise SspError(
                f"{here}: the {name} of the connection is not an Enumeration defined in the file, so its items have"
                " no values"
            )
        missing = [x for x in texts if x not in connector.items]
        if missing:
            raise SspError(
                f"{here}: '{missing[0]}' is not an item of the {name}'s"
                f" enumeration{did_you_mean(missing[0], connector.items)}"
            )
    assert step.source.items is not None
    assert step.target.items is not None
    for a, b in table.items():
        found[step.source.items[a]] = step.target.items[b]
    return found
