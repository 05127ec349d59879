"""`python -m benchmarks [--json FILE] [--old FOLDER]`: all benchmarks, as ratios measured in one run.

Needs the FMUs (`build-fmus`).
"""

from __future__ import annotations

import argparse
import json
import tempfile
import time
from pathlib import Path

from rich.console import Console
from rich.markup import escape
from rich.table import Table

from benchmarks import (
    batch,
    chain,
    exchange_lag,
    fmu_cost,
    hmmwv_real_time,
    isolation,
    learning,
    mathematics,
    mpc_at_limit,
    mpc_solvers,
    mpc_worst,
    qp_time,
    solver_check,
    states,
    trench_plant,
)
from benchmarks.master_cost import measure
from build_fmus.base import safe_files
from cosim import Record, System
from cosim.experiments.gpc import EXPERIMENT as GPC
from cosim.experiments.gpc.runs import PLANT
from cosim.study import FmuSet, run_study
from cosim.study.store import Store


def full_car() -> dict[str, float]:
    """Simulated time per wall time of the full car alone at 1 ms."""
    import warnings

    warnings.simplefilter("ignore")
    with System() as system:
        system.add("car", FmuSet().path(PLANT), step="1 ms")
        recording = system.run(20.0, record=Record(["car.x"], "100 ms"))
    return {"simulated time / wall time": recording.real_time_factor}


def study() -> dict[str, float]:
    """The whole published study from nothing, on all cores."""
    with tempfile.TemporaryDirectory() as tmp:
        begin = time.perf_counter()
        result = run_study(GPC, FmuSet(), Path(tmp))
        wall_time = time.perf_counter() - begin
        return {"wall time [s]": wall_time, "runs": len(Store(Path(tmp))), "tasks": len(result.tasks)}


def main() -> None:
    """Run and print; `--json FILE` keeps the numbers, `--old FOLDER` has FMUs compared with older ones."""
    parser = argparse.ArgumentParser(
        prog="python -m benchmarks", description="all benchmarks, as ratios measured in one run"
    )
    parser.add_argument("--json", type=Path, help="file for the numbers")
    parser.add_argument("--old", type=Path, help="folder with older FMUs that the present ones are compared with")
    options = parser.parse_args()
    results = {
        "full car alone": full_car(),
        "master, passive system (3 FMUs)": measure("passive"),
        "master, preview system (4 FMUs)": measure("preview"),
        **{f"chain of three trivial FMUs, FMI {v}": chain.measure(v) for v in (2, 3)},
        "an isolated FMU": isolation.measure(),
        "hydraulic HMMWV, simulated time / processor time of one core": hmmwv_real_time.measure(),
        "saved states of one corner": states.measure(),
        "one corner by hand, and in real time": states.by_hand(),
        learning.TITLE: learning.measure(),
        batch.TITLE: batch.measure(),
        "contact plant of paper 003, trench of 1.5 m at 3 km/h": trench_plant.measure(),
        "solver check at initialization": solver_check.measure(),
        "mathematical library inside the FMUs": mathematics.measure(),
        "cosim study gpc": study(),
        exchange_lag.TITLE: exchange_lag.measure(),
        **qp_time.table(),
    }
    if options.old:
        results[fmu_cost.TITLE] = fmu_cost.measure(options.old)
    programs = mpc_solvers.solvers()
    longest, at_limit = mpc_worst.worst(), mpc_at_limit.choices()
    for shown in (mpc_solvers.table(programs), mpc_worst.table(longest), mpc_at_limit.table(at_limit)):
        Console(width=220).print(shown)
    for title, rows in results.items():
        table = Table(title, "", box=None)
        for name, value in rows.items():
            table.add_row(escape(name), f"{value:.3g}")
        Console().print(table)
    if options.json:
        kept = {**results, **programs, "longest sample": longest, "at the limit": at_limit}
        safe_files.write(options.json, json.dumps(kept, indent=1) + "\n")


if __name__ == "__main__":
    main()
