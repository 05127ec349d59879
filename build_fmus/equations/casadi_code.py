"""CasADi's own code of functions, without what nothing here calls."""

from __future__ import annotations

import re
from collections.abc import Sequence

from build_fmus.base import extras

with extras.needed("build", extras.BUILDING):
    import casadi as ca

_WORDS = {
    "casadi_real": "double",
    "casadi_int": "int",
    "casadi_inf": "INFINITY",
    "casadi_nan": "NAN",
    "CASADI_SYMBOL_EXPORT": "static",
}
_WORD = re.compile(rf"\b({'|'.join(_WORDS)})\b")
_AS = re.compile(r"\bCASADI_CAST\((\w+), ")
_NAME = re.compile(r"\bcasadi_\w+")
_CAST = r"(?<!sizeof)\((?:casadi_)?int\)(?![ ]?sizeof) ?"  # a number to an index


def casadi_code(functions: Sequence[ca.Function]) -> tuple[str, dict[str, str]]:
    """C code of functions, and the name of each in it.

    In C they have the form `int (const double**, double**, int*, double*, int)`.

    Raises:
        RuntimeError: code that allocates, or converts numbers to integers in a way that is not known.
    """
    generator = ca.CodeGenerator("model", {"with_header": False, "casadi_int": "int", "verbose": False})
    for f in functions:
        generator.add(f)
    code = generator.dump()
    for forbidden in ("malloc(", "calloc(", "free("):
        if forbidden in code:
            raise RuntimeError(f"generated code calls {forbidden[:-1]}, which is not allowed in doStep")
    entries = {f.name(): _entry(code, f.name()) for f in functions}
    chunks = {
        name: _AS.sub(r"((\1) ", _WORD.sub(lambda m: _WORDS[m[1]], text)) for name, text in _definitions(code).items()
    }
    needed: dict[str, None] = {}
    open_ = list(entries.values())
    while open_:
        name = open_.pop()
        if name in chunks and name not in needed:
            needed[name] = None
            open_ += _NAME.findall(chunks[name])
    kept = (text for name, text in chunks.items() if name in needed)
    return "\n".join(text if text.startswith("static ") else f"static {text}" for text in map(_safe, kept)), entries


def _entry(code: str, name: str) -> str:
    """The function that holds the code of an entry point."""
    found = re.search(rf"\bint {name}\([^)]*\)\s*{{\s*return (casadi_f\d+)\(", code)
    if found is None:
        raise RuntimeError(f"CasADi's code has no entry point {name} of the form that this version knows")
    return found[1]


def _definitions(code: str) -> dict[str, str]:
    """Functions and constants of CasADi's code by name, in their order."""
    result: dict[str, str] = {}
    open_: list[str] = []
    for line in code.splitlines():
        if not open_ and not re.match(r"[A-Za-z]", line):
            continue  # between definitions: preprocessor, comments
        open_.append(line)
        text = "\n".join(open_)
        if text.count("{") == text.count("}") and line.rstrip().endswith((";", "}")):
            head = _NAME.search(_WORD.sub("", text))
            # neither entry points nor their like
            if head is not None and not text.startswith("CASADI_SYMBOL_EXPORT"):
                result[head[0]] = text
            open_ = []
    return result


def _safe(code: str) -> str:
    """With every conversion of a number to an index defined for every number, and every argument used."""
    safe = re.sub(_CAST + r"(?:(\*cr\+\+)|(?=\())", lambda m: f"index_of({m[1]})" if m[1] else "index_of", code)
    left = re.search(_CAST + ".{0,40}", safe)
    if left:
        raise RuntimeError(f"generated code converts numbers in a way this version does not know: {left[0]}")
    return re.sub(r"(int\* iw, double\* w, int mem\) \{)", r"\1\n  (void)iw;\n  (void)w;\n  (void)mem;", safe)
