"""Stepping by hand: advance in pieces, stop conditions, save and restore, repeated runs, what ends a run early."""

import os
import signal

import numpy as np
import pytest
from probes import Clock, Delta, Integrator

from cosim import ComponentError, CosimError, Interrupted, PythonComponent, Record, Recording, StopWhen, System
from cosim.core.errors import CallFailed

pytestmark = pytest.mark.filterwarnings("ignore::cosim.UnconnectedInputsWarning")


def loop(delay=False):
    """A controller and a plant at different rates."""
    system = System()
    system.add("control", Delta(), step="3 ms")
    system.add("plant", Integrator(), step="2 ms", parameters={"gain": 5.0})
    system.connect("plant.y", "control.u", delay=delay)
    system.connect("control.y", "plant.u")
    return system


def same(a, b):
    assert a.names == b.names
    np.testing.assert_array_equal(a.time, b.time)
    np.testing.assert_array_equal(a.data, b.data)


@pytest.mark.parametrize("delay", [False, True])
@pytest.mark.parametrize("piece", ["1 ms", "3 ms", "4 ms", "7 ms"])
def test_advancing_in_pieces_equals_one_go(piece, delay):
    whole = loop(delay).run("84 ms", record=Record(interval="1 ms"))
    system = loop(delay)
    simulation = system.initialize(record=Record(interval="1 ms"))
    for i in range(1, 84 // int(piece[0]) + 1):
        simulation.advance(f"{i * int(piece[0])} ms")
    simulation.advance("84 ms", final=True)
    same(simulation.recording, whole)


def test_stop_condition_ends_at_the_first_sample_that_fulfils_it_and_can_be_continued():
    whole = loop().run(0.09)
    simulation = loop().initialize()
    assert simulation.advance(0.09, stop_when=[StopWhen("plant.y", ">=", 0.1)]) == "plant.y >= 0.1"
    result = simulation.recording
    assert result.stopped_by == "plant.y >= 0.1"
    assert result["plant.y"][-1] >= 0.1 > result["plant.y"][-2]
    np.testing.assert_array_equal(result.data, whole.data[: len(result)])
    assert simulation.advance(0.09, final=True) is None
    same(simulation.recording, whole)


def test_stop_condition_as_a_function_and_at_a_coarse_recording():
    def late(view):
        return view.time > 0.0105 and view["plant.y"] > 0

    result = loop().run(1, stop_when=[late], record=Record(["plant.y"], 0.01))
    assert result.stopped_by == "late"
    np.testing.assert_array_equal(result.time, [0.0, 0.01])


def test_stop_condition_on_a_variable_nobody_records():
    result = loop().run(1, record=["control.y"], stop_when=[StopWhen("plant.y", ">", 0.1)])
    assert result.names == ["control.y"]
    assert result.stopped_by


def test_unknown_relation(raises):
    with raises(CosimError):
        StopWhen("a.b", "=>", 1)


def test_save_and_restore_continue_bit_for_bit():
    whole = loop(delay=True).run(0.2)
    system = loop(delay=True)
    simulation = system.initialize()
    simulation.advance(0.05)
    state = simulation.save()
    simulation.advance(0.2)
    same(simulation.recording, whole)
    simulation.restore(state)
    assert simulation.time == 0.05
    simulation.set("plant.gain", -3.0)
    simulation.advance(0.2)
    assert simulation.recording["plant.y"][-1] != whole["plant.y"][-1]
    simulation.restore(state)
    simulation.advance(0.2)
    same(simulation.recording, whole)


def test_state_of_another_simulation_is_refused(raises):
    state = loop().initialize().save()
    with raises(CosimError):
        loop().initialize().restore(state)


def test_repeated_runs_start_fresh_and_take_new_parameters():
    system = loop()
    first = system.run(0.1)
    same(system.run(0.1), first)
    system["plant"].set(gain=1.0)
    other = system.run(0.1)
    assert other["plant.y"][-1] != first["plant.y"][-1]
    system["plant"].set({"gain": 5.0})
    same(system.run(0.1), first)


def test_a_closed_simulation_says_so():
    system = loop()
    old = system.initialize()
    system.initialize()
    with pytest.raises(CosimError, match="closed"):
        old.advance(1)


def test_cannot_go_back():
    simulation = loop().initialize()
    simulation.advance(0.1)
    with pytest.raises(ValueError, match=r"stands at 0\.1 s"):
        simulation.advance(0.05)


def test_start_time_and_nanoseconds():
    system = System()
    system.add("clock", Clock(), step="1/60")
    simulation = system.initialize(10)
    simulation.advance("601/60")
    assert simulation.time == 601 / 60
    assert simulation.time_ns == 10016666667
    np.testing.assert_array_equal(simulation.recording.time, [10.0, 601 / 60])


class Failing(PythonComponent):
    """Fails at t = 0.5 s in the way `how` says."""

    outputs = ("y",)
    default_step = "100 ms"

    def __init__(self, how):
        super().__init__()
        self._how = how

    def step(self, t, h, u, y):  # noqa: ARG002
        if t >= 0.5:
            self._how()
        y[0] = t


@pytest.mark.parametrize(("status", "name"), [(2, "Discard"), (3, "Error"), (4, "Fatal")])
def test_failure_names_component_time_and_message_and_keeps_the_recording(status, name, tmp_path):
    class Bad(Failing):
        def bind(self, *args):
            ports = super().bind(*args)

            def step(t, h):
                if t >= 0.5:
                    raise CallFailed("bad", "fmi2DoStep", status, "step", ["tire.force is not finite"])
                ports.step(t, h)

            return ports.of(ports.set_inputs, step, ports.get_outputs)

    system = System()
    system.add("bad", Bad(None))
    path = tmp_path / "new" / "out.csv"
    with pytest.raises(ComponentError, match=r"'bad'.*fmi2DoStep.*at t = 0\.5 s") as caught:
        system.run(1, output=path)
    error = caught.value
    assert (error.component, error.function, error.status, error.time) == ("bad", "fmi2DoStep", name, 0.5)
    assert "tire.force is not finite" in str(error)
    assert error.recording.time[-1] == 0.5
    same(Recording.read(path), error.recording)


def test_an_exception_in_a_python_component_is_its_error():
    def divide():
        return 1 / 0

    system = System()
    system.add("bad", Failing(divide))
    with pytest.raises(ComponentError, match="ZeroDivisionError") as caught:
        system.run(1)
    assert caught.value.recording.time[-1] == 0.5


def test_control_c_stops_between_two_instants_and_can_be_continued(tmp_path):
    def interrupt():
        os.kill(os.getpid(), signal.SIGINT)
        broken._how = lambda: None

    broken = Failing(interrupt)
    system = System()
    system.add("slow", broken)
    path = tmp_path / "out.csv"
    with pytest.raises(Interrupted) as caught:
        system.run(1000, output=path)
    kept = caught.value.recording
    assert 0.5 <= caught.value.time < 1000
    assert kept.time[-1] == caught.value.time
    assert len(Recording.read(path)) == len(kept)
    assert isinstance(caught.value, KeyboardInterrupt)
    assert signal.getsignal(signal.SIGINT) is signal.default_int_handler


def test_interrupted_simulation_goes_on():
    system = loop()
    fired = []

    def press(view):
        if view.time >= 0.05 and not fired:
            fired.append(view.time)
            os.kill(os.getpid(), signal.SIGINT)
        return False

    simulation = system.initialize()
    with pytest.raises(Interrupted):
        simulation.advance(0.2, stop_when=[press])
    simulation.advance(0.2)
    same(simulation.recording, loop().run(0.2))


def test_a_recording_that_cannot_be_written_is_refused_before_the_run(tmp_path, raises):
    (tmp_path / "file").write_text("")
    with raises(CosimError):
        loop().run(1, output=tmp_path / "file" / "out.csv")


def test_progress_bar_runs(monkeypatch):
    monkeypatch.setattr("cosim.engine.progress.ProgressBar.PATIENCE", 0.0)
    assert loop().run(1, progress=True).time[-1] == 1.0


def test_several_controllers_from_one_instant(raises, refused):
    """The plant continues from the saved state, a controller that takes over begins there."""

    def build():
        system = System()
        system.add("plant", Integrator(), step="2 ms")
        system.add("first", Delta(), step="2 ms")
        system.add("second", Integrator(), step="1 ms", parameters={"gain": -50.0, "x0": 1.0})
        system.connect("plant.y", "first.u")
        system.connect("first.y", "plant.u")
        return system

    whole = build().run(0.2, record=["plant.y", "first.y"])
    system = build()
    simulation = system.initialize()
    simulation.advance(0.1)
    state = simulation.save()
    unchanged = system.run(0.2, state=state, record=["plant.y", "first.y"])
    np.testing.assert_array_equal(unchanged.time, whole.time[100:])
    np.testing.assert_array_equal(unchanged.data, whole.data[100:])
    system.disconnect("plant.u")
    system.connect("second.y", "plant.u")
    system.connect("plant.y", "second.u")
    del state.components["second"]  # begins afresh
    other = system.run(0.2, state=state)
    assert other["plant.y"][0] == whole["plant.y"][100]
    assert other["second.y"][0] == 1.0
    assert other["plant.y"][-1] != whole["plant.y"][-1]
    with raises(CosimError):
        build().initialize(state=state)
    simulation = system.initialize()
    simulation.advance(0.001)
    within = simulation.save()
    assert system.initialize(state=within).time == 0.001  # as it was: within a step too
    system.disconnect("second.u")
    refused(CosimError, lambda: system.initialize(state=within), lambda: system.disconnect("plant.v"))
