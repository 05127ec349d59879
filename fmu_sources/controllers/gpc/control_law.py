"""Generalized predictive control: control laws of an ARX model, from its multi-step prediction.

Brown, Murugan, Mazza, "Analytical Evaluation of Generalized Predictive Control Algorithms Using a Full Vehicle
Multi-Body Dynamics Model For Mobility Enhancement". Equation numbers in this file are that paper's.

The model is ARX of order p, with m outputs y, rc controls u and rd measured disturbances d (rd may be 0):

    y(t) = sum_{i=1..p} alpha_i y(t-i) + sum_{i=0..p} beta_i u(t-i) + sum_{i=0..p} delta_i d(t-i)          (1), (17)

Three steps lead from a recorded run to a controller:

    found = identify_arx(u, y, d, order=8, samples=400)            # (2)-(5), (16), (17)
    predictor = multi_step_predictor(found.model, h_p=8, h_c=8)    # (6)-(8), (18), (20)
    gpc = gpc_law(predictor, Q=[50, 10, 1], R=1e-7, variant="preview")   # (9)-(15), (19), (21)
    u_now = gpc.command(y_hist, u_hist, d_hist, d_future)

Everywhere a history is ordered most recent first, [x(t-1); x(t-2); ...; x(t-p)], and a future in time,
[x(t); x(t+1); ...]. Both are passed as arrays with one row per instant, or flattened in that order. Signals are
deviations from the static operating point: subtracting it, and the units of y, u and d, are the caller's business.

Where the print is incomplete or damaged, this is what is implemented:

* (19), (21): delta_C and gamma_C are the first rc rows of -(tau' Q tau + R)^-1 tau' Q {delta, gamma}.
* (18) drops gamma, so "explicit" takes the disturbance ahead to be 0. `hold` takes it to stay at d(t-1) instead.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Literal, get_args

import numpy as np
import numpy.typing as npt
from scipy import linalg

from build_fmus.base.checks import plain, whole_number
from fmu_sources.controllers.design_checks import Array, finite_array, rows
from fmu_sources.controllers.gpc.prediction import MultiStepPredictor

__all__ = ["GpcLaw", "GpcSequence", "Variant", "gpc_law", "gpc_sequence"]

Variant = Literal["implicit", "explicit", "preview"]

LAW_FORMAT = "gpc-law/1"
EPS = float(np.finfo(float).eps)


@dataclass(frozen=True, eq=False)
class GpcSequence:
    """Gains to the whole optimal sequence [u(t) ... u(t+h_c-1)]: (13), (14) with the disturbance terms of (21)."""

    gain_y: Array  # (rc h_c, m p), A_C
    gain_u: Array  # (rc h_c, rc p), B_C
    gain_d: Array  # (rc h_c, rd p)
    gain_preview: Array  # (rc h_c, rd h_p)


def gpc_sequence(predictor: MultiStepPredictor, Q: npt.ArrayLike, R: npt.ArrayLike) -> GpcSequence:
    """Minimize (9) over all future controls: (12), (13).

    With Q = Fq' Fq and R = Fr' Fr the minimum of (9) is the least-squares solution of

        [Fq tau; Fr] u = -[Fq f; 0],    f = alpha y + beta u_past + delta d + gamma d_future,

    which is solved by orthogonal triangularization, never forming tau' Q tau: its condition number would be the
    square of this one's. Weights as in `gpc_law`.
    """
    q_factor = _weight_factor("Q", Q, predictor.outputs, predictor.h_p, signal="output", definite=False)
    r_factor = _weight_factor("R", R, predictor.controls, predictor.h_c, signal="control", definite=True)
    stacked = np.vstack([q_factor @ predictor.tau, r_factor])
    orthogonal, triangle = linalg.qr(stacked, mode="economic")
    condition = np.linalg.cond(triangle / linalg.norm(triangle, axis=0))
    if not condition < 0.01 / EPS:
        raise ValueError(
            f"R is too small beside tau' Q tau to determine the controls in double precision "
            f"(condition number {condition:.1e} of the least-squares problem); increase R"
        )
    project = orthogonal[: len(q_factor)].T @ q_factor

    def gain(free_response: Array) -> Array:
        return -linalg.solve_triangular(triangle, project @ free_response)

    return GpcSequence(
        gain_y=gain(predictor.alpha),
        gain_u=gain(predictor.beta),
        gain_d=gain(predictor.delta),
        gain_preview=gain(predictor.gamma),
    )


@dataclass(frozen=True, eq=False)
class GpcLaw:
    """The receding-horizon control law, equations (15), (19), (21).

    It gives u(t) from histories and, with preview, from the disturbance ahead.

    (15), (19), (21).

    The four gains are always those of the optimization itself. What a variant does with them:

    * implicit: rd = 0, so only `gain_y` and `gain_u` act;
    * explicit: `gain_d` acts too; with `hold` also `gain_hold` on d(t-1), which is what `gain_preview` gives for a
      disturbance that stays at its last measured value. A controller can switch hold on and off at run time;
    * preview: `gain_d` and `gain_preview` act.
    """

    variant: Variant
    gain_y: Array  # (rc, m p)
    gain_u: Array  # (rc, rc p)
    gain_d: Array  # (rc, rd p)
    gain_preview: Array  # (rc, rd h_p)
    order: int  # p
    h_p: int
    h_c: int
    output_weight: Array  # Q as it was given
    control_weight: Array  # R as it was given
    hold: bool = False
    provenance: Mapping[str, Any] = field(default_factory=dict)  # JSON values only

    def __post_init__(self) -> None:
        if self.variant not in get_args(Variant):
            raise ValueError(f"unknown variant {self.variant!r}; choose one of {', '.join(get_args(Variant))}")
        for name in ("order", "h_p", "h_c"):
            whole_number(name, getattr(self, name))
        for name in ("gain_y", "gain_u", "gain_d", "gain_preview"):
            object.__setattr__(self, name, finite_array(name, getattr(self, name), ndim=2))
        for name in ("output_weight", "control_weight"):
            object.__setattr__(self, name, finite_array(name, getattr(self, name)))
        expected = {
            "gain_y": self.outputs * self.order,
            "gain_u": self.controls * self.order,
            "gain_d": self.disturbances * self.order,
            "gain_preview": self.disturbances * self.h_p,
        }
        for name, columns in expected.items():
            shape = getattr(self, name).shape
            if shape != (self.controls, columns):
                raise ValueError(f"{name} has shape {shape}; expected ({self.controls}, {columns})")
        if self.variant == "implicit" and self.disturbances:
            raise ValueError(f"an implicit control law has no disturbances, but gain_d is for {self.disturbances}")
        if self.variant != "implicit" and not self.disturbances:
            raise ValueError(f"the {self.variant} control law needs measured disturbances, but gain_d has no columns")
        if self.hold and self.variant != "explicit":
            raise ValueError(f"hold applies to the explicit control law only, not to {self.variant}")

    @property
    def outputs(self) -> int:
        """Number m of outputs."""
        return int(self.gain_y.shape[1]) // self.order

    @property
    def controls(self) -> int:
        """Number rc of controls."""
        return int(self.gain_y.shape[0])

    @property
    def disturbances(self) -> int:
        """Number rd of disturbances."""
        return int(self.gain_d.shape[1]) // self.order

    @property
    def gain_hold(self) -> Array:
        """(rc, rd): gain on d(t-1) that stands for the whole future when the disturbance is held."""
        return np.asarray(self.gain_preview.reshape(self.controls, self.h_p, self.disturbances).sum(axis=1))

    @property
    def gain_d_hold(self) -> Array:
        """(rc, rd p): `gain_d` with `gain_hold` folded into its first block, that of d(t-1)."""
        folded = self.gain_d.copy()
        folded[:, : self.disturbances] += self.gain_hold
        return folded

    def command(
        self,
        y_hist: npt.ArrayLike,
        u_hist: npt.ArrayLike,
        d_hist: npt.ArrayLike | None = None,
        d_future: npt.ArrayLike | None = None,
    ) -> Array:
        """u(t), (rc,). The history of u is that of the applied controls, after any limit.

        `d_hist` belongs to explicit and preview, `d_future` = [d(t) ... d(t+h_p-1)] to preview only; each is refused
        where the variant makes no use of it.
        """
        used = {"d_hist": self.variant != "implicit", "d_future": self.variant == "preview"}
        for name, value in (("d_hist", d_hist), ("d_future", d_future)):
            if used[name] and value is None:
                raise ValueError(f"the {self.variant} control law needs {name}")
            if not used[name] and value is not None:
                raise ValueError(f"the {self.variant} control law does not use {name}; leave it out")
        u = self.gain_y @ rows("y_hist", y_hist, self.order, self.outputs).ravel()
        u += self.gain_u @ rows("u_hist", u_hist, self.order, self.controls).ravel()
        if self.variant != "implicit":
            gain = self.gain_d_hold if self.hold else self.gain_d
            u += gain @ rows("d_hist", d_hist, self.order, self.disturbances).ravel()
        if self.variant == "preview":
            u += self.gain_preview @ rows("d_future", d_future, self.h_p, self.disturbances).ravel()
        return u

    def to_dict(self) -> dict[str, Any]:
        """JSON values from which `from_dict` rebuilds the control law exactly."""
        return {
            "format": LAW_FORMAT,
            "variant": self.variant,
            "hold": self.hold,
            "order": self.order,
            "h_p": self.h_p,
            "h_c": self.h_c,
            **{name: getattr(self, name).tolist() for name in _LAW_ARRAYS},
            "provenance": dict(self.provenance),
        }

    @classmethod
    def from_dict(cls, data: Mapping[str, Any]) -> GpcLaw:
        """The control law of a dictionary made by `to_dict`."""
        if data.get("format") != LAW_FORMAT:
            raise ValueError(f"not a stored GPC controller: format is {data.get('format')!r}, expected {LAW_FORMAT!r}")
        names = ("variant", "hold", "order", "h_p", "h_c", *_LAW_ARRAYS, "provenance")
        missing = [name for name in names if name not in data]
        unknown = sorted(set(data) - {"format", *names})
        if missing or unknown:
            raise ValueError(f"not a stored GPC controller: lacks {missing}, has unknown {unknown}")
        if not isinstance(data["hold"], bool):
            raise ValueError(f"hold is {data['hold']!r}; expected true or false")
        return cls(**{name: data[name] for name in names})

    def to_json(self) -> str:
        """`to_dict` as text, one matrix row per line, every number in the shortest form that reads back exactly."""
        return _json_text(self.to_dict()) + "\n"

    @classmethod
    def from_json(cls, text: str) -> GpcLaw:
        """The control law of a text made by `to_json`."""
        try:
            data = json.loads(text)
            if not isinstance(data, dict):
                raise ValueError("not a stored GPC controller: the text holds no JSON object")
            return cls.from_dict(data)
        except (ValueError, TypeError, RecursionError) as error:  # numbers that are none, brackets without an end
            raise ValueError(plain(str(error))) from None


_LAW_ARRAYS = ("output_weight", "control_weight", "gain_y", "gain_u", "gain_d", "gain_preview")


def gpc_law(
    predictor: MultiStepPredictor,
    Q: npt.ArrayLike,
    R: npt.ArrayLike,
    variant: Variant,
    *,
    hold: bool = False,
    provenance: Mapping[str, Any] | None = None,
) -> GpcLaw:
    """The first rc rows of the optimal sequence: (15), (19) or (21).

    Q, positive semi-definite, weighs the predicted outputs: one number, one per output (m,), a matrix (m, m) used at
    every instant, or the whole matrix (m h_p, m h_p). R, positive definite, weighs the controls: likewise with rc
    and h_c. "implicit" needs a predictor without disturbances, the other two one with them.
    """
    if variant not in get_args(Variant):
        raise ValueError(f"unknown variant {variant!r}; choose one of {', '.join(get_args(Variant))}")
    if variant == "implicit" and predictor.disturbances:
        raise ValueError(
            f"the implicit control law takes no account of disturbances, but the model has {predictor.disturbances}; "
            "identify it without d"
        )
    if variant != "implicit" and not predictor.disturbances:
        raise ValueError(
            f"the {variant} control law needs measured disturbances, but the model has none; identify it with d"
        )
    sequence = gpc_sequence(predictor, Q, R)
    first = slice(0, predictor.controls)
    return GpcLaw(
        variant=variant,
        gain_y=sequence.gain_y[first],
        gain_u=sequence.gain_u[first],
        gain_d=sequence.gain_d[first],
        gain_preview=sequence.gain_preview[first],
        order=predictor.order,
        h_p=predictor.h_p,
        h_c=predictor.h_c,
        output_weight=np.asarray(Q, dtype=float),
        control_weight=np.asarray(R, dtype=float),
        hold=hold,
        provenance=dict(provenance or {}),
    )


# --------------------------------------------------------------------------------------------------- checks


def _weight_factor(name: str, weight: npt.ArrayLike, width: int, horizon: int, *, signal: str, definite: bool) -> Array:
    """F with F' F = the whole weight matrix, after checking the weight."""
    value = finite_array(name, weight)
    if value.ndim == 0:
        value = np.full(width, float(value))
    full = width * horizon
    if value.shape not in ((width,), (width, width), (full, full)):
        raise ValueError(
            f"{name} has shape {value.shape}; expected a number, ({width},), ({width}, {width}) or ({full}, {full}) "
            f"({signal}s: {width}, horizon: {horizon})"
        )
    required = "positive definite" if definite else "positive semi-definite"
    if value.ndim == 1:
        if np.any(value <= 0.0 if definite else value < 0.0):
            k = int(np.argmin(value))
            raise ValueError(f"{name} is not {required}: the weight of {signal} {k} is {value[k]:g}")
        return np.asarray(np.diag(np.sqrt(np.tile(value, horizon))))
    skew = np.abs(value - value.T)
    if np.max(skew) > 1e-12 * np.max(np.abs(value)):
        i, j = (int(k) for k in np.unravel_index(np.argmax(skew), skew.shape))
        raise ValueError(f"{name} is not symmetric: [{i}, {j}] is {value[i, j]:g}, [{j}, {i}] is {value[j, i]:g}")
    eigenvalues, vectors = linalg.eigh((value + value.T) / 2)
    rounding = len(value) * EPS * np.max(np.abs(eigenvalues))
    if eigenvalues[0] <= rounding if definite else eigenvalues[0] < -rounding:
        raise ValueError(f"{name} is not {required}: its smallest eigenvalue is {eigenvalues[0]:g}")
    factor = np.sqrt(np.maximum(eigenvalues, 0.0))[:, None] * vectors.T
    return factor if len(value) == full else np.kron(np.eye(horizon), factor)


def _json_text(value: Any, indent: str = "") -> str:
    """JSON, indented, but with every list of plain values on one line."""
    inner = indent + "  "
    if isinstance(value, dict) and value:
        items = [f"{inner}{json.dumps(str(key))}: {_json_text(item, inner)}" for key, item in value.items()]
        return "{\n" + ",\n".join(items) + f"\n{indent}}}"
    if isinstance(value, list | tuple) and any(isinstance(item, dict | list | tuple) for item in value):
        return "[\n" + ",\n".join(inner + _json_text(item, inner) for item in value) + f"\n{indent}]"
    return json.dumps(value, allow_nan=False)
