"""A description and bytes under one digest: a file of our own that is read without executing anything.

A line that says what it is, the SHA-256 of all that follows, the length of the description, the description (canonical
JSON), and the pieces of bytes one after the other; how long each is stands first in the description. The digest finds
damage. It is no signature: whoever makes a file can make its digest, so what is read is checked as if anybody had
written it.
"""

from __future__ import annotations

import hashlib
import json
import re
import struct
from collections.abc import Sequence
from typing import Any

from cosim.core.errors import CosimError

LARGEST = 2**30  # bytes that are read
LARGEST_DESCRIPTION = 2**26
_LENGTH = struct.Struct("<Q")


def pack(magic: bytes, description: dict[str, Any], pieces: Sequence[bytes]) -> bytes:
    """All in one. Raises CosimError when it is larger than what `unpack` takes."""
    text = _canonical({"lengths": [len(p) for p in pieces], "description": description})
    body = b"".join([_LENGTH.pack(len(text)), text, *pieces])
    if len(body) > LARGEST or len(text) > LARGEST_DESCRIPTION:
        raise CosimError(f"it takes {len(body):,} bytes; at most {LARGEST:,} are written")
    return magic + hashlib.sha256(body).digest() + body


def unpack(magic: bytes, data: bytes, what: str) -> tuple[dict[str, Any], list[bytes]]:
    """Description and pieces. Raises CosimError, which begins with `what`, when these are not what `pack` made."""
    start = len(magic) + hashlib.sha256().digest_size
    if not data.startswith(magic):
        kind, _, version = magic.rstrip(b"\n").rpartition(b" ")
        other = re.match(re.escape(kind) + rb" (\d{1,9})\n", data)
        if other:
            raise CosimError(f"{what} is of version {other[1].decode()}; this program reads version {version.decode()}")
        raise CosimError(f"{what} does not begin with '{magic.decode().strip()}'")
    if len(data) > LARGEST + start:
        raise CosimError(f"{what} has {len(data):,} bytes; at most {LARGEST:,} are read")
    body = memoryview(data)[start:]
    if hashlib.sha256(body).digest() != data[len(magic) : start]:
        raise CosimError(f"{what} is damaged or incomplete: SHA-256 mismatch; copy or save it again")
    forged = CosimError(f"{what} was not written by this program: its parts do not fit together")
    try:
        (length,) = _LENGTH.unpack_from(body)
        text = bytes(body[_LENGTH.size : _LENGTH.size + min(length, LARGEST_DESCRIPTION + 1)])
        if len(text) != length:
            raise forged
        about = json.loads(text)
        if type(about) is not dict or _canonical(about) != text:  # nothing twice, no NaN
            raise forged
        lengths, description = about["lengths"], about["description"]
    except (ValueError, KeyError, RecursionError, struct.error):
        raise forged from None
    pieces = body[_LENGTH.size + length :]
    plain = type(lengths) is list and all(type(n) is int and n >= 0 for n in lengths)
    if not plain or type(description) is not dict or sum(lengths) != len(pieces):
        raise forged
    found, begin = [], 0
    for n in lengths:
        found.append(bytes(pieces[begin : begin + n]))
        begin += n
    return description, found


def _canonical(value: Any) -> bytes:
    return json.dumps(value, sort_keys=True, separators=(",", ":"), allow_nan=False).encode("ascii")
