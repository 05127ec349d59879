"""Sources in single precision."""

from __future__ import annotations

import re

import numpy as np

from build_fmus.component import Model
from build_fmus.generate import ticks

_TOKEN = re.compile(
    r"/\*.*?\*/|//[^\n]*|\"(?:[^\"\\]|\\.)*\"|'(?:[^'\\]|\\.)*'"
    r"|(?P<number>(?<![\w.])(?:0[xX][\da-fA-F]+(?:\.[\da-fA-F]*)?[pP][-+]?\d+"
    r"|(?:\d+\.\d*|\.\d+)(?:[eE][-+]?\d+)?|\d+[eE][-+]?\d+)(?![\w.]))"
    r"|(?P<word>\b[A-Za-z_]\w*\b)",
    re.DOTALL,
)
_WORDS = {"double": "float", **{f"DBL_{n}": f"FLT_{n}" for n in ("MAX", "MIN", "EPSILON")}}
_LARGEST, _SMALLEST = float(np.finfo(np.float32).max), float(np.finfo(np.float32).tiny)
_FUNCTIONS = {
    1: "acos acosh asin asinh atan atanh cos cosh erf erfc exp expm1 log log1p sin sinh tan tanh",
    2: "atan2 fmod hypot pow remainder",
}
MATHEMATICS = (
    "\n/* Single precision from here: exact operations of the processor, and the functions above, rounded once. */\n"
    + "".join(f"#undef {n}\n" for n in ("ceil", "copysign", "fabs", "floor", "fmax", "fmin", "sqrt"))
    + """#define copysign(x, y) __builtin_copysignf(x, y)
#define fabs(x) __builtin_fabsf(x)
#define sqrt(x) __builtin_sqrtf(x)
#define floor(x) single_floor(x)
#define ceil(x) (-single_floor(-(x)))
#define fmax(x, y) single_fmax(x, y)
#define fmin(x, y) single_fmin(x, y)

/* A number of 2^23 and more is whole. */
static inline float single_floor(float x) {
    if (!(fabs(x) < 8388608.0f)) return x;
    const float whole = (float)(int32_t)x;
    return copysign(whole > x ? whole - 1.0f : whole, x);
}

static inline float single_fmax(float x, float y) {
    if (x > y) return x;
    if (x < y) return y;
    if (x == y) return signbit(x) ? y : x;
    return x == x ? x : y;
}

static inline float single_fmin(float x, float y) {
    if (x < y) return x;
    if (x > y) return y;
    if (x == y) return signbit(x) ? x : y;
    return x == x ? x : y;
}

"""
    + "".join(f"#undef {n}\n#define {n}(x) ((float)FMU_MATH({n})((double)(x)))\n" for n in _FUNCTIONS[1].split())
    + "".join(
        f"#undef {n}\n#define {n}(x, y) ((float)FMU_MATH({n})((double)(x), (double)(y)))\n"
        for n in _FUNCTIONS[2].split()
    )
)


def to_single(text: str) -> str:
    """C code in single precision: types, constants and limits of numbers."""

    def changed(token: re.Match[str]) -> str:
        if number := token["number"]:
            return _constant(float.fromhex(number) if number[:2] in ("0x", "0X") else float(number))
        return _WORDS.get(token[0], token[0])

    return _TOKEN.sub(changed, text)


def exact_time(component: Model) -> str:
    """C code by which the time of a sample follows from its number in whole numbers, so that it does not drift."""
    every = ticks(component)
    n, d = (f"{k}LL" for k in (every.numerator, every.denominator))
    number = f"(sample) * {n}"
    return f"#define TIME_OF(sample) ((double)({number} / {d}) + (double)({number} % {d}) / (double){d})\n"


def _constant(value: float) -> str:
    """A number as a constant of type float: the nearest; none becomes 0 or infinite, no whole number grows."""
    if value == 0.0:
        return "0.0f"
    near = np.float32(min(max(abs(value), _SMALLEST), _LARGEST))
    if value.is_integer() and float(near) > abs(value):
        near = np.nextafter(near, np.float32(0.0))
    return f"{near!s}f"
