"""C headers of this project, as cffi reads them."""

from __future__ import annotations

import re
from pathlib import Path


def declarations(*headers: Path) -> str:
    """What headers declare, without directives and without what is for C++ alone."""
    text = "".join(header.read_text(encoding="utf-8") for header in headers)
    return re.sub(r"(?ms)^#ifdef __cplusplus$.*?^#endif$|^#[^\n]*$", "", text)
