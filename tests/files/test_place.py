"""Caches and temporary files lie where no other user can change them, and nothing stays of killed processes."""

from __future__ import annotations

import os
import shutil
import signal
import stat
import subprocess
import sys
import tempfile
from pathlib import Path

import pytest

from build_fmus import compile as compilers
from build_fmus.base import safe_files
from build_fmus.base.safe_files import place

pytestmark = pytest.mark.skipif(os.name == "nt", reason="a user's profile is private on Windows")
VARIABLES = ("BUILD_FMUS_CACHE", "XDG_CACHE_HOME", "LOCALAPPDATA", "HOME", "USERPROFILE")


@pytest.fixture
def home(tmp_path, monkeypatch):
    """A user without caches; `home` and `temporary` below are his."""
    for name in VARIABLES:
        monkeypatch.delenv(name, raising=False)
    (tmp_path / "home").mkdir()
    (tmp_path / "temporary").mkdir()
    place._warn.cache_clear()
    monkeypatch.setenv("HOME", str(tmp_path / "home"))
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path / "temporary"))
    return tmp_path / "home"


def mode(path):
    return stat.S_IMODE(path.stat().st_mode)


def is_of_this_process(folder):
    return safe_files.scratch() in folder.parents and mode(folder) == 0o700 and mode(safe_files.scratch()) == 0o700


def test_the_cache_is_private(home):
    previous = os.umask(0)
    try:
        found = safe_files.cache_directory()
    finally:
        os.umask(previous)
    assert found == home / ".cache" / "suspension-fmus"
    assert mode(found) == mode(found.parent) == 0o700
    found.chmod(0o755)
    assert safe_files.cache_directory() == found
    assert mode(found) == 0o700


@pytest.mark.parametrize("variable", ["BUILD_FMUS_CACHE", "XDG_CACHE_HOME", "HOME"])
@pytest.mark.parametrize("writers", [0o020, 0o002])
def test_a_folder_to_which_others_can_write_is_not_used(home, monkeypatch, variable, writers, warns):
    monkeypatch.delenv("HOME")
    monkeypatch.setenv(variable, str(home / "below"))
    folder = safe_files.cache_directory()
    folder.chmod(0o700 | writers)
    with warns(safe_files.SharedFolderWarning, match=f"{folder}"):
        found = safe_files.cache_directory()
    assert folder != found
    assert found.parent == home.parent / "temporary" or is_of_this_process(found)
    assert mode(found) == 0o700
    folder.chmod(0o700)
    home.chmod(0o700 | writers)  # whoever can write above it can exchange it
    with warns(safe_files.SharedFolderWarning, match=f"{home}"):
        assert safe_files.cache_directory() == found


def test_a_folder_that_somebody_has_prepared_in_the_temporary_one_is_not_used(home, monkeypatch, warns):
    """Without a home the name of the folder for caches is known to all."""
    monkeypatch.delenv("HOME")
    (home.parent / "temporary").chmod(0o1777)
    mine = safe_files.cache_directory()
    assert mine.parent == home.parent / "temporary"
    assert mode(mine) == 0o700
    shutil.rmtree(mine)
    mine.mkdir(mode=0o700)
    mine.chmod(0o777)
    with warns(safe_files.SharedFolderWarning):
        assert is_of_this_process(safe_files.cache_directory())
    mine.rmdir()
    mine.symlink_to(home)
    home.chmod(0o777)
    with warns(safe_files.SharedFolderWarning, match=f"{home}"):
        assert is_of_this_process(safe_files.cache_directory())


@pytest.mark.usefixtures("home")
def test_what_belongs_to_another_user_is_not_used(monkeypatch, warns):
    """As `sudo` has it: the home of one user, the rights of another."""
    safe_files.cache_directory()
    monkeypatch.setattr(os, "getuid", lambda: 4242)
    with warns(safe_files.SharedFolderWarning):
        assert is_of_this_process(safe_files.cache_directory())


@pytest.mark.skipif(os.name == "nt" or os.getuid() != 0, reason="only the administrator can give files away")
def test_a_folder_of_another_user_is_not_used(home, monkeypatch, warns):
    monkeypatch.delenv("HOME")
    (home.parent / "temporary").chmod(0o1777)
    mine = safe_files.cache_directory()
    os.chown(mine, 4242, 4242)
    with warns(safe_files.SharedFolderWarning, match=f"{mine}"):
        assert is_of_this_process(safe_files.cache_directory())
    mine.rmdir()
    mine.symlink_to(home)
    os.lchown(mine, 4242, 4242)
    place._warn.cache_clear()
    with warns(safe_files.SharedFolderWarning, match=f"{mine}"):
        assert is_of_this_process(safe_files.cache_directory())


@pytest.mark.usefixtures("home")
def test_what_ziglang_keeps_lies_among_the_caches(monkeypatch):
    asked = []
    monkeypatch.setattr(
        compilers.subprocess, "run", lambda *_, env, **__: asked.append(env) or subprocess.CompletedProcess([], 0)
    )
    target = compilers.PLATFORMS["x86_64-linux"]
    compilers.Toolchain(target, ("zig",), "ziglang 0.13").compile(Path("a.c"), Path("a.o"), [])
    assert asked[0]["ZIG_GLOBAL_CACHE_DIR"] == str(safe_files.cache_directory() / "zig")


# ------------------------------------------------------------------------------------------------------ temporary files

HOLD = """
import os, sys, tempfile
from build_fmus.base import safe_files
from build_fmus.base.safe_files import place
folder = tempfile.mkdtemp(dir=safe_files.scratch())
if sys.argv[1] == "fork" and os.fork():
    sys.stdout.flush(); os.kill(os.getpid(), 9)
print(folder, flush=True)
sys.stdin.read()
if sys.argv[1] == "die":
    os.kill(os.getpid(), 9)
"""


@pytest.fixture
def hold(home):
    """Processes that have temporary files until they read the end of their input."""
    started = []

    def start(how):
        environment = {
            **os.environ,
            "TMPDIR": str(home.parent / "temporary"),
            "PYTHONPATH": str(Path(__file__).parents[2]),
        }
        process = subprocess.Popen(
            [sys.executable, "-c", HOLD, how], stdin=subprocess.PIPE, stdout=subprocess.PIPE, env=environment, text=True
        )
        started.append(process)
        return process, Path(process.stdout.readline().strip())

    yield start
    for process in started:
        process.stdin.close()
        process.stdout.close()
        process.wait()


def test_temporary_files_are_removed_at_the_end(hold):
    process, folder = hold("end")
    assert folder.is_dir()
    process.stdin.close()
    assert process.wait() == 0
    assert not folder.parent.exists()


@pytest.mark.parametrize("how", ["die", "fork"])
def test_the_next_process_removes_what_a_killed_one_has_left(hold, how):
    """Whether it lives is said by its lock, which its forks hold too: numbers of processes are given again."""
    living, kept = hold("end")
    killed, folder = hold(how)
    if how == "fork":  # the one that started it is gone
        assert killed.wait() == -signal.SIGKILL
        hold("end")
        assert folder.is_dir()
    else:
        killed.stdin.close()
        assert killed.wait() == -signal.SIGKILL
        assert folder.is_dir()
        hold("end")
        assert not folder.parent.exists()
    assert living.poll() is None
    assert kept.is_dir()


def test_others_of_similar_names_stay(home):
    temporary = home.parent / "temporary"
    others = [
        temporary / n for n in ("cosim-results", "suspension-fmus-scratch-mine", "suspension-fmus-scratch-abcdefghi")
    ]
    for folder in others:
        folder.mkdir()
    left = temporary / "suspension-fmus-scratch-abcdefgh"
    left.mkdir()
    link = temporary / "suspension-fmus-scratch-linklink"
    link.symlink_to(home)
    safe_files.scratch()
    assert all(folder.is_dir() for folder in others)
    assert not left.exists()
    assert link.is_symlink()
    assert home.is_dir()


@pytest.mark.usefixtures("home")
def test_a_process_goes_on_where_its_temporary_folder_was_removed():
    safe_files.scratch().rmdir()
    assert safe_files.scratch().is_dir()
