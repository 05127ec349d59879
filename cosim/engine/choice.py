"""Which of the two executes a system, the compiled engine or the Python master, and why."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Literal, get_args

from build_fmus.base.checks import unknown
from cosim.core.errors import CosimError
from cosim.engine.compiled import CompiledExchange
from cosim.engine.exchange import Exchange
from cosim.engine.library import NoEngine, library
from cosim.system.components import SystemComponent

EngineChoice = Literal["auto", "compiled", "python"]


@dataclass(frozen=True)
class Engine:
    """What executes the instants of a system, in words too."""

    exchange: type[Exchange]
    text: str


def choose_engine(components: Iterable[SystemComponent], choice: EngineChoice = "auto") -> Engine:
    """Choose the engine that executes a system of these components.

    Raises CosimError for an unknown choice, and when "compiled" is not possible.
    """
    if choice not in get_args(EngineChoice):
        known = get_args(EngineChoice)
        raise CosimError(unknown("engine", choice, known))
    if choice == "python":
        return Engine(Exchange, "the Python master, as requested")
    components = list(components)
    back = [m.name for m in components if _called_back(m)]
    if choice == "auto" and len(back) == len(components):
        return Engine(
            Exchange, "the Python master: all components are written in Python or have clocks, which only it drives"
        )
    try:
        library()
    except NoEngine as error:
        if choice == "compiled":
            raise CosimError(f"there is no compiled engine here: {error}") from None
        return Engine(Exchange, f"the Python master: {error}")
    called = f", which calls back {', '.join(back)}" if back else ""
    return Engine(
        CompiledExchange, f"the compiled engine{called}; stop conditions that are functions take the Python master"
    )


def _called_back(component: SystemComponent) -> bool:
    """Whether its steps are Python's: a component in Python, or an FMU whose clocks are driven there."""
    about = component.description
    return not (about.fmi_version or about.native) or getattr(component.implementation, "in_event_mode", False)
