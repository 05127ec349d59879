"""Command line ``cosim``: run experiments and studies, identify laws, look into FMUs."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Annotated, Any

import typer
from rich.console import Console
from rich.markup import escape
from rich.table import Table
from typer.core import TyperGroup

import safe_files
from cosim.experiments import cli_bench, cli_gpc, cli_hmmwv, cli_preview_lq, cli_three_axle, cli_trench

console = Console(stderr=True, highlight=False, soft_wrap=True)


class Stopped(Exception):  # noqa: N818
    """Ctrl-C, on its way through typer, which would end the program without a word."""


class Commands(TyperGroup):
    """Commands that Ctrl-C ends with a message."""

    def invoke(self, ctx: Any) -> Any:
        try:
            return super().invoke(ctx)
        except KeyboardInterrupt as error:
            raise Stopped(str(error) or "interrupted") from error


app = typer.Typer(cls=Commands, add_completion=False, pretty_exceptions_enable=False, no_args_is_help=True)
run_app = typer.Typer(help="Run one case of an experiment.", no_args_is_help=True)
study_app = typer.Typer(help="Run a whole published study and write its report.", no_args_is_help=True)
identify_app = typer.Typer(help="Derive the control laws again from their plant FMU.", no_args_is_help=True)
app.add_typer(run_app, name="run")
app.add_typer(study_app, name="study")
app.add_typer(identify_app, name="identify")

EXPERIMENTS: dict[str, Any] = {
    "bench": cli_bench,
    "gpc": cli_gpc,
    "hmmwv": cli_hmmwv,
    "preview-lq": cli_preview_lq,
    "three-axle": cli_three_axle,
    "trench": cli_trench,
}
for _name, _module in EXPERIMENTS.items():
    run_app.command(_name)(_module.run)
    study_app.command(_name)(_module.study)
    if hasattr(_module, "identify"):
        identify_app.command(_name)(_module.identify)


@app.command("list")
def list_experiments() -> None:
    """List the experiments."""
    table = Table("experiment", "what it is", box=None)
    table.add_column("options", overflow="fold")
    for name, module in EXPERIMENTS.items():
        table.add_row(name, module.TITLE, module.OPTIONS)
    Console().print(table)


@app.command()
def fmu(file: Annotated[Path, typer.Argument(help="an .fmu file, of any tool")]) -> None:
    """Show what is in an FMU, ready to wire."""
    from cosim.describe import describe

    Console().print(describe(file))


def main() -> None:
    """Entry point: expected failures end with one message, not a traceback."""
    from cosim.errors import CosimError

    safe_files.plain_warnings()
    try:
        app()
    except Stopped as stopped:
        console.print(escape(str(stopped)))
        sys.exit(130)
    except (CosimError, ValueError, LookupError, OSError, RuntimeError) as error:
        console.print(f"[red]cosim:[/red] {escape(_text(error))}")
        sys.exit(1)


def _text(error: Exception) -> str:
    if isinstance(error, OSError):
        return safe_files.sentence(error)
    return str(error.args[0] if isinstance(error, KeyError) and error.args else error)
