"""The builder of a component: what users write a declaration with, and what is derived from it."""

from __future__ import annotations

import difflib
import math
import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import replace
from functools import cached_property
from typing import Any

import numpy as np

from build_fmus import extras, qp, units
from build_fmus.component.linear import Linearization
from build_fmus.component.variables import (
    BaseType,
    DeclarationError,
    Element,
    Kind,
    Role,
    Solver,
    Variable,
    source_fault,
)

with extras.needed("build", extras.BUILDING):
    import casadi as ca

_NAME = re.compile(r"^[A-Za-z_]\w*(\.[A-Za-z_]\w*)*$", re.ASCII)
_JACOBIAN_UP_TO = 10_000  # operations of `fwd`: beyond it a Jacobian in one piece would double the size of the FMU
_TYPES: dict[type, BaseType] = {float: "Float64", int: "Int32", bool: "Boolean"}


class Component:
    """Declaration of one FMU. See the module docstring for an example.

    Args:
        name: FMU name, UpperCamelCase; also the C model identifier.
        kind: ``"continuous"`` (derivatives) or ``"discrete"`` (update with a sample period).
        description: one line for the model description.
        source: where the equations come from (paper and equation numbers).
        sample_time: period [s]; discrete components only.
        solver, solver_step: fixed-step integrator and its largest step [s]; continuous components only. ``"rk4"``: classic
            Runge-Kutta, for smooth dynamics slower than the step. ``"am2"``: Adams-Bashforth-2 predictor,
            Adams-Moulton-2 corrector. ``"ros2"``: linearly implicit Rosenbrock method of order 2 with the exact Jacobian,
            L-stable, for stiff components with few states (a dense n x n system is solved twice per step); give its
            states ``nominal`` values. ``"semi_implicit"``: Stoermer-Verlet (leapfrog) with midpoint velocities, order 2, for
            mechanical systems with contacts: positions (states whose derivative is another state) and velocities
            advance in turn, so that undamped vibrations neither grow nor decay below ``step * omega = 2``.
        exchange_step: communication step [s] proposed to tools (default experiment).
        symbols: ``ca.SX`` (default, no overhead) or ``ca.MX`` where lookup tables are needed.
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
            raise DeclarationError(f"{name}: a sample_time is for discrete components, and only for those")
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
        self._sizes: dict[Role, int] = {"parameter": 0, "input": 0, "state": 0, "output": 0}
        self._next: dict[str, Any] = {}  # state name -> derivative or update expression
        self._values: dict[str, tuple[Any, str]] = {}  # intermediate values by name, with the source of their equations
        self.equations: dict[str, str] = {}  # output or state -> where its equation comes from
        self._start: dict[str, Any] = {}  # state name -> start expression of parameters and inputs
        self._outputs: dict[str, Any] = {}
        self.programs: list[qp.QuadraticProgram] = []
        self._checks: list[tuple[Any, str]] = []
        self.stimulus: dict[str, Callable[[float], float]] = {}
        self.operating_points: dict[str, dict[str, float]] = {"start": {}}
        if kind == "continuous":  # the runtime finds it in the first slot
            self.parameter(
                "solver.step", solver_step, "s", f"largest step of the fixed-step solver ({solver})", min=1e-6,
                max=1e-2, source="build option",
            )  # fmt: skip

    # ------------------------------------------------------------------ declaring

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
    ) -> Any:
        """Declare a parameter; shape and type follow from ``start`` (float, int, bool or array). Returns its symbol.

        ``source`` says where the value comes from (paper and table, "measured", "assumed"); it goes into the model
        description, and without one the parameter is refused.
        """
        if fault := source_fault(source):
            raise DeclarationError(f"{self.name}.{name}: source: {fault}")
        array = np.asarray(start)
        kind = bool if array.dtype == bool else int if array.dtype.kind == "i" else float
        return self._add(
            name, "parameter", unit, description, array.shape, start=array, type=_TYPES[kind], min=min, max=max,
            nominal=nominal, display_unit=display_unit, tunable=tunable, source=source,
        )  # fmt: skip

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
    ) -> Any:
        """Declare an input (vector when ``shape`` is given). Returns what the equations are written with.

        A real input with ``min`` or ``max`` is clipped to them in the equations, so that a solver that overshoots by a
        hair does no harm: the FMU takes any finite value, warns once, and its derivatives are 0 beyond a limit.
        Integers and Booleans are refused outside their range.
        """
        kind = _TYPES[type]
        symbol = self._add(
            name, "input", unit, description, shape, start=np.broadcast_to(start, shape), type=kind, min=min, max=max,
            nominal=nominal, display_unit=display_unit,
        )  # fmt: skip
        if kind != "Float64":
            return symbol
        # Not fmin and fmax: at a limit itself the derivative is that of the inside.
        if max is not None:
            symbol = ca.if_else(symbol > max, max, symbol)
        if min is not None:
            symbol = ca.if_else(symbol < min, min, symbol)
        return symbol

    def constant_input(
        self, name: str, unit: str | None, description: str, *, must_equal: float, display_unit: str | None = None
    ) -> None:
        """Declare an input that takes a constant of its source, for comparison: no equation uses it.

        A controller built for preview heights 30 ms apart says so with it. It starts at 0, which means that nothing is
        connected; the model description tells ``must_equal``, with which a master can refuse a wrong source by name, and
        the FMU warns once when it gets another value than that and 0.
        """
        if not math.isfinite(must_equal):
            raise DeclarationError(f"{self.name}.{name}: must_equal is {must_equal}")
        self._add(
            name, "input", unit, description, (), start=np.zeros(()), must_equal=float(must_equal), display_unit=display_unit
        )  # fmt: skip
        self.stimulus[name] = lambda _: must_equal

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
    ) -> Any:
        """Declare a state. Returns its symbol.

        ``start`` is a number or array (a start value the user may set) or a CasADi expression of parameters and
        inputs (a calculated start). States of discrete components are hidden unless ``exposed``.
        ``output=True`` gives the variable output causality.
        """
        calculated = isinstance(start, (ca.SX, ca.MX))
        if exposed is None:
            exposed = self.kind == "continuous"
        symbol = self._add(
            name, "state", unit, description, shape,
            start=None if calculated else np.broadcast_to(start, shape), min=min, max=max, nominal=nominal,
            display_unit=display_unit, output=output, exposed=exposed,
        )  # fmt: skip
        if calculated:
            self._start[name] = self._flat(self._variables[name], start, "start")
        return symbol

    def derivative(self, state: Any, expression: Any, *, source: str = "") -> None:
        """``d state/dt = expression`` (continuous components); ``source``: paper and number of the equation, for readers of the C."""
        self._relate(state, expression, "continuous", "derivative", source)

    def update(self, state: Any, expression: Any, *, source: str = "") -> None:
        """``state`` after the sample instant ``= expression`` (discrete components); ``source`` as of :meth:`derivative`."""
        self._relate(state, expression, "discrete", "update", source)

    def value(self, name: str, expression: Any, *, source: str = "") -> Any:
        """Name an intermediate value and return it: the generated C calls it so; ``source`` as of :meth:`derivative`.

        No variable of the FMU, and no other result. The name is one that C could have (``strut_force``), different from all others
        of this kind.
        """
        if not re.fullmatch(r"[A-Za-z_]\w*", name, re.ASCII):
            raise DeclarationError(f"{self.name}.{name}: the name of a value has letters, digits and _ only")
        if name in self._values:
            raise DeclarationError(f"{self.name}.{name}: two values of this name")
        self._values[name] = (self._symbols(expression), source)
        self.__dict__.pop("functions", None)
        return expression

    @property
    def value_sources(self) -> dict[str, str]:
        """Names of the intermediate values, in the order of ``functions["values"]``, with the sources of their equations."""
        return {name: source for name, (_, source) in self._values.items()}

    def _explain(self, name: str, source: str) -> None:
        if source:
            self.equations[name] = source

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

        ``source``: paper and number of its equation, for readers of the C.
        """
        expression = self._symbols(expression)
        shape: tuple[int, ...] = () if expression.is_scalar() else tuple(expression.shape)
        if len(shape) == 2 and shape[1] == 1:
            shape = shape[:1]
        self._add(
            name, "output", unit, description, shape, start=None, type=_TYPES[type], min=min, max=max, nominal=nominal,
            display_unit=display_unit, output=True,
        )  # fmt: skip
        self._outputs[name] = expression
        self._explain(name, source)

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
        backend: qp.Backend | Sequence[qp.Backend] | None = None,
    ) -> qp.Solution:
        """Solve ``minimise 1/2 z'Hz + q'z subject to l <= A z <= u`` at each sample (discrete components).

        Declares the outputs ``NAME.status``, ``NAME.iterations`` and ``NAME.residual``. The solver starts from the last
        solution, which is part of the instance's state; during initialization nothing is committed. With large matrices
        in ``linear``, ``lower``, ``upper``, declare the component with ``symbols=ca.MX``: SX would write one statement
        per element.

        Args:
            name: prefix of the outputs.
            hessians: constant H (n, n), symmetric positive definite, one per case.
            constraints: constant A (m, n), one per case or a single one for all.
            linear, lower, upper: q (n,), l (m,), u (m,) as expressions of time, states, inputs and parameters; a scalar is
                repeated. Bounds of 1e30 and beyond do not bind.
            case: expression for the case 0, 1, ... (rounded, clipped).
            backend: :class:`~build_fmus.qp.Daqp` (default) or :class:`~build_fmus.qp.Osqp` with its settings; of several the
                first is used, and the others tell the settings when another one is chosen at build time.

        Returns:
            Symbols of solution, multipliers, status, iterations and residual, for outputs and updates.

        Raises:
            DeclarationError: wrong kind of component, shapes that do not match, a Hessian that is not positive definite,
                data that depend on the solution of a program.
        """
        where = f"{self.name}.{name}"
        if self.kind != "discrete":
            raise DeclarationError(f"{where}: quadratic programs are for discrete components")
        try:
            H, A = qp.checked_matrices(where, hessians, constraints)
        except qp.ProgramError as error:
            raise DeclarationError(str(error)) from None
        n, m = len(H[0]), len(A[0])
        if case is None and len(H) > 1:
            raise DeclarationError(f"{where}: {len(H)} Hessians need a case")
        columns = [
            self._column(where, what, expression, size)
            for what, expression, size in (("linear", linear, n), ("lower", lower, m), ("upper", upper, m))
        ]
        data = ca.densify(ca.vertcat(*columns, self._column(where, "case", 0 if case is None else case, 1)))
        if any(ca.depends_on(data, p.symbol) for p in self.programs):
            raise DeclarationError(
                f"{where}: its data depend on the solution of a quadratic program; keep it in a state and use it at the "
                "next sample"
            )
        backends = (qp.Daqp(),) if backend is None else tuple(backend) if isinstance(backend, Sequence) else (backend,)
        if not backends:
            raise DeclarationError(f"{where}: an empty list of back ends")
        program = qp.QuadraticProgram(where, H, A, backends, data, self._symbols.sym(name, n + m + 3))
        self.programs.append(program)
        s = program.solution
        self.output(
            f"{name}.status", s.status, None, "outcome: 0 solved, 1 limit reached, 2 infeasible, 3 bad data", type=int,
            min=0, max=3,
        )  # fmt: skip
        self.output(
            f"{name}.iterations", s.iterations, None, "iterations of the solver and of its fallback", type=int, min=0
        )
        self.output(
            f"{name}.residual", s.residual, "1",
            "largest of primal, dual and complementarity residual, each divided by max(1, largest magnitude of its terms)",
            min=0.0,
        )  # fmt: skip
        return s

    def choose_backend(self, name: str) -> None:
        """Let all quadratic programs use the solver ``name`` (with its declared settings, or its defaults)."""
        for i, p in enumerate(self.programs):
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

    def operating_point(self, name: str, **values: float) -> None:
        """Name a point (variable name with ``__`` for ``.`` -> value) where the build also checks solver stability."""
        self.operating_points[name] = {k.replace("__", "."): v for k, v in values.items()}

    def stimulate(self, signals: Mapping[str, Callable[[float], float]]) -> None:
        """Input signals over time for the reference result (``NAME_in.csv``); inputs without one keep their start."""
        for name in signals:
            if name not in (e.name for e in self.elements("input")):
                raise DeclarationError(f"{self.name}: stimulus for {name!r}, which is not an input")
        self.stimulus.update(signals)

    def check(self, positive: Any, message: str) -> None:
        """Refuse parameters and inputs that do not fit together: ``positive`` must be > 0 when initialization ends.

        For relations between variables, which ``min`` and ``max`` of one variable cannot express. ``positive`` is an
        expression of parameters, inputs and time; every element of it must be > 0. The FMU answers with an error and
        ``message``, which names the variables and says what to do.
        """
        expression = ca.vec(self._symbols(positive))
        if not expression.numel():
            raise DeclarationError(f"{self.name}: check() of nothing ({message})")
        self._checks += [(e, message) for e in ca.vertsplit(expression)]
        for derived in ("functions", "dependencies", "initial_dependencies", "_jacobians"):
            self.__dict__.pop(derived, None)

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
        except KeyError as error:
            raise DeclarationError(f"{where}: {error.args[0]}") from None
        flat = None if start is None else tuple(float(v) for v in np.asarray(start, dtype=float).ravel())
        low, high = rest.get("min"), rest.get("max")
        for v in flat or ():
            if not math.isfinite(v):
                raise DeclarationError(f"{where}: start value {v} is not finite")
            if (low is not None and v < low) or (high is not None and v > high):
                raise DeclarationError(f"{where}: start value {v:g} lies outside [{low}, {high}]")
        size = math.prod(shape)
        flat_symbol = self._symbols.sym(name, size)
        # Row-major elements; CasADi matrices are column-major.
        symbol = flat_symbol if len(shape) < 2 else ca.reshape(flat_symbol, shape[1], shape[0]).T
        variable = Variable(
            name, role, unit, description, shape, start=flat, slot=self._sizes[role], symbol=flat_symbol, **rest
        )
        self._variables[name] = variable
        self._handles[name] = symbol
        self._sizes[role] += size
        for derived in ("functions", "dependencies", "initial_dependencies", "_jacobians"):
            self.__dict__.pop(derived, None)
        return symbol

    def _relate(self, state: Any, expression: Any, kind: Kind, verb: str, source: str) -> None:
        if self.kind != kind:
            raise DeclarationError(f"{self.name}: {verb}() is for {kind} components")
        for v in self._variables.values():
            if v.role == "state" and state is self._handles[v.name]:
                if v.name in self._next:
                    raise DeclarationError(f"{self.name}.{v.name}: {verb} given twice")
                self._next[v.name] = self._flat(v, expression, verb)
                self._explain(v.name, source)
                return
        raise DeclarationError(f"{self.name}: {verb}() needs the very symbol that state() returned")

    def _flat(self, v: Variable, expression: Any, what: str) -> Any:
        """``expression`` as row-major column of the elements of ``v``; a scalar is repeated."""
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

    # ------------------------------------------------------------------ reading

    @property
    def variables(self) -> list[Variable]:
        """Declared variables by role (time, parameters, inputs, states, derivatives, outputs) without hidden states."""
        groups: dict[Role, list[Variable]] = {r: [] for r in ("parameter", "input", "state", "derivative", "output")}
        for v in self._variables.values():
            if v.exposed:
                groups[v.role].append(v)
        if self.kind == "continuous":
            groups["derivative"] = [self._derivative_variable(v) for v in groups["state"]]
        time = Variable("time", "time", "s", "simulation time")
        return [time, *(v for g in groups.values() for v in g)]

    @property
    def all_variables(self) -> list[Variable]:
        """Every declared variable in declaration order, hidden states included."""
        return list(self._variables.values())

    @staticmethod
    def _derivative_variable(v: Variable) -> Variable:
        unit = units.unit(v.unit) if v.unit else None
        match = None
        if unit is not None:
            want = {**unit.exponents, "s": unit.exponents.get("s", 0) - 1}
            want = {k: e for k, e in want.items() if e}
            match = next((u.name for u in units.UNITS.values() if u.exponents == want and u.factor == 1.0), None)
        return Variable(
            f"der({v.name})", "derivative", match, f"time derivative of {v.name}", v.shape, slot=v.slot,
            derivative_of=v.name,
        )  # fmt: skip

    def elements(self, *roles: Role) -> list[Element]:
        """Scalar elements of the given roles (all when none is given), in value-reference order."""
        return [
            Element(n, v, i)
            for v in self.variables
            if not roles or v.role in roles
            for i, n in enumerate(v.element_names())
        ]

    @property
    def constant_inputs(self) -> list[Variable]:
        """Inputs that take a constant of their source."""
        return [v for v in self.variables if v.must_equal is not None]

    @property
    def clipped_inputs(self) -> list[Variable]:
        """Inputs that the equations clip to their range."""
        inputs = [v for v in self.variables if v.role == "input" and v.type == "Float64"]
        return [v for v in inputs if v.min is not None or v.max is not None]

    def constant_outputs(self) -> dict[str, float]:
        """Output elements whose value is a number known now, such as the step of a preview."""
        constant = {n: e for n, e in self._outputs.items() if e.is_constant()}
        return {
            element: float(value)
            for name, e in constant.items()
            for element, value in zip(
                self._variables[name].element_names(), np.asarray(ca.evalf(e).full()).ravel(), strict=True
            )
        }

    def output_elements(self) -> list[Element]:
        """Everything with output causality: states declared as outputs, then declared outputs."""
        return [e for e in self.elements("state", "output") if e.variable.output]

    def variable(self, name: str) -> Variable:
        """Variable by name; KeyError proposing the nearest name."""
        try:
            return self._variables[name]
        except KeyError:
            near = difflib.get_close_matches(name, self._variables, n=1)
            hint = f"; did you mean {near[0]!r}?" if near else ""
            raise KeyError(f"{self.name} has no variable {name!r}{hint}") from None

    def size(self, role: Role) -> int:
        """Number of scalars of a role, hidden ones included."""
        return self._sizes[role]

    def vector(self, role: Role) -> np.ndarray:
        """Start values of a role as one vector; hidden and calculated elements are 0."""
        out = np.zeros(self._sizes[role])
        for v in self._variables.values():
            if v.role == role and v.start is not None:
                out[v.slot : v.slot + v.size] = v.start
        return out

    def _symbol(self, role: Role) -> Any:
        parts = [v.symbol for v in self._variables.values() if v.role == role]
        return ca.vertcat(*parts) if parts else self._symbols(0, 1)

    @cached_property
    def functions(self) -> dict[str, ca.Function]:
        """The component's functions, all of them with dense column vectors:

        ``start (x, u, p) -> x0``: start state (declared starts pass through, calculated ones are evaluated);
        ``rhs (t, x, u, p) -> dx`` (continuous) or ``update (t, x, u, p) -> x_next`` and
        ``tick (t, x, u, p) -> x_next, y`` (discrete); ``out (t, x, u, p) -> y``; with quadratic programs these three take
        their solutions as fifth argument, and ``programs (t, x, u, p) -> data`` has q, l, u, case of each;
        ``fwd (t, x, u, p, dx, du, dp) -> d rhs, d y`` and ``fwd_start (x, u, p, dx, du, dp) -> d x0`` (continuous);
        ``jac (t, x, u, p) -> d rhs/dx, d rhs/dt`` (solver ``ros2``, and wherever its code stays short);
        ``check (t, x, u, p) -> values`` that must be > 0 when initialization ends (components with checks);
        ``values (t, x, u, p) -> v1, v2, ...``: what :meth:`value` has named, in this order (with solutions as ``out``).

        Raises:
            DeclarationError: a state without derivative/update, or an expression with an undeclared symbol.
        """
        verb = "derivative" if self.kind == "continuous" else "update"
        states = [v for v in self._variables.values() if v.role == "state"]
        missing = [v.name for v in states if v.name not in self._next]
        if missing:
            raise DeclarationError(f"{self.name}: no {verb} for state(s) {', '.join(missing)}")
        empty = self._symbols(0, 1)
        t, x, u, p = self.time, *(self._symbol(r) for r in ("state", "input", "parameter"))

        def column(parts: list[Any]) -> Any:
            return ca.densify(ca.vertcat(*parts)) if parts else empty

        nxt = column([self._next[v.name] for v in states])
        # Row-major output elements: vec() of the transpose.
        y = column([ca.vec(self._outputs[v.name].T) for v in self._variables.values() if v.role == "output"])
        x0 = column([self._start.get(v.name, v.symbol) for v in states])
        functions: dict[str, ca.Function] = {}

        def add(name: str, args: list[Any], outs: list[Any]) -> None:
            if self._symbols is ca.SX and self.kind == "continuous":
                outs = ca.cse(outs)  # what two expressions share is computed once: derivatives shrink to half
            try:
                functions[name] = ca.Function(f"fmu_{name}", args, outs)
            except RuntimeError as error:
                free = ", ".join(
                    str(s)
                    for e in outs
                    for s in ca.symvar(e)
                    if not any(ca.depends_on(a, s) for a in args if a.numel())
                )
                raise DeclarationError(f"{self.name}: {name} uses undeclared symbols ({free or error})") from None

        solutions = [ca.vertcat(*(q.symbol for q in self.programs))] if self.programs else []
        add("start", [x, u, p], [x0])
        add("out", [t, x, u, p, *solutions], [y])
        if self.kind == "continuous":
            add("rhs", [t, x, u, p], [nxt])
            dx, du, dp = (self._symbols.sym(f"d{n}", s.numel()) for n, s in (("x", x), ("u", u), ("p", p)))
            knowns, seeds = ca.vertcat(x, u, p), ca.vertcat(dx, du, dp)
            add("fwd", [t, x, u, p, dx, du, dp], [ca.densify(ca.jtimes(e, knowns, seeds)) for e in (nxt, y)])
            add("fwd_start", [x, u, p, dx, du, dp], [ca.densify(ca.jtimes(x0, knowns, seeds))])
            if self.solver == "ros2" or functions["fwd"].n_instructions() <= _JACOBIAN_UP_TO:
                add("jac", [t, x, u, p], [ca.densify(ca.jacobian(nxt, v)) for v in (x, t)])
        else:
            add("update", [t, x, u, p, *solutions], [nxt])
            add("tick", [t, x, u, p, *solutions], [nxt, y])
            if self.programs:
                add("programs", [t, x, u, p], [column([q.data for q in self.programs])])
        if self._values:
            add("values", [t, x, u, p, *solutions], [ca.densify(e) for e, _ in self._values.values()])
        if self._checks:
            add("check", [t, x, u, p], [column([e for e, _ in self._checks])])
            if any(ca.depends_on(e, x) for e, _ in self._checks if x.numel()):
                raise DeclarationError(f"{self.name}: a check may depend on parameters, inputs and time, not on states")
        return functions

    @property
    def check_messages(self) -> list[str]:
        """What to say when an element of ``functions["check"]`` is not > 0."""
        return [m for _, m in self._checks]

    def failed_checks(self, u: np.ndarray | None = None, p: np.ndarray | None = None) -> list[str]:
        """Messages of the checks that inputs ``u`` and parameters ``p`` (start values by default) do not pass."""
        if not self._checks:
            return []
        u = self.vector("input") if u is None else np.asarray(u, float)
        p = self.vector("parameter") if p is None else np.asarray(p, float)
        values = np.asarray(self.functions["check"](0.0, self.vector("state"), u, p)).ravel()
        return [m for m, value in zip(self.check_messages, values, strict=True) if not value > 0]

    @cached_property
    def velocity_of(self) -> np.ndarray:
        """For each state the slot of the state that is its derivative, or -1: positions and velocities of a mechanism.

        A state is a position when its derivative is one other state and nothing else. That other state must not be a
        position itself; chains of integrators (jerk, acceleration, velocity) count from the top.
        """
        n = self._sizes["state"]
        result = np.full(n, -1)
        if self.kind != "continuous" or not n:
            return result
        f = self.functions["rhs"]
        args = [
            self._symbols.sym(k, size)
            for k, size in zip("txup", (1, n, self.size("input"), self.size("parameter")), strict=True)
        ]
        rows: list[list[int]] = [[] for _ in range(n)]
        for r, column in zip(*ca.jacobian_sparsity(f(*args), ca.vertcat(*args)).get_triplet(), strict=True):
            rows[r].append(column - 1)
        points = [np.random.default_rng(seed).uniform(0.5, 1.5, n) for seed in (1, 2)]
        values = [np.asarray(f(0.0, x, self.vector("input"), self.vector("parameter"))).ravel() for x in points]
        driver = {}
        for i, known in enumerate(rows):
            if len(known) == 1 and 0 <= known[0] < n and known[0] != i:
                j = known[0]
                if all(v[i] == x[j] for v, x in zip(values, points, strict=True)):
                    driver[i] = j

        def is_position(i: int, seen: tuple[int, ...] = ()) -> bool:
            return i in driver and i not in seen and not is_position(driver[i], (*seen, i))

        for i, j in driver.items():
            if is_position(i):
                result[i] = j
        return result

    # ------------------------------------------------------------------ derived models

    @cached_property
    def dependencies(self) -> dict[str, list[str]]:
        """Exact structural dependencies from the sparsity pattern.

        Maps each output and derivative element to what it depends on directly: continuous states, inputs and ``time``
        (discrete components: inputs and ``time``, by feed-through at a sample instant).
        """
        roles: tuple[Role, ...] = ("time", "state", "input") if self.kind == "continuous" else ("time", "input")
        return self._structure(*roles, initial=False)

    @cached_property
    def initial_dependencies(self) -> dict[str, list[str]]:
        """As :attr:`dependencies`, during initialization: of time, parameters, inputs and settable start values."""
        return self._structure("time", "state", "input", "parameter", initial=True)

    def _structure(self, *roles: Role, initial: bool) -> dict[str, list[str]]:
        f = self.functions
        t = self._symbols.sym("t")
        roles_of: dict[str, Role] = {"x": "state", "u": "input", "p": "parameter"}
        x, u, p = (self._symbols.sym(n, self._sizes[r]) for n, r in roles_of.items())
        x_at = f["start"](x, u, p) if initial else x
        solutions = [self._symbols.sym("s", sum(q.n_solution for q in self.programs))] if self.programs else []
        vectors = {"output": f["out"](t, x_at, u, p, *solutions)}
        if self.kind == "continuous":
            vectors["derivative"] = f["rhs"](t, x_at, u, p)
        if initial:
            vectors["state"] = f["start"](x, u, p)
        knowns = ca.vertcat(t, x, u, p)
        names: list[str | None] = [None] * knowns.numel()
        nx, nu = x.numel(), u.numel()
        offset: dict[Role, int] = {"time": 0, "state": 1, "input": 1 + nx, "parameter": 1 + nx + nu}
        for e in self.elements(*roles):
            if not (initial and e.variable.role == "state" and e.start is None):
                names[offset[e.variable.role] + e.slot] = e.name
        of_solution: list[set[int]] = []  # knowns behind each element of the solutions
        if self.programs:
            data = _pattern(f["programs"](t, x_at, u, p), knowns)
            first = 0
            for q in self.programs:
                of_solution += [set().union(*data[first : first + q.n_data])] * q.n_solution
                first += q.n_data
        result: dict[str, list[str]] = {}
        for role, expr in vectors.items():
            rows = _pattern(expr, knowns)
            if role == "output":
                for row, used in zip(rows, _pattern(expr, *solutions) if solutions else (), strict=False):
                    row.update(*(of_solution[c] for c in used))
            for e in self.elements(role):  # type: ignore[arg-type]
                result[e.name] = [n for c in sorted(rows[e.slot]) if (n := names[c]) is not None]
        if not initial:  # a state that is an output depends on itself alone
            for e in self.elements("state"):
                if e.variable.output:
                    result[e.name] = [e.name] if self.kind == "continuous" else []
        return result

    def linearize(
        self, x: np.ndarray | None = None, u: np.ndarray | None = None, p: np.ndarray | None = None
    ) -> Linearization:
        """Linear model about ``(x, u, p)`` (start values by default); C and D cover all output elements in order.

        ``x`` None means the start state for ``u`` and ``p``. Continuous components only.
        """
        if self.kind != "continuous":
            raise DeclarationError(f"{self.name}: only continuous components have a linear model here")
        u = self.vector("input") if u is None else np.asarray(u, float)
        p = self.vector("parameter") if p is None else np.asarray(p, float)
        if x is None:
            x = np.asarray(self.functions["start"](self.vector("state"), u, p)).ravel()
        nx, nu = self._sizes["state"], self._sizes["input"]
        jac = self._jacobians
        A, B, Cy, Dy = (np.asarray(ca.DM(m).full()) for m in jac(0.0, x, u, p))
        outs = self.output_elements()
        C, D = np.zeros((len(outs), nx)), np.zeros((len(outs), nu))
        for i, e in enumerate(outs):
            if e.variable.role == "state":
                C[i, e.slot] = 1.0
            else:
                C[i], D[i] = Cy[e.slot], Dy[e.slot]
        names = [[e.name for e in self.elements(r)] for r in ("state", "input")]  # type: ignore[arg-type]
        return Linearization(A, B, C, D, names[0], names[1], [e.name for e in outs])

    @cached_property
    def _jacobians(self) -> ca.Function:
        t = self._symbols.sym("t")
        roles: dict[str, Role] = {"x": "state", "u": "input", "p": "parameter"}
        x, u, p = (self._symbols.sym(n, self._sizes[r]) for n, r in roles.items())
        dx, y = self.functions["rhs"](t, x, u, p), self.functions["out"](t, x, u, p)
        blocks = [ca.densify(ca.jacobian(e, v)) for e, v in ((dx, x), (dx, u), (y, x), (y, u))]
        return ca.Function("jacobians", [t, x, u, p], blocks)


def _pattern(expression: Any, knowns: Any) -> list[set[int]]:
    """For each row of a column expression the elements of ``knowns`` it depends on."""
    rows: list[set[int]] = [set() for _ in range(expression.numel())]
    if expression.numel() and knowns.numel():
        for r, c in zip(*ca.jacobian_sparsity(expression, knowns).get_triplet(), strict=True):
            rows[r].add(c)
    return rows
