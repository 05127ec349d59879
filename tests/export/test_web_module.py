"""Systems as one WebAssembly module.

The numbers of the systems themselves, bit by bit, in a host that is no browser.
"""

from __future__ import annotations

import importlib.util
from fractions import Fraction
from pathlib import Path

import numpy as np
import pytest
from built import FMUS, BuiltFmus
from same import bits
from web_host import TYPES, WebHost

from build_fmus.compile import CompileError
from cosim import CosimError, Record, System
from cosim.experiments.trench import EXPERIMENT as TRENCH
from cosim.export.code import SystemCode, exported_schedule
from cosim.export.variables import choose
from cosim.export.web.module import Module, compile_module
from cosim.study import FmuSet, Runner

pytestmark = pytest.mark.filterwarnings("ignore::cosim.UnconnectedInputsWarning")
STEP = Fraction(1, 100)


def loop(built_fmus: BuiltFmus, law: str, road: str = "RoadBenchRandom") -> System:
    """A car on a road, and a law (with a quadratic program or without) where one is named."""
    system = System()
    system.add("road", built_fmus.path(road, 3))
    system.add("car", built_fmus.path("QuarterCarBench", 3), step="1 ms")
    system.connect_matching("road", "car")
    if law:
        system.add("law", built_fmus.path(law, 3))
        system.connect_matching("car", "law")
        system.connect_matching("law", "car")
    return system


def code_of(name: str, system: System, known: dict) -> SystemCode:
    schedule = exported_schedule(system, ())
    return SystemCode(name, schedule, choose(schedule, None, None, "*"), 3, known)


def outputs(code: SystemCode) -> list[tuple[int, str, str]]:
    """Value reference, type and name of what is shown, sorted by type as the module wants it."""
    found = [(k, e.type, e.name) for k, e in enumerate(code.variables, start=1) if e.causality == "output"]
    return sorted(found, key=lambda v: TYPES[v[1]])


@pytest.fixture(scope="module")
def made(built_fmus: BuiltFmus):
    """Three systems in one module, and the road alone."""
    known: dict = {}
    systems = [loop(built_fmus, law) for law in ("", "LqrBench", "MpcBench")]
    codes = [code_of(f"s{i}", s, known) for i, s in enumerate(systems)]
    road = codes[0].parts[systems[0]["road"]]
    yield systems, codes, compile_module(codes, [road]), road
    for s in systems:
        s.close()


def numbers(
    system: System, code: SystemCode, module: Module, model: int, step: Fraction, n: int
) -> dict[str, np.ndarray]:
    """Outputs in a run of the module, every `step`, which has the bits of the system itself."""
    shown = outputs(code)
    names = [name for _, _, name in shown]
    host = WebHost(module.content, [(r, t) for r, t, _ in shown], model)
    assert host.start(float(step)) == 0, host.message
    rows = np.vstack([host.look(), host.run(n)])
    system.allow_unconnected = True
    with system.initialize(record=names) as simulation:
        expected = []
        for k in range(n + 1):
            simulation.advance(k * step)
            expected.append([float(simulation[name]) for name in names])
    assert np.array_equal(bits(rows), bits(expected)), [
        name for k, name in enumerate(names) if not np.array_equal(bits(rows[:, k]), bits(np.array(expected)[:, k]))
    ]
    return dict(zip(names, rows.T, strict=True))


def test_every_system_of_a_module_has_the_bits_of_the_system_itself(made) -> None:
    systems, codes, module, _ = made
    for i, (system, code) in enumerate(zip(systems, codes, strict=True)):
        assert np.ptp(numbers(system, code, module, i, STEP, 300)["car.body.az"]) > 0.1


@pytest.mark.full
def test_a_vehicle_with_contact_has_them_too(built_fmus: BuiltFmus) -> None:  # noqa: ARG001
    """The wheels hang over a trench and hit its edges, under the control law with a quadratic program."""
    with Runner(TRENCH, FmuSet(FMUS)) as runner:
        system = runner.system(TRENCH.case(controller="mpc"))
        code = code_of("trench", system, {})
        found = numbers(system, code, compile_module([code]), 0, Fraction(1, 50), 200)
    assert found["car.tire.a1l.deflection"].max() > 0.1  # m, without contact
    assert np.ptp(found["car.contact.a1l.fx"]) > 10e3  # N, at both edges


def test_systems_share_what_they_have_in_common(made, built_fmus: BuiltFmus) -> None:
    _, codes, module, _ = made
    alone = [compile_module([code_of("s", s, {})]) for s in [loop(built_fmus, "MpcBench")]]
    assert len({p.name for c in codes for p in c.distinct}) == 4  # road, car, two laws
    assert len(module.content) < 1.4 * len(alone[0].content)


def test_a_run_begins_again(made) -> None:
    _, codes, module, _ = made
    host = WebHost(module.content, [(r, t) for r, t, _ in outputs(codes[2])], 2)
    host.start(float(STEP))
    first = host.run(50)
    assert not np.array_equal(host.run(50), first)
    assert host.call("web_reset", host.handle) == 0
    host.start(float(STEP))
    assert np.array_equal(bits(host.run(50)), bits(first))


def test_what_is_set_counts_and_what_is_wrong_is_said(made) -> None:
    _, codes, module, _ = made
    host = WebHost(module.content, [(r, t) for r, t, _ in outputs(codes[0])])
    reference = {e.name: k for k, e in enumerate(codes[0].variables, start=1)}
    mass = reference["car.body.mass"]
    assert host.set(mass, "Float64", [-1.0]) > 1
    assert "car.body.mass" in host.message
    assert host.set(mass, "Float64", [1e9]) > 1
    assert host.set(reference["car.force"], "Float64", [40.0]) == 0
    host.start(float(STEP))
    pushed = host.run(20)
    assert np.abs(pushed).max() > 0
    assert host.set(mass, "Float64", [3.0]) > 1  # fixed: only before the start
    assert "car.body.mass" in host.message
    assert WebHost(module.content, [], 4).handle == 0  # there is no such model


def test_the_road_alone_shows_what_lies_ahead(built_fmus: BuiltFmus) -> None:
    known: dict = {}
    with System() as system:
        system.add("speed", built_fmus.path("SpeedProfile", 3), start={"start.x": 0.0, "start.speed": 10.0})
        system.add("road", built_fmus.path("RoadHoleBump", 3))
        system.connect("speed.x", "road.x")
        system.connect("speed.speed", "road.speed")
        code = code_of("s", system, known)
        component = system["road"]
        part = code.parts[component]
        module = compile_module([code], [part])
        variables = component.description.variables
        road = WebHost(module.content, [(variables["road.fl.height"].reference, "Float64")], module.model(part))
        assert road.start(1e-3) == 0
        recording = system.run(1.5, record=Record(["speed.x", "road.road.fl.height"], "10 ms"))
    heights = []
    for x in recording["speed.x"][:150]:
        assert road.set(variables["x"].reference, "Float64", [x]) == 0
        heights.append(road.run(1)[0, 0])
    assert np.array_equal(bits(heights), bits(recording["road.road.fl.height"][:150]))
    assert max(heights) > 0.02


def test_what_cannot_be_a_page(
    follower: dict[int, Path], built_fmus: BuiltFmus, monkeypatch: pytest.MonkeyPatch, raises
) -> None:
    with System() as system:
        system.add("late", follower[3], step="5 ms")
        with raises(CosimError):
            compile_module([code_of("s", system, {})])
    with System() as system:
        system.add("road", built_fmus.path("RoadBumps", 2))
        code = code_of("s", system, {})
        with raises(CosimError):
            compile_module([code], code.distinct)
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: None)
    with pytest.raises(CompileError, match=r"pip install 'suspension-fmus\[zig\]'"):
        compile_module([])


def test_the_same_bytes_again(made) -> None:
    _, codes, module, road = made
    again: Module = compile_module(codes, [road])
    assert again.content == module.content
