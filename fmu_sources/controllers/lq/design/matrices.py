"""Matrices as the designs take and make them: checks that name the argument, symmetry, order of eigenvalues."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt
from scipy import linalg

from build_fmus.base.checks import finite, number
from fmu_sources.controllers.design_checks import Array


def by_decay(eigenvalues: npt.NDArray[np.complex128]) -> npt.NDArray[np.complex128]:
    """Fastest decay first, conjugate pairs together with the positive imaginary part first."""
    return eigenvalues[np.lexsort((-eigenvalues.imag, -np.abs(eigenvalues.imag).round(9), eigenvalues.real.round(9)))]


def even(value: Array) -> Array:
    """The symmetric part of a matrix."""
    return np.asarray((value + value.T) / 2)


def scaled_lowest(value: Array) -> float:
    """Smallest eigenvalue of a symmetric matrix scaled to a unit diagonal, so that units do not matter."""
    diagonal = np.abs(np.diag(value))
    scale = np.sqrt(np.where(diagonal > 0.0, diagonal, 1.0))
    return float(linalg.eigvalsh(value / np.outer(scale, scale))[0]) if len(value) else 0.0


def positive_definite(name: str, value: Array) -> None:
    """Refuse a symmetric matrix that is singular or not positive definite (ValueError)."""
    diagonal = np.diag(value)
    if np.any(diagonal <= 0.0):
        k = int(np.argmin(diagonal))
        raise ValueError(f"{name} is not positive definite: [{k}, {k}] is {diagonal[k]:g}")
    lowest = scaled_lowest(value)
    if lowest <= len(value) * float(np.finfo(float).eps):
        raise ValueError(
            f"{name} is singular or not positive definite: scaled to a unit diagonal, its smallest eigenvalue is "
            f"{lowest:.3g}; give every control a weight above 0"
        )


def symmetric(name: str, value: Array) -> Array:
    """A read-only copy that is exactly symmetric; ValueError where `value` is not symmetric to 1e-12."""
    skew = np.abs(value - value.T)
    if value.size and np.max(skew) > 1e-12 * np.max(np.abs(value)):
        i, j = (int(k) for k in np.unravel_index(np.argmax(skew), skew.shape))
        raise ValueError(f"{name} is not symmetric: [{i}, {j}] is {value[i, j]:g}, [{j}, {i}] is {value[j, i]:g}")
    result = even(value)
    result.setflags(write=False)
    return result


def matrix(name: str, value: npt.ArrayLike, shape: tuple[int | None, int | None], meaning: str) -> Array:
    """A read-only copy of `value`; ValueError for another shape (None: any size) or a value that is not finite."""
    array = np.array(value, dtype=float)  # a copy, made read-only: a plant or control law never changes once it exists
    array.setflags(write=False)
    if array.ndim != 2 or any(size not in (None, have) for size, have in zip(shape, array.shape, strict=True)):
        expected = ", ".join("any" if size is None else str(size) for size in shape)
        raise ValueError(f"{name} has shape {array.shape}; expected ({expected}){f', {meaning}' if meaning else ''}")
    finite(name, array)
    return array


def weights(name: str, value: npt.ArrayLike, names: Sequence[str], kind: str) -> Array:
    """Weights (n,), one for each of `names`; ValueError for another number, or a weight that is no finite number."""
    array = np.array(value, dtype=float)
    if array.shape != (len(names),):
        given = f"{array.size} weights" if array.ndim == 1 else f"shape {array.shape}"
        raise ValueError(f"{name} has {given}; expected one for each {kind}: {', '.join(names)} ({len(names)})")
    for entry, weight in zip(names, array, strict=True):
        number(f"the weight of {kind} {entry}", weight)
    return array
