"""Runs that continue in another process: what tests there call, in a pool whose processes are started afresh."""

from __future__ import annotations

import multiprocessing
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
from same import bits

from cosim import Fmu, PythonComponent, Recording, StopWhen, System, SystemState

Build = Callable[..., System]


@contextmanager
def another_process() -> Iterator[ProcessPoolExecutor]:
    """A pool of one process that shares nothing with this one."""
    with ProcessPoolExecutor(1, mp_context=multiprocessing.get_context("spawn")) as pool:
        yield pool


def continued(
    build: Build,
    arguments: Sequence[Any],
    state: SystemState,
    until: Sequence[Any],
    stop: Sequence[StopWhen] = (),
    **options: Any,
) -> Recording:
    """The recording from a state on, of a system that is built here.

    The simulation is advanced to each of `until` in turn.
    """
    with build(*arguments) as system, system.initialize(state=state, **options) as simulation:
        assert simulation.time == state.time
        for time in until:
            if simulation.advance(time, stop_when=stop):
                break
        return simulation.recording


def assert_tail(fork: Recording, whole: Recording, since: float) -> None:
    """The fork recorded what the whole run did from `since` on, to the last bit."""
    later = whole.time >= since
    assert fork.names == whole.names
    assert fork.stopped_by == whole.stopped_by
    np.testing.assert_array_equal(bits(fork.time), bits(whole.time[later]))
    np.testing.assert_array_equal(bits(fork.data), bits(whole.data[later]))


class Player(PythonComponent):
    """Drives all inputs of an FMU, within their ranges, by something that never repeats.

    It has state of every plain kind.
    """

    kind = "discrete"

    def __init__(self, ranges: dict[str, tuple[float, float]]):
        self.inputs = ("trim",)
        self.outputs = tuple(ranges)
        self.ranges = tuple(ranges.values())
        super().__init__()

    def begin(self) -> None:
        self.phase = np.zeros((2, len(self.ranges)), order="F")
        self.count, self.last, self.log, self.off = 0, None, [(0, -0.0)], {"a": {1: (True, "text")}}

    def step(self, t: float, h: float, u: Any, y: Any) -> None:
        self.phase[0] += 1.7 * h * np.arange(1, len(y) + 1)
        self.count += 1
        self.last = np.float64(t) + u[0]
        self.log.append((self.count, float(self.last)))
        for i, (low, high) in enumerate(self.ranges):
            y[i] = low + (high - low) * 0.5 * (1.0 + np.sin(40.0 * self.phase[0, i] + 0.3 * i))


def played(path: Path) -> System:
    """An FMU with moving inputs."""
    system = System()
    component = system.add("fmu", path, step=None if Fmu(path).description.sample_time else "1 ms")
    free = [v for v in component.description.inputs.values() if v.type == "real" and v.must_equal is None]
    ranges = {}
    for v in free:
        low = 0.0 if v.minimum is None else v.minimum
        high = np.inf if v.maximum is None else v.maximum
        center = v.start if isinstance(v.start, float) and low <= v.start <= high else low
        ranges[v.name] = (center, min(high, center + (300.0 if v.name == "x" else 1e-2)))
    if ranges:
        system.add("player", Player(ranges), step="1 ms")
        system.connect_matching("player", "fmu")
    return system
