"""Which FMUs the tests run over, where they are, and how they get built."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import components

import build_fmus
from build_fmus import builder
from build_fmus.builder import Options
from build_fmus.compile import ObjectCache
from fmu_sources import cli
from fmu_sources.catalog import default_catalog

ROOT = Path(__file__).parents[1]
FMUS = Path(os.environ.get("FMUS_FOLDER", ROOT / "fmus"))  # those of another BLAS kernel have a folder of their own
PROBES = FMUS / ".probes"  # FMUs of the test components

OBJECTS = ObjectCache(
    Options(FMUS).cache / "objects"
)  # where tests compile, too: what has been compiled is not compiled again

# While a component is being written, FMUS_UNDER_TEST=QuarterCarHmmwv,ProbeRk4 builds and tests those alone.
_ASKED = [n for n in os.environ.get("FMUS_UNDER_TEST", "").split(",") if n]
CATALOG_NAMES = [n for n in default_catalog() if not _ASKED or n in _ASKED]
PROBE_NAMES = [n for n in components.CATALOG if not _ASKED or n in _ASKED]
NAMES = [*PROBE_NAMES, *CATALOG_NAMES]
ALL_ARE_ASKED = not _ASKED


@dataclass(frozen=True)
class BuiltFmus:
    """Where the built FMUs are."""

    def path(self, name: str, fmi: int, *, arrays: bool = False) -> Path:
        """File of one FMU; `arrays`: the FMI 3.0 build of a test component with real arrays."""
        if name in components.CATALOG:
            return Options(PROBES / ("arrays" if arrays else "scalars")).target(name, fmi)
        return Options(FMUS).target(name, fmi)


@contextmanager
def one_at_a_time(path: Path) -> Iterator[None]:
    """Exclusive lock across processes: the first test worker builds, the others find everything up to date."""
    path.parent.mkdir(parents=True, exist_ok=True)
    with path.open("w") as file:
        if os.name == "nt":
            import msvcrt

            msvcrt.locking(file.fileno(), msvcrt.LK_LOCK, 1)
        else:
            import fcntl

            fcntl.flock(file, fcntl.LOCK_EX)
        yield


def share_objects(out: Path) -> Path:
    """A folder in which `build-fmus` uses and keeps the compiled objects of the FMUs under test."""
    (out / ".cache").mkdir(parents=True, exist_ok=True)
    OBJECTS.directory.mkdir(parents=True, exist_ok=True)
    with suppress(FileExistsError):
        (out / ".cache" / "objects").symlink_to(OBJECTS.directory, target_is_directory=True)
    return out


@cache
def build_all() -> BuiltFmus:
    """Bring all FMUs under test up to date, for this machine; once per process."""
    with one_at_a_time(FMUS / ".cache" / "tests.lock"):
        code = builder.source_hash(Path(build_fmus.__file__).parent)
        for folder, versions, arrays in (("scalars", (2, 3), False), ("arrays", (3,), True)):
            options = Options(share_objects(PROBES / folder), versions, arrays=arrays)
            builder.build(components.CATALOG, PROBE_NAMES, options, sources=lambda _: code, task=components.build_entry)
        if CATALOG_NAMES:
            cli.build(CATALOG_NAMES, Options(FMUS))
    return BuiltFmus()
