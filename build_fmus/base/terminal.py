"""What both commands have in common toward people: help, version, tables, and how they end."""

from __future__ import annotations

import errno
import io
import logging
import os
import re
import sys
from collections.abc import Callable, Collection, Mapping, Sequence
from pathlib import Path
from typing import Any

import click
from click.shell_completion import CompletionItem
from rich.console import Console, RenderableType
from rich.text import Text

from build_fmus.base import extras, safe_files, surface
from build_fmus.base.checks import unknown

PACKAGE = "suspension-fmus"
SETTINGS = {"max_content_width": 110, "show_default": True}  # of help; terminals are wider than 80 columns
"""Context settings of a program's first command; those below it have them too."""
PATH = click.Path(path_type=Path)

AS_TEXT: dict[str, Any] = {"markup": False, "emoji": False}
"""Arguments of every console: names, units and messages of others hold brackets and colons, which are never markup.
What is styled is a `Text`.
"""
console = Console(stderr=True, highlight=False, soft_wrap=True, **AS_TEXT)


class UserAbort(Exception):  # noqa: N818
    """Ctrl-C, on its way through click, which would end the program without a word."""


class Names(click.ParamType):
    """A value whose names help lists and shells complete; the command checks it, with a message that says more.

    Args:
        names: it is one of these.
        more: stands for what else is taken, `FILE.crg`.
        kind: type of the value.
    """

    name = "text"

    def __init__(self, names: Collection[Any], more: str = "", kind: type = str) -> None:
        self.names = [str(n) for n in names]
        self.more = more
        self.kind = click.types.convert_type(kind)

    def get_metavar(self, param: click.Parameter, ctx: click.Context) -> str:  # noqa: ARG002
        """`a|b|c`."""
        return "|".join(filter(None, [*self.names, self.more]))

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        """The value as its type has it."""
        return self.kind.convert(value, param, ctx)

    def shell_complete(self, ctx: click.Context, param: click.Parameter, incomplete: str) -> list[CompletionItem]:  # noqa: ARG002
        """The names that begin so, or files."""
        return completions(self.names, incomplete, files=bool(self.more))


def completions(names: Collection[str], incomplete: str, *, files: bool) -> list[CompletionItem]:
    """The names that begin with a word; where none does and there may be files, those."""
    found = [CompletionItem(name) for name in names if name.startswith(incomplete)]
    return found or [CompletionItem(incomplete, type="file")] * files


class _ToScreen(logging.Handler):
    """Messages of the loggers below `cosim` on standard error."""

    def emit(self, record: logging.LogRecord) -> None:
        console.print(self.format(record))


def _tell_more(_context: click.Context, _option: click.Parameter, count: int) -> None:
    if count:
        logger = logging.getLogger("cosim")
        logger.handlers = [h for h in logger.handlers if not isinstance(h, _ToScreen)] + [_ToScreen()]
        logger.setLevel(logging.DEBUG if count > 1 else logging.INFO)


def _tell_less(_context: click.Context, _option: click.Parameter, quiet: bool) -> None:
    console.quiet = quiet


_VERBOSITY = (
    click.Option(
        ["--verbose", "-v"],
        count=True,
        expose_value=False,
        callback=_tell_more,
        help="print the warnings of the FMUs as they run; -vv: everything that they log",
    ),
    click.Option(
        ["--quiet", "-q"], is_flag=True, expose_value=False, callback=_tell_less, help="print only results and errors"
    ),
)
"""Options of every command."""


class Command(click.Command):
    """A command that Ctrl-C ends with a message, with `-v` and `-q`.

    `groups`: its options by their heading in the help; `params`: those without one, which come last.
    """

    def __init__(
        self,
        name: str | None,
        *,
        groups: Mapping[str, Sequence[click.Parameter]] | None = None,
        params: Sequence[click.Parameter] | None = None,
        **named: Any,
    ) -> None:
        self.groups = groups or {}
        grouped = [option for options in self.groups.values() for option in options]
        super().__init__(name, params=[*grouped, *(params or ()), *_VERBOSITY], **named)

    def parse_args(self, ctx: click.Context, args: list[str]) -> list[str]:
        """Parse the arguments; the message on a text that is not a number says so in plain words."""
        try:
            return super().parse_args(ctx, args)
        except click.BadParameter as error:
            found = re.fullmatch(r"(.+) is not a valid (float|integer)( range)?\.", error.message, re.DOTALL)
            if found is None:
                raise
            kind = "a number" if found[2] == "float" else "a whole number"
            raise click.BadParameter(f"{found[1]}; give {kind}", error.ctx, error.param, error.param_hint) from None

    def invoke(self, ctx: click.Context) -> Any:
        """Run the command; Ctrl-C raises UserAbort, and messages name the options of the command."""
        options = {name for parameter in self.params for name in (*parameter.opts, *parameter.secondary_opts)}
        try:
            with surface.command(options):
                return super().invoke(ctx)
        except KeyboardInterrupt as error:
            raise UserAbort(str(error)) from error

    def format_options(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """Write the options by their groups, the others last."""
        grouped = {option for options in self.groups.values() for option in options}
        others = [p for p in self.get_params(ctx) if p not in grouped and not isinstance(p, click.Argument)]
        for heading, options in {**self.groups, "Other options" if grouped else "Options": others}.items():
            if rows := [row for option in options if (row := option.get_help_record(ctx)) is not None]:
                with formatter.section(heading):
                    formatter.write_dl(rows)


class Commands(click.Group):
    """Commands that Ctrl-C ends with a message, and whose help has the first sentence of each, uncut.

    `what`: they are; `beside`: what may stand in their place.
    """

    what = "command"
    beside = ""
    command_class = Command

    def list_commands(self, ctx: click.Context) -> list[str]:  # noqa: ARG002
        """Names of the commands, in the order of their declaration."""
        return list(self.commands)

    def resolve_command(
        self, ctx: click.Context, args: list[str]
    ) -> tuple[str | None, click.Command | None, list[str]]:
        """Find the named command; an unknown name ends with a message that hints at the nearest one."""
        if self.get_command(ctx, args[0]) is None and not args[0].startswith("-") and not ctx.resilient_parsing:
            ctx.fail(self.refusal(ctx, args[0]) + self.beside)
        return super().resolve_command(ctx, args)

    def refusal(self, ctx: click.Context, name: str) -> str:
        """The sentence about a name that no command has."""
        return unknown(self.what, name, self._shown(ctx))

    def _shown(self, ctx: click.Context) -> dict[str, click.Command]:
        found = ((name, self.get_command(ctx, name)) for name in self.list_commands(ctx))
        return {name: command for name, command in found if command is not None and not command.hidden}

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """Write the commands, each with the first sentence of its help."""
        rows = [(name, re.split(r"\.(?:\s|$)", command.help or "")[0]) for name, command in self._shown(ctx).items()]
        if rows:
            with formatter.section("Commands"):
                formatter.write_dl(rows)

    def invoke(self, ctx: click.Context) -> Any:
        """Run the chosen command; Ctrl-C raises UserAbort."""
        try:
            return super().invoke(ctx)
        except KeyboardInterrupt as error:
            raise UserAbort(str(error)) from error


version_option = click.version_option(
    package_name=PACKAGE, message="%(package)s %(version)s", help="show the version and stop"
)


def show(*items: RenderableType, as_is: bool = False) -> None:
    """Print to standard output: as wide as the terminal, and into a pipe or a file with nothing wrapped or cut.

    Args:
        *items: to print.
        as_is: not wrapped in a terminal either, so that it can be copied from there.

    Raises:
        OSError: it cannot be written (a full disk).
    """
    wide = None if sys.stdout.isatty() else 1_000_000
    try:
        Console(width=wide, **AS_TEXT).print(*items, soft_wrap=as_is)
    except OSError as error:
        _drop_output()
        raise OSError(error.errno, error.strerror, "standard output") from error


def run(program: str, app: Callable[[], Any], expected: tuple[type[Exception], ...], interrupted: str) -> None:
    """Run a command line: expected failures end with one message, not a traceback.

    Args:
        program: name of the command, for messages.
        app: runs the command line.
        expected: classes of failures that are a user's.
        interrupted: what Ctrl-C ends with, unless it comes with a text of its own.
    """
    failures: tuple[type[Exception], ...] = (*expected, extras.MissingExtraError)
    open_closed_streams()
    safe_files.plain_warnings()
    escape_unprintable()
    try:
        app()
    except UserAbort as stopped:
        console.quiet = False
        console.print(str(stopped) or interrupted)
        sys.exit(130)
    except failures as error:
        console.quiet = False
        console.print(Text.assemble((f"{program}:", "red"), f" {_text(error)}"))
        _drop_output()
        sys.exit(1)


def _drop_output() -> None:
    """What cannot be written is not written again when Python ends."""
    try:
        sys.stdout.flush()
    except OSError:
        os.dup2(os.open(os.devnull, os.O_WRONLY), 1)


def open_closed_streams() -> None:
    """Open standard streams that were closed before the program began (`>&-`).

    So no other file gets their descriptors. Input is empty, output that is written to is an error, and messages are
    lost.
    """
    for number, flags in enumerate((os.O_RDONLY, os.O_RDONLY, os.O_WRONLY)):
        try:
            os.fstat(number)
        except OSError:
            os.open(os.devnull, flags)  # gets the smallest number that is free
    if sys.stdout is None:
        sys.stdout = os.fdopen(1, "w", buffering=1, closefd=False)
    if sys.stderr is None:
        sys.stderr = os.fdopen(2, "w", buffering=1, closefd=False)


def escape_unprintable() -> None:
    r"""From now on output shows what the terminal's encoding lacks as escapes (`\xe4`), instead of failing on it."""
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="backslashreplace")


def _text(error: Exception) -> str:
    if isinstance(error, UnicodeEncodeError):  # a name of a file, or in one
        lacking = error.object[error.start : error.end]
        return (
            f"this locale has no characters for {lacking!r}; set PYTHONUTF8=1, or a UTF-8 locale such as LC_ALL=C.UTF-8"
        )
    if str(error) == "can't start new thread" or (isinstance(error, BlockingIOError) and error.filename is None):
        return (
            "cannot start another thread or process: end other processes, or raise the limit of this user or container"
            " (ulimit -u)"
        )
    if isinstance(error, OSError) and error.errno == errno.EBADF:
        return "standard output is closed"
    if isinstance(error, OSError):
        return safe_files.sentence(error)
    return str(error.args[0] if isinstance(error, KeyError) and error.args else error)
