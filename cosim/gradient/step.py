"""Derivatives of one communication step of an FMU of this project, at a saved state.

    step = StepDerivatives("FullCarHmmwv")
    found = step(state, "1 ms")  # state: bytes of fmi3SerializeFMUState, of any importer
    found.jacobian[step.unknowns.index("body.z"), step.knowns.index("force.fl")]

They are those of the solver steps or samples that are computed, not of the differential equations, so they are exact
for coarse steps, sampled controllers and quadratic programs too. `step_derivatives.h` is the same for C.
"""

from __future__ import annotations

import os
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any

import cffi
import numpy as np

from build_fmus.base.archives import zipped
from build_fmus.compile import host
from cosim.batch.lane_source import LaneSource, NoLanes, lane_source
from cosim.batch.library import STEP_HEADER, step_library
from cosim.core.c_headers import declarations
from cosim.core.errors import CosimError
from cosim.core.signals import Array
from cosim.core.time import TimeLike, positive
from cosim.fmu.file import FmuFile
from cosim.fmu.find import find

FOLDER = "extra/suspension-fmus.step-derivatives"
"""Folder of a copied FMU with the library for C."""


@dataclass(frozen=True)
class Step:
    """A step and its derivatives.

    Attributes:
        after: states and outputs after the step (unknowns,), those of the FMU to the last bit.
        jacobian: their derivatives (unknowns, knowns), each in the unit of the unknown by that of the known. Its
            transposed times weights of the unknowns is the adjoint.
        sides: a number that is equal where two steps have taken the same sides of all comparisons of what depends on
            the knowns: contact, limits, pieces of tables, active rows of quadratic programs.
    """

    after: Array
    jacobian: Array
    sides: int


class StepDerivatives:
    """The step function of an FMU of this project, with its derivatives.

    Args:
        fmu: a file, or the name of an FMU of the catalog.

    Attributes:
        states: names.
        knowns: names of parameters, inputs and states (also of those that are no variables) at the begin of a step.
        unknowns: names of states and outputs at its end.

    Raises CosimError for an FMU of another tool, and without a C++ compiler. An FMU that computes random profiles has
    no derivatives by the parameters of these.
    """

    def __init__(self, fmu: str | os.PathLike[str]) -> None:
        file = FmuFile(find(fmu), quiet=True)
        self._source = _source_of(file)
        self._library = _interface().dlopen(str(step_library(self._source)))
        self._sizes = _interface().new("StepSizes *")
        self._library.step_derivatives_sizes(self._sizes)
        names = {self._source.place(v): v.name for v in file.description.variables.values()}
        for name, slot, n in self._source.hidden:
            names |= {("state", slot + k): f"{name}[{k + 1}]" if n > 1 else name for k in range(n)}
        numbers = {role: range(self._source.sizes[f"{role}s"]) for role in ("parameter", "input", "state", "output")}
        of = {role: [names.get((role, k), f"{role} {k + 1}") for k in slots] for role, slots in numbers.items()}
        self.knowns = of["parameter"] + of["input"] + of["state"]
        self.states, self.unknowns = of["state"], of["state"] + of["output"]

    def __call__(self, state: bytes, step: TimeLike, seeds: Array | None = None) -> Step:
        """Take a step from a state, with its derivatives.

        Args:
            state: what `fmi3SerializeFMUState` or `fmi2SerializeFMUstate` gives in step mode.
            step: its length.
            seeds: (n, knowns) directions; the Jacobian is then (unknowns, n). Default: each known by itself.

        Raises CosimError for bytes that are no state of this FMU, and for a step in which a state diverges or an output
        is not finite.
        """
        h = float(positive(step, "step"))
        along = np.ascontiguousarray(np.eye(len(self.knowns)) if seeds is None else seeds, dtype=float)
        if along.ndim != 2 or along.shape[1] != len(self.knowns) or not np.isfinite(along).all():
            raise CosimError(f"seeds must be finite numbers of shape (n, {len(self.knowns)}), not {along.shape}")
        after, slopes = np.empty(len(self.unknowns)), np.empty((len(along), len(self.unknowns)))
        memory, sides = np.empty(self._sizes.memory, dtype=np.uint8), np.zeros(1, dtype=np.uint64)
        buffer, data = _interface().from_buffer, bytes(state)
        found = self._library.step_derivatives(
            buffer("char[]", memory),
            data,
            len(data),
            h,
            len(along),
            buffer("double[]", along),
            buffer("double[]", after),
            buffer("double[]", slopes),
            buffer("uint64_t[]", sides),
        )
        if found == self._library.STEP_NO_STATE:
            raise CosimError(
                "these bytes are no state of this FMU before a step of this length: give what"
                " fmi3SerializeFMUState returned, of the same FMU"
            )
        if found == self._library.STEP_FAILED:
            raise CosimError("the step fails: a state diverges, or an output is not finite; take a shorter one")
        if not np.isfinite(slopes).all():
            row, column = np.argwhere(~np.isfinite(slopes))[0]
            raise CosimError(f"the derivative of {self.unknowns[column]} along direction {row + 1} is not finite")
        return Step(after, slopes.T, int(sides[0]))


def copy_with_step_derivatives(fmu: Path, to: Path) -> None:
    """Write a copy of an FMU of this project that carries `step_derivatives.h` and its library for this platform.

    Raises CosimError as `StepDerivatives` does.
    """
    file = FmuFile(fmu, quiet=True)
    library = step_library(_source_of(file))
    content = file.files()
    content[f"{FOLDER}/{STEP_HEADER.name}"] = STEP_HEADER.read_bytes()
    content[f"{FOLDER}/{host()}/{file.description.name}{library.suffix}"] = library.read_bytes()
    to.write_bytes(zipped(content, first="modelDescription.xml"))


def _source_of(file: FmuFile) -> LaneSource:
    try:
        return lane_source(file)
    except NoLanes as reason:
        raise CosimError(f"{file.path} has no derivatives of a step: {reason}") from None


@lru_cache
def _interface() -> Any:
    ffi = cffi.FFI()
    ffi.cdef(declarations(STEP_HEADER))
    return ffi
