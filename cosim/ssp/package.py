"""An SSP from outside: unpacked, and its files by the URIs that its files name. Nothing is read that is not in it."""

from __future__ import annotations

import tempfile
import warnings
from pathlib import Path
from typing import Any, ClassVar
from urllib.parse import unquote, urlsplit

from build_fmus.base.checks import did_you_mean, one_line
from cosim.core.errors import CosimError, FmuError, SspError, SspWarning
from cosim.fmu.archive import Archive
from cosim.fmu.limits import Limits
from cosim.fmu.xml import tree
from cosim.ssp.names import ENTRY
from cosim.ssp.schema import deviation


class _SspArchive(Archive):
    error: ClassVar[type[CosimError]] = SspError
    kind: ClassVar[str] = "SSP"
    main: ClassVar[str] = ENTRY


class Package:
    """An SSP file, or the folder of an unpacked one, copied to a folder of its own in `scratch`.

    Attributes:
        title: name in messages.
        folder: directory of its files.
    """

    def __init__(self, path: Path, scratch: Path, title: str = ""):
        self.title = title or str(path)
        self.folder = Path(tempfile.mkdtemp(dir=scratch)).resolve()
        try:
            archive = _SspArchive(path, Limits())
            archive.description()  # there is one, and it can be unpacked
            twice = sorted({n for n in archive.names if archive.names.count(n) > 1})
            if twice:
                raise SspError(f"{self.title}: {one_line(twice[0], 80)!r} appears twice")
            archive.unpack(self.folder)
        except FmuError as error:  # of the limits
            raise SspError(str(error)) from None

    def descriptions(self) -> list[Path]:
        """The structure descriptions of the package: SystemStructure.ssd first, then variants by name."""
        found = [p for p in self.folder.glob("*.ssd") if p.is_file()]
        return sorted(found, key=lambda p: (p.name != ENTRY, p.name))

    def file(self, uri: str, base: Path, what: str) -> Path:
        """The file that a URI means, relative to the file `base`. Raises SspError for what is not in the package."""
        name = f"{self.title}: {what}: {one_line(uri, 100)!r}"
        try:
            parts = urlsplit(uri)
        except ValueError:
            raise SspError(f"{name} is not a URI") from None
        if parts.scheme or parts.netloc:
            raise SspError(f"{name} is outside of the SSP, which must contain all files that it uses")
        relative = unquote(parts.path)
        if not relative or "\0" in relative or relative.startswith(("/", "\\")):
            raise SspError(f"{name} is not the relative path of a file in the SSP")
        path = base.parent.joinpath(relative).resolve()
        if not path.is_relative_to(self.folder):
            raise SspError(f"{name} is outside of the SSP")
        try:
            there = path.is_file() or (path.is_dir() and (path / "modelDescription.xml").is_file())
        except OSError:
            there = False
        if not there:
            names = [
                p.relative_to(base.parent).as_posix()
                for p in self.folder.rglob("*")
                if p.is_file() and p.is_relative_to(base.parent)
            ]
            raise SspError(f"{name} is not in the SSP{did_you_mean(relative, names)}")
        return path

    def root(self, file: Path) -> Any:
        """The root element of one of its XML files; a deviation from the standard's schema is warned of."""
        name = file.relative_to(self.folder).as_posix()
        try:
            xml = file.read_bytes()
            root = tree(xml, self.title, Limits(), name)
        except OSError as error:
            raise SspError(f"{self.title}: {name} cannot be read ({error.strerror or error})") from None
        except FmuError as error:
            raise SspError(str(error)) from None
        if found := deviation(root):
            warnings.warn(
                f"{self.title}: {name} deviates from SSP {root.get('version', '')}: {found}", SspWarning, stacklevel=2
            )
        return root
