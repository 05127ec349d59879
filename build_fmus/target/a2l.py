"""A2L files (ASAM MCD-2 MC 1.7.1): variables of an instance for measurement and calibration tools.

The addresses of a library are those of an example program with one instance and one struct of inputs, those of an FMU
are relative to its binary (`build_fmus.xcp`). A tool takes those of another program from its symbols: each variable has
the name of its global variable and the offset in it.
"""

from __future__ import annotations

import math
import sys
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from build_fmus.base import escape
from build_fmus.component import Model

_BITS = {"double": 64, "single": 32}  # of a number
_MOST = {64: sys.float_info.max, 32: float(np.finfo(np.float32).max)}


@dataclass(frozen=True)
class Place:
    """Where something is: `offset` [bytes] in a global variable that has an address."""

    symbol: str
    address: int
    offset: int = 0

    def plus(self, n: int) -> Place:
        """The place `n` bytes further."""
        return Place(self.symbol, self.address, self.offset + n)


def example_program(name: str) -> str:
    """C code with the global variables whose addresses the file has."""
    return f'#include "{name}.h"\n{name} {name}_example;\n{name}_inputs {name}_example_inputs;\n'


def example_places(
    component: Model, addresses: Mapping[str, int], prepared: int, precision: str = "double"
) -> dict[str, Place]:
    """Places in the example program, as `a2l` takes them.

    Args:
        component: that the library was made from.
        addresses: of the global variables.
        prepared: offset of this field in an instance [bytes].
        precision: of the numbers.
    """
    instance, inputs = (Place(n, addresses[n]) for n in (f"{component.name}_example{e}" for e in ("", "_inputs")))
    results = _BITS[precision] // 8 * max(1, component.size("parameter"))  # the fields after the parameters
    return {
        "parameter": instance,
        "output": instance.plus(results),
        "input": inputs,
        "prepared": instance.plus(prepared),
    }


def a2l(component: Model, places: Mapping[str, Place], precision: str = "double", interface: str = "") -> str:
    """The text of the file.

    Tunable parameters are characteristics, inputs and outputs are measurements. So is `prepared` a characteristic: a
    tool writes 0 to it after other parameters, and the next step recalculates what follows from parameters only.

    Args:
        component: that has the variables.
        places: of the vectors of `parameter`, `input` and `output`, and of `prepared`.
        precision: of the numbers, "double" or "single".
        interface: how a tool connects (`IF_DATA`).
    """
    name, bits = component.name, _BITS[precision]
    parts = [
        "ASAP2_VERSION 1 71",
        f"/begin PROJECT {name} {escape.a2l(component.description)}",
        f'/begin MODULE {name} ""',
        f'/begin MOD_COMMON ""\n  BYTE_ORDER MSB_LAST\n  ALIGNMENT_FLOAT{bits}_IEEE {bits // 8}\n/end MOD_COMMON',
        *([interface] if interface else []),
        f"/begin RECORD_LAYOUT NUMBERS\n  FNC_VALUES 1 FLOAT{bits}_IEEE ROW_DIR DIRECT\n/end RECORD_LAYOUT",
        "/begin RECORD_LAYOUT FLAG\n  FNC_VALUES 1 SLONG ROW_DIR DIRECT\n/end RECORD_LAYOUT",
    ]
    roles = ("parameter", "input", "output")
    listed = [v for v in component.variables if v.role in roles and (v.role != "parameter" or v.tunable)]
    units = {u: f"UNIT_{k}" for k, u in enumerate(dict.fromkeys(v.unit or "" for v in listed))}
    for unit, method in units.items():
        text = escape.a2l(unit)
        parts.append(f'/begin COMPU_METHOD {method} {text} IDENTICAL "%.9" {text}\n/end COMPU_METHOD')
    flag = escape.c_identifier("prepared", [v.name for v in listed])
    parts.append(
        f'/begin CHARACTERISTIC {flag} "write 0 after a change of other characteristics"\n'
        f"  VALUE {_address(places['prepared'])} FLAG 0 NO_COMPU_METHOD 0 1\n"
        f"{_link(places['prepared'])}/end CHARACTERISTIC"
    )
    for v in listed:
        about, method = escape.a2l(v.description), units[v.unit or ""]
        place = places[v.role].plus(bits // 8 * v.slot)
        address, link = _address(place), _link(place)
        low, high = (_limit(x, s * _MOST[bits]) for x, s in ((v.min, -1), (v.max, 1)))
        size = f"  MATRIX_DIM {' '.join(str(n) for n in (*v.shape, 1, 1)[:3])}\n" if v.shape else ""
        if v.role == "parameter":
            kind = "VAL_BLK" if v.shape else "VALUE"
            head = f"CHARACTERISTIC {v.name} {about}\n  {kind} {address} NUMBERS 0 {method} {low} {high}\n"
            parts.append(f"/begin {head}{size}{link}/end CHARACTERISTIC")
        else:
            head = f"MEASUREMENT {v.name} {about}\n  FLOAT{bits}_IEEE {method} 0 0 {low} {high}\n"
            parts.append(f"/begin {head}{size}  ECU_ADDRESS {address}\n{link}/end MEASUREMENT")
    return "\n".join([*parts, "/end MODULE", "/end PROJECT", ""])


def _address(place: Place) -> str:
    return f"0x{place.address + place.offset:08X}"


def _link(place: Place) -> str:
    return f'  SYMBOL_LINK "{place.symbol}" {place.offset}\n'


def _limit(x: float | None, most: float) -> str:
    return repr(most if x is None or math.isinf(x) else float(x))
