"""Prediction models of the MPC: a plant's linearization, filters around it, and its exact sampled form.

Everything starts from `build_fmus.component.Linearization`, so the model is the plant's own. A disturbance is a
road height that the controller may know ahead of time; its rate, where the plant has one as an input, follows from it.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from scipy import linalg

from build_fmus.base.checks import did_you_mean, number
from build_fmus.component import Linearization
from fmu_sources.controllers.design_checks import Array, finite_array

Hold = Literal["foh", "zoh"]


class MpcError(ValueError):
    """An MPC that cannot be: the message names the signal, the setting and what is wrong with it."""


def position(what: str, name: str, known: Sequence[str]) -> int:
    """Place of `name` in `known`; MpcError that proposes the nearest one."""
    try:
        return list(known).index(name)
    except ValueError:
        hint = did_you_mean(name, known) or f" (there are: {', '.join(known)})"
        raise MpcError(f"no {what} {name!r}{hint}") from None


@dataclass(frozen=True)
class Disturbance:
    """A signal that the controller may know ahead, as height, rate, or both, of inputs of the plant.

    `height` and `rate` name inputs of the linearization; the rate is taken as that of the height between samples.
    Without `height` the plant sees the rate only (models in relative coordinates).
    """

    name: str
    height: str | None = None
    rate: str | None = None

    @classmethod
    def roads(cls, corners: Iterable[str]) -> tuple[Disturbance, ...]:
        """Road heights of a ride car's corners, with their rates."""
        return tuple(cls(f"road.{k}", f"road.{k}.height", f"road.{k}.rate") for k in corners)


@dataclass(frozen=True, eq=False)
class MpcModel:
    """Sampled linear model.

    x(k+1) = A x(k) + B u(k) + E0 w(k) + E1 w(k+1),  y(k) = C x(k) + D u(k-1) + F0 w(k) + F1 w(k+1)

    `u` is held between samples; a controller reads y(k) before its command u(k) acts, so u(k-1) is still in it.
    Shapes: A (n, n), B (n, nu), E0 and E1 (n, nw), C (ny, n), D (ny, nu), F0 and F1 (ny, nw). `period` [s].
    """

    A: Array
    B: Array
    E0: Array
    E1: Array
    C: Array
    D: Array
    F0: Array
    F1: Array
    states: tuple[str, ...]
    inputs: tuple[str, ...]
    disturbances: tuple[str, ...]
    outputs: tuple[str, ...]
    period: float

    def __post_init__(self) -> None:
        n, nu, nw, ny = (len(v) for v in (self.states, self.inputs, self.disturbances, self.outputs))
        shapes = {
            "A": (n, n),
            "B": (n, nu),
            "E0": (n, nw),
            "E1": (n, nw),
            "C": (ny, n),
            "D": (ny, nu),
            "F0": (ny, nw),
            "F1": (ny, nw),
        }
        for name, shape in shapes.items():
            value = finite_array(f"model.{name}", getattr(self, name))
            if value.shape != shape:
                raise MpcError(f"model.{name} has shape {value.shape}; its names ask for {shape}")
            object.__setattr__(self, name, value)
        number("the model's period", self.period, "s", above=0, error=MpcError)

    @classmethod
    def sampled(
        cls,
        lin: Linearization,
        period: float,
        *,
        inputs: Sequence[str],
        outputs: Sequence[str],
        disturbances: Sequence[Disturbance] = (),
        hold: Hold = "foh",
    ) -> MpcModel:
        """Exact sampled form of a continuous linear model.

        Args:
            lin: the plant's linearization (with filters around it, see `filter_inputs`).
            period: sample time [s].
            inputs: names of the inputs that are controlled, zero-order hold.
            outputs: names of the outputs to predict (weighted, bounded or measured).
            disturbances: what may be known ahead.
            hold: between samples the height of a disturbance is linear (`"foh"`) or held (`"zoh"`), and the rate is
                (w(k+1) - w(k)) / period.

        Raises:
            MpcError: a name that the linearization does not have.
        """
        u = [position("input of the plant", n, lin.inputs) for n in inputs]
        y = [position("output of the plant", n, lin.outputs) for n in outputs]
        nx, nu, nw = len(lin.states), len(u), len(disturbances)
        Eh, Er = np.zeros((nx, nw)), np.zeros((nx, nw))
        Fh, Fr = np.zeros((len(y), nw)), np.zeros((len(y), nw))
        for k, d in enumerate(disturbances):
            for name, E, F in ((d.height, Eh, Fh), (d.rate, Er, Fr)):
                if name is not None:
                    column = position("input of the plant", name, lin.inputs)
                    E[:, k], F[:, k] = lin.B[:, column], lin.D[y, column]
        # d/dt (x, u, w, s) with the slope s = (w(k+1) - w(k)) / period constant within a period.
        big = np.zeros((nx + nu + 2 * nw,) * 2)
        big[:nx, :nx], big[:nx, nx : nx + nu] = lin.A, lin.B[:, u]
        big[:nx, nx + nu : nx + nu + nw], big[:nx, nx + nu + nw :] = Eh, Er
        if hold == "foh":
            big[nx + nu : nx + nu + nw, nx + nu + nw :] = np.eye(nw)
        elif hold != "zoh":
            raise MpcError(f"hold {hold!r} of the disturbances is neither 'foh' nor 'zoh'")
        step = linalg.expm(big * period)[:nx]
        G0, G1 = step[:, nx + nu : nx + nu + nw], step[:, nx + nu + nw :] / period
        return cls(
            A=step[:, :nx],
            B=step[:, nx : nx + nu],
            E0=G0 - G1,
            E1=G1,
            C=lin.C[y],
            D=lin.D[np.ix_(y, u)],
            F0=Fh - Fr / period,
            F1=Fr / period,
            states=tuple(lin.states),
            inputs=tuple(inputs),
            disturbances=tuple(d.name for d in disturbances),
            outputs=tuple(outputs),
            period=period,
        )

    def with_disturbance_states(self, outputs: Sequence[str] = (), *, roads: bool = False) -> MpcModel:
        """The model with integrators that stand for what it does not know.

        `outputs`: one constant offset per named output (state `offset.NAME`). `roads`: one constant height per
        disturbance, added to what is known of it (state `walk.NAME`).
        """
        n, nw = len(self.states), len(self.disturbances) if roads else 0
        rows = [position("output", name, self.outputs) for name in outputs]
        more = len(rows) + nw
        A = linalg.block_diag(self.A, np.eye(more))
        C = np.hstack([self.C, np.zeros((len(self.outputs), more))])
        C[rows, n + np.arange(len(rows))] = 1.0
        if roads:
            A[:n, n + len(rows) :], C[:, n + len(rows) :] = self.E0 + self.E1, self.F0 + self.F1
        pad = [(0, more), (0, 0)]
        names = (
            *self.states,
            *(f"offset.{name}" for name in outputs),
            *(f"walk.{d}" for d in (self.disturbances if roads else ())),
        )
        return MpcModel(
            A=A,
            B=np.pad(self.B, pad),
            E0=np.pad(self.E0, pad),
            E1=np.pad(self.E1, pad),
            C=C,
            D=self.D,
            F0=self.F0,
            F1=self.F1,
            states=names,
            inputs=self.inputs,
            disturbances=self.disturbances,
            outputs=self.outputs,
            period=self.period,
        )


# -------------------------------------------------------------------------- filters around a linear model


@dataclass(frozen=True, eq=False)
class Filter:
    """A single-input single-output linear filter dx/dt = A x + b u, y = c x + d u."""

    A: Array
    b: Array
    c: Array
    d: float = 0.0

    @classmethod
    def second_order(cls, frequency: float, damping: float, *, gain: float = 1.0, rate: bool = False) -> Filter:
        """Transfer function gain w^2 / (s^2 + 2 z w s + w^2), with z the `damping` and w the `frequency` [rad/s].

        With `rate` gain s / (s^2 + 2 z w s + w^2).
        """
        w = frequency
        A = np.array([[0.0, w], [-w, -2 * damping * w]])
        c = np.array([0.0, gain / w]) if rate else np.array([gain, 0.0])
        return cls(A, np.array([0.0, w]), c)

    def then(self, other: Filter) -> Filter:
        """This filter followed by `other`."""
        n, m = len(self.b), len(other.b)
        A = np.block([[self.A, np.zeros((n, m))], [np.outer(other.b, self.c), other.A]])
        return Filter(
            A, np.concatenate([self.b, other.b * self.d]), np.concatenate([other.d * self.c, other.c]), self.d * other.d
        )


def filter_inputs(lin: Linearization, names: Sequence[str], filter_: Filter) -> Linearization:
    """`lin` with a filter upstream of each named input.

    Filter states are `NAME.filter[i]`, after those of `lin`.
    """
    A, B, C, D, states = lin.A, lin.B.copy(), lin.C, lin.D.copy(), list(lin.states)
    for name in names:
        j = position("input of the plant", name, lin.inputs)
        m, n = len(filter_.b), len(A)
        A = np.block([[A, np.outer(B[:, j], filter_.c)], [np.zeros((m, n)), filter_.A]])
        C = np.hstack([C, np.outer(D[:, j], filter_.c)])
        B = np.vstack([B, np.zeros((m, B.shape[1]))])
        B[:, j] = np.concatenate([B[:n, j] * filter_.d, filter_.b])
        D[:, j] = D[:, j] * filter_.d
        states += [f"{name}.filter[{i + 1}]" for i in range(m)]
    return Linearization(A, B, C, D, states, list(lin.inputs), list(lin.outputs))


def filter_output(lin: Linearization, output: str, filter_: Filter, name: str) -> Linearization:
    """`lin` with one more output `name`: `output` after a filter, whose states are `NAME.filter[i]`."""
    i, m, n = position("output of the plant", output, lin.outputs), len(filter_.b), len(lin.A)
    A = np.block([[lin.A, np.zeros((n, m))], [np.outer(filter_.b, lin.C[i]), filter_.A]])
    B = np.vstack([lin.B, np.outer(filter_.b, lin.D[i])])
    row = np.concatenate([filter_.d * lin.C[i], filter_.c])
    C = np.vstack([np.hstack([lin.C, np.zeros((len(lin.C), m))]), row])
    D = np.vstack([lin.D, filter_.d * lin.D[i]])
    states = [*lin.states, *(f"{name}.filter[{k + 1}]" for k in range(m))]
    return Linearization(A, B, C, D, states, list(lin.inputs), [*lin.outputs, name])
