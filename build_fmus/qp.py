"""Quadratic programs of a component: declaration, back ends, and the constants that go into the FMU.

    minimise 1/2 z'Hz + q'z  subject to  l <= A z <= u

with constant H and A, and with q, l, u computed from time, states, inputs and parameters at each sample. The
declaration is `build_fmus.component.Component.quadratic_program`; this module knows nothing of components. What
depends on H and A alone is computed here, when the FMU is built, and lies in `qp_data.c` as constants.

H may also be H0 + w1 H1 + w2 H2 + ... with weights w that are data of the sample; DAQP then factors it there.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Literal, Protocol

import numpy as np
from scipy.linalg import solve_triangular
from scipy.sparse import csc_array

from build_fmus.base.checks import finite, number

BackendName = Literal["daqp", "osqp"]
INFINITE = 1e30  # bounds of this size and beyond do not bind; QP_INFINITY in qp.h
SOURCES = ("qp.c",)
HEADERS = ("qp.h", "qp_model.h")


class ProgramError(ValueError):
    """A quadratic program that cannot be built; the message says which and why."""


class Backend(Protocol):
    """A solver and its settings."""

    @property
    def name(self) -> BackendName:
        """Name of the solver."""

    @property
    def sources(self) -> tuple[str, ...]:
        """C files and headers of the runtime that this back end adds."""

    @property
    def fallback(self) -> Backend | None:
        """Solver that takes over where this one finds no solution."""

    @property
    def most_iterations(self) -> int:
        """Iterations of a sample at most, with those of the fallback; what bounds its time."""

    @property
    def tolerance(self) -> float:
        """By how much a lower bound may exceed its upper one, relative to max(1, bound)."""

    def memory(self, n: int, m: int) -> int:
        """Numbers of warm start beside the last solution."""

    def constants(self, where: str, hessian: np.ndarray, constraints: np.ndarray, prefix: str) -> tuple[str, str]:
        """C code of the constants of one case, and the name of the object with them."""

    def settings(self, prefix: str) -> str:
        """C code that defines the object `prefix`."""


@dataclass(frozen=True)
class Daqp:
    """Dual active-set solver DAQP: exact up to rounding, fast for few variables, no settings to tune.

    Attributes:
        tolerance: by which a row may be violated, in the units of A z.
        max_iterations: changes of the active set before the solver gives up; choose them such that a sample ends in
            time.
    """

    tolerance: float = 1e-8
    max_iterations: int = 2000

    def __post_init__(self) -> None:
        _positive("Daqp", tolerance=self.tolerance, max_iterations=self.max_iterations)

    name: BackendName = "daqp"
    sources = ("qp_daqp.c", "qp_daqp.h")
    fallback = None

    @property
    def most_iterations(self) -> int:
        """Its own."""
        return self.max_iterations

    def memory(self, n: int, m: int) -> int:  # noqa: ARG002
        """The active rows: how many, and at most n + 1."""
        return n + 2

    def constants(self, where: str, hessian: np.ndarray, constraints: np.ndarray, prefix: str) -> tuple[str, str]:
        """Inverse Cholesky factor of H and the rows of A in its coordinates, with length 1."""
        n = len(hessian)
        upper = np.linalg.cholesky(hessian).T
        inverse = solve_triangular(upper, np.eye(n))
        rows = constraints @ inverse
        length = np.sqrt(np.sum(rows**2, axis=1))
        if not np.all(np.isfinite(rows)):
            raise ProgramError(f"{where}: the Hessian is singular to working precision")
        scaling = np.divide(1.0, length, out=np.ones_like(length), where=length > 0)
        code = _array(f"{prefix}_rinv", inverse[np.triu_indices(n)])
        code += _array(f"{prefix}_rows", rows * scaling[:, None]) + _array(f"{prefix}_scaling", scaling)
        ill = int(np.linalg.cond(hessian) > 1e6)
        parts = f"{prefix}_rinv, {prefix}_rows, {prefix}_scaling, {ill}"
        return f"{code}static const QpDaqpFactors {prefix} = {{{parts}}};\n", prefix

    def settings(self, prefix: str) -> str:
        """Tolerance and limit."""
        return f"static const QpDaqpSettings {prefix} = {{{self.tolerance!r}, {self.max_iterations}}};\n"


@dataclass(frozen=True)
class Osqp:
    """Operator-splitting solver OSQP with a fixed step size.

    Its accuracy and speed depend on `rho` and on the scaling.

    Attributes:
        rho: step size, in the scaled problem.
        eps: primal, dual and gap tolerance, absolute and relative, in the scaled problem.
        max_iterations: before the solver gives up; choose them such that a sample ends in time.
        scaling: units of the variables, `"diagonal"`: such that H has ones on its diagonal; `"hessian"`:
            coordinates in which H is the identity; `"none"`.
        unit_rows: scale the rows of A to length 1.
        check_interval: iterations between checks for the end.
        infeasible: tolerance of the certificate that there is no feasible point; with bad scaling OSQP also finds one
            of feasible programs.
        fallback: starts from the rows that OSQP found active, and makes the solution exact; at the limit of
            iterations, and where OSQP finds the program infeasible, it starts from scratch, and its solution is OSQP's
            next start. Where it reaches its own limit from these rows, OSQP's solution stays.
    """

    rho: float = 0.1
    eps: float = 1e-7
    max_iterations: int = 4000
    scaling: Literal["none", "diagonal", "hessian"] = "diagonal"
    unit_rows: bool = True
    check_interval: int = 10
    infeasible: float = 1e-5
    sigma: float = 1e-6
    alpha: float = 1.6
    fallback: Daqp | None = None

    def __post_init__(self) -> None:
        _positive(
            "Osqp",
            rho=self.rho,
            eps=self.eps,
            max_iterations=self.max_iterations,
            infeasible=self.infeasible,
            check_interval=self.check_interval,
            sigma=self.sigma,
            alpha=self.alpha,
        )
        if self.scaling not in ("none", "diagonal", "hessian") or self.alpha >= 2:
            raise ProgramError(
                f"Osqp: give scaling 'none', 'diagonal' or 'hessian' and alpha below 2, not {self.scaling!r} and"
                f" {self.alpha:g}"
            )

    name: BackendName = "osqp"
    sources = ("qp_osqp.c", "qp_osqp.h")

    @property
    def most_iterations(self) -> int:
        """Its own and those of the fallback."""
        return self.max_iterations + (self.fallback.most_iterations if self.fallback else 0)

    @property
    def tolerance(self) -> float:
        """As for any other row."""
        return self.eps

    def memory(self, n: int, m: int) -> int:
        """Last iterate and its multipliers."""
        return n + m

    def constants(self, where: str, hessian: np.ndarray, constraints: np.ndarray, prefix: str) -> tuple[str, str]:
        """The scaled problem and the factors of its linear system."""
        n = len(hessian)
        if self.scaling == "hessian":
            turn = solve_triangular(np.linalg.cholesky(hessian).T, np.eye(n))
        else:
            turn = np.diag(1 / np.sqrt(np.diag(hessian))) if self.scaling == "diagonal" else np.eye(n)
        H, A = turn.T @ hessian @ turn, constraints @ turn
        length = np.sqrt(np.sum(A**2, axis=1))
        scale = (
            np.divide(1.0, length, out=np.ones_like(length), where=length > 0) if self.unit_rows else np.ones(len(A))
        )
        A = A * scale[:, None]
        lower = np.linalg.cholesky(H + self.sigma * np.eye(n) + self.rho * A.T @ A)
        diagonal = np.diag(lower)
        if not all(np.all(np.isfinite(x)) for x in (turn, A, lower)):
            raise ProgramError(f"{where}: the Hessian is singular to working precision")
        p, a = csc_array(np.triu(H)), csc_array(A)
        parts: list[str] = []
        code = ""
        for part, values in (
            ("transform", turn),
            ("inverse", np.linalg.inv(turn)),
            ("row_scale", scale),
            ("p_columns", p.indptr),
            ("p_rows", p.indices),
            ("p_values", p.data),
            ("a_columns", a.indptr),
            ("a_rows", a.indices),
            ("a_values", a.data),
            ("lower", (lower / diagonal)[np.tril_indices(n, -1)]),
            ("inverse_diagonal", 1 / diagonal**2),
        ):
            code += _array(f"{prefix}_{part}", values)
            parts.append(f"{prefix}_{part}")
        return f"{code}static const QpOsqpFactors {prefix} = {{\n    {', '.join(parts)}}};\n", prefix

    def settings(self, prefix: str) -> str:
        """Step size, tolerances and limits."""
        values = (self.rho, self.sigma, self.alpha, self.eps, self.infeasible, self.max_iterations, self.check_interval)
        return f"static const QpOsqpSettings {prefix} = {{{', '.join(map(repr, values))}}};\n"


def _positive(what: str, **values: float) -> None:
    for name, value in values.items():
        number(f"{what}: {name}", value, above=0, error=ProgramError)


BACKENDS: dict[str, Any] = {"daqp": Daqp, "osqp": Osqp}


@dataclass(frozen=True)
class Solution:
    """Symbols for the outcome of a quadratic program, to be used in outputs and updates.

    Attributes:
        z: solution (n,); after a failure the last one (zeros at first), so always finite.
        multipliers: (m,), positive at the upper bound, negative at the lower one: H z + q + A' multipliers = 0.
        status: 0 solved, 1 limit reached, 2 infeasible, 3 bad data.
        iterations: of the solver and of its fallback.
        residual: largest of primal, dual and complementarity residual, each divided by max(1, largest magnitude of its
            terms); 1e30 with bad data.
    """

    z: Any
    multipliers: Any
    status: Any
    iterations: Any
    residual: Any


@dataclass(frozen=True, eq=False)
class QuadraticProgram:
    """A declared program.

    Attributes:
        name: of the component and of the program, for messages.
        hessians, constraints: one per case.
        terms: (k, n, n), what is added to H, each matrix times its weight.
        backends: the first one is used; the others are settings for when the build chooses another solver.
        data: CasADi column q, l, u, case, weights.
        symbol: CasADi column z, multipliers, status, iterations, residual.
    """

    name: str
    hessians: tuple[np.ndarray, ...]
    constraints: tuple[np.ndarray, ...]
    terms: np.ndarray
    backends: tuple[Backend, ...]
    data: Any
    symbol: Any

    @property
    def backend(self) -> Backend:
        """The solver in use."""
        return self.backends[0]

    @property
    def solvers(self) -> tuple[Backend, ...]:
        """The solver in use and its fallback."""
        return (self.backend, *((self.backend.fallback,) if self.backend.fallback else ()))

    @property
    def n(self) -> int:
        """Number of variables."""
        return len(self.hessians[0])

    @property
    def m(self) -> int:
        """Number of rows."""
        return len(self.constraints[0])

    @property
    def n_memory(self) -> int:
        """Numbers kept from sample to sample: the last solution and the solver's warm start."""
        return self.n + self.backend.memory(self.n, self.m)

    @property
    def n_data(self) -> int:
        """Length of `data`."""
        return self.n + 2 * self.m + 1 + len(self.terms)

    @property
    def n_solution(self) -> int:
        """Length of `symbol`."""
        return self.n + self.m + 3

    @property
    def solution(self) -> Solution:
        """`symbol` by names."""
        n, m, s = self.n, self.m, self.symbol
        return Solution(s[:n], s[n : n + m], s[n + m], s[n + m + 1], s[n + m + 2])


def checked_matrices(
    where: str, hessians: Sequence[Any], constraints: Sequence[Any], *, what: str = "Hessian"
) -> tuple[tuple[np.ndarray, ...], tuple[np.ndarray, ...]]:
    """Hessians and constraint matrices of all cases as finite arrays of matching shapes.

    `what`: other matrices than Hessians are called so, and need not be definite.

    Raises:
        ProgramError: shapes that do not match, values that are not finite, a Hessian that is not symmetric positive
            definite.
    """
    if isinstance(hessians, np.ndarray) and hessians.ndim == 2:
        hessians = [hessians]
    if isinstance(constraints, np.ndarray) and constraints.ndim == 2:
        constraints = [constraints]
    H = [np.atleast_2d(np.array(h, dtype=float)) for h in hessians]
    A = [np.atleast_2d(np.array(a, dtype=float)) for a in constraints]
    if not H:
        raise ProgramError(f"{where}: give at least one Hessian")
    if len(A) not in (1, len(H)):
        raise ProgramError(
            f"{where}: {len(A)} constraint matrices for {len(H)} cases; give one for all or one per case"
        )
    n, m = H[0].shape[0], A[0].shape[0] if A[0].ndim == 2 else 0
    for k, h in enumerate(H):
        if h.shape != (n, n):
            raise ProgramError(f"{where}: {what} {k} has shape {h.shape}, not {(n, n)}")
        finite(f"{where}: {what} {k} at ", h, error=ProgramError)
        if np.max(np.abs(h - h.T)) > 1e-9 * np.max(np.abs(h)):
            raise ProgramError(f"{where}: {what} {k} is not symmetric")
        H[k] = 0.5 * (h + h.T)
        if what != "Hessian":
            continue
        try:
            np.linalg.cholesky(H[k])
        except np.linalg.LinAlgError:
            smallest = np.linalg.eigvalsh(H[k])[0]
            raise ProgramError(
                f"{where}: Hessian {k} is not positive definite (smallest eigenvalue {smallest:.3g}); weight every "
                "variable"
            ) from None
    for k, a in enumerate(A):
        if a.shape != (m, n) or m == 0:
            raise ProgramError(f"{where}: constraint matrix {k} has shape {a.shape}, not (m, {n}) with the same m >= 1")
        finite(f"{where}: constraint matrix {k} at ", a, error=ProgramError)
    return tuple(H), tuple(A * len(H) if len(A) == 1 else A)


def _array(name: str, values: np.ndarray) -> str:
    values = np.asarray(values)
    kind = "int" if values.dtype.kind == "i" else "double"
    numbers = [repr(x) for x in values.ravel().tolist()]
    lines = [", ".join(numbers[i : i + 6]) for i in range(0, len(numbers), 6)]
    return f"static const {kind} {name}[] = {{\n    " + ",\n    ".join(lines or ["0"]) + "\n};\n"


def generate_data(programs: Sequence[QuadraticProgram]) -> str:
    """`qp_data.c`: the constants of all programs of a component."""
    names = list(dict.fromkeys(b.name for p in programs for b in p.solvers))
    code = ["/* Constants of the quadratic programs: generated, do not edit. */", "#include <stddef.h>"]
    code += [f'#include "qp_{b}.h"' for b in names] + ['#include "qp_model.h"', ""]
    rows = []
    for i, p in enumerate(programs):
        matrices, written = [], dict[bytes | int, str]()
        for k, (h, a) in enumerate(zip(p.hessians, p.constraints, strict=True)):
            for key, name, values in ((id(a), f"qp{i}_constraints{k}", a), (h.tobytes(), f"qp{i}_hessian{k}", h)):
                if key not in written:
                    written[key] = name
                    code.append(_array(name, values))
            matrices.append((written[h.tobytes()], written[id(a)]))
        fallback, terms = "NULL", "NULL"
        if len(p.terms):
            terms = f"qp{i}_terms"
            code.append(_array(terms, p.terms))
        for b in reversed(p.solvers):
            row = _solver_data(p, b, matrices, terms, f"qp{i}_{b.name}", fallback, code)
            if b is p.backend:
                rows.append(row)
            else:
                fallback = f"&qp{i}_fallback"
                code.append(f"static const Qp {fallback[1:]} = {row};\n")
    code.append(f"const int qp_count = {len(programs)};")
    code.append("const Qp qp_list[] = {\n    " + ",\n    ".join(rows) + "\n};\n")
    return "\n".join(code)


def _solver_data(
    p: QuadraticProgram,
    backend: Backend,
    matrices: Sequence[tuple[str, str]],
    terms: str,
    prefix: str,
    fallback: str,
    code: list[str],
) -> str:
    """Append the constants of one solver for one program; returns the initializer of its `Qp`."""
    cases = []
    same = dict[tuple[str, str], str]()  # cases that differ in q, l, u alone share their constants
    for k, (h, a) in enumerate(zip(p.hessians, p.constraints, strict=True)):
        if len(p.terms):
            same[matrices[k]] = f"{{{', '.join(matrices[k])}, NULL}}"
        elif matrices[k] not in same:
            text, factors = backend.constants(f"{p.name}, case {k}", h, a, f"{prefix}_factors{k}")
            code.append(text)
            same[matrices[k]] = f"{{{', '.join(matrices[k])}, &{factors}}}"
        cases.append(same[matrices[k]])
    code.append(f"static const QpCase {prefix}_cases[] = {{{', '.join(cases)}}};\n")
    code.append(backend.settings(f"{prefix}_settings"))
    return (
        f"{{{p.n}, {p.m}, {len(p.hessians)}, {backend.memory(p.n, p.m)}, {backend.tolerance!r}, {prefix}_cases, "
        f"&qp_{backend.name}, &{prefix}_settings, {fallback}, {len(p.terms)}, {terms}}}"
    )
