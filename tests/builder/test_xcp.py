"""FMI-LS-XCP: what an A2L file in an FMU says of the memory of its first instance is true (10 s)."""

from __future__ import annotations

import ctypes
import re
import sys
import zipfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import lief
import numpy as np
import pytest
from built import FMUS, share_objects
from fmpy import extract, read_model_description
from fmpy.fmi2 import FMU2Slave
from fmpy.fmi3 import FMU3Slave
from lxml import etree

from build_fmus import xcp
from build_fmus.builder import Options
from build_fmus.compile import PLATFORMS, host
from build_fmus.generate import MARK
from fmu_sources import cli

BLOCK = re.compile(r"/begin (CHARACTERISTIC|MEASUREMENT) (\S+) .*?/end \1", re.DOTALL)
posix = pytest.mark.skipif(sys.platform == "win32", reason="the base address of a library comes from dladdr")


class Calibrated:
    """An instance of an FMU whose memory is read and written as an XCP service does it."""

    def __init__(self, name: str, fmi: int) -> None:
        path = FMUS / f"fmi{fmi}" / f"{name}.fmu"
        self.about, self.fmi = read_model_description(path), fmi
        self.folder = Path(extract(path))
        self.variables = {v.name: v for v in self.about.modelVariables}
        self.fmu = self.instance()
        platform = PLATFORMS[host()]
        a2l = self.folder / xcp.FOLDER / (platform.fmi2_name if fmi == 2 else platform.name) / f"{name}.a2l"
        blocks = {m[2]: m[0] for m in BLOCK.finditer(a2l.read_text(encoding="ascii"))}
        self.addresses = {n: int(re.findall(r"0x([0-9A-F]{8})", b)[0], 16) for n, b in blocks.items()}
        self.sizes = {n: int(np.prod([int(k) for k in _dimensions(b)])) for n, b in blocks.items()}

    def instance(self) -> Any:
        kind = FMU2Slave if self.fmi == 2 else FMU3Slave
        fmu = kind(
            guid=self.about.guid,
            modelIdentifier=self.about.coSimulation.modelIdentifier,
            unzipDirectory=str(self.folder),
            instanceName="one",
        )
        fmu.instantiate()
        return fmu

    def initialize(self) -> None:
        if self.fmi == 2:
            self.fmu.setupExperiment(startTime=0.0)
        self.fmu.enterInitializationMode()
        self.fmu.exitInitializationMode()

    def close(self) -> None:
        self.fmu.terminate()
        self.fmu.freeInstance()

    def references(self, name: str) -> list[int]:
        """Of the elements of a variable, in the order of its values in memory."""
        n = self.sizes[name]
        return [v.valueReference for k, v in self.variables.items() if re.sub(r"\[[\d,]+\]$", "", k) == name][:n]

    def memory(self, name: str) -> Any:
        base = _base_address(self.fmu.dll.fmi2DoStep if self.fmi == 2 else self.fmu.dll.fmi3DoStep)
        return (ctypes.c_double * self.sizes[name]).from_address(base + self.addresses[name])

    def prepare_again(self) -> None:
        ctypes.c_int32.from_address(ctypes.addressof(self.memory("prepared"))).value = 0

    def get(self, refs: list[int]) -> list[float]:
        return list((self.fmu.getReal if self.fmi == 2 else self.fmu.getFloat64)(refs))

    def set(self, refs: list[int], values: list[float]) -> None:
        (self.fmu.setReal if self.fmi == 2 else self.fmu.setFloat64)(refs, values)

    def is_real(self, name: str) -> bool:
        first = next(v for k, v in self.variables.items() if re.sub(r"\[[\d,]+\]$", "", k) == name)
        return first.type in ("Real", "Float64")

    def of_causality(self, causality: str) -> list[str]:
        names = dict.fromkeys(
            re.sub(r"\[[\d,]+\]$", "", k) for k, v in self.variables.items() if v.causality == causality
        )
        return [n for n in names if n in self.addresses and self.is_real(n)]

    def step(self, k: int) -> None:
        h = float(self.about.defaultExperiment.stepSize)
        self.fmu.doStep(currentCommunicationPoint=k * h, communicationStepSize=h)


def _dimensions(block: str) -> tuple[str, ...]:
    found = re.search(r"MATRIX_DIM (\d+) (\d+) (\d+)", block)
    return found.groups() if found else ("1",)


def _base_address(function: Any) -> int:
    class Info(ctypes.Structure):
        _fields_ = (
            ("file", ctypes.c_char_p),
            ("base", ctypes.c_void_p),
            ("name", ctypes.c_char_p),
            ("at", ctypes.c_void_p),
        )

    info = Info()
    assert ctypes.CDLL(None).dladdr(ctypes.cast(function, ctypes.c_void_p), ctypes.byref(info)) != 0
    return int(info.base)


@posix
@pytest.mark.parametrize("fmi", [2, 3])
@pytest.mark.parametrize("name", ["LqrHmmwv", "GpcPreview", "KalmanHmmwv", "MpcBench"])
def test_memory_has_the_variables(name: str, fmi: int) -> None:
    one = Calibrated(name, fmi)
    one.initialize()
    rng, inputs = np.random.default_rng(1), one.of_causality("input")
    for k in range(3):
        for n in inputs:
            if n != "preview.step":
                one.set(one.references(n), list(rng.normal(size=one.sizes[n])))
        one.step(k)
    seen = 0.0
    for n in [*one.of_causality("parameter"), *inputs, *one.of_causality("output")]:
        assert list(one.memory(n)) == one.get(one.references(n)), n
        seen += np.abs(np.array(one.memory(n))).sum()
    assert len(inputs) > 0
    assert seen > 0
    one.close()


@posix
@pytest.mark.parametrize("fmi", [2, 3])
@pytest.mark.parametrize(
    ("name", "parameter", "value"),
    [("LqrHmmwv", "force.limit", 10.0), ("GpcPreview", "limit", 10.0), ("ForceTracking", "eta_1", 1e3)],
)
def test_calibration_is_that_of_the_parameter(name: str, parameter: str, value: float, fmi: int) -> None:
    def outputs(change: Callable[[Calibrated], None]) -> list[float]:
        one = Calibrated(name, fmi)
        one.initialize()
        for k in range(25):
            if k == 5:
                change(one)
            for n in one.of_causality("input"):
                if n != "preview.step":
                    one.set(one.references(n), list(np.full(one.sizes[n], np.sin(0.5 * k))))
            one.step(k)
        found = [x for n in one.of_causality("output") for x in one.memory(n)]
        one.close()
        return found

    def in_memory(one: Calibrated) -> None:
        one.memory(parameter)[0] = value
        one.prepare_again()

    def by_fmi(one: Calibrated) -> None:
        one.set(one.references(parameter), [value])

    assert outputs(in_memory) == outputs(by_fmi) != outputs(lambda _: None)


@posix
def test_only_the_first_instance_is_there() -> None:
    one = Calibrated("LqrHmmwv", 3)
    limit, start = one.references("force.limit"), list(one.memory("force.limit"))
    second = one.instance()
    second.setFloat64(limit, [7.0])
    assert list(one.memory("force.limit")) == start != [7.0]
    one.set(limit, [9.0])
    assert list(one.memory("force.limit")) == [9.0]
    second.enterInitializationMode()
    assert list(second.getFloat64(limit)) == [7.0]
    one.fmu.freeInstance()
    third = one.instance()
    third.setFloat64(limit, [11.0])
    assert list(one.memory("force.limit")) == [11.0]
    assert list(second.getFloat64(limit)) == [7.0]
    for fmu in (second, third):
        fmu.freeInstance()


@pytest.mark.parametrize("fmi", [2, 3])
def test_archive(fmi: int) -> None:
    with zipfile.ZipFile(FMUS / f"fmi{fmi}" / "LqrHmmwv.fmu") as z:
        names = z.namelist()
        root = etree.fromstring(z.read(f"{xcp.FOLDER}/fmi-ls-manifest.xml"))
        definition = root[0].get("definition")
        for binary in [n for n in names if n.startswith("binaries/")]:
            text = z.read(f"{xcp.FOLDER}/{binary.split('/')[1]}/{definition}").decode("ascii")
            own = z.read(f"{xcp.FOLDER}/{definition}").decode("ascii")  # for binaries from the sources
            links = re.compile(r'SYMBOL_LINK "first_instance" \d+')
            assert links.findall(own) == links.findall(text) != []
            assert "/include" not in text
        assert "static struct" in z.read("sources/model.c").decode()
        assert root[0].get("supportsDirectMemoryAccess") == "true"
        assert root[0].get("containsXCPService") is None
    with zipfile.ZipFile(FMUS / f"fmi{fmi}" / "QuarterCarHmmwv.fmu") as z:
        assert [n for n in z.namelist() if "xcp" in n] == []


@pytest.mark.platforms
def test_addresses_on_all_platforms(tmp_path: Path) -> None:
    """By another reader of ELF, PE and Mach-O."""
    cli.build(["LqrHmmwv"], Options(share_objects(tmp_path), fmi=(3,), platform="all"))
    with zipfile.ZipFile(tmp_path / "fmi3" / "LqrHmmwv.fmu") as z:
        found = {n: z.read(n) for n in z.namelist() if n.startswith("binaries/")}
    assert len(found) == len(PLATFORMS)
    for path, binary in found.items():
        assert xcp.address_in(binary, MARK) == _by_lief(binary), path


def _by_lief(data: bytes) -> int:
    binary = lief.parse(list(data))
    assert binary is not None
    (section,) = (s for s in binary.sections if s.name in (".data", "__data"))
    return int(section.virtual_address) + bytes(section.content).index(MARK)


def test_address_is_that_of_another_reader() -> None:
    with zipfile.ZipFile(FMUS / "fmi3" / "LqrHmmwv.fmu") as z:
        (path,) = (n for n in z.namelist() if n.startswith(f"binaries/{host()}/"))
        binary = z.read(path)
    assert xcp.address_in(binary, MARK) == _by_lief(binary) > 0
    with pytest.raises(ValueError, match="0 times, not once"):
        xcp.address_in(binary, b"no such mark")
    with pytest.raises(ValueError, match="in no segment"):
        xcp.address_in(b"\x7fELF" + bytes(100) + MARK, MARK)
