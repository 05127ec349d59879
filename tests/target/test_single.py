"""Libraries in single precision: constants, mathematics, time, bad input, errors in metrics.json (40 s)."""

from __future__ import annotations

import ctypes
import json
import re
from pathlib import Path

import casadi as ca
import numpy as np
import pytest
from built import FMUS
from same_samples import declared
from test_libraries import NOT_FINITE, NOT_TUNABLE, OK, OUT_OF_RANGE, counter
from test_target_sources import mathematics

from build_fmus.compile import find_toolchain, host
from build_fmus.component import Component
from build_fmus.target.assemble import assemble
from build_fmus.target.errors import run_library
from build_fmus.target.library import build_library
from build_fmus.target.single import to_single
from build_fmus.target.toolchain import TARGETS, Tools

pytestmark = pytest.mark.filterwarnings("error::build_fmus.target.library.SourceWarning")
WRAPPER = """
#include "NAME.h"
static NAME self;
void start(long long sample) { NAME_init(&self); self.sample = sample; }
int set_parameter(int parameter, float value) {
    return NAME_set_parameter(&self, (NAME_parameter)parameter, 0, value);
}
int step(const float *u, float *y) { return NAME_step(&self, (const NAME_inputs *)u, (NAME_outputs *)y); }
"""


def loaded(component: Component, folder: Path) -> ctypes.CDLL:
    built = build_library(component, TARGETS["host-static"], folder, "single")
    name = built.name
    (folder / "wrapper.c").write_text(WRAPPER.replace("NAME", name))
    command = [*find_toolchain(host()).command, "-shared", "-fPIC", f"-I{built}", "wrapper.c"]
    Tools.run([*command, str(built / f"lib{name}.a"), "-o", f"{name}.so"], folder)
    library = ctypes.CDLL(str(folder / f"{name}.so"))
    library.start.argtypes = [ctypes.c_longlong]
    library.set_parameter.argtypes = [ctypes.c_int, ctypes.c_float]
    library.start(0)
    return library


def step(library: ctypes.CDLL, *inputs: float) -> tuple[int, float]:
    """Status and first output of a sample."""
    y = (ctypes.c_float * 8)()
    return library.step((ctypes.c_float * max(len(inputs), 1))(*inputs), y), y[0]


@pytest.mark.parametrize(
    ("double", "single"),
    [
        ("double x = 0.1;", "float x = 0.1f;"),
        ("y = 2.0 * a1.e5 - 1e-3 + x2 + 7;", "y = 2.0f * a1.e5 - 0.001f + x2 + 7;"),
        ("1e308 -1e-300 0x1p-1 DBL_MAX", "3.4028235e+38f -1.1754944e-38f 0.5f FLT_MAX"),
        ("x <= 2147483646.0", "x <= 2.1474835e+09f"),  # a larger one would be no int
        ('/* 1.5 double */ "1.5" // 2.5 double', '/* 1.5 double */ "1.5" // 2.5 double'),
    ],
)
def test_code(double: str, single: str) -> None:
    assert to_single(double) == single


def test_mathematics_is_the_double_one_rounded_once(tmp_path: Path) -> None:
    component = mathematics().model()
    rng = np.random.default_rng(3)
    inputs = np.column_stack([rng.uniform(0.01, 0.99, 2000), rng.uniform(0.1, 9.0, 2000), rng.uniform(1.0, 50.0, 2000)])
    inputs = inputs.astype(np.float32).astype(float)
    names = [e.name for e in component.elements("output")]
    exact, rounded = (
        run_library(assemble(component, p), inputs, len(names), tmp_path)[0] for p in ("double", "single")
    )
    assert [n for n, a, b in zip(names, exact.T, rounded.T, strict=True) if (a.astype(np.float32) != b).any()] == []
    assert np.ptp(rounded, axis=0)[names.index("sin")] > 0.5


@pytest.mark.parametrize("rate", [0.01, 1 / 3])
def test_time_does_not_drift(rate: float, tmp_path: Path) -> None:
    c = Component("Clock", kind="discrete", sample_time=rate, description="Time", source="none")
    c.output("y", c.time + 0.0, "s", "time")
    library = loaded(c, tmp_path)
    for k in (0, 1, 7, 1000, 16_777_217, 360_000_001):
        library.start(k)
        assert abs(step(library)[1] - k * rate) <= np.spacing(np.float32(k * rate)), k


def test_bad_input_is_refused_as_in_double_precision(tmp_path: Path) -> None:
    library = loaded(counter(), tmp_path)
    header = (tmp_path / "host-static-single" / "Counter" / "Counter.h").read_text()
    assert "float error_now; /* [1] error */" in header
    assert "double" not in header
    gain, offset = (int(re.findall(rf"Counter_PARAMETER_{n} = (\d+)", header)[0]) for n in ("gain", "offset"))
    assert library.set_parameter(offset, 1.0) == OK
    assert step(library, 1.0, 1.0) == (OK, 3.0)
    assert library.set_parameter(offset, 2.0) == NOT_TUNABLE
    assert [library.set_parameter(gain, x) for x in (np.nan, 11.0, 3.0)] == [NOT_FINITE, OUT_OF_RANGE, OK]
    refused = [step(library, *u)[0] for u in ((np.nan, 1), (1, 7), (1, 0.5), (np.inf, 1))]
    assert refused == [NOT_FINITE, OUT_OF_RANGE, OUT_OF_RANGE, NOT_FINITE]
    assert step(library, 1.0, 2.0) == (OK, 6.0)


def test_errors_in_metrics(tmp_path: Path) -> None:
    """A sum of thirds: its error is known."""
    c = Component("Sum", kind="discrete", sample_time=0.01, description="A sum", source="none")
    x = c.input("x", "1", "x")
    c.output("same", ca.fmax(x, 0.0), "1", "x")
    c.output("third", x / 3.0, "1", "a third")
    c.reference_input({"x": lambda t: 1.0 + round(100 * t) % 2})
    folder = build_library(c, TARGETS["host-static"], tmp_path, "single")
    metrics = json.loads((folder / "metrics.json").read_text())
    thirds = np.array([1.0, 2.0]) / 3.0
    error = float(np.abs(np.float32([1.0, 2.0]) / np.float32(3.0) - thirds).max())
    assert metrics["precision"] == "single"
    assert metrics["single_errors"] == {
        "samples": 1000,
        "outputs": {
            "same": {"absolute": 0.0, "relative": 0.0},
            "third": {"absolute": error, "relative": error / thirds.max()},
        },
    }


@pytest.mark.parametrize("name", ["Skyhook", "KalmanHmmwv", "GpcPreview"])
def test_controllers_keep_five_digits(name: str, tmp_path: Path) -> None:
    folder = build_library(declared(name, FMUS), TARGETS["host-static"], tmp_path, "single")
    errors = json.loads((folder / "metrics.json").read_text())["single_errors"]["outputs"]
    assert 0.0 < max(e["relative"] for e in errors.values()) < 1e-5
