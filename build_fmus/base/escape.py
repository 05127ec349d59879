"""Texts from outside in what this project writes: one function for each language, which all packages use.

Names, units and descriptions come from files of other people. In C they stand in strings only: a comment ends at signs
that nobody sees.
"""

from __future__ import annotations

import html as _html
import json
import math
import re
import shlex
from collections.abc import Collection
from typing import Any

NO_XML = re.compile("[^\t\n\r\x20-\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]")
"""A character that no XML document can hold, escaped or not."""
_REPLACEMENT = "\ufffd"


def c_string(text: str) -> str:
    """A string literal of C99 with the bytes of the text in UTF-8.

    What the compiler would read otherwise is an octal escape, and `?` is escaped, since two of them begin a trigraph.
    A zero byte, which would end the string, is replaced.
    """
    return '"' + "".join(map(_c_byte, text.replace("\0", _REPLACEMENT).encode("utf-8", "replace"))) + '"'


def _c_byte(byte: int) -> str:
    sign = chr(byte)
    if sign in '"\\?':
        return f"\\{sign}"
    return sign if 32 <= byte < 127 else f"\\{byte:03o}"


def c_comment(text: str) -> str:
    """Text of a declaration for a comment of C, which it neither ends nor continues.

    For texts that the author of a component writes, not for names from outside.
    """
    plain = re.sub(r"[\x00-\x1f\x7f\\]", " ", text)
    return re.sub(r"\?(?=\?)|\*(?=/)|/(?=\*)", r"\g<0> ", plain)


def c_identifier(text: str, taken: Collection[str] = ()) -> str:
    """An identifier like the text, none of those that are taken: also a name for files and for elements of an SSP."""
    plain = re.sub(r"\W", "_", text, flags=re.ASCII)
    plain = plain if plain and not plain[0].isdigit() else f"_{plain}"
    return next(n for n in (plain, *(f"{plain}_{k}" for k in range(2, len(taken) + 3))) if n not in taken)


def c_number(x: float) -> str:
    """A number of C that is read back to the last bit."""
    if math.isnan(x):
        return "NAN"
    if x in (float("inf"), float("-inf")):
        return "INFINITY" if x > 0 else "-INFINITY"
    return repr(float(x))


def a2l(text: str) -> str:
    """A string of an A2L file, in ASCII on one line."""
    plain = re.sub(r"[^ -~]", "?", re.sub(r"\s+", " ", text))
    return '"' + plain.replace("\\", "\\\\").replace('"', '\\"') + '"'


def xml(text: str) -> str:
    """Text for an element or attribute of lxml: characters that XML cannot contain are replaced.

    lxml escapes the rest.
    """
    return NO_XML.sub(_REPLACEMENT, text)


def html(text: str) -> str:
    """Text in HTML, and in the labels of plotly, which reads them as such."""
    return _html.escape(text, quote=False)


def script(value: Any) -> str:
    """JSON within a `<script>`, which no text in it can end."""
    text = json.dumps(value, sort_keys=True, separators=(",", ":"), allow_nan=False)
    return re.sub("[<>&]", lambda m: f"\\u{ord(m[0]):04x}", text)


def shell(text: str) -> str:
    """One word of a command line of a POSIX shell."""
    return shlex.quote(text)
