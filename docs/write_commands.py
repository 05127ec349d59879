"""Write `reference/commands.md` from the command line itself: every command with its options.

python docs/write_commands.py

Names, help texts and defaults are those of `--help`. A test compares the page with the command line.
"""

from __future__ import annotations

import re
import textwrap
from collections.abc import Container, Iterable
from pathlib import Path
from typing import Any

import click

from cosim.cli import app
from fmu_sources import cli

PAGE = Path(__file__).parent / "reference" / "commands.md"
EVERYWHERE = ("--verbose", "--quiet", "--help")
"""Options of all commands, which the page describes once."""
INTRODUCTION = """# Commands

<!-- Written by docs/write_commands.py. -->

`cosim` and `build-fmus` are the short names of `suspension-fmus` and `suspension-fmus build`
([install](../how-to/install.md#names-of-the-commands)). `cosim --version` prints the version. Every command has
`--help`, `-q` (print only results and errors) and `-v` (print the warnings of the FMUs as they run; `-vv`:
everything that the FMUs log).

`NAME` is one of the [experiments](#experiments), a Python file with [your own study](../how-to/studies.md), or
an [SSP file](../how-to/ssp.md)."""
PICTURE = """![Four FMUs with their rates, connected by name](../images/system.svg)

(The picture that `cosim wiring gpc` draws.)"""
LONGEST = 60
"""Characters of an option with its choices; longer lists of choices go into the text."""

Record = tuple[str, str]
"""An option as `--help` shows it, and its help text."""


def commands() -> dict[str, Any]:
    """The commands that are not hidden, by name, as they are called: `cosim run`, `build-fmus`."""
    found = {f"cosim {name}": command for name, command in app.commands.items() if not command.hidden}
    del found["cosim build"]  # which passes its options on
    return {"build-fmus": cli.app, **found}


def records(command: click.Command) -> list[Record]:
    """Arguments and options of a command."""
    context = click.Context(command, show_default=True)
    parameters = [p for p in command.params if not set(p.opts) & set(EVERYWHERE)]
    return [record for p in parameters if (record := p.get_help_record(context)) is not None]


def of_experiments(group: Any) -> dict[str, list[Record]]:
    """The options of a command for each experiment."""
    context = click.Context(group)
    return {name: records(group.get_command(context, name)) for name in group.list_commands(context)}


def common(options: dict[str, list[Record]]) -> list[Record]:
    """The options that a command has for every experiment."""
    first, *others = options.values()
    meanings = [{_meaning(record) for record in other} for other in others]
    return [record for record in first if all(_meaning(record) in other for other in meanings)]


def shared(options: dict[str, list[Record]]) -> dict[Record, list[str]]:
    """Options that several commands have with the same meaning, with the names of these commands."""
    having: dict[Record, list[str]] = {}
    for command, found in options.items():
        for record in found:
            having.setdefault(record, []).append(command)
    return {record: commands for record, commands in having.items() if len(commands) > 1}


def page() -> str:
    """The whole page."""
    found = commands()
    groups = {name: of_experiments(c) for name, c in found.items() if isinstance(c, click.Group)}
    options = {name: common(inside) for name, inside in groups.items()}
    several = shared(options)
    summary = [f"| [`{name}`](#{_anchor(name, groups)}) | {_start(c.help)} |" for name, c in found.items()]
    parts = [INTRODUCTION, "\n".join(["| command | what it does |", "|---|---|", *summary])]
    for name, command in found.items():
        parts.append(f"## {_heading(name, groups)}")
        parts.append(_wrapped(command.help.partition("NAME is")[0]))
        own = [r for r in options[name] if r not in several] if name in groups else records(command)
        parts.append(_list(own))
        if others := [f"`{_name(r)}`" for r, those in several.items() if name in those]:
            parts.append(_wrapped(f"{'Also' if own else 'Options'} ([shared](#shared-options)): {', '.join(others)}."))
        if name == "cosim wiring":
            parts.append(PICTURE)
    parts += ["## Shared options", "These options mean the same in several commands.", _list(several)]
    parts += ["## Experiments", "These options choose the case of an experiment."]
    for name, having in groups["cosim run"].items():
        everywhere = {_meaning(r) for r in options["cosim run"]}
        about = found["cosim run"].get_command(click.Context(found["cosim run"]), name).help
        parts += [f"### {name}", f"{about.partition('. ')[0]}."]
        parts.append(_list(r for r in having if _meaning(r) not in everywhere))
    return "\n\n".join(filter(None, parts)) + "\n"


def _name(record: Record) -> str:
    """The first name of an option."""
    return re.split(r"[ ,]", record[0])[0]


def _meaning(record: Record) -> tuple[str, str]:
    """What makes two options the same: first name and text (one experiment may have an alias less)."""
    return _name(record), record[1]


def _heading(name: str, groups: Container[str]) -> str:
    return f"{name} NAME" if name in groups else name


def _anchor(name: str, groups: Container[str]) -> str:
    return _heading(name, groups).lower().replace(" ", "-")


def _start(text: str) -> str:
    """A help text up to its first full stop or colon."""
    return re.split(r"[.:](?:\s|$)", re.sub(r"\s+", " ", text.strip()), maxsplit=1)[0]


def _list(found: Iterable[Record]) -> str:
    return "\n".join(_item(*record) for record in found)


def _item(names: str, text: str) -> str:
    if len(names) > LONGEST:
        names, _, choices = names.rpartition(" ")
        text = f"{text}; one of {', '.join(f'`{c}`' for c in choices.split('|'))}"
    text = re.sub(r"\[(default: [^]]*)]", r"(\1)", text)  # after a unit in brackets it would be a link
    return _wrapped(f"`{names}`: {text}", "- ")


def _wrapped(text: str, bullet: str = "") -> str:
    return textwrap.fill(
        re.sub(r"\s+", " ", text).strip(),
        120,
        initial_indent=bullet,
        subsequent_indent=" " * len(bullet),
        break_long_words=False,
        break_on_hyphens=False,
    )


if __name__ == "__main__":
    PAGE.write_text(page(), encoding="utf-8")
