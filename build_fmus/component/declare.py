"""The builder: what users write a declaration with."""

from __future__ import annotations

import functools
import math
import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import replace
from types import MappingProxyType
from typing import Any, Concatenate, ParamSpec, TypeVar

import numpy as np

from build_fmus import qp
from build_fmus.base import extras, units
from build_fmus.base.checks import number
from build_fmus.component.declaration import named
from build_fmus.component.dimensions import Dimensions
from build_fmus.component.linear import Linearization, statespace
from build_fmus.component.model import Model
from build_fmus.component.variables import (
    BaseType,
    DeclarationError,
    Kind,
    Role,
    Solver,
    Variable,
    source_fault,
    text_fault,
)
from build_fmus.random_profiles import RandomProfiles

with extras.needed("build", extras.BUILDING):
    import casadi as ca

_NAME = re.compile(r"^[A-Za-z_]\w*(\.[A-Za-z_]\w*)*$", re.ASCII)
_PERIOD = "sample time"  # no name that a variable could have
_TYPES: dict[type, BaseType] = {float: "Float64", int: "Int32", bool: "Boolean"}

_P = ParamSpec("_P")
_T = TypeVar("_T")


def _declares(method: Callable[Concatenate[Component, _P], _T]) -> Callable[Concatenate[Component, _P], _T]:
    """A method that declares something, which is refused once the model is made."""

    @functools.wraps(method)
    def checked(self: Component, *args: _P.args, **options: _P.kwargs) -> _T:
        self._refuse_if_made(f"{method.__name__}()")
        return method(self, *args, **options)

    return checked


class Component:
    """Collects the declaration of one FMU; `model` freezes it. See the docstring of the package for an example.

    Args:
        name: FMU name, UpperCamelCase; also the C model identifier.
        kind: `"continuous"` (derivatives) or `"discrete"` (update with a sample period).
        description: one line for the model description.
        source: where the equations come from (paper and equation numbers).
        sample_time: period [s]; discrete components only.
        solver, solver_step: fixed-step integrator and its largest step [s]; continuous components only. `"rk4"`:
            classic Runge-Kutta, for smooth dynamics slower than the step. `"am2"`: Adams-Bashforth-2 predictor,
            Adams-Moulton-2 corrector. `"ros2"`: linearly implicit Rosenbrock method of order 2 with the exact
            Jacobian, L-stable, for stiff components with few states (a dense n x n system is solved twice per step);
            give its states `nominal` values. `"semi_implicit"`: Stoermer-Verlet (leapfrog) with midpoint
            velocities, order 2, for mechanical systems with contacts: positions (states whose derivative is another
            state) and velocities advance in turn, so that undamped vibrations neither grow nor decay below `step *
            omega = 2`.
        exchange_step: communication step [s] proposed to tools (default experiment).
        symbols: `ca.SX` (default, no overhead) or `ca.MX` where lookup tables are needed.
        notes: paragraphs for the documentation page (assumptions, what is left out and why, wiring).
    """

    def __init__(
        self,
        name: str,
        *,
        kind: Kind,
        description: str,
        source: str,
        sample_time: float | None = None,
        solver: Solver = "rk4",
        solver_step: float = 5e-4,
        exchange_step: float = 1e-3,
        stop_time: float = 10.0,
        symbols: Any = ca.SX,
        notes: Iterable[str] = (),
    ) -> None:
        if not re.fullmatch(r"[A-Za-z_]\w*", name, re.ASCII):
            raise DeclarationError(f"component name {name!r} is not an identifier")
        if (sample_time is not None) != (kind == "discrete"):
            raise DeclarationError(f"{name}: give sample_time if kind='discrete', and only then")
        for what, fault in (("description", text_fault(description)), ("source", source_fault(source))):
            if fault:
                raise DeclarationError(f"{name}: {what}: {fault}")
        self._model: Model | None = None
        self.name, self.kind, self.description, self.source = name, kind, description, source
        self.sample_time = sample_time
        self.solver, self.solver_step = solver, solver_step
        self.exchange_step, self.stop_time = exchange_step, stop_time
        self.notes = tuple(notes)
        self.provenance: dict[str, Any] = {}  # stored in the FMU as resources/provenance.json when not empty
        self.bibliography: dict[str, str] = {}  # what short names in sources stand for; on the documentation page
        self.time = symbols.sym("time")
        self._symbols = symbols
        self._variables: dict[str, Variable] = {}
        self._handles: dict[str, Any] = {}  # what parameter(), input() and state() returned
        self._sizes: dict[Role, int] = {"parameter": 0, "constant": 0, "input": 0, "state": 0, "output": 0}
        self._changes: dict[str, Any] = {}  # state name -> derivative or update expression
        self._values: dict[str, tuple[Any, str]] = {}  # intermediate values by name, with the source of their equations
        self.equations: dict[str, str] = {}  # output or state -> where its equation comes from
        self._starts: dict[str, Any] = {}  # state name -> start expression of parameters and inputs
        self._results: dict[str, Any] = {}
        self.programs: list[qp.QuadraticProgram] = []
        self.profiles: list[RandomProfiles] = []
        self._checks: list[tuple[Any, str]] = []
        self.reference_inputs: dict[str, Callable[[float], float]] = {}
        self.operating_points: dict[str, dict[str, float]] = {"start": {}}
        if kind == "continuous":  # the runtime finds it in the first slot
            self.parameter(
                "solver.step",
                solver_step,
                "s",
                f"largest step of the fixed-step solver ({solver})",
                min=1e-6,
                max=1e-2,
                source="build option",
            )

    @classmethod
    def from_statespace(
        cls,
        name: str,
        system: Any,
        *,
        description: str,
        source: str,
        sample_time: float | None = None,
        inputs: Mapping[str, str | None] | None = None,
        outputs: Mapping[str, str | None] | None = None,
        **options: Any,
    ) -> Component:
        """Make a component of a linear controller, filter or plant.

        With a sample time `x[k+1] = A x[k] + B u[k]`, `y[k] = C x[k] + D u[k]` at every sample, without one `dx/dt
        = A x + B u` in continuous time; states start at 0. The matrices become tunable parameters of the names A, B,
        C, D, those that are there; elements of D that are 0 stay 0.

        Args:
            name: of the FMU.
            system: a `control.StateSpace` or a tuple of matrices (A, B, C, D).
            description: one line for the model description.
            source: where the matrices come from.
            sample_time: period [s]; needed for sampled matrices, and of systems that do not tell their own.
            inputs: FMU name -> unit (None: no unit), in the order of the columns of B. By default the names of the
                system's signals, with the names and units of the FMU where it is a model that `cosim` has linearized.
            outputs: likewise, in the order of the rows of C.
            options: as of `Component`.

        Raises:
            DeclarationError: shapes that do not fit, another sample time than the system's, a continuous system with a
                sample time.
        """
        model = statespace(name, system, sample_time, inputs, outputs)
        kind: Kind = "discrete" if model.sample_time else "continuous"
        c = cls(name, kind=kind, description=description, source=source, sample_time=model.sample_time, **options)
        model.declare_in(c, source)
        return c

    def __setattr__(self, name: str, value: Any) -> None:
        self._refuse_if_made(name)
        super().__setattr__(name, value)

    def _refuse_if_made(self, what: str) -> None:
        if self.__dict__.get("_model") is not None:
            raise DeclarationError(
                f"{self.name}: {what} comes too late: model(), linearize() or a build has completed the declaration;"
                " declare it before"
            )

    # ------------------------------------------------------------------ declaring

    @_declares
    def parameter(
        self,
        name: str,
        start: Any,
        unit: str | None = "1",
        description: str = "",
        *,
        min: float | None = None,
        max: float | None = None,
        nominal: float | None = None,
        display_unit: str | None = None,
        tunable: bool = False,
        source: str = "",
        rows: Sequence[str] = (),
        columns: Sequence[str] = (),
    ) -> Any:
        """Declare a parameter; shape and type follow from `start` (float, int, bool or array). Returns its symbol.

        `rows`, `columns`: units of an array whose elements differ (`unit` None), for the check of dimensions. An
        element has the unit of its row, divided by that of its column where it has one: a gain has outputs as rows and
        inputs as columns.

        `source` says where the value comes from (paper and table, "measured", "assumed"); it goes into the model
        description, and without one the parameter is refused.
        """
        if fault := source_fault(source):
            raise DeclarationError(f"{self.name}.{name}: source: {fault}")
        array = np.asarray(start)
        kind = bool if array.dtype == bool else int if array.dtype.kind == "i" else float
        return self._add(
            name,
            "parameter",
            unit,
            description,
            array.shape,
            start=array,
            type=_TYPES[kind],
            min=min,
            max=max,
            nominal=nominal,
            display_unit=display_unit,
            tunable=tunable,
            source=source,
            rows=tuple(rows),
            columns=tuple(columns),
        )

    @_declares
    def constant(
        self,
        name: str,
        value: Any,
        unit: str | None,
        description: str,
        *,
        source: str,
        rows: Sequence[str] = (),
        columns: Sequence[str] = (),
    ) -> Any:
        """Declare numbers with a unit that equations use and nobody sets, such as the acceleration of gravity.

        `value` is a number, vector or matrix. It is no variable of the FMU: the C code has the numbers. Returns its
        symbol; a number with a dimension that stands in an equation without a declaration does not pass the check of
        dimensions. `source`, `rows` and `columns` as of `parameter`.
        """
        if fault := source_fault(source):
            raise DeclarationError(f"{self.name}.{name}: source: {fault}")
        array = np.asarray(value, dtype=float)
        return self._add(
            name,
            "constant",
            unit,
            description,
            array.shape,
            start=array,
            source=source,
            rows=tuple(rows),
            columns=tuple(columns),
        )

    @property
    def period(self) -> Any:
        """Symbol of the sample time [s] of a discrete component, for equations.

        It is a constant with a symbol, so that it has its dimension.
        """
        if self.sample_time is None:
            raise DeclarationError(
                f"{self.name}: period is for discrete components; a continuous one has no sample time"
            )
        if _PERIOD not in self._handles:
            self._refuse_if_made("period")
            symbol = self._handles[_PERIOD] = self._symbols.sym("period")
            self._variables[_PERIOD] = Variable(
                _PERIOD, "constant", "s", "sample time", start=(self.sample_time,), symbol=symbol
            )
        return self._handles[_PERIOD]

    @_declares
    def input(
        self,
        name: str,
        unit: str | None,
        description: str,
        *,
        start: Any = 0.0,
        shape: tuple[int, ...] = (),
        type: type = float,
        min: float | None = None,
        max: float | None = None,
        nominal: float | None = None,
        display_unit: str | None = None,
        optional: bool = False,
    ) -> Any:
        """Declare an input (vector when `shape` is given). Returns what the equations are written with.

        A real input with `min` or `max` is clipped to them in the equations, so that a solver that overshoots by a
        hair does no harm: the FMU takes any finite value, warns once, and its derivatives are 0 beyond a limit.
        Integers and Booleans are refused outside their range. `optional`: the model description says that it may stay
        unconnected, and a master does not warn of it.
        """
        kind = _TYPES[type]
        symbol = self._add(
            name,
            "input",
            unit,
            description,
            shape,
            start=np.broadcast_to(start, shape),
            type=kind,
            min=min,
            max=max,
            nominal=nominal,
            display_unit=display_unit,
            optional=optional,
        )
        if kind != "Float64":
            return symbol
        # Not fmin and fmax: at a limit itself the derivative is that of the inside.
        if max is not None:
            limit = self._limit(name, "max", max, unit)
            symbol = ca.if_else(symbol > limit, limit, symbol)
        if min is not None:
            limit = self._limit(name, "min", min, unit)
            symbol = ca.if_else(symbol < limit, limit, symbol)
        return symbol

    def _limit(self, name: str, which: str, value: float, unit: str | None) -> Any:
        """A limit of an input as a constant of the equations, in the input's unit."""
        symbol = self._symbols.sym(f"{name}.{which}")
        key = f"{which} of {name}"  # no name that a variable could have
        self._variables[key] = Variable(key, "constant", unit, "", start=(float(value),), symbol=symbol)
        return symbol

    @_declares
    def constant_input(
        self, name: str, unit: str | None, description: str, *, must_equal: float, display_unit: str | None = None
    ) -> None:
        """Declare an input that takes a constant of its source, for comparison: no equation uses it.

        A controller built for preview heights 30 ms apart says so with it. It starts at 0, which means that nothing is
        connected; the model description tells `must_equal`, with which a master can refuse a wrong source by name,
        and the FMU warns once when it gets another value than that and 0.
        """
        number(f"{self.name}.{name}: must_equal", must_equal, error=DeclarationError)
        self._add(
            name,
            "input",
            unit,
            description,
            (),
            start=np.zeros(()),
            must_equal=float(must_equal),
            display_unit=display_unit,
        )
        self.reference_inputs[name] = lambda _: must_equal

    @_declares
    def state(
        self,
        name: str,
        unit: str | None,
        description: str = "",
        *,
        start: Any = 0.0,
        shape: tuple[int, ...] = (),
        output: bool = False,
        nominal: float | None = None,
        min: float | None = None,
        max: float | None = None,
        display_unit: str | None = None,
        exposed: bool | None = None,
        rows: Sequence[str] = (),
        columns: Sequence[str] = (),
    ) -> Any:
        """Declare a state. Returns its symbol.

        `start` is a number or array (a start value the user may set) or a CasADi expression of parameters and
        inputs (a calculated start). States of discrete components are hidden unless `exposed`.
        `output=True` gives the variable output causality. `rows`, `columns` as of `parameter`.
        """
        calculated = isinstance(start, (ca.SX, ca.MX))
        if exposed is None:
            exposed = self.kind == "continuous"
        symbol = self._add(
            name,
            "state",
            unit,
            description,
            shape,
            start=None if calculated else np.broadcast_to(start, shape),
            min=min,
            max=max,
            nominal=nominal,
            display_unit=display_unit,
            output=output,
            exposed=exposed,
            rows=tuple(rows),
            columns=tuple(columns),
        )
        if calculated:
            self._starts[name] = self._flat(self._variables[name], start, "start")
        return symbol

    @_declares
    def initial_value(self, name: str, expression: Any, unit: str | None, description: str = "") -> Any:
        """Declare a discrete state that keeps what `expression` of parameters and inputs is at the start.

        Returns its symbol.
        """
        if self.kind != "discrete":
            raise DeclarationError(
                f"{self.name}: initial_value() is for discrete components; a continuous one has no first sample"
            )
        expression = self._symbols(expression)
        symbol = self.state(name, unit, description, start=expression, shape=_shape(expression))
        self._changes[name] = self._flat(self._variables[name], symbol, "initial_value")
        return symbol

    @_declares
    def derivative(self, state: Any, expression: Any, *, source: str = "") -> None:
        """Declare `d state/dt = expression` (continuous components).

        `source`: paper and number of the equation, for readers of the C code.
        """
        self._relate(state, expression, "continuous", "derivative", source)

    @_declares
    def update(self, state: Any, expression: Any, *, source: str = "") -> None:
        """Declare that `state` becomes `expression` after the sample instant (discrete components).

        `source`: as of `derivative`.
        """
        self._relate(state, expression, "discrete", "update", source)

    @_declares
    def value(self, name: str, expression: Any, *, source: str = "") -> Any:
        """Name an intermediate value and return it: the generated C calls it so, and has `source` above it.

        `source`: paper and number of its equation, or in a few words what it is.

        No variable of the FMU, and no other result. The name is one that C could have (`strut_force`), different from
        all others of this kind.
        """
        if not re.fullmatch(r"[A-Za-z_]\w*", name, re.ASCII):
            raise DeclarationError(f"{self.name}.{name}: the name of a value may contain only letters, digits and _")
        if name in self._values:
            raise DeclarationError(f"{self.name}.{name}: another value has this name already")
        self._values[name] = (self._symbols(expression), source)
        return expression

    def _explain(self, name: str, source: str) -> None:
        if source:
            self.equations[name] = source

    @_declares
    def output(
        self,
        name: str,
        expression: Any,
        unit: str | None,
        description: str,
        *,
        type: type = float,
        min: float | None = None,
        max: float | None = None,
        nominal: float | None = None,
        display_unit: str | None = None,
        source: str = "",
    ) -> None:
        """Declare an output by its expression (column vector or matrix expressions become array variables).

        `source`: paper and number of its equation, for readers of the C.
        """
        expression = self._symbols(expression)
        self._add(
            name,
            "output",
            unit,
            description,
            _shape(expression),
            start=None,
            type=_TYPES[type],
            min=min,
            max=max,
            nominal=nominal,
            display_unit=display_unit,
            output=True,
        )
        self._results[name] = expression
        self._explain(name, source)

    @_declares
    def quadratic_program(
        self,
        name: str,
        *,
        hessians: Sequence[Any],
        constraints: Sequence[Any],
        linear: Any,
        lower: Any,
        upper: Any,
        case: Any = None,
        terms: Sequence[tuple[Any, Any]] = (),
        backend: qp.Backend | Sequence[qp.Backend] | None = None,
    ) -> qp.Solution:
        """Solve `minimise 1/2 z'Hz + q'z subject to l <= A z <= u` at each sample (discrete components).

        Declares the outputs `NAME.status`, `NAME.iterations` and `NAME.residual`. The solver starts from the last
        solution, which is part of the instance's state; during initialization nothing is committed. With large matrices
        in `linear`, `lower`, `upper`, declare the component with `symbols=ca.MX`: SX would write one statement
        per element. In these three a scalar is repeated.

        Args:
            name: prefix of the outputs.
            hessians: constant H (n, n), symmetric positive definite, one per case.
            constraints: constant A (m, n), one per case or a single one for all.
            linear: q (n,), an expression of time, states, inputs and parameters.
            lower: l (m,), such an expression too. Bounds of 1e30 and beyond do not bind.
            upper: u (m,), likewise.
            case: expression for the case 0, 1, ... (rounded, clipped).
            terms: weights, each such an expression, and symmetric matrices (n, n): H is that of `hessians`, which then
                need not be definite, plus each matrix times its weight. DAQP factors it at each sample; where it is not
                positive definite, the status is 3.
            backend: `build_fmus.qp.Daqp` (default) or `build_fmus.qp.Osqp` with its settings; of
                several the first is used, and the others tell the settings when another one is chosen at build time.

        Returns:
            Symbols of solution, multipliers, status, iterations and residual, for outputs and updates.

        Raises:
            DeclarationError: wrong kind of component, shapes that do not match, a Hessian that is not positive
                definite, data that depend on the solution of a program.
        """
        where = f"{self.name}.{name}"
        if self.kind != "discrete":
            raise DeclarationError(f"{where}: quadratic programs are for discrete components")
        try:
            H, A = qp.checked_matrices(where, hessians, constraints, what="constant term" if terms else "Hessian")
            varying, _ = qp.checked_matrices(where, [H[0], *(m for _, m in terms)], A[:1], what="term")
        except qp.ProgramError as error:
            raise DeclarationError(str(error)) from None
        n, m = len(H[0]), len(A[0])
        if case is None and len(H) > 1:
            raise DeclarationError(f"{where}: {len(H)} Hessians, but no case to choose one; give case=...")
        columns = [
            self._column(where, what, expression, size)
            for what, expression, size in (("linear", linear, n), ("lower", lower, m), ("upper", upper, m))
        ]
        columns.append(self._column(where, "case", 0 if case is None else case, 1))
        columns += [self._column(where, "weight", w, 1) for w, _ in terms]
        data = ca.densify(ca.vertcat(*columns))
        if any(ca.depends_on(data, p.symbol) for p in self.programs):
            raise DeclarationError(
                f"{where}: its data depend on the solution of a quadratic program; keep it in a state and use it at the"
                " next sample"
            )
        backends = (qp.Daqp(),) if backend is None else tuple(backend) if isinstance(backend, Sequence) else (backend,)
        if not backends:
            raise DeclarationError(f"{where}: the list of back ends is empty; leave backend out for the default")
        if terms and any(b.name != "daqp" for b in backends):
            raise DeclarationError(f"{where}: only DAQP solves programs with terms; give backend=Daqp(...)")
        matrices = np.reshape(varying[1:], (-1, n, n))
        program = qp.QuadraticProgram(where, H, A, matrices, backends, data, self._symbols.sym(name, n + m + 3))
        self.programs.append(program)
        s = program.solution
        self.output(
            f"{name}.status",
            s.status,
            None,
            "outcome: 0 solved, 1 limit reached, 2 infeasible, 3 bad data",
            type=int,
            min=0,
            max=3,
        )
        self.output(
            f"{name}.iterations", s.iterations, None, "iterations of the solver and of its fallback", type=int, min=0
        )
        self.output(
            f"{name}.residual",
            s.residual,
            "1",
            "largest of primal, dual and complementarity residual, each divided by max(1, largest magnitude of its"
            " terms)",
            min=0.0,
        )
        return s

    @_declares
    def random_profiles(
        self,
        name: str,
        *,
        seed: Any,
        length: Any,
        spectra: Callable[[Any], tuple[Any, Any]],
        step: float,
        nodes: tuple[int, int],
        wave_numbers: tuple[float, float],
    ) -> tuple[Any, Any]:
        """Two random height profiles [m], left and right, as functions of parameters: sums of waves of random phase.

        The FMU computes them in each instance, again when a parameter changes (`build_fmus.random_profiles`).
        Declare the component with `symbols=ca.MX`. Discrete components only, one pair for each.

        Args:
            name: begins their names in the C code.
            seed: expression of parameters, a whole number from 0 on.
            spectra: of the wave number [cycles/m], one-sided power spectral densities [m3] of half the sum and half the
                difference of both profiles; expressions of it and of parameters.
            length: expression of parameters, what the profiles cover at least [m].
            step: distance between nodes [m].
            nodes: least and largest number of nodes, powers of two: of those between, the first that covers the length
                is taken. The profiles have waves at multiples of 1 / (nodes step).
            wave_numbers: lowest and highest [cycles/m].

        Returns:
            Columns of the heights of both at the nodes, to be indexed with whole numbers.

        Raises:
            DeclarationError: wrong kind of component or of numbers, settings that depend on more than parameters.
        """
        where = f"{self.name}.{name}"
        if self.kind != "discrete" or self._symbols is not ca.MX or self.profiles:
            raise DeclarationError(
                f"{where}: random profiles are for discrete components with symbols=ca.MX, once in each"
            )
        least, most = nodes
        if not 4 <= least <= most or any(n & (n - 1) for n in nodes):
            raise DeclarationError(f"{where}: nodes {nodes} must be powers of two from 4 on, the smaller one first")
        lowest, highest = wave_numbers
        number(f"{where}: step", step, "m", above=0, error=DeclarationError)
        number(f"{where}: highest wave number", highest, "1/m", above=lowest, most=0.5 / step, error=DeclarationError)
        wave_number = ca.MX.sym("wave_number")
        settings = ca.densify(ca.vertcat(self._symbols(seed), self._symbols(length)))
        densities = ca.densify(ca.vertcat(*(self._symbols(s) for s in spectra(wave_number))))
        if settings.shape != (2, 1) or densities.shape != (2, 1):
            raise DeclarationError(f"{where}: seed, length and both spectra must be numbers, not vectors")
        parameters = [v.symbol for v in self._variables.values() if v.role in ("parameter", "constant")]
        known, used = ca.vertcat(*parameters, wave_number), ca.symvar(ca.vertcat(settings, densities))
        free = [str(s) for s in used if not ca.depends_on(known, s)]
        if free:
            raise DeclarationError(f"{where}: profiles may depend on parameters only, not on {', '.join(free)}")
        symbol = ca.MX.sym(name, 2 * most)
        made = RandomProfiles(name, least, most, float(step), lowest, highest, wave_number, settings, densities, symbol)
        self.profiles.append(made)
        return symbol[:most], symbol[most:]

    @_declares
    def choose_backend(self, name: str) -> None:
        """Let all quadratic programs use the solver `name` (with its declared settings, or its defaults).

        A program with terms stays with DAQP.
        """
        for i, p in enumerate(self.programs):
            if len(p.terms):
                continue
            matching = [b for b in p.backends if b.name == name] or [qp.BACKENDS[name]()]
            rest = [b for b in p.backends if b.name != name]
            self.programs[i] = replace(p, backends=(*matching[:1], *rest))

    def _column(self, where: str, what: str, expression: Any, size: int) -> Any:
        if isinstance(expression, (np.ndarray, list, tuple, float, int)):
            expression = np.clip(np.asarray(expression, dtype=float), -qp.INFINITE, qp.INFINITE)
        expression = self._symbols(expression)
        if expression.numel() == 1:
            return ca.repmat(expression, size, 1)
        if not expression.is_vector() or expression.numel() != size:
            raise DeclarationError(f"{where}: {what} has shape {expression.shape}, not ({size},)")
        return ca.vec(expression)

    @_declares
    def operating_point(self, name: str, values: Mapping[str, float]) -> None:
        """Name a point (state or input -> value) where the build also checks solver stability.

        States and inputs that are not given are as at the start.
        """
        known = self._element_names("state", "input")
        for n in values:
            if n not in known:
                raise DeclarationError(
                    f"{self.name}: operating point {name!r} sets {n!r}, which is neither state nor input"
                )
        self.operating_points[name] = dict(values)

    @_declares
    def reference_input(self, signals: Mapping[str, Callable[[float], float]]) -> None:
        """Input signals over time for the reference result (`NAME_in.csv`); inputs without one keep their start."""
        known = self._element_names("input")
        for name in signals:
            if name not in known:
                raise DeclarationError(f"{self.name}: reference input for {name!r}, which is not an input")
        self.reference_inputs.update(signals)

    @_declares
    def check(self, positive: Any, message: str) -> None:
        """Refuse parameters and inputs that do not fit together: `positive` must be > 0 when initialization ends.

        For relations between variables, which `min` and `max` of one variable cannot express. `positive` is an
        expression of parameters, inputs and time; every element of it must be > 0. The FMU answers with an error and
        `message`, which names the variables and says what to do.
        """
        expression = ca.vec(self._symbols(positive))
        if not expression.numel():
            raise DeclarationError(f"{self.name}: check() has an empty expression ({message})")
        self._checks += [(e, message) for e in ca.vertsplit(expression)]

    def _add(
        self, name: str, role: Role, unit: str | None, description: str, shape: Any, *, start: Any, **rest: Any
    ) -> Any:
        where = f"{self.name}.{name}"
        if not _NAME.match(name):
            raise DeclarationError(f"{where}: not a legal structured name")
        if name in self._variables:
            raise DeclarationError(f"{where}: declared twice")
        if name == "time":
            raise DeclarationError(f"{where}: every FMU has this variable already; use component.time")
        shape = tuple(int(n) for n in shape)
        if any(n < 1 for n in shape) or len(shape) > 2:
            raise DeclarationError(f"{where}: shape {shape} must be a vector or matrix of positive size")
        try:
            if unit is not None:
                units.unit(unit)
            if rest.get("display_unit"):
                units.display_unit(unit or "", rest["display_unit"])
            for name_of_unit in (*rest.get("rows", ()), *rest.get("columns", ())):
                units.unit(name_of_unit)
        except KeyError as error:
            raise DeclarationError(f"{where}: {error.args[0]}") from None
        _check_rows(where, unit, shape, rest.get("rows", ()), rest.get("columns", ()))
        flat = None if start is None else tuple(float(v) for v in np.asarray(start, dtype=float).ravel())
        low, high = rest.get("min"), rest.get("max")
        for v in flat or ():
            number(f"{where}: start value", v, unit or "", least=low, most=high, error=DeclarationError)
        size = math.prod(shape)
        if role == "constant":  # of its shape: numbers take its place, and leave no trace of another order
            flat_symbol = symbol = self._symbols.sym(name, *(*shape, 1, 1)[:2])
            self._variables[name] = Variable(name, role, unit, description, shape, start=flat, symbol=symbol, **rest)
            self._handles[name] = symbol
            return symbol
        flat_symbol = self._symbols.sym(name, size)
        # Row-major elements; CasADi matrices are column-major.
        symbol = flat_symbol if len(shape) < 2 else ca.reshape(flat_symbol, shape[1], shape[0]).T
        variable = Variable(
            name, role, unit, description, shape, start=flat, slot=self._sizes[role], symbol=flat_symbol, **rest
        )
        self._variables[name] = variable
        self._handles[name] = symbol
        self._sizes[role] += size
        return symbol

    def _element_names(self, *roles: Role) -> set[str]:
        return {n for v in self._variables.values() if v.role in roles for n in v.element_names()}

    def _relate(self, state: Any, expression: Any, kind: Kind, verb: str, source: str) -> None:
        if self.kind != kind:
            raise DeclarationError(f"{self.name}: {verb}() is for {kind} components")
        for v in self._variables.values():
            if v.role == "state" and state is self._handles[v.name]:
                if v.name in self._changes:
                    raise DeclarationError(f"{self.name}.{v.name}: {verb} given twice")
                self._changes[v.name] = self._flat(v, expression, verb)
                self._explain(v.name, source)
                return
        raise DeclarationError(f"{self.name}: {verb}() needs the symbol that state() returned, unchanged")

    def _flat(self, v: Variable, expression: Any, what: str) -> Any:
        """`expression` as row-major column of the elements of `v`; a scalar is repeated."""
        expression = self._symbols(expression)
        if expression.numel() == 1:
            return ca.repmat(expression, v.size, 1)
        if len(v.shape) == 2 and tuple(expression.shape) == v.shape:
            return ca.vec(expression.T)
        if len(v.shape) == 1 and expression.is_vector() and expression.numel() == v.size:
            return ca.vec(expression)
        raise DeclarationError(
            f"{self.name}.{v.name}: {what} has shape {expression.shape}, not {v.shape or 'that of a scalar'}"
        )

    # ------------------------------------------------------------------ the model

    def declares(self, name: str) -> bool:
        """Whether there is a variable of this name so far."""
        return name in self._variables

    def known(self) -> tuple[Any, np.ndarray]:
        """Symbols (n,) of all elements of parameters and constants declared so far, and their values.

        For numbers that follow from a declaration, such as a rest position.
        """
        given = [v for v in self._variables.values() if v.role in ("parameter", "constant") and v.start is not None]

        def values(v: Variable) -> np.ndarray:
            start = np.array(v.start, dtype=float)
            return start.reshape(v.shape).T.ravel() if v.role == "constant" and len(v.shape) == 2 else start

        return ca.vertcat(*(ca.vec(v.symbol) for v in given)), np.concatenate([values(v) for v in given])

    def variable(self, name: str) -> Variable:
        """Declared variable by name; KeyError proposing the nearest name."""
        return named(self.name, self._variables, name)

    def reword(self, words: Callable[[str], str]) -> None:
        """Change description and notes; sources of values stay as they are."""
        self.description, self.notes, self._model = words(self.description), tuple(map(words, self.notes)), None

    def model(self) -> Model:
        """The frozen model, which everything else reads.

        The first call ends the declaration; later ones return the same model.

        Raises:
            DeclarationError: a state without derivative or update.
        """
        if self._model is None:
            states = [v.name for v in self._variables.values() if v.role == "state"]
            if missing := [n for n in states if n not in self._changes]:
                verb = "derivative" if self.kind == "continuous" else "update"
                raise DeclarationError(f"{self.name}: no {verb} for state(s) {', '.join(missing)}")
            self._model = Model(
                name=self.name,
                kind=self.kind,
                description=self.description,
                source=self.source,
                sample_time=self.sample_time,
                solver=self.solver,
                solver_step=self.solver_step,
                exchange_step=self.exchange_step,
                stop_time=self.stop_time,
                notes=tuple(self.notes),
                all_variables=tuple(self._variables.values()),
                symbols=self._symbols,
                time=self.time,
                starts=MappingProxyType(dict(self._starts)),
                changes=MappingProxyType({n: self._changes[n] for n in states}),
                results=MappingProxyType(dict(self._results)),
                checks=tuple(self._checks),
                values=MappingProxyType(dict(self._values)),
                equations=MappingProxyType(dict(self.equations)),
                programs=tuple(self.programs),
                profiles=tuple(self.profiles),
                reference_inputs=MappingProxyType(dict(self.reference_inputs)),
                operating_points=MappingProxyType(dict(self.operating_points)),
                provenance=MappingProxyType(dict(self.provenance)),
                bibliography=MappingProxyType(dict(self.bibliography)),
            )
        return self._model

    def check_dimensions(self) -> Dimensions:
        """Refuse expressions that do not scale as the units of their variables do, and tell what was checked.

        Builds make this check too.

        Raises:
            DeclarationError: naming variables, their units, and the powers of base units that they really have.
        """
        self.model().dimensions.check()
        return self.model().dimensions

    def linearize(
        self, x: np.ndarray | None = None, u: np.ndarray | None = None, p: np.ndarray | None = None
    ) -> Linearization:
        """`Model.linearize` of the model."""
        return self.model().linearize(x, u, p)


def _check_rows(
    where: str, unit: str | None, shape: tuple[int, ...], rows: Sequence[str], columns: Sequence[str]
) -> None:
    """Refuse units by row and column that do not fit."""
    if (rows or columns) and (unit is not None or (len(rows), *([len(columns)] if columns else [])) != shape):
        raise DeclarationError(
            f"{where}: {len(rows)} row units and {len(columns)} column units need unit None and a shape of those"
            f" sizes, not unit {unit!r} and shape {shape}"
        )


def _shape(expression: Any) -> tuple[int, ...]:
    """Shape of the variable that an expression gives: scalar, vector for a column, matrix."""
    if expression.is_scalar():
        return ()
    rows, columns = expression.shape
    return (rows,) if columns == 1 else (rows, columns)
