"""Command line ``cosim``: run experiments and studies, identify laws, look into FMUs."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console
from rich.table import Table

from cosim.experiments import cli_gpc

console = Console(stderr=True, highlight=False)
app = typer.Typer(add_completion=False, pretty_exceptions_enable=False, no_args_is_help=True)
run_app = typer.Typer(help="Run one case of an experiment.", no_args_is_help=True)
study_app = typer.Typer(help="Run a whole published study and write its report.", no_args_is_help=True)
identify_app = typer.Typer(help="Derive the control laws again from their plant FMU.", no_args_is_help=True)
app.add_typer(run_app, name="run")
app.add_typer(study_app, name="study")
app.add_typer(identify_app, name="identify")

EXPERIMENTS = {"gpc": cli_gpc}
for _name, _module in EXPERIMENTS.items():
    run_app.command(_name)(_module.run)
    study_app.command(_name)(_module.study)
    if hasattr(_module, "identify"):
        identify_app.command(_name)(_module.identify)


@app.command("list")
def list_experiments() -> None:
    """List the experiments."""
    table = Table("experiment", "what it is", "options", box=None)
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

    try:
        app()
    except KeyboardInterrupt:
        console.print("interrupted; what was computed is kept, the same command continues from there")
        sys.exit(130)
    except (CosimError, ValueError, LookupError, OSError) as error:
        message = error.args[0] if isinstance(error, KeyError) and error.args else error
        console.print(f"[red]cosim:[/red] {message}", markup=True)
        sys.exit(1)
