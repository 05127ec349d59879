"""Mistakes that somebody could make in a line, by the kind of mistake.

Such as another factor, swapped columns, a signal under another name.
"""

from __future__ import annotations

import ast
import hashlib
import re
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any

_NAME = re.compile(r"[A-Za-z][\w.\-]*")  # texts that name something, no sentences
_TURNED: dict[type[ast.cmpop], type[ast.cmpop]] = {
    ast.Lt: ast.Gt,
    ast.Gt: ast.Lt,
    ast.LtE: ast.GtE,
    ast.GtE: ast.LtE,
    ast.Eq: ast.NotEq,
    ast.NotEq: ast.Eq,
    ast.In: ast.NotIn,
    ast.NotIn: ast.In,
    ast.Is: ast.IsNot,
    ast.IsNot: ast.Is,
}
_OTHER_SIGN: dict[type[ast.operator], tuple[str, type[ast.operator]]] = {
    ast.Add: ("sign", ast.Sub),
    ast.Sub: ("sign", ast.Add),
    ast.Mult: ("times", ast.Div),
    ast.Div: ("times", ast.Mult),
}
_OTHER_FUNCTION = {
    "max": "min",
    "min": "max",
    "mean": "median",
    "median": "mean",
    "sum": "max",
    "any": "all",
    "all": "any",
    "diff": "cumsum",
    "argmax": "argmin",
    "argmin": "argmax",
    "degrees": "radians",
    "radians": "degrees",
    "floor": "ceil",
    "ceil": "floor",
}
_COMMUTE = ("max", "min", "fmax", "fmin", "hypot", "maximum", "minimum", "gcd", "isclose", "logical_and", "logical_or")
_LEFT_OUT = ("abs", "sqrt", "round", "sorted", "reversed", "log10")  # functions of one argument
_HIDDEN = (ast.Raise, ast.Assert, ast.Import, ast.ImportFrom)  # nothing in there is seen


@dataclass(frozen=True)
class Mutant:
    """One mistake: `before` became `after` in the function `where`, the `number`-th such place of it."""

    file: str
    where: str
    kind: str
    before: str
    after: str
    number: int

    @property
    def id(self) -> str:
        """Names the mistake as long as its function stays as it is, whatever is written around it."""
        return " | ".join([self.place, self.kind, f"{self.before} -> {self.after}", str(self.number)])

    @property
    def place(self) -> str:
        """File and function."""
        return f"{self.file} | {self.where}"


@dataclass(frozen=True)
class _Site:
    where: str
    kind: str
    before: str
    after: str
    apply: Callable[[], None]


def mutants(file: str, source: str) -> list[Mutant]:
    """All mistakes of the known kinds that can be made in a file."""
    return [mutant for mutant, _ in _numbered(file, ast.parse(source))]


def mutated(mutant: Mutant, source: str) -> str:
    """The file with one mistake.

    Raises:
        LookupError: there is no such place in this source.
    """
    tree = ast.parse(source)
    for found, apply in _numbered(mutant.file, tree):
        if found == mutant:
            apply()
            return ast.unparse(ast.fix_missing_locations(tree))
    raise LookupError(mutant.id)


def sample(found: list[Mutant], most: int, seed: str = "1") -> list[Mutant]:
    """At most so many mutations of each kind in each file, chosen by the hash of their names.

    So the same ones are chosen as long as they exist.
    """
    strata: dict[tuple[str, str], list[Mutant]] = {}
    for mutant in found:
        strata.setdefault((mutant.file, mutant.kind), []).append(mutant)
    chosen = [
        m
        for stratum in strata.values()
        for m in sorted(stratum, key=lambda m: hashlib.sha256((seed + m.id).encode()).digest())[:most]
    ]
    order = {mutant: i for i, mutant in enumerate(found)}
    return sorted(chosen, key=order.__getitem__)


def _numbered(file: str, tree: ast.Module) -> Iterator[tuple[Mutant, Callable[[], None]]]:
    seen: dict[tuple[str, ...], int] = {}
    for site in _Sites(tree).found:
        key = (site.where, site.kind, site.before, site.after)
        seen[key] = seen.get(key, 0) + 1
        yield Mutant(file, *key, seen[key]), site.apply


class _Sites:
    """Goes through a module and notes every place where a mistake can be made, each with what makes it in this tree."""

    def __init__(self, tree: ast.Module) -> None:
        self.found: list[_Site] = []
        self._where: list[str] = []
        self._names = list(dict.fromkeys(_names(tree)))
        self._texts = list(dict.fromkeys(ast.unparse(n) for n in ast.walk(tree) if _is_pattern(n)))
        self._visit(tree)

    def _visit(self, node: ast.AST) -> None:
        if isinstance(node, _HIDDEN) or _is_for_type_checkers(node) or _is_hint(node):
            return
        if named := isinstance(node, ast.FunctionDef | ast.ClassDef):
            self._where.append(node.name)
        look = getattr(self, f"_in_{type(node).__name__.lower()}", None)
        if look is not None:
            look(node)
        for name, value in ast.iter_fields(node):
            if name in ("annotation", "returns", "bases", "type_params", "format_spec") or (
                name == "type" and isinstance(node, ast.ExceptHandler)
            ):
                continue
            for child in value if isinstance(value, list) else [value]:
                if isinstance(child, ast.AST):
                    self._visit(child)
        if named:
            self._where.pop()

    def _note(self, kind: str, before: ast.AST | str, after: str, apply: Callable[[], None]) -> None:
        text = before if isinstance(before, str) else ast.unparse(before)
        if text != after:
            self.found.append(_Site(".".join(self._where) or "module", kind, _short(text), _short(after), apply))

    def _replace(self, kind: str, whole: ast.AST, owner: Any, field: str, new: Any) -> None:
        """Note that `owner.field` becomes `new`; `whole` is the expression that people know the place by."""
        old = getattr(owner, field)

        def apply() -> None:
            setattr(owner, field, new)

        before = ast.unparse(whole)
        apply()
        after = ast.unparse(ast.fix_missing_locations(whole))
        setattr(owner, field, old)
        self._note(kind, before, after, apply)

    def _swap(self, kind: str, whole: ast.AST, items: list[Any], i: int) -> None:
        def apply() -> None:
            items[i], items[i + 1] = items[i + 1], items[i]

        if ast.unparse(items[i]) != ast.unparse(items[i + 1]):
            pair = f"{ast.unparse(items[i])}, {ast.unparse(items[i + 1])}"
            swapped = f"{ast.unparse(items[i + 1])}, {ast.unparse(items[i])}"
            head = f"{ast.unparse(whole.func)}: " if isinstance(whole, ast.Call) else ""
            self._note(kind, head + pair, head + swapped, apply)

    # ------------------------------------------------------------------------------------------- kinds, by what is read

    def _in_call(self, node: ast.Call) -> None:
        name = node.func.attr if isinstance(node.func, ast.Attribute) else getattr(node.func, "id", "")
        if name in ("isinstance", "getattr", "cast", "TypeVar", "super"):
            return
        if name in _OTHER_FUNCTION:
            owner, field = (node.func, "attr") if isinstance(node.func, ast.Attribute) else (node.func, "id")
            if not (name == "sum" and isinstance(node.func, ast.Attribute) and node.args):
                self._replace("function", node, owner, field, _OTHER_FUNCTION[name])
        if name in _LEFT_OUT and len(node.args) == 1 and not node.keywords:
            plain = (
                ast.Call(ast.Name("list", ast.Load()), [node.args[0]], [])
                if name in ("sorted", "reversed")
                else node.args[0]
            )
            self._becomes("function", node, plain)
        for i in range(len(node.args) - 1 if name not in _COMMUTE else 0):
            if not any(isinstance(a, ast.Starred | ast.GeneratorExp) for a in node.args[i : i + 2]):
                self._swap("arguments", node, node.args, i)
        for argument in [*node.args, *(k.value for k in node.keywords)]:
            self._name(argument)

    def _becomes(self, kind: str, node: ast.AST, new: ast.AST) -> None:
        """Note that a node becomes another one in its place; by its fields, since its parent is not known."""
        before, after = ast.unparse(node), ast.unparse(ast.fix_missing_locations(new))

        def apply() -> None:
            node.__class__ = new.__class__  # type: ignore[assignment]
            node.__dict__ = dict(new.__dict__)

        self._note(kind, before, after, apply)

    def _in_list(self, node: ast.List | ast.Tuple) -> None:
        if isinstance(node.ctx, ast.Load):
            for i in range(len(node.elts) - 1):
                if not any(isinstance(e, ast.Starred) for e in node.elts[i : i + 2]):
                    self._swap("items", node, node.elts, i)

    _in_tuple = _in_list

    def _in_dict(self, node: ast.Dict) -> None:
        for i in range(len(node.values) - 1):
            if None not in node.keys[i : i + 2]:
                self._swap("items", node, node.values, i)

    def _in_subscript(self, node: ast.Subscript) -> None:
        self._name(node.slice)
        for part in node.slice.elts if isinstance(node.slice, ast.Tuple) else [node.slice]:
            self._bounds(node, part)

    def _bounds(self, whole: ast.Subscript, part: ast.expr) -> None:
        """An index or a slice that is off by one."""
        whole_ = whole
        if isinstance(part, ast.Slice):
            for field in ("lower", "upper"):
                bound = getattr(part, field)
                if bound is not None:
                    more = 1 if field == "lower" else -1
                    self._replace("slice", whole_, part, field, _plus(bound, more))
            if part.lower is None and part.upper is not None and part.step is None:
                self._replace("slice", whole_, part, "lower", ast.Constant(1))
        elif (value := _whole_number(part)) is not None:
            index = ast.Constant(value + 1) if value >= 0 else ast.Constant(value - 1)
            if part is whole_.slice:
                self._replace("slice", whole_, whole_, "slice", index)

    def _in_compare(self, node: ast.Compare) -> None:
        for i, op in enumerate(node.ops):
            ops = [*node.ops]
            ops[i] = _TURNED[type(op)]()
            self._replace("comparison", node, node, "ops", ops)
        for side in [node.left, *node.comparators]:
            self._name(side)

    def _in_binop(self, node: ast.BinOp) -> None:
        if type(node.op) in _OTHER_SIGN and not (_is_text(node.left) or _is_text(node.right)):
            kind, other = _OTHER_SIGN[type(node.op)]
            self._replace(kind, node, node, "op", other())
        for field in ("left", "right"):
            self._number(node, node, field)

    def _in_assign(self, node: ast.Assign | ast.AnnAssign | ast.keyword) -> None:
        if node.value is not None:
            self._number(node, node, "value")

    _in_annassign = _in_keyword = _in_assign

    def _in_constant(self, _: ast.Constant) -> None:
        return

    def _number(self, whole: ast.AST, owner: Any, field: str) -> None:
        """A factor, power or limit that is another one."""
        node = getattr(owner, field)
        if (
            isinstance(node, ast.Constant)
            and isinstance(node.value, int | float)
            and not isinstance(node.value, bool)
            and node.value
        ):
            value = node.value
            power_of_ten = float(f"{abs(value):.0e}") == abs(value) and f"{abs(value):e}"[0] == "1" and value != 1
            other = 1 if value in (3.6, 60, 180) else value / 10 if power_of_ten else 2 * value
            other = int(other) if isinstance(value, int) and other == int(other) else other
            self._replace("number", whole, owner, field, ast.Constant(other))

    def _in_unaryop(self, node: ast.UnaryOp) -> None:
        if isinstance(node.op, ast.USub | ast.Not) and _whole_number(node) is None:
            self._becomes("sign" if isinstance(node.op, ast.USub) else "condition", node, node.operand)

    def _in_boolop(self, node: ast.BoolOp) -> None:
        self._replace("condition", node, node, "op", ast.Or() if isinstance(node.op, ast.And) else ast.And())

    def _in_ifexp(self, node: ast.IfExp) -> None:
        self._becomes("condition", node, ast.IfExp(node.test, node.orelse, node.body))

    def _name(self, node: ast.expr) -> None:
        """A text that names something, and becomes the name of its neighbor in the file."""
        if isinstance(node, ast.Constant) and isinstance(node.value, str) and node.value in self._names:
            at = self._names.index(node.value)
            if len(self._names) > 1:
                self._replace("name", node, node, "value", self._names[(at + 1) % len(self._names)])
        elif _is_pattern(node):
            at = self._texts.index(ast.unparse(node))
            other = self._texts[(at + 1) % len(self._texts)]
            if len(self._texts) > 1 and _free(other) <= _free(self._texts[at]):
                self._becomes("name", node, ast.parse(other, mode="eval").body)


def _names(tree: ast.Module) -> Iterator[str]:
    """Texts of a file that name something: used as keys, arguments, or in comparisons."""
    for node in ast.walk(tree):
        places: list[Any] = []
        if isinstance(node, ast.Subscript):
            places = [node.slice]
        elif isinstance(node, ast.Call):
            places = [*node.args, *(k.value for k in node.keywords)]
        elif isinstance(node, ast.Compare):
            places = [node.left, *node.comparators]
        for place in places:
            if isinstance(place, ast.Constant) and isinstance(place.value, str) and _NAME.fullmatch(place.value):
                yield place.value


def _is_pattern(node: ast.AST) -> bool:
    """A text made of names, such as `f"car.wheel.{k}.z"`."""
    if not isinstance(node, ast.JoinedStr) or not any(isinstance(v, ast.FormattedValue) for v in node.values):
        return False
    written = "".join(str(v.value) for v in node.values if isinstance(v, ast.Constant))
    return bool(re.fullmatch(r"[\w.\-\[\]]*\.[\w.\-\[\]]*", written))


def _free(text: str) -> set[str]:
    return {n.id for n in ast.walk(ast.parse(text, mode="eval")) if isinstance(n, ast.Name)}


def _is_text(node: ast.AST) -> bool:
    return isinstance(node, ast.JoinedStr | ast.List | ast.ListComp | ast.Tuple | ast.Dict | ast.Set) or (
        isinstance(node, ast.Constant) and isinstance(node.value, str)
    )


def _is_for_type_checkers(node: ast.AST) -> bool:
    if isinstance(node, ast.If):
        return isinstance(node.test, ast.Name) and node.test.id == "TYPE_CHECKING"
    return isinstance(node, ast.Assign) and any(isinstance(t, ast.Name) and t.id == "__all__" for t in node.targets)


def _is_hint(node: ast.AST) -> bool:
    """A call that looks for what a user may have meant."""
    return isinstance(node, ast.Call) and ast.unparse(node.func) in ("nearest", "did_you_mean")


def _whole_number(node: ast.AST) -> int | None:
    negative = isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.USub)
    value = node.operand if negative else node  # type: ignore[attr-defined]
    if isinstance(value, ast.Constant) and isinstance(value.value, int) and not isinstance(value.value, bool):
        return -value.value if negative else value.value
    return None


def _plus(node: ast.expr, more: int) -> ast.expr:
    value = _whole_number(node)
    if value is not None:
        return ast.Constant(value + more)
    return ast.BinOp(node, ast.Add() if more > 0 else ast.Sub(), ast.Constant(abs(more)))


def _short(text: str) -> str:
    text = " ".join(text.split())
    return text if len(text) <= 120 else f"{text[:80]}...{text[-37:]}"
