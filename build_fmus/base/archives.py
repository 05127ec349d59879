"""Zip archives that depend on their content alone."""

from __future__ import annotations

import io
import zipfile
from collections.abc import Mapping

_EPOCH = (1980, 1, 1, 0, 0, 0)
_UNIX = 3


def zipped(files: Mapping[str, bytes], first: str = "") -> bytes:
    """The bytes of a zip archive with these files by path: the same for the same content.

    The file `first` begins it, the others follow by name. Archives in it are stored as they are; what is below
    `binaries/` can be executed.
    """
    out = io.BytesIO()
    with zipfile.ZipFile(out, "w", compresslevel=9) as archive:
        for name in sorted(files, key=lambda n: (n != first, n)):
            info = zipfile.ZipInfo(name, date_time=_EPOCH)
            info.compress_type = zipfile.ZIP_STORED if name.endswith(".fmu") else zipfile.ZIP_DEFLATED
            info.create_system = _UNIX
            info.external_attr = (0o755 if name.startswith("binaries/") else 0o644) << 16
            archive.writestr(info, files[name])
    return out.getvalue()
