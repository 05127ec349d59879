"""The A2L file of a library (ASAM MCD-2 MC 1.7.1): variables of an instance for measurement and calibration tools.

Addresses are those of an example program with one instance and one struct of inputs. A tool takes those of another
program from its symbols: each variable has the name of its global variable and the offset in it.
"""

from __future__ import annotations

import math
import sys
from collections.abc import Iterator, Mapping

import numpy as np

from build_fmus.base import escape
from build_fmus.component import Model, Variable

_BITS = {"double": 64, "single": 32}  # of a number
_MOST = {64: sys.float_info.max, 32: float(np.finfo(np.float32).max)}


def example_program(name: str) -> str:
    """C code with the global variables whose addresses the file has."""
    return f'#include "{name}.h"\n{name} {name}_example;\n{name}_inputs {name}_example_inputs;\n'


def a2l(component: Model, addresses: Mapping[str, int], prepared: int, precision: str = "double") -> str:
    """The text of the file.

    Tunable parameters are characteristics, inputs and outputs are measurements. So is `prepared` a characteristic: a
    tool writes 0 to it after other parameters, and the next step recalculates what follows from parameters only.

    Args:
        component: that the library was made from.
        addresses: of the global variables of `example_program`.
        prepared: offset of this field in an instance [bytes].
        precision: of its numbers, "double" or "single".
    """
    name, bits = component.name, _BITS[precision]
    parts = [
        "ASAP2_VERSION 1 71",
        f"/begin PROJECT {name} {escape.a2l(component.description)}",
        f'/begin MODULE {name} ""',
        f'/begin MOD_COMMON ""\n  BYTE_ORDER MSB_LAST\n  ALIGNMENT_FLOAT{bits}_IEEE {bits // 8}\n/end MOD_COMMON',
        f"/begin RECORD_LAYOUT NUMBERS\n  FNC_VALUES 1 FLOAT{bits}_IEEE ROW_DIR DIRECT\n/end RECORD_LAYOUT",
        "/begin RECORD_LAYOUT FLAG\n  FNC_VALUES 1 SLONG ROW_DIR DIRECT\n/end RECORD_LAYOUT",
    ]
    listed = list(_variables(component, bits // 8))
    units = {v.unit or "": f"UNIT_{k}" for k, v in enumerate({v.unit or "": v for v, _, _ in listed}.values())}
    for unit, method in units.items():
        text = escape.a2l(unit)
        parts.append(f'/begin COMPU_METHOD {method} {text} IDENTICAL "%.9" {text}\n/end COMPU_METHOD')
    instance, flag = f"{name}_example", escape.c_identifier("prepared", [v.name for v, _, _ in listed])
    parts.append(
        f'/begin CHARACTERISTIC {flag} "write 0 after a change of other characteristics"\n'
        f"  VALUE 0x{addresses[instance] + prepared:08X} FLAG 0 NO_COMPU_METHOD 0 1\n"
        f'  SYMBOL_LINK "{instance}" {prepared}\n/end CHARACTERISTIC'
    )
    for v, symbol, offset in listed:
        about, method = escape.a2l(v.description), units[v.unit or ""]
        address = f"0x{addresses[symbol] + offset:08X}"
        low, high = (_limit(x, s * _MOST[bits]) for x, s in ((v.min, -1), (v.max, 1)))
        link = f'  SYMBOL_LINK "{symbol}" {offset}\n'
        size = f"  MATRIX_DIM {' '.join(str(n) for n in (*v.shape, 1, 1)[:3])}\n" if v.shape else ""
        if v.role == "parameter":
            kind = "VAL_BLK" if v.shape else "VALUE"
            head = f"CHARACTERISTIC {v.name} {about}\n  {kind} {address} NUMBERS 0 {method} {low} {high}\n"
            parts.append(f"/begin {head}{size}{link}/end CHARACTERISTIC")
        else:
            head = f"MEASUREMENT {v.name} {about}\n  FLOAT{bits}_IEEE {method} 0 0 {low} {high}\n"
            parts.append(f"/begin {head}{size}  ECU_ADDRESS {address}\n{link}/end MEASUREMENT")
    return "\n".join([*parts, "/end MODULE", "/end PROJECT", ""])


def _variables(component: Model, size: int) -> Iterator[tuple[Variable, str, int]]:
    """Variables with the global variable that they are in and their offset there [bytes].

    `size` [bytes] of a number.
    """
    results = size * max(1, component.size("parameter"))  # parameters, then results: the first fields of an instance
    instance = f"{component.name}_example"
    places = {"parameter": (instance, 0), "output": (instance, results), "input": (f"{instance}_inputs", 0)}
    for v in component.variables:
        if v.role in places and (v.role != "parameter" or v.tunable):
            symbol, begin = places[v.role]
            yield v, symbol, begin + size * v.slot


def _limit(x: float | None, most: float) -> str:
    return repr(most if x is None or math.isinf(x) else float(x))
