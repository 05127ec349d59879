"""What users do with a batch, and do wrong; copies that fail."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import awkward
import numpy as np
import pytest
from built import FMUS
from same import bits

from cosim import (
    ComponentError,
    CosimError,
    PythonComponent,
    Record,
    System,
    TimeError,
    UnconnectedInputsWarning,
    WiringError,
)
from cosim.batch import Batch, CopyFailedWarning

pytestmark = [
    pytest.mark.filterwarnings("ignore::cosim.UnconnectedInputsWarning"),
    pytest.mark.usefixtures("built_fmus"),
]
PLANT = FMUS / "fmi3" / "QuarterCarBench.fmu"
OUTPUTS = ["plant.body.z", "plant.body.az"]


@pytest.fixture
def bench() -> Iterator[System]:
    """A quarter car that nothing drives."""
    with System() as system:
        system.add("plant", PLANT, step="1 ms")
        yield system


def test_inputs_and_outputs_are_arrays(bench: System) -> None:
    batch = Batch(bench, 5, inputs=["plant.force", "plant.road.*"], outputs=OUTPUTS, start={"plant.body.mass": 2.3})
    assert batch.input_names == ["plant.force", "plant.road.height", "plant.road.rate"]
    assert batch.output_names == OUTPUTS
    assert batch.outputs.shape == (5, 2)
    force = np.zeros((5, 3))
    force[:, 0] = np.arange(5.0)
    got = batch.step("10 ms", force)
    assert batch.time == 0.01
    assert got.shape == (5, 2)
    assert np.all(np.diff(got[:, 0]) > 0)
    np.testing.assert_array_equal(batch["plant.body.z"], got[:, 0])
    with bench.initialize(record=Record(watch=OUTPUTS)) as simulation:
        bench["plant"].set({"body.mass": 2.3})
    with bench.initialize(record=Record(watch=OUTPUTS)) as simulation:
        simulation.set("plant.force", 4.0)
        simulation.advance("10 ms")
        assert [simulation[n] for n in OUTPUTS] == got[4].tolist()


@pytest.mark.parametrize("copies", [10**10, 10**20])
def test_more_copies_than_fit_into_memory_are_refused(bench: System, copies: int) -> None:
    with pytest.raises(CosimError, match=rf"^{copies} copies .* [\d.e+]+ GB .* [\d.]+ GB"):
        Batch(bench, copies)


@pytest.mark.parametrize("duration", ["0.3 ms", 0.0015, "1/3"])
def test_a_step_ends_at_a_tick(bench: System, duration: str | float, raises) -> None:
    """Otherwise steps of 0.3 ms would take 1 ms each."""
    with Batch(bench, 2, inputs="plant.force", outputs=OUTPUTS) as batch:
        with raises(TimeError):
            batch.step(duration, np.ones((2, 1)))
        assert (batch.time, batch["plant.body.z"].tolist()) == (0.0, [0.0, 0.0])
        batch.step("3 ms", np.ones((2, 1)))
        assert batch.time == 0.003


def test_a_reset_begins_again(bench: System) -> None:
    with Batch(bench, 3, inputs="plant.force", outputs=OUTPUTS, record="plant.*") as batch:
        force = np.array([[1.0], [2.0], [3.0]])
        first, recorded = batch.step("20 ms", force), batch.recording
        batch.advance(0.1)
        batch.reset()
        assert batch.time == 0
        np.testing.assert_array_equal(batch.step("20 ms", force), first)
        np.testing.assert_array_equal(bits(batch.recording.data), bits(recorded.data))
        batch.reset({"plant.body.mass": [2.0, 2.5, 3.0]})
        other = batch.step("20 ms", force)
        assert not np.array_equal(other, first)
        batch.reset()
        np.testing.assert_array_equal(batch.step("20 ms", force), first)


def test_steps_in_pieces_are_those_in_one_go(bench: System) -> None:
    def run(times: list[float]) -> np.ndarray:
        masses, force = [2.0, 2.5, 3.0], [[1.0], [2.0], [-1.0]]
        with Batch(
            bench, 3, start={"plant.body.mass": masses}, inputs="plant.force", record=Record("plant.*", "3 ms")
        ) as batch:
            batch.set(force)
            for t in times:
                batch.advance(t)
            recording = batch.recording
        assert recording.time.tolist() == [k * 3 / 1000 for k in range(34)]
        assert recording.data.shape == (3, 34, len(recording.names))
        np.testing.assert_array_equal(
            recording["plant.body.z"], recording.data[:, :, recording.names.index("plant.body.z")]
        )
        one = recording.one(1)
        assert (one.names, one.time.tolist()) == (recording.names, recording.time.tolist())
        np.testing.assert_array_equal(one["plant.body.z"], recording["plant.body.z"][1])
        return recording.data

    np.testing.assert_array_equal(bits(run([0.1])), bits(run([0.001, 0.001, 0.0045, 0.006, 0.05, 0.1])))


def test_it_says_what_runs_how(bench: System, follower: dict[int, Path]) -> None:
    bench.add("other", follower[3], step="10 ms")
    with Batch(bench, 3, threads=1) as batch:
        text = str(batch)
        assert "3 copies" in text
        assert "in lanes:\n     plant (QuarterCarBench)" in text
        assert "other" in batch.scalar
        assert "no FMU of this project" in text


def test_other_vectors_than_the_processor_has(bench: System) -> None:
    with pytest.raises(CosimError, match=r"'auto', 'avx512', 'avx2', 'baseline'|auto, avx512, avx2, baseline"):
        Batch(bench, 3, vectors="sse9")


@pytest.mark.parametrize(
    "arguments",
    [
        {"copies": 0},
        {"copies": 3, "threads": 0},
        {"copies": 3, "start": {"plant.body.mas": 1.0}},
        {"copies": 3, "start": {"car.body.mass": 1.0}},
        {"copies": 3, "start": {"plant.body.mass": [1.0, 2.0]}},
        {"copies": 3, "start": {"plant.body.mass": [2.0, float("nan"), 2.0]}},
        {"copies": 3, "start": {"plant.body.mass": [2.0, 2.0, -1.0]}},
        {"copies": 3, "inputs": ["plant.forc"]},
        {"copies": 3, "inputs": ["plant.body.mass"]},
        {"copies": 3, "outputs": ["plant.body.q"]},
        {"copies": 3, "stop_when": [bool]},
    ],
)
def test_what_does_not_fit_is_named(bench: System, arguments: dict, raises) -> None:
    with raises(CosimError):
        Batch(bench, **arguments)


def test_inputs_that_do_not_fit(bench: System, raises) -> None:
    batch = Batch(bench, 3, inputs=["plant.force", "plant.road.height"])
    with pytest.raises(WiringError, match=r"shape \(3,\); give \(3, 2\)"):
        batch.set(np.zeros(3))
    wrong = np.zeros((3, 2))
    wrong[1, 1] = np.nan
    with pytest.raises(WiringError, match=r"copy 1: plant.road.height is nan"):
        batch.set(wrong)
    with pytest.raises(KeyError, match=r"plant.body.z"):
        batch["plant.body.z"]
    batch.advance(0.01)
    with raises(TimeError):
        batch.advance(0)


def test_limits_of_inputs_are_those_of_a_simulation() -> None:
    with System() as system:
        system.add("law", FMUS / "fmi3" / "PreviewLqComfort5ms.fmu")
        batch = Batch(system, 2, inputs=["law.preview.step"])
        with pytest.raises(WiringError, match=r"copy 1: .*preview.step must equal 0.005 s"):
            batch.set([[0.005], [0.007]])


def test_inputs_that_are_driven_or_free(bench: System, raises) -> None:
    bench.add("road", FMUS / "fmi3" / "RoadBenchBump.fmu")
    bench.connect_matching("road", "plant")
    with raises(WiringError):
        Batch(bench, 3, inputs=["plant.road.height"])
    with pytest.warns(UnconnectedInputsWarning, match=r"plant\.force"):
        Batch(bench, 3)


def test_python_in_the_loop_is_refused(bench: System, raises) -> None:
    class Gain(PythonComponent):
        outputs = ("y",)

    bench.add("p", Gain(), step="1 ms")
    with raises(CosimError):
        Batch(bench, 3)


def test_a_copy_that_fails_costs_itself_only(bench: System) -> None:
    """Its message is that of a run of its own; the bits of the others are as without it."""
    with Batch(bench, 6, inputs="plant.force", outputs=OUTPUTS, record=OUTPUTS, threads=2) as batch:
        force = np.full((6, 1), 1.0)
        fine = batch.step("50 ms", force)
        batch.reset()
        force[4] = 1e300
        with pytest.warns(CopyFailedWarning, match=r"copy 4 ended at t = 0 s: component 'plant'"):
            got = batch.step("50 ms", force)
        (failure,) = batch.failures
        assert (failure.copy, failure.component, failure.time) == (4, "plant", 0.0)
        assert batch.running.tolist() == [True, True, True, True, False, True]
        assert "1 ended" in str(batch)
        assert np.isnan(got[4]).all()
        np.testing.assert_array_equal(np.delete(got, 4, 0), np.delete(fine, 4, 0))
        assert np.isnan(batch.recording.data[4, 1:]).all()
        assert np.isfinite(np.delete(batch.recording.data, 4, 0)).all()
        batch.step("10 ms", np.where(force > 10, np.nan, force))  # nothing is asked of it any more
        batch.reset()
        assert batch.running.all()
    with bench.initialize() as simulation:
        simulation.set("plant.force", 1e300)
        with pytest.raises(ComponentError) as alone:
            simulation.advance("50 ms")
    said = failure.message.partition(": ")[2]
    assert said.startswith("state ")
    assert said in str(alone.value)


def test_all_copies_may_fail(bench: System) -> None:
    batch = Batch(bench, 3, inputs="plant.force", outputs=OUTPUTS)
    with pytest.warns(CopyFailedWarning):
        batch.step("10 ms", np.full((3, 1), 1e300))
    assert len(batch.failures) == 3
    assert np.isnan(batch.step("10 ms")).all()
    assert batch.time == 0.02


def test_a_copy_that_cannot_be_initialized(bench: System) -> None:
    start = {"plant.tire.stiffness": [1250.0, 1e8, 1300.0]}
    with pytest.warns(CopyFailedWarning, match=r"copy 1 ended at t = 0 s: .*plant"):
        batch = Batch(bench, 3, start=start, outputs=OUTPUTS, inputs="plant.force")
    assert "unstable" in batch.failures[0].message
    batch.step(0.01, np.ones((3, 1)))
    assert batch.running.tolist() == [True, False, True]
    assert np.isfinite(batch.outputs[[0, 2]]).all()
    with pytest.raises(ComponentError, match="unstable"):
        Batch(bench, 2, start={"plant.tire.stiffness": 1e8})


@pytest.mark.parametrize("version", [2, 3])
def test_a_copy_of_a_foreign_fmu_that_fails(version: int, awkward_fmus: dict[int, Path]) -> None:
    with System() as system:
        system.add("m", awkward_fmus[version], step="10 ms", start={"at": 0.1, "value": 3.0})
        start = {"m.trouble": [awkward.NONE, awkward.STATUS, awkward.NOT_FINITE]}
        system.allow_unconnected = True
        with Batch(system, 3, start=start, outputs=["m.y"]) as batch:
            with pytest.warns(CopyFailedWarning):
                batch.advance(0.3)
            assert sorted((f.copy, f.component) for f in batch.failures)[:1] == [(1, "m")]
            said = {f.copy: f.message for f in batch.failures}
            assert "Error" in said[1]
            assert batch.running[0]
        system["m"].set({"trouble": awkward.STATUS})
        with pytest.raises(ComponentError) as alone:
            system.run(0.3)
        assert said[1] == str(alone.value)
