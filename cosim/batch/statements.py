"""Reads the generated functions of a component back from its C code, as `build_fmus.equations` writes them.

Any other code is rejected (`NotRead`), so no statement is ever misunderstood.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass
from functools import lru_cache
from typing import NamedTuple


class NotRead(Exception):  # noqa: N818
    """Code that is not written as the generator writes it; the argument says what."""


class Expression(NamedTuple):
    """An expression of the generated C code.

    `kind`: number, name, field (pointer->name), index (array[i]), flat (all of a vector), unary, binary, call or cast;
    `text`: number, name, operator or function; `parts`: operands.
    """

    kind: str
    text: str
    parts: tuple[Expression, ...] = ()

    def names(self) -> Iterator[str]:
        """All names in it; of struct fields as pointer->name."""
        if self.kind in ("name", "field"):
            yield self.text
        elif self.kind == "flat":
            yield f"{self.text}->"
        for part in self.parts:
            yield from part.names()


@dataclass(frozen=True)
class Declaration:
    """A number or a condition (`int`) with its value; if not constant, it may get another value under a condition."""

    name: str
    kind: str
    constant: bool
    value: Expression


@dataclass(frozen=True)
class Work:
    """An array in the work memory."""

    name: str
    place: int


@dataclass(frozen=True)
class Assignment:
    """An assignment of a value to a name, a field or an element of an array."""

    target: Expression
    value: Expression


@dataclass(frozen=True)
class Call:
    """A function that writes into its first argument."""

    call: Expression


@dataclass(frozen=True)
class If:
    """Statements that are executed if a condition holds."""

    condition: Expression
    body: tuple[Statement, ...]


@dataclass(frozen=True)
class For:
    """A statement that is repeated with an index from `begin` to `end`."""

    variable: str
    begin: int
    end: int
    body: Statement


Statement = Declaration | Work | Assignment | Call | If | For

_TOKEN = re.compile(
    r"\s*(?:(\d+(?:\.\d*)?(?:e[+-]?\d+)?)|([A-Za-z_]\w*)|(->|&&|\|\||<=|>=|==|!=|\+\+|[-+*/<>=!()\[\]{},;&]))"
)
_COMMENT = re.compile(r"/\*.*?\*/", re.DOTALL)
_FUNCTION = r"^static void {name}\(const FmuArguments \*at, double \*result(?:, double \*second)?\) \{{\n(.*?)^\}}\n"
_LEVELS = (("||",), ("&&",), ("==", "!="), ("<", "<=", ">", ">="), ("+", "-"), ("*", "/"))


def without_comments(code: str) -> str:
    """C code without its comments."""
    return _COMMENT.sub(" ", code)


@lru_cache(maxsize=16)
def read_function(code: str, name: str) -> tuple[Statement, ...] | None:
    """Statements of a generated function of a `model.c` without comments; None where there is no such function."""
    found = re.search(_FUNCTION.format(name=name), code, re.DOTALL | re.MULTILINE)
    return None if found is None else _Reader(found[1]).all()


class _Reader:
    def __init__(self, code: str):
        self._tokens: list[str] = []
        self._at, place = 0, 0
        code = code.rstrip()
        for match in _TOKEN.finditer(code):
            if match.start() != place:
                break
            self._tokens.append(match[match.lastindex or 0])
            place = match.end()
        if place < len(code):
            raise NotRead(f"its code has '{code[place : place + 20].strip()}'")

    # Tokens.

    def _peek(self, ahead: int = 0) -> str:
        at = self._at + ahead
        return self._tokens[at] if at < len(self._tokens) else ""

    def _next(self) -> str:
        self._at += 1
        return self._tokens[self._at - 1] if self._at <= len(self._tokens) else ""

    def _take(self, *expected: str) -> None:
        for token in expected:
            if self._next() != token:
                raise NotRead(f"its code has '{' '.join(self._tokens[max(0, self._at - 4) : self._at + 3])}'")

    def _takes(self, *expected: str) -> bool:
        if all(self._peek(i) == token for i, token in enumerate(expected)):
            self._at += len(expected)
            return True
        return False

    def _until_semicolon(self) -> list[str]:
        begin = self._at
        while self._next() != ";":
            if self._at > len(self._tokens):
                raise NotRead("its code ends within a statement")
        return self._tokens[begin : self._at - 1]

    def _integer(self) -> int:
        token = self._next()
        if not token.isdecimal():
            raise NotRead(f"its code has '{token}' in place of a whole number")
        return int(token)

    # Statements.

    def all(self) -> tuple[Statement, ...]:
        """Everything there is."""
        found = tuple(self.statements())
        if self._peek():
            raise NotRead(f"its code has '{' '.join(self._tokens[max(0, self._at - 4) : self._at + 3])}'")
        return found

    def statements(self) -> Iterator[Statement]:
        while self._peek() and self._peek() != "}":
            yield from self._statement()

    def _statement(self) -> Iterator[Statement]:
        if self._takes("(", "void", ")") or "at" in (line := self._rest_of_line()) or self._is_view(line):
            self._until_semicolon()  # arguments under names of their own
        elif self._takes("double", "*", "const"):
            name = self._next()
            self._take("=", "w", "+")
            yield Work(name, self._integer())
            self._take(";")
        elif self._peek() in ("const", "double", "int"):
            yield from self._declaration()
        elif self._takes("if", "("):
            condition = self._expression()
            self._take(")", "{")
            body = tuple(self.statements())
            self._take("}")
            if self._peek() == "else":
                raise NotRead("its code has 'else'")
            yield If(condition, body)
        elif self._takes("for", "(", "int"):
            yield self._loop()
        else:
            yield self._assignment()

    def _rest_of_line(self) -> list[str]:
        begin, at = self._at, self._at
        while at < len(self._tokens) and self._tokens[at] not in (";", "{"):
            at += 1
        return self._tokens[begin:at]

    @staticmethod
    def _is_view(line: list[str]) -> bool:
        """A struct over what is given or over a result: `States *const der = (States *)result;`."""
        return line[-1:] in (["result"], ["second"]) and "*" in line

    def _declaration(self) -> Iterator[Declaration]:
        constant = self._takes("const")
        kind = self._next()
        if kind not in ("double", "int"):
            raise NotRead(f"its code declares a '{kind}'")
        while True:
            name = self._next()
            self._take("=")
            yield Declaration(name, kind, constant, self._expression())
            if not self._takes(","):
                break
        self._take(";")

    def _loop(self) -> For:
        variable = self._next()
        self._take("=")
        begin = self._integer()
        self._take(";", variable, "<")
        end = self._integer()
        self._take(";", variable, "++", ")")
        (body,) = self._statement()
        return For(variable, begin, end, body)

    def _assignment(self) -> Assignment | Call:
        target = self._operand()
        if self._takes(";"):
            if target.kind != "call":
                raise NotRead(f"its code has '{target.text}' as a statement")
            return Call(target)
        self._take("=")
        value = self._expression()
        self._take(";")
        return Assignment(target, value)

    # Expressions.

    def _expression(self, level: int = 0) -> Expression:
        if level == len(_LEVELS):
            return self._unary()
        left = self._expression(level + 1)
        while self._peek() in _LEVELS[level]:
            operator = self._next()
            left = Expression("binary", operator, (left, self._expression(level + 1)))
        return left

    def _unary(self) -> Expression:
        if self._peek() in ("-", "!", "&"):
            return Expression("unary", self._next(), (self._unary(),))
        if self._takes("(", "double", ")"):
            return Expression("cast", "double", (self._unary(),))
        return self._operand()

    def _operand(self) -> Expression:
        if self._takes("(", "(", "const", "double", "*", ")"):
            found = Expression("flat", self._next())
            self._take(")")
        elif self._takes("("):
            found = self._expression()
            self._take(")")
            return found
        else:
            found = self._name()
        while self._takes("["):
            found = Expression("index", "", (found, self._expression()))
            self._take("]")
        return found

    def _name(self) -> Expression:
        token = self._next()
        if token[:1].isdigit() or token in ("NAN", "INFINITY"):
            return Expression("number", token)
        if not token.isidentifier():
            raise NotRead(f"its code has '{' '.join(self._tokens[max(0, self._at - 4) : self._at + 3])}'")
        if self._takes("->"):
            return Expression("field", f"{token}->{self._next()}")
        if self._takes("("):
            arguments = []
            while not self._takes(")"):
                arguments.append(self._expression())
                if self._peek() != ")":
                    self._take(",")
            return Expression("call", token, tuple(arguments))
        return Expression("name", token)
