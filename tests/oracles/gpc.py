"""Stability of a GPC law on its own model."""

from __future__ import annotations

import numpy as np
from scipy import linalg

from fmu_sources.controllers.gpc.arx import ArxModel
from fmu_sources.controllers.gpc.control_law import GpcLaw


def closed_loop_spectral_radius(model: ArxModel, law: GpcLaw) -> float:
    """Largest eigenvalue magnitude of the law acting on its own model; below 1 the pair is stable.

    The state is [y(t-1) ... y(t-p); u(t-1) ... u(t-p)]. Disturbances act from outside, so all variants that share
    `gain_y` and `gain_u` share this number. The actuator limit and the plant's nonlinearity are not in it.
    """
    p, m, rc = model.order, model.outputs, model.controls
    if (law.order, law.outputs, law.controls) != (p, m, rc):
        raise ValueError(
            f"order, outputs and controls are {(law.order, law.outputs, law.controls)} in the law "
            f"and {(p, m, rc)} in the model"
        )
    control = np.hstack([law.gain_y, law.gain_u])
    free = np.hstack([*model.alpha, *model.beta[1:]])
    step = np.zeros(((m + rc) * p, (m + rc) * p))
    step[:m] = free + model.beta[0] @ control
    step[m : m * p, : m * (p - 1)] = np.eye(m * (p - 1))
    step[m * p : m * p + rc] = control
    step[m * p + rc :, m * p : -rc] = np.eye(rc * (p - 1))
    return float(np.max(np.abs(linalg.eigvals(step))))
