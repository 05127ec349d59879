"""The process in which FMUs run while they are checked; each check runs in its own fork, so none affects the next.

It receives jobs as pickled data on its standard input, and answers on its standard output: `Workers` in `runner.py`
holds the other end. Where processes cannot be forked (Windows) it runs the check itself, and is replaced when it is
lost.

An FMU is foreign code. What comes from a process in which one ran is JSON of limited length, and each of its fields is
validated; the fork has no descriptor but that of its own answer. Processes that an FMU has started are ended after each
check, on Linux also detached ones.
"""

from __future__ import annotations

import contextlib
import ctypes
import gc
import json
import math
import mmap
import os
import pickle
import select
import signal
import struct
import sys
import tempfile
import time
import traceback
from dataclasses import dataclass, field, fields
from functools import lru_cache
from pathlib import Path
from types import SimpleNamespace
from typing import Any, BinaryIO

from build_fmus.base.checks import plain
from cosim.check import derivatives, model_exchange_rules, references, runs, saved, states, values  # noqa: F401 (registers the checks)
from cosim.check.bench import Bench
from cosim.check.calls import Ended, Fmu, Refused, parse_types
from cosim.check.model import Model
from cosim.check.rules import CHECKS, MOST, SEVERITIES, Finding, NotApplicable
from cosim.core.memory import resident_memory
from cosim.fmu import calls

_SPOKEN = 4096  # bytes for what is being done
_LAST_WORDS = 400  # characters of what the FMU printed last
LATE = "a call did not return within"
_POLL = 0.02  # s between looks at a child's memory
_LONGEST = 1 << 20  # bytes of an answer
_MOST_MEASURES, _MEASURE = 100, 200  # of an answer; characters of one
_OF_ORPHANS = 5.0  # s for ending processes that an FMU has left
_SET_CHILD_SUBREAPER = 36  # of prctl


@dataclass(frozen=True)
class Job:
    """A check of one interface of an FMU that is unpacked, with its limits [s], [bytes]; `model` as it is pickled."""

    check: str
    kind: str
    model: bytes = field(repr=False)
    folder: Path
    libraries: dict[str, Path]
    seconds: float
    memory: int


@dataclass
class Answer:
    """Findings of a check.

    `lost` says how the process ended, if it did; `late`: the time limit was exceeded; `unjudged`: why there is no
    verdict.
    """

    findings: list[Finding] = field(default_factory=list)
    inapplicable: str = ""
    lost: str = ""
    late: bool = False
    unjudged: str = ""
    doing: str = ""
    words: str = ""
    seconds: float = 0.0
    measures: dict[str, str] = field(default_factory=dict)
    broken: str = ""  # a mistake of the check itself

    def pack(self) -> bytes:
        """As JSON."""
        found = {**vars(self), "findings": [[f.text, f.severity, f.line] for f in self.findings]}
        return json.dumps(found).encode()

    @classmethod
    def unpack(cls, data: bytes) -> Answer:
        """From JSON that an FMU may have written. Raises ValueError."""
        try:
            given = json.loads(data)
            if not isinstance(given, dict) or given.keys() != {f.name for f in fields(cls)}:
                raise ValueError("the fields differ")
            texts = {
                name: _text(given[name]) for name in ("inapplicable", "lost", "unjudged", "doing", "words", "broken")
            }
            findings = [_finding(*f) for f in _typed(given["findings"], list)[:MOST]]
            measures = {
                _text(k)[:_MEASURE]: _text(v)[:_MEASURE]
                for k, v in [*_typed(given["measures"], dict).items()][:_MOST_MEASURES]
            }
            seconds = float(_typed(given["seconds"], float))
            late: bool = _typed(given["late"], bool)
        except (ValueError, TypeError, RecursionError, MemoryError) as error:
            raise ValueError(f"not a valid answer of a check: {error}") from None
        return cls(
            findings=findings, measures=measures, seconds=seconds if math.isfinite(seconds) else 0.0, late=late, **texts
        )


def _typed(value: Any, type_: type) -> Any:
    if type(value) is not type_:
        raise ValueError(f"{type(value).__name__} for {type_.__name__}")
    return value


def _text(value: Any) -> str:
    return plain(_typed(value, str)[:_SPOKEN])


def _finding(text: Any, severity: Any, line: Any) -> Finding:
    if severity not in SEVERITIES:
        raise ValueError("an unknown severity")
    return Finding(_text(text), severity, int(_typed(line, int)))


@lru_cache(1)
def _model(data: bytes) -> Model:
    """A model description, of which all checks of an FMU have one."""
    model: Model = pickle.loads(data)
    return model


def execute(job: Job, say: Any = None) -> Answer:
    """Run a check in this process."""
    answer = Answer()
    check = CHECKS[job.check]
    bench = Bench(Fmu(_model(job.model), job.folder, job.libraries, say), job.kind, answer.measures)
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
        if refused.status == calls.DISCARD:
            answer.inapplicable = str(refused)
        else:
            answer.findings.append(Finding(str(refused), check.worst if refused.status != calls.FATAL else "error"))
    except MemoryError:
        answer.inapplicable = "it needs more memory than this process can have"
    except OSError as error:
        text = f"the library cannot be loaded: {' '.join(str(error).split())}"
        if _lacks_another_library(str(error), job.libraries[job.kind]):
            answer.unjudged = text  # binary.libraries says so
        else:
            answer.findings.append(Finding(text, "error"))
    except Exception:  # a mistake of ours must not look like one of the FMU
        answer.broken = traceback.format_exc()[-_SPOKEN:]
    return answer


def _lacks_another_library(error: str, library: Path) -> bool:
    """Whether a library is missing on this machine that the FMU's own library needs."""
    return "cannot open shared object file: No such file" in error and str(library) not in error


def _in_child(job: Job, memory: mmap.mmap, output: int) -> None:
    def say(text: str) -> None:
        data = text.encode()[: _SPOKEN - 4]
        memory[: 4 + len(data)] = struct.pack("=I", len(data)) + data

    data = execute(job, say).pack()
    with os.fdopen(output, "wb") as stream:
        stream.write(data)


def _close_but_one(output: int) -> int:
    """Close every descriptor except the standard ones and this one, which becomes 3.

    The other descriptors of this process lead to the process that judges the answers.
    """
    if output != 3:
        os.dup2(output, 3)
    os.closerange(4, min(os.sysconf("SC_OPEN_MAX"), 1 << 16))
    return 3


def supervise(job: Job) -> Answer:
    """Run a check in a fork of this process."""
    _model(job.model)  # before the fork, which then need not read it
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
            _in_child(job, memory, _close_but_one(writable))
            code = 0
        finally:
            os._exit(code)
    os.close(writable)
    data, ended = _listen(job, pid, readable, begin)
    os.close(readable)
    with contextlib.suppress(ProcessLookupError, PermissionError):
        os.killpg(pid, signal.SIGKILL)
    _, status = os.waitpid(pid, 0)
    _end_orphans()
    code = os.waitstatus_to_exitcode(status)
    answer = Answer()
    if not ended and data:
        try:
            answer = Answer.unpack(data)
        except ValueError as error:
            ended = f"it wrote to the result channel of the check ({error})"
    if ended or not data:
        answer.late = ended.startswith(LATE)
        answer.lost = ended or (
            f"signal {-code} ({signal.strsignal(-code)})" if code < 0 else f"its process ended with exit code {code}"
        )
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
    data, ended = b"", False
    while True:
        left = begin + job.seconds - time.monotonic()
        if left <= 0:
            return data, f"{LATE} {job.seconds:g} s"
        if select.select([readable], [], [], 0.0 if ended else min(left, _POLL))[0]:
            part = os.read(readable, 1 << 16)
            if not part:
                return data, ""
            data += part
            if len(data) > _LONGEST:
                return data, f"it wrote more than {_LONGEST} bytes to the result channel of the check"
        elif ended:  # a process that it has left still holds the other end
            return data, ""
        elif os.waitid(os.P_PID, pid, os.WEXITED | os.WNOHANG | os.WNOWAIT) is not None:
            ended = True
        elif (resident_memory(pid) or 0) > job.memory:
            return data, f"it used more than {job.memory / 1e6:,.0f} MB of memory"


def _end_orphans() -> None:
    """End the processes that an FMU has left. On Linux the detached ones have become children of this process."""
    end = time.monotonic() + _OF_ORPHANS
    with contextlib.suppress(ChildProcessError):
        while time.monotonic() < end:
            if os.waitpid(-1, os.WNOHANG)[0] == 0:
                for pid in _children():
                    with contextlib.suppress(ProcessLookupError, PermissionError):
                        os.kill(pid, signal.SIGKILL)
                time.sleep(0.001)


def _children() -> list[int]:
    found = []
    for name in os.listdir("/proc") if os.path.isdir("/proc") else ():
        with contextlib.suppress(OSError, ValueError, IndexError), open(f"/proc/{int(name)}/stat", "rb") as file:
            if int(file.read().rpartition(b")")[2].split()[1]) == os.getpid():
                found.append(int(name))
    return found


def receive(stream: BinaryIO, longest: int | None = None) -> bytes | None:
    """Bytes that `send` has sent; None at the end, and where they are more than `longest`."""
    head = stream.read(8)
    if len(head) < 8:
        return None
    (length,) = struct.unpack("=Q", head)
    if longest is not None and length > longest:
        return None
    data = stream.read(length)
    return data if len(data) == length else None


def receive_answer(stream: BinaryIO) -> Answer | None:
    """Receive the answer of a worker; None if the worker has ended, or writes something else.

    Where FMUs run in the worker itself, they can write there.
    """
    data = receive(stream, 2 * _LONGEST)
    with contextlib.suppress(ValueError):
        return None if data is None else Answer.unpack(data)
    return None


def send(stream: BinaryIO, data: bytes) -> None:
    """Write data after its length, for `receive` at the other end."""
    stream.write(struct.pack("=Q", len(data)) + data)
    stream.flush()


def _prepare_forks() -> None:
    """Do once what each fork would repeat: parse the C types that instances need, and copy what `gc` visits."""
    fake = SimpleNamespace(fmi2Instantiate=_nothing, fmi3InstantiateCoSimulation=_nothing)
    calls.instantiate2(fake, calls.c_library(), ("", "", ""), _nothing, [], "cs")
    calls.instantiate3(fake, ("", "", ""), _nothing, [], "cs")
    for version in ("2", "3"):
        parse_types(version)
    gc.collect()
    gc.freeze()


def _nothing(*_: Any) -> None:
    pass


def main() -> None:
    """Answer jobs until the other end is closed."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the parent process handles it and closes the pipe
    sources = os.fdopen(os.dup(0), "rb")
    answers = os.fdopen(os.dup(1), "wb")
    null = os.open(os.devnull, os.O_RDWR)
    os.dup2(null, 0)
    os.dup2(2, 1)
    if sys.platform == "linux":  # detached processes of an FMU become children of this one
        with contextlib.suppress(OSError, AttributeError):
            ctypes.CDLL(None).prctl(_SET_CHILD_SUBREAPER, 1, 0, 0, 0)
    _prepare_forks()
    while (data := receive(sources)) is not None:
        job = pickle.loads(data)
        if hasattr(os, "fork"):
            answer = supervise(job)
        else:
            begin = time.monotonic()
            _model.cache_clear()  # a check may change it
            answer = execute(job)
            answer.seconds = time.monotonic() - begin
        send(answers, answer.pack())
