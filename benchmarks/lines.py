"""`python -m benchmarks.lines [COMMIT]`: lines of code by package, of the working tree or of a commit.

Counts what git tracks: Python, C, JavaScript, CSS, HTML and templates, with blank lines and comments. Third-party code
is left out. Product: everything outside of `tests`.
"""

from __future__ import annotations

import argparse
import subprocess
from collections import Counter
from pathlib import PurePosixPath

ENDINGS = (".py", ".c", ".h", ".js", ".css", ".html", ".j2")
THIRD_PARTY = "third_party"
"""Name of the folders of third-party code."""


def count(commit: str | None = None) -> dict[str, int]:
    """Lines by package (`cosim/engine`, ...; files of a package itself under its name)."""
    pattern = ["-e", "", *([commit] if commit else []), "--", *(f"*{e}" for e in ENDINGS)]
    listed = subprocess.run(["git", "grep", "-c", *pattern], capture_output=True, text=True, check=True).stdout
    found: Counter[str] = Counter()
    for line in listed.splitlines():
        name, _, lines = line.removeprefix(f"{commit}:").rpartition(":")
        parts = PurePosixPath(name).parts
        if THIRD_PARTY not in parts:
            found["/".join(parts[: min(2, len(parts) - 1)]) or "."] += int(lines)
    return dict(found)


def main() -> None:
    """Print the table: one row per package, then product and tests."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.lines", description="Count lines of code by package.")
    parser.add_argument("commit", nargs="?", help="a commit instead of the working tree")
    commit = parser.parse_args().commit
    try:
        found = count(commit)
    except subprocess.CalledProcessError as error:
        parser.error(f"git cannot read {commit or 'this folder'}: {error.stderr.strip()}")
    tests = sum(n for package, n in found.items() if package.split("/")[0] == "tests")
    for package, n in [*sorted(found.items()), ("product", sum(found.values()) - tests), ("tests", tests)]:
        print(f"{n:7d}  {package}")


if __name__ == "__main__":
    main()
