"""What a release publishes (`make release`), with one FMU."""

from __future__ import annotations

import hashlib
import json
import re
import subprocess
import sys
import tomllib
import zipfile
from pathlib import Path

import pytest
import yaml
from built import ROOT, share_objects
from cyclonedx.schema import SchemaVersion
from cyclonedx.validation.json import JsonStrictValidator
from environments import make

import cosim
from build_fmus.compile import PLATFORMS
from fmu_sources.catalog import PAPERS

PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
NAME = "Skyhook"
WITHOUT_A_COMPILER = """
import os
os.environ |= {"PATH": "", "CC": "no-compiler"}
from cosim import PythonComponent, System

class Count(PythonComponent):
    outputs = ("y",)

    def step(self, t, h, u, y):
        y[0] += h

with System() as system:
    system.add("count", Count(), step="1 ms")
    recording = system.run(0.1)
print(len(recording), recording.time[-1])
"""


def release(folder: Path, fmus: Path) -> dict[str, bytes]:
    """Make one; its files by name."""
    command = [sys.executable, ROOT / ".ci" / "release.py", folder, NAME, "--fmus", share_objects(fmus)]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return {p.name: p.read_bytes() for p in folder.iterdir()}


@pytest.fixture(scope="module")
def files(tmp_path_factory: pytest.TempPathFactory) -> dict[str, bytes]:
    return release(tmp_path_factory.mktemp("release"), tmp_path_factory.mktemp("fmus"))


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
        f"{under}-{version}-py3-none-any.whl",
        f"{under}-{version}.tar.gz",
    }


def test_the_wheel_runs_systems_without_a_compiler(files: dict[str, bytes], tmp_path: Path) -> None:
    """The engine is in it for all platforms, and is loaded from there."""
    (name,) = (n for n in files if n.endswith(".whl"))
    (tmp_path / name).write_bytes(files[name])
    environment = make(tmp_path / "environment", tmp_path / name)
    place = environment.site / "suspension_fmus" / "cosim" / "engine" / "prebuilt"
    assert {p.name for p in place.iterdir()} == {f"{n}{p.suffix}" for n, p in PLATFORMS.items()}
    assert environment.execute(WITHOUT_A_COMPILER).split() == ["101", "0.1"]


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


def test_versions_agree() -> None:
    version = PROJECT["version"]
    citation = yaml.safe_load((ROOT / "CITATION.cff").read_text())
    assert cosim.__version__ == citation["version"] == version
    (first, *_) = re.findall(r"^## (\S+)", (ROOT / "docs" / "changelog.md").read_text(), re.MULTILINE)
    assert first == version


def test_the_citation_names_the_papers() -> None:
    citation = yaml.safe_load((ROOT / "CITATION.cff").read_text())
    assert citation["license"] == PROJECT["license"]
    assert len(citation["references"]) == len(PAPERS)
    for paper in PAPERS.values():
        found = [r for r in citation["references"] if r["title"] in paper]
        assert len(found) == 1, paper
        assert all(a["family-names"] in paper and a["given-names"] in paper for a in found[0]["authors"])
