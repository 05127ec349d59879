"""Every function of FMI in every state with odd arguments, for FMUs of this project.

With numbers about the declared limits, and forged states.

A case is a line with the FMU and the version of FMI, then the calls as bytes that `player.c` reads. The FMU's sources
run under AddressSanitizer and UndefinedBehaviorSanitizer, in a process that goes on from case to case.
"""

from __future__ import annotations

import atexit
import os
import random
import selectors
import struct
import subprocess
import sys
import tempfile
import zipfile
from functools import cache
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1]))

from built import BuiltFmus, build_all
from sanitized import FLAGS, gcc, kept_object

from cosim import Fmu

from .bench import HANGS

NAMES = (
    "QuarterCarHmmwv",
    "HydraulicActuator",
    "PreviewBuffer",
    "RoadIso8608",
    "ProbeDiscrete",
    "ProbeQpDaqp",
    "ProbeAm2",
    "ProbeRos2",
)
"""A vehicle and an actuator, sampled states in plenty, quadratic programs, and every solver; small ones, so that much
is tried.
"""

ALLOWED = ()
PLAYER = Path(__file__).with_name("player.c")
OPTIONS = "detect_leaks=1:detect_stack_use_after_return=1:allocator_may_return_null=1"


def make(rng: random.Random) -> bytes:
    name, fmi = rng.choice(NAMES), rng.choice((2, 3))
    # Bytes are not even: a few calls of a kind in a row lead further than any order.
    calls = bytearray()
    for _ in range(rng.randrange(2, 40)):
        calls += bytes([rng.randrange(24)] if rng.random() < 0.6 else [rng.choice((6, 11, 12, 13, 16, 20))])
        calls += rng.randbytes(rng.choice((1, 3, 4, 4, 8, 16)))
    return f"{name} {fmi}\n".encode() + calls


def run(case: bytes, folder: Path) -> None:  # noqa: ARG001
    head, _, calls = case.partition(b"\n")
    name, fmi = head.decode().split()
    player = _player(name, int(fmi))
    if player.poll() is not None:
        _player.cache_clear()
        player = _player(name, int(fmi))
    assert player.stdin is not None
    assert player.stdout is not None
    player.stdin.write(struct.pack("=I", len(calls)) + calls)
    player.stdin.flush()
    with selectors.DefaultSelector() as selector:
        selector.register(player.stdout, selectors.EVENT_READ)
        answer = os.read(player.stdout.fileno(), 1) if selector.select(HANGS) else None
    if answer == b"+":
        return
    if answer is None:
        player.kill()
    said, errors = player.communicate()
    _player.cache_clear()
    what = "did not come back" if answer is None else (answer + said).decode(errors="replace")
    raise AssertionError(f"{head.decode()}: {what}\n{errors.decode(errors='replace')[-4000:]}")


@cache
def _player(name: str, fmi: int) -> subprocess.Popen[bytes]:
    path = BuiltFmus().path(name, fmi)
    if not path.is_file():
        build_all()
    with tempfile.TemporaryDirectory() as folder:
        with zipfile.ZipFile(path) as archive:
            archive.extractall(folder)
        sources, program = Path(folder) / "sources", Path(folder) / "player"
        objects = [
            *(kept_object(c, sources) for c in sorted(sources.rglob("*.c"))),
            kept_object(PLAYER, sources, f"-DFMI={fmi}"),
        ]
        gcc(*FLAGS, *map(str, objects), "-lm", "-o", str(program))
        step = Fmu(path).description.default_step or 1e-3
        started = subprocess.Popen(
            [program, repr(float(step)), *(["trace"] if os.environ.get("FUZZ_TRACE") else [])],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            env={**os.environ, "ASAN_OPTIONS": OPTIONS},
        )
    atexit.register(_end, started)
    return started


def _end(process: subprocess.Popen[bytes]) -> None:
    if process.poll() is None:
        process.kill()
        process.communicate()
