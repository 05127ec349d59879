"""Code blocks, command lines and links of the Markdown pages, and what programs print."""

from __future__ import annotations

import math
import re
from functools import cache
from pathlib import Path

ROOT = Path(__file__).parents[1]
PAGES = [ROOT / "README.md", *sorted((ROOT / "docs").rglob("*.md"))]

_FENCE = re.compile(r"^```(\w*)\n(.*?)^```", re.MULTILINE | re.DOTALL)


def blocks(page: Path, language: str) -> list[str]:
    """Fenced blocks of a language, in order."""
    return [text for name, text in _FENCE.findall(page.read_text(encoding="utf-8")) if name == language]


def transcripts(page: Path) -> list[tuple[list[str], str]]:
    """(arguments, expected output) of each command in the page's console blocks."""
    found = []
    for block in blocks(page, "console"):
        for part in re.split(r"^\$ ", block, flags=re.MULTILINE)[1:]:
            command, _, output = part.partition("\n")
            found.append((command.split(), output))
    return found


def links(page: Path) -> list[str]:
    """Targets of links and images to files of the repository."""
    text = _FENCE.sub("", page.read_text(encoding="utf-8"))
    targets = re.findall(r"\]\(([^)\s]+)\)", text)
    return [t for t in targets if "://" not in t]


def headings(page: Path) -> set[str]:
    """Anchors of the page's headings, as GitHub makes them."""
    text = _FENCE.sub("", page.read_text(encoding="utf-8"))
    titles = re.findall(r"^#+ (.*)$", text, re.MULTILINE)
    return {re.sub(r"[^\w\- ]", "", t.lower()).replace(" ", "-") for t in titles}


def section(page: str, title: str) -> str:
    """What stands below a heading of a page in `docs`, up to the next heading."""
    text = (ROOT / "docs" / page).read_text(encoding="utf-8")
    found = re.search(rf"^#+ {re.escape(title)}\n(.*?)(?=^#|\Z)", text, re.MULTILINE | re.DOTALL)
    assert found is not None, f"{page} has no section {title!r}"
    return found[1]


def words(text: str) -> list[str]:
    """Words of an output without times and speeds of the machine."""
    text = re.sub(r"\d+x real time|\(\d+(\.\d+)? s\)", "", text)
    return text.split()


def same(shown: str, printed: str) -> bool:
    """Whether two words are equal, or numbers that are close: platforms differ in the last digits."""
    try:
        return math.isclose(float(shown), float(printed), rel_tol=0.02, abs_tol=2e-5)
    except ValueError:
        return shown == printed


@cache
def help_of(*command: str) -> str:
    """What `cosim COMMAND --help` prints; of a command that needs the name of an experiment, with one."""
    from click.testing import CliRunner

    from cosim.cli import app
    from cosim.experiments import EXPERIMENTS, IDENTIFY

    result = CliRunner().invoke(app, [*command, "--help"], env={"COLUMNS": "200"})
    assert result.exit_code == 0, result.output
    names = IDENTIFY if command == ("identify",) else EXPERIMENTS
    return help_of(*command, min(names)) if "COMMAND [ARGS]" in result.output else result.output
