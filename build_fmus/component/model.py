"""The frozen model of a component: its declaration and all that is derived from it.

Each derived value is computed on first use.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from build_fmus.base import extras
from build_fmus.component import functions, linear, structure
from build_fmus.component.declaration import Declaration
from build_fmus.component.dimensions import Dimensions, find_dimensions
from build_fmus.component.variables import DeclarationError

with extras.needed("build", extras.BUILDING):
    import casadi as ca


@dataclass(frozen=True, eq=False)
class Model(Declaration):
    """What a builder has declared, and everything derived from it.

    Nothing of it changes, so nothing derived gets out of date.
    """

    @cached_property
    def functions(self) -> dict[str, ca.Function]:
        """The component's functions; arguments and results are dense column vectors.

        `start (x, u, p) -> x0`: start state (declared starts pass through, calculated ones are evaluated);
        `rhs (t, x, u, p) -> dx` (continuous) or `update (t, x, u, p) -> x_next` and
        `tick (t, x, u, p) -> x_next, y` (discrete); `out (t, x, u, p) -> y`; with quadratic programs these three
        take their solutions as fifth argument, and `programs (t, x, u, p) -> data` has q, l, u, case of each; with
        random profiles they take these as last argument, and `profile_settings (t, x, u, p)` and `spectra (wave
        number, x, u, p)` are what these come from (`build_fmus.random_profiles`); `fwd (t, x, u, p, dx, du, dp)
        -> d rhs, d y` and `fwd_start (x, u, p, dx, du, dp) -> d x0` (continuous); `jac (t, x, u, p) -> d rhs/dx, d
        rhs/dt` (solver `ros2`, and wherever its code stays short); `check (t, x, u, p) -> values` that must be > 0
        when initialization ends (components with checks); `values (t, x, u, p) -> v1, v2, ...`: intermediate values
        with a name, in this order (with solutions as `out`).

        Raises:
            DeclarationError: an expression with an undeclared symbol, a check that depends on a state.
        """
        return functions.make_functions(self._in_numbers)

    def failed_checks(self, u: np.ndarray | None = None, p: np.ndarray | None = None) -> list[str]:
        """Messages of the checks that inputs `u` and parameters `p` (start values by default) do not pass."""
        if not self.checks:
            return []
        u, p = self._given(u, p)
        values = np.asarray(self.functions["check"](0.0, self.vector("state"), u, p)).ravel()
        return [m for m, value in zip(self.check_messages, values, strict=True) if not value > 0]

    @cached_property
    def dependencies(self) -> dict[str, list[str]]:
        """Exact structural dependencies from the sparsity pattern: `structure.dependencies`."""
        return structure.dependencies(self, self.functions, initial=False)

    @cached_property
    def initial_dependencies(self) -> dict[str, list[str]]:
        """As `dependencies`, during initialization."""
        return structure.dependencies(self, self.functions, initial=True)

    @cached_property
    def velocity_of(self) -> np.ndarray:
        """For each state the slot of the state that is its derivative, or -1: `structure.velocities`."""
        return structure.velocities(self, self.functions)

    @cached_property
    def constant_outputs(self) -> dict[str, float]:
        """Output elements whose value is a number known now, such as the step of a preview."""
        return structure.constant_outputs(self._in_numbers)

    @cached_property
    def dimensions(self) -> Dimensions:
        """Whether all expressions scale as the units of their variables do: `.dimensions`."""
        _ = self.functions  # undeclared symbols are refused there
        return find_dimensions(self)

    def linearize(
        self, x: np.ndarray | None = None, u: np.ndarray | None = None, p: np.ndarray | None = None
    ) -> linear.Linearization:
        """Linear model about `(x, u, p)` (start values by default); C and D cover all output elements in order.

        `x` None means the start state for `u` and `p`. Continuous components only.
        """
        if self.kind != "continuous":
            raise DeclarationError(f"{self.name}: only continuous components can be linearized")
        u, p = self._given(u, p)
        if x is None:
            x = np.asarray(self.functions["start"](self.vector("state"), u, p)).ravel()
        return linear.linearized(self, self._jacobians, x, u, p)

    @cached_property
    def _in_numbers(self) -> Declaration:
        """The declaration with numbers for its constants."""
        return functions.with_constants(self)

    @cached_property
    def _jacobians(self) -> ca.Function:
        return linear.make_jacobians(self, self.functions)

    def _given(self, u: np.ndarray | None, p: np.ndarray | None) -> tuple[np.ndarray, np.ndarray]:
        """Inputs and parameters, start values where there are none."""
        return (
            self.vector("input") if u is None else np.asarray(u, float),
            self.vector("parameter") if p is None else np.asarray(p, float),
        )
