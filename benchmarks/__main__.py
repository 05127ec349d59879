"""`python -m benchmarks [NAME ...] [--json FILE] [--old FOLDER]`: benchmarks, as ratios measured in one run.

Each is a module with a function `measure`. Needs the FMUs (`build-fmus`).
"""

from __future__ import annotations

import argparse
import importlib
import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.markup import escape
from rich.table import Table

from build_fmus.base import safe_files

NAMES = (
    "real_time",
    "master_cost",
    "chain",
    "isolation",
    "states",
    "learning",
    "batch",
    "gradients",
    "calibration",
    "solver_check",
    "mathematics",
    "study",
    "exchange_lag",
    "masters",
    "qp_time",
    "mpc_solvers",
    "mpc_worst",
    "mpc_at_limit",
)
"""What is measured without names."""
MORE = ("sweeps", "lane_sweeps", "web_pages")
OLD = "fmu_cost"  # with --old


def show(title: str, results: Mapping[str, Any]) -> None:
    """Print a line for each number, or a table of the numbers of several subjects."""
    rows = {name: row for name, row in results.items() if isinstance(row, Mapping)}
    columns = dict.fromkeys(column for row in rows.values() for column in row)
    table = Table("", *map(escape, columns), box=None)
    for name, row in rows.items():
        table.add_row(escape(name), *(f"{row[c]:.3g}" if c in row else "" for c in columns))
    print(title)
    for name, value in results.items():
        if name not in rows:
            print(f"{name}: {value:.3g}")
    if rows:
        Console(width=220).print(table)


def main() -> None:
    """Run and print; `--json FILE` keeps the numbers, `--old FOLDER` has FMUs compared with older ones."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks", description="Measure, as ratios in one run.")
    parser.add_argument("names", nargs="*", help=f"benchmarks (default: all but {', '.join(MORE)})")
    parser.add_argument("--json", type=Path, help="file for the numbers")
    parser.add_argument("--old", type=Path, help="folder with older FMUs that the present ones are compared with")
    options = parser.parse_args()
    for name in options.names:
        if name not in (*NAMES, *MORE):
            parser.error(f"there is no benchmark {name!r}; there are {', '.join((*NAMES, *MORE))}")
    kept: dict[str, Any] = {}
    for name in [*(options.names or ([] if options.old else NAMES)), *([OLD] if options.old else [])]:
        module = importlib.import_module(f"benchmarks.{name}")
        kept[name] = module.measure(*([options.old] if name == OLD else []))
        show(str(module.__doc__).splitlines()[0], kept[name])
    if options.json:
        safe_files.write(options.json, json.dumps(kept, indent=1) + "\n")


if __name__ == "__main__":
    main()
