"""Commands of an experiment that show the system of a case: `export` and `wiring`."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import click
from rich.text import Text

from build_fmus.base import safe_files
from build_fmus.base.terminal import PATH, Command, Names, console, show
from build_fmus.compile import PLATFORMS
from cosim import System
from cosim.core.errors import CosimError
from cosim.study.experiment import Experiment
from cosim.study.options import case_of, case_options, command, fmu_options, fmu_set
from cosim.study.runner import Runner

EXPORT = (
    click.Option(["--fmu"], type=PATH, metavar="FILE", help="write the system as this FMU, NAME.fmu"),
    click.Option(
        ["--web"], type=PATH, metavar="FILE", help="write a web page, NAME.html, in which the system runs live"
    ),
    click.Option(
        ["--beside"],
        multiple=True,
        metavar="OPTION=VALUE,...",
        help="show another system on the page: the same case with these options changed (repeatable)",
    ),
    click.Option(
        ["--ssp"], type=PATH, metavar="FILE", help="write the FMUs and their connections as this SSP, NAME.ssp"
    ),
    click.Option(
        ["--ssp-version"],
        type=Names(("1.0", "2.0")),
        default="1.0",
        help="choose the SSP version; 1.0 contains FMI 2.0 FMUs, 2.0 FMI 3.0 FMUs",
    ),
    click.Option(
        ["--input", "inputs"],
        multiple=True,
        metavar="NAME",
        help="make this variable, COMPONENT.VARIABLE or a pattern, an input of the exported system (default: FMU: all"
        " unconnected inputs, SSP: none) (repeatable)",
    ),
    click.Option(
        ["--output", "outputs"],
        multiple=True,
        metavar="NAME",
        help="make this variable an output (default: all outputs) (repeatable)",
    ),
    click.Option(
        ["--without"],
        multiple=True,
        metavar="COMPONENT",
        help="leave this component out; the inputs that it drove become inputs of the system (repeatable)",
    ),
    click.Option(
        ["--platform"],
        type=Names(("host", "all", *PLATFORMS)),
        default="host",
        help="build binaries for these platforms, separated by commas",
    ),
)
PICTURE = (
    click.Option(["--svg"], type=PATH, metavar="FILE", help="write the picture to this file (default: NAME.svg)"),
    click.Option(["--title"], help="set the heading of the picture; '' for none"),
)


def export_command(experiment: Experiment) -> Command:
    """The command that writes the system of one case as an FMU or as an SSP."""

    def export(**given: Any) -> None:
        case = case_of(experiment, given)
        text = f"{experiment.title}: {case.label}" if experiment.title else ""
        if sum(given[target] is not None for target in ("fmu", "ssp", "web")) != 1:
            raise CosimError("give one target: --fmu NAME.fmu, --ssp NAME.ssp or --web NAME.html")
        if given["web"] is not None:
            _export_web(experiment, case, given)
            return
        if given["beside"]:
            raise CosimError("--beside needs a page: add --web NAME.html")
        with Runner(experiment, fmu_set(experiment, given)) as runner:
            system = runner.system(case)
            if given["ssp"] is not None:
                _export_ssp(system, given, text, experiment.run.end(system, case))
                return
            path = system.export_fmu(
                given["fmu"],
                inputs=given["inputs"] or None,
                outputs=given["outputs"] or None,
                without=given["without"],
                fmi=given["fmi"],
                platforms=given["platform"],
                text=text,
            )
        console.print(f"{path}, FMI {given['fmi']}.0; cosim fmu {path} shows its contents")

    return command(
        experiment,
        export,
        "Export the system of one case: as one FMU that contains all components, as an SSP (the FMUs and their"
        " connections), or as a web page in which it runs.",
        {"Case": case_options(experiment, beside=EXPORT), "Export": EXPORT, "FMUs": fmu_options(experiment)},
    )


def _export_web(experiment: Experiment, case: Any, given: Mapping[str, Any]) -> None:
    from cosim.study.web import write_web

    for option, name in (("inputs", "--input"), ("outputs", "--output"), ("without", "--without")):
        if given[option]:
            raise CosimError(f"{name} applies to --fmu only: a page has all inputs and outputs")
    if given["fmi"] != 3:
        raise CosimError("--web is for FMI 3.0 only: leave --fmi out")
    path = write_web(experiment, fmu_set(experiment, given), given["web"], case, given["beside"])
    console.print(f"{path}, {path.stat().st_size / 1e6:.1f} MB: open it in a browser; it needs no server")


def _export_ssp(system: System, given: Mapping[str, Any], text: str, stop_time: float) -> None:
    for option, name in (("outputs", "--output"), ("without", "--without")):
        if given[option]:
            raise CosimError(f"{name} applies to --fmu only: in an SSP every component has all its outputs")
    path = system.export_ssp(
        given["ssp"], version=given["ssp_version"], inputs=given["inputs"], stop_time=stop_time, text=text
    )
    console.print(f"{path}, SSP {given['ssp_version']}; cosim wiring {path} draws it, cosim run {path} runs it")


def wiring_command(experiment: Experiment) -> Command:
    """The command that draws the system of one case."""

    def wiring(**given: Any) -> None:
        case = case_of(experiment, given)
        path = given["svg"] or Path(f"{experiment.name}.svg")
        if path.suffix.lower() in (".png", ".jpg", ".jpeg", ".pdf"):
            raise CosimError(f"--svg {path}: the picture is SVG; name the file {path.with_suffix('.svg').name}")
        with Runner(experiment, fmu_set(experiment, given)) as runner:
            system = runner.system(case)
            safe_files.write(path, system.draw(experiment.title if given["title"] is None else given["title"]))
            show(Text(str(system.schedule())))
        console.print(f"{path}")

    return command(
        experiment,
        wiring,
        "Draw the system of one case: its components with their rates, and a line for each bundle of signals.",
        {"Case": case_options(experiment), "Picture": PICTURE, "FMUs": fmu_options(experiment)},
    )
