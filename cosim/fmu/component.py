"""One instance of an FMU as the master sees it, FMI 2.0 or 3.0."""

from __future__ import annotations

import logging
import math
import os
import warnings
import weakref
from collections import deque
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

import cosim.fmu.calls as fmi
from cosim.core.component import Array
from cosim.core.dependencies import Dependencies, by_derivatives, by_perturbation
from cosim.core.description import Variable
from cosim.core.errors import STATUS_NAMES, CallFailed, CosimError, FmuError, FmuWarning, IsolationCrashed
from cosim.fmu.bound_instance import BoundInstance
from cosim.fmu.clocked_steps import ClockedSteps, returns_early
from cosim.fmu.environment import restorer
from cosim.fmu.event_steps import EventSteps, steps_with_events
from cosim.fmu.file import Library
from cosim.fmu.instance import nothing_to_restore
from cosim.fmu.intermediate import IntermediateUpdates, followed
from cosim.fmu.isolation import IsolatedLibrary
from cosim.fmu.kinks import refuse_kinks
from cosim.fmu.model_exchange import Integration
from cosim.fmu.own_states import MORE_THAN_STATES, find_states
from cosim.fmu.saved_states import FmuState
from cosim.fmu.transfers import by_reference


class FmuComponent(BoundInstance):
    """One instance of an FMU, as a `Component`; in this process, or isolated in one of its own."""

    def clone(self) -> FmuComponent:
        """Another component of the same FMU, with an instance of its own."""
        made = FmuComponent(self.fmu, self.isolation, self.exchange)
        if self.structure:
            made.restructure(self.structure)
        return made

    def restructure(self, structure: Mapping[str, Any]) -> None:
        """Other values of structural parameters, by name, before it is instantiated: its arrays have other sizes.

        Raises FmuError for sizes that are too large.
        """
        self.description, self.structure = self.fmu.structured(structure), dict(structure)

    def instantiate(self, name: str) -> None:
        self._forget_messages()
        self._reads_values = False
        self._given.clear()
        self._kept.clear()
        for pool in (pools := (*self._earlier_pools, *self.state_pools)):
            pool.free_unused()
        self._earlier_pools = [p for p in pools if p.in_use]
        self.state_pools, self._own_pool = [], None
        reusable = self._instance is not None and not self._dead and self._library.reusable(self.isolation)
        self.clocked = ClockedSteps(self) if self.in_event_mode else None
        if reusable and self._call("Reset") <= fmi.WARNING:
            if self._event_steps is not None:
                self._event_steps.end()
            self._configure()
            return
        self.close()
        self._forget_messages()
        self.name = name
        self._dead = False
        self.foreign = self.description.kind is None and self.isolation is None
        self._restore = restorer() if self.foreign else nothing_to_restore
        library = self._open()
        self._keep = []
        resources = library.folder / "resources"
        log = _logger(name, self.messages, self.problems)
        texts = (name, self.description.token, f"{resources}{os.sep}" if self._v3 else resources.as_uri())
        divided = steps_with_events(self.description)
        how = {"event_mode": True, "early_return": returns_early(self.description)} if self.clocked else {}
        if divided:
            about = self.description
            how = {"event_mode": about.event_mode, "early_return": about.variable_step}
        follows = followed(self.description)
        self._intermediate = IntermediateUpdates(follows) if follows else None
        update = self._intermediate.callback if self._intermediate else None
        instance = library.instantiate(texts, log, self._keep, **how, intermediate=update)
        self._check_environment()
        if instance == self._ffi.NULL and divided and self.description.event_mode and not library.lost():
            self._forget_messages()
            instance, divided = library.instantiate(texts, log, self._keep, intermediate=update), False
            if instance != self._ffi.NULL:
                warnings.warn(
                    f"component '{name}': its FMU declares event mode (hasEventMode) and cannot be instantiated with"
                    " it; it runs without, and processes its events by itself",
                    FmuWarning,
                    stacklevel=2,
                )
        if instance == self._ffi.NULL:
            lost = library.lost()
            library.release()
            if lost:
                raise IsolationCrashed(name, f"fmi{self.fmu.major}Instantiate", lost, self._recent_log())
            failure_detail = library.failure_detail()
            said = [f"    {line}" for line in [*self._recent_log(), *([failure_detail] if failure_detail else [])]]
            if self.description.needs_tool:
                said.append("  it needs the tool that exported it (needsExecutionTool): is it installed?")
            colon = ":\n" if said else ""
            raise FmuError(f"{self.fmu.path}: cannot be instantiated as '{name}'{colon}" + "\n".join(said))
        self._library, self._instance, self._kept_from_start = library, instance, len(self._keep)
        self._finalizer = weakref.finalize(self, _free, library, self._v3, instance, self._keep)
        self.integration = Integration(self, self.exchange) if self.integrated else None
        self._event_steps = EventSteps(self, self._intermediate) if divided else None
        if self._intermediate is not None:
            self._intermediate.attach(self)
            self._keep.append(self._intermediate)
            self._kept_from_start = len(self._keep)
        self._configure()

    # States.

    def serialize(self) -> bytes:
        """The present state as bytes. Raises CosimError when the FMU does not offer it."""
        if not self.description.can_serialize:
            raise CosimError("its FMU cannot serialize its state")
        if self.clocked is not None:
            raise CosimError("it has clocks, whose next ticks are not part of the state that the FMU serializes")
        state = self.save()
        try:
            return self.pack_pointer(state.pointer)
        finally:
            self.forget(state)

    def identity(self) -> Mapping[str, str]:
        about = self.description
        return {
            "model": about.name,
            "FMI version": about.fmi_version,
            "token": about.token,
            **({"interface": "Model Exchange"} if self.integrated else {}),
            **({"structural parameters": str(self.structure)} if self.structure else {}),
            "content (SHA-256 of description and library)": self.fmu.digest,
        }

    def pack(self, state: FmuState) -> bytes:
        """A saved state as the FMU serializes it. Raises CosimError when it does not offer that."""
        return state.pack()

    def unpack(self, data: bytes) -> None:
        if not self.description.can_serialize:
            raise CosimError(f"'{self.name}' cannot restore serialized states (canSerializeFMUState)")
        self._unpack(data)

    def sampled_states(self) -> dict[str, float]:
        """States that a sampled FMU of this project keeps between samples, element by element.

        They are `state[1]`, ... in the order of the declaration. Raises CosimError for other FMUs, and for those with a
        quadratic program.
        """
        data = self.serialize()
        if self._layout is None:
            about = self.description
            outputs = list(about.outputs.values())

            def shown(other: bytes) -> list[float]:
                self.deserialize(other)
                return [float(v) for v in self.get(outputs)]

            try:
                self._layout = find_states(data, len(about.parameters), len(about.inputs), len(outputs), shown)
            except CallFailed:
                raise CosimError(MORE_THAN_STATES) from None
            finally:
                self.deserialize(data)
        return {f"state[{i}]": float(x) for i, x in enumerate(self._layout.read(data), start=1)}

    def set_sampled_states(self, x: Array) -> None:
        """Other values for all of `sampled_states`, in their order; call that first."""
        assert self._layout is not None
        self.deserialize(self._layout.write(self.serialize(), x))

    # Derivatives.

    def linearize(self, inputs: Sequence[Variable], outputs: Sequence[Variable]) -> tuple[Array, Array, Array, Array]:
        """(A, B, C, D) at the present state for the given inputs and outputs, by directional derivatives.

        By differences where an FMU of Model Exchange does not offer them, or where those of a third-party one do not
        agree with differences, of which an FmuWarning tells. States and derivatives are those of the model structure.
        Raises CosimError when the FMU offers neither.
        """
        states, derivatives = self.description.states, self.description.derivatives
        if not self.description.directional_derivatives:
            if self.integration is not None:
                return self.integration.linearize(inputs, outputs)
            remedy = ': add it with interface="me" for differences' if self.description.model_exchange else ""
            raise CosimError(f"its FMU offers no directional derivatives{remedy}")
        unknowns, knowns, n = [*derivatives, *outputs], [*states, *inputs], len(states)
        jacobian = np.array([[float(of is by) for by in knowns] for of in unknowns]).reshape(-1, len(knowns))
        asked = [i for i, of in enumerate(unknowns) if of not in states]  # FMUs differ in what they say of the others
        for column, known in enumerate(knowns):
            if asked:
                jacobian[asked, column] = self.derivative([unknowns[i] for i in asked], known)
        own = self.integration
        if own is not None and self.description.kind is None and not own.agrees(jacobian, inputs, outputs):
            warnings.warn(
                f"component '{self.name}': the directional derivatives of its FMU ({self.fmu.path.name}) do not agree"
                " with differences, by which it is linearized",
                FmuWarning,
                stacklevel=2,
            )
            return own.linearize(inputs, outputs)
        return jacobian[:n, :n], jacobian[:n, n:], jacobian[n:, :n], jacobian[n:, n:]

    def refuse_kinks(self, inputs: Sequence[Variable], outputs: Sequence[Variable], slopes: Array) -> None:
        """Raise CosimError if the present state lies on a kink or jump.

        `slopes`: the result of `linearize`, [[A, B], [C, D]]. States can be moved only in FMUs of this project.
        """
        about = self.description
        if slopes.size and about.kind is not None and about.can_serialize:
            refuse_kinks(self, slopes, [*about.derivatives, *outputs], about.states, inputs)

    def measure_dependencies(self, inputs: Sequence[Variable], outputs: Sequence[Variable]) -> Dependencies:
        """Inputs on which outputs depend directly at the present values during initialization.

        They are found by directional derivatives, or by changes that a saved state takes back. Raises CosimError when
        the FMU offers neither.
        """
        about = self.description
        if about.directional_derivatives and all(v.type == "real" for v in (*inputs, *outputs)):
            return by_derivatives(self.derivative, inputs, outputs)
        if not about.can_save or self.in_event_mode:
            raise CosimError("its FMU offers neither directional derivatives nor saved states")
        with self.kept():
            return by_perturbation(self, inputs, outputs)

    def derivative(self, unknowns: Sequence[Variable], known: Variable) -> list[float]:
        """Derivatives d unknowns / d known by the FMU's directional derivatives.

        Raises CosimError if one is not finite.
        """
        found = self.directional(unknowns, {known: 1.0})
        for variable, value in zip(unknowns, found, strict=True):
            if not math.isfinite(value):
                raise CosimError(f"its derivative of {variable.name} by {known.name} is {value}")
        return found

    def directional(self, unknowns: Sequence[Variable], seeds: Mapping[Variable, float]) -> list[float]:
        """Derivatives of unknowns along a change of variables, by one call; arrays are requested as a whole."""
        ffi, groups, knowns = self._ffi, by_reference(unknowns), by_reference(list(seeds))
        (begin, result), (at, seed) = (self._room(g) for g in (groups, knowns))
        for variable, value in seeds.items():
            seed[at[variable.reference] + variable.index] = value
        of, by = ffi.new("VR[]", list(groups)), ffi.new("VR[]", list(knowns))
        if self._v3:
            arguments: tuple[Any, ...] = (seed, len(seed), result, len(result))
        else:
            arguments = (seed, result)
        self._must("GetDirectionalDerivative", of, len(groups), by, len(knowns), *arguments)
        return [result[begin[v.reference] + v.index] for v in unknowns]

    def _room(self, groups: Mapping[int, Sequence[Variable]]) -> tuple[dict[int, int], Any]:
        """Where arrays begin, by value reference, and doubles for all of them."""
        ends = np.cumsum([0, *(elements[0].size for elements in groups.values())]).tolist()
        return dict(zip(groups, ends, strict=False)), self._ffi.new("double[]", ends[-1])


_LOG = logging.getLogger("cosim.fmu")
_LEVELS = (logging.DEBUG, logging.WARNING)  # of OK and Warning; what is worse is an error


def _logger(name: str, messages: deque[str], problems: deque[str]) -> fmi.Log:
    """What FMUs call to log. All categories are on: not every FMU files its errors under the category it declares.

    The logger `cosim.fmu` of Python gets all of it, with the component's name.
    """

    def log(status: int, category: str, message: str) -> None:
        level = STATUS_NAMES[status] if 0 <= status < len(STATUS_NAMES) else str(status)
        text = f"[{level}] {category + ': ' if category else ''}{message.rstrip()}"
        messages.append(text)
        _LOG.log(_LEVELS[status] if 0 <= status < len(_LEVELS) else logging.ERROR, "%s: %s", name, text)
        if status >= fmi.WARNING:
            problems.append(text)

    return log


def _free(library: Library | IsolatedLibrary, v3: bool, instance: Any, keep: list[Any]) -> None:
    (library.handle.fmi3FreeInstance if v3 else library.handle.fmi2FreeInstance)(instance)
    keep.clear()
    library.release()
