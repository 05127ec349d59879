"""What a page holds compressed."""

from __future__ import annotations

import re
import zlib
from base64 import b64decode


def packed_texts(page: str) -> dict[str, str]:
    """Texts by the ids of their elements."""
    found = {}
    for id_, size, content in re.findall(
        r'<script type="application/x-deflate" id="([^"]+)" data-bytes="(\d+)">([^<]*)</script>', page
    ):
        plain = zlib.decompress(b64decode(content, validate=True), -zlib.MAX_WBITS)
        assert len(plain) == int(size)
        found[id_] = plain.decode()
    return found
