"""Write the tables of docs/how-to/microcontroller.md: what controllers need on two processors, single precision.

Run `python docs/write_targets.py` after `make fmus`, with gcc-arm-none-eabi and qemu-system-arm.
"""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import Any

ROOT = Path(__file__).parents[1]
sys.path[:0] = [str(ROOT), str(ROOT / "tests")]  # the project first: tests/ has a folder cosim, too

from build_fmus.base.one_thread import one_thread  # noqa: E402

one_thread()  # constants as in the FMUs

import numpy as np  # noqa: E402
from target.same_samples import declared, inputs_of, metrics_of, size_of  # noqa: E402

from build_fmus.target.cycles import core_of  # noqa: E402
from build_fmus.target.library import build_library  # noqa: E402
from build_fmus.target.toolchain import TARGETS  # noqa: E402
from cosim.fmu.target import target  # noqa: E402

PAGE = ROOT / "docs" / "how-to" / "microcontroller.md"
FMUS = ROOT / "fmus"
LAWS = ("Skyhook", "LqrHmmwv", "KalmanHmmwv", "ForceTracking", "GpcPreview")
CONTROLLERS = (*LAWS, "MpcBench", "MpcHmmwv", "MpcThreeAxle")
PROCESSORS = ("cortex-m4f", "cortex-m7")
WORST = ROOT / "tests" / "target" / "worst_samples.json"
SOURCES = ROOT / "tests" / "target" / "measured_sources.json"
SAMPLES = 1000
SINGLE, SINGLE_SAMPLES = (*LAWS, "MpcBench", "MpcHmmwv"), 10
MARKS = ("<!-- table: written by docs/write_targets.py -->", "<!-- end of table -->")
SINGLE_MARKS = ("<!-- single: written by docs/write_targets.py -->", "<!-- end of single -->")
SINGLE_HEAD = (
    "| component | double [instructions] | single [instructions] | ratio | largest relative error |\n"
    "|---|---|---|---|---|\n"
)
HEAD = (
    "| component | sample time [ms] | processor | flash [bytes] | RAM [bytes] | worst stack [bytes] | instructions"
    " | cycles, estimate | in its sample time |\n"
    "|---|---|---|---|---|---|---|---|---|\n"
)
LOOPS_HEAD = (
    "| MPC | closed loop | random | extreme | adversarial | samples tried | its input |\n"
    "|---|---|---|---|---|---|---|\n"
)


def instructions(name: str, processor: str, inputs: np.ndarray) -> int:
    """The most instructions of one of these samples."""
    controller = target(name, processor, folder=FMUS / "target", timeout=60.0)
    controller.instantiate(name)
    controller.begin()
    y = controller.take_samples(inputs)
    controller.close()
    return int(y[:, -2].max())


def in_words(n: float) -> str:
    """Three digits and a unit."""
    for size, unit in ((1e9, " G"), (1e6, " M"), (1e3, " k")):
        if n >= size:
            return f"{n / size:.3g}{unit}"
    return f"{n:.3g}"


def row(name: str, processor: str) -> str:
    """A line of the table."""
    component = declared(name, FMUS)
    folder = build_library(component, TARGETS[processor], FMUS / "target")
    m = metrics_of(folder)
    worst = json.loads(WORST.read_text(encoding="utf-8")).get(name)
    if worst:
        most = worst["instructions"][processor]
    else:
        most = instructions(name, processor, inputs_of(component.model(), SAMPLES))
    core = core_of(processor)
    assert core is not None
    cycles = " to ".join(in_words(n) for n in core.cycles(most))
    numbers = (m["flash_bytes"], m["ram_bytes"], m["stack_bytes"], most)
    verdict = core.verdict(most, m["sample_time_s"])
    cells = (name, f"{1e3 * m['sample_time_s']:g}", processor, *(f"{n:,}" for n in numbers), cycles, verdict)
    return f"| {' | '.join(cells)} |\n"


def loop_row(name: str, worst: dict[str, Any]) -> str:
    """What the search for the longest sample of an MPC found, on the Cortex-M7."""
    model = declared(name, FMUS).model()
    elements, last = model.elements("input"), np.array(worst["inputs"][-1])
    k = int(np.argmax(np.abs(last) / [size_of(e.variable) for e in elements]))
    inputs = f"`{elements[k].name}` = {last[k]:.4g} {elements[k].variable.unit or ''}".rstrip()
    numbers = (worst["closed_loop_instructions"], *worst["most_by_method"].values(), worst["tried"])
    cells = (name, *(f"{n:,}" for n in numbers), f"{inputs}, ...")
    return f"| {' | '.join(cells)} |\n"


def single_row(name: str) -> str:
    """A line of the table of single precision: the Cortex-M4F, whose unit has single precision only."""
    component = declared(name, FMUS)
    inputs = inputs_of(component.model(), SINGLE_SAMPLES)
    folders = [build_library(component, TARGETS["cortex-m4f"], FMUS / "target", p) for p in ("double", "single")]
    double, single = (instructions(name, folder.parent.name, inputs) for folder in folders)
    errors = [
        e["relative"]
        for n, e in metrics_of(folders[1])["single_errors"]["outputs"].items()
        if not n.startswith("solver.")
    ]
    cells = (f"{double:,}", f"{single:,}", f"{double / single:.1f}", f"{max(errors):.1e}")
    return f"| {name} | {' | '.join(cells)} |\n"


def write_table(marks: tuple[str, str], table: str) -> None:
    """Write a table of the page again."""
    before, rest = PAGE.read_text(encoding="utf-8").split(marks[0])
    _, after = rest.split(marks[1])
    PAGE.write_text(f"{before}{marks[0]}\n\n{table}\n{marks[1]}{after}", encoding="utf-8")


def main() -> None:
    """Write the page with new tables."""
    table = HEAD + "".join(row(name, processor) for name in CONTROLLERS for processor in PROCESSORS)
    worst = json.loads(WORST.read_text(encoding="utf-8"))
    sources = {n: metrics_of(FMUS / "target" / PROCESSORS[0] / n)["source_sha256"] for n in CONTROLLERS}
    SOURCES.write_text(json.dumps(sources, indent=1) + "\n", encoding="utf-8")
    write_table(MARKS, table + "\n" + LOOPS_HEAD + "".join(loop_row(name, worst[name]) for name in worst))
    write_table(SINGLE_MARKS, SINGLE_HEAD + "".join(single_row(name) for name in SINGLE))


if __name__ == "__main__":
    main()
