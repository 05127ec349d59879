"""C code of outputs without those that nobody reads.

A compiler leaves out numbers that are not used, but not numbers with derivatives: their operations write to memory.
"""

from __future__ import annotations

import math
import re
from collections.abc import Collection

_FUNCTION = re.compile(
    r"(?<=^static void outputs\(const FmuArguments \*at, real \*result\) \{\n).*?(?=^\}$)", re.M | re.S
)
_STRUCT = re.compile(r"typedef struct \{([^}]*)\} Outputs;")
_FIELD = re.compile(r"^ *(?:real|scalar) (\w+)((?:\[\d+\])*);", re.M)
_STATEMENT = re.compile(r"^ *(?:/\*.*?\*/|[^;{}]*(?:\{0\})?[;{]|\})\n", re.M | re.S)
_WRITTEN = re.compile(r"\s*(?:const (?:scalar|local|condition) )?(y->)?(\w+)(?:\[[^]]*\])? =(?!\s*\{0\})")
_EMPTY = re.compile(r"(\w+)\s*=\s*\{0\}")
_NAME = re.compile(r"(?<!->)\b[A-Za-z_]\w*")


def without_unread_outputs(code: str, outputs: Collection[int]) -> str:
    """`model.c` whose function `outputs` computes those with these slots, and nothing that only others need."""
    struct = _STRUCT.search(code)
    if struct is None:
        return code
    read, slot = set(), 0
    for name, shape in _FIELD.findall(struct[1]):
        size = math.prod(map(int, re.findall(r"\d+", shape)))
        if any(slot <= k < slot + size for k in outputs):
            read.add(name)
        slot += size
    return _FUNCTION.sub(lambda body: _needed(body[0], read), code)


def _needed(body: str, outputs: Collection[str]) -> str:
    """The statements that write these outputs, or names that are read below."""
    found = _STATEMENT.findall(body)
    if "".join(found).split() != body.split():  # a statement of another form
        return body
    kept: list[str] = []
    names: set[str] = set()
    ends: list[int] = []  # of the blocks around a statement: how many statements were kept up to their ends
    for statement in reversed(found):
        written = _WRITTEN.match(statement)
        if statement.endswith("}\n"):
            kept.append(statement)
            ends.append(len(kept))
            continue
        if statement.endswith("{\n"):
            needed = len(kept) > ends.pop()
            if not needed:
                kept.pop()
        elif written:
            needed = written[2] in (outputs if written[1] else names)
        else:  # declarations of names without a value, pointers, comments
            declared = _EMPTY.search(statement)
            needed = declared[1] in names if declared else not statement.endswith("*/\n")
        if needed:
            kept.append(statement)
            names.update(_NAME.findall(statement))
    return "".join(reversed(kept))
