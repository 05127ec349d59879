"""The binaries for other platforms run.

Windows ones under Wine, ARM ones under QEMU, and their numbers are those of this machine.

`host.c` is compiled for each platform by ziglang, and replays the stimulus of every FMU (and of an exported system);
the state travels as bytes into another instance halfway. macOS has no such stand-in: of its binaries only what they say
of themselves is looked at.
"""

from __future__ import annotations

import shutil
import subprocess
import zipfile
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import binaries
import numpy as np
import pytest
from api import Model, Signals
from built import CATALOG_NAMES, FMUS, ROOT, one_at_a_time, share_objects
from fmpy import __file__ as fmpy_file

from build_fmus.builder import Options
from build_fmus.compile import PLATFORMS, Platform, find_toolchain
from cosim import System
from fmu_sources import cli

pytestmark = [pytest.mark.platforms, pytest.mark.xdist_group("platforms")]
HERE = Path(__file__).parent
HOST = "x86_64-linux"
SYSTEM = "ClosedLoop"  # an exported system among the FMUs
WITHOUT_INPUTS = 20.0  # s; the pitch reference begins to move at 15 s


@dataclass(frozen=True)
class Runner:
    """Runs programs of a platform here: `programs`, any of them, with `arguments`.

    `packages` of Debian bring them.
    """

    programs: tuple[str, ...]
    arguments: tuple[str, ...]
    packages: str

    @property
    def command(self) -> list[str] | None:
        """The begin of a command line, None where it is not installed."""
        found = next((p for p in map(shutil.which, self.programs) if p), None)
        return None if found is None else [found, *self.arguments]


RUNNERS = {
    "x86_64-windows": Runner(("wine64", "wine", "/usr/lib/wine/wine64"), (), "wine64 (or wine)"),
    "aarch64-linux": Runner(
        ("qemu-aarch64-static", "qemu-aarch64"),
        ("-L", "/usr/aarch64-linux-gnu"),
        "qemu-user-static and libc6-arm64-cross",
    ),
}


@cache
def build_for_all() -> Path:
    """Folder with all FMUs, and an exported system, for every platform; kept from run to run, and by releases."""
    out = ROOT / "build" / "platforms"
    with one_at_a_time(FMUS / ".cache" / "platforms.lock"):
        cli.build(CATALOG_NAMES, Options(share_objects(out), platform="all"))
        for fmi in (2, 3):
            with System() as system:
                system.add("car", out / f"fmi{fmi}" / "QuarterCarBench.fmu")
                system.add("law", out / f"fmi{fmi}" / "MpcBench.fmu")
                system.connect_matching("car", "law")
                system.connect_matching("law", "car", "force")
                system.export_fmu(out / "systems" / f"fmi{fmi}" / f"{SYSTEM}.fmu", fmi=fmi, platforms="all")
    return out


def archive_of(name: str, fmi: int) -> Path:
    """File of one of them."""
    return build_for_all() / ("systems" if name == SYSTEM else "") / f"fmi{fmi}" / f"{name}.fmu"


def binary_of(path: Path, platform: Platform, fmi: int) -> str:
    """Path of a platform's binary inside an archive."""
    return f"binaries/{platform.fmi2_name if fmi == 2 else platform.name}/{path.stem}{platform.suffix}"


def bits(values: np.ndarray) -> str:
    """Numbers as host.c reads them."""
    return " ".join(f"{b:x}" for b in np.ascontiguousarray(values, dtype=float).ravel().view(np.uint64))


def stimulus_of(path: Path, model: Model) -> Signals:
    """The inputs of the documentation; those of a system, which has none, swing.

    Without inputs: long enough for any profile over time.
    """
    with zipfile.ZipFile(path) as z:
        name = f"documentation/{path.stem}_in.csv"
        if name in z.namelist() and model.inputs:
            return Signals.read(z.read(name).decode())
    if not model.inputs:
        time = np.arange(round(WITHOUT_INPUTS / model.step) + 1) * model.step
        return Signals(time, np.empty((len(time), 0)), [])
    time, names = np.arange(201) * model.step, model.names("input", "real")
    return Signals(time, np.column_stack([0.02 * np.sin(20.0 * time + i) for i in range(len(names))]), names)


def write_job(path: Path, fmi: int, platform: Platform, folder: Path) -> Path:
    """One FMU's job for host.c; the archive is unpacked beside it."""
    root = folder / f"{path.stem}{fmi}"
    with zipfile.ZipFile(path) as z:
        z.extractall(root)
    model = Model(path)
    signals = stimulus_of(path, model)
    place = f"Z:{root}" if platform.is_windows else str(root)  # Wine's name of the root of this machine
    resources = f"file://{root}/resources" if fmi == 2 else f"{place}/resources/"

    def variables(names: list[str]) -> str:
        found = [model.variables[n] for n in names]
        return " ".join([str(len(names)), *(f"{v.kind[0]} {v.reference}" for v in found)])

    job = folder / f"{path.stem}{fmi}.job"
    job.write_text(
        "\n".join(
            [
                f"{fmi} {place}/{binary_of(path, platform, fmi)} {model.token} {resources}",
                f"{bits(np.array([model.step]))} {len(signals.time) - 1}",
                variables(signals.names),
                variables(model.outputs),
                bits(signals.values),
            ]
        )
    )
    return job


@pytest.fixture(scope="module")
def results(tmp_path_factory: pytest.TempPathFactory) -> Callable[[str], tuple[Path, str]]:
    """Folder of the outputs of all FMUs on a platform, and what its host said; each platform runs once."""

    @cache
    def run(name: str) -> tuple[Path, str]:
        runner = RUNNERS.get(name)
        command: list[str] | None = [] if runner is None else runner.command
        if command is None:
            pytest.skip(
                f"nothing here runs programs for {name}: install Debian's {runner.packages}" if runner else name
            )
        platform, folder = PLATFORMS[name], tmp_path_factory.mktemp(name)
        host = folder / ("host.exe" if platform.is_windows else "host")
        headers = Path(fmpy_file).parent / "c-code"
        libraries = [] if platform.is_windows else ["-ldl"]
        subprocess.run(
            [
                *find_toolchain(name).command,
                "-O1",
                "-std=gnu99",
                f"-I{headers}",
                HERE / "host.c",
                "-o",
                host,
                *libraries,
            ],
            check=True,
        )
        archives = [(archive_of(n, fmi), fmi) for fmi in (2, 3) for n in (*CATALOG_NAMES, SYSTEM)]
        jobs = [write_job(path, fmi, platform, folder) for path, fmi in archives]
        places = [f"Z:{j}" if platform.is_windows else str(j) for j in jobs]
        done = subprocess.run([*command, host, *places], capture_output=True, text=True, check=False, timeout=3000)
        return folder, f"exit code {done.returncode}\n{done.stderr[-3000:]}"

    return run


def outputs(results: Callable[[str], tuple[Path, str]], platform: str, name: str, fmi: int) -> np.ndarray:
    """Outputs at all communication points of an FMU on a platform."""
    folder, said = results(platform)
    file = folder / f"{name}{fmi}.job.out"
    assert file.is_file(), f"the host for {platform} did not come to {name}, FMI {fmi}: {said}"
    rows = [[int(w, 16) for w in line.split()] for line in file.read_text().splitlines()]
    assert len({len(r) for r in rows}) == 1, f"{name} stopped halfway on {platform}: {said}"
    return np.array(rows, dtype=np.uint64).view(float)


@pytest.mark.parametrize("fmi", [2, 3])
@pytest.mark.parametrize("name", [*CATALOG_NAMES, SYSTEM])
@pytest.mark.parametrize("platform", RUNNERS)
def test_same_numbers(results: Callable[[str], tuple[Path, str]], platform: str, name: str, fmi: int) -> None:
    """The FMUs carry their mathematical functions, and no operation is fused: the bits are the same."""
    there, here = (outputs(results, p, name, fmi) for p in (platform, HOST))
    path = archive_of(name, fmi)
    assert here.shape == (len(stimulus_of(path, Model(path)).time), len(Model(path).outputs))
    assert np.isfinite(here).all()
    assert np.ptp(here, axis=0).max(initial=0.0) > 0.0, "nothing moves: the comparison says nothing"
    assert there.tobytes() == here.tobytes()


@pytest.mark.parametrize("fmi", [2, 3])
@pytest.mark.parametrize("name", [*CATALOG_NAMES, SYSTEM])
def test_macos_binaries_say_what_they_are(name: str, fmi: int) -> None:
    """Built, not run: the load commands, the oldest system, and the symbols."""
    path = archive_of(name, fmi)
    with zipfile.ZipFile(path) as z:
        exported = {p: binaries.read(z.read(binary_of(path, PLATFORMS[p], fmi))) for p in PLATFORMS}
    for platform in ("x86_64-darwin", "aarch64-darwin"):
        binary = exported[platform]
        assert binary.macos == (11, 0, 0)
        assert binary.name == f"@rpath/{name}.dylib"
        assert binary.libraries == {"/usr/lib/libSystem.B.dylib"}
        assert binary.exported == exported[HOST].exported
