"""What a road shows, asked of its declaration."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np
import pytest

from build_fmus.component import Component, Model


def look(road: Component | Model, x: Any, speed: float = 0.0, **parameters: Any) -> dict[str, Any]:
    """Outputs by name, at one position or as columns over many; parameters by name, with `__` for the dot."""
    model = road.model() if isinstance(road, Component) else road
    p = model.vector("parameter", {name.replace("__", "."): value for name, value in parameters.items()})
    out = model.functions["out"]
    y = np.array([np.asarray(out(0.0, [], [xi, speed], p)).ravel() for xi in np.atleast_1d(x)])
    return {e.name: y[:, e.slot] if np.ndim(x) else y[0, e.slot] for e in model.output_elements()}


def check_preview(
    road: Component | Model,
    x: float,
    speed: float,
    places: Iterable[int],
    *,
    step: float,
    within: float,
    **parameters: Any,
) -> None:
    """Check that the preview shows what each wheel meets later, to `within` meters.

    The places are counted from 0 and `step` seconds apart.
    """
    now = look(road, x, speed, **parameters)
    assert now["preview.step"] == step
    corners = {name.split(".")[1] for name in now if name.startswith("road.") and name.endswith(".height")}
    assert corners
    for i in places:
        later = look(road, x + speed * step * i, speed, **parameters)
        for k in corners:
            assert now[f"preview.{k}[{i + 1}]"] == pytest.approx(later[f"road.{k}.height"], abs=within)
