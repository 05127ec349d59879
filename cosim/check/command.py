"""The command `cosim check`: tables on the screen, files for others, and an exit code."""

from __future__ import annotations

import sys
from contextlib import nullcontext
from pathlib import Path
from typing import Any

import click
from rich.table import Table
from rich.text import Text

from build_fmus.base import extras, safe_files
from build_fmus.base.terminal import PATH, Command, Names, console, show
from cosim.check.report import UNCHECKED, Report, section, to_json, to_junit
from cosim.check.rules import SEVERITIES
from cosim.check.runner import Options, Unchecked, Workers, check, ordered
from cosim.core.errors import CosimError
from cosim.fmu.limits import Limits

_COLORS = {
    "error": "bold red",
    "warning": "yellow",
    "note": "cyan",
    "passed": "green",
    "not applicable": "dim",
    "not judged": "yellow",
}


@click.command("check", cls=Command)
@click.argument("files", nargs=-1, type=PATH, metavar="FILE.fmu ...", help="FMU files to check")
@click.option(
    "--only",
    multiple=True,
    metavar="CHECK",
    help="run only this check, group or pattern, such as 'runs.*' (repeatable)",
)
@click.option("--skip", multiple=True, metavar="CHECK", help="skip this check, group or pattern (repeatable)")
@click.option("--interface", type=Names(("cs", "me")), help="check only Co-Simulation or Model Exchange")
@click.option("--fmi", type=Names(("2", "3")), help="require this FMI version")
@click.option("--strict", is_flag=True, help="treat warnings as errors")
@click.option("--all", "every", is_flag=True, help="show every check, including those that passed or do not apply")
@click.option("--junit", type=PATH, metavar="FILE", help="write JUnit XML, for CI")
@click.option("--html", type=PATH, metavar="FILE", help="write an HTML page")
@click.option("--json", type=PATH, metavar="FILE", help="write all results as JSON")
@click.option("--timeout", type=float, default=20.0, metavar="SECONDS", help="limit the time of one check [s]")
@click.option(
    "--memory-limit",
    type=float,
    metavar="MB",
    help="limit the memory of one check [MB] (default: half of the machine's)",
)
@click.option(
    "--limit", multiple=True, metavar="NAME=NUMBER", help="raise a limit, such as variables=1000000 (repeatable)"
)
@click.option("--list", "list_", is_flag=True, help="list the checks and stop")
def check_command(list_: bool, **given: Any) -> None:
    """Check whether an FMU conforms to the FMI standard: its description and its behavior.

    The exit code is 0 without errors, 1 with errors, 2 when the FMU could not be checked.
    """
    if list_:
        table = Table("check", "requirement", "worst", box=None)
        for c in ordered():
            table.add_row(c.id, Text(c.title), Text(c.worst, style=_COLORS[c.worst]))
        show(table)
        return
    try:
        code = _checked(**given)
    except CosimError as error:
        console.print(Text(f"cosim check: {error}", style="red"))
        code = UNCHECKED
    sys.exit(code)


def _checked(files, only, skip, interface, fmi, strict, every, junit, html, json, timeout, memory_limit, limit) -> int:  # type: ignore[no-untyped-def]
    if not files:
        raise Unchecked("give an FMU: cosim check FILE.fmu")
    for name, value, choices in (("--interface", interface, ("cs", "me")), ("--fmi", fmi, ("2", "3"))):
        if value is not None and value not in choices:
            raise Unchecked(f"{name} is {value!r}; it is {' or '.join(choices)}")
    if not timeout > 0:
        raise Unchecked(f"--timeout is {timeout:g} s; it must be above 0")
    if memory_limit is not None and not memory_limit >= 1:
        raise Unchecked(f"--memory-limit is {memory_limit:g} MB; it must be at least 1")
    if html:
        extras.require("reports", extras.WRITING)
    options = Options(
        only=only,
        skip=skip,
        kinds=(interface,) if interface else ("cs", "me"),
        fmi=fmi,
        seconds=timeout,
        memory=None if memory_limit is None else int(memory_limit * 1e6),
        limits=Limits.of(limit),
    )
    options.chosen()
    reports: list[Report] = []
    code = 0
    with Workers() as workers:
        for file in files:
            with console.status("") if sys.stderr.isatty() else nullcontext() as status:

                def progress(what: str, done: int, of: int, file: Path = file, status=status) -> None:  # type: ignore[no-untyped-def]
                    if status is not None:
                        status.update(f"{file.name}: {what} ({done + 1} of {of})")

                try:
                    report = check(file, options, workers=workers, progress=progress)
                except Unchecked as error:
                    console.print(Text(f"cosim check: {error}", style="red"))
                    code = code or UNCHECKED
                    continue
            _show(report, every)
            reports.append(report)
    ends = [r.exit_code(strict) for r in reports]
    for path, content in (
        (junit, lambda: to_junit(reports, strict).decode()),
        (json, lambda: to_json(reports)),
        (html, lambda: _page(reports)),
    ):
        if path is not None:
            safe_files.write(path, content())
    return 1 if 1 in ends else code or max(ends, default=UNCHECKED)


def _page(reports: list[Report]) -> str:
    from cosim.check.page import to_html

    return to_html(reports)


def _show(report: Report, every: bool) -> None:
    """The table of one FMU."""
    title = Text(f"{report.path.name}", style="bold")
    title.append(
        f"  {report.name}, FMI {report.fmi}, {' and '.join(report.interfaces) or 'no interface'}", style="not bold"
    )
    if report.tool:
        title.append(f", made by {report.tool}", style="not bold")
    show(title)
    if report.layered:
        show(Text(f"  layered standards: {', '.join(report.layered)}"))
    if report.not_run:
        show(Text(f"  not run: {report.not_run}", style="yellow"))
    table = Table("", "check", "finding", box=None, padding=(0, 1))
    table.columns[2].overflow = "fold"
    for result, finding in report.findings():
        text = Text(str(finding))
        text.append(f"\n{section(result, report)}. {result.check.advice}", style="dim")
        table.add_row(Text(finding.severity, style=_COLORS[finding.severity]), result.name, text)
    for result in report.results:
        if result.verdict not in SEVERITIES and (every or result.verdict == "not judged"):
            table.add_row(
                Text(result.verdict, style=_COLORS[result.verdict]),
                result.name,
                Text(result.inapplicable or result.check.title),
            )
    for result in report.results:
        if result.more:
            table.add_row("", result.name, Text(f"and {result.more} more"))
    if table.row_count:
        show(table)
    for name, value in report.measures.items() if every else ():
        show(Text(f"  {name}: {value}", style="dim"))
    for failure in report.failures:
        show(Text(f"  internal error of cosim check, please report it: {failure}", style="red"))
    show(Text(f"  {report.summary()} ({report.seconds:.1f} s)"))
