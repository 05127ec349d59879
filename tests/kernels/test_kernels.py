"""Numbers under other kernels of OpenBLAS, with FMUs built under them.

A kernel adds sums in its own order. So LAPACK's results differ by rounding, and by what rounding decides: the order of
equal eigenvalues, the basis of their subspace, signs. The processor selects the kernel; `OPENBLAS_CORETYPE` selects
another one.
"""

from __future__ import annotations

import os
import platform
import subprocess
import sys
from collections.abc import Mapping
from pathlib import Path

import pytest
from built import FMUS, ROOT, share_objects

KERNELS = ("Haswell", "SkylakeX", "Nehalem")
NUMERIC = (
    "control",
    "estimators",
    "models",
    "plants",
    "sensing",
    "roads",
    "builder",
    "optimisation",
    "experiments",
    "cosim",
    "engine",
    "docs/test_public_hmmwv.py",
    "docs/test_pages.py",
    "docs/test_results.py",
    *(f"conformance/test_{name}.py" for name in ("derivatives", "reference", "solver_step", "compliance", "systems")),
)
"""Tests of numbers that follow from linear algebra, in FMUs or in Python."""
SHORT = (
    "control/lq",
    "estimators",
    "models",
    "plants/test_linear_car.py",
    "docs/test_public_hmmwv.py",
    "optimisation/test_calibration.py",
    "conformance/test_derivatives.py",
    "conformance/test_reference.py",
)
WITHOUT = ("rebuilt_from_the_sources", "small_motions", "vehicle_of_a_user", "script_runs_as_the_page_says")
"""Tests among these of which the short form takes none: compilers, integrators and programs, which use no kernel."""
SHORT_FMUS = "RideCarHmmwvPublic,LqrHmmwv,MpcBench"
USED = """
import numpy, scipy.linalg, threadpoolctl
a = numpy.ones((300, 300))
scipy.linalg.lu_factor(a @ a + numpy.eye(300))  # OpenBLAS selects a kernel even if the processor lacks its instructions
print(*{p["architecture"] for p in threadpoolctl.threadpool_info()})
"""

pytestmark = pytest.mark.skipif(
    platform.machine().lower() not in {"x86_64", "amd64"},
    reason="kernels have other names on other processors than x86-64",
)


def environment(kernel: str | None, **more: str) -> dict[str, str]:
    """That of a process with this kernel; with None, with the one of the processor."""
    plain = {k: v for k, v in os.environ.items() if k != "OPENBLAS_CORETYPE" and not k.startswith("PYTEST_")}
    return plain | ({"OPENBLAS_CORETYPE": kernel} if kernel else {}) | more


def used(env: Mapping[str, str]) -> str:
    """The kernel that numpy and scipy use in such a process; empty where the processor does not execute it."""
    found = subprocess.run([sys.executable, "-P", "-c", USED], env=env, capture_output=True, text=True, check=False)
    assert found.returncode <= 0, found.stderr
    return found.stdout.strip() if found.returncode == 0 else ""


def passes(kernel: str, tests: tuple[str, ...], *options: str, **more: str) -> None:
    """These tests pass under a kernel, with FMUs of its own."""
    folder = share_objects(FMUS / ".kernels" / kernel)
    command = [sys.executable, "-m", "pytest", "-p", "no:cacheprovider", *options, *(f"tests/{t}" for t in tests)]
    done = subprocess.run(
        command,
        cwd=ROOT,
        env=environment(kernel, FMUS_FOLDER=str(folder), **more),
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, f"under the kernel {kernel}:\n{done.stdout[-6000:]}{done.stderr[-2000:]}"


def test_numbers_hold_under_another_kernel() -> None:
    """The short form, on one kernel that this process does not use."""
    own = used(os.environ)
    other = next(k for k in KERNELS if k != own and used(environment(k)) == k)
    passes(other, SHORT, "-n0", "-k", f"not ({' or '.join(WITHOUT)})", FMUS_UNDER_TEST=SHORT_FMUS)


@pytest.mark.kernels
@pytest.mark.parametrize("kernel", KERNELS)
def test_numbers_hold_under_every_kernel(kernel: str) -> None:
    if used(environment(kernel)) != kernel:
        pytest.skip(f"this processor cannot execute the kernel {kernel}")
    passes(kernel, NUMERIC, "-n", "auto", "--dist", "loadscope")


def test_every_test_that_is_named_is_there() -> None:
    for name in {*NUMERIC, *SHORT}:
        assert (Path(ROOT) / "tests" / name).exists(), name
