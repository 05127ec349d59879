"""The command of an experiment that tells the error of the exchange in the run of a case: `error`."""

from __future__ import annotations

from typing import Any

import click
from rich.text import Text

from build_fmus.base.checks import number
from build_fmus.base.terminal import Command, show
from cosim.study.commands import progress_bar
from cosim.study.experiment import Experiment
from cosim.study.options import EXECUTION, case_of, case_options, command, execution, fmu_options, fmu_set
from cosim.study.runner import Runner

ERROR = (
    click.Option(
        ["--variable", "variables"],
        multiple=True,
        metavar="NAME",
        help="tell the error of this variable, such as car.body.az, or of those that fit a pattern (default: all that"
        " the experiment records) (repeatable)",
    ),
    click.Option(["--tolerance"], type=float, default=1e-3, help="advise steps for this relative error"),
    click.Option(
        ["--contributions/--no-contributions"],
        default=True,
        help="also run once for each coupling of two components, to tell what it contributes",
    ),
)


def error_command(experiment: Experiment) -> Command:
    """The command that estimates the error of the exchange for one case."""

    def error(**given: Any) -> None:
        tolerance = number("--tolerance", given["tolerance"], above=0.0, most=1.0)
        case, how = case_of(experiment, given), execution(given)
        with Runner(experiment, fmu_set(experiment, given), execution=how) as runner:
            runner.system(case).select(given["variables"])  # refused before there is a progress bar
            with progress_bar("runs") as progress:
                found = runner.exchange_error(
                    case, given["variables"], contributions=given["contributions"], progress=progress
                )
        show(Text(found.table(tolerance)), as_is=True)

    return command(
        experiment,
        error,
        "Estimate the error of the exchange in the run of one case, from runs with smaller communication steps: by"
        " variable, with its order, the error of the solvers and the coupling that contributes most.",
        {
            "Case": case_options(experiment, beside=ERROR),
            "Error": ERROR,
            "FMUs": fmu_options(experiment),
            "How it runs": EXECUTION,
        },
    )
