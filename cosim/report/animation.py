"""Animations: recorded runs, played through the scene of a live page.

An `Animation` has takes, of which the page shows one; a take has playbacks, which run side by side on one clock; a
playback is a scene and the series of the variables that it reads, `step` apart from time 0. The page interpolates in
between.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from build_fmus.base.checks import finite, number
from cosim.core.content_checks import assign, check_id, check_text, check_unique, curve, items
from cosim.scenes.scene import Scene, scene_data

_DIGITS = 4  # of the largest magnitude of a series that are kept, at least


@dataclass(frozen=True, eq=False)
class Phase:
    """Which of a few named phases a run is in."""

    names: Sequence[str]
    index: npt.ArrayLike

    def __post_init__(self) -> None:
        assign(self, "names", items("phase", "names", self.names, str))
        assign(self, "index", curve("phase", "index", self.index))
        if not np.isin(np.asarray(self.index), np.arange(len(self.names))).all():
            raise ValueError(f"phase: an index is not one of 0 to {len(self.names) - 1}")


@dataclass(frozen=True, eq=False)
class Playback:
    """One run: a scene without `grounds`, and its variables, series (samples,) or numbers that stay.

    The first reading of the scene is drawn over time, too. `outcome` says in a few words how the run ended, `good`
    colors it.
    """

    title: str
    step: float
    scene: Scene
    series: Mapping[str, npt.ArrayLike]
    phase: Phase | None = None
    outcome: str = ""
    good: bool = True

    def __post_init__(self) -> None:
        where = f"playback '{self.title}'"
        check_text(where, title=self.title)
        number(f"{where}: step", self.step, "s", above=0)
        assign(self, "good", bool(self.good))
        if self.scene.grounds:
            raise ValueError(f"{where}: its scene asks a road for heights, which a recording does not have")
        if missing := [name for name in self.scene.variables if name not in self.series]:
            raise ValueError(f"{where}: its scene reads {', '.join(missing)}; give these series too")
        kept: dict[str, Any] = {}
        shared: dict[int, Any] = {}  # what several variables share stays one
        for name in self.scene.variables:
            given = self.series[name]
            if id(given) not in shared:
                values = float(given) if np.ndim(given) == 0 else curve(where, name, given)  # type: ignore[arg-type]
                finite(f"{where}: {name}", np.asarray(values), sampled=np.ndim(given) > 0)
                shared[id(given)] = values
            kept[name] = shared[id(given)]
        assign(self, "series", kept)
        lengths = {name: len(values) for name, values in kept.items() if np.ndim(values)}
        if self.phase is not None:
            lengths["phase"] = len(np.asarray(self.phase.index))
        if len(set(lengths.values())) != 1:
            raise ValueError(f"{where}: series have different lengths: {lengths}")
        if self.samples < 2:
            raise ValueError(f"{where} has {self.samples} sample; motion needs two")

    @property
    def samples(self) -> int:
        """Number of samples of every series."""
        return max(np.size(values) for values in self.series.values())


@dataclass(frozen=True, eq=False)
class Take:
    """Playbacks on one clock; one that is over stays at its end."""

    title: str
    scenes: Sequence[Playback]

    def __post_init__(self) -> None:
        where = f"take '{self.title}'"
        check_text(where, title=self.title)
        assign(self, "scenes", items(where, "scenes", self.scenes, Playback))
        if not 1 <= len(self.scenes) <= 4:
            raise ValueError(f"{where} has {len(self.scenes)} scenes; 1 to 4 fit side by side")
        check_unique(where, "scene", (s.title for s in self.scenes))


@dataclass(frozen=True, eq=False)
class Animation:
    """Takes to choose from."""

    id: str
    title: str
    caption: str
    takes: Sequence[Take]

    def __post_init__(self) -> None:
        where = f"animation '{self.id}'"
        check_id(where, self.id)
        check_text(where, title=self.title)
        assign(self, "takes", items(where, "takes", self.takes, Take))
        if not self.takes:
            raise ValueError(f"{where} has no takes")
        check_unique(where, "take", (t.title for t in self.takes))


def animation_data(animation: Animation) -> dict[str, Any]:
    """What the page's script reads: series as differences of whole numbers, which keeps a page small."""
    return {"takes": [{"title": t.title, "scenes": [_playback(s) for s in t.scenes]} for t in animation.takes]}


def _playback(run: Playback) -> dict[str, Any]:
    packed: dict[int, Any] = {}  # by identity: what several variables share is there once
    for values in run.series.values():
        packed.setdefault(id(values), _packed(values) if np.ndim(values) else float(values))  # type: ignore[arg-type]
    places = {key: i for i, key in enumerate(packed)}
    phase = run.phase
    return {
        "title": run.title,
        "outcome": run.outcome,
        "good": run.good,
        "step": run.step,
        "samples": run.samples,
        "scene": scene_data(run.scene),
        "series": {name: places[id(values)] for name, values in run.series.items()},
        "values": list(packed.values()),
        "phase": None if phase is None else {"names": phase.names, "index": _packed(phase.index, decimals=0)},
    }


def _packed(values: npt.ArrayLike, decimals: int | None = None) -> dict[str, Any]:
    """Decimals and the differences of the rounded values."""
    array = np.asarray(values)
    if decimals is None:
        largest = float(np.abs(array).max())
        decimals = _DIGITS - 1 - int(np.floor(np.log10(largest))) if largest else 0
    whole = np.rint(array * 10.0**decimals).astype(np.int64)
    return {"decimals": decimals, "steps": np.diff(whole, prepend=0).tolist()}
