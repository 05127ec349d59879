"""Multi-step prediction with an ARX model (module `arx`): equations (6) to (8), (18) and (20) of paper 000.

Histories and futures are ordered as in module `control_law`. Where the print is incomplete or damaged, the
implementation is:

* (8b), (8c) for every index: alpha_i^q = alpha_{i+1}^{q-1} + alpha_1^{q-1} alpha_i with alpha_{p+1} = 0; likewise
  beta_i^q and delta_i^q, for i = 0 ... p.
* (20): gamma has h_p block columns, d(t) ... d(t+h_p-1), lower block-Toeplitz with delta_0 on the diagonal.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from build_fmus.base.checks import whole_number
from fmu_sources.controllers.design_checks import Array, rows
from fmu_sources.controllers.gpc.arx import ArxModel


@dataclass(frozen=True, eq=False)
class MultiStepPredictor:
    """Matrices of the multi-step prediction (6), (18), (20).

    Prediction:

        [y(t) ... y(t+h_p-1)] = tau [u(t) ... u(t+h_c-1)] + alpha [y(t-1) ...] + beta [u(t-1) ...]
                                + delta [d(t-1) ...] + gamma [d(t) ... d(t+h_p-1)]

    Controls from t+h_c on are zero, as in (7).
    """

    tau: Array  # (m h_p, rc h_c)
    alpha: Array  # (m h_p, m p)
    beta: Array  # (m h_p, rc p)
    delta: Array  # (m h_p, rd p)
    gamma: Array  # (m h_p, rd h_p)
    order: int  # p
    outputs: int  # m
    controls: int  # rc
    disturbances: int  # rd
    h_p: int
    h_c: int

    def predict(
        self,
        u_future: npt.ArrayLike,
        y_hist: npt.ArrayLike,
        u_hist: npt.ArrayLike,
        d_hist: npt.ArrayLike | None = None,
        d_future: npt.ArrayLike | None = None,
    ) -> Array:
        """(20): predicted outputs, (h_p, m). Disturbances that are not given are zero."""
        p = self.order
        y_future = (
            self.tau @ rows("u_future", u_future, self.h_c, self.controls).ravel()
            + self.alpha @ rows("y_hist", y_hist, p, self.outputs).ravel()
            + self.beta @ rows("u_hist", u_hist, p, self.controls).ravel()
            + self.delta @ rows("d_hist", d_hist, p, self.disturbances).ravel()
            + self.gamma @ rows("d_future", d_future, self.h_p, self.disturbances).ravel()
        )
        return y_future.reshape(self.h_p, self.outputs)


def multi_step_predictor(model: ArxModel, h_p: int, h_c: int | None = None) -> MultiStepPredictor:
    """The matrices of (7), (18) and (20) by the recursion (8), for 1 <= h_c <= h_p (default: h_c = h_p)."""
    h_p = whole_number("h_p", h_p)
    h_c = h_p if h_c is None else whole_number("h_c", h_c)
    if h_c > h_p:
        raise ValueError(f"control horizon h_c = {h_c} exceeds the prediction horizon h_p = {h_p}")
    p, m, rc, rd = model.order, model.outputs, model.controls, model.disturbances

    # Step q of the recursion, for i = 1 ... p (alpha) and i = 0 ... p (beta, delta).
    alpha, beta, delta = [model.alpha], [model.beta], [model.delta]
    for q in range(1, h_p):
        first = alpha[q - 1][0]  # alpha_1^{q-1}
        alpha.append(_shift(alpha[q - 1]) + first @ model.alpha)  # (8b)
        beta.append(_shift(beta[q - 1]) + first @ model.beta)  # (8a), (8c)
        delta.append(_shift(delta[q - 1]) + first @ model.delta)

    def history(steps: list[Array], width: int) -> Array:
        """Rows q = 0 ... h_p-1, block columns i = 1 ... p."""
        return np.stack(steps)[:, -p:].transpose(0, 2, 1, 3).reshape(m * h_p, width * p)

    def future(steps: list[Array], width: int, horizon: int) -> Array:
        """Lower block-Toeplitz matrix of the direct terms: block (q, j) is step q - j."""
        matrix = np.zeros((h_p, m, horizon, width))
        for j in range(horizon):
            for q in range(j, h_p):
                matrix[q, :, j, :] = steps[q - j][0]
        return matrix.reshape(m * h_p, width * horizon)

    return MultiStepPredictor(
        tau=future(beta, rc, h_c),
        alpha=history(alpha, m),
        beta=history(beta, rc),
        delta=history(delta, rd),
        gamma=future(delta, rd, h_p),
        order=p,
        outputs=m,
        controls=rc,
        disturbances=rd,
        h_p=h_p,
        h_c=h_c,
    )


def _shift(coefficients: Array) -> Array:
    """Coefficient i + 1 in the place of coefficient i; the last becomes zero."""
    return np.concatenate([coefficients[1:], np.zeros_like(coefficients[:1])])
