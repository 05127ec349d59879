"""FMUs of the catalog by name: `FullCarHmmwv` is `fmus/fmi3/FullCarHmmwv.fmu` below the working folder.

A checkout of the repository has a folder of built FMUs too, and a published wheel has the FMUs themselves, for where
none is built. `published.toml` lists the names of the catalog.
"""

from __future__ import annotations

import os
import tomllib
from collections.abc import Iterator, Sequence
from functools import cache
from pathlib import Path

from build_fmus.base import extras
from build_fmus.base.checks import did_you_mean, plain
from build_fmus.base.layout import FMUS, fmu_path
from cosim.core.errors import FmuError
from cosim.fmu.prebuilt import packed

PUBLISHED = Path(__file__).with_name("published.toml")
VERSIONS = (3, 2)  # of FMI, the preferred one first


def find(fmu: str | os.PathLike[str], versions: Sequence[int] = VERSIONS) -> Path:
    """The file of an FMU, given by its path or by its name in the catalog.

    Args:
        fmu: a text without slashes and dots is a name, unless there is a file or folder called so.
        versions: of FMI, the preferred one first.

    Raises:
        FmuError: no FMU of that name is built. The message says how to build it, or which names there are.
    """
    text = os.fspath(fmu)
    if not text or {"/", "\\", "."} & set(text) or os.path.exists(text):
        return Path(text)
    files = (fmu_path(folder, fmi, text) for folder in _folders() for fmi in versions)
    found = next(filter(os.path.isfile, files), None) or next(
        filter(None, (packed(fmi, text) for fmi in versions)), None
    )
    if found is None:
        raise FmuError(plain(_refusal(text)))
    return found


@cache
def published_names() -> tuple[str, ...]:
    """Names of the FMUs of the catalog."""
    return tuple(tomllib.loads(PUBLISHED.read_text(encoding="utf-8"))["names"])


def _folders() -> Iterator[Path]:
    """Folders of built FMUs: that of the working folder, and that of the repository in a checkout."""
    yield FMUS
    yield Path(__file__).parents[2] / FMUS


def _refusal(name: str) -> str:
    """The sentence about a name of which no FMU is built."""
    needs = f", which needs {extras.named('build')}" if extras.missing("build") else ""
    if name in published_names():
        return f"the FMU {name} is not built: run `build-fmus {name}`{needs}"
    folders = [fmu_path(folder, fmi, name).parent for folder in _folders() for fmi in VERSIONS]
    built = sorted({file.stem for folder in folders for file in folder.glob("*.fmu")})
    if near := did_you_mean(name, sorted({*built, *published_names()})):
        return f"no FMU {name!r}{near}"
    what = f"built are: {', '.join(built)}" if built else f"`build-fmus` builds: {', '.join(published_names())}"
    return f"no FMU {name!r} ({what}){'' if built else needs}; or give the path of a file, NAME.fmu"
