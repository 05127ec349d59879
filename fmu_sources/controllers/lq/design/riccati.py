"""Newton steps on a Riccati equation."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from scipy import linalg

from fmu_sources.controllers.design_checks import Array
from fmu_sources.controllers.lq.design.matrices import even

RESIDUAL_LIMIT = 1e-8  # of a Riccati equation, relative to |P|


def refined(P: Array, newton: Callable[[Array], Array], residual: Callable[[Array], Array]) -> tuple[Array, float]:
    """P after the Newton steps that help, and the residual relative to |P|."""

    def relative(value: Array) -> float:
        size = float(linalg.norm(value))
        return float(linalg.norm(residual(value))) / size if size > 0.0 else float(linalg.norm(residual(value)))

    best = even(P)
    error = relative(best)
    for _ in range(3):
        candidate = even(newton(best))
        if not np.all(np.isfinite(candidate)) or not relative(candidate) < error:
            break
        best, error = candidate, relative(candidate)
    return best, error
