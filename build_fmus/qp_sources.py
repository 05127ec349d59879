"""C sources of the QP solvers, from outside this project: OSQP from its installed wheel, DAQP from its sdist on PyPI.

DAQP is downloaded by `pip` once per user, with the user's own index settings, and checked against a pinned hash.
Nothing of either is part of this repository; their licenses go into the FMU.
"""

from __future__ import annotations

import hashlib
import io
import os
import subprocess
import tarfile
from dataclasses import dataclass
from functools import lru_cache
from importlib import metadata
from pathlib import Path

from build_fmus.base import safe_files
from build_fmus.base.interpreters import PYTHON

DAQP_VERSION = "0.11.0"
DAQP_SHA256 = "2f27baf18d2acca14186498e651b34e0bed455627e777d3fd8ba655e7e40f920"
DAQP_VARIABLE = "DAQP_SOURCE"  # a folder or sdist to take instead of the download
_DAQP_FILES = ("daqp.c", "auxiliary.c", "factorization.c")
_DAQP_HEADERS = ("daqp.h", "auxiliary.h", "factorization.h", "types.h", "constants.h")


class SourceError(RuntimeError):
    """Sources of a solver that are not there; the message says how to get them."""


@dataclass(frozen=True)
class ThirdParty:
    """Sources of one solver: C files and headers by their path in the FMU's `sources/`, and its license.

    Attributes:
        spdx, license: the license's SPDX identifier and its text.
        note: what it is and what was changed.
    """

    name: str
    version: str
    files: dict[str, bytes]
    spdx: str
    license: bytes
    note: str


def license_file(distribution: str) -> bytes:
    """The license that an installed package carries.

    Raises:
        SourceError: a package without one.
    """
    found = next((f for f in metadata.files(distribution) or () if f.name.startswith("LICENSE")), None)
    if found is None or not (path := Path(str(found.locate()))).is_file():
        raise SourceError(f"the installed package {distribution} has no license file; install it from PyPI")
    return path.read_bytes()


@lru_cache
def daqp() -> ThirdParty:
    """C sources of DAQP.

    Raises:
        SourceError: the download failed, or what was found is not the pinned release.
    """
    chosen = os.environ.get(DAQP_VARIABLE)
    if chosen and Path(chosen).is_dir():
        return _from_folder(Path(chosen))
    return _from_sdist(_daqp_sdist(Path(chosen) if chosen else None))


def _from_folder(folder: Path) -> ThirdParty:
    def find(name: str) -> bytes:
        for path in (folder / name, *(folder / base / name for base in ("csrc/src", "csrc/include", "src", "include"))):
            if path.is_file():
                return path.read_bytes()
        raise SourceError(f"{DAQP_VARIABLE}={folder} has no {name}; unpack the sdist daqp=={DAQP_VERSION} there")

    files = {f"daqp/{n}": find(n) for n in (*_DAQP_FILES, *_DAQP_HEADERS)}
    return _daqp_of(files, find("LICENSE"))


def _from_sdist(data: bytes) -> ThirdParty:
    top = f"daqp-{DAQP_VERSION}"
    with tarfile.open(fileobj=io.BytesIO(data)) as tar:

        def find(path: str) -> bytes:
            member = tar.extractfile(f"{top}/{path}")
            assert member is not None  # the hash was right
            return member.read()

        files = {f"daqp/{n}": find(f"csrc/src/{n}") for n in _DAQP_FILES}
        files |= {f"daqp/{n}": find(f"csrc/include/{n}") for n in _DAQP_HEADERS}
        return _daqp_of(files, find("LICENSE"))


def _daqp_of(files: dict[str, bytes], license: bytes) -> ThirdParty:
    return ThirdParty("DAQP", DAQP_VERSION, files, "MIT", license, "Solver of quadratic programs, a part of it.")


def _daqp_sdist(chosen: Path | None) -> bytes:
    name = f"daqp-{DAQP_VERSION}.tar.gz"
    if chosen is not None:
        if not chosen.is_file():
            raise SourceError(f"{DAQP_VARIABLE}={chosen}: no such file or folder; it should be {name} or its contents")
        data = chosen.read_bytes()
        if not _is_pinned(data):
            raise SourceError(f"{DAQP_VARIABLE}={chosen} is not the published {name} (its SHA-256 differs)")
        return data
    kept = safe_files.cache_directory() / name
    if kept.is_file() and _is_pinned(data := kept.read_bytes()):
        return data
    data = _download(name)
    safe_files.write(kept, data)
    return data


def _is_pinned(data: bytes) -> bool:
    return hashlib.sha256(data).hexdigest() == DAQP_SHA256


def _download(name: str) -> bytes:
    pinned = f"daqp=={DAQP_VERSION} --hash=sha256:{DAQP_SHA256}\n"
    with safe_files.scratch_files({"requirements.txt": pinned.encode()}) as folder:
        options = ["--quiet", "--disable-pip-version-check", "--no-deps", "--no-binary", "daqp", "--require-hashes"]
        files = ["--dest", str(folder), "-r", str(folder / "requirements.txt")]
        command = [*PYTHON, "-m", "pip", "download", *options, *files]
        done = subprocess.run(command, capture_output=True, text=True, check=False)
        path = folder / name
        if path.is_file() and _is_pinned(data := path.read_bytes()):
            return data
    reason = (done.stderr.strip().splitlines() or ["no reason given"])[-1]
    raise SourceError(
        f"cannot download the sources of the QP solver DAQP ({reason}). They are downloaded from PyPI or another"
        f" index that pip is configured for; without a connection, get {name} on another machine (pip download"
        f" --no-deps --no-binary daqp daqp=={DAQP_VERSION}) and set {DAQP_VARIABLE} to that file"
    )


_OSQP_FILES = (
    "osqp_api.c",
    "auxil.c",
    "vector.c",
    "matrix.c",
    "csc_math.c",
    "csc_utils.c",
    "util.c",
    "error.c",
    "algebra_libs.c",
    "scaling.c",
)
_OSQP_CONFIGURATION = b"""/* Configuration of OSQP (https://osqp.org, Apache License 2.0), of which this file is a part.
 *
 * CHANGED by suspension-fmus: OSQP's build generates it from osqp_configure.h.in; this one is written by hand with the
 * few definitions of its embedded code. No heap, no printing, no clock, constant matrices. */
#ifndef OSQP_CONFIGURE_H
#define OSQP_CONFIGURE_H

#define OSQP_ALGEBRA_BUILTIN
#define OSQP_EMBEDDED_MODE 1

#endif
"""


@lru_cache
def osqp() -> ThirdParty:
    """C sources of OSQP's embedded code, which its wheel carries for its code generator.

    Raises:
        SourceError: a wheel without them.
    """
    folder = Path(str(metadata.distribution("osqp").locate_file("osqp/codegen/codegen_src")))
    headers = [p for part in ("public", "private") for p in sorted((folder / "inc" / part).glob("*.h"))]
    paths = [*(folder / "src" / n for n in _OSQP_FILES), *headers]
    if not headers or not all(p.is_file() for p in paths):
        raise SourceError(f"the installed package osqp has no C sources in {folder}; install osqp from PyPI (1.1)")
    files = {f"osqp/{p.name}": p.read_bytes() for p in paths} | {"osqp/osqp_configure.h": _OSQP_CONFIGURATION}
    note = (
        "Solver of quadratic programs, a part of its embedded code. Changed by suspension-fmus: osqp_configure.h, which"
        " OSQP's build generates, is written by hand; the other files are unchanged."
    )
    return ThirdParty("OSQP", metadata.version("osqp"), files, "Apache-2.0", license_file("osqp"), note)


def identity() -> str:
    """What the environment says about these sources, as text for cache keys."""
    chosen = os.environ.get(DAQP_VARIABLE)
    if not chosen or not Path(chosen).is_dir():
        return ""
    try:
        files = _from_folder(Path(chosen)).files
    except SourceError as error:
        return str(error)
    return hashlib.sha256(b"\0".join(files[n] for n in sorted(files))).hexdigest()


THIRD_PARTY = {"daqp": daqp, "osqp": osqp}
