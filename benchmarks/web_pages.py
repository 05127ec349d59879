"""Systems of the live pages in WebAssembly, beside the same systems run by the engine; the pages in Chromium.

Both take turns. WebAssembly runs in wasmtime, whose compiler makes about what
browsers make. Without Node.js and Chromium, the pages are not opened.
"""

from __future__ import annotations

import sys
import tempfile
from fractions import Fraction
from pathlib import Path

from benchmarks import spent
from cosim.experiments.live_pages import shown, write_pages
from cosim.export.code import SystemCode, exported_schedule
from cosim.export.variables import choose
from cosim.export.web.module import compile_module
from cosim.study import FmuSet, Runner
from cosim.study.experiment import resolved
from tests.browsers import script_output
from tests.export.web_host import TYPES, WebHost

SCRIPT = Path(__file__).parents[1] / "tests" / "export" / "live.mjs"
SECONDS, STEP, ROUNDS = 5, Fraction(1, 100), 3


def measure() -> dict[str, float]:
    """Sizes [MB], speed of the pages, and simulated time per processor time of each system, native and in WebAssembly.

    For the systems of a first group, the best of some rounds.
    """
    found: dict[str, float] = {}
    with tempfile.TemporaryDirectory() as folder:
        for page in write_pages(FmuSet(), Path(folder)):
            found[f"{page.stem}, page [MB]"] = page.stat().st_size / 1e6
            found |= {f"{page.stem}, {name}": value for name, value in in_chromium(page, Path(folder)).items()}
    for name, experiment in shown().items():
        live = resolved(experiment.web)(experiment.case())
        for one in [c for c in live.cases if c.group == live.cases[0].group]:
            with Runner(experiment, FmuSet()) as runner:
                system = runner.system(one.case)
                schedule = exported_schedule(system, ())
                code = SystemCode("system", schedule, choose(schedule, None, None, "*"), 3)
                module = compile_module([code])
                watched = [(k, e.type) for k, e in enumerate(code.variables, start=1) if e.causality == "output"]
                watched.sort(key=lambda v: TYPES[v[1]])
                for _ in range(ROUNDS):
                    host = WebHost(module.content, watched)
                    assert host.start(float(STEP)) == 0, host.message
                    web = SECONDS / spent(host.run, int(SECONDS / STEP))
                    system.allow_unconnected = True
                    with system.initialize(record=[]) as simulation:
                        native = SECONDS / spent(simulation.advance, SECONDS)
                    key = f"{name}, {one.title}, times the clock"
                    found[f"{key}, native"] = max(found.get(f"{key}, native", 0.0), native)
                    found[f"{key}, WebAssembly"] = max(found.get(f"{key}, WebAssembly", 0.0), web)
    return found


def in_chromium(page: Path, folder: Path) -> dict[str, float]:
    """The slowest view of a page at two widths and in two color schemes; empty without Node.js or Chromium."""
    try:
        views = script_output(SCRIPT, page, folder / page.stem, str(SECONDS))["views"]
    except FileNotFoundError as missing:
        print(missing, file=sys.stderr)
        return {}
    return {
        "time until it is ready [s]": max(v["ready"] for v in views),
        "simulated time / wall time": min(v["pace"] for v in views),
        "frames [1/s]": min(v["frames"] for v in views),
    }
