"""Icons of FMUs, drawn and encoded here so that they are the same bytes everywhere."""

from __future__ import annotations

import struct
import zlib
from itertools import pairwise

import numpy as np

SIZE = 128
_BACKGROUND = {"continuous": (24, 78, 119), "discrete": (52, 99, 71)}


def icon_png(kind: str) -> bytes:
    """A PNG: a quarter car for continuous components, a sampled staircase for discrete ones."""
    y, x = (np.mgrid[0:SIZE, 0:SIZE] + 0.5) / SIZE
    image = np.zeros((SIZE, SIZE, 4))

    def paint(distance: np.ndarray, color: tuple[int, int, int]) -> None:
        """Blend `color` where the signed distance is negative, with one pixel of antialiasing."""
        cover = np.clip(0.5 - distance * SIZE, 0.0, 1.0)[..., None]
        image[..., :3] = image[..., :3] * (1 - cover) + np.array(color) * cover
        image[..., 3:] = np.maximum(image[..., 3:], 255 * cover)

    def box(x0: float, y0: float, x1: float, y1: float, r: float = 0.0) -> np.ndarray:
        dx = np.maximum(np.abs(x - (x0 + x1) / 2) - (x1 - x0) / 2 + r, 0)
        dy = np.maximum(np.abs(y - (y0 + y1) / 2) - (y1 - y0) / 2 + r, 0)
        return np.hypot(dx, dy) - max(r, 1e-9)

    def segment(x0: float, y0: float, x1: float, y1: float, width: float) -> np.ndarray:
        ax, ay = x1 - x0, y1 - y0
        t = np.clip(((x - x0) * ax + (y - y0) * ay) / (ax * ax + ay * ay), 0, 1)
        return np.hypot(x - x0 - t * ax, y - y0 - t * ay) - width / 2

    white, amber = (255, 255, 255), (246, 174, 45)
    paint(box(0.02, 0.02, 0.98, 0.98, 0.16), _BACKGROUND[kind])
    if kind == "continuous":
        paint(box(0.22, 0.14, 0.78, 0.34, 0.04), white)
        zigzag = [(0.5, 0.34), (0.5, 0.38), (0.42, 0.41), (0.58, 0.46), (0.42, 0.51), (0.5, 0.54), (0.5, 0.58)]
        for a, b in pairwise(zigzag):
            paint(segment(*a, *b, 0.035), amber)
        radius = np.hypot(x - 0.5, y - 0.71)
        paint(radius - 0.15, white)
        paint(radius - 0.07, _BACKGROUND[kind])
        paint(segment(0.14, 0.885, 0.86, 0.885, 0.03), amber)
    else:
        levels = [0.62, 0.40, 0.26, 0.36, 0.58]
        for i, level in enumerate(levels):
            left = 0.15 + 0.14 * i
            paint(segment(left, level, left + 0.14, level, 0.04), white)
            if i:
                paint(segment(left, levels[i - 1], left, level, 0.02), white)
            paint(np.hypot(x - left, y - level) - 0.035, amber)
        paint(segment(0.14, 0.8, 0.86, 0.8, 0.03), amber)
    raw = b"".join(b"\0" + row.tobytes() for row in np.round(image).astype(np.uint8))

    def chunk(tag: bytes, data: bytes) -> bytes:
        return struct.pack(">I", len(data)) + tag + data + struct.pack(">I", zlib.crc32(tag + data))

    header = struct.pack(">IIBBBBB", SIZE, SIZE, 8, 6, 0, 0, 0)
    return b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", header) + chunk(b"IDAT", zlib.compress(raw, 9)) + chunk(b"IEND", b"")
