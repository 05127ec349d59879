"""A controller on an emulated microcontroller as a component: its firmware runs in QEMU, sample by sample."""

from __future__ import annotations

import hashlib
import json
import os
import select
import shutil
import struct
import subprocess
import time
import weakref
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from cosim.core.component import PythonComponent
from cosim.core.errors import CosimError
from cosim.core.signals import Array

QEMU = "qemu-system-arm"
FOLDER = Path("fmus") / "target"
_STATUS = (
    "done",
    "an input or a value is not finite",
    "a value is outside its range",
    "the parameter cannot be set once the controller runs",
    "the firmware has no such parameter: build it again",
    "the parameters contradict each other",
    "a result is not finite",
)


class EmulatedTarget(PythonComponent):
    """The firmware of a component in an emulator of its processor.

    Besides the outputs of the component it has `target.instructions` of the sample, in steps of 40, and `target.stack`,
    the largest stack so far [bytes].
    """

    kind = "discrete"

    def __init__(self, folder: Path, timeout: float = 10.0) -> None:
        """`timeout` [s]: for each sample."""
        self._folder, self._timeout = folder, timeout
        self._about = _read(folder / "interface.json")
        self._firmware_hash = hashlib.sha256((folder / "firmware.elf").read_bytes()).hexdigest()
        about = self._about
        self.inputs = [_with_unit(*v) for v in about["inputs"]]  # type: ignore[misc]
        self.outputs = [*(_with_unit(*v) for v in about["outputs"]), "target.instructions [1]", "target.stack [1]"]  # type: ignore[misc]
        self.parameters = {_with_unit(n, u): x for n, u, x, _, _ in about["parameters"]}  # type: ignore[misc]
        self.default_step = about["sample_time"]  # type: ignore[misc]
        super().__init__()
        starts = dict(zip((n for n, _ in about["inputs"]), about["input_starts"], strict=True))
        variables = {
            n: replace(v, start=starts[n]) if n in starts else v for n, v in self.description.variables.items()
        }
        name = f"{about['component']} on {about['board']}"
        self.description = replace(self.description, name=name, variables=variables, can_save=False)
        self._inputs = {v: i for i, v in enumerate(self.description.inputs.values())}
        self._outputs = {v: i for i, v in enumerate(self.description.outputs.values())}
        self._process: subprocess.Popen[bytes] | None = None

    def begin(self) -> None:
        """Start the emulator."""
        self.close()
        program = shutil.which(QEMU)
        if program is None:
            raise CosimError(f"{QEMU} is not in PATH: install it (Debian package qemu-system-arm)")
        machine = ["-M", self._about["board"], "-kernel", str(self._folder / "firmware.elf")]
        plain = ["-display", "none", "-monitor", "none", "-serial", "stdio", "-icount", "shift=0"]
        pipe = subprocess.PIPE
        self._process = subprocess.Popen(
            [program, *machine, *plain], stdin=pipe, stdout=pipe, stderr=subprocess.DEVNULL
        )
        self._end = weakref.finalize(self, _stop, self._process)
        self._fresh = False

    def start(self, u: Array, y: Array) -> None:
        """Outputs of a first sample that is not kept."""
        self._initialize()
        self._sample(u, y)
        self._fresh = False

    def step(self, t: float, h: float, u: Array, y: Array) -> None:  # noqa: ARG002
        """Take a sample."""
        if not self._fresh:
            self._initialize()
            self._fresh = True
        changed = {n: getattr(self, n) for n, *_ in self._about["parameters"]}
        self._set_parameters({n: x for n, x in changed.items() if x != self._set[n]})
        self._sample(u, y)

    def _initialize(self) -> None:
        self._check(self._ask(b"i", 4))
        self._set = {n: start for n, _, start, _, _ in self._about["parameters"]}
        self._set_parameters({n: x for n in self._set if (x := getattr(self, n)) != self._set[n]})

    def _set_parameters(self, values: dict[str, float]) -> None:
        for name, _, _, parameter, element in self._about["parameters"]:
            if name in values:
                answer = self._ask(struct.pack("<ciid", b"p", parameter, element, values[name]), 4)
                self._check(answer, f"{name} = {values[name]}: ")
                self._set[name] = values[name]

    def _sample(self, u: Array, y: Array) -> None:
        n = len(self._about["outputs"])
        number = np.dtype("<f4" if self._about.get("precision") == "single" else "<f8")
        answer = self._ask(b"s" + u.astype(number).tobytes(), 12 + number.itemsize * n)
        self._check(answer)
        ticks, stack = struct.unpack_from("<II", answer, 4)
        y[:n] = np.frombuffer(answer, number, n, 12)
        y[n:] = 40 * ticks, stack

    def _check(self, answer: bytes, what: str = "") -> None:
        (status,) = struct.unpack_from("<i", answer)
        if status:
            text = _STATUS[status] if 0 < status < len(_STATUS) else f"status {status}"
            raise ValueError(f"{what}{text}")

    def _ask(self, request: bytes, n: int) -> bytes:
        """Send a request, and return the `n` bytes of the answer."""
        process = self._process
        if process is None or process.stdin is None or process.stdout is None:
            raise CosimError("the emulator does not run")
        end = time.monotonic() + self._timeout
        answer = b""
        try:
            process.stdin.write(request)
            process.stdin.flush()
            while len(answer) < n:
                ready, _, _ = select.select([process.stdout], [], [], max(0.0, end - time.monotonic()))
                if not ready:
                    self.close()
                    raise CosimError(f"no answer of the emulated {self._about['board']} within {self._timeout:g} s")
                more = os.read(process.stdout.fileno(), n - len(answer))
                if not more:
                    raise BrokenPipeError
                answer += more
        except BrokenPipeError:
            code = process.wait(self._timeout)
            raise CosimError(f"the emulator of {self._about['board']} has ended (exit code {code})") from None
        return answer

    def identity(self) -> dict[str, str]:
        """What makes a run another one: the firmware."""
        return {**super().identity(), "firmware": self._firmware_hash}

    def terminate(self) -> None:
        """Stop the emulator."""
        self.close()

    def close(self) -> None:
        """Stop the emulator."""
        if self._process is not None:
            self._end()
            self._process = None


def _stop(process: subprocess.Popen[bytes]) -> None:
    process.kill()
    process.wait()
    for pipe in (process.stdin, process.stdout):
        if pipe is not None:
            pipe.close()


def _with_unit(name: str, unit: str) -> str:
    return f"{name} [{unit}]" if unit else name


def _read(path: Path) -> dict[str, Any]:
    try:
        about = json.loads(path.read_text(encoding="utf-8"))
        names = [[n for n, *_ in about[k]] for k in ("inputs", "outputs", "parameters")]
        if len(about["input_starts"]) == len(names[0]) and {"component", "board", "sample_time"} <= about.keys():
            return dict(about)
    except (ValueError, KeyError, TypeError, AttributeError):
        pass
    raise CosimError(f"{path}: it is not what build-fmus --target writes; build the component again")


def target(
    name: str, processor: str, *, folder: str | os.PathLike[str] = FOLDER, timeout: float = 10.0
) -> EmulatedTarget:
    """A component on an emulated processor, for `System.add`.

    Args:
        name: of the component, such as `LqrHmmwv`.
        processor: "cortex-m4f" or "cortex-m7".
        folder: that `build-fmus --target` has written.
        timeout: for each sample [s].

    Raises:
        CosimError: the firmware is not built.
    """
    place = Path(folder) / processor / name
    if not (place / "interface.json").is_file() or not (place / "firmware.elf").is_file():
        raise CosimError(
            f"no firmware of {name} for {processor} in {folder}; build it with `build-fmus --target {processor} {name}`"
            " (cortex-m4f and cortex-m7 are emulated)"
        )
    return EmulatedTarget(place, timeout)
