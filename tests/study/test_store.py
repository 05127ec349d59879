"""Stored runs: what their key covers, and that nothing else than what was stored is taken for a result."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import pytest

from build_fmus import sources
from build_fmus.safe_files import DamagedWarning
from cosim.experiments import EXPERIMENTS
from cosim.study import FmuSet, Search, key, load
from cosim.study.store import NotStored, RunStore

ROOT = Path(sources.__file__).parents[1]
MASTER = {
    "cosim/__init__.py", "cosim/session.py", "cosim/recording.py", "cosim/fmu/calls.py", "cosim/master/exchange.py",
    "cosim/study/case.py", "cosim/study/runner.py", "cosim/study/experiment.py",
}  # fmt: skip
DEPENDS = {  # what each measures with, as far as it was forgotten before or easily would be
    "bench": {"cosim/experiments/steps.py", "fmu_sources/controllers/mpc/bench.py", "fmu_sources/controllers/lq/bench.py"},
    "gpc": {"cosim/experiments/metrics/response.py", "fmu_sources/controllers/gpc/identification.py",
            "cosim/experiments/gpc/matching.py", "fmu_sources/controllers/gpc/law.py", "fmu_sources/controllers/gpc/prediction.py"},
    "hmmwv": {"cosim/experiments/hmmwv/wiring.py", "cosim/experiments/steps.py", "fmu_sources/models/comfort.py",
              "fmu_sources/roads/bumps.py", "fmu_sources/controllers/mpc/hmmwv.py"},
    "force-tracking": {"cosim/experiments/hmmwv/tracking/runs.py", "cosim/experiments/hmmwv/wiring.py"},
    "preview-chain": {"cosim/experiments/hmmwv/preview/runs.py", "cosim/experiments/hmmwv/wiring.py", "fmu_sources/roads/bumps.py"},
    "preview-lq": {"cosim/experiments/preview_lq/runs.py", "fmu_sources/controllers/lq/preview_weights.py",
                   "fmu_sources/controllers/lq/design/sampled.py", "fmu_sources/models/corners.py",
                   "fmu_sources/controllers/lq/weights/road_holding.toml"},
    "three-axle": {"cosim/experiments/three_axle/runs.py", "cosim/experiments/steps.py",
                   "fmu_sources/controllers/mpc/settings.py"},
    "trench": {"cosim/experiments/trench/runs.py", "cosim/experiments/metrics/crossing.py", "cosim/peaks.py"},
}  # fmt: skip
FOUND = {e.name: e for place in EXPERIMENTS.values() for e in load(place).every}
"""Experiments and the parts of some."""


def searches(name: str) -> list[Search]:
    return [t for t in FOUND[name].tasks() if not hasattr(t, "case")] if name in EXPERIMENTS else []


def files(name: str) -> set[str]:
    found = key.code_files(FOUND[name], searches(name))
    return {p.relative_to(ROOT).as_posix() for p in found if p.is_relative_to(ROOT)}


@pytest.mark.parametrize("name", FOUND)
def test_one_byte_in_any_file_gives_another_key(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """Every module that wiring, run and measurement load, and every data file beside them."""
    experiment = dataclasses.replace(FOUND[name], fmus=())
    known = searches(name)
    covered = key.code_files(experiment, known)
    before = key.salt(experiment, FmuSet(), searches=known)
    assert key.salt(experiment, FmuSet(), searches=known) == before
    assert files(name) >= MASTER | DEPENDS.get(name, set())
    read = Path.read_bytes
    for changed in covered:
        monkeypatch.setattr(Path, "read_bytes", lambda p: read(p) + (b"\n#" if p == changed else b""))  # noqa: B023
        assert key.salt(experiment, FmuSet(), searches=known) != before, changed
        monkeypatch.undo()


@pytest.mark.parametrize("name", FOUND)
def test_pages_are_no_part_of_the_key(name: str) -> None:
    """A study of hours is not made again for another caption."""
    assert not {
        f for f in files(name) if f.rpartition("/")[2] in ("report.py", "claims.py") or f.startswith("cosim/report/")
    }


def test_a_part_and_the_whole_are_kept_apart() -> None:
    """A change of the force tracking makes no run of the vehicle anew."""
    assert not {f for f in files("hmmwv") if "/tracking/" in f or "/preview/" in f}


def test_fmus_and_libraries_are_part_of_the_key(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    fmu = tmp_path / "fmi3" / "A.fmu"
    fmu.parent.mkdir()
    fmu.write_bytes(b"one")
    experiment = dataclasses.replace(FOUND["bench"], fmus=("A",))
    before = key.salt(experiment, FmuSet(tmp_path))
    fmu.write_bytes(b"two")
    assert key.salt(experiment, FmuSet(tmp_path)) != before
    fmu.write_bytes(b"one")
    assert key.salt(experiment, FmuSet(tmp_path)) == before
    for library in ("numpy", "casadi"):
        version = key.metadata.version
        monkeypatch.setattr(key.metadata, "version", lambda n: "0.0" if n == library else version(n))  # noqa: B023
        assert key.salt(experiment, FmuSet(tmp_path)) != before, library
        monkeypatch.undo()


def test_all_packages_are_known() -> None:
    packages = {p.parent.name for p in ROOT.glob("*/__init__.py")} - {"benchmarks"}
    assert packages == set(sources.PACKAGES)


def test_imports_wherever_they_stand(tmp_path: Path) -> None:
    (tmp_path / "study.py").write_text("def late():\n    from cosim import units\nimport build_fmus.qp_sources as q\n")
    names = {str(p.relative_to(ROOT)) for p in sources.imported([tmp_path / "study.py"]) if p.is_relative_to(ROOT)}
    assert {
        "build_fmus/units.py",
        "cosim/__init__.py",
        "build_fmus/qp_sources.py",
        "build_fmus/safe_files/whole.py",
    } <= names


def test_a_users_neighbours_and_data_count(tmp_path: Path) -> None:
    """Modules beside a user's file, relative imports, and the data files that it names; nothing else of its folder."""
    (tmp_path / "mine.py").write_text(
        "import helper\nfrom .part import x\nTABLE = 'road.csv'\nfrom typing import TYPE_CHECKING\nif TYPE_CHECKING:\n    import unseen\n"
    )
    for name in ("helper.py", "part.py", "unseen.py", "other.py", "road.csv", "other.csv"):
        (tmp_path / name).write_text("")
    names = {p.name for p in sources.imported([tmp_path / "mine.py"])}
    assert names == {"mine.py", "helper.py", "part.py", "road.csv"}


def test_libraries_that_modules_import(tmp_path: Path) -> None:
    (tmp_path / "mine.py").write_text("import os, scipy.signal\nimport helper\n")
    (tmp_path / "helper.py").write_text("def late():\n    from pandas import DataFrame\n")
    assert sources.libraries([tmp_path / "mine.py"]) == {"scipy", "pandas"}


def test_a_stored_result_is_found_under_its_key_and_salt_only(tmp_path: Path) -> None:
    store = RunStore(tmp_path, "salt")
    assert store.put(["case", 1], {"J": 1.5, "pair": (1, 2)}) == {"J": 1.5, "pair": [1, 2]}
    assert store.get(["case", 1]) == {"J": 1.5, "pair": [1, 2]}
    for other, name in ((store, ["case", 2]), (RunStore(tmp_path, "other"), ["case", 1])):
        with pytest.raises(NotStored):
            other.get(name)


def test_an_edited_result_is_discarded(tmp_path: Path) -> None:
    store = RunStore(tmp_path, "salt")
    store.put(["case", 1], {"J": 1.5})
    (path,) = tmp_path.iterdir()
    path.write_text(path.read_text().replace("1.5", "0.5"))
    with pytest.warns(DamagedWarning, match=path.name), pytest.raises(NotStored):
        store.get(["case", 1])
    assert not path.exists()
