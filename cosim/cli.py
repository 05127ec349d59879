"""Command line `suspension-fmus`, in short `cosim`.

It runs experiments and studies, identifies control laws, inspects FMUs and builds them.
"""

from __future__ import annotations

import functools
import re
import shutil
from collections.abc import Callable
from pathlib import Path

import click
from click.shell_completion import CompletionItem, get_completion_class
from rich.table import Table
from rich.text import Text

from build_fmus.base import extras, terminal
from build_fmus.base.checks import unknown
from build_fmus.base.terminal import PATH, SETTINGS, Command, Commands, Names, show, version_option
from cosim.check.command import check_command
from cosim.experiments import EXPERIMENTS, IDENTIFY
from cosim.study.commands import run_command, study_command
from cosim.study.error_command import error_command
from cosim.study.experiment import Experiment, resolved
from cosim.study.export_command import export_command, wiring_command
from cosim.study.loading import load
from cosim.study.sweep_command import sweep_command

NAMES = sorted(EXPERIMENTS)
"""Names of our experiments."""
PROGRAMS = ("cosim", "suspension-fmus")
SHELLS = ("bash", "zsh", "fish")


class Experiments(Commands):
    """A group with one command per experiment, created when called: our experiments by name, a user's by its file."""

    what = "experiment"
    beside = "; or a file of yours, as my_experiment.py or Any.ssp"

    def __init__(self, name: str, make: Callable[[Experiment], Command], help: str, *, hidden: bool = False) -> None:
        called = f"NAME is a built-in experiment or your own file: cosim {name} my_experiment.py, cosim {name} Any.ssp"
        super().__init__(name, help=f"{help} {called}", hidden=hidden)
        self.make = make

    def list_commands(self, ctx: click.Context) -> list[str]:  # noqa: ARG002
        return [] if extras.missing("studies") else NAMES

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:  # noqa: ARG002
        if cmd_name in NAMES:
            extras.require("studies", f"the experiment {cmd_name}")
        if cmd_name in EXPERIMENTS or cmd_name.endswith((".py", ".ssp")):
            return self.make(load(EXPERIMENTS.get(cmd_name, cmd_name)))
        return None

    def refusal(self, ctx: click.Context, name: str) -> str:  # noqa: ARG002
        needed = f", which need {extras.named('studies')}" if extras.missing("studies") else ""
        return unknown(self.what, name, NAMES) + needed

    def shell_complete(self, ctx: click.Context, incomplete: str) -> list[CompletionItem]:
        """Names, without loading the experiments, or files."""
        if incomplete.startswith("-"):
            return super().shell_complete(ctx, incomplete)
        return terminal.completions(self.list_commands(ctx), incomplete, files=True)


class Controllers(Commands):
    """One command per experiment whose controllers are identified."""

    def list_commands(self, ctx: click.Context) -> list[str]:  # noqa: ARG002
        return list(IDENTIFY)

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:  # noqa: ARG002
        return resolved(IDENTIFY.get(cmd_name))  # type: ignore[no-any-return]


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


@click.group(cls=Commands, epilog=first_steps(), context_settings=SETTINGS)
@version_option
def app() -> None:
    """Co-simulate FMUs: reproduce published experiments, run your own, and inspect FMUs of any tool."""


@app.command("list")
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


def _options(command: Command) -> str:
    """The options of the cases of a command in a line: `--road sine|curb  --speed KM/H  --hold`."""
    shown = []
    for option in command.groups["Case"]:
        assert isinstance(option, click.Option)
        unit = re.search(r"\[([^\]]+)\]", option.help or "")
        value = unit[1].upper() if unit else "N"
        if isinstance(option.type, Names):
            value = option.make_metavar(click.Context(command))
        shown.append(option.opts[0] if option.is_flag else f"{option.opts[0]} {value}")
    return "  ".join(shown)


@app.command()
@click.argument("file", type=PATH, help=".fmu file of any tool, or the name of an FMU of the catalog")
@click.option("--strict", is_flag=True, help="reject an FMU that deviates from the FMI standard")
@click.option(
    "--limit", multiple=True, metavar="NAME=NUMBER", help="raise a limit, such as variables=1000000 (repeatable)"
)
@click.option("--copy", type=PATH, metavar="FOLDER", help="copy the FMU into this folder, and show nothing else")
@click.option("--fmi", type=click.IntRange(2, 3), default=3, help="the FMI version that is copied, of a name")
@click.option("--step-derivatives", is_flag=True, help="the copy also carries derivatives of its step, for C programs")
def fmu(file: Path, strict: bool, limit: tuple[str, ...], copy: Path | None, fmi: int, step_derivatives: bool) -> None:
    """Show what is in an FMU, ready to wire, and where it deviates from the FMI standard."""
    from cosim.fmu.describe import describe, wiring
    from cosim.fmu.file import FmuFile
    from cosim.fmu.find import find
    from cosim.fmu.limits import Limits

    if copy is not None:
        found = find(file, (fmi,))
        copy.mkdir(parents=True, exist_ok=True)
        to = copy / found.name
        if step_derivatives:
            from cosim.gradient.step import copy_with_step_derivatives

            copy_with_step_derivatives(found, to)
        else:
            shutil.copy(found, to)
        show(Text(str(to)))
        return
    if step_derivatives:
        raise ValueError("--step-derivatives is for a copy: give --copy FOLDER")
    opened = FmuFile(file, limits=Limits.of(limit), quiet=True)
    show(describe(opened))
    if strict:
        opened.require_standard()
    show(Text("\nready to paste:", style="bold"))
    show(Text(wiring(opened), style="green"), as_is=True)


app.add_command(check_command)


@app.command()
@click.argument("shell", metavar="|".join(SHELLS), help="the shell")
def completion(shell: str) -> None:
    """Print the script that completes commands, options and names in a shell: eval "$(cosim completion bash)"."""
    made = get_completion_class(shell)
    if made is None:
        raise ValueError(unknown("shell", shell, SHELLS))
    for program in PROGRAMS:
        print(made(app, {}, program, f"_{program.replace('-', '_')}_COMPLETE".upper()).source())


@app.command()
@click.argument("file", type=PATH, metavar="FILE", help="NAME.csv.part, or the NAME.csv next to it")
@click.option("--to", type=PATH, metavar="FILE", help="write the CSV to this file")
def recover(file: Path, to: Path | None) -> None:
    """Recover the results of a crashed run as a CSV file."""
    from cosim.recording.spool import recover

    path, recording = recover(file, to)
    end = f", up to t = {recording.time[-1]:.9g} s" if len(recording) else ""
    show(Text(f"{path}: {len(recording)} samples of {len(recording.names)} variables{end}"))


# the other command reads the arguments
@app.command(add_help_option=False, context_settings={"allow_extra_args": True, "ignore_unknown_options": True})
@click.pass_context
def build(context: click.Context) -> None:
    """Build FMUs from the component declarations."""
    from fmu_sources import cli

    cli.main(context.command_path, context.args)


def optimise_command(experiment: Experiment) -> Command:
    """The command that searches for parameters of an experiment; its module is imported when it is called."""
    from cosim.study import optimise_command as module

    return module.optimise_command(experiment)


SEARCH = "Search for parameters of an experiment that minimize or maximize metrics."
for group in (
    Experiments("run", run_command, "Run one case of an experiment."),
    Experiments("study", study_command, "Run a whole study and write its report."),
    Experiments("sweep", sweep_command, "Run an experiment over a design of its parameters."),
    Experiments("optimise", optimise_command, SEARCH),
    Experiments("optimize", optimise_command, SEARCH, hidden=True),
    Experiments("export", export_command, "Write the system of one case as one FMU, for any tool, or as an SSP."),
    Experiments("error", error_command, "Estimate the error of the exchange in the run of one case."),
    Experiments("wiring", wiring_command, "Draw the system of one case as SVG."),
    Controllers("identify", help="Identify the controllers of an experiment again from its plant FMU."),
):
    app.add_command(group)


def main(program: str = "cosim") -> None:
    """Entry point; `program` is what it was called as."""
    from cosim.core.errors import CosimError

    failures = (CosimError, ValueError, LookupError, OSError, RuntimeError)
    terminal.run(program, functools.partial(app, prog_name=program), failures, "interrupted")
