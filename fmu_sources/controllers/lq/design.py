"""Linear-quadratic control with preview of the disturbance: continuous and exact sampled design.

Marzbanrad, Hojjat, Zohoor, Nikravesh, "Optimal Preview Control Design of an Active Suspension Based on a Full Car
Model". Equation numbers in this file are that paper's.

The plant is linear, with states x, controls u, disturbances w (the road under each wheel) and weighted outputs y:

    dx/dt = A x + B u + E w,    y = C x + D u + F w                                                       (9), (20)

The index is the mean of a quadratic form in x, u and w. With output weights it is the mean of
sum rho_i y_i^2 + sum rho_j u_j^2, as in (10); in general it is (13) with one more term, 2 u' Nuw w:

    J = mean of x' Q1 x + 2 x' N u + u' R u + 2 x' Q12 w + w' Q2 w + 2 u' Nuw w                                (13)

The way from a plant to a controller:

    index = output_index(plant, output_weights, control_weights)       # (10) -> (13)
    law = continuous_lq(plant, index)                                  # (14)-(18): u = -law.K x + u_ff
    weights = law.foh_weights(step=0.005, count=80)                    # u_ff from heights 5 ms apart
    u_ff = weights.command(road_ahead, horizons=[24, 51, 24, 51])      # one horizon per wheel, in steps

or, for a controller that is evaluated every `period` seconds and holds its command and its road in between,
`sampled_lq(plant, index, period)`. Both laws are optimal for a disturbance known over the whole future. A horizon
that ends earlier takes the disturbance to be 0 beyond its end, or with hold_tail to stay at the last value known.

Where the print is incomplete or damaged, this is what is implemented:

* (17): the driving term is (P E + Q12) w; here it is (P E + Q12 - K' Nuw) w, which differs when D' W F is not 0.
* (A5): N_d is C' Q1 D Rd^-1 N' + N Rd^-1 D' Q1 C + N Rd^-1 N'.
* (A6) is r = lambda - P x; the first term of (A9) is A_d' P; (A10) ends at r = -P x for a horizon without a terminal
  weight, hence at 0 in the limit of a long one; (21): K2 is -Rd^-1 B'.
* (20): w drives the states and v, the measurement error, enters y through F; Appendix A has the two names exchanged.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt
from scipy import linalg

from fmu_sources.controllers.checks import whole_number

__all__ = [
    "ContinuousLq",
    "FohWeights",
    "LinearPlant",
    "LqError",
    "OutputErrorLq",
    "QuadraticIndex",
    "SampledLq",
    "SampledRun",
    "continuous_lq",
    "mean_squares",
    "output_index",
    "sampled_loop",
    "sampled_lq",
    "theorem2_lq",
]

Array = npt.NDArray[np.float64]

RESIDUAL_LIMIT = 1e-8  # of a Riccati equation, relative to |P|
MODE_TOLERANCE = 1e-9  # of the modal tests, relative to the size of the balanced matrix


class LqError(ValueError):
    """No optimal law exists. `eigenvalue` and `states` name the mode that stands in the way, if it is one."""

    def __init__(self, message: str, eigenvalue: complex | None = None, states: Sequence[str] = ()) -> None:
        super().__init__(message)
        self.eigenvalue = eigenvalue
        self.states = tuple(states)


# ------------------------------------------------------------------------------------------ plant and index


@dataclass(frozen=True, eq=False)
class LinearPlant:
    """dx/dt = A x + B u + E w; weighted outputs y = C x + D u + F w. The names are for messages."""

    A: Array  # (n, n)
    B: Array  # (n, nu)
    E: Array  # (n, nw)
    C: Array  # (ny, n)
    D: Array  # (ny, nu)
    F: Array  # (ny, nw)
    states: tuple[str, ...]
    controls: tuple[str, ...]
    disturbances: tuple[str, ...]
    outputs: tuple[str, ...]

    def __post_init__(self) -> None:
        sizes: dict[str, int] = {}
        for name in ("states", "controls", "disturbances", "outputs"):
            names = getattr(self, name)
            if isinstance(names, str):
                raise ValueError(f"{name} is the text {names!r}; expected a list of names")
            names = tuple(str(entry) for entry in names)
            doubled = sorted({entry for entry in names if names.count(entry) > 1})
            if doubled:
                raise ValueError(f"{name} lists {', '.join(doubled)} more than once")
            object.__setattr__(self, name, names)
            sizes[name] = len(names)
        for name in ("states", "controls"):
            if not sizes[name]:
                raise ValueError(f"the plant has no {name}")
        shapes = {
            "A": ("states", "states"),
            "B": ("states", "controls"),
            "E": ("states", "disturbances"),
            "C": ("outputs", "states"),
            "D": ("outputs", "controls"),
            "F": ("outputs", "disturbances"),
        }
        for name, (rows, columns) in shapes.items():
            value = _matrix(name, getattr(self, name), (sizes[rows], sizes[columns]), f"{rows} x {columns}")
            object.__setattr__(self, name, value)


@dataclass(frozen=True, eq=False)
class QuadraticIndex:
    """Weights of (13), and `Nuw` of the term 2 u' Nuw w (0 if it is not given)."""

    Q1: Array  # (n, n)
    N: Array  # (n, nu)
    R: Array  # (nu, nu), positive definite
    Q12: Array  # (n, nw)
    Q2: Array  # (nw, nw)
    Nuw: Array = field(default_factory=lambda: np.zeros((0, 0)))  # (nu, nw); empty becomes zeros

    def __post_init__(self) -> None:
        n, nu, nw = len(np.atleast_1d(self.Q1)), len(np.atleast_1d(self.R)), len(np.atleast_1d(self.Q2))
        Nuw = self.Nuw if np.size(self.Nuw) else np.zeros((nu, nw))
        shapes = {"Q1": (n, n), "N": (n, nu), "R": (nu, nu), "Q12": (n, nw), "Q2": (nw, nw), "Nuw": (nu, nw)}
        for name, shape in shapes.items():
            value = _matrix(name, Nuw if name == "Nuw" else getattr(self, name), shape, "")
            if name in ("Q1", "R", "Q2"):
                value = _symmetric(name, value)
            object.__setattr__(self, name, value)
        _positive_definite("R", self.R)
        lowest = _scaled_lowest(np.block([[self.Q1, self.N], [self.N.T, self.R]]))
        if lowest < -1e-10:
            raise ValueError(
                "Q1, N and R do not make a nonnegative index: [[Q1, N], [N', R]], scaled to a unit diagonal, has the "
                f"eigenvalue {lowest:.3g}, so Q_n = Q1 - N R^-1 N' of (14) is not nonnegative definite"
            )


def output_index(plant: LinearPlant, output_weights: npt.ArrayLike, control_weights: npt.ArrayLike) -> QuadraticIndex:
    """(10) -> (13): the index mean(sum rho_i y_i^2 + sum rho_j u_j^2) in terms of x, u and w.

    One weight per output, 0 or more, in the order of `plant.outputs`; one per control, above 0.
    """
    rho_y = _weights("output_weights", output_weights, plant.outputs, "output")
    rho_u = _weights("control_weights", control_weights, plant.controls, "control")
    for name, weight in zip(plant.outputs, rho_y, strict=True):
        if weight < 0.0:
            raise ValueError(f"the weight of output {name} is {weight:g}; a weight is 0 or more")
    for name, weight in zip(plant.controls, rho_u, strict=True):
        if weight <= 0.0:
            raise ValueError(f"the weight of control {name} is {weight:g}; above 0 is needed, or R may be singular")
    return _index_from_outputs(plant, np.diag(rho_y), np.diag(rho_u))


def _index_from_outputs(plant: LinearPlant, W: Array, R: Array) -> QuadraticIndex:
    """The index y' W y + u' R u in terms of x, u and w."""
    C, D, F = plant.C, plant.D, plant.F
    return QuadraticIndex(
        Q1=_even(C.T @ W @ C),
        N=C.T @ W @ D,
        R=_even(R + D.T @ W @ D),
        Q12=C.T @ W @ F,
        Q2=_even(F.T @ W @ F),
        Nuw=D.T @ W @ F,
    )


# --------------------------------------------------------------------------------------------- continuous law


@dataclass(frozen=True, eq=False)
class ContinuousLq:
    """Theorem 1: u(t) = -K x(t) + direct w(t) + integral over s from 0 on of kernel(s) w(t + s)."""

    P: Array  # (n, n), stabilizing solution of (16)
    K: Array  # (nu, n), R^-1 (N' + B' P)
    A_c: Array  # (n, n), (18)
    direct: Array  # (nu, nw), -R^-1 Nuw
    drive: Array  # (n, nw), P E + Q12 - K' Nuw: what w does to r in (17)
    eigenvalues: npt.NDArray[np.complex128]  # of A_c, slowest decay last
    residual: float  # |left side of (16)| / |P|, Frobenius norms
    plant: LinearPlant
    index: QuadraticIndex

    @property
    def preview_gain(self) -> Array:
        """(nu, n): R^-1 B', with which r of (17) acts on u."""
        return np.asarray(linalg.solve(self.index.R, self.plant.B.T, assume_a="pos"))

    def kernel(self, s: float) -> Array:
        """(nu, nw): G(s) = -R^-1 B' exp(A_c' s) (P E + Q12 - K' Nuw), the weight of w(t + s)."""
        if not np.isfinite(s) or s < 0.0:
            raise ValueError(f"s = {s} s; the kernel is defined ahead of now, from s = 0 on")
        return -self.preview_gain @ linalg.expm(self.A_c.T * s) @ self.drive

    def foh_weights(self, step: float, count: int) -> FohWeights:
        """The integral of kernel(s) w(t + s) for a w that is linear between nodes 0, step, 2 step ... ahead.

        With Phi = exp(A_c' step), H0 = integral of exp(A_c' s)(1 - s/step) and H1 = integral of exp(A_c' s) s/step
        over one step, the hat over node j weighs -R^-1 B' (H1 Phi^(j-1) + H0 Phi^j)(P E + Q12 - K' Nuw). All three
        are blocks of one matrix exponential, so nothing is approximated.
        """
        step, count = _positive("step", step), whole_number("count", count)
        n, M = len(self.A_c), self.A_c.T
        ladder = np.zeros((3 * n, 3 * n))
        ladder[:n, :n] = M * step
        ladder[:n, n : 2 * n] = ladder[n : 2 * n, 2 * n :] = np.eye(n)
        blocks = linalg.expm(ladder)[:n]
        phi, whole, falling = blocks[:, :n], step * blocks[:, n : 2 * n], step * blocks[:, 2 * n :]
        gain = self.preview_gain
        fall, rise = gain @ falling, gain @ (whole - falling)
        rest = linalg.solve(M.T, gain.T).T  # gain (A_c')^-1

        shape = (count, *self.direct.shape)
        interior, end, tail = np.zeros(shape), np.zeros(shape), np.zeros(shape)
        v = self.drive
        interior[0], tail[0] = -fall @ v, rest @ v
        for j in range(1, count):
            end[j] = -rise @ v
            v = phi @ v
            interior[j] = end[j] - fall @ v
            tail[j] = rest @ v
        return FohWeights(step=step, interior=interior, end=end, tail=tail, direct=self.direct)


@dataclass(frozen=True, eq=False)
class FohWeights:
    """Weights of the nodes w_j = w(t + j step) when w is linear between them and known up to node n:

        u_ff = direct w_0 + sum_{j<n} interior[j] w_j + end[n] w_n  (+ tail[n] w_n with hold_tail)

    `end[n]` is the rising half of the hat at the horizon, 0 for n = 0. `tail[n]` is what w gives from the horizon on
    if it stays at w_n; without it w is taken to be 0 there. `direct` is 0 unless D' W F is not.
    """

    step: float  # s
    interior: Array  # (count, nu, nw)
    end: Array  # (count, nu, nw)
    tail: Array  # (count, nu, nw)
    direct: Array  # (nu, nw)

    def command(self, ahead: npt.ArrayLike, horizons: Sequence[int], *, hold_tail: bool = False) -> Array:
        """u_ff, (nu,), from the nodes ahead (nodes, nw) and one horizon n per disturbance, in steps."""
        road = _matrix("ahead", ahead, (None, self.direct.shape[1]), "nodes x disturbances")
        if len(horizons) != road.shape[1]:
            raise ValueError(f"{len(horizons)} horizons are given for {road.shape[1]} disturbances")
        most = min(len(self.interior), len(road)) - 1
        u = np.zeros(len(self.direct))
        if most >= 0:
            u += self.direct @ road[0]
        for k, n in enumerate(horizons):
            if not 0 <= n <= most:
                raise ValueError(f"horizon {n} of disturbance {k} is outside 0 ... {most}, the nodes there are")
            u += np.einsum("ju,j->u", self.interior[:n, :, k], road[:n, k]) + self.end[n, :, k] * road[n, k]
            if hold_tail:
                u += self.tail[n, :, k] * road[n, k]
        return u


def continuous_lq(plant: LinearPlant, index: QuadraticIndex) -> ContinuousLq:
    """Theorem 1: (14)-(18), solved with the cross term and refined by Newton steps on (16).

    `LqError` names the mode if (A, B) is not stabilizable or the index does not detect a mode that does not decay.
    """
    _check_sizes(plant, index)
    _check_modes(plant, index)
    A, B, N, R = plant.A, plant.B, index.N, index.R

    def gain(P: Array) -> Array:
        return np.asarray(linalg.solve(R, B.T @ P + N.T, assume_a="pos"))

    def residual(P: Array) -> Array:
        K = gain(P)
        return A.T @ P + P @ A - K.T @ R @ K + index.Q1

    def newton(P: Array) -> Array:
        K = gain(P)
        cost = index.Q1 - N @ K - K.T @ N.T + K.T @ R @ K
        return np.asarray(linalg.solve_continuous_lyapunov((A - B @ K).T, -_even(cost)))

    try:
        P = linalg.solve_continuous_are(A, B, index.Q1, R, s=N)
    except (linalg.LinAlgError, ValueError) as error:
        raise LqError(f"the Riccati equation (16) has no stabilizing solution: {error}") from error
    P, relative = _refined(np.asarray(P), newton, residual)
    K = gain(P)
    A_c = A - B @ K
    eigenvalues = _sorted(linalg.eigvals(A_c))
    if not relative <= RESIDUAL_LIMIT or eigenvalues[-1].real >= 0.0:
        raise LqError(
            f"the Riccati equation (16) was solved to {relative:.1e} |P| only, with the slowest closed-loop "
            f"eigenvalue at {_rate(eigenvalues[-1])}; the weights are too far apart, or a mode is hardly reached"
        )
    return ContinuousLq(
        P=P,
        K=K,
        A_c=A_c,
        direct=-linalg.solve(R, index.Nuw, assume_a="pos"),
        drive=P @ plant.E + index.Q12 - K.T @ index.Nuw,
        eigenvalues=eigenvalues,
        residual=relative,
        plant=plant,
        index=index,
    )


# ------------------------------------------------------------------------------------------------ sampled law


@dataclass(frozen=True, eq=False)
class SampledLq:
    """The optimal law of a controller with sample time `period`: u_k = -K x_k - sum_{j>=0} G_j w_{k+j}.

    Controls and disturbances are held over each period; the index is the exact integral between samples, so that
    P, Qd, Nd ... are integrals over one period, not means.
    """

    period: float  # s
    Ad: Array
    Bd: Array
    Ed: Array
    Qd: Array  # (n, n)
    Nd: Array  # (n, nu)
    Rd: Array  # (nu, nu)
    N_xw: Array  # (n, nw)
    N_uw: Array  # (nu, nw)
    Q2d: Array  # (nw, nw)
    P: Array
    K: Array  # (nu, n)
    A_cd: Array  # (n, n), Ad - Bd K
    Rb: Array  # (nu, nu), Rd + Bd' P Bd
    eigenvalues: npt.NDArray[np.complex128]  # of A_cd, smallest magnitude first
    residual: float  # of the discrete Riccati equation / |P|, Frobenius norms
    plant: LinearPlant
    index: QuadraticIndex

    @property
    def _drive(self) -> Array:
        return self.A_cd.T @ self.P @ self.Ed + self.N_xw - self.K.T @ self.N_uw

    def preview_gains(self, count: int) -> Array:
        """(count, nu, nw): G_0 = Rb^-1 (Bd' P Ed + N_uw), G_j = Rb^-1 Bd' (A_cd')^(j-1) [A_cd' P Ed + N_xw - K' N_uw]."""
        gains = np.zeros((whole_number("count", count), *self.N_uw.shape))
        gains[0] = linalg.solve(self.Rb, self.Bd.T @ self.P @ self.Ed + self.N_uw, assume_a="pos")
        gain, v = linalg.solve(self.Rb, self.Bd.T, assume_a="pos"), self._drive
        for j in range(1, count):
            gains[j] = gain @ v
            v = self.A_cd.T @ v
        return gains

    def tail(self, n: int) -> Array:
        """(nu, nw): sum of G_j from j = n on.

        A preview that ends with w_{n-1} and holds it from there on uses G_{n-1} + tail(n) on that last value.
        """
        if n < 0:
            raise ValueError(f"n = {n}; a tail begins at 0 or later")
        if n == 0:
            return np.asarray(self.preview_gains(1)[0] + self.tail(1))
        gain = linalg.solve(self.Rb, self.Bd.T, assume_a="pos")
        power = np.linalg.matrix_power(self.A_cd.T, n - 1)
        return np.asarray(gain @ power @ linalg.solve(np.eye(len(self.K[0])) - self.A_cd.T, self._drive))


def sampled_lq(plant: LinearPlant, index: QuadraticIndex, period: float) -> SampledLq:
    """The exact sampled design: zero-order hold of u and w over `period` seconds, costs integrated in between."""
    period = _positive("period", period)
    _check_sizes(plant, index)
    _check_modes(plant, index)
    n, nu = plant.B.shape
    step, cost = _sampled_costs(plant, index, period)
    x, u, w = slice(0, n), slice(n, n + nu), slice(n + nu, None)
    Ad, Bd, Ed = step[x, x], step[x, u], step[x, w]
    Qd, Nd, Rd = cost[x, x], cost[x, u], cost[u, u]

    mode = _hidden_mode(Ad, Bd, discrete=True)
    if mode is not None:
        states = _dominant(mode[1], plant.states)
        raise LqError(
            f"at a period of {period:g} s the control loses the mode at {_rate(mode[0], 'per sample')}, mostly "
            f"{', '.join(states)}: it is undamped and turns by whole or half turns between samples; change the period",
            mode[0],
            states,
        )

    def weight(P: Array) -> Array:
        return _even(Rd + Bd.T @ P @ Bd)

    def gain(P: Array) -> Array:
        return np.asarray(linalg.solve(weight(P), Bd.T @ P @ Ad + Nd.T, assume_a="pos"))

    def residual(P: Array) -> Array:
        K = gain(P)
        return Ad.T @ P @ Ad - P - K.T @ weight(P) @ K + Qd

    def newton(P: Array) -> Array:
        K = gain(P)
        return np.asarray(
            linalg.solve_discrete_lyapunov((Ad - Bd @ K).T, _even(Qd - Nd @ K - K.T @ Nd.T + K.T @ Rd @ K))
        )

    try:
        P = linalg.solve_discrete_are(Ad, Bd, Qd, Rd, s=Nd)
    except (linalg.LinAlgError, ValueError) as error:
        raise LqError(
            f"at a period of {period:g} s the sampled Riccati equation has no stabilizing solution ({error}); "
            "change the period or the weights"
        ) from error
    P, relative = _refined(np.asarray(P), newton, residual)
    K = gain(P)
    A_cd = Ad - Bd @ K
    eigenvalues = linalg.eigvals(A_cd)
    eigenvalues = eigenvalues[np.lexsort((-eigenvalues.imag, np.round(np.abs(eigenvalues), 12)))]
    if not relative <= RESIDUAL_LIMIT or np.abs(eigenvalues[-1]) >= 1.0:
        raise LqError(
            f"at a period of {period:g} s the sampled Riccati equation was solved to {relative:.1e} |P| only, with the "
            f"largest closed-loop eigenvalue at magnitude {np.abs(eigenvalues[-1]):.6g}; change the period or the weights"
        )
    return SampledLq(
        period=period,
        Ad=Ad,
        Bd=Bd,
        Ed=Ed,
        Qd=Qd,
        Nd=Nd,
        Rd=Rd,
        N_xw=cost[x, w],
        N_uw=cost[u, w],
        Q2d=cost[w, w],
        P=P,
        K=K,
        A_cd=A_cd,
        Rb=weight(P),
        eigenvalues=eigenvalues,
        residual=relative,
        plant=plant,
        index=index,
    )


def _sampled_costs(plant: LinearPlant, index: QuadraticIndex, period: float) -> tuple[Array, Array]:
    """exp(Z T) and the integral of exp(Z' s) W exp(Z s) over [0, T] for z = [x, u, w], dz/dt = Z z with u, w held.

    Van Loan's method on a step short enough that exp(-Z' s) stays harmless, doubled until it covers the period.
    """
    n, nu = plant.B.shape
    size = n + nu + plant.E.shape[1]
    Z = np.zeros((size, size))
    Z[:n] = np.hstack([plant.A, plant.B, plant.E])
    W = np.block(
        [[index.Q1, index.N, index.Q12], [index.N.T, index.R, index.Nuw], [index.Q12.T, index.Nuw.T, index.Q2]]
    )
    balanced = linalg.matrix_balance(plant.A, permute=False)[0]
    doublings = max(0, int(np.ceil(np.log2(max(linalg.norm(balanced, 2) * period, 1e-300)))))
    short = period / 2**doublings
    blocks = linalg.expm(np.block([[-Z.T, W], [np.zeros_like(Z), Z]]) * short)
    step = blocks[size:, size:]
    cost = _even(step.T @ blocks[:size, size:])
    for _ in range(doublings):
        cost = _even(cost + step.T @ cost @ step)
        step = step @ step
    return step, cost


# -------------------------------------------------------------------------- Theorem 2: outputs with an error


@dataclass(frozen=True, eq=False)
class OutputErrorLq:
    """Theorem 2: u = K1 x + K2 r + K3 v for an index in y = C x + D u + F v with a known error v. (A12), (21).

    r(t) is the integral over s from 0 on of exp(A_G' s) [road_drive w(t + s) + error_drive v(t + s)]; leave out what
    is not known ahead. `law` is the same law in the form of Theorem 1, its disturbances being [w, v].
    """

    K1: Array  # (nu, n)
    K2: Array  # (nu, n)
    K3: Array  # (nu, nv)
    P: Array
    A_d: Array  # (A5)
    B_d: Array
    C_d: Array
    R_d: Array
    A_G: Array  # (A11), the closed loop
    road_drive: Array  # (n, nw), of (A10)
    error_drive: Array  # (n, nv)
    residual: float  # |left side of (A9)| / |P|
    law: ContinuousLq


def theorem2_lq(
    plant: LinearPlant,
    Q1y: npt.ArrayLike,
    N: npt.ArrayLike,
    R: npt.ArrayLike,
    Q12: npt.ArrayLike,
    *,
    error: npt.ArrayLike | None = None,
    errors: Sequence[str] | None = None,
) -> OutputErrorLq:
    """Minimise the mean of y' Q1y y + 2 x' N u + u' R u + 2 x' Q12 w, (19), for y = C x + D u + F w + error v.

    `error` (ny, nv) is F of (20), the way of the measurement error v into y; without it there is no v. `plant.F`, the
    direct way of the road into y, is 0 in the paper and is allowed here. N (n, nu), R (nu, nu) and Q12 (n, nw).
    """
    n, nu, nw, ny = *plant.B.shape, plant.E.shape[1], len(plant.C)
    Q = _symmetric("Q1y", _matrix("Q1y", Q1y, (ny, ny), "outputs x outputs"))
    if _scaled_lowest(Q) < -1e-10:
        raise ValueError(f"Q1y is not nonnegative definite: eigenvalue {linalg.eigvalsh(Q)[0]:.3g}")
    cross = _matrix("N", N, (n, nu), "states x controls")
    R_own = _symmetric("R", _matrix("R", R, (nu, nu), "controls x controls"))
    Q12_own = _matrix("Q12", Q12, (n, nw), "states x disturbances")
    F = _matrix("error", np.zeros((ny, 0)) if error is None else error, (ny, None), "outputs x errors")
    nv = F.shape[1]
    names = tuple(f"error[{k + 1}]" for k in range(nv)) if errors is None else tuple(errors)
    if len(names) != nv:
        raise ValueError(f"errors has {len(names)} names; error has {nv} columns")

    both = LinearPlant(
        plant.A,
        plant.B,
        np.hstack([plant.E, np.zeros((n, nv))]),
        plant.C,
        plant.D,
        np.hstack([plant.F, F]),
        plant.states,
        plant.controls,
        (*plant.disturbances, *names),
        plant.outputs,
    )
    from_outputs = _index_from_outputs(both, Q, R_own)
    index = QuadraticIndex(
        Q1=from_outputs.Q1,
        N=from_outputs.N + cross,
        R=from_outputs.R,
        Q12=from_outputs.Q12 + np.hstack([Q12_own, np.zeros((n, nv))]),
        Q2=from_outputs.Q2,
        Nuw=from_outputs.Nuw,
    )
    law = continuous_lq(both, index)
    R_d, B = index.R, plant.B
    R_d_inverse_N = linalg.solve(R_d, index.N.T, assume_a="pos")  # Rd^-1 (D' Q1y C + N')
    return OutputErrorLq(
        K1=-law.K,
        K2=-law.preview_gain,
        K3=law.direct[:, nw:],
        P=law.P,
        A_d=plant.A - B @ R_d_inverse_N,
        B_d=B @ law.preview_gain,
        C_d=_even(index.Q1 - index.N @ R_d_inverse_N),
        R_d=R_d,
        A_G=law.A_c,
        road_drive=law.drive[:, :nw],
        error_drive=law.drive[:, nw:],
        residual=law.residual,
        law=law,
    )


# ------------------------------------------------------------------------------------------------- simulation


@dataclass(frozen=True, eq=False)
class SampledRun:
    """Signals at the samples k period, k = 0 ... steps - 1, with the command and the disturbance held from there."""

    time: Array  # (steps,), s
    x: Array  # (steps, n)
    u: Array  # (steps, nu)
    w: Array  # (steps, nw)
    y: Array  # (steps, ny)
    x_end: Array  # (n,), the state one period after the last sample


def sampled_loop(
    plant: LinearPlant,
    period: float,
    w: npt.ArrayLike,
    *,
    K: npt.ArrayLike | None = None,
    feed_forward: npt.ArrayLike | Callable[[int], npt.ArrayLike] | None = None,
    x0: npt.ArrayLike | None = None,
    hold: int = 1,
) -> SampledRun:
    """The loop of a sampled controller and the continuous plant, exact at the samples.

    w (steps, nw) is held over each period. At every `hold`-th sample k the command becomes u = -K x_k + feed_forward,
    given as an array (steps, nu) or as a function of k; in between it is held. Without K and feed_forward the plant
    runs passive.
    """
    period, hold = _positive("period", period), whole_number("hold", hold)
    n, nu = plant.B.shape
    road = _matrix("w", w, (None, plant.E.shape[1]), "samples x disturbances")
    gain = _matrix("K", np.zeros((nu, n)) if K is None else K, (nu, n), "controls x states")
    x = np.zeros(n) if x0 is None else _matrix("x0", np.atleast_2d(x0), (1, n), "1 x states")[0]
    steps = len(road)
    ahead: Callable[[int], npt.ArrayLike]
    if callable(feed_forward):
        ahead = feed_forward
    else:
        table = np.zeros((steps, nu)) if feed_forward is None else feed_forward
        ahead = _matrix("feed_forward", table, (steps, nu), "samples x controls").__getitem__

    Z = np.zeros((n + nu + road.shape[1],) * 2)
    Z[:n] = np.hstack([plant.A, plant.B, plant.E])
    step = linalg.expm(Z * period)[:n]
    xs, us = np.zeros((steps, n)), np.zeros((steps, nu))
    u = np.zeros(nu)
    for k in range(steps):
        if k % hold == 0:
            u = -gain @ x + np.asarray(ahead(k), dtype=float)
        xs[k], us[k] = x, u
        x = step @ np.concatenate([x, u, road[k]])
    y = xs @ plant.C.T + us @ plant.D.T + road @ plant.F.T
    return SampledRun(time=np.asarray(period * np.arange(steps), dtype=float), x=xs, u=us, w=road, y=y, x_end=x)


def mean_squares(samples: npt.ArrayLike) -> Array:
    """Mean of the square of each column of equally spaced samples, by the trapezoidal rule."""
    values = _matrix("samples", samples, (None, None), "samples x signals")
    if len(values) < 2:
        raise ValueError(f"{len(values)} samples are given; a mean over time needs at least 2")
    return np.asarray(np.trapezoid(values**2, axis=0) / (len(values) - 1))


# ---------------------------------------------------------------------------------------------- modal checks


def _check_modes(plant: LinearPlant, index: QuadraticIndex) -> None:
    """Theorem 1's conditions: (A, B) stabilizable and (A_n, T) detectable, with Q_n = T' T. (14)"""
    mode = _hidden_mode(plant.A, plant.B)
    if mode is not None:
        eigenvalue, shape = mode
        states = _dominant(shape, plant.states)
        raise LqError(
            f"not stabilizable: the plant's mode at {_rate(eigenvalue)}, mostly {', '.join(states)}, does not decay and "
            f"no control ({', '.join(plant.controls)}) acts on it; damp it in the plant or give an actuator an arm on it",
            eigenvalue,
            states,
        )
    # For Q_n >= 0, T v = 0 is the same as Q_n v = 0, and Q_n needs no square root, which would halve the digits.
    # Its rows may be scaled at will; a row that is only the rounding of the terms that cancelled in it is 0.
    R_inverse_N = linalg.solve(index.R, index.N.T, assume_a="pos")
    reduced = index.N @ R_inverse_N
    A_n, Q_n = plant.A - plant.B @ R_inverse_N, index.Q1 - reduced
    terms = linalg.norm(index.Q1, axis=1) + linalg.norm(reduced, axis=1)
    rows = linalg.norm(Q_n, axis=1)
    seen = Q_n[rows > 1e-12 * terms]
    mode = _hidden_mode(A_n.T, seen.T, dual=True)
    if mode is not None:
        eigenvalue, shape = mode
        states = _dominant(shape, plant.states)
        raise LqError(
            f"not detectable: the mode at {_rate(eigenvalue)}, mostly {', '.join(states)}, does not decay by itself and "
            "the index does not see it; give a weight above 0 to an output that contains it",
            eigenvalue,
            states,
        )


def _hidden_mode(A: Array, B: Array, *, dual: bool = False, discrete: bool = False) -> tuple[complex, Array] | None:
    """The first mode that neither decays nor is reached by B (Popov-Belevitch-Hautus), and each state's part in it.

    With `dual`, A and B are the transposes of a system matrix and of an output matrix.
    """
    balanced, (scale, _) = linalg.matrix_balance(A, permute=False, separate=True)
    size = linalg.norm(balanced, 2) or 1.0
    columns = B / scale[:, None]
    length = linalg.norm(columns, axis=0)
    columns = columns * (size / np.where(length > 0.0, length, 1.0))
    for eigenvalue in linalg.eigvals(balanced):
        decay = 1.0 - abs(eigenvalue) if discrete else -eigenvalue.real / size
        if decay > MODE_TOLERANCE or eigenvalue.imag < 0.0:
            continue
        shifted = balanced - eigenvalue * np.eye(len(A))
        left, singular, _ = linalg.svd(np.hstack([shifted, columns]), full_matrices=False)
        if singular[-1] > MODE_TOLERANCE * size:
            continue
        unseen = left[:, -1]
        if dual:
            return complex(eigenvalue), np.abs(unseen)
        # The motion itself: of all right eigenvectors, the one that the unreached direction belongs to.
        _, singular, right = linalg.svd(shifted)
        space = right[singular <= max(1e-7 * size, singular[-1])].conj().T
        motion = space @ (space.conj().T @ unseen)
        return complex(eigenvalue), np.abs(motion if linalg.norm(motion) > 1e-6 else space[:, -1])
    return None


def _dominant(shape: Array, names: Sequence[str]) -> tuple[str, ...]:
    """The states that make up the mode, largest first, at most four."""
    order = np.argsort(-np.round(shape / np.max(shape), 6), kind="stable")
    return tuple(names[k] for k in order[:4] if shape[k] >= 0.3 * np.max(shape))


def _rate(eigenvalue: complex, unit: str = "1/s") -> str:
    real, imaginary = float(np.real(eigenvalue)), abs(float(np.imag(eigenvalue)))
    real = 0.0 if abs(real) < 1e-9 * max(1.0, imaginary) else real
    if imaginary <= 1e-9 * max(1.0, abs(real)):
        return f"{real:.4g} {unit}"
    hertz = f" ({imaginary / (2 * np.pi):.3g} Hz)" if unit == "1/s" else ""
    return f"{real:.4g} +- {imaginary:.4g}i {unit}{hertz}"


# --------------------------------------------------------------------------------------------------- numerics


def _refined(P: Array, newton: Callable[[Array], Array], residual: Callable[[Array], Array]) -> tuple[Array, float]:
    """P after the Newton steps that help, and the residual relative to |P|."""

    def relative(value: Array) -> float:
        size = float(linalg.norm(value))
        return float(linalg.norm(residual(value))) / size if size > 0.0 else float(linalg.norm(residual(value)))

    best = _even(P)
    error = relative(best)
    for _ in range(3):
        candidate = _even(newton(best))
        if not np.all(np.isfinite(candidate)) or not relative(candidate) < error:
            break
        best, error = candidate, relative(candidate)
    return best, error


def _sorted(eigenvalues: npt.NDArray[np.complex128]) -> npt.NDArray[np.complex128]:
    """Fastest decay first, conjugate pairs together with the positive imaginary part first."""
    return eigenvalues[np.lexsort((-eigenvalues.imag, -np.abs(eigenvalues.imag).round(9), eigenvalues.real.round(9)))]


def _even(value: Array) -> Array:
    return np.asarray((value + value.T) / 2)


def _scaled_lowest(value: Array) -> float:
    """Smallest eigenvalue of a symmetric matrix scaled to a unit diagonal, so that units do not matter."""
    diagonal = np.abs(np.diag(value))
    scale = np.sqrt(np.where(diagonal > 0.0, diagonal, 1.0))
    return float(linalg.eigvalsh(value / np.outer(scale, scale))[0]) if len(value) else 0.0


# ----------------------------------------------------------------------------------------------------- checks


def _check_sizes(plant: LinearPlant, index: QuadraticIndex) -> None:
    (n, nu), nw = plant.B.shape, plant.E.shape[1]
    if (len(index.Q1), len(index.R), len(index.Q2)) != (n, nu, nw):
        raise ValueError(
            f"the index is for {len(index.Q1)} states, {len(index.R)} controls and {len(index.Q2)} disturbances; "
            f"the plant has {n}, {nu} and {nw}"
        )


def _positive_definite(name: str, value: Array) -> None:
    diagonal = np.diag(value)
    if np.any(diagonal <= 0.0):
        k = int(np.argmin(diagonal))
        raise ValueError(f"{name} is not positive definite: [{k}, {k}] is {diagonal[k]:g}")
    lowest = _scaled_lowest(value)
    if lowest <= len(value) * float(np.finfo(float).eps):
        raise ValueError(
            f"{name} is singular or not positive definite: scaled to a unit diagonal, its smallest eigenvalue is "
            f"{lowest:.3g}; give every control a weight above 0"
        )


def _symmetric(name: str, value: Array) -> Array:
    skew = np.abs(value - value.T)
    if value.size and np.max(skew) > 1e-12 * np.max(np.abs(value)):
        i, j = (int(k) for k in np.unravel_index(np.argmax(skew), skew.shape))
        raise ValueError(f"{name} is not symmetric: [{i}, {j}] is {value[i, j]:g}, [{j}, {i}] is {value[j, i]:g}")
    result = _even(value)
    result.setflags(write=False)
    return result


def _matrix(name: str, value: npt.ArrayLike, shape: tuple[int | None, int | None], meaning: str) -> Array:
    array = np.array(value, dtype=float)  # a copy, made read-only: a plant or law never changes once it exists
    array.setflags(write=False)
    if array.ndim != 2 or any(want not in (None, have) for want, have in zip(shape, array.shape, strict=True)):
        wanted = ", ".join("any" if size is None else str(size) for size in shape)
        raise ValueError(f"{name} has shape {array.shape}; expected ({wanted}){f', {meaning}' if meaning else ''}")
    bad = np.argwhere(~np.isfinite(array))
    if len(bad):
        i, j = (int(k) for k in bad[0])
        raise ValueError(f"{name}[{i}, {j}] is {array[i, j]}")
    return array


def _weights(name: str, value: npt.ArrayLike, names: Sequence[str], kind: str) -> Array:
    array = np.array(value, dtype=float)
    if array.shape != (len(names),):
        given = f"{array.size} weights" if array.ndim == 1 else f"shape {array.shape}"
        raise ValueError(f"{name} has {given}; expected one for each {kind}: {', '.join(names)} ({len(names)})")
    for entry, weight in zip(names, array, strict=True):
        if not np.isfinite(weight):
            raise ValueError(f"the weight of {kind} {entry} is {weight}")
    return array


def _positive(name: str, value: float) -> float:
    if not np.isfinite(value) or value <= 0.0:
        raise ValueError(f"{name} = {value} s; expected a time above 0")
    return float(value)
