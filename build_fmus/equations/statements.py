"""One C function from the operations of one function of a component.

What is used once stands where it is used; what has a name, is used more often, or makes a line too long gets a line of
its own. The numbers of a vector are computed in one loop as far as they do not depend on each other. What only one
value of a choice needs stands under its condition (`branches`).
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field

from build_fmus.base import extras
from build_fmus.base.escape import c_comment
from build_fmus.equations.branches import Branch, Guard, calls, guards
from build_fmus.equations.graph import GATHER, SCATTER, Graph, Node, UnknownOperationError
from build_fmus.equations.lines import Layout, Line
from build_fmus.equations.names import WIDTH, Struct, identifier
from build_fmus.equations.operators import ARITHMETIC, ATOM, ELEMENTWISE, SMOOTH_FUNCTIONS, Text, constant, write
from build_fmus.equations.values import Index, Tables, Value

with extras.needed("build", extras.BUILDING):
    import casadi as ca

LONGEST = 4 * WIDTH  # characters of an expression that is not divided
_FREE = 16  # characters of an operand that no line of its own makes shorter


@dataclass(frozen=True)
class Name:
    """Name of a node, with the source of its equation.

    Says also whether the node gets a line of its own although it is used only once, at the end.
    """

    name: str
    source: str = ""
    is_value: bool = False


@dataclass(frozen=True)
class Target:
    """Where a result goes: `struct` over `pointer`, or an array where there is no struct.

    `sources` of equations and `comments` are by element. `array` is the same as an array; `zero_first`: all
    elements become 0 before those that are not.
    """

    pointer: str
    size: int
    struct: Struct | None = None
    sources: Mapping[int, str] = field(default_factory=dict)
    comments: Mapping[int, str] = field(default_factory=dict)
    zero_first: bool = False
    array: str = "result"


class Statements:
    """Writes the body of one C function."""

    def __init__(
        self,
        graph: Graph,
        structs: Mapping[str, Struct],
        names: Mapping[int, Name],
        tables: Tables,
        constants: Mapping[int, str],
        *,
        branches: bool = True,
        local: bool = True,
        known: Mapping[int, str] | None = None,
    ) -> None:
        """Prepare the statements of functions over `graph`.

        `structs`: those of the vectors, by the pointer's name; `constants`: names of constant arrays; `branches`:
        whether code that only one value of a choice needs stands under its condition; `local`: whether numbers can be
        local; `known`: fields of the struct `f` that have the numbers of nodes.
        """
        self._known = known or {}
        self._branches, self._local = branches, local
        self.graph, self.structs, self.names, self.tables, self.constants = graph, structs, names, tables, constants
        self.pointers: dict[str, None] = {}  # vectors that are used
        self._values: dict[int, Value] = {}
        self._inner: Counter[int] = Counter()  # operations that use a node
        self._uses: Counter[int] = Counter()  # and results
        self._taken: set[str] = set()
        self._explained: set[str] = set()  # sources that stand somewhere above
        self._lines: list[Line] = []
        self._kept: frozenset[str] = frozenset()  # numbers that are not local
        self._count = 0
        self._live: set[int] = set()  # all nodes that are needed
        self._guards: dict[int, Guard] = {}
        self._depths: dict[int, int] = {}
        self._own_lines: set[int] = set()  # nodes under other conditions than what uses them, conditions, awaited calls
        self._storage: dict[int, str] = {}  # work arrays that operations own
        self.work = 0  # numbers of work arrays
        self.kept: list[tuple[int, int]] = []  # first slot and count of states that a sample leaves as they are
        self.solves = False  # linear equations

    def write(self, results: Sequence[tuple[Target, int, int]]) -> list[str]:
        """Lines for results, each a target, the first element there, and its node; in this order."""
        roots = [n for _, _, n in results]
        self._count_uses(roots)
        self._guard(roots)
        zeros = {t.array: t.size for t, _, _ in results if t.zero_first}
        for array, size in zeros.items():
            self._lines.append(Line([f"for (int i = 0; i < {size}; i++) {array}[i] = all(0.0);"]))
        explained = ""
        for target, start, node in results:
            if target.zero_first and self.is_zero(node):
                continue
            self._prepare(node)
            source = target.sources.get(start, "")
            if source and source != explained:
                self._lines.append(Line([f"/* {c_comment(source)} */"]))
            explained = source
            self._assign(target, start, node)
        layout = Layout(self._lines, self._condition, self._kept, local=self._local)
        text = layout.in_branches() if self._guards else layout.placed()
        self.work = layout.work
        if self.work:
            self.pointers["w"] = None
        return text

    # ------------------------------------------------------------------ which operations, in which order

    def _guard(self, roots: list[int]) -> None:
        """Find what stands under conditions."""
        if not self._branches:
            return
        self._guards = guards(self.graph, roots, self._live.difference(self._known))
        for guard in self._guards.values():
            self._own_lines.update(condition for condition, _ in guard)
        if self._guards:
            computed = self._live.difference(self._known)
            for n in computed:
                operands = self.graph.nodes[n].arguments
                self._own_lines.update(a for a in operands if self._guards.get(a, ()) != self._guards.get(n, ()))
            self._depths, awaited = calls(self.graph, computed)
            self._own_lines |= awaited

    def _count_uses(self, roots: Iterable[int]) -> None:
        roots = list(roots)
        self._uses.update(roots)
        seen: set[int] = set()
        open_ = list(roots)
        while open_:
            n = open_.pop()
            if n in seen:
                continue
            seen.add(n)
            arguments = self._operands(n)
            self._inner.update(arguments)
            self._uses.update(arguments)
            open_ += arguments
        self._live = seen

    def _operands(self, n: int) -> tuple[int, ...]:
        return () if n in self._known else self.graph.nodes[n].arguments

    def _prepare(self, root: int) -> None:
        """Values of a node and of what it needs, in the order of need."""
        open_ = [root]
        while open_:
            n = open_[-1]
            if n in self._values:
                open_.pop()
                continue
            missing = [a for a in self._operands(n) if a not in self._values]
            if missing:
                open_ += reversed(missing)
                continue
            open_.pop()
            self._values[n] = self._value(n)

    def is_zero(self, n: int) -> bool:
        """Whether a node is the number 0, or a vector of them."""
        node = self.graph.nodes[n]
        return node.operation == ca.OP_CONST and isinstance(node.data, float) and node.data.hex() == "0x0.0p+0"

    def _condition(self, branch: Branch) -> str:
        node, holds = branch
        text = self._values[node].at(Index(""))
        return (text.condition if holds else write(ca.OP_NOT, [text])).code

    # ------------------------------------------------------------------ values

    def _value(self, n: int) -> Value:
        node = self.graph.nodes[n]
        if n in self._known:
            self.pointers["f"] = None
            return self._field("f", self._known[n])
        if node.operation == ca.OP_INPUT:
            vector, first = node.data
            return self._input(vector, first, node.size)
        if node.operation == ca.OP_CONST:
            return self._constant(n, node)
        if node.operation == GATHER:
            value = self._gather(node)
        elif node.operation == ca.OP_GETNONZEROS_PARAM:
            value = self._looked_up(node)
        elif node.operation in ELEMENTWISE:
            value = self._elementwise(node)
        else:
            return self._computed(n, node)
        name = self.names.get(n)
        is_named = (name is not None and (name.is_value or self._inner[n] > 0)) or n in self._own_lines
        if value.plain:
            return self._named(n, value) if is_named and node.size == 1 else value
        return self._named(n, value) if is_named or self._uses[n] > 1 else value

    def _named(self, n: int, value: Value) -> Value:
        """The value on a line of its own, under a name."""
        node = self.graph.nodes[n]
        if node.size == 1:
            text = value.at(Index(""))
            name = self._name(n)
            guard = self._guards.get(n, ())
            kind = "condition" if text.logical else "scalar"
            reads = value.reads.union(*(self._values[c].reads for c, _ in guard))
            smooth = value.smooth and not (text.logical or text.uniform)
            lines = [*self._explanation(n), f"{name} = {(text if text.logical else text.real).code};"]
            depth = self._depths.get(n, 0)
            line = Line(lines, writes=name, reads=reads, kind=kind, guard=guard, smooth=smooth, depth=depth)
            self._lines.append(line)
            named = Text(name, ATOM, text.logical)
            return Value(lambda _: named, len(name), reads=frozenset((name,)), plain=True, smooth=not text.logical)
        storage = self._begin(n, node.size)
        self._loop(f"{storage}[i]", node.size, value, storage)
        return self._stored(storage, node.size)

    def _explanation(self, n: int) -> list[str]:
        """Where the equation of a node comes from, unless that stands above."""
        name = self.names.get(n)
        if name is None or not name.source or name.source in self._explained:
            return []
        self._explained.add(name.source)
        return [f"/* {c_comment(name.source)} */"]

    def _name(self, n: int) -> str:
        known = self.names.get(n)
        if known is not None:
            name = identifier(known.name, self._taken)
        else:
            self._count += 1
            name = f"v{self._count}"
        self._taken.add(name)
        return name

    def _begin(self, n: int, size: int) -> str:
        """A work array for a node."""
        name = self._name(n)
        self._storage[n] = name
        lines = [*self._explanation(n), f"real *const {name} = w + @;"]
        self._lines.append(Line(lines, writes=name, begins=size))
        return name

    def _stored(self, storage: str, size: int) -> Value:
        def at(index: Index) -> Text:
            return Text(f"{storage}[{index.code if size > 1 else 0}]")

        return Value(at, len(storage) + 3, storage, frozenset((storage,)), plain=True)

    def _input(self, vector: str, first: int, size: int) -> Value:
        self.pointers[vector] = None
        struct = self.structs.get(vector)
        if struct is None:  # time
            return Value(lambda _: Text(vector), len(vector), reads=frozenset((vector,)), plain=True, smooth=True)
        if size == 1:
            return self._field(vector, struct.element(first))
        field = struct.field_at(first)
        if len(field.shape) == 1 and first + size <= field.slot + field.size:
            array, offset = f"{vector}->{field.name}", first - field.slot
        else:
            array, offset = f"((const real *){vector})", first

        def at(index: Index) -> Text:
            return Text(f"{array}[{Index(index.variable, index.step, index.start + offset).code}]")

        return Value(at, len(array) + 3, f"{array} + {offset}" if offset else array, plain=True)

    @staticmethod
    def _field(vector: str, element: str) -> Value:
        text = Text(f"{vector}->{element}")
        reads, is_scalar = frozenset((text.code,)), "[" not in element
        return Value(lambda _: text, len(text.code), f"&{text.code}", reads, plain=True, smooth=is_scalar)

    def _constant(self, n: int, node: Node) -> Value:
        if isinstance(node.data, float):
            text = constant(node.data)
            return Value(lambda _: text, len(text.code), plain=True, smooth=True)
        table = self.tables.numbers(node.data, self.constants.get(n, ""))
        return Value(lambda index: Text(f"{table}[{index.code}]", uniform=True), len(table) + 3, table, plain=True)

    def _gather(self, node: Node) -> Value:
        source, places = self._values[node.arguments[0]], node.data
        if (
            isinstance(places, range)
            and places.step == 1
            and self.graph.nodes[node.arguments[0]].operation == ca.OP_INPUT
        ):
            vector, first = self.graph.nodes[node.arguments[0]].data
            return self._input(vector, first + places.start, node.size)
        repeated = self.graph.nodes[node.arguments[0]].size == 1
        if isinstance(places, range) or repeated:
            if node.size == 1 or repeated:
                index = Index("", 0, places[0])
                return Value(lambda _: source.at(index), source.length, reads=source.reads, plain=source.plain)
            pointer = ""
            if source.pointer and places.step == 1:
                pointer = f"{source.pointer} + {places.start}" if places.start else source.pointer
            return Value(lambda i: source.at(i.through(places)), source.length + 4, pointer, source.reads, source.plain)
        table = self.tables.positions(places)
        length = source.length + len(table) + 4
        return Value(lambda i: source.at(Index(f"{table}[{i.code}]")), length, reads=source.reads, plain=source.plain)

    def _looked_up(self, node: Node) -> Value:
        array, places = node.arguments
        size, pointer = self.graph.nodes[array].size, self._pointer(array)
        index = self._simple(places, node.size)
        self._keep([index])
        reads = self._values[array].reads | index.reads
        return Value(
            lambda i: Text(f"look_up({pointer}, {size}, {index.at(i).number.code})"),
            index.length + len(pointer) + 16,
            reads=reads,
        )

    def _elementwise(self, node: Node) -> Value:
        operands = [self._simple(a, node.size) for a in node.arguments]
        while sum(v.length for v in operands) > LONGEST:
            longest = max(range(len(operands)), key=lambda k: operands[k].length)
            if operands[longest].length <= _FREE:
                break
            a = node.arguments[longest]
            self._values[a] = operands[longest] = self._named(a, operands[longest])
            operands = [self._values[b] if b == a else v for b, v in zip(node.arguments, operands, strict=True)]
        length = sum(v.length for v in operands) + 3 * len(operands)
        reads = frozenset().union(*(v.reads for v in operands))
        if node.size > 1:  # once for each element
            self._kept |= reads
        if node.size == 1:
            text = write(node.operation, [v.at(Index("")) for v in operands])
            smooth = all(v.smooth for v in operands)
            if node.operation not in ARITHMETIC:
                smooth &= node.operation in SMOOTH_FUNCTIONS and operands[0].plain
                self._keep(operands)
            return Value(lambda _: text, length, reads=reads, smooth=smooth)
        return Value(lambda index: write(node.operation, [v.at(index) for v in operands]), length, reads=reads)

    def _keep(self, arguments: Iterable[Value]) -> None:
        """Let numbers that are arguments of functions, or stored, have derivatives.

        Each call would compute them, and a comparison of a number with its copy would be one of two that move apart.
        """
        self._kept = self._kept.union(*(v.reads for v in arguments if v.plain))

    def _simple(self, a: int, size: int) -> Value:
        """An operand; a number that all elements of a vector are computed with is computed before them."""
        value = self._values[a]
        if size > 1 and self.graph.nodes[a].size == 1 and not value.plain:
            self._values[a] = value = self._named(a, value)
        return value

    def _pointer(self, a: int) -> str:
        """Where the elements of a node lie in a row, after they have been put there."""
        value = self._values[a]
        if not value.pointer:
            storage = self._begin(a, self.graph.nodes[a].size)
            self._loop(f"{storage}[i]", self.graph.nodes[a].size, value, storage)
            self._values[a] = value = self._stored(storage, self.graph.nodes[a].size)
        return value.pointer

    def _loop(
        self, target: str, size: int, value: Value, writes: str = "", reads: frozenset[str] = frozenset()
    ) -> None:
        """`target` = value, element by element; with `i` in the target."""
        self._keep([value])
        if size == 1:
            line = f"{target.replace('[i]', '[0]')} = {value.at(Index('')).real.code};"
        else:
            line = f"for (int i = 0; i < {size}; i++) {target} = {value.at(Index('i')).real.code};"
        self._lines.append(Line([line], writes=writes, reads=value.reads | reads))

    # ------------------------------------------------------------------ what is no loop over independent elements

    def _computed(self, n: int, node: Node) -> Value:
        if node.operation in (ca.OP_MMIN, ca.OP_MMAX):
            (a,) = node.arguments
            size, pointer = self.graph.nodes[a].size, self._pointer(a)
            call = f"{'smallest' if node.operation == ca.OP_MMIN else 'largest'}({pointer}, {size})"
            return self._named(n, Value(lambda _: Text(call), len(call), reads=self._values[a].reads))
        if node.operation in (ca.OP_SETNONZEROS, ca.OP_SETNONZEROS_PARAM):
            return self._changed(n, node)
        if node.operation in (ca.OP_VERTCAT, ca.OP_HORZCAT):
            storage = self._begin(n, node.size)
            start = 0
            for a in node.arguments:
                size = self.graph.nodes[a].size
                self._fill(storage, range(start, start + size), self._values[a])
                start += size
        elif node.operation == SCATTER:
            storage = self._begin(n, node.size)
            self._loop(f"{storage}[i]", node.size, _ZERO, storage)
            self._fill(storage, node.data, self._values[node.arguments[0]])
        elif node.operation == ca.OP_MTIMES:
            return self._product(n, node)
        elif node.operation == ca.OP_SOLVE:
            return self._solved(n, node)
        elif node.operation in (ca.OP_HORZREPMAT, ca.OP_TRANSPOSE):
            (a,) = node.arguments
            ((rows, columns),) = node.data
            value = self._values[a]
            storage = self._begin(n, node.size)
            if node.operation == ca.OP_TRANSPOSE:
                element, outer, inner = f"{storage}[j + {columns} * i]", columns, rows
                code = value.at(Index(f"i + {rows} * j")).real.code
            else:
                element, outer, inner = (
                    f"{storage}[i + {rows * columns} * j]",
                    node.size // (rows * columns),
                    rows * columns,
                )
                code = value.at(Index("i")).real.code
            line = f"for (int j = 0; j < {outer}; j++) for (int i = 0; i < {inner}; i++) {element} = {code};"
            self._lines.append(Line([line], writes=storage, reads=value.reads))
        else:
            raise UnknownOperationError(f"operation {node.operation}")
        return self._stored(storage, node.size)

    def _fill(self, storage: str, places: range | tuple[int, ...], value: Value) -> None:
        """Set elements of a work array."""
        if not len(places):
            return
        self._keep([value])
        if isinstance(places, range):
            place = Index("i" if len(places) > 1 else "").through(places).code
        else:
            place = f"{self.tables.positions(places)}[i]"
        if len(places) == 1:
            line = f"{storage}[{places[0]}] = {value.at(Index('')).real.code};"
        else:
            line = f"for (int i = 0; i < {len(places)}; i++) {storage}[{place}] = {value.at(Index('i')).real.code};"
        self._lines.append(Line([line], writes=storage, reads=value.reads))

    def _own(self, n: int, a: int) -> str:
        """A work array for node `n` that begins as `a`: that of `a` itself where nothing else reads it."""
        if a in self._storage and self._uses[a] == 1:
            storage = self._storage[n] = self._storage[a]
            return storage
        value, size = self._values[a], self.graph.nodes[n].size
        storage = self._begin(n, size)
        self._loop(f"{storage}[i]", size, value, storage)
        return storage

    def _changed(self, n: int, node: Node) -> Value:
        base, *rest = node.arguments
        if node.operation == ca.OP_SETNONZEROS_PARAM:
            new, places = rest
            size = self.graph.nodes[places].size
            value, place = self._simple(new, size), self._simple(places, size)
            self._keep([value, place])
            storage = self._own(n, base)
            i = Index("i" if size > 1 else "")
            call = f"store({storage}, {node.size}, {place.at(i).number.code}, {value.at(i).number.code});"
            line = f"for (int i = 0; i < {size}; i++) {call}" if size > 1 else call
            self._lines.append(Line([line], writes=storage, reads=value.reads | place.reads))
        else:
            storage = self._own(n, base)
            value = self._values[rest[0]]
            self._fill(storage, node.data, value)
        return self._stored(storage, node.size)

    def _product(self, n: int, node: Node) -> Value:
        z, x, y = node.arguments
        _, (rows, inner), (_, columns) = node.data
        left, right = self._pointer(x), self._pointer(y)
        call, storage = ("product", self._begin(n, node.size)) if self.is_zero(z) else ("add_product", self._own(n, z))
        reads = self._values[x].reads | self._values[y].reads
        line = f"{call}({storage}, {left}, {right}, {rows}, {inner}, {columns});"
        self._lines.append(Line([line], writes=storage, reads=reads))
        return self._stored(storage, node.size)

    def _solved(self, n: int, node: Node) -> Value:
        """The solution of linear equations; behind it in its work array they are eliminated."""
        self.solves = True
        b, a = node.arguments
        (rows, columns), _ = node.data
        right, left = self._pointer(b), self._pointer(a)
        storage = self._begin(n, node.size + rows * rows)
        reads = self._values[a].reads | self._values[b].reads
        line = f"solve_linear({storage}, {storage} + {node.size}, {left}, {right}, {rows}, {columns});"
        self._lines.append(Line([line], writes=storage, reads=reads))
        return self._stored(storage, node.size)

    # ------------------------------------------------------------------ results

    def _assign(self, target: Target, start: int, n: int) -> None:
        size, value = self.graph.nodes[n].size, self._values[n]
        self._keep([value])
        done = 0
        while done < size:
            slot = start + done
            if target.struct is None:
                element, array, count = f"{target.pointer}[{slot}]", (target.pointer, slot), size
            else:
                self.pointers[target.pointer] = None
                field = target.struct.field_at(slot)
                element = f"{target.pointer}->{target.struct.element(slot)}"
                array = (f"{target.pointer}->{field.name}", slot - field.slot)
                count = min(size - done, field.slot + field.size - slot) if len(field.shape) < 2 else 1
            comment = f" /* {c_comment(target.comments[slot])} */" if slot in target.comments else ""
            stays = f"{array[0].replace('next->', 'x->')} + {array[1]}".removesuffix(" + 0")
            if count == 1:
                line = f"{element} = {value.at(Index('', 0, done)).real.code};{comment}"
            else:
                code = value.at(Index("i", 1, done)).real.code
                line = (
                    f"for (int i = 0; i < {count}; i++) {array[0]}[{Index('i', 1, array[1]).code}] = {code};{comment}"
                )
            lines = [line]
            if target.pointer == "next" and count == size > 1 and value.pointer == stays:
                self.kept.append((slot, count))
                lines = ["#ifndef LANES", line, "#endif"]
            self._lines.append(Line(lines, reads=value.reads))
            done += count


_ZERO = Value(lambda _: Text("0.0", uniform=True), 3)
