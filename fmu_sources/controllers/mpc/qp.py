"""The condensed quadratic program of an MPC: constant matrices, and the expressions that change from step to step.

Unknowns are the moves du of all blocks, one after the other, and one slack eps where there are soft bounds:

    minimize 1/2 z' H z + q' z    subject to    l <= A z <= u

    z = (du(move 1), du(move 2), ..., eps)

The inputs are u(k + i) = u(k - 1) + sum of the moves up to step i (an integrator in the model), so that holding an
input costs nothing but its own weight. Predicted outputs are what comes without any move (the free response, by
recursion: no large matrix) plus `response` times the moves. Columns are scaled so that the Hessians have diagonals
near 1, rows of A to length 1.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import casadi as ca
import numpy as np

from fmu_sources.controllers.design_checks import Array
from fmu_sources.controllers.mpc.model import MpcError, position
from fmu_sources.controllers.mpc.settings import CATCH_UP, INFINITE, Mpc

_NO_EFFECT = 1e-12  # of the largest: an output row that no move reaches


Named = Callable[..., Any]
"""`(name, expression, source="") -> expression`, such as `Component.value`."""


Bounds = Callable[[Any], tuple[Any, Any]]
"""`free` (ny, prediction), the outputs without any move -> least and largest inputs (nu, control) of each move."""


def _unnamed(_name: str, expression: Any, *, source: str = "") -> Any:  # noqa: ARG001
    return expression


@dataclass(frozen=True)
class QpExpressions:
    """What changes from step to step in the quadratic program.

    Columns of the program, and `free` (ny, prediction), the outputs without any move.
    """

    linear: Any
    lower: Any
    upper: Any
    free: Any


@dataclass(frozen=True, eq=False)
class CondensedQp:
    """The program of an `Mpc`. Build it once, then `expressions` for each step.

    `weights`: of squares, per unit, each an expression that takes the place of the weights of the outputs and inputs
    that are named with it. H is then `hessians` plus `terms`.

    Raises:
        MpcError: a signal that the `mpc` does not have, or that has two such weights; weights and several cases.
    """

    mpc: Mpc
    weights: Sequence[tuple[Any, Sequence[str]]] = ()

    def __post_init__(self) -> None:
        signals = [*(o.name for o in self.mpc.outputs), *(i.name for i in self.mpc.inputs)]
        named = [n for _, names in self.weights for n in names]
        for name in named:
            position("output or input with a weight", name, signals)
            if named.count(name) > 1:
                raise MpcError(f"{name} has two weights that are parameters: name it in one of them")
        if named and len(self.mpc.cases) > 1:
            raise MpcError("weights cannot be parameters of an MPC with several cases, each of which has its own")

    # ------------------------------------------------------------------------------------------------ constant part

    @property
    def moves(self) -> int:
        """Unknown moves: inputs times blocks."""
        return len(self.mpc.model.inputs) * self.mpc.horizon.control

    @property
    def size(self) -> int:
        """Unknowns."""
        return self.moves + self.mpc.soft

    @cached_property
    def _rows(self) -> tuple[int, ...]:
        """Rows of the model's outputs, in the order of `mpc.outputs`."""
        return tuple(position("output of the model", o.name, self.mpc.model.outputs) for o in self.mpc.outputs)

    @cached_property
    def response(self) -> Array:
        """Outputs at the steps that count (prediction * ny, rows step by step) to the moves (columns)."""
        m, h = self.mpc.model, self.mpc.horizon
        C, D, nu = m.C[list(self._rows)], m.D[list(self._rows)], len(m.inputs)
        columns = []
        for start in h.moves:
            x, rows = np.zeros((len(m.A), nu)), []
            for i in range(h.prediction):
                on = float(i >= start)
                x = m.A @ x + on * m.B
                rows.append(C @ x + on * D)
            columns.append(np.vstack(rows))
        return np.hstack(columns)

    @cached_property
    def held(self) -> Array:
        """Inputs at steps 0 ... prediction (rows step by step) to the moves."""
        nu, h = len(self.mpc.model.inputs), self.mpc.horizon
        steps = np.array([[float(i >= start) for start in h.moves] for i in range(h.prediction + 1)])
        return np.kron(steps, np.eye(nu))

    def _weights(self, case: int) -> tuple[Array, Array, Array]:
        """Weights (output; input; move), squared and per unit."""
        outputs, inputs = self.mpc.case_outputs[case], self.mpc.case_inputs[case]
        return (
            np.array([(o.weight / o.scale) ** 2 for o in outputs]),
            np.array([(i.weight / i.scale) ** 2 for i in inputs]),
            np.array([(i.rate_weight / i.scale) ** 2 for i in inputs]),
        )

    def _masks(self, names: Sequence[str]) -> tuple[Array, Array]:
        """1 for the outputs and the inputs with these names, 0 for others."""
        signals = ([o.name for o in self.mpc.outputs], self.mpc.model.inputs)
        outputs, inputs = (np.array([float(s in names) for s in known]) for known in signals)
        return outputs, inputs

    def _fixed_weights(self, case: int) -> tuple[Array, Array, Array]:
        """As `_weights`, 0 where an expression takes their place."""
        wy, wu, wd = self._weights(case)
        outputs, inputs = self._masks([n for _, names in self.weights for n in names])
        return wy * (1 - outputs), wu * (1 - inputs), wd

    def plain_hessian(self, case: int) -> Array:
        """H before scaling, with the weights of the settings."""
        return self._plain_hessian(self._weights(case), self.mpc.slack_weight)

    def _plain_hessian(self, weights: tuple[Array, Array, Array], slack_weight: float) -> Array:
        wy, wu, wd = weights
        h = self.mpc.horizon
        R, S = self.response, self.held
        H = np.zeros((self.size, self.size))
        n = self.moves
        H[:n, :n] = 2 * (
            R.T @ (np.tile(wy, h.prediction)[:, None] * R)
            + S.T @ (np.tile(wu, h.prediction + 1)[:, None] * S)
            + np.diag(np.tile(wd, h.control))
        )
        if self.mpc.soft:
            H[n, n] = 2 * slack_weight
        return (H + H.T) / 2

    @cached_property
    def columns(self) -> Array:
        """What a scaled unknown of 1 is in its own unit."""
        diagonal = np.mean([np.diag(self.plain_hessian(c)) for c in range(len(self.mpc.cases))], axis=0)
        return 1 / np.sqrt(diagonal)

    @cached_property
    def hessians(self) -> list[Array]:
        """H of each case, scaled, without `terms`."""
        scale = np.outer(self.columns, self.columns)
        cases = range(len(self.mpc.cases))
        return [self._plain_hessian(self._fixed_weights(c), self.mpc.slack_weight) * scale for c in cases]

    @property
    def terms(self) -> list[tuple[Any, Array]]:
        """What `weights` add to H: each with its matrix, scaled."""
        scale = np.outer(self.columns, self.columns)
        still = np.zeros(len(self.mpc.model.inputs))
        return [(w, self._plain_hessian((*self._masks(names), still), 0.0) * scale) for w, names in self.weights]

    @cached_property
    def _output_rows(self) -> list[tuple[int, int, int, Array]]:
        """(step, output, side, row) of each output bound; side 1 for max, -1 for min, 0 for both at once (hard)."""
        n, ny, h = self.moves, len(self.mpc.outputs), self.mpc.horizon
        rows = []
        largest = [np.abs(self.response[i::ny]).max() for i in range(ny)]
        for step in range(h.prediction):
            for i in self.mpc.bounded:
                o = self.mpc.outputs[i]
                effect = self.response[step * ny + i]
                if np.abs(effect).max() <= _NO_EFFECT * largest[i]:
                    continue  # nothing can be done about it
                for side in (1, -1) if o.ecr > 0 else (0,):
                    if side and not any(np.isfinite(c[i].max if side > 0 else c[i].min) for c in self.mpc.case_outputs):
                        continue
                    row = np.zeros(self.size)
                    row[:n] = effect
                    if side:
                        row[n] = -side * o.ecr * o.scale
                    rows.append((step, i, side, row))
        return rows

    @cached_property
    def _constraint(self) -> tuple[Array, Array]:
        """A in scaled unknowns with rows of length 1, and what the rows were divided by."""
        nu, blocks = len(self.mpc.model.inputs), self.mpc.horizon.control
        cumulative = np.kron(np.tril(np.ones((blocks, blocks))), np.eye(nu))
        A = np.zeros((self.moves + (self.moves - nu), self.size))
        A[: self.moves, : self.moves] = np.eye(self.moves)
        A[self.moves :, : self.moves] = cumulative[nu:]
        if self.mpc.soft:
            slack = np.zeros((1, self.size))
            slack[0, -1] = 1.0
            A = np.vstack([A, slack])
        A = np.vstack([A, *(r[None, :] for *_, r in self._output_rows)]) * self.columns
        length = np.linalg.norm(A, axis=1)
        return A / length[:, None], length

    @property
    def constraint(self) -> Array:
        """A, the same in all cases: rows for moves, inputs from the second move on, slack, output bounds."""
        return self._constraint[0]

    # ------------------------------------------------------------------------------------ expressions for each step

    def _by_case(self, values: list[Any], case: Any) -> Any:
        """Column of constants, chosen by `case`."""
        table = ca.DM(np.clip(np.array(values, dtype=float).T, -INFINITE, INFINITE))
        if len(values) == 1:
            return ca.MX(table)
        return ca.mtimes(ca.MX(table), ca.MX(ca.DM(np.arange(len(values), dtype=float))) == case)

    def free_response(self, x: Any, previous: Any, disturbance: Any, named: Named = _unnamed) -> Any:
        """Outputs (ny, prediction) when the inputs stay at `previous`.

        `x` (n,) now, `disturbance` (nw, prediction + 2) from now on, index 0 now; None for none.
        """
        m, h = self.mpc.model, self.mpc.horizon
        rows = list(self._rows)

        def matrix(name: str, values: Array) -> Any:
            return named(name, ca.MX(ca.DM(values)))

        A, C = matrix("A", m.A), matrix("C", m.C[rows])
        pushed = named("B_u", ca.mtimes(matrix("B", m.B), previous), source="effect of the last command, which stays")
        seen = ca.mtimes(matrix("D", m.D[rows]), previous)
        steps = h.prediction + 1
        if disturbance is None or not m.disturbances:
            into, through = ca.MX(len(m.A), steps), ca.MX(len(rows), steps)
        else:
            now, then = disturbance[:, :steps], disturbance[:, 1 : steps + 1]
            into = ca.mtimes(matrix("E0", m.E0), now) + ca.mtimes(matrix("E1", m.E1), then)
            named("E_w", into, source="effect of the previewed disturbance, step by step")
            through = ca.mtimes(matrix("F0", m.F0[rows]), now) + ca.mtimes(matrix("F1", m.F1[rows]), then)
        states = [named("state_now", x)]
        for i in range(h.prediction):
            source = "x(k + 1) = A x(k) + B u + E w: the model while the command stays" if i == 0 else ""
            states.append(named(f"state_{i + 1}", ca.mtimes(A, states[-1]) + pushed + into[:, i], source=source))
        chosen = ca.horzcat(*states[1:])
        return ca.mtimes(C, chosen) + ca.repmat(seen, 1, h.prediction) + through[:, 1:]

    def expressions(
        self,
        x: Any,
        previous: Any,
        disturbance: Any,
        reference: Any,
        case: Any,
        named: Named = _unnamed,
        bounds: Bounds | None = None,
    ) -> QpExpressions:
        """q, l, u of the scaled program; `named` gets the names of the values.

        Args (CasADi MX): `x` (n,) state now; `previous` (nu,) inputs of the step before; `disturbance` (nw,
        prediction + 2) or None; `reference` (ny, prediction) or None for 0; `case` number of the case; `bounds` of the
        inputs instead of their `min` and `max`.
        """
        mpc, h = self.mpc, self.mpc.horizon
        cases = range(len(mpc.cases))
        free = named(
            "free_response",
            self.free_response(x, previous, disturbance, named),
            source="predicted outputs, column by column",
        )
        error = free if reference is None else named("error", free - reference)
        weights = [self._fixed_weights(c) for c in cases]
        wy = self._by_case([2 * w[0] for w in weights], case)
        wu = self._by_case([2 * w[1] for w in weights], case)
        for weight, names in self.weights:
            outputs, inputs = self._masks(names)
            wy = wy + ca.DM(2 * outputs) * weight if outputs.any() else wy
            wu = wu + ca.DM(2 * inputs) * weight if inputs.any() else wu
        target = self._by_case([[i.target for i in mpc.case_inputs[c]] for c in cases], case)
        total = ca.DM([float(sum(i >= start for i in range(h.prediction + 1))) for start in h.moves])
        response = named("response_transposed", ca.MX(ca.DM(self.response.T)))
        weighted = named("weighted_error", ca.vec(ca.repmat(wy, 1, h.prediction) * error))
        linear = ca.mtimes(response, weighted)
        linear += ca.vec(ca.mtimes(wu * (previous - target), total.T))
        named("gradient", linear, source="q before scaling: of the outputs' weights, and of the inputs'")
        if mpc.soft:
            linear = ca.vertcat(linear, 0)

        def limit(name: str) -> Any:
            return self._by_case([[getattr(i, name) for i in mpc.case_inputs[c]] for c in cases], case)

        down, up = limit("rate_min"), limit("rate_max")
        if bounds is None:
            lows, highs = ([limit(n)] * h.control for n in ("min", "max"))
        else:
            lows, highs = ([side[:, j] for j in range(h.control)] for side in bounds(free))
        # An input outside its bounds (they may jump with the case) comes back as fast as its rate allows: never
        # infeasible.
        first_low = ca.fmin(ca.fmax(down, lows[0] - previous), up)
        first_high = ca.fmax(ca.fmin(up, highs[0] - previous), down)
        named("first_low", first_low, source="bounds of the first move")
        named("first_high", first_high)
        lower = [first_low, ca.repmat(down, h.control - 1, 1)]
        upper = [first_high, ca.repmat(up, h.control - 1, 1)]
        for j in range(1, h.control):
            fastest = j + 1 - 2 * CATCH_UP
            lower.append(ca.fmin(lows[j] - previous, fastest * up))
            upper.append(ca.fmax(highs[j] - previous, fastest * down))
        if mpc.soft:
            lower.append(0)
            upper.append(INFINITE)
        if self._output_rows:
            ny = len(mpc.outputs)
            places = [step * ny + i for step, i, _, _ in self._output_rows]
            column: Any = ca.vec(free)
            there = column[places]
            sides = []
            for which, off, value in ((-1, -INFINITE, "min"), (1, INFINITE, "max")):
                table = [[getattr(o, value) for o in mpc.case_outputs[c]] for c in cases]
                rows = [[t[i] if side in (0, which) else off for _, i, side, _ in self._output_rows] for t in table]
                sides.append(self._by_case(rows, case) - there)
            lower.append(sides[0])
            upper.append(sides[1])
        length = ca.DM(self._constraint[1])
        named("row_lengths", ca.MX(length))
        q = named("column_scales", ca.MX(ca.DM(self.columns))) * linear
        l, u = (ca.vertcat(*parts) / length for parts in (lower, upper))  # noqa: E741
        absent = INFINITE * 1e-6  # far above any bound, far below what scaling leaves of an absent one
        return QpExpressions(q, ca.if_else(l < -absent, -INFINITE, l), ca.if_else(u > absent, INFINITE, u), free)

    def all_moves(self, z: Any) -> Any:
        """The moves (nu * control,) in their own units, of the scaled unknowns."""
        return ca.DM(self.columns[: self.moves]) * z[: self.moves]

    def planned(self, previous: Any, moves: Any) -> Any:
        """Inputs (nu, prediction) from now on that these moves come to."""
        h, nu = self.mpc.horizon, len(self.mpc.model.inputs)
        steps = ca.mtimes(ca.MX(ca.DM(self.held[: nu * h.prediction])), moves)
        return ca.repmat(previous, 1, h.prediction) + ca.reshape(steps, nu, h.prediction)

    def predicted(self, free: Any, moves: Any) -> Any:
        """Outputs (ny, prediction), in the order of `mpc.outputs`, that the free response and these moves come to."""
        return free + ca.reshape(ca.mtimes(ca.MX(ca.DM(self.response)), moves), *free.shape)
