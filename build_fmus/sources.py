"""What code depends on: the modules of this project that it imports, with the data files beside them, and their hash."""

from __future__ import annotations

import ast
import hashlib
from collections.abc import Iterable, Iterator
from functools import cache
from pathlib import Path

PACKAGES = ("build_fmus", "cosim", "fmu_sources")
DATA_SUFFIXES = (".toml", ".csv")
_ROOT = Path(__file__).resolve().parents[1]


def imported(modules: Iterable[str | Path]) -> list[Path]:
    """Files of this project behind ``modules`` (their files): themselves, all that they import, directly or not, and the data
    files of the packages these lie in.

    Imports are read, not run, wherever they stand in a file; what is imported under a name made at run time is not seen.
    """
    found: set[Path] = set()
    open_ = [Path(m).resolve() for m in modules]
    while open_:
        module = open_.pop()
        if module not in found:
            found.add(module)
            open_ += [*_imports(module), *_data(module.parent)]
    return sorted(found)


def code_hash(modules: Iterable[str | Path]) -> str:
    """Hash of the contents of all files that :func:`imported` finds."""
    digest = hashlib.sha256()
    for path in imported(modules):
        name = path.relative_to(_ROOT) if path.is_relative_to(_ROOT) else Path(path.name)
        digest.update(name.as_posix().encode() + b"\0" + path.read_bytes() + b"\0")
    return digest.hexdigest()


def _imports(file: Path) -> Iterator[Path]:
    """Modules of this project that one file imports, with the packages around them."""
    if file.suffix != ".py":
        return
    for node in ast.walk(ast.parse(file.read_bytes())):
        if isinstance(node, ast.Import):
            names = [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom) and not node.level:
            names = [f"{node.module}.{alias.name}" for alias in node.names]
        else:
            continue
        for name in names:
            yield from _files(name)


@cache
def _files(name: str) -> tuple[Path, ...]:
    """Files that importing a dotted name runs; a last part that is no module is what a module holds."""
    parts = name.split(".")
    if parts[0] not in PACKAGES:
        return ()
    paths = [_ROOT.joinpath(*parts[: i + 1]) for i in range(len(parts))]
    found = [p / "__init__.py" if p.is_dir() else p.with_suffix(".py") for p in paths]
    return tuple(p for p in found if p.is_file())


@cache
def _data(package: Path) -> tuple[Path, ...]:
    """Data files in a package, and in those of its folders that are no packages."""
    return tuple(p for p in package.rglob("*") if p.suffix in DATA_SUFFIXES and _belongs(p.parent, package))


def _belongs(folder: Path, package: Path) -> bool:
    while folder != package:
        if (folder / "__init__.py").exists():
            return False
        folder = folder.parent
    return True
