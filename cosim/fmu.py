"""FMU files: checked when opened, unpacked and loaded when first instantiated."""

from __future__ import annotations

import os
import shutil
import sys
import tempfile
import weakref
import zipfile
import zlib
from pathlib import Path
from typing import Any

from cosim import fmi_calls as fmi
from cosim.description import Description, parse
from cosim.errors import FmuError, did_you_mean
from cosim.fmu_component import FmuComponent


class Fmu:
    """A Co-Simulation FMU file (FMI 2.0 or 3.0), or the folder of an unpacked one.

    Opening reads the description only. Raises FmuError for a missing, truncated or foreign file, a wrong FMI
    version and an FMU without Co-Simulation. The unpacked copy is removed by `close()` or when Python ends.
    """

    def __init__(self, path: str | os.PathLike[str]):
        self.path = Path(path)
        self.description: Description = parse(self._read_description(), str(self.path))
        self.major = self.description.fmi_version[0]
        self._folder: Path | None = None
        self._library: Any = None
        self._abandoned = False
        self._ffi = fmi.ffi2 if self.major == "2" else fmi.ffi3
        self._owned: list[Path] = []
        self._cleanup = weakref.finalize(self, _remove, self._owned)

    def __repr__(self) -> str:
        return f"Fmu({str(self.path)!r})"

    def _read_description(self) -> bytes:
        if not self.path.exists():
            siblings = [p.name for p in self.path.parent.glob("*.fmu")] if self.path.parent.is_dir() else []
            raise FmuError(f"no such FMU: {self.path}{did_you_mean(self.path.name, siblings)}")
        try:
            if self.path.is_dir():
                return (self.path / "modelDescription.xml").read_bytes()
            with zipfile.ZipFile(self.path) as archive:
                self._names = archive.namelist()
                return archive.read("modelDescription.xml")
        except (KeyError, FileNotFoundError):
            raise FmuError(f"{self.path} is not an FMU: it holds no modelDescription.xml") from None
        except (zipfile.BadZipFile, EOFError, zlib.error) as error:
            raise FmuError(f"{self.path} is not an FMU or is incomplete ({error}); copy or build it again") from None
        except OSError as error:
            raise FmuError(f"cannot read {self.path}: {error.strerror or error}") from None

    @property
    def binary(self) -> str:
        """Path of this platform's library inside the archive."""
        folder, suffix = fmi.platform_folder(self.major)
        return f"binaries/{folder}/{self.description.identifier}{suffix}"

    def platforms(self) -> list[str]:
        """Platform folders the archive has binaries for."""
        if self.path.is_dir():
            return sorted(p.name for p in self.path.glob("binaries/*") if p.is_dir())
        return sorted({n.split("/")[1] for n in self._names if n.startswith("binaries/") and n.count("/") >= 2})

    def check_platform(self) -> None:
        """Raises FmuError when there is no binary for this machine."""
        there = (self.path / self.binary).exists() if self.path.is_dir() else self.binary in self._names
        if not there:
            others = ", ".join(self.platforms()) or "no platform at all"
            raise FmuError(
                f"{self.path} has no binary for this platform ({self.binary}); it was built for {others}. "
                "Build or export it for this platform"
            )

    def library(self) -> tuple[Any, Path]:
        """(loaded library, folder of the unpacked FMU). FMUs that allow one instance per process get a fresh copy
        at every call."""
        if self._library is None or self.description.only_once:
            self.check_platform()
            self._folder = self._unpack()
            try:
                if sys.platform == "win32":
                    os.add_dll_directory(str((self._folder / self.binary).parent))
                self._library = self._ffi.dlopen(str(self._folder / self.binary))
            except OSError as error:
                raise FmuError(f"{self.path}: its library cannot be loaded: {error}") from None
        assert self._folder is not None
        return self._library, self._folder

    def _unpack(self) -> Path:
        if self.path.is_dir() and not self.description.only_once and not self._abandoned:
            return self.path.resolve()
        folder = Path(tempfile.mkdtemp(prefix="cosim-"))
        self._owned.append(folder)
        try:
            if self.path.is_dir():
                shutil.copytree(self.path, folder, dirs_exist_ok=True)
            else:
                with zipfile.ZipFile(self.path) as archive:
                    archive.extractall(folder)
        except (zipfile.BadZipFile, zlib.error, EOFError) as error:
            raise FmuError(f"{self.path} is damaged ({error}); copy or build it again") from None
        except OSError as error:
            raise FmuError(f"cannot unpack {self.path} to {folder}: {error.strerror or error}") from None
        return folder

    def abandon(self) -> None:
        """After a Fatal: leave the loaded library alone; the next instance gets a copy of its own."""
        self._library = None
        self._abandoned = True

    def instance(self) -> FmuComponent:
        """A new component of this FMU."""
        return FmuComponent(self)

    def close(self) -> None:
        """Remove the unpacked copy. Close the components first."""
        self._cleanup()


def _remove(folders: list[Path]) -> None:
    for folder in folders:
        shutil.rmtree(folder, ignore_errors=True)
