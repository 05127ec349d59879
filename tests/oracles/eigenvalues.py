"""Eigenvalues of components at their operating points."""

from __future__ import annotations

import numpy as np

from build_fmus.component import Model
from build_fmus.stability import matrices_by_point


def eigenvalues_by_point(component: Model) -> dict[str, np.ndarray]:
    """Eigenvalues [1/s] of the linearized component at each declared operating point."""
    return {n: np.linalg.eigvals(a) if a.size else np.zeros(0) for n, a in matrices_by_point(component).items()}
