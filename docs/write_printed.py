"""Write `reference/printed-numbers.md`: the design values that the papers print, and where the project uses them.

python docs/write_printed.py
"""

from __future__ import annotations

import textwrap
import tomllib
from itertools import groupby
from pathlib import Path
from typing import Any

from build_fmus.base import safe_files

HERE = Path(__file__).parent
PAGE = HERE / "reference" / "printed-numbers.md"
_HEAD = """# Printed numbers

<!-- Written by docs/write_printed.py. -->

The design values that the papers print: masses, stiffnesses, weights, bounds, gains and rates. Each is compared with
what an FMU or a study uses (`tests/papers`). Published results are not listed here; the reports of the studies compare
them with ours. Values that the papers do not print are marked "assumed" in the documentation of each FMU.
"""


def page() -> str:
    """The page, as Markdown."""
    return _HEAD + "".join(_paper(file) for file in sorted((HERE.parent / "tests" / "papers").glob("*.toml")))


def _paper(file: Path) -> str:
    content = tomllib.loads(file.read_text(encoding="utf-8"))
    parts = [f"\n## Paper {file.stem}\n\n{textwrap.fill(content['paper'], 120)}\n"]
    for place, rows in groupby(content["printed"], key=lambda row: row["place"]):
        parts.append(f"\n### {place}\n\n| number | printed | used by |\n|---|---:|---|\n")
        parts += [f"| {row['what']} | {_value(row)} | {_use(row)} |\n" for row in rows]
    return "".join(parts)


def _value(row: dict[str, Any]) -> str:
    return f"{row['value']:g}" + (f" {row['unit']}" if row["unit"] != "1" else "")


def _use(row: dict[str, Any]) -> str:
    if "unused" in row:
        return f"not used: {row['unused']}"
    names = dict.fromkeys(f"`{used.partition(' ')[0]}`" for used in row["used"])
    return ", ".join(names) + (f"; {row['reading']}" if "reading" in row else "")


if __name__ == "__main__":
    safe_files.write(PAGE, page())
