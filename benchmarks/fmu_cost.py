"""What FMUs cost beside older ones of the same names: bare C loops over two folders of FMUs, taking turns, in one run.

`python -m benchmarks --old FOLDER` compares `fmus` with a copy that was kept before a change. Nothing but the
FMUs differs: the same program sets, steps and gets the same variables of the passive and the preview system, and of
the contact plant alone. Times are of the processor, the least of all turns.
"""

from __future__ import annotations

import tempfile
from collections.abc import Callable
from pathlib import Path

from benchmarks.master_cost import Wired, bare_program, flatten, seconds
from cosim import System
from cosim.experiments.gpc.runs import Case, wire
from cosim.study import FmuSet

STEPS = 50_000  # of 1 ms; the contact plant a tenth of it


def gpc_system(fmus: FmuSet, controller: str) -> list[Wired]:
    """The FMUs of the published closed loop over the sine road."""
    with wire(fmus, Case("sine", controller=controller)) as system:
        return flatten(system)


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


def measure(old: Path, turns: int = 7) -> dict[str, float]:
    """Microseconds per step of 1 ms of each system with the FMUs of both folders, and the speedup of the new ones."""
    found: dict[str, float] = {}
    with tempfile.TemporaryDirectory() as tmp:
        for i, (name, (make, steps)) in enumerate(SYSTEMS.items()):
            programs = {}
            for which, folder in (("old", old), ("new", Path("fmus"))):
                place = Path(tmp) / f"{i}{which}"
                place.mkdir()
                programs[which] = bare_program(make(FmuSet(folder.resolve())), steps, place)
            took = [{which: seconds([p]) for which, p in programs.items()} for _ in range(turns)]
            least = {which: min(t[which] for t in took) for which in programs}
            found |= {f"{name}, {which} [us per ms]": t / steps * 1e6 for which, t in least.items()}
            found[f"{name}, old / new"] = least["old"] / least["new"]
    return found
