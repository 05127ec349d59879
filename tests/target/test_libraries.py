"""C libraries for targets: bit-identical to the FMU, what they refuse, what they measure (40 s)."""

from __future__ import annotations

import ctypes
import json
import re
import shutil
from pathlib import Path

import numpy as np
import pytest
from built import FMUS
from same_samples import declared, fmu_samples, inputs_of

from build_fmus.compile import find_toolchain, host
from build_fmus.component import Component
from build_fmus.generate import ticks
from build_fmus.target.assemble import TargetError
from build_fmus.target.cycles import core_of
from build_fmus.target.library import build_library
from build_fmus.target.stack import worst_stack
from build_fmus.target.toolchain import TARGETS, Tools

WRAPPER = """
#include "NAME.h"
static NAME self;
void start(void) { NAME_init(&self); }
int set_parameter(int parameter, int element, double value) {
    return NAME_set_parameter(&self, (NAME_parameter)parameter, element, value);
}
int step(const double *u, double *y) { return NAME_step(&self, (const NAME_inputs *)u, (NAME_outputs *)y); }
"""
SAMPLES = {"Skyhook": 3000, "LqrHmmwv": 3000, "KalmanHmmwv": 1000, "ForceTracking": 3000, "GpcImplicit": 3000}
SAMPLES |= {"MpcBench": 100}
OK, NOT_FINITE, OUT_OF_RANGE, NOT_TUNABLE, UNKNOWN = range(5)


class Loaded:
    """A library for this machine, loaded."""

    def __init__(self, folder: Path, work: Path) -> None:
        name = folder.name
        (work / "wrapper.c").write_text(WRAPPER.replace("NAME", name))
        command = [*find_toolchain(host()).command, "-shared", "-fPIC", f"-I{folder}", "wrapper.c"]
        Tools.run([*command, str(folder / f"lib{name}.a"), "-o", f"{name}.so"], work)
        self.library = ctypes.CDLL(str(work / f"{name}.so"))
        self.library.set_parameter.argtypes = [ctypes.c_int, ctypes.c_int, ctypes.c_double]
        self.library.step.argtypes = [ctypes.c_void_p] * 2
        self.library.start()

    def step(self, u: np.ndarray, n_outputs: int) -> tuple[int, np.ndarray]:
        u, y = np.ascontiguousarray(u, dtype=float), np.zeros(n_outputs)
        return self.library.step(u.ctypes.data, y.ctypes.data), y


@pytest.mark.parametrize("name", SAMPLES)
def test_same_bits_as_the_fmu(name: str, tmp_path: Path) -> None:
    component = declared(name, FMUS)
    library = Loaded(build_library(component, TARGETS["host-static"], tmp_path), tmp_path)
    model = component.model()
    u = inputs_of(model, SAMPLES[name])
    inputs, outputs = ([e.name for e in model.elements(r)] for r in ("input", "output"))
    expected = fmu_samples(FMUS / "fmi3" / f"{name}.fmu", u, inputs, outputs, float(ticks(model)))
    got = np.zeros_like(expected)
    for k, row in enumerate(u):
        status, got[k] = library.step(row, len(outputs))
        assert status == OK, k
    differing = [n for n, a, b in zip(outputs, got.T, expected.T, strict=True) if a.tobytes() != b.tobytes()]
    assert differing == []
    assert np.ptp(expected, axis=0).max() > 0


def counter() -> Component:
    """A user's component with a limit, an integer, and a parameter that is fixed once it runs."""
    c = Component("Counter", kind="discrete", sample_time=0.01, description="A counter", source="none")
    gain = c.parameter("gain", 2.0, "1", "gain", min=0.0, max=10.0, tunable=True, source="none")
    offset = c.parameter("offset", 0.5, "1", "offset", source="none")
    error = c.input("error.now", "1", "error")
    gear = c.input("gear", None, "gear", type=int, start=1, min=0, max=6)
    total = c.state("total", "1", "sum of errors", start=0.0)
    c.output("command", gain * error + offset + gear * total, "1", "command")
    c.update(total, total + error)
    return c


def test_refusals_and_parameters(tmp_path: Path) -> None:
    library = Loaded(build_library(counter(), TARGETS["host-static"], tmp_path), tmp_path)
    header = (tmp_path / "host-static" / "Counter" / "Counter.h").read_text()
    assert "double error_now; /* [1] error */" in header
    gain, offset = (int(re.findall(rf"Counter_PARAMETER_{n} = (\d+)", header)[0]) for n in ("gain", "offset"))

    def set_(parameter: int, value: float, element: int = 0) -> int:
        return library.library.set_parameter(parameter, element, value)

    assert set_(offset, 1.0) == OK
    assert library.step(np.array([1.0, 1.0]), 1)[1] == [3.0]
    assert set_(offset, 2.0) == NOT_TUNABLE
    assert [set_(gain, x) for x in (np.nan, 11.0, 3.0)] == [NOT_FINITE, OUT_OF_RANGE, OK]
    assert [set_(gain, 1.0, 1), set_(99, 1.0), set_(-1, 1.0)] == [UNKNOWN] * 3
    refused = [library.step(np.array(u), 1)[0] for u in ([np.nan, 1], [1, 7], [1, 0.5], [np.inf, 1])]
    assert refused == [NOT_FINITE, OUT_OF_RANGE, OUT_OF_RANGE, NOT_FINITE]
    assert library.step(np.array([1.0, 2.0]), 1)[1] == [6.0]  # refused samples have not counted


def test_two_builds_are_identical(tmp_path: Path) -> None:
    folders = [build_library(counter(), TARGETS["host-static"], tmp_path / n) for n in "ab"]
    files = [{p.name: p.read_bytes() for p in f.iterdir()} for f in folders]
    assert files[0] == files[1]
    assert {"Counter.c", "Counter.h", "libCounter.a", "metrics.json"} < files[0].keys()


def test_two_libraries_link_into_one_program(tmp_path: Path) -> None:
    folders = [build_library(declared(n, FMUS), TARGETS["host-static"], tmp_path) for n in ("Skyhook", "LqrHmmwv")]
    calls = "".join(f"static {f.name} a{i}; {f.name}_init(&a{i}); " for i, f in enumerate(folders))
    includes = "".join(f'#include "{f.name}.h"\n' for f in folders)
    (tmp_path / "both.c").write_text(f"{includes}int main(void) {{ {calls} return 0; }}\n")
    command = [*find_toolchain(host()).command, "both.c", *(f"-I{f}" for f in folders)]
    Tools.run([*command, *(str(f / f"{f.name}.c") for f in folders), "-o", "both"], tmp_path)
    Tools.run([str(tmp_path / "both")], tmp_path)


def test_continuous_components_are_refused(tmp_path: Path) -> None:
    with pytest.raises(TargetError, match="QuarterCarHmmwv is continuous"):
        build_library(declared("QuarterCarHmmwv", FMUS), TARGETS["host-static"], tmp_path)


@pytest.mark.parametrize("target", ["cortex-m4f", "cortex-m7", "cortex-r5"])
def test_cross_compiler_measures(target: str, tmp_path: Path) -> None:
    if shutil.which("arm-none-eabi-gcc") is None:
        pytest.skip("arm-none-eabi-gcc is not installed (Debian package gcc-arm-none-eabi)")
    folder = build_library(counter(), TARGETS[target], tmp_path)
    metrics = json.loads((folder / "metrics.json").read_text())
    assert 300 < metrics["flash_bytes"] < 5000
    assert metrics["ram_bytes"] == 8 * (2 + 1 + 9 + 1) + 16  # parameters, results, 9 arrays, samples, three flags
    assert 32 < metrics["stack_bytes"] < 600
    core = core_of(target)
    assert metrics["cycles_estimate"] == (core.estimate(0.01) if core else None)
    if target == "cortex-m7":  # with a unit for double precision
        assert not [n for n in metrics["needs"] if n.startswith("__aeabi_d")]


def test_cycles_and_verdicts() -> None:
    core = core_of("cortex-m7")
    assert core is not None
    assert core.cycles(1000) == (500.0, 31000.0)
    assert core.available(0.01) == 4.8e6
    verdicts = [core.verdict(n, 0.01) for n in (154838, 154839, 9_600_000, 9_600_001)]
    assert verdicts == ["fits", "may fit", "may fit", "does not fit"]
    limits = core.estimate(0.01)
    assert (limits["instructions_that_fit"], limits["instructions_that_may_fit"]) == (154838, 9_600_000)
    assert core_of("cortex-r5") is None


def test_worst_stack_of_a_graph() -> None:
    sizes = {"step": 10, "deep": 100, "pointed": 1000, "turn": 7, "again": 5}
    nodes = "".join(f'node: {{ title: "x.c:{n}" label: "{n}\\n{s} bytes (static)" }}\n' for n, s in sizes.items())
    edges = (("step", "deep"), ("deep", "__indirect_call"), ("step", "turn"), ("turn", "again"), ("again", "turn"))
    named = {n: f"x.c:{n}" for n in sizes}
    graph = nodes + "".join(f'edge: {{ sourcename: "{named[a]}" targetname: "{named.get(b, b)}" }}\n' for a, b in edges)
    code = "table = {pointed}; step(); deep(); turn(); again();"
    assert worst_stack(graph, code, ["step"], {}, {"turn": 3}) == 10 + 100 + 1000
    assert worst_stack(graph, "turn(); again()", ["step"], {}, {"turn": 300}) == 10 + 301 * 12 + 12
    with pytest.raises(TargetError, match="calls itself"):
        worst_stack(graph, code, ["step"], {}, {})
    with pytest.raises(TargetError, match="the stack of memcpy is not known"):
        worst_stack(graph + 'edge: { sourcename: "x.c:deep" targetname: "memcpy" }', code, ["step"], {}, {"turn": 1})
    with pytest.raises(TargetError, match="depends on the data"):
        worst_stack(graph.replace("100 bytes (static)", "100 bytes (dynamic)"), code, ["step"], {}, {"turn": 1})
