"""Whether expressions have the dimensions that their variables declare.

An equation between quantities holds in all units. So when meters become a power of four larger, and every value that is
measured in meters is given in the new ones, each start, derivative, update and output must come out in the new ones
too: multiplied by that power of four to the exponent that its unit has in m. What adds a length to a mass, drops a
factor with a dimension or has one in a literal does not. Each base unit is tried by itself, with a power of four above
1 and one below, at the operating points with fixed random values about them. Powers of four, and their roots, only move
the exponents of binary numbers: sums, products, quotients and roots are bit-identical, `fmax` and `if_else` take
the same branch. Only `pow` and the like round, for which 1e-12 is allowed.

Radians count as dimensionless: rotations are full of products of lengths and angles. Degrees are no unit that a
variable could have, only a display unit. A factor without a dimension (a forgotten 1/2, kN for N) is not found in this
way.

Variables without a unit are dimensionless when they are Integers or Booleans. Real ones are unknown; what depends on
one is not checked, unless it has units by row and column.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from build_fmus.base import extras, units
from build_fmus.component.declaration import VECTORS, Declaration
from build_fmus.component.functions import column, results
from build_fmus.component.variables import DeclarationError, Role, Variable

with extras.needed("build", extras.BUILDING):
    import casadi as ca

Exponents = Mapping[str, int]
"""Base unit -> exponent, without those that are 0."""

_FACTORS = (4.0**16, 4.0**-16)  # far enough that a literal of any usual size shows
_SPREADS = (0.03, 0.1, 1.0, 0.01, 3.0, 0.3, 0.3, 0.03)  # of the random values about an operating point, relative
_POINTS = (24, 40)  # over all operating points: few of long functions; half of them with the reference inputs
_OPERATIONS = 200_000  # in all points together, roughly
_STEPS = 200  # along the reference inputs, as in the reference result
_PARAMETERS = 0.3  # largest spread of parameters, so that they still fit together
_TOLERANCE = 1e-12  # relative, where an operation is not exact
_TOLD = 5  # violations in a message
_INEXACT = (
    ca.OP_POW,
    ca.OP_CONSTPOW,
    ca.OP_LOG,
    ca.OP_LOG1P,
    ca.OP_EXP,
    ca.OP_EXPM1,
    ca.OP_HYPOT,
    ca.OP_ATAN2,
    ca.OP_CALL,
    ca.OP_SOLVE,
    ca.OP_DETERMINANT,
    ca.OP_INVERSE,
    ca.OP_NORM2,
    ca.OP_NORMF,
)


@dataclass(frozen=True)
class Violation:
    """An expression that does not scale as its variable's unit does.

    Attributes:
        name: element of an output, `der(state)`, or `start of STATE`.
        unit: what is declared, in words: `m/s2`, `m/s per s`.
        base: base unit that was scaled.
        declared: exponent of the base unit in the declared unit.
        found: power with which the expression really scales; None when it is no power, because quantities of different
            dimension are added or compared.
    """

    name: str
    unit: str
    base: str
    declared: int
    found: float | None

    def __str__(self) -> str:
        what = f"{self.name}: declared in {self.unit}, which has {self.base}^{self.declared}, but its expression "
        if self.found is None:
            return f"{what}adds or compares quantities with different powers of {self.base}"
        return f"{what}scales with {self.base}^{self.found:g}"


@dataclass(frozen=True)
class Dimensions:
    """What the check of a component found.

    Attributes:
        component: its name.
        violations: what does not scale as declared.
        unchecked: elements that are, or depend on, real values without a unit.
        not_exercised: real elements that were 0 or not finite at every point, so that their dimension was not checked.
    """

    component: str
    violations: tuple[Violation, ...]
    unchecked: tuple[str, ...]
    not_exercised: tuple[str, ...]

    def check(self) -> None:
        """Refuse violations.

        Raises:
            DeclarationError: naming variables, their units, and the powers that they really have.
        """
        if not self.violations:
            return
        texts = [str(v) for v in self.violations]
        more = [f"and {len(texts) - _TOLD} more"] if len(texts) > _TOLD else []
        raise DeclarationError(
            f"{self.component}: dimensions: {'; '.join(texts[:_TOLD] + more)}. Declare every number that has a"
            " dimension with its unit, by parameter() or constant(); for the sample time use component.period"
        )


def find_dimensions(declaration: Declaration) -> Dimensions:
    """Scale every base unit, and compare.

    Raises:
        DeclarationError: an expression with an undeclared symbol.
    """
    return _Scaling(declaration).report()


def exponents(name: str) -> Exponents:
    """Base-unit exponents of a unit, without radians."""
    return {b: e for b, e in units.unit(name).powers.items() if b != "rad"}


def element_exponents(v: Variable) -> list[Exponents | None]:
    """Exponents of the elements of a variable, row-major; None where nothing is known."""
    if v.type != "Float64":
        return [{}] * v.size
    if v.unit is not None:
        return [exponents(v.unit)] * v.size
    if not v.rows:
        return [None] * v.size
    return [_quotient(exponents(r), exponents(c)) for r in v.rows for c in v.columns or ("1",)]


def _quotient(a: Exponents, b: Exponents) -> Exponents:
    return {n: e for n in {**a, **b} if (e := a.get(n, 0) - b.get(n, 0))}


@dataclass(frozen=True)
class _Row:
    """One scalar that is compared.

    `name` and `unit` are for messages; `exponents` None: unknown; `real`: whether it is a real number.
    """

    name: str
    unit: str
    exponents: Exponents | None
    real: bool


@dataclass(frozen=True)
class _Part:
    """A start, change or output: a column of expressions, and what each of them is."""

    expression: Any
    rows: list[_Row]
    number: bool = False  # an output that is a number: its declaration tells the unit

    @classmethod
    def of(cls, v: Variable, pattern: str, expression: Any, per: Exponents, number: bool = False) -> _Part:
        """The expression of `v`, or of its derivative when `per` is a second."""
        units = [v.unit or "no unit"] * v.size
        if v.rows:
            units = [f"{r} per {c}" if c else r for r in v.rows for c in v.columns or ("",)]
        rows = [
            _Row(
                pattern.format(n),
                f"{u} per s" if per else u,
                e if e is None else _quotient(e, per),
                v.type == "Float64",
            )
            for n, u, e in zip(v.element_names(), units, element_exponents(v), strict=True)
        ]
        return cls(expression, rows, number)


class _Scaling:
    """One declaration with its constants as arguments."""

    def __init__(self, d: Declaration) -> None:
        self.d = d
        self.exponents = {v.name: element_exponents(v) for v in d.all_variables}
        self.constants = d.of("constant")
        self.programs = [q.symbol for q in d.programs]
        self.symbols = [
            d.time,
            *(d.symbol(r) for r in VECTORS),
            *(v.symbol for v in self.constants),
            *self.programs,
            *(s for q in d.profiles for s in (q.symbol, q.wave_number)),
        ]
        self.start = ca.Function("start", self.symbols, [column(d, list(d.starts.values()))])
        named = {v.name: v for v in d.all_variables}
        per: Exponents = {"s": 1} if d.kind == "continuous" else {}
        parts = [_Part.of(named[n], "start of {}", e, {}) for n, e in d.starts.items()]
        parts += [_Part.of(named[n], "der({})" if per else "{}", e, per) for n, e in d.changes.items()]
        parts += [
            _Part.of(named[n], "{}", e, {}, d.results[n].is_constant())
            for n, e in zip(d.results, results(d), strict=True)
        ]
        for q in d.profiles:
            rows = [_Row(f"seed of {q.name}", "no unit", {}, False), _Row(f"length of {q.name}", "m", {"m": 1}, True)]
            rows += [_Row(f"spectrum of {q.name}", "m3", {"m": 3}, True)] * 2
            parts.append(_Part(ca.vertcat(q.settings, q.spectra), rows))
        parts = [p for p in parts if not p.number]
        checked = self._checked(parts)
        self.unchecked = [
            r.name for p, known in zip(parts, checked, strict=True) for r, k in zip(p.rows, known, strict=True) if not k
        ]
        parts = [p for p, known in zip(parts, checked, strict=True) if known.any()]
        self.rows = [r for p in parts for r in p.rows]
        self.checked = np.concatenate([known for known in checked if known.any()] or [np.zeros(0, bool)])
        self.expressions = column(d, [p.expression for p in parts])
        self.function = ca.Function("dimensions", self.symbols, [self.expressions])

    def _checked(self, parts: Sequence[_Part]) -> list[np.ndarray]:
        """For each part the rows whose unit is known and that depend on no value of unknown unit."""
        known = [np.array([r.exponents is not None for r in p.rows], bool) for p in parts]
        unknown = [v.symbol for v in self.d.all_variables if v.role != "output" and None in self.exponents[v.name]]
        unknown += self.programs
        if unknown and parts:
            every = column(self.d, [p.expression for p in parts])
            tainted = np.array(ca.which_depends(every, ca.vertcat(*unknown), 1, True), bool)
            ends = np.cumsum([len(p.rows) for p in parts])[:-1]
            known = [k & ~t for k, t in zip(known, np.split(tainted, ends), strict=True)]
        return known

    # ------------------------------------------------------------------ where

    def _vector(self, role: Role, what: str, missing: float) -> np.ndarray:
        """A limit or nominal value of each element of a role."""
        out = np.full(self.d.size(role), missing)
        for v in self.d.of(role):
            value = getattr(v, what)
            if value is not None:
                out[v.slot : v.slot + v.size] = value
        return out

    def _near(self, role: Role, at: np.ndarray, rng: np.random.Generator, spread: float) -> np.ndarray:
        """Random values about `at` within the limits; Integers and Booleans anywhere in their range."""
        usual = np.where(at != 0, np.abs(at), self._vector(role, "nominal", 1.0))
        out = at + spread * usual * rng.uniform(-1.0, 1.0, at.shape)
        for v in self.d.of(role):
            if v.type != "Float64":
                low, high = (0, 1) if v.type == "Boolean" else (v.min, v.max)
                low, high = (0 if low is None else low), (3 if high is None else high)
                out[v.slot : v.slot + v.size] = rng.integers(int(low), int(high) + 1, v.size)
        return np.clip(out, self._vector(role, "min", -np.inf), self._vector(role, "max", np.inf))

    @cached_property
    def points(self) -> list[list[np.ndarray]]:
        """Time, states, inputs and parameters: operating points, each with random values about it."""
        d, rng = self.d, np.random.default_rng(13)
        places = {
            role: {n: v.slot + i for v in d.of(role) for i, n in enumerate(v.element_names())}
            for role in ("state", "input")
        }
        fixed, found = self._fixed(), []
        calculated = [v.slot + i for n in d.starts for v in d.of("state") if v.name == n for i in range(v.size)]
        fewest, most = _POINTS
        count = min(most, max(fewest, _OPERATIONS // max(1, self.function.n_instructions())))
        each = max(4, math.ceil(count / len(d.operating_points)))
        for values in d.operating_points.values():
            for k in range(each):
                driven = k % 2 == 1
                spread = _SPREADS[k % len(_SPREADS)]
                t = rng.uniform(0.0, _STEPS * (d.sample_time or d.exchange_step) if driven else d.stop_time)
                u, p = d.vector("input"), d.vector("parameter")
                moving = {n: signal(t) for n, signal in d.reference_inputs.items()} if driven else {}
                for name, value in (*moving.items(), *values.items()):
                    if name in places["input"]:
                        u[places["input"][name]] = value
                u = self._near("input", u, rng, spread)
                p = self._near("parameter", p, rng, min(spread, _PARAMETERS))
                x = d.vector("state")
                x[calculated] = np.asarray(self.start(t, x, u, p, *fixed)).ravel()
                for name, value in values.items():
                    if name in places["state"]:
                        x[places["state"][name]] = value
                found.append([np.array(t), self._near("state", x, rng, spread), u, p])
        return found

    # ------------------------------------------------------------------ comparing

    def _scale(self, variables: Sequence[Variable], base: str, factor: float) -> np.ndarray:
        """What the elements of variables are multiplied with."""
        return np.array([factor ** (e or {}).get(base, 0) for v in variables for e in self.exponents[v.name]])

    def _fixed(self, base: str = "s", factor: float = 1.0) -> list[Any]:
        """Constants in these units, the solutions of quadratic programs, and random profiles with a wave number."""
        values = [np.array(v.start or ()) * self._scale([v], base, factor) for v in self.constants]
        fixed = [ca.DM(x.reshape(v.symbol.shape)) for x, v in zip(values, self.constants, strict=True)]
        fixed += [ca.DM.zeros(*s.shape) for s in self.programs]
        meter = factor if base == "m" else 1.0
        for q in self.d.profiles:
            heights = np.random.default_rng(7).standard_normal(q.symbol.numel())
            fixed += [ca.DM(heights * meter), ca.DM(np.sqrt(q.lowest * q.highest) / meter)]
        return fixed

    def report(self) -> Dimensions:
        """Evaluate at all points in all units."""
        points, fixed = (self.points if self.rows else []), self._fixed()
        plain = [self._evaluate(point, fixed) for point in points]
        seen = np.zeros(len(self.rows), bool)
        for values in plain:
            seen |= np.isfinite(values) & (values != 0)
        bad: dict[tuple[int, str], set[float | None]] = {}
        for base in sorted({"s", *(b for known in self.exponents.values() for e in known for b in e or {})}):
            for factor in _FACTORS:
                scales = [np.array(factor if base == "s" else 1.0)]
                scales += [self._scale(self.d.of(role), base, factor) for role in VECTORS]
                fixed = self._fixed(base, factor)
                declared = np.array([factor ** (r.exponents or {}).get(base, 0) for r in self.rows])
                for point, values in zip(points, plain, strict=True):
                    scaled = self._evaluate([a * s for a, s in zip(point, scales, strict=True)], fixed)
                    expected = values * declared
                    for i in np.flatnonzero(self.checked & (expected != scaled) & np.isfinite(values)).tolist():
                        if not self._rounded(i, expected[i], scaled[i]):
                            power = _power(scaled[i] / values[i], factor) if values[i] else None
                            bad.setdefault((i, base), set()).add(power)
        violations = []
        for (i, base), powers in sorted(bad.items()):
            row = self.rows[i]
            exponent = (row.exponents or {}).get(base, 0)
            found = powers.pop() if len(powers) == 1 else None
            violations.append(Violation(row.name, row.unit, base, exponent, None if found == exponent else found))
        not_exercised = [
            r.name for r, k, s in zip(self.rows, self.checked, seen, strict=True) if k and r.real and not s
        ]
        return Dimensions(self.d.name, tuple(violations), tuple(self.unchecked), tuple(not_exercised))

    def _evaluate(self, point: Sequence[np.ndarray], fixed: Sequence[Any]) -> np.ndarray:
        return np.asarray(self.function(*point, *fixed)).ravel()

    def _rounded(self, i: int, expected: float, scaled: float) -> bool:
        """Whether a difference is rounding, of an operation that is not exact."""
        if not abs(scaled - expected) <= _TOLERANCE * abs(expected):
            return False
        f = ca.Function("row", self.symbols, [self.expressions[i]])
        return any(f.instruction_id(k) in _INEXACT for k in range(f.n_instructions()))


def _power(ratio: float, factor: float) -> float | None:
    """The exponent e with `ratio` = `factor`**e; None when no expression of units could have that exponent."""
    if not (math.isfinite(ratio) and ratio > 0):
        return None
    power = math.log(ratio) / math.log(factor)
    near = round(power * 6) / 6
    return round(near, 4) + 0.0 if abs(power - near) < 1e-9 else None
