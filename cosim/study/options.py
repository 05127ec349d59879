"""Options of the commands of experiments: one from each field of a case, and those that several commands have."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

import click

from build_fmus.base.checks import number
from build_fmus.base.layout import FMUS
from build_fmus.base.terminal import PATH, Command, Names
from cosim import Execution
from cosim.core.errors import CosimError
from cosim.study.case import Field, fields
from cosim.study.experiment import Experiment, resolved
from cosim.study.fmus import FmuSet

FMU_FILES = (
    click.Option(["--fmus"], type=PATH, default=FMUS, help="directory that contains the FMUs (see build-fmus)"),
    click.Option(["--fmi"], type=click.IntRange(2, 3), default=3, metavar="2|3", help="FMI version of the FMUs"),
)
VEHICLE = click.Option(
    ["--vehicle"],
    type=PATH,
    multiple=True,
    metavar="FILE",
    help="use the FMUs that `build-fmus --vehicle` built from this vehicle, actuator or sensors file (repeatable)",
)
OUT = click.Option(["--out"], type=PATH, default=Path("results"), help="write results to this directory")
EXECUTION = (
    click.Option(
        ["--isolate"],
        multiple=True,
        metavar="COMPONENT",
        help="run the FMU of this component, or of all that fit a pattern such as '*', in its own process (repeatable)",
    ),
    click.Option(
        ["--step-timeout"], type=float, metavar="S", help="limit the wall time of one call of an isolated FMU [s]"
    ),
    click.Option(["--memory-limit"], type=float, metavar="MB", help="limit the memory of an isolated FMU [MB]"),
)
MANY_RUNS = (
    click.Option(["--processes"], type=click.IntRange(min=1), help="number of worker processes (default: all cores)"),
    click.Option(
        ["--dask"],
        metavar="ADDRESS|local",
        help="run on the Dask cluster whose scheduler has this address, such as tcp://HOST:8786; local: start a cluster"
        " on this machine",
    ),
    click.Option(["--force"], is_flag=True, help="discard stored runs and run everything again"),
)
_CASE = "case_"  # begins the names of values of cases, so that other options may be called like a field
RETRY = click.Option(["--retry-failed"], is_flag=True, help="run failed runs again")


def command(
    experiment: Experiment, function: Callable[..., None], help: str, groups: Mapping[str, Sequence[click.Option]]
) -> Command:
    """A command of an experiment: `function` gets the values of the options by name."""
    about = f"{experiment.title}. {help}" if experiment.title else help
    return Command(experiment.name, callback=function, help=about, groups=groups)


def case_options(
    experiment: Experiment, *, beside: Iterable[click.Option] = (), repeatable: bool = False
) -> list[click.Option]:
    """One option for each field of an experiment's cases; not where an option `beside` has its name."""
    taken = {name for option in beside for name in option.opts}
    found = [_option(f, repeatable) for f in fields(experiment.case)]
    return [option for option in found if not taken & {*option.opts}]


def _option(f: Field, repeatable: bool) -> click.Option:
    """The option of a field. Ranges and choices are checked by the case, whose messages say more."""
    about = f.option
    more = f"FILE{about.files}" if about.files else ""
    names = [f"--{n}" for n in (f.name, *about.aliases)]
    if f.type is bool and f.default:
        names = [f"--{f.name}/--no-{f.name}"]
    return click.Option(
        [*names, _CASE + f.attribute],
        type=f.type if about.choices is None else Names(about.choices, more, f.type),
        is_flag=f.type is bool,
        default=None if repeatable else f.default,
        multiple=repeatable,
        help=f"{about.help} [{about.unit}]" if about.unit else about.help,
    )


def case_values(given: Mapping[str, Any]) -> dict[str, Any]:
    """What the options of `case_options` give, by attribute of the case."""
    return {name.removeprefix(_CASE): value for name, value in given.items() if name.startswith(_CASE)}


def case_of(experiment: Experiment, given: Mapping[str, Any]) -> Any:
    """The case of the options; fields without an option have their default."""
    return experiment.case(**case_values(given))


def fmu_options(experiment: Experiment) -> list[click.Option]:
    """Options of the FMUs, with files of the user's where the experiment takes such."""
    return [*([VEHICLE] if experiment.wiring.own_fmus is not None else []), *FMU_FILES]


def fmu_set(experiment: Experiment, given: Mapping[str, Any]) -> FmuSet:
    """The FMUs of an experiment, with those of a user's files."""
    make = resolved(experiment.wiring.own_fmus)
    if not experiment.wiring.takes_fmus and given["fmus"] != FMUS:
        raise CosimError(f"--fmus has no effect on {experiment.module}, which says where its FMUs are: leave it out")
    if make is None:
        return FmuSet(given["fmus"], given["fmi"])
    case = case_of(experiment, given) if case_values(given) else None
    found: FmuSet = make(experiment.name, given["fmus"], given["fmi"], given["vehicle"], case)
    return found


def execution(given: Mapping[str, Any]) -> Execution:
    """How FMUs are run, of the options `EXECUTION`."""
    timeout, limit = given["step_timeout"], given["memory_limit"]
    if timeout is not None:
        number("--step-timeout", timeout, "s", above=0.0, error=CosimError)
    if limit is not None:
        number("--memory-limit", limit, "MB", least=1.0, error=CosimError)
    if not given["isolate"] and (limit is not None or timeout is not None):
        raise CosimError("--step-timeout and --memory-limit apply to isolated FMUs only: choose these with --isolate")
    return Execution(given["isolate"], timeout, None if limit is None else int(limit * 1e6))
