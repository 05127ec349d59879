"""Imports between files: no cycles, and between packages only those of the table in docs/explanation/architecture.md.

The test parses imports and does not execute them. Imports inside functions and under TYPE_CHECKING count too.
"""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator
from functools import cache
from pathlib import Path

import pytest
from pages import ROOT, section

PACKAGES = ("build_fmus", "cosim", "fmu_sources")
CORE = (
    *(f"cosim/{p}/" for p in ("core", "recording", "fmu", "system", "engine", "linear", "tables", "picture", "ssp")),
    "cosim/session.py",
    "cosim/__init__.py",
)
BELOW = (
    "build_fmus/base/",
    "build_fmus/compile.py",
    "cosim/engine/library.py",  # C alone, the integrator of Model Exchange
    "cosim/export/",  # which builds, and is asked for by one function of `System`
    "cosim/scenes/",  # what its pages show
    "cosim/gradient/",  # which compiles, and is asked for by one function of `System`
)


@cache
def files() -> frozenset[str]:
    """All files of the packages, by their path from the root."""
    found = (path for package in PACKAGES for path in (ROOT / package).rglob("*.py"))
    return frozenset(path.relative_to(ROOT).as_posix() for path in found)


@cache
def graph() -> dict[str, set[str]]:
    """Each file with the files that it imports."""
    return {file: set(imports(file)) - {file} for file in files()}


def imports(file: str) -> Iterator[str]:
    for node in ast.walk(ast.parse((ROOT / file).read_bytes())):
        if isinstance(node, ast.Import):
            names = [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom):
            assert not node.level, f"{file}: write whole names instead of relative imports"
            names = [f"{node.module}.{alias.name}" for alias in node.names]
        else:
            continue
        yield from (module(n) for n in names if n.split(".")[0] in PACKAGES)


def module(dotted: str) -> str:
    """The file of a module, or of the one that holds what the last part names."""
    path = dotted.replace(".", "/")
    holder = path.rpartition("/")[0]
    candidates = (f"{path}/__init__.py", f"{path}.py", f"{holder}/__init__.py", f"{holder}.py")
    return next(file for file in candidates if file in files())


def files_in_cycles(arrows: dict[str, set[str]]) -> list[str]:
    """The files in cycles and between cycles.

    Files that import nothing, or that no file imports, are removed until nothing changes; the rest remains.
    """
    left = dict(arrows)
    while True:
        imported = set().union(*left.values())
        ends = {file for file, others in left.items() if not others or file not in imported}
        if not ends:
            return sorted(left)
        left = {file: others - ends for file, others in left.items() if file not in ends}


@cache
def allowed_imports() -> dict[str, tuple[str, ...]]:
    """Each package of the table, lowest first, with the packages that it may import."""
    table = section("explanation/architecture.md", "Allowed imports")
    rows = re.findall(r"^\| `([^`|]+)` \|[^|]*\|([^|]*)\|$", table, re.MULTILINE)
    assert len(rows) > 10
    return {one: tuple(re.findall(r"`([^`]+)`", arrows)) for one, arrows in rows}


def package_of(file: str) -> str:
    """The most specific row of the table that contains a file: the file, else its folder, else an enclosing folder."""
    folder, *around = (p.as_posix() for p in Path(file).parents)
    for candidate in (file, f"{folder}/*.py", f"{folder}/", *(f"{p}/" for p in around)):
        if candidate in allowed_imports():
            return candidate
    raise AssertionError(f"{file} belongs to no package: add a row to the table in docs/explanation/architecture.md")


def test_files_do_not_import_in_cycles() -> None:
    assert files_in_cycles(graph()) == []


def test_a_cycle_is_found() -> None:
    arrows = {"a": {"b", "x"}, "b": {"c"}, "c": {"a"}, "x": set(), "y": {"a"}}
    assert files_in_cycles(arrows) == ["a", "b", "c"]
    assert files_in_cycles({**arrows, "c": set()}) == []


def test_packages_import_only_packages_below_them() -> None:
    seen: list[str] = []
    for one, arrows in allowed_imports().items():
        assert set(arrows) <= set(seen), f"{one} may import packages that are below it in the table"
        seen.append(one)


def test_files_import_only_allowed_packages() -> None:
    arrows = {
        (package_of(file), package_of(other)): (file, other) for file, others in graph().items() for other in others
    }
    allowed = {(one, other) for one, others in allowed_imports().items() for other in others}
    wrong = {pair: files for pair, files in arrows.items() if pair[0] != pair[1] and pair not in allowed}
    assert wrong == {}
    assert allowed - arrows.keys() == set(), "the table in docs/explanation/architecture.md allows unused imports"


def test_the_core_of_cosim_knows_neither_vehicles_nor_builds() -> None:
    for one in CORE:
        assert set(allowed_imports()[one]) <= {*CORE, *BELOW}, one


def test_only_identification_needs_the_master() -> None:
    """An edit of the master builds again what is identified with it, and nothing else (`code_of_makers`)."""
    needs = {f for f, others in graph().items() if any(re.match("cosim/(?!core/)", o) for o in others)}
    assert {f for f in needs if f.startswith("fmu_sources/")} == {"fmu_sources/controllers/gpc/identification.py"}


def folders() -> dict[str, list[str]]:
    """Each folder of `fmu_sources` with its modules and packages."""
    held: dict[str, list[str]] = {}
    for path in map(Path, files()):
        name, folder = (path.parent.name, path.parents[1]) if path.name == "__init__.py" else (path.stem, path.parent)
        if folder.is_relative_to("fmu_sources"):
            held.setdefault(folder.as_posix(), []).append(name)
    return {folder: sorted(names) for folder, names in held.items()}


@pytest.mark.parametrize("folder", sorted(folders().keys() - {"fmu_sources"}))
def test_the_docstring_of_a_folder_names_its_modules(folder: str) -> None:
    told = ast.get_docstring(ast.parse((ROOT / folder / "__init__.py").read_bytes())) or ""
    assert sorted(re.findall(r"^- `(\w+)`: \S", told, re.MULTILINE)) == folders()[folder]
