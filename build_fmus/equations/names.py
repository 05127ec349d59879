"""C identifiers, and C structs whose fields are the elements of one of the runtime's vectors by their names."""

from __future__ import annotations

import bisect
import re
import textwrap
from collections.abc import Collection, Sequence
from dataclasses import dataclass
from math import prod

from build_fmus.base.escape import c_comment
from build_fmus.equations.operators import FUNCTIONS, HELPERS

WIDTH = 120
# Of C, of C++ (headers of firmware), of headers and compilers.
_KEYWORDS = frozenset(
    re.findall(
        r"\w+",
        """
    auto break case char const continue default do double else enum extern float for goto if inline int long
    register restrict return short signed sizeof static struct switch typedef union unsigned void volatile while
    alignas alignof and and_eq asm bitand bitor bool catch char16_t char32_t class compl const_cast constexpr
    decltype delete dynamic_cast explicit export false friend mutable namespace new noexcept not not_eq nullptr
    operator or or_eq private protected public reinterpret_cast static_assert static_cast template this
    thread_local throw true try typeid typename using virtual wchar_t xor xor_eq
    I INFINITY NAN NULL linux unix i386 near far scalar local
    """,
    )
)
# What generated functions call their own: arguments, pointers to vectors, indices.
_OWN = frozenset(
    (
        "at",
        "result",
        "second",
        "t",
        "x",
        "u",
        "p",
        "f",
        "s",
        "w",
        "y",
        "dx",
        "du",
        "dp",
        "dy",
        "der",
        "d_der",
        "next",
        "start",
        "d_start",
        "data",
        "i",
        "j",
        "c",
        "profiles",
        "profile_settings",
        "spectra",
    )
)


def identifier(name: str, taken: Collection[str] = (), *, local: bool = True) -> str:
    """A C identifier for `name` (`suspension.stiffness` -> `suspension_stiffness`) that is not taken yet.

    `local`: of a variable in a generated function, where more names are taken than behind an arrow.
    """
    result = re.sub(r"\W+", "_", name)
    while result in _KEYWORDS or result in taken or (local and result in _RESERVED):
        result += "_"
    return result


_RESERVED = frozenset((*_OWN, *HELPERS, *FUNCTIONS))


@dataclass(frozen=True)
class Field:
    """A field of a struct: its shape (() for a scalar), its first position in the vector, and its comment."""

    name: str
    shape: tuple[int, ...]
    slot: int
    comment: str

    @property
    def size(self) -> int:
        """Number of elements."""
        return prod(self.shape)


class Struct:
    """A C struct that lies over a vector, field after field without gaps."""

    def __init__(self, name: str, title: str, variables: Sequence[tuple[str, tuple[int, ...], str]]) -> None:
        """`variables`: name, shape and comment of each; the title says what the struct is."""
        self.name, self.title = name, title
        self.fields: list[Field] = []
        taken: set[str] = set()
        slot = 0
        for text, shape, comment in variables:
            field = Field(identifier(text, taken, local=False), shape, slot, comment)
            taken.add(field.name)
            self.fields.append(field)
            slot += field.size
        self.size = slot
        self._slots = [m.slot for m in self.fields]

    def field_at(self, slot: int) -> Field:
        """The field that an element of the vector belongs to."""
        return self.fields[bisect.bisect_right(self._slots, slot) - 1]

    def element(self, slot: int) -> str:
        """C code of an element, behind the pointer to the struct."""
        m = self.field_at(slot)
        index = slot - m.slot
        if not m.shape:
            return m.name
        if len(m.shape) == 1:
            return f"{m.name}[{index}]"
        return f"{m.name}[{index // m.shape[1]}][{index % m.shape[1]}]"

    def definition(self, name: str = "", number: str = "") -> str:
        """The typedef, with a comment on each field; under another name, and of another type of numbers, if given."""
        declared = {
            m: f"{number or ('real' if m.shape else 'scalar')} {m.name}{''.join(f'[{n}]' for n in m.shape)}"
            for m in self.fields
        }
        lines = [f"/* {self.title} */", "typedef struct {"]
        column = max(map(len, declared.values())) + 6
        for m in self.fields:
            head = f"    {declared[m]};"
            if m.comment:
                wrapped = textwrap.wrap(f"/* {c_comment(m.comment)} */", max(50, WIDTH + 8 - column))
                head = f"{head:<{column}}{wrapped[0]}"
                lines += [head, *(" " * (column + 3) + line for line in wrapped[1:])]
            else:
                lines.append(head)
        return "\n".join([*lines, f"}} {name or self.name};"])
