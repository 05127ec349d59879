"""Dependencies of code: the modules of this project that it imports, the data files beside them, and their hash."""

from __future__ import annotations

import ast
import hashlib
import sys
from collections.abc import Iterable, Iterator
from functools import cache
from pathlib import Path

PACKAGES = ("build_fmus", "cosim", "fmu_sources")
DATA_SUFFIXES = (".toml", ".csv", ".json", ".txt", ".npz", ".npy", ".c", ".h")
_ROOT = Path(__file__).resolve().parents[2]


def imported(modules: Iterable[str | Path]) -> list[Path]:
    """The files of `modules`, of all modules that they import, directly or not, and of their data.

    Imports count where they lead into this project or to files beside the importing module. Data files are those of the
    packages of this project that the modules lie in, and those that a user's module names in its text.

    Imports are read, not run, wherever they stand in a file; what is imported under a name made at run time is not
    seen.
    """
    found: set[Path] = set()
    open_ = [Path(m).resolve() for m in modules]
    while open_:
        module = open_.pop()
        if module not in found:
            found.add(module)
            open_ += [*_imports(module), *(_data(module.parent) if _is_ours(module) else _named_files(module))]
    return sorted(found)


def code_hash(modules: Iterable[str | Path]) -> str:
    """Hash of the contents of all files that `imported` finds."""
    digest = hashlib.sha256()
    for path in imported(modules):
        name = path.relative_to(_ROOT) if path.is_relative_to(_ROOT) else Path(path.name)
        digest.update(name.as_posix().encode() + b"\0" + path.read_bytes() + b"\0")
    return digest.hexdigest()


def libraries(modules: Iterable[str | Path]) -> set[str]:
    """Top-level modules of others (numpy, casadi, ...) that `imported` files import."""
    return {
        name.partition(".")[0]
        for file in imported(modules)
        for _, name in _imported_names(file)
        if not _files(name, file.parent) and name.partition(".")[0] not in sys.stdlib_module_names
    }


def _imports(file: Path) -> Iterator[Path]:
    """Modules that one file imports, with the packages around them: of this project, or from its own folder."""
    for folder, name in _imported_names(file):
        yield from _files(name, folder)


@cache
def _imported_names(file: Path) -> tuple[tuple[Path | None, str], ...]:
    """Dotted names that a file imports, each with the folder that it counts from where the import is relative."""
    if file.suffix != ".py":
        return ()
    found: list[tuple[Path | None, str]] = []
    for node in _statements(ast.parse(file.read_bytes())):
        if isinstance(node, ast.Import):
            found += [(file.parent, alias.name) for alias in node.names]
        elif isinstance(node, ast.ImportFrom):
            folder = file.parents[node.level - 1] if node.level else file.parent
            start = f"{node.module}." if node.module else ""
            found += [(folder, f"{start}{alias.name}") for alias in node.names]
    return tuple(found)


_BLOCKS = ("body", "orelse", "finalbody", "handlers", "cases")


def _statements(node: ast.AST) -> Iterator[ast.AST]:
    """All statements below a node but those that only type checkers read; no expressions, which are most of a file."""
    for_checkers = isinstance(node, ast.If) and isinstance(node.test, ast.Name) and node.test.id == "TYPE_CHECKING"
    for block in ("orelse",) if for_checkers else _BLOCKS:
        for child in getattr(node, block, ()):
            yield child
            yield from _statements(child)


@cache
def _files(name: str, folder: Path | None = None) -> tuple[Path, ...]:
    """Files that importing a dotted name runs, from a file in `folder`.

    A last part that is no module counts as a name in a module.
    """
    parts = name.split(".")
    root = _ROOT if parts[0] in PACKAGES else folder
    if root is None:
        return ()
    paths = [root.joinpath(*parts[: i + 1]) for i in range(len(parts))]
    found = [p / "__init__.py" if p.is_dir() else p.with_suffix(".py") for p in paths]
    return tuple(p for p in found if p.is_file())


@cache
def _data(package: Path) -> tuple[Path, ...]:
    """Data files in a package, and in those of its folders that are no packages."""
    return tuple(p for p in package.rglob("*") if p.suffix in DATA_SUFFIXES and _belongs(p.parent, package))


def _is_ours(file: Path) -> bool:
    return file.is_relative_to(_ROOT) and file.relative_to(_ROOT).parts[0] in PACKAGES


@cache
def _named_files(module: Path) -> tuple[Path, ...]:
    """Files that texts in a module name, seen from its folder or from here."""
    if module.suffix != ".py":
        return ()
    nodes = ast.walk(ast.parse(module.read_bytes()))
    texts = {
        n.value for n in nodes if isinstance(n, ast.Constant) and isinstance(n.value, str) and 0 < len(n.value) < 4096
    }
    texts = {t for t in texts if "\0" not in t and "\n" not in t and Path(t).suffix}
    found = {p.resolve() for t in texts for p in (module.parent / t, Path(t))}
    return tuple(sorted(p for p in found if p.is_file() and p.suffix != ".py"))


def _belongs(folder: Path, package: Path) -> bool:
    while folder != package:
        if (folder / "__init__.py").exists():
            return False
        folder = folder.parent
    return True
