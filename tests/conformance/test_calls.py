"""The state machine: every function in every state, and every function with arguments it cannot use."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import pytest
from api import DISCARD, ERROR, NEVER, OK, Instance, Library, Model
from applies import applies_to

# States of an instance, one letter each.
INSTANTIATED, INITIALIZATION, EVENT, CONTINUOUS, STEP, TERMINATED = "INECST"
EVERYWHERE = "INECST"
READ, RUNNING, DERIVATIVES = "NECST", "ECS", "NECT"

Arguments = Callable[[Instance], tuple[Any, ...]]


@dataclass(frozen=True)
class Function:
    """Where a function may be called, with arguments that are right there, and what it then returns."""

    name: str
    states: str
    arguments: Arguments = lambda a: ()
    returns: int = OK
    interface: str = ""  # "me": only on Model Exchange instances
    continuous: bool = False  # an error in discrete components


def nothing(n: int) -> Arguments:
    """`n` empty arrays, each with its length 0."""
    return lambda a: (None, 0) * n


ROOM = 1 << 20  # bytes for a serialized state, more than any FMU here needs


def values(a: Instance) -> tuple[Any, ...]:
    """An empty list of references with its empty list of values."""
    return (None, 0, None) if a.fmi == 2 else (None, 0, None, 0)


def states(a: Instance) -> tuple[Any, ...]:
    """Room for the continuous states."""
    n = len(a.library.states)
    return a.ffi.new("double[]", n), n


def room(*kinds: str) -> Arguments:
    """Pointers to fresh results of the given C types."""
    return lambda a: tuple(a.ffi.new(f"{k}*") for k in kinds)


def step(a: Instance) -> tuple[Any, ...]:
    h = a.library.step
    return (0.0, h, True, *(() if a.fmi == 2 else room("bool", "bool", "bool", "double")(a)))


def snapshot(a: Instance) -> Any:
    state = a.save()
    KEEP.append((a, state))
    return state


KEEP: list[tuple[Instance, Any]] = []


def serialized(a: Instance) -> tuple[Any, ...]:
    data = a.serialize()
    return data, len(data)


COMMON = [
    Function("SetDebugLogging", EVERYWHERE, lambda a: (True, 0, None)),
    Function("ExitInitializationMode", INITIALIZATION),
    Function("Terminate", RUNNING),
    Function("Reset", EVERYWHERE),
    Function("EnterContinuousTimeMode", EVENT),
    Function("SetTime", EVENT + CONTINUOUS, lambda a: (0.5,)),
    Function("SetContinuousStates", CONTINUOUS, states),
    Function("GetContinuousStates", DERIVATIVES, states, interface="me"),
    Function("GetContinuousStateDerivatives", DERIVATIVES, states, interface="me"),
    Function("GetNominalsOfContinuousStates", DERIVATIVES, states, interface="me"),
    Function("GetEventIndicators", DERIVATIVES, nothing(1), interface="me"),
    Function("GetFMUState", EVERYWHERE, lambda a: (snapshot(a),)),
    Function("SetFMUState", EVERYWHERE, lambda a: (snapshot(a)[0],)),
    Function("FreeFMUState", EVERYWHERE, lambda a: (a.save(),)),
    Function("SerializedFMUStateSize", EVERYWHERE, lambda a: (snapshot(a)[0], *room("size_t")(a))),
    Function("SerializeFMUState", EVERYWHERE, lambda a: (snapshot(a)[0], a.ffi.new("char[]", ROOM), ROOM)),
    Function("DeserializeFMUState", EVERYWHERE, lambda a: (*serialized(a), loose(a))),
    Function("DoStep", STEP, step),
]
FMI2 = [
    *COMMON,
    Function("SetupExperiment", INSTANTIATED, lambda a: (False, 0.0, 0.0, False, 0.0)),
    Function("EnterInitializationMode", INSTANTIATED),
    *(Function(f"Get{t}", READ, values) for t in ("Real", "Integer", "Boolean", "String")),
    Function("SetReal", "INECS", values),
    *(Function(f"Set{t}", "INES", values) for t in ("Integer", "Boolean", "String")),
    Function("GetDirectionalDerivative", READ, lambda a: (*nothing(2)(a), None, None), continuous=True),
    Function("EnterEventMode", EVENT + CONTINUOUS),
    Function("NewDiscreteStates", EVENT, room("EventInfo")),
    Function("CompletedIntegratorStep", CONTINUOUS, lambda a: (True, *room("int", "int")(a))),
    *(Function(n, "") for n in NEVER[2]),
    Function("GetStatus", "ST", lambda a: (0, *room("int")(a)), DISCARD, "cs"),
    Function("GetRealStatus", "ST", lambda a: (2, *room("double")(a)), interface="cs"),
    Function("GetIntegerStatus", "ST", lambda a: (0, *room("int")(a)), DISCARD, "cs"),
    Function("GetBooleanStatus", "ST", lambda a: (3, *room("int")(a)), interface="cs"),
    Function("GetStringStatus", "ST", lambda a: (1, *room("const char*")(a)), DISCARD, "cs"),
]
TYPES3 = ("Int8", "UInt8", "Int16", "UInt16", "Int32", "UInt32", "Int64", "UInt64", "Boolean", "String")
FMI3 = [
    *COMMON,
    Function("EnterInitializationMode", INSTANTIATED, lambda a: (False, 0.0, 0.0, False, 0.0)),
    *(Function(f"Get{t}", READ, values) for t in ("Float32", "Float64", *TYPES3)),
    *(Function(f"Set{t}", "INECS", values) for t in ("Float32", "Float64")),
    *(Function(f"Set{t}", "INES", values) for t in TYPES3),
    Function("GetBinary", READ, lambda a: (*nothing(1)(a), None, None, 0)),
    Function("SetBinary", "INES", lambda a: (*nothing(1)(a), None, None, 0)),
    *(Function(f"Get{kind}Derivative", READ, nothing(4), continuous=True) for kind in ("Directional", "Adjoint")),
    Function("EnterEventMode", CONTINUOUS),
    Function("UpdateDiscreteStates", EVENT, room(*["bool"] * 5, "double")),
    Function("CompletedIntegratorStep", CONTINUOUS, lambda a: (True, *room("bool", "bool")(a))),
    Function("GetNumberOfEventIndicators", EVERYWHERE, room("size_t"), interface="me"),
    Function("GetNumberOfContinuousStates", EVERYWHERE, room("size_t"), interface="me"),
    *(Function(n, "") for n in NEVER[3]),
]
TABLES = {2: FMI2, 3: FMI3}


def loose(a: Instance) -> Any:
    """Room for an FMU state that is freed with the others."""
    state = a.ffi.new("void**")
    KEEP.append((a, state))
    return state


def put_into(a: Instance, state: str) -> None:
    """Bring a new instance into a state."""
    if state == INSTANTIATED:
        return
    assert a.try_enter() == OK
    if state == INITIALIZATION:
        return
    a.must("ExitInitializationMode")
    if state == CONTINUOUS:
        a.must("EnterContinuousTimeMode")
    if state == TERMINATED:
        a.must("Terminate")


def cases(fmu: Library) -> list[tuple[str, str]]:
    """(interface, state) of everything an FMU can be."""
    found = [("cs", s) for s in (INSTANTIATED, INITIALIZATION, STEP, TERMINATED)]
    if fmu.is_continuous:
        found += [("me", s) for s in (INSTANTIATED, INITIALIZATION, EVENT, CONTINUOUS, TERMINATED)]
    return found


def test_each_function_in_each_state(fmu: Library) -> None:
    """Allowed calls succeed; all others return Error, log the state, and change nothing."""
    for interface, state in cases(fmu):
        with fmu.instance(interface) as a:
            put_into(a, state)
            before = a.save()
            bits = a.serialize()
            for f in TABLES[fmu.fmi]:
                allowed = (
                    state in f.states and f.interface in ("", interface) and (fmu.is_continuous or not f.continuous)
                )
                a.messages.clear()
                status = a.call(f.name, *f.arguments(a))
                where = f"{f.name} on a {interface} instance in state {state}"
                if allowed:
                    assert status == f.returns, f"{where}: {a.messages}"
                else:
                    assert status == ERROR, where
                    assert a.messages, where
                    assert a.messages[-1][1] == "logStatusError"
                    assert a.serialize() == bits, where
                for owner, kept in KEEP:
                    owner.free_state(kept)
                KEEP.clear()
                a.restore(before)
            a.free_state(before)


def test_null_instance(fmu: Library) -> None:
    """NULL for the instance is an error everywhere, and nothing for FreeInstance."""
    with fmu.instance() as a:
        put_into(a, STEP)
        for f in TABLES[fmu.fmi]:
            arguments = (a.ffi.NULL if x is None else x for x in f.arguments(a))
            assert a.raw(f.name)(a.ffi.NULL, *arguments) == ERROR, f.name
        for owner, kept in KEEP:
            owner.free_state(kept)
        KEEP.clear()
    a.raw("FreeInstance")(a.ffi.NULL)


def test_null_arguments(fmu: Library) -> None:
    """NULL where an array or a result should be is an error and changes nothing."""
    one, n, ffi = 1, len(fmu.states), fmu.loaded.ffi
    ref, value, data = [0], ffi.new("double*"), ffi.new("char[64]")
    value_of = {fmu.real: value, "Boolean": ffi.new(f"{fmu.loaded.types['Boolean']}*")}
    tail: tuple[Any, ...] = () if fmu.fmi == 2 else (one,)
    calls: list[tuple[Any, ...]] = [
        ("SetDebugLogging", 1, one, None),
        *((f"{d}{t}", None, one, value_of[t], *tail) for d in ("Get", "Set") for t in value_of),
        *((f"{d}{t}", ref, one, None, *tail) for d in ("Get", "Set") for t in value_of),
        ("GetFMUState", None),
        ("SetFMUState", None),
        ("FreeFMUState", None),
        ("SerializedFMUStateSize", None, ffi.new("size_t*")),
        ("SerializeFMUState", None, data, 64),
        ("DeserializeFMUState", None, 64, ffi.new("void**")),
        ("DeserializeFMUState", data, 64, None),
    ]
    if fmu.fmi == 2:
        calls += [
            ("GetDirectionalDerivative", None, one, ref, one, value, value),
            ("GetDirectionalDerivative", ref, one, ref, one, None, value),
            ("GetDirectionalDerivative", ref, one, ref, one, value, None),
            ("GetRealStatus", 2, None),
            ("GetBooleanStatus", 3, None),
        ]
    else:
        calls += [
            ("GetDirectionalDerivative", None, one, ref, one, value, one, value, one),
            ("GetAdjointDerivative", None, one, ref, one, value, one, value, one),
            ("GetDirectionalDerivative", ref, one, ref, one, None, one, value, one),
            ("GetAdjointDerivative", ref, one, ref, one, None, one, value, one),
            ("GetDirectionalDerivative", ref, one, ref, one, value, one, None, one),
            ("GetAdjointDerivative", ref, one, ref, one, value, one, None, one),
            ("DoStep", 0.0, fmu.step, True, None, None, None, None),
        ]
    exchange: list[tuple[Any, ...]] = [
        ("SetContinuousStates", None, n),
        ("GetContinuousStates", None, n),
        ("GetNominalsOfContinuousStates", None, n),
        ("GetContinuousStateDerivatives", None, n),
        ("CompletedIntegratorStep", True, None, None),
        ("SetContinuousStates", value, n + 1),
        ("GetEventIndicators", value, one),
    ]
    for interface in ("cs", "me") if fmu.is_continuous else ("cs",):
        with fmu.instance(interface) as a:
            put_into(a, STEP if interface == "cs" else CONTINUOUS)
            bits = a.serialize()
            for call in (*calls, *(exchange if interface == "me" else ())):
                if call[0] in ("DoStep", "GetRealStatus", "GetBooleanStatus") and interface == "me":
                    continue
                assert a.call(*call) == ERROR, call[0]
                assert a.serialize() == bits
            state = a.save()
            assert a.call("SerializedFMUStateSize", state[0], None) == ERROR
            assert a.call("SerializeFMUState", state[0], None, len(bits)) == ERROR
            assert a.call("SerializeFMUState", state[0], data, len(bits) - 1) == ERROR
            a.free_state(state)
    if fmu.is_continuous:
        with fmu.instance("me") as a:
            put_into(a, EVENT)
            if fmu.fmi == 2:
                assert a.call("NewDiscreteStates", None) == ERROR
            else:
                assert a.call("UpdateDiscreteStates", *[None] * 6) == ERROR
                assert a.call("GetNumberOfContinuousStates", None) == ERROR
                assert a.call("GetNumberOfEventIndicators", None) == ERROR


@pytest.mark.parametrize("h", [0.0, -0.0, -1e-3, math.nan, math.inf, -math.inf, 1e300, 1e9])
def test_wrong_step_sizes(fmu: Library, h: float) -> None:
    with fmu.instance() as a:
        a.initialize(fmu.stimulus.row(0))
        bits = a.serialize()
        assert a.do_step(0.0, h) == ERROR
        assert "communicationStepSize" in a.last_message
        assert a.serialize() == bits
        a.run(2)


def test_wrong_times(fmu: Library) -> None:
    with fmu.instance() as a:
        assert a.try_enter(math.nan) == ERROR
        a.reset()
        assert a.try_enter(math.inf) == ERROR
        a.reset()
        assert a.try_enter(1.0, 0.5) == ERROR
        a.reset()
        a.initialize(fmu.stimulus.row(0), stop=10 * fmu.step)
        a.run(2)
        bits = a.serialize()
        for t in (0.0, fmu.step, 3 * fmu.step, -1.0, math.nan, math.inf, 1e300):
            assert a.do_step(t, fmu.step) == ERROR
            assert "currentCommunicationPoint" in a.last_message
        assert a.do_step(2 * fmu.step, 9 * fmu.step) == ERROR
        assert "stopTime" in a.last_message
        assert a.serialize() == bits
        a.run(8, first=2)
    if fmu.is_continuous:
        with fmu.instance("me") as a:
            put_into(a, CONTINUOUS)
            assert a.call("SetTime", math.nan) == ERROR


def test_starts_at_another_time(fmu: Library) -> None:
    with fmu.instance() as a:
        a.initialize(fmu.stimulus.row(0), start=12.5)
        assert a.get(["time"])[0] == 12.5
        for _ in range(3):
            a.step(fmu.step)
        assert a.get(["time"])[0] == pytest.approx(12.5 + 3 * fmu.step)


def test_unknown_references_and_wrong_types(fmu: Library) -> None:
    kinds = {"real": fmu.real, "integer": "Integer" if fmu.fmi == 2 else "Int32", "boolean": "Boolean"}
    with fmu.instance() as a:
        a.initialize()
        bits = a.serialize()
        for kind in kinds.values():
            for reference in (len(fmu.variables), 2**32 - 1):
                for direction in ("Get", "Set"):
                    assert a.access(direction, kind, [reference], a.array(kind, [0])) == ERROR
                    assert str(reference) in a.last_message
        for v in list(fmu.variables.values())[:: max(1, len(fmu.variables) // 50)]:
            for kind in kinds.values():
                if kind != v.type:
                    assert a.access("Get", kind, [v.reference], a.array(kind, [0])) == ERROR
                    assert v.name in a.last_message
                    assert a.access("Set", kind, [v.reference], a.array(kind, [0])) == ERROR
        assert a.access("Get", "String", [0], a.array("String", [])) in (OK, ERROR)
        if fmu.fmi == 3:
            room_for = a.ffi.new("double[2]")
            assert a.call("GetFloat64", [0], 1, room_for, 2) == ERROR
            assert a.call("GetFloat64", [0], 1, room_for, 0) == ERROR
        assert a.serialize() == bits


def test_wrong_token_or_name(fmu: Library) -> None:
    for interface in ("cs", "me") if fmu.is_continuous else ("cs",):
        for wrong in ({"token": ""}, {"token": fmu.token[:-1]}, {"token": fmu.token + "x"}, {"name": ""}):
            a = Instance(fmu, interface, **wrong)
            assert a.handle is None
            assert a.messages[-1][0] == ERROR
            assert ("GUID" if fmu.fmi == 2 else "Token") in a.last_message or "Name" in a.last_message
    if not fmu.is_continuous:
        with fmu.instance() as a:
            assert a.maker(interface=0)() is None


@pytest.mark.parametrize("bad", [math.nan, math.inf, -math.inf])
def test_values_that_are_not_finite(fmu: Library, bad: float) -> None:
    """The error names the variable; nothing changes, also not the good values of the same call."""
    with fmu.instance() as a:
        settable = fmu.names("parameter", "real") + fmu.names("input", "real")
        exact = [v.name for v in fmu.variables.values() if v.initial == "exact" and v.name in fmu.states]
        check_refused(a, dict.fromkeys((settable + exact)[:: max(1, len(settable) // 60)], bad))
        a.initialize()
        check_refused(a, dict.fromkeys(fmu.names("input", "real")[:60], bad))
    if fmu.is_continuous:
        with fmu.instance("me") as a:
            put_into(a, CONTINUOUS)
            x = a.get_states()
            for i, n in enumerate(fmu.states):
                data = a.array(fmu.real, [*x[:i], bad, *x[i + 1 :]])
                assert a.call("SetContinuousStates", data, len(x)) == ERROR
                assert n in a.last_message
            assert a.get_states().tobytes() == x.tobytes()


def outside(fmu: Model) -> dict[str, float]:
    """A value outside its range for each parameter and integer input that has one."""
    bad: dict[str, float] = {}
    for v in fmu.variables.values():
        strict = v.causality == "parameter" or (v.causality == "input" and v.kind == "integer")
        if strict and v.kind != "boolean":
            if v.high is not None and v.high < 1e15:
                bad[v.name] = v.high + max(1.0, abs(v.high) * 1e-3)
            elif v.low is not None:
                bad[v.name] = v.low - max(1.0, abs(v.low) * 1e-3)
    return bad


@applies_to(outside)
def test_values_outside_their_range(fmu: Library) -> None:
    with fmu.instance() as a:
        check_refused(a, outside(fmu))


def check_refused(a: Instance, bad: dict[str, float]) -> None:
    """Setting each value is refused by name and leaves no trace, alone or together with a good one."""
    bits = a.serialize()
    for name, value in bad.items():
        v = a.library.variables[name]
        assert a.try_set({name: value}) in (ERROR, DISCARD), name
        assert name in a.last_message
        good = next((w for w in a.library.variables.values() if w.type == v.type and w.causality == "input"), None)
        if good is not None and good.name != name:
            both = a.array(v.type, [(good.start_value or 0), value])
            assert a.access("Set", v.type, [good.reference, v.reference], both) in (ERROR, DISCARD)
        assert a.serialize() == bits, name


def test_what_may_not_be_set(fmu: Library) -> None:
    """Calculated variables never, parameters only before the end of initialization unless they are tunable."""
    calculated = [v for v in fmu.variables.values() if v.causality in ("output", "local", "independent")]
    fixed = [v for v in fmu.variables.values() if v.causality == "parameter" and v.variability == "fixed"]
    tunable = [v for v in fmu.variables.values() if v.causality == "parameter" and v.variability == "tunable"]
    with fmu.instance() as a:
        for v in calculated:
            if v.initial != "exact":
                assert a.try_set({v.name: 0.0}) == ERROR, v.name
                assert v.name in a.last_message
        for v in fixed + tunable:
            assert a.try_set({v.name: v.start_value}) == OK
        a.initialize()
        for v in calculated + fixed:
            assert a.try_set({v.name: v.start_value or 0.0}) == ERROR, v.name
            assert v.name in a.last_message
        for v in tunable:
            assert a.try_set({v.name: v.start_value}) == OK, v.name
    if fmu.is_continuous:
        with fmu.instance("me") as a:
            put_into(a, CONTINUOUS)
            for v in fixed + tunable:
                assert a.try_set({v.name: v.start_value}) == ERROR, v.name
            for n in fmu.inputs:
                expected = OK if fmu.variables[n].kind == "real" else ERROR  # discrete inputs change at events only
                assert a.try_set({n: fmu.variables[n].start_value or 0.0}) == expected, n


def test_start_values_are_those_of_the_description(fmu: Library) -> None:
    names = [v.name for v in fmu.variables.values() if v.start is not None and v.causality in ("parameter", "input")]
    with fmu.instance() as a:
        a.initialize()
        for n, value in zip(names, a.get(names), strict=True):
            assert value == fmu.variables[n].start_value, n


def test_logging_is_quiet_when_asked(fmu: Library) -> None:
    with fmu.instance(logging=False) as a:
        assert a.do_step(0.0, 1.0) == ERROR
        assert a.messages.pop()[1] == "logStatusError"  # errors are told even without debug logging
        a.must("SetDebugLogging", False, 0, None)
        assert a.do_step(0.0, 1.0) == ERROR
        assert not a.messages
        category, nonsense = (a.ffi.new("char[]", text) for text in (b"logStatusError", b"nonsense"))
        a.must("SetDebugLogging", True, 1, [category])
        assert a.do_step(0.0, 1.0) == ERROR
        assert a.messages.pop()[1] == "logStatusError"
        a.initialize()
        assert not a.messages  # events were not asked for
        assert a.call("SetDebugLogging", True, 1, [nonsense]) == ERROR
        assert "nonsense" in a.last_message
        a.must("SetDebugLogging", False, 0, None)


def test_without_a_logger(fmu: Library) -> None:
    """An importer may give no function to log with."""
    assert Instance(fmu, token="wrong", logger=False).handle is None
    with Instance(fmu, logger=False) as a:
        assert a.do_step(0.0, 1.0) == ERROR
        a.initialize(fmu.stimulus.row(0))
        a.run(2)


def test_instantiation_with_null_arguments(fmu: Library) -> None:
    with fmu.instance() as a:
        for wrong in ({"name": None}, {"token": None}):
            assert a.maker(**wrong)() is None
            assert a.messages
        if fmu.fmi == 2:
            assert a.maker(bare=True)() is None
            assert a.maker(interface=7)() is None
        else:
            assert a.maker(events=True)() is None
            null, logger = a.ffi.NULL, a.logger
            arguments = (b"x", fmu.token.encode(), null, False, True, null, logger, null, null, null)
            assert not a.raw("InstantiateScheduledExecution")(*arguments)
