"""An isolated FMU gives the bits that it gives in this process, and its process ends with it."""

from __future__ import annotations

import multiprocessing
import os
import signal
import subprocess
import sys
import time
from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from built import BuiltFmus
from hypothesis import HealthCheck, given, settings
from random_systems import systems, wired
from same import assert_same, bits

from cosim import CosimError, LoopError, Record, Recording, System, WiringError
from cosim.fmu.isolation import Isolation

pytestmark = pytest.mark.filterwarnings(
    "ignore::cosim.UnconnectedInputsWarning",
    "ignore::cosim.AlgebraicLoopWarning",
    "ignore:initial values do not settle",
)

ROAD, CAR, LAW = "RoadSine", "FullCarHmmwvModified", "GpcPreview"


def children() -> set[int]:
    """Processes that this one has started and that are there."""
    found = Path(f"/proc/{os.getpid()}/task/{os.getpid()}/children").read_text().split()
    return {int(p) for p in found if "program" in Path(f"/proc/{p}/cmdline").read_text()}


def isolate(system: System, names: tuple[str, ...] = ("*",), *, shared_memory: bool = True) -> None:
    system.isolate(*names)
    for component in system.components.values():
        implementation: Any = component.implementation
        if getattr(implementation, "isolation", None):
            implementation.isolation = replace(implementation.isolation, shared_memory=shared_memory)


def run(plan: dict[str, Any], follower: dict[int, Path], how: bool | None) -> Recording:
    """In pieces, with a state saved at one cut and gone back to at the next.

    `how`: isolated with shared memory or without, None: not.
    """
    with wired(plan, follower) as system:
        if how is not None:
            isolate(system, shared_memory=how)
        every = [
            f"{m}.{v}" for m in system.components for v in system.components[m].description.outputs if "[" not in v
        ]
        with system.initialize(record=Record(every, plan["interval"])) as simulation:  # type: ignore[arg-type]
            state = None
            for i, until in enumerate([*plan["cuts"], 0.05]):
                simulation.advance(max(until, simulation.time))
                if i == plan["saved_at"]:
                    state = simulation.save()
                elif state is not None:
                    simulation.restore(state)
                    state = None
                    simulation.advance(max(until, simulation.time))
            return simulation.recording


@settings(
    max_examples=12, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture, HealthCheck.too_slow]
)
@given(plan=systems())
@pytest.mark.parametrize("how", [True, False], ids=["memory", "socket"])
def test_random_systems_of_isolated_fmus_give_the_same_bits(plan, follower, how):
    plan = {**plan, "cuts": sorted(c for c in plan["cuts"] if c <= 0.05)}
    try:
        with wired(plan, follower) as system:
            system.schedule()
    except LoopError:
        return
    assert_same(run(plan, follower, None), run(plan, follower, how))


def car(fmus: BuiltFmus, fmi: int) -> System:
    """The car of paper 005 on a road with its preview law: sampled and continuous FMUs, arrays in FMI 3.0."""
    system = System()
    for name, fmu, step in (("road", ROAD, "1 ms"), ("car", CAR, "1 ms"), ("law", LAW, None)):
        system.add(name, fmus.path(fmu, fmi), step=step)
    system.connect_matching("road", "car", "road.*")
    system.connect("car.x", "road.x")
    return system


@pytest.mark.parametrize("fmi", [2, 3])
def test_a_car_gives_the_same_bits_and_leaves_no_process(built_fmus, fmi):
    before = children()
    found = []
    for isolated in (False, True):
        with car(built_fmus, fmi) as system:
            if isolated:
                isolate(system)
            for _ in range(2):  # reset and used again
                found.append(system.run(0.3, record=["car.*", "law.*"]))
            assert len(children() - before) == 3 * isolated
    assert children() == before
    for other in found[1:]:
        assert_same(found[0], other)


@pytest.mark.parametrize("fmi", [2, 3])
def test_states_and_derivatives_travel(built_fmus, fmi):
    path = built_fmus.path(CAR, fmi)
    found = []
    for isolated in (False, True):
        with System() as system:
            component: Any = system.add(
                "car", path, step="1 ms", start={"road.fl.height": 0.02}, isolated=isolated
            ).implementation
            with system.initialize(record=["car.body.z"]) as simulation:
                simulation.advance(0.1)
                data = component.serialize()
                simulation.advance(0.2)
                component.deserialize(data)
                about = component.description
                inputs, outputs = list(about.inputs.values())[:2], list(about.outputs.values())[:3]
                found.append((data, component.get(list(about.outputs.values())), component.linearize(inputs, outputs)))
    assert found[0][0] == found[1][0]
    assert found[0][1] == found[1][1]
    for one, other in zip(found[0][2], found[1][2], strict=True):
        assert np.array_equal(bits(one), bits(other))


def test_only_what_is_asked_for_is_isolated(harmless, raises):
    with System() as system:
        system.add("here", harmless)
        system.add("there", harmless, isolated=True, step_timeout=5.0, memory_limit=10**8)
        with pytest.raises(WiringError, match="isolated=True"):
            system.add("wrong", harmless, step_timeout=5.0)
        with raises(WiringError):
            system.isolate("here", "ther")  # all or none
        components: list[Any] = [m.implementation for m in system.components.values()]
        assert [c.isolation for c in components[:2]] == [None, Isolation(5.0, 10**8)]
        before = children()
        system.run(0.01)
        assert len(children() - before) == 1
        said = [line.strip() for line in str(system.schedule()).splitlines()]
        assert "there (Hostile) every 0.001 s, in a process of its own" in said
        assert "here (Hostile) every 0.001 s" in said


@pytest.mark.parametrize("limits", [{"step_timeout": 0.0}, {"step_timeout": float("nan")}, {"memory_limit": 10}])
def test_limits_are_checked(harmless, limits):
    with System() as system, pytest.raises((CosimError, ValueError), match=next(iter(limits))):
        system.add("there", harmless, isolated=True, **limits)


ORPHAN = """
import sys, time
from cosim import System
system = System(allow_unconnected=True)
system.add("there", sys.argv[1], isolated=True)
system.run(0.01)
print(system["there"].implementation._library._process.pid, flush=True)
time.sleep(60)
"""


def test_the_process_of_an_fmu_ends_with_its_master(harmless):
    master = subprocess.Popen([sys.executable, "-c", ORPHAN, harmless], stdout=subprocess.PIPE, text=True)
    assert master.stdout is not None
    worker = int(master.stdout.readline())
    os.kill(worker, 0)
    master.send_signal(signal.SIGKILL)
    master.wait()
    end = time.monotonic() + 300
    while Path(f"/proc/{worker}").exists() and Path(f"/proc/{worker}/stat").read_text().split()[2] != "Z":
        assert time.monotonic() < end, "it lives on"
        time.sleep(0.02)


def steps_of(path: Path) -> list[float]:
    """What a system shows in a process that was forked while another one was at work here."""
    with SYSTEMS[0] as system:
        system.allow_unconnected = True
        found = system.run(0.05, record=["one.y", "two.y"])
        return [float(found[n][-1]) for n in found.names] + [len(path.name)]


SYSTEMS: list[System] = []


@pytest.mark.filterwarnings("ignore::DeprecationWarning")
def test_a_forked_process_gets_fmus_of_its_own(follower):
    with System() as system:
        system.add("one", follower[2], step="1 ms", start={"u": 1.0}, isolated=True)
        system.add("two", follower[3], step="1 ms", isolated=True)
        system.connect("one.y", "two.u")
        system.allow_unconnected = True
        simulation = system.initialize(record=["one.y", "two.y"])
        simulation.advance(0.02)
        before = simulation.recording
        SYSTEMS[:] = [system]
        with ProcessPoolExecutor(2, multiprocessing.get_context("fork")) as pool:
            found = list(pool.map(steps_of, [follower[2]] * 4))
        simulation.advance(0.05)  # nobody has moved what belongs to this process
        own = [float(simulation.recording[n][-1]) for n in before.names]
        assert [f[:2] for f in found] == [own] * 4
