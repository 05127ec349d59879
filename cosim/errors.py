"""The errors a user of the master can meet; each message names what is wrong and what to do."""

from __future__ import annotations

import difflib
from collections.abc import Iterable, Sequence
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from cosim.recording import Recording

STATUS_NAMES = ("OK", "Warning", "Discard", "Error", "Fatal", "Pending")


class CosimError(Exception):
    """Base of every error the master raises on purpose.

    Errors cross processes with their message and attributes, without the recording: a study's workers report what failed.
    """

    def __reduce__(self) -> tuple[Any, ...]:
        attributes = {k: v for k, v in self.__dict__.items() if k != "recording"}
        return _restored, (type(self), self.args, attributes, hasattr(self, "recording"))


def _restored(kind: type[CosimError], args: tuple[Any, ...], attributes: dict[str, Any], recorded: bool) -> CosimError:
    error = kind.__new__(kind, *args)
    error.args = args
    error.__dict__.update(attributes, **({"recording": None} if recorded else {}))
    return error


class FmuError(CosimError):
    """A file is missing, is no FMU, or is an FMU that cannot run here."""


class TimeError(CosimError, ValueError):
    """A time or step that cannot be read or used."""


class WiringError(CosimError, ValueError):
    """Components, variables, units or connections that do not fit together."""


class LoopError(WiringError):
    """Discrete components that wait for each other at the same instant."""


class UnconnectedInputsWarning(UserWarning):
    """Inputs that nothing drives: they keep their start values."""


class StabilityWarning(UserWarning):
    """The coupled continuous components amplify their own errors with the chosen steps."""


class CallFailed(CosimError):  # noqa: N818
    """One call into a component failed. The master turns it into a `ComponentError` with the time."""

    def __init__(self, component: str, function: str, status: int, detail: str = "", messages: Sequence[str] = ()):
        self.component = component
        self.function = function
        self.status = STATUS_NAMES[status] if 0 <= status < len(STATUS_NAMES) else str(status)
        self.detail = detail
        self.messages = list(messages)
        super().__init__(self._text(None))

    def _text(self, time: float | None) -> str:
        when = "" if time is None else f" at t = {time:.9g} s"
        text = f"component '{self.component}': {self.function} returned {self.status}{when}"
        if self.detail:
            text += f" ({self.detail})"
        if self.messages:
            text += "\n  the component says:\n" + "\n".join(f"    {line}" for line in self.messages)
        return text


class ComponentError(CosimError):
    """A component ended the run.

    Attributes: `component`, `function`, `status` ("Discard", "Error", "Fatal", ...), `time` [s],
    `messages` (the component's own log lines, oldest first), `recording` (everything up to the failure,
    None when the failure came before the first sample).
    """

    def __init__(self, failure: CallFailed, time: float, recording: Recording | None):
        super().__init__(failure._text(time))
        self.component = failure.component
        self.function = failure.function
        self.status = failure.status
        self.time = time
        self.messages = failure.messages
        self.recording = recording


class Interrupted(CosimError, KeyboardInterrupt):  # noqa: N818
    """Ctrl-C: the run stopped between two instants; `recording` holds everything up to `time` [s]."""

    def __init__(self, time: float, recording: Recording | None):
        super().__init__(f"interrupted at t = {time:.9g} s; everything recorded up to there is kept")
        self.time = time
        self.recording = recording


def did_you_mean(name: str, known: Iterable[str]) -> str:
    """`"; did you mean 'a' or 'b'?"` for the nearest known names, else an empty string."""
    candidates = list(known)
    near = difflib.get_close_matches(name, candidates, n=3, cutoff=0.5)
    if not near:
        near = [c for c in candidates if name.lower() in c.lower()][:3]
    return "; did you mean " + " or ".join(f"'{n}'" for n in near) + "?" if near else ""
