"""Generated sources: warnings of C and C++ compilers, MISRA C rules, changes to third-party sources (30 s)."""

from __future__ import annotations

import re
import shutil
import subprocess
import tomllib
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import casadi as ca
import pytest
from built import FMUS
from components import optimizer
from pages import ROOT
from same_samples import declared

from build_fmus.component import Component
from build_fmus.mathematics import FOLDER, THIRD_PARTY
from build_fmus.qp import Daqp, Osqp
from build_fmus.qp_sources import THIRD_PARTY as SOLVERS
from build_fmus.target import library as library_module
from build_fmus.target.assemble import Library, assemble, third_party_changes
from build_fmus.target.library import SourceWarning, build_library
from build_fmus.target.toolchain import CFLAGS, TARGETS, WARNINGS, Tools
from fmu_sources.catalog import default_catalog

pytestmark = pytest.mark.filterwarnings("error::build_fmus.target.library.SourceWarning")
COMPILERS = {
    n: [f"{TARGETS[n].prefix}gcc", *CFLAGS, *TARGETS[n].flags, "-Werror"]
    for n in ("cortex-m4f", "cortex-m7", "host-static")
}
CHECKED = ["LqrHmmwv", "GpcPreview", "ForceTracking", "KalmanHmmwvPrinted", "TrenchCrossing", "RideComfort"]
COMPILERS["C++"] = ["g++", "-std=c++17", "-x", "c++", "-O1", "-Wall", "-Wextra", "-Werror"]


def mathematics() -> Component:
    """A component that calls every mathematical function: `z` is for those that need a number of at least 1."""
    c = Component("Mathematics", kind="discrete", sample_time=0.01, description="Every function */", source="none")
    x, y, z = (c.input(n, "1", n, start=1.0) for n in "xyz")
    of_one = ["acos", "asin", "asinh", "atan", "atanh", "ceil", "cos", "cosh", "erf", "exp", "expm1", "fabs"]
    of_one += ["floor", "log", "log1p", "sign", "sin", "sinh", "sqrt", "tan", "tanh"]
    of_two = ("atan2", "copysign", "fmax", "fmin", "fmod", "hypot", "power", "remainder")
    for name in of_one:
        c.output(name, getattr(ca, name)(x), "1", name)
    c.output("acosh", ca.acosh(z), "1", "acosh")
    for name in of_two:
        c.output(name, getattr(ca, name)(x, y), "1", name)
    return c


def compiled(source: Library, compiler: str, folder: Path) -> None:
    command = COMPILERS[compiler]
    if shutil.which(command[0]) is None:
        pytest.skip(f"{command[0]} is not installed (Debian package gcc-arm-none-eabi or g++)")
    (folder / f"{source.name}.h").write_text(source.header)
    (folder / f"{source.name}.c").write_text(source.code)
    Tools.run([*command, "-c", f"{source.name}.c", "-o", "all.o"], folder)


@pytest.mark.parametrize("compiler", COMPILERS)
@pytest.mark.parametrize("make", [lambda: declared("Skyhook", FMUS), mathematics], ids=["Skyhook", "mathematics"])
@pytest.mark.parametrize("precision", ["double", "single"])
def test_no_warnings(compiler: str, make: Callable[[], Component], precision: str, tmp_path: Path) -> None:
    compiled(assemble(make().model(), precision), compiler, tmp_path)


@pytest.mark.embedded
@pytest.mark.parametrize("target", ["cortex-m4f", "cortex-m7", "host-static"])
def test_no_warnings_in_the_catalog(target: str, tmp_path: Path) -> None:
    """Every component that --target takes, as it is written (5 min each)."""
    if shutil.which(f"{TARGETS[target].prefix}gcc") is None:
        pytest.skip(f"{TARGETS[target].prefix}gcc is not installed (Debian package gcc-arm-none-eabi)")
    n = 0
    for name in default_catalog():
        component = declared(name, FMUS)
        if component.model().kind == "discrete" and not component.model().profiles:
            folder = build_library(component, TARGETS[target], tmp_path)
            if target == "host-static":
                Tools.run([*COMPILERS["C++"], "-fsyntax-only", f"{name}.c"], folder)
            n += 1
    assert n >= 44


def test_a_warning_is_no_failure(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    component = declared("Skyhook", FMUS)
    build_library(component, TARGETS["host-static"], tmp_path)
    source = assemble(component.model())
    code = f"{source.code}\nint Skyhook_count(double x);\nint Skyhook_count(double x) {{ return x; }}\n"
    monkeypatch.setattr(library_module, "assemble", lambda *_: replace(source, code=code))
    with pytest.warns(SourceWarning, match=r"^Skyhook: the compiler warns of its C code: .*\[-Wfloat-conversion\]$"):
        build_library(component, TARGETS["host-static"], tmp_path)
    assert set(WARNINGS) < set(CFLAGS)


def test_changed_texts_are_in_third_party_sources() -> None:
    files = {f"{FOLDER}/{p.name}": p.read_bytes() for p in (THIRD_PARTY / FOLDER).iterdir()}
    for solver in SOLVERS.values():
        files |= solver().files
    texts = {path: files[path].decode() for path in third_party_changes()}
    assert [(p, old) for p, changes in third_party_changes().items() for old, _ in changes if old not in texts[p]] == []


@pytest.mark.embedded
def test_deviations_from_misra_are_those_listed(tmp_path: Path) -> None:
    """Rules of MISRA C:2012 that sources break, found by cppcheck's addon (2 min).

    The sources are those of a few components that contain all of the runtime, of the mathematics and of the solvers.
    """
    if shutil.which("cppcheck") is None:
        pytest.skip("cppcheck is not installed (Debian package cppcheck)")
    found: dict[str, set[str]] = {"own": set(), "third_party": set()}
    solvers = optimizer("Solvers", Osqp(rho=1.0, fallback=Daqp()))
    for component in (mathematics(), solvers, *(declared(n, FMUS) for n in CHECKED)):
        source = assemble(component.model())
        (tmp_path / f"{source.name}.h").write_text(source.header)
        (tmp_path / f"{source.name}.c").write_text(source.code)
        for rule, line in findings(f"{source.name}.c", tmp_path):
            file = re.findall(r"^/\* -{60} (\S+) \*/$", "\n".join(source.code.splitlines()[:line]), re.MULTILINE)
            found["third_party" if file and "/" in file[-1] else "own"].add(rule)
    listed = tomllib.loads((ROOT / "build_fmus" / "target" / "misra.toml").read_text(encoding="utf-8"))
    assert {part: sorted(rules) for part, rules in found.items()} == {p: sorted(rules) for p, rules in listed.items()}
    assert all(len(reason) > 10 for rules in listed.values() for reason in rules.values())


def findings(source: str, folder: Path) -> list[tuple[str, int]]:
    """Rules that a file breaks, and the lines; one configuration, that of GCC."""
    command = ["cppcheck", "--addon=misra", "-q", "-D__GNUC__=12", "--template={id} {line}", source]
    done = subprocess.run(command, cwd=folder, capture_output=True, text=True, check=True)
    lines = [line.split() for line in done.stderr.splitlines()]
    return [(rule.removeprefix("misra-c2012-"), int(line)) for rule, line in lines]
