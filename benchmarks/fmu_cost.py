"""What FMUs cost beside older ones of the same names: bare C loops over two folders of FMUs, taking turns, in one run.

`python -m benchmarks.fmu_cost --old FOLDER` compares `fmus` with a copy that was kept before a change. Nothing but
the FMUs differs: the same program sets, steps and gets the same variables of the passive and the preview system, and of
the contact plant alone. Times are of the processor, the least of all turns.
"""

from __future__ import annotations

import argparse
import tempfile
from collections.abc import Callable, Sequence
from pathlib import Path

from rich.console import Console
from rich.table import Table

from benchmarks.master_cost import Wired, bare_program, flatten, seconds
from cosim import System
from cosim.experiments.gpc.runs import CONTROLLERS, PLANT, SPEED, Case, road_file, wire
from cosim.study import FmuSet

STEPS = 50_000  # of 1 ms; the contact plant a tenth of it
TITLE = "comparison with older FMUs, in bare C loops"


def gpc_system(fmus: FmuSet, controller: str) -> list[Wired]:
    """The FMUs of the published closed loop over the sine road."""
    paths = {"speed": fmus.path(SPEED), "road": road_file(fmus, "sine"), "car": fmus.path(PLANT)}
    if name := CONTROLLERS[controller]:
        paths["controller"] = fmus.path(name)
    with wire(fmus, Case("sine", controller=controller)) as system:
        return flatten(system, paths)


def contact_plant(fmus: FmuSet) -> list[Wired]:
    """The 6x6 alone: what its metrics need is read every step."""
    path = fmus.path("ThreeAxleTrench")
    with System() as system:
        system.add("car", path, step="1 ms")
        (component,) = system.schedule().components
        outputs = component.description.outputs
        read = [
            v.reference
            for n, v in outputs.items()
            if n == "x" or n.startswith("body.") or n.endswith((".force", ".fx"))
        ]
        return [Wired(component.name, path, int(component.description.fmi_version[0]), [], [], read, 0)]


SYSTEMS: dict[str, tuple[Callable[[FmuSet], list[Wired]], int]] = {
    "passive system (3 FMUs)": (lambda fmus: gpc_system(fmus, "passive"), STEPS),
    "preview system (4 FMUs)": (lambda fmus: gpc_system(fmus, "preview"), STEPS),
    "contact plant of paper 003": (contact_plant, STEPS // 10),
}


def measure(old: Path, new: Path = Path("fmus"), turns: int = 7) -> dict[str, float]:
    """Microseconds per step of 1 ms of each system with the FMUs of both folders, and the speedup of the new ones."""
    found: dict[str, float] = {}
    with tempfile.TemporaryDirectory() as tmp:
        for i, (name, (make, steps)) in enumerate(SYSTEMS.items()):
            programs = {}
            for which, folder in (("old", old), ("new", new)):
                place = Path(tmp) / f"{i}{which}"
                place.mkdir()
                programs[which] = bare_program(make(FmuSet(folder.resolve())), steps, place)
            took = [{which: seconds([p]) for which, p in programs.items()} for _ in range(turns)]
            least = {which: min(t[which] for t in took) for which in programs}
            found |= {f"{name}, {which} [us per ms]": t / steps * 1e6 for which, t in least.items()}
            found[f"{name}, old / new"] = least["old"] / least["new"]
    return found


def main(arguments: Sequence[str] | None = None) -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.fmu_cost", description=TITLE)
    parser.add_argument("--old", type=Path, required=True, help="folder with older FMUs, as build-fmus makes it")
    parser.add_argument("--new", type=Path, default=Path("fmus"), help="folder with the FMUs (fmus)")
    parser.add_argument("--turns", type=int, default=7, help="how often each program runs (7)")
    options = parser.parse_args(arguments)
    table = Table(TITLE, "", box=None)
    for name, value in measure(options.old, options.new, options.turns).items():
        table.add_row(name.replace("[", r"\["), f"{value:.3g}")
    Console().print(table)


if __name__ == "__main__":
    main()
