"""An experiment of an SSP file: it runs its default experiment; its parameters and steps are options of the cases."""

from __future__ import annotations

from pathlib import Path
from typing import Any
from weakref import WeakKeyDictionary

from cosim import System
from cosim.core.errors import SspError
from cosim.study.case import case_of, option
from cosim.study.experiment import Experiment, Measures, RunOptions, Wiring
from cosim.study.fmus import FmuSet

SUFFIX = ".ssp"


def ssp_experiment(place: str, measure: Any) -> Experiment:
    """The experiment of an SSP file; `measure` as of any experiment.

    Raises:
        SspError: there is no such file.
    """
    path = Path(place)
    if not path.exists():
        raise SspError(f"no such SSP: {place}")

    def wired(
        file: str = option(place, files=SUFFIX, help="use another file", label=lambda f: Path(f).stem),
        variant: str = option("", help="choose the system description if the file has several"),
        step: str = option(
            "",
            help="set the step of components that do not declare one, '1 ms', or of named ones, 'NAME=1 ms, NAME=2 ms'",
            label=_label,
        ),
        parameters: str = option(
            "", name="set", help="set values, such as 'car.body.mass=1200, road.amplitude=0.05'", label=_label
        ),
        record: str = option(
            "",
            help="record these names and patterns, separated by commas (default: all outputs)",
            label=lambda _: "some",
        ),
        stop_time: float | None = option(None, unit="s", within=(1e-9, 1e9), help="override the stop time of the file"),
    ) -> None: ...

    return Experiment(
        name=path.stem.replace(" ", "_"),
        title=f"The system of {path.name}",
        case=case_of(wired),
        wiring=Wiring(_wire, _structure, _configure, takes_fmus=False),
        measures=Measures(measure),
        run=RunOptions(_stop_time, _record),
        module=place,
    )


def _wire(_: FmuSet, case: Any) -> System:
    steps = _pairs(case.step, "--step") if "=" in case.step else case.step.strip() or None
    system = System.from_ssp(case.file, variant=case.variant or None, step=steps)
    system.allow_unconnected = True  # the file says what is connected
    _own[system] = {n: dict(m.values) for n, m in system.components.items()}
    return system


_own: WeakKeyDictionary[System, dict[str, dict[str, Any]]] = WeakKeyDictionary()
"""Values of the file, of systems that are used for several cases."""


def _structure(case: Any) -> tuple[str, ...]:
    return case.file, case.variant, case.step


def _configure(system: System, case: Any) -> None:
    for name, values in _own[system].items():
        system[name].values = dict(values)
    for full, text in _pairs(case.parameters, "--set").items():
        component, variable = system.components.split(full)
        kind = (
            component.description.find(variable, component.name).type
            if variable not in component.description.arrays
            else "real"
        )
        component.set({variable: _value(text, kind, full)})


def _value(text: str, kind: str, name: str) -> Any:
    if kind == "string":
        return text
    if kind == "boolean":
        known = {"true": True, "false": False, "1": True, "0": False}
        if text.lower() not in known:
            raise SspError(f"{name} is {text!r}; give true or false")
        return known[text.lower()]
    try:
        numbers = [float(t) for t in text.split()]
    except ValueError:
        raise SspError(f"{name} is {text!r}, which is not a number") from None
    return numbers[0] if len(numbers) == 1 else numbers


def _pairs(text: str, option_name: str) -> dict[str, str]:
    """`a=1, b=2` by name."""
    found: dict[str, str] = {}
    for part in filter(None, (p.strip() for p in text.split(","))):
        name, equals, value = (p.strip() for p in part.partition("="))
        if not equals or not name or not value:
            raise SspError(f"{option_name}: {part!r} is not NAME=VALUE")
        found[name] = value
    return found


def _label(text: str) -> str:
    return "".join(c if c.isalnum() or c in ".=" else "_" for c in text.replace(" ", ""))


def _record(case: Any) -> Any:
    return [p.strip() for p in case.record.split(",") if p.strip()] or None


def _stop_time(system: System, case: Any) -> float:
    if case.stop_time is not None:
        return float(case.stop_time)
    if system.experiment[1] is not None:
        return float(system.experiment[1])
    ends = [m.description.default_stop for m in system.components.values() if m.description.default_stop]
    if not ends:
        raise SspError(f"neither {case.file} nor its FMUs declare a stop time: give --stop-time")
    return float(max(ends))
