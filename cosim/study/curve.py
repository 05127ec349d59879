"""Curves and bars as text, as wide as the terminal."""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np
import numpy.typing as npt

HEIGHT = 10  # lines of a curve
_NARROWEST = 20  # columns that a curve needs beside its labels
_MOST = 2.0  # times the whole, up to which a bar grows; a longer one has an arrow at its end
_DOTS = np.array(((0x01, 0x08), (0x02, 0x10), (0x04, 0x20), (0x40, 0x80)))  # of a Braille character, by row and column


def drawn(title: str, time: npt.ArrayLike, values: npt.ArrayLike, width: int, *, plain: bool = False) -> str:
    """A curve over time with its lowest and highest value at the left, in `width` columns; every sample is within it.

    Each column of dots goes from the lowest to the highest sample in it, so a peak of one sample is seen. `plain`: of
    ASCII alone.

    Raises:
        ValueError: there are no samples, or none is finite.
    """
    t, y = np.asarray(time, dtype=float), np.asarray(values, dtype=float)
    kept = np.isfinite(y)
    if not kept.any():
        raise ValueError(f"{title} has no finite sample to draw")
    low, high = float(y[kept].min()), float(y[kept].max())
    labels = [f"{v:.4g}" for v in (high, low)]
    margin = max(map(len, labels)) + 2
    columns = max(_NARROWEST, width - margin)
    across, down = (1, 1) if plain else (2, 4)
    dots = np.zeros((HEIGHT * down, columns * across), dtype=bool)
    span, extent = float(t[-1] - t[0]) or 1.0, (high - low) or 1.0
    place = np.minimum((t - t[0]) / span * dots.shape[1], dots.shape[1] - 1).astype(int)
    row = np.rint((high - y[kept]) / extent * (dots.shape[0] - 1)).astype(int)
    place = place[kept]
    for column in np.unique(place):
        rows = row[place == column]
        dots[rows.min() : rows.max() + 1, column] = True
    lines = [title]
    for i in range(HEIGHT):
        label = labels[0] if i == 0 else labels[1] if i == HEIGHT - 1 else ""
        block = dots[i * down : (i + 1) * down]
        if plain:
            text = "".join("*" if dot else " " for dot in block[0])
        else:
            bits = np.einsum("rnc,rc->n", block.reshape(down, columns, across), _DOTS)
            text = "".join(chr(0x2800 + b) if b else " " for b in bits.tolist())
        lines.append(f"{label:>{margin - 2}} {'|' if plain else '│'}{text.rstrip()}")
    begin, end = f"{t[0]:.4g}", f"{t[-1]:.4g} s"
    lines.append(" " * (margin - 1) + begin + " " * max(1, columns - len(begin) - len(end) + 1) + end)
    return "\n".join(lines)


def bars(shares: Mapping[str, float], width: int, *, plain: bool = False) -> str:
    """Shares of a whole as bars, one line each with its name and per cent, in `width` columns; a mark shows the whole.

    Raises:
        ValueError: there are none, or one is negative or not finite.
    """
    if not shares or any(not math.isfinite(s) or s < 0 for s in shares.values()):
        raise ValueError("bars need shares that are finite and not negative")
    label = min(max(map(len, shares)), max(12, width // 2))
    room = max(_NARROWEST, width - label - 9)
    longest = min(_MOST, max(1.0, *shares.values()))
    whole = round(room / longest)
    full, mark, beyond = ("#", "|", ">") if plain else ("█", "│", "▶")
    lines = []
    for name, share in shares.items():
        columns = min(room, round(room * share / longest))
        line = list(full * columns + " " * (room - columns))
        if share > longest:
            line[-1] = beyond
        elif columns < whole:
            line[whole - 1] = mark
        short = name if len(name) <= label else f"{name[: label - 3]}..."
        lines.append(f"{short:<{label}} {''.join(line)} {100 * share:5.0f} %")
    return "\n".join(lines)
