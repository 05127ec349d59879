"""The process in which FMUs run while they are checked: one fork for each check, so that none leaves anything to the next.

It is told what to do by lines of pickled data on its standard input and answers on its standard output: `run()` and `Workers` in
`runner.py` hold the other end. Where processes cannot be forked (Windows) it runs the check itself, and is replaced when it is lost.
"""

from __future__ import annotations

import contextlib
import mmap
import os
import pickle
import select
import signal
import struct
import tempfile
import time
import traceback
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, BinaryIO

from cosim.check import derivatives, references, runs, states, values  # noqa: F401 (registers the checks)
from cosim.check.bench import Bench
from cosim.check.calls import DISCARD, FATAL, Ended, Fmu, Refused
from cosim.check.model import Model
from cosim.check.rules import CHECKS, MOST, Finding, NotApplicable

_SPOKEN = 4096  # bytes for what is being done
_LAST_WORDS = 400  # characters of what the FMU printed last
_POLL = 0.02  # s between looks at a child's memory


@dataclass(frozen=True)
class Job:
    """A check of one interface of an FMU that is unpacked, with its limits [s], [bytes]."""

    check: str
    kind: str
    model: Model = field(repr=False)
    folder: Path
    libraries: dict[str, Path]
    seconds: float
    memory: int


@dataclass
class Answer:
    """What a check has found; `lost` says how the process ended, if it did."""

    findings: list[Finding] = field(default_factory=list)
    inapplicable: str = ""
    lost: str = ""
    doing: str = ""
    words: str = ""
    seconds: float = 0.0
    measures: dict[str, str] = field(default_factory=dict)
    broken: str = ""  # a mistake of the check itself


def execute(job: Job, say: Any = None) -> Answer:
    """Run a check in this process."""
    answer = Answer()
    check = CHECKS[job.check]
    bench = Bench(Fmu(job.model, job.folder, job.libraries, say), job.kind, answer.measures)
    try:
        for finding in check.run(bench):
            answer.findings.append(finding)
            if len(answer.findings) >= MOST:
                break
    except NotApplicable as reason:
        answer.inapplicable = str(reason)
    except Ended:
        answer.inapplicable = "the FMU asks to end the simulation"
    except Refused as refused:
        if refused.status == DISCARD:
            answer.inapplicable = str(refused)
        else:
            answer.findings.append(Finding(str(refused), check.worst if refused.status != FATAL else "error"))
    except OSError as error:
        answer.findings.append(Finding(f"the library cannot be loaded: {' '.join(str(error).split())}", "error"))
    except Exception:  # a mistake of ours must not look like one of the FMU
        answer.broken = traceback.format_exc()
    return answer


def _in_child(job: Job, memory: mmap.mmap, output: int) -> None:
    def say(text: str) -> None:
        data = text.encode()[: _SPOKEN - 4]
        memory[: 4 + len(data)] = struct.pack("=I", len(data)) + data

    data = pickle.dumps(execute(job, say))
    with os.fdopen(output, "wb") as stream:
        stream.write(data)


def supervise(job: Job) -> Answer:
    """Run a check in a fork of this process."""
    memory = mmap.mmap(-1, _SPOKEN)
    readable, writable = os.pipe()
    words = tempfile.TemporaryFile()  # noqa: SIM115 (closed below)
    begin = time.monotonic()
    pid = os.fork()
    if pid == 0:
        code = 70
        try:
            os.setsid()
            os.close(readable)
            signal.signal(signal.SIGINT, signal.SIG_DFL)
            null = os.open(os.devnull, os.O_RDONLY)
            for source, target in ((null, 0), (words.fileno(), 1), (words.fileno(), 2)):
                os.dup2(source, target)
            os.chdir(tempfile.gettempdir())
            _in_child(job, memory, writable)
            code = 0
        finally:
            os._exit(code)
    os.close(writable)
    data, ended = _listen(job, pid, readable, begin)
    os.close(readable)
    with contextlib.suppress(ProcessLookupError, PermissionError):
        os.killpg(pid, signal.SIGKILL)
    _, status = os.waitpid(pid, 0)
    code = os.waitstatus_to_exitcode(status)
    try:
        answer = pickle.loads(data) if data and not ended else Answer()
    except (pickle.UnpicklingError, EOFError):
        answer, data = Answer(), b""
    if ended or not data:
        answer.lost = ended or (f"signal {-code} ({signal.strsignal(-code)})" if code < 0 else f"its process ended itself with exit code {code}")
        (length,) = struct.unpack("=I", memory[:4])
        answer.doing = memory[4 : 4 + min(length, _SPOKEN - 4)].decode("utf-8", "replace")
        words.seek(0, os.SEEK_END)
        words.seek(max(0, words.tell() - 4 * _LAST_WORDS))
        answer.words = " ".join(words.read().decode("utf-8", "replace").split())[-_LAST_WORDS:]
    answer.seconds = time.monotonic() - begin
    words.close()
    memory.close()
    return answer


def _listen(job: Job, pid: int, readable: int, begin: float) -> tuple[bytes, str]:
    """What a child answers, and why it was not waited for, if so."""
    data = b""
    while True:
        left = begin + job.seconds - time.monotonic()
        if left <= 0:
            return data, f"it did not come back within {job.seconds:g} s"
        if select.select([readable], [], [], min(left, _POLL))[0]:
            part = os.read(readable, 1 << 16)
            if not part:
                return data, ""
            data += part
        elif _resident(pid) > job.memory:
            return data, f"it took more than {job.memory / 1e6:,.0f} MB of memory"


def _resident(pid: int) -> int:
    try:
        with open(f"/proc/{pid}/statm", encoding="ascii") as file:
            return int(file.read().split()[1]) * os.sysconf("SC_PAGE_SIZE")
    except (OSError, ValueError, IndexError):
        return 0


def receive(stream: BinaryIO) -> Any:
    """An object, None at the end."""
    head = stream.read(8)
    if len(head) < 8:
        return None
    (length,) = struct.unpack("=Q", head)
    data = stream.read(length)
    return pickle.loads(data) if len(data) == length else None


def send(stream: BinaryIO, thing: Any) -> None:
    data = pickle.dumps(thing)
    stream.write(struct.pack("=Q", len(data)) + data)
    stream.flush()


def main() -> None:
    """Answer jobs until the other end is closed."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the other end is told, and closes
    sources = os.fdopen(os.dup(0), "rb")
    answers = os.fdopen(os.dup(1), "wb")
    null = os.open(os.devnull, os.O_RDWR)
    os.dup2(null, 0)
    os.dup2(2, 1)
    while (job := receive(sources)) is not None:
        if hasattr(os, "fork"):
            send(answers, supervise(job))
        else:
            begin = time.monotonic()
            answer = execute(job)
            answer.seconds = time.monotonic() - begin
            send(answers, answer)

