"""Incremental builds: what is built, when, and in which order; the command line's messages."""

from __future__ import annotations

import re
import sys
import zipfile
from contextlib import nullcontext
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import pytest

from build_fmus import builder
from build_fmus.base import safe_files
from build_fmus.base.safe_files import DamagedWarning
from build_fmus.builder import Options, Stamps, levels, source_hash, with_needs
from fmu_sources import cli, registration
from fmu_sources.catalog import default_catalog


@dataclass(frozen=True)
class Entry:
    """A catalog entry of the tests."""

    name: str
    needs: tuple[str, ...] = ()
    files: tuple[Path, ...] = ()
    choices: str = ""


@dataclass
class Recorder:
    """A build task that writes empty FMUs and remembers what it was asked for. Runs in this process."""

    calls: list[tuple[str, tuple[int, ...]]] = field(default_factory=list)

    def __call__(self, name: str, options: Options, versions: tuple[int, ...]) -> None:
        self.calls.append((name, versions))
        for fmi in versions:
            target = options.target(name, fmi)
            target.parent.mkdir(parents=True, exist_ok=True)
            target.write_text(f"{name} {fmi}")


@pytest.fixture
def task(monkeypatch: pytest.MonkeyPatch) -> Recorder:
    def run(_self, task, jobs, options):  # type: ignore[no-untyped-def]
        for name, versions in jobs.items():
            task(name, options, versions)
            yield name

    monkeypatch.setattr(builder._Pool, "run", run)
    return Recorder()


def build(catalog: list[Entry], names: list[str], out: Path, task: Recorder, **options) -> list[str]:  # type: ignore[no-untyped-def]
    """Build and return the names built; `sources` defaults to unchanged code."""
    force, sources = options.pop("force", False), options.pop("sources", "code")
    return builder.build(
        {e.name: e for e in catalog}, names, Options(out, **options), sources=lambda _: sources, task=task, force=force
    )


def test_unchanged_fmus_are_not_rebuilt(tmp_path: Path, task: Recorder) -> None:
    catalog = [Entry("A"), Entry("B")]
    assert build(catalog, ["A", "B"], tmp_path, task) == ["A", "B"]
    assert task.calls == [("A", (2, 3)), ("B", (2, 3))]
    assert build(catalog, ["A", "B"], tmp_path, task) == []
    assert len(task.calls) == 2
    assert build(catalog, ["A"], tmp_path, task, force=True) == ["A"]


@pytest.mark.parametrize("change", ["file", "sources", "platform", "damaged", "missing", "stamp", "compiler"])
def test_any_change_rebuilds(change: str, tmp_path: Path, task: Recorder, monkeypatch: pytest.MonkeyPatch) -> None:
    vehicle = tmp_path / "vehicle.toml"
    vehicle.write_text("mass = 1")
    catalog, out, options = [Entry("A", files=(vehicle,)), Entry("B")], tmp_path / "out", {}
    build(catalog, ["A", "B"], out, task)
    expected = ["A"]
    target = Options(out).target("A", 2)
    if change == "file":
        vehicle.write_text("mass = 2")
    elif change == "damaged":
        target.write_text("?")
    elif change == "missing":
        target.unlink()
    elif change == "stamp":
        next((out / ".cache" / "stamps").glob("fmi2-A.json")).write_text("{")
    elif change == "compiler":
        monkeypatch.setenv("CC", "other-compiler")
        expected = ["A", "B"]
    else:
        options = {"sources": "new code"} if change == "sources" else {"platform": "all"}
        expected = ["A", "B"]
    task.calls.clear()
    with pytest.warns(DamagedWarning) if change in ("damaged", "stamp") else nullcontext():
        assert build(catalog, ["A", "B"], out, task, **options) == expected
    versions = (2,) if change in ("damaged", "missing", "stamp") else (2, 3)
    assert task.calls == [(n, versions) for n in expected]


@pytest.mark.parametrize("change", ["mass = 2", None])
def test_a_file_that_changes_during_the_build_is_built_again(
    change: str | None, tmp_path: Path, task: Recorder, warns
) -> None:
    """Nobody knows which of its contents went into the FMU."""
    vehicle = tmp_path / "vehicle.toml"
    vehicle.write_text("mass = 1")
    catalog, out = [Entry("A", files=(vehicle,))], tmp_path / "out"

    def edited(*job: Any) -> None:
        task(*job)
        vehicle.write_text(change) if change else vehicle.unlink()

    with warns(UserWarning):
        assert build(catalog, ["A"], out, edited) == ["A"]
    for content in ("mass = 2", "mass = 1"):
        vehicle.write_text(content)
        assert build(catalog, ["A"], out, task) == ["A"]
        assert build(catalog, ["A"], out, task) == []


def test_needs_come_first_and_in_the_version_makers_read(tmp_path: Path, task: Recorder) -> None:
    catalog = [Entry("Law", needs=("Plant", "Road")), Entry("Plant"), Entry("Road", needs=("Speed",)), Entry("Speed")]
    build(catalog, ["Law"], tmp_path, task, fmi=(2,))
    order = [n for n, _ in task.calls]
    assert order.index("Speed") < order.index("Road") < order.index("Law")
    assert order.index("Plant") < order.index("Law")
    assert dict(task.calls)["Law"] == (2,)
    assert all(3 in versions for n, versions in task.calls if n != "Law")


def test_levels_and_cycles(raises) -> None:
    catalog = {e.name: e for e in (Entry("A", needs=("B",)), Entry("B", needs=("C",)), Entry("C"), Entry("D"))}
    assert with_needs(catalog, ["A"]) == ["A", "B", "C"]
    assert list(levels(catalog, list(catalog))) == [["C", "D"], ["B"], ["A"]]
    cycle = {e.name: e for e in (Entry("A", needs=("B",)), Entry("B", needs=("A",)))}
    with raises(ValueError):
        list(levels(cycle, list(cycle)))


def test_a_failure_keeps_what_was_built(tmp_path: Path, task: Recorder) -> None:
    def failing(name: str, options: Options, versions: tuple[int, ...]) -> None:
        if name == "B":
            raise ValueError("B is broken")
        task(name, options, versions)

    catalog = [Entry("A"), Entry("B")]
    with pytest.raises(ValueError, match="B is broken"):
        build(catalog, ["A", "B"], tmp_path, failing)  # type: ignore[arg-type]
    assert build(catalog, ["A", "B"], tmp_path, task) == ["B"]


def test_stamps_of_damaged_directories(tmp_path: Path) -> None:
    stamps = Stamps(tmp_path)
    assert not stamps.fresh(tmp_path / "fmi2" / "A.fmu", "key")


def test_source_hash_sees_content_and_names(tmp_path: Path) -> None:
    (tmp_path / "a.py").write_text("1")
    first = source_hash(tmp_path)
    (tmp_path / "notes.txt").write_text("not a source")
    (tmp_path / "__pycache__").mkdir()
    (tmp_path / "__pycache__" / "a.py").write_text("2")
    assert source_hash(tmp_path) == first
    (tmp_path / "a.py").rename(tmp_path / "b.py")
    assert source_hash(tmp_path) != first


def test_an_edit_of_the_master_builds_what_is_made_with_it(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "own.py").write_text("from cosim import System\n")
    catalog = {**default_catalog(), "Own": Entry("Own", files=(tmp_path / "own.py",))}
    before = {n: cli.code_of_makers()(e) for n, e in catalog.items()}
    monkeypatch.setattr(cli, "code_hash", lambda modules: f"another master of {modules}")
    after = {n: cli.code_of_makers()(e) for n, e in catalog.items()}
    assert [n for n in catalog if before[n] != after[n]] == ["GpcImplicit", "GpcExplicit", "GpcPreview", "Own"]


def test_modules_with_declarations_are_known() -> None:
    package = Path(registration.__file__).parent
    files = {p for p in package.rglob("*.py") if "\n@component(" in p.read_text()}
    assert files == {package / f"{m.replace('.', '/')}.py" for m in registration.MODULES}


def test_a_declaration_takes_literals(tmp_path: Path) -> None:
    path = tmp_path / "own.py"
    path.write_text('NAME = "Own"\n\n\n@component(NAME, "text")\ndef own(name): ...\n')
    with pytest.raises(ValueError, match=r"own\.py:4: a declaration of the catalog takes literals only"):
        registration.read(path, "own")


def test_list_names_the_whole_catalog(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture) -> None:
    monkeypatch.setattr(sys, "argv", ["build-fmus", "--list"])
    with pytest.raises(SystemExit) as end:
        cli.main()
    assert not end.value.code
    said = capsys.readouterr().out
    for name in cli.load_catalog():
        assert name in said


def test_a_damaged_fmu_and_a_changed_stamp_are_named(tmp_path: Path, task: Recorder, warns) -> None:
    build([Entry("A")], ["A"], tmp_path, task)
    target = Options(tmp_path).target("A", 3)
    target.write_text("A 4")
    with warns(DamagedWarning, match=re.escape(str(target))):
        assert build([Entry("A")], ["A"], tmp_path, task) == ["A"]
    stamp = tmp_path / ".cache" / "stamps" / "fmi3-A.json"
    stamp.write_text(stamp.read_text().replace('"key": "', '"key": "0'))
    with warns(DamagedWarning, match=re.escape(str(stamp))):
        assert build([Entry("A")], ["A"], tmp_path, task) == ["A"]


def test_force_uses_nothing_that_was_kept(tmp_path: Path) -> None:
    """A wrong library in the cache, with a hash that fits, gets into a build, but not into a forced one."""
    options = Options(tmp_path, fmi=(3,))

    def binary(**how: bool) -> bytes:
        options.target("SpeedProfile", 3).unlink(missing_ok=True)
        assert cli.build(["SpeedProfile"], options, **how) == ["SpeedProfile"]
        with zipfile.ZipFile(options.target("SpeedProfile", 3)) as z:
            return next(z.read(n) for n in z.namelist() if n.startswith("binaries/"))

    sound = binary()
    wrong = sound + b"more"
    objects = options.cache / "objects"
    (library,) = (p for p in objects.iterdir() if p.suffix != ".o")
    library.unlink()
    key = library.name.partition("-")[0]
    safe_files.keep_file(objects, key, library.suffix, lambda out: out.write_bytes(wrong) and None)
    old = {p.name: p.stat().st_mtime_ns for p in objects.glob("*.o")}
    assert binary() == wrong
    assert binary(force=True) == sound
    assert all(p.stat().st_mtime_ns > old[p.name] for p in objects.glob("*.o"))
    assert cli.build(["SpeedProfile"], options) == []
