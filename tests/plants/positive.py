"""Parameters of a linear ride car with which it must be stable, whatever they are."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from hypothesis import strategies as st

from build_fmus.component import Model


def parameters(wheels: Mapping[str, tuple[float, float]]) -> st.SearchStrategy[dict[str, float]]:
    """Masses, springs and dampers above 0.

    `wheels`: corners, with the limits of their position ahead of the CG [m].
    """
    limits = {"body.mass": (10.0, 1e5), "body.roll_inertia": (1.0, 1e6), "body.pitch_inertia": (1.0, 1e6)}
    for k, along in wheels.items():
        limits |= {
            f"wheel.{k}.mass": (1.0, 5e3),
            f"wheel.{k}.x": along,
            f"wheel.{k}.half_track": (0.2, 3.0),
            f"suspension.{k}.stiffness": (1e3, 1e6),
            f"suspension.{k}.damping": (1e2, 1e5),
            f"tire.{k}.stiffness": (1e4, 1e7),
            f"tire.{k}.damping": (0.0, 1e4),
        }
    return st.fixed_dictionaries({name: st.floats(*ends) for name, ends in limits.items()})


def check_stable(car: Model, values: Mapping[str, float]) -> None:
    """Every mode decays, up to the rounding of the eigenvalues."""
    eigenvalues = np.linalg.eigvals(car.linearize(p=car.vector("parameter", values)).A)
    assert eigenvalues.real.max() < 1e-10 * np.abs(eigenvalues).max()
