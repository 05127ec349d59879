"""What goes wrong in a run: the message, the time and the recording."""

from __future__ import annotations

from fractions import Fraction
from typing import Any

import awkward
import numpy as np
import pytest
from ctrl_c import ctrl_c
from oracles.exchange_rule import by_the_rule
from rich.progress import Progress
from same import assert_same, bits, outcome

from build_fmus.compile import CompileError
from cosim import CosimError, Execution, Interrupted, PythonComponent, Record, Recording, StopWhen, System
from cosim.engine import library
from cosim.recording.spool import spool_of

pytestmark = pytest.mark.filterwarnings("ignore::cosim.UnconnectedInputsWarning")

TROUBLES = [
    *((awkward.STATUS, status) for status in (1, 2, 3, 4, 5, 77, -1)),
    *((awkward.GET_STATUS, status) for status in (1, 3, 4)),
    *((awkward.NOT_FINITE, value) for value in (float("nan"), float("inf"), -float("inf"))),
    (awkward.END, 0.0),
    (awkward.END_EARLY, 0.0),
    (awkward.NONE, 0.0),
]


class Breaks(PythonComponent):
    """Breaks at 0.3 s in the way that it is told; before that it counts."""

    outputs = ("y",)
    parameters = {"how": ""}  # noqa: RUF012

    def step(self, t: float, h: float, u: Any, y: Any) -> None:  # noqa: ARG002
        if t > 0.29:
            if self.how == "raise":
                raise ValueError("the spring is broken")
            if self.how == "interrupt":
                raise KeyboardInterrupt
            if self.how:
                y[0] = float(self.how)
                return
        y[0] += 1.0


@pytest.mark.parametrize("version", [2, 3])
@pytest.mark.parametrize("kind", ["continuous", "discrete"])
@pytest.mark.parametrize(("trouble", "value"), TROUBLES)
def test_an_fmu_in_trouble(awkward_fmus, follower, version, kind, trouble, value):
    """Beside components that run before and after it.

    Some are in a group where one reads what the other has just reached.
    """

    def made() -> System:
        system = System()
        parameters = {"trouble": trouble, "at": 0.3, **({"value": value} if np.isfinite(value) else {})}
        system.add("m", awkward_fmus[version], step="50 ms", kind=kind, parameters=parameters)
        if not np.isfinite(value):
            system["m"].values["value"] = value
        for name, step in (("a", "10 ms"), ("z", "30 ms")):
            system.add(name, follower[version], step=step, start={"u": 1.0})
        system.connect("a.off", "z.on")
        if kind == "continuous":
            system.group("all", ["z", "m", "a"], "gauss-seidel")
        return system

    def run() -> Recording:
        with made() as system:
            return system.run(0.6)

    said, recording = outcome(run)
    assert recording is not None
    assert len(recording) > 10
    harmless = trouble == awkward.NONE or (trouble != awkward.NOT_FINITE and value == 1)
    if harmless or trouble in (awkward.END, awkward.END_EARLY):
        assert said == ""
        assert (recording.stopped_by is None) == harmless
        with made() as system:
            expected = by_the_rule(system, "0.6", recording.names)
        expected.stopped_by = recording.stopped_by
        assert_same(recording, expected)
    else:
        assert "'m'" in said or "m.y" in said


@pytest.mark.parametrize("how", ["raise", "interrupt", "nan", "inf", ""])
def test_a_python_component_in_trouble(follower, how):
    def run() -> Recording:
        with System() as system:
            system.add("p", Breaks(), step="20 ms", parameters={"how": how})
            system.add("f", follower[3], step="10 ms")
            system.connect("p.y", "f.u")
            return system.run(0.6)

    said, recording = outcome(run)
    assert {"raise": "the spring is broken", "interrupt": "Interrupted", "nan": "y is nan", "inf": "y is inf", "": ""}[
        how
    ] in said
    assert how == "interrupt" or recording is not None


def test_not_finite_values_are_handed_on_where_that_is_allowed(follower):
    def run() -> Recording:
        with System() as system:
            system.add("p", Breaks(), step="20 ms", parameters={"how": "nan"})
            system.add("f", follower[2], step="10 ms")
            system.connect("p.y", "f.u")
            return system.run(0.6, execution=Execution(allow_nan=True))

    said, recording = outcome(run)
    assert said == ""
    assert np.isnan(recording["f.y"][-1])


def test_what_can_be_read_and_what_cannot_end_a_run(follower):
    """The name of a stop condition may be wrong."""

    def run() -> Recording:
        with System() as system:
            system.add("f", follower[2], step="10 ms", start={"u": 1.0})
            with system.initialize(record=["f.y"]) as simulation:
                simulation.advance(0.1, stop_when=[StopWhen("f.x", ">", 0.0)])
                return simulation.recording

    said, _ = outcome(run)
    assert "f.x" in said


def test_a_function_as_stop_condition_sees_the_same(follower):
    def run() -> Recording:
        def late(view: Any) -> bool:
            return view.time > 0.05 and view["f.y"] > 0.0

        with System() as system:
            system.add("f", follower[2], step="10 ms", start={"u": 1.0})
            return system.run(0.2, stop_when=[late])

    said, recording = outcome(run)
    assert (said, recording.stopped_by) == ("", "late")
    assert recording.time[-1] == 0.06


def test_times_that_doubles_do_not_divide_exactly(follower):
    """A tick so short that one division of doubles would not be correctly rounded."""
    with System() as system:
        system.add("f", follower[2], step="1 ms")
        system.add("g", follower[2], step="1/1000003")
        recording = system.run("10000000.01", start_time=10**7)
    expected = [float(10**7 + Fraction(k, 1000003)) for k in range(len(recording))]
    assert recording.time.tolist() == expected
    assert len(recording) == 10001


def test_without_a_compiler_it_says_what_to_install(follower, monkeypatch, raises):
    monkeypatch.setattr(library, "find_toolchain", none)
    library.library.cache_clear()
    try:
        with System() as system, raises(CosimError):
            system.add("f", follower[2], step="10 ms")
            system.run(0.1)
    finally:
        library.library.cache_clear()


def none(_: str) -> None:
    raise CompileError("no C compiler in PATH")


def test_ctrl_c_ends_a_compiled_run_between_two_instants(follower):
    """It comes while the engine runs, is seen when that comes back, and the simulation can be continued."""
    with System() as system:
        system.add("f", follower[3], step="1 ms", start={"u": 30.0})
        with system.initialize(record=Record(["f.y"], "1 s")) as simulation:
            with ctrl_c(after=1.0), pytest.raises(Interrupted, match="interrupted at t ="):
                simulation.advance(10**9)
            reached = simulation.time
            assert 0 < reached < 10**9
            simulation.advance(reached + 1)
            assert simulation.time > reached


def test_ctrl_c_keeps_what_a_compiled_run_has_recorded(follower, tmp_path):
    """Raised with the recording, which is in the file too; both are the begin of a run that nobody has interrupted."""
    with System() as system:
        system.add("f", follower[2], step="1 ms", start={"u": 30.0})
        csv = tmp_path / "run.csv"
        part = spool_of(csv)
        with ctrl_c(lambda: part.exists() and part.stat().st_size > 1000), pytest.raises(Interrupted) as raised:
            system.run(10**9, record=Record(["f.y"], "1 s"), output=csv)
        kept = raised.value.recording
        whole = system.run(kept.time[-1], record=Record(["f.y"], "1 s"))
    assert len(kept) > 2
    np.testing.assert_array_equal(bits(kept.time), bits(whole.time))
    np.testing.assert_array_equal(bits(kept.data), bits(whole.data))
    rows = np.loadtxt(csv, delimiter=",", skiprows=1)
    np.testing.assert_array_equal(bits(rows), bits(np.column_stack([kept.time, kept.data])))
    assert [p.name for p in tmp_path.iterdir()] == ["run.csv"]


def test_the_progress_bar_of_a_compiled_run_moves(follower, monkeypatch):
    """From where the simulation stands to the end, while the engine runs."""
    seen: list[tuple[float, float, str]] = []

    def update(self: Progress, task: Any, *, completed: float, description: str) -> None:
        seen.append((completed, self.tasks[task].total or 0.0, description))

    monkeypatch.setattr(Progress, "update", update)
    monkeypatch.setattr("cosim.engine.progress.ProgressBar.PATIENCE", 0.0)
    with System() as system:
        system.add("f", follower[3], step="1 ms", start={"u": 30.0})
        with system.initialize(record=Record(["f.y"], "1 s")) as simulation:
            simulation.advance(1)
            simulation.advance(101, progress=True)
    done = [completed for completed, _, _ in seen]
    assert len(done) > 3
    assert done == sorted(set(done))
    assert {total for _, total, _ in seen} == {100.0}
    assert 0 < done[0] < 1
    assert (done[-1], seen[-1][2]) == (100.0, "101 of 101 s")
