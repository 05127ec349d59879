"""White Gaussian noise in plain double arithmetic.

The numbers are the same on every platform with the same mathematical library.

Uniform numbers come from the combined multiple recursive generator MRG32k3a (L'Ecuyer, Operations Research 47, 1999),
which was made for doubles: every product stays below 2^53, so nothing is rounded. Pairs of them become pairs of normal
ones (Box, Muller).
"""

from __future__ import annotations

import math
from typing import Any

import casadi as ca

from build_fmus.component import Component

_M1, _M2 = 4294967087.0, 4294944443.0
_A12, _A13 = 1403580.0, 810728.0
_A21, _A23 = 527612.0, 1370589.0
_PRIME = 67108859.0  # below 2^26: squares are exact
_ROUNDS = 16


def white_noise(c: Component, seed: Any, count: int) -> list[Any]:
    """`count` independent standard normal numbers, new ones at every sample of `c`; adds six hidden states.

    `seed`: whole number from 0 on (a parameter of the component); neighboring seeds give unrelated numbers.
    """
    start = _start(seed)
    states = [c.state(f"random.s{i}", "1", "memory of the noise", start=s, nominal=1e9) for i, s in enumerate(start)]
    first, second = states[:3], states[3:]
    normal: list[Any] = []
    for _ in range((count + 1) // 2):
        first, second, u = _draw(first, second)
        first, second, v = _draw(first, second)
        radius, angle = ca.sqrt(-2 * ca.log(u)), 2 * math.pi * v
        normal += [radius * ca.cos(angle), radius * ca.sin(angle)]
    for state, value in zip(states, first + second, strict=True):
        c.update(state, value)
    return normal[:count]


def _draw(first: list[Any], second: list[Any]) -> tuple[list[Any], list[Any], Any]:
    """Both recursions one step on, and a number within 0 and 1, neither of them."""
    p = _mod(_A12 * first[1] - _A13 * first[0], _M1)
    q = _mod(_A21 * second[2] - _A23 * second[0], _M2)
    u = (p - q + ca.if_else(p <= q, _M1, 0)) / (_M1 + 1)
    return [*first[1:], p], [*second[1:], q], u


def _mod(x: Any, m: float) -> Any:
    """`x` modulo `m`, exact for whole x of up to 2^53: the quotient may be off by one, which is corrected."""
    r = x - m * ca.floor(x / m)
    return r + ca.if_else(r < 0, m, ca.if_else(r >= m, -m, 0))


def _start(seed: Any) -> list[Any]:
    """Six start values of a seed, stirred by squaring, since both recursions are linear."""
    part, high = _mod(seed, _PRIME), ca.floor(seed / _PRIME)
    y, drawn = part, []
    for n in range(_ROUNDS + 12):
        y = _mod(y * y + (part + 15485863.0 * high + 12345.0 + 7919.0 * n), _PRIME)
        if n >= _ROUNDS:
            drawn.append(y)
    limit = _M2 - 1  # the smaller modulus serves for both
    return [1 + _mod(64 * a + _mod(b, 64.0), limit) for a, b in zip(drawn[::2], drawn[1::2], strict=True)]
