"""Options that cases of several experiments have."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import replace
from types import SimpleNamespace
from typing import Any, Self

from cosim.experiments.steps import Stepped
from cosim.study import option
from cosim.study.case import fields

Only = tuple[Callable[[Any], bool], str]
"""Where an option means something; see `option`."""
Label = str | Callable[[Any], str]


class AtSpeed:
    """A case that is driven at a speed."""

    speed_kmh: float

    @property
    def speed(self) -> float:
        """Speed [m/s]."""
        return self.speed_kmh / 3.6


class Controlled(Stepped):
    """A case with a control law, or "passive"."""

    controller: str

    def passive(self) -> Self:
        """The same case without control; options that are for controlled cases only have their defaults.

        Conditions of options (`only`) read the other options as they are.
        """
        bare = SimpleNamespace(**{**vars(self), "controller": "passive"})
        unused = {f.attribute: f.default for f in fields(type(self)) if f.option.only and not f.option.only[0](bare)}
        return replace(self, **{**unused, "controller": "passive"})


def quantity(
    what: str,
    default: float | None,
    within: tuple[float, float],
    help: str,
    only: Only | None = None,
    label: Label = "",
    *,
    always: bool = False,
) -> Any:
    """A number, "preview error [ms]": name of the option and unit; labels of runs have its value and unit."""
    name, _, unit = what.removesuffix("]").partition(" [")
    label, name = label or "{:g}" + unit.replace("/", ""), name.replace(" ", "-")
    return option(default, name=name, unit=unit, within=within, help=help, only=only, label=label, always=always)


def milliseconds(seconds: float) -> str:
    """A time in the label of a run."""
    return f"{1e3 * seconds:g}ms"


def speed_option(
    default: float, within: tuple[float, float], help: str = "speed", *, label: str = "{:g}kmh", always: bool = True
) -> Any:
    """The speed of a case, its field `speed_kmh`."""
    return option(default, name="speed", unit="km/h", within=within, label=label, help=help, always=always)


def terrain_option(default: str, classes: Iterable[str], help: str, only: Only | None = None) -> Any:
    """Class of a random road."""
    return option(default, choices=tuple(classes), only=only, label="class-{}", help=f"class of {help} (ISO 8608)")


def tunable_option(only: Only) -> Any:
    """The MPC whose weights can be changed."""
    text = "the MPC whose weights are parameters, free to vary in sweeps and searches (controller.weight...)"
    return option(False, only=only, help=text)
