"""FMU files and folders, believed only as far as they can be checked: names, sizes, contents, the library.

A declared size costs a sender nothing, so every size is compared with a limit before anything is made that big.
"""

from __future__ import annotations

import lzma
import shutil
import struct
import zipfile
import zlib
from collections.abc import Sequence
from pathlib import Path, PurePosixPath, PureWindowsPath

from build_fmus.checks import did_you_mean
from cosim.errors import FmuError

DESCRIPTION = "modelDescription.xml"
LARGEST_DESCRIPTION = 128 * 2**20  # bytes; a hundred thousand variables take some 40 MB
SMALL_ARCHIVE = 2**30  # bytes; unpacked archives up to this size are not looked at further
LARGEST_RATIO = 100  # of unpacked to packed bytes; text compresses by 10 to 30, a bomb by 1000 and more

_DAMAGED = (
    zipfile.BadZipFile, zlib.error, lzma.LZMAError, EOFError, RuntimeError, ValueError, ArithmeticError, LookupError,
    struct.error,
)  # fmt: skip
"""What `zipfile` raises for damaged, encrypted (RuntimeError) and unknown (NotImplementedError) contents."""


class Archive:
    """An FMU file, or the folder of an unpacked one. Raises FmuError for what is missing or no FMU."""

    def __init__(self, path: Path):
        self.path = path
        self._require()
        self.is_folder = path.is_dir()
        self.names: Sequence[str] = ()

    def _require(self) -> None:
        try:
            if self.path.exists():
                return
            siblings = [p.name for p in self.path.parent.glob("*.fmu")] if self.path.parent.is_dir() else []
        except OSError as error:  # a name that is too long, a folder that may not be read
            raise FmuError(f"cannot read {self.path}: {error.strerror or error}") from None
        raise FmuError(f"no such FMU: {self.path}{did_you_mean(self.path.name, siblings)}")

    def description(self) -> bytes:
        """modelDescription.xml."""
        try:
            if self.is_folder:
                file = self.path / DESCRIPTION
                self._check_description(file.stat().st_size)
                return file.read_bytes()
            with zipfile.ZipFile(self.path) as archive:
                self.names = archive.namelist()
                self._check_description(archive.getinfo(DESCRIPTION).file_size)
                return archive.read(DESCRIPTION)
        except (KeyError, FileNotFoundError):
            raise FmuError(f"{self.path} is not an FMU: it holds no {DESCRIPTION}") from None
        except OSError as error:
            raise FmuError(f"cannot read {self.path}: {error.strerror or error}") from None
        except _DAMAGED as error:
            raise FmuError(f"{self.path} is not an FMU or is incomplete ({error}); copy or build it again") from None

    def _check_description(self, size: int) -> None:
        if size > LARGEST_DESCRIPTION:
            raise FmuError(
                f"{self.path}: its {DESCRIPTION} has {_megabytes(size)}; at most {_megabytes(LARGEST_DESCRIPTION)} are read"
            )

    def has(self, name: str) -> bool:
        """Is there a file of that name?"""
        return (self.path / name).is_file() if self.is_folder else name in self.names

    def libraries(self) -> list[tuple[str, str]]:
        """(platform folder, file name) of every shared library below `binaries/`."""
        if self.is_folder:
            found = [(p.parent.name, p.name) for p in self.path.glob("binaries/*/*") if p.is_file()]
        else:
            parts = [name.split("/") for name in self.names]
            found = [(p[1], p[2]) for p in parts if len(p) == 3 and p[0] == "binaries" and p[2]]
        return sorted(pair for pair in found if pair[1].endswith((".so", ".dll", ".dylib")))

    def unpack(self, folder: Path) -> None:
        """Put a copy of everything into `folder`."""
        try:
            if self.is_folder:
                shutil.copytree(self.path, folder, dirs_exist_ok=True)
                return
            with zipfile.ZipFile(self.path) as archive:
                self._check_contents(archive.infolist(), folder)
                archive.extractall(folder)
        except OSError as error:
            raise FmuError(f"cannot unpack {self.path} to {folder}: {error.strerror or error}") from None
        except UnicodeEncodeError as error:
            name = error.object[error.start : error.end]
            raise FmuError(
                f"cannot unpack {self.path}: this locale has no characters for {name!r} in a file's name; set PYTHONUTF8=1"
            ) from None
        except _DAMAGED as error:
            raise FmuError(f"{self.path} is damaged ({error}); copy or build it again") from None

    def _check_contents(self, members: Sequence[zipfile.ZipInfo], folder: Path) -> None:
        for member in members:
            posix, windows = PurePosixPath(member.filename), PureWindowsPath(member.filename)
            if posix.is_absolute() or windows.drive or windows.root or ".." in (*posix.parts, *windows.parts):
                raise FmuError(f"{self.path} is no FMU to be trusted: it holds {member.filename!r}, outside of itself")
        size = sum(member.file_size for member in members)
        if size > max(SMALL_ARCHIVE, LARGEST_RATIO * self.path.stat().st_size):
            raise FmuError(
                f"{self.path} would unpack to {_megabytes(size)}, more than {LARGEST_RATIO} times its own size; "
                "if that is right, unpack it and give the folder"
            )
        free = shutil.disk_usage(folder).free
        if size > free:
            raise FmuError(
                f"cannot unpack {self.path}: it needs {_megabytes(size)}, and {folder.parent} has {_megabytes(free)} free"
            )


def check_library(path: Path) -> None:
    """Raise OSError when an ELF library is shorter than its own headers say: loading half a library ends the process
    with SIGBUS. (The loaders of Windows and macOS check this themselves, as that of Linux checks all else.)"""
    with path.open("rb") as file:
        head = file.read(64)
        if head[:4] != b"\x7fELF":
            return
        size = path.stat().st_size
        try:
            order = {1: "<", 2: ">"}[head[5]]
            wide = head[4] == 2
            at, _, _, _, length, count = struct.unpack_from(
                order + ("QQIHHH" if wide else "IIIHHH"), head, 32 if wide else 28
            )
            file.seek(at)
            table = file.read(length * count)
            ends = [at + length * count]
            for i in range(count):  # offset and size in the file of each segment
                if wide:
                    offset, _, _, stored = struct.unpack_from(order + "QQQQ", table, i * length + 8)
                else:
                    offset, _, _, stored = struct.unpack_from(order + "IIII", table, i * length + 4)
                ends.append(offset + stored)
        except (struct.error, KeyError, IndexError):
            raise OSError(f"{path.name} ends within its header") from None
    if max(ends) > size:
        raise OSError(f"{path.name} is cut short: it has {size} of {max(ends)} bytes")


def _megabytes(size: int) -> str:
    return f"{size / 1e6:,.0f} MB"
