"""Controllers on emulated processors: bit-identical to the FMU, stack, closed loop, failures (3 min)."""

from __future__ import annotations

import json
import runpy
import shutil
import sys
from pathlib import Path

import numpy as np
import pytest
from built import FMUS
from pages import ROOT, blocks
from same_samples import declared, fmu_samples, inputs_of

from build_fmus.generate import ticks
from build_fmus.target.assemble import assemble
from build_fmus.target.errors import run_library
from build_fmus.target.library import build_library
from build_fmus.target.toolchain import CFLAGS, TARGETS, Tools, find_tools
from cosim import CosimError, System
from cosim.fmu.target import EmulatedTarget, target

MISSING = [n for n in ("arm-none-eabi-gcc", "qemu-system-arm") if shutil.which(n) is None]
pytestmark = [
    pytest.mark.embedded,
    pytest.mark.skipif(
        bool(MISSING),
        reason=f"{', '.join(MISSING)} not installed (Debian packages gcc-arm-none-eabi, qemu-system-arm)",
    ),
]
SAMPLES = {"Skyhook": 500, "LqrHmmwv": 500, "KalmanHmmwv": 200, "ForceTracking": 500, "GpcImplicit": 500}
SAMPLES |= {"GpcPreview": 200, "MpcBench": 20}


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("target")


def built(name: str, processor: str, folder: Path, **options: float) -> EmulatedTarget:
    if not (folder / processor / name).exists():
        build_library(declared(name, FMUS), TARGETS[processor], folder)
    return target(name, processor, folder=folder, **options)


@pytest.mark.parametrize("processor", ["cortex-m4f", "cortex-m7"])
@pytest.mark.parametrize("name", SAMPLES)
def test_same_bits_and_stack(name: str, processor: str, folder: Path) -> None:
    model = declared(name, FMUS).model()
    u = inputs_of(model, SAMPLES[name], seed=2)
    inputs, outputs = ([e.name for e in model.elements(r)] for r in ("input", "output"))
    expected = fmu_samples(FMUS / "fmi3" / f"{name}.fmu", u, inputs, outputs, float(ticks(model)))
    controller = built(name, processor, folder)
    controller.instantiate(name)
    controller.begin()
    y = np.zeros((len(u), len(outputs) + 2))
    for row, result in zip(u, y, strict=True):
        controller.step(0.0, 0.0, row, result)
    controller.close()
    assert y[:, :-2].tobytes() == expected.tobytes()
    predicted = json_of(folder / processor / name / "metrics.json")["stack_bytes"]
    assert y[:, -1].max() <= predicted + 16  # the call itself
    if not model.programs:  # whose prediction has the deepest recursion of DAQP in it
        assert y[:, -1].max() > 0.2 * predicted


@pytest.mark.parametrize("name", ["Skyhook", "ForceTracking", "GpcPreview", "MpcBench"])
def test_single_precision_has_the_numbers_of_this_machine_and_takes_less(name: str, folder: Path) -> None:
    model = declared(name, FMUS).model()
    u = inputs_of(model, 20, seed=2)
    n = len(model.elements("output"))
    expected, _ = run_library(assemble(model, "single"), u, n, folder)
    build_library(declared(name, FMUS), TARGETS["cortex-m4f"], folder, "single")
    results = []
    for processor in ("cortex-m4f-single", "cortex-m4f"):
        controller = built(name, processor, folder)
        controller.instantiate(name)
        controller.begin()
        y = np.zeros((len(u), n + 2))
        for row, result in zip(u, y, strict=True):
            controller.step(0.0, 0.0, row, result)
        controller.close()
        results.append(y)
    assert results[0][:, :n].tobytes() == expected.tobytes()
    assert results[0][:, n].max() < 0.5 * results[1][:, n].max()  # instructions


def json_of(path: Path) -> dict[str, int]:
    found: dict[str, int] = json.loads(path.read_text())
    return found


def closed_loop(controller: EmulatedTarget | str) -> np.ndarray:
    system = System()
    system.add("speed", "SpeedProfile")
    system.add("road", "RoadBumps")
    system.add("car", "RideCarHmmwv", step="1 ms")
    system.add("controller", controller)
    system.connect_matching("speed", "road")
    system.connect_matching("road", "car")
    system.connect_matching("car", "controller")
    system.connect_matching("controller", "car")
    recording = system.run(0.9, record=["car.body.z", "controller.force.fl"])
    return np.array([recording["car.body.z"], recording["controller.force.fl"]])


def test_closed_loop_as_with_the_fmu(folder: Path) -> None:
    with_fmu = closed_loop("Skyhook")
    assert closed_loop(built("Skyhook", "cortex-m7", folder)).tobytes() == with_fmu.tobytes()
    assert np.abs(with_fmu[1]).max() > 0


def test_failures_have_names(folder: Path) -> None:
    with pytest.raises(CosimError, match="build-fmus --target cortex-m7 Nothing"):
        target("Nothing", "cortex-m7", folder=folder)
    controller = built("Skyhook", "cortex-m7", folder)
    controller.instantiate("controller")
    controller.begin()
    u, y = np.zeros(len(controller.inputs)), np.zeros(len(controller.outputs))
    u[0] = np.nan
    with pytest.raises(ValueError, match="an input or a value is not finite"):
        controller.step(0.0, 0.0, u, y)
    assert controller._process is not None
    controller._process.kill()
    with pytest.raises(CosimError, match="the emulator of mps2-an500 has ended"):
        controller.step(0.0, 0.0, np.zeros(len(u)), y)
    controller.begin()
    controller._timeout = 0.0
    with pytest.raises(CosimError, match="no answer of the emulated mps2-an500 within 0 s"):
        controller.step(0.0, 0.0, np.zeros(len(u)), y)


def test_page(monkeypatch: pytest.MonkeyPatch, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """The how-to page as a reader follows it."""
    page = ROOT / "docs" / "how-to" / "microcontroller.md"
    monkeypatch.chdir(ROOT)
    for command in filter(None, "\n".join(blocks(page, "shell")).splitlines()):
        program, *arguments = command.split()
        Tools.run([str(Path(sys.executable).parent / program), *arguments], ROOT)
    library = ROOT / "fmus" / "target" / "cortex-m7" / "LqrHmmwv"
    (tmp_path / "firmware.c").write_text("\n".join(blocks(page, "c")))
    compiler = [
        "arm-none-eabi-gcc",
        *CFLAGS,
        *TARGETS["cortex-m7"].flags,
        "-Wall",
        "-Wextra",
        "-Wconversion",
        "-Werror",
    ]
    Tools.run([*compiler, f"-I{library}", "-c", "firmware.c"], tmp_path)
    (tmp_path / "firmware.cpp").write_text("\n".join(blocks(page, "cpp")))
    plus = ["arm-none-eabi-g++", *TARGETS["cortex-m7"].flags, "-std=c++17", "-Wall", "-Wextra", "-Werror"]
    Tools.run([*plus, f"-I{library}", "-fsyntax-only", "firmware.cpp"], tmp_path)
    for code in blocks(page, "python"):
        exec(compile(code, page.name, "exec"), {"__name__": "page"})
    printed = capsys.readouterr().out
    assert "bit-identical: True\ninstructions of a sample: " in printed
    assert "".join(blocks(page, "text")).splitlines()[-1] in printed


@pytest.mark.parametrize("processor", ["cortex-m4f", "cortex-m7"])
@pytest.mark.parametrize("name", ["Skyhook", "LqrHmmwv", "ForceTracking"])
def test_rows_of_the_page(name: str, processor: str) -> None:
    if "12.2" not in find_tools(TARGETS[processor]).version:
        pytest.skip("the page has the numbers of arm-none-eabi-gcc 12.2, and this is another version")
    writer = runpy.run_path(str(ROOT / "docs" / "write_targets.py"))
    made = [cell.strip() for cell in writer["row"](name, processor).split("|")]
    page = writer["PAGE"].read_text(encoding="utf-8").splitlines()
    (told,) = (
        [cell.strip() for cell in line.split("|")] for line in page if f"| {name} | {made[2]} | {processor} |" in line
    )
    assert told[:7] == made[:7]
    assert abs(int(told[7].replace(",", "")) - int(made[7].replace(",", ""))) <= 40  # the timer counts in steps of 40
