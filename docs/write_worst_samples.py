"""Write tests/target/worst_samples.json: the longest samples of the MPCs that a search on the emulated Cortex-M7 finds.

Run `python docs/write_worst_samples.py [NAME ...]` after `make fmus`, with gcc-arm-none-eabi and qemu-system-arm
(15 minutes). The search maximizes the instructions of the last of two samples from the start: random inputs, inputs at
0 or far beyond their limits, and then random changes of the best ones, of which those that do not take fewer
instructions are kept. The worst of all are compared with the FMU bit for bit. Seeds are fixed.
"""

from __future__ import annotations

import heapq
import json
import sys
from pathlib import Path
from typing import Any

ROOT = Path(__file__).parents[1]
sys.path[:0] = [str(ROOT), str(ROOT / "tests"), str(ROOT / "tests" / "target")]  # tests/ has a folder cosim, too

from build_fmus.base.one_thread import one_thread  # noqa: E402

one_thread()  # constants as in the FMUs

import numpy as np  # noqa: E402
from mpc_loops import LOOPS, mpc_loop  # noqa: E402
from same_samples import declared, fmu_samples, inputs_of, metrics_of, size_of  # noqa: E402

from build_fmus.component import Model  # noqa: E402
from build_fmus.generate import ticks  # noqa: E402
from build_fmus.target.library import build_library  # noqa: E402
from build_fmus.target.toolchain import TARGETS  # noqa: E402
from cosim.fmu.target import EmulatedTarget, target  # noqa: E402

FILE = ROOT / "tests" / "target" / "worst_samples.json"
FMUS = ROOT / "fmus"
LENGTH = 2  # samples: the solver starts the second one at the solution of the first
TRIES = {"MpcBench": 900, "MpcBenchMoves": 900, "MpcHmmwv": 600, "MpcThreeAxle": 900}
REPLAYED = 500
CLOSED_LOOP = 300  # samples
FAR = 100.0  # times the usual size of a signal


class Search:
    """Inputs of `LENGTH` samples from the start that take the most instructions."""

    def __init__(self, model: Model, controller: EmulatedTarget, seed: int = 1) -> None:
        self.model, self.controller, self.rng = model, controller, np.random.default_rng(seed)
        self.worst: list[tuple[int, int, np.ndarray, np.ndarray]] = []  # a heap: instructions, number, ...
        self.most: dict[str, int] = {}
        self.count = 0

    def measure(self, how: str, u: np.ndarray) -> int:
        """Instructions of the last sample; keeps the inputs if they are among the worst."""
        outputs, instructions = replay(self.controller, u)
        entry = (instructions, self.count, u, outputs)
        self.count += 1
        (heapq.heappush if len(self.worst) < REPLAYED else heapq.heappushpop)(self.worst, entry)
        self.most[how] = max(self.most.get(how, 0), instructions)
        return instructions

    def random(self) -> np.ndarray:
        """Inputs of some size."""
        u = inputs_of(self.model, LENGTH, int(self.rng.integers(2**31)))
        return self._legal(u * np.where(self._real(), 10.0 ** self.rng.uniform(-2, 1), 1.0))

    def extreme(self) -> np.ndarray:
        """Each input at 0, at its usual size or far beyond."""
        u = inputs_of(self.model, LENGTH, int(self.rng.integers(2**31)))
        sizes = np.array([size_of(e.variable) for e in self.model.elements("input")])
        factors = self.rng.choice([0.0, 1.0, -1.0, FAR, -FAR], size=u.shape)
        return self._legal(np.where(self._real(), sizes * factors, u))

    def changed(self, u: np.ndarray) -> np.ndarray:
        """Some inputs replaced or scaled."""
        other = self.extreme() if self.rng.random() < 0.3 else self.random()
        scaled = self._legal(u * np.where(self._real(), self.rng.lognormal(0.0, 0.5, u.shape), 1.0))
        here = self.rng.random(u.shape) < self.rng.choice([0.02, 0.1, 0.3])
        return np.where(here, scaled if self.rng.random() < 0.5 else other, u)

    def run(self, tries: int) -> None:
        """A third of the tries each: random, extreme, and changes of the best five of them."""
        for _ in range(tries // 3):
            self.measure("random", self.random())
            self.measure("extreme", self.extreme())
        best = [[e[0], e[2]] for e in heapq.nlargest(5, self.worst)]
        for k in range(tries // 3):
            at = best[k % len(best)]
            u = self.changed(at[1])
            if (instructions := self.measure("adversarial", u)) >= at[0]:
                at[:] = instructions, u

    def _real(self) -> np.ndarray:
        """Which inputs may have any value."""
        variables = [e.variable for e in self.model.elements("input")]
        return np.array([v.type == "Float64" and v.must_equal is None for v in variables])

    def _legal(self, u: np.ndarray) -> np.ndarray:
        """Six digits, so that the file has exactly these numbers."""
        return np.array([[float(f"{x:.6g}") for x in row] for row in u])


def replay(controller: EmulatedTarget, u: np.ndarray) -> tuple[np.ndarray, int]:
    """Outputs of samples from the start, and the instructions of the last one."""
    controller.start_again()
    y = controller.take_samples(u)
    return y[:, :-2], int(y[-1, -2])


def running(name: str, processor: str) -> EmulatedTarget:
    """The component on an emulated processor, which has started."""
    build_library(declared(name, FMUS), TARGETS[processor], FMUS / "target")
    controller = target(name, processor, folder=FMUS / "target", timeout=600.0)
    controller.instantiate(name)
    controller.begin()
    return controller


def check(name: str, model: Model, search: Search) -> None:
    """Compare the worst samples with those of the FMU."""
    inputs, outputs = ([e.name for e in model.elements(r)] for r in ("input", "output"))
    for _, _, u, y in search.worst:
        expected = fmu_samples(FMUS / "fmi3" / f"{name}.fmu", u, inputs, outputs, float(ticks(model)))
        if expected.tobytes() != y.tobytes():
            sys.exit(f"{name}: the emulated controller differs from the FMU for the inputs {u.tolist()}")


def entry(name: str) -> dict[str, Any]:
    """What the file has of an MPC."""
    model, controller = declared(name, FMUS).model(), running(name, "cortex-m7")
    search = Search(model, controller)
    search.run(TRIES[name])
    check(name, model, search)
    most, _, u, y = max(search.worst, key=lambda e: e[:2])
    outputs = dict(zip([e.name for e in model.elements("output")], y[-1], strict=True))
    instructions = {"cortex-m7": most}
    for processor in [p for p, t in TARGETS.items() if t.board and p not in instructions]:
        instructions[processor] = replay(running(name, processor), u)[1]
    loop = mpc_loop(name, FMUS, CLOSED_LOOP, target(name, "cortex-m7", folder=FMUS / "target", timeout=60.0))[1]
    print(f"{name}: {most:,} instructions; in the closed loop {loop[:, -2].max():,.0f}", flush=True)
    return {
        "tried": search.count,
        "replayed": len(search.worst),
        "most_by_method": search.most,
        "instructions": dict(sorted(instructions.items())),
        "closed_loop_samples": CLOSED_LOOP,
        "closed_loop_instructions": int(loop[:, -2].max()),
        "source_sha256": metrics_of(FMUS / "target" / "cortex-m7" / name)["source_sha256"],
        "solver": {k: v for k, v in outputs.items() if k.startswith("solver.")},
        "inputs": u.tolist(),
    }


def main() -> None:
    """Search for these MPCs, or for all."""
    found = json.loads(FILE.read_text(encoding="utf-8")) if FILE.exists() else {}
    for name in sys.argv[1:] or LOOPS:
        found[name] = entry(name)
        FILE.write_text(json.dumps(dict(sorted(found.items())), indent=None) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
