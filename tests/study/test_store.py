"""Stored runs: what their key covers, and that nothing else than what was stored is taken for a result."""

from __future__ import annotations

import dataclasses
import errno
import json
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import pyarrow as pa
import pytest
from pyarrow import parquet as pq

from build_fmus.base import extras, safe_files, sources
from build_fmus.base.safe_files import DamagedWarning
from cosim.experiments import EXPERIMENTS
from cosim.study import FmuSet, Search, key, load
from cosim.study.store import NotStored, RunStore, Store, Stored

ROOT = Path(sources.__file__).parents[2]
MASTER = {
    "cosim/__init__.py",
    "cosim/session.py",
    "cosim/recording/recording.py",
    "cosim/fmu/calls.py",
    "cosim/engine/exchange.py",
    "cosim/study/case.py",
    "cosim/study/runner.py",
    "cosim/study/experiment.py",
}
DEPENDS = {  # what each measures with, as far as it was forgotten before or easily would be
    "bench": {
        "cosim/experiments/steps.py",
        "fmu_sources/controllers/mpc/bench.py",
        "fmu_sources/controllers/lq/bench.py",
    },
    "gpc": {
        "cosim/experiments/metrics/response.py",
        "fmu_sources/controllers/gpc/identification.py",
        "cosim/experiments/gpc/matching.py",
        "fmu_sources/controllers/gpc/control_law.py",
        "fmu_sources/controllers/gpc/prediction.py",
    },
    "hmmwv": {
        "cosim/experiments/hmmwv/wiring.py",
        "cosim/experiments/steps.py",
        "fmu_sources/models/comfort.py",
        "fmu_sources/roads/bumps.py",
        "fmu_sources/controllers/mpc/hmmwv.py",
    },
    "force-tracking": {"cosim/experiments/hmmwv/tracking/runs.py", "cosim/experiments/hmmwv/wiring.py"},
    "preview-chain": {
        "cosim/experiments/hmmwv/preview/runs.py",
        "cosim/experiments/hmmwv/wiring.py",
        "fmu_sources/roads/bumps.py",
    },
    "preview-lq": {
        "cosim/experiments/preview_lq/runs.py",
        "fmu_sources/controllers/lq/preview_weights.py",
        "fmu_sources/controllers/lq/design/sampled.py",
        "fmu_sources/models/corners.py",
        "fmu_sources/controllers/lq/weights/road_holding.toml",
    },
    "three-axle": {
        "cosim/experiments/three_axle/runs.py",
        "cosim/experiments/steps.py",
        "fmu_sources/controllers/mpc/settings.py",
    },
    "trench": {"cosim/experiments/trench/runs.py", "cosim/experiments/metrics/crossing.py", "cosim/recording/peaks.py"},
}
LOADED = [load(place) for place in EXPERIMENTS.values()]
FOUND = {e.name: e for one in LOADED for e in one.every[1:]} | {one.name: one for one in LOADED}
"""Experiments and the parts of some."""


def searches(name: str) -> list[Search]:
    return [t for t in FOUND[name].tasks() if not hasattr(t, "case")] if name in EXPERIMENTS else []


def files(name: str) -> set[str]:
    found = key.code_files(FOUND[name], searches(name))
    return {p.relative_to(ROOT).as_posix() for p in found if p.is_relative_to(ROOT)}


@pytest.mark.parametrize("name", FOUND)
def test_one_byte_in_any_file_gives_another_key(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """Every module that wiring, run and measurement load, and every data file beside them.

    Each is a file of one byte here: hashing all of them for each would take time.
    """
    experiment = dataclasses.replace(FOUND[name], wiring=dataclasses.replace(FOUND[name].wiring, fmus=()))
    known = searches(name)
    covered = key.code_files(experiment, known)
    assert all(p.is_relative_to(ROOT) for p in covered)  # whose own releases are no other numbers
    assert files(name) >= MASTER | DEPENDS.get(name, set())
    assert not [p for p in files(name) if p.endswith("claims.toml")]  # another sentence repeats no run
    read = Path.read_bytes
    modules = tuple(key.entry_modules(experiment, known))
    found, libraries = {modules: sources.imported(modules)}, sources.libraries(modules)
    versions = key.versions(libraries)
    monkeypatch.setattr(key, "imported", lambda m: found[tuple(m)])  # a comment changes neither what is imported
    monkeypatch.setattr(key, "libraries", lambda _: libraries)
    monkeypatch.setattr(key, "versions", lambda _: versions)  # nor what is installed
    monkeypatch.setattr(key, "entry_modules", lambda *_: modules)
    content = dict.fromkeys(covered, b"a")
    monkeypatch.setattr(Path, "read_bytes", lambda p: content[p] if p in content else read(p))
    before = key.salt(experiment, FmuSet(), searches=known)
    assert key.salt(experiment, FmuSet(), searches=known) == before
    for changed in covered:
        content[changed] = b"b"
        assert key.salt(experiment, FmuSet(), searches=known) != before, changed
        content[changed] = b"a"


def test_the_last_byte_of_a_long_file_counts(tmp_path: Path) -> None:
    """A file of 2 MiB, of code or an FMU."""
    path, content = tmp_path / "long.fmu", bytes(2**21)
    path.write_bytes(content)
    before = key.content_hash([path])
    path.write_bytes(content[:-1] + b"1")
    assert key.content_hash([path]) != before


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
    experiment = dataclasses.replace(FOUND["bench"], wiring=dataclasses.replace(FOUND["bench"].wiring, fmus=("A",)))
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
        "build_fmus/base/units.py",
        "cosim/__init__.py",
        "build_fmus/qp_sources.py",
        "build_fmus/base/safe_files/whole.py",
    } <= names


def test_a_users_neighbors_and_data_count(tmp_path: Path) -> None:
    """Modules beside a user's file, relative imports, and the data files that it names; nothing else of its folder."""
    (tmp_path / "mine.py").write_text(
        "import helper\nfrom .part import x\nTABLE = 'road.csv'\nfrom typing import TYPE_CHECKING\nif TYPE_CHECKING:\n "
        "   import unseen\n"
    )
    for name in ("helper.py", "part.py", "unseen.py", "other.py", "road.csv", "other.csv"):
        (tmp_path / name).write_text("")
    names = {p.name for p in sources.imported([tmp_path / "mine.py"])}
    assert names == {"mine.py", "helper.py", "part.py", "road.csv"}


def test_libraries_that_modules_import(tmp_path: Path) -> None:
    (tmp_path / "mine.py").write_text("import os, scipy.signal\nimport helper\n")
    (tmp_path / "helper.py").write_text("def late():\n    from pandas import DataFrame\n")
    assert sources.libraries([tmp_path / "mine.py"]) == {"scipy", "pandas"}


def runs(folder: Path, salt: str = "salt") -> RunStore:
    return RunStore(Store(folder), salt)


def test_a_stored_result_is_found_under_its_key_and_salt_only(tmp_path: Path) -> None:
    store = runs(tmp_path)
    assert store.put(["case", 1], {"J": 1.5, "pair": (1, 2)}) == {"J": 1.5, "pair": [1, 2]}
    assert store.get(["case", 1]) == {"J": 1.5, "pair": [1, 2]}
    for other, name in ((store, ["case", 2]), (runs(tmp_path, "other"), ["case", 1])):
        assert other.find(name) is None
        with pytest.raises(NotStored):
            other.get(name)


ODD = {
    "nan": float("nan"),
    "inf": float("inf"),
    "text": "a b\nü\u2028",
    "none": None,
    "deep": [[0.1, -0.0, 1e-320], {"x": True}],
}


@pytest.mark.parametrize("flushed", [False, True])
def test_what_is_read_is_what_was_stored(tmp_path: Path, flushed: bool) -> None:
    """To the last bit, from lines and from a batch, by this process and by the next one."""
    store = runs(tmp_path)
    store.put("odd", ODD)
    if flushed:
        store.store.flush()
    assert [p.suffix for p in tmp_path.iterdir()] == [".parquet" if flushed else ".lines"]
    for reader in (store, runs(tmp_path)):
        assert json.dumps(reader.get("odd")) == json.dumps(ODD)


def test_batches(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Ten results in batches of four: two files of Parquet, and a file of lines until the end."""
    monkeypatch.setattr(Store, "RESULTS", 4)
    store = runs(tmp_path)
    for i in range(10):
        store.put(i, {"n": i})
    assert sorted(p.suffix for p in tmp_path.iterdir()) == [".lines", ".parquet", ".parquet"]
    store.store.flush()
    table = pq.read_table(tmp_path)
    assert table.column_names == ["key", "sha256", "entry"]
    assert sorted(json.loads(t)["n"] for t in table["entry"].to_pylist()) == list(range(10))
    monkeypatch.setattr(Store, "CACHE", 1)  # one batch at a time in memory
    for reader in (store, runs(tmp_path)):
        assert [reader.get(i)["n"] for i in reversed(range(10))] == list(reversed(range(10)))
        assert len(reader.store) == 10


def test_a_batch_ends_when_it_is_large(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(Store, "SIZE", 1000)
    store = runs(tmp_path)
    store.put(1, {"z": [0.5] * 100})
    assert [p.suffix for p in tmp_path.iterdir()] == [".lines"]
    store.put(2, {"z": [0.5] * 200})
    assert [p.suffix for p in tmp_path.iterdir()] == [".parquet"]


def test_what_was_stored_last_counts(tmp_path: Path) -> None:
    """A run that failed and was made again, in the same batch and in another."""
    store = runs(tmp_path)
    for value in ("failed", "better"):
        store.put("run", {value: ""})
    assert store.get("run") == runs(tmp_path).get("run") == {"better": ""}
    store.store.flush()
    store.put("run", {"best": ""})
    assert store.get("run") == runs(tmp_path).get("run") == {"best": ""}
    store.store.flush()
    assert store.get("run") == runs(tmp_path).get("run") == {"best": ""}


WRITER = """
import os, signal, sys
from pathlib import Path
from cosim.study.store import RunStore, Store
store = RunStore(Store(Path(sys.argv[1])), "salt")
for i in range(int(sys.argv[2])):
    store.put(i, {"n": i})
os.kill(os.getpid(), signal.SIGKILL)
"""


@pytest.mark.skipif(os.name == "nt", reason="sends signals")
def test_a_killed_process_loses_nothing_that_it_was_given(tmp_path: Path) -> None:
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    subprocess.run([sys.executable, "-c", WRITER, str(tmp_path), "5000"], env=environment, check=False)
    assert sorted(p.suffix for p in tmp_path.iterdir()) == [".lines", ".parquet"]
    store = runs(tmp_path)
    assert [store.get(i)["n"] for i in range(5000)] == list(range(5000))


def test_half_a_line_costs_one_result(tmp_path: Path) -> None:
    """What a power failure leaves; what is written from then on goes into another file."""
    store = runs(tmp_path)
    for i in range(3):
        store.put(i, {"n": i})
    (path,) = tmp_path.iterdir()
    path.write_bytes(path.read_bytes()[:-5])
    after = runs(tmp_path)
    assert [after.find(i) for i in range(3)] == [{"n": 0}, {"n": 1}, None]
    after.put(2, {"n": 2})
    assert [runs(tmp_path).find(i) for i in range(3)] == [{"n": 0}, {"n": 1}, {"n": 2}]


def test_two_processes_see_what_the_other_has_stored(tmp_path: Path) -> None:
    one, other = runs(tmp_path), runs(tmp_path)
    one.put(1, {"n": 1})
    assert other.get(1) == {"n": 1}
    other.put(2, {"n": 2})
    assert one.get(2) == {"n": 2}
    one.store.flush()  # its lines are gone, and what was read of them is still right
    assert other.get(1) == {"n": 1}
    one.put(3, {"n": 3})
    one.store.flush()
    assert other.get(3) == {"n": 3}
    other.store.flush()
    assert [runs(tmp_path).get(i)["n"] for i in (1, 2, 3)] == [1, 2, 3]


def test_lines_of_workers_are_taken_over(tmp_path: Path) -> None:
    worker = RunStore(Store(tmp_path, "group"), "salt")
    worker.put(1, {"n": 1})
    other = RunStore(Store(tmp_path, "others"), "salt")
    other.put(2, {"n": 2})
    worker.store.close()
    parent = runs(tmp_path)
    parent.store.absorb("group")
    assert sorted(p.suffix for p in tmp_path.iterdir()) == [".lines", ".parquet"]
    assert [parent.get(i)["n"] for i in (1, 2)] == [1, 2]


class Full:
    """A file on a disk with room for `room` more bytes."""

    def __init__(self, file: Any, room: int) -> None:
        self.file, self.room = file, room

    def write(self, data: Any) -> int:
        if not self.room:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        written: int = self.file.write(bytes(data)[: self.room])
        self.room -= written
        return written

    def __getattr__(self, name: str) -> Any:
        return getattr(self.file, name)


def test_a_full_disk_keeps_what_is_there(tmp_path: Path, raises) -> None:
    """The error names the file, no half line stays, and with room again the same process goes on."""
    store = runs(tmp_path)
    store.put(1, {"n": 1})
    (path,) = tmp_path.iterdir()
    whole = path.read_bytes()
    store.store._file = Full(store.store._file, 20)
    with raises(OSError) as caught:
        store.put(2, {"n": 2})
    assert caught.value.filename == str(path)
    assert "free disk space there" in safe_files.sentence(caught.value)
    assert path.read_bytes() == whole
    assert store.find(2) is None
    store.store._file = store.store._file.file
    store.put(3, {"n": 3})
    store.store.flush()
    assert [runs(tmp_path).find(i) for i in (1, 2, 3)] == [{"n": 1}, None, {"n": 3}]


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="a disk that is full")
def test_a_batch_that_does_not_fit_leaves_its_lines(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, raises) -> None:
    store = runs(tmp_path)
    store.put(1, {"n": 1})

    def full(*_: Any, **__: Any) -> None:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr(pq, "write_table", full)
    with raises(OSError):
        store.store.flush()
    assert [p.suffix for p in tmp_path.iterdir()] == [".lines"]
    assert runs(tmp_path).get(1) == {"n": 1}


def edit(path: Path, old: str, new: str) -> None:
    """Change a stored text, in lines or in a batch."""
    if path.suffix == ".lines":
        path.write_text(path.read_text().replace(old, new))
    else:
        table = pq.read_table(path)
        texts = [t.replace(old, new) for t in table["entry"].to_pylist()]
        pq.write_table(table.set_column(2, "entry", pa.array(texts)), path)


@pytest.mark.parametrize("flushed", [False, True])
def test_an_edited_result_is_made_again(tmp_path: Path, flushed: bool, warns) -> None:
    store = runs(tmp_path)
    store.put(["case", 1], {"J": 1.5})
    store.put(["case", 2], {"J": 2.5})
    if flushed:
        store.store.flush()
    (path,) = tmp_path.iterdir()
    edit(path, "1.5", "0.5")
    store = runs(tmp_path)
    with warns(DamagedWarning), pytest.raises(NotStored):
        store.get(["case", 1])
    assert store.get(["case", 2]) == {"J": 2.5}
    store.put(["case", 1], {"J": 1.5})
    store.store.flush()
    assert runs(tmp_path).get(["case", 1]) == {"J": 1.5}


@pytest.mark.parametrize("content", [b"", b"no Parquet", b"PAR1" + bytes(100) + b"PAR1"])
def test_a_damaged_batch_is_discarded(tmp_path: Path, content: bytes) -> None:
    store = runs(tmp_path)
    store.put(1, {"n": 1})
    store.store.flush()
    store.put(2, {"n": 2})
    (path,) = tmp_path.glob("*.parquet")
    path.write_bytes(content)
    with pytest.warns(DamagedWarning, match=path.name):
        after = runs(tmp_path)
    assert not path.exists()
    assert [after.find(i) for i in (1, 2)] == [None, {"n": 2}]


def test_columns_of_something_else(tmp_path: Path) -> None:
    """Parquet by somebody else is no batch."""
    path = tmp_path / "1.parquet"
    pq.write_table(pa.table({"key": [1, 2], "x": [0.5, 1.5]}), path)
    with pytest.warns(DamagedWarning, match="1.parquet"):
        assert len(Store(tmp_path)) == 0


def test_results_that_are_read_when_asked_for(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    store = runs(tmp_path)
    for i in range(5):
        store.put(i, {"n": [i] * 10})
    monkeypatch.setattr(Stored, "CACHE", 100)
    found = Stored(store.store, [store.name(i) for i in (3, 1, 3)])
    assert [e["n"][0] for e in found] == [3, 1, 3]
    assert found[0] is found[0]
    assert len(found) == 3


def test_without_parquet_lines_stay_lines(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(extras, "missing", lambda extra: extra == "reports")
    monkeypatch.setattr(Store, "RESULTS", 2)
    store = runs(tmp_path)
    for i in range(5):
        store.put(i, {"n": i})
    store.store.flush()
    assert {p.suffix for p in tmp_path.iterdir()} == {".lines"}
    assert [reader.get(i)["n"] for reader in (store, runs(tmp_path)) for i in range(5)] == [*range(5)] * 2


def test_reading_a_batch_starts_no_thread(tmp_path: Path) -> None:
    """Threads of Arrow that let go of a file when the interpreter has ended abort the process: one sweep in 250."""
    path = tmp_path / "a.parquet"
    pq.write_table(pa.table({"a": [0.5 * k for k in range(4096)]}), path)
    code = f"""
import os, pathlib
from cosim.recording.formats import parquet_table
count = lambda: len(os.listdir("/proc/self/task"))
import pyarrow.parquet
before = count()
table = parquet_table(pathlib.Path({str(path)!r}))
print(table.num_rows, count() - before)
"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.split() == ["4096", "0"]
