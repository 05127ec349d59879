"""A2L files of libraries: addresses and offsets of the example program, limits, units, a reader by others (30 s)."""

from __future__ import annotations

import re
import shutil
import struct
import zipfile
from pathlib import Path
from typing import Any

import lief
import numpy as np
import pytest
from built import FMUS
from same_samples import declared, inputs_of

from build_fmus.base import escape
from build_fmus.component import Component
from build_fmus.equations.names import identifier
from build_fmus.target.library import build_library
from build_fmus.target.toolchain import TARGETS, find_tools
from cosim.fmu.target import target

pytestmark = pytest.mark.skipif(
    shutil.which("arm-none-eabi-gcc") is None, reason="arm-none-eabi-gcc not installed (package gcc-arm-none-eabi)"
)
NAMES = ("LqrHmmwv", "GpcPreview", "MpcHmmwv")
BLOCK = re.compile(r"/begin (CHARACTERISTIC|MEASUREMENT) (\S+) .*?/end \1", re.DOTALL)


@pytest.fixture(scope="module", params=NAMES)
def built(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Path:
    return build_library(declared(request.param, FMUS), TARGETS["cortex-m7"], tmp_path_factory.mktemp("a2l"))


def blocks_of(folder: Path) -> dict[str, str]:
    text = (folder / f"{folder.name}.a2l").read_text(encoding="ascii")
    found = {m[2]: m[0] for m in BLOCK.finditer(text)}
    assert len(found) == len(BLOCK.findall(text))
    return found


def address(block: str) -> int:
    return int(re.findall(r"0x([0-9A-F]{8})", block)[0], 16)


def test_addresses_are_those_of_the_program(built: Path, tmp_path: Path) -> None:
    """Symbols by lief, offsets by the compiler from the names of the fields in the header."""
    name, model = built.name, declared(built.name, FMUS).model()
    program = lief.parse(str(built / "example.elf"))
    symbols = {s.name: s.value for s in program.symbols}
    blocks = blocks_of(built)
    roles = {"parameter": "parameters", "input": "inputs", "output": "results"}
    fields = {"prepared": (f"{name}_example", name, "prepared")}
    for role, field in roles.items():
        taken: list[str] = []
        for v in [v for v in model.variables if v.role == role]:
            own = identifier(v.name, taken, local=False)
            taken.append(own)
            if role == "parameter" and not v.tunable:
                assert v.name not in blocks
            elif role == "input":
                fields[v.name] = (f"{name}_example_inputs", f"{name}_inputs", own)
            else:
                fields[v.name] = (f"{name}_example", name, f"{field}.{own}")
    assert blocks.keys() == fields.keys()
    offsets = ", ".join(f"offsetof({kind}, {field})" for _, kind, field in fields.values())
    (tmp_path / "offsets.c").write_text(
        f'#include <stddef.h>\n#include "{name}.h"\nconst unsigned offsets[] = {{{offsets}}};\n'
    )
    find_tools(TARGETS["cortex-m7"]).compile("offsets.c", "offsets.o", tmp_path, f"-I{built}")
    compiled = lief.parse(str(tmp_path / "offsets.o"))  # which its sections do not keep alive
    (content,) = (bytes(s.content) for s in compiled.sections if s.name == ".rodata.offsets")
    expected = struct.unpack(f"<{len(fields)}I", content)
    assert expected[1:] != expected[:-1]
    for (variable, (symbol, _, _)), offset in zip(fields.items(), expected, strict=True):
        assert address(blocks[variable]) == symbols[symbol] + offset, variable
        assert f'SYMBOL_LINK "{symbol}" {offset}\n' in blocks[variable]


def test_limits_units_and_shapes(built: Path) -> None:
    blocks, text = blocks_of(built), (built / f"{built.name}.a2l").read_text(encoding="ascii")
    methods = dict(re.findall(r'COMPU_METHOD (UNIT_\d+) "(.*?)"', text))
    for v in declared(built.name, FMUS).model().variables:
        if v.name not in blocks:
            continue
        head = blocks[v.name].splitlines()[1].split()
        method, low, high = (head[4], *head[5:]) if v.role == "parameter" else (head[1], *head[4:])
        assert methods[method] == (v.unit or "")
        largest = np.finfo(float).max
        limits = [np.clip(x if x is not None else s * np.inf, -largest, largest) for x, s in ((v.min, -1), (v.max, 1))]
        assert [float(low), float(high)] == limits
        shape = re.findall(r"MATRIX_DIM (\d+) (\d+) (\d+)", blocks[v.name])
        assert [int(np.prod([int(n) for n in s])) for s in shape] == ([v.size] if v.shape else [])


@pytest.mark.embedded
def test_other_reader(built: Path) -> None:
    parser = pytest.importorskip("pya2l.parser", reason="pya2l is not installed (extra embedded)")
    check_other_reader(parser, (built / f"{built.name}.a2l").read_bytes())


@pytest.mark.embedded
@pytest.mark.parametrize("fmi", [2, 3])
@pytest.mark.parametrize("name", NAMES)
def test_other_reader_of_fmus(name: str, fmi: int) -> None:
    parser = pytest.importorskip("pya2l.parser", reason="pya2l is not installed (extra embedded)")
    with zipfile.ZipFile(FMUS / f"fmi{fmi}" / f"{name}.fmu") as z:
        files = [z.read(n) for n in z.namelist() if n.endswith(".a2l")]
    assert len(files) >= 2
    for content in files:
        check_other_reader(parser, content)


def check_other_reader(parser: Any, content: bytes) -> None:
    with parser.A2lParser() as reader:
        module = reader.tree_from_a2l(content).PROJECT.MODULE[0]
        for warning in reader.warnings:  # of any block inside IF_DATA, which each file has once
            block = re.findall(r"^\d+:\d+ (PROTOCOL_LAYER|XCP_ON_UDP_IP) may be used at most once here", warning)
            assert [content.count(f"/begin {b}".encode()) for b in block] == [1], warning
    blocks = {m[2]: m[0] for m in BLOCK.finditer(content.decode("ascii"))}
    found = {c.Name.Value: c.Address.Value for c in module.CHARACTERISTIC}
    found |= {m.Name.Value: m.ECU_ADDRESS.Address.Value for m in module.MEASUREMENT}
    assert found == {name: address(block) for name, block in blocks.items()}


@pytest.mark.skipif(shutil.which("qemu-system-arm") is None, reason="qemu-system-arm not installed")
def test_calibration_in_memory(tmp_path: Path) -> None:
    """A characteristic written where the file says has the effect of the parameter, as has a measurement read there."""
    component = declared("LqrHmmwv", FMUS)
    folder = build_library(component, TARGETS["cortex-m7"], tmp_path)
    blocks = blocks_of(folder)
    in_instance = ((n, re.findall(r'SYMBOL_LINK "LqrHmmwv_example" (\d+)', b)) for n, b in blocks.items())
    links = {n: int(offset[0]) for n, offset in in_instance if offset}
    u = inputs_of(component.model(), 4)
    controller = target("LqrHmmwv", "cortex-m7", folder=tmp_path)
    controller.instantiate("LqrHmmwv")
    controller.begin()
    before = controller.take_samples(u)[-1]
    state = controller.save()
    memory = state["memory"].copy()
    memory[links["force.limit"] :][:8] = np.frombuffer(struct.pack("<d", 10.0), np.uint8)
    memory[links["prepared"] :][:4] = 0
    controller.restore(state | {"memory": memory})
    calibrated = controller.take_samples(u)[-1]
    read = controller.save()["memory"][links["force.fl"] :][:8].tobytes()
    controller.begin()
    controller.instantiate("LqrHmmwv")
    setattr(controller, "force.limit", 10.0)
    expected = controller.take_samples(u)[-1]
    controller.close()
    assert calibrated[:-2].tobytes() == expected[:-2].tobytes()
    assert np.abs(calibrated[:4]).max() <= 10.0 < np.abs(before[:4]).max()
    assert struct.unpack("<d", read) == (calibrated[controller.outputs.index("force.fl [N]")],)


def test_names_are_unique(tmp_path: Path) -> None:
    c = Component("Named", kind="discrete", sample_time=0.01, description="Names", source="none")
    prepared = c.parameter("prepared", 1.0, "1", "gain", tunable=True, source="none")
    c.output("y", prepared * c.input("u", "1", "input"), "1", "output")
    blocks = blocks_of(build_library(c, TARGETS["cortex-m4f"], tmp_path))
    assert list(blocks) == ["prepared_2", "prepared", "u", "y"]


def test_strings_cannot_end_early() -> None:
    assert escape.a2l('a "b" \\ c\n/end µ') == '"a \\"b\\" \\\\ c /end ?"'


def test_two_builds_are_identical(tmp_path: Path) -> None:
    made = [build_library(declared("LqrHmmwv", FMUS), TARGETS["cortex-r5"], tmp_path / n) for n in "ab"]
    for file in ("LqrHmmwv.a2l", "example.elf"):
        assert (made[0] / file).read_bytes() == (made[1] / file).read_bytes()
