"""``python -m tests.mutants``: make mistakes, run the tests that should notice, list the mistakes that none noticed."""

from __future__ import annotations

import argparse
import signal
import sys
from collections.abc import Iterator
from pathlib import Path

from . import trial
from .mutations import Mutant, mutants, mutated, sample
from .rooms import ROOMS, ROOT, Room

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


def of_room(room: Room) -> list[Mutant]:
    """All mistakes in the files of a room."""
    found = [m for f in room.files() for m in mutants(f.relative_to(ROOT).as_posix(), f.read_text(encoding="utf-8"))]
    return [m for m in found if m.kind not in room.leave]


def main() -> int:
    """The command; 1 when a mistake was not noticed that is not among the accepted ones."""
    arguments = _arguments()
    signal.signal(signal.SIGTERM, lambda *_: sys.exit("ended; what was tried is kept"))  # so that the copy is removed
    rooms = [r for r in ROOMS if not arguments.room or r.name in arguments.room]
    chosen = {r: [m for m in sample(of_room(r), arguments.most) if arguments.only in m.id] for r in rooms}
    if arguments.list:
        for m in (m for found in chosen.values() for m in found):
            print(m.id)
        return 0
    known, count, new = accepted(), 0, 0
    with trial.copied_tree(ROOT) as tree:
        for room, found in chosen.items():
            for m in _unnoticed(room, found, tree):
                count += 1
                if m.id not in known:
                    new += 1
                    print(m.id, flush=True)  # at once: a room takes minutes
    total = sum(map(len, chosen.values()))
    print(f"{total} mistakes, {total - count} noticed, {count - new} accepted, {new} not noticed")
    return 1 if new else 0


def _unnoticed(room: Room, found: list[Mutant], tree: Path) -> Iterator[Mutant]:
    """Mistakes of a room that its tests pass with."""
    from build_fmus.sources import imported

    tests, slower = (
        [p.relative_to(ROOT).as_posix() for p in files] for files in (room.test_files(), room.slower_files())
    )
    if not tests:
        sys.exit(f"room {room.name} has no tests: {', '.join(room.tests)}")
    files = sorted(
        {*imported([*room.test_files(), *room.slower_files(), *room.files()]), *(ROOT / "tests").rglob("conftest.py")}
    )
    limit: float | None = None
    for i, m in enumerate(found, start=1):
        text = mutated(m, (ROOT / m.file).read_text(encoding="utf-8"))
        kept = STORE / trial.content_key([m.id, text, *tests, *slower], files)
        if not kept.is_file():
            if limit is None:
                well, seconds = trial.timed(tree, tests)
                if not well:
                    sys.exit(f"room {room.name}: its tests fail as they are, without any mistake")
                limit = trial.LIMIT[0] + trial.LIMIT[1] * seconds
            with trial.changed(tree / m.file, text):
                passed = trial.passes(tree, tests, limit) and (not slower or trial.passes(tree, slower))
                result = "passed" if passed else "noticed"
            STORE.mkdir(parents=True, exist_ok=True)
            kept.write_text(result)
        if sys.stderr.isatty():
            print(f"\r{room.name}: {i} of {len(found)} ", end="", file=sys.stderr, flush=True)
        if kept.read_text() == "passed":
            yield m
    if sys.stderr.isatty():
        print(file=sys.stderr)


def _arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser("python -m tests.mutants", description=__doc__)
    parser.add_argument(
        "--room", action="append", choices=[r.name for r in ROOMS], help="of this room alone; several may be given"
    )
    parser.add_argument("--only", default="", metavar="TEXT", help="mistakes whose name has this text")
    parser.add_argument("--most", type=int, default=3, metavar="N", help="of each kind in each file (default: 3)")
    parser.add_argument("--list", action="store_true", help="name the mistakes and run nothing")
    return parser.parse_args()


if __name__ == "__main__":
    sys.exit(main())
