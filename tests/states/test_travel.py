"""States that travel: a run that goes on in another process has the bits of the one that went on here."""

from __future__ import annotations

import gc
import json
import pickle
import struct
import threading
from pathlib import Path

import awkward
import numpy as np
import pytest
from built import CATALOG_NAMES, PROBE_NAMES, BuiltFmus
from forks import another_process, assert_tail, continued, played
from hypothesis import HealthCheck, given, settings
from random_systems import SampledSaw, Saw, systems, wired
from same import assert_same

from cosim import CosimError, LoopError, PythonComponent, Record, Recording, StopWhen, System, SystemState
from cosim.core import packing, plain
from cosim.engine.state import MAGIC

pytestmark = pytest.mark.filterwarnings(
    "ignore::cosim.UnconnectedInputsWarning",
    "ignore::cosim.AlgebraicLoopWarning",
    "ignore:initial values do not settle",
)


@pytest.fixture(scope="module")
def elsewhere():
    with another_process() as pool:
        yield lambda *args, **options: pool.submit(continued, *args, **options).result()


# ------------------------------------------------------------------------------------------------- in another process


@settings(
    max_examples=25, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture, HealthCheck.too_slow]
)
@given(plan=systems())
def test_a_fork_continues_bit_for_bit_whatever_is_wired(plan, follower, elsewhere):
    """Several rates, offsets, delays, extrapolation, groups, types, components in Python.

    Within steps and at stop conditions.
    """
    stop = [] if plan["stop"] is None else [StopWhen("m0.y", *plan["stop"])]
    with wired(plan, follower) as system:
        every = [
            f"{m}.{v}" for m in system.components for v in system.components[m].description.outputs if "[" not in v
        ]
        options = {"record": Record([*every, "m0.u"], plan["interval"], watch=["m0.y"])}
        try:
            simulation = system.initialize(**options)
        except LoopError:
            return
        with simulation:
            for until in plan["cuts"] or [0.05]:
                if simulation.advance(until, stop_when=stop):
                    break
            state = simulation.save()
            simulation.advance(0.12, stop_when=stop)
            whole = simulation.recording
    assert_tail(elsewhere(wired, (plan, follower), state, [0.12], stop, **options), whole, state.time)


STILL = ("Road", "PitchReference", "PreviewBuffer")  # outputs may not move here: flat, too early, nothing valid is seen


@pytest.mark.parametrize("fmi", [2, 3])
@pytest.mark.parametrize("name", [*PROBE_NAMES, *CATALOG_NAMES])
def test_every_fmu_continues_in_another_process(built_fmus: BuiltFmus, elsewhere, name, fmi):
    path = built_fmus.path(name, fmi)
    with played(path) as system:
        period = max(system["fmu"].step, system.components["player"].step if "player" in system.components else 0)
        system.allow_unconnected = True
        with system.initialize(record="fmu.*") as simulation:
            simulation.advance(14 * period)
            state = simulation.save()
            simulation.advance(40 * period)
            whole = simulation.recording
    assert name.startswith(STILL) or np.ptp(whole.data[whole.time >= state.time], axis=0).any()
    fork = elsewhere(played, (path,), state, [40 * period], record="fmu.*")
    assert_tail(fork, whole, state.time)


# --------------------------------------------------------------------------------------------- what a system must be


def chain(*, step="2 ms", law: type[PythonComponent] = SampledSaw, delay=False, rename="law") -> System:
    system = System()
    system.add("plant", Saw(), step=step)
    system.add(rename, law(), step="2 ms")
    system.connect("plant.y", f"{rename}.u")
    system.connect(f"{rename}.y", "plant.u", delay=delay)
    return system


def taken(system: System, until: float = 0.1) -> bytes:
    with system.initialize(record=Record(interval="1 ms")) as simulation:
        simulation.advance(until)
        return simulation.save().to_bytes()


class Other(SampledSaw):
    """Another class of the same variables."""


class More(SampledSaw):
    inputs = ("u [rad]", "v")


More.__qualname__ = "SampledSaw"


@pytest.mark.parametrize("other", [lambda: chain(rename="law2"), lambda: chain(law=Other), lambda: chain(law=More)])
def test_another_system_is_refused_by_name_of_what_differs(other, raises):
    state = SystemState.from_bytes(taken(chain()))
    with raises(CosimError):
        other().initialize(state=state)


def test_rates_and_wiring_may_change_at_a_common_multiple_of_all_steps(raises):
    """As for states that never left: at the end of everybody's step."""
    at_end, within = (SystemState.from_bytes(taken(chain(), t)) for t in (0.1, 0.101))
    for changed in (lambda: chain(delay=True), lambda: chain(step="1 ms")):
        assert changed().initialize(state=at_end).time == 0.1
        with raises(CosimError):
            changed().initialize(state=within)
    assert chain().initialize(state=within).time == 0.101


def test_another_fmu_under_the_same_name_is_refused(built_fmus, raises):
    def car(name, fmi):
        system = System()
        system.add("car", built_fmus.path(name, fmi), step="1 ms")
        return system

    with car("QuarterCarHmmwv", 3) as system:
        state = SystemState.from_bytes(taken(system, 0.01))
    for other in (("QuarterCarHmmwv", 2), ("QuarterCarBench", 3)):
        with car(*other) as system, raises(CosimError):
            system.initialize(state=state)


def test_what_was_not_recorded_there_can_be_recorded_here_at_the_end_of_a_step(raises):
    state = SystemState.from_bytes(taken(two_rates(), 0.004))
    whole = two_rates().run(0.02)
    assert_tail(two_rates().run(0.02, state=state), whole, 0.004)
    system = two_rates()
    with system.initialize(record=["fast.y"]) as simulation:
        simulation.advance(0.005)
        within = simulation.save()
        simulation.advance(0.02)
    system.run(0.02, state=within, record=["fast.y"])
    with raises(CosimError):
        system.run(0.02, state=within)


@pytest.mark.parametrize("name", ["slow.u", "slow.gain"])
def test_a_value_that_is_recorded_and_watched_is_one_value(name, tmp_path):
    def run(system: System, **more) -> Recording:
        options = {"record": Record(["slow.y", name], watch=[name, name]), "stop_when": [StopWhen(name, ">", 1e9)]}
        return system.run(0.02, **options, **more)

    system = two_rates(Gained)
    with system.initialize(record=Record(["slow.y", name], watch=[name, name])) as simulation:
        simulation.advance(0.008)
        state = SystemState.read(simulation.save().write(tmp_path / "state"))
    assert len(set(state.keys)) == len(state.values)
    assert_tail(run(two_rates(Gained), state=state), run(two_rates(Gained)), 0.008)


class Gained(Saw):
    parameters = {"gain": 0.5}  # noqa: RUF012


def two_rates(slow: type[Saw] = Saw) -> System:
    system = System()
    system.add("fast", Saw(), step="1 ms")
    system.add("slow", slow(), step="4 ms")
    return system


def test_the_grid_of_the_recorder_goes_on():
    whole = chain().run(0.1, record=Record(interval="10 ms"))
    state = SystemState.from_bytes(taken(chain(), 0.025))
    assert_tail(chain().run(0.1, record=Record(interval="10 ms"), state=state), whole, 0.025)


# ------------------------------------------------------------------------------------------------ what can be packed


class Remembers(PythonComponent):
    outputs = ("y",)

    def begin(self) -> None:
        self.what = self.given

    def step(self, t, h, u, y):  # noqa: ARG002
        y[0] = t


@pytest.mark.parametrize(
    "value",
    [
        np.random.default_rng(1),
        {"a": [1, {2, 3}]},
        np.array(["a"]),
        np.array([None]),
        pytest.param(10**2000, id="large"),
        lambda: 1,
    ],
)
def test_what_is_no_plain_data_is_refused_by_member_and_attribute(value, raises):
    system = System()
    component = Remembers()
    component.given = None
    system.add("mind", component, step="1 ms")
    with system.initialize() as simulation:
        system["mind"].implementation.what = value
        if not callable(value):
            state = simulation.save()
            with raises(CosimError):
                state.to_bytes()


def test_arrays_that_share_memory_are_refused(raises):
    system = System()
    component = Remembers()
    component.given = None
    system.add("mind", component, step="1 ms")
    with system.initialize() as simulation:
        component = system["mind"].implementation
        component.what = np.arange(4.0)
        component.part = component.what[1:]
        with raises(CosimError):
            simulation.save().to_bytes()
        component.what, component.part = component._u, 1
        with raises(CosimError):
            simulation.save().to_bytes()


class Views(PythonComponent):
    """Names for parts of one state vector, and for the inputs: what is written to one shows in the other."""

    inputs = ("u",)
    outputs = ("y", "z")

    def begin(self) -> None:
        self.state = np.zeros((3, 2), order="F")
        self.first, self.last, self.back = self.state[:, 0], self.state[1:, 1], [self.state[::-1, 1]]
        self.received = self._u
        self.rows = {"row": self.state[1]}

    def step(self, t, h, u, y):  # noqa: ARG002
        self.state += np.arange(6.0).reshape(3, 2) + t
        self.first += 1.0
        self.last[0] *= 0.5
        self.back[0][0] -= self.received[0]
        self.rows["row"][1] += 0.25
        y[0], y[1] = self.state.sum(), self.first[1]


def test_arrays_that_share_memory_still_do_after_they_were_restored(raises):
    system = System()
    system.add("views", Views(), step="1 ms")
    system.add("saw", Saw(), step="2 ms")
    system.connect("saw.y", "views.u")
    whole = system.run(0.03)
    with system.initialize() as simulation:
        simulation.advance(0.01)
        state = simulation.save()
        for _ in range(2):
            simulation.advance(0.03)
            assert_same(simulation.recording, whole)
            simulation.restore(state)
        views = system["views"].implementation
        assert views.received is views._u
        views.state[:] = 7.0
        assert (views.first == 7.0).all()
        simulation.restore(state)
        with raises(CosimError):
            state.to_bytes()


def test_plain_data_comes_back_as_it_was():
    values = {
        "f": -0.0,
        "nan": float("nan"),
        "i": -(2**70),
        "b": True,
        "n": None,
        "s": "\u00e9\ud800",
        "c": np.float32(0.1),
        "l": [1, (2.5, {"k": [None]}), {}],
        "e": np.zeros((0, 3)),
        "z": np.array(1.5),
        "a": np.arange(24, dtype=np.int16).reshape(2, 3, 4).transpose(2, 0, 1),
        "k": {(1, "x"): 2, 3.5: np.bool_(True)},
    }
    back = plain.decode(plain.encode(values))
    assert list(back) == list(values)
    assert repr(back) == repr(values)
    assert [type(v) for v in back.values()] == [type(v) for v in values.values()]
    assert back["a"].strides == values["a"].copy(order="K").strides
    assert back["a"].flags.writeable
    assert np.signbit(back["f"])
    assert back["n"] is None


def test_fmus_that_do_not_serialize_are_named(awkward_fmus, raises):
    with System() as system:
        system.add("plant", awkward_fmus[3])
        system.add("saw", Saw(), step="1 ms")
        with system.initialize() as simulation:
            state = simulation.save()
            with raises(CosimError):
                pickle.dumps(state)
            simulation.restore(state)  # here it can be used


def test_states_that_are_held_when_a_system_closes_become_bytes(follower, elsewhere):
    """Those of FMUs that were saved together, and of one that was saved alone."""
    for isolated in (False, True):
        with wired_pair(follower, isolated=isolated) as system, system.initialize(record=["b.y"]) as simulation:
            simulation.advance(0.3)
            state, dropped, forgotten = simulation.save(), simulation.save(), simulation.save()
            del dropped
            simulation.forget(forgotten)
            simulation.advance(0.6)
            whole = simulation.recording
        assert_tail(elsewhere(wired_pair, (follower,), state, [0.6], record=["b.y"]), whole, 0.3)
        assert_tail(system.run(0.6, record=["b.y"], state=state), whole, 0.3)
        assert not forgotten.components


def test_a_state_is_serialized_in_another_thread_when_the_simulation_stands(follower):
    """As pools do it, which pickle in a thread of their own."""
    stands = threading.Event()

    class Waits(PythonComponent):
        outputs = ("y",)

        def step(self, t, h, u, y):  # noqa: ARG002
            if t > 0.5 and not stands.is_set():
                pickling.start()
                pickling.join(0.2)
                assert pickling.is_alive()  # it waits
                stands.set()

    data = []
    with wired_pair(follower) as system:
        system.add("waits", Waits(), step="1 ms")
        with system.initialize() as simulation:
            simulation.advance(0.5)
            state = simulation.save()
            expected = state.to_bytes()
            pickling = threading.Thread(target=lambda: data.append(state.to_bytes()))
            simulation.advance(1.0)
            pickling.join()
    assert stands.is_set()
    assert data == [expected]


def test_states_of_an_fmu_that_failed_are_lost(awkward_fmus, raises):
    """The FMU returns fmi3Fatal at 0.3 s."""
    with System() as system:
        system.add("plant", awkward_fmus[3], parameters={"trouble": awkward.STATUS, "at": 0.3, "value": 4.0})
        with system.initialize() as simulation:
            simulation.advance(0.2)
            state = simulation.save()
            with pytest.raises(CosimError):
                simulation.advance(0.5)
            with raises(CosimError):
                state.to_bytes()


# ------------------------------------------------------------------------------------------------------------- files


def test_a_file_is_whole_or_not_there(tmp_path):
    with chain().initialize() as simulation:
        simulation.advance(0.1)
        state = simulation.save()
        simulation.advance(0.2, final=True)
        whole = simulation.recording
    path = state.write(tmp_path / "folder" / "settled.state")
    assert [p.name for p in path.parent.iterdir()] == ["settled.state"]
    assert path.read_bytes() == state.to_bytes() == SystemState.read(path).to_bytes()
    assert_tail(chain().run(0.2, state=SystemState.read(path)), whole, 0.1)
    with pytest.raises(OSError, match=r"none\.state"):
        SystemState.read(tmp_path / "none.state")
    assert b"pickle" not in path.read_bytes()


@pytest.fixture(scope="module")
def good(follower) -> bytes:
    with System() as system:
        system.add("plant", follower[3], step="1 ms", start={"u": 1.0})
        system.add("law", SampledSaw(), step="2 ms")
        system.connect("plant.y", "law.u", delay=True)
        return taken(system, 0.003)


def test_every_flipped_byte_and_every_cut_is_refused(good):
    for i in range(len(good)):
        damaged = bytearray(good)
        damaged[i] ^= 1 << (i % 8)
        with pytest.raises(CosimError, match="this state"):
            SystemState.from_bytes(bytes(damaged))
        with pytest.raises(CosimError, match="this state"):
            SystemState.from_bytes(good[:i])


def repacked(good: bytes, change) -> bytes:
    """With something else in it, under a right digest."""
    about, pieces = packing.unpack(MAGIC, good, "it")
    return packing.pack(MAGIC, *change(about, pieces))


def value_of(new):
    def change(about, pieces):
        values = np.frombuffer(pieces[0]).copy()
        values[0] = new
        return about, [values.tobytes(), *pieces[1:]]

    return change


def about_of(*path_and_value):
    *path, new = path_and_value

    def change(about, pieces):
        inner = about = json.loads(json.dumps(about))
        for key in path[:-1]:
            inner = inner[key]
        inner[path[-1]] = new
        return about, pieces

    return change


FORGED = [
    about_of("tick", -1),
    about_of("tick", 2**60),
    about_of("tick", "3"),
    about_of("tick", True),
    about_of("phase", "nothing"),
    about_of("ending", [0, "x"]),
    about_of("ending", 3),
    about_of("base", ["0", "0"]),
    about_of("base", ["1/0", "0"]),
    about_of("base", ["1", "9" * 41]),
    about_of("base", ["1/7", "0"]),
    about_of("wiring", {}),
    about_of("wiring", 1),
    about_of("wiring", "components", "law", ["other", "1", "0"]),
    about_of("wiring", "components", "law", ["discrete", "-1", "0"]),
    about_of("wiring", "components", "law", ["discrete", "1e9", "0"]),
    about_of("wiring", "connections", 0, ["a"]),
    about_of("wiring", "connections", 0, ["a", "b", 1, 2, 3, 4]),
    about_of("wiring", "groups", [["jacobi", ["x"]]]),
    about_of("keys", []),
    about_of("keys", 0, ["visible", "nobody", "y"]),
    about_of("keys", 0, ["other", "law", "y"]),
    about_of("keys", 0, ["visible", "law", 1]),
    about_of("keys", 0, [[], [], []]),
    about_of("components", []),
    about_of("components", 0, ["nobody", {}]),
    about_of("components", 0, ["law", {"class": 3}]),
    about_of("components", 5),
    lambda a, p: (a, p[:-1]),
    lambda a, p: (a, [*p, b""]),
    lambda a, p: (a, [p[0][:-8], *p[1:]]),
    lambda a, p: ({}, p),
    lambda a, p: (a | {"components": [a["components"][0]] * 2}, p),
    about_of("ending", [0, "nobody", "x"]),
    about_of("ending", [0, "law", 3]),
]


@pytest.mark.parametrize("change", FORGED, ids=range(len(FORGED)))
def test_forged_states_are_refused_in_a_sentence(good, change, raises):
    with raises(CosimError) as caught:
        SystemState.from_bytes(repacked(good, change))
    assert "\n" not in str(caught.value)


USED = [
    value_of(np.nan),
    value_of(np.inf),
    lambda a, p: (a | {"keys": a["keys"][:-1]}, [p[0][:-8], *p[1:]]),
    lambda a, p: (a, [p[0], b"[]", p[2]]),
    lambda a, p: (a, [p[0], b"{}", p[2]]),
    lambda a, p: (a, [p[0], b"[" * 10**6, p[2]]),
    lambda a, p: (a, [p[0], p[1][:-1] + b',["step",["float","0000000000000000"]]]', p[2]]),
    lambda a, p: (a, [p[0], p[1][:-1] + b',["description",["none"]]]', p[2]]),
    lambda a, p: (a, [p[0], p[1][:-1] + b',["a",["array","float64",[0],[1000000000000],""]]]', p[2]]),
    lambda a, p: (a, [p[0], p[1][:-1] + b',["a",["array","object",[],[],""]]]', p[2]]),
    lambda a, p: (a, [p[0], p[1][:-1] + b',["a",["array","bool",[],[],"Ag=="]]]', p[2]]),
    lambda a, p: (a, [p[0], p[1], p[2][:-1]]),
    lambda a, p: (a, [p[0], p[1], b""]),
]


@pytest.mark.parametrize("change", USED, ids=range(len(USED)))
def test_what_shows_only_when_it_is_used_is_refused_then(good, follower, change, raises):
    state = SystemState.from_bytes(repacked(good, change))
    with System() as system:
        system.add("plant", follower[3], step="1 ms", start={"u": 1.0})
        system.add("law", SampledSaw(), step="2 ms")
        system.connect("plant.y", "law.u", delay=True)
        with raises(CosimError):
            system.initialize(state=state)
        good_again = system.run(0.01, state=SystemState.from_bytes(good))
        assert np.isfinite(good_again.data).all()


def test_sizes_are_compared_before_they_are_believed(good, raises):
    for length in (2**63, 2**64 - 1, len(good), 2**27):
        body = struct.pack("<Q", length) + good[len(MAGIC) + 40 :]
        with raises(CosimError):
            SystemState.from_bytes(MAGIC + packing.hashlib.sha256(body).digest() + body)


# ------------------------------------------------------------------------------------------------------------- users


def test_a_hundred_runs_from_one_settled_state(elsewhere, follower, tmp_path):
    """A warm start: the state from a file, in another process; what a run changes does not touch the next."""
    with wired_pair(follower) as system, system.initialize(record=["b.y"]) as simulation:
        simulation.advance(0.5)
        path = simulation.save().write(tmp_path / "settled.state")
    first, *others = [
        elsewhere(wired_pair, (follower,), SystemState.read(path), [0.6], record=["b.y"]) for _ in range(3)
    ]
    for other in others:
        assert_same(first, other)


def tells_no_roll_back(system: System) -> list[bool]:
    """Argument noSetFMUStatePriorToCurrentPoint of the next steps."""
    return [system[name].implementation._no_set_prior() for name in ("a", "b")]


def wired_pair(follower: dict[int, Path], isolated: bool = False) -> System:
    system = System()
    system.add("a", follower[2], step="1 ms", start={"u": 3.0})
    system.add("b", follower[3], step="3 ms", parameters={"rate": 20.0}, isolated=isolated)
    system.connect("a.y", "b.u", extrapolate=True)
    return system


def test_states_that_travel_hold_no_instance_and_live_ones_let_go(follower, raises):
    with wired_pair(follower) as system, system.initialize(record=["b.y"]) as simulation:
        simulation.advance(0.5)
        traveled = SystemState.from_bytes(simulation.save().to_bytes())
        gc.collect()
        assert not any(p.in_use for p in system["a"].implementation.state_pools)
        assert traveled.owner is None
        assert not traveled.instances
        with raises(CosimError):
            simulation.restore(traveled)
        fork = system.initialize(record=["b.y"], state=traveled)  # in the system where it comes from
        fork.advance(0.6)
        assert not any(p.in_use for p in system["a"].implementation.state_pools)
        assert all(tells_no_roll_back(system))
        kept = fork.save()
        assert not any(tells_no_roll_back(system))
        exchange = kept.owner
        system.initialize()
        del fork, simulation
        gc.collect()
        assert exchange() is None  # a state that is kept does not keep the recording of its run


def test_fmus_of_others_for_themselves_and_a_system_as_one_fmu(follower, elsewhere, tmp_path):
    """The container serializes the states of its members, and each of these."""
    with wired_pair(follower) as inner:
        whole = inner.run(0.6, record=Record(["b.y"], "3 ms"))
        path = inner.export_fmu(tmp_path / "Pair.fmu", fmi=3)
    with as_one(path) as system, system.initialize(record=["pair.b.y"]) as simulation:
        simulation.advance(0.3)
        state = simulation.save()
        simulation.advance(0.6)
        assert_tail(elsewhere(as_one, (path,), state, [0.6], record=["pair.b.y"]), simulation.recording, 0.3)
        np.testing.assert_array_equal(simulation.recording["pair.b.y"], whole["b.y"])


def as_one(path: Path) -> System:
    system = System()
    system.add("pair", path, step="3 ms")
    return system


def partly(follower: dict[int, Path]) -> System:
    """One element of the array m.w is driven, the others keep their values."""
    system = System()
    system.add("m", follower[3], step="1 ms", start={"u": 1.0, "w": [0.1, 0.2, 0.3]})
    system.add("n", follower[3], step="1 ms", start={"w": [1.0, 1.0, 1.0]})
    system.connect("n.total[1]", "m.w[1]")
    return system


def test_elements_beside_driven_ones_can_be_set_while_it_runs(follower, elsewhere):
    """total[2] adds up w[2]: what is set counts from then on, and is part of the state."""
    options = {"record": ["m.w[2]", "m.total[2]", "m.total[1]"]}
    with partly(follower) as system, system.initialize(**options) as simulation:
        simulation.advance(0.01)
        simulation.set("m.w[2]", 50.0)
        simulation.advance(0.02)
        assert simulation["m.total[2]"] == pytest.approx(0.01 * 0.2 + 0.01 * 50.0)
        assert simulation["m.total[1]"] != 0  # driven, in degrees Celsius
        state = simulation.save()
        simulation.set("m.w[2]", 7.0)
        simulation.advance(0.03)
        assert simulation["m.total[2]"] == pytest.approx(0.01 * 0.2 + 0.01 * 50.0 + 0.01 * 7.0)
        simulation.restore(state)
        simulation.advance(0.03)
        assert simulation["m.total[2]"] == pytest.approx(0.01 * 0.2 + 0.02 * 50.0)
        whole = simulation.recording
    assert_tail(elsewhere(partly, (follower,), state, [0.03], **options), whole, 0.02)


def test_an_end_that_was_asked_for_is_remembered(awkward_fmus):
    """The FMU asks in its step from 0.3 to 0.4 s; the state is saved between, where others still step."""
    with System() as system:
        system.add("plant", awkward_fmus[3], parameters={"trouble": awkward.END, "at": 0.3, "value": 0.0})
        system.add("fast", Saw(), step="10 ms")
        with system.initialize() as simulation:
            simulation.advance(0.35)
            state = simulation.save()
            assert "asked to end" in simulation.advance(0.7)
            whole = simulation.recording
        assert whole.time[-1] == 0.4
        assert_tail(system.run(0.7, state=state), whole, 0.35)


def test_repeated_runs_keep_nothing_of_those_before(follower):
    """Also where every run begins with the same state."""
    with wired_pair(follower) as system:
        with system.initialize() as simulation:
            simulation.advance(0.3)
            state = SystemState.from_bytes(simulation.save().to_bytes())
        kept = []
        for _ in range(3):
            system.run(0.4, state=state)
            kept.append([len(system[name].implementation._keep) for name in ("a", "b")])
        assert kept[0] == kept[1] == kept[2]


@pytest.mark.parametrize("isolated", [False, True])
def test_whether_an_fmu_is_isolated_is_nothing_to_its_state(follower, elsewhere, isolated):
    with wired_pair(follower, isolated=isolated) as system, system.initialize(record=["b.y"]) as simulation:
        simulation.advance(0.3)
        state = simulation.save()
        simulation.advance(0.6)
        whole = simulation.recording
    assert_tail(elsewhere(wired_pair, (follower, not isolated), state, [0.6], record=["b.y"]), whole, 0.3)
