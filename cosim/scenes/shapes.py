"""Shapes of vehicles, from the positions of their wheels; only dimensions that a plant's parameters give are to scale.

Every function returns faces in the frame of the body: the origin is the center of gravity, x ahead, y left, z up [m].
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from cosim.scenes.scene import Face, Material

Point = tuple[float, float, float]
Contour = Sequence[tuple[float, float]]
"""(x, z) along the vehicle, x falling or rising all the way."""

_PROUD = 0.012  # m, how far a window or a lamp stands out from the sheet below it
_TIRE_ROOM = 0.04  # m, between a tire and the sheet beside it


@dataclass(frozen=True)
class Axle:
    """Where an axle is: x ahead of the CG, half of its track, radius and width of its tires [m]."""

    x: float
    half_track: float
    radius: float
    width: float

    @property
    def outside(self) -> float:
        """Half of the width of the vehicle that covers its tires [m]."""
        return self.half_track + self.width / 2 + _TIRE_ROOM


# ------------------------------------------------------------------------------------------------------------- vehicles


def off_road(axles: Sequence[Axle], cg_height: float) -> list[Face]:
    """A light four-by-four: upright windscreen, flat bonnet, slanted back, wheels at its corners."""
    front, rear = axles
    side, radius = max(a.outside for a in axles), max(a.radius for a in axles)
    inner = min(a.half_track - a.width / 2 for a in axles) - 0.06
    nose, tail = front.x + 0.52, rear.x - 0.76
    cowl, roof_front, roof_rear, deck = front.x - 0.96, front.x - 1.10, rear.x + 0.42, rear.x - 0.50
    sill, belt, top = 1.15 * radius, 2.66 * radius, 3.84 * radius
    hood = belt - 0.11
    arches = [_angular_arch(a.x, 2.26 * radius, sill, 0.80 * radius, 1.42 * radius) for a in (front, rear)]
    low: Contour = [(nose, sill + 0.10), *arches[0], *arches[1], (tail, sill + 0.12)]
    high: Contour = [(nose, hood), (cowl, belt), (tail, belt)]
    faces = [
        *_sides(low, high, side),
        *(_arch_liner(a, side) for arch in arches for a in _pairs(arch)),
        *_box((tail + 0.1, nose - 0.1), (-inner, inner), (0.92 * radius, belt - 0.2), "dark"),
        _across([(nose, hood), (cowl, belt)], side, "panel"),
        _across([(nose, hood), (nose, sill + 0.10)], side, "body"),
        _across([(cowl, belt), (tail, belt)], side, "panel"),
        _across([(tail, belt), (tail, sill + 0.12)], side, "body"),
    ]
    # cabin: sides lean in, glass stands proud of them
    wide, narrow = side - 0.09, side - 0.22
    cabin: Contour = [(cowl, belt), (roof_front, top), (roof_rear, top), (deck, belt)]
    lean = _leaning(belt, wide, top, narrow)
    faces += [Face([(x, s * lean(z), z) for x, z in cabin], "body") for s in (-1, 1)]
    faces += [
        _strip(a, lean(a[1]), b, lean(b[1]), "panel" if k == 1 else "body") for k, (a, b) in enumerate(_pairs(cabin))
    ]
    sash, head, pillar = belt + 0.07, top - 0.11, (roof_front + roof_rear) / 2
    at = _along((cowl, belt), (roof_front, top))
    back = _along((roof_rear, top), (deck, belt))
    panes = [
        [(at(sash) - 0.10, sash), (at(head) - 0.08, head), (pillar + 0.05, head), (pillar + 0.05, sash)],
        [(pillar - 0.05, sash), (pillar - 0.05, head), (roof_rear + 0.12, head), (roof_rear + 0.12, sash)],
    ]
    faces += [Face([(x, s * (lean(z) + _PROUD), z) for x, z in pane], "glass") for s in (-1, 1) for pane in panes]
    for a, b in ((0.04, narrow - 0.06), (-narrow + 0.06, -0.04)):
        faces.append(_upright(lambda z: at(z) + _PROUD, a, b, sash, head, "glass"))
    faces.append(_upright(lambda z: back(z) - _PROUD, 0.45, -0.45, sash + 0.12, head - 0.1, "glass"))
    # nose: slots of the grille, lamps; bumpers; doors as seams
    x = nose + _PROUD
    slot, step = 0.075, 0.125
    faces += [
        _upright(x, k * step - slot / 2, k * step + slot / 2, sill + 0.22, hood - 0.07, "dark") for k in range(-3, 4)
    ]
    faces += [_disc(x, s * (side - 0.26), (sill + hood) / 2 + 0.08, 0.105, "lamp") for s in (-1, 1)]
    faces += [
        _upright(tail - _PROUD, y, y + 0.12, belt - 0.32, belt - 0.14, "tail") for y in (side - 0.24, -side + 0.12)
    ]
    faces += _box((nose, nose + 0.10), (-side + 0.16, side - 0.16), (sill + 0.02, sill + 0.19), "dark")
    faces += _box((tail - 0.08, tail), (-side + 0.2, side - 0.2), (sill + 0.1, sill + 0.26), "dark")
    front_door, rear_door = cowl + 0.02, roof_rear + 0.04
    for s in (-1, 1):
        y, seams = s * (side + _PROUD), (front_door - 0.1, pillar, rear_door + 0.1)
        faces += [_beside(y, a - 0.011, a + 0.011, sill + 0.06, belt - 0.03, "dark") for a in seams]
        handles = (pillar + 0.06, rear_door + 0.16)
        faces += [_beside(y, a, a + 0.13, belt - 0.13, belt - 0.17, "dark") for a in handles]
    return _lowered(faces, cg_height)


def sedan(axles: Sequence[Axle], cg_height: float) -> list[Face]:
    """A saloon: three boxes, round arches."""
    front, rear = axles
    side, radius = max(a.outside for a in axles), max(a.radius for a in axles)
    inner = min(a.half_track - a.width / 2 for a in axles) - 0.05
    nose, tail = front.x + 0.86, rear.x - 0.98
    sill, belt, top = 0.62 * radius, 2.78 * radius, 4.5 * radius
    cowl, roof_front, roof_rear, boot = front.x - 0.42, front.x - 1.12, rear.x + 0.40, rear.x - 0.34
    hood, lid = belt - 0.13, belt + 0.05
    arches = [_round_arch(a.x, radius, 1.17 * radius, sill) for a in (front, rear)]
    low: Contour = [(nose, sill + 0.08), *arches[0], *arches[1], (tail, sill + 0.12)]
    high: Contour = [
        (nose, hood - 0.1),
        (nose - 0.16, hood),
        (cowl, belt),
        (boot, lid),
        (tail + 0.08, lid - 0.02),
        (tail, lid - 0.1),
    ]
    faces = [
        *_sides(low, high, side, "paint"),
        *(_arch_liner(a, side) for arch in arches for a in _pairs(arch)),
        *_box((tail + 0.3, nose - 0.3), (-inner, inner), (0.7 * radius, belt - 0.25), "dark"),
        *(_across([a, b], side, "bonnet") for a, b in _pairs(high)),
        _across([(nose, hood - 0.1), (nose, sill + 0.08)], side, "paint"),
        _across([(tail, lid - 0.1), (tail, sill + 0.12)], side, "paint"),
    ]
    wide, narrow = side - 0.05, side - 0.26
    cabin: Contour = [(cowl, belt), (roof_front, top), (roof_rear, top), (boot, lid)]
    lean = _leaning(belt, wide, top, narrow)
    faces += [Face([(x, s * lean(z), z) for x, z in cabin], "paint") for s in (-1, 1)]
    for k, (a, b) in enumerate(_pairs(cabin)):
        faces.append(_strip(a, lean(a[1]), b, lean(b[1]), "bonnet" if k == 1 else "paint"))
    sash, head = belt + 0.07, top - 0.07
    at, back = _along((cowl, belt), (roof_front, top)), _along((roof_rear, top), (boot, lid))
    pillar = (roof_front + roof_rear) / 2 - 0.12
    panes = [
        [(at(sash) - 0.14, sash), (at(head) - 0.08, head), (pillar + 0.035, head), (pillar + 0.035, sash)],
        [(pillar - 0.035, sash), (pillar - 0.035, head), (back(head) + 0.08, head), (back(sash) + 0.2, sash)],
    ]
    faces += [Face([(x, s * (lean(z) + _PROUD), z) for x, z in pane], "glass") for s in (-1, 1) for pane in panes]
    for slope, out, z1, z2 in ((at, _PROUD, belt + 0.05, top - 0.05), (back, -_PROUD, lid + 0.06, top - 0.06)):
        faces.append(
            Face(
                [(slope(z) + out, y * (lean(z) - 0.09), z) for z, y in ((z1, 1), (z1, -1), (z2, -1), (z2, 1))], "glass"
            )
        )
    faces += [
        _upright(nose + _PROUD, s * (side - 0.34) - 0.2, s * (side - 0.34) + 0.2, hood - 0.25, hood - 0.13, "lamp")
        for s in (-1, 1)
    ]
    faces.append(_upright(nose + _PROUD, -0.38, 0.38, sill + 0.14, hood - 0.28, "dark"))
    faces += [
        _upright(tail - _PROUD, s * (side - 0.27) - 0.2, s * (side - 0.27) + 0.2, lid - 0.26, lid - 0.13, "tail")
        for s in (-1, 1)
    ]
    for s in (-1, 1):
        y, seams = s * (side + _PROUD), (cowl - 0.05, pillar, rear.x + 0.62)
        faces += [_beside(y, a - 0.008, a + 0.008, sill + 0.06, belt - 0.02, "dark") for a in seams]
        handles = (pillar + 0.05, rear.x + 0.68)
        faces += [_beside(y, a, a + 0.16, belt - 0.11, belt - 0.14, "dark") for a in handles]
    return _lowered(faces, cg_height)


@dataclass(frozen=True)
class Outline:
    """Lower outline of a long vehicle, as in `ThreeAxleTrench` [m].

    Overhangs are beyond the outer axles, heights above the CG.
    """

    front_overhang: float = 1.2
    rear_overhang: float = 1.25
    tip_height: float = -0.3
    knee_distance: float = 0.6
    knee_height: float = -0.42
    belly_distance: float = 0.25
    belly_height: float = -0.64

    def lower(self, first: float, last: float) -> list[tuple[float, float]]:
        """From the front tip to the rear one; x of the outer axles."""
        return [
            (first + self.front_overhang, self.tip_height),
            (first + self.knee_distance, self.knee_height),
            (first + self.belly_distance, self.belly_height),
            (last - self.belly_distance, self.belly_height),
            (last - self.knee_distance, self.knee_height),
            (last - self.rear_overhang, self.tip_height),
        ]


def carrier(axles: Sequence[Axle], outline: Outline) -> list[Face]:
    """A wheeled carrier on three axles or more: the plant's belly, sloping bow, sponsons above the wheels."""
    first, last = axles[0].x, axles[-1].x
    side = max(a.half_track for a in axles) + 0.13
    inner = min(a.half_track - a.width / 2 for a in axles) - 0.09
    lower = outline.lower(first, last)
    front, rear = lower[0][0], lower[-1][0]
    shelf, roof = 0.34, 1.08  # above the CG: underside of the sponsons, roof
    bow, brow, glacis = (front - 0.04, 0.24), (first + 0.50, 0.52), (first - 0.28, roof)
    stern, top_rear = (rear, 0.40), (rear + 0.24, roof)
    faces = [
        *_sides(
            [*lower],
            [(front, outline.tip_height + 1e-4), bow, brow, (rear + 0.02, 0.52), (rear, outline.tip_height + 1e-4)],
            inner,
            "dark",
        )
    ]
    faces += [_across([a, b], inner, "dark") for a, b in _pairs(lower)]
    # bow plate, glacis, roof, stern; the sides of the sponsons lean in above the shelf
    wide, narrow = side, side - 0.30
    lean = _leaning(0.52, wide, roof, narrow)
    upper: Contour = [brow, glacis, top_rear, (rear, 0.52)]
    nose_low: Contour = [(front, outline.tip_height), bow]
    faces += [_strip(nose_low[0], inner, bow, inner + 0.18, "body"), _strip(bow, inner + 0.18, brow, wide, "body")]
    faces += [Face([(x, s * lean(z), z) for x, z in upper], "body") for s in (-1, 1)]
    materials: tuple[Material, ...] = ("panel", "panel", "body")
    faces += [_strip(a, lean(a[1]), b, lean(b[1]), m) for (a, b), m in zip(_pairs(upper), materials, strict=True)]
    skirt = [(first + 0.42, 0.52), (first + 0.30, shelf), (rear + 0.06, shelf), (rear, 0.52)]
    faces += [Face([(x, s * wide, z) for x, z in skirt], "body") for s in (-1, 1)]
    cheek = [(brow[0], wide, brow[1]), (first + 0.30, wide, shelf), (bow[0], inner + 0.18, bow[1])]
    under = [(first + 0.30, inner), (first + 0.30, wide), (rear + 0.06, wide), (rear + 0.06, inner)]
    faces += [*_both(cheek, "body"), *_both([(x, y, shelf) for x, y in under], "dark")]
    faces += [_strip(stern, inner, (rear, 0.52), inner, "body"), _strip(lower[-1], inner, stern, inner, "body")]
    end, below = rear + 0.06, shelf
    faces += _both([(rear, inner, 0.52), (rear, wide, 0.52), (end, wide, below), (end, inner, below)], "dark")
    # vision blocks, hatch, lamps
    faces += [_mounted(_along(brow, glacis), y, y + 0.5, 0.74, 0.94, "glass") for y in (-0.62, 0.12)]
    for s in (-1, 1):
        for x in (glacis[0] - 0.55, glacis[0] - 1.75, glacis[0] - 2.95):
            block = [(x, 0.76), (x - 0.42, 0.76), (x - 0.42, 0.92), (x, 0.92)]
            faces.append(Face([(q, s * (lean(z) + _PROUD), z) for q, z in block], "glass"))
    faces += _box((first - 1.55, first - 0.85), (-0.36, 0.36), (roof, roof + 0.10), "body")
    faces += [_mounted(_along(bow, brow), y, y + 0.2, 0.30, 0.42, "lamp") for y in (-0.82, 0.62)]
    faces += [_upright(rear - _PROUD, y, y + 0.14, 0.06, 0.20, "tail") for y in (inner - 0.22, -inner + 0.08)]
    faces.append(_upright(rear - _PROUD, -0.42, 0.42, -0.12, 0.38, "panel"))
    return faces


# ------------------------------------------------------------------------------------------------------------ test rigs


def rig_mass(size: float) -> list[Face]:
    """The sprung mass of a quarter car, guided at both ends; `size` is the radius of the wheel.

    The origin is the middle of its underside.
    """
    return [
        *_box((-1.35 * size, 1.35 * size), (-0.8 * size, 0.8 * size), (0.0, 0.62 * size), "mass"),
        *_box((-0.95 * size, 0.95 * size), (-0.5 * size, 0.5 * size), (0.62 * size, 0.84 * size), "mass"),
        *(
            f
            for s in (-1, 1)
            for f in _box(
                (s * 1.485 * size - 0.135 * size, s * 1.485 * size + 0.135 * size),
                (-0.24 * size, 0.24 * size),
                (0.1 * size, 0.52 * size),
                "steel",
            )
        ),
    ]


def rig_frame(size: float, height: float) -> list[Face]:
    """Base, two columns and a beam, standing on the floor; `height` is that of the columns."""
    deep = 0.14 * size
    columns = [
        f
        for s in (-1, 1)
        for f in _box(
            (s * 1.72 * size - 0.1 * size, s * 1.72 * size + 0.1 * size), (-deep, deep), (0.0, height), "steel"
        )
    ]
    beam = _box((-2.0 * size, 2.0 * size), (-0.2 * size, 0.2 * size), (height, height + 0.22 * size), "steel")
    base = _box((-2.3 * size, 2.3 * size), (-1.0 * size, 1.0 * size), (-0.16 * size, 0.0), "dark")
    return [*columns, *beam, *base]


def rig_plate(size: float, stroke: float) -> list[Face]:
    """The shaker's plate with its piston, `stroke` above the base; the origin is on the plate, under the tire."""
    return [
        *_box((-1.05 * size, 1.05 * size), (-0.62 * size, 0.62 * size), (-0.14 * size, 0.0), "panel"),
        *_box((-0.2 * size, 0.2 * size), (-0.2 * size, 0.2 * size), (-stroke, -0.14 * size), "steel"),
    ]


# --------------------------------------------------------------------------------------------------------------- pieces


def _pairs(contour: Contour) -> list[tuple[tuple[float, float], tuple[float, float]]]:
    return list(pairwise(contour))


def _along(a: tuple[float, float], b: tuple[float, float]) -> Callable[[float], float]:
    """The function x(z) of the line from a to b."""
    return lambda z: a[0] + (b[0] - a[0]) * (z - a[1]) / (b[1] - a[1])


def _leaning(z1: float, y1: float, z2: float, y2: float) -> Callable[[float], float]:
    """The function y(z) of a sheet that leans inward."""
    return lambda z: y1 + (y2 - y1) * (z - z1) / (z2 - z1)


def _sides(low: Contour, high: Contour, y: float, material: Material = "body") -> list[Face]:
    """The sheets at both sides between a lower and an upper contour, upright at y and -y, in convex columns."""
    (lx, lz), (hx, hz) = (np.array(sorted(c)).T for c in (low, high))
    xs = np.unique(np.concatenate([lx, hx]))
    xs = xs[(xs >= max(lx[0], hx[0])) & (xs <= min(lx[-1], hx[-1]))]
    bottom, top = np.interp(xs, lx, lz), np.interp(xs, hx, hz)
    faces = []
    for i in range(len(xs) - 1):
        corners = [(xs[i], bottom[i]), (xs[i + 1], bottom[i + 1]), (xs[i + 1], top[i + 1]), (xs[i], top[i])]
        distinct = [c for k, c in enumerate(corners) if math.dist(c, corners[k - 1]) > 2e-3]
        if len(distinct) >= 3 and xs[i + 1] - xs[i] > 1e-6:
            faces += [Face([(float(x), s * y, float(z)) for x, z in distinct], material) for s in (-1, 1)]
    return faces


def _across(contour: Contour, y: float, material: Material) -> Face:
    """The sheet from the left side to the right one over a piece of a contour."""
    a, b = contour
    return _strip(a, y, b, y, material)


def _strip(a: tuple[float, float], ya: float, b: tuple[float, float], yb: float, material: Material) -> Face:
    """As `_across`, of different widths at its ends."""
    return Face([(a[0], ya, a[1]), (b[0], yb, b[1]), (b[0], -yb, b[1]), (a[0], -ya, a[1])], material)


def _angular_arch(x: float, top: float, sill: float, above: float, below: float) -> list[tuple[float, float]]:
    """From the front to the rear: an arch of three straight pieces over a wheel at x."""
    return [(x + below, sill), (x + above, top), (x - above, top), (x - below, sill)]


def _round_arch(x: float, center: float, radius: float, sill: float) -> list[tuple[float, float]]:
    """From the front to the rear: an arc about the wheel's center, down to the sill."""
    begin = math.asin((sill - center) / radius)
    angles = np.linspace(begin, math.pi - begin, 12)
    return [(x + radius * math.cos(a), center + radius * math.sin(a)) for a in angles.tolist()]


def _arch_liner(piece: tuple[tuple[float, float], tuple[float, float]], side: float) -> Face:
    """One sheet of the inside of both arches of an axle; parts between the wheels hide where it crosses the vehicle."""
    return _strip(piece[0], side, piece[1], side, "dark")


def _box(x: tuple[float, float], y: tuple[float, float], z: tuple[float, float], material: Material) -> list[Face]:
    """All six sides."""
    faces = []
    for axis in range(3):
        others = [(x, y, z)[k] for k in range(3) if k != axis]
        for at in (x, y, z)[axis]:
            ring = [[others[0][i], others[1][j]] for i, j in ((0, 0), (1, 0), (1, 1), (0, 1))]
            for point in ring:
                point.insert(axis, at)
            faces.append(Face([(p[0], p[1], p[2]) for p in ring], material))
    return faces


def _upright(
    x: float | Callable[[float], float], y1: float, y2: float, z1: float, z2: float, material: Material
) -> Face:
    """A rectangle that looks ahead or behind; `x` may depend on z."""
    at = x if callable(x) else lambda _: x
    return Face([(at(z), y, z) for y, z in ((y1, z1), (y2, z1), (y2, z2), (y1, z2))], material)


def _mounted(sheet: Callable[[float], float], y1: float, y2: float, z1: float, z2: float, material: Material) -> Face:
    """A rectangle that stands out from a sheet x(z), ahead and up."""
    flat = _upright(sheet, y1, y2, z1, z2, material)
    return Face([(x + _PROUD, y, z + _PROUD) for x, y, z in flat.points], material)


def _beside(y: float, x1: float, x2: float, z1: float, z2: float, material: Material) -> Face:
    """A rectangle that looks to a side."""
    return Face([(x1, y, z1), (x2, y, z1), (x2, y, z2), (x1, y, z2)], material)


def _both(points: Sequence[Point], material: Material) -> list[Face]:
    """A face of the left side, mirrored on the right side first."""
    return [Face([(x, s * y, z) for x, y, z in points], material) for s in (-1, 1)]


def _disc(x: float, y: float, z: float, radius: float, material: Material) -> Face:
    """A disc that looks ahead."""
    angles = np.linspace(0, 2 * math.pi, 12, endpoint=False).tolist()
    return Face([(x, y + radius * math.cos(a), z + radius * math.sin(a)) for a in angles], material)


def _lowered(faces: Iterable[Face], by: float) -> list[Face]:
    """The faces with heights above the CG instead of above the road."""
    return [Face([(x, y, z - by) for x, y, z in face.points], face.material) for face in faces]
