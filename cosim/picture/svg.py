"""A system as SVG: a box for each component with its rate, a line for each bundle of signals.

The same system gives the same bytes.
"""

from __future__ import annotations

from collections.abc import Mapping
from fractions import Fraction
from itertools import pairwise

from lxml import etree

from build_fmus.base import escape
from cosim.core.time import seconds_text
from cosim.picture.layout import LANE, Box, Line, Picture, arrange
from cosim.system.components import SystemComponent
from cosim.system.schedule import Schedule

COLORS = {"discrete": ("#fff3d6", "#c98a00", "#8a5f00"), "continuous": ("#dfecfb", "#2a6fb0", "#1d5488")}
"""Kind of a component -> fill, edge and ink."""
_INK, _LINE = "#222", "#444"
_HEAD = 34.0  # space for the title


def draw(schedule: Schedule, title: str) -> bytes:
    """The picture of a system as UTF-8 SVG."""
    picture = arrange(schedule)
    head = _HEAD if title else 0.0
    width, height = round(picture.width), round(picture.height + head)
    root = sheet(width, height, title or "A system of components", {"tip": _LINE})
    if title:
        text(root, width / 2, 24, title, bold=True, size=14)
    body = etree.SubElement(root, "g", transform=f"translate(0 {_n(head)})")
    _lines(body, picture)
    for component, box in picture.boxes.items():
        _box(body, component, box)
    return serialize(root)


def sheet(width: int, height: int, title: str, tips: Mapping[str, str]) -> etree._Element:
    """A white sheet; `tips`: colors of the tips of arrows by their names."""
    size = {"width": str(width), "height": str(height)}
    root = etree.Element(
        "svg", nsmap={None: "http://www.w3.org/2000/svg"}, viewBox=f"0 0 {width} {height}", **size, role="img"
    )
    root.set("font-family", "Helvetica, Arial, sans-serif")
    root.set("font-size", "12")
    etree.SubElement(root, "title").text = escape.xml(title)
    definitions = etree.SubElement(root, "defs")
    for name, color in tips.items():
        tip = etree.SubElement(definitions, "marker", id=name, viewBox="0 0 10 10", refX="9", refY="5")
        for key, value in (("markerWidth", "7"), ("markerHeight", "7"), ("orient", "auto")):
            tip.set(key, value)
        etree.SubElement(tip, "path", d="M0 0 L10 5 L0 10 z", fill=color)
    etree.SubElement(root, "rect", **size, rx="10", fill="#ffffff")
    return root


def serialize(root: etree._Element) -> bytes:
    """A picture as UTF-8 SVG."""
    etree.indent(root)
    return bytes(etree.tostring(root, encoding="utf-8", xml_declaration=False)) + b"\n"


def _lines(body: etree._Element, picture: Picture) -> None:
    group = etree.SubElement(body, "g", stroke=_LINE, fill="none")
    group.set("stroke-width", "1.5")
    for line in picture.lines:
        path = etree.SubElement(group, "path", d=_path(line.points))
        path.set("marker-end", "url(#tip)")
        if any(c.delay for c in line.bundle.connections):
            path.set("stroke-dasharray", "6 4")
        tip = etree.SubElement(path, "title")
        tip.text = escape.xml("\n".join(map(str, line.bundle.connections)))
    for line in picture.lines:
        text(body, *line.label_at, _label(line), color=_LINE, anchor="start", halo=True)


def _label(line: Line) -> str:
    delayed = any(c.delay for c in line.bundle.connections)
    return line.bundle.label + (", delayed" if delayed else "")


def _path(points: tuple[tuple[float, float], ...]) -> str:
    parts = [f"M{_n(points[0][0])} {_n(points[0][1])}"]
    for (x0, y0), (x, y) in pairwise(points):
        parts.append(f"H{_n(x)}" if y == y0 else f"V{_n(y)}" if x == x0 else f"L{_n(x)} {_n(y)}")
    return " ".join(parts)


def _box(body: etree._Element, component: SystemComponent, box: Box) -> None:
    fill, stroke, ink = COLORS[component.kind]
    rect = etree.SubElement(
        body,
        "rect",
        x=_n(box.x),
        y=_n(box.y),
        width=_n(box.width),
        height=_n(box.height),
        rx="6",
        fill=fill,
        stroke=stroke,
    )
    rect.set("stroke-width", "2")
    middle, y = box.x + box.width / 2, box.y + box.height / 2 - LANE
    text(body, middle, y + 2, component.name, bold=True, size=14)
    text(body, middle, y + 20, component.description.name)
    offset = f", from {_duration(component.offset)}" if component.offset else ""
    text(body, middle, y + 38, f"{component.kind}, {_duration(component.step)}{offset}", color=ink)


def _duration(value: Fraction) -> str:
    """`0.5 ms`, `1/60 s`."""
    milliseconds = value * 1000
    short = value < 1 and 1000 % milliseconds.denominator == 0
    return f"{float(milliseconds):g} ms" if short else seconds_text(value)


def text(
    parent: etree._Element,
    x: float,
    y: float,
    words: str,
    *,
    color: str = _INK,
    anchor: str = "middle",
    bold: bool = False,
    size: int = 12,
    halo: bool = False,
) -> None:
    """Words at a point."""
    element = etree.SubElement(parent, "text", x=_n(x), y=_n(y), fill=color)
    element.set("text-anchor", anchor)
    element.set("font-size", str(size))
    if bold:
        element.set("font-weight", "bold")
    if halo:
        for name, value in (("paint-order", "stroke"), ("stroke", "#ffffff"), ("stroke-width", "4")):
            element.set(name, value)
    element.text = escape.xml(words)


def _n(x: float) -> str:
    return f"{x:.1f}".rstrip("0").rstrip(".")
