"""What a release publishes (`make release`), with one FMU: minutes of compiling for five platforms."""

from __future__ import annotations

import ast
import hashlib
import io
import json
import re
import subprocess
import sys
import tomllib
import zipfile
from pathlib import Path

import pytest
from built import ROOT, share_objects
from environments import Environment, make

from build_fmus.compile import PLATFORMS, host

RELEASE = (ROOT / ".ci" / "release.py").read_text(encoding="utf-8")
TAGS = ast.literal_eval(re.search(r"^WHEELS = (\{.*?\})", RELEASE, re.MULTILINE | re.DOTALL)[1])  # type: ignore[index]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
NAME = "Skyhook"
WITHOUT_A_COMPILER = """
import os
os.environ |= {"PATH": "", "CC": "no-compiler"}
from cosim import System

with System(allow_unconnected=True) as system:
    system.add("law", "Skyhook")
    recording = system.run(0.9)
print(len(recording), recording.time[-1])
"""

pytestmark = pytest.mark.full


def release(folder: Path, fmus: Path) -> dict[str, bytes]:
    """Make one; its files by name."""
    command = [sys.executable, ROOT / ".ci" / "release.py", folder, NAME, "--fmus", share_objects(fmus)]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return {p.name: p.read_bytes() for p in folder.iterdir()}


@pytest.fixture(scope="module")
def built(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Where the FMUs of the release are built."""
    return tmp_path_factory.mktemp("fmus")


@pytest.fixture(scope="module")
def files(built: Path, tmp_path_factory: pytest.TempPathFactory) -> dict[str, bytes]:
    return release(tmp_path_factory.mktemp("release"), built)


@pytest.fixture(scope="module")
def fmus(files: dict[str, bytes], tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The zip of FMUs, unpacked."""
    folder = tmp_path_factory.mktemp("unpacked")
    (name,) = (n for n in files if n.endswith("-fmus.zip"))
    (folder / "fmus.zip").write_bytes(files[name])
    with zipfile.ZipFile(folder / "fmus.zip") as z:
        z.extractall(folder / "fmus")
    return folder / "fmus"


def verify(sums: str, folder: Path) -> set[str]:
    """Check the checksums; the names of the files."""
    listed = dict(reversed(line.split("  ")) for line in sums.splitlines())
    for name, digest in listed.items():
        assert hashlib.sha256((folder / name).read_bytes()).hexdigest() == digest, name
    return set(listed)


def test_it_has_fmus_wheel_and_sources(files: dict[str, bytes], tmp_path: Path) -> None:
    stem, version = PROJECT["name"], PROJECT["version"]
    under = stem.replace("-", "_")
    for name, data in files.items():
        (tmp_path / name).write_bytes(data)
    assert verify(files["SHA256SUMS"].decode(), tmp_path) == {
        f"{stem}-{version}-fmus.zip",
        *(f"{under}-{version}-py3-none-{tag}.whl" for tag in TAGS.values()),
        f"{under}-{version}.tar.gz",
    }


@pytest.fixture(scope="module")
def environment(files: dict[str, bytes], tmp_path_factory: pytest.TempPathFactory) -> Environment:
    """The wheel of this platform, installed without extras."""
    folder = tmp_path_factory.mktemp("installed")
    (name,) = (n for n in files if n.endswith(f"{TAGS[host()]}.whl"))
    (folder / name).write_bytes(files[name])
    return make(folder / "environment", folder / name)


def test_the_wheel_runs_systems_without_a_compiler(environment: Environment) -> None:
    """Engine and FMU are in it."""
    assert environment.execute(WITHOUT_A_COMPILER).split() == ["31", "0.9"]


@pytest.mark.parametrize("fmi", [2, 3])
def test_its_fmus_are_those_that_were_built(environment: Environment, built: Path, fmi: int) -> None:
    """Byte for byte, by a command that needs neither the declaration nor a compiler."""
    environment.run("suspension-fmus", "fmu", NAME, "--fmi", str(fmi), "--copy", "copies")
    copy = environment.folder.parent / "copies" / f"{NAME}.fmu"
    original = built / ".wheels" / host() / f"fmi{fmi}" / f"{NAME}.fmu"
    assert copy.read_bytes() == original.read_bytes()


def test_a_damaged_store_is_named(environment: Environment) -> None:
    store = environment.site / "suspension_fmus" / "cosim" / "fmu" / "prebuilt" / "fmus.zip"
    whole = store.read_bytes()
    with zipfile.ZipFile(store) as z:
        largest = max(z.infolist(), key=lambda i: i.compress_size)
    at = largest.header_offset + 200
    for damaged in (whole[:-100], whole[:at] + bytes([whole[at] ^ 1]) + whole[at + 1 :]):
        store.write_bytes(damaged)
        try:
            code = (
                "import os, tempfile; os.environ['XDG_CACHE_HOME'] = tempfile.mkdtemp();"
                f" from cosim import System; System().add('law', '{NAME}')"
            )
            assert re.search(
                r"FmuError: \S+fmus.zip is damaged \(.*\): install the package again", environment.execute(code, code=1)
            )
        finally:
            store.write_bytes(whole)


@pytest.mark.parametrize("platform", PLATFORMS)
def test_each_wheel_is_for_one_platform(files: dict[str, bytes], platform: str) -> None:
    (name,) = (n for n in files if n.endswith(f"{TAGS[platform]}.whl"))
    with zipfile.ZipFile(io.BytesIO(files[name])) as z:
        about = next(z.read(n).decode() for n in z.namelist() if n.endswith("/WHEEL"))
        engines = {Path(n).name for n in z.namelist() if "/engine/prebuilt/" in n}
        with zipfile.ZipFile(io.BytesIO(z.read("suspension_fmus/cosim/fmu/prebuilt/fmus.zip"))) as store:
            index = json.loads(store.read("index.json"))
    assert f"Tag: py3-none-{TAGS[platform]}\n" in about
    assert engines == {f"{platform}{PLATFORMS[platform].suffix}"}
    assert set(index) == {f"fmi{v}/{NAME}.fmu" for v in (2, 3)}
    binaries = {n for entry in index.values() for n in entry["files"] if n.startswith("binaries/")}
    target = PLATFORMS[platform]
    assert binaries == {f"binaries/{f}/{NAME}{target.suffix}" for f in (target.name, target.fmi2_name)}


def test_every_file_of_the_zip_has_its_checksum(fmus: Path) -> None:
    there = {p.relative_to(fmus).as_posix() for p in fmus.rglob("*") if p.is_file()}
    assert verify((fmus / "SHA256SUMS").read_text(), fmus) == there - {"SHA256SUMS"}
    text = (fmus / "README.txt").read_text()
    for name in re.findall(r"docs/\S+\.md", text):
        assert (fmus / name).is_file()


def test_fmus_are_for_all_platforms_in_both_versions(fmus: Path) -> None:
    assert {p.relative_to(fmus).as_posix() for p in fmus.rglob("*.fmu")} == {f"fmi{v}/{NAME}.fmu" for v in (2, 3)}
    for fmi in (2, 3):
        with zipfile.ZipFile(fmus / f"fmi{fmi}" / f"{NAME}.fmu") as z:
            held = {n for n in z.namelist() if n.startswith("binaries/")}
        folders = {p: p.fmi2_name if fmi == 2 else p.name for p in PLATFORMS.values()}
        assert held == {f"binaries/{folder}/{NAME}{p.suffix}" for p, folder in folders.items()}


def test_the_bill_of_materials_lists_every_fmu_with_its_hash(fmus: Path) -> None:
    from cyclonedx.schema import SchemaVersion
    from cyclonedx.validation.json import JsonStrictValidator  # takes a second, also of workers that do not need it

    text = (fmus / "bill-of-materials.cdx.json").read_text()
    assert JsonStrictValidator(SchemaVersion.V1_6).validate_str(text) is None
    listed = {c["name"]: c for c in json.loads(text)["components"]}
    assert set(listed) == {f"fmi{v}/{NAME}.fmu" for v in (2, 3)}
    for name, component in listed.items():
        (digest,) = component["hashes"]
        assert digest["content"] == hashlib.sha256((fmus / name).read_bytes()).hexdigest()
        assert {"suspension-fmus", "FMI headers", "MinGW-w64"} <= {c["name"] for c in component["components"]}


def test_the_same_sources_give_the_same_bytes(files: dict[str, bytes], tmp_path: Path) -> None:
    assert release(tmp_path / "again", tmp_path / "fmus") == files
