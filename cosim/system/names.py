"""The components of a system by name, and its variables by `component.variable`.

The component's name ends at the first dot. If components of nested systems have dots in theirs,
`sub.component.variable`, it ends where there is a component of that name: no name continues another.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import Any, NoReturn

from build_fmus.base.checks import did_you_mean, glob
from cosim.core.description import RECORDABLE, Variable, split_index
from cosim.core.errors import WiringError
from cosim.system.components import SystemComponent, article, indices


class SystemComponents(dict[str, SystemComponent]):
    """Components by name. Looking up one that is not there raises WiringError with the nearest name."""

    def __missing__(self, name: str) -> NoReturn:
        raise WiringError(f"no component '{name}'{did_you_mean(name, self)}")

    def split(self, full: str) -> tuple[SystemComponent, str]:
        """Split `component.variable` into the component and the variable's own name.

        Raises WiringError for an unknown component.
        """
        component, variable = self.parts(full)
        if component == full:
            raise WiringError(f"'{full}': write component.variable")
        return self[component], self[component].description.canonical(variable)

    def parts(self, full: str) -> tuple[str, str]:
        """Split `component.variable` at the component's name if there is one, else at the first dot."""
        at = full.find(".")
        while at >= 0:
            if full[:at] in self:
                return full[:at], full[at + 1 :]
            at = full.find(".", at + 1)
        component, _, variable = full.partition(".")
        return component, variable

    def canonical(self, full: str) -> str:
        """`component.variable` with the variable's own name where that is an alias; other texts as they are."""
        name, variable = self.parts(full)
        component = self.get(name)
        return full if component is None else f"{name}.{component.description.canonical(variable)}"

    def select(self, patterns: str | Iterable[str] | None) -> list[tuple[SystemComponent, Variable]]:
        """Variables by full name or pattern (`*`, `?`).

        A pattern selects outputs; if it matches none, it selects inputs, then local variables. None: every output that
        is no array element. Text variables are left out.
        """
        if patterns is None:
            return [
                (m, v)
                for m in self.values()
                for v in m.description.outputs.values()
                if not split_index(v.name)[1] and v.type in RECORDABLE
            ]
        chosen: dict[str, tuple[SystemComponent, Variable]] = {}
        for pattern in [patterns] if isinstance(patterns, str) else patterns:
            chosen.update((f"{m.name}.{v.name}", (m, v)) for m, v in self._fitting(pattern))
        return list(chosen.values())

    def fitting(self, pattern: str, causality: str) -> list[tuple[SystemComponent, Variable]]:
        """Variables of a full name (all elements of an array), or those of one causality that fit a pattern."""
        if not set("*?") & set(pattern):
            component, name = self.split(pattern)
            return [(component, v) for v in elements(component, name)]
        fits = glob(pattern)
        variables = (
            (m, v) for m in self.values() for v in m.description.variables.values() if v.causality == causality
        )
        return [(m, v) for m, v in variables if fits_any(fits, m, v)]

    def _fitting(self, pattern: str) -> list[tuple[SystemComponent, Variable]]:
        if not set("*?") & set(pattern):
            component, name = self.split(pattern)
            found = [(component, v) for v in elements(component, name)]
            for _, variable in found:
                if variable.type not in RECORDABLE:
                    raise WiringError(f"'{pattern}' is {article(variable.fmi_type)} and cannot be recorded")
            return found
        fits = glob(pattern)
        for causality in ("output", "input", "local"):
            matching = [
                (m, v)
                for m in self.values()
                for v in m.description.variables.values()
                if v.causality == causality and v.type in RECORDABLE and fits_any(fits, m, v)
            ]
            if matching:
                return matching
        names = [f"{m.name}.{o}" for m in self.values() for o in m.description.outputs]
        raise WiringError(f"'{pattern}' fits no variable{did_you_mean(pattern.replace('*', ''), names)}")


def elements(component: SystemComponent, name: str) -> list[Variable]:
    """A variable, or all elements of an array."""
    about = component.description
    if name in about.variables or name not in about.arrays:
        return [about.find(name, component.name)]
    return [about.variables[n] for n in sorted(about.arrays[name], key=indices)]


def fits_any(fits: Callable[[str], Any], component: SystemComponent, variable: Variable) -> bool:
    """Whether the full name, or one with an alias, fits."""
    return any(fits(f"{component.name}.{n}") for n in component.description.names(variable))
