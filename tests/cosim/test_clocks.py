"""Third-party FMUs with clocks and event mode.

When each kind ticks, what is exchanged then, and what is refused by name.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from fractions import Fraction
from pathlib import Path

import fmpy
import numpy as np
import pytest
from foreign import clocked

from cosim import ComponentError, CosimError, FmuError, PythonComponent, Simulation, System, SystemState
from cosim.check import Options, check
from cosim.fmu.file import FmuFile

Build = Callable[..., Path]
Act = Callable[[Simulation, str], None]


@pytest.fixture(scope="module")
def fmu(tmp_path_factory: pytest.TempPathFactory) -> Build:
    """An FMU by the kind of its clock; each is built once."""
    made: dict[str, Path] = {}

    def of(kind: str) -> Path:
        if kind not in made:
            made[kind] = clocked.build(kind, tmp_path_factory.mktemp(kind))
        return made[kind]

    return of


class Ramp(PythonComponent):
    """1, 2, 3, ... at its samples."""

    outputs = ("y",)
    kind = "discrete"

    def begin(self) -> None:
        self.n = 0.0

    def step(self, t, h, u, y):  # noqa: ARG002
        self.n += 1.0
        y[0] = self.n


def run(path: Path, stop: float = 0.1, *, step: str = "10 ms", **start: object) -> dict[str, list[float]]:
    with System() as system:
        system.add("c", path, step=step, start={"u": 1.0, "begin": False, **start})
        recording = system.run(stop, record=["c.*"])  # type: ignore[arg-type]
    return {n.removeprefix("c."): recording[n].round(9).tolist() for n in recording.names}


def test_a_constant_clock_ticks_exactly_where_its_counters_say(fmu: Build) -> None:
    """Every 1/300 s, three times in each step of 10 ms.

    The FMU fails where a tick is passed or comes at another time.
    """
    found = run(fmu("constant"))
    assert found["ticks"] == [3.0 * k for k in range(11)]
    assert found["last"][1:] == [round((3 * k + 2) / 300, 9) for k in range(10)]
    assert found["y"] == found["ticks"], "u is added at every tick"
    z = [sum(n / 300 for n in range(1, 3 * k + 1)) for k in range(11)]
    assert found["z"] == pytest.approx(z, abs=1e-9), "what holds between ticks is integrated"
    assert run(fmu("constant"), 12.0)["ticks"][-1] == 3600.0


def test_a_fixed_clock_has_the_interval_and_shift_of_its_parameters(fmu: Build) -> None:
    found = run(fmu("fixed"), period=0.03, shift=0.005)
    assert found["last"] == [-1.0, *[0.005] * 3, *[0.035] * 3, *[0.065] * 3, 0.095]
    assert found["ticks"][-1] == 4.0


def test_a_tunable_clock_follows_its_parameter_from_when_it_is_set(fmu: Build) -> None:
    with System() as system:
        system.add("c", fmu("tunable"), step="10 ms", start={"u": 1.0, "begin": False})
        with system.initialize(record=["c.last", "c.ticks"]) as simulation:
            simulation.advance(0.04)
            simulation.set("c.period", 0.025)
            simulation.advance(0.12)
            recording = simulation.recording
    assert recording["c.last"].round(9).tolist()[4:] == [0.03, 0.03, 0.03, 0.065, 0.065, 0.065, 0.09, 0.09, 0.115]
    assert recording["c.ticks"][-1] == 7.0


def test_a_changing_clock_says_at_each_tick_when_the_next_one_is(fmu: Build) -> None:
    found = run(fmu("changing"), 0.16, step="40 ms")  # ticks at 10, 20, 40, 70, 80, 100, 130, 140 ms
    assert found["ticks"] == [0.0, 2.0, 4.0, 6.0, 8.0]
    assert found["last"][1:] == [0.02, 0.07, 0.1, 0.14]


@pytest.mark.parametrize("fractions", [False, True])
def test_a_countdown_begins_at_an_event(tmp_path: Path, fractions: bool) -> None:
    """A discrete input is set in event mode; 15 ms later, within a step, the clock ticks.

    Before it the interval is not known: a fraction is 0 / 0.
    """

    class Begin(PythonComponent):
        outputs = ("y",)
        kind = "discrete"

        def step(self, t, h, u, y):  # noqa: ARG002
            y[0] = float(0.035 < t < 0.045 or t > 0.075)

    class Truth(Begin):
        def __init__(self) -> None:
            super().__init__()
            y = self.description.variables["y"]
            object.__setattr__(y, "type", "boolean")

    with System() as system:
        system.add("begin", Truth(), step="10 ms")
        path = clocked.build("countdown", tmp_path, fractions=fractions)
        system.add("c", path, step="10 ms", start={"u": 1.0})
        system.connect("begin.y", "c.begin")
        recording = system.run(0.12, record=["c.last", "c.ticks"])  # type: ignore[arg-type]
    assert recording["c.ticks"].tolist() == [0.0] * 6 + [1.0] * 4 + [2.0] * 3
    assert recording["c.last"][-1] == pytest.approx(0.095, abs=1e-12)


def test_what_an_output_clock_carries_shows_when_the_fmu_says_that_it_ticks(fmu: Build) -> None:
    found = run(fmu("tunable"))
    assert found["w"] == [0.0, 0.0, 0.0, 3.0, 3.0, 3.0, 6.0, 6.0, 6.0, 9.0, 9.0], "at every third tick"


def test_inputs_of_a_clock_are_taken_when_it_ticks(fmu: Build) -> None:
    with System() as system:
        system.add("ramp", Ramp(), step="10 ms")
        system.add("c", fmu("fixed"), step="10 ms", kind="discrete", start={"begin": False})
        system.connect("ramp.y", "c.u")
        recording = system.run(0.1, record=["c.y", "ramp.y"])
    assert recording["ramp.y"].tolist()[:5] == [1.0, 2.0, 3.0, 4.0, 5.0]
    assert recording["c.y"].tolist() == [1.0, 1.0, 4.0, 4.0, 9.0, 9.0, 16.0, 16.0, 25.0, 25.0, 36.0], (
        "every second sample counts"
    )


def test_an_input_that_is_set_between_ticks_waits_for_the_next(fmu: Build) -> None:
    with System() as system:
        system.add("c", fmu("fixed"), step="10 ms", start={"u": 1.0, "begin": False})
        with system.initialize(record=["c.y"]) as simulation:
            simulation.advance(0.03)
            simulation.set("c.u", 10.0)
            simulation.advance(0.06)
            assert simulation.recording["c.y"].tolist() == [0.0, 1.0, 1.0, 2.0, 2.0, 12.0, 12.0]


@pytest.mark.parametrize("kind", ["constant", "changing"])
def test_saved_states_hold_when_clocks_tick(fmu: Build, kind: str, raises) -> None:
    with System() as system:
        system.add("c", fmu(kind), step="15 ms", start={"u": 1.0, "begin": False})
        with system.initialize(record=["c.*"]) as simulation:
            simulation.advance(0.06)
            state = simulation.save()
            simulation.advance(0.15)
            once = simulation.recording["c.z"][-1]
            simulation.restore(state)
            simulation.advance(0.15)
            assert simulation.recording["c.z"][-1] == once
            system["c"].description.can_serialize = False
            with raises(CosimError):
                state.to_bytes()


@pytest.mark.parametrize("isolated", [False, True])
@pytest.mark.parametrize("kind", ["constant", "fixed", "tunable", "changing", "countdown"])
def test_states_in_files_hold_when_clocks_tick(fmu: Build, tmp_path: Path, kind: str, isolated: bool) -> None:
    """Bit for bit, within an interval and while an input waits for the next tick; another run records other outputs."""

    def build() -> System:
        system = System(allow_unconnected=True)
        system.add("c", fmu(kind), step="7 ms", start={"u": 1.0, "begin": False}, isolated=isolated)
        return system

    with build() as system, system.initialize(record=["c.*"]) as simulation:
        simulation.advance(0.084)
        simulation.set("c.u", 3.0)
        simulation.set("c.begin", True)
        if kind == "tunable":
            simulation.set("c.period", 0.013)
        file = simulation.save().write(tmp_path / "state")
        simulation.advance(0.42)
        whole = simulation.recording
    with build() as system:
        for names in (["c.*"], ["c.z"]):
            found = system.run(0.42, state=SystemState.read(file), record=names)
            for name in found.names:
                np.testing.assert_array_equal(found[name], whole[name][12:], err_msg=name)
    assert whole["c.ticks"][-1] > whole["c.ticks"][12]


def test_repeated_runs_are_alike(fmu: Build) -> None:
    with System() as system:
        system.add("c", fmu("changing"), step="10 ms", start={"u": 1.0, "begin": False})
        first, second = (system.run(0.1, record=["c.*"]) for _ in range(2))
    assert all(np.array_equal(first[n], second[n]) for n in first.names)


def test_clocks_are_no_inputs(fmu: Build) -> None:
    with System() as system:
        system.add("c", fmu("constant"), step="10 ms")
        assert system.unconnected() == ["c.u", "c.begin"], "clocks are no inputs to be connected"


@pytest.mark.parametrize(
    ("kind", "options"), [("triggered", {"event_mode": False}), ("constant", {"event_mode": False})]
)
def test_clocks_that_cannot_be_driven_are_refused_by_name(
    tmp_path: Path, kind: str, options: dict[str, bool], raises
) -> None:
    path = clocked.build(kind, tmp_path, **options)
    assert [c.name for c in FmuFile(path, quiet=True).description.clocks] == ["clock", "pulse"], "it can be looked at"
    with System() as system, raises(FmuError):
        system.add("c", path, step="10 ms")


def test_a_tick_within_a_step_needs_steps_of_other_lengths(tmp_path: Path, raises) -> None:
    path = clocked.build("changing", tmp_path, variable_step=False)
    assert run(path, 0.05)["ticks"][-1] == 3.0, "ticks begin steps: nothing is divided"
    with raises(ComponentError):
        run(path, 0.08, step="40 ms")


def test_early_return_and_endless_events_are_refused_by_name(fmu: Build, refused) -> None:
    refused(ComponentError, lambda: run(fmu("early")), lambda: run(fmu("endless")))


def test_intervals_and_shifts_that_no_clock_can_have_are_refused(fmu: Build, refused) -> None:
    wrong = [{"period": 0.0}, {"period": -0.01}, {"period": 0.01, "shift": -1.0}]
    refused(CosimError, *(lambda w=w: run(fmu("fixed"), **w) for w in wrong))


def outside_and_inside(path: Path, folder: Path, step: str, act: Act, **start: object) -> list[dict[str, np.ndarray]]:
    """What `act` records in a run of an FMU, and in a run of a system that was exported with it."""
    found = []
    with System() as system:
        system.add("c", path, step=step, start={"u": 1.0, "begin": False, **start})
        exported = system.export_fmu(folder / "Clocks.fmu")
        for made, name in ((system, "c"), (System(allow_unconnected=True), "s.c")):
            if made is not system:
                made.add("s", exported, step=step)
            with made, made.initialize(record=[f"{name}.*"]) as simulation:
                act(simulation, name)
                found.append({n.removeprefix("s."): simulation.recording[n].copy() for n in simulation.recording.names})
    return found


@pytest.mark.parametrize("kind", ["constant", "fixed", "tunable", "changing", "countdown"])
def test_exported_systems_tick_them_alike(fmu: Build, tmp_path: Path, kind: str) -> None:
    """Also after inputs are set, which wait for a tick, and after a tunable clock has another interval.

    A saved state is restored while an input waits.
    """

    def act(simulation: Simulation, name: str) -> None:
        simulation.advance(0.08)
        simulation.set(f"{name}.u", 3.0)
        simulation.set(f"{name}.begin", True)
        if kind == "tunable":
            simulation.set(f"{name}.period", 0.013)
        state = simulation.save()
        simulation.advance(0.2)
        simulation.restore(state)
        simulation.advance(0.4)

    run_, exported = outside_and_inside(fmu(kind), tmp_path, "40 ms", act)
    assert run_["c.ticks"][-1] == 1 if kind == "countdown" else run_["c.ticks"][-1] > 15
    for name in ("c.y", "c.z", "c.ticks", "c.last", "c.w"):
        np.testing.assert_array_equal(exported[name], run_[name], err_msg=name)


def test_a_call_that_is_refused_leaves_the_inputs_that_wait(fmu: Build, tmp_path: Path) -> None:
    """The FMU refuses a period of 2 s: of u, what waited before counts, or else what it was at the last tick."""
    with System() as system:
        system.add("c", fmu("tunable"), step="10 ms", start={"u": 1.0, "begin": False})
        path = system.export_fmu(tmp_path / "Refusing.fmu", outputs=["c.y"], parameters=["c.period"])
    about = fmpy.read_model_description(path)
    reference = {v.name: v.valueReference for v in about.modelVariables}
    made = fmpy.instantiate_fmu(fmpy.extract(path, tmp_path / "extracted"), about, "CoSimulation")
    made.enterInitializationMode()
    made.exitInitializationMode()
    names, shown = [reference["c.u"], reference["c.u"], reference["c.period"]], []
    for k, waits in enumerate([None, 10.0, None]):
        if waits is not None:
            made.setFloat64(names[:1], [waits])
        with pytest.raises(fmpy.fmi1.FMICallException):
            made.setFloat64(names, [100.0, 1000.0, 2.0])
        made.doStep(0.01 * k, 0.01)
        shown += made.getFloat64([reference["c.y"]])
    made.terminate()
    made.freeInstance()
    assert shown == [1.0, 11.0, 21.0]


@pytest.mark.parametrize("period", ["1/300", "0.0123456789", "0.007"])
def test_ticks_do_not_add_up_rounding(fmu: Build, period: str) -> None:
    exact = Fraction(period)
    start = {"u": 1.0, "begin": False, "period": float(exact), "shift": 0.001}
    with System() as system:
        system.add("c", fmu("fixed"), step="1/60", start=start)
        found = system.run(2, record=["c.last", "c.ticks"])
    for last, ticks in zip(found["c.last"][1:], found["c.ticks"][1:], strict=True):
        expected = float(Fraction(1, 1000) + (int(ticks) - 1) * exact)
        assert abs(last - expected) <= math.ulp(expected), "the FMU itself adds the length of a step to its time"


def test_exported_systems_name_components_whose_events_do_not_end(fmu: Build, tmp_path: Path, refused) -> None:
    def run_exported(kind: str) -> None:
        with System() as system, System(allow_unconnected=True) as outer:
            system.add("c", fmu(kind), step="10 ms")
            outer.add("s", system.export_fmu(tmp_path / "Clocks.fmu"), step="10 ms")
            outer.run(0.1, record=[])

    refused(ComponentError, lambda: run_exported("early"), lambda: run_exported("endless"))


@pytest.mark.parametrize("kind", ["constant", "fixed", "tunable"])
def test_check_ticks_them(fmu: Build, kind: str) -> None:
    """The FMU is strict, and no check asks of it what clocks do not allow."""
    chosen = ("description.clocks", "states.life", "runs.repeat", "runs.reset", "saved.replay")
    report = check(fmu(kind), Options(only=chosen))
    assert [str(f) for _, f in report.findings()] == []
    assert {r.check.id for r in report.results if not r.inapplicable} == set(chosen)


@pytest.mark.parametrize("kind", ["constant", "fixed", "changing"])
def test_isolated_fmus_give_the_same_bits(fmu: Build, kind: str) -> None:
    found = []
    for isolated in (False, True):
        with System() as system:
            system.add("c", fmu(kind), step="40 ms", start={"u": 1.0, "begin": False}, isolated=isolated)
            found.append(system.run(0.4, record=["c.*"]))
    here, there = found
    assert here["c.ticks"][-1] > 10
    assert all(np.array_equal(here[n], there[n]) for n in here.names)
