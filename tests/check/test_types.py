"""C types are parsed before checks fork: what a fork parses, the fork of each check parses again."""

from __future__ import annotations

import gc
import zipfile
from collections.abc import Callable
from pathlib import Path

import pytest
from lxml import etree

import cosim.fmu.calls as fmi
from cosim.check import worker
from cosim.check.bench import Bench
from cosim.check.calls import Fmu
from cosim.check.model import read
from cosim.check.rules import CHECKS

USUAL = ("states.life", "states.allowed", "values.set", "runs.repeat", "saved", "derivatives.directional", "exchange")


@pytest.mark.parametrize("kind", ["cs", "me"])
@pytest.mark.parametrize("version", [2, 3])
def test_forks_parse_no_types(
    version: int, kind: str, faulty: Callable[..., Path], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(fmi, "_parsed", {})
    monkeypatch.setattr(gc, "freeze", lambda: None)
    worker._prepare_forks()
    known = set(fmi.ffi_of(str(version))._parsed_types)
    with zipfile.ZipFile(faulty(version)) as archive:
        archive.extractall(tmp_path)
    model = read(etree.parse(tmp_path / "modelDescription.xml").getroot())
    fmu = Fmu(model, tmp_path, dict.fromkeys(("cs", "me"), tmp_path / fmi.library_path(str(version), "faulty")))
    of_kind = [c for c in CHECKS.values() if c.id.startswith(USUAL) and kind in c.kinds and str(version) in c.versions]
    assert len(of_kind) > 5
    for check in of_kind:
        assert list(check.run(Bench(fmu, kind))) == []
    parsed = set(fmi.ffi_of(str(version))._parsed_types) - known
    assert {t for t in parsed if not t.startswith("_")} == set()
