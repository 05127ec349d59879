"""What a variable belongs to, by its structured name: `road.fl.height` is `height` of `fl` of `road`.

Who writes terminals and who wires FMUs that have none read names alike.
"""

from __future__ import annotations


def place(name: str, *, array: bool = False) -> tuple[tuple[str, ...], str]:
    """Where a variable stands: the names of what it belongs to, outermost first, and its own.

    Everything ahead of the last dot is what it belongs to; a name without dots belongs to itself. An array (`array`,
    or a name with an index) is something to belong to, too: `preview.fl[3]` is `fl[3]` of `fl` of `preview`. Dots
    within quotes and brackets separate nothing.
    """
    begin = index = 0  # of the last part; of what follows it in brackets, at the very end
    quoted, depth, parts = False, 0, []
    for at, character in enumerate(name):
        if character == "'":
            quoted = not quoted
        elif quoted:
            continue
        elif character == "[":
            index = at if depth == 0 else index
            depth += 1
        elif character == "]":
            depth -= 1
        elif character == "." and depth == 0:
            parts.append(name[begin:at])
            begin = at + 1
    last = name[begin:]
    if array or (index > begin and name.endswith("]")):
        parts.append(name[begin:index] if index > begin else last)
    return tuple(parts) or (last,), last
