"""The base of all errors of the master, apart from them since what they refer to raises some itself."""

from __future__ import annotations

from typing import Any


class CosimError(Exception):
    """Base of every error the master raises on purpose.

    Errors cross processes with their message and attributes, without the recording: a study's workers report what
    failed.
    """

    def __reduce__(self) -> tuple[Any, ...]:
        attributes = {k: v for k, v in self.__dict__.items() if k != "recording"}
        return _restored, (type(self), self.args, attributes, hasattr(self, "recording"))


def _restored(kind: type[CosimError], args: tuple[Any, ...], attributes: dict[str, Any], recorded: bool) -> CosimError:
    error = kind.__new__(kind, *args)
    error.args = args
    error.__dict__.update(attributes, **({"recording": None} if recorded else {}))
    return error
