"""Generated equations without those of outputs that nothing reads.

A compiler leaves them out where numbers are plain. It cannot where an operation calls a function of its own, or keeps
something (numbers.h).
"""

from __future__ import annotations

import math
import re
from collections import Counter
from collections.abc import Collection

_OUTPUTS = re.compile(r"typedef struct \{([^}]*)\} Outputs;")
_FIELD = re.compile(r"real (\w+)((?:\[\d+\])*);")
_FUNCTION = re.compile(r"^static void (?:outputs|sample)\(.*?^\}$", re.MULTILINE | re.DOTALL)
_JACOBIAN = re.compile(r"^static void jacobian\(.*?^\}$", re.MULTILINE | re.DOTALL)
_SHOWN = re.compile(r"(?<=[;{}])\s*y->(\w+)(?:\[[^]]*\])* = [^;{}]*;")
_DEFINITION = re.compile(r"(?<=[;{}])\s*const (?:real|condition) (\w+) = [^;{}]*;")
_NAME = re.compile(r"\b[A-Za-z_]\w*")


def without_unread(model: str, slots: Collection[int], jacobian: bool) -> str:
    """The text of a `model.c` without comments, without what only outputs other than those with these slots need.

    `jacobian`: whether its solver needs that function, which takes long to compile over numbers with operators.
    """
    if not jacobian:
        model = _JACOBIAN.sub("", model)
    found = _OUTPUTS.search(model)
    if found is None:
        return model
    unread, slot = set(), 0
    for name, sizes in _FIELD.findall(found[1]):
        end = slot + math.prod(map(int, re.findall(r"\d+", sizes)))
        if not any(slot <= s < end for s in slots):
            unread.add(name)
        slot = end
    return _FUNCTION.sub(lambda function: _without(function[0], unread), model)


def _without(function: str, unread: Collection[str]) -> str:
    """A function without assignments to these outputs, and without values that nothing needs then."""
    read = Counter(re.findall(r"y->(\w+)", function))
    assigned = Counter(found[1] for found in _SHOWN.finditer(function))
    gone = {name for name in unread if read[name] == assigned[name]}
    function = _SHOWN.sub(lambda found: "" if found[1] in gone else found[0], function)
    before = ""
    while function != before:
        before, uses = function, Counter(_NAME.findall(function))
        unused = [name for name in _DEFINITION.findall(function) if uses[name] == 1]
        for name in unused:
            function = re.sub(rf"\s*const (?:real|condition) {name} = [^;{{}}]*;", "", function, count=1)
    return function
