"""Saved, restored and serialized states; reset; instances that do not touch each other; memory."""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from api import ERROR, OK, WARNING, Library, Model
from applies import applies_to
from built import PROBE_NAMES

STEPS = 12
MEMORY = 2**21  # bytes that 10,000 instances may leave behind: room for the allocator, not for a leak of 210 bytes each


def test_save_and_restore_continue_bit_equal(fmu: Library) -> None:
    with fmu.instance() as a, fmu.instance() as b:
        a.initialize(fmu.stimulus.row(0))
        a.run(STEPS)
        state = a.save()
        first = a.run(STEPS, first=STEPS)
        a.restore(state)
        assert a.run(STEPS, first=STEPS).tobytes() == first.tobytes()
        b.restore(state)  # another instance, never initialized
        assert b.run(STEPS, first=STEPS).tobytes() == first.tobytes()
        a.must("GetFMUState", state)  # into the same block
        a.restore(state)
        assert a.run(STEPS, first=2 * STEPS).tobytes() == b.run(STEPS, first=2 * STEPS).tobytes()
        a.free_state(state)
        a.free_state(a.ffi.new("void**"))  # freeing nothing is fine


def test_serialized_states_continue_bit_equal(fmu: Library) -> None:
    with fmu.instance() as a, fmu.instance() as b:
        a.initialize(fmu.stimulus.row(0))
        a.run(STEPS)
        data = a.serialize()
        first = a.run(STEPS, first=STEPS)
        for instance in (a, b):
            instance.deserialize(data)
            assert instance.run(STEPS, first=STEPS).tobytes() == first.tobytes()
        b.reset()
        b.deserialize(data)
        assert b.serialize() == data


def test_serialized_bytes_are_no_state(fmu: Library) -> None:
    """Their checksum is of what they hold, and only DeserializeFMUState looks at it.

    A state in memory is told by its address.
    """
    with fmu.instance() as a:
        a.initialize(fmu.stimulus.row(0))
        data = a.serialize()
        state = a.ffi.new("void**", a.ffi.from_buffer(data))
        for function, argument in (("SetFMUState", state[0]), ("FreeFMUState", state)):
            assert a.call(function, argument) == ERROR
            assert "is not a state of this FMU" in a.last_message
        assert a.serialize() == data


def test_states_taken_during_initialization_and_model_exchange(fmu: Library) -> None:
    with fmu.instance() as a, fmu.instance() as b:
        a.enter_initialization()
        if fmu.inputs:
            a.set(fmu.stimulus.row(1))
        b.deserialize(a.serialize())
        for one in (a, b):
            one.must("ExitInitializationMode")
        assert a.run(STEPS).tobytes() == b.run(STEPS).tobytes()
    if fmu.is_continuous:
        with fmu.instance("me") as a, fmu.instance("me") as b, fmu.instance() as other:
            a.initialize(fmu.stimulus.row(0)).continuous_time()
            a.set_states(a.get_states() + 1e-3)
            b.deserialize(a.serialize())
            assert b.get_derivatives().tobytes() == a.get_derivatives().tobytes()
            state = a.save()
            assert other.call("SetFMUState", state[0]) == ERROR, "Co-Simulation instances have no such modes"
            assert "Model Exchange" in other.last_message
            a.free_state(state)


def test_damaged_states_are_refused(fmu: Library) -> None:
    with fmu.instance() as a:
        a.initialize(fmu.stimulus.row(0))
        a.run(2)
        data = a.serialize()
        damaged = {
            "empty": b"",
            "cut header": data[:7],
            "header only": data[:40],
            "cut body": data[:-1],
            "extended": data + b"\0",
            "doubled": data + data,
            "zeros": bytes(len(data)),
        }
        for at in (*range(0, 40, 4), 40, 41, len(data) // 2, len(data) - 1):
            if at not in range(12, 16):  # reserved
                damaged[f"byte {at}"] = data[:at] + bytes([data[at] ^ 0x10]) + data[at + 1 :]
        for what, blob in damaged.items():
            status, state = a.try_deserialize(blob)
            assert status == ERROR, what
            assert not state[0]
        assert a.serialize() == data


def test_foreign_states_are_refused(name: str, load: Callable[[str, int], Library]) -> None:
    others = [n for n in PROBE_NAMES if n != name]
    for fmi in (2, 3):
        fmu = load(name, fmi)
        with fmu.instance() as a:
            bits = a.serialize()
            for other in others:
                with load(other, fmi).instance() as b:
                    foreign = b.save()
                    assert a.call("SetFMUState", foreign[0]) == ERROR
                    assert fmu.name in a.last_message
                    assert a.try_deserialize(b.serialize())[0] == ERROR
                    b.free_state(foreign)
            assert a.serialize() == bits


def test_reset_equals_fresh(fmu: Library) -> None:
    row = fmu.stimulus.row(0)
    with fmu.instance() as a:
        a.initialize(row)
        fresh = a.run(STEPS).tobytes()
        bits = a.serialize()

        def check() -> None:
            a.reset()
            a.initialize(row)
            assert a.run(STEPS).tobytes() == fresh
            assert a.serialize() == bits

        check()
        parameters = [fmu.variables[n] for n in fmu.names("parameter", "real")]
        a.reset()
        moved = {v.name: v.start_value * 1.001 for v in parameters if (v.high or np.inf) >= v.start_value * 1.001 >= 0}
        if a.try_set(moved) <= WARNING and a.try_enter() <= WARNING:
            a.call("ExitInitializationMode")
        check()
        a.do_step(-1.0, 1.0)
        a.do_step(a.time, 1e300)
        check()
        a.must("Terminate")
        check()
        a.reset()
        a.enter_initialization()
        check()


@pytest.mark.skipif(not Path("/proc/self/statm").exists(), reason="reads the resident size from /proc")
def test_instances_leave_no_memory_behind(fmu: Library) -> None:
    with fmu.instance() as a:
        make = a.maker()
        get, free_state, free = (a.raw(f) for f in ("GetFMUState", "FreeFMUState", "FreeInstance"))
        at = a.ffi.new("void**")

        def cycle(n: int) -> None:
            for _ in range(n):
                handle = make()
                get(handle, at)
                free_state(handle, at)
                free(handle)

        cycle(500)
        for _ in range(3):  # the rest of this process may grow meanwhile, but not each time
            before = resident()
            cycle(10_000)
            grown = resident() - before
            if grown < MEMORY:
                break
        assert grown < MEMORY


def resident() -> int:
    """Resident memory of this process in bytes."""
    pages = int(Path("/proc/self/statm").read_text().split()[1])
    return pages * os.sysconf("SC_PAGE_SIZE")


def unbounded(fmu: Model) -> list[str]:
    """States that may start anywhere."""
    return [n for n in fmu.states if fmu.variables[n].initial == "exact" and fmu.variables[n].high is None]


@applies_to(unbounded)
def test_error_state_allows_reset_and_little_else(fmu: Library) -> None:
    """A component driven out of all bounds ends the step with an error; reset brings it back."""
    row = fmu.stimulus.row(0)
    with fmu.instance() as a:
        a.initialize(row)
        good = a.save()
        fresh = a.run(STEPS).tobytes()
        a.reset()
        assert a.try_set({unbounded(fmu)[0]: 1e30}) == OK
        a.enter_initialization()
        a.call("ExitInitializationMode")
        status = OK
        for k in range(3):
            status = max(status, a.do_step(k * fmu.step, fmu.step))
        assert status == ERROR
        assert a.do_step(0.0, fmu.step) == ERROR
        assert "'error'" in a.last_message
        a.restore(good)  # the standard promises this too
        assert a.run(STEPS).tobytes() == fresh
        a.free_state(good)
        a.reset()
        a.initialize(row)
        assert a.run(STEPS).tobytes() == fresh
