"""Quadratic programs solved in Python: by the very C code of the FMU, and by an independent solver."""

from __future__ import annotations

import ctypes
import tempfile
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

import numpy as np

from build_fmus import generate, safe_files
from build_fmus.compile import ObjectCache, find_toolchain, host
from build_fmus.component import Model
from build_fmus.qp import INFINITE
from build_fmus.qp_sources import cache_directory

_EXPORTS = """/* What Python calls. */
#include "fmu_model.h"

#if defined(_WIN32)
#define EXPORT __declspec(dllexport)
#else
#define EXPORT __attribute__((visibility("default")))
#endif

EXPORT size_t scratch_size(void) { return fmu_qp_functions.scratch_size(); }
EXPORT void setup(void *scratch) { fmu_qp_functions.setup(scratch); }
EXPORT void solve(void *scratch, double *memory, const double *data, double *solution) {
    fmu_qp_functions.solve(scratch, memory, data, solution);
}
"""


class CompiledPrograms:
    """The quadratic programs of one instance of a component, with the C code and the constants of its FMU.

    Attributes:
        memory: last solutions and warm starts; zeros at first.
    """

    def __init__(self, component: Model) -> None:
        self._library = _library(component)
        self.memory = np.zeros(sum(q.n_memory for q in component.programs))
        self._n_data = sum(q.n_data for q in component.programs)
        self._n_solution = sum(q.n_solution for q in component.programs)
        self._scratch = np.zeros(self._library.scratch_size() // 16 + 1, dtype=np.complex128)  # 16-byte aligned
        self._library.setup(self._scratch.ctypes.data)

    def solve(self, data: np.ndarray, *, commit: bool = True) -> np.ndarray:
        """Solutions (z, multipliers, status, iterations, residual of each program) for ``data`` (q, l, u, case of each).

        ``commit=False`` leaves the warm starts as they are.
        """
        data = np.ascontiguousarray(data, dtype=float)
        if data.shape != (self._n_data,):
            raise ValueError(f"data of shape {data.shape}, not ({self._n_data},)")
        memory = self.memory if commit else self.memory.copy()
        solution = np.zeros(self._n_solution)
        self._library.solve(self._scratch.ctypes.data, memory.ctypes.data, data.ctypes.data, solution.ctypes.data)
        return solution


def _library(component: Model) -> ctypes.CDLL:
    files = generate.solver_files(component) | {"qp_exports.c": _EXPORTS.encode()}
    files["fmu_model.h"] = (generate.RUNTIME_DIR / "fmu_model.h").read_bytes()
    files = generate.with_mathematics(files)
    with tempfile.TemporaryDirectory() as tmp, safe_files.named(tmp):
        for name, data in files.items():
            (Path(tmp) / name).parent.mkdir(exist_ok=True)
            (Path(tmp) / name).write_bytes(data)
        sources = [Path(tmp) / n for n in files if n.endswith(".c")]
        cache = ObjectCache(cache_directory() / "solvers")
        return _load(cache.library(find_toolchain(host()), sources, [Path(tmp)], "solver"))


@lru_cache
def _load(path: Path) -> ctypes.CDLL:
    library = ctypes.CDLL(str(path))
    library.scratch_size.restype = ctypes.c_size_t
    library.setup.argtypes, library.setup.restype = [ctypes.c_void_p], None
    library.solve.argtypes, library.solve.restype = [ctypes.c_void_p] * 4, None
    return library


@dataclass(frozen=True)
class ReferenceSolution:
    """Solution z (n,) with multipliers (m,), positive at upper bounds, and status 0 (solved) or 2 (infeasible)."""

    z: np.ndarray
    multipliers: np.ndarray
    status: int


def solve_reference(
    hessian: np.ndarray, linear: np.ndarray, constraints: np.ndarray, lower: np.ndarray, upper: np.ndarray
) -> ReferenceSolution:
    """Solve ``minimise 1/2 z'Hz + q'z subject to l <= A z <= u`` with quadprog (Goldfarb and Idnani), for comparison.

    Shapes: (n, n), (n,), (m, n), (m,), (m,). Needs the package ``quadprog`` (extra ``test``).
    """
    import quadprog

    H, q, A = (np.asarray(a, dtype=float) for a in (hessian, linear, constraints))
    m = len(A)
    lo, up = np.broadcast_to(np.asarray(lower, float), m), np.broadcast_to(np.asarray(upper, float), m)
    length = np.linalg.norm(A, axis=1)
    empty = length == 0
    multipliers = np.zeros(m)
    nothing = ReferenceSolution(np.zeros(len(q)), multipliers, 2)
    if np.any(lo[empty] > 0) or np.any(up[empty] < 0) or np.any(lo > up):
        return nothing
    equal = np.flatnonzero((lo == up) & ~empty)
    below = np.flatnonzero((lo > -INFINITE) & (lo < up) & ~empty)
    above = np.flatnonzero((up < INFINITE) & (lo < up) & ~empty)
    rows = np.concatenate([equal, below, above])
    sign = np.concatenate([np.ones(len(equal) + len(below)), -np.ones(len(above))])
    bounds = np.where(sign > 0, lo[rows], up[rows])
    scale = sign / length[rows]
    if not len(rows):
        return ReferenceSolution(-np.linalg.solve(H, q), multipliers, 0)
    # Units of the variables in which H has ones on its diagonal
    unit = 1 / np.sqrt(np.diag(H))
    try:
        z, _, _, _, active, _ = quadprog.solve_qp(
            H * unit * unit[:, None], -q * unit, (A[rows] * scale[:, None] * unit).T, bounds * scale, len(equal)
        )
    except ValueError as error:
        if "inconsistent" not in str(error):
            raise
        return nothing
    np.add.at(multipliers, rows, -active * scale)
    return ReferenceSolution(z * unit, multipliers, 0)
