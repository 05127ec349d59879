"""Changes at random: of bytes, of texts by lines and words, of values."""

from __future__ import annotations

import random
import re
from collections.abc import Callable, Sequence

ODD = (
    "",
    " ",
    "-1",
    "0",
    "-0",
    "1",
    "2",
    "3",
    "1.5",
    "1e999",
    "-1e999",
    "1e-400",
    "nan",
    "NaN",
    "inf",
    "INF",
    "-INF",
    "4294967295",
    "4294967296",
    "9223372036854775807",
    "-9223372036854775809",
    "18446744073709551616",
    "9" * 30,
    "9" * 5000,
    "0x10",
    "1_000",
    "1,5",
    "1;2",
    "1 2 3",
    "1" + " 1" * 500,
    "true",
    "false",
    "True",
    "yes",
    "None",
    "null",
    "[]",
    "{}",
    "1/3",
    "1/0",
    "x",
    "x" * 300,
    "x" * 70_000,
    "../../x",
    "/dev/zero",
    "C:\\x",
    "a.b.c",
    "a[1]",
    "a[1,2]",
    "a[",
    "der(x)",
    "ä€😀",
    "\u202e\u0085\u2028",
    "%s%n",
    "<&>\"'",
    "\t",
    "\n",
    "2.0",
    "3.0",
    "continuous",
    "discrete",
    "fixed",
    "tunable",
    "constant",
    "input",
    "output",
    "parameter",
    "local",
    "independent",
    "calculatedParameter",
    "structuralParameter",
    "exact",
    "approx",
    "calculated",
    "m",
    "deg",
)
"""Values that some reader has been surprised by."""

_NUMBER = re.compile(r"[-+]?\d+(?:\.\d*)?(?:[eEdD][-+]?\d+)?")


def several(
    rng: random.Random, value: bytes, changes: Sequence[Callable[[random.Random, bytes], bytes]], most: int = 5
) -> bytes:
    """One to `most` of the changes, one after the other."""
    for _ in range(rng.randint(1, most)):
        value = rng.choice(changes)(rng, value)
    return value


def odd(rng: random.Random) -> str:
    """A value that some reader has been surprised by."""
    return rng.choice(ODD)


# -------------------------------------------------------------------------------------------------------------- bytes


def flip(rng: random.Random, data: bytes) -> bytes:
    """Some bytes become others."""
    changed = bytearray(data)
    for _ in range(rng.choice((1, 1, 2, 8, 64))):
        if changed:
            changed[rng.randrange(len(changed))] = rng.choice((0, 0xFF, 0x20, 0x0A, rng.randrange(256)))
    return bytes(changed)


def cut(rng: random.Random, data: bytes) -> bytes:
    """The end, the beginning, or a part from the middle is missing."""
    a, b = sorted((rng.randint(0, len(data)), rng.randint(0, len(data))))
    return rng.choice((data[:a], data[a:], data[:a] + data[b:]))


def repeat(rng: random.Random, data: bytes) -> bytes:
    """A part stands there twice, or at another place too."""
    a = rng.randint(0, len(data))
    part = data[a : a + rng.choice((1, 7, 80, 1000))]
    at = rng.choice((a, rng.randint(0, len(data))))
    return data[:at] + part * rng.choice((1, 1, 2, 50)) + data[at:]


def insert(rng: random.Random, data: bytes) -> bytes:
    """Something odd stands somewhere."""
    at = rng.randint(0, len(data))
    new = rng.choice(
        (
            odd(rng).encode(),
            rng.randbytes(rng.randint(1, 16)),
            rng.choice((b"[", b"{", b'{"a":', b"(")) * rng.choice((1, 100, 100_000)),
        )
    )
    return data[:at] + new + data[at:]


BYTES = (flip, cut, repeat, insert)

# -------------------------------------------------------------------------------------------------------------- texts


def number(rng: random.Random, data: bytes) -> bytes:
    """One number, or all of one kind, become something odd."""
    text = data.decode("latin-1")
    found = list(_NUMBER.finditer(text))
    if not found:
        return insert(rng, data)
    one = rng.choice(found)
    new = odd(rng).encode().decode("latin-1")
    if rng.random() < 0.1 and len(found) < 5000:
        return text.replace(one[0], new, 200).encode("latin-1")
    return (text[: one.start()] + new + text[one.end() :]).encode("latin-1")


def line(rng: random.Random, data: bytes) -> bytes:
    """A line is missing, is there twice or often, changes places, or is empty."""
    lines = data.split(b"\n")
    i, k = rng.randrange(len(lines)), rng.randrange(len(lines))
    match rng.randrange(5):
        case 0:
            del lines[i]
        case 1:
            lines[i:i] = [lines[i]] * rng.choice((1, 1, 3, 300))
        case 2:
            lines[i], lines[k] = lines[k], lines[i]
        case 3:
            lines[i:i] = [b""]
        case _:
            lines[i] = lines[i] + rng.choice((b",", b";", b" ", b"=", b"\t", b'"', b"#", b"[")) + odd(rng).encode()
    return b"\n".join(lines)


def word(rng: random.Random, data: bytes) -> bytes:
    """A word is missing, becomes another one of the file, or something odd."""
    found = list(re.finditer(rb"\w+", data))
    if not found:
        return insert(rng, data)
    one, other = rng.choice(found), rng.choice(found)
    new = rng.choice((b"", other[0], odd(rng).encode(), one[0][:-1], one[0].upper()))
    return data[: one.start()] + new + data[one.end() :]


def encoding(rng: random.Random, data: bytes) -> bytes:
    """Another encoding, other ends of lines, another separator, a mark at the beginning."""
    match rng.randrange(6):
        case 0:
            return data.decode("utf-8", "replace").encode(
                rng.choice(("utf-16", "utf-16-be", "utf-32", "utf-7", "cp037")), "replace"
            )
        case 1:
            return data.replace(b"\n", rng.choice((b"\r\n", b"\r", b"\n\n", b"\x85", b"\0")))
        case 2:
            return data.replace(b",", rng.choice((b";", b"\t", b"  ", b",,")))
        case 3:
            return b"\xef\xbb\xbf" + data
        case 4:
            return data.replace(b".", b",")
        case _:
            return data.replace(b'"', rng.choice((b"'", b'"""', b"")))


TEXTS = (number, number, number, line, line, word, word, encoding, *BYTES)
