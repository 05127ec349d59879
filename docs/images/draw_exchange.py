"""Draw `exchange.svg`: who reads what, and of which time, as the master runs four components.

python docs/images/draw_exchange.py

Every output is the time that it is of, so what a component reads tells where its arrow begins: the picture shows a run,
not an intention.
"""

from __future__ import annotations

import sys
from dataclasses import dataclass
from fractions import Fraction
from itertools import pairwise
from pathlib import Path
from typing import Any

from lxml import etree

from cosim import PythonComponent, System
from cosim.picture.svg import COLORS as KINDS
from cosim.picture.svg import serialize, sheet, text

PERIODS = {"filter": 2, "law": 2, "actuator": 1, "car": 1}
"""Component -> its step [ms], from the top of the picture to its bottom."""
DISCRETE = ("filter", "law")
CHAIN = ("car", "filter", "law", "actuator", "car")  # each gives its output to the next one
END = 4  # ms that are shown
TITLES = {
    False: "As it is: continuous components side by side (Jacobi)",
    True: "Actuator and car in a group, one after the other (Gauss-Seidel)",
}


@dataclass(frozen=True)
class Read:
    """What a step began with: `reader` at `time` read the output that `source` had of `of` [ms]."""

    reader: str
    time: Fraction
    source: str
    of: Fraction


class _Logged(PythonComponent):
    inputs = ("u [s]",)
    outputs = ("y [s]",)

    def __init__(self, name: str, source: str, reads: list[Read]) -> None:
        super().__init__()
        self._note = lambda t, of: reads.append(Read(name, _ms(t), source, _ms(of)))

    def step(self, t: float, h: float, u: Any, y: Any) -> None:
        self._note(t, u[0])
        y[0] = t + h


class _Continuous(_Logged):
    """Its output at the end of a step does not depend on what its input is then."""

    feedthrough = {"y": ()}  # noqa: RUF012


class _Discrete(_Logged):
    kind = "discrete"

    def step(self, t: float, h: float, u: Any, y: Any) -> None:  # noqa: ARG002
        self._note(t, u[0])
        y[0] = t


def reads(*, group: bool) -> list[Read]:
    """All that is read until the end of the picture, in the order of the calls; `group`: actuator and car are one."""
    found: list[Read] = []
    with System() as system:
        for source, name in pairwise(CHAIN):
            kind = _Discrete if name in DISCRETE else _Continuous
            system.add(name, kind(name, source, found), step=f"{PERIODS[name]} ms")
        for source, name in pairwise(CHAIN):
            system.connect(f"{source}.y", f"{name}.u")
        if group:
            system.group("drive", ["actuator", "car"])
        system.run(f"{END + 1} ms", record=["car.y"])
    return [r for r in found if r.time < END or (r.time == END and r.reader in DISCRETE)]


def _ms(seconds: float) -> Fraction:
    return Fraction(round(1e6 * seconds), 1000)


# ------------------------------------------------------------------------------------------------------------ drawing

LEFT, RIGHT, ROW, HEAD, FOOT, BAR = 96, 24, 58, 66, 44, 14  # px
PER_MS = 150
COLORS = {"same": "#1d5488", "held": "#777777", "ahead": "#b8500c"}
WORDS = {
    "same": "of the same instant",
    "held": "held since an earlier sample",
    "ahead": "just reached by the one before it in the group",
}


def kind_of(read: Read) -> str:
    """Of which age what was read is: a key of `WORDS`."""
    return "same" if read.of == read.time else "held" if read.of < read.time else "ahead"


def draw(target: Path) -> None:
    """Both ways below each other, as SVG; the same bytes every time."""
    width, height = LEFT + END * PER_MS + RIGHT, HEAD + len(PERIODS) * ROW + FOOT
    root = sheet(width, 2 * height + 34, "Who reads what, and of which time", COLORS)
    for i, group in enumerate(TITLES):
        _panel(etree.SubElement(root, "g", transform=f"translate(0 {i * height})"), group)
    for i, (kind, words) in enumerate(WORDS.items()):
        x, y = 20 + (0, 165, 375)[i], 2 * height + 12
        line = etree.SubElement(root, "path", d=f"M{x} {y} h26", stroke=COLORS[kind])
        line.set("stroke-width", "2")
        line.set("marker-end", f"url(#{kind})")
        text(root, x + 34, y + 4, words, anchor="start", size=13)
    target.write_bytes(serialize(root))


def _panel(body: etree._Element, group: bool) -> None:
    text(body, 20, 30, TITLES[group], anchor="start", size=13, bold=True)
    bottom = HEAD + (len(PERIODS) - 1) * ROW + 30
    for ms in range(END + 1):
        etree.SubElement(body, "path", d=f"M{_x(ms)} {HEAD - 22} V{bottom}", stroke="#dddddd")
        text(body, _x(ms), bottom + 18, f"{ms} ms", size=13)
    for name, period in PERIODS.items():
        discrete = name in DISCRETE
        fill, edge, _ = KINDS["discrete" if discrete else "continuous"]
        text(body, 20, _y(name) + 5, name, anchor="start", size=13)
        if discrete:
            etree.SubElement(body, "path", d=f"M{_x(0)} {_y(name)} H{_x(END)}", stroke=edge).set(
                "stroke-dasharray", "3 4"
            )
        for ms in range(0, END + discrete, period):
            if discrete:
                etree.SubElement(
                    body, "circle", cx=str(_x(ms)), cy=str(_y(name)), r=str(BAR / 2), fill=fill, stroke=edge
                )
            else:
                bar = {"x": _x(ms) + 3, "y": _y(name) - BAR / 2, "width": period * PER_MS - 6, "height": BAR, "rx": 5}
                etree.SubElement(body, "rect", {k: str(v) for k, v in bar.items()}, fill=fill, stroke=edge)
    for read in reads(group=group):
        path = etree.SubElement(body, "path", d=_arrow(read), stroke=COLORS[kind_of(read)], fill="none")
        path.set("stroke-width", "1.8")
        path.set("marker-end", f"url(#{kind_of(read)})")
        etree.SubElement(
            path, "title"
        ).text = f"{read.reader} at {float(read.time):g} ms reads {read.source} of {float(read.of):g} ms"


def _arrow(read: Read) -> str:
    """From the source's row at the time that its output is of, to where the reader's step begins."""
    down = 1 if _y(read.reader) > _y(read.source) else -1
    begin, end = (
        (_x(float(read.of)), _y(read.source) + down * BAR / 2),
        (_x(float(read.time)), _y(read.reader) - down * BAR / 2),
    )
    beside = -9 if down < 0 else 5  # what goes up stands left of what goes down
    return f"M{begin[0] + beside} {begin[1]} L{end[0] + beside} {end[1]}"


def _x(ms: float) -> float:
    return LEFT + PER_MS * ms


def _y(name: str) -> float:
    return HEAD + ROW * list(PERIODS).index(name)


if __name__ == "__main__":
    draw(Path(sys.argv[1]) if len(sys.argv) > 1 else Path(__file__).with_name("exchange.svg"))
