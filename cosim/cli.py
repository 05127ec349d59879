"""Command line ``cosim``: run experiments and studies, identify laws, look into FMUs."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Annotated, Any

import typer
from rich.table import Table
from rich.text import Text

from build_fmus import terminal
from build_fmus.terminal import Command, Commands, PackageVersion, show
from cosim.experiments import cli_bench, cli_gpc, cli_hmmwv, cli_preview_lq, cli_three_axle, cli_trench

GROUP: dict[str, Any] = {**terminal.APP, "no_args_is_help": True}
app = typer.Typer(cls=Commands, **GROUP)
run_app = typer.Typer(help="Run one case of an experiment.", **GROUP)
study_app = typer.Typer(help="Run a whole published study and write its report.", **GROUP)
identify_app = typer.Typer(help="Derive the control laws again from their plant FMU.", **GROUP)
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
    run_app.command(_name, cls=Command)(_module.run)
    study_app.command(_name, cls=Command)(_module.study)
    if hasattr(_module, "identify"):
        identify_app.command(_name, cls=Command)(_module.identify)

_EVERYWHERE = {"--fmus", "--fmi", "--vehicle", "--out", "--help"}
"""Options of every experiment, which say nothing about one of them."""


@app.callback()
def cosim(_version: PackageVersion = False) -> None:
    """Co-simulate FMUs: experiments that repeat published papers, and a look into FMUs of any tool."""


@app.command("list", cls=Command)
def list_experiments() -> None:
    """List the experiments with the options of their runs."""
    table = Table("experiment", "what it is", box=None)
    table.add_column("options", overflow="fold")
    runs = typer.main.get_command(run_app).commands  # type: ignore[attr-defined]
    for name, module in EXPERIMENTS.items():
        table.add_row(name, Text(module.TITLE), Text(_options(runs[name])))
    show(table)


def _options(command: Any) -> str:
    """The options of a command in a line: ``--road sine|curb  --speed KM/H  --hold``."""
    terminal.list_choices(command)
    shown = []
    for option in command.params:
        if option.opts[0] not in _EVERYWHERE:
            unit = re.search(r"\[([^\]]+)\]", option.help or "")
            value = option.metavar or (unit[1].upper() if unit else "N")
            shown.append(option.opts[0] if option.is_flag else f"{option.opts[0]} {value}")
    return "  ".join(shown)


@app.command(cls=Command)
def fmu(file: Annotated[Path, typer.Argument(help="an .fmu file, of any tool")]) -> None:
    """Show what is in an FMU, ready to wire."""
    from cosim.describe import describe, wiring

    show(describe(file))
    show(Text("\nready to paste:", style="bold"))
    show(Text(wiring(file), style="green"), as_is=True)


def main() -> None:
    """Entry point."""
    from cosim.errors import CosimError

    failures = (CosimError, ValueError, LookupError, OSError, RuntimeError)
    terminal.run("cosim", app, failures, "interrupted")
