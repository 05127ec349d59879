"""Checks of what is declared about derivatives and dependencies, and of Model Exchange: compared with differences."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Sequence

from cosim.check.bench import Bench, Values, attempt, moved, same, tried
from cosim.check.calls import Ended, Instance, Refused
from cosim.check.model import Unknown, Var
from cosim.check.rules import Found, NotApplicable, check, names, note, require

_STRUCTURE2, _STRUCTURE3 = (
    "2.2.8 Definition of the Model Structure (dependencies)",
    "2.4.8 Model Structure (dependencies)",
)
_PARTIAL2, _PARTIAL3 = "2.1.9 Getting Partial Derivatives", "2.2.11 Getting Partial Derivatives"
MOST = 24  # knowns that are tried
TOLERANCE = 1e-3  # of a column: what is above is another derivative, not the error of a difference
AGREE = 1e-5  # of a column: up to which differences with two steps agree, for the column to count as reliable

Vector = list[float]


def _flat(values: Values) -> Vector:
    return [float(x) for xs in values.values() for x in xs]


@check(
    "derivatives.initial",
    "in initialization an unknown depends only on its declared dependencies",
    fmi2=_STRUCTURE2,
    fmi3=_STRUCTURE3,
    advice="Add the known to the dependencies of the InitialUnknown, or omit dependencies, which means all knowns.",
    worst="warning",
)
def initial(bench: Bench) -> Found:
    m = bench.model
    numbers = {v for v in bench.fmu.readable(m.variables) if v.is_number}
    of = {v: u for u, v in m.unknowns("InitialUnknown") if u.depends is not None and v in numbers}
    knowns = [v for v in bench.settable("input", "parameter") if v.is_float]
    knowns += [
        v
        for v in bench.fmu.readable(m.of("output", "local"))
        if v.says.get("initial") == "exact" and v.is_float and v.starts() is not None and v.variability == "continuous"
    ]
    require(of, "no dependencies of initial unknowns are declared")
    require(knowns, "there is nothing to vary")
    unknowns = list(of)
    aliases = _aliases(bench)

    def move(a: Instance, known: Var, values: Vector) -> tuple[Values, Values, Values] | None:
        a.enter_initialization()
        before, again = a.get(unknowns), a.get(unknowns)
        after = attempt(lambda: a.set({known: values}) and a.get(unknowns))
        return None if after is None else (before, again, after)

    for known in tried(knowns, MOST):
        values = moved(known)
        if values is None:
            continue

        read = bench.alone(move, known, values)
        if read is None:
            continue
        before, again, after = read
        found = [
            v.name
            for v, u in of.items()
            if not (aliases[m.key(known)] & set(u.depends or ()))
            and v.key != known.key
            and not are_close(before[v], after[v])
            and are_close(before[v], again[v])
        ]
        if found:
            text = (
                f"{names(found)} {'move' if len(found) > 1 else 'moves'} with {known.name!r} in initialization, but"
                f" {'do' if len(found) > 1 else 'does'} not declare to depend on it"
            )
            # Leaving parameters out is how a tool says that nobody may solve for them.
            yield note(text) if known.causality == "parameter" else text


def other_values(x: Sequence[float]) -> list[float]:
    """Values near these, none of them the same."""
    return [v + 1e-3 * max(abs(v), 1e-3) for v in x]


def are_close(a: Sequence[float], b: Sequence[float]) -> bool:
    """Equal but for what an iterative solution inside an FMU may leave, of the largest of them."""
    size = max((abs(float(x)) for x in (*a, *b) if math.isfinite(x)), default=0.0)
    return all(
        same(float(x), float(y), 1e-6) or abs(x - y) <= max(1e-6 * size, 1e-9) for x, y in zip(a, b, strict=True)
    )


def _aliases(bench: Bench) -> dict[int | None, set[int | None]]:
    """Keys of each variable and of all that are the same one."""
    sets: dict[tuple[int | None, str], set[int | None]] = {}
    for v in bench.model.variables:
        sets.setdefault(v.key, set()).add(bench.model.key(v))
    return {bench.model.key(v): sets[v.key] for v in bench.model.variables}


def evaluating(bench: Bench) -> Instance:
    """A Model Exchange instance, a step from its start, so that it lies off special points."""
    a = bench.instance().require()
    try:
        a.initialize()
        for _ in range(2):
            a.step(bench.step)
    except Ended:
        a.free()
        raise NotApplicable("it asks to end the simulation") from None
    except Refused:
        a.free()
        raise
    return a


def _known(bench: Bench) -> list[tuple[str, Var, int]]:
    """(what, variable, element) of states and continuous inputs."""
    m = bench.model
    found = [("state", s, i) for s in m.states for i in range(s.size)]
    return [*found, *_known_inputs(bench)]


def _known_inputs(bench: Bench) -> list[tuple[str, Var, int]]:
    return [("input", v, i) for v in bench.continuous_inputs() for i in range(v.size)]


def _function(
    bench: Bench, a: Instance, what: str, known: Var, element: int, unknowns: Sequence[Var]
) -> tuple[Callable[[float], Values], float]:
    """Unknowns as a function of one known, and where that is now."""
    if what == "state":
        x = a.get_states()
        at = sum(s.size for s in bench.model.states[: bench.model.states.index(known)]) + element

        def f(value: float) -> Values:
            a.set_states([*x[:at], value, *x[at + 1 :]])
            return a.get(unknowns)

        return f, x[at]
    values = a.get([known])[known]

    def g(value: float) -> Values:
        a.set({known: [*values[:element], value, *values[element + 1 :]]})
        return a.get(unknowns)

    return g, values[element]


def _unknowns(bench: Bench) -> dict[Var, Unknown]:
    """Continuous outputs and derivatives."""
    continuous = bench.continuous()
    found: dict[Var, Unknown] = {}
    for u, v in bench.model.unknowns("Output", "Derivative"):
        if v in continuous:
            found.setdefault(v, u)
    return found


@check(
    "derivatives.dependencies",
    "outputs and derivatives depend only on the states and inputs that they declare",
    fmi2=_STRUCTURE2,
    fmi3=_STRUCTURE3,
    advice="Add the known to the dependencies of the unknown, or omit dependencies, which means all knowns.",
    kinds=("me",),
)
def dependencies(bench: Bench) -> Found:
    m, unknowns = bench.model, {v: u for v, u in _unknowns(bench).items() if u.depends is not None}
    knowns = _known(bench)
    require(unknowns, "no dependencies are declared")
    require(knowns, "there is nothing to vary")
    aliases = _aliases(bench)
    with evaluating(bench) as a:
        read = list(unknowns)
        reported: set[tuple[str, str]] = set()
        for what, known, element in tried(knowns, 2 * MOST):
            f, at = _function(bench, a, what, known, element, read)
            before = attempt(f, at)
            size = 1e-3 * max(abs(at), known.nominal or 0.0, 1e-2)
            after = attempt(f, at + size)
            again = attempt(f, at)
            if before is None or after is None or again is None:
                continue
            for v, u in unknowns.items():
                if aliases[m.key(known)] & set(u.depends or ()) or v.key == known.key:
                    continue
                if (
                    not are_close(before[v], after[v])
                    and are_close(before[v], again[v])
                    and (v.name, known.name) not in reported
                ):
                    reported.add((v.name, known.name))
                    yield f"{v.name!r} moves with the {what} {known.name!r}, but does not declare to depend on it"
                    if len(reported) >= 5:
                        return


@check(
    "derivatives.directional",
    "directional derivatives agree with finite differences",
    fmi2=_PARTIAL2,
    fmi3=_PARTIAL3,
    advice="Correct the derivative, or do not declare support for directional derivatives.",
)
def directional(bench: Bench) -> Found:
    require(bench.interface.directional, "it does not support directional derivatives")
    if bench.kind == "me":
        with evaluating(bench) as a:
            yield from _columns(bench, a, list(_unknowns(bench)), _known(bench), "")
        return
    continuous = bench.continuous()
    listed = dict.fromkeys(bench.model.listed("InitialUnknown"))
    unknowns = [v for v in listed if v in continuous and v.causality == "output"]
    # between steps nothing may be read after it was set, but in initialization it may
    with bench.instance() as a:
        a.enter_initialization()
        yield from _columns(bench, a, unknowns, _known_inputs(bench), " in initialization")


def _columns(bench: Bench, a: Instance, unknowns: list[Var], knowns: list[tuple[str, Var, int]], where: str) -> Found:
    require(unknowns and knowns, "there is nothing to differentiate")
    m = bench.model
    groups = ("InitialUnknown",) if where else ("Output", "Derivative")
    of = {u.key: u for u in m.structure if u.group in groups}
    aliases = _aliases(bench)
    reported = 0
    for what, known, element in tried(knowns, MOST):
        depending = [
            v
            for v in unknowns
            if (u := of.get(m.key(v))) is None or u.depends is None or aliases[m.key(known)] & set(u.depends)
        ]
        depending = [v for v in depending if v.key != known.key]
        if not depending:
            continue
        f, at = _function(bench, a, what, known, element, depending)

        def g(x: float, f: Callable[[float], Values] = f) -> Vector:
            return _flat(f(x))

        expected = attempt(difference, g, at, max(abs(at), known.nominal or 1e-2))
        if attempt(f, at) is None or expected is None:
            continue
        seed = [float(i == element) for i in range(known.size)]
        column = a.directional(depending, [known], seed)
        scale = max(map(abs, (*expected, *(x for x in column if math.isfinite(x)))), default=0.0)
        flat = [(v, i) for v in depending for i in range(v.size)]
        for (v, i), x, y in zip(flat, column, expected, strict=True):
            if not abs(x - y) <= TOLERANCE * scale + 1e-9:
                index = f"[{i + 1}]" if v.size > 1 else ""
                yield f"d {v.name}{index} / d {known.name}{where} is {x:.6g} in the FMU, {y:.6g} by finite differences"
                reported += 1
                break
        if reported >= 3:
            return


def difference(f: Callable[[float], Vector], at: float, size: float) -> Vector | None:
    """Derivative of `f` by central differences, or None if it is not reliable there: at kinks, jumps and limits."""
    best: Vector | None = None
    gap_of_best = math.inf
    for relative in (1e-1, 1e-2, 1e-3, 1e-4, 1e-5):
        h = relative * size
        try:
            here, sides = f(at), [(d, f(at + d), f(at - d)) for d in (h, h / 2)]
        except Refused:
            continue
        coarse, fine = ([(x - y) / (2 * d) for x, y in zip(up, down, strict=True)] for d, up, down in sides)
        wide, bend = (
            max((abs(x - 2 * z + y) / d for x, y, z in zip(up, down, here, strict=True)), default=0.0)
            for d, up, down in sides
        )
        scale = max(map(abs, fine), default=0.0)
        if bend > max(0.9 * wide, 1e-3 * scale):  # a kink at the point itself: its slopes do not come closer
            continue
        gap = max((abs(x - y) for x, y in zip(coarse, fine, strict=True)), default=0.0)
        if scale == 0.0 and gap == 0.0:
            return fine
        if scale > 0.0 and math.isfinite(gap) and gap / scale < gap_of_best:
            best, gap_of_best = fine, gap / scale
    return best if gap_of_best < AGREE else None


@check(
    "derivatives.adjoint",
    "adjoint derivatives are the transpose of directional ones",
    fmi3="2.2.11 Getting Partial Derivatives (fmi3GetAdjointDerivative)",
    advice="Correct one of the two, or do not declare support for it.",
)
def adjoint(bench: Bench) -> Found:
    require(
        bench.interface.can("providesAdjointDerivatives") and bench.interface.directional,
        "it does not support directional and adjoint derivatives",
    )
    unknowns = list(_unknowns(bench))
    knowns = bench.continuous_inputs()
    if bench.kind == "me":
        knowns = [*bench.model.states, *knowns]
    both = {v.key for v in knowns}
    unknowns = [v for v in unknowns if v.key not in both]  # a state that is an output is both
    require(unknowns and knowns, "there is nothing to differentiate")
    with evaluating(bench) as a:
        n, k = sum(v.size for v in unknowns), sum(v.size for v in knowns)
        x, y = [math.cos(i + 1.0) for i in range(k)], [math.sin(i + 1.0) for i in range(n)]
        forward, backward = a.directional(unknowns, knowns, x), a.directional(unknowns, knowns, y, adjoint=True)
        one, other = (sum(p * q for p, q in zip(u, w, strict=True)) for u, w in ((y, forward), (backward, x)))
        size = sum(abs(p * q) for p, q in zip(y, forward, strict=True))
        if not abs(one - other) <= 1e-6 * size + 1e-12:
            yield (
                f"for one seed of each, the product of both is {one:.9g} by directional and {other:.9g} by adjoint"
                " derivatives"
            )


@check(
    "derivatives.rates",
    "outputs that are declared as derivatives of other outputs are consistent with them",
    fmi2="2.2.7 Definition of Model Variables (derivative)",
    fmi3="2.4.7.5 Type specific properties (derivative)",
    advice="Correct the attribute derivative, or the computation.",
    kinds=("cs",),
)
def rates(bench: Bench) -> Found:
    m = bench.model
    readable = set(bench.fmu.readable(m.variables))
    pairs = [
        (v, s)
        for v in m.variables
        if (s := m.state_of(v)) is not None and {v, s} <= readable and v.is_float and s.is_float and v.size == s.size
    ]
    pairs = pairs[:100]
    require(pairs, "no variable is declared as the derivative of another one")
    with bench.instance() as a:
        a.initialize()
        h = bench.step  # never less: an FMU may advance in steps of its own, and FMI 2.0 has no word to say so
        watched = list(dict.fromkeys(v for pair in pairs for v in pair))
        found = []
        try:
            for _ in range(12):
                a.step(h)
                found.append(a.get(watched))
        except Ended:
            pass
    for v, s in pairs:
        for i in range(v.size):
            x, dx = [f[s][i] for f in found], [f[v][i] for f in found]
            held = [p == q for p, q in itertools.pairwise(x)]
            if any(held) and not (all(held) and bench.tells_step):
                continue  # its own steps do not fit this one
            if _wrong_rate(x, dx, h):
                k = max(range(len(dx) - 1), key=lambda k: abs(dx[k]))
                yield (
                    f"{v.name!r} is declared as the derivative of {s.name!r}, which changes by"
                    f" {(x[k + 1] - x[k]) / h:.6g} per second while it is {dx[k]:.6g}"
                )
                break


def _wrong_rate(x: Vector, dx: Vector, h: float) -> bool:
    """Whether hardly any step fits, by a margin that no solver's error explains: where the rate itself is smooth."""
    wrong = smooth = 0
    for k in range(len(x) - 1):
        moved_, mean, bend = x[k + 1] - x[k], 0.5 * h * (dx[k] + dx[k + 1]), abs(h * (dx[k + 1] - dx[k]))
        size = max(abs(moved_), abs(mean))
        if not math.isfinite(size) or size <= 1e-9 * max(abs(x[k]), 1e-6) or bend > 0.2 * size:
            continue
        smooth += 1
        wrong += abs(moved_ - mean) > 0.3 * size + bend
    return smooth >= 5 and wrong >= 0.8 * smooth
