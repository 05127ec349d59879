"""Quadratic programs solved in Python, by the very C code of the FMU."""

from __future__ import annotations

import ctypes
from functools import lru_cache
from pathlib import Path

import numpy as np

from build_fmus import generate
from build_fmus.base import safe_files
from build_fmus.compile import ObjectCache, find_toolchain, host
from build_fmus.component import Model

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
        scratch_size: bytes that a solve works in.
    """

    def __init__(self, component: Model) -> None:
        self._library = _library(component)
        self.memory = np.zeros(sum(q.n_memory for q in component.programs))
        self._n_data = sum(q.n_data for q in component.programs)
        self._n_solution = sum(q.n_solution for q in component.programs)
        self.scratch_size: int = self._library.scratch_size()
        self._scratch = np.zeros(self.scratch_size // 16 + 1, dtype=np.complex128)  # 16-byte aligned
        self._library.setup(self._scratch.ctypes.data)

    def solve(self, data: np.ndarray, *, commit: bool = True) -> np.ndarray:
        """Solve the programs for `data` (q, l, u, case, weights of each).

        Returns (z, multipliers, status, iterations, residual) of each. `commit=False` leaves the warm starts as they
        are.
        """
        data = np.ascontiguousarray(data, dtype=float)
        if data.shape != (self._n_data,):
            raise ValueError(f"data of shape {data.shape}, not ({self._n_data},)")
        memory = self.memory if commit else self.memory.copy()
        solution = np.zeros(self._n_solution)
        self._library.solve(self._scratch.ctypes.data, memory.ctypes.data, data.ctypes.data, solution.ctypes.data)
        return solution


@lru_cache(maxsize=8)
def _library(component: Model) -> ctypes.CDLL:
    """Generated once for the instances of a component, of which nothing changes: the constants are long."""
    files = generate.solver_files(component) | {"qp_exports.c": _EXPORTS.encode()}
    files["fmu_model.h"] = (generate.RUNTIME_DIR / "fmu_model.h").read_bytes()
    files = generate.with_mathematics(files)
    with safe_files.scratch_files(files) as folder:
        sources = [folder / n for n in files if n.endswith(".c")]
        return _load(ObjectCache.of_user().library(find_toolchain(host()), sources, [folder], "solver"))


@lru_cache
def _load(path: Path) -> ctypes.CDLL:
    library = ctypes.CDLL(str(path))
    library.scratch_size.restype = ctypes.c_size_t
    library.setup.argtypes, library.setup.restype = [ctypes.c_void_p], None
    library.solve.argtypes, library.solve.restype = [ctypes.c_void_p] * 4, None
    return library
