"""What is in an FMU, as a table for people and lines ready to paste into a script.

A name in an FMU is a stranger's text: it is printed as text, and gets into code only as a literal.
"""

from __future__ import annotations

import json
import os
import re
from collections.abc import Sequence

from rich.console import Group
from rich.table import Table
from rich.text import Text

from cosim.core.description import RECORDABLE, Clock, Description, Variable, split_index
from cosim.core.errors import FmuError
from cosim.core.time import seconds_text
from cosim.fmu.file import FmuFile
from cosim.fmu.model_exchange import refusal
from cosim.fmu.validation import Finding


def describe(fmu: str | os.PathLike[str] | FmuFile) -> Group:
    """Name, versions, kind, rate, inputs, outputs and parameters of an FMU; print it with rich.

    The lines that add it to a system come from `wiring`; print them as they are. Runs nothing of the FMU, so it works
    for FMUs of other platforms. Raises FmuError.
    """
    fmu = fmu if isinstance(fmu, FmuFile) else FmuFile(fmu, quiet=True)
    about = fmu.description
    facts = Table.grid(padding=(0, 2))
    kind = about.kind or "continuous (not declared by the FMU; kind='discrete' overrides it)"
    step = about.sample_time if about.kind == "discrete" else about.default_step
    rows = {
        "FMU": f"{about.name}  (FMI {about.fmi_version}, {about.tool or 'tool unknown'})",
        "": about.text,
        "kind": kind,
        "step": f"{step} s" if step else "not declared: give step=...",
        "interfaces": _interfaces(about),
        "can": ", ".join(_abilities(fmu)) or "only step forward",
        "clocks": ", ".join(map(_clock, about.clocks)),
        "needs": "the tool that exported it (needsExecutionTool)" if about.needs_tool else "",
        "platforms": ", ".join(fmu.platforms()) or "none",
    }
    for label, text in rows.items():
        if text:
            facts.add_row(Text(label, style="bold"), Text(text))
    parts = [facts]
    for title, variables in (("inputs", about.inputs), ("outputs", about.outputs), ("parameters", about.parameters)):
        if variables:
            parts.append(_variables(title, list(variables.values()), about))
    parts += _terminals(fmu)
    verdict = fmu.verdict
    if verdict.findings:
        parts.append(_findings(f"deviations from FMI {about.fmi_version}", verdict.findings, verdict.more_findings))
    if verdict.quirks:
        parts.append(_findings("known quirks of its tool, harmless", verdict.quirks, verdict.more_quirks))
    return Group(*parts)


def wiring(fmu: str | os.PathLike[str] | FmuFile) -> str:
    """Python lines that put the FMU into a system, one `connect` per input (arrays in one line). Raises FmuError."""
    fmu = fmu if isinstance(fmu, FmuFile) else FmuFile(fmu, quiet=True)
    about = fmu.description
    name = re.sub(r"\W+", "_", about.name.split(".")[-1]).strip("_").lower() or "fmu"
    arguments = [_quoted(name), _quoted(str(fmu.path))]
    step = about.sample_time if about.kind == "discrete" else about.default_step
    arguments.append(f"step={_quoted(str(step) if step else '1 ms')}")
    if about.kind is None:
        arguments.append(f"kind={_quoted('continuous')}")
    inputs = dict.fromkeys(split_index(v.name)[0] for v in about.inputs.values())
    lines = [f"system.add({', '.join(arguments)})"]
    lines += [f"system.connect({_quoted(f'OTHER.{i}')}, {_quoted(f'{name}.{i}')})" for i in inputs]
    outputs = list(dict.fromkeys(split_index(v.name)[0] for v in about.outputs.values() if v.type in RECORDABLE))
    listed = ", ".join(_quoted(f"{name}.{o}") for o in outputs[:4])
    lines.append(f"recording = system.run(5.0, record=[{listed}])")
    return "\n".join(lines)


def _interfaces(about: Description) -> str:
    """What it offers, and how the master runs it."""
    if not about.model_exchange:
        return "Co-Simulation"
    if about.interface == "cs":
        return 'Co-Simulation, Model Exchange (interface="me")'
    why = refusal(about)
    states = f"{len(about.states)} states and {about.event_indicators} event indicators"
    how = f"the master cannot integrate it: {why}" if why else f"the master integrates its {states}"
    return f"{'Co-Simulation, ' if about.co_simulation else ''}Model Exchange: {how}"


def _clock(clock: Clock) -> str:
    every = "" if clock.interval is None else f", every {seconds_text(clock.interval)}"
    return f"{clock.name} ({clock.causality}, {clock.kind}{every})"


def _quoted(text: str) -> str:
    """A Python literal of it, in double quotes where they do."""
    return json.dumps(text, ensure_ascii=False) if text.isprintable() else repr(text)


def _abilities(fmu: FmuFile) -> list[str]:
    about = fmu.description
    offered = {
        "save and restore its state": about.can_save,
        "serialize it": about.can_serialize,
        "directional derivatives": about.directional_derivatives,
        "steps of any length": about.variable_step,
        "several instances": not about.only_once,
    }
    return [text for text, there in offered.items() if there]


def _variables(title: str, variables: Sequence[Variable], about: Description) -> Table:
    table = Table(title=f"{title} ({len(variables)})", title_justify="left", title_style="bold", box=None)
    sourced = any(v.source for v in variables)
    for column in ("name", "unit", "start", "range", "type", "description", *(("source",) if sourced else ())):
        table.add_column(column, overflow="fold", justify="right" if column == "start" else "left")
    groups: dict[str, list[Variable]] = {}
    for variable in variables:
        groups.setdefault(split_index(variable.name)[0], []).append(variable)
    for base, elements in groups.items():
        first = elements[0]
        start = "" if first.start is None else f"{first.start:g}" if first.type == "real" else str(first.start)
        name = first.name if len(elements) == 1 else f"{base}{_span(elements)}"
        if len(elements) > 1 and len({v.start for v in elements}) > 1:
            start = "..."
        low, high = first.minimum, first.maximum
        limits = (
            "" if low is None and high is None else f"{'' if low is None else low:} .. {'' if high is None else high}"
        )
        if first.must_equal is not None:
            limits = f"{first.must_equal:g} or 0"
        further = [a for a, declared in about.aliases.items() if declared == first.declared]
        text = "; ".join(x for x in (first.description, f"also {', '.join(further)}" if further else "") if x)
        source = (first.source or "",) if sourced else ()
        table.add_row(*map(Text, (name, first.unit_name, start, limits, first.fmi_type, text, *source)))
    return table


def _terminals(fmu: FmuFile) -> list[Table]:
    """What belongs together, if it says so: a row per terminal, those in others after these."""
    try:
        found = [t for terminal in fmu.terminals for t in terminal.all() if t.members or t.streams]
    except FmuError as error:
        table = Table(title="terminals", title_justify="left", title_style="bold", box=None)
        table.add_row(Text(f"invalid: {error}"))
        return [table]
    if not found:
        return []
    table = Table(title=f"terminals ({len(found)})", title_justify="left", title_style="bold", box=None)
    for column in ("name", "rule", "members"):
        table.add_column(column, overflow="fold")
    for terminal in found:
        streams = [m for s in terminal.streams for m in (s.entering, s.leaving)]
        names = [m.name or m.variables[0] for m in (*terminal.members, *streams)]
        shown = names if len(names) <= 8 else [*names[:3], "...", names[-1]]
        kind = f", {terminal.kind}" if terminal.kind else ""
        table.add_row(*map(Text, (terminal.path, terminal.rule + kind, "  ".join(shown))))
    return [table]


def _findings(title: str, findings: Sequence[Finding], more: int) -> Table:
    table = Table(title=f"{title} ({len(findings) + more})", title_justify="left", title_style="bold", box=None)
    table.add_column("line", justify="right")
    table.add_column("finding", overflow="fold")
    quirks = any(f.quirk for f in findings)
    if quirks:
        table.add_column("why it is harmless", overflow="fold")
    for finding in findings:
        table.add_row(*map(Text, (str(finding.line), finding.text, *((finding.quirk,) if quirks else ()))))
    if more:
        table.add_row("", Text(f"and {more} more"))
    return table


def _span(elements: Sequence[Variable]) -> str:
    first, last = (split_index(v.name)[1] for v in (elements[0], elements[-1]))
    return "[" + ",".join(f"{a}..{b}" for a, b in zip(first, last, strict=True)) + "]"
