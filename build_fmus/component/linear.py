"""The linear model of a component about an operating point."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class Linearization:
    """``dx/dt = A x + B u``, ``y = C x + D u`` about an operating point, with the names of rows and columns."""

    A: np.ndarray
    B: np.ndarray
    C: np.ndarray
    D: np.ndarray
    states: list[str]
    inputs: list[str]
    outputs: list[str]
