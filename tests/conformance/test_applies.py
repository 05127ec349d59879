"""No test of this folder passes because there was nothing to do: it is run over the FMUs that it applies to."""

from __future__ import annotations

import ast
from collections.abc import Iterator
from pathlib import Path

import pytest
from applies import applies_to
from built import ALL_ARE_ASKED


def statements(node: ast.AST) -> Iterator[ast.AST]:
    """What belongs to a function itself, without the functions inside it."""
    for child in ast.iter_child_nodes(node):
        if not isinstance(child, ast.FunctionDef | ast.Lambda):
            yield child
            yield from statements(child)


@pytest.mark.parametrize("path", sorted(Path(__file__).parent.glob("test_*.py")), ids=lambda p: p.stem)
def test_no_test_returns_early(path: Path) -> None:
    functions = (n for n in ast.walk(ast.parse(path.read_text())) if isinstance(n, ast.FunctionDef))
    tests = [f for f in functions if f.name.startswith("test_")]
    assert tests
    early = [f"{f.name}, line {s.lineno}" for f in tests for s in statements(f) if isinstance(s, ast.Return)]
    assert not early, "say with applies_to(...) which FMUs the test is about"


@pytest.mark.skipif(not ALL_ARE_ASKED, reason="FMUS_UNDER_TEST may leave none")
def test_a_trait_that_no_fmu_has_is_refused(raises) -> None:
    def impossible(_: object) -> bool:
        return False

    with raises(ValueError):
        applies_to(impossible)
