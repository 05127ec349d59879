"""The same MPC step by an independent path: dense prediction in numpy, plain units, solved by quadprog.

Nothing here uses the condensed program of the FMU: outputs are predicted by simulating the model, the cost is summed up
step by step, and Goldfarb and Idnani's dual method of `quadprog` solves it. Tests and benchmarks compare the FMU with
it.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache

import numpy as np

from fmu_sources.controllers.design_checks import Array
from fmu_sources.controllers.mpc.model import MpcError, position
from fmu_sources.controllers.mpc.settings import CATCH_UP, Input, Mpc, Output

_SPARE = 1e-10  # of a scaled unknown; two bounds that meet are one equality, which rounding must not make contradictory


@dataclass(frozen=True)
class ReferenceStep:
    """Solution of one step.

    `command` (nu,) after clipping, all `moves` (blocks, nu), `slack`, cost without constants.
    """

    command: Array
    moves: Array
    slack: float
    cost: float


@dataclass(frozen=True)
class _Fixed:
    H: Array
    G: Array
    norm: Array
    unit: Array
    bounds: list[Callable[[Array, Array], float]]


class MpcReference:
    """One MPC, step by step. Needs the package `quadprog`.

    For example:

        reference = MpcReference(mpc)
        step = reference.step(x, previous=u, disturbance=road, case=0)
        u = step.command
    """

    def __init__(self, mpc: Mpc) -> None:
        self.mpc = mpc
        m = mpc.model
        self._rows = [position("output", o.name, m.outputs) for o in mpc.outputs]
        nu, blocks = len(m.inputs), mpc.horizon.control
        rest = np.zeros(len(m.states))
        none = np.zeros((len(m.disturbances), mpc.horizon.prediction + 2))
        units = [np.eye(blocks * nu)[j].reshape(blocks, nu) for j in range(blocks * nu)]
        self._effect = np.stack([self.predict(rest, np.zeros(nu), unit, none) for unit in units], axis=-1)
        self._inputs = np.stack([self.plan(np.zeros(nu), unit) for unit in units], axis=-1)

    def plan(self, previous: Array, moves: Array) -> Array:
        """Inputs (prediction + 1, nu) from now on."""
        h = self.mpc.horizon
        plan, u = [], np.array(previous, dtype=float)
        for i in range(h.prediction + 1):
            if i in h.moves:
                u = u + moves[h.moves.index(i)]
            plan.append(u)
        return np.array(plan)

    def predict(self, x: Array, previous: Array, moves: Array, disturbance: Array) -> Array:
        """Outputs (prediction, ny) at the steps that count, for given moves (blocks, nu)."""
        m, h = self.mpc.model, self.mpc.horizon
        plan, outputs = self.plan(previous, moves), []
        for i in range(h.prediction):
            now, then, later = disturbance[:, i : i + 3].T
            x = m.A @ x + m.B @ plan[i] + m.E0 @ now + m.E1 @ then
            outputs.append((m.C @ x + m.D @ plan[i] + m.F0 @ then + m.F1 @ later)[self._rows])
        return np.array(outputs)

    def step(
        self,
        x: Array,
        previous: Array,
        disturbance: Array | None = None,
        reference: Array | None = None,
        case: int = 0,
    ) -> ReferenceStep:
        """Solve one step.

        Args:
            x: state (n,) now.
            previous: inputs (nu,) of the step before.
            disturbance: (nw, prediction + 2) from now on; None for 0.
            reference: (ny, prediction) for the outputs; None for 0.
            case: number of the case.

        Raises:
            MpcError: no solution (only possible with hard output bounds).
        """
        import quadprog

        mpc, h = self.mpc, self.mpc.horizon
        fixed = self._fixed(case)
        inputs, nu = mpc.case_inputs[case], len(mpc.model.inputs)
        if disturbance is None:
            disturbance = np.zeros((len(mpc.model.disturbances), h.prediction + 2))
        n = nu * h.control
        free = self.predict(np.asarray(x, float), previous, np.zeros((h.control, nu)), disturbance)
        error = free if reference is None else free - reference.T
        f = np.zeros(n + mpc.soft)
        for i, o in enumerate(mpc.case_outputs[case]):
            f[:n] += 2 * (o.weight / o.scale) ** 2 * self._effect[:, i].T @ error[:, i]
        for j, u in enumerate(inputs):
            gradient = self._inputs[:, j].T @ np.full(h.prediction + 1, previous[j] - u.target)
            f[:n] += 2 * (u.weight / u.scale) ** 2 * gradient
        least = np.array([bound(free, previous) for bound in fixed.bounds]) / fixed.norm - _SPARE
        try:
            z, cost, *_ = quadprog.solve_qp(fixed.H, -f * fixed.unit, fixed.G.T, least)
        except ValueError as error:
            raise MpcError(f"the step has no solution: {error}") from None
        z = z * fixed.unit
        moves = z[:n].reshape(h.control, nu)
        return ReferenceStep(
            self.clip(previous + moves[0], previous, case), moves, float(z[n]) if mpc.soft else 0.0, cost
        )

    @cache  # noqa: B019
    def _fixed(self, case: int) -> _Fixed:
        """What does not change from step to step, in unknowns with a Hessian of diagonal 1.

        quadprog's tolerance is absolute.
        """
        mpc, h = self.mpc, self.mpc.horizon
        inputs, nu = mpc.case_inputs[case], len(mpc.model.inputs)
        n = nu * h.control
        size = n + mpc.soft
        H = np.zeros((size, size))
        for i, o in enumerate(mpc.case_outputs[case]):
            H[:n, :n] += 2 * (o.weight / o.scale) ** 2 * self._effect[:, i].T @ self._effect[:, i]
        for j, u in enumerate(inputs):
            H[:n, :n] += 2 * (u.weight / u.scale) ** 2 * self._inputs[:, j].T @ self._inputs[:, j]
            own = np.arange(j, n, nu)
            H[own, own] += 2 * (u.rate_weight / u.scale) ** 2
        if mpc.soft:
            H[n, n] = 2 * mpc.slack_weight
        rows, bounds = self._bounds(mpc.case_outputs[case], inputs, size)
        unit = 1 / np.sqrt(np.diag(H))
        norm = np.linalg.norm(rows * unit, axis=1)
        return _Fixed(H * np.outer(unit, unit), rows * unit / norm[:, None], norm, unit, bounds)

    def clip(self, command: Array, previous: Array, case: int = 0) -> Array:
        """The command within the hard bounds, as far as the rate bounds let it."""
        u = np.array(command, dtype=float)
        for j, i in enumerate(self.mpc.case_inputs[case]):
            low, high = previous[j] + i.rate_min, previous[j] + i.rate_max
            u[j] = min(max(u[j], low), high)
            u[j] = min(max(u[j], min(i.min, high)), max(i.max, low))
        return u

    def _bounds(
        self, outputs: tuple[Output, ...], inputs: tuple[Input, ...], size: int
    ) -> tuple[Array, list[Callable[[Array, Array], float]]]:
        """Rows of G z >= b, and each b as a function of free response and previous inputs."""
        rows: list[Array] = []
        bounds: list[Callable[[Array, Array], float]] = []
        h, nu = self.mpc.horizon, len(inputs)

        def add(row: Array, limit: float, least: Callable[[Array, Array], float]) -> None:
            if np.isfinite(limit):
                rows.append(row)
                bounds.append(least)

        for b in range(h.control):
            for j, u in enumerate(inputs):
                move, total = np.zeros(size), np.zeros(size)
                move[b * nu + j] = 1.0
                total[j : (b + 1) * nu : nu] = 1.0
                fast_up, fast_down = ((b + 1 - 2 * CATCH_UP * (b > 0)) * r for r in (u.rate_max, u.rate_min))
                add(move, u.rate_min, lambda free, p, u=u: u.rate_min)  # type: ignore[misc]
                add(-move, u.rate_max, lambda free, p, u=u: -u.rate_max)  # type: ignore[misc]
                add(total, u.min, lambda free, p, u=u, j=j, fast=fast_up: min(u.min - p[j], fast))  # type: ignore[misc]
                add(-total, u.max, lambda free, p, u=u, j=j, fast=fast_down: -max(u.max - p[j], fast))  # type: ignore[misc]
        if self.mpc.soft:
            slack = np.zeros(size)
            slack[-1] = 1.0
            add(slack, 0.0, lambda free, p: 0.0)
        n = h.control * nu
        for k, o in enumerate(outputs):
            for step in range(h.prediction):
                effect = self._effect[step, k]
                if np.abs(effect).max() <= 1e-12 * np.abs(self._effect[:, k]).max():
                    continue
                for sign, limit in ((1.0, o.min), (-1.0, o.max)):
                    row = np.zeros(size)
                    row[:n] = sign * effect
                    if o.ecr > 0:
                        row[-1] = o.ecr * o.scale
                    add(row, limit, lambda free, p, s=step, k=k, g=sign, c=limit: g * (c - free[s, k]))  # type: ignore[misc]
        return np.array(rows), bounds
