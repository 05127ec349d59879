"""Command line `suspension-fmus`, in short `cosim`.

It runs experiments and studies, identifies control laws, inspects FMUs and builds them.
"""

from __future__ import annotations

import re
import shutil
from pathlib import Path
from typing import Annotated, Any

import typer
from rich.table import Table
from rich.text import Text

from build_fmus.base import extras, terminal
from build_fmus.base.checks import unknown
from build_fmus.base.completion import SCRIPTS, fitting
from build_fmus.base.terminal import Command, Commands, PackageVersion, show
from cosim.check.command import check_command
from cosim.experiments import EXPERIMENTS, IDENTIFY
from cosim.study.commands import EVERYWHERE, export_command, run_command, study_command, wiring_command
from cosim.study.experiment import resolved
from cosim.study.loading import load
from cosim.study.optimise_command import optimise_command
from cosim.study.sweep_command import sweep_command

GROUP: dict[str, Any] = {**terminal.APP, "no_args_is_help": True}
_ANYTHING = {"allow_extra_args": True, "ignore_unknown_options": True}  # which another command reads

NAMES = sorted(EXPERIMENTS)
"""Names of our experiments."""


class Experiments(Commands):
    """A group with one command per experiment, created when called: our experiments by name, a user's by its file."""

    make: Any
    what = "experiment"
    beside = "; or a file of yours, as my_experiment.py or Any.ssp"

    def list_commands(self, ctx: Any) -> list[str]:  # noqa: ARG002
        return [] if extras.missing("studies") else NAMES

    def get_command(self, ctx: Any, cmd_name: str) -> Any:  # noqa: ARG002
        if cmd_name in NAMES:
            extras.require("studies", f"the experiment {cmd_name}")
        if cmd_name in EXPERIMENTS or cmd_name.endswith((".py", ".ssp")):
            return type(self).make(load(EXPERIMENTS.get(cmd_name, cmd_name)))
        return None

    def refusal(self, ctx: Any, name: str) -> str:  # noqa: ARG002
        needed = f", which need {extras.named('studies')}" if extras.missing("studies") else ""
        return unknown(self.what, name, NAMES) + needed


class Runs(Experiments):
    """Commands that run a case of an experiment."""

    make = staticmethod(run_command)


class Studies(Experiments):
    """Commands that run the study of an experiment."""

    make = staticmethod(study_command)


class Sweeps(Experiments):
    """Commands that run a sweep over an experiment."""

    make = staticmethod(sweep_command)


class Searches(Experiments):
    """Commands that optimize an experiment."""

    make = staticmethod(optimise_command)


class Exports(Experiments):
    """Commands that export the system of an experiment."""

    make = staticmethod(export_command)


class Drawings(Experiments):
    """Commands that show the wiring of an experiment."""

    make = staticmethod(wiring_command)


class Controllers(Commands):
    """One command per experiment whose controllers are identified."""

    def list_commands(self, ctx: Any) -> list[str]:  # noqa: ARG002
        return list(IDENTIFY)

    def get_command(self, ctx: Any, cmd_name: str) -> Any:  # noqa: ARG002
        if cmd_name not in IDENTIFY:
            return None
        made = typer.Typer(**terminal.APP)
        made.command(cmd_name, cls=Command)(resolved(IDENTIFY[cmd_name]))
        return typer.main.get_command(made)


EXAMPLES = """\b
First steps:
  cosim run trench --length 1.2             one run, beside the passive vehicle
  cosim study three-axle                    a whole study, and its report
  cosim sweep hmmwv --vary car.body.mass=2000:3500 --samples 50
  cosim export hmmwv --web hmmwv.html       drive it, in a browser
  cosim check MyModel.fmu                   does an FMU keep to the standard?
  cosim list                                all experiments and their options
"""
BASE_EXAMPLES = f"""\b
First steps:
  cosim fmu MyModel.fmu                     what is in an FMU, with lines to paste into Python
  cosim check MyModel.fmu                   does an FMU keep to the standard?
  cosim run my_experiment.py                one run of an experiment of your own
  cosim run Any.ssp                         one run of a system of another tool
The experiments of the papers and build-fmus need {extras.named("studies")}
"""
"""First steps that work without extras."""


def first_steps() -> str:
    """Those that work with what is installed."""
    return BASE_EXAMPLES if extras.missing("studies") else EXAMPLES


app = typer.Typer(cls=Commands, epilog=first_steps(), **GROUP)
FILE = "NAME is a built-in experiment or your own file: cosim {0} my_experiment.py, cosim {0} Any.ssp"


@app.callback()
def cosim(_version: PackageVersion = False) -> None:
    """Co-simulate FMUs: reproduce published experiments, run your own, and inspect FMUs of any tool."""


app.add_typer(typer.Typer(cls=Runs, help="Run one case of an experiment. " + FILE.format("run"), **GROUP), name="run")
app.add_typer(
    typer.Typer(cls=Studies, help="Run a whole study and write its report. " + FILE.format("study"), **GROUP),
    name="study",
)
app.add_typer(
    typer.Typer(cls=Sweeps, help="Run an experiment over a design of its parameters. " + FILE.format("sweep"), **GROUP),
    name="sweep",
)
searches = typer.Typer(
    cls=Searches,
    help="Search for parameters of an experiment that minimize or maximize metrics. " + FILE.format("optimise"),
    **GROUP,
)
app.add_typer(searches, name="optimise")
app.add_typer(searches, name="optimize", hidden=True)
app.add_typer(
    typer.Typer(
        cls=Exports,
        help="Write the system of one case as one FMU, for any tool, or as an SSP. " + FILE.format("export"),
        **GROUP,
    ),
    name="export",
)
app.add_typer(
    typer.Typer(cls=Drawings, help="Draw the system of one case as SVG. " + FILE.format("wiring"), **GROUP),
    name="wiring",
)
app.add_typer(
    typer.Typer(cls=Controllers, help="Identify the controllers of an experiment again from its plant FMU.", **GROUP),
    name="identify",
)


@app.command("list", cls=Command)
def list_experiments() -> None:
    """List the experiments with the options of their runs."""
    if extras.missing("studies"):
        show(Text(first_steps().removeprefix("\b\n"), end=""), as_is=True)
        return
    table = Table("experiment", "title", box=None)
    table.add_column("options", overflow="fold")
    for name in NAMES:
        experiment = load(EXPERIMENTS[name])
        table.add_row(name, Text(experiment.title), Text(_options(run_command(experiment))))
    show(table)


def _options(command: Any) -> str:
    """The options of a command in a line: `--road sine|curb  --speed KM/H  --hold`."""
    terminal.list_choices(command)
    shown = []
    for option in command.params:
        if option.opts[0] not in EVERYWHERE:
            unit = re.search(r"\[([^\]]+)\]", option.help or "")
            value = option.metavar or (unit[1].upper() if unit else "N")
            shown.append(option.opts[0] if option.is_flag else f"{option.opts[0]} {value}")
    return "  ".join(shown)


@app.command(cls=Command)
def fmu(
    file: Annotated[Path, typer.Argument(help=".fmu file of any tool, or the name of an FMU of the catalog")],
    strict: Annotated[bool, typer.Option("--strict", help="reject an FMU that deviates from the FMI standard")] = False,
    limit: Annotated[
        list[str] | None,
        typer.Option(metavar="NAME=NUMBER", help="raise a limit, such as variables=1000000 (repeatable)"),
    ] = None,
    copy: Annotated[
        Path | None, typer.Option(metavar="FOLDER", help="copy the FMU into this folder, and show nothing else")
    ] = None,
    fmi: Annotated[int, typer.Option(min=2, max=3, help="the FMI version that is copied, of a name")] = 3,
) -> None:
    """Show what is in an FMU, ready to wire, and where it deviates from the FMI standard."""
    from cosim.fmu.describe import describe, wiring
    from cosim.fmu.file import FmuFile
    from cosim.fmu.find import find
    from cosim.fmu.limits import Limits

    if copy is not None:
        found = find(file, (fmi,))
        copy.mkdir(parents=True, exist_ok=True)
        show(Text(str(shutil.copy(found, copy / found.name))))
        return
    opened = FmuFile(file, limits=Limits.of(limit or []), quiet=True)
    show(describe(opened))
    if strict:
        opened.require_standard()
    show(Text("\nready to paste:", style="bold"))
    show(Text(wiring(opened), style="green"), as_is=True)


app.command("check", cls=Command)(check_command)


@app.command(cls=Command)
def completion(shell: Annotated[str, typer.Argument(metavar="|".join(SCRIPTS), help="the shell")]) -> None:
    """Print the script that completes commands, options and names in a shell: eval "$(cosim completion bash)"."""
    if shell not in SCRIPTS:
        raise ValueError(unknown("shell", shell, SCRIPTS))
    print(SCRIPTS[shell], end="")


@app.command(cls=Command, hidden=True)
def complete(words: Annotated[list[str] | None, typer.Argument()] = None) -> None:
    """Print what the last word may become: what completion scripts call."""
    for word in fitting(typer.main.get_command(app), words or [""]):
        print(word)


@app.command(cls=Command)
def recover(
    file: Annotated[Path, typer.Argument(help="NAME.csv.part, or the NAME.csv next to it", metavar="FILE")],
    to: Annotated[Path | None, typer.Option(help="write the CSV to this file", metavar="FILE")] = None,
) -> None:
    """Recover the results of a crashed run as a CSV file."""
    from cosim.recording.spool import recover

    path, recording = recover(file, to)
    end = f", up to t = {recording.time[-1]:.9g} s" if len(recording) else ""
    show(Text(f"{path}: {len(recording)} samples of {len(recording.names)} variables{end}"))


@app.command("build", cls=Command, add_help_option=False, context_settings=_ANYTHING)
def build(context: typer.Context) -> None:
    """Build FMUs from the component declarations."""
    from fmu_sources import cli

    cli.main(context.command_path, context.args)


def main(program: str = "cosim") -> None:
    """Entry point; `program` is what it was called as."""
    from cosim.core.errors import CosimError

    failures = (CosimError, ValueError, LookupError, OSError, RuntimeError)
    terminal.run(program, app, failures, "interrupted")
