"""When things happen: sampling of discrete components, start states while initializing."""

from __future__ import annotations

import numpy as np
import pytest
from api import Instance, Library
from applies import applies_to, continuous, discrete, inputs


def outputs(a: Instance) -> bytes:
    return a.get(a.library.outputs).tobytes()


def test_initialization_commits_nothing(fmu: Library) -> None:
    """Reading outputs during initialization, under any inputs and any number of times, leaves no trace."""
    with fmu.instance() as a, fmu.instance() as b:
        for one in (a, b):
            one.enter_initialization()
        for k in (5, 3, 8, 0):
            if fmu.inputs:
                a.set(fmu.stimulus.row(k))
            a.get(fmu.outputs)
            a.get(fmu.outputs)
        if fmu.inputs:
            b.set(fmu.stimulus.row(0))
        assert outputs(a) == outputs(b)
        for one in (a, b):
            one.must("ExitInitializationMode")
        assert outputs(a) == outputs(b)
        assert a.run(10).tobytes() == b.run(10).tobytes()


@applies_to(inputs)
def test_outputs_follow_inputs_during_initialization(fmu: Library) -> None:
    """What initialization shows for inputs is what a fresh instance shows that knows nothing but these inputs."""
    with fmu.instance() as a, fmu.instance() as b:
        for one in (a, b):
            one.enter_initialization()
        a.set(fmu.stimulus.row(2))
        a.get(fmu.outputs)
        for one in (a, b):
            one.set(fmu.stimulus.row(9))
        assert outputs(a) == outputs(b)


@applies_to(discrete)
def test_discrete_outputs_before_the_first_sample_are_those_of_the_first_sample(fmu: Library) -> None:
    with fmu.instance() as a:
        a.initialize(fmu.stimulus.row(0))
        before = outputs(a)
        a.step(fmu.step)
        assert outputs(a) == before


@applies_to(discrete)
def test_many_samples_in_one_step(fmu: Library) -> None:
    """One doStep over several sample times equals single steps of the same inputs; the last sample's outputs remain."""
    with fmu.instance() as a, fmu.instance() as b:
        for one in (a, b):
            one.initialize(fmu.stimulus.row(0))
            if fmu.inputs:
                one.set(fmu.stimulus.row(1))
        a.step(7 * fmu.step)
        for k in range(7):
            assert b.do_step(k * fmu.step, fmu.step) == 0
        assert outputs(a) == outputs(b)
        b.time = a.time
        for one in (a, b):
            one.step(fmu.step)
        assert outputs(a) == outputs(b)


@applies_to(discrete)
def test_steps_shorter_than_the_sample_time_sample_once(fmu: Library) -> None:
    with fmu.instance() as a, fmu.instance() as b:
        for one in (a, b):
            one.initialize(fmu.stimulus.row(0))
        for k in range(6):
            if fmu.inputs:
                for one in (a, b):
                    one.set(fmu.stimulus.row(k))
            assert a.do_step(k * fmu.step, fmu.step) == 0
            for part in range(4):
                assert b.do_step((k + part / 4) * fmu.step, fmu.step / 4) == 0
                assert outputs(b) == outputs(a)  # hold until the next sample
                if fmu.inputs and part < 3:
                    b.set(fmu.stimulus.row(k + 1))  # between samples nobody looks
                    assert outputs(b) == outputs(a)


@pytest.mark.parametrize("start", [0.0, 1000.0])
def test_samples_are_counted_exactly(load, start: float) -> None:  # type: ignore[no-untyped-def]
    """Twenty thousand steps of a sample time that binary fractions cannot represent: as many samples."""
    for fmi in (2, 3):
        fmu: Library = load("ProbeDiscrete", fmi)
        with fmu.instance() as a:
            a.initialize(start=start)
            flags, last = a.ffi.new("bool[3]"), a.ffi.new("double*")
            tail = (True, *(() if fmi == 2 else (flags, flags + 1, flags + 2, last)))
            function, h = a.raw("DoStep"), fmu.step
            for k in range(20_000):
                assert function(a.handle, start + k * fmu.step, h, *tail) == 0
            samples, clock = a.get(["samples", "clock"])
            assert samples == 19_999  # before the last one
            assert clock == pytest.approx(start + 19_999 * fmu.step, abs=1e-9)


@applies_to(continuous)
def test_feedthrough_and_time_in_model_exchange(fmu: Library) -> None:
    """Outputs and derivatives follow time, states and inputs at once, in any order of calls."""
    with fmu.instance("me") as a, fmu.instance("me") as b:
        for one in (a, b):
            one.initialize(fmu.stimulus.row(0)).continuous_time()
        x = a.get_states()
        real = {n: v for n, v in fmu.stimulus.row(4).items() if fmu.variables[n].kind == "real"}
        a.set(real)
        a.must("SetTime", 0.01)
        a.set_states(x + 1e-3)
        b.set_states(x - 1e-3)
        b.get(fmu.outputs)
        b.set_states(x + 1e-3)
        b.must("SetTime", 0.01)
        b.get_derivatives()
        b.set(real)
        assert outputs(a) == outputs(b)
        assert a.get_derivatives().tobytes() == b.get_derivatives().tobytes()
        assert np.array_equal(a.get(fmu.derivatives), a.get_derivatives())
        assert np.array_equal(a.get(fmu.states), a.get_states())
        a.must("SetTime", 0.0321)
        late = outputs(a), a.get_derivatives().tobytes()
        b.reset()
        b.initialize(fmu.stimulus.row(0)).continuous_time()
        b.must("SetTime", 0.0321)
        b.set_states(x + 1e-3)
        b.set(real)
        assert (outputs(b), b.get_derivatives().tobytes()) == late
        before = outputs(a)
        a.must("Terminate")
        assert outputs(a) == before


def test_values_stay_readable_after_terminate(fmu: Library) -> None:
    with fmu.instance() as a, fmu.instance() as b:
        for one in (a, b):
            one.initialize(fmu.stimulus.row(0))
            one.step(fmu.step)
        expected = outputs(b)
        a.must("Terminate")
        assert outputs(a) == expected
