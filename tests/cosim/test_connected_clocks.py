"""Clocks of FMUs that other FMUs tick: when, with which values, and what is refused."""

from __future__ import annotations

from collections.abc import Callable
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from exported import run_exported
from foreign import clocked, pulses, sloped

from cosim import ComponentError, LoopError, Recording, System, SystemState, UnconnectedInputsWarning, WiringError


@pytest.fixture(scope="module")
def fmu(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return pulses.build(tmp_path_factory.mktemp("pulses"))


def chain(fmu: Path, *names: str, relay: int = 1, period: float = 0.003, **options: Any) -> System:
    """Components in a row: the first one ticks every `period`, and the others pass that on."""
    system = System(allow_unconnected=True)
    for name in names:
        own = {"period": period} if name == names[0] else {"relay": relay}
        system.add(name, fmu, step="10 ms", parameters=own, **options)
    for source, target in pairwise(names):
        system.connect(f"{source}.y", f"{target}.x")
        system.connect(f"{source}.out", f"{target}.in")
    return system


def rounded(values: np.ndarray) -> list[float]:
    return values.round(12).tolist()


@pytest.mark.parametrize("relay", [1, 2])
@pytest.mark.parametrize("order", ["abc", "cab", "bca"])
def test_ticks_and_their_values_reach_all_at_once(fmu: Path, relay: int, order: str) -> None:
    """Every 3 ms, within steps of 10 ms, through two components, whatever their names."""
    with chain(fmu, *order, relay=relay) as system:
        found = system.run(0.04, record=["*"])
    _, second, third = order
    for name, more in ((second, 0.0), (third, 1.0)):
        assert found[f"{name}.count"].tolist() == [0, 3, 6, 9, 13], (
            "a tick at 0.03 s belongs to the step that begins there"
        )
        assert rounded(found[f"{name}.last"]) == [-1.0, 0.009, 0.018, 0.027, 0.039]
        assert found[f"{name}.got"].tolist() == [0.0, 3.0 + more, 6.0 + more, 9.0 + more, 13.0 + more]


def test_values_of_clocks_form_no_algebraic_loop(fmu: Path) -> None:
    """They are passed on at ticks: what a has got is what b has computed at the same one."""
    with chain(fmu, "a", "b") as system:
        system.connect("b.y", "a.x")
        system.connect("b.out", "a.in")
        found = system.run(0.04, record=["*"])
    assert not found.loops
    assert found["b.got"].tolist() == [0, 3, 6, 9, 13]
    assert found["a.got"].tolist() == [0, 4, 7, 10, 14]


def test_loops_of_components_that_take_their_steps_together(fmu: Path, tmp_path: Path) -> None:
    """Two outputs k sin(u) + t: solved between steps, and refused where a step would have to be repeated."""
    ticked = sloped.build(3, tmp_path, events="ticked")
    with System(allow_unconnected=True) as system:
        system.add("source", fmu, step="10 ms", parameters={"period": 0.003})
        for name in ("m", "n"):
            system.add(name, ticked, step="10 ms", parameters={"k": 0.5})
            system.connect("source.out", f"{name}.clock")
        system.connect("m.a", "n.p")
        system.connect("n.a", "m.p")
        found = system.run(0.1, record=["m.a", "n.a"])
        for a, b in (("m.a", "n.a"), ("n.a", "m.a")):
            assert np.abs(found[a] - found.time - 0.5 * np.sin(found[b])).max() < 1e-8
        system["m"].set({"trouble": 6.0})
        with pytest.raises(
            LoopError, match=r"(?s)'m' .* takes its steps together with those whose clocks .* m\.a -> n"
        ):
            system.run(0.1)


def test_one_clock_ticks_several(fmu: Path) -> None:
    with chain(fmu, "a", "b") as system:
        system.add("c", fmu, step="10 ms")
        system.connect("a.out", "c.in")
        system.connect("b.y", "c.x")
        found = system.run(0.02, record=["*"])
    assert found["c.count"].tolist() == found["b.count"].tolist() == [0, 3, 6]
    assert found["c.got"].tolist() == [0.0, 4.0, 7.0], "what b computes at the tick"


def test_values_without_a_connected_clock_are_those_of_the_exchange(fmu: Path) -> None:
    """When its clock ticks, c reads x; b, which drives x and shares no clock with it, shows y after its step."""
    with chain(fmu, "a", "c") as system:
        system.disconnect("c.x")
        system.add("b", fmu, step="10 ms", parameters={"period": 0.004})
        system.connect("b.y", "c.x")
        found = system.run(0.03, record=["*"])
    assert found["c.got"].tolist() == [0.0, 0.0, 2.0, 4.0]


def found_with(fmu: Path, announced: bool, *, isolated: bool = False) -> Recording:
    """Ticks of a every 3.1 ms and of d every 4.1 ms, known before or not, reach b and c."""
    with System(allow_unconnected=True) as system:
        for source, target, period in (("a", "b", 0.0031), ("d", "c", 0.0041)):
            relay = 0 if announced else 3
            system.add(source, fmu, step="10 ms", parameters={"period": period, "relay": relay}, isolated=isolated)
            system.add(target, fmu, step="10 ms", parameters={"relay": 1}, isolated=isolated)
            system.connect(f"{source}.y", f"{target}.x")
            system.connect(f"{source}.out", f"{target}.in")
        system.connect("a.out", "d.in")
        return system.run(0.05, record=["*"])


def test_early_returns_divide_the_steps_of_all(fmu: Path, tmp_path: Path) -> None:
    """Each tick where it is, though a and d return at different times; then the one that is ahead goes back."""
    may_return = pulses.build(tmp_path, early_return=True)
    announced, early = found_with(fmu, True), found_with(may_return, False)
    assert early["b.count"].tolist() == [0, 3, 6, 9, 12, 16]
    assert early["c.count"].tolist() == [0, 2, 4, 7, 9, 12]
    names = [n for n in early.names if not n.endswith(("relay", "period"))]
    assert all(rounded(early[n]) == rounded(announced[n]) for n in names)
    isolated = found_with(may_return, False, isolated=True)
    assert all(np.array_equal(early[n], isolated[n]) for n in early.names)


def test_an_event_right_after_a_communication_point_is_where_it_is(tmp_path: Path) -> None:
    """By less than what passes for rounding: an FMU that does not process it before its time is stepped to it."""
    path, period = pulses.build(tmp_path, near="1e-13"), 0.01 + 1e-11
    with System(allow_unconnected=True) as system:
        system.add("a", path, step="10 ms", parameters={"period": period})
        system.add("b", path, step="10 ms")
        system.connect("a.out", "b.in")
        found = system.run(0.05, record=["b.count", "b.last"])
    assert found["b.count"].tolist() == [0, 0, 1, 2, 3, 4]
    np.testing.assert_allclose(found["b.last"][2:], period * np.arange(1, 5), rtol=0, atol=1e-12)


def test_one_that_returns_again_on_its_way_takes_all_others_back(tmp_path: Path) -> None:
    """One that goes back to where b returns early returns before that: all FMUs are at one time at each event."""
    path = pulses.build(tmp_path, early_return=True)
    with System(allow_unconnected=True) as system:
        for name, period, relay in (("a", 0.0, 6), ("b", 0.0031, 3), ("c", 0.0, 1), ("e", 0.0041, 3)):
            system.add(name, path, step="10 ms", parameters={"period": period, "relay": relay})
        for source, target in (("b", "a"), ("b", "c"), ("e", "b")):
            system.connect(f"{source}.out", f"{target}.in")
        found = system.run(0.05, record=["*"])
    assert found["a.count"].tolist() == found["c.count"].tolist() == [0, 3, 6, 9, 12, 16]
    assert rounded(found["a.last"]) == rounded(found["c.last"]) == [-1.0, 0.0093, 0.0186, 0.0279, 0.0372, 0.0496]
    assert rounded(found["b.last"]) == [-1.0, 0.0082, 0.0164, 0.0287, 0.0369, 0.0492]


def ending_system(fmu: Path, early: bool) -> System:
    """Every 3 ms a ticks b; c is alone. `early`: they return early then."""
    system = chain(fmu, "a", "b")
    system["a"].set(relay=3 * early)
    system.add("c", fmu, step="10 ms", parameters={"period": 0.004, "relay": 3 * early})
    return system


@pytest.fixture(scope="module")
def ending(tmp_path_factory: pytest.TempPathFactory) -> dict[bool, tuple[Path, Path]]:
    """By whether it returns early, an FMU that asks for the end of the simulation, and the FMU of a system of it."""
    found = {}
    for early in (False, True):
        folder = tmp_path_factory.mktemp("ending")
        fmu = pulses.build(folder, early_return=early, ends=True)
        with ending_system(fmu, early) as system:
            parameters = [f"{name}.{p}" for name in "abc" for p in ("end", "how")]
            found[early] = fmu, system.export_fmu(folder / "Ending.fmu", parameters=parameters)
    return found


@pytest.mark.parametrize(
    ("early", "how", "at", "end"),
    [
        (False, "whole", 0.04, 0.04),
        (False, "whole", 0.035, 0.03),
        (False, "discarded", 0.04, 0.03),
        (False, "early", 0.035, 0.03),
        (False, "in event mode", 0.03, 0.03),
        (False, "in event mode", 0.032, 0.03),
        (False, "in event mode", 0.0, 0.0),
        (True, "whole", 0.04, 0.04),
        (True, "early", 0.035, 0.03),
        (True, "in event mode", 0.118, 0.12),
    ],
)
@pytest.mark.parametrize("name", ["a", "b", "c"])
def test_an_exported_system_ends_where_its_run_ends(
    ending: dict[bool, tuple[Path, Path]], name: str, early: bool, how: str, at: float, end: float
) -> None:
    """After a whole step, or where a step begins that was not taken whole; all components are at that time.

    Events at 0.12 s are known after the step to there only, if FMUs return early.
    """
    fmu, exported = ending[early]
    own = {"end": at, "how": pulses.HOW.index(how)}
    with ending_system(fmu, early) as system, System(allow_unconnected=True) as outer:
        system[name].set(**own)
        outside = system.run(0.2, record=["*.count", "*.last", "*.got", "*.y"])
        outer.add("s", exported, step="10 ms", parameters={f"{name}.{p}": x for p, x in own.items()})
        inside = outer.run(0.2, record=[f"s.{n}" for n in outside.names])
    for found in (outside, inside):
        assert found.time[-1] == pytest.approx(end, abs=1e-12)
        assert f"component '{name}'" in str(found.stopped_by)
    assert np.array_equal(inside.data, outside.data)
    before = int(1000 * end - 1) // 3
    assert outside["b.count"][-1] - before in (0, 1), "a tick at the end is of the next step, unless it is known late"


def test_a_discrete_component_that_has_asked_for_the_end_takes_no_step(
    ending: dict[bool, tuple[Path, Path]], tmp_path: Path
) -> None:
    """In its first event iteration: it stays in event mode, where the FMU refuses a step."""
    with System(allow_unconnected=True) as system, System() as outer:
        own = {"end": 0.0, "how": pulses.HOW.index("in event mode")}
        system.add("a", ending[False][0], kind="discrete", step="10 ms", parameters=own)
        outer.add("s", system.export_fmu(tmp_path / "Discrete.fmu"), step="10 ms")
        for found in (system.run(0.1, record=["*"]), outer.run(0.1, record=["*"])):
            assert found.time.tolist() == [0.0]
            assert "component 'a'" in str(found.stopped_by)


def test_early_returns_without_progress_or_permission_end_the_run(
    fmu: Path, tmp_path: Path, refused: Callable[..., None]
) -> None:
    may_return = pulses.build(tmp_path, early_return=True)
    runs = [(may_return, 4), (may_return, 5), (fmu, 3)]
    systems = [chain(path, "a", "b") for path, _ in runs]
    for system, (_, relay) in zip(systems, runs, strict=True):
        system["a"].set(relay=relay)
    refused(ComponentError, *(lambda s=s: s.run(0.01, record=[]) for s in systems))


def test_saved_states_continue(fmu: Path) -> None:
    with chain(fmu, "a", "b", "c") as system, system.initialize(record=["*"]) as simulation:
        simulation.advance(0.02)
        state = simulation.save()
        simulation.advance(0.07)
        once = {n: simulation.recording[n].copy() for n in simulation.recording.names}
        simulation.restore(state)
        simulation.advance(0.07)
        assert all(np.array_equal(once[n], simulation.recording[n]) for n in once)
        assert once["c.count"][-1] > 20
        data = state.to_bytes()
    with chain(fmu, "a", "b", "c") as system:
        found = system.run(0.07, state=SystemState.from_bytes(data), record=["*"])
        assert all(np.array_equal(once[n][2:], found[n]) for n in once)


@pytest.mark.parametrize(("early", "relay"), [(False, 1), (False, 2), (True, 3)])
def test_exported_systems_tick_alike(fmu: Path, tmp_path: Path, early: bool, relay: int) -> None:
    """Two networks and an FMU alone, with values that are converted; also after a saved state is restored."""
    path = pulses.build(tmp_path, early_return=early) if early else fmu
    own = {"a": (0.0031, 3 * early), "b": (0.0, 1 if early else relay), "c": (0.0, 1), "d": (0.0041, 3 * early)}
    with System(allow_unconnected=True) as system:
        for name, (period, how) in {**own, "alone": (0.002, 0)}.items():
            system.add(name, path, step="10 ms", parameters={"period": period, "relay": how})
        for source, target in (("a", "b"), ("b", "c")):
            system.connect(f"{source}.out", f"{target}.in")
            system.connect(f"{source}.y", f"{target}.x", linear=(2.0, 0.5))
        system.connect("d.out", "alone.in")
        system.connect("alone.got", "d.x")
        exported = system.export_fmu(tmp_path / "Ticks.fmu")
        found = system.run(0.1, record=["*"])
    inside = run_exported(exported, "10 ms", 0.05, 0.07, 0.1)
    names = [n for n in found.names if not n.endswith(("relay", "period", ".x"))]
    assert len(names) == 20
    assert found["c.count"][-1] == 32
    for name in names:
        np.testing.assert_array_equal(inside[name], found[name], err_msg=name)


def test_ticks_in_a_circle_end_the_run_of_an_exported_system_too(
    fmu: Path, tmp_path: Path, refused: Callable[..., None]
) -> None:
    with chain(fmu, "a", "b", relay=2) as system, System(allow_unconnected=True) as outer:
        system["a"].set(relay=2)
        system.connect("b.out", "a.in")
        system.connect("b.y", "a.x", delay=True)
        outer.add("s", system.export_fmu(tmp_path / "Circle.fmu"), step="10 ms")
        refused(ComponentError, lambda: outer.run(0.02, record=[]))


def test_the_schedule_tells_them(fmu: Path) -> None:
    with chain(fmu, "a", "b") as system:
        assert "Clocks that tick together" in str(system.schedule())
        assert "a.out -> b.in" in str(system.schedule())


def test_a_clock_that_nothing_ticks_is_reported(fmu: Path) -> None:
    with System() as system:
        system.add("a", fmu, step="10 ms", parameters={"period": 0.003})
        assert system.unconnected() == ["a.x", "a.in"]
        with pytest.warns(UnconnectedInputsWarning, match=r"a\.in"):
            assert system.run(0.01, record=["a.count"])["a.count"].tolist() == [0, 0]


def test_ticks_in_a_circle_end_the_run_with_the_names(fmu: Path, refused: Callable[..., None]) -> None:
    with chain(fmu, "a", "b", relay=2) as system:
        system["a"].set(relay=2)
        system.connect("b.out", "a.in")
        system.connect("b.y", "a.x", delay=True)
        refused(ComponentError, lambda: system.run(0.02, record=[]))


def test_what_does_not_fit_is_refused(fmu: Path, refused: Callable[..., None]) -> None:
    with chain(fmu, "a", "b") as system:
        system.add("slow", fmu, step="20 ms")
        system.add("sampled", fmu, step="10 ms", kind="discrete")
        refused(
            WiringError,
            lambda: system.connect("a.in", "b.in"),
            lambda: system.connect("a.y", "slow.in"),
            lambda: system.connect("a.out", "slow.in", delay=True),
        )
        for name in ("slow", "sampled"):
            system.connect("a.out", f"{name}.in")
            refused(WiringError, system.schedule)
            system.disconnect(f"{name}.in")
        system.group("together", ["a", "b"])
        refused(WiringError, system.schedule)


def test_time_based_clocks_tick_others_too(fmu: Path, tmp_path: Path) -> None:
    """Every 1/300 s, from the start on: three times in each step of 10 ms."""
    with System(allow_unconnected=True) as system:
        system.add("timer", clocked.build("constant", tmp_path), step="10 ms")
        system.add("b", fmu, step="10 ms")
        system.connect("timer.clock", "b.in")
        system.connect("timer.ticks", "b.x")
        found = system.run(0.03, record=["b.*", "timer.ticks"])
    assert found["b.count"].tolist() == [0, 3, 6, 9]
    assert rounded(found["b.last"] * 300.0) == [-300.0, 2.0, 5.0, 8.0]
    assert found["b.got"].tolist() == found["timer.ticks"].tolist()
