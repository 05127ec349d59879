"""Checks of values: those of the start, those that are set, and those that cannot be."""

from __future__ import annotations

import math
from typing import Any

from cosim.check.bench import Bench, Values, all_moved, attempt, compared, difference, moved, same, shown, tried
from cosim.check.calls import Ended, Instance, Refused, good
from cosim.check.model import Var
from cosim.check.rules import Found, check, names, require, warning

_VALUES2 = "2.1.7 Getting and Setting Variable Values"
_VALUES3 = "2.2.6.2 Getting and Setting Variable Values"
MOST_NAMED = 5


@check(
    "values.start",
    "before anything is set, variables have the start values of the description",
    fmi2="2.2.7 Definition of Model Variables (start)",
    fmi3="2.4.7.5 Type specific properties (start)",
    advice="Write the same start values into the description and into the code.",
)
def start(bench: Bench) -> Found:
    with bench.instance() as a:
        a.enter_initialization()
        yield from _first([*_not_at_start(a.get(_exact(bench)))])


def _first(found: list[Any]) -> Found:
    """The first findings and the number of the others."""
    yield from found[:MOST_NAMED]
    if len(found) > MOST_NAMED:
        yield f"and {len(found) - MOST_NAMED} more"


def _exact(bench: Bench) -> list[Var]:
    readable = bench.fmu.readable(bench.model.variables)
    return [v for v in readable if v.initial == "exact" and v.starts() is not None and v.causality != "independent"]


def _not_at_start(values: Values) -> Found:
    for v, got in values.items():
        for x, y in zip(got, v.starts() or (), strict=True):
            value = x.decode("utf-8", "replace") if isinstance(x, bytes) else x
            expected = y if isinstance(y, str | bool) else float(y) if v.is_float else int(y)
            if v.access == "Boolean":
                value = bool(value)
            if v.type == "Float32" and isinstance(value, float):
                if same(value, float(expected), 1e-6):
                    continue
            elif same(value, expected, 1e-5) or (isinstance(value, str) and value.split() == str(expected).split()):
                continue
            if v.access == "String":  # where resources lie is known in a run only
                yield warning(f"{v.name!r} is {shown(value)} in initialization mode; its start is {shown(expected)}")
                break
            yield f"{v.name!r} is {shown(value)} in initialization mode; its start is {shown(expected)}"
            break


@check(
    "values.set",
    "a get returns the value that was set, in initialization and between steps",
    fmi2=_VALUES2,
    fmi3=_VALUES3,
    advice="Keep values that were set until they are set again.",
)
def set_and_read(bench: Bench) -> Found:
    inputs = tried(bench.settable("input"), 60)
    floats = [v for v in bench.settable("parameter") if v.is_float]
    before = all_moved([*tried(floats, 40), *inputs], 1e-3)
    require(before, "there is nothing to set")

    def lost(values: Values, *, running: bool = False, set_after_setup: bool = False) -> dict[Var, str] | None:
        """What is not kept, in words; None: the FMU does not take these values."""

        def work(a: Instance) -> dict[Var, str] | None:
            try:
                if not running:
                    a.enter_initialization(values, set_after_setup=set_after_setup)
                else:
                    a.initialize()
                    a.set(values)
                    if a.kind == "cs":  # nothing may be read between set and step
                        a.step(bench.step)
                return {v: text for v, got in a.get(list(values)).items() if (text := _not_kept(v, values[v], got))}
            except (Refused, Ended):
                return None

        return bench.alone(work)

    found = lost(before)
    if found is None:  # together they do not fit: try each alone
        found = {v: text for v in tried([*before]) for text in (lost({v: before[v]}) or {}).values()}
    later = lost({v: before[v] for v in found}, set_after_setup=True) if found and bench.version == "2" else None
    for v, text in [*found.items()][:MOST_NAMED]:
        when = "before initialization" if bench.version == "3" or v.causality != "input" else "in initialization mode"
        if later is not None and v not in later and v.causality != "input":
            when = "before fmi2SetupExperiment; set after it, the value is kept"
        yield f"{text} (set {when})"
    continuous = {v: before[v] for v in inputs if v in before and (bench.kind == "cs" or v.variability == "continuous")}
    if continuous:
        for text in [*(lost(continuous, running=True) or {}).values()][:MOST_NAMED]:
            yield f"{text} (an input set {'between steps' if bench.kind == 'cs' else 'in continuous-time mode'})"


def _not_kept(v: Var, was: list[Any], got: list[Any]) -> str:
    for x, y in zip(was, got, strict=True):
        if not same(float(x), float(y), 1e-6):  # some pass through single precision
            return f"{v.name!r} was set to {shown(x)} and is {shown(y)}"
    return ""


@check(
    "values.discrete",
    "integers and Booleans are read back as they were set",
    fmi2=_VALUES2,
    fmi3=_VALUES3,
    advice="Keep values that were set until they are set again.",
)
def set_discrete(bench: Bench) -> Found:
    candidates = [v for v in bench.settable("input", "parameter") if not v.is_float]
    require(candidates, "there are no integers or Booleans to set")

    def read(a: Instance, v: Var, value: list[Any]) -> list[Any] | None:
        return a.get([v])[v] if attempt(a.enter_initialization, {v: value}) is not None else None

    for v in tried(candidates):
        value = moved(v)
        if value is None:
            continue
        got = bench.alone(read, v, value)
        if got is not None and [int(x) for x in got] != [int(x) for x in value]:
            yield f"{v.name!r} was set to {shown(value[0])} and is {shown(got[0])}"


@check(
    "values.reset",
    "reset restores all start values",
    fmi2="2.1.6 Initialization, Termination, and Resetting an FMU (fmi2Reset)",
    fmi3="2.3.1 Super State: FMU State Setable (fmi3Reset)",
    advice="Reset must do everything that instantiation does, including all start values.",
)
def reset(bench: Bench) -> Found:
    floats = [v for v in bench.settable("parameter", "input") if v.is_float]
    values = all_moved(tried(floats, 40), 1e-3)

    def after_reset(a: Instance) -> Values:
        attempt(a.initialize, values)
        attempt(a.step, bench.step)
        a.reset()
        return a.enter_initialization().get(_exact(bench))

    found = [f"after reset {t}" for t in _not_at_start(bench.alone(after_reset))]
    # What is not at its start anyway is no fault of reset.
    fresh = bench.alone(lambda a: a.enter_initialization().get(_exact(bench)))
    anyway = {f"after reset {t}" for t in _not_at_start(fresh)}
    yield from _first([t for t in found if t not in anyway])


@check(
    "values.effect",
    "parameters take effect on a fresh and on a reset instance alike",
    fmi2="2.1.6 Initialization, Termination, and Resetting an FMU",
    fmi3="2.3.1 Super State: FMU State Setable; 2.3.2 State: Instantiated",
    advice="Compute everything that depends on parameters when initialization mode is left, also after Reset.",
)
def effect(bench: Bench) -> Found:
    base = bench.repeatable()
    parameters = tried([v for v in bench.settable("parameter") if v.is_float], 6)
    require(parameters, "there are no parameters to set")

    def after_reset(a: Instance, values: Values) -> list[Values] | None:
        attempt(lambda: bench.run(a.initialize()))
        a.reset()
        return attempt(lambda: bench.run(a.initialize(values)))  # type: ignore[no-any-return]

    for v in parameters:
        values = moved(v)
        if values is None:
            continue
        fresh = attempt(bench.fresh, {v: values})
        if not fresh or not difference(base, fresh):
            continue
        again = bench.alone(after_reset, {v: values})
        what = f"with {v.name!r} = {shown(values[0])} a fresh instance and one that was reset give different results"
        if again and (unlike := compared(bench, fresh, again, what)):
            yield unlike


@check(
    "values.readonly",
    "constants, outputs and calculated variables cannot be set",
    fmi2="2.1.3 Status Returned by Functions; 2.2.7 (causality, variability)",
    fmi3="2.2.4 Status Returned by Functions (setting a constant)",
    advice="Return Error when a constant, an output or another calculated variable is set.",
    worst="warning",
)
def readonly(bench: Bench) -> Found:
    readable = bench.fmu.readable(bench.model.variables)
    exact = {
        v.key
        for v in bench.model.variables
        if v.causality in ("input", "parameter") or (v.says.get("initial") in ("exact", "approx"))
    }
    states = {v.key for v in bench.model.states}
    constants = [v for v in readable if v.variability == "constant" and v.is_number]
    calculated = [
        v
        for v in readable
        if v.causality in ("output", "calculatedParameter") and v.initial == "calculated" and v.is_number
    ]
    fixed = [v for v in bench.settable("parameter") if v.variability == "fixed"]
    taken: dict[str, list[str]] = {}

    def takes(a: Instance, v: Var, running: bool) -> bool:
        if running:
            a.initialize()
        return good(a.set_raw(v.access, [v], v.starts() or [0] * v.size))

    for what, group, running in (
        ("constants", constants, False),
        ("calculated variables", calculated, True),
        ("fixed parameters, after initialization,", fixed, True),
    ):
        for v in tried(group, 4):
            if what != "fixed parameters, after initialization," and (v.key in exact or v.key in states):
                continue  # an alias of it may be set
            if bench.alone(takes, v, running):
                taken.setdefault(what, []).append(v.name)
    for what, found in taken.items():
        yield f"{what} can be set: {names(found)}"


@check(
    "values.unknown",
    "value references that do not exist, and functions of another type, return an error",
    fmi2="2.1.3 Status Returned by Functions; " + _VALUES2,
    fmi3="2.2.4 Status Returned by Functions; " + _VALUES3,
    advice="Look up value references, and return Error for unknown ones.",
    worst="warning",
)
def unknown(bench: Bench) -> Found:
    used: dict[str, set[int]] = {}
    for v in bench.model.variables:
        used.setdefault(v.access if bench.version == "2" else "", set()).add(v.reference or 0)
    floats = "Real" if bench.version == "2" else "Float64"
    nobodys = next(r for r in range(2**20, 2**32) if all(r not in u for u in used.values()))

    def takes(a: Instance, reference: int, function: str) -> bool:
        return good(a.initialize().transfer(function, [reference], 1, a.buffer("double", 1), 1))

    taken = [
        f"{function} of value reference {reference}"
        for reference in (nobodys, 2**32 - 1)
        if not any(reference in u for u in used.values())
        for function in (f"Get{floats}", f"Set{floats}")
        if bench.alone(takes, reference, function)
    ]
    if taken:
        yield f"accepted: {', '.join(taken)}"
    other = "Integer" if bench.version == "2" else "Int32"
    for v in [v for v in bench.watched() if v.access == floats and v.size == 1][:1]:
        if bench.version == "2" and v.reference in used.get("Integer", ()):
            continue
        if bench.alone(lambda a, v: good(a.initialize().get_raw(other, [v])[0]), v):
            yield f"Get{other} reads {v.name!r}, which is {v.type}"


@check(
    "values.extreme",
    "NaN, infinity and values out of range are rejected or handled without a crash",
    fmi2=_VALUES2 + " (min, max)",
    fmi3="2.2.6.3 Handling min/max Range Violations",
    advice="Return Discard or Error for invalid values; never crash or hang.",
    worst="warning",
)
def extreme(bench: Bench) -> Found:
    inputs = [v for v in bench.settable("input") if v.is_float]
    parameters = [v for v in bench.settable("parameter") if v.is_float]
    require(inputs or parameters, "there are no real inputs or parameters")
    tries: list[tuple[list[Var], float]] = [(inputs, x) for x in (math.nan, math.inf, -1e300)]
    tries += [(tried(parameters, 2), x) for x in (math.nan, math.inf)]

    def live_on(a: Instance, group: list[Var], value: float) -> None:
        running = group is inputs
        if running:
            a.initialize()
        bench.fmu.say(f"with {value:g} in {names(v.name for v in group)}")
        if attempt(a.set, {v: [value] * v.size for v in group}) is None:
            return
        attempt(lambda: running or a.initialize())
        for _ in range(2):
            attempt(a.step, bench.step)
        attempt(a.get, bench.watched())

    for group, value in tries:
        if group:
            bench.alone(live_on, group, value)
    yield from ()


@check(
    "values.range",
    "values in a run are finite and lie in their declared range",
    fmi2="2.2.7 Definition of Model Variables (min, max)",
    fmi3="2.2.6.3 Handling min/max Range Violations",
    advice="Correct min and max, or the computation.",
    worst="warning",
)
def in_range(bench: Bench) -> Found:
    seen: set[str] = set()
    for values in bench.fresh():
        for v, got in values.items():
            if v.name in seen or not v.is_number:
                continue
            low, high = v.bounds
            for x in got:
                margin = 1e-6 * max(abs(v.low or 0.0), abs(v.high or 0.0), v.nominal or 0.0) if v.is_float else 0
                if v.is_float and not math.isfinite(x):
                    seen.add(v.name)
                    yield warning(f"{v.name!r} is {shown(x)} with start values")
                    break
                if x < low - margin or x > high + margin:
                    seen.add(v.name)
                    yield warning(f"{v.name!r} is {shown(x)}, outside of its range {low:g} to {high:g}")
                    break
