"""Files that are replaced only by whole ones, and errors that name the path."""

from __future__ import annotations

import errno
import io
import os
from pathlib import Path

import numpy as np
import pytest

from build_fmus.base import safe_files
from cosim import Recording
from cosim.study.commands import write_summary


@pytest.fixture
def full_disk(monkeypatch: pytest.MonkeyPatch) -> None:
    """A disk on which every file can be opened, and takes no more than its first ten bytes."""
    real = io.open

    class Full(io.FileIO):
        room = 10

        def write(self, data) -> int:  # type: ignore[no-untyped-def, override]
            self.room -= len(data)
            if self.room < 0:
                raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
            return super().write(data)

    def opened(path, mode="r", *args, **options):  # type: ignore[no-untyped-def]
        if "w" not in mode:
            return real(path, mode, *args, **options)
        raw = io.BufferedWriter(Full(str(path), "w"))
        return raw if "b" in mode else io.TextIOWrapper(raw, encoding="utf-8", newline=options.get("newline"))

    monkeypatch.setattr(io, "open", opened)  # what Path.open calls
    monkeypatch.setattr("builtins.open", opened)


RECORDING = Recording(np.arange(100.0), ["x"], np.arange(100.0)[:, None])
WRITERS = {
    "recording": ("old.csv", RECORDING.to_csv),
    "summary": ("old.json", lambda path: write_summary(path, {"passive": {"J": 1.0}})),
    "kept value": ("old.json", lambda path: safe_files.keep_json(path, {"J": 1.0})),
    "text": ("old.html", lambda path: safe_files.write(path, "a page of some length")),
}


@pytest.mark.parametrize("writer", WRITERS)
@pytest.mark.usefixtures("full_disk")
def test_a_full_disk_leaves_the_older_file_and_is_named(writer: str, tmp_path: Path, raises) -> None:
    name, write = WRITERS[writer]
    path = tmp_path / name
    path.touch()
    os.truncate(path, 7)
    before = path.read_bytes()
    with raises(OSError) as caught:
        write(path)
    assert caught.value.errno == errno.ENOSPC
    assert safe_files.sentence(caught.value) == (
        f"{path}: No space left on device; free disk space there, or write to another directory"
    )
    assert path.read_bytes() == before
    assert os.listdir(tmp_path) == [name]  # nothing is left of the new one


def test_an_interrupted_write_leaves_the_older_file(tmp_path: Path) -> None:
    path = safe_files.write(tmp_path / "new folder" / "a.csv", "old")
    seen = []

    def broken_off() -> None:
        with safe_files.opened(path) as file:
            file.write("half of the n")
            file.flush()
            seen.append(path.read_text())
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        broken_off()
    assert seen == ["old"]
    assert [p.read_text() for p in path.parent.iterdir()] == ["old"]


def test_a_new_file_has_the_permissions_of_any_new_file(tmp_path: Path) -> None:
    (tmp_path / "plain").touch()
    whole = safe_files.write(tmp_path / "whole", "x")
    assert whole.stat().st_mode == (tmp_path / "plain").stat().st_mode


@pytest.mark.skipif(os.name == "nt", reason="links and devices of Unix")
def test_links_stay_links_and_devices_devices(tmp_path: Path) -> None:
    (tmp_path / "results").mkdir()
    link = tmp_path / "link.csv"
    link.symlink_to(tmp_path / "results" / "far.csv")
    RECORDING.to_csv(link)
    assert link.is_symlink()
    assert Recording.read(tmp_path / "results" / "far.csv")["x"].shape == (100,)
    (tmp_path / "null").symlink_to(os.devnull)
    RECORDING.to_csv(tmp_path / "null")
    assert not Path(os.devnull).is_file()


def test_an_error_of_another_file_keeps_its_name(tmp_path: Path) -> None:
    with pytest.raises(FileNotFoundError) as caught, safe_files.opened(tmp_path / "a.csv"):
        (tmp_path / "missing.csv").read_text()
    assert str(caught.value.filename).endswith("missing.csv")
