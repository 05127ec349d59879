"""Build backend: setuptools, with everything below one name when it is installed.

In the repository three packages lie side by side. Installed like that, `cosim`, `build_fmus` and `fmu_sources`
would lie beside those of others, and `cosim` there is one already. So a wheel has them in `suspension_fmus/`, and a
path file that makes Python look there last: `import cosim` finds ours unless there is another one. An editable
install has the packages where they are.

What is made depends on the sources and on the version of setuptools, not on the day, the machine, or what lies around:
it is made from a fresh copy, and archives carry no times.
"""

from __future__ import annotations

import base64
import gzip
import hashlib
import io
import os
import shutil
import tarfile
import tempfile
import zipfile
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from types import MappingProxyType
from typing import Any

from setuptools import build_meta
from setuptools.build_meta import (
    build_editable,
    get_requires_for_build_editable,
    get_requires_for_build_sdist,
    get_requires_for_build_wheel,
    prepare_metadata_for_build_editable,
)

NAME = "suspension_fmus"
PACKAGES = ("build_fmus", "cosim", "fmu_sources")  # that go below it
SOURCES = ("LICENSE", "README.md", "pyproject.toml", ".ci", *PACKAGES)
_IGNORED = shutil.ignore_patterns("__pycache__", "*.py[co]", ".*_cache")


def build_wheel(
    wheel_directory: str,
    config_settings: Any = None,
    metadata_directory: str | None = None,  # noqa: ARG001
    more: Mapping[str, bytes] = MappingProxyType({}),
    platform: str = "any",
) -> str:
    """The wheel of setuptools, repacked with one name at its top.

    `more`: further files by path; `platform`: the tag of that which they are for.
    """
    target = Path(wheel_directory).resolve()
    with _copy():
        name = build_meta.build_wheel(".", config_settings)
        with zipfile.ZipFile(name) as made:
            files = {_installed(n): made.read(n) for n in made.namelist() if not n.endswith("/")}
    files |= {_installed(n): data for n, data in more.items()}
    (record,) = (n for n in files if n.endswith(".dist-info/RECORD"))
    info = record.removesuffix("RECORD")
    files[f"{NAME}.pth"] = f"{NAME}\n".encode()
    files[f"{info}top_level.txt"] = f"{NAME}\n".encode()
    if platform != "any":
        name = name.replace("-any.whl", f"-{platform}.whl")
        about = files[f"{info}WHEEL"].replace(b"-any\n", f"-{platform}\n".encode())
        files[f"{info}WHEEL"] = about.replace(b"Purelib: true", b"Purelib: false")
    files[record] = _record({n: data for n, data in files.items() if n != record}, record)
    with zipfile.ZipFile(target / name, "w") as wheel:
        for one in sorted(files, key=lambda n: (n.startswith(info), n == record, n)):
            entry = zipfile.ZipInfo(one)  # of 1980
            entry.external_attr = 0o100644 << 16
            wheel.writestr(entry, files[one], zipfile.ZIP_DEFLATED, 9)
    return name


def build_sdist(sdist_directory: str, config_settings: Any = None) -> str:
    """What a wheel is made of, this file included, and its metadata as PKG-INFO."""
    target = Path(sdist_directory).resolve()
    with _copy() as root:
        files = {p.relative_to(root).as_posix(): p.read_bytes() for p in root.rglob("*") if p.is_file()}
        info = Path(build_meta.prepare_metadata_for_build_wheel(".", config_settings))
        files["PKG-INFO"] = (info / "METADATA").read_bytes()
    stem = info.name.removesuffix(".dist-info")
    packed = io.BytesIO()
    with tarfile.open(fileobj=packed, mode="w", format=tarfile.PAX_FORMAT) as archive:
        for name, data in sorted(files.items()):
            entry = tarfile.TarInfo(f"{stem}/{name}")  # of 1970, of nobody
            entry.size, entry.mode = len(data), 0o644
            archive.addfile(entry, io.BytesIO(data))
    (target / f"{stem}.tar.gz").write_bytes(gzip.compress(packed.getvalue(), mtime=0))
    return f"{stem}.tar.gz"


@contextmanager
def _copy() -> Iterator[Path]:
    """A fresh copy of the sources as the current folder: setuptools packs what earlier builds have left in theirs."""
    source = Path.cwd()
    with tempfile.TemporaryDirectory() as folder:
        root = Path(folder).resolve()
        for name in SOURCES:
            if (source / name).is_dir():
                shutil.copytree(source / name, root / name, ignore=_IGNORED)
            else:
                shutil.copy(source / name, root / name)
        os.chdir(root)
        try:
            yield root
        finally:
            os.chdir(source)


def _installed(name: str) -> str:
    return f"{NAME}/{name}" if name.partition("/")[0] in PACKAGES else name


def _record(files: Mapping[str, bytes], record: str) -> bytes:
    lines = [f"{name},sha256={_digest(data)},{len(data)}" for name, data in sorted(files.items())]
    return "\n".join([*lines, f"{record},,", ""]).encode()


def _digest(data: bytes) -> str:
    return base64.urlsafe_b64encode(hashlib.sha256(data).digest()).rstrip(b"=").decode()


__all__ = [
    "build_editable",
    "build_sdist",
    "build_wheel",
    "get_requires_for_build_editable",
    "get_requires_for_build_sdist",
    "get_requires_for_build_wheel",
    "prepare_metadata_for_build_editable",
]
