"""Linear plants with disturbances, and quadratic indices of them; every mistake is refused by name."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

from build_fmus.component import Linearization
from fmu_sources.controllers.design_checks import Array
from fmu_sources.controllers.lq.design.matrices import (
    even,
    matrix,
    positive_definite,
    scaled_lowest,
    symmetric,
    weights,
)


class LqError(ValueError):
    """No optimal control law exists. `eigenvalue` and `states` name the mode that stands in the way, if it is one."""

    def __init__(self, message: str, eigenvalue: complex | None = None, states: Sequence[str] = ()) -> None:
        super().__init__(message)
        self.eigenvalue = eigenvalue
        self.states = tuple(states)


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

    @classmethod
    def of(
        cls, lin: Linearization, controls: Sequence[str], disturbances: Sequence[str], outputs: Sequence[str]
    ) -> LinearPlant:
        """The linear model of a component, by the names of its inputs and of the outputs that are weighted."""
        u, w = ([lin.inputs.index(n) for n in names] for names in (controls, disturbances))
        y = [lin.outputs.index(n) for n in outputs]
        B, E, C, D, F = lin.B[:, u], lin.B[:, w], lin.C[y], lin.D[np.ix_(y, u)], lin.D[np.ix_(y, w)]
        return cls(lin.A, B, E, C, D, F, tuple(lin.states), tuple(controls), tuple(disturbances), tuple(outputs))

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
            value = matrix(name, getattr(self, name), (sizes[rows], sizes[columns]), f"{rows} x {columns}")
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
            value = matrix(name, Nuw if name == "Nuw" else getattr(self, name), shape, "")
            if name in ("Q1", "R", "Q2"):
                value = symmetric(name, value)
            object.__setattr__(self, name, value)
        positive_definite("R", self.R)
        lowest = scaled_lowest(np.block([[self.Q1, self.N], [self.N.T, self.R]]))
        if lowest < -1e-10:
            raise ValueError(
                "Q1, N and R do not make a nonnegative index: [[Q1, N], [N', R]], scaled to a unit diagonal, has the "
                f"eigenvalue {lowest:.3g}, so Q_n = Q1 - N R^-1 N' of (14) is not nonnegative definite"
            )


def output_index(plant: LinearPlant, output_weights: npt.ArrayLike, control_weights: npt.ArrayLike) -> QuadraticIndex:
    """(10) -> (13): the index mean(sum rho_i y_i^2 + sum rho_j u_j^2) in terms of x, u and w.

    One weight per output, 0 or more, in the order of `plant.outputs`; one per control, above 0.
    """
    rho_y = weights("output_weights", output_weights, plant.outputs, "output")
    rho_u = weights("control_weights", control_weights, plant.controls, "control")
    for name, weight in zip(plant.outputs, rho_y, strict=True):
        if weight < 0.0:
            raise ValueError(f"the weight of output {name} is {weight:g}; a weight is 0 or more")
    for name, weight in zip(plant.controls, rho_u, strict=True):
        if weight <= 0.0:
            raise ValueError(f"the weight of control {name} is {weight:g}; above 0 is needed, or R may be singular")
    return index_from_outputs(plant, np.diag(rho_y), np.diag(rho_u))


def index_from_outputs(plant: LinearPlant, W: Array, R: Array) -> QuadraticIndex:
    """The index y' W y + u' R u in terms of x, u and w."""
    C, D, F = plant.C, plant.D, plant.F
    return QuadraticIndex(
        Q1=even(C.T @ W @ C),
        N=C.T @ W @ D,
        R=even(R + D.T @ W @ D),
        Q12=C.T @ W @ F,
        Q2=even(F.T @ W @ F),
        Nuw=D.T @ W @ F,
    )


def check_sizes(plant: LinearPlant, index: QuadraticIndex) -> None:
    """Refuse an index whose weights do not have the sizes of the plant (ValueError)."""
    (n, nu), nw = plant.B.shape, plant.E.shape[1]
    if (len(index.Q1), len(index.R), len(index.Q2)) != (n, nu, nw):
        raise ValueError(
            f"the index is for {len(index.Q1)} states, {len(index.R)} controls and {len(index.Q2)} disturbances; "
            f"the plant has {n}, {nu} and {nw}"
        )
