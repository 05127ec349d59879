"""Write `reference/fmus.md`, the list of the FMUs of the catalog, from the FMUs themselves.

Writes `cosim/fmu/published.toml` too, the names by which the master finds built FMUs.

build-fmus python docs/write_fmus.py

Their variables are in pages that are made of the FMUs where they are read: the documentation inside each FMU, the site
(`write_site.py`), the release's `docs/reference/fmus.md`.
"""

from __future__ import annotations

import re
import textwrap
from collections.abc import Callable, Iterable
from pathlib import Path

from build_fmus.base import safe_files
from build_fmus.base.layout import FMUS
from cosim import Fmu, Variable
from cosim.fmu.find import PUBLISHED
from cosim.fmu.model_description import Description
from fmu_sources.catalog import PAPERS, default_catalog

HERE = Path(__file__).parent
_HEAD = """# FMU reference

<!-- Written by docs/write_fmus.py. -->

{contents} FMUs have the same variables in FMI 2.0 and 3.0. Corners are
`fl fr rl rr`, axes ISO 8855, units SI. `name[1..8]` stands for `name[1]` to `name[8]`. Sources cite papers by number:

{papers}
"""
_LIST = """\
`cosim fmu NAME` prints the inputs, outputs and parameters of an FMU, with their units and sources. The same tables are
in `documentation/index.html` in the FMU, on its page of the site (`make docs`), and for all FMUs in
`docs/reference/fmus.md` of a release.

"""


def sections(fmus: Path, names: Iterable[str] | None = None) -> dict[str, str]:
    """What each FMU has, by its name (of the whole catalog unless `names` are given).

    `fmus` is the folder with `fmi3/`.
    """
    found = {}
    catalog = default_catalog()
    for name in catalog if names is None else names:
        about = _about(fmus, name)
        parts = [f"{about.text}\n", f"{_kind(about)}. Catalog: {catalog[name].summary}.\n"]
        for title, variables in (
            ("inputs", about.inputs),
            ("outputs", about.outputs),
            ("parameters", about.parameters),
        ):
            if variables:
                parts.append(_table(title, variables.values()))
        found[name] = "\n".join(parts)
    return found


def reference(fmus: Path, names: Iterable[str] | None = None) -> str:
    """FMUs with their variables in one page."""
    parts = [f"## {name}\n\n{text}" for name, text in sections(fmus, names).items()]
    return "\n".join([_head("This page lists every FMU of the catalog with its variables."), *parts])


def index(fmus: Path, shown: Callable[[str], str] = "`{}`".format) -> str:
    """The list: what each FMU is, its kind and step; `shown` makes of a name what stands in the list."""
    rows = []
    for name in default_catalog():
        about = _about(fmus, name)
        rows.append(f"| {shown(name)} | {about.text} | {_kind(about)} |")
    table = "\n".join(["| FMU | description | kind and step |", "|---|---|---|", *rows])
    return f"{_head('This page lists every FMU of the catalog.')}\n{_LIST}{table}\n"


def published() -> str:
    """The names of the catalog as TOML."""
    names = "".join(f'    "{name}",\n' for name in sorted(default_catalog()))
    return f"# Names of the FMUs of the catalog, written by docs/write_fmus.py; do not edit.\nnames = [\n{names}]\n"


def _about(fmus: Path, name: str) -> Description:
    return Fmu(fmus / "fmi3" / f"{name}.fmu").description


def _head(contents: str) -> str:
    papers = (f"- {number}: {title}" for number, title in sorted(PAPERS.items()))
    return _HEAD.format(
        contents=contents, papers="\n".join(textwrap.fill(p, 120, subsequent_indent="  ") for p in papers)
    )


def _kind(about: Description) -> str:
    kind = about.kind or "continuous"
    step = about.sample_time if kind == "discrete" else about.default_step
    rate = f"{'sample time' if kind == 'discrete' else 'proposed communication step'} {float(step or 0):g} s"
    return f"{kind.capitalize()}, {rate}"


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
    safe_files.write(HERE / "reference" / "fmus.md", index(HERE.parent / FMUS))
    safe_files.write(PUBLISHED, published())
