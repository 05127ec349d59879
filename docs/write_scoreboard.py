"""Write `reference/check-scoreboard.md`: the deliberate faults that each checker finds, and its false errors.

The latter are its errors for FMUs without a fault.

    python docs/write_scoreboard.py              # everything: a minute
    python docs/write_scoreboard.py NAME ...     # the rows of these faults; the others stay as they are

It needs the extra [test] and the FMUs of this project in fmus/. The faults are those of tests/foreign/faulty.py.
"""

from __future__ import annotations

import argparse
import re
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterable
from concurrent.futures import ThreadPoolExecutor
from importlib import metadata
from pathlib import Path

from fmpy.validation import validate_fmu

HERE = Path(__file__).resolve().parent
ROOT = HERE.parent
sys.path[:0] = [str(ROOT), str(ROOT / "tests")]  # the project first: tests/ has a folder cosim, too

from foreign.faulty import FAULTS, ODDITIES, build  # noqa: E402

PAGE = HERE / "reference" / "check-scoreboard.md"
OWN = ("QuarterCarHmmwv", "LqrHmmwv", "RoadSine", "GpcPreview")
SLOW = ("step-hang", "slow")  # whether one that takes long hangs cannot be told
PATIENCE = 30.0  # s, of a program
FOUND, MISSED = "yes", ""

Cell = dict[int, bool]  # FMI version -> whether it is noticed


def by_cosim_check(path: Path, version: int) -> bool:  # noqa: ARG001
    """That it finds each fault and accuses no FMU without one is what tests/check/test_faults.py asserts."""
    return path.stem.partition("_")[2] in FAULTS


def by_fmpy(path: Path, version: int) -> bool:  # noqa: ARG001
    try:
        return bool(validate_fmu(str(path)))
    except Exception:  # it refuses the FMU
        return True


def by_toolbox(path: Path, version: int) -> bool:  # noqa: ARG001
    return "ERROR" in run([str(Path(sys.executable).with_name("fmutool")), "-input", str(path), "-check"])


CHECKERS: dict[str, Callable[[Path, int], bool]] = {
    "`cosim check`": by_cosim_check,
    "`fmpy validate`": by_fmpy,
    "`fmutool -check`": by_toolbox,
}


def run(command: list[str]) -> str:
    """What a program prints; "ERROR" where it crashes or does not come back."""
    with tempfile.TemporaryDirectory() as folder:
        try:
            done = subprocess.run(
                command, capture_output=True, text=True, errors="replace", cwd=folder, timeout=PATIENCE, check=False
            )
        except subprocess.TimeoutExpired:
            return "ERROR"
    return done.stdout + done.stderr if done.returncode == 0 else "ERROR"


def noticed(cell: Cell) -> str:
    """A cell in words: in which versions."""
    yes = [v for v, found in cell.items() if found]
    return FOUND if yes == list(cell) else f"FMI {yes[0]}" if yes else MISSED


def row(name: str, paths: dict[int, Path]) -> str:
    """Of the table: one FMU in its versions, by all checkers."""
    print(name, flush=True)
    cells = [noticed({v: look(p, v) for v, p in paths.items()}) for look in CHECKERS.values()]
    return "| " + " | ".join([f"`{name}`", ", ".join(map(str, paths)), *cells]) + " |"


def faulty(names: Iterable[str], folder: Path) -> list[str]:
    """Rows of faults."""
    known = {**FAULTS, **ODDITIES}
    jobs = {n: {v: build(v, folder, n) for v in known[n].versions} for n in names if known[n].spoil is not None}
    with ThreadPoolExecutor(6) as pool:
        made = dict(zip(jobs, pool.map(lambda n: row(n, jobs[n]), jobs), strict=True))
    return [made.get(n) or coded(n, known[n].versions) for n in names]


def coded(name: str, versions: tuple[int, ...]) -> str:
    """The row of a fault in the code.

    Its description is that of the FMU without a fault, so what only reads notices nothing.
    """
    cells = [FOUND if name in FAULTS else MISSED, *[MISSED] * (len(CHECKERS) - 1)]
    return "| " + " | ".join([f"`{name}`", ", ".join(map(str, versions)), *cells]) + " |"


def right(folder: Path) -> list[str]:
    """Rows of FMUs without a fault."""
    own = {n: {v: ROOT / "fmus" / f"fmi{v}" / f"{n}.fmu" for v in (2, 3)} for n in OWN}
    plain = {"none": {v: build(v, folder) for v in (2, 3)}}
    with ThreadPoolExecutor(6) as pool:
        return [*faulty(allowed(), folder), *pool.map(lambda item: row(*item), {**plain, **own}.items())]


def allowed() -> list[str]:
    """Properties that the standard allows, of which no checker may make an error."""
    return [name for name in ODDITIES if name not in SLOW]


def rows_of(page: str) -> dict[str, str]:
    """Name -> row of the tables of a page."""
    return {m[1]: m[0] for m in re.finditer(r"(?m)^\| `([^`]+)` \|.*$", page)}


def counted(rows: Iterable[str]) -> list[tuple[int, int]]:
    """By checker: how many FMUs it notices, of how many; one in one version counts as noticed there."""
    cells = [[c.strip() for c in r.strip("|").split("|")][2:] for r in rows]
    return [(sum(c[i] != MISSED for c in cells), len(cells)) for i in range(len(CHECKERS))]


def text(faults: list[str], clean: list[str]) -> str:
    """The page."""
    head = "| " + " | ".join(["", "FMI", *CHECKERS]) + " |\n" + "|---" * (2 + len(CHECKERS)) + "|\n"
    versions = {"FMPy": "FMPy", "fmu_manipulation_toolbox": "FMU Manipulation Toolbox (`fmutool`)"}
    named = ", ".join(f"{title} {metadata.version(package)}" for package, title in versions.items())
    summary = "".join(
        f"| {checker} | {found} of {of} | {wrong} of {of_right} |\n"
        for checker, (found, of), (wrong, of_right) in zip(CHECKERS, counted(faults), counted(clean), strict=True)
    )
    return f"""# Checkers compared

<!-- written by docs/write_scoreboard.py -->

This page shows which of the deliberate faults in `tests/foreign/faulty.py` each checker finds, and for which FMUs
without a fault it reports an error. `cosim check` was developed with these faults, and tests assert its column
(`tests/check/test_faults.py`, `tests/conformance/test_compliance.py`). The table therefore shows that the command works
as documented, not that it finds unknown faults. The other checkers have a smaller scope: they read the model
description and do not run the FMU.

Versions: {named}.
Other checkers (FMUComplianceChecker, VDMCheck) are not available on PyPI.

| checker | faults found | errors in FMUs without a fault |
|---|---|---|
{summary}
A fault counts as found if `cosim check` has a finding, or if `fmpy validate` or `fmutool -check` report a problem.
"FMI 2" or "FMI 3" means that the fault is found in this version only.

## Faults

{head}{chr(10).join(faults)}

## FMUs without a fault

The first rows are FMUs with properties that the standard allows and that a checker may mistake for faults.

{head}{chr(10).join(clean)}
"""


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("names", nargs="*", choices=[*FAULTS, []], metavar="NAME", help="only the rows of these faults")
    names = parser.parse_args().names
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place)
        known = rows_of(PAGE.read_text()) if names else {}
        made = rows_of("\n".join(faulty(names or FAULTS, folder)))
        clean = (
            right(folder)
            if not names
            else [r for n, r in known.items() if n not in FAULTS and f"`{n}`" not in CHECKERS]
        )
        PAGE.write_text(text([({**known, **made})[n] for n in FAULTS], clean))


if __name__ == "__main__":
    main()
