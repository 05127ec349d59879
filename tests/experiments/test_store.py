"""Stored runs: what their key covers, and that nothing else than what was stored is taken for a result."""

from __future__ import annotations

from pathlib import Path

import pytest

from build_fmus import sources
from build_fmus.safe_files import DamagedWarning
from cosim.experiments import gpc, hmmwv, hmmwv_preview, hmmwv_tracking, three_axle, trench
from cosim.experiments.provenance import salt
from cosim.experiments.store import RunStore

MEASURE = {
    "gpc": [gpc],
    "hmmwv": [hmmwv, hmmwv_preview, hmmwv_tracking],
    "three_axle": [three_axle],
    "trench": [trench],
}
DEPENDS = {  # what each measures with, as far as it was forgotten before or easily would be
    "gpc": ["cosim/metrics.py", "fmu_sources/controllers/gpc_identification.py"],
    "hmmwv": ["cosim/experiments/hmmwv_wiring.py", "cosim/comfort.py", "fmu_sources/roads/bumps.py",
              "fmu_sources/vehicles/ride_car_hmmwv.toml", "fmu_sources/vehicles/loader.py"],
    "three_axle": ["cosim/experiments/cases.py", "fmu_sources/controllers/mpc_settings.py"],
    "trench": ["cosim/metrics_crossing.py"],
}  # fmt: skip
ROOT = Path(sources.__file__).parents[1]


@pytest.mark.parametrize("experiment", MEASURE)
def test_the_key_covers_what_a_run_is_made_with(experiment: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """A change of any of these files gives another key."""
    code = [m.__file__ for m in MEASURE[experiment]]
    before = salt([], code)
    assert salt([], code) == before
    read = Path.read_bytes
    master = ["cosim/master.py", "cosim/fmi_calls.py", "cosim/recording.py", "cosim/__init__.py"]
    for name in (*DEPENDS[experiment], *master):
        changed = ROOT / name
        assert changed.is_file()
        monkeypatch.setattr(Path, "read_bytes", lambda p: read(p) + (b"\n#" if p == changed else b""))  # noqa: B023
        assert salt([], code) != before, name
        monkeypatch.undo()


def test_pages_are_no_part_of_the_key() -> None:
    """A study of hours is not made again for another caption."""
    names = {p.name for m in (gpc, three_axle, trench) for p in sources.imported([m.__file__])}
    assert not {n for n in names if "report" in n}


def test_all_packages_are_known() -> None:
    packages = {p.parent.name for p in ROOT.glob("*/__init__.py")} - {"benchmarks"}
    assert packages == set(sources.PACKAGES)


def test_imports_wherever_they_stand(tmp_path: Path) -> None:
    (tmp_path / "study.py").write_text("def late():\n    from cosim import units\nimport build_fmus.qp_sources as q\n")
    names = {str(p.relative_to(ROOT)) for p in sources.imported([tmp_path / "study.py"]) if p.is_relative_to(ROOT)}
    assert {
        "cosim/units.py",
        "cosim/__init__.py",
        "build_fmus/qp_sources.py",
        "build_fmus/safe_files/whole.py",
    } <= names


def test_a_stored_run_is_made_once(tmp_path: Path) -> None:
    store = RunStore(tmp_path, "salt")
    assert store.get(["case", 1], lambda: {"J": 1.5}) == {"J": 1.5}
    assert store.get(["case", 1], lambda: {"J": 2.5}) == {"J": 1.5}
    assert RunStore(tmp_path, "other").get(["case", 1], lambda: {"J": 2.5}) == {"J": 2.5}


def test_an_edited_run_is_discarded_and_made_again(tmp_path: Path) -> None:
    store = RunStore(tmp_path, "salt")
    store.get(["case", 1], lambda: {"J": 1.5})
    (path,) = tmp_path.iterdir()
    path.write_text(path.read_text().replace("1.5", "0.5"))
    with pytest.warns(DamagedWarning, match=path.name):
        assert store.get(["case", 1], lambda: {"J": 1.5}) == {"J": 1.5}
    assert store.get(["case", 1], lambda: {"J": 3.5}) == {"J": 1.5}
