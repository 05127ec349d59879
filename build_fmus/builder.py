"""Build what changed, in dependency order, on all cores.

A build has two layers of content hashes. The outer one covers everything that can influence an FMU (sources of this
project, library versions, options, user files): when it matches the stamp of an existing file, nothing is even
imported. The inner one is the object cache of `build_fmus.compile`.
"""

from __future__ import annotations

import hashlib
import os
import warnings
from collections.abc import Callable, Iterable, Iterator, Mapping
from concurrent.futures import ProcessPoolExecutor, as_completed
from contextlib import nullcontext, suppress
from dataclasses import dataclass, replace
from functools import cache
from importlib import metadata
from pathlib import Path
from typing import Any, Protocol

from build_fmus import qp_sources
from build_fmus.base import safe_files
from build_fmus.base.interpreters import forget_safe_path, safe_path
from build_fmus.base.layout import fmu_path
from build_fmus.compile import toolchain_identity

SOURCE_SUFFIXES = (".py", ".toml", ".c", ".h", ".html", ".csv")
_LIBRARIES = ("casadi", "fmpy", "numpy", "scipy", "lxml", "jinja2", "osqp", "suspension-fmus")


class Buildable(Protocol):
    """What the builder needs to know of a catalog entry."""

    @property
    def name(self) -> str:
        """Name of the entry and of its FMUs."""

    @property
    def needs(self) -> tuple[str, ...]:
        """Names of the entries that must be built before it."""

    @property
    def files(self) -> tuple[Path, ...]:
        """Files of the user that determine it."""

    @property
    def choices(self) -> str:
        """Options of the user that determine it."""


@dataclass(frozen=True)
class Options:
    """Options of one build run."""

    out: Path
    fmi: tuple[int, ...] = (2, 3)
    platform: str = "host"
    arrays: bool = False
    clocks: bool = False
    qp: str | None = None  # solver of all quadratic programs instead of each component's own
    ignore_cache_before: int = 0  # ns: ignore cache entries older than this, see safe_files.ignore_cache

    @property
    def cache(self) -> Path:
        """Directory of stamps, objects and derived data."""
        return self.out / ".cache"

    def target(self, name: str, fmi: int) -> Path:
        """File of one FMU."""
        return fmu_path(self.out, fmi, name)


def with_needs(catalog: Mapping[str, Buildable], names: Iterable[str]) -> list[str]:
    """`names` and everything they need, in catalog order."""
    requested: set[str] = set()
    stack = list(names)
    while stack:
        name = stack.pop()
        if name not in requested:
            requested.add(name)
            stack.extend(catalog[name].needs)
    return [n for n in catalog if n in requested]


def levels(catalog: Mapping[str, Buildable], names: list[str]) -> Iterator[list[str]]:
    """Groups of entries that can be built side by side, each after the groups before it."""
    left = list(names)
    while left:
        ready = [n for n in left if not any(d in left for d in catalog[n].needs)]
        if not ready:
            raise ValueError(f"catalog entries depend on each other in a cycle: {', '.join(left)}")
        yield ready
        left = [n for n in left if n not in ready]


def source_hash(*packages: Path) -> str:
    """Hash of all source files below the given package directories."""
    digest = hashlib.sha256()
    for package in packages:
        for path in sorted(package.rglob("*")):
            if path.suffix in SOURCE_SUFFIXES and "__pycache__" not in path.parts:
                digest.update(str(path.relative_to(package)).encode() + b"\0" + path.read_bytes() + b"\0")
    return digest.hexdigest()


def stamp_key(entry: Buildable, options: Options, fmi: int, sources: str) -> str:
    """Key of one FMU file: everything that can influence its bytes."""
    digest = hashlib.sha256()
    compilers = toolchain_identity(options.platform)
    parts = [sources, entry.name, str(fmi), options.platform, str(options.arrays and fmi == 3), compilers]
    parts += [str(options.clocks and fmi == 3), options.qp or "", entry.choices, qp_sources.identity()]
    parts += _versions()
    digest.update("|".join(parts).encode())
    for path in entry.files:
        digest.update(path.read_bytes())
    return digest.hexdigest()


@cache
def _versions() -> list[str]:
    return [f"{n}={metadata.version(n)}" for n in _LIBRARIES]


class Stamps:
    """Which key each existing FMU file was built from, with the hash of the file itself."""

    def __init__(self, directory: Path) -> None:
        self.directory = directory

    def _path(self, target: Path) -> Path:
        return self.directory / "stamps" / f"{target.parent.name}-{target.stem}.json"

    def fresh(self, target: Path, key: str) -> bool:
        """Whether `target` exists unchanged since it was built from `key`."""
        if not target.is_file():
            return False
        try:
            stamp = safe_files.kept_json(self._path(target))
        except safe_files.CacheMiss:
            return False
        if stamp["key"] != key:
            return False
        if stamp["sha256"] != hashlib.sha256(target.read_bytes()).hexdigest():
            text = f"{target} was damaged or replaced after it was built; it is built again"
            warnings.warn(text, safe_files.DamagedWarning, stacklevel=2)
            return False
        return True

    def write(self, target: Path, key: str) -> None:
        """Record that `target` was built from `key`."""
        stamp = {"key": key, "sha256": hashlib.sha256(target.read_bytes()).hexdigest()}
        safe_files.keep_json(self._path(target), stamp)

    def remove(self, target: Path) -> None:
        """Forget what `target` was built from."""
        self._path(target).unlink(missing_ok=True)


def build(
    catalog: Mapping[str, Buildable],
    names: Iterable[str],
    options: Options,
    *,
    sources: Callable[[Buildable], str],
    task: Callable[[str, Options, tuple[int, ...]], None],
    report: Callable[[str, str], None] = lambda _name, _what: None,
    force: bool = False,
) -> list[str]:
    """Build the named entries and what they need, as far as they are not up to date.

    Args:
        catalog: name -> entry.
        names: of the entries to build.
        options: of the build.
        sources: hash of the code that makes the component of an entry.
        task: makes and writes one entry's FMUs for the given FMI versions; called in worker processes, so it must be a
            module-level function or a picklable object.
        report: called with `(name, "built" | "up to date")` as the build proceeds.
        force: build what is up to date too, and use nothing that was kept in caches before.

    Returns:
        Names of the entries that were built.
    """
    if force:
        options = replace(options, ignore_cache_before=safe_files.filesystem_time(options.cache))
    stamps = Stamps(options.cache)
    built: list[str] = []
    requested = with_needs(catalog, names)
    asked = set(names)
    with _Pool() as pool:
        for level in levels(catalog, requested):
            stale: dict[str, tuple[int, ...]] = {}
            keys: dict[tuple[str, int], str] = {}  # of what the files hold before they are read to build from
            for name in level:
                # Entries needed only by others must exist for FMI 3.0, which makers read.
                alone = name in asked and not any(name in catalog[n].needs for n in requested)
                versions = options.fmi if alone else tuple({*options.fmi, 3})
                keys |= {(name, f): stamp_key(catalog[name], options, f, sources(catalog[name])) for f in versions}
                stale[name] = tuple(
                    f for f in versions if force or not stamps.fresh(options.target(name, f), keys[name, f])
                )
            jobs = {name: v for name, v in stale.items() if v}
            for name in level:
                if name not in jobs:
                    report(name, "up to date")
            for name in pool.run(task, jobs, options):
                for f in jobs[name]:
                    if _is_key(keys[name, f], catalog[name], options, f, sources(catalog[name])):
                        stamps.write(options.target(name, f), keys[name, f])
                    else:
                        stamps.remove(options.target(name, f))
                        text = f"a source file of {name} changed during the build; the next build builds it again"
                        warnings.warn(text, stacklevel=2)
                built.append(name)
                report(name, "built")
    return built


def _is_key(key: str, *made_of: Any) -> bool:
    """Whether an FMU would have this key now."""
    try:
        return key == stamp_key(*made_of)
    except OSError:  # a file has gone
        return False


def _start_worker() -> None:
    forget_safe_path()
    safe_files.plain_warnings()


class _Pool:
    """Worker processes, started only when there is more than one job."""

    def __init__(self) -> None:
        self._executor: ProcessPoolExecutor | None = None

    def __enter__(self) -> _Pool:
        return self

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        if self._executor is None:
            return
        if kind is not None:  # an error or Ctrl-C: what runs is abandoned, files appear only when they are whole
            for process in list((self._executor._processes or {}).values()):
                process.terminate()
        with suppress(RuntimeError) if kind is not None else nullcontext():  # its thread could not be started
            self._executor.shutdown(cancel_futures=True)

    def run(self, task: Callable, jobs: dict[str, tuple[int, ...]], options: Options) -> Iterator[str]:
        if len(jobs) <= 1:
            for name, versions in jobs.items():
                task(name, options, versions)
                yield name
            return
        with safe_path():
            if self._executor is None:
                self._executor = ProcessPoolExecutor(os.cpu_count(), initializer=_start_worker)
            futures = {self._executor.submit(task, n, options, v): n for n, v in jobs.items()}
        for future in as_completed(futures):
            future.result()
            yield futures[future]
