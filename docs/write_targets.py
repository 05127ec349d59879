"""Write the table of docs/how-to/microcontroller.md: what seven controllers need on two processors.

Run `python docs/write_targets.py` after `make fmus`, with gcc-arm-none-eabi and qemu-system-arm.
"""

from __future__ import annotations

import json
import re
from pathlib import Path

import numpy as np

from cosim.fmu.target import target
from fmu_sources.cli import Options, build_libraries

ROOT = Path(__file__).parents[1]
PAGE = ROOT / "docs" / "how-to" / "microcontroller.md"
CONTROLLERS = ("Skyhook", "LqrHmmwv", "KalmanHmmwv", "ForceTracking", "GpcPreview", "MpcBench", "MpcHmmwv")
SAMPLES = 50
HEAD = (
    "| component | sample time [ms] | processor | flash [bytes] | RAM [bytes] | worst stack [bytes] | instructions |\n"
    "|---|---|---|---|---|---|---|\n"
)


def instructions(name: str, processor: str, folder: Path) -> int:
    """The most instructions of `SAMPLES` samples with random inputs (normal, standard deviation 0.05)."""
    controller = target(name, processor, folder=folder, timeout=60.0)
    controller.instantiate(name)
    controller.begin()
    starts = np.array([v.start for v in controller.description.inputs.values()], dtype=float)
    rng, y = np.random.default_rng(1), np.zeros(len(controller.outputs))
    types = np.array([v.name.startswith(("use_", "case", "mode")) for v in controller.description.inputs.values()])
    most = 0.0
    for _ in range(SAMPLES):
        noise = 0.05 * rng.normal(size=len(starts))
        controller.step(0.0, 0.0, starts + np.where(types | (starts != 0), 0.0, noise), y)
        most = max(most, y[-2])
    controller.close()
    return int(most)


def rows() -> list[str]:
    """Lines of the table."""
    out = ROOT / "fmus"
    lines = []
    for name in CONTROLLERS:
        for processor in ("cortex-m4f", "cortex-m7"):
            (folder,) = build_libraries([name], processor, Options(out))
            m = json.loads((folder / "metrics.json").read_text())
            numbers = (
                m["flash_bytes"],
                m["ram_bytes"],
                m["stack_bytes"],
                instructions(name, processor, out / "target"),
            )
            cells = (name, f"{1e3 * m['sample_time_s']:g}", processor, *(f"{n:,}" for n in numbers))
            lines.append(f"| {' | '.join(cells)} |\n")
    return lines


def main() -> None:
    """Write the page with a new table."""
    text = PAGE.read_text(encoding="utf-8")
    table = HEAD + "".join(rows())
    PAGE.write_text(re.sub(r"\| component \|.*?\n(?=\n)", lambda _: table, text, flags=re.DOTALL), encoding="utf-8")


if __name__ == "__main__":
    main()
