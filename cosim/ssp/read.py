"""A system of an SSP: its FMUs, flat, with their values, rates and connections."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from fractions import Fraction
from pathlib import Path
from typing import Any

from build_fmus.base import surface
from build_fmus.base.checks import did_you_mean, glob, one_line, unknown
from cosim.core.description import Variable
from cosim.core.errors import CosimError, SspError, WiringError
from cosim.core.time import TimeLike, positive
from cosim.fmu.component import FmuComponent
from cosim.fmu.model_exchange import ModelExchange
from cosim.ssp.integer_mapping import IntegerTable
from cosim.ssp.package import Package
from cosim.ssp.parameters import BoundValue, values_of
from cosim.ssp.signals import Change, Place, Signals, change, trace
from cosim.ssp.structure import Component, Structure, System
from cosim.ssp.structure_reader import read
from cosim.system.components import SystemComponent, indices
from cosim.system.names import elements
from cosim.system.wiring import Wiring

StepsLike = TimeLike | Mapping[str, TimeLike] | None


def read_ssp(
    wiring: Wiring, path: Path, scratch: Path, *, variant: str | None, step: StepsLike, strict: bool
) -> Structure:
    """Fill an empty wiring; see `System.from_ssp`. `scratch`: a folder for its files."""
    package = Package(path, scratch)
    structure = read(package, variant)
    return _Reader(wiring, structure, package, step, strict).structure


class _Reader:
    def __init__(self, wiring: Wiring, structure: Structure, package: Package, step: StepsLike, strict: bool):
        self.wiring, self.structure, self.title, self.strict = wiring, structure, package.title, strict
        self.room = package.folder.parent
        self.steps = {n: positive(s, f"step of '{n}'") for n, s in step.items()} if isinstance(step, Mapping) else {}
        self.other_step = None if step is None or isinstance(step, Mapping) else positive(step, "step")
        self.components = dict(structure.system.components())
        if not self.components:
            raise SspError(f"{self.title}: it contains no component")
        self.named = self.names()
        used: set[str] = set()
        for component_path, component in self.components.items():
            used |= self.add(component_path, component)
        missing = sorted(self.steps.keys() - used)
        if missing:
            raise SspError(f"{self.title}: {unknown('component', missing[0], self.wiring.components)}")
        signals = trace(structure.system, self.title)
        self.set_values(signals)
        self.connect(signals)
        self.group(structure.system, ())

    @contextmanager
    def named_in(self, what: str) -> Iterator[None]:
        """Around calls whose errors know neither the SSP nor where in it the error is."""
        try:
            yield
        except CosimError as error:
            text = str(error)
            if text.startswith(self.title):
                raise
            for folder in sorted(self.room.iterdir(), key=lambda f: -len(str(f))):
                text = text.replace(f"{folder}/", "")
            raise SspError(f"{self.title}: {what}: {text}") from None

    # Components.

    def names(self) -> dict[tuple[str, ...], str]:
        """Names of components, without blanks, * and ?: those of our own annotation, or those of the elements."""
        found: dict[tuple[str, ...], str] = {}
        for path, c in self.components.items():
            last = c.own.get("name") or c.name
            name = ".".join(re.sub(r"[\s*?]+", "_", part.strip()) for part in (*path[:-1], last)).strip(".")
            if name in found.values():
                raise SspError(f"{self.title}: two components would be '{name}'")
            found[path] = name
        return found

    def add(self, path: tuple[str, ...], c: Component) -> set[str]:
        """Add a component; returns the patterns of `step` that it fits."""
        name = self.named[path]
        with self.named_in(f"component '{'.'.join(path)}'"):
            fmu, kind = c.fmu, c.own.get("kind")
            about = self.wiring._component(fmu, self.strict, self.exchange(c) or c.interface)
            given = [p for p in self.steps if glob(p)(name)]
            own = c.own.get("step")
            sampled = about.description.sample_time if (kind or about.description.kind) == "discrete" else None
            choices = (
                self.steps[given[-1]] if given else None,
                None if own is None else positive(own, "its step"),
                c.hint,
                sampled,
                self.system_step(path),
                about.description.default_step,
                self.other_step,
            )
            chosen = next((s for s in choices if s is not None), None)
            if chosen is None:
                one = surface.hint(f"step={{'{name}': '1 ms'}}", f"--step '{name}=1 ms'")
                raise SspError(
                    f"{self.title}: neither this file nor the FMU declares the step of '{name}': give"
                    f" {surface.given(step='1 ms')} for all components without one, or {one}"
                )
            self.wiring.add(name, about, step=chosen, offset=c.own.get("offset", "0"), kind=kind)  # type: ignore[arg-type]
        return set(given)

    def exchange(self, c: Component) -> ModelExchange | None:
        """How a component is integrated, if our annotation says it."""
        given: dict[str, Any] = {k: c.own[k] for k in ("tolerance", "solver") if k in c.own}
        if c.interface != "me" or not given:
            return None
        with suppress(ValueError):  # what is no number is refused by name
            given["tolerance"] = float(given.get("tolerance", ""))
        return ModelExchange(**given)

    def system_step(self, path: tuple[str, ...]) -> Fraction | None:
        """What the innermost system around an element says."""
        system, found = self.structure.system, self.structure.system.step
        for part in path[:-1]:
            inner = system.elements[part]
            assert isinstance(inner, System)
            system, found = inner, inner.step or found
        return found

    def group(self, system: System, path: tuple[str, ...]) -> None:
        """Groups, of all systems in it too."""
        for name, method, components in system.groups:
            with self.named_in(f"group '{name}'"):
                prefix = ".".join("_".join(p.split()) for p in path)
                full = [f"{prefix}.{m}" if prefix else m for m in components]
                self.wiring.group(f"{prefix}.{name}" if prefix else name, full, method)  # type: ignore[arg-type]
        for e in system.elements.values():
            if isinstance(e, System):
                self.group(e, (*path, e.name))

    # Signals.

    def variables(self, path: tuple[str, ...], connector: str) -> list[Variable] | None:
        """What a connector of a component stands for, in its FMU: a variable, or all elements of an array."""
        about = self.component(path).description
        name = about.canonical(connector)
        if name not in about.variables and name not in about.arrays:
            return None
        return elements(self.component(path), name)

    def component(self, path: tuple[str, ...]) -> SystemComponent:
        return self.wiring.components[self.named[path]]

    def variable(self, place: Place) -> Variable:
        """The variable at a place of a component. Raises SspError when its FMU has none like it."""
        found = self.variables(place.path, place.connector)
        if found is None:
            about = self.component(place.path).description
            near = did_you_mean(place.connector, about.variables)
            raise SspError(
                f"{self.title}: component '{'.'.join(place.path)}': its FMU {about.name} has no variable"
                f" '{place.connector}'{near}"
            )
        if not place.indices and len(found) == 1:
            return found[0]
        for v in found:
            if indices(v.name) == place.indices:
                return v
        raise SspError(f"{self.title}: {place} is not in the FMU, which has {len(found)} element(s) of it")

    def connect(self, signals: Signals) -> None:
        """Every input of an FMU with the output that its value comes from."""
        tables: dict[tuple[str, Change], str] = {}
        for place in signals.leads:
            if place.path not in self.components or place.inside:
                continue
            source, steps = signals.way(place)
            if source.path not in self.components or source.inside:
                continue  # from outside of the whole system, or from nothing
            target, origin = self.variable(place), self.variable(source)
            first, last = origin.unit or steps[0].source.unit, target.unit or steps[-1].target.unit
            how = change(steps, first, last, origin.relative and target.relative, f"{self.title}: {source} to {place}")
            flags: dict[str, Any] = {k: any(getattr(s.connection, k) for s in steps) for k in ("delay", "extrapolate")}
            flags["max_size"] = next((s.connection.max_size for s in steps if s.connection.max_size is not None), None)
            start = f"{self.named[source.path]}.{origin.name}"
            end = f"{self.named[place.path]}.{target.name}"
            with self.named_in(f"line {steps[0].connection.line}"):
                if how is not None and how.table:
                    if target.causality == "parameter":
                        raise WiringError(
                            f"{start} -> {end}: a mapping of integers cannot set a parameter; set its value instead"
                        )
                    if origin.type != "integer" or target.type != "integer":
                        raise WiringError(
                            f"{start} -> {end}: integers are mapped, but it is {origin.fmi_type} to {target.fmi_type}"
                        )
                    start, how = self.table(start, source, how, tables), None
                linear = None if how is None else (how.factor, how.offset)
                self.wiring.connect(start, end, linear=linear, **flags)

    def table(self, start: str, source: Place, how: Change, tables: dict[tuple[str, Change], str]) -> str:
        """The output of a component that maps the integers of another one's."""
        if (start, how) not in tables:
            component = self.component(source.path)
            stem = "".join(ch if ch.isalnum() else "_" for ch in start)
            name = next(
                n
                for n in (f"{stem}_mapped", *(f"{stem}_mapped{k}" for k in range(2, 10_000)))
                if n not in self.wiring.components
            )
            self.wiring.add(
                name, IntegerTable(dict(how.table), component.step), step=component.step, offset=component.offset
            )
            self.wiring.connect(start, f"{name}.u")
            tables[start, how] = f"{name}.y"
        return tables[start, how]

    # Values.

    def set_values(self, signals: Signals) -> None:
        """What parameter sets of all levels say, the outermost last."""
        given = values_of(self.structure.system)
        for path, c in self.components.items():
            component = self.component(path)
            for name, value in self.applied(path, signals, given).items():
                with self.named_in(f"component '{'.'.join(path)}', parameter '{one_line(name, 80)}'"):
                    each = component.expand(name, value)
                    # initial values are for tools that step first
                    component.set({n: v for n, v in each.items() if n not in c.initial})

    def applied(self, path: tuple[str, ...], signals: Signals, given: Mapping[Place, BoundValue]) -> dict[str, Any]:
        """Values by the names of an FMU's variables.

        They are given for the FMU itself, or for the source of the values of its connectors.
        """
        component = self.component(path)
        fmu = component.implementation.fmu if isinstance(component.implementation, FmuComponent) else None
        found: dict[str, tuple[int, Any]] = {}
        for place, g in given.items():
            if place.path == path and (variables := self.variables(path, place.connector)):
                with self.named_in(f"component '{'.'.join(path)}', parameter '{one_line(place.connector, 80)}'"):
                    found[place.connector] = g.depth, g.for_(variables, fmu)
        for place in signals.leads:
            if place.path != path or place.indices:
                continue
            source, steps = signals.way(place)
            if (
                source not in given
                or source.path in self.components
                or (variables := self.variables(path, place.connector)) is None
            ):
                continue
            g = given[source]
            if place.connector in found and found[place.connector][0] <= g.depth:
                continue
            how = change(
                steps,
                g.value.unit or steps[0].source.unit,
                variables[0].unit,
                variables[0].relative,
                f"{self.title}: {source}",
            )
            with self.named_in(f"component '{'.'.join(path)}', parameter '{one_line(place.connector, 80)}'"):
                found[place.connector] = g.depth, g.along(how, variables, fmu, steps[0].source.unit)
        return {name: value for name, (_, value) in found.items()}
