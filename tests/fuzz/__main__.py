"""`python -m tests.fuzz [TARGET ...] --cases N --seed S`: make cases, try them, keep those that fail."""

from __future__ import annotations

import argparse
import sys
import time
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1]))  # as in the tests

from . import bench
from .campaign import campaign, kept, work
from .targets import TARGETS, target


def main() -> int:
    """The command; 1 when a case failed."""
    if sys.argv[1:2] == ["--work"]:  # in the process of a campaign
        name, seed, first, end, progress, longest = sys.argv[2:]
        return work(name, int(seed), int(first), int(end), Path(progress), float(longest))
    if sys.argv[1:2] == ["--replay"]:
        name, longest, *files = sys.argv[2:]
        found = {file: bench.failure(target(name), kept(Path(file)), float(longest)) for file in files}
        print("\n".join(f"{file}: {what}" for file, what in found.items() if what))
        return 1 if any(found.values()) else 0
    parser = argparse.ArgumentParser(prog="python -m tests.fuzz", description=__doc__)
    parser.add_argument(
        "targets", nargs="*", metavar="TARGET", help=f"one or more of {', '.join(TARGETS)}; default all"
    )
    parser.add_argument("--cases", type=int, default=1000, help="in total, shared by the targets; default 1000")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--first", type=int, default=0, help="number of the first case of each target")
    arguments = parser.parse_args()
    if unknown := set(arguments.targets) - set(TARGETS):
        parser.error(f"no target {', '.join(sorted(unknown))}; there are {', '.join(TARGETS)}")
    chosen = arguments.targets or list(TARGETS)
    every = sum(TARGETS[name] for name in chosen)
    failed = 0
    for i, name in enumerate(chosen):
        before, after = (sum(TARGETS[n] for n in chosen[:k]) for k in (i, i + 1))
        count = arguments.cases * after // every - arguments.cases * before // every
        begin = time.perf_counter()
        failures, tried = campaign(name, arguments.seed, arguments.first, count)
        for failure in failures:
            print(failure, end="\n\n")
        print(f"{name}: {tried} cases in {time.perf_counter() - begin:.0f} s, {len(failures)} failed", flush=True)
        failed += len(failures)
    return 1 if failed else 0


if __name__ == "__main__":
    raise SystemExit(main())
