"""Checks of whole runs: repeated after reset, beside other instances, in threads, from saved states, other steps."""

from __future__ import annotations

import ctypes as c
import itertools
import math
import sys
import threading

from cosim.check.bench import STEPS, Bench, Values, attempt, compared, difference, disturb, same, shown
from cosim.check.calls import Ended, Instance, Refused
from cosim.check.rules import Finding, Found, NotApplicable, check, require, warning
from cosim.core.memory import resident_memory

_INSTANCES2 = "2.1.5 Creation, Destruction and Logging of FMU Instances"
_INSTANCES3 = "2.2.1 Requirements for Implementations of the C-API; 2.3.1 Super State: FMU State Setable"


@check(
    "runs.repeat",
    "identical runs give identical results",
    fmi2="1.1 Properties and Guiding Ideas",
    fmi3="1.2 Properties and Guiding Ideas",
    advice="Initialize all memory; make the seeds of random numbers parameters.",
    worst="warning",
)
def repeat(bench: Bench) -> Found:
    if text := difference(bench.fresh(), bench.fresh()):
        yield text


@check(
    "runs.reset",
    "a run after reset equals the run of a fresh instance",
    fmi2="2.1.6 Initialization, Termination, and Resetting an FMU (fmi2Reset)",
    fmi3="2.3.1 Super State: FMU State Setable (fmi3Reset)",
    advice="Reset must restore the state after instantiation: clear states, memories, counters and caches.",
)
def reset(bench: Bench) -> Found:
    base = bench.repeatable()

    def after_reset(a: Instance, terminated: bool) -> list[Values]:
        a.initialize()
        disturb(bench, a)
        attempt(bench.run, a, 3)
        if terminated:
            attempt(a.terminate)
        a.reset()
        return bench.run(a.initialize())

    for what, terminated in (("in a run", False), ("after terminate", True)):
        again = bench.alone(after_reset, terminated)
        if found := compared(bench, base, again, f"reset {what}: fresh and reset instance differ"):
            yield found
            return


@check(
    "runs.instances",
    "instances do not affect each other",
    fmi2=_INSTANCES2,
    fmi3=_INSTANCES3,
    advice="Keep everything in the instance, nothing in global or static variables.",
)
def instances(bench: Bench) -> Found:
    bench.several()
    base = bench.repeatable()
    with bench.instance(name="one") as a, bench.instance(name="other") as b:
        watched = bench.watched()
        try:
            b.initialize()
            disturb(bench, b)
            attempt(b.step, bench.step)
            a.initialize()
            found = [a.get(watched)]
            for _ in range(STEPS):
                attempt(b.step, bench.step)
                a.step(bench.step)
                attempt(b.get, watched)
                found.append(a.get(watched))
        except Ended:
            return
        if unlike := compared(bench, base, found, "results differ when a second instance exists"):
            yield unlike
        b.free()
        attempt(a.step, bench.step)


@check(
    "runs.threads",
    "instances in separate threads give the same results as alone",
    fmi2="2.1.1 Header Files and Naming of Functions (parallel calls)",
    fmi3="2.2.1 Requirements for Implementations of the C-API (threads)",
    advice="Keep everything in the instance, nothing in global or static variables; protect what libraries share.",
    worst="warning",
)
def threads(bench: Bench) -> Found:
    bench.several()
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
        except Exception as error:  # the waiting thread reports any error
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
                yield _of_version(bench, f"in {n} threads results differ from those of a single instance: {text}")
                return


def _of_version(bench: Bench, text: str) -> Finding:
    """FMI 3.0 says that instances may be called in parallel, FMI 2.0 that they may be in different processes."""
    return Finding(text, "error") if bench.version == "3" else warning(text)


@check(
    "runs.time",
    "the independent variable equals the simulation time",
    fmi2="2.2.7 Definition of Model Variables (independent)",
    fmi3="2.4.7.4 Variable Attributes (independent)",
    advice="Return the current communication point, or the time that was set.",
)
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
            text = f"{clock.name!r} is {shown(value)} at {shown(a.time)} s"
            yield text if bench.kind == "me" else warning(text)  # only SetTime is said to set it


@check(
    "runs.steps",
    "variable communication steps reach the same time with nearly the same results",
    fmi2="4.2.2 Computation; 4.3.1 (canHandleVariableCommunicationStepSize)",
    fmi3="4.2.1 (fmi3DoStep); 4.3 (canHandleVariableCommunicationStepSize)",
    advice="Integrate exactly to the end of every step, or do not declare support for variable steps.",
    kinds=("cs",),
)
def steps(bench: Bench) -> Found:
    require(bench.interface.variable_step, "it does not support variable communication steps")
    h, watched = bench.step, [v for v in bench.watched() if v.is_float and v.causality == "output"]
    ways = {"even": [1.0] * 8, "uneven": [2.0, 1.0, 3.0, 1.0, 1.0]}
    # else no step is shorter than that of the FMU, which FMI 2.0 cannot tell
    if bench.version == "3" and bench.interface.internal_step is None:
        ways["split"] = [0.5, 0.5, 0.25, 0.75, 0.5, 0.5, 1.0] * 2

    def ends(a: Instance, parts: list[float]) -> tuple[Values, Values]:
        first = a.initialize().get(watched)
        for part in parts:
            a.step(h * part)
        return first, a.get(watched)

    even: Values = {}
    for way, parts in ways.items():
        try:
            first, end = bench.alone(ends, parts)
        except Ended:
            return
        except Refused:
            if way == "split":  # it may have a shortest step
                return
            raise
        for v in watched if even else ():
            for x, y, z in zip(even[v], end[v], first[v], strict=True):
                size = max(abs(x - z), abs(y - z), 1e-6 * max(abs(x), abs(y)), 1e-9)
                if math.isfinite(x) and math.isfinite(y) and abs(x - y) > 0.25 * size:
                    yield warning(f"after {8 * h:g} s in even and in {way} steps {v.name!r} is {x:.6g} and {y:.6g}")
                    return
        even = even or end


@check(
    "runs.floating_point",
    "the floating-point environment is unchanged",
    fmi2="2.1.1 Header Files and Naming of Functions (global settings)",
    fmi3="2.2.1 Requirements for Implementations of the C-API (global settings)",
    advice=(
        "Restore rounding mode and control registers before a function returns; do not link with -ffast-math, which"
        " flushes subnormal numbers."
    ),
)
def floating_point(bench: Bench) -> Found:
    before = _environment()
    bench.fmu.library(bench.kind)
    loaded = _environment()
    if loaded != before:
        yield warning(f"loading the library changes {_changed(before, loaded)}, for the whole process")
    with bench.instance() as a:
        attempt(a.initialize)
        attempt(a.step, bench.step)
        after = _environment()
    if after != loaded:
        yield f"a step changes {_changed(loaded, after)}"


def _environment() -> tuple[int, bool]:
    """Rounding mode, and whether subnormal numbers are kept."""
    library = c.CDLL({"win32": "ucrtbase.dll", "linux": "libm.so.6"}.get(sys.platform))
    smallest = float.fromhex("0x1p-1022")
    return int(library.fegetround()), smallest / 2.0 != 0.0


def _changed(before: tuple[int, bool], after: tuple[int, bool]) -> str:
    return " and ".join(
        t
        for t, x, y in zip(("the rounding mode", "the treatment of subnormal numbers"), before, after, strict=True)
        if x != y
    )


def _growth(bench: Bench) -> float | None:
    """Growth of the process [bytes] with each instance; None if it is not steady, or negligible."""
    import time as clock

    begin, count = clock.perf_counter(), 0
    marks = []
    for _ in range(4):
        for _ in range(20):
            with bench.instance(logging=False) as a:
                attempt(a.initialize)
                for _ in range(2):
                    attempt(a.step, bench.step)
            count += 1
            if clock.perf_counter() - begin > 2.0:
                break
        marks.append((count, resident_memory() or 0))
    (n0, m0), (n1, m1) = marks[1], marks[-1]
    bench.measures["memory of the process"] = f"{m1 / 1e6:.0f} MB"
    require(n1 - n0 >= 20, "instantiation takes too long to repeat it often enough")
    rate = (m1 - m0) / (n1 - n0)
    return rate if rate > 4096 and all(b[1] > a[1] for a, b in itertools.pairwise(marks)) else None


@check(
    "runs.memory",
    "memory is released when instances are freed",
    fmi2="2.1.5 Creation, Destruction and Logging of FMU Instances (fmi2FreeInstance)",
    fmi3="2.3.1 Super State: FMU State Setable (fmi3FreeInstance)",
    advice="Free what instantiation and steps have allocated.",
    worst="warning",
)
def memory(bench: Bench) -> Found:
    bench.several()
    require(resident_memory() is not None, "the memory of a process cannot be read on this system")
    # Some tools load and keep things with the first instances, and the system gives a process its pages when it
    # pleases; what counts is that it continues, whenever it is asked.
    rate = 0.0
    for _ in range(3):
        found = _growth(bench)
        if found is None:
            return
        rate = found
    yield f"every instance that is created, run and freed leaks about {rate / 1024:.0f} KB"
