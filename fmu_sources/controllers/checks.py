"""Checks that the design modules share; each message names the argument."""

from __future__ import annotations

import numpy as np


def whole_number(name: str, value: int) -> int:
    """``value`` as an int of at least 1; ValueError otherwise."""
    if isinstance(value, bool) or not isinstance(value, int | np.integer):
        raise ValueError(f"{name} is {value!r}; expected a whole number")
    if value < 1:
        raise ValueError(f"{name} = {value}; expected at least 1")
    return int(value)
