"""The C functions of one component, with the structs and constant arrays that they share."""

from __future__ import annotations

import textwrap
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, replace

from build_fmus import random_profiles
from build_fmus.base import extras
from build_fmus.base.escape import c_comment
from build_fmus.component import Model, Role, Variable
from build_fmus.equations.casadi_code import casadi_code
from build_fmus.equations.graph import GATHER, Graph, Result, UnknownOperationError
from build_fmus.equations.names import WIDTH, Struct
from build_fmus.equations.operators import CONDITIONS
from build_fmus.equations.statements import Name, Statements, Target
from build_fmus.equations.values import Tables

with extras.needed("build", extras.BUILDING):
    import casadi as ca

_STRUCTS: dict[Role, tuple[str, str]] = {
    "parameter": ("p", "Parameters"),
    "input": ("u", "Inputs"),
    "state": ("x", "States"),
    "output": ("y", "Outputs"),
}
# What functions are given, by the pointer to it, and the vector of which it is one.
_ARGUMENTS = {"x": "x", "u": "u", "p": "p", "f": "f", "s": "s", "c": "c", "dx": "x", "du": "u", "dp": "p"}
_INPUTS = {
    "start": ("x", "u", "p"),
    "fwd": ("t", "x", "u", "p", "dx", "du", "dp"),
    "fwd_start": ("x", "u", "p", "dx", "du", "dp"),
}
# What copies and gradients need, and no other functions but the Jacobian of a solver that solves with it.
_IN_LANES = ("fixed", *random_profiles.FUNCTIONS, "start", "out", "rhs", "programs", "tick")
_ARGUMENT_CODE = {"t": "&at->t", "c": "profiles(at)"}  # of others: at->NAME


@dataclass(frozen=True)
class _Part:
    """One C function of a component.

    Attributes:
        name, title: of the C function; what its section is about.
        function: of `Component.functions`.
        results: for each result the index among those of CasADi's function, and where it goes.
        skipped: slots of the first result that stay as they are.
    """

    name: str
    title: str
    function: str
    results: tuple[tuple[int, Target], ...]
    skipped: frozenset[int] = frozenset()


class Functions:
    """Code of a component's functions.

    Attributes:
        declarations: structs, and constant arrays.
        in_lanes, sections: one for each function, in the order of reading; those that copies in lanes have, and others.
        vectorized: whether copies in lanes have all that they call.
        names: of the C functions there are, which are those of the runtime's fields.
        n_work: numbers that they work in.
        kept: first slot and count of states that a sample leaves as they are, which it does not write in lanes.
        solves: whether they solve linear equations.
    """

    def __init__(self, component: Model) -> None:
        self._component = component
        self._graph, self._tables = Graph(), Tables()
        self.structs = _structs(component)
        self.n_work = 0
        self.names: list[str] = []
        self.in_lanes: list[str] = []
        self.sections: list[str] = []
        self.known: dict[int, str] = {}
        self.kept: list[tuple[int, int]] = []
        self.solves = False
        parts = self._parts()
        read: dict[str, list[Result] | None] = {}
        for name in dict.fromkeys(("values", "out", "rhs", *(p.function for p in parts))):
            if name in component.functions:
                read[name] = self._read(name)
        self._names, self._constants = self._named(read)
        if fixed := self._fixed(read):
            read["fixed"] = [Result(0, k, n) for k, n in enumerate(fixed)]
            sources = {k: self._names[n].source for k, n in enumerate(fixed) if n in self._names}
            target = Target("f", len(fixed), self.structs["f"], sources)
            parts.insert(0, _Part("prepare", "values that depend on parameters only", "fixed", ((0, target),)))
        others = [component.functions[p.function] for p in parts if read[p.function] is None]
        shared = self._shared
        self.vectorized = vectors = all(read[p.function] is not None for p in parts if p.function in shared)
        code, entries = casadi_code(others) if others else ("", {})
        if code:
            self.sections.append(f"{_head('operations in the code of CasADi')}\n{code}\n")
        for part in parts:
            results = read[part.function]
            where = self.in_lanes if vectors and part.function in shared else self.sections
            where.append(self._calls(part, entries) if results is None else self._section(part, results))
            self.names.append(part.name)
        for pair in component.profiles:
            # After what they come from, before what reads them; their memory lies behind that of the others.
            body = random_profiles.code(pair, component.size("parameter"), self.n_work)
            head = _head("random profiles: computed again when a parameter has changed")
            after = bool(fixed) + len(random_profiles.FUNCTIONS)
            (self.in_lanes if vectors else self.sections).insert(
                after + (bool(code) and not vectors), f"{head}\n{body}"
            )
            self.n_work += random_profiles.memory(pair, component.size("parameter"))
        self.uses_casadi = bool(others)

    @property
    def declarations(self) -> str:
        """Structs over the vectors, and constant arrays."""
        shown = [s.definition() for s in self.structs.values()]
        constants = [f"{_head('constants')}\n", *self._tables.code] if self._tables.code else []
        return "\n\n".join([*shown, *constants])

    @property
    def _shared(self) -> tuple[str, ...]:
        return (*_IN_LANES, "jac") if self._component.solver == "ros2" else _IN_LANES

    # ------------------------------------------------------------------ what there is to write

    def _parts(self) -> list[_Part]:
        c = self._component
        functions, states, outputs = c.functions, self.structs.get("x"), self.structs.get("y")
        nx, ny = c.size("state"), c.size("output")
        state_sources = self._sources("state")
        output_sources = self._sources("output")
        calculated = frozenset(k for v in c.of("state") if v.start is not None for k in range(v.slot, v.slot + v.size))
        parts = []
        for name, title in random_profiles.FUNCTIONS.items() if c.profiles else ():
            parts.append(_Part(name, f"random profiles: {title}", name, ((0, Target("result", 2)),)))
        if nx > len(calculated):
            target = Target("start", nx, states)
            parts.append(_Part("start_states", "start: calculated states x(u, p)", "start", ((0, target),), calculated))
        if c.kind == "discrete":
            results = ((1, Target("y", ny, outputs, output_sources)), (0, Target("next", nx, states, state_sources)))
            title = "sample: outputs y and next states at a sample instant"
            parts.append(_Part("sample", title, "tick", results))
            if c.programs:
                target = Target("data", functions["programs"].numel_out(0), self.structs["data"])
                parts.append(_Part("program_data", "data of the quadratic programs", "programs", ((0, target),)))
        else:
            if ny:
                parts.append(_Part("outputs", "outputs: y", "out", ((0, Target("y", ny, outputs, output_sources)),)))
            if nx:
                target = Target("der", nx, states, state_sources)
                parts.append(_Part("derivatives", "derivatives: dx/dt", "rhs", ((0, target),)))
            if nx or ny:
                targets = (
                    (0, Target("d_der", nx, states, zero_first=True)),
                    (1, Target("dy", ny, outputs, zero_first=True)),
                )
                title = "directional derivatives of dx/dt and y along dx, du, dp"
                parts.append(_Part("directional", title, "fwd", targets))
            if nx > len(calculated):
                target = Target("d_start", nx, states)
                title = "directional derivatives of calculated start states"
                parts.append(_Part("directional_start", title, "fwd_start", ((0, target),), calculated))
            if nx and "jac" in functions:
                names = [n for v in c.of("state") for n in v.element_names()]
                comments = {i + nx * k: f"der({names[i]}) by {names[k]}" for i in range(nx) for k in range(nx)}
                by_time = {i: f"der({names[i]}) by time" for i in range(nx)}
                targets = (
                    (0, Target("result", nx * nx, comments=comments, zero_first=True)),
                    (1, Target("second", nx, comments=by_time, zero_first=True)),
                )
                parts.append(_Part("jacobian", "Jacobian of dx/dt by x, column by column, and by time", "jac", targets))
        if "check" in functions:
            target = Target("result", len(c.check_messages))
            parts.append(
                _Part("checks", "relations between parameters: values that must be > 0", "check", ((0, target),))
            )
        return parts

    def _sources(self, role: Role) -> dict[int, str]:
        """Where equations come from, by the slot that they give."""
        sources = self._component.equations
        declared = [v for v in self._component.of(role) if v.name in sources]
        return {v.slot + k: sources[v.name] for v in declared for k in range(v.size)}

    def _read(self, name: str) -> list[Result] | None:
        """Results of a function; None where CasADi is to write it."""
        try:
            return self._graph.read(self._component.functions[name], self._inputs(name))
        except UnknownOperationError:
            return None

    def _inputs(self, function: str) -> tuple[str, ...]:
        """What a function of `Component.functions` is given; what it does not take may follow."""
        c = self._component
        further = [p for p, there in (("s", c.programs), ("c", c.profiles)) if there]
        return _INPUTS.get(function, ("t", "x", "u", "p", *further))

    def _named(self, read: Mapping[str, list[Result] | None]) -> tuple[dict[int, Name], dict[int, str]]:
        """Names of nodes, and names of constant arrays.

        Intermediate values come first, then outputs, then derivatives or next states.
        """
        c, nodes = self._component, self._graph.nodes
        names: dict[int, Name] = {}
        constants: dict[int, str] = {}
        for name, source, node in self._value_nodes(read.get("values") or ()):
            if nodes[node].operation == ca.OP_CONST:
                constants.setdefault(node, name)
            else:
                names.setdefault(node, Name(name, source, is_value=True))
        discrete = c.kind == "discrete"
        after = ("tick", 0, "next_") if discrete else ("rhs", 0, "der_")
        for function, index, prefix in (("tick" if discrete else "out", 1 if discrete else 0, ""), after):
            struct = self.structs.get("x" if prefix else "y")
            for result in read.get(function) or ():
                if result.index != index or struct is None:
                    continue
                field = struct.field_at(result.start)
                if (result.start, nodes[result.node].size) == (field.slot, field.size):
                    names.setdefault(result.node, Name(f"{prefix}{field.name}"))
        return names, constants

    def _value_nodes(self, results: Iterable[Result]) -> Iterator[tuple[str, str, int]]:
        """Name, source and node of the intermediate values; of scalar graphs each element is one, `turn_2_3`."""
        by_index: dict[int, list[Result]] = {}
        for r in results:
            by_index.setdefault(r.index, []).append(r)
        for index, (name, source) in enumerate(self._component.value_sources.items()):
            parts = by_index.get(index, [])
            if self._component.symbols is ca.MX or len(parts) == 1:
                node = self._graph.joined([r.node for r in parts])
                if node is not None:
                    yield name, source, node
                continue
            rows, columns = self._component.functions["values"].size_out(index)
            for r in parts:
                column = f"_{r.start // rows + 1}" if columns > 1 else ""
                yield f"{name}_{r.start % rows + 1}{column}", source, r.node

    def _fixed(self, read: Mapping[str, list[Result] | None]) -> list[int]:
        """Nodes that depend on parameters only, with what depends on more: they are computed when parameters change.

        Conditions are not among them: they are no numbers.
        """
        nodes = self._graph.nodes
        fixed: list[bool] = []
        for node in nodes:
            given = node.operation != ca.OP_INPUT or node.data[0] == "p"
            fixed.append(given and all(fixed[a] for a in node.arguments))
        open_ = [r.node for name in self._shared for r in read.get(name) or () if name not in random_profiles.FUNCTIONS]
        seen: set[int] = set()
        while open_:
            n = open_.pop()
            if n not in seen:
                seen.add(n)
                if not (fixed[n] and self._is_number(n)):
                    open_ += nodes[n].arguments
        found = sorted(n for n in seen if fixed[n] and self._is_number(n))
        if found:
            named = [(self._names[n].name if n in self._names else f"v{k + 1}", (), "") for k, n in enumerate(found)]
            self.structs["f"] = Struct("Fixed", "Values that depend on parameters only", named)
            self.known = dict(zip(found, (m.name for m in self.structs["f"].fields), strict=True))
        return found

    def _is_number(self, n: int) -> bool:
        """Whether a node is one number that an operation gives."""
        node = self._graph.nodes[n]
        return node.size == 1 and bool(node.arguments) and node.operation not in (GATHER, *CONDITIONS)

    # ------------------------------------------------------------------ writing

    def _section(self, part: _Part, results: list[Result]) -> str:
        # Derivatives are asked for seldom, and are long: with branches compilers take half as long again.
        own = part.function in ("fixed", *random_profiles.FUNCTIONS)
        statements = Statements(
            self._graph,
            self.structs_of_arguments,
            {n: name for n, name in self._names.items() if n not in self.known} if own else self._names,
            self._tables,
            self._constants,
            branches=part.function not in ("fwd", "fwd_start", "jac"),
            local=part.function in _IN_LANES and part.function != "start",  # which writes the states that it reads
            known={} if own else self.known,
        )
        wanted = [
            (target, r.start, r.node)
            for index, target in part.results
            for r in results
            if r.index == index and not self._is_skipped(part, r)
        ]
        arrays = dict(zip((t.pointer for _, t in part.results), ("result", "second"), strict=False))
        zeros = Counter(t.pointer for t, _, n in wanted if statements.is_zero(n))
        wanted = [
            (replace(t, array=arrays[t.pointer], zero_first=t.zero_first and zeros[t.pointer] > 1), start, n)
            for t, start, n in wanted
        ]
        body = statements.write(wanted)
        self.n_work = max(self.n_work, statements.work)
        self.kept += statements.kept
        self.solves |= statements.solves
        return self._function(part, body, statements.pointers)

    def _is_skipped(self, part: _Part, r: Result) -> bool:
        slots = range(r.start, r.start + self._graph.nodes[r.node].size)
        return bool(part.skipped) and part.skipped.issuperset(slots)

    @property
    def structs_of_arguments(self) -> dict[str, Struct]:
        """Structs by the pointers that functions have to what they are given."""
        return {pointer: self.structs[vector] for pointer, vector in _ARGUMENTS.items() if vector in self.structs}

    def _function(self, part: _Part, body: list[str], used: Mapping[str, None]) -> str:
        lines = []
        if "t" in used:
            lines.append("const scalar t = all(at->t);")
        for pointer, struct in self.structs_of_arguments.items():
            if pointer in used and all(pointer != target.pointer for _, target in part.results):
                lines.append(f"const {struct.name} *const {pointer} = (const {struct.name} *){_argument(pointer)};")
        if "w" in used:
            lines.append("real *const w = at->w;")
        if not lines:
            lines.append("(void)at;")
        for parameter, (_, target) in zip(("result", "second"), part.results, strict=False):
            if target.struct is not None and target.pointer in used:
                lines.append(f"{target.struct.name} *const {target.pointer} = ({target.struct.name} *){parameter};")
            elif not any(parameter in line for line in body):
                lines.append(f"(void){parameter};")
        indented = [f"    {line}" for line in (*lines, *([""] if body else []), *body)]
        head = _head(part.title, self._component.source)
        return "\n".join([head, f"{_signature(part)} {{", *(line.rstrip() for line in indented), "}", ""])

    def _calls(self, part: _Part, entries: Mapping[str, str]) -> str:
        """A function that is CasADi's code."""
        function = self._component.functions[part.function]
        given = [_argument(v) for v in self._inputs(part.function)][: function.n_in()]
        given += ["NULL"] * (function.sz_arg() - len(given))
        parameters = {index: name for name, (index, _) in zip(("result", "second"), part.results, strict=False)}
        taken = [parameters.get(i, "NULL") for i in range(function.n_out())]
        taken += ["NULL"] * (function.sz_res() - len(taken))
        self.n_work = max(self.n_work, function.sz_w())
        lines = [
            f"    const double *arg[] = {{{', '.join(given)}}};",
            f"    double *res[] = {{{', '.join(taken)}}};",
            f"    int iw[{max(1, function.sz_iw())}];",
            f"    (void){entries[function.name()]}(arg, res, iw, at->w, 0);",
        ]
        head = _head(part.title, self._component.source)
        return "\n".join([head, f"{_signature(part)} {{", *lines, "}", ""])


def _argument(pointer: str) -> str:
    return _ARGUMENT_CODE.get(pointer, f"at->{pointer}")


def _signature(part: _Part) -> str:
    once = "CALLED_ONCE\n" if part.function in ("start", "fwd_start") else ""
    second = ", real *second" if len(part.results) > 1 else ""
    return f"{once}static void {part.name}(const FmuArguments *at, real *result{second})"


def _head(title: str, source: str = "") -> str:
    text = f"/* {'-' * 66} {title}"
    lines = textwrap.wrap(c_comment(source), WIDTH - 3, break_long_words=False)
    return "\n * ".join([text, *lines]) + " */"


def _structs(component: Model) -> dict[str, Struct]:
    """Structs over the vectors that are not empty, by their pointer."""
    flat = component.symbols is ca.MX
    structs = {}
    for role, (pointer, name) in _STRUCTS.items():
        variables = component.of(role)
        if variables:
            fields = [(v.name, _shape(v, flat), _comment(v, flat)) for v in variables]
            structs[pointer] = Struct(name, f"{name}: {_OF[role]}", fields)
    if component.programs:
        solutions, data = [], []
        for q in component.programs:
            stem = q.name.rpartition(".")[2]
            solutions += [
                (f"{stem}.z", (q.n,), "solution"),
                (f"{stem}.multipliers", (q.m,), ""),
                (f"{stem}.status", (), ""),
                (f"{stem}.iterations", (), ""),
                (f"{stem}.residual", (), ""),
            ]
            data += [
                (f"{stem}.linear", (q.n,), "q of z'Hz / 2 + q'z"),
                (f"{stem}.lower", (q.m,), "bounds of A z"),
                (f"{stem}.upper", (q.m,), ""),
                (f"{stem}.case", (), "which H and A"),
                *([(f"{stem}.weights", (len(q.terms),), "of the terms of H")] if len(q.terms) else []),
            ]
        structs["s"] = Struct("Solutions", "Solutions of the quadratic programs", solutions)
        structs["data"] = Struct("ProgramData", "Data of the quadratic programs", data)
    for pair in component.profiles:
        heights = [(f"{pair.name}.{side}", (pair.most,), "[m] at its nodes") for side in ("left", "right")]
        structs["c"] = Struct("Profiles", "Random profiles", heights)
    return structs


_OF: dict[Role, str] = {
    "parameter": "p->body_mass is the variable body.mass; elements count from 0, those of gain[2,3] row by row",
    "input": "u",
    "state": "x",
    "output": "y",
}


def _shape(v: Variable, flat: bool) -> tuple[int, ...]:
    return (v.size,) if flat and v.shape else v.shape


def _comment(v: Variable, flat: bool) -> str:
    unit = f"[{v.unit}] " if v.unit and v.type == "Float64" else ""
    rows = f"; {v.shape[0]} x {v.shape[1]}, row by row" if flat and len(v.shape) == 2 else ""
    return f"{unit}{v.description}{rows}"
