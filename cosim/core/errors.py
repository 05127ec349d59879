"""The errors a user of the master can meet; each message names what is wrong and what to do."""

from __future__ import annotations

from collections.abc import Sequence
from math import inf
from typing import Any

from build_fmus.base import surface
from build_fmus.base.checks import plain
from cosim.core.base_error import CosimError

STATUS_NAMES = ("OK", "Warning", "Discard", "Error", "Fatal", "Pending")  # FMI 3.0 has no Pending


class FmuError(CosimError):
    """A file is missing, is no FMU, or is an FMU that cannot run here."""


class SspError(CosimError):
    """An SSP is missing or damaged, or holds what cannot be represented; or a system cannot travel as one."""

    def __init__(self, message: str):
        super().__init__(plain(message))


class TimeError(CosimError, ValueError):
    """A time or step that cannot be read or used."""


class WiringError(CosimError, ValueError):
    """Components, variables, units or connections that do not fit together."""

    def __init__(self, message: str):
        super().__init__(plain(message))  # names are those of FMUs, of whatever length


class LoopError(WiringError):
    """An algebraic loop that cannot be solved: values that depend on themselves at the same instant."""


class AlgebraicLoopWarning(UserWarning):
    """There may be an algebraic loop, which is not solved.

    Not all components in it declare their direct dependencies, and initialization has measured none.
    """


class UnconnectedInputsWarning(UserWarning):
    """Inputs that nothing drives: they keep their start values."""

    remedy = "System(allow_unconnected=True) if this is intended"


class FmuWarning(UserWarning):
    """An FMU deviates from the standard, or contradicts itself; it can be run, but results may be wrong."""


class SspWarning(UserWarning):
    """An SSP deviates from the standard: it can be read, but may not be what was meant."""


class StabilityWarning(UserWarning):
    """The coupled continuous components amplify their own errors with the chosen steps."""


class IsolationCrashedWarning(UserWarning):
    """An isolated FMU was lost after its last step."""


class CallFailed(CosimError):  # noqa: N818
    """One call into a component failed. The master turns it into a `ComponentError` with the time.

    `status`: an FMI status, or any other number that the component returned. `known`: names of the statuses there are.
    """

    def __init__(
        self,
        component: str,
        function: str,
        status: int,
        detail: str = "",
        messages: Sequence[str] = (),
        known: Sequence[str] = STATUS_NAMES,
    ):
        self.component = component
        self.function = function
        self.status = known[status] if 0 <= status < len(known) else str(status)
        self.known = self.status in known
        self.detail = detail
        self.messages = list(messages)
        super().__init__(self._text(None))

    def _text(self, time: float | None) -> str:
        when = "" if time is None else f" at t = {time:.9g} s"
        status = self.status if self.known else f"{self.status}, which is no FMI status,"
        text = f"component '{self.component}': {self.function} returned {status}{when}"
        if self.detail:
            text += f" ({self.detail})"
        if self.messages:
            text += "\n  the component says:\n" + "\n".join(f"    {line}" for line in self.messages)
        return text


class NotFinite(CallFailed):
    """A component showed NaN or infinity, at `at` [s]; `variable` and `value` say where and what."""

    def __init__(self, component: str, variable: str, value: float, at: float | None = None):
        self.variable = variable
        self.value = value
        self.at = at
        super().__init__(component, "get", 0)
        self.status = "not finite"

    def _text(self, time: float | None) -> str:
        when = time if self.at is None else self.at
        return (
            f"component '{self.component}': {self.variable} is {self.value}"
            + ("" if when is None else f" at t = {when:.9g} s")
            + surface.hint("; run with execution=Execution(allow_nan=True) to let such values pass")
        )


class IntegrationFailed(CallFailed):
    """The integrator of a Model Exchange FMU cannot continue at `at` [s]; `why` is the reason as a clause."""

    def __init__(self, component: str, why: str, at: float, messages: Sequence[str] = ()):
        self.why, self.at = why, at
        super().__init__(component, "integration", 3, why, messages)

    def _text(self, time: float | None) -> str:  # noqa: ARG002
        text = f"component '{self.component}': its integration failed at t = {self.at:.9g} s: {self.why}"
        return text + "".join(f"\n    {line}" for line in self.messages)


class LoopNotSolved(CallFailed):
    """An algebraic loop has no solution at `at` [s], or jumps there.

    `values`: name, value and residual of each unknown; `path`: the connections of the loop, as text; `culprit`: an
    output that was not finite where the solution ended; `switches`: discrete states change with every solution.
    """

    def __init__(
        self,
        component: str,
        values: Sequence[tuple[str, float, float]],
        tolerance: float,
        at: float,
        path: str,
        culprit: NotFinite | None = None,
        switches: bool = False,
    ):
        self.values, self.tolerance, self.at, self.path, self.culprit = values, tolerance, at, path, culprit
        self.switches = switches
        super().__init__(component, "algebraic loop", 3)
        self.status = "not solved"

    def _text(self, time: float | None) -> str:  # noqa: ARG002
        found = ", ".join(f"{n} = {z:.9g} (residual {r:.3g})" for n, z, r in self.values[:8])
        more = f" and {len(self.values) - 8} more" if len(self.values) > 8 else ""
        if self.switches:
            return (
                f"the algebraic loop through '{self.component}' has no solution at t = {self.at:.9g} s: discrete states"
                f" of its components change again with each solution, at last {found}{more}\n{self.path}"
                + surface.hint("\nGive one of these connections delay=True (one step of delay).")
            )
        if self.culprit is not None:
            more += f", where {self.culprit.component}.{self.culprit.variable} is {self.culprit.value}"
        return (
            f"the algebraic loop through '{self.component}' has no solution at t = {self.at:.9g} s, or its solution"
            f" jumps there: {found}{more}, tolerance {self.tolerance:g}\n{self.path}"
            + surface.hint(
                "\nGive an input of the loop a start value near the solution (start=...), one of these connections"
                " delay=True (one step of delay), or the run a larger execution=Execution(loop_tolerance=...)."
            )
        )


class ToleranceExceeded(CallFailed):
    """The error of an output exceeds what a step may make of the tolerance, even in one of `smallest` length [s]."""

    def __init__(
        self, component: str, variable: str, error: float, most: float, tolerance: float, smallest: float, at: float
    ):
        self.variable, self.error, self.most, self.tolerance = variable, error, most, tolerance
        self.smallest, self.at = smallest, at
        super().__init__(component, "exchange", 3)
        self.status = "not within the tolerance"

    def _text(self, time: float | None) -> str:  # noqa: ARG002
        found = f"its error is {self.error:.2g} instead of {self.most:.2g}"
        return (
            f"the exchange of {self.component}.{self.variable} does not reach the tolerance of {self.tolerance:g} at"
            f" t = {self.at:.9g} s: {found if self.error < inf else 'it is not finite'} in a step"
            f" of {self.smallest:.2g} s, the smallest one; run with a larger tolerance, or without one"
        )


class IsolationCrashed(CallFailed):
    """An isolated FMU was lost in a call; `how` says in which way."""

    def __init__(self, component: str, function: str, how: str, messages: Sequence[str] = ()):
        self.how = how
        super().__init__(component, function, 4, "", messages)
        self.status = "lost"

    def _text(self, time: float | None) -> str:
        when = "" if time is None else f" at t = {time:.9g} s"
        text = f"component '{self.component}' was lost in {self.function}{when}: {self.how}"
        if self.messages:
            text += "\n  its last words:\n" + "\n".join(f"    {line}" for line in self.messages)
        return text


class ComponentError(CosimError):
    """A component ended the run.

    Attributes: `component`, `function`, `status` ("Discard", "Error", "Fatal", ..., "not finite", "lost", or a number
    that FMI does not define), `time` [s], `variable` (the one that is not finite, else None), `messages` (the
    component's own log lines, oldest first), `recording` (a `Recording` up to the failure, None when it came before the
    first sample).
    """

    def __init__(self, failure: CallFailed, time: float, recording: Any):
        super().__init__(failure._text(time))
        self.component = failure.component
        self.function = failure.function
        self.status = failure.status
        self.variable, self.time = None, time
        if isinstance(failure, NotFinite):
            self.variable, self.time = failure.variable, time if failure.at is None else failure.at
        self.messages = failure.messages
        self.recording = recording


class Interrupted(CosimError, KeyboardInterrupt):  # noqa: N818
    """Ctrl-C: the run stopped between two instants; `recording` (a `Recording`) ends at `time` [s]."""

    def __init__(self, time: float, recording: Any):
        super().__init__(f"interrupted at t = {time:.9g} s; everything recorded up to there is kept")
        self.time = time
        self.recording = recording
