"""An experiment whose cases also have parameters of the system, `component.variable`, that a sweep varies."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import make_dataclass, replace
from functools import lru_cache, partial
from typing import Any

from cosim.study.case import Case, fields, option
from cosim.study.experiment import Experiment, Study, Wiring
from cosim.study.loading import load

KINDS: dict[str, type] = {"real": float, "integer": int, "boolean": bool, "string": str}
Parameters = tuple[tuple[str, str], ...]
"""Names of parameters, `component.variable`, with the type of each, a key of KINDS."""


def attribute(number: int) -> str:
    """The field of a case that holds the parameter of this number."""
    return f"parameter_{number}"


def swept(experiment: Experiment, parameters: Parameters) -> Experiment:
    """The experiment with these parameters of its system among the fields of its cases.

    None leaves a parameter as the experiment sets it.
    """
    if not parameters:
        return replace(experiment, study=Study())
    more = [
        (attribute(i), KINDS[kind] | None, option(None, help=f"start value of {name}", name=name))
        for i, (name, kind) in enumerate(parameters)
    ]
    names = [name for name, _ in parameters]
    made = make_dataclass(
        "Point",
        more,
        bases=(_Point, experiment.case),
        frozen=True,
        namespace={"__module__": __name__, "base": experiment.case},
    )
    wiring = replace(
        experiment.wiring,
        wire=partial(_wire, experiment.wiring),
        structure=partial(_structure, experiment.wiring),
        configure=partial(_configure, experiment.wiring, tuple(names)),
    )
    return replace(experiment, case=made, wiring=wiring, study=Study())


class _Point(Case):
    """What is checked of these fields is checked by the FMU's description when they are set."""

    def __post_init__(self) -> None:
        own(self)


def own(point: Any) -> Any:
    """The case of the experiment itself, without the parameters."""
    case = type(point).base
    return case(**{f.attribute: getattr(point, f.attribute) for f in fields(case)})


def _wire(wiring: Wiring, fmus: Any, point: Any) -> Any:
    return wiring.wire(fmus, own(point))


def _structure(wiring: Wiring, point: Any) -> Any:
    return wiring.shared(own(point))


def _configure(wiring: Wiring, names: Sequence[str], system: Any, point: Any) -> None:
    if wiring.configure is not None:
        wiring.configure(system, own(point))
    set_parameters(system, {n: getattr(point, attribute(i)) for i, n in enumerate(names)})


def set_parameters(system: Any, given: Mapping[str, Any]) -> None:
    """Set parameters and start values by `component.variable`.

    Raises:
        WiringError: there is no such component or variable, or the value cannot be.
    """
    for name, value in given.items():
        component, _, variable = name.partition(".")
        if value is not None:
            system[component].set({variable: value})


@lru_cache(8)
def load_swept(place: str, parameters: Parameters) -> Experiment:
    """The experiment of a module or file, with these parameters."""
    return swept(load(place), parameters)
