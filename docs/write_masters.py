"""Write the tables of docs/reference/masters.md: errors of the exchange and what they cost, on five systems.

Run `python -m docs.write_masters [PYTHON]` after `make fmus`. PYTHON: an interpreter that has CoFmuPy (`pip install
cofmupy`); without one, its cells stay as they are.
"""

from __future__ import annotations

import re
import sys
from collections.abc import Sequence
from pathlib import Path

from benchmarks.masters import EXTRAPOLATED, PLAIN, SUBJECTS, TOLERANCES, Cost, Result, Subject, measured

PAGE = Path(__file__).parent / "reference" / "masters.md"
WAYS = (PLAIN, EXTRAPOLATED, *(f"tolerance {t:g}" for t in TOLERANCES), "CoFmuPy")
HEADS = {"estimates": ("system", "step [ms]", "plain", "ratios", "extrapolated", "ratios"), "costs": ("system", *WAYS)}


def estimates(subject: Subject, result: Result) -> list[str]:
    """Cells of the first table."""
    cells = [subject.name, f"{1e3 * float(subject.step):g}"]
    for what in (PLAIN, EXTRAPOLATED):
        ratios = result.ratios.get(what)
        cells += (
            ["unstable", ""]
            if ratios is None
            else [f"{result.within(what)} of {len(ratios)}", f"{min(ratios):.2f} to {max(ratios):.2f}"]
        )
    return cells


def costs(subject: Subject, result: Result, peers: str) -> list[str]:
    """Cells of the second table; `peers`: what stands for CoFmuPy where it was not measured."""
    return [subject.name, *(cost(result.costs[way]) if way in result.costs else peers for way in WAYS)]


def cost(found: Cost) -> str:
    """Error and calls."""
    return f"{found.error:.2g} ({found.calls:,} calls)" if found.error < 1.0 else "diverges"


def table(name: str, rows: Sequence[Sequence[str]]) -> str:
    """A Markdown table."""
    head = HEADS[name]
    lines = [head, ["---"] * len(head), *rows]
    return "".join(f"| {' | '.join(line)} |\n" for line in lines)


def rows_of(text: str, name: str) -> dict[str, list[str]]:
    """Cells of a table of the page, by system."""
    (body,) = re.findall(rf"<!-- {name}: .*?-->(.*?)<!-- end of {name} -->", text, re.DOTALL)
    lines = [[cell.strip() for cell in line.strip("|\n").split("|")] for line in body.strip().splitlines()[2:]]
    return {cells[0]: cells for cells in lines}


def main() -> None:
    """Measure and write."""
    peer = Path(sys.argv[1]) if len(sys.argv) > 1 else None
    text = PAGE.read_text(encoding="utf-8")
    before = rows_of(text, "costs")
    results = {subject: measured(subject, peer=peer) for subject in SUBJECTS}
    tables = {
        "estimates": [estimates(s, r) for s, r in results.items()],
        "costs": [costs(s, r, before[s.name][-1] if s.name in before else "") for s, r in results.items()],
    }
    for name, rows in tables.items():
        mark, end = f"<!-- {name}: written by docs/write_masters.py -->", f"<!-- end of {name} -->"
        begin = text.index(mark) + len(mark)
        text = f"{text[:begin]}\n\n{table(name, rows)}\n{text[text.index(end) :]}"
    PAGE.write_text(text, encoding="utf-8")


if __name__ == "__main__":
    main()
