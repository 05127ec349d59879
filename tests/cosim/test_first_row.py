"""The first row shows values that belong together: what reads outputs that first event iterations have changed."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from foreign import eventful, messages, relay, sloped
from foreign.making import redescribed
from oracles.exchange_rule import by_the_rule
from same import assert_same, bits

from cosim import CosimError, PythonComponent, Recording, StopWhen, System, SystemState
from cosim.batch import Batch
from cosim.system.components import SystemComponent
from cosim.system.followers import find_followers
from cosim.system.loops import declared

pytestmark = pytest.mark.filterwarnings("ignore::cosim.UnconnectedInputsWarning")

STEP = "0.125 s"
VERSIONS = pytest.mark.parametrize("version", [2, 3])
ISOLATED = pytest.mark.parametrize("isolated", [False, True], ids=["in process", "isolated"])
JUMPS = {"gain": 0.0, "on": -1.0, "off": -1.0}  # y from 0 to 1, in the first event iteration
PASSES = {"gain": 2.0, "on": 1e9, "off": 1e9}  # y = 2 (u + a)


@pytest.fixture(scope="session")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("first rows")


class Doubled(PythonComponent):
    inputs = ("u",)
    outputs = ("y",)
    feedthrough = {"y": ("u",)}  # noqa: RUF012
    computes_on_get = True

    def start(self, u: Any, y: Any) -> None:
        y[0] = 2.0 * u[0]

    def step(self, t: float, h: float, u: Any, y: Any) -> None:  # noqa: ARG002
        self.start(u, y)


class InSteps(Doubled):
    computes_on_get = False


class Undeclared(Doubled):
    feedthrough = {}  # noqa: RUF012


def chain(path: Path, *names: str, isolated: bool = False, **rule: Any) -> System:
    """The first one jumps, and each other one doubles what the one before it shows."""
    system = System()
    for i, name in enumerate(names):
        system.add(name, path, step=STEP, parameters=PASSES if i else JUMPS, isolated=isolated)
        if i:
            system.connect(f"{names[i - 1]}.y", f"{name}.u", **rule)
    return system


def first_row(system: System, *names: str) -> list[float]:
    with system:
        found = system.run(0.25, record=names)
    return [float(found[n][0]) for n in names]


@ISOLATED
@VERSIONS
def test_a_chain_follows_whatever_its_names(folder, version, isolated):
    """Of Model Exchange FMUs, in each order of the names."""
    path = relay.build(version, folder)
    for names in (("a", "b", "c"), ("c", "b", "a"), ("b", "c", "a")):
        assert first_row(chain(path, *names, isolated=isolated), *(f"{n}.y" for n in names)) == [1.0, 2.0, 4.0]


def test_what_is_followed_has_the_order_of_the_system(folder):
    """Not that of hashes, which differ from process to process: exports are reproducible."""
    names = [f"y{i}" for i in range(9)]

    class Mixed(InSteps):
        inputs, outputs = tuple(n.replace("y", "u") for n in names), ("sum", *names)
        feedthrough = {"sum": inputs} | {n: (n.replace("y", "u"),) for n in names}

    system = System()
    system.add("m", Mixed(), step=STEP)
    for n in names:
        system.add(n, relay.build(3, folder), step=STEP)
        system.connect(f"{n}.y", n.replace("y", "m.u"))
    with system:
        *_, found = find_followers(system.schedule(), (), declared)
    assert [m.name for m, _ in found.reads] == names


def test_followers_of_one_level_have_the_order_of_the_schedule(folder):
    system = chain(relay.build(3, folder), "a")
    for name in "bcd":
        system.add(name, Doubled(), step=STEP)
        system.connect("a.y", f"{name}.u")
    system.group("group", ["d", "b"], "gauss-seidel")
    with system:
        found = find_followers(system.schedule(), (), declared)
    assert [f.what.name for f in found if isinstance(f.what, SystemComponent)] == ["c", "d", "b"]


@pytest.mark.parametrize("offset", [1.0, -1.0])
@VERSIONS
def test_an_exported_system_does_the_same(folder, version, offset):
    """With y = 1 + offset of the first one, which was 1."""
    with chain(relay.build(version, folder), "c", "b", "a") as system:
        system.components["c"].set({"gain": 1.0, "a": 1.0, "offset": offset})
        path = system.export_fmu(folder / f"Chain{version}{int(offset > 0.0)}.fmu", fmi=version)
    system = System(allow_unconnected=True)
    system.add("s", path, step=STEP)
    y = 1.0 + offset
    assert first_row(system, "s.c.y", "s.b.y", "s.a.y") == [y, 2.0 * y, 4.0 * y]


def test_what_changes_otherwise_is_not_followed(folder):
    """The output b.a grows by 1 when initialization ends, and what b reads does not change."""
    system = System()
    system.add("s", relay.build(3, folder), step=STEP, parameters=PASSES)
    system.add("b", sloped.build(3, folder), step=STEP, parameters={"trouble": 8.0})
    system.add("c", Doubled(), step=STEP)
    system.connect("s.y", "b.q")
    system.connect("b.a", "c.u")
    assert first_row(system, "b.a", "c.y") == [1.0, 0.0]


def test_a_value_that_is_not_finite_is_named_where_it_is_made(folder):
    """And nobody reads it."""
    system = System()
    infinite = JUMPS | {"gain": 1.0, "offset": 1e308}
    system.add("b", relay.build(3, folder), step=STEP, parameters=infinite, start={"a": 1e308})
    system.add("a", Doubled(), step=STEP)
    system.connect("b.y", "a.u", linear=(0.25, 0.0))
    with pytest.raises(CosimError, match="component 'b': y is inf"):
        system.run(0.25)


@pytest.mark.parametrize("made", [Doubled, Undeclared, InSteps])
def test_a_component_that_computes_in_steps_only_keeps_what_it_has(folder, made):
    """Whether dependencies are declared or not."""
    system = chain(relay.build(3, folder), "a")
    system.add("b", made(), step=STEP)
    system.connect("a.y", "b.u")
    with system:
        found = system.run(0.25, record=["b.y"])
    assert found["b.y"].tolist() == [0.0 if made is InSteps else 2.0, 2.0, 2.0]


def test_what_computes_in_steps_only_keeps_all_of_its_loop(folder):
    """Otherwise b.y would be of values that nobody shows: b reads c.a, which is in a loop through e."""
    path, names = relay.build(3, folder), ["b.y", "c.a", "c.b", "e.y"]

    def made() -> System:
        system = chain(path, "e")  # whose output follows no input
        system.add("b", path, step=STEP, parameters=JUMPS | {"gain": 0.4})
        system.add("c", sloped.build(3, folder), step=STEP, parameters={"k": 0.0})
        for source, target in (("e.y", "c.q"), ("c.a", "e.a"), ("c.a", "b.u"), ("b.y", "b.a")):
            system.connect(source, target)
        return system

    found = first_row(made(), *names)
    assert np.allclose(found, [1.0 / 0.6, 0.0, 0.0, 1.0], rtol=1e-8)
    with made() as system:
        assert_same(system.run(0.5, record=names), by_the_rule(system, 0.5, names))


@pytest.mark.parametrize(("trouble", "follows"), [(0.0, True), (6.0, False)])
@VERSIONS
def test_a_co_simulation_fmu_follows_if_it_computes_between_steps(folder, version, trouble, follows):
    """Its output a is sin(p) at first."""
    system = chain(relay.build(version, folder), "z")
    system.add("b", sloped.build(version, folder), step=STEP, parameters={"trouble": trouble})
    system.connect("z.y", "b.p")
    assert first_row(system, "b.a") == [np.sin(1.0) if follows else 0.0]


def test_a_co_simulation_fmu_that_refuses_between_steps_keeps_what_it_has(folder):
    """And its step is what says so, if the input is the reason."""
    names = ["c.a", "d.y"]

    def made(low: float) -> System:
        system = chain(relay.build(3, folder), "b")
        system.add("c", sloped.build(3, folder), step=STEP, parameters={"trouble": 7.0})
        system.add("d", Doubled(), step=STEP)
        system.connect("b.y", "c.p", linear=(low, 0.0))
        system.connect("c.a", "d.u")
        return system

    assert first_row(made(-1.0), *names) == [np.sin(-1.0), 2.0 * np.sin(-1.0)]
    with made(-2.0) as system, system.initialize(record=names) as begun:
        assert [begun[n] for n in names] == [0.0, 0.0]
    with made(-2.0) as system, pytest.raises(CosimError, match="component 'c'"):
        system.run(0.25, record=names)


@ISOLATED
@VERSIONS
def test_an_output_that_is_refused_between_steps_keeps_no_other_one(folder, version, isolated):
    """Whatever is recorded: b is, which c refuses then. In an exported system, too."""
    a = np.sin(-2.0)
    expected = {"c.a": a, "d.y": 2.0 * a, "c.b": -1.0}
    if version == 3:
        expected |= {"c.multiples[1]": a, "c.multiples[2]": 2.0 * a}
        expected |= {"c.whole": int(1e3 * a), "c.less": int(1e3 * a) - 1}

    def made() -> System:
        system, path = System(), relay.build(version, folder)
        system.add("b", path, step=STEP, parameters=JUMPS)
        fmu = sloped.build(version, folder, multiples=version == 3)
        system.add("c", fmu, step=STEP, parameters={"trouble": 9.0}, isolated=isolated)
        system.add("d", path, step=STEP, parameters=PASSES)
        system.connect("b.y", "c.p", linear=(-2.0, 0.0))
        system.connect("c.a", "d.u")
        for name in ("whole", "less") if version == 3 else ():  # more than a double holds passes such a connection
            system.add(f"of.{name}", messages.build(folder), step=STEP)
            system.connect(f"c.{name}", f"of.{name}.whole_in")
        return system

    def shown(system: System, names: list[str]) -> list[float]:
        with system, system.initialize(record=names) as begun:
            return [begun[n] for n in names]

    names = [*expected]
    for some in (names, names[:2], names[::-1], names[-1:]):
        assert shown(made(), some) == [expected[n] for n in some]
    if not isolated:
        with made() as system:
            path = system.export_fmu(folder / f"Refusing{version}.fmu", fmi=version, outputs=names)
        outer = System(allow_unconnected=True)
        outer.add("s", path, step=STEP)
        assert shown(outer, [f"s.{n}" for n in names]) == [*expected.values()]


def test_what_a_co_simulation_fmu_counts_in_event_mode_is_followed(folder):
    """In its first event iteration, where the period is 0."""
    parameters = {"kind": eventful.KINDS.index("at_end"), "period": 0.0}

    def made() -> System:
        system = System(allow_unconnected=True)
        system.add("e", eventful.build(folder), step=STEP, parameters=parameters)
        system.add("b", relay.build(3, folder), step=STEP, parameters=PASSES)
        system.connect("e.count", "b.u")
        return system

    assert first_row(made(), "e.count", "b.y") == [1.0, 2.0]
    with made() as system:
        path = system.export_fmu(folder / "Counted.fmu")
    system = System(allow_unconnected=True)
    system.add("s", path, step=STEP)
    assert first_row(system, "s.e.count", "s.b.y") == [1.0, 2.0]


@pytest.mark.parametrize("rule", [{"delay": True}, {"extrapolate": True}])
def test_a_delay_passes_nothing_on(folder, rule):
    """The delayed value is that of initialization; an extrapolated one is that of now."""
    assert first_row(chain(relay.build(3, folder), "a", "b", **rule), "b.y") == [0.0 if "delay" in rule else 2.0]


def test_a_loop_that_a_delay_breaks_is_not_iterated(folder):
    """Only b reads what has changed without a delay, and a does not read again what b computes of that."""
    path = relay.build(3, folder)

    def made(*, driven: bool) -> System:
        system = System()
        system.add("a", path, step=STEP, parameters=JUMPS | {"gain": 3.0})
        system.add("b", path, step=STEP, parameters=PASSES)
        system.connect("a.y", "b.u")
        system.connect("b.y", "a.u", delay=True)
        if driven:
            system.add("c", path, step=STEP, parameters=JUMPS)
            system.connect("c.y", "a.a")
        return system

    assert first_row(made(driven=False), "a.y", "b.y") == [1.0, 2.0]
    assert first_row(made(driven=True), "a.y", "b.y") == [4.0, 8.0]
    with made(driven=True) as system:
        found = system.run(0.5, record=["a.y", "b.y"])
        assert_same(found, by_the_rule(system, 0.5, ["a.y", "b.y"]))


def test_a_delayed_input_has_the_value_of_initialization(folder):
    """Also where its source jumps, and the component computes its outputs again: 3 (0 + 1) + 1, not 3 (1 + 1) + 1."""
    system = chain(relay.build(3, folder), "c")
    system.add("a", relay.build(3, folder), step=STEP, parameters=JUMPS | {"gain": 3.0})
    system.connect("c.y", "a.a")
    system.connect("a.y", "a.u", delay=True)
    assert first_row(system, "a.y") == [4.0]


def looped(path: Path, *, isolated: bool = False) -> System:
    """The solution of x = 0.5 y + s and y = 0.5 x is 4/3 s and 2/3 s, where s jumps from 0 to 1; z = 2 y."""
    system = System()
    gains = {"x": (1.0, 0.5), "y": (0.5, 1.0), "z": (2.0, 1.0)}
    system.add("s", path, step=STEP, parameters=JUMPS)
    for name, (gain, _) in gains.items():
        given = {"gain": gain, "on": 1e9, "off": 1e9}
        system.add(name, path, step=STEP, parameters=given, isolated=isolated)
    system.connect("s.y", "x.a")
    for source, target in (("x", "y"), ("y", "x"), ("y", "z")):
        system.connect(f"{source}.y", f"{target}.u", linear=(gains[target][1], 0.0))
    return system


@ISOLATED
@VERSIONS
def test_a_loop_is_solved_again_and_followed(folder, version, isolated):
    found = first_row(looped(relay.build(version, folder), isolated=isolated), "x.y", "y.y", "z.y")
    assert np.allclose(found, [4 / 3, 2 / 3, 4 / 3], rtol=1e-8)


@pytest.mark.parametrize("version", [None, 2, 3])
def test_a_loop_of_co_simulation_components_is_solved_again(folder, version):
    """In Python x = 2 y and y = x / 4 + s, and in an FMU a = sin(s) + a / 4."""
    names = ["x.y", "y.y"] if version is None else ["x.a", "x.b"]

    def made() -> System:
        system = chain(relay.build(3, folder), "s")
        if version is None:
            system.add("x", Doubled(), step=STEP)
            system.add("y", Summed(), step=STEP)
            system.connect("x.y", "y.u", linear=(0.25, 0.0))
            system.connect("y.y", "x.u")
            system.connect("s.y", "y.v")
        else:
            system.add("x", sloped.build(version, folder), step=STEP)
            system.connect("x.a", "x.q")
            system.connect("s.y", "x.p")
        return system

    expected = 4.0 if version is None else np.sin(1.0) / 0.75
    assert abs(first_row(made(), *names)[0] - expected) < 1e-8
    with made() as system:
        assert_same(system.run(0.5, record=names), by_the_rule(system, 0.5, names))


class Summed(Doubled):
    inputs = ("u", "v")
    feedthrough = {"y": ("u", "v")}  # noqa: RUF012

    def start(self, u: Any, y: Any) -> None:
        y[0] = u[0] + u[1]


def wide(path: Path, *more: str) -> Callable[[], System]:
    """A chain, and `more` relays that belong to nothing, some of which jump."""

    def made() -> System:
        system = chain(path, "c", "b", "a")
        for i, name in enumerate(more):
            system.add(name, path, step=STEP, parameters=JUMPS if i % 2 else PASSES)
        return system

    return made


def test_neither_what_is_recorded_nor_what_is_beside_it_matters(folder):
    path, every = relay.build(3, folder), ["c.y", "b.y", "a.y"]
    rows = []
    for more in ((), ("0", "d"), tuple("defghijklmnopq")):
        for names in (every, ["a.y"], ["a.y", "b.updates", "c.open"]):
            with wide(path, *more)() as system:
                rows.append(system.run(0.5, record=names)["a.y"])
    assert all(bits(row).tolist() == bits(rows[0]).tolist() for row in rows)
    with looped(path) as system:
        all_of_it = system.run(0.5, record=["*"])
    for name in ("x.y", "y.y", "z.y"):
        with looped(path) as system:
            assert bits(system.run(0.5, record=[name])[name]).tolist() == bits(all_of_it[name]).tolist()


def test_discrete_states_outside_of_loops_are_not_updated_again(folder):
    """One update each, also of a relay that opens in its first step."""
    system = chain(relay.build(3, folder), "a")
    system.add("b", relay.build(3, folder), step=STEP, parameters={"gain": 1.0, "on": 0.5, "off": 0.5})
    system.connect("a.y", "b.u")
    with system:
        found = system.run(0.25, record=["b.updates", "b.open", "b.y"])
    assert found["b.updates"].tolist()[0] == 1.0
    assert found["b.open"].tolist() == [0.0, 1.0, 1.0]
    assert found["b.y"].tolist() == [1.0, 2.0, 2.0]


def ending(path: Path, *, isolated: bool = False) -> System:
    """The relay in the loop opens since `s` has jumped, and asks for the end in that update, once."""
    system = looped(path, isolated=isolated)
    system.components["y"].set({"on": 0.5, "off": 0.5, "ends": 1.0})
    return system


@ISOLATED
@VERSIONS
def test_a_request_for_the_end_is_kept(folder, version, isolated):
    with ending(relay.build(version, folder), isolated=isolated) as system:
        found = system.run(1.0, record=["y.open"])
    assert found.time.tolist() == [0.0]
    assert found["y.open"].tolist() == [1.0]
    assert found.stopped_by is not None
    assert "'y'" in found.stopped_by


@ISOLATED
@VERSIONS
def test_a_request_in_the_first_event_iteration_ends_the_run_with_the_first_row(folder, version, isolated):
    with chain(relay.build(version, folder), "a", "b", isolated=isolated) as system:
        system.components["a"].set({"ends": 1.0})
        found = system.run(1.0, record=["a.y", "b.y"])
        assert found.time.tolist() == [0.0]
        assert [found["a.y"][0], found["b.y"][0]] == [1.0, 2.0]
        assert found.stopped_by is not None
        assert "'a' asked to end the simulation" in found.stopped_by
        system.disconnect("b.u")
        system.connect("a.y", "b.u", delay=True)
        with system.initialize(record=["b.y"]) as simulation:
            assert "'a'" in (simulation.stepper(STEP)() or "")
            assert simulation.finished
            assert simulation.recording.time.tolist() == [simulation.time] == [0.0]


@ISOLATED
@pytest.mark.parametrize("kind", ["continuous", "discrete"])
def test_so_does_that_of_a_co_simulation_fmu(folder, kind, isolated):
    """It stays in event mode, where the FMU refuses a step; its discrete input k can be set there."""
    parameters = {"kind": eventful.KINDS.index("ending"), "period": 0.0}
    with System(allow_unconnected=True) as system:
        system.add("e", eventful.build(folder), kind=kind, step=STEP, parameters=parameters, isolated=isolated)
        found = system.run(1.0, record=["e.count"])
        assert found["e.count"].tolist() == [1.0]
        with system.initialize(record=["e.count"]) as simulation:
            simulation.set("e.k", 2)
            simulation.restore(simulation.save())
            simulation.advance(1.0)
            assert simulation.recording["e.count"].tolist() == [1.0]
        system.add("b", relay.build(3, folder), step=STEP, parameters=PASSES)
        system.connect("e.count", "b.u", delay=True)
        with system.initialize(record=["e.count"]) as simulation:
            assert "'e'" in (simulation.stepper(STEP)() or "")
    assert "'e' asked to end" in (found.stopped_by or "")


class Held(InSteps):
    kind = "discrete"


def test_discrete_components_run_in_the_instant_of_such_a_request(folder):
    with chain(relay.build(3, folder), "a") as system:
        system.components["a"].set({"ends": 1.0})
        system.add("c", Held(), step=STEP)
        system.connect("a.y", "c.u")
        for found in (system.run(1.0, record=["c.y"]), by_the_rule(system, 1.0, ["c.y"])):
            assert found["c.y"].tolist() == [2.0]
        with system.initialize(record=["c.y"]) as simulation:
            step = simulation.stepper(STEP, stop_when=[StopWhen("c.y", ">=", 1.0)])
            assert "'a'" in (step() or "")
            simulation.restart()  # the stop condition holds here, too
            assert "'a'" in (step() or "")
            assert simulation.recording["c.y"].tolist() == [2.0]


@VERSIONS
def test_a_state_of_a_run_that_has_ended_there_can_be_restored(folder, version):
    with chain(relay.build(version, folder), "a", "b") as system:
        system.components["a"].set({"ends": 1.0})
        with system.initialize(record=["b.y"]) as simulation:
            saved = SystemState.from_bytes(simulation.save().to_bytes())
        found = system.run(0.5, record=["b.y"], state=saved)
    assert saved.ending is not None
    assert (saved.ending.tick, saved.ending.component) == (0, "a")
    assert found["b.y"].tolist() == [2.0]
    assert "'a' asked to end the simulation" in (found.stopped_by or "")


def test_a_state_is_restored_where_initialization_asks_for_the_end(folder):
    """By the start value of an input, which the state replaces; the discrete input q waits for event mode again."""
    with System() as system:
        system.add("s", relay.build(3, folder), step=STEP, parameters=PASSES)
        system.add("c", sloped.build(3, folder, events="discrete"), step=STEP, parameters={"trouble": 10.0})
        system.components["s"].set({"u": 1.0})
        system.components["c"].set({"p": 2.0})
        system.connect("s.y", "c.p", linear=(-1.0, 0.0))
        system.connect("s.x", "c.q")
        whole = system.run(1.0, record=["c.b"])
        with system.initialize(record=["c.b"]) as simulation:
            simulation.advance(0.5)
            state = simulation.save()
        found = system.run(1.0, record=["c.b"], state=state)
    assert len(whole.time) == 9
    assert found["c.b"].tolist() == whole["c.b"][4:].tolist()


def test_copies_of_a_batch_end_with_such_a_request(folder):
    with chain(relay.build(3, folder), "b", "a") as system:
        with pytest.warns(match="copy 1 ended at t = 0 s"):
            batch = Batch(system, 3, start={"b.ends": [0.0, 1.0, 0.0]}, outputs=["a.y"])
        assert batch.running.tolist() == [True, False, True]
        assert [(f.copy, f.component, f.time) for f in batch.failures] == [(1, "b", 0.0)]
        assert "'b' asked to end the simulation" in batch.failures[0].message
        batch.advance(0.25)
        assert np.isnan(batch.outputs[:, 0]).tolist() == [False, True, False]
        assert len(batch.failures) == 1


@pytest.mark.parametrize("discrete", [False, True])
def test_no_linear_model_is_made_after_such_a_request(folder, discrete):
    with chain(relay.build(3, folder), "a", "b") as system:
        system.components["a"].set({"ends": 1.0})
        with pytest.raises(CosimError, match="'a' asked to end the simulation"):
            system.linearize(["a.a"], ["b.y"], discrete=discrete)


def test_rows_by_hand_are_those_of_a_run(folder):
    names = ["x.y", "y.y", "z.y"]
    with looped(relay.build(3, folder)) as system:
        whole = system.run(0.5, record=names)

    def stepped(system: System) -> Recording:
        with system.initialize(record=names) as simulation:
            step = simulation.stepper(STEP)
            for _ in range(4):
                step()
            return simulation.recording

    with looped(relay.build(3, folder)) as system:
        assert_same(stepped(system), whole)


def test_a_run_with_a_tolerance_begins_with_the_same_row(folder):
    with looped(relay.build(3, folder)) as system:
        found = system.run(0.25, record=["x.y", "z.y"], tolerance=1e-4)
    assert np.allclose([found["x.y"][0], found["z.y"][0]], 4 / 3, rtol=1e-8)


def test_dependencies_that_are_not_declared_are_measured_in_possible_loops(folder):
    """The output b.a does not depend on b.p, so there is no loop; c.b, which nobody reads, may depend on c.p."""
    kept = redescribed(sloped.build(3, folder), folder / "Silent.fmu", (b' dependencies="0 1"', b""))
    names = ["b.a", "c.b", "c.a"]

    def made() -> System:
        system = chain(relay.build(3, folder), "s")
        for name, q in (("b", 0.0), ("c", 2.0)):
            system.add(name, kept, step=STEP, parameters={"k": 0.0}, start={"q": q})
        system.connect("s.y", "b.q")
        system.connect("b.a", "c.p")
        system.connect("c.a", "b.p")
        return system

    with pytest.warns(match="may form an algebraic loop"):
        assert first_row(made(), *names) == [0.25, 0.0625, 0.5]
    with made() as system, pytest.warns(match="may form an algebraic loop"):
        path = system.export_fmu(folder / "Measured.fmu")
    system = System()
    system.add("s", path, step=STEP)
    assert first_row(system, *(f"s.{n}" for n in names)) == [0.25, 0.0625, 0.5]
