"""Random systems of small FMUs, drawn by hypothesis.

Drawn are rates, offsets, types, units, delays, groups, stops and cuts.
"""

from __future__ import annotations

from dataclasses import dataclass
from fractions import Fraction
from pathlib import Path
from typing import Any

import numpy as np
from foreign.followers import TYPED
from hypothesis import strategies as st

from cosim import PythonComponent, System

STEPS = [Fraction(1, 1000), Fraction(1, 500), Fraction(1, 60), Fraction(3, 700), Fraction(1, 7000), Fraction(7, 999)]


class Saw(PythonComponent):
    """A signal that no formula of the engine makes, with state."""

    inputs = ("u [rad]",)
    outputs = ("y [rad]",)
    feedthrough = {"y": ()}  # noqa: RUF012

    def begin(self) -> None:
        self.x = 0.3

    def start(self, u: Any, y: Any) -> None:  # noqa: ARG002
        y[0] = self.x

    def step(self, t: float, h: float, u: Any, y: Any) -> None:
        self.x = np.sin(37.0 * t + self.x) + 0.1 * u[0] * h
        y[0] = self.x


class SampledSaw(Saw):
    kind = "discrete"


@dataclass(frozen=True)
class Piece:
    what: str  # "2", "3": FMI version of a follower; "python"
    discrete: bool
    step: Fraction
    offset: Fraction
    rate: float

    @property
    def typed(self) -> bool:
        return self.what == "3"


@dataclass(frozen=True)
class Wire:
    source: int
    output: str
    target: int
    input: str
    delay: bool
    extrapolate: bool


pieces = st.builds(
    Piece,
    what=st.sampled_from(["2", "3", "3", "python"]),
    discrete=st.booleans(),
    step=st.sampled_from(STEPS),
    offset=st.sampled_from([Fraction(0), Fraction(0), Fraction(1, 250), Fraction(1, 90)]),
    rate=st.floats(0.1, 1000.0),
)


@st.composite
def systems(draw: st.DrawFn, *, python: bool = True) -> dict[str, Any]:
    """What a system is made of; `python`: also of components in Python, but never of these alone."""
    kinds = pieces if python else pieces.filter(lambda p: p.what != "python")
    made = draw(st.lists(kinds, min_size=1, max_size=5).filter(lambda all_: any(p.what != "python" for p in all_)))
    wires = []
    for target, piece in enumerate(made):
        if draw(st.booleans()) or not target:
            wires.append(draw_wire(draw, made, target, "u", ["y"]))
        if piece.what != "python" and draw(st.booleans()):
            wires.append(draw_wire(draw, made, target, "count_in", ["count"], what="23"))
            wires.append(draw_wire(draw, made, target, "on", ["off"], what="23"))
        if piece.typed and draw(st.booleans()):
            chosen = draw(st.sampled_from(TYPED))
            wires.append(draw_wire(draw, made, target, f"{chosen}_in", [f"{chosen}_out"], what="3"))
            wires.append(draw_wire(draw, made, target, f"w[{draw(st.integers(1, 3))}]", ["total[2]"], what="3"))
    continuous = [i for i, p in enumerate(made) if not p.discrete]
    return {
        "pieces": made,
        "wires": [w for w in wires if w],
        "group": draw(st.permutations(continuous))[: draw(st.integers(0, len(continuous)))],
        "interval": draw(st.sampled_from([None, Fraction(1, 1000), Fraction(1, 60)])),
        "cuts": sorted(draw(st.lists(st.floats(0.001, 0.119), max_size=3))),
        "saved_at": draw(st.sampled_from([None, 0, 1])),
        "stop": draw(st.sampled_from([None, (">=", 0.2), ("<", -0.1)])),
    }


def draw_wire(
    draw: st.DrawFn, made: list[Piece], target: int, name: str, outputs: list[str], what: str = "23python"
) -> Wire | None:
    sources = [i for i, p in enumerate(made) if p.what in what]
    if not sources:
        return None
    source = draw(st.sampled_from(sources))
    output = draw(st.sampled_from(outputs if made[source].typed else outputs[-1:]))
    both = not (made[source].discrete or made[target].discrete)
    real = name in ("u",) or name.startswith("w[")
    loops = source >= target and (
        (made[source].discrete and made[target].discrete)
        or (both and not real)  # what is not real feeds through in a follower
    )
    delay = loops or draw(st.booleans())
    return Wire(source, output, target, name, delay, extrapolate=both and real and not delay and draw(st.booleans()))


def wired(plan: dict[str, Any], follower: dict[int, Path]) -> System:
    system = System()
    for i, p in enumerate(plan["pieces"]):
        kind = "discrete" if p.discrete else "continuous"
        if p.what == "python":
            system.add(f"m{i}", SampledSaw() if p.discrete else Saw(), step=p.step, offset=p.offset)
        else:
            start = {"u": 10.0 + i, "count_in": i, "on": bool(i % 2)}
            if p.typed:
                start |= {f"{t}_in": (2**40 if "64" in t else 3) + i for t in TYPED} | {"w": [0.1, 0.2, 0.3 + i]}
            system.add(
                f"m{i}",
                follower[int(p.what)],
                step=p.step,
                offset=p.offset,
                kind=kind,
                parameters={"rate": p.rate},
                start=start,
            )
    for w in plan["wires"]:
        system.connect(f"m{w.source}.{w.output}", f"m{w.target}.{w.input}", delay=w.delay, extrapolate=w.extrapolate)
    if len(plan["group"]) > 1:
        system.group("group", [f"m{i}" for i in plan["group"]], "gauss-seidel")
    return system
