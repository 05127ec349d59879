"""Write the tables of docs/how-to/microcontroller.md: needs of seven controllers, single precision.

Run `python docs/write_targets.py` after `make fmus`, with gcc-arm-none-eabi and qemu-system-arm.
"""

from __future__ import annotations

import json
import sys
from pathlib import Path

import numpy as np

ROOT = Path(__file__).parents[1]
sys.path[:0] = [str(ROOT), str(ROOT / "tests")]  # the project first: tests/ has a folder cosim, too

from target.same_samples import declared, inputs_of  # noqa: E402

from build_fmus.target.library import build_library  # noqa: E402
from build_fmus.target.toolchain import TARGETS  # noqa: E402
from cosim.fmu.target import target  # noqa: E402

PAGE = ROOT / "docs" / "how-to" / "microcontroller.md"
FMUS = ROOT / "fmus"
CONTROLLERS = ("Skyhook", "LqrHmmwv", "KalmanHmmwv", "ForceTracking", "GpcPreview", "MpcBench", "MpcHmmwv")
CLOCKS_MHZ = {"cortex-m4f": 168, "cortex-m7": 480}
AT_BEST = {"cortex-m4f": 1, "cortex-m7": 2}  # instructions per cycle
SAMPLES = 50
MARKS = ("<!-- table: written by docs/write_targets.py -->", "<!-- end of table -->")
SINGLE_MARKS = ("<!-- single: written by docs/write_targets.py -->", "<!-- end of single -->")
SINGLE_HEAD = (
    "| component | double [instructions] | single [instructions] | ratio | largest relative error |\n"
    "|---|---|---|---|---|\n"
)
HEAD = (
    "| component | sample time [ms] | processor | flash [bytes] | RAM [bytes] | worst stack [bytes] | instructions"
    " | at least [% of the sample time] |\n"
    "|---|---|---|---|---|---|---|---|\n"
)


def instructions(name: str, processor: str, inputs: np.ndarray) -> int:
    """The most instructions of one of these samples."""
    controller = target(name, processor, folder=FMUS / "target", timeout=60.0)
    controller.instantiate(name)
    controller.begin()
    y = np.zeros((len(inputs), len(controller.outputs)))
    for row, outputs in zip(inputs, y, strict=True):
        controller.step(0.0, 0.0, row, outputs)
    controller.close()
    return int(y[:, -2].max())


def least_share(processor: str, most: int, sample_time: float) -> str:
    """The least time that instructions take, in per cent of the sample time."""
    share = 100.0 * most / (1e6 * CLOCKS_MHZ[processor] * AT_BEST[processor] * sample_time)
    return f"{share:,.0f}" if share >= 10.0 else f"{share:.2g}"


def row(name: str, processor: str) -> str:
    """A line of the table."""
    component = declared(name, FMUS)
    folder = build_library(component, TARGETS[processor], FMUS / "target")
    m = json.loads((folder / "metrics.json").read_text(encoding="utf-8"))
    most = instructions(name, processor, inputs_of(component.model(), SAMPLES))
    numbers = (m["flash_bytes"], m["ram_bytes"], m["stack_bytes"], most)
    share = least_share(processor, most, m["sample_time_s"])
    cells = (name, f"{1e3 * m['sample_time_s']:g}", processor, *(f"{n:,}" for n in numbers), share)
    return f"| {' | '.join(cells)} |\n"


def single_row(name: str) -> str:
    """A line of the table of single precision: the Cortex-M4F, whose unit has single precision only."""
    component = declared(name, FMUS)
    inputs = inputs_of(component.model(), SAMPLES)
    folders = [build_library(component, TARGETS["cortex-m4f"], FMUS / "target", p) for p in ("double", "single")]
    double, single = (instructions(name, folder.parent.name, inputs) for folder in folders)
    metrics = json.loads((folders[1] / "metrics.json").read_text(encoding="utf-8"))
    errors = [e["relative"] for n, e in metrics["single_errors"]["outputs"].items() if not n.startswith("solver.")]
    cells = (f"{double:,}", f"{single:,}", f"{double / single:.1f}", f"{max(errors):.1e}")
    return f"| {name} | {' | '.join(cells)} |\n"


def write_table(marks: tuple[str, str], table: str) -> None:
    """Write a table of the page again."""
    before, rest = PAGE.read_text(encoding="utf-8").split(marks[0])
    _, after = rest.split(marks[1])
    PAGE.write_text(f"{before}{marks[0]}\n\n{table}\n{marks[1]}{after}", encoding="utf-8")


def main() -> None:
    """Write the page with new tables."""
    write_table(MARKS, HEAD + "".join(row(name, processor) for name in CONTROLLERS for processor in CLOCKS_MHZ))
    write_table(SINGLE_MARKS, SINGLE_HEAD + "".join(single_row(name) for name in CONTROLLERS))


if __name__ == "__main__":
    main()
