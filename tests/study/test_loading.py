"""Files of users that cannot be imported: each is refused in a sentence."""

from __future__ import annotations

from pathlib import Path

import pytest

from build_fmus.base import extras
from cosim.study import ExperimentError, load


@pytest.mark.parametrize(
    "text",
    [
        "import no_such_module",
        "from cosim import Cosimulation",  # another project's
    ],
)
def test_what_a_file_imports_is_not_there(text: str, tmp_path: Path, raises) -> None:
    file = tmp_path / "mine.py"
    file.write_text(text + "\n")
    with raises(ExperimentError) as refused:
        load(str(file))
    assert str(file) in str(refused.value)


def test_a_missing_extra_is_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, raises) -> None:
    file = tmp_path / "mine.py"
    file.write_text("from build_fmus.base import extras\nextras.require('reports', 'this')\n")
    monkeypatch.setitem(extras.EXTRAS, "reports", ("no_such_module",))
    with raises(extras.MissingExtraError):
        load(str(file))
