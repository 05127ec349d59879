"""The page on commands is that of the command line, and has every option that `--help` shows."""

from __future__ import annotations

import re
import runpy

import pytest
from pages import ROOT, help_of, section

WRITER = runpy.run_path(str(ROOT / "docs" / "write_commands.py"))
PAGE = WRITER["PAGE"]


def test_the_page_is_up_to_date() -> None:
    assert PAGE.read_text(encoding="utf-8") == WRITER["page"](), "run `python docs/write_commands.py`"


@pytest.mark.parametrize("command", WRITER["commands"]())
def test_every_option_is_on_the_page(command: str) -> None:
    """In the section of its command, or in that of the experiment whose case it chooses."""
    words = ["build"] if command == "build-fmus" else command.split()[1:]
    text = PAGE.read_text(encoding="utf-8")
    (own,) = re.findall(rf"^## {command}(?: NAME)?\n(.*?)(?=^## )", text, re.MULTILINE | re.DOTALL)
    case = section("reference/commands.md", "bench")
    options = set(re.findall(r"^ +(?:-\w, )?(--[a-z][\w-]*)", help_of(*words), re.MULTILINE))
    assert options - set(WRITER["EVERYWHERE"]) <= set(re.findall(r"--[a-z][\w-]*", own + case))
