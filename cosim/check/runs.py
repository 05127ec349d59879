"""Checks of whole runs: the same again after reset, beside others, in threads, from saved states and with other steps."""

from __future__ import annotations

import ctypes as c
import itertools
import math
import sys
import threading
from typing import Any

from cosim.check.bench import STEPS, Bench, Found, Values, attempt, compared, difference, good, moved, same, tried
from cosim.check.calls import Ended, Instance, Refused
from cosim.check.rules import Finding, NotApplicable, check, note, warning

_INSTANCES2 = "2.1.5 Creation, Destruction and Logging of FMU Instances"
_INSTANCES3 = "2.2.1 Requirements for Implementations of the C-API; 2.3.1 Super State: FMU State Setable"


@check(
    "runs.repeat", "two runs from the same start give the same results",
    fmi2="1.1 Properties and Guiding Ideas", fmi3="1.2 Properties and Guiding Ideas",
    advice="Initialize all memory; make seeds of random numbers parameters. Runs that differ cannot be compared.", kinds=("cs", "me"), worst="warning",
)  # fmt: skip
def repeat(bench: Bench) -> Found:
    bench.several()
    if text := difference(bench.fresh(), bench.fresh()):
        yield text


@check(
    "runs.reset", "a run after reset is the run of a fresh instance",
    fmi2="2.1.6 Initialization, Termination, and Resetting an FMU (fmi2Reset)", fmi3="2.3.1 Super State: FMU State Setable (fmi3Reset)",
    advice="Reset goes into the state that instantiation leaves: clear states, memories, counters and caches.", kinds=("cs", "me"),
)  # fmt: skip
def reset(bench: Bench) -> Found:
    base = bench.repeatable()
    for what, leave in (("in a run", lambda a: None), ("after terminate", lambda a: a.terminate())):
        with bench.instance() as a:
            a.initialize()
            _disturb(bench, a)
            bench.run(a, 3)
            attempt(lambda a=a, leave=leave: leave(a))  # type: ignore[misc]
            a.reset()
            a.initialize()
            if found := compared(base, bench.run(a), f"reset {what}: fresh and reset instance differ"):
                yield found
                return


def _disturb(bench: Bench, a: Instance) -> None:
    """Other inputs, as far as the FMU takes them."""
    inputs = [v for v in tried(bench.settable("input")) if v.is_float and (bench.kind == "cs" or v.variability == "continuous")]
    values: Values = {v: m for v in inputs if (m := moved(v, v.starts() or ())) is not None}
    if values:
        attempt(lambda: a.set(values))


@check(
    "runs.instances", "instances know nothing of each other",
    fmi2=_INSTANCES2, fmi3=_INSTANCES3,
    advice="Keep everything in the instance, nothing in global or static variables.", kinds=("cs", "me"),
)  # fmt: skip
def instances(bench: Bench) -> Found:
    base = bench.repeatable()
    with bench.instance(name="one") as a, bench.instance(name="other") as b:
        watched = bench.watched()
        try:
            b.initialize()
            _disturb(bench, b)
            b.step(bench.step)
            a.initialize()
            found = [a.get(watched)]
            for _ in range(STEPS):
                attempt(lambda: b.step(bench.step))
                a.step(bench.step)
                attempt(lambda: b.get(watched))
                found.append(a.get(watched))
        except Ended:
            return
        if unlike := compared(base, found, "beside another instance it gives other results"):
            yield unlike
        b.free()
        attempt(lambda: a.step(bench.step))


@check(
    "runs.threads", "instances in threads of their own give what they give alone",
    fmi2="2.1.1 Header Files and Naming of Functions (parallel calls)", fmi3="2.2.1 Requirements for Implementations of the C-API (threads)",
    advice="Keep everything in the instance, nothing in global or static variables; protect what libraries share.",
    kinds=("cs", "me"), worst="warning",
)  # fmt: skip
def threads(bench: Bench) -> Found:
    base = bench.repeatable()
    n, rounds = 3, 3
    results: list[list[list[Values]]] = [[] for _ in range(n)]
    failures: list[str] = []
    begin = threading.Barrier(n)

    def work(i: int) -> None:
        try:
            begin.wait(10)
            for _ in range(rounds):
                results[i].append(bench.fresh())
        except Exception as error:  # whatever it is, it is told by the thread that waits
            failures.append(str(error))

    workers = [threading.Thread(target=work, args=(i,)) for i in range(n)]
    for w in workers:
        w.start()
    for w in workers:
        w.join()
    if failures:
        yield _of_version(bench, f"in {n} threads: {failures[0]}")
        return
    for runs in results:
        for run in runs:
            if text := difference(base, run):
                yield _of_version(bench, f"in {n} threads an instance gives other results: {text}")
                return


def _of_version(bench: Bench, text: str) -> Finding:
    """FMI 3.0 says that instances may be called in parallel, FMI 2.0 that they may be in different processes."""
    return Finding(text, "error") if bench.version == "3" else warning(text)


@check(
    "runs.time", "the independent variable is the time of the run",
    fmi2="2.2.7 Definition of Model Variables (independent)", fmi3="2.4.7.4 Variable Attributes (independent)",
    advice="Return the current communication point, or the time that was set.", kinds=("cs", "me"),
)  # fmt: skip
def time(bench: Bench) -> Found:
    clock = next((v for v in bench.fmu.readable(bench.model.of("independent")) if v.is_float), None)
    if clock is None:
        raise NotApplicable("there is no independent variable that can be read")
    with bench.instance() as a:
        try:
            a.initialize()
            for _ in range(3):
                a.step(bench.step)
        except Ended:
            return
        value = a.get([clock])[clock][0]
        if not same(value, a.time, 1e-6) and abs(value - a.time) > 1e-6 * bench.step * 3:
            text = f"{clock.name!r} is {shown_time(value)} at {shown_time(a.time)} s"
            yield text if bench.kind == "me" else warning(text)  # only SetTime is said to set it


def shown_time(t: float) -> str:
    return f"{t:.9g}"


@check(
    "runs.steps", "communication steps may be split: the same time, nearly the same result",
    fmi2="4.2.2 Computation; 4.3.1 (canHandleVariableCommunicationStepSize)", fmi3="4.2.1 (fmi3DoStep); 4.3 (canHandleVariableCommunicationStepSize)",
    advice="Integrate to the end of every step exactly, or do not promise variable steps.", kinds=("cs",),
)  # fmt: skip
def steps(bench: Bench) -> Found:
    bench.require(bench.interface.variable_step, "it does not promise variable communication steps")
    h, watched = bench.step, [v for v in bench.watched() if v.is_float and v.causality == "output"]
    even: Values = {}
    ways = {"even": [1.0] * 8, "uneven": [2.0, 1.0, 3.0, 1.0, 1.0], "split": [0.5, 0.5, 0.25, 0.75, 0.5, 0.5, 1.0] * 2}
    for way, parts in ways.items():
        with bench.instance() as a:
            try:
                a.initialize()
                first = a.get(watched)
                for part in parts:
                    a.step(h * part)
            except Ended:
                return
            except Refused:
                if way == "split":  # it may have a shortest step
                    return
                raise
            end = a.get(watched)
        for v in watched if even else ():
            for x, y, z in zip(even[v], end[v], first[v], strict=True):
                size = max(abs(x - z), abs(y - z), 1e-6 * max(abs(x), abs(y)), 1e-9)
                if math.isfinite(x) and math.isfinite(y) and abs(x - y) > 0.25 * size:
                    yield warning(f"after {8 * h:g} s in even and in {way} steps {v.name!r} is {x:.6g} and {y:.6g}")
                    return
        even = even or end


@check(
    "runs.floating_point", "the floating-point environment is left as it was",
    fmi2="2.1.1 Header Files and Naming of Functions (global settings)", fmi3="2.2.1 Requirements for Implementations of the C-API (global settings)",
    advice="Restore rounding mode and control registers before a function returns; do not link with -ffast-math, which flushes subnormal numbers.",
    kinds=("cs", "me"),
)  # fmt: skip
def floating_point(bench: Bench) -> Found:
    before = _environment()
    bench.fmu.dll(bench.kind)
    loaded = _environment()
    if loaded != before:
        yield warning(f"loading the library changes {_changed(before, loaded)}, for the whole process")
    with bench.instance() as a:
        attempt(a.initialize)
        attempt(lambda: a.step(bench.step))
        after = _environment()
    if after != loaded:
        yield f"after a step {_changed(loaded, after)} is another"


def _environment() -> tuple[int, bool]:
    """Rounding mode, and whether subnormal numbers are kept."""
    library = c.CDLL("ucrtbase.dll") if sys.platform == "win32" else c.CDLL("libm.so.6") if sys.platform == "linux" else c.CDLL(None)
    smallest = float.fromhex("0x1p-1022")
    return int(library.fegetround()), smallest / 2.0 != 0.0


def _changed(before: tuple[int, bool], after: tuple[int, bool]) -> str:
    return " and ".join(t for t, x, y in zip(("the rounding mode", "the treatment of subnormal numbers"), before, after, strict=True) if x != y)


def _growth(bench: Bench) -> float | None:
    """Bytes by which the process grows with each instance; None where it does not grow from mark to mark, or by next to nothing."""
    import time as clock

    begin, count = clock.perf_counter(), 0
    marks = []
    for _ in range(4):
        for _ in range(20):
            with bench.instance(logging=False) as a:
                attempt(a.initialize)
                for _ in range(2):
                    attempt(lambda a=a: a.step(bench.step))  # type: ignore[misc]
            count += 1
            if clock.perf_counter() - begin > 2.0:
                break
        marks.append((count, _resident() or 0))
    (n0, m0), (n1, m1) = marks[1], marks[-1]
    bench.measures["memory of the process"] = f"{m1 / 1e6:.0f} MB"
    if n1 - n0 < 20:
        raise NotApplicable("its instances take too long to make enough of them")
    rate = (m1 - m0) / (n1 - n0)
    return rate if rate > 4096 and all(b[1] > a[1] for a, b in itertools.pairwise(marks)) else None


@check(
    "runs.memory", "memory is given back when instances are freed",
    fmi2="2.1.5 Creation, Destruction and Logging of FMU Instances (fmi2FreeInstance)", fmi3="2.3.1 Super State: FMU State Setable (fmi3FreeInstance)",
    advice="Free what instantiation and steps have allocated.", kinds=("cs", "me"), worst="warning",
)  # fmt: skip
def memory(bench: Bench) -> Found:
    bench.several()
    if _resident() is None:
        raise NotApplicable("the memory of a process cannot be read on this system")
    # Some tools load and keep things with the first instances, and the system gives a process its pages when it pleases; what counts is that
    # it goes on, whenever it is asked.
    rate = 0.0
    for _ in range(3):
        found = _growth(bench)
        if found is None:
            return
        rate = found
    yield f"every instance that is made, run and freed leaves some {rate / 1024:.0f} KB behind"


def _resident() -> int | None:
    """Bytes of this process in memory."""
    import os

    try:
        with open("/proc/self/statm", encoding="ascii") as file:
            return int(file.read().split()[1]) * os.sysconf("SC_PAGE_SIZE")
    except (OSError, ValueError, IndexError):
        return None


# -------------------------------------------------------------------------------------------------------- saved states

_SAVED2, _SAVED3 = "2.1.8 Getting and Setting the Complete FMU State", "2.2.6.4 Getting and Setting the Complete FMU State"


def _saving(bench: Bench, serialized: bool = False) -> list[Values]:
    i = bench.interface
    bench.require(i.serializes if serialized else i.saves, f"it does not promise {'serialized' if serialized else 'saved'} states")
    return bench.repeatable()


def _continued(bench: Bench, a: Instance, t: float) -> list[Values]:
    a.time = t
    return bench.run(a, 4)


@check(
    "saved.replay", "a state that was saved and is restored continues with the same results, again and again",
    fmi2=_SAVED2, fmi3=_SAVED3,
    advice="Put everything into the state that results depend on: memories, caches, inputs, parameters, time, pending events.", kinds=("cs", "me"),
)  # fmt: skip
def replay(bench: Bench) -> Found:
    _saving(bench)
    with bench.instance() as a:
        a.initialize()
        bench.run(a, 3)
        state, t, next_event, indicators = a.save(), a.time, a.next_event, a.indicators
        expected = _continued(bench, a, t)
        for attempts in range(2):
            _disturb(bench, a)
            attempt(lambda: a.step(bench.step))
            a.restore(state)
            a.next_event, a.indicators, a.state = next_event, indicators, "step mode" if a.kind == "cs" else "continuous-time mode"
            if found := compared(expected, _continued(bench, a, t), f"continued from a saved state{' once more' if attempts else ''}"):
                yield found
                return


@check(
    "saved.parameters", "a saved state brings back the values that were set",
    fmi2=_SAVED2, fmi3=_SAVED3,
    advice="Save inputs and parameters with the state.", kinds=("cs", "me"),
)  # fmt: skip
def with_values(bench: Bench) -> Found:
    _saving(bench)
    inputs = [v for v in bench.settable("input") if v.is_float and (bench.kind == "cs" or v.variability == "continuous")]
    values: Values = {v: m for v in tried(inputs) if (m := moved(v, v.starts() or ())) is not None}
    if not values:
        raise NotApplicable("there are no real inputs")
    with bench.instance() as a:
        a.initialize()
        before = a.get(list(values))
        state = a.save()
        if attempt(lambda: a.set(values)) is None:
            raise NotApplicable("it does not take other values")
        a.restore(state)
        for v, got in a.get(list(values)).items():
            if not all(same(x, y) for x, y in zip(got, before[v], strict=True)):
                yield f"input {v.name!r} was {shown_value(before[v])} when the state was saved, and is {shown_value(got)} after it was restored"
                return


def shown_value(values: list[Any]) -> str:
    return f"{values[0]:.9g}"


@check(
    "saved.states", "several states live side by side, and saving into an old one replaces it",
    fmi2=_SAVED2, fmi3=_SAVED3,
    advice="Allocate when the pointer is NULL, overwrite when it is not; set it to NULL when the state is freed.", kinds=("cs", "me"),
)  # fmt: skip
def several_states(bench: Bench) -> Found:
    _saving(bench)
    with bench.instance() as a:
        a.initialize()
        watched = bench.watched()
        early, at_early = a.save(), a.get(watched)
        bench.run(a, 2)
        late, at_late = a.save(), a.get(watched)
        for state, expected, name in ((early, at_early, "the first"), (late, at_late, "the second")):
            a.restore(state)
            if text := difference([expected], [a.get(watched)]):
                yield f"of two states {name} is restored wrongly: {text.removesuffix(' at the start')}"
                return
        a.must(f"Get{a.saved}", c.byref(early))  # into the old one
        a.restore(early)
        if text := difference([at_late], [a.get(watched)]):
            yield f"a state saved into an old one is restored wrongly: {text.removesuffix(' at the start')}"
        a.must(f"Free{a.saved}", c.byref(early))
        if early.value is not None:
            yield f"Free{a.saved} leaves the pointer at the state that it has freed"
            a._saved.remove(early)
        a.call(f"Free{a.saved}", c.byref(c.c_void_p()))  # NULL is ignored


@check(
    "saved.serialize", "a serialized state continues with the same results, in this and in a fresh instance",
    fmi2=_SAVED2, fmi3=_SAVED3,
    advice="Serialize contents, never pointers.", kinds=("cs", "me"),
)  # fmt: skip
def serialized(bench: Bench) -> Found:
    _saving(bench, True)
    with bench.instance() as a:
        a.initialize()
        bench.run(a, 3)
        state, t, next_event, indicators = a.save(), a.time, a.next_event, a.indicators
        data = a.serialize(state)
        if a.serialize(state) != data:
            yield note("one state, serialized twice, gives different bytes")
        expected = _continued(bench, a, t)
        a.restore(a.deserialize(data))
        a.next_event, a.indicators, a.state = next_event, indicators, "step mode" if a.kind == "cs" else "continuous-time mode"
        if found := compared(expected, _continued(bench, a, t), "continued from a serialized state"):
            yield found
            return
    with bench.instance() as b:
        b.initialize()
        b.restore(b.deserialize(data))
        b.next_event, b.indicators = next_event, indicators
        if found := compared(expected, _continued(bench, b, t), "continued from a serialized state in a fresh instance"):
            yield found


@check(
    "saved.damaged", "bytes that are no state are refused",
    fmi2=_SAVED2, fmi3=_SAVED3,
    advice="Check the length before bytes are read; a checksum finds the rest.", kinds=("cs", "me"), worst="warning",
)  # fmt: skip
def damaged(bench: Bench) -> Found:
    bench.require(bench.interface.serializes, "it does not promise serialized states")
    with bench.instance() as a:
        a.initialize()
        data = a.serialize(a.save())
        for what, wrong in (("cut in half", data[: len(data) // 2]), ("empty", b"")):
            state = c.c_void_p()
            name = ("DeSerialize" if a.version == "2" else "Deserialize") + a.saved
            if len(wrong) < len(data) and good(a.call(name, wrong, c.c_size_t(len(wrong)), c.byref(state))):
                yield f"{name} takes a state that is {what}"
                return


