"""Animations of a vehicle from the side: what moves, drawn by the page to scale.

An `Animation` has takes, of which the page shows one; a take has scenes, which run side by side on one clock; a
scene has a ground, rigid bodies, wheels, struts between them, forces and readings. Lengths in m, forces in N, angles in
rad, x ahead and z up, angles positive nose down (ISO 8855 pitch). All series of a scene are sampled `step` apart from
time 0; the page interpolates in between.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
import numpy.typing as npt

from build_fmus.base.checks import finite, number
from cosim.report.content_checks import (
    assign,
    check_choice,
    check_id,
    check_text,
    check_unique,
    curve,
    items,
    split_label,
)

Role = Literal["ground", "body"]
Points = Sequence[tuple[float, float]]

_METRES, _RADIANS, _NEWTONS = 3, 4, -2  # decimals kept: 1 mm, 0.1 mrad, 100 N


@dataclass(frozen=True, eq=False)
class Body:
    """A rigid outline, in a frame of its own that moves with (x, z, angle)."""

    name: str
    outline: Points
    x: npt.ArrayLike
    z: npt.ArrayLike
    angle: npt.ArrayLike

    def __post_init__(self) -> None:
        where = f"body '{self.name}'"
        check_text(where, name=self.name)
        assign(self, "outline", _points(where, "outline", self.outline, least=3))
        _series(where, self, "x", "z", "angle")


@dataclass(frozen=True, eq=False)
class Wheel:
    """A disc that rolls; `turn` grows while it rolls ahead."""

    name: str
    radius: float
    x: npt.ArrayLike
    z: npt.ArrayLike
    turn: npt.ArrayLike

    def __post_init__(self) -> None:
        where = f"wheel '{self.name}'"
        check_text(where, name=self.name)
        number(f"{where}: radius", self.radius, "m", above=0)
        _series(where, self, "x", "z", "turn")


@dataclass(frozen=True)
class Strut:
    """Between a point of a body's frame and the center of a wheel."""

    body: str
    at: tuple[float, float]
    wheel: str


@dataclass(frozen=True, eq=False)
class Force:
    """An arrow from (x, z); `role` gives its color: of the ground on a wheel, or on the body."""

    name: str
    x: npt.ArrayLike
    z: npt.ArrayLike
    fx: npt.ArrayLike
    fz: npt.ArrayLike
    role: Role = "ground"

    def __post_init__(self) -> None:
        where = f"force '{self.name}'"
        check_text(where, name=self.name)
        check_choice(where, "role", self.role, Role)
        _series(where, self, "x", "z", "fx", "fz")


@dataclass(frozen=True, eq=False)
class Reading:
    """A number beside the scene, `"pitch [deg]"`; the first one of a scene is drawn over time, too."""

    label: str
    values: npt.ArrayLike
    decimals: int = 1

    def __post_init__(self) -> None:
        where = f"reading '{self.label}'"
        split_label(self.label, where)
        if not 0 <= self.decimals <= 6:
            raise ValueError(f"{where}: {self.decimals} decimals; use 0 to 6")
        _series(where, self, "values")


@dataclass(frozen=True, eq=False)
class Phase:
    """Which of a few named phases the scene is in."""

    names: Sequence[str]
    index: npt.ArrayLike

    def __post_init__(self) -> None:
        assign(self, "names", items("phase", "names", self.names, str))
        _series("phase", self, "index")
        index = np.asarray(self.index)
        if not np.isin(index, np.arange(len(self.names))).all():
            raise ValueError(f"phase: an index is not one of 0 to {len(self.names) - 1}")


@dataclass(frozen=True, eq=False)
class Scene:
    """One run. `outcome` says in a few words how it ended, `good` colors it."""

    title: str
    step: float
    ground: Points
    bodies: Sequence[Body]
    wheels: Sequence[Wheel] = ()
    struts: Sequence[Strut] = ()
    forces: Sequence[Force] = ()
    readings: Sequence[Reading] = ()
    phase: Phase | None = None
    outcome: str = ""
    good: bool = True

    def __post_init__(self) -> None:
        where = f"scene '{self.title}'"
        check_text(where, title=self.title)
        number(f"{where}: step", self.step, "s", above=0)
        assign(self, "good", bool(self.good))
        assign(self, "ground", _points(where, "ground", self.ground, least=2))
        for part, kind in _PARTS.items():
            assign(self, part, items(where, part, getattr(self, part), kind))
        if not self.bodies:
            raise ValueError(f"{where} has no body to follow")
        for group in ("bodies", "wheels", "forces"):
            check_unique(where, group, (part.name for part in getattr(self, group)))
        check_unique(where, "reading", (r.label for r in self.readings))
        for strut in self.struts:
            ends = {
                "body": (strut.body, [b.name for b in self.bodies]),
                "wheel": (strut.wheel, [w.name for w in self.wheels]),
            }
            for end, (named, there) in ends.items():
                if named not in there:
                    raise ValueError(f"{where}: a strut hangs on {end} '{named}', which is not there")
        lengths = {part_name: len(values) for part_name, values in self._all_series()}
        if len(set(lengths.values())) > 1:
            raise ValueError(f"{where}: series have different lengths: {lengths}")
        if self.samples < 2:
            raise ValueError(f"{where} has {self.samples} sample; motion needs two")

    @property
    def samples(self) -> int:
        """Number of samples of every series."""
        return len(np.asarray(self.bodies[0].x))

    @property
    def duration(self) -> float:
        """Seconds."""
        return (self.samples - 1) * self.step

    def _all_series(self) -> Iterable[tuple[str, np.ndarray]]:
        parts: list[Body | Wheel | Force] = [*self.bodies, *self.wheels, *self.forces]
        for part in parts:
            for name in ("x", "z", "angle", "turn", "fx", "fz"):
                if hasattr(part, name):
                    yield f"{part.name}.{name}", np.asarray(getattr(part, name))
        for reading in self.readings:
            yield reading.label, np.asarray(reading.values)
        if self.phase is not None:
            yield "phase", np.asarray(self.phase.index)


_PARTS: dict[str, type] = {"bodies": Body, "wheels": Wheel, "struts": Strut, "forces": Force, "readings": Reading}


@dataclass(frozen=True, eq=False)
class Take:
    """Scenes on one clock; one that is over stays at its end."""

    title: str
    scenes: Sequence[Scene]

    def __post_init__(self) -> None:
        where = f"take '{self.title}'"
        check_text(where, title=self.title)
        assign(self, "scenes", items(where, "scenes", self.scenes, Scene))
        if not 1 <= len(self.scenes) <= 4:
            raise ValueError(f"{where} has {len(self.scenes)} scenes; 1 to 4 fit side by side")
        check_unique(where, "scene", (s.title for s in self.scenes))


@dataclass(frozen=True, eq=False)
class Animation:
    """Takes to choose from, with `width` [m] of the ground in view and `force_scale` [N] drawn as long as a meter.

    The scale has no exception: an arrow that is too long for the picture leaves it, and its size is written.
    """

    id: str
    title: str
    caption: str
    takes: Sequence[Take]
    width: float = 9.0
    force_scale: float = 1e5

    def __post_init__(self) -> None:
        where = f"animation '{self.id}'"
        check_id(where, self.id)
        check_text(where, title=self.title)
        assign(self, "takes", items(where, "takes", self.takes, Take))
        if not self.takes:
            raise ValueError(f"{where} has no takes")
        check_unique(where, "take", (t.title for t in self.takes))
        for name, unit in (("width", "m"), ("force_scale", "N")):
            number(f"{where}: {name}", getattr(self, name), unit, above=0)


def animation_data(animation: Animation) -> dict[str, Any]:
    """What the page's script reads: series as differences of whole numbers, which keeps a page small."""
    return {
        "width": animation.width,
        "forceScale": animation.force_scale,
        "takes": [{"title": t.title, "scenes": [_scene(s) for s in t.scenes]} for t in animation.takes],
    }


def _scene(scene: Scene) -> dict[str, Any]:
    phase = scene.phase
    return {
        "title": scene.title,
        "outcome": scene.outcome,
        "good": scene.good,
        "step": scene.step,
        "samples": scene.samples,
        "ground": scene.ground,
        "bodies": [
            {"name": b.name, "outline": b.outline, **_moves(b, x=_METRES, z=_METRES, angle=_RADIANS)}
            for b in scene.bodies
        ],
        "wheels": [
            {"name": w.name, "radius": w.radius, **_moves(w, x=_METRES, z=_METRES, turn=2)} for w in scene.wheels
        ],
        "struts": [
            {
                "body": [b.name for b in scene.bodies].index(s.body),
                "at": s.at,
                "wheel": [w.name for w in scene.wheels].index(s.wheel),
            }
            for s in scene.struts
        ],
        "forces": [
            {"name": f.name, "role": f.role, **_moves(f, x=2, z=2, fx=_NEWTONS, fz=_NEWTONS)} for f in scene.forces
        ],
        "readings": [
            {
                "quantity": split_label(r.label)[0],
                "unit": split_label(r.label)[1],
                "decimals": r.decimals,
                "values": _packed(np.asarray(r.values), r.decimals),
            }
            for r in scene.readings
        ],
        "phase": None if phase is None else {"names": phase.names, "index": _packed(np.asarray(phase.index), 0)},
    }


def _moves(part: object, **decimals: int) -> dict[str, Any]:
    return {name: _packed(np.asarray(getattr(part, name)), d) for name, d in decimals.items()}


def _packed(values: np.ndarray, decimals: int) -> dict[str, Any]:
    """Decimals and the differences of the rounded values."""
    whole = np.rint(values * 10.0**decimals).astype(np.int64)
    return {"decimals": decimals, "steps": np.diff(whole, prepend=0).tolist()}


def _points(where: str, name: str, points: Points, *, least: int) -> tuple[tuple[float, float], ...]:
    array = np.array(points, dtype=float)
    if array.ndim != 2 or array.shape[1] != 2 or len(array) < least or not np.isfinite(array).all():
        raise ValueError(f"{where}: {name} needs {least} or more finite points (x, z)")
    return tuple((float(x), float(z)) for x, z in array)


def _series(where: str, part: object, *names: str) -> None:
    for name in names:
        values = curve(where, name, getattr(part, name))
        finite(f"{where}: {name}", values, sampled=True)
        assign(part, name, values)
