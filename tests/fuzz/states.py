"""Saved states with one to three wrong values under a right digest.

They are states of FMUs in both versions of FMI and of a component in Python, with several rates. They are refused in a
sentence, or harmless: what runs on shows finite numbers.
"""

from __future__ import annotations

import random
import sys
from functools import cache
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).parents[1]))

import numpy as np
from built import BuiltFmus, build_all
from random_systems import SampledSaw

from cosim import CosimError, System, SystemState
from cosim.core import packing
from cosim.engine.state import MAGIC

from .forged_states import forged

ALLOWED = (CosimError,)


def build() -> System:
    """The system whose states are forged."""
    fmus = BuiltFmus()
    if not fmus.path("QuarterCarHmmwv", 3).is_file():
        build_all()
    system = System()
    for name, fmi, step in (("plant", 3, "1 ms"), ("other", 2, "3 ms")):
        system.add(name, fmus.path("QuarterCarHmmwv", fmi), step=step)
    system.add("law", SampledSaw(), step="2 ms")
    system.connect("plant.body.z", "other.road.height", extrapolate=True)
    system.connect("other.body.z", "plant.road.height", delay=True)
    system.group("group", ["plant", "other"])
    return system


@cache
def _good() -> tuple[dict[str, Any], list[bytes]]:
    with build() as system, system.initialize() as simulation:
        simulation.advance(0.0073)
        return packing.unpack(MAGIC, simulation.save().to_bytes(), "it")


@cache
def _system() -> System:
    return build()


def make(rng: random.Random) -> bytes:
    return packing.pack(MAGIC, *forged(*_good(), rng))


def run(case: bytes, folder: Path) -> None:  # noqa: ARG001
    state = SystemState.from_bytes(case)
    if state.time < 1:
        recording = _system().run(state.time + 0.01, state=state)
        assert np.isfinite(recording.data).all()
