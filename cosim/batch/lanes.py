"""Functions of a component over several copies at once: its generated C statements over vectors of numbers ("lanes").

Every operation is that of the component's own code, in the same order, so each lane is bit-identical to a copy alone.
Three things differ: statements that no needed output or state depends on are left out; values that depend on parameters
only are computed once (`Fixed`); a block under a condition is skipped where the condition holds in no lane. Where it
holds in some lanes, the block is executed for all, and its results are taken for these lanes only.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

from build_fmus.base import elementwise
from cosim.batch.statements import (
    Assignment,
    Call,
    Declaration,
    Expression,
    For,
    If,
    NotRead,
    Statement,
    Work,
    read_function,
)

FUNCTIONS = frozenset((*elementwise.FUNCTIONS, "square"))
"""What generated statements call on numbers; `runtime/lanes.h` has each as lanes_NAME."""

VECTORS = {"x": "States", "u": "Inputs", "p": "Parameters", "c": "Profiles"}
_POINTERS = {
    "States": ("x", "next", "der", "start"),
    "Inputs": ("u",),
    "Parameters": ("p",),
    "Outputs": ("y",),
    "Profiles": ("c",),
}
_RESULTS = frozenset(("y", "next", "der", "start"))
_STRUCT = re.compile(r"typedef struct \{\n(.*?)\n\} (\w+);\n", re.DOTALL)
_MEMBER = re.compile(r"double (\w+)((?:\[\d+\])*);")
_TABLE = re.compile(r"static const (double|int) (\w+)\[\d+\] = \{[^}]*\};\n")


class Code(NamedTuple):
    """C code of a value.

    `kind`: number (the same in all lanes), lanes, mask (a condition in each lane), index. `fixed`: it depends on
    parameters and constants only. `simple`: it contains no operation.
    """

    text: str
    kind: str
    fixed: bool = False
    simple: bool = True

    @property
    def lanes(self) -> str:
        """As lanes."""
        if self.kind == "mask":
            return f"lanes_number({self.text})"
        return self.text if self.kind == "lanes" else f"lanes_all({self.text})"

    @property
    def number(self) -> str:
        """As an operand of arithmetic: a number is spread over the lanes by the compiler."""
        return self.text if self.kind == "number" else self.lanes

    @property
    def mask(self) -> str:
        """C code of the condition in each lane."""
        return self.text if self.kind == "mask" else f"((mask)({self.lanes} != 0.0))"


@dataclass
class Fixed:
    """What depends on parameters only, computed once."""

    names: dict[str, str] = field(default_factory=dict)  # code -> name
    kinds: list[str] = field(default_factory=list)

    def name(self, code: Code) -> Code:
        """The value under its name."""
        if code.text not in self.names:
            self.names[code.text] = f"f->v{len(self.names)}"
            self.kinds.append(code.kind)
        return Code(self.names[code.text], code.kind, fixed=True)

    def code(self) -> str:
        """Struct, and the function that computes it."""
        components = [f"    {kind} {name[3:]};" for kind, name in zip(self.kinds, self.names.values(), strict=True)]
        lines = [f"    {name} = {text};" for text, name in self.names.items()]
        return "\n".join(
            [
                "typedef struct {",
                *components,
                "    lanes unused;",
                "} Fixed;",
                "",
                "static void prepare(const Parameters *const p, Fixed *const f) {",
                "    (void)p;",
                "    (void)f;",
                *lines,
                "}",
                "",
            ]
        )


@dataclass(frozen=True)
class Needed:
    """Elements of the outputs that somebody reads, by name of the C code and index."""

    elements: frozenset[tuple[str, int]]
    components: frozenset[str]

    @classmethod
    def of(cls, components: Sequence[tuple[str, int]], slots: Iterable[int]) -> Needed:
        """From the names and sizes of the struct's fields, in their order, and the slots of the elements."""
        places = [(name, i) for name, size in components for i in range(size)]
        found = frozenset(places[s] for s in slots)
        return cls(found, frozenset(name for name, _ in found))

    def has(self, target: Expression) -> bool:
        """Whether an assignment to `y->...` is needed."""
        index = None
        if target.kind == "index":
            target, index = target.parts
        if target.kind != "field":
            raise NotRead("its code writes outputs in another way than by name")
        name = target.text.partition("->")[2]
        if index is not None and index.kind == "number":
            return (name, int(index.text)) in self.elements
        return name in self.components


class Structs:
    """The structs over a component's vectors, by name."""

    def __init__(self, code: str):
        self.code: dict[str, str] = {}
        self.components: dict[str, list[tuple[str, int]]] = {}
        self.arrays: set[str] = set()  # fields that are arrays, as pointer->name
        for body, name in _STRUCT.findall(code):
            rows = [_MEMBER.fullmatch(line.strip()) for line in body.split("\n") if line.strip()]
            if not all(rows):
                raise NotRead(f"its struct {name} has something else than numbers")
            self.components[name] = []
            for row in rows:
                assert row is not None
                size = 1
                for length in re.findall(r"\d+", row[2]):
                    size *= int(length)
                self.components[name].append((row[1], size))
                if row[2]:
                    self.arrays.update(f"{pointer}->{row[1]}" for pointer in _POINTERS.get(name, ()))
            self.code[name] = f"typedef struct {{\n{body}\n}} {name};\n".replace("double ", "lanes ")


def translated(code: str, outputs: Iterable[int]) -> tuple[str, list[str]]:
    """Translate the functions of a `model.c` without comments to lanes; return the code and their names.

    Only the outputs with these slots are needed. Raises NotRead for code that the generator does not write.
    """
    structs = Structs(code)
    tables = {name: kind for kind, name in _TABLE.findall(code)}
    fixed = Fixed()
    functions: list[str] = []
    names: list[str] = []
    needed = Needed.of(structs.components.get("Outputs", []), outputs)
    for name in ("start_states", "derivatives", "outputs", "sample"):
        statements = read_function(code, name)
        if statements is None:
            continue
        functions.append(_Function(name, statements, structs, tables, fixed, needed).code())
        names.append(name)
    if "static void" in (rest := re.sub(r"static void \w+\(const FmuArguments", "", code)) or "goto" in rest:
        raise NotRead("it has functions in the code of CasADi")
    arguments = (
        "typedef struct {\n    double t;\n    const lanes *x, *u, *p, *c;\n    const Fixed *f;\n    lanes *w;\n}"
        " Arguments;\n"
    )
    parameters = structs.code.get("Parameters") or "typedef struct {\n    lanes none;\n} Parameters;\n"
    shown = [text for name, text in structs.code.items() if name in ("Inputs", "States", "Outputs", "Profiles")]
    constants = [m[0] for m in _TABLE.finditer(code)]
    return "\n".join([parameters, *shown, *constants, fixed.code(), arguments, *functions]), names


def _target(statement: Statement) -> Expression | None:
    if isinstance(statement, Assignment):
        return statement.target
    return statement.call.parts[0] if isinstance(statement, Call) else None


def _base(e: Expression) -> Expression:
    """The array or number that is written, without index and offset."""
    while e.kind in ("index", "unary") or (e.kind == "binary" and e.text == "+"):
        e = e.parts[0]
    return e


class _Function:
    """One function over lanes."""

    def __init__(
        self,
        name: str,
        statements: Sequence[Statement],
        structs: Structs,
        tables: Mapping[str, str],
        fixed: Fixed,
        needed: Needed,
    ):
        self._name, self._structs, self._tables, self._fixed, self._needed = name, structs, tables, fixed, needed
        self._values: dict[str, Code] = {"t": Code("t", "number")}
        self._arrays: set[str] = set()
        self._indices: set[str] = set()
        self._live: set[str] = set()
        self._statements = self._wanted(statements)

    # What is needed.

    def _wanted(self, statements: Sequence[Statement]) -> list[Statement]:
        """Those that lead to something needed; names mean one thing in the whole function."""
        kept: list[Statement] = []
        for s in reversed(statements):
            if isinstance(s, Declaration | Work):
                if s.name not in self._live:
                    continue
                if isinstance(s, Declaration):
                    self._live.update(s.value.names())
            elif isinstance(s, If):
                body = self._wanted(s.body)
                if body:
                    self._live.update(s.condition.names())
                    kept.append(If(s.condition, tuple(body)))
                continue
            elif not self._writes_needed(s):
                continue
            kept.append(s)
        return kept[::-1]

    def _writes_needed(self, s: Statement) -> bool:
        inner = s
        while isinstance(inner, For):
            inner = inner.body
        target = _target(inner)
        if target is None:
            raise NotRead("its code has a loop over a declaration")
        base = _base(target)
        if base.kind == "field":
            pointer = base.text.partition("->")[0]
            if pointer not in _RESULTS:
                raise NotRead(f"its code writes to {base.text}")
            needed = pointer != "y" or self._needed.has(target)
        else:
            needed = base.text in self._live
        if needed:
            parts = [inner.value, target] if isinstance(inner, Assignment) else list(inner.call.parts)  # type: ignore[union-attr]
            for part in parts:
                self._live.update(part.names())
        return needed

    # Code.

    def code(self) -> str:
        body = [line for s in self._statements for line in self._statement(s, 1)]
        text = "\n".join(body)
        second = ", lanes *second" if self._name == "sample" else ""
        views = []
        for pointer, struct in VECTORS.items():
            if struct in self._structs.code:
                views.append(f"const {struct} *const {pointer} = (const {struct} *)at->{pointer}")
        results = {
            "start_states": (("start", "States", "result"),),
            "derivatives": (("der", "States", "result"),),
            "outputs": (("y", "Outputs", "result"),),
            "sample": (("y", "Outputs", "result"), ("next", "States", "second")),
        }[self._name]
        for pointer, struct, argument in results:
            if struct in self._structs.code:
                views.append(f"{struct} *const {pointer} = ({struct} *){argument}")
            else:
                text = f"    (void){argument};\n{text}"
        views += ["const Fixed *const f = at->f", "const double t = at->t", "lanes *const w = at->w"]
        head = [f"    {v};" for v in views]
        head += [f"    (void){v.split(' = ')[0].split()[-1].lstrip('*')};" for v in views]
        return "\n".join(
            [
                f"static void {self._name}(const Arguments *const at, lanes *const result{second}) {{",
                *head,
                text,
                "}",
                "",
            ]
        )

    def _statement(self, s: Statement, depth: int, inside: bool = False) -> list[str]:
        indent = "    " * depth
        if isinstance(s, Work):
            self._arrays.add(s.name)
            return [f"{indent}lanes *const {s.name} = w + {s.place};"]
        if isinstance(s, Declaration):
            return self._declared(s, indent)
        if isinstance(s, If):
            condition = self._hoisted(self._code(s.condition))
            body = [line for b in s.body for line in self._statement(b, depth + 1, inside=True)]
            return [f"{indent}if (lanes_any({condition.mask})) {{", *body, f"{indent}}}"]
        if inside and not (isinstance(s, Assignment) and s.target.kind == "name" and s.target.text in self._values):
            raise NotRead("its code has more than numbers under a condition")
        if isinstance(s, For):
            self._indices.add(s.variable)
            body = self._statement(s.body, depth + 1)
            head = f"{indent}for (int {s.variable} = {s.begin}; {s.variable} < {s.end}; {s.variable}++) {{"
            return [head, *body, f"{indent}}}"]
        if isinstance(s, Call):
            return [f"{indent}{self._procedure(s.call)};"]
        return [f"{indent}{self._written(s.target, s.value)};"]

    def _declared(self, s: Declaration, indent: str) -> list[str]:
        value = self._code(s.value)
        kind = "mask" if s.kind == "int" else "lanes"
        if s.constant:
            if value.fixed and value.kind != "number" and (value.kind == kind or not value.simple):
                text = value.mask if kind == "mask" else value.lanes
                self._values[s.name] = self._fixed.name(Code(text, kind, fixed=True))
                return []
            if value.kind == "number" and kind == "lanes":
                self._values[s.name] = Code(s.name, "number", fixed=value.fixed)
                return [f"{indent}const double {s.name} = {value.text};"]
        self._values[s.name] = Code(s.name, kind)
        if s.kind == "int" and value.kind == "number" and not s.constant:
            return [f"{indent}mask {s.name} = {{0}};"]  # 0, until a condition gives it another value
        text = value.mask if kind == "mask" else value.lanes
        return [f"{indent}{'const ' if s.constant else ''}{kind} {s.name} = {text};"]

    def _written(self, target: Expression, value: Expression) -> str:
        code = self._code(value)
        if target.kind == "name":
            known = self._values.get(target.text)
            if known is None:
                raise NotRead(f"its code writes to {target.text}, which it does not declare")
            return f"{target.text} = {code.mask if known.kind == 'mask' else code.lanes}"
        return f"{self._place(target)} = {code.lanes}"

    def _place(self, e: Expression) -> str:
        """Where something is written."""
        if e.kind == "field":
            return e.text
        if e.kind == "index":
            array, kind = self._pointer(e.parts[0])
            if kind != "lanes":
                raise NotRead("its code writes to a table")
            return f"{array}[{self._index(e.parts[1])}]"
        raise NotRead(f"its code writes to '{e.text}'")

    def _procedure(self, call: Expression) -> str:
        name, parts = call.text, call.parts
        if name in ("product", "add_product"):
            (z, _), (x, of_x), (y, of_y) = (self._pointer(p) for p in parts[:3])
            sizes = ", ".join(self._index(p) for p in parts[3:])
            return f"lanes_{name}_{of_x}_{of_y}({z}, {x}, {y}, {sizes})"
        if name == "store":
            array, _ = self._pointer(parts[0])
            index, value = (self._code(p).lanes for p in parts[2:])
            return f"lanes_store({array}, {self._index(parts[1])}, {index}, {value})"
        raise NotRead(f"its code calls {name}")

    def _pointer(self, e: Expression) -> tuple[str, str]:
        """An array, and what is in it: lanes, or a table's numbers."""
        if e.kind == "name" and e.text in self._arrays:
            return e.text, "lanes"
        if e.kind == "name" and self._tables.get(e.text) == "double":
            return e.text, "table"
        if e.kind == "field":
            if e.text not in self._structs.arrays:
                raise NotRead(f"its code has {e.text} in place of an array")
            return self._checked(e.text), "lanes"
        if e.kind == "index":  # a row of a matrix
            array, kind = self._pointer(e.parts[0])
            return f"{array}[{self._index(e.parts[1])}]", kind
        if e.kind == "flat" and e.text in VECTORS:
            return f"((const lanes *){e.text})", "lanes"
        if e.kind == "binary" and e.text == "+":
            array, kind = self._pointer(e.parts[0])
            return f"({array} + {self._index(e.parts[1])})", kind
        if e.kind == "unary" and e.text == "&":
            return f"&{self._checked(e.parts[0].text)}", "lanes"
        raise NotRead(f"its code has '{e.text}' in place of an array")

    def _checked(self, component: str) -> str:
        pointer = component.partition("->")[0]
        if pointer not in VECTORS and pointer not in _RESULTS:
            raise NotRead(f"its code reads {component}")
        return component

    def _index(self, e: Expression) -> str:
        """A whole number that is the same in all lanes."""
        if e.kind == "number" and e.text.isdecimal():
            return e.text
        if e.kind == "name" and e.text in self._indices:
            return e.text
        if e.kind == "index" and e.parts[0].kind == "name" and self._tables.get(e.parts[0].text) == "int":
            return f"{e.parts[0].text}[{self._index(e.parts[1])}]"
        if e.kind == "binary" and e.text in ("+", "-", "*"):
            return f"({self._index(e.parts[0])} {e.text} {self._index(e.parts[1])})"
        raise NotRead(f"its code has '{e.text}' as an index")

    def _hoisted(self, code: Code) -> Code:
        """As an operand of what is not fixed."""
        return self._fixed.name(code) if code.fixed and not code.simple and code.kind in ("lanes", "mask") else code

    def _operation(self, write: str, kind: str, operands: Sequence[Code], how: Sequence[str]) -> Code:
        """`write` with {0}, {1}, ... for operands as `how` says: number, lanes or mask."""
        fixed = all(o.fixed for o in operands)
        if not fixed:
            operands = [self._hoisted(o) for o in operands]
        return Code(
            write.format(*(getattr(o, h) for o, h in zip(operands, how, strict=True))), kind, fixed, simple=False
        )

    def _code(self, e: Expression) -> Code:
        if e.kind == "number":
            return Code(e.text, "number", fixed=True)
        if e.kind == "name":
            if e.text not in self._values:
                raise NotRead(f"its code has '{e.text}' as a number")
            return self._values[e.text]
        if e.kind == "field":
            return Code(self._checked(e.text), "lanes", fixed=e.text.startswith("p->"))
        if e.kind == "index":
            array, kind = self._pointer(e.parts[0])
            fixed = kind == "table" or array.startswith("p->")
            index = self._index(e.parts[1])
            constant = e.parts[1].kind == "number"
            return Code(f"{array}[{index}]", "lanes" if kind == "lanes" else "number", fixed=fixed and constant)
        if e.kind == "cast":
            value = self._code(e.parts[0])
            return self._operation("{0}", "lanes", [value], ["lanes"]) if value.kind == "mask" else value
        if e.kind == "unary":
            return self._unary(e)
        if e.kind == "binary":
            return self._binary(e)
        if e.kind == "call":
            return self._call(e)
        raise NotRead(f"its code has '{e.text}' as a value")

    def _unary(self, e: Expression) -> Code:
        value = self._code(e.parts[0])
        if e.text == "!":
            return self._operation("(~{0})", "mask", [value], ["mask"])
        if e.text != "-":
            raise NotRead(f"its code has '{e.text}'")
        if value.kind == "number":
            return Code(f"(-{value.text})", "number", value.fixed)
        return self._operation("(-{0})", "lanes", [value], ["lanes"])

    def _binary(self, e: Expression) -> Code:
        a, b = (self._code(part) for part in e.parts)
        if e.text in ("&&", "||"):
            return self._operation(f"({{0}} {e.text[0]} {{1}})", "mask", [a, b], ["mask", "mask"])
        numbers = a.kind == b.kind == "number"
        if e.text in ("<", "<=", ">", ">=", "==", "!="):
            how = ["lanes", "lanes"] if numbers else ["number", "number"]
            return self._operation(f"((mask)({{0}} {e.text} {{1}}))", "mask", [a, b], how)
        return self._operation(
            f"({{0}} {e.text} {{1}})", "number" if numbers else "lanes", [a, b], ["number", "number"]
        )

    def _call(self, e: Expression) -> Code:
        name = e.text
        if name == "look_up":
            array, kind = self._pointer(e.parts[0])
            index = self._code(e.parts[2])
            return Code(
                f"lanes_look_up_{kind}({array}, {self._index(e.parts[1])}, {self._hoisted(index).lanes})",
                "lanes",
                simple=False,
            )
        if name in ("smallest", "largest"):
            array, kind = self._pointer(e.parts[0])
            if kind != "lanes":
                raise NotRead(f"its code has {name} of a table")
            return Code(f"lanes_{name}({array}, {self._index(e.parts[1])})", "lanes", simple=False)
        operands = [self._code(part) for part in e.parts]
        if name == "when":
            return self._operation("lanes_when({0}, {1})", "lanes", operands, ["mask", "lanes"])
        if name == "if_else":
            return self._operation("lanes_if_else({0}, {1}, {2})", "lanes", operands, ["mask", "lanes", "lanes"])
        if name not in FUNCTIONS:
            raise NotRead(f"its code calls {name}")
        if all(o.kind == "number" for o in operands):
            return Code(
                f"{name}({', '.join(o.text for o in operands)})", "number", all(o.fixed for o in operands), simple=False
            )
        if name in ("fmin", "fmax"):
            return self._extreme(name, e.parts, operands)
        write = f"lanes_{name}({', '.join(f'{{{i}}}' for i in range(len(operands)))})"
        return self._operation(write, "lanes", operands, ["lanes"] * len(operands))

    def _extreme(self, name: str, parts: Sequence[Expression], operands: Sequence[Code]) -> Code:
        """Smaller or larger of two numbers.

        It is one instruction if one of the two is known to be neither NaN nor the zero that would win.
        """
        for i in (0, 1):
            value = _literal(parts[i])
            if value is not None and (value != 0.0 or (name == "fmax" and not str(value).startswith("-"))):
                write = f"lanes_{name}_of_known({{{1 - i}}}, {{{i}}})"
                return self._operation(write, "lanes", operands, ["lanes", "lanes"])
        return self._operation(f"lanes_{name}({{0}}, {{1}})", "lanes", operands, ["lanes", "lanes"])


def _literal(e: Expression) -> float | None:
    """The value of a number that stands in the code, if it is finite."""
    if e.kind == "unary" and e.text == "-":
        value = _literal(e.parts[0])
        return None if value is None else -value
    return float(e.text) if e.kind == "number" and e.text[:1].isdigit() else None
