"""A web page that runs systems: their module, the descriptions of their variables, its controls, scenes and charts.

The page is one file, which works without a server and without a network. Its numbers are those of the system's FMU,
since it is compiled from the same C sources.
"""

from __future__ import annotations

import base64
import gzip
import json
import math
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field
from fractions import Fraction
from importlib import metadata
from pathlib import Path
from typing import Any, Literal, get_args

from build_fmus import description_xml as base
from build_fmus.base import safe_files
from build_fmus.base.checks import did_you_mean, number
from cosim.core.description import Variable
from cosim.core.errors import CosimError, WiringError
from cosim.core.time import TimeLike, positive, seconds_text
from cosim.export.code import SystemCode, exported_schedule, start_values, template
from cosim.export.parts import Part
from cosim.export.variables import TYPES, Exported, choose
from cosim.export.web.module import Module, compile_module
from cosim.scenes.scene import Scene, Value, scene_data, scene_script, scene_style
from cosim.system.components import indices
from cosim.system.schedule import Schedule
from cosim.system.wiring import Wiring

_ASSETS = Path(__file__).parent / "assets"
_SCRIPTS = ("fmu.js", "plot.js", "drive.js", "variant.js", "page.js")  # in this order
_TYPES = {name: i for i, name in enumerate(TYPES.values())}
SHOWN_EVERY = Fraction(1, 200)  # s, or the nearest number of ticks above
_FMI = 3
_STEPS = 200  # of a slider from end to end
_MOST = 4  # systems side by side

Kind = Literal["number", "check", "choice"]
How = Literal["peak", "largest", "rms", "mean square"]
PACES = (0.1, 0.25, 0.5, 1.0, 2.0, 5.0)  # times the clock


@dataclass(frozen=True)
class Drive:
    """How a person holds a control with keys or a gamepad; the value returns to `rest` when it is released.

    A gamepad that is lost has released it. On the slider the value stays where it is put.

    Attributes:
        rate: of the value while a key is held, in SI units per second of simulated time.
        back: on its way to `rest`, and to where a gamepad has it; likewise.
        rest: in SI units.
        raised_by, lowered_by: keys that move it to the maximum or minimum while they are held: as browsers name them,
            letters in lower case.
        axis: number of an axis in the standard layout of gamepads, and 1 if right or down raises the value, or -1.
        button: number of a button there, which raises the value from `rest` to the maximum as far as it is pressed.
    """

    rate: float
    back: float
    rest: float = 0.0
    raised_by: Sequence[str] = ()
    lowered_by: Sequence[str] = ()
    axis: tuple[int, Literal[-1, 1]] | None = None
    button: int | None = None

    def __post_init__(self) -> None:
        for name in ("rate", "back"):
            number(f"drive: {name}", getattr(self, name), above=0)
        number("drive: rest", self.rest)

    @property
    def keys(self) -> tuple[str, ...]:
        """All keys."""
        return (*self.raised_by, *self.lowered_by)


@dataclass(frozen=True)
class Control:
    """One control of the page, for one variable or for several that mean the same.

    Attributes:
        label: for people.
        names: `component.variable` of inputs and parameters; systems that do not have them are passed over.
        minimum, maximum: of the slider, in SI units; by default those of the variable.
        choices: texts and values to choose from, instead of a slider.
        keys: keys (as browsers name them) that lower and raise it by a step.
        drive: keys and parts of a gamepad that move it while they are held.
        follows: variables that are set with it: each to the largest of these values.
    """

    label: str
    names: Sequence[str]
    minimum: float | None = None
    maximum: float | None = None
    choices: Mapping[str, float] = field(default_factory=dict)
    keys: tuple[str, str] | tuple[()] = ()
    drive: Drive | None = None
    text: str = ""
    follows: Mapping[str, Sequence[Value]] = field(default_factory=dict)


@dataclass(frozen=True)
class Measure:
    """A number of the whole run, in a table with a column for each system.

    Attributes:
        label: for people.
        names: outputs; of several the worst counts.
        how: the largest magnitude, the largest value, the root mean square, or the mean square.
        relative: shown in per cent of the first system's.
        unit: in which it is shown, `factor` times the output's.
        limit: in that unit; what is above it is marked, and fails a run that has a `Finish`.
    """

    label: str
    names: Sequence[str]
    how: How = "peak"
    unit: str = ""
    factor: float = 1.0
    limit: float | None = None
    decimals: int = 2
    relative: bool = False

    def __post_init__(self) -> None:
        if self.how not in get_args(How):
            raise CosimError(f"measure '{self.label}': {self.how!r} is not one of {', '.join(get_args(How))}")


@dataclass(frozen=True)
class Finish:
    """End of a run: it is over when `when` is no longer negative.

    The run has failed if that is not reached within `patience` [s]; without `when` it is over after `patience`.
    """

    when: Value | None
    patience: float


@dataclass(frozen=True)
class PageSystem:
    """One system of a page.

    `values` are set in it before it starts; systems of the same `group` run side by side, and the user chooses among
    the groups. `scene`: its picture.
    """

    title: str
    system: Wiring
    values: Mapping[str, float] = field(default_factory=dict)
    group: str = ""
    scene: Scene | None = None


@dataclass(frozen=True)
class WebPage:
    """Contents of the page around the systems.

    Attributes:
        title: heading.
        text: a sentence or two below it.
        controls: those shown at the top; all others follow, component by component.
        plots: outputs, and inputs that are driven, that the charts show first.
        measures: metrics of the whole run.
        finish: condition that ends a run; None: never.
        pace: initial real-time factor, one of `PACES`.
        group_label: name of the choice of groups, such as "course".
        interval: time between the samples that are measured [s]; a number of ticks of all systems.
    """

    title: str
    text: str = ""
    controls: Sequence[Control] = ()
    plots: Sequence[str] = ()
    measures: Sequence[Measure] = ()
    finish: Finish | None = None
    pace: float = 1.0
    group_label: str = ""
    interval: TimeLike | None = None


def export_web(path: str | Path, systems: Sequence[PageSystem], page: WebPage) -> Path:
    """Write the page.

    Raises:
        CosimError: no systems, more than four side by side, one with a component that is no FMU or has no sources, an
            interval that is no number of ticks.
        WiringError: a control, plot or value that names nothing.
        CompileError: no ziglang.
    """
    path = Path(path)
    if path.suffix != ".html":
        raise CosimError(f"{path}: name the page FILE.html")
    if page.pace not in PACES:
        raise CosimError(f"pace {page.pace:g}: choose from {', '.join(f'{p:g}' for p in PACES)}")
    data, module, codes = _gathered(systems, page)
    html = template("page.html").render(
        page=page,
        driven=[c.label for c in page.controls if c.drive],
        paces=PACES,
        style=f"{_asset('page.css')}\n{scene_style()}",
        script="\n".join([scene_script(), *(_asset(n) for n in _SCRIPTS)]),
        module=_packed(module.content),
        data=_packed(json.dumps(data, allow_nan=False, separators=(",", ":")).encode()),
        size=len(module.content),
        components=sorted({m.name for c in codes for m in c.schedule.components}),
        schedule="\n\n".join(_headed(s, c) for s, c in zip(systems, codes, strict=True)),
        licenses=_licenses(codes),
        version=metadata.version(base.TOOL),
    )
    with safe_files.named(path):
        return safe_files.write(path, html.encode())


def _asset(name: str) -> str:
    return (_ASSETS / name).read_text(encoding="utf-8")


def _packed(content: bytes) -> str:
    return base64.b64encode(gzip.compress(content, 9, mtime=0)).decode()


def _headed(shown: PageSystem, code: SystemCode) -> str:
    title = f"{shown.title}, {shown.group}" if shown.group else shown.title
    return f"{title}\n\n{code.schedule}"


def _licenses(codes: Sequence[SystemCode]) -> str:
    """Every license text of what the page holds, each once."""
    texts: dict[bytes, str] = {}
    for part in {p.name: p for code in codes for p in code.distinct}.values():
        for name, content in sorted(part.licenses().items()):
            texts.setdefault(content, name)
    return "\n\n".join(f"{name}\n\n{content.decode(errors='replace').strip()}" for content, name in texts.items())


# ------------------------------------------------------------------------------------------------ what the script reads


def _gathered(systems: Sequence[PageSystem], page: WebPage) -> tuple[dict[str, Any], Module, list[SystemCode]]:
    """What the page's script reads, the module, and the code of each system."""
    if not systems:
        raise CosimError("a page shows at least one system")
    groups = list(dict.fromkeys(s.group for s in systems))
    for group in groups:
        if (n := sum(s.group == group for s in systems)) > _MOST:
            raise CosimError(f"{n} systems side by side{f' in {group}' if group else ''}; a page shows up to {_MOST}")
    known: dict[tuple[str, str], Part] = {}
    codes = [_code(f"system{i}", s, known) for i, s in enumerate(systems)]
    interval = _interval(page, codes)
    alone = [_road_part(s.scene, c) for s, c in zip(systems, codes, strict=True) if s.scene and s.scene.grounds]
    module = compile_module(codes, alone)
    _check_names(systems, codes, page)
    data = {
        "interval": float(interval),
        "keep": max(1, math.floor(SHOWN_EVERY / interval)),
        "groups": groups,
        "plots": list(page.plots),
        "measures": [asdict(m) for m in page.measures],
        "finish": (
            page.finish and {"when": page.finish.when and _sum(page.finish.when), "patience": page.finish.patience}
        ),
        "systems": [
            {
                "title": s.title,
                "group": groups.index(s.group),
                "model": i,
                "values": {n: float(v) for n, v in s.values.items()},
                "variables": [_variable(e, k) for k, e in enumerate(c.variables, start=1)],
                "scene": scene_data(s.scene) if s.scene else None,
                "road": _road(s.scene, c, module),
                "ahead": _ahead(c.schedule),
            }
            for i, (s, c) in enumerate(zip(systems, codes, strict=True))
        ],
        "controls": [_control(control, codes) for control in page.controls],
    }
    return data, module, codes


def _code(name: str, shown: PageSystem, known: dict[tuple[str, str], Part]) -> SystemCode:
    schedule = exported_schedule(shown.system, page=True)
    outputs = [e.name for e in choose(schedule, (), None, ()) if e.causality == "output"]
    drawn = shown.scene.variables if shown.scene else ()
    elements = dict.fromkeys(
        n for n in (*drawn, *(n for a in _ahead(schedule).values() for n in a["names"])) if n not in outputs
    )
    there = {f"{m.name}.{v}" for m in schedule.components for v in m.description.outputs}
    return SystemCode(
        name, schedule, choose(schedule, None, [*outputs, *(n for n in elements if n in there)], "*"), _FMI, known
    )


def _ahead(schedule: Schedule) -> dict[str, dict[str, Any]]:
    """Predicted values of sampled controllers, by the signal that each continues.

    `planned.NAME[i]` continues an output of the controller, from this sample on; `predicted.NAME[i]` the signal that
    drives an input of it, from the next sample on.
    """
    sources = {c.target_name: c.source_name for c in schedule.connections}
    found: dict[str, dict[str, Any]] = {}
    for m in schedule.components:
        for array, elements in m.description.arrays.items():
            kind, _, name = array.partition(".")
            own = f"{m.name}.{name}"
            signal = {"planned": own if name in m.description.outputs else None, "predicted": sources.get(own)}.get(
                kind
            )
            if signal is not None:
                names = [f"{m.name}.{n}" for n in sorted(elements, key=indices)]
                found[signal] = {"names": names, "step": float(m.step), "first": 0 if kind == "planned" else 1}
    return found


def _interval(page: WebPage, codes: Sequence[SystemCode]) -> Fraction:
    """Of what is shown: a number of ticks of every system."""
    if page.interval is None:
        tick = max(c.schedule.tick for c in codes)
        interval = math.ceil(SHOWN_EVERY / tick) * tick
    else:
        interval = positive(page.interval, "interval")
    for c in codes:
        if (interval / c.schedule.tick).denominator != 1:
            raise CosimError(
                f"an interval of {seconds_text(interval)} is not a multiple of the system's tick of"
                f" {seconds_text(c.schedule.tick)}"
            )
    return interval


def _variable(e: Exported, reference: int) -> dict[str, Any]:
    v = e.variable
    low, high = (None if not math.isfinite(x) else x for x in e.variable.limits)
    return {
        "name": e.name,
        "role": e.causality,
        "type": _TYPES[e.type],
        "reference": reference,
        "unit": v.unit_name,
        "text": v.description,
        "min": low,
        "max": high,
        "start": None if e.start is None else float(e.start),
        "tunable": e.tunable,
        "display": _display(v),
    }


def _sum(value: Value) -> dict[str, Any]:
    return {"terms": dict(value.terms), "offset": value.offset}


def _display(v: Variable) -> dict[str, Any] | None:
    d = v.display
    return None if d is None else {"unit": d.name, "factor": d.factor, "offset": d.offset}


def _check_names(systems: Sequence[PageSystem], codes: Sequence[SystemCode], page: WebPage) -> None:
    """Everything named is there, in one system at least."""
    settable = {e.name for c in codes for e in c.variables if e.causality != "output"}
    fixed = {e.name for c in codes for e in c.variables if e.causality != "input" and not e.tunable}
    outputs = {e.name for c in codes for e in c.variables if e.causality == "output"}
    driven = {n for control in page.controls if control.drive for n in control.names}
    for control in page.controls:
        if not control.names:
            raise WiringError(f"the control '{control.label}' names no variable")
        for name in control.names if control.drive else ():
            if name in fixed & settable:
                raise WiringError(
                    f"the control '{control.label}' is driven, but {name} cannot change while the system runs; name"
                    " inputs and tunable parameters"
                )
        for name in (
            *control.names,
            *control.follows,
            *(n for sums in control.follows.values() for v in sums for n in v.terms),
        ):
            if name not in settable:
                raise WiringError(
                    f"the control '{control.label}' names '{name}', which is not an input or"
                    f" parameter{did_you_mean(name, settable)}"
                )
    keys = Counter(k for c in page.controls for k in (*c.keys, *(c.drive.keys if c.drive else ())))
    for key in (k for k, n in keys.items() if n > 1 and driven):
        raise WiringError(f"the key '{key}' moves several controls; give each its own keys")
    for what, name in [("be plotted", n) for n in page.plots if n not in driven] + [
        ("be measured", n) for m in page.measures for n in m.names
    ]:
        if name not in outputs:
            raise WiringError(f"'{name}' is not an output and cannot {what}{did_you_mean(name, outputs)}")
    for name in page.finish.when.terms if page.finish and page.finish.when else ():
        if name not in settable | outputs:
            raise WiringError(
                f"the end condition of the run names '{name}', which does not"
                f" exist{did_you_mean(name, settable | outputs)}"
            )
    for shown, code in zip(systems, codes, strict=True):
        own = {e.name for e in code.variables if e.causality != "output"}
        for name in shown.values:
            if name not in own:
                raise WiringError(f"{shown.title} has no input or parameter '{name}'{did_you_mean(name, own)}")


def _control(control: Control, codes: Sequence[SystemCode]) -> dict[str, Any]:
    e = next(e for c in codes for e in c.variables if e.name in control.names and e.causality != "output")
    d = e.variable.display
    factor, offset = (d.factor, d.offset) if d else (1.0, 0.0)
    low, high = (
        given if given is not None else limit if math.isfinite(limit) else None
        for given, limit in zip((control.minimum, control.maximum), e.variable.limits, strict=True)
    )
    shown = [None if x is None else float(f"{x * factor + offset:.9g}") for x in (low, high)]
    step: float | str = "any"
    whole = e.type == "Int32"
    if shown[0] is not None and shown[1] is not None:
        step = 1.0 if whole else float(f"{(shown[1] - shown[0]) / _STEPS:.2g}")
    elif control.keys or control.drive:
        raise WiringError(
            f"the control '{control.label}' {'is driven' if control.drive else 'has keys'}, but {e.name} has no limits"
            " to go between: give minimum and maximum"
        )
    kind: Kind = "choice" if control.choices else "check" if e.type == "Boolean" else "number"
    if control.drive and (kind != "number" or whole):
        raise WiringError(f"the control '{control.label}' is driven, but {e.name} is not a real number")
    if control.drive and not (low or 0.0) <= control.drive.rest <= (high or 0.0):
        raise WiringError(f"the control '{control.label}' rests at {control.drive.rest:g}, outside of its limits")
    return {
        "label": control.label,
        "text": control.text or e.variable.description,
        "names": list(control.names),
        "kind": kind,
        "unit": d.name if d else e.variable.unit_name,
        "factor": factor,
        "offset": offset,
        "min": shown[0],
        "max": shown[1],
        "step": step,
        "whole": whole,
        "follows": {n: [_sum(v) for v in sums] for n, sums in control.follows.items()},
        "keys": list(control.keys),
        "drive": control.drive and asdict(control.drive) | {"low": low, "high": high},
        "choices": [[text, value] for text, value in control.choices.items()],
    }


def _road_part(scene: Scene, code: SystemCode) -> Part:
    return next(p for m, p in code.parts.items() if m.name == scene.grounds[0].component)


def _road(scene: Scene | None, code: SystemCode, module: Module) -> dict[str, Any] | None:
    """How the page asks the road alone what lies ahead."""
    if scene is None or not scene.grounds:
        return None
    name = scene.grounds[0].component
    component = next(m for m in code.schedule.components if m.name == name)

    def own_variable(full: str) -> Variable:
        return component.description.find(full.removeprefix(f"{name}."), name)

    own = {
        f"{name}.{v.name}": v for v in component.description.parameters.values() if v.size == 1 and v.fmi_type in _TYPES
    }
    return {
        "model": module.model(code.parts[component]),
        "x": own_variable(scene.grounds[0].input).reference,
        "step": float(component.step),
        "sides": {g.side: {"reference": own_variable(g.output).reference, "ahead": g.ahead} for g in scene.grounds},
        "starts": [
            [_TYPES[v.fmi_type], v.reference, values] for v, values in start_values(component) if v.fmi_type in _TYPES
        ],
        "parameters": {n: {"type": _TYPES[v.fmi_type], "reference": v.reference} for n, v in own.items()},
    }
