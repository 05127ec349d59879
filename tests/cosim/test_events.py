"""Co-Simulation FMUs with event mode and without clocks: when events are processed, and what is set then."""

from __future__ import annotations

from functools import partial
from pathlib import Path

import numpy as np
import pytest
from foreign import eventful

from cosim import ComponentError, FmuWarning, PythonComponent, Recording, System, SystemState
from cosim.fmu.isolation import Isolation


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("eventful")


@pytest.fixture(scope="module")
def fmu(folder: Path) -> Path:
    return eventful.build(folder)


class Levels(PythonComponent):
    """1, 1, 2, 2, 3, 3, ... at its samples."""

    outputs = ("y",)
    kind = "discrete"

    def __init__(self) -> None:
        super().__init__()
        object.__setattr__(self.description.variables["y"], "type", "integer")

    def begin(self) -> None:
        self.n = 1

    def step(self, t, h, u, y):  # noqa: ARG002
        self.n += 1
        y[0] = float(self.n // 2)


def run(path: Path, kind: str, stop: float = 0.1, *, step: str = "20 ms", isolated: bool = False) -> Recording:
    number = eventful.KINDS.index(kind)
    with System() as system:
        system.add("c", path, step=step, start={"u": 1.0, "k": 1}, parameters={"kind": number}, isolated=isolated)
        return system.run(stop, record=["c.*"])


def rounded(values: np.ndarray) -> list[float]:
    return values.round(12).tolist()


@pytest.mark.parametrize("kind", ["announced", "early"])
def test_events_within_a_step_are_processed_where_they_are(fmu: Path, kind: str) -> None:
    """Every 30 ms; a step is divided there, and the rest of it is completed."""
    found = run(fmu, kind)
    assert rounded(found["c.last"]) == [-1.0, -1.0, 0.03, 0.06, 0.06, 0.09]
    assert found["c.count"].tolist() == [0, 0, 1, 2, 2, 3]
    assert rounded(found["c.z"]) == rounded(np.arange(6) * 0.02)
    assert found["c.steps"].tolist() == [0, 1, 3, 4, 5, 7]


def test_an_event_that_is_announced_for_now_is_processed_now(fmu: Path) -> None:
    found = run(fmu, "twice")
    assert found["c.count"].tolist() == [0, 0, 2, 4, 4, 6]
    assert rounded(found["c.last"]) == [-1, -1, 0.03, 0.06, 0.06, 0.09]


def test_times_of_events_are_computed_in_the_rounding_mode_of_the_caller(folder: Path) -> None:
    """Those of the FMU's internal steps, which are counted from the end of its last step on."""
    fmu = eventful.build(folder, internal="0.0011")
    with pytest.warns(UserWarning, match="changes the rounding mode"):
        found = run(fmu, "upward", 2.0, step="0.1 s")
    right = run(fmu, "announced", 2.0, step="0.1 s")
    for name in ("c.z", "c.last", "c.count"):
        np.testing.assert_array_equal(found[name], right[name])


def test_an_event_is_processed_at_the_end_of_a_step_that_cannot_be_divided(folder: Path) -> None:
    """Neither early return nor steps of other lengths: 0.04, 0.06 and 0.1 s."""
    found = run(eventful.build(folder, variable_step=False), "announced")
    assert rounded(found["c.last"]) == [-1.0, -1.0, 0.04, 0.06, 0.06, 0.1]
    assert found["c.steps"].tolist() == [0, 1, 2, 3, 4, 5]


def test_steps_end_at_internal_steps(folder: Path) -> None:
    """An event at 0.03 s is announced, and internal steps take 8 ms: it is processed at 0.032 s."""
    path = eventful.build(folder, internal="0.008")
    found = run(path, "announced", step="40 ms", stop=0.04)
    assert rounded(found["c.last"]) == [-1.0, 0.032]


def test_an_event_that_is_not_announced_is_processed_at_the_end_of_the_step(fmu: Path) -> None:
    assert rounded(run(fmu, "at_end")["c.last"]) == [-1.0, -1.0, 0.04, 0.06, 0.06, 0.1]


def test_early_returns_are_completed_without_event_mode(folder: Path) -> None:
    found = run(eventful.build(folder, event_mode=False), "paused")
    assert rounded(found["c.z"]) == rounded(np.arange(6) * 0.02)
    assert found["c.steps"].tolist() == [0, 1, 3, 4, 5, 7]
    assert found["c.count"].tolist() == [0] * 6


def test_discrete_inputs_are_set_in_event_mode_when_they_change(fmu: Path) -> None:
    """The FMU fails where k is set in step mode; dz/dt is the level that was set last."""
    with System() as system:
        system.add("levels", Levels(), step="10 ms")
        system.add("c", fmu, step="10 ms", start={"u": 1.0}, parameters={"period": 10.0})
        system.connect("levels.y", "c.k")
        found = system.run(0.06, record=["c.level", "c.z", "levels.y"])
    levels = found["levels.y"]
    assert levels.tolist() == [1, 1, 2, 2, 3, 3, 4]
    assert found["c.level"].tolist()[1:] == levels.tolist()[:-1]
    assert rounded(found["c.z"]) == rounded(np.concatenate([[0.0], np.cumsum(levels[:-1]) * 0.01]))


def test_free_inputs_are_set_in_event_mode(fmu: Path) -> None:
    with System() as system:
        system.add("c", fmu, step="10 ms", start={"u": 1.0, "k": 1})
        with system.initialize(record=["c.level", "c.z"]) as simulation:
            simulation.advance(0.02)
            simulation.set("c.k", 5)
            simulation.advance(0.04)
            assert simulation.recording["c.level"].tolist() == [1, 1, 1, 5, 5], "shown after a step"
            assert rounded(simulation.recording["c.z"]) == [0.0, 0.01, 0.02, 0.07, 0.12]


@pytest.mark.parametrize("kind", ["announced", "early"])
def test_isolated_fmus_give_the_same_bits(fmu: Path, kind: str) -> None:
    here, there = run(fmu, kind), run(fmu, kind, isolated=True)
    assert all(np.array_equal(here[n], there[n]) for n in here.names)
    assert Isolation().shared_memory


@pytest.mark.parametrize("isolated", [False, True])
def test_saved_states_hold_announced_events_and_discrete_inputs(fmu: Path, isolated: bool) -> None:
    with System() as system:
        system.add("levels", Levels(), step="10 ms")
        system.add("c", fmu, step="25 ms", start={"u": 1.0}, isolated=isolated)
        system.connect("levels.y", "c.k")
        with system.initialize(record=["c.*"]) as simulation:
            simulation.advance(0.05)
            state = simulation.save()
            simulation.advance(0.3)
            once = {n: simulation.recording[n].copy() for n in simulation.recording.names}
            simulation.restore(state)
            simulation.advance(0.3)
            assert all(np.array_equal(once[n], simulation.recording[n]) for n in once)
            packed = state.to_bytes()
        with system.initialize(record=["c.*"], state=type(state).from_bytes(packed)) as simulation:
            simulation.advance(0.3)
            found = simulation.recording
            assert all(np.array_equal(once[n][-len(found.time) :], found[n]) for n in once)


def test_events_without_end_and_bad_times_are_refused_by_name(fmu: Path, refused) -> None:
    kinds = ("endless", "backward", "stuck", "nowhere", "passed")
    refused(ComponentError, *(lambda kind=kind: run(fmu, kind) for kind in kinds))


def test_an_fmu_may_end_the_simulation_in_event_mode(fmu: Path) -> None:
    found = run(fmu, "ending")
    assert "'c' asked to end the simulation (in event mode at 0.06 s" in str(found.stopped_by)
    assert round(found.time[-1], 9) == 0.06


@pytest.mark.parametrize("isolated", [False, True])
def test_an_fmu_that_refuses_its_event_mode_runs_without(folder: Path, isolated: bool) -> None:
    path = eventful.build(folder, token="refuses")
    with pytest.warns(
        FmuWarning, match=r"'c': its FMU declares event mode \(hasEventMode\) and cannot be instantiated"
    ):
        found = run(path, "at_end", isolated=isolated)
    without = run(eventful.build(folder, event_mode=False, variable_step=False), "at_end")
    assert all(np.array_equal(found[n], without[n]) for n in without.names)


def pair(path: Path, kind: str, *, levels: bool = True) -> System:
    """The discrete input of b is the number of events of a."""
    system = System(allow_unconnected=True)
    number = eventful.KINDS.index(kind)
    system.add("a", path, step="20 ms", start={"u": 1.0, "k": 1}, parameters={"kind": number})
    system.add("b", path, step="20 ms", parameters={"kind": 0, "period": 0.05})
    if levels:
        system.connect("a.count", "b.k")
    system.connect("a.z", "b.u")
    return system


def alone(path: Path) -> System:
    """The FMU of a system."""
    system = System(allow_unconnected=True)
    system.add("s", path, step="20 ms")
    return system


SHOWN = ("a.z", "a.count", "a.last", "b.z", "b.level", "b.count", "b.last", "b.steps")


@pytest.mark.parametrize("kind", ["announced", "early", "at_end"])
def test_exported_systems_keep_their_events(fmu: Path, tmp_path: Path, kind: str) -> None:
    """The same bits as in a run of the system, with a value that is set between steps."""

    def values(system: System, prefix: str) -> dict[str, list[float]]:
        with system, system.initialize(record=[f"{prefix}{n}" for n in SHOWN]) as simulation:
            simulation.advance(0.1)
            simulation.set(f"{prefix}a.k", 3)
            simulation.advance(0.2)
            return {n: simulation.recording[f"{prefix}{n}"].tolist() for n in SHOWN}

    with pair(fmu, kind) as system:
        path = system.export_fmu(tmp_path / "Events.fmu")
    inside, outside = values(alone(path), "s."), values(pair(fmu, kind), "")
    assert inside == outside
    assert outside["b.level"][-1] > 2
    assert outside["a.z"][-1] > 0.25, "faster since k was set"


def test_exported_systems_without_event_mode_complete_early_returns(folder: Path, tmp_path: Path) -> None:
    path = eventful.build(folder, event_mode=False)
    with pair(path, "paused", levels=False) as system:
        exported = system.export_fmu(tmp_path / "Paused.fmu")
        outside = system.run(0.2, record=list(SHOWN))
    with alone(exported) as system:
        inside = system.run(0.2, record=[f"s.{n}" for n in SHOWN])
    assert all(np.array_equal(inside[f"s.{n}"], outside[n]) for n in SHOWN)


def test_saved_states_of_exported_systems_hold_their_events(fmu: Path, tmp_path: Path) -> None:
    """In the same process and as bytes, which another instance reads; and the system can be reset."""
    with pair(fmu, "announced") as system:
        path = system.export_fmu(tmp_path / "Events.fmu")
    names = [f"s.{n}" for n in SHOWN]
    with alone(path) as system:
        first, second = (system.run(0.2, record=names) for _ in range(2))
        with system.initialize(record=names) as simulation:
            simulation.advance(0.08)
            state = simulation.save()
            simulation.advance(0.2)
            once = [simulation.recording[n].tolist() for n in names]
            data = state.to_bytes()
            simulation.restore(state)
            simulation.advance(0.2)
            assert [simulation.recording[n].tolist() for n in names] == once
    with alone(path) as system, system.initialize(record=names, state=SystemState.from_bytes(data)) as simulation:
        simulation.advance(0.2)
        assert simulation.recording["s.b.z"][-1] == first["s.b.z"][-1]
        assert simulation.recording["s.b.count"][-1] == first["s.b.count"][-1]
    assert all(np.array_equal(first[n], second[n]) for n in names)
    assert once == [first[n].tolist() for n in names]


def test_exported_systems_name_the_component_whose_events_fail(fmu: Path, tmp_path: Path, refused) -> None:
    def run_exported(kind: str) -> None:
        with pair(fmu, kind) as system:
            path = system.export_fmu(tmp_path / f"{kind}.fmu")
        with alone(path) as system:
            system.run(0.2, record=[])

    kinds = ("endless", "backward", "stuck", "nowhere", "passed")
    refused(ComponentError, *(lambda kind=kind: run_exported(kind) for kind in kinds))


def test_exported_systems_say_why_they_do_not_begin_or_step(fmu: Path, folder: Path, tmp_path: Path, refused) -> None:
    """The first event iteration is endless; an early return that was not allowed."""
    plain = eventful.build(folder, event_mode=False, variable_step=False)

    def run_exported(path: Path, kind: str, period: float) -> None:
        number = eventful.KINDS.index(kind)
        with System(allow_unconnected=True) as system:
            system.add("a", path, step="20 ms", parameters={"kind": number, "period": period})
            exported = system.export_fmu(tmp_path / f"{kind}.fmu")
        with alone(exported) as system:
            system.run(0.2, record=[])

    cases = [(fmu, "endless", 0.0), (plain, "backward", 0.03)]
    refused(ComponentError, *(partial(run_exported, *case) for case in cases))


def test_an_event_right_after_a_communication_point_is_not_late(folder: Path) -> None:
    """By less than what passes for rounding: an FMU that does not process it before its time is stepped to it."""
    with System(allow_unconnected=True) as system:
        period = 0.02 + 1e-11
        system.add("c", eventful.build(folder, near="1e-13"), step="20 ms", parameters={"period": period})
        found = system.run(0.1, record=["c.count", "c.last"])
    assert found["c.count"].tolist() == [0, 0, 1, 2, 3, 4]
    np.testing.assert_allclose(found["c.last"][2:], period * np.arange(1, 5), rtol=0, atol=1e-12)


@pytest.mark.parametrize(("kind", "end"), [("ending", 0.06), ("discards", 0.02)])
def test_an_exported_system_ends_where_a_component_asks_for_it(
    fmu: Path, tmp_path: Path, kind: str, end: float
) -> None:
    """At the end of its step, or where that begins if the FMU did not take it."""
    with pair(fmu, kind) as system:
        path = system.export_fmu(tmp_path / "Ending.fmu")
        outside = system.run(0.2, record=list(SHOWN))
    with alone(path) as system:
        inside = system.run(0.2, record=[f"s.{n}" for n in SHOWN])
    for found in (inside, outside):
        assert "asked to end the simulation" in str(found.stopped_by)
        assert "'a'" in str(found.stopped_by)
        assert round(found.time[-1], 9) == end
    assert np.array_equal(inside.data, outside.data)


def test_an_exported_fmu_that_refuses_its_event_mode_runs_without(folder: Path, tmp_path: Path) -> None:
    with alone(eventful.build(folder, token="refuses")) as system:
        path = system.export_fmu(tmp_path / "Refuses.fmu")
    with alone(path) as system:
        found = system.run(0.2, record=["s.s.*"])
    assert found["s.s.count"].tolist() == [0] * 11
