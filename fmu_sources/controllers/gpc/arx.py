"""ARX models with measured disturbances: the model, its simulation and its identification.

Brown, Murugan, Mazza (paper 000), equations (1)-(5), (16), (17):

    y(t) = sum_{i=1..p} alpha_i y(t-i) + sum_{i=0..p} beta_i u(t-i) + sum_{i=0..p} delta_i d(t-i)          (1), (17)

with m outputs y, rc controls u and rd measured disturbances d (rd may be 0). Histories are ordered most recent first.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np
import numpy.typing as npt
from scipy import linalg

from build_fmus.base.checks import whole_number
from fmu_sources.controllers.design_checks import finite_array, rows, signal

Array = npt.NDArray[np.float64]
EPS = float(np.finfo(float).eps)


@dataclass(frozen=True, eq=False)
class ArxModel:
    """Coefficients of the ARX model (1), (17): the observer Markov parameters.

    `alpha[i - 1]` is alpha_i; `beta[i]` and `delta[i]` are beta_i and delta_i, index 0 being the direct term.
    """

    alpha: Array  # (p, m, m)
    beta: Array  # (p + 1, m, rc)
    delta: Array = field(default_factory=lambda: np.zeros((0, 0, 0)))  # (p + 1, m, rd); empty becomes rd = 0

    def __post_init__(self) -> None:
        alpha = finite_array("alpha", self.alpha, ndim=3)
        beta = finite_array("beta", self.beta, ndim=3)
        p, m = alpha.shape[:2]
        delta = finite_array("delta", self.delta, ndim=3)
        if not delta.size:
            delta = np.zeros((p + 1, m, 0))
        if p < 1 or m < 1 or alpha.shape != (p, m, m):
            raise ValueError(f"alpha has shape {alpha.shape}; expected (p, m, m) with p >= 1 and m >= 1")
        if beta.shape[:2] != (p + 1, m) or beta.shape[2] < 1:
            raise ValueError(f"beta has shape {beta.shape}; alpha requires ({p + 1}, {m}, rc) with rc >= 1")
        if delta.shape[:2] != (p + 1, m):
            raise ValueError(f"delta has shape {delta.shape}; alpha requires ({p + 1}, {m}, rd)")
        for name, value in (("alpha", alpha), ("beta", beta), ("delta", delta)):
            object.__setattr__(self, name, value)

    @property
    def order(self) -> int:
        """Order p."""
        return int(self.alpha.shape[0])

    @property
    def outputs(self) -> int:
        """Number m of outputs."""
        return int(self.alpha.shape[1])

    @property
    def controls(self) -> int:
        """Number rc of controls."""
        return int(self.beta.shape[2])

    @property
    def disturbances(self) -> int:
        """Number rd of disturbances."""
        return int(self.delta.shape[2])

    def simulate(
        self,
        u: npt.ArrayLike,
        d: npt.ArrayLike | None = None,
        *,
        y_past: npt.ArrayLike | None = None,
        u_past: npt.ArrayLike | None = None,
        d_past: npt.ArrayLike | None = None,
    ) -> Array:
        """y(0) ... y(n-1) by stepping (1) through time, for u (n, rc) and d (n, rd) and given histories.

        Histories hold p rows, most recent first; what is not given was zero. This is the definition of the model,
        written as plainly as possible: the predictor is compared with it in tests.
        """
        p = self.order
        u_run = signal("u", u, self.controls)
        d_run = signal("d", np.zeros((len(u_run), 0)) if d is None and not self.disturbances else d, self.disturbances)
        if len(d_run) != len(u_run):
            raise ValueError(f"d has {len(d_run)} samples, u has {len(u_run)}")
        y_all = np.vstack([rows("y_past", y_past, p, self.outputs)[::-1], np.zeros((len(u_run), self.outputs))])
        u_all = np.vstack([rows("u_past", u_past, p, self.controls)[::-1], u_run])
        d_all = np.vstack([rows("d_past", d_past, p, self.disturbances)[::-1], d_run])
        for t in range(p, len(y_all)):
            y_t = self.beta[0] @ u_all[t] + self.delta[0] @ d_all[t]
            for i in range(1, p + 1):
                y_t += self.alpha[i - 1] @ y_all[t - i] + self.beta[i] @ u_all[t - i] + self.delta[i] @ d_all[t - i]
            y_all[t] = y_t
        return y_all[p:]


@dataclass(frozen=True, eq=False)
class ArxIdentification:
    """An identified model and how well the data determined it."""

    model: ArxModel
    samples: int  # L
    equations: int  # L - p: columns of V that were used
    singular_values: Array  # of V with every row scaled to length 1, largest first
    rank: int  # singular values that were kept
    condition: float  # largest over smallest kept singular value
    residual_rms: Array  # (m,), in the unit of each output
    dropped: tuple[str, ...]  # rows of V without variance, e.g. "d[2](t-3)": their coefficients are 0

    def summary(self) -> dict[str, Any]:
        """Plain numbers, to be stored as provenance of a control law."""
        return {
            "order": self.model.order,
            "samples": self.samples,
            "equations": self.equations,
            "rank": self.rank,
            "unknowns_per_output": len(self.singular_values) + len(self.dropped),
            "condition": self.condition,
            "residual_rms": self.residual_rms.tolist(),
            "dropped": list(self.dropped),
        }


def identify_arx(
    u: npt.ArrayLike,
    y: npt.ArrayLike,
    d: npt.ArrayLike | None = None,
    *,
    order: int,
    samples: int | None = None,
    rcond: float | None = None,
    from_rest: bool = False,
) -> ArxIdentification:
    """Observer Markov parameters from a recorded run, by least squares on (2) with V of (4), with d that of (16).

    u (n, rc), y (n, m) and d (n, rd) hold one row per sample. The last `samples` = L rows are used (all rows if it
    is None), so that a run may begin with a stretch of settling. The columns of V that reach back before the first
    of them are left out: the zeros printed there hold only for a run that starts from rest with no disturbance. With
    `from_rest` the first of them is the start of such a run, and these columns are used as printed.

    The rows of V differ by many orders of magnitude (newtons beside degrees), so each is scaled to length 1 before
    the singular value decomposition, and of all exact fits the one of smallest norm in these units is taken. Singular
    values below `rcond` times the largest count as zero; default: machine epsilon times the larger dimension of V.
    """
    p = whole_number("order", order)
    u_run, y_run = signal("u", u), signal("y", y)
    d_run = np.zeros((len(u_run), 0)) if d is None else signal("d", d)
    for name, run in (("u", u_run), ("y", y_run)):
        if run.shape[1] == 0:
            raise ValueError(f"{name} has no columns")
    for name, run in (("y", y_run), ("d", d_run)):
        if len(run) != len(u_run):
            raise ValueError(f"{name} has {len(run)} samples, u has {len(u_run)}")

    length = len(u_run) if samples is None else whole_number("samples", samples)
    if length > len(u_run):
        raise ValueError(f"samples = {length}, but only {len(u_run)} were recorded")
    u_run, y_run, d_run = (run[len(run) - length :] for run in (u_run, y_run, d_run))
    if from_rest:
        u_run, y_run, d_run = (np.vstack([np.zeros((p, run.shape[1])), run]) for run in (u_run, y_run, d_run))
        length += p

    m, rc, rd = y_run.shape[1], u_run.shape[1], d_run.shape[1]
    unknowns = rd + rc + (rd + rc + m) * p
    if length - p < unknowns:
        raise ValueError(
            f"too few samples: order {p} with {m} outputs, {rc} controls and {rd} disturbances has {unknowns} "
            f"coefficients per output and needs at least {unknowns + p} samples, got {length}"
        )

    v, labels = _data_matrix(y_run, u_run, d_run, p)
    kept = np.ptp(v, axis=1) > 8 * EPS * np.max(np.abs(v), axis=1)
    if not kept.any():
        raise ValueError("u, y and d are constant over the whole run: nothing to identify")
    scale = linalg.norm(v[kept], axis=1)
    left, singular, right = linalg.svd(v[kept] / scale[:, None], full_matrices=False, lapack_driver="gesvd")
    limit = max(v.shape) * EPS if rcond is None else rcond
    rank = int(np.count_nonzero(singular > limit * singular[0]))
    target = y_run[p:].T
    y_bar = np.zeros((m, unknowns))
    y_bar[:, kept] = ((target @ right[:rank].T) / singular[:rank]) @ left[:, :rank].T / scale
    residual = target - y_bar @ v

    # (5), (17) read back: [delta_0 beta_0 | delta_1 beta_1 alpha_1 | ... | delta_p beta_p alpha_p]
    direct, rest = y_bar[:, : rd + rc], y_bar[:, rd + rc :].reshape(m, p, rd + rc + m).transpose(1, 0, 2)
    model = ArxModel(
        alpha=rest[:, :, rd + rc :],
        beta=np.concatenate([direct[None, :, rd:], rest[:, :, rd : rd + rc]]),
        delta=np.concatenate([direct[None, :, :rd], rest[:, :, :rd]]),
    )
    return ArxIdentification(
        model=model,
        samples=length - p if from_rest else length,
        equations=length - p,
        singular_values=singular,
        rank=rank,
        condition=float(singular[0] / singular[rank - 1]),
        residual_rms=np.sqrt(np.mean(residual**2, axis=1)),
        dropped=tuple(label for label, keep in zip(labels, kept, strict=True) if not keep),
    )


def _data_matrix(y: Array, u: Array, d: Array, p: int) -> tuple[Array, list[str]]:
    """V of (4), (16) from column p on, and a label for each row."""
    blocks: list[Array] = []
    labels: list[str] = []
    for lag in range(p + 1):
        signals = [("d", d), ("u", u)] + ([("y", y)] if lag else [])
        for name, run in signals:
            blocks.append(run[p - lag : len(run) - lag].T)
            labels += [f"{name}[{k}](t-{lag})" if lag else f"{name}[{k}](t)" for k in range(run.shape[1])]
    return np.vstack(blocks), labels
