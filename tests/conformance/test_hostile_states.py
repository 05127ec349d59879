"""Forged serialized states, with a checksum that fits.

Whatever the component takes for granted is checked.
"""

from __future__ import annotations

import math
import struct
from collections.abc import Iterator

import pytest
from api import ERROR, OK, Instance, Library, Model, Variable
from applies import applies_to, continuous
from built import PROBE_NAMES

# The layout of saved_state.h: FmuSnapshot, State, then parameters, inputs, states, derivatives, outputs, warm starts.
HEADER = struct.Struct("=IIIIQQQ")
BLOCK = struct.Struct("=dddqiiiiii")
FIELDS = (
    "time",
    "start_time",
    "stop_time",
    "sample",
    "mode",
    "has_stop",
    "started",
    "start_valid",
    "outputs_valid",
    "derivatives_valid",
)
STEP, TERMINATED = 16, 32
BAD = (math.nan, math.inf, -math.inf)


def checksum(data: bytes) -> int:
    """FNV-1a of words of 8 bytes, as the runtime has it."""
    h = 14695981039346656037
    for (word,) in struct.iter_unpack("=Q", data):
        h = ((h ^ word ^ (word >> 32)) * 1099511628211) & (2**64 - 1)
    return h


class State:
    """A serialized state taken apart."""

    def __init__(self, data: bytes) -> None:
        self.header = HEADER.unpack_from(data)
        self.fields = dict(zip(FIELDS, BLOCK.unpack_from(data, HEADER.size), strict=True))
        at = HEADER.size + BLOCK.size
        self.values = list(struct.unpack_from(f"={(len(data) - at) // 8}d", data, at))

    def bytes(self, **fields: float) -> bytes:
        """Put together again, with other fields and the checksum that belongs to them."""
        block = BLOCK.pack(*{**self.fields, **fields}.values())
        block += struct.pack(f"={len(self.values)}d", *self.values)
        return HEADER.pack(*self.header[:-1], checksum(block)) + block

    def with_value(self, at: int, value: float) -> bytes:
        """Put together again with another number among the values."""
        kept, self.values[at] = self.values[at], value
        data = self.bytes()
        self.values[at] = kept
        return data


def places(fmu: Library, causality: str) -> dict[str, int]:
    """Where parameters or inputs lie among the values."""
    first = 0 if causality == "parameter" else len(fmu.names("parameter"))
    return {n: first + i for i, n in enumerate(fmu.names(causality))}


def check_refused(a: Instance, data: bytes, what: str) -> None:
    """An error that says what is wrong, no state, and an instance that is as it was."""
    before = a.serialize()
    status, state = a.try_deserialize(data)
    assert status == ERROR, what
    assert not state[0]
    assert "cannot be a state of" in a.last_message
    assert what in a.last_message
    assert a.serialize() == before


def running(fmu: Library) -> Instance:
    a = fmu.instance()
    a.initialize(fmu.stimulus.row(0))
    a.run(3)
    return a


def test_a_state_put_together_again_is_accepted(fmu: Library) -> None:
    """So that the other tests refuse what they mean to."""
    with running(fmu) as a:
        data = a.serialize()
        assert State(data).bytes() == data
        assert a.try_deserialize(State(data).bytes(outputs_valid=0))[0] == OK


def test_two_signs_that_have_changed_are_damage(fmu: Library) -> None:
    """Each alone would change the checksum's highest bit, and both together nothing, if words were not folded."""
    with running(fmu) as a:
        data = bytearray(a.serialize())
        for word in (len(data) // 8 - 1, len(data) // 8 - 2):
            data[8 * word + 7] ^= 0x80
        status, _ = a.try_deserialize(bytes(data))
        assert status == ERROR
        assert "damaged" in a.last_message


def test_modes_flags_and_times(fmu: Library) -> None:
    with running(fmu) as a:
        state = State(a.serialize())
        assert state.fields["mode"] == STEP
        for mode in (0, 3, STEP | TERMINATED, 128, -1, 2**31 - 1, 4, 8):  # the last two belong to Model Exchange
            check_refused(a, state.bytes(mode=mode), "mode")
        for flag in FIELDS[5:]:
            for value in (2, -1, 2**31 - 1):
                check_refused(a, state.bytes(**{flag: value}), "flags")
        for name in FIELDS[:3]:
            for bad in BAD:
                check_refused(a, state.bytes(**{name: bad}), "time")
        check_refused(a, state.bytes(has_stop=1, stop_time=-1.0), "stop time")


def test_samples(fmu: Library) -> None:
    """Sample index and time belong together: otherwise a step would have millions of samples to catch up with."""
    with running(fmu) as a:
        state = State(a.serialize())
        sample = state.fields["sample"]
        wrong = {"started": 1 - state.fields["started"]}, {"sample": -1}, {"sample": 2**63 - 1}, {"sample": sample + 5}
        for fields in wrong:
            check_refused(a, state.bytes(**fields), "samples")
        if not fmu.is_continuous:
            check_refused(a, state.bytes(sample=0, started=0), "samples")
            check_refused(a, state.bytes(time=1e9), "samples")
            check_refused(a, state.bytes(start_time=-1e300), "samples")


def numbers(fmu: Library, state: State) -> Iterator[tuple[int, str]]:
    """Some positions of the values, with what the message has to say."""
    count = len(state.values)
    for causality in ("parameter", "input"):
        found = [(at, n) for n, at in places(fmu, causality).items()]
        yield from found[:: max(1, len(found) // 20)]
    first = len(fmu.names("parameter")) + len(fmu.names("input"))
    states = [(first + i, n) for i, n in enumerate(fmu.states)]
    yield from states
    if not fmu.is_continuous and first < count:
        yield first, ""  # hidden states or outputs


def test_numbers_that_are_not_finite(fmu: Library) -> None:
    with running(fmu) as a:
        state = State(a.serialize())
        for at, name in numbers(fmu, state):
            for bad in BAD:
                check_refused(a, state.with_value(at, bad), name)


def outside(v: Variable) -> list[float]:
    """Values that a parameter or an input cannot have."""
    if v.kind == "boolean":
        return [2.0, 0.5, -1.0]
    if v.kind == "integer":
        return [0.5, 1e300, *([] if v.high is None else [v.high + 1])]
    limits = ((v.low, -1.0), (v.high, 1e3)) if v.causality == "parameter" else ()
    return [limit + d for limit, d in limits if limit is not None]


def parameters_and_selectors(fmu: Model) -> list[str]:
    """Those that cannot have every finite value."""
    return [n for n in fmu.names("parameter") + fmu.inputs if outside(fmu.variables[n])]


@applies_to(parameters_and_selectors)
def test_parameters_and_selectors_outside_their_range(fmu: Library) -> None:
    with running(fmu) as a:
        state, strict = State(a.serialize()), set(parameters_and_selectors(fmu))
        for causality in ("parameter", "input"):
            found = [(n, at) for n, at in places(fmu, causality).items() if n in strict]
            for name, at in found[:: max(1, len(found) // 40)]:
                for value in outside(fmu.variables[name]):
                    if value != state.values[at]:  # a limit so large that nothing is added
                        check_refused(a, state.with_value(at, value), name)


@pytest.mark.parametrize("name", [n for n in PROBE_NAMES if n == "ProbeQpDaqp"])
def test_active_rows_of_daqp(fmu: Library) -> None:
    """Its memory: the number of active rows, then each row by its number with a sign.

    Three variables, five rows: room for four that are active.
    """
    with running(fmu) as a:
        state = State(a.serialize())
        count = len(state.values) - 5
        active = int(state.values[count])
        assert 1 <= active <= 3, "no active row to spoil"
        assert all(1 <= abs(row) <= 5 for row in state.values[count + 1 : count + 1 + active])
        for at in (count, count + 1):
            for bad in (*BAD, 1e9, -1e9, 6.0, 0.5, 2.0**40, 1e300):
                check_refused(a, state.with_value(at, bad), "quadratic programs")
        check_refused(a, state.with_value(count + 1, 0.0), "quadratic programs")
        for row in (1.0, -5.0):  # not what it left there, but rows of the program
            status, made = a.try_deserialize(state.with_value(count + 1, row))
            assert status == OK
            a.restore(made)
            assert a.do_step(3 * fmu.step, fmu.step) == OK
            a.free_state(made)


@pytest.mark.parametrize("name", [n for n in PROBE_NAMES if n == "ProbeQpOsqp"])
def test_iterate_of_osqp(fmu: Library) -> None:
    with running(fmu) as a:
        state = State(a.serialize())
        for bad in BAD:
            check_refused(a, state.with_value(len(state.values) - 1, bad), "quadratic programs")
        a.deserialize(state.with_value(len(state.values) - 1, 1e300))
        a.step(fmu.step)


@applies_to(continuous)
def test_a_state_left_by_an_error_can_be_kept(fmu: Library) -> None:
    """Its numbers are as the error left them; it is restored, and is an error still."""
    with running(fmu) as a:
        state = State(a.serialize())
        first = len(fmu.names("parameter")) + len(fmu.names("input"))
        status, made = a.try_deserialize(state.bytes(mode=64, outputs_valid=0))
        assert status == OK
        state.values[first] = math.nan
        a.free_state(made)
        a.deserialize(state.bytes(mode=64, outputs_valid=0))
        assert a.do_step(a.time, fmu.step) == ERROR
        assert math.isnan(a.get(fmu.states)[0])
        a.reset()
        a.initialize(fmu.stimulus.row(0))
        a.run(2)
