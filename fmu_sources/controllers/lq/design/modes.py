"""Whether an optimal control law exists: modes that no control reaches, or that the index does not see."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy import linalg

from fmu_sources.controllers.design_checks import Array
from fmu_sources.controllers.lq.design.plant import LinearPlant, LqError, QuadraticIndex

MODE_TOLERANCE = 1e-9  # of the modal tests, relative to the size of the balanced matrix


def check_modes(plant: LinearPlant, index: QuadraticIndex) -> None:
    """Check the conditions of Theorem 1, (14): (A, B) stabilizable and (A_n, T) detectable, with Q_n = T' T."""
    mode = hidden_mode(plant.A, plant.B)
    if mode is not None:
        eigenvalue, shape = mode
        states = dominant(shape, plant.states)
        raise LqError(
            f"not stabilizable: the plant's mode at {rate(eigenvalue)}, mostly {', '.join(states)}, does not decay and"
            f" no control ({', '.join(plant.controls)}) acts on it; damp it in the plant or give an actuator an arm"
            " on it",
            eigenvalue,
            states,
        )
    # For Q_n >= 0, T v = 0 is the same as Q_n v = 0, and Q_n needs no square root, which would halve the digits.
    # Its rows may be scaled at will; a row that is only the rounding of the terms that canceled in it is 0.
    R_inverse_N = linalg.solve(index.R, index.N.T, assume_a="pos")
    reduced = index.N @ R_inverse_N
    A_n, Q_n = plant.A - plant.B @ R_inverse_N, index.Q1 - reduced
    terms = linalg.norm(index.Q1, axis=1) + linalg.norm(reduced, axis=1)
    rows = linalg.norm(Q_n, axis=1)
    seen = Q_n[rows > 1e-12 * terms]
    mode = hidden_mode(A_n.T, seen.T, dual=True)
    if mode is not None:
        eigenvalue, shape = mode
        states = dominant(shape, plant.states)
        raise LqError(
            f"not detectable: the mode at {rate(eigenvalue)}, mostly {', '.join(states)}, does not decay by itself and "
            "the index does not see it; give a weight above 0 to an output that contains it",
            eigenvalue,
            states,
        )


def hidden_mode(A: Array, B: Array, *, dual: bool = False, discrete: bool = False) -> tuple[complex, Array] | None:
    """The slowest mode that neither decays nor is reached by B (Popov-Belevitch-Hautus), and each state's part in it.

    Where several modes share an eigenvalue, the parts are those of their whole subspace: they do not depend on the
    order or the basis in which eigenvectors are computed. With `dual`, A and B are the transposes of a system matrix
    and of an output matrix.
    """
    balanced, (scale, _) = linalg.matrix_balance(A, permute=False, separate=True)
    size = linalg.norm(balanced, 2) or 1.0
    columns = B / scale[:, None]
    length = linalg.norm(columns, axis=0)
    columns = columns * (size / np.where(length > 0.0, length, 1.0))
    for eigenvalue in sorted(linalg.eigvals(balanced), key=lambda v: round(abs(v) / size, 9)):
        decay = 1.0 - abs(eigenvalue) if discrete else -eigenvalue.real / size
        if decay > MODE_TOLERANCE or eigenvalue.imag < 0.0:
            continue
        shifted = balanced - eigenvalue * np.eye(len(A))
        left, singular, _ = linalg.svd(np.hstack([shifted, columns]), full_matrices=False)
        unreached = left[:, singular <= MODE_TOLERANCE * size]
        if not unreached.shape[1]:
            continue
        if dual:
            return complex(eigenvalue), linalg.norm(unreached, axis=1)
        # The motions themselves: of all right eigenvectors, those that the unreached directions belong to.
        _, singular, right = linalg.svd(shifted)
        space = right[singular <= max(1e-7 * size, singular[-1])].conj().T
        motion = linalg.norm(space @ (space.conj().T @ unreached), axis=1)
        return complex(eigenvalue), motion if linalg.norm(motion) > 1e-6 else linalg.norm(space, axis=1)
    return None


def dominant(shape: Array, names: Sequence[str]) -> tuple[str, ...]:
    """The states that make up the mode, largest first, at most four."""
    order = np.argsort(-np.round(shape / np.max(shape), 6), kind="stable")
    return tuple(names[k] for k in order[:4] if shape[k] >= 0.3 * np.max(shape))


def rate(eigenvalue: complex, unit: str = "1/s") -> str:
    """Text of an eigenvalue for messages; with unit 1/s also its frequency [Hz]."""
    real, imaginary = float(np.real(eigenvalue)), abs(float(np.imag(eigenvalue)))
    real = 0.0 if abs(real) < 1e-9 * max(1.0, imaginary) else real
    if imaginary <= 1e-9 * max(1.0, abs(real)):
        return f"{real:.4g} {unit}"
    hertz = f" ({imaginary / (2 * np.pi):.3g} Hz)" if unit == "1/s" else ""
    return f"{real:.4g} +- {imaginary:.4g}i {unit}{hertz}"
