"""The process of one isolated FMU: started, asked, and lost with a sentence that says how."""

from __future__ import annotations

import contextlib
import mmap
import os
import re
import signal
import socket
import subprocess
import sys
import sysconfig
import tempfile
import time
import weakref
from dataclasses import dataclass
from functools import cache, lru_cache
from pathlib import Path
from typing import Any

import cffi

if sys.platform != "win32":
    import fcntl

import cosim.fmu.calls as fmi
from build_fmus.base import safe_files, surface
from build_fmus.base.checks import number
from build_fmus.compile import CompileError, ObjectCache, find_toolchain, host
from cosim.core.c_headers import declarations
from cosim.core.errors import FmuError
from cosim.core.interrupt import CANCELLERS
from cosim.core.memory import physical_memory
from cosim.engine.library import INTEGRATOR, INTERMEDIATE
from cosim.fmu.environment import HEADER as ENVIRONMENT
from cosim.fmu.environment import what_changed

_FOLDER = Path(__file__).parent
_REGION = 64 * 2**20  # bytes; pages that nobody touches cost nothing
_PATIENCE = 0.5  # s for a process that has closed its connection to end
_LEAVING = 10.0  # s for the process that ends those of an FMU
_SPIN = 50.0  # microseconds for which the master looks for an answer before it sleeps

_EXPORTED = """
typedef void (*LinkLogger)(int status, const char *category, const char *text);
typedef struct Link Link;
void link_cancel(int yes);
Link *link_open(void *memory, size_t size, bool shared, int fd, int pid, double timeout, double spin_us);
void link_close(Link *l);
void link_release(Link *l);
void link_forked(void);
int link_end(const Link *l);
const char *link_failed(const Link *l);
uint32_t link_environment(const Link *l);
uint32_t link_no_memory(const Link *l);
int link_load(Link *l, const char *library, const char *functions, int version);
const char *link_said(const Link *l);
bool link_instantiate(Link *l, const char *name, const char *token, const char *resources, bool exchange, int events,
                      const uint32_t *required, size_t n_required, LinkLogger log);
void link_follow(Link *l, void *update);
uint32_t link_integrate(Link *l, const char *setup, size_t size, double t);
uint32_t link_integrator(Link *l, char *bytes, size_t size, bool set);
"""


class NoIsolation(FmuError):  # noqa: N818
    """FMUs cannot be isolated on this machine; the message says why."""


@dataclass(frozen=True)
class Isolation:
    """What an isolated FMU may take.

    Args:
        step_timeout: wall time of one call into the FMU [s]; None: any. What takes longer is ended.
        memory_limit: bytes that it may allocate; None: half of what the machine has.
        shared_memory: False: everything goes through a socket, as where there is no shared memory.
    """

    step_timeout: float | None = 60.0
    memory_limit: int | None = None
    shared_memory: bool = True

    def __post_init__(self) -> None:
        if self.step_timeout is not None:
            number("step_timeout", self.step_timeout, "s", above=0.0)
        if self.memory_limit is not None:
            number("memory_limit", self.memory_limit, "bytes", least=2**20)

    @property
    def bytes(self) -> int:
        """The memory that it may allocate."""
        if self.memory_limit is not None:
            return int(self.memory_limit)
        return physical_memory() // 2


@lru_cache
def _interface() -> tuple[cffi.FFI, Any, Path, Path]:
    """Types, client library and its path, and the worker's program. Raises NoIsolation."""
    if sys.platform == "win32":
        option = surface.hint("isolated=True", "--isolate")
        raise NoIsolation(f"FMUs can be isolated on Linux and macOS only; run without {option or 'isolation'}")
    ffi = cffi.FFI()
    ffi.cdef(declarations(_FOLDER / "link.h") + _EXPORTED)
    try:
        toolchain, cache = find_toolchain(host()), ObjectCache.of_user()
        client = cache.library(toolchain, [_FOLDER / "client.c"], [_FOLDER, INTERMEDIATE.parent], "client")
        sources = [_FOLDER / "worker.c", _FOLDER / "launcher.c"]
        sources += [header.with_suffix(".c") for header in (INTEGRATOR, INTERMEDIATE)]
        worker = cache.program(toolchain, sources, [_FOLDER, ENVIRONMENT.parent, INTEGRATOR.parent])
        loaded = ffi.dlopen(str(client))
        os.register_at_fork(after_in_child=loaded.link_forked)
        return ffi, loaded, client, worker
    except (CompileError, OSError) as error:
        raise NoIsolation(f"FMUs cannot be isolated here: {str(error).splitlines()[0]}") from error


def require(what: str) -> None:
    """Raise NoIsolation where FMUs cannot be isolated; the message begins with `what`."""
    try:
        _interface()
    except NoIsolation as error:
        raise NoIsolation(f"{what}: {error}") from None


@lru_cache
def _functions(version: str) -> Any:
    """FMI's functions of the client library."""
    return fmi.ffi_of(version).dlopen(str(_interface()[2]))


def _cancel(yes: bool) -> None:
    """Let go of all calls that this process is waiting for (yes), or let them be waited for again."""
    if _interface.cache_info().currsize:
        _interface()[1].link_cancel(yes)


CANCELLERS.append(_cancel)


@cache
def _libpython() -> str:
    """The library of this Python, for FMUs that expect it in their process (PythonFMU); "" without one."""
    name, folder = (str(sysconfig.get_config_var(n) or "") for n in ("INSTSONAME", "LIBDIR"))
    return next(
        (str(p) for p in (Path(folder, name), Path(sys.base_prefix, "lib", name)) if ".so" in name and p.is_file()), ""
    )


class _Handle:
    """An FMU's functions, those that its library has."""

    def __init__(self, version: str, missing: frozenset[str]):
        self._functions, self._missing = _functions(version), missing

    def __getattr__(self, name: str) -> Any:
        if name in self._missing:
            raise AttributeError(name)
        return getattr(self._functions, name)


class IsolatedLibrary:
    """The library of an FMU in a process of its own, for one instance.

    Raises FmuError where it cannot be loaded, NoIsolation where nothing can be isolated, and `WorkerCrashed` where it
    ends its process.
    """

    def __init__(self, version: str, interface: str, library: Path, folder: Path, isolation: Isolation):
        self.folder = folder
        self.isolation = isolation
        self.cancelled = False  # a second Ctrl-C ended it
        self._version, self._exchange = version, interface == "me"
        self._last_words: tuple[str | None, str, str] | None = (
            None  # of `lost`, `failing_function` and `failure_detail`, once it is released
        )
        ffi, client, _, worker = _interface()
        self._ffi, self._client = ffi, client
        limit = isolation.bytes
        memory = _shared_memory() if isolation.shared_memory else None
        ours, theirs = socket.socketpair()
        with contextlib.ExitStack() as stack:
            stack.callback(theirs.close)
            given = [theirs.fileno()]
            if memory is not None:
                stack.callback(os.close, memory)
                given.append(memory)
            arguments = [theirs.fileno(), -1 if memory is None else memory, _REGION, limit, os.getpid()]
            try:
                region = mmap.mmap(-1 if memory is None else memory, _REGION)
                self._process = subprocess.Popen(
                    [str(worker), *map(str, arguments)],
                    pass_fds=given,
                    stdin=subprocess.DEVNULL,
                    start_new_session=True,
                    env={"SUSPENSION_FMUS_LIBPYTHON": _libpython(), **os.environ},
                )
            except OSError as error:
                ours.close()
                raise NoIsolation(f"cannot start a process for an FMU: {error.strerror or error}") from None
        self.owner = os.getpid()
        spin = _SPIN if (os.cpu_count() or 1) > 1 else 0.0
        buffer = ffi.from_buffer(region)
        self._link = client.link_open(
            buffer, _REGION, memory is not None, ours.fileno(), self._process.pid, isolation.step_timeout or 0.0, spin
        )
        self._finalizer = weakref.finalize(self, _end, self._process, ours, self.owner)
        if self._link == ffi.NULL:
            self._finalizer()
            raise NoIsolation("cannot isolate an FMU: there is no memory left")
        # Holders may still call and get the error that the process is lost; so the link lives as long.
        weakref.finalize(self, _forget, ffi, client, self._link, buffer, region)
        result = client.link_load(
            self._link, os.fsencode(library), " ".join(fmi.declared(version, interface)).encode(), int(version)
        )
        if result:
            lost = self.lost()
            said = "" if result < 0 else self._reply()
            self.release()
            if re.search("undefined symbol: _?Py", said):
                said += (
                    "; it expects the library of Python in its process, and this Python has none: run it without"
                    " isolation"
                )
            raise WorkerCrashed(lost) if lost else FmuError(said)
        missing = frozenset(self._reply().split())
        self.missing = [name for name in fmi.required(version, interface) if name in missing]
        self.absent = missing
        self.handle = _Handle(version, missing)

    def _reply(self) -> str:
        return fmi.text(self._ffi, self._client.link_said(self._link))

    def instantiate(
        self,
        texts: tuple[str, str, str],
        log: fmi.Log,
        keep: list[Any],
        *,
        event_mode: bool = False,
        early_return: bool = False,
        intermediate: fmi.Intermediate | None = None,
    ) -> Any:
        """The instance, or NULL. `texts` = name, token, folder of resources as this version of FMI wants it."""
        ffi = self._ffi

        @ffi.callback("LinkLogger", onerror=fmi._quiet)
        def logger(status: int, category: Any, message: Any) -> None:
            log(status, fmi.text(ffi, category), fmi.text(ffi, message))

        keep.append(logger)
        inputs = list(intermediate[2]) if intermediate else []
        required = ffi.new("uint32_t[]", inputs), len(inputs)
        how = self._exchange, event_mode | early_return << 1
        there = self._client.link_instantiate(self._link, *(t.encode() for t in texts), *how, *required, logger)
        types = fmi.ffi_of(self._version)
        return types.cast("Component", int(ffi.cast("uintptr_t", self._link)) if there else 0)

    def follow(self, steps: int) -> None:
        """Inputs follow inside its steps, as the `IntermediateStep` at this address says."""
        self._client.link_follow(self._link, self._ffi.cast("void*", steps))

    def integrate(self, setup: bytes, t: float) -> int:
        """Make the integrator of a Model Exchange FMU at the end of its initialization; returns a status."""
        return int(self._client.link_integrate(self._link, setup, len(setup), t))

    def remembered(self, size: int) -> bytes | None:
        """Memory and report of the integrator; None when the process is lost."""
        data = self._ffi.new("char[]", size)
        status = self._client.link_integrator(self._link, data, size, False)
        return bytes(self._ffi.buffer(data)) if status <= fmi.WARNING else None

    def remember(self, memory: bytes) -> None:
        """Replace the memory of the integrator."""
        self._client.link_integrator(self._link, self._ffi.from_buffer("char[]", memory), len(memory), True)

    def reusable(self, isolation: Isolation | None) -> bool:
        """Whether its instance will do for one that is isolated so: not in a process that was forked since."""
        return isolation == self.isolation and os.getpid() == self.owner

    def lost(self) -> str | None:
        """How the FMU was lost, in words; None: it is there."""
        if self._last_words is not None:
            return self._last_words[0]
        client = self._client
        end = client.link_end(self._link)
        if end == client.LINK_ALIVE:
            return None
        if end == client.LINK_TOO_SLOW:
            return (
                f"a call did not return within step_timeout = {self.isolation.step_timeout:g} s; its process was"
                " terminated"
            )
        if end == client.LINK_CANCELLED:
            self.cancelled = True
            return "the call was canceled and its process terminated"
        if end == client.LINK_INHERITED:
            return "its process belongs to the parent of this forked process; create a new system here"
        if end == client.LINK_RELEASED:
            return "it is closed"
        if end == client.LINK_LIED:
            return "its process corrupted the memory shared with the master and was terminated"
        code = _exit_code(self._process)
        if code is None:
            return "it closed the connection to the master; its process was terminated"
        text = f"its process ended with exit code {code}"
        if code < 0:
            text = f"its process was ended by signal {-code} ({signal.strsignal(-code) or 'unknown'})"
        if client.link_no_memory(self._link):
            text += f"; it had used up its memory_limit of {self.isolation.bytes / 1e6:,.0f} MB"
        return text

    def failing_function(self, function: str) -> str:
        """The function that failed in a call of `function`: values that are set are sent with the next step."""
        name = self._last_words[1] if self._last_words else fmi.text(self._ffi, self._client.link_failed(self._link))
        return name.removeprefix(f"fmi{self._version}") or function

    def failure_detail(self) -> str:
        """What is to be said about a call that failed, apart from its status."""
        if self._last_words is not None:
            return self._last_words[2]
        client = self._client
        changed = client.link_environment(self._link)
        if changed:
            return f"it changed {what_changed(changed)}"
        if client.link_no_memory(self._link):
            return f"it has used up its memory_limit of {self.isolation.bytes / 1e6:,.0f} MB"
        return ""

    def release(self) -> None:
        """End the process."""
        if self._last_words is None:
            self._last_words = self.lost(), self.failing_function(""), self.failure_detail()
            self._client.link_release(self._link)
            self._finalizer()


class WorkerCrashed(Exception):  # noqa: N818
    """An isolated FMU was lost; the argument says how."""


def _exit_code(process: Any) -> int | None:
    """Exit code of a process that has ended, or ends within half a second; negative: ended by a signal.

    If the operating system permits, the process stays a zombie, so that no other process gets the number by which its
    group is ended.
    """
    if not hasattr(os, "waitid"):
        with contextlib.suppress(subprocess.TimeoutExpired):
            return int(process.wait(_PATIENCE))
        return None
    end = time.monotonic() + _PATIENCE
    try:
        while (found := os.waitid(os.P_PID, process.pid, os.WEXITED | os.WNOHANG | os.WNOWAIT)) is None:
            if time.monotonic() > end:
                return None
            time.sleep(0.001)
    except ChildProcessError:  # another part of the program has waited for it
        return None
    return found.si_status if found.si_code == os.CLD_EXITED else -found.si_status


def _end(process: Any, ours: socket.socket, owner: int) -> None:
    """End the process of an FMU and all that it has started; a forked child leaves them to its parent."""
    with contextlib.suppress(OSError):  # a program that becomes a daemon has closed it
        ours.close()
    if os.getpid() != owner:
        return
    process.terminate()  # it ends the FMU's processes, then itself (launcher.c)
    try:
        process.wait(_LEAVING)
    except subprocess.TimeoutExpired:
        process.kill()
        process.wait()


def _forget(ffi: Any, client: Any, link: Any, buffer: Any, region: mmap.mmap) -> None:
    client.link_close(link)
    ffi.release(buffer)
    with contextlib.suppress(BufferError):
        region.close()


def _shared_memory() -> int | None:
    """File descriptor of memory that two processes can share; None if the system offers no such memory."""
    try:
        if hasattr(os, "memfd_create"):
            descriptor = os.memfd_create("cosim", os.MFD_CLOEXEC | os.MFD_ALLOW_SEALING)
            os.ftruncate(descriptor, _REGION)
            # a file that shrinks would end the master by SIGBUS
            sizes = fcntl.F_SEAL_SHRINK | fcntl.F_SEAL_GROW | fcntl.F_SEAL_SEAL
            fcntl.fcntl(descriptor, fcntl.F_ADD_SEALS, sizes)
        else:
            descriptor, name = tempfile.mkstemp(dir=safe_files.scratch())
            os.unlink(name)
            os.ftruncate(descriptor, _REGION)
    except OSError:
        return None
    return descriptor
