"""Runs the checks of an FMU: of its file here, of what it does in processes of its own."""

from __future__ import annotations

import contextlib
import fnmatch
import os
import pickle
import shutil
import subprocess
import tempfile
import time
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from build_fmus.base import safe_files
from build_fmus.base.checks import did_you_mean
from build_fmus.base.interpreters import PYTHON, environment
from cosim.check import archive, binary, description_rules, layered, structure_rules, worker
from cosim.check.binary import claimed
from cosim.check.description_rules import File
from cosim.check.model import read
from cosim.check.report import Report, Result
from cosim.check.rules import CHECKS, GROUPS, MOST, Check, Finding, NotApplicable
from cosim.check.worker import LATE, Answer, Job, receive_answer, send
from cosim.core.errors import CosimError, FmuError
from cosim.core.memory import physical_memory
from cosim.fmu.archive import Archive
from cosim.fmu.calls import library_path
from cosim.fmu.find import find
from cosim.fmu.interface import NAMES
from cosim.fmu.limits import Limits
from cosim.fmu.xml import tree

__all__ = [
    "Options",
    "Workers",
    "archive",
    "binary",
    "check",
    "description_rules",
    "layered",
    "structure_rules",
    "worker",
]
LIFE = "states.life"  # without which nothing else can be run
WRONG_CALLS = ("states.step", "states.arguments", "values.unknown", "values.extreme", "saved.damaged")
"""Checks that make mistakes on purpose; an FMU that hangs in them is waited for less long. What takes its time in the
others is not judged.
"""
PATIENCE = 5.0  # s, or as many times as long as the FMU's life took, if that is longer
ONCE_PER_FMU = ("states.version",)  # what is the same for both interfaces


class Unchecked(CosimError):  # noqa: N818 (reads as what happened)
    """A file that cannot be checked at all; the message says why."""


@dataclass(frozen=True)
class Options:
    """What is checked, and what it may take.

    Args:
        only, skip: ids of checks, or patterns (`runs.*`); without `only` all.
        kinds: interfaces; fmi: version that the FMU must be of ("2", "3"), None any.
        seconds: time of one check [s]; memory: of its process [bytes], None half of the machine's.
        limits: of what is read.
    """

    only: tuple[str, ...] = ()
    skip: tuple[str, ...] = ()
    kinds: tuple[str, ...] = ("cs", "me")
    fmi: str | None = None
    seconds: float = 20.0
    memory: int | None = None
    limits: Limits = field(default_factory=Limits)

    def chosen(self) -> list[Check]:
        """The checks, in order. Raises Unchecked for ids and patterns that fit none."""
        for pattern in (*self.only, *self.skip):
            if not any(_fits(c, (pattern,)) for c in CHECKS.values()):
                near = did_you_mean(pattern, [*CHECKS, *GROUPS])
                raise Unchecked(f"there is no check {pattern!r}{near}; cosim check --list shows them all")
        return [c for c in ordered() if (not self.only or _fits(c, self.only)) and not _fits(c, self.skip)]

    @property
    def bytes(self) -> int:
        """Memory limit [bytes], by default half of the machine's memory."""
        return self.memory if self.memory is not None else physical_memory() // 2


def ordered() -> list[Check]:
    """All checks by group, as they are run."""
    return sorted(CHECKS.values(), key=lambda c: GROUPS.index(c.group))


def _fits(check: Check, patterns: Iterable[str]) -> bool:
    return any(fnmatch.fnmatchcase(check.id, p) or check.group == p for p in patterns)


class Workers:
    """The process that runs checks. Starting it takes a second, so several FMUs share one."""

    def __init__(self) -> None:
        self._process: subprocess.Popen[bytes] | None = None

    def __enter__(self) -> Workers:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def _start(self) -> subprocess.Popen[bytes]:
        if self._process is None or self._process.poll() is not None:
            command = [*PYTHON, "-c", "from cosim.check.worker import main; main()"]
            pipe = subprocess.PIPE
            self._process = subprocess.Popen(command, stdin=pipe, stdout=pipe, env=environment())
        return self._process

    def run(self, job: Job) -> Answer:
        """The answer to a job, whatever becomes of its process."""
        process = self._start()
        begin = time.monotonic()
        watch = None if hasattr(os, "fork") else _kill_later(process, job.seconds)
        try:
            send(process.stdin, pickle.dumps(job))  # type: ignore[arg-type]
            answer = receive_answer(process.stdout)  # type: ignore[arg-type]
        except (BrokenPipeError, OSError):
            answer = None
        finally:
            if watch is not None:
                watch.cancel()
        if answer is None:
            try:
                code = process.wait(1.0)
            except subprocess.TimeoutExpired:  # it writes what is no answer
                process.kill()
                code = process.wait()
            self._process = None
            seconds = time.monotonic() - begin
            late = watch is not None and seconds >= job.seconds
            answer = Answer(
                lost=f"{LATE} {job.seconds:g} s" if late else f"its process ended with exit code {code}",
                late=late,
                seconds=seconds,
            )
        return answer

    def close(self) -> None:
        """End the process."""
        process, self._process = self._process, None
        if process is not None:
            for stream in (process.stdin, process.stdout):
                with contextlib.suppress(OSError):
                    stream.close()  # type: ignore[union-attr]
            try:
                process.wait(5)
            except subprocess.TimeoutExpired:
                process.kill()
                process.wait()


def _kill_later(process: subprocess.Popen[bytes], seconds: float) -> Any:
    import threading

    timer = threading.Timer(seconds, process.kill)
    timer.start()
    return timer


Progress = Callable[[str, int, int], None]


def check(
    path: str | os.PathLike[str],
    options: Options | None = None,
    *,
    workers: Workers | None = None,
    progress: Progress | None = None,
) -> Report:
    """Check an FMU.

    Raises Unchecked if nothing can be checked: no file, no FMU, an unknown version.
    """
    options = options or Options()
    chosen = options.chosen()
    begin = time.monotonic()
    report = Report(Path(path))
    with contextlib.ExitStack() as stack:
        file = _opened(report, options, stack)
        if file is not None:
            if workers is None:
                workers = stack.enter_context(Workers())
            _run_all(report, file, chosen, options, workers, progress or (lambda what, done, of: None))
    report.seconds = time.monotonic() - begin
    return report


READABLE = Check(
    "archive.readable",
    "the archive and its description can be read",
    {"2": "2.3 FMU Distribution", "3": "2.5 FMU Distribution"},
    "Create the archive again, with a valid description.",
    ("2", "3"),
    (),
    "error",
    lambda *_: (),
)
CHECKS.setdefault(READABLE.id, READABLE)


def _opened(report: Report, options: Options, stack: contextlib.ExitStack) -> File | None:
    """The FMU, unpacked; None where it cannot be read, which the report then says."""
    try:
        report.path = path = find(report.path)
        file = Archive(path, options.limits)
        xml = file.description()
    except FmuError as error:
        raise Unchecked(str(error)) from None
    try:
        root = tree(xml, str(path), options.limits)
    except FmuError as error:
        report.fmi = "?"
        _unreadable(report, error)
        return None
    version = root.get("fmiVersion", "")
    if root.tag != "fmiModelDescription" or not version.startswith(("2.", "3.")):
        raise Unchecked(f"{path}: FMI version {version[:40]!r} is not known; FMI 2.0 and 3.0 can be checked")
    if options.fmi is not None and version[0] != options.fmi:
        raise Unchecked(f"{path} is an FMU of FMI {version[:40]}, not of FMI {options.fmi}.0 as requested")
    found = File(file, root, read(root))
    model = found.model
    report.name, report.fmi, report.tool = model.name, model.fmi, model.tool
    report.interfaces = (*(NAMES[k] for k in model.interfaces), *(["Scheduled Execution"] if model.scheduled else []))
    folder = Path(tempfile.mkdtemp(dir=safe_files.scratch()))
    stack.callback(shutil.rmtree, folder, ignore_errors=True)
    try:
        file.unpack(folder)
    except FmuError as error:
        _unreadable(report, error)
        return None
    (folder / "resources").mkdir(exist_ok=True)
    found.folder = folder
    report.layered = tuple(layered.declared(found))
    return found


def _unreadable(report: Report, error: FmuError) -> None:
    text = str(error).removeprefix(f"{report.path}: ")
    report.results.append(Result(READABLE, "", (Finding(text, "error"),)))


def _run_all(
    report: Report, file: File, chosen: list[Check], options: Options, workers: Workers, progress: Progress
) -> None:
    version, model = file.model.version, file.model
    mine = [c for c in chosen if version in c.versions and c.id != READABLE.id]
    still = [c for c in mine if not c.kinds]
    moving = [c for c in mine if c.kinds]
    for done, c in enumerate(still):
        progress(c.id, done, len(mine))
        report.results.append(_of_file(c, file))
    _measure_libraries(report, file)
    kinds = [k for k in model.interfaces if k in options.kinds]
    paths = {k: library_path(version, model.interfaces[k].identifier) for k in kinds}
    reasons = {k: _cannot_run(file, path) for k, path in paths.items()}
    if model.scheduled and not kinds:
        report.not_run = "it offers Scheduled Execution only, which cosim check does not run"
    elif kinds and all(reasons.values()):
        report.not_run = reasons[kinds[0]]
    libraries = {k: file.folder / path for k, path in paths.items() if not reasons[k]}

    def run(check: Check, kind: str, seconds: float) -> Result:
        job = Job(check.id, kind, file.packed_model, file.folder, libraries, seconds, options.bytes)
        return _of_instance(check, kind, workers.run(job), report)

    done = len(still)
    patience = dict.fromkeys(kinds, PATIENCE)
    for kind in kinds:
        of_kind = [c for c in moving if kind in c.kinds]
        reason = reasons[kind]
        if not reason:  # first of all it must live
            result = run(CHECKS[LIFE], kind, options.seconds)
            patience[kind] = PATIENCE * max(1.0, round(result.seconds, 1))
            if result.verdict == "not judged":
                reason = report.not_run = result.inapplicable
            elif result.findings and result.verdict == "error":
                reason = f"the FMU cannot be run (see {LIFE})"
                if model.interfaces[kind].needs_tool:
                    why = f"it needs its tool, which is not available here: {result.findings[0].text}"
                    result = Result(result.check, kind, (), why, result.seconds)
                    report.not_run = report.not_run or why
            if any(c.id == LIFE for c in of_kind) or result.findings or reason:
                report.results.append(result)
            of_kind = [c for c in of_kind if c.id != LIFE]
        for c in of_kind:
            progress(f"{c.id}, {NAMES[kind]}", min(done, len(mine) - 1), len(mine))
            done += 1
            if c.id in ONCE_PER_FMU and kind != kinds[0]:
                continue
            if reason:
                report.results.append(Result(c, kind, (), reason))
            else:
                seconds = min(options.seconds, patience[kind]) if c.id in WRONG_CALLS else options.seconds
                report.results.append(run(c, kind, seconds))


def _cannot_run(file: File, path: str) -> str:
    """Why an interface with its library there cannot be run here; empty: it can."""
    if (file.folder / path).is_file():
        return ""
    others = sorted({folder for folder, _ in file.archive.libraries() if claimed(folder, file.model.version)})
    there = f"it has binaries for {', '.join(others)}" if others else "it has no binaries"
    return f"there is no binary for this platform ({path}); {there}"


def _measure_libraries(report: Report, file: File) -> None:
    """Newest versions of glibc that the libraries need."""
    for path, (library, _) in binary.libraries(file).items():
        if isinstance(library, binary.Library) and library.glibc:
            report.measures[f"{path} needs glibc"] = ".".join(map(str, library.glibc))


def _of_file(check: Check, file: File) -> Result:
    begin = time.monotonic()
    found: list[Finding] = []
    reason = ""
    try:
        found = list(check.run(file))
    except NotApplicable as why:
        reason = str(why)
    return Result(check, "", tuple(found[:MOST]), reason, time.monotonic() - begin, max(0, len(found) - MOST))


def _of_instance(check: Check, kind: str, answer: Answer, report: Report) -> Result:
    if answer.broken:
        report.failures.append(f"{check.id}, {NAMES[kind]}:\n{answer.broken}")
        return Result(check, kind, (), "the check itself failed, which says nothing about the FMU", answer.seconds)
    findings = list(answer.findings)
    doing = f" in {answer.doing}" if answer.doing else ""
    if answer.late and check.id not in WRONG_CALLS:
        answer.unjudged = f"{answer.lost}{doing}; --timeout gives it more time"
    elif answer.lost:
        words = f"; its last output: {answer.words}" if answer.words else ""
        findings.append(Finding(f"the process of the FMU failed{doing}: {answer.lost}{words}", check.worst))
    for name, value in answer.measures.items():
        report.measures[f"{name} ({NAMES[kind]})"] = value
    return Result(
        check, kind, tuple(findings), answer.unjudged or answer.inapplicable, answer.seconds, judged=not answer.unjudged
    )
