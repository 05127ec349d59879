"""`python -m tests.mutants`: make mistakes, run the tests that should notice, list the mistakes that none noticed."""

from __future__ import annotations

import argparse
import os
import signal
import sys
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor, as_completed
from contextlib import ExitStack
from pathlib import Path
from queue import SimpleQueue

from . import trial
from .groups import GROUPS, ROOT, Group
from .mutations import Mutant, mutants, mutated, sample

ACCEPTED = Path(__file__).parent / "accepted.txt"
STORE = ROOT / ".cache" / "mutants"


def accepted() -> dict[str, str]:
    """Mistakes that need not be noticed, by name, each with its reason: lines below it that begin with a blank."""
    found: dict[str, str] = {}
    name = ""
    for line in ACCEPTED.read_text(encoding="utf-8").splitlines():
        if line.startswith(" "):
            found[name] = f"{found[name]} {line.strip()}".strip()
        elif line and not line.startswith("#"):
            name = line
            found[name] = ""
    return found


def of_group(group: Group, root: Path = ROOT) -> list[Mutant]:
    """All mistakes in the files of a group, as they are in the tree `root`."""
    found = [m for f in group.files(root) for m in mutants(f, (root / f).read_text(encoding="utf-8"))]
    return [m for m in found if m.kind not in group.leave]


def main() -> int:
    """The command; 1 when a mistake was not noticed that is not among the accepted ones."""
    arguments = _arguments()
    signal.signal(signal.SIGTERM, lambda *_: sys.exit("ended; what was tried is kept"))  # so that the copy is removed
    groups = [r for r in GROUPS if not arguments.group or r.name in arguments.group]

    def choose(root: Path) -> dict[Group, list[Mutant]]:
        return {r: [m for m in sample(of_group(r, root), arguments.most) if arguments.only in m.id] for r in groups}

    if arguments.list:
        for m in (m for found in choose(ROOT).values() for m in found):
            print(m.id)
        return 0
    known, count, new = accepted(), 0, 0
    with ExitStack() as stack:
        trees = [stack.enter_context(trial.copied_tree(ROOT))]  # what is written to the project from now on is not seen
        trees += [stack.enter_context(trial.copied_tree(trees[0])) for _ in range(arguments.processes - 1)]
        chosen = choose(trees[0])
        for group, found in chosen.items():
            for m in _unnoticed(group, found, trees):
                count += 1
                if m.id not in known:
                    new += 1
                    print(m.id, flush=True)  # at once: a group takes minutes
    total = sum(map(len, chosen.values()))
    print(f"{total} mistakes, {total - count} noticed, {count - new} accepted, {new} not noticed")
    return 1 if new else 0


def _unnoticed(group: Group, found: list[Mutant], trees: list[Path]) -> Iterator[Mutant]:
    """Mistakes of a group that its tests pass with; as many are tried at a time as there are copies of the project."""
    first_tree = trees[0]  # no mistake is in it yet
    tests, slower = group.test_files(first_tree), group.slower_files(first_tree)
    if not tests:
        sys.exit(f"group {group.name} has no tests: {', '.join(group.tests)}")
    files = sorted(
        {
            *trial.imported(first_tree, [*tests, *slower, *group.files(first_tree)]),
            *(first_tree / "tests").rglob("conftest.py"),
        }
    )
    texts = {m: mutated(m, (first_tree / m.file).read_text(encoding="utf-8")) for m in found}
    kept = {m: STORE / trial.content_key([m.id, text, *tests, *slower], files) for m, text in texts.items()}
    todo = [m for m in found if not kept[m].is_file()]
    if todo:
        usual = trial.baseline(first_tree, tests)
        if not usual.passed:
            sys.exit(f"group {group.name}: its tests fail as they are, without any mistake")
        trial.copy_bytecode(first_tree, trees[1:])
        limit = trial.LIMIT[0] + trial.LIMIT[1] * usual.seconds
        STORE.mkdir(parents=True, exist_ok=True)
        free: SimpleQueue[Path] = SimpleQueue()
        for tree in trees:
            free.put(tree)

        def attempt(m: Mutant) -> None:
            tree = free.get()
            try:
                with trial.changed(tree / m.file, texts[m]):
                    first = usual.callers.get(m.place, ())
                    passed = trial.passes(tree, tests, limit, first) and (not slower or trial.passes(tree, slower))
                kept[m].write_text("passed" if passed else "noticed")
            finally:
                free.put(tree)

        with ThreadPoolExecutor(len(trees)) as pool:
            tries = [pool.submit(attempt, m) for m in todo]
            try:
                for i, done in enumerate(as_completed(tries), start=1):
                    done.result()
                    if sys.stderr.isatty():
                        print(f"\r{group.name}: {i} of {len(todo)} ", end="", file=sys.stderr, flush=True)
            except BaseException:
                pool.shutdown(cancel_futures=True)
                raise
        if sys.stderr.isatty():
            print(file=sys.stderr)
    yield from (m for m in found if kept[m].read_text() == "passed")


def _arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser("python -m tests.mutants", description=__doc__)
    parser.add_argument(
        "--group",
        action="append",
        choices=[r.name for r in GROUPS],
        help="mutate only this group of files (repeatable)",
    )
    parser.add_argument("--only", default="", metavar="TEXT", help="mistakes whose name has this text")
    parser.add_argument("--most", type=int, default=3, metavar="N", help="of each kind in each file (default: 3)")
    parser.add_argument(
        "--processes",
        type=int,
        default=os.cpu_count() or 1,
        metavar="N",
        help="tried at a time (default: as many as there are cores)",
    )
    parser.add_argument("--list", action="store_true", help="name the mistakes and run nothing")
    return parser.parse_args()


if __name__ == "__main__":
    sys.exit(main())
