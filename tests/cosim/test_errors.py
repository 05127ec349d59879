"""Whoever catches CosimError catches every error that the master and its studies raise on purpose."""

from __future__ import annotations

import importlib
import pickle

import pytest

from cosim import CosimError, FormatError, Recording
from cosim.study import design

PUBLIC = ("cosim", "cosim.study", "cosim.batch", "cosim.check", "cosim.tables", "cosim.gym")


@pytest.mark.parametrize("module", PUBLIC)
def test_public_errors_are_of_one_class(module):
    found = importlib.import_module(module)
    named = {name: getattr(found, name) for name in found.__all__}
    errors = {
        n for n, o in named.items() if isinstance(o, type) and issubclass(o, Exception) and not issubclass(o, Warning)
    }
    assert {n for n in errors if not issubclass(named[n], CosimError)} == set()


def test_errors_of_files_and_designs_are_among_them(tmp_path, raises):
    with pytest.raises(CosimError, match="junk"):
        Recording.read(tmp_path / "junk.junk")
    with raises(CosimError):
        design.Design(())
    for error in (FormatError("text"), design.DesignError("text")):
        assert isinstance(error, ValueError)
        again = pickle.loads(pickle.dumps(error))
        assert (type(again), str(again)) == (type(error), "text")
