"""FMU files: checked when opened, unpacked and loaded when first instantiated."""

from __future__ import annotations

import os
import shlex
import shutil
import sys
import tempfile
import warnings
import weakref
from collections.abc import Iterable, Mapping
from functools import cached_property
from pathlib import Path
from typing import Any

import cosim.fmu.calls as fmi
from build_fmus.base import safe_files
from build_fmus.base.checks import unknown
from cosim.core.description import Description
from cosim.core.errors import FmuError, FmuWarning
from cosim.core.terminals import Terminal
from cosim.fmu import terminals_file, validation
from cosim.fmu.archive import DESCRIPTION, Archive, check_library
from cosim.fmu.find import find
from cosim.fmu.interface import INTERFACES, NAMES
from cosim.fmu.isolation import IsolatedLibrary, Isolation, NoIsolation
from cosim.fmu.limits import Limits
from cosim.fmu.model_description import read
from cosim.fmu.xml import tree


class Library:
    """An FMU's library in this process, and the folder of the unpacked FMU; closed with its last instance."""

    cancelled = False

    def reusable(self, isolation: Isolation | None) -> bool:
        """Whether its instance will do for one that is isolated so."""
        return isolation is None

    def __init__(self, version: str, interface: str, ffi: Any, handle: Any, folder: Path, own_folder: bool):
        self.handle = handle
        self.folder = folder
        self._owner = os.getpid()
        self._version, self._interface = version, interface
        self.users = 0
        self.open = True
        self._ffi = ffi
        self._own_folder = own_folder  # unpacked for this library alone
        self._kept = False

    def instantiate(
        self,
        texts: tuple[str, str, str],
        log: fmi.Log,
        keep: list[Any],
        **how: Any,
    ) -> Any:
        """Create an instance, or return NULL.

        `texts` = name, token, folder of resources in the form of its FMI version; objects that must outlive the
        instance are put into `keep`. `how`: for FMI 3.0, see `instantiate3`.
        """
        if self._version == "3":
            return fmi.instantiate3(self.handle, texts, log, keep, self._interface, **how)
        return fmi.instantiate2(self.handle, fmi.c_library(), texts, log, keep, self._interface)

    def release(self) -> None:
        """One instance less."""
        self.users -= 1
        if self.users == 0 and not self._kept:
            self.open = False
            fmi.close(self._ffi, self.handle)
            if self._own_folder:
                _remove([self.folder], self._owner)

    def lost(self) -> str | None:
        """How the FMU was lost, in words: in this process it is there as long as the process is."""
        return None

    def failing_function(self, function: str) -> str:
        """The function that failed, where `function` was called."""
        return function

    def failure_detail(self) -> str:
        """What is to be said about a call that failed, apart from its status."""
        return ""

    def keep(self) -> None:
        """Never close it: after a Fatal nothing of it may be called any more, its destructors included."""
        self._kept = True
        _KEPT.append(self)


_KEPT: list[Library] = []


class FmuFile:
    """An FMU file (FMI 2.0 or 3.0), or the folder of an unpacked one.

    `path`: of a file or folder, or the name of a built FMU of the catalog (`cosim.fmu.find`). `interface`: "cs" for
    Co-Simulation, "me" for Model Exchange; by default Co-Simulation if the FMU offers it.

    Opening reads the description only. Raises FmuError for a missing, truncated or foreign file, a wrong FMI
    version, an FMU without that interface, and what cannot be run safely: names that are not unique, sizes beyond
    `limits`. What else deviates from the standard is in `verdict`; an FmuWarning tells of it unless `quiet`, and with
    `strict` it is refused too. The library is closed with its last instance, the unpacked copy is removed by `close()`
    or when Python ends.
    """

    def __init__(
        self,
        path: str | os.PathLike[str],
        *,
        strict: bool = False,
        limits: Limits | None = None,
        quiet: bool = False,
        interface: str | None = None,
    ):
        if interface not in (None, *INTERFACES):
            raise FmuError(unknown("interface", str(interface), INTERFACES))
        self.path = find(path)
        limits = limits or Limits()
        self._archive = Archive(self.path, limits)
        xml = self._archive.description()
        root = tree(xml, str(self.path), limits)
        self.description: Description = read(root, str(self.path), limits, interface)
        self.verdict = validation.verdict(xml, root, self.description)
        if strict:
            self.require_standard()
        elif self.verdict and not quiet:
            text = (
                f"{self.path}: modelDescription.xml deviates from FMI {self.description.fmi_version}:"
                f" {self.verdict.summary()}"
            )
            warnings.warn(text, FmuWarning, stacklevel=2)
        self.major = self.description.fmi_version[0]
        self._library: Library | None = None
        self._folder: Path | None = None  # unpacked, for the next library
        self._abandoned = False
        self._ffi = fmi.ffi_of(self.major)
        self._owned: list[Path] = []
        self._owner = os.getpid()
        weakref.finalize(self, _remove, self._owned, self._owner)

    def __repr__(self) -> str:
        return f"{type(self).__name__}({str(self.path)!r})"

    def structured(self, structure: Mapping[str, Any]) -> Description:
        """The description with other values of structural parameters, by name: arrays have other sizes.

        Raises FmuError for sizes that are too large.
        """
        limits = self._archive.limits
        root = tree(self._archive.description(), str(self.path), limits)
        return read(root, str(self.path), limits, self.description.interface, structure)

    def require_standard(self) -> None:
        """Raises FmuError when the description deviates from the standard, other than by a known quirk of its tool."""
        if self.verdict:
            version = self.description.fmi_version
            raise FmuError(
                f"{self.path}: modelDescription.xml deviates from FMI {version}, which strict mode rejects:"
                f" {self.verdict.summary()}"
            )

    def enumeration(self, variable: str) -> tuple[str, dict[str, int]] | None:
        """Name and items (value by name) of the enumeration that is the type of a variable.

        None if the type is another, or is not defined. An array is given by its name without index.
        """
        root = tree(self._archive.description(), str(self.path), self._archive.limits)
        scalar = root.xpath("ModelVariables/*[@name=$name]", name=variable)
        typed = [e for s in scalar for e in (s, *s) if e.tag == "Enumeration"]
        name = typed[0].get("declaredType") if typed else None
        where = (
            "TypeDefinitions/SimpleType[@name=$name]/Enumeration/Item |"
            " TypeDefinitions/EnumerationType[@name=$name]/Item"
        )
        items = {i.get("name", ""): i.get("value", "") for i in root.xpath(where, name=name or "")}
        if not items:
            return None
        numbers = items.values()
        values = [int(n) if n.lstrip("-").isdecimal() and len(n) < 12 else k for k, n in enumerate(numbers, start=1)]
        return str(name), dict(zip(items, values, strict=True))

    @cached_property
    def terminals(self) -> tuple[Terminal, ...]:
        """The terminals that it declares (FMI 3.0); none if it has no file of them.

        Raises FmuError for a malformed file.
        """
        if self.major == "2" or not self._archive.has(terminals_file.FILE):
            return ()
        return terminals_file.read(
            self._archive.xml(terminals_file.FILE), str(self.path), self.description, self._archive.limits
        )

    @property
    def binary(self) -> str:
        """Path of this platform's library inside the archive."""
        return fmi.library_path(self.major, self.description.identifier)

    def files(self, below: str = "") -> dict[str, bytes]:
        """Its files by path; those in the folder `below` (`"sources/"`) by their path in that.

        Raises FmuError for a damaged file.
        """
        return self._archive.files(below)

    @cached_property
    def digest(self) -> str:
        """SHA-256 of its description and of this platform's library: equal where states of one instance fit another."""
        return self._archive.digest(DESCRIPTION, self.binary)

    def platforms(self) -> list[str]:
        """Platforms whose library is in the archive."""
        name = self.description.identifier
        return sorted({folder for folder, file in self._archive.libraries() if file.rsplit(".", 1)[0] == name})

    def check_platform(self) -> None:
        """Raises FmuError when there is no binary for this machine."""
        if self._archive.has(self.binary):
            return
        there = self.platforms()
        others = [f"binaries/{folder}/{file}" for folder, file in self._archive.libraries()]
        built = (
            f"it was built for {', '.join(there)}"
            if there
            else (
                f"it contains {', '.join(others[:5])}, but its modelIdentifier is {self.description.identifier!r}"
                if others
                else "it has no binaries"
            )
        )
        remedy = "Build or export it for this platform"
        if self._archive.has_sources():
            built += ", but source code"
            remedy += f", or compile its source code ({self._compilation()})"
        raise FmuError(f"{self.path} has no binary for this platform ({self.binary}); {built}. {remedy}")

    def _compilation(self) -> str:
        """The commands by which FMPy compiles its source code; FMPy does not read folders."""
        if not self._archive.is_folder:
            return f"fmpy compile {shlex.quote(str(self.path))}"
        folder = str(self.path.resolve())
        file = shlex.quote(f"{folder}-compiled.fmu")
        return f"python -m zipfile -c {file} {shlex.quote(os.path.join(folder, '.'))}, then fmpy compile {file}"

    def library(self) -> Library:
        """The loaded library, with one more user: call its `release()` when done.

        FMUs that allow one instance per process get a fresh copy at every call.
        """
        library = self._library
        if library is None or not library.open or self.description.only_once:
            self.check_platform()
            folder = self._unpack()
            library = self._library = Library(
                self.major,
                self.description.interface,
                self._ffi,
                self._load(folder),
                folder,
                self.description.only_once,
            )
        library.users += 1
        return library

    def isolated(self, isolation: Isolation) -> IsolatedLibrary:
        """The library in a process of its own, for one instance. Raises FmuError, NoIsolation and WorkerCrashed."""
        self.check_platform()
        folder = self._folder or self._unpack()
        file = folder / self.binary
        try:
            check_library(file)
            library = IsolatedLibrary(self.major, self.description.interface, file, folder, isolation)
        except NoIsolation:
            raise
        except (OSError, FmuError) as error:
            raise FmuError(f"{self.path}: its library cannot be loaded: {error}") from None
        if library.missing:
            library.release()
            raise FmuError(self._lacks(library.missing))
        return library

    def _lacks(self, missing: Iterable[str]) -> str:
        needs = f"which {NAMES[self.description.interface]} needs; build or export it again"
        return f"{self.path}: its library lacks {', '.join(missing)}, {needs}"

    def _load(self, folder: Path) -> Any:
        file = folder / self.binary
        try:
            check_library(file)
            if sys.platform == "win32":
                os.add_dll_directory(str(file.parent))
            handle = self._ffi.dlopen(str(file))
        except OSError as error:
            raise FmuError(f"{self.path}: its library cannot be loaded: {error}") from None
        missing = [name for name in fmi.required(self.major, self.description.interface) if not hasattr(handle, name)]
        if missing:
            fmi.close(self._ffi, handle)
            raise FmuError(self._lacks(missing))
        return handle

    def _unpack(self) -> Path:
        if self._archive.is_folder and not self.description.only_once and not self._abandoned:
            return self.path.resolve()
        if self._folder is not None and not self.description.only_once:
            return self._folder  # its library was closed and is needed again
        try:
            folder = Path(tempfile.mkdtemp(dir=safe_files.scratch()))
        except OSError as error:
            raise FmuError(f"cannot unpack {self.path}: {error}") from None
        self._owned.append(folder)
        self._archive.unpack(folder, ("sources/", "documentation/"))  # most files, which no run reads
        self._folder = folder
        return folder

    def abandon(self, library: Library) -> None:
        """After a Fatal: leave this library alone; the next instance gets a copy of its own."""
        library.keep()
        if library is self._library:
            self._library = self._folder = None
            self._abandoned = True

    def close(self) -> None:
        """Remove the unpacked copy. Close the components first."""
        self._folder = None
        _remove(self._owned, self._owner)


def _remove(folders: list[Path], owner: int) -> None:
    """Remove what a process has unpacked; one that was forked from it leaves that alone."""
    while os.getpid() == owner and folders:
        shutil.rmtree(folders.pop(), ignore_errors=True)
