"""How an algebraic loop is solved, written to be read: what `algebraic_loop.c` must compute, bit for bit.

The unknowns z are the outputs at which the loop is cut; its components, computed in their order from z, give G(z). The
residual G(z) - z vanishes in the solution.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

Vector = list[float]
Residual = Callable[[Sequence[float]], Vector]


def solve(
    residual_of: Residual,
    guess: Sequence[float],
    nominal: Sequence[float],
    tolerance: float,
    along: Callable[[Sequence[float], float], Vector] | None = None,
) -> Vector:
    """Newton's method from a guess; raises ArithmeticError where it finds no solution.

    `along`: the residual at a point that differs from the one evaluated last by `change`, by directional derivatives of
    the components that offer them.
    """
    n = len(guess)

    def size(z: Sequence[float], k: int) -> float:
        return max(abs(z[k]), nominal[k])

    def largest(z: Sequence[float], residual: Sequence[float]) -> float:
        found = [abs(residual[k]) / size(z, k) for k in range(n)]
        return max(found) if all(map(math.isfinite, found)) else math.inf

    def differences(z: Sequence[float], residual: Sequence[float], *, derivatives: bool) -> list[Vector]:
        columns = []
        for k in range(n):
            other = [*z]
            other[k] = z[k] + 2.0**-20 * size(z, k)
            there = along(other, other[k] - z[k]) if along and derivatives else residual_of(other)
            columns.append([(there[i] - residual[i]) / (other[k] - z[k]) for i in range(n)])
        return [list(row) for row in zip(*columns, strict=True)]

    def newton_step(z: Sequence[float], jacobian: Sequence[Vector], residual: Sequence[float]) -> Vector | None:
        matrix = [[jacobian[i][k] * size(z, k) / size(z, i) for k in range(n)] for i in range(n)]
        step = [-residual[i] / size(z, i) for i in range(n)]
        for k in range(n):
            pivot = max(range(k, n), key=lambda i: abs(matrix[i][k]))
            if not abs(matrix[pivot][k]) > 2.0**-52:
                return None
            matrix[k], matrix[pivot], step[k], step[pivot] = matrix[pivot], matrix[k], step[pivot], step[k]
            for i in range(k + 1, n):
                factor = matrix[i][k] / matrix[k][k]
                for j in range(k + 1, n):
                    matrix[i][j] -= factor * matrix[k][j]
                step[i] -= factor * step[k]
        for i in reversed(range(n)):
            for j in range(i + 1, n):
                step[i] -= matrix[i][j] * step[j]
            step[i] /= matrix[i][i]
        return [step[k] * size(z, k) for k in range(n)]

    z = [*guess]
    residual = residual_of(z)
    outdated, jacobian = True, [[0.0] * n] * n
    for i in range(50):
        present = largest(z, residual)
        if present <= tolerance:
            return z
        if math.isinf(present):
            break
        derivatives = i == 0 and along is not None
        fresh = outdated and not derivatives
        if outdated:
            jacobian = differences(z, residual, derivatives=derivatives)
        step, reached = newton_step(z, jacobian, residual), math.inf
        other, there = z, residual
        for halving in range(13 if fresh else 1):
            if step is None:
                break
            factor = 0.5**halving
            other = [z[k] + factor * step[k] for k in range(n)]
            there = residual_of(other)
            reached = largest(other, there)
            if reached < present * (1.0 - 1e-4 * factor):
                break
            reached = math.inf
        outdated = reached > 0.1 * present
        if math.isinf(reached):
            if fresh:
                break
            continue
        moved = [(other[k] - z[k]) / size(z, k) for k in range(n)]
        length = sum(d * d for d in moved)
        for j in range(n):
            error = there[j] - residual[j]
            for k in range(n):
                error -= jacobian[j][k] * (other[k] - z[k])
            for k in range(n):
                jacobian[j][k] += error * ((other[k] - z[k]) / (size(z, k) * size(z, k))) / length
        z, residual = other, there
    raise ArithmeticError(f"no solution: {z} with residuals {residual}")
