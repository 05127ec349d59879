"""Acceleration of gravity, the same for all vehicles."""

from __future__ import annotations

from typing import Any

from build_fmus.component import Component


def gravity(c: Component) -> Any:
    """Declare the constant [m/s2]."""
    return c.constant(
        "gravity", 9.81, "m/s2", "acceleration of gravity", source="as all papers have it, to three digits"
    )
