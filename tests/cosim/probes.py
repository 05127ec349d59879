"""Components that make the instants of exchange visible: their outputs are times, and they log what they read."""

from __future__ import annotations

from typing import Any

from cosim import PythonComponent

INITIAL = -1.0


class Probe(PythonComponent):
    """`y` is the instant its latest step has reached: its begin if discrete, its end if continuous.

    `log` holds (begin of the step, value of `u` then) in milliseconds.
    """

    inputs = ("u",)
    outputs = ("y",)

    def begin(self) -> None:
        self.log: list[tuple[int, int]] = []

    def start(self, u: Any, y: Any) -> None:  # noqa: ARG002
        y[0] = INITIAL / 1000

    def step(self, t: float, h: float, u: Any, y: Any) -> None:
        self.log.append((round(t * 1000), round(u[0] * 1000)))
        y[0] = t if self.kind == "discrete" else t + h


class DiscreteProbe(Probe):
    kind = "discrete"


class Delta(PythonComponent):
    """y = u + 1 at every step: shows lags along a chain. Starts at 0."""

    kind = "discrete"
    inputs = ("u",)
    outputs = ("y",)

    def step(self, t: float, h: float, u: Any, y: Any) -> None:  # noqa: ARG002
        y[0] = u[0] + 1


class Moore(Delta):
    """Like Delta, but says that its output does not depend directly on its input."""

    feedthrough = {"y": ()}  # noqa: RUF012


class Clock(PythonComponent):
    """y = t, from the sample at t on."""

    kind = "discrete"
    outputs = ("y [s]",)

    def step(self, t: float, h: float, u: Any, y: Any) -> None:  # noqa: ARG002
        y[0] = t


class Integrator(PythonComponent):
    """dx/dt = gain * u, y = x; exact for inputs held over a step."""

    inputs = ("u",)
    outputs = ("y",)
    parameters = {"gain": 1.0, "x0": 0.0}  # noqa: RUF012
    feedthrough = {"y": ()}  # noqa: RUF012

    def begin(self) -> None:
        self.x = self.x0

    def start(self, u: Any, y: Any) -> None:  # noqa: ARG002
        y[0] = self.x

    def step(self, t: float, h: float, u: Any, y: Any) -> None:  # noqa: ARG002
        self.x += h * self.gain * u[0]
        y[0] = self.x
