"""Write ``fmus.md``, the reference of every FMU of the catalog, from the FMUs themselves.

build-fmus
python docs/write_fmus.py
"""

from __future__ import annotations

import re
from collections.abc import Iterable
from pathlib import Path

from build_fmus import safe_files
from cosim import Fmu, Variable
from fmu_sources.catalog import PAPERS, default_catalog

HERE = Path(__file__).parent
_HEAD = """# FMU reference

Every FMU of the catalog with its variables, written by `docs/write_fmus.py` from the FMUs themselves; do not edit. FMI 2.0
and 3.0 have the same variables. Corners are `fl fr rl rr`, axes ISO 8855, units SI. `name[1..8]` stands for
`name[1]` to `name[8]`. Numbers of papers in sources:

"""


def reference(fmus: Path) -> str:
    """The whole page; ``fmus`` is the folder with ``fmi3/``."""
    parts = [_HEAD + "".join(f"- {number}: {title}\n" for number, title in sorted(PAPERS.items()))]
    for name, entry in default_catalog().items():
        about = Fmu(fmus / "fmi3" / f"{name}.fmu").description
        kind = about.kind or "continuous"
        step = about.sample_time if kind == "discrete" else about.default_step
        rate = f"{'sample time' if kind == 'discrete' else 'proposed communication step'} {float(step or 0):g} s"
        parts += [f"## {name}\n", f"{about.text}\n", f"{kind.capitalize()}, {rate}. Catalog: {entry.summary}.\n"]
        for title, variables in (
            ("inputs", about.inputs),
            ("outputs", about.outputs),
            ("parameters", about.parameters),
        ):
            if variables:
                parts.append(_table(title, variables.values()))
    return "\n".join(parts)


def _table(title: str, variables: Iterable[Variable]) -> str:
    groups: dict[tuple[str, str, str], list[Variable]] = {}
    for v in variables:
        groups.setdefault((re.sub(r"\[[\d,]+\]$", "[]", v.name), v.unit_name, v.description), []).append(v)
    parameters = title == "parameters"
    head = [title, "unit", *(("start", "description", "source") if parameters else ("description",))]
    lines = [f"| {' | '.join(head)} |", f"|{'---|' * len(head)}"]
    for (name, unit, description), elements in groups.items():
        cells = [f"`{_spanned(name, elements)}`", unit, description + _limits(elements[0])]
        if parameters:
            cells.insert(2, _start(elements))
            cells.append(elements[0].source or "")
        lines.append(f"| {' | '.join(cells)} |")
    return "\n".join(lines) + "\n"


def _limits(v: Variable) -> str:
    """What values an input takes."""
    if v.causality != "input" or v.type == "boolean":
        return ""
    if v.must_equal is not None:
        return f"; must equal {v.must_equal:.6g}, 0 for none"
    if v.minimum is None and v.maximum is None:
        return ""
    low = "(-∞" if v.minimum is None else f"[{v.minimum:.6g}"
    high = "∞)" if v.maximum is None else f"{v.maximum:.6g}]"
    return f"; {'clipped to' if v.type == 'real' else 'within'} {low}, {high}"


def _spanned(name: str, elements: list[Variable]) -> str:
    if not name.endswith("[]"):
        return name
    last = re.search(r"\[([\d,]+)\]$", elements[-1].name)
    assert last is not None
    return f"{name[:-2]}[{','.join(f'1..{n}' for n in last[1].split(','))}]"


def _start(elements: list[Variable]) -> str:
    """Arrays are not shown: they are long, and identified gains differ in the last digits between machines."""
    if len(elements) > 1:
        return "several"
    value = elements[0].start
    return f"{value:g}" if isinstance(value, float) else str(value).lower()


if __name__ == "__main__":
    safe_files.write(HERE / "fmus.md", reference(HERE.parent / "fmus"))
