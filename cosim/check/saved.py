"""Checks of saved and serialized states."""

from __future__ import annotations

from typing import Any

from cosim.check.bench import (
    EQUAL,
    OTHER,
    Bench,
    Values,
    all_moved,
    attempt,
    compared,
    difference,
    differs,
    disturb,
    peaks,
    same,
    shown,
    tried,
)
from cosim.check.calls import Instance, good
from cosim.check.rules import Found, check, note, require, warning
from cosim.fmu.calls import name_in

_SAVED2, _SAVED3 = (
    "2.1.8 Getting and Setting the Complete FMU State",
    "2.2.6.4 Getting and Setting the Complete FMU State",
)


def _saving(bench: Bench, serialized: bool = False) -> list[Values]:
    i = bench.interface
    require(
        i.saves and (i.serializes or not serialized),
        f"it does not support {'serialized' if serialized else 'saved'} states",
    )
    return bench.repeatable()


_Known = tuple[float, float, list[float], str]
"""What an importer knows of an instance: time, next event, event indicators and the state of the state machine."""


def _run_to_save(bench: Bench, a: Instance) -> tuple[Any, _Known]:
    """A state that is saved some steps after the start."""
    a.initialize()
    bench.run(a, 3)
    return a.save(), (a.time, a.next_event, a.indicators, a.state)


def _continued(bench: Bench, a: Instance, state: Any, known: _Known) -> list[Values]:
    """The next steps from a saved state."""
    a.restore(state)
    a.time, a.next_event, a.indicators, a.state = known
    return bench.run(a, 4)


@check(
    "saved.replay",
    "a restored state continues with the same results, however often it is restored",
    fmi2=_SAVED2,
    fmi3=_SAVED3,
    advice="Save everything that results depend on: memories, caches, inputs, parameters, time, pending events.",
)
def replay(bench: Bench) -> Found:
    straight_on = _saving(bench)[3:8]
    require(straight_on, "it asks to end the simulation after a few steps")

    def work(a: Instance) -> list[list[Values]]:
        state, known = _run_to_save(bench, a)
        runs = [_continued(bench, a, state, known)]
        for _ in range(2):
            disturb(bench, a)
            attempt(a.step, bench.step)
            runs.append(_continued(bench, a, state, known))
        return runs

    at_once, *later = bench.alone(work)
    # Where nothing happened between saving and restoring, only an integrator that begins from scratch makes a
    # difference.
    restarted = bool(difference(straight_on, at_once))
    if found := compared(
        bench, straight_on, at_once, "results differ after saving and restoring at once", restarted=restarted
    ):
        yield found
        return
    for again, run in zip(("", " once more"), later, strict=True):
        if found := compared(bench, at_once, run, f"continued from a saved state{again}", restarted=restarted):
            yield found
            return


@check(
    "saved.parameters",
    "a saved state restores the values that were set",
    fmi2=_SAVED2,
    fmi3=_SAVED3,
    advice="Save inputs and parameters with the state.",
)
def with_values(bench: Bench) -> Found:
    _saving(bench)
    inputs = [
        v for v in bench.settable("input") if v.is_float and (bench.kind == "cs" or v.variability == "continuous")
    ]
    values = all_moved(tried(inputs))
    require(values, "there are no real inputs")

    def work(a: Instance) -> tuple[Values, Values]:
        before = a.initialize().get(list(values))
        state = a.save()
        require(attempt(a.set, values), "it does not take other values")
        a.restore(state)
        return before, a.get(list(values))

    before, after = bench.alone(work)
    for v, got in after.items():
        if not all(same(x, y) for x, y in zip(got, before[v], strict=True)):
            yield (
                f"input {v.name!r} was {shown(before[v][0])} when the state was saved, and is {shown(got[0])}"
                " after it was restored"
            )
            return


@check(
    "saved.states",
    "several saved states coexist, and saving into an existing one replaces it",
    fmi2=_SAVED2,
    fmi3=_SAVED3,
    advice="Allocate when the pointer is NULL, overwrite when it is not; set it to NULL when the state is freed.",
)
def several_states(bench: Bench) -> Found:
    base = _saving(bench)

    def work(a: Instance) -> list[tuple[str, list[Values]] | str]:
        found: list[tuple[str, list[Values]] | str] = []
        watched = bench.watched()
        early, at_early = a.initialize().save(), a.get(watched)
        bench.run(a, 2)
        late, at_late = a.save(), a.get(watched)
        for state, expected, name in (
            (early, at_early, "of two states the first"),
            (late, at_late, "of two states the second"),
        ):
            a.restore(state)
            found.append((f"{name} is restored wrongly", [expected, a.get(watched)]))
        a.must("GetFMUState", early)  # into the old one
        a.restore(early)
        found.append(("a state saved into an existing one is restored wrongly", [at_late, a.get(watched)]))
        a.must("FreeFMUState", early)
        if early[0]:
            found.append(f"{name_in(a.version, 'FreeFMUState')} does not set the pointer to NULL")
            a._saved.remove(early)
        a.call("FreeFMUState", a.ffi.new("void**"))  # NULL is ignored
        return found

    for entry in bench.alone(work):
        if isinstance(entry, str):
            yield entry
            continue
        what, (expected, restored) = entry
        scale = peaks([*base, expected])
        if text := differs(expected, restored, OTHER, scale):
            yield f"{what}: {text}"
            return
        if text := differs(expected, restored, EQUAL, scale):
            yield warning(f"{what}, slightly: {text}")
            return


@check(
    "saved.serialize",
    "a serialized state continues with the same results, in the same and in a fresh instance",
    fmi2=_SAVED2,
    fmi3=_SAVED3,
    advice="Serialize contents, never pointers.",
)
def serialized(bench: Bench) -> Found:
    straight_on = _saving(bench, True)[3:8]

    def work(a: Instance) -> tuple[_Known, bytes, bytes, list[Values], list[Values]]:
        state, known = _run_to_save(bench, a)
        data, again = a.serialize(state), a.serialize(state)
        return known, data, again, _continued(bench, a, state, known), _continued(bench, a, a.deserialize(data), known)

    known, data, again, expected, here = bench.alone(work)
    if again != data:
        yield note("one state, serialized twice, gives different bytes")
    restarted = bool(difference(straight_on, expected))
    if found := compared(bench, expected, here, "continued from a serialized state", restarted=restarted):
        yield found
        return
    fresh = bench.alone(lambda a: _continued(bench, a.initialize(), a.deserialize(data), known))
    if found := compared(
        bench, expected, fresh, "continued from a serialized state in a fresh instance", restarted=restarted
    ):
        yield found


@check(
    "saved.damaged",
    "bytes that are not a valid state are rejected",
    fmi2=_SAVED2,
    fmi3=_SAVED3,
    advice="Check the length before reading, and a checksum for other damage.",
    worst="warning",
)
def damaged(bench: Bench) -> Found:
    require(bench.interface.saves and bench.interface.serializes, "it does not support serialized states")
    with bench.instance() as a:
        a.initialize()
        data = a.serialize(a.save())
        for what, wrong in (("cut in half", data[: len(data) // 2]), ("empty", b"")):
            name, state = "DeserializeFMUState", a.ffi.new("void**")
            if len(wrong) < len(data) and good(a.call(name, wrong, len(wrong), state)):
                yield f"{name_in(a.version, name)} accepts a state that is {what}"
                return
