"""Whether expressions have the dimensions that their variables declare.

An equation between quantities holds in all units. So when metres become a power of four larger, and every value that is measured
in metres is given in the new ones, each start, derivative, update and output must come out in the new ones too: multiplied by that power of
four to the exponent that its unit has in m. What adds a length to a mass, drops a factor with a dimension or has one in a literal
does not. Each base unit is tried by itself, with a power of four above 1 and one below, at the operating points with fixed random values about
them. Powers of four, and their roots, only move the exponents of binary numbers: sums, products, quotients and roots give the same bits,
``fmax`` and ``if_else`` take the same branch. Only ``pow`` and the like round, for which 1e-12 is allowed.

Radians count as dimensionless: rotations are full of products of lengths and angles. Degrees are no unit that a variable could have, only a
display unit. A factor without a dimension (a forgotten 1/2, kN for N) is not found in this way.

Variables without a unit are dimensionless when they are Integers or Booleans. Real ones are unknown; what depends on one is not
checked, unless it has units by row and column.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from build_fmus import extras, units
from build_fmus.component.declaration import VECTORS, Declaration
from build_fmus.component.functions import column, results
from build_fmus.component.variables import DeclarationError, Role, Variable

with extras.needed("build", extras.BUILDING):
    import casadi as ca

Exponents = Mapping[str, int]
"""Base unit -> exponent, without those that are 0."""

BASE_UNITS = tuple(sorted({b for u in units.UNITS.values() for b in u.exponents} - {"rad"}))
"""What is scaled, each by itself."""

_FACTORS = (4.0**16, 4.0**-16)  # far enough that a literal of any usual size shows
_SPREADS = (0.03, 0.3, 0.3, 1.0)  # of the random values about an operating point, relative; one point each
_TOLERANCE = 1e-12  # relative, where an operation is not exact
_TOLD = 5  # violations in a message
_INEXACT = (
    ca.OP_POW, ca.OP_CONSTPOW, ca.OP_LOG, ca.OP_LOG1P, ca.OP_EXP, ca.OP_EXPM1, ca.OP_HYPOT, ca.OP_ATAN2, ca.OP_CALL, ca.OP_SOLVE,
    ca.OP_DETERMINANT, ca.OP_INVERSE, ca.OP_NORM2, ca.OP_NORMF,
)  # fmt: skip


@dataclass(frozen=True)
class Violation:
    """An expression that does not scale as its variable's unit does.

    Attributes:
        name: element of an output, ``der(state)``, or ``start of STATE``.
        unit: what is declared, in words: ``m/s2``, ``m/s per s``.
        base: base unit that was scaled.
        declared: exponent of the base unit in the declared unit.
        found: power with which the expression really scales; None when it is none, because quantities of different dimension are
            added or compared.
    """

    name: str
    unit: str
    base: str
    declared: int
    found: float | None

    def __str__(self) -> str:
        what = f"{self.name}: declared in {self.unit}, which has {self.base}^{self.declared}, but its expression "
        if self.found is None:
            return f"{what}has no power of {self.base}: unlike quantities are added or compared"
        return f"{what}scales with {self.base}^{self.found:g}"


@dataclass(frozen=True)
class Dimensions:
    """What the check of a component found.

    Attributes:
        component: its name.
        violations: what does not scale as declared.
        unchecked: elements that are, or depend on, real values without a unit.
        unseen: elements that were 0 or not finite at every point, so that nothing can be said of them.
    """

    component: str
    violations: tuple[Violation, ...]
    unchecked: tuple[str, ...]
    unseen: tuple[str, ...]

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
            f"{self.component}: dimensions: {'; '.join(texts[:_TOLD] + more)}. A number with a dimension that stands in an equation is "
            "declared with its unit: parameter(), constant(); the sample time is component.period"
        )


def find_dimensions(declaration: Declaration) -> Dimensions:
    """Scale every base unit, and compare.

    Raises:
        DeclarationError: an expression with an undeclared symbol.
    """
    return _Scaling(declaration).report()


def exponents(name: str) -> Exponents:
    """Base-unit exponents of a unit, without radians."""
    return {b: e for b, e in units.unit(name).exponents.items() if b != "rad" and e}


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
class _Result:
    """One scalar that is compared."""

    name: str
    unit: str
    exponents: Exponents | None


class _Scaling:
    """One declaration with its constants as arguments."""

    def __init__(self, d: Declaration) -> None:
        self.d = d
        self.constants = d.of("constant")
        self.programs = [q.symbol for q in d.programs]
        self.symbols = [
            d.time, *(d.symbol(r) for r in VECTORS), *(v.symbol for v in self.constants), *self.programs
        ]  # fmt: skip
        self.starts = column(d, list(d.starts.values()))
        self.expressions = column(d, [self.starts, *d.changes.values(), *results(d)])
        try:
            self.function = ca.Function("dimensions", self.symbols, [self.expressions])
        except RuntimeError:
            raise DeclarationError(f"{d.name}: an expression uses undeclared symbols") from None

    # ------------------------------------------------------------------ what is compared

    @cached_property
    def results(self) -> list[_Result]:
        """Starts, changes and outputs, one for each row of the function."""
        d = self.d
        found: list[_Result] = []
        per_s: Exponents = {"s": 1} if d.kind == "continuous" else {}
        named = {v.name: v for v in d.all_variables}
        for name in d.starts:
            found += self._of(named[name], "start of {}")
        for name in d.changes:
            found += self._of(named[name], "der({})" if per_s else "{}", per_s)
        for name in d.results:
            found += self._of(named[name], "{}")
        return found

    @staticmethod
    def _of(v: Variable, pattern: str, per: Exponents | None = None) -> list[_Result]:
        declared: list[str]
        if v.unit is not None or not v.rows:
            declared = [v.unit or "no unit"] * v.size
        else:
            declared = [f"{r} per {c}" if v.columns else r for r in v.rows for c in v.columns or ("1",)]
        return [
            _Result(
                pattern.format(n), u + (" per s" if per else ""), None if e is None else _quotient(e, per or {})
            )
            for n, u, e in zip(v.element_names(), declared, element_exponents(v), strict=True)
        ]

    @cached_property
    def checked(self) -> np.ndarray:
        """Rows of the function whose unit is known and that depend on no value of unknown unit."""
        known = np.array([r.exponents is not None for r in self.results], bool)
        unknown = [
            v.symbol
            for v in self.d.all_variables
            if v.role != "output" and None in element_exponents(v)
        ]
        unknown += self.programs
        if unknown and known.any():
            known &= ~np.array(ca.which_depends(self.expressions, ca.vertcat(*unknown), 1, True), bool)
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
        """Random values about ``at`` within the limits; Integers and Booleans anywhere in their range."""
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
        """Arguments of the function: operating points, each with random values about it."""
        d, rng = self.d, np.random.default_rng(13)
        places = {
            role: {n: v.slot + i for v in d.of(role) for i, n in enumerate(v.element_names())}
            for role in ("state", "input")
        }
        rest = [np.reshape(v.start or (), v.symbol.shape) for v in self.constants]
        rest += [np.zeros(s.shape) for s in self.programs]
        found = []
        for values in d.operating_points.values():
            for spread in _SPREADS:
                u, p = d.vector("input"), d.vector("parameter")
                for name, value in values.items():
                    if name in places["input"]:
                        u[places["input"][name]] = value
                u, p = self._near("input", u, rng, spread), self._near("parameter", p, rng, spread)
                x, t = d.vector("state"), rng.uniform(0.0, d.stop_time)
                if d.starts:
                    calculated = iter(np.asarray(self.function(t, x, u, p, *rest)).ravel())
                    for name in d.starts:
                        v = next(v for v in d.of("state") if v.name == name)
                        x[v.slot : v.slot + v.size] = [next(calculated) for _ in range(v.size)]
                for name, value in values.items():
                    if name in places["state"]:
                        x[places["state"][name]] = value
                found.append([np.array(t), self._near("state", x, rng, spread), u, p, *rest])
        return found

    # ------------------------------------------------------------------ comparing

    def _scales(self, base: str, factor: float) -> list[np.ndarray]:
        """What each argument is multiplied with."""
        powers = []
        for role in VECTORS:
            powers.append([e for v in self.d.of(role) for e in element_exponents(v)])
        scales = [np.array(factor if base == "s" else 1.0)]
        scales += [np.array([factor ** (e or {}).get(base, 0) for e in group]) for group in powers]
        for v in self.constants:
            scale = np.array([factor ** (e or {}).get(base, 0) for e in element_exponents(v)])
            rows, columns = v.symbol.shape
            scales.append(scale.reshape(rows, columns))
        return scales + [np.ones(s.shape) for s in self.programs]

    def _used(self) -> list[str]:
        """Base units that a variable of the component has."""
        used = {b for v in self.d.all_variables for e in element_exponents(v) for b in e or {}}
        return [b for b in BASE_UNITS if b in used or (b == "s")]

    def report(self) -> Dimensions:
        """Evaluate at all points in all units."""
        rows = np.flatnonzero(self.checked)
        seen = np.zeros(len(self.results), bool)
        bad: dict[tuple[int, str], list[float | None]] = {}
        for point in self.points if rows.size else ():
            plain = self._evaluate(point)
            informative = np.isfinite(plain) & (plain != 0)
            seen |= informative
            for base in self._used():
                for factor in _FACTORS:
                    scaled = self._evaluate([a * s for a, s in zip(point, self._scales(base, factor), strict=True)])
                    expected = plain * self._expected(base, factor)
                    for i in rows[(expected != scaled)[rows] & np.isfinite(plain)[rows]]:
                        if not self._rounded(int(i), expected[i], scaled[i]):
                            power = _power(scaled[i] / plain[i], factor) if plain[i] else None
                            bad.setdefault((int(i), base), []).append(power)
        violations = []
        for (i, base), powers in sorted(bad.items()):
            r = self.results[i]
            declared = (r.exponents or {}).get(base, 0)
            same = powers[0] if all(p == powers[0] for p in powers) else None
            violations.append(Violation(r.name, r.unit, base, declared, same if same != declared else None))
        names = [r.name for r in self.results]
        return Dimensions(
            self.d.name,
            tuple(violations),
            tuple(n for n, k in zip(names, self.checked, strict=True) if not k),
            tuple(names[i] for i in rows if not seen[i]),
        )

    def _expected(self, base: str, factor: float) -> np.ndarray:
        return np.array([factor ** (r.exponents or {}).get(base, 0) for r in self.results])

    def _evaluate(self, arguments: Sequence[np.ndarray]) -> np.ndarray:
        return np.asarray(self.function(*arguments)).ravel()

    def _rounded(self, i: int, expected: float, scaled: float) -> bool:
        """Whether a difference is rounding, of an operation that is not exact."""
        if not abs(scaled - expected) <= _TOLERANCE * abs(expected):
            return False
        f = ca.Function("row", self.symbols, [self.expressions[i]])
        return any(f.instruction_id(k) in _INEXACT for k in range(f.n_instructions()))


def _power(ratio: float, factor: float) -> float | None:
    """The power of ``factor`` that ``ratio`` is, None when it is none that an expression of units could have."""
    if not (math.isfinite(ratio) and ratio > 0):
        return None
    power = math.log(ratio) / math.log(factor)
    near = round(power * 6) / 6
    return round(near, 4) + 0.0 if abs(power - near) < 1e-9 else None
