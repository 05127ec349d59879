"""Where the components of a system are in a picture: in columns along the signals, from left to right.

x points to the right and y down. Components of one column are ordered by where their neighbors are, so that few lines
cross.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import pairwise

from cosim.system.components import Connection, SystemComponent
from cosim.system.schedule import Schedule

WIDTH, HEIGHT = 190.0, 74.0  # of a box, at least
BETWEEN_ROWS = 46.0
LANE = 16.0  # between lines side by side
MARGIN = 24.0
PORT = 20.0  # between the ends of lines on one side of a box
LETTER = 6.7  # width of a letter of a label
_SWEEPS = 8


@dataclass(frozen=True)
class Box:
    """A component's place: upper left corner and size."""

    x: float
    y: float
    width: float
    height: float

    @property
    def right(self) -> float:
        """Right edge, in x."""
        return self.x + self.width

    @property
    def bottom(self) -> float:
        """Lower edge, in y."""
        return self.y + self.height


@dataclass(frozen=True, eq=False)
class Bundle:
    """All connections from one component to another."""

    source: SystemComponent
    target: SystemComponent
    connections: tuple[Connection, ...]

    @property
    def label(self) -> str:
        """What it carries: names without what they have in common, and how many there are of each."""
        counts: dict[str, int] = {}
        first: dict[str, str] = {}
        for c in self.connections:
            name = c.output.name
            stem = name.partition(".")[0].partition("[")[0]
            counts[stem] = counts.get(stem, 0) + 1
            first.setdefault(stem, name)
        words = [first[s] if n == 1 else f"{s} ({n})" for s, n in counts.items()]
        if len(words) > 3:
            words = [*words[:2], f"{sum(list(counts.values())[2:])} more"]
        return ", ".join(words)


@dataclass(frozen=True)
class Line:
    """A bundle's way, corner by corner, and where its label begins."""

    bundle: Bundle
    points: tuple[tuple[float, float], ...]
    label_at: tuple[float, float]


@dataclass(frozen=True)
class Picture:
    """Boxes of the components, lines of the bundles, and the size of the whole."""

    boxes: dict[SystemComponent, Box]
    lines: tuple[Line, ...]
    width: float
    height: float


def bundles(schedule: Schedule) -> list[Bundle]:
    """Connections by source and target, in the order of the schedule."""
    found: dict[tuple[SystemComponent, SystemComponent], list[Connection]] = {}
    for c in schedule.connections:
        found.setdefault((c.source, c.target), []).append(c)
    place = {m: i for i, m in enumerate(schedule.components)}
    return [Bundle(*pair, tuple(found[pair])) for pair in sorted(found, key=lambda p: (place[p[0]], place[p[1]]))]


def arrange(schedule: Schedule) -> Picture:
    """Arrange the picture of a system.

    Lines between neighboring columns run in the channel between these; those that pass a column run above all boxes,
    and those that lead back below.
    """
    all_bundles = bundles(schedule)
    columns = _columns(schedule, all_bundles)
    column_of = {m: i for i, column in enumerate(columns) for m in column}
    leaving = {m: [b for b in all_bundles if b.source is m] for m in column_of}
    coming = {m: [b for b in all_bundles if b.target is m] for m in column_of}

    def way(b: Bundle) -> str:
        span = column_of[b.target] - column_of[b.source]
        return "beside" if span == 1 else "above" if span > 1 else "below"

    height = {m: max(HEIGHT, PORT * (1 + max(len(leaving[m]), len(coming[m])))) for m in column_of}
    width = {m: max(WIDTH, LETTER * 1.15 * max(len(m.name), len(m.description.name)) + 24) for m in column_of}
    above = [b for b in all_bundles if way(b) == "above"]
    below = [b for b in all_bundles if way(b) == "below"]
    tallest = max(sum(height[m] + BETWEEN_ROWS for m in column) - BETWEEN_ROWS for column in columns)
    top = MARGIN + LANE * len(above) + (LANE if above else 0.0)
    channels = _channels(columns, column_of, all_bundles)
    boxes: dict[SystemComponent, Box] = {}
    x = MARGIN + channels[0]
    for i, column in enumerate(columns):
        wide = max(width[m] for m in column)
        y = top + (tallest - sum(height[m] + BETWEEN_ROWS for m in column) + BETWEEN_ROWS) / 2
        for m in column:
            boxes[m] = Box(x, y, wide, height[m])
            y += height[m] + BETWEEN_ROWS
        x += wide + channels[i + 1]
    bottom = top + tallest
    lines = _lines(all_bundles, boxes, column_of, leaving, coming, way, top, bottom)
    return Picture(boxes, tuple(lines), x + MARGIN, bottom + MARGIN + LANE * (len(below) + (1 if below else 0)))


def _columns(schedule: Schedule, all_bundles: Sequence[Bundle]) -> list[list[SystemComponent]]:
    """Components by column: behind all that they take values from, apart from what leads back."""
    order = {m: i for i, m in enumerate(_flow(schedule, all_bundles))}
    forward = [b for b in all_bundles if order[b.source] < order[b.target]]
    column: dict[SystemComponent, int] = {}
    for m in order:
        column[m] = max((column[b.source] + 1 for b in forward if b.target is m), default=0)
    for m in reversed(list(order)):  # sources stand next to what they feed
        nearest = min((column[b.target] for b in forward if b.source is m), default=None)
        if nearest is not None:
            column[m] = max(column[m], nearest - 1)
    found: list[list[SystemComponent]] = [[] for _ in range(max(column.values()) + 1)]
    for m in order:
        found[column[m]].append(m)
    used = [c for c in found if c]
    for _ in range(_SWEEPS):
        for columns in (used, used[::-1]):
            for fixed, moved in pairwise(columns):
                place = {m: (i + 0.5) / len(fixed) for i, m in enumerate(fixed)}
                moved.sort(key=lambda m: _middle(m, place, all_bundles))
    return used


def _flow(schedule: Schedule, all_bundles: Sequence[Bundle]) -> list[SystemComponent]:
    """Components in the direction of the signals.

    A discrete one comes after those that are executed before it; a continuous one after the discrete ones that feed it,
    and after continuous ones that feed it more than it feeds them.
    """
    weight = {(b.source, b.target): len(b.connections) for b in all_bundles}
    continuous = sorted(
        schedule.continuous,
        key=lambda m: sum(
            weight.get((other, m), 0) - weight.get((m, other), 0) for other in schedule.continuous if other is not m
        ),
    )
    fed = {b.target for b in all_bundles if b.source in continuous and b.target.discrete}
    sources = {b.source for b in all_bundles}
    last = [m for m in schedule.discrete if m in fed and m not in sources]
    return [*(m for m in schedule.discrete if m not in last), *continuous, *last]


def _middle(m: SystemComponent, place: dict[SystemComponent, float], all_bundles: Sequence[Bundle]) -> float:
    """Mean place of a component's neighbors in the column beside it."""
    near = [
        place[o] for b in all_bundles for s, o in ((b.source, b.target), (b.target, b.source)) if s is m and o in place
    ]
    return sum(near) / len(near) if near else 0.5


def _channels(
    columns: Sequence[Sequence[SystemComponent]], column_of: dict[SystemComponent, int], all_bundles: Sequence[Bundle]
) -> list[float]:
    """Widths of the channels left of each column, and right of the last one.

    A channel has space for a line per bundle and for the longest label.
    """
    lanes = [0] * (len(columns) + 1)
    letters = [0] * (len(columns) + 1)
    for b in all_bundles:
        out, into = column_of[b.source] + 1, column_of[b.target]
        lanes[out] += 1
        if into != out:
            lanes[into] += 1
        letters[out] = max(letters[out], len(b.label))
    return [(40.0 if n else 0.0) + LANE * n + LETTER * k for n, k in zip(lanes, letters, strict=True)]


def _lines(
    all_bundles: Sequence[Bundle],
    boxes: dict[SystemComponent, Box],
    column_of: dict[SystemComponent, int],
    leaving: dict[SystemComponent, list[Bundle]],
    coming: dict[SystemComponent, list[Bundle]],
    way: Callable[[Bundle], str],
    top: float,
    bottom: float,
) -> list[Line]:
    """The way of each bundle: out at the right of its source, in at the left of its target."""
    out_at: dict[Bundle, float] = {}
    in_at: dict[Bundle, float] = {}
    for m, box in boxes.items():
        for ends, at, other in ((leaving[m], out_at, "target"), (coming[m], in_at, "source")):
            height = {b: _wanted(way(b), boxes[getattr(b, other)]) for b in ends}
            for i, b in enumerate(sorted(ends, key=height.__getitem__), start=1):
                at[b] = box.y + box.height * i / (len(ends) + 1)
    used_out: dict[int, int] = {}
    used_in: dict[int, int] = {}
    n_above = n_below = 0
    found = []
    by_height = sorted(
        all_bundles, key=lambda b: (out_at[b] < in_at[b], out_at[b] if out_at[b] >= in_at[b] else -out_at[b])
    )
    for b in by_height:
        out, into = column_of[b.source] + 1, column_of[b.target]
        right = max(boxes[m].right for m in boxes if column_of[m] == out - 1)
        left = min(boxes[m].x for m in boxes if column_of[m] == into)
        (y1, y2), (x1, x2) = (out_at[b], in_at[b]), (boxes[b.source].right, boxes[b.target].x)
        label_at = (x1 + 6, y1 - 7)
        text = LETTER * max((len(o.label) for o in all_bundles if column_of[o.source] + 1 == out), default=0)
        used_out[out] = used_out.get(out, 0) + 1
        first = right + 14 + text + LANE * (used_out[out] - 1)
        if way(b) == "beside":
            points = [(x1, y1), (first, y1), (first, y2), (x2, y2)] if abs(y1 - y2) > 0.5 else [(x1, y1), (x2, y2)]
        else:
            if way(b) == "above":
                n_above += 1
                lane = top - LANE * n_above
            else:
                n_below += 1
                lane = bottom + LANE * n_below
            used_in[into] = used_in.get(into, 0) + 1
            second = left - 14 - LANE * (used_in[into] - 1)
            points = [(x1, y1), (first, y1), (first, lane), (second, lane), (second, y2), (x2, y2)]
        found.append(Line(b, tuple(points), label_at))
    return found


def _wanted(way: str, other: Box) -> float:
    """Where on the side of a box a line should be, by where it goes."""
    return {"above": -1.0, "below": 1e9}.get(way, other.y + other.height / 2)
