"""`make test` runs all tests that there are."""

from __future__ import annotations

from fnmatch import fnmatch

import pytest
from pages import ROOT


def test_no_folder_of_tests_is_passed_over(pytestconfig: pytest.Config) -> None:
    """pytest does not look into folders of some names, such as ``build``, unless it is told to."""
    passed_over = pytestconfig.getini("norecursedirs")
    assert passed_over
    for file in (ROOT / "tests").rglob("test_*.py"):
        for folder in file.relative_to(ROOT).parts[:-1]:
            assert not [p for p in passed_over if fnmatch(folder, p)], file
