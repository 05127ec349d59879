"""Studies on executors of all kinds: the same results, and what is lost with a worker, an executor or a cluster."""

from __future__ import annotations

import hashlib
import os
import signal
import socket
import ssl
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Iterator
from concurrent.futures import Executor, Future, ProcessPoolExecutor
from pathlib import Path
from typing import Any

import psutil
import pytest

from build_fmus.base import safe_files
from cosim import CosimError
from cosim.study import FmuSet, load, run_study
from cosim.study import dispatch as dispatching
from cosim.study.dispatch import DIED, LOST, Dispatch, ExecutorLostError, failed
from cosim.study.executors import ClusterError, dask, width
from cosim.study.processes import WorkerDiedError, local_processes
from cosim.study.store import pack
from cosim.study.work import JobContext, Reply, hashes, work

HERE = Path(__file__).parent
ROOT = HERE.parents[1]
FILE = HERE / "mine.py"
FMUS = FmuSet()


@pytest.fixture(scope="module")
def experiment() -> Any:
    return load(str(FILE))


@pytest.fixture
def many(experiment: Any) -> list[Any]:
    return [experiment.case(i / 100) for i in range(200)]


def right(results: Any, but: float | None = None) -> bool:
    """Whether every run has the result of its rate, all but one."""
    return all(results[c]["last"] == pytest.approx((1 - c.rate / 100) ** 100) for c in results if c.rate != but)


# ------------------------------------------------------------------------------------------------- without processes


class Hand(Executor):
    """An executor of which a test says what becomes of each chunk: an exception, or None to do it."""

    _max_workers = 2
    loses_only_its_own = True

    def __init__(self, fate: Callable[[list[int], dict[str, bytes] | None], BaseException | None]) -> None:
        self.fate, self.chunks = fate, []

    def submit(self, _work: Any, /, *args: Any, **_: Any) -> Future[Any]:
        _, chunk, contents, _vectors = args
        numbers = [int(name) for name, _ in chunk]
        self.chunks.append(numbers)
        future: Future[Any] = Future()
        error = self.fate(numbers, contents)
        if error is None:
            lines = [pack(f"{n:032}", {"metrics": {"n": n}}) for n in numbers]
            future.set_result(Reply(lines, seconds=0.01 * len(numbers)))
        else:
            future.set_exception(error)
        return future


def dispatch(**options: Any) -> Dispatch:
    ship = JobContext("nothing", FMUS, options.get("hashes", {}), None, "", {}, None)
    return Dispatch(ship, lambda i: (f"{i:032}", None), lambda _: 1.0, width)


def test_short_runs_travel_together() -> None:
    """Of 10 ms each, chunks of 0.2 s: first one run, to see how long it takes, and small ones at the end."""
    hand = Hand(lambda *_: None)
    found = list(dispatch().through(hand, range(1000), 1000))
    assert sorted(i for i, _ in found) == list(range(1000))
    sizes = [len(c) for c in hand.chunks]
    assert sizes[:4] == [1, 1, 1, 1]
    assert max(sizes) == 20
    assert sizes[-1] == 1
    assert sum(sizes) == 1000


def test_a_lost_chunk_is_run_again_one_by_one() -> None:
    """The culprit is recorded as failed after two attempts of its own or with others; nobody else is."""
    hand = Hand(lambda numbers, _: WorkerDiedError("dead") if 500 in numbers else None)
    found = dict(dispatch().through(hand, range(1000), 1000))
    assert set(found) == set(range(1000))
    assert [i for i, line in found.items() if failed(line)] == [500]
    assert found[500] == pack(f"{500:032}", {"failed": DIED})
    assert sum(500 in c for c in hand.chunks) == 2


def test_those_that_were_only_near_are_not_blamed() -> None:
    """Workers that hold several tasks take all along.

    A suspect counts as the culprit when nothing else was on its way.
    """
    near: set[int] = set()

    def fate(numbers: list[int], _: Any) -> BaseException | None:
        if numbers == [501] and 501 not in near:  # once beside 500
            near.add(501)
            return WorkerDiedError("dead")
        return WorkerDiedError("dead") if 500 in numbers else None

    hand = Hand(fate)
    hand.loses_only_its_own = False
    found = dict(dispatch().through(hand, range(1000), 1000))
    assert [i for i, line in found.items() if failed(line)] == [500]
    assert len(found) == 1000


def test_the_reason_of_what_gives_no_result() -> None:
    hand = Hand(lambda numbers, _: OSError("no route to host") if 3 in numbers else None)
    found = dict(dispatch().through(hand, range(5), 5))
    assert found[3] == pack(f"{3:032}", {"failed": "its worker gave no result: OSError: no route to host"})


def test_workers_that_can_do_nothing() -> None:
    """Not 10^5 failed runs, but one sentence."""
    hand = Hand(lambda *_: ModuleNotFoundError("No module named 'cosim'"))
    with pytest.raises(ExecutorLostError, match="No module named 'cosim'"):
        list(dispatch().through(hand, range(100_000), 100_000))
    assert len(hand.chunks) < 20


def test_fmus_go_where_they_are_missing(tmp_path: Path, raises) -> None:
    """A worker asks by hash, and gets the chunk again with the contents."""
    fmu = tmp_path / "a.fmu"
    fmu.write_bytes(b"content")
    digest = hashlib.sha256(b"content").hexdigest()
    sent = []

    class Distant(Hand):
        def submit(self, fn: Any, /, *args: Any, **more: Any) -> Future[Any]:
            if args[2] is None:
                future: Future[Any] = Future()
                future.set_result(Reply(missing=[digest]))
                return future
            sent.append(args[2])
            return super().submit(fn, *args, **more)

    found = list(dispatch(hashes={str(fmu): digest}).through(Distant(lambda *_: None), range(3), 3))
    assert len(found) == 3
    assert sent == [{digest: b"content"}] * 3
    fmu.write_bytes(b"another")
    with raises(CosimError):
        list(dispatch(hashes={str(fmu): digest}).through(Distant(lambda *_: None), range(3), 3))


def test_a_worker_keeps_fmus_by_content(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """What is not there, or is another file, is asked for once; a damaged copy is asked for again."""
    monkeypatch.setenv("BUILD_FMUS_CACHE", str(tmp_path / "cache"))
    here, there = tmp_path / "here.fmu", tmp_path / "elsewhere.fmu"
    here.write_bytes(b"one")
    digest = hashlib.sha256(b"two").hexdigest()
    known = {**hashes([here]), str(there): digest}
    ship = JobContext(str(FILE), FmuSet(), known, None, "", {"": "salt"}, None)
    name = "0" * 32
    task = (name, ("", {"rate": 1.0, "note": ""}, False))
    assert work(ship, [task]).missing == [digest]
    (line,) = work(ship, [task], {digest: b"two"}).lines
    assert not failed(line)
    kept = safe_files.cache_directory() / "fmus" / digest / "elsewhere.fmu"
    assert kept.read_bytes() == b"two"
    assert len(work(ship, [task]).lines) == 1
    assert FmuSet(at={str(there): str(kept)}).path(str(there)) == kept
    kept.write_bytes(b"damaged")
    assert work(ship, [task]).missing == [digest]
    there.write_bytes(b"not two")
    assert work(ship, [task], {digest: b"two"}).lines


# ---------------------------------------------------------------------------------------------------- local processes


def test_a_dead_worker_costs_only_its_own_task(raises) -> None:
    with local_processes(2) as pool:
        doomed = pool.submit(os._exit, 3)
        others = [pool.submit(abs, -i) for i in range(20)]
        with pytest.raises(WorkerDiedError):
            doomed.result(30)
        assert [f.result(30) for f in others] == list(range(20))
        with raises(TypeError):
            pool.submit(abs, "text").result(30)
        with pytest.raises(Exception, match="pickle"):
            pool.submit(lambda: 1).result(30)
        with raises(RuntimeError):
            pool.submit(threading.Lock).result(30)


@pytest.mark.skipif(os.name == "nt", reason="sends signals")
def test_a_worker_that_is_killed_costs_nothing(experiment: Any, many: list[Any], tmp_path: Path) -> None:
    """SIGKILL in the middle of a study: what it held is done by others."""
    victims: list[int] = []

    def progress(done: int, _: int) -> None:
        if done >= 20 and not victims:
            victims.append(next(iter(pool._processes.values())).pid)
            os.kill(victims[0], signal.SIGKILL)

    with local_processes(2) as pool:
        results = run_study(experiment, FMUS, tmp_path, tasks=many, executor=pool, progress=progress)
    assert victims
    assert not results.failures
    assert right(results)


# ---------------------------------------------------------------------------------------------------- pools of others


def loky() -> Any:
    from loky import ProcessPoolExecutor as Pool

    return Pool(2)


@pytest.mark.parametrize(
    "make", [lambda: ProcessPoolExecutor(2), pytest.param(loky, marks=pytest.mark.full)], ids=["futures", "loky"]
)
def test_pools_that_break_are_made_again(experiment: Any, tmp_path: Path, make: Any) -> None:
    """A function that makes pools: the culprit alone is lost. One pool: the study ends, and goes on with another."""
    cases = [experiment.case(666.0 if i == 7 else i / 100) for i in range(20)]
    made = []

    def again() -> Any:
        made.append(make())
        return made[-1]

    results = run_study(experiment, FMUS, tmp_path / "one", tasks=cases, executor=again)
    assert results.failures == {"rate666": DIED}
    assert right(results, but=666.0)
    assert len(made) >= 2
    with make() as pool, pytest.raises(ExecutorLostError) as caught:
        run_study(experiment, FMUS, tmp_path / "two", tasks=cases, executor=pool)
    assert str(caught.value) == LOST
    results = run_study(experiment, FMUS, tmp_path / "two", tasks=cases, processes=1)
    assert list(results.failures) == ["rate666"]


MPI = """
from pathlib import Path
from mpi4py.futures import MPIPoolExecutor
from cosim.study import FmuSet, load, run_study

if __name__ == "__main__":
    experiment = load({file!r})
    with MPIPoolExecutor() as pool:
        results = run_study(experiment, FmuSet(), Path("runs"), executor=pool)
    print(sorted(results.failures), [results[c]["last"] for c in results.ran])
"""


@pytest.mark.full
def test_mpi(experiment: Any, tmp_path: Path) -> None:
    mpiexec = Path(sys.executable).with_name("mpiexec")
    script = tmp_path / "script.py"
    script.write_text(MPI.format(file=str(FILE)))
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    done = subprocess.run(
        [mpiexec, "-n", "3", sys.executable, "-m", "mpi4py.futures", str(script)],
        cwd=tmp_path,
        env=environment,
        capture_output=True,
        text=True,
        check=True,
        timeout=300,
    )
    ours = run_study(experiment, FMUS, tmp_path / "ours", processes=1)
    assert done.stdout.strip() == f"{sorted(ours.failures)} {[ours[c]['last'] for c in ours.ran]}"


# --------------------------------------------------------------------------------------------------------------- Dask


@pytest.fixture(scope="module")
def cluster() -> Iterator[Executor]:
    with dask("local", 2) as executor:
        yield executor


def test_a_local_cluster_gives_the_same(experiment: Any, cluster: Executor, tmp_path: Path) -> None:
    assert width(cluster) == 2
    ours = run_study(experiment, FMUS, tmp_path / "ours", processes=1)
    theirs = run_study(experiment, FMUS, tmp_path / "theirs", executor=cluster)
    assert theirs.rows() == ours.rows()


def answer(port: int, *, encrypted: bool) -> bytes:
    """What a server answers somebody without certificate; nothing where it ends the connection."""
    anybody = ssl.create_default_context()
    anybody.check_hostname, anybody.verify_mode = False, ssl.CERT_NONE
    try:
        bare = socket.create_connection(("127.0.0.1", port))
        with bare, anybody.wrap_socket(bare) if encrypted else bare as connection:
            connection.sendall(b"GET / HTTP/1.0\r\n\r\n")
            return connection.recv(100)
    except (ssl.SSLError, ConnectionError):
        return b""


def test_nobody_else_reaches_a_local_cluster(cluster: Any) -> None:
    """Nothing listens but the cluster's scheduler, workers and their nannies.

    These talk to the holder of its certificate only.
    """
    from distributed import Client
    from distributed.security import Security

    address = cluster._client.scheduler.address
    children = psutil.Process().children(recursive=True)
    listening = [c.laddr for child in children for c in child.net_connections("tcp") if c.status == psutil.CONN_LISTEN]
    assert len(listening) == 5
    for ip, port in listening:
        assert ip == "127.0.0.1"
        assert answer(port, encrypted=True) == b""
        assert not answer(port, encrypted=False).startswith(b"HTTP")
    assert address in {f"tls://{ip}:{port}" for ip, port in listening}
    for other, security in ((address, Security.temporary()), (address.replace("tls:", "tcp:"), None)):
        with pytest.raises(OSError, match=r"Timed out|refused|reset|TLS|SSL|certificate"):
            Client(other, security=security, timeout=2, set_as_default=False)
    assert cluster.submit(abs, -1).result(30) == 1


def test_a_local_cluster_has_a_private_folder(cluster: Any) -> None:
    """Dask imports from its folder, and gives it a name that everybody knows where nothing else is said."""
    told = cluster._client.run(lambda dask_worker: (dask_worker.local_directory, tempfile.gettempdir()))
    for folder in {f for both in told.values() for f in both}:
        assert safe_files.scratch() in Path(folder).parents


OWN_CLUSTER = """
import time
from cosim.study import dask
if __name__ == "__main__":
    with dask("local", 1):
        print("there", flush=True)
        time.sleep(600)
"""


@pytest.mark.skipif(os.name == "nt", reason="sends signals")
def test_a_local_cluster_ends_with_who_asked_for_it(tmp_path: Path) -> None:
    """However it ends: scheduler and worker are processes of their own."""
    program = tmp_path / "own.py"
    program.write_text(OWN_CLUSTER)
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    process = subprocess.Popen([sys.executable, str(program)], env=environment, stdout=subprocess.PIPE, text=True)
    assert process.stdout is not None
    assert process.stdout.readline() == "there\n"
    others = psutil.Process(process.pid).children(recursive=True)
    assert len(others) >= 2
    process.kill()
    process.communicate()
    _, alive = psutil.wait_procs(others, timeout=300)
    assert not alive


@pytest.mark.skipif(os.name == "nt", reason="sends signals")
def test_a_dead_worker_of_a_cluster_costs_only_the_culprit(experiment: Any, cluster: Any, tmp_path: Path) -> None:
    """It ends two workers, each with what it held; the cluster replaces them."""
    cases = [experiment.case(666.0 if i == 37 else i / 100) for i in range(100)]
    results = run_study(experiment, FMUS, tmp_path, tasks=cases, executor=cluster)
    assert results.failures == {"rate666": DIED}
    assert right(results, but=666.0)


def free_port() -> int:
    with socket.socket() as s:
        s.bind(("127.0.0.1", 0))
        return int(s.getsockname()[1])


def test_a_scheduler_that_does_not_answer(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("cosim.study.executors.ANSWER", 1.0)
    address = f"tcp://127.0.0.1:{free_port()}"
    with pytest.raises(ClusterError, match=f"{address}.*`dask scheduler`"), dask(address):
        pass


def test_one_that_accepts_and_is_silent(monkeypatch: pytest.MonkeyPatch, raises) -> None:
    monkeypatch.setattr("cosim.study.executors.ANSWER", 1.0)
    with socket.socket() as silent:
        silent.bind(("127.0.0.1", 0))
        silent.listen()
        since = time.monotonic()
        with raises(ClusterError), dask(f"tcp://127.0.0.1:{silent.getsockname()[1]}"):
            pass
        assert time.monotonic() - since < 300  # it does not wait forever


@pytest.mark.parametrize(
    "address", ["nonsense", "tcp://127.0.0.1", "http://127.0.0.1:22", "tcp://:8786", "tcp://a b:1"]
)
def test_what_is_no_address_of_a_scheduler(address: str, raises) -> None:
    with raises(ClusterError), dask(address):
        pass


def scheduler(port: int, folder: Path) -> subprocess.Popen[bytes]:
    command = [sys.executable, "-m", "distributed.cli.dask_scheduler", "--port", str(port), "--no-dashboard"]
    process = subprocess.Popen(command, cwd=folder, stdout=-3, stderr=-3)
    end = time.monotonic() + 300
    while socket.socket().connect_ex(("127.0.0.1", port)):
        assert time.monotonic() < end
        time.sleep(0.05)
    return process


def worker(port: int, folder: Path) -> subprocess.Popen[bytes]:
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    command = [
        sys.executable,
        "-m",
        "distributed.cli.dask_worker",
        f"tcp://127.0.0.1:{port}",
        "--nthreads",
        "1",
        "--no-dashboard",
        "--death-timeout",
        "20",
    ]
    return subprocess.Popen(command, cwd=folder, env=environment, stdout=-3, stderr=-3)


@pytest.mark.full
@pytest.mark.skipif(os.name == "nt", reason="sends signals")
def test_a_scheduler_that_dies_and_comes_again(
    experiment: Any, many: list[Any], tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    """The study ends with one message, and finished results are kept.

    The same study goes on with the next scheduler.
    """
    monkeypatch.setattr("cosim.study.executors.ANSWER", 3.0)
    monkeypatch.setattr("cosim.study.executors.WORKERS", 2.0)
    port = free_port()
    address = f"tcp://127.0.0.1:{port}"
    first = scheduler(port, tmp_path)
    started = [first]
    try:
        with pytest.raises(ClusterError, match="dask worker tcp"), dask(address):
            pass
        monkeypatch.setattr("cosim.study.executors.WORKERS", 60.0)
        started.append(worker(port, tmp_path))
        kept: list[int] = []

        def progress(done: int, _: int) -> None:
            kept.append(done)
            if done == 20:
                first.kill()

        with pytest.raises((ExecutorLostError, ClusterError), match="stored"), dask(address) as executor:
            run_study(experiment, FMUS, tmp_path / "runs", tasks=many, executor=executor, progress=progress)
        assert kept[-1] >= 20
        assert "Traceback" not in capfd.readouterr().err
        started.append(scheduler(port, tmp_path))
        started.append(worker(port, tmp_path))
        again: list[int] = []
        with dask(address) as executor:
            results = run_study(
                experiment,
                FMUS,
                tmp_path / "runs",
                tasks=many,
                executor=executor,
                progress=lambda done, _: again.append(done),
            )
        assert again[0] == kept[-1]
        assert right(results)
        assert not results.failures
    finally:
        for process in started:
            process.kill()
            process.wait()


def test_chunks_are_as_said() -> None:
    """The numbers of the page on studies."""
    assert (dispatching.CHUNK, dispatching.TRIES) == (0.2, 2)
