"""The words that this project does not use (language.toml) occur in no name, message, docstring, comment or page."""

from __future__ import annotations

import ast
import io
import re
import tokenize
import tomllib
from collections.abc import Iterator
from functools import cache
from pathlib import Path
from typing import Any

import pytest
from pages import PAGES, ROOT

from benchmarks.lines import THIRD_PARTY

WORDS = tomllib.loads(Path(__file__).with_name("language.toml").read_text(encoding="utf-8"))["words"]
PACKAGES = ("build_fmus", "cosim", "fmu_sources", "benchmarks", ".ci")
C_WORD = re.compile(r"/\*.*?\*/|//[^\n]*|\"(?:\\.|[^\"\\])*\"|[A-Za-z_]\w*", re.DOTALL)


def sources(*endings: str) -> list[Path]:
    found = [p for d in PACKAGES for e in endings for p in (ROOT / d).rglob(f"*{e}")]
    return [p for p in found if THIRD_PARTY not in p.parts]


def parts_of_python(text: str) -> Iterator[tuple[str, int, str]]:
    """Scope, line and text of names, messages, docstrings and comments."""
    tree = ast.parse(text)
    docstrings = {
        id(n.value)
        for n in ast.walk(tree)
        if isinstance(n, ast.Expr) and isinstance(n.value, ast.Constant) and isinstance(n.value.value, str)
    }
    for n in ast.walk(tree):
        if isinstance(n, ast.Constant) and isinstance(n.value, str):
            if id(n) in docstrings:
                yield "prose", n.lineno, n.value
            elif len(n.value.split()) >= 3:
                yield "message", n.lineno, n.value
        elif isinstance(n, (ast.FunctionDef, ast.ClassDef, ast.AsyncFunctionDef)):
            yield "identifier", n.lineno, n.name
        elif isinstance(n, ast.arg):
            yield "identifier", n.lineno, n.arg
        elif isinstance(n, ast.Name) and isinstance(n.ctx, ast.Store):
            yield "identifier", n.lineno, n.id
        elif isinstance(n, ast.Attribute) and isinstance(n.ctx, ast.Store):
            yield "identifier", n.lineno, n.attr
    for token in tokenize.generate_tokens(io.StringIO(text).readline):
        if token.type == tokenize.COMMENT:
            yield "prose", token.start[0], token.string


def parts_of_c(text: str) -> Iterator[tuple[str, int, str]]:
    for found in C_WORD.finditer(text):
        word = found.group()
        line = text.count("\n", 0, found.start()) + 1
        if word[:1] == "/":
            yield "prose", line, word
        elif word[:1] == '"':
            yield "message", line, word
        else:
            yield "identifier", line, word


@cache
def parts() -> list[tuple[str, str, str]]:
    """Scope, place and text of everything that is read."""
    found = []
    for path in sources(".py", ".c", ".h", ".js"):
        text = path.read_text(encoding="utf-8")
        of_file = parts_of_python(text) if path.suffix == ".py" else parts_of_c(text)
        found += [(scope, f"{path.relative_to(ROOT)}:{line}", part) for scope, line, part in of_file]
    for page in PAGES:
        text = page.read_text(encoding="utf-8")
        found += [("prose", f"{page.relative_to(ROOT)}:{n}", line) for n, line in enumerate(text.splitlines(), 1)]
    return found


@pytest.mark.parametrize("word", WORDS, ids=lambda w: w["but"])
def test_words_that_are_not_used(word: dict[str, Any]) -> None:
    patterns = {s: re.compile(str(word["pattern"]), 0 if s == "identifier" else re.IGNORECASE) for s in word["scope"]}
    found = [
        f"{place}: {hit.group()!r} in {text[max(0, hit.start() - 30) : hit.end() + 30]!r}"
        for scope, place, text in parts()
        if scope in patterns and (hit := patterns[scope].search(text))
    ]
    assert not found, f"say {word['but']}:\n" + "\n".join(found)
