"""Two masses on springs, each of which feels the other, and their exact motion."""

from __future__ import annotations

from typing import Any

import numpy as np
from scipy.linalg import expm

from cosim import PythonComponent

K, COUPLING = 100.0, 50.0
NAMES = ["a.x", "a.v", "b.x", "b.v"]


class Mass(PythonComponent):
    """A mass of 1 kg on its own spring of k N/m and damper of d Ns/m; exact for a force that is held."""

    inputs = ("force",)
    outputs = ("x", "v")
    parameters = {"x0": 1.0, "d": 0.0, "k": K}  # noqa: RUF012
    feedthrough = {"x": (), "v": ()}  # noqa: RUF012

    def begin(self) -> None:
        self.x, self.v = self.x0, 0.0

    def start(self, u: Any, y: Any) -> None:  # noqa: ARG002
        y[:] = self.x, self.v

    def step(self, t: float, h: float, u: Any, y: Any) -> None:  # noqa: ARG002
        rest, decay = u[0] / self.k, 0.5 * self.d
        w = np.sqrt(self.k - decay * decay)
        c, s, x = np.cos(w * h), np.sin(w * h), self.x - rest
        p = (self.v + decay * x) / w
        e = np.exp(-decay * h)
        self.x = rest + e * (x * c + p * s)
        self.v = e * ((p * w - decay * x) * c - (x * w + decay * p) * s)
        y[:] = self.x, self.v


def exact(times: np.ndarray, *, k: float = K, d: float = 0.0) -> dict[str, np.ndarray]:
    """Of masses on springs of k N/m: mass a starts at 1 m. Each feels COUPLING N/m times the other's position."""
    a = np.array([[0, 1, 0, 0], [-k, -d, COUPLING, 0], [0, 0, 0, 1], [COUPLING, 0, -k, -d]])
    states = np.array([expm(a * t) @ [1, 0, 0, 0] for t in times])
    return dict(zip(NAMES, states.T, strict=True))
