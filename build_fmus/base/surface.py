"""How the user gives values: as options of a shell command, or as arguments in Python. Messages use the same terms."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from typing import Any

from build_fmus.base import escape

_options: frozenset[str] | None = None


def command_options() -> frozenset[str] | None:
    """The options of the command that runs; None where none does."""
    return _options


def set_command_options(options: Iterable[str] | None) -> None:
    """In a worker process: what `command_options` gave in the process that started it."""
    global _options  # noqa: PLW0603 - of all threads
    _options = None if options is None else frozenset(options)


@contextmanager
def command(options: Iterable[str]) -> Iterator[None]:
    """In the block a command with these options runs."""
    before = command_options()
    set_command_options(options)
    try:
        yield
    finally:
        set_command_options(before)


def hint(python: str = "", shell: str = "") -> str:
    """The hint that fits the user's surface.

    Args:
        python: where no command runs.
        shell: where a command runs that has the options which this text names; else the hint is empty.
    """
    if _options is None:
        return python
    named = {word.rstrip(",.;:)'") for word in shell.replace("=", " ").split() if word.startswith("--")}
    return shell if named <= _options else ""


def name_of(argument: str, option: str = "") -> str:
    """A value's name: `--preview-error` of a command, `preview_error` in Python.

    Args:
        argument: its name in Python.
        option: without its dashes, where it is not the argument's name.
    """
    return argument if _options is None else f"--{option or argument.replace('_', '-')}"


def given(**values: Any) -> str:
    """Values as the user gives them to a command or in Python.

    `--controller zero --hold` to a command, `controller='zero', hold=True` in Python.
    """
    if _options is None:
        return ", ".join(f"{name}={value!r}" for name, value in values.items())
    texts = {name_of(name): value if value is True else escape.shell(str(value)) for name, value in values.items()}
    return " ".join(name if value is True else f"{name} {value}" for name, value in texts.items())
