"""Observers of the MPC: steady-state Kalman filters with a measured road, an estimated road or output offsets.

The disturbance model of the filter decides how an MPC without preview acts:

- offsets on the outputs (`offsets`): every deviation is a constant added to an output. This is the usual default of
  MPC tools; it knows of no road, so it reacts to what the road has done to the body, and leaves no steady-state error.
- heights that wander (`walks`): the filter estimates the road under each wheel, and predicts with it.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import casadi as ca
import numpy as np
from scipy import linalg

from build_fmus.base.checks import number
from fmu_sources.controllers.design_checks import Array
from fmu_sources.controllers.mpc.model import MpcError, MpcModel, position


@dataclass(frozen=True, eq=False)
class Observer:
    """A filter for `model`, which is the plant's with the disturbance states that the filter estimates.

    At a sample: x = x_predicted + gain (y - C x_predicted - D u(k-1) - F w), with the measured outputs y as they stand
    before the new command acts; then x_predicted = A x + B u(k) + E w for the next sample.
    `gain` (n, measured), `covariance` (n, n) of the prediction error.
    """

    model: MpcModel
    measured: tuple[str, ...]
    gain: Array
    covariance: Array
    noise: Mapping[str, object] = field(default_factory=dict)

    @classmethod
    def kalman(
        cls,
        plant: MpcModel,
        measured: Mapping[str, float],
        *,
        input_noise: float | Sequence[float],
        offsets: Mapping[str, float] | None = None,
        walks: float | None = None,
    ) -> Observer:
        """Steady-state Kalman filter.

        Args:
            plant: sampled model of the plant.
            measured: outputs that are measured, with the standard deviation of their noise.
            input_noise: standard deviation of white noise on each input, by period (what the model does not know of).
            offsets: outputs with an integrating offset, and by how much it wanders per period (standard deviation).
            walks: how much the road under each wheel wanders per period [m]; None: no road is estimated.

        Raises:
            MpcError: something that wanders cannot be told from the measured outputs, or noise that is not positive.
        """
        offsets = offsets or {}
        for name, value in {
            **{f"noise of {k}": v for k, v in measured.items()},
            **{f"offset of {k}": v for k, v in offsets.items()},
        }.items():
            number(f"observer: {name}", value, above=0, error=MpcError)
        if not measured:
            raise MpcError("observer: no output is measured")
        push = np.broadcast_to(np.asarray(input_noise, dtype=float), (len(plant.inputs),))
        model = plant.with_disturbance_states(tuple(offsets), roads=walks is not None)
        rows = [position("output of the model", name, model.outputs) for name in measured]
        C, n = model.C[rows], len(plant.states)
        Q = model.B @ np.diag(push**2) @ model.B.T
        wander = [*offsets.values(), *([walks] * len(plant.disturbances) if walks is not None else [])]
        Q[n:, n:] += np.diag(np.square(wander))
        R = np.diag(np.square(list(measured.values())))
        try:
            P = linalg.solve_discrete_are(model.A.T, C.T, Q, R)
            gain = linalg.solve(C @ P @ C.T + R, C @ P, assume_a="pos").T
        except (linalg.LinAlgError, ValueError):
            gain = None
        if gain is None or np.abs(linalg.eigvals(model.A - model.A @ gain @ C)).max() >= 1 - 1e-9:
            unknown = ", ".join(model.states[n:]) or "the states of the plant"
            raise MpcError(
                f"observer: {unknown} cannot all be observed from {', '.join(measured)}; measure more outputs, or"
                " give fewer offsets or walks"
            )
        noise = {"measured": dict(measured), "input": push.tolist(), "offsets": dict(offsets), "walks": walks}
        return cls(model, tuple(measured), gain, P, noise)

    def _rows(self) -> list[int]:
        return [position("output of the model", name, self.model.outputs) for name in self.measured]

    def correct(self, predicted: Any, y: Any, previous: Any, now: Any, then: Any) -> Any:
        """State (n,) from the prediction, measured outputs, inputs of the step before, disturbances now and next."""
        m, rows = self.model, self._rows()
        expected = _times(m.C[rows], predicted) + _times(m.D[rows], previous)
        expected += _times(m.F0[rows], now) + _times(m.F1[rows], then)
        return predicted + _times(self.gain, y - expected)

    def predict(self, x: Any, u: Any, now: Any, then: Any) -> Any:
        """State (n,) one period later."""
        m = self.model
        return _times(m.A, x) + _times(m.B, u) + _times(m.E0, now) + _times(m.E1, then)


def _times(matrix: Array, vector: Any) -> Any:
    if isinstance(vector, np.ndarray):
        return matrix @ vector
    return ca.mtimes(ca.DM(matrix), vector)
