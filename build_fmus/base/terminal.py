"""What both commands have in common toward people: help, version, tables, and how they end."""

from __future__ import annotations

import errno
import importlib
import io
import logging
import os
import re
import sys
from collections.abc import Callable, Collection, Iterable, Mapping
from importlib import metadata
from typing import Annotated, Any

import typer
from rich.console import Console, RenderableType
from rich.text import Text
from typer.core import TyperCommand, TyperGroup

from build_fmus.base import extras, safe_files, surface
from build_fmus.base.checks import unknown

PACKAGE = "suspension-fmus"
APP: dict[str, Any] = {
    "add_completion": False,
    "pretty_exceptions_enable": False,
    "rich_markup_mode": None,  # which would take units in help texts, [km/h], for markup
    "context_settings": {"max_content_width": 110},  # of help; terminals are wider than 80 columns
}
"""Arguments of every `typer.Typer`."""

AS_TEXT: dict[str, Any] = {"markup": False, "emoji": False}
"""Arguments of every console: names, units and messages of others hold brackets and colons, which are never markup.
What is styled is a `Text`.
"""
console = Console(stderr=True, highlight=False, soft_wrap=True, **AS_TEXT)


class UserAbort(Exception):  # noqa: N818
    """Ctrl-C, on its way through typer, which would end the program without a word."""


class OneOf(str):
    """What stands behind an option in its help: the names that it takes, read from tables only when help is requested.

    `table` is `module:NAME` (importing an experiment takes seconds); `more` stands for what else is taken.
    """

    table: str
    more: str

    def __new__(cls, table: str, more: str = "") -> OneOf:
        """Text with the value `table`; the table itself is read later."""
        self = super().__new__(cls, table)
        self.table, self.more = table, more
        return self

    def listed(self) -> str:
        """`a|b|c`."""
        module, _, name = self.table.partition(":")
        return one_of(getattr(importlib.import_module(module), name), self.more)


def one_of(names: Iterable[str], more: str = "") -> str:
    """Names as help shows a choice."""
    return "|".join([*names, *([more] if more else [])])


class _ToScreen(logging.Handler):
    """Messages of the loggers below `cosim` on standard error."""

    def emit(self, record: logging.LogRecord) -> None:
        console.print(self.format(record))


def _tell_more(count: int) -> None:
    if count:
        logger = logging.getLogger("cosim")
        logger.handlers = [h for h in logger.handlers if not isinstance(h, _ToScreen)] + [_ToScreen()]
        logger.setLevel(logging.DEBUG if count > 1 else logging.INFO)


def _tell_less(quiet: bool) -> None:
    console.quiet = quiet


_More = Annotated[
    int,
    typer.Option(
        "--verbose",
        "-v",
        count=True,
        expose_value=False,
        callback=_tell_more,
        help="print the warnings of the FMUs as they run; -vv: everything that they log",
    ),
]
_Less = Annotated[
    bool,
    typer.Option("--quiet", "-q", expose_value=False, callback=_tell_less, help="print only results and errors"),
]


def _verbosity_options() -> list[Any]:
    """Options of every command."""
    app = typer.Typer(**APP)

    @app.command()
    def _nothing(verbose: _More = 0, quiet: _Less = False) -> None: ...

    return typer.main.get_command(app).params


class Command(TyperCommand):
    """A command that Ctrl-C ends with a message, and whose help lists choices.

    It has `-v` and `-q`, unless it declares its own. `headings`: of groups of options in its help -> the names of
    their parameters; options in no group come last.
    """

    headings: Mapping[str, Collection[str]] = {}

    def __init__(self, *arguments: Any, **named: Any) -> None:
        super().__init__(*arguments, **named)
        taken = {name for parameter in self.params for name in parameter.opts}
        self.params += [option for option in _verbosity_options() if not taken & set(option.opts)]

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        """Parse the arguments; the message on a wrong value shows the value."""
        try:
            return super().parse_args(ctx, args)
        except typer.BadParameter as error:
            error.message = _with_value(error)
            raise

    def invoke(self, ctx: Any) -> Any:
        """Run the command; Ctrl-C raises UserAbort, and messages name the options of the command."""
        options = {name for parameter in self.params for name in (*parameter.opts, *parameter.secondary_opts)}
        try:
            with surface.command(options):
                return super().invoke(ctx)
        except KeyboardInterrupt as error:
            raise UserAbort(str(error)) from error

    def format_help(self, ctx: Any, formatter: Any) -> None:
        """Write the help, in which options list their choices."""
        list_choices(self)
        super().format_help(ctx, formatter)

    def format_options(self, ctx: Any, formatter: Any) -> None:
        """Write the options by the groups of `headings`, the others last."""
        left = {p.name: record for p in self.get_params(ctx) if (record := p.get_help_record(ctx)) is not None}
        for heading, names in self.headings.items():
            if rows := [left.pop(name) for name in list(left) if name in names]:
                with formatter.section(heading):
                    formatter.write_dl(rows)
        with formatter.section("Other options" if self.headings else "Options"):
            formatter.write_dl(list(left.values()))


def _with_value(error: typer.BadParameter) -> str:
    """The message about a value of the wrong type, which names the value; the cause is pydantic's, in newer typers."""
    details: list[Any] = getattr(error.__cause__, "errors", list)()
    wanted = {"float_parsing": "a number", "int_parsing": "a whole number"}.get(details[0]["type"]) if details else None
    return error.message if wanted is None else f"{details[0]['input']!r}; give {wanted}"


class Commands(TyperGroup):
    """Commands that Ctrl-C ends with a message, and whose help has the first sentence of each, uncut.

    `what`: they are; `beside`: what may stand in their place.
    """

    what = "command"
    beside = ""

    def resolve_command(self, ctx: Any, args: list[str]) -> Any:
        """Find the named command; an unknown name ends with a message that hints at the nearest one."""
        name, *rest = args
        if name.startswith("-"):
            return super().resolve_command(ctx, args)
        command = self.get_command(ctx, name)
        if command is None:
            ctx.fail(self.refusal(ctx, name) + self.beside)
        return name, command, rest

    def refusal(self, ctx: Any, name: str) -> str:
        """The sentence about a name that no command has."""
        return unknown(self.what, name, self._shown(ctx))

    def _shown(self, ctx: Any) -> dict[str, Any]:
        found = ((name, self.get_command(ctx, name)) for name in self.list_commands(ctx))
        return {name: command for name, command in found if command is not None and not command.hidden}

    def format_commands(self, ctx: Any, formatter: Any) -> None:
        """Write the commands, each with the first sentence of its help."""
        rows = [(name, re.split(r"\.(?:\s|$)", command.help or "")[0]) for name, command in self._shown(ctx).items()]
        if rows:
            with formatter.section("Commands"):
                formatter.write_dl(rows)

    def invoke(self, ctx: Any) -> Any:
        """Run the chosen command; Ctrl-C raises UserAbort."""
        try:
            return super().invoke(ctx)
        except KeyboardInterrupt as error:
            raise UserAbort(str(error)) from error


def list_choices(command: Any) -> None:
    """Put the names that options take into a command's help."""
    for parameter in command.params:
        if isinstance(parameter.metavar, OneOf):
            parameter.metavar = parameter.metavar.listed()


def _print_version(asked: bool) -> None:
    if asked:
        print(f"{PACKAGE} {metadata.version(PACKAGE)}")
        raise typer.Exit


PackageVersion = Annotated[
    bool, typer.Option("--version", callback=_print_version, is_eager=True, help="show the version and stop")
]


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
