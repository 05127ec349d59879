"""Validation of FMU files and folders: names, sizes, contents, the library.

Every declared size is compared with a limit before memory or disk space of that size is used.
"""

from __future__ import annotations

import hashlib
import lzma
import shutil
import struct
import zipfile
import zlib
from collections.abc import Sequence
from contextlib import nullcontext
from pathlib import Path, PurePosixPath, PureWindowsPath
from typing import IO, ClassVar

from build_fmus.base.checks import did_you_mean, one_line
from cosim.core.errors import CosimError, FmuError
from cosim.fmu.limits import Limits

DESCRIPTION = "modelDescription.xml"
ENTRY = 128  # bytes of an archive's directory for one file, name included, on average
LARGEST_RATIO = 100  # of unpacked to packed bytes; text compresses by 10 to 30, a bomb by 1000 and more

# of an archive: the size of its directory; the same beyond 4 GB, and the bytes between the two
_END = struct.Struct("<12xI6x")
_WIDE_END = struct.Struct("<40xQ8x")
_LOCATOR = 20
_METHODS = (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED)  # of compression, those that FMI allows

_DAMAGED = (
    zipfile.BadZipFile,
    zlib.error,
    lzma.LZMAError,
    EOFError,
    RuntimeError,
    ValueError,
    ArithmeticError,
    LookupError,
    struct.error,
)
"""What `zipfile` raises for damaged, encrypted (RuntimeError) and unknown (NotImplementedError) contents."""


class Archive:
    """An FMU file, or the folder of an unpacked one.

    Raises FmuError (`error`) for missing files and for files that are no FMU (`kind`).
    """

    error: ClassVar[type[CosimError]] = FmuError
    kind: ClassVar[str] = "FMU"
    main: ClassVar[str] = DESCRIPTION

    def __init__(self, path: Path, limits: Limits):
        self.path = path
        self.limits = limits
        self._require()
        self.is_folder = path.is_dir()
        self.names: Sequence[str] = ()

    def _require(self) -> None:
        try:
            if self.path.is_dir() or self.path.is_file():
                return
            if self.path.exists():  # a pipe, a device
                raise self.error(f"{self.path} is not an {self.kind}: it is neither a file nor a folder")
            siblings = (
                [p.name for p in self.path.parent.glob(f"*.{self.kind.lower()}")] if self.path.parent.is_dir() else []
            )
        except OSError as error:  # a name that is too long, a folder that may not be read
            raise self.error(f"cannot read {self.path}: {error.strerror or error}") from None
        raise self.error(f"no such {self.kind}: {self.path}{did_you_mean(self.path.name, siblings)}")

    def description(self) -> bytes:
        """modelDescription.xml, or what else is its main file."""
        return self.xml(self.main)

    def xml(self, name: str) -> bytes:
        """The bytes of one of its XML files."""
        try:
            if self.is_folder:
                file = self.path / name
                self._check_xml(name, file.stat().st_size)
                if not file.is_file():
                    raise self.error(f"{self.path} is not an {self.kind}: its {name} is not a file")
                return file.read_bytes()
            with self._opened() as archive:
                self.names = archive.namelist()
                if self.names.count(name) > 1:
                    raise self.error(f"{self.path} is an unsafe {self.kind}: it contains more than one {name}")
                member = archive.getinfo(name)
                self._check_xml(name, member.file_size)
                _check_method(member)
                with archive.open(member) as stream:  # a part at a time: what is packed may be larger than it says
                    return b"".join(iter(lambda: stream.read(2**20), b""))
        except (KeyError, FileNotFoundError):
            raise self.error(f"{self.path} is not an {self.kind}: it contains no {name}") from None
        except OSError as error:
            raise self.error(f"cannot read {self.path}: {error.strerror or error}") from None
        except _DAMAGED as error:
            reason = one_line(str(error))
            raise self.error(
                f"{self.path} is not an {self.kind} or is incomplete ({reason}); copy or build it again"
            ) from None

    def _check_xml(self, name: str, size: int) -> None:
        self.limits.check("xml_bytes", size, f"{self.path}: its {name} has {_megabytes(size)}")

    def _opened(self) -> zipfile.ZipFile:
        """The archive, whose directory is of a size that can be read."""
        with self.path.open("rb") as file:
            size = _directory_size(file)
        count = size // ENTRY
        self.limits.check(
            "files", count, f"{self.path}: its directory has {_megabytes(size)}, enough for {count} files"
        )
        return zipfile.ZipFile(self.path)

    def digest(self, *names: str) -> str:
        """SHA-256 of some of its files, one after the other with their lengths."""
        digest = hashlib.sha256()
        try:
            with nullcontext() if self.is_folder else zipfile.ZipFile(self.path) as archive:
                for name in names:
                    content = (self.path / name).read_bytes() if archive is None else archive.read(name)
                    digest.update(len(content).to_bytes(8, "little") + content)
        except OSError as error:
            raise self.error(f"cannot read {self.path}: {error.strerror or error}") from None
        except (KeyError, *_DAMAGED) as error:
            raise self.error(f"{self.path} is damaged or was replaced ({error}); copy or build it again") from None
        return digest.hexdigest()

    def has(self, name: str) -> bool:
        """Is there a file of that name?"""
        return (self.path / name).is_file() if self.is_folder else name in self.names

    def files(self, below: str = "") -> dict[str, bytes]:
        """Its files by path; those in the folder `below` (`"sources/"`) by their path in that."""
        try:
            if self.is_folder:
                folder = self.path / below
                found = sorted(p for p in folder.rglob("*") if p.is_file())
                return {p.relative_to(folder).as_posix(): p.read_bytes() for p in found}
            with self._opened() as archive:
                names = [n for n in archive.namelist() if n.startswith(below) and not n.endswith("/")]
                return {n.removeprefix(below): archive.read(n) for n in names}
        except OSError as error:
            raise self.error(f"cannot read {self.path}: {error.strerror or error}") from None
        except _DAMAGED as error:
            raise self.error(f"{self.path} is damaged ({one_line(str(error))}); copy or build it again") from None

    def libraries(self) -> list[tuple[str, str]]:
        """(platform folder, file name) of every shared library below `binaries/`."""
        if self.is_folder:
            found = [(p.parent.name, p.name) for p in self.path.glob("binaries/*/*") if p.is_file()]
        else:
            parts = [name.split("/") for name in self.names]
            found = [(p[1], p[2]) for p in parts if len(p) == 3 and p[0] == "binaries" and p[2]]
        return sorted(pair for pair in found if pair[1].endswith((".so", ".dll", ".dylib")))

    def has_sources(self) -> bool:
        """Whether it has files of C or C++ below `sources/`."""
        if self.is_folder:
            names = [p.name for p in (self.path / "sources").rglob("*")]
        else:
            names = [n for n in self.names if n.startswith("sources/")]
        return any(n.lower().endswith((".c", ".cc", ".cpp", ".cxx")) for n in names)

    def unpack(self, folder: Path, without: tuple[str, ...] = ()) -> None:
        """Put a copy of everything into `folder`, except for the folders in `without` (`"sources/"`) of an archive."""
        try:
            if self.is_folder:
                shutil.copytree(self.path, folder, dirs_exist_ok=True)
                return
            with self._opened() as archive:
                self._check_contents(archive.infolist(), folder)
                archive.extractall(folder, [n for n in archive.namelist() if not n.startswith(without)])
        except OSError as error:
            raise self.error(f"cannot unpack {self.path} to {folder}: {error.strerror or error}") from None
        except UnicodeEncodeError as error:
            name = error.object[error.start : error.end]
            raise self.error(
                f"cannot unpack {self.path}: this locale has no characters for {name!r} in a file's name; set"
                " PYTHONUTF8=1"
            ) from None
        except _DAMAGED as error:
            raise self.error(f"{self.path} is damaged ({one_line(str(error))}); copy or build it again") from None

    def _check_contents(self, members: Sequence[zipfile.ZipInfo], folder: Path) -> None:
        for member in members:
            posix, windows = PurePosixPath(member.filename), PureWindowsPath(member.filename)
            _check_method(member)
            if posix.is_absolute() or windows.drive or windows.root or ".." in (*posix.parts, *windows.parts):
                name = one_line(member.filename)
                raise self.error(
                    f"{self.path} is an unsafe {self.kind}: it contains {name!r}, a path outside of the archive"
                )
        size = sum(member.file_size for member in members)
        if size > LARGEST_RATIO * self.path.stat().st_size:
            what = f"{self.path} would unpack to {_megabytes(size)}, more than {LARGEST_RATIO} times its own size"
            self.limits.check("unpacked_bytes", size, what)
        free = shutil.disk_usage(folder).free
        if size > free:
            raise self.error(
                f"cannot unpack {self.path}: it needs {_megabytes(size)}, and {folder.parent} has {_megabytes(free)}"
                " free"
            )


def _check_method(member: zipfile.ZipInfo) -> None:
    """Raise NotImplementedError for methods of compression that FMI does not know: some unpack without bounds."""
    if member.compress_type not in _METHODS:
        name = one_line(member.filename, 80)
        raise NotImplementedError(
            f"{name!r} is compressed with method {member.compress_type}; FMI allows 0 (stored) and 8 (deflate)"
        )


def check_library(path: Path) -> None:
    """Raise OSError when an ELF library is shorter than its own headers say.

    Loading half a library would end the process with SIGBUS. The loaders of Windows and macOS check this themselves;
    that of Linux checks all else.
    """
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


def _directory_size(file: IO[bytes]) -> int:
    """Size of an archive's directory [bytes] from its end record, found as `zipfile` finds it; 0 if it is no archive.

    The directory is read as a whole, and holds 46 bytes and a name for each file.
    """
    end = file.seek(0, 2)
    file.seek(max(0, end - 2**16 - _END.size - _WIDE_END.size - _LOCATOR))  # a comment may follow
    tail = file.read()
    at = len(tail) - _END.size
    if not (tail[at:].startswith(b"PK\x05\x06") and tail.endswith(b"\0\0")):
        at = tail.rfind(b"PK\x05\x06")
    if at < 0 or len(tail) - at < _END.size:
        return 0
    (size,) = _END.unpack_from(tail, at)
    wide = at - _LOCATOR - _WIDE_END.size
    if wide >= 0 and tail[wide:].startswith(b"PK\x06\x06"):
        (size,) = _WIDE_END.unpack_from(tail, wide)
    return min(int(size), end)


def _megabytes(size: int) -> str:
    return f"{size / 1e6:,.0f} MB"
