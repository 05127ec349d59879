"""The README: its length, its code from a folder with built FMUs, its commands and its numbers.

The page on installation.
"""

from __future__ import annotations

import re
import shlex
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest
from pages import ROOT, blocks, help_of, same, words

from build_fmus.base import extras
from fmu_sources.catalog import PAPERS, default_catalog

README = ROOT / "README.md"
TEXT = README.read_text(encoding="utf-8")
INSTALL = ROOT / "docs" / "how-to" / "install.md"
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
RELEASE = (ROOT / ".ci" / "release.py").read_text(encoding="utf-8")
MAKEFILE = (ROOT / "Makefile").read_text(encoding="utf-8")
LONGEST, WIDEST, FIRST_SCREEN = 150, 120, 12
COUNTS = ("zero", "one", "two", "three", "four", "five", "six", "seven", "eight", "nine")


def test_it_is_short_and_begins_with_the_two_commands() -> None:
    lines = TEXT.splitlines()
    assert len(lines) <= LONGEST
    assert [line for line in lines if len(line) > WIDEST] == []
    first = "\n".join(lines[:FIRST_SCREEN])
    assert "    make run " in first
    assert "    make test " in first


def test_sections_are_in_order() -> None:
    assert re.findall(r"^## (.*)$", TEXT, re.MULTILINE) == [
        "Use one FMU",
        "Wire two FMUs",
        "Run an experiment",
        "The papers",
        "What else it can do",
        "Limits",
        "How to cite",
    ]


EXAMPLES = list(zip(blocks(README, "python"), blocks(README, "text"), strict=True))


@pytest.mark.parametrize(("code", "expected"), EXAMPLES, ids=["one FMU", "two FMUs"])
def test_code_prints_what_the_readme_shows(code: str, expected: str, workplace: Path) -> None:
    """Each block by itself, in a process of its own, without a warning."""
    done = subprocess.run([sys.executable, "-c", code], cwd=workplace, capture_output=True, text=True, check=False)
    assert (done.returncode, done.stderr) == (0, "")
    for shown, printed in zip(words(expected), words(done.stdout), strict=True):
        assert same(shown, printed), f"the README shows {expected}, its code prints {done.stdout}"


def test_code_is_short() -> None:
    one, two = ([line for line in code.splitlines() if line.strip()] for code, _ in EXAMPLES)
    assert len(one) <= 5
    assert len(two) <= 8


def commands(text: str) -> list[list[str]]:
    """Command lines of a page: in shell blocks, indented blocks and inline code."""
    fenced = re.findall(r"^```(?:shell|console)\n(.*?)^```", text, re.MULTILINE | re.DOTALL)
    prose = re.sub(r"^```.*?^```", "", text, flags=re.MULTILINE | re.DOTALL)
    lines = [line.removeprefix("$ ") for block in fenced for line in block.splitlines()]
    lines += re.findall(r"^    (\S.*)$", prose, re.MULTILINE) + re.findall(r"`([^`\n]+)`", prose)
    programs = ("make", "pip", "build-fmus", "cosim", "suspension-fmus")
    split = [shlex.split(part.replace("\\", "/"), comments=True) for line in lines for part in re.split("&&|;", line)]
    return [[Path(first).name, *others] for first, *others in filter(None, split) if Path(first).name in programs]


@pytest.mark.parametrize("page", [README, INSTALL], ids=lambda p: p.stem)
def test_shell_commands_exist(page: Path) -> None:
    """Targets of make, extras of pip, FMUs, and commands with their options."""
    found = commands(page.read_text(encoding="utf-8"))
    assert {"make", "pip", "build-fmus", "cosim"} <= {program for program, *_ in found}
    targets = set(re.findall(r"^([a-z-]+):", MAKEFILE, re.MULTILINE))
    for program, *arguments in found:
        options = [a for a in arguments if a.startswith("--")]
        names = [a for a in arguments if not a.startswith("-")]
        if program == "make":
            assert set(names) <= targets
        elif program == "pip":
            ((install, what),) = [names]
            assert install == "install"
            if wheel := re.fullmatch(rf"suspension_fmus-{re.escape(PROJECT['version'])}-py3-none-(\w+)\.whl", what):
                assert f'"{wheel[1]}"' in RELEASE
                continue
            assert set(re.findall(r"[a-z]+", what)) <= PROJECT["optional-dependencies"].keys()
        elif program == "build-fmus":
            assert set(names) <= {*default_catalog(), "all"}
            assert all(option in help_of("build") for option in options)
        elif names:
            command = names[:2] if names[0] in ("run", "study", "export") else names[:1]
            command = [n for n in command if n.islower() and not n.endswith(".py")]
            text = help_of(*command)  # which fails where there is no such command
            assert all(option in text for option in options), command


def test_numbers_have_their_source() -> None:
    """Numbers in prose; those of the examples and of the table of papers have tests of their own."""
    prose = re.sub(r"^```.*?^```|<!-- results.*end of results -->", "", TEXT, flags=re.MULTILINE | re.DOTALL)
    prose = re.sub(r"`[^`]*`|\]\([^)]*\)", "", prose)
    (height,) = re.findall(r'"road.height": ([\d.]+)', TEXT)
    sources = {
        PROJECT["requires-python"].removeprefix(">="),
        *(f"{version}.0" for version in ("2", "3") if f"fmus/fmi{version}/" in TEXT),
        f"{1000 * float(height):.0f}",
    }
    assert set(re.findall(r"(?<![\w.-])\d+(?:\.\d+)?", prose)) == sources
    run = MAKEFILE.split("\nrun: ")[1].split("\n\n")[0]
    assert f"runs {COUNTS[run.count('@$(BIN)/cosim study ')]} experiments" in TEXT
    assert f"the {COUNTS[len(PAPERS)]} papers" in TEXT
    assert PROJECT["license"] in TEXT


def test_installation_lists_the_extras_and_supported_pythons() -> None:
    text = INSTALL.read_text(encoding="utf-8")
    listed = re.findall(r"^\| `\[(\w+)\]` \|", text, re.MULTILINE)
    assert sorted(listed) == sorted([*extras.EXTRAS, *extras.OUTSIDE, "all", "zig"])
    assert set(listed) <= PROJECT["optional-dependencies"].keys()
    supported = [m[1] for c in PROJECT["classifiers"] if (m := re.search(r":: Python :: (3\.\d+)$", c))]
    assert f"Python {', '.join(supported[:-1])} or {supported[-1]}" in text
