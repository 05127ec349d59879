"""Corners of vehicles: their names, their axles, and the order that all vectors over wheels have."""

from __future__ import annotations

TWO_AXLES = {f"{axle[0]}{side}": axle for axle in ("front", "rear") for side in "lr"}
"""Corner -> axle: ``fl fr rl rr`` -> ``front`` or ``rear``."""
THREE_AXLES = {f"{axle}{side}": axle for axle in ("a1", "a2", "a3") for side in "lr"}
"""Corner -> axle: ``a1l a1r a2l a2r a3l a3r`` -> ``a1`` (the front), ``a2`` or ``a3``."""

CORNERS = tuple(TWO_AXLES)
SIX_CORNERS = tuple(THREE_AXLES)
