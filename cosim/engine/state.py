"""Saved states: of a simulation that continues, and on their way to another process or another day.

A live state holds what the components themselves saved; it belongs to their instances. As bytes (`to_bytes`, `write`,
pickle) it holds what they serialize then, the exchanged values by name, the exact time, and what tells systems apart:
components with their FMUs, rates, wiring. When an instance ends, its live states become bytes.
"""

from __future__ import annotations

import os
import re
import weakref
from collections.abc import Mapping, Sequence
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass, field
from fractions import Fraction
from functools import cached_property
from pathlib import Path
from typing import Any, NoReturn

import numpy as np

from build_fmus.base import safe_files
from cosim.core import packing
from cosim.core.component import Array, Portable
from cosim.core.errors import CosimError
from cosim.core.interrupt import held
from cosim.core.time import LONGEST, MOST_TICKS, TimeBase
from cosim.engine.adaptive import State as AdaptiveState
from cosim.engine.clock import Clock
from cosim.engine.exchange import Ending, Exchange, Phase
from cosim.engine.values import Key
from cosim.fmu.saved_states import SavedStates
from cosim.system.components import SystemComponent
from cosim.system.schedule import Schedule

MAGIC = b"state of a co-simulation, version 1\n"
_PARTS = ("visible", "latest", "previous", "sample_time", "constant")
_PHASES = {"arrived": Phase.ARRIVED, "sampled": Phase.SAMPLED}
_FRACTION = re.compile(r"-?\d{1,40}(/\d{1,40})?")
_CONTROL = re.compile(r"[\x00-\x1f\x7f-\x9f]")
LONGEST_TEXT = 2**20  # of names in a state
Wiring = dict[str, Any]


@dataclass(frozen=True)
class Packed:
    """A component's state away from its instance. `identity` says of which component, `data` is the state."""

    identity: Mapping[str, str]
    data: bytes


@dataclass(eq=False)
class SystemState:
    """A saved state of a simulation at `time` [s], made by `Simulation.save`; to be used any number of times.

    Give it to `Simulation.restore` of the same simulation, or to `System.initialize(state=...)` of the same system,
    whose wiring may have changed. Pickled, or written to a file (`write`, `read`), it also continues in other
    processes, in a system that is put together in the same way; all components must be able to serialize their states
    then. `components` holds the state of each component: a component that is deleted there begins afresh.
    """

    tick: int
    phase: Phase
    base: TimeBase
    values: Array
    keys: Sequence[Key]
    individual: dict[str, Any]  # states of the components that are not in `joint`, by name
    wiring: Wiring
    joint: SavedStates | None = None  # states of FMUs that were saved by one call
    samples: int = 0
    ending: Ending | None = None
    steps: AdaptiveState | None = None  # of a run with a tolerance
    instances: Mapping[str, SystemComponent] = field(
        default_factory=dict, repr=False
    )  # whose instances hold it; none when it traveled
    owner: weakref.ref[Exchange] | None = field(default=None, repr=False)
    lock: AbstractContextManager[Any] = field(default_factory=nullcontext, repr=False)  # for calls of the components

    @cached_property
    def components(self) -> dict[str, Any]:
        """The state of each component, in their order."""
        found = self.individual if self.joint is None else {**self.individual, **self.joint.by_name()}
        return {name: found[name] for name in self.wiring["components"] if name in found}

    @property
    def time(self) -> float:
        """Time of the state [s]."""
        return self.base.seconds(self.tick)

    def clock(self, name: str) -> Clock:
        """When a component was due, in ticks of `base`."""
        _, step, offset = self.wiring["components"][name]
        return Clock(self.base.count(Fraction(step)), self.base.count(Fraction(offset)))

    def continues(self, schedule: Schedule) -> bool:
        """Whether a system of this schedule continues as if never interrupted.

        All components, rates and connections must be those of the state.
        """
        return len(self.components) == len(schedule.components) and self.wiring == wiring_of(schedule)

    # As bytes.

    def to_bytes(self) -> bytes:
        """The state as bytes, for other processes; see `read`.

        In another thread (process pools pickle in a thread of their own) it waits while the simulation calls its
        components. Raises CosimError naming the components that cannot serialize their states, and why.
        """
        if self.steps is not None:
            raise CosimError("a state of a run with a tolerance cannot leave its process")
        packed, unable = {}, []
        with self.lock, held():
            for name, saved in self.components.items():
                try:
                    packed[name] = saved if isinstance(saved, Packed) else _packed(self.instances[name], saved)
                except CosimError as error:
                    unable.append(f"'{name}': {error}")
        if unable:
            raise CosimError(f"this state cannot leave its process, because of {'; '.join(unable)}")
        description = {
            "tick": self.tick,
            "phase": self.phase.name.lower(),
            "ending": None if self.ending is None else list(self.ending),
            "base": [str(self.base.tick), str(self.base.start)],
            "wiring": self.wiring,
            "keys": [list(key) for key in self.keys],
            "components": [[name, dict(p.identity)] for name, p in packed.items()],
        }
        return packing.pack(MAGIC, description, [_doubles(self.values), *(p.data for p in packed.values())])

    @classmethod
    def from_bytes(cls, data: bytes) -> SystemState:
        """What `to_bytes` gave. Raises CosimError for anything else."""
        return _read(data, "this state")

    def write(self, path: str | os.PathLike[str]) -> Path:
        """Write the state to a file, which replaces an older one when it is complete.

        Raises CosimError as `to_bytes`, OSError naming the path.
        """
        return safe_files.write(path, self.to_bytes())

    @classmethod
    def read(cls, path: str | os.PathLike[str]) -> SystemState:
        """Read a file that `write` wrote.

        Nothing in the file is executed, and everything in it is validated: CosimError says what is wrong with a file
        that is damaged, or was made by another program. The FMUs themselves must judge their serialized states.
        """
        file = Path(path)
        with safe_files.named(file):
            size = file.stat().st_size
            if size > packing.LARGEST + len(MAGIC) + 32:
                raise CosimError(f"{file} has {size:,} bytes; a state of more than {packing.LARGEST:,} is not read")
            data = file.read_bytes()
        return _read(data, str(file))

    def __reduce__(self) -> tuple[Any, ...]:
        return SystemState.from_bytes, (self.to_bytes(),)


def _packed(component: SystemComponent, saved: Any) -> Packed:
    """Saved state of a live component."""
    implementation = component.implementation
    if not isinstance(implementation, Portable):
        raise CosimError(
            f"{type(implementation).__name__} does not say how (identity, pack and unpack of cosim.core.component)"
        )
    return Packed(implementation.identity(), implementation.pack(saved))


def wiring_of(schedule: Schedule) -> Wiring:
    """What decides how values are exchanged, in types that JSON has."""
    return {
        "components": {m.name: [m.kind, str(m.step), str(m.offset)] for m in schedule.components},
        "connections": [
            [c.source_name, c.target_name, c.delay, c.extrapolate, c.scale, c.offset]
            for c in schedule.value_connections
        ],
        "groups": [[g.method, [m.name for m in g.components]] for g in schedule.groups],
    }


def difference(state: SystemState, schedule: Schedule) -> str:
    """The first thing by which a system differs from that of a state, in words; empty when nothing does."""
    there, here = state.wiring, wiring_of(schedule)
    for name in sorted({*there["components"], *here["components"]}):
        old, new = there["components"].get(name), here["components"].get(name)
        if old is None or new is None:
            return f"'{name}' is only in {'this system' if old is None else 'the state'}"
        for what, a, b in zip(("kind", "step", "offset"), old, new, strict=True):
            if a != b:
                return (
                    f"the {what} of '{name}' is {b}{' s' * (what != 'kind')}, in the state {a}{' s' * (what != 'kind')}"
                )
    old, new = ({c[1]: c for c in w["connections"]} for w in (there, here))
    for target in sorted({*old, *new}):
        if old.get(target) != new.get(target):
            return f"{target} is connected to {_source(new.get(target))}, in the state to {_source(old.get(target))}"
    if there["groups"] != here["groups"]:
        return "the groups differ"
    missing = sorted({*here["components"]} - {*state.components})
    return f"'{missing[0]}' begins afresh" if missing else ""


def _source(connection: Sequence[Any] | None) -> str:
    if connection is None:
        return "nothing"
    source, _, delay, extrapolate, scale, offset = connection
    notes = ["delayed"] * delay + ["extrapolated"] * extrapolate
    notes += [f"times {scale:g} plus {offset:g}"] * ((scale, offset) != (1.0, 0.0))
    return source + (f" ({', '.join(notes)})" if notes else "")


def unpack(component: SystemComponent, packed: Packed) -> None:
    """Restore a component from the state of another instance.

    Raises CosimError naming the component when they differ.
    """
    implementation = component.implementation
    if not isinstance(implementation, Portable):
        raise CosimError(
            f"'{component.name}' is of type {type(implementation).__name__}, which takes no state of another instance"
        )
    here = implementation.identity()
    for what in dict.fromkeys([*here, *packed.identity]):
        a, b = packed.identity.get(what, "none"), here.get(what, "none")
        if a != b:
            raise CosimError(
                f"'{component.name}' is another component than in the state: its {what} is {_short(b)}, there"
                f" {_short(a)}"
            )
    implementation.unpack(packed.data)


def _short(text: str) -> str:
    return text if len(text) <= 200 else f"{text[:120]} ... {text[-60:]}"


def _doubles(values: Array) -> bytes:
    return np.ascontiguousarray(values, dtype="<f8").tobytes()


def _read(data: bytes, what: str) -> SystemState:
    about, pieces = packing.unpack(MAGIC, data, what)

    def refuse(part: str) -> NoReturn:
        raise CosimError(f"{what} was not written by this program: {part}")

    try:
        wiring, keys, named = about["wiring"], [tuple(k) for k in about["keys"]], about["components"]
        base = TimeBase(*(_fraction(text) for text in about["base"]))
        tick, ending = about["tick"], None if about["ending"] is None else Ending(*about["ending"])
        _check_wiring(wiring)
        if base.tick <= 0 or abs(base.start) > LONGEST or base.tick > LONGEST:
            refuse("its ticks have no length")
        if type(tick) is not int or not 0 <= tick <= MOST_TICKS:
            refuse("its time is invalid")
        if ending is not None:
            valid = type(ending.tick) is int and tick <= ending.tick <= MOST_TICKS and type(ending.text) is str
            if not valid or ending.component not in wiring["components"]:
                refuse("its end is invalid")
        if about["phase"] not in _PHASES:
            refuse("its phase is invalid")
        known = wiring["components"]
        if len(set(keys)) != len(keys) or any(k[0] not in _PARTS or k[1] not in known for k in keys):
            refuse("its values have no names")
        if any(len(k) != 3 or not _readable(k[2]) for k in keys):
            refuse("its values have no names")
        if len(pieces) != 1 + len(named) or len(pieces[0]) != 8 * len(keys):
            refuse("it holds more or less than it names")
        components: dict[str, Any] = {}
        for (name, identity), piece in zip(named, pieces[1:], strict=True):
            if name not in known or name in components:
                refuse("it names components that it does not have")
            if type(identity) is not dict or not all(_readable(text) for pair in identity.items() for text in pair):
                refuse(f"it does not say what '{name}' is")
            components[name] = Packed(identity, piece)
        state = SystemState(
            tick=tick,
            phase=_PHASES[about["phase"]],
            base=base,
            values=np.frombuffer(pieces[0], dtype="<f8").astype(float),
            keys=keys,
            individual=components,
            wiring=wiring,
            ending=ending,
        )
        for name in known:
            state.clock(name)
        return state
    except (KeyError, ValueError, TypeError, AttributeError, IndexError, ZeroDivisionError) as error:
        if isinstance(error, CosimError):
            refuse(str(error))
        refuse("its description lacks something, or has it in another form")


def _check_wiring(wiring: Any) -> None:
    """Raises ValueError or TypeError for invalid wiring."""
    components, connections, groups = wiring["components"], wiring["connections"], wiring["groups"]
    for name, (kind, step, offset) in components.items():
        if (
            not name
            or not _readable(name)
            or kind not in ("discrete", "continuous")
            or _fraction(step) <= 0
            or _fraction(offset) < 0
        ):
            raise ValueError(name)
    for source, target, delay, extrapolate, scale, offset in connections:
        kinds = [type(x) for x in (delay, extrapolate, scale, offset)]
        named = _readable(source) and _readable(target)
        if not named or kinds[:2] != [bool, bool] or not {*kinds[2:]} <= {int, float}:
            raise ValueError(target)
    for method, names in groups:
        if not _readable(method) or any(n not in components for n in names):
            raise ValueError(method)


def _readable(text: Any) -> bool:
    """Whether it is a text that messages may show."""
    return type(text) is str and len(text) <= LONGEST_TEXT and not _CONTROL.search(text)


def _fraction(text: str) -> Fraction:
    if type(text) is not str or not _FRACTION.fullmatch(text):
        raise ValueError("no fraction")
    return Fraction(text)
