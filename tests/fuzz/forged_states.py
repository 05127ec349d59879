"""States that somebody made: mistakes in the description and in what members remember, under right digests."""

from __future__ import annotations

import json
import random
from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np

ODD: list[Any] = [
    None,
    True,
    False,
    0,
    -1,
    1,
    2**31,
    2**53,
    2**63,
    2**200,
    -(2**70),
    0.5,
    -0.0,
    1e308,
    "",
    "x",
    "visible",
    "plant",
    "law",
    "1/3",
    "0",
    "-1",
    "1/0",
    "9" * 40,
    [],
    {},
    [[]],
    [1, 2, 3],
    {"a": 1},
    "discrete",
    "sampled",
    "../../etc",
    "a\nb",
]
DOUBLES = [0.0, -0.0, np.nan, np.inf, -np.inf, 1e308, -1e308, 5e-324, 1e9]


def places(value: Any, path: tuple[Any, ...] = ()) -> Iterator[tuple[Any, ...]]:
    """Where there is something in a JSON value."""
    if path:
        yield path
    if isinstance(value, dict | list):
        for key in value if isinstance(value, dict) else range(len(value)):
            yield from places(value[key], (*path, key))


def forged(about: dict[str, Any], pieces: Sequence[bytes], rng: random.Random) -> tuple[dict[str, Any], list[bytes]]:
    """Description and pieces of a state with one to three things in them that are not right."""
    about, changed = json.loads(json.dumps(about)), [bytearray(p) for p in pieces]
    for _ in range(rng.choice([1, 1, 1, 2, 3])):
        if rng.random() < 0.5:
            _change(about, rng)
        else:
            _damage(changed, pieces, rng)
    return about, [bytes(p) for p in changed]


def _change(about: dict[str, Any], rng: random.Random) -> None:
    *path, last = rng.choice(list(places(about)))
    inner: Any = about
    for key in path:
        inner = inner[key]
    how = rng.random()
    if how < 0.6:
        inner[last] = rng.choice(ODD)
    elif how < 0.75:
        del inner[last]
    elif isinstance(inner, list):
        inner.insert(rng.randrange(len(inner) + 1), rng.choice([*ODD, *inner]))
    else:
        inner[rng.choice(["other", "law", "plant", "tick"])] = rng.choice(ODD)


def _damage(pieces: list[bytearray], whole: Sequence[bytes], rng: random.Random) -> None:
    i = rng.choice([0, *range(len(pieces))])
    piece, how = pieces[i], rng.random()
    if how < 0.5 and piece:
        for _ in range(rng.choice([1, 1, 8])):
            piece[rng.randrange(len(piece))] = rng.randrange(256)
    elif how < 0.7 and i == 0 and len(piece) >= 8:
        k = rng.randrange(len(piece) // 8)
        piece[8 * k : 8 * k + 8] = np.array(rng.choice(DOUBLES)).tobytes()
    elif how < 0.8:
        del piece[rng.randrange(len(piece) + 1) :]
    elif how < 0.9:
        piece.extend(bytes(rng.choice([1, 8, 1000])))
    else:
        pieces[i] = bytearray(rng.choice(whole))
