"""Hostile FMUs: a bad deed in some phase, isolated, in a system of some kind.

The host lives, and the end is a sentence or a recording.
"""

from __future__ import annotations

import random
import sys
import tempfile
from functools import cache
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1]))

from foreign.hostile import ENDS, HARMLESS, LIES, PHASES, build

from cosim import ComponentError, CosimError, System

DEEDS = (*ENDS, *LIES, *HARMLESS, "nan", "infinite", "scribble")
SLOW = ("hang", "sleep", "stop", "close", "devour", "greedy")  # they wait for a limit
ALLOWED = (CosimError,)


def make(rng: random.Random) -> bytes:
    deed = rng.choice(DEEDS if rng.random() < 0.1 else [d for d in DEEDS if d not in SLOW])
    words = (rng.choice((2, 3)), rng.choice(PHASES), deed, rng.randrange(1, 5), rng.randrange(1 << 16))
    return " ".join(map(str, words)).encode()


def run(case: bytes, folder: Path) -> None:  # noqa: ARG001
    version, phase, deed, steps, choices = case.decode().split()
    rng = random.Random(int(choices))
    with System() as system:
        system.add("good", _fmu(2, "step", "nothing"), step=f"{steps} ms")
        system.add("bad", _fmu(int(version), phase, deed), isolated=True, step_timeout=0.2, memory_limit=50_000_000)
        if rng.random() < 0.7:
            system.connect("good.y", "bad.u", delay=rng.random() < 0.3)
        if rng.random() < 0.7:
            system.connect("bad.y", "good.u", extrapolate=rng.random() < 0.3)
        system.allow_unconnected = True
        simulation = system.initialize(record=["*.y"])  # type: ignore[arg-type]
        try:
            simulation.advance("5 ms")
            state = simulation.save() if rng.random() < 0.5 else None
            simulation.advance("15 ms")
            if state is not None:
                simulation.restore(state)
                simulation.advance("20 ms")
        except ComponentError as error:
            if error.component != "bad" or error.recording is None:
                raise RuntimeError(f"somebody else is failing_function, or nothing is left: {error}") from error
            raise


@cache
def _fmu(version: int, phase: str, deed: str) -> Path:
    return build(version, Path(_folder().name), phase, deed)


@cache
def _folder() -> tempfile.TemporaryDirectory[str]:
    return tempfile.TemporaryDirectory(prefix="hostile-")
