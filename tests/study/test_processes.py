"""Workers of a study leave nothing behind, however it ends."""

import os
import signal
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import pytest
from awkward import archive, description, library

HERE = Path(__file__).parent
pytestmark = pytest.mark.skipif(os.name == "nt", reason="sends signals")


@pytest.fixture(scope="module")
def fmu(tmp_path_factory):
    folder = tmp_path_factory.mktemp("fmu")
    return archive(folder / "a.fmu", description(2), binary=library(2, folder))


@pytest.fixture
def temporary():
    """A folder for temporary files with a short path.

    Workers are started over a socket in it, whose path has a limit.
    """
    with tempfile.TemporaryDirectory() as folder:
        yield Path(folder)


def start(fmu, folder, temporary, then):
    """The study in a process of its own, with a folder of its own for temporary files."""
    notes = folder / "notes"
    notes.mkdir()
    environment = {
        **os.environ,
        "TMPDIR": str(temporary),
        "PYTHONPATH": os.pathsep.join([str(HERE.parents[1]), str(HERE)]),
    }
    command = [sys.executable, HERE / "workers.py", fmu, notes, then]
    with (folder / "errors").open("w") as errors:  # a pipe would stay open as long as a worker lives
        process = subprocess.Popen(command, env=environment, stderr=errors)
    return process, notes


def unpacked(temporary):
    return list(temporary.rglob("modelDescription.xml"))


def wait_until(true, limit=300.0):
    """What happens in other processes is waited for, not timed: the limit only ends a test that has failed."""
    end = time.monotonic() + limit
    while not true():
        assert time.monotonic() < end, "it did not happen"
        time.sleep(0.02)


def alive(pid):
    """Is the process there, and no zombie that waits for its parent's parent?"""
    try:
        os.kill(pid, 0)
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
    except ProcessLookupError:
        return False
    except FileNotFoundError:
        return sys.platform != "linux"


@pytest.mark.parametrize(("then", "code"), [("end", 0), ("fail", 1)])
def test_unpacked_fmus_are_removed(tmp_path, temporary, fmu, then, code):
    process, notes = start(fmu, tmp_path, temporary, then)
    assert process.wait() == code, (tmp_path / "errors").read_text()
    assert {Path(n.read_text()).parents[1] for n in notes.iterdir()} == {temporary}
    assert not list(temporary.glob("suspension-fmus-*"))
    assert not unpacked(temporary)


@pytest.mark.parametrize("how", [signal.SIGINT, signal.SIGKILL, signal.SIGTERM])
def test_workers_end_with_their_parent_and_clean_up(tmp_path, temporary, fmu, how):
    """Killed, the parent can tell nobody anything; interrupted, it ends its workers itself."""
    process, notes = start(fmu, tmp_path, temporary, "stay")
    wait_until(lambda: len(list(notes.iterdir())) == 2)
    workers = [int(n.name) for n in notes.iterdir()]
    try:
        assert len(unpacked(temporary)) == 2
        assert all(map(alive, workers))
        process.send_signal(how)
        process.wait()
        wait_until(lambda: not any(map(alive, workers)))
        wait_until(lambda: not list(temporary.glob("suspension-fmus-*")))
    finally:
        for pid in filter(alive, workers):
            os.kill(pid, signal.SIGKILL)


SCRIPT = """
from pathlib import Path
from cosim.study import FmuSet, load, run_study
def main():
    made = load({file!r})
    found = run_study(made, FmuSet(), Path("runs"), tasks=[made.case(count=i) for i in range(9)], processes=2)
    print(len(found.failures), sum(row["count"] for row in found.values()))
"""


def test_a_script_whose_workers_run_it_again_is_told_so_and_loses_nothing(tmp_path):
    """No run is to blame for it: what was stored is not that they failed."""
    environment = {**os.environ, "PYTHONPATH": str(HERE.parents[1])}
    text = SCRIPT.format(file=str(HERE / "falling.py"))
    for guard, code, said in (
        ("", 1, 'below `if __name__ == "__main__":`'),
        ('if __name__ == "__main__":\n    ', 0, ""),
    ):
        (tmp_path / "script.py").write_text(f"{text}{guard}main()\n")
        done = subprocess.run(
            [sys.executable, "script.py"],
            check=False,
            cwd=tmp_path,
            env=environment,
            capture_output=True,
            text=True,
            timeout=300,
        )
        assert done.returncode == code, done.stderr
        assert said in done.stderr.splitlines()[-1] if said else done.stdout == "0 36\n"
