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

from cosim.core import plain
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
    the largest stack so far [bytes]. Its state can be saved and restored, in this and in another emulator.
    """

    kind = "discrete"

    def __init__(self, folder: Path, timeout: float = 10.0) -> None:
        """`timeout` [s]: for each request."""
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
        self.description = replace(self.description, name=name, variables=variables)
        self._inputs = {v: i for i, v in enumerate(self.description.inputs.values())}
        self._outputs = {v: i for i, v in enumerate(self.description.outputs.values())}
        self._process: subprocess.Popen[bytes] | None = None

    def begin(self) -> None:
        """Start the emulator."""
        self.close()
        program = shutil.which(QEMU)
        if program is None:
            raise CosimError(f"{QEMU} is not in PATH: install it (Debian package qemu-system-arm)")
        machine = ["-M", self._about["board"], "-kernel", str(self._folder / "firmware.elf"), "-icount", "shift=0"]
        plain = ["-display", "none", "-monitor", "none", "-serial", "none"]
        calls = ["-semihosting-config", "enable=on,target=native"]
        pipe = subprocess.PIPE
        self._process = subprocess.Popen(
            [program, *machine, *plain, *calls], stdin=pipe, stdout=pipe, stderr=subprocess.DEVNULL, bufsize=0
        )
        for end in (self._process.stdin, self._process.stdout):
            os.set_blocking(end.fileno(), False)  # type: ignore[union-attr]
        self._end = weakref.finalize(self, _stop, self._process)
        self._fresh, self._set = False, self._starts()

    def start(self, u: Array, y: Array) -> None:
        """Outputs of a first sample that is not kept."""
        self._initialize()
        self._sample(u[None], y[None])
        self._fresh = False

    def step(self, t: float, h: float, u: Array, y: Array) -> None:  # noqa: ARG002
        """Take a sample."""
        self._prepare()
        self._sample(u[None], y[None])

    def take_samples(self, u: Array) -> Array:
        """Samples one after the other from inputs that are known: many times faster than single steps.

        Args:
            u: inputs (samples x inputs), in the declared order.

        Returns:
            Outputs (samples x outputs). `target.stack` is that at the end of each request of many samples.

        Raises:
            ValueError: a sample failed; the message has its number, from 0.
            CosimError: the emulator has ended, or does not answer.
        """
        self._prepare()
        y, most = np.zeros((len(u), len(self.outputs))), self._about["frame"]
        for k in range(0, len(u), most):
            self._sample(u[k : k + most], y[k : k + most], k)
        return y

    def start_again(self) -> None:
        """Take the next sample from the start."""
        self._fresh = False

    def _prepare(self) -> None:
        if not self._fresh:
            self._initialize()
            self._fresh = True
        changed = {n: getattr(self, n) for n, *_ in self._about["parameters"]}
        self._set_parameters({n: x for n, x in changed.items() if x != self._set[n]})

    def _initialize(self) -> None:
        self._check(self._ask(b"i", 4))
        self._set = self._starts()
        self._set_parameters({n: x for n in self._set if (x := getattr(self, n)) != self._set[n]})

    def _starts(self) -> dict[str, float]:
        return {n: start for n, _, start, _, _ in self._about["parameters"]}

    def _set_parameters(self, values: dict[str, float]) -> None:
        for name, _, _, parameter, element in self._about["parameters"]:
            if name in values:
                answer = self._ask(struct.pack("<ciid", b"p", parameter, element, values[name]), 4)
                self._check(answer, f"{name} = {values[name]}: ")
                self._set[name] = values[name]

    def _sample(self, u: Array, y: Array, first: int | None = None) -> None:
        rows, n = len(u), len(self._about["outputs"])
        number = np.dtype("<f4" if self._about["precision"] == "single" else "<f8")
        row = np.dtype([("ticks", "<f8"), ("outputs", number, (n,))], align=True)  # as in firmware.c
        request = struct.pack("<cI", b"s", rows) + u.astype(number).tobytes()
        answer = self._ask(request, 12 + row.itemsize * rows)
        _, taken, stack = struct.unpack_from("<III", answer)
        self._check(answer, "" if first is None else f"sample {first + taken}: ")
        found = np.frombuffer(answer, row, rows, 12)
        y[:, :n], y[:, n], y[:, n + 1] = found["outputs"], 40 * found["ticks"], stack

    def save(self) -> Any:
        """The instance in the emulator's memory, the parameters, inputs and outputs."""
        return {
            "firmware": self._firmware_hash,
            "memory": np.frombuffer(self._ask(b"g", 4 + self._about["state_bytes"]), np.uint8, offset=4),
            "set": dict(self._set),
            "parameters": {n: getattr(self, n) for n in self._set},
            "fresh": self._fresh,
            "inputs": self._u.copy(),
            "outputs": self._y.copy(),
        }

    def restore(self, state: Any) -> None:
        """Continue from a saved state, also in another emulator.

        Raises:
            CosimError: the state is not one of this firmware.
        """
        sizes = {"inputs": len(self._u), "outputs": len(self._y), "memory": self._about["state_bytes"]}
        if state["firmware"] != self._firmware_hash or any(len(state[k]) != n for k, n in sizes.items()):
            raise self._not_own()
        self._check(self._ask(b"r" + state["memory"].tobytes(), 4))
        self._u[:], self._y[:] = state["inputs"], state["outputs"]
        self._set, self._fresh = dict(state["set"]), state["fresh"]
        vars(self).update(state["parameters"])

    def pack(self, state: Any) -> bytes:
        """The state as plain data.

        Raises:
            CosimError: it has addresses, those of a QP solver, which a forged file would turn against the emulator.
        """
        if self._about["has_addresses"]:
            raise CosimError("the state of its QP solver has addresses, which are not taken from files")
        return plain.encode(state)

    def unpack(self, data: bytes) -> None:
        """Continue from what `pack` gave.

        Raises:
            CosimError: it is something else.
        """
        try:
            state = plain.decode(data)
            kinds = {k: type(v) for k, v in self.save().items()}
            numbers = [state[k] for k in ("inputs", "outputs")] + [[*state[k].values()] for k in ("set", "parameters")]
            names = state["set"].keys() == state["parameters"].keys() == self._set.keys()
            valid = names and {k: type(v) for k, v in state.items()} == kinds and not self._about["has_addresses"]
            if valid and all(np.isfinite(np.asarray(n, dtype=float)).all() for n in numbers):
                self.restore(state)
                return
        except (plain.NotPlain, KeyError, TypeError, AttributeError, ValueError):
            pass
        raise self._not_own()

    def _not_own(self) -> CosimError:
        return CosimError(f"the state of '{self._name}' is not one of the firmware in {self._folder}; save it again")

    def sampled_states(self) -> dict[str, float]:
        """Not known: they are in the emulator.

        Raises:
            CosimError: always.
        """
        raise CosimError(f"the states of '{self._name}' are in an emulator: use {self._about['component']}.fmu instead")

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
        answer, to, of = b"", process.stdin.fileno(), process.stdout.fileno()
        try:
            while len(answer) < n:
                left = max(0.0, end - time.monotonic())
                readable, writable, _ = select.select([of], [to] if request else [], [], left)
                if not readable and not writable:
                    self.close()
                    raise CosimError(f"no answer of the emulated {self._about['board']} within {self._timeout:g} s")
                if writable:
                    request = request[os.write(to, request) :]
                if readable:
                    more = os.read(of, n - len(answer))
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
        known = {"component", "board", "sample_time", "frame", "state_bytes", "has_addresses"} <= about.keys()
        if known and len(about["input_starts"]) == len(names[0]):
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
        timeout: for each sample, or each request of `take_samples` [s].

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
