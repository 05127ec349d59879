"""What a run records, and how it is executed."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import TYPE_CHECKING

from build_fmus.base import surface
from build_fmus.base.checks import number
from cosim.core.errors import WiringError
from cosim.core.time import TimeLike
from cosim.engine.plan import LOOP_TOLERANCE

if TYPE_CHECKING:
    from cosim.system.wiring import Wiring


@dataclass(frozen=True)
class Record:
    """What a run records.

    Args:
        variables: names and patterns as in `System.select`; None for all outputs that are no array elements.
        interval: [s] between two rows, default the smallest step of the system.
        watch: further variables that can be read while a simulation runs (`simulation["car.x"]`).
        display_units: a file of the recording has the units in which the FMUs display their variables.
    """

    variables: str | Iterable[str] | None = None
    interval: TimeLike | None = None
    watch: Iterable[str] = ()
    display_units: bool = False

    @property
    def names(self) -> list[str]:
        """The variables as a list, none for None."""
        return [self.variables] if isinstance(self.variables, str) else list(self.variables or ())

    @classmethod
    def of(cls, given: Record | str | Iterable[str] | None) -> Record:
        """Names alone are the variables."""
        return given if isinstance(given, Record) else cls(given)


@dataclass(frozen=True)
class Execution:
    """How a run is executed. Where it does not fail, its numbers are the same in any way, except with a `tolerance`.

    Args:
        isolate: names and patterns of FMUs that run in processes of their own, see `System.isolate`.
        step_timeout: of these, wall time of one call [s].
        memory_limit: of these, bytes.
        real_time: pace, 1.0 for that of the clock, 2.0 for twice as fast, see `Simulation.advance`; None: none.
        check_stability: warn of a coupling that amplifies errors (StabilityWarning).
        allow_nan: outputs that are NaN or infinite do not end the run, except with a `tolerance` those that a
            continuous component reads from another one.
        loop_tolerance: of the values that solve an algebraic loop, relative to max(nominal value, |value|). A run with
            a `tolerance` takes a smaller one where it needs it.
        tolerance: of the error that the exchange between continuous components makes in a run, relative to the largest
            magnitude of each value: their communication steps follow it (`cosim.engine.adaptive`). None: their steps
            are fixed.
        lanes: the vectors in which studies, sweeps and searches run copies of a system side by side, as in
            `cosim.batch.Batch`; "off": in none; None: in "auto" if it saves more time than their compilation takes.
    """

    isolate: tuple[str, ...] = ()
    step_timeout: float | None = None
    memory_limit: int | None = None
    real_time: float | None = None
    check_stability: bool = False
    allow_nan: bool = False
    loop_tolerance: float = LOOP_TOLERANCE
    tolerance: float | None = None
    lanes: str | None = None

    def __post_init__(self) -> None:
        number("loop_tolerance", self.loop_tolerance, above=0.0, most=1.0, error=WiringError)
        if self.tolerance is not None:
            number(surface.name_of("tolerance"), self.tolerance, above=0.0, most=1.0, error=WiringError)

    def prepare(self, system: Wiring, *, every: bool = True) -> None:
        """Isolate the FMUs of a system that are to be isolated.

        Raises:
            WiringError: a name that matches nothing, unless not `every` name must.
        """
        system.isolate(
            *self.isolate, step_timeout=self.step_timeout, memory_limit=self.memory_limit, missing_ok=not every
        )
