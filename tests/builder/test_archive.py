"""From a declaration to an archive: reproducible bytes, clean binaries, any compiler."""

from __future__ import annotations

import hashlib
import importlib.util
import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import fmpy
import pytest
from built import FMUS, OBJECTS
from components import filter_bank, oscillator

from build_fmus import compile as compiling
from build_fmus.compile import (
    CFLAGS,
    PLATFORMS,
    CompileError,
    ObjectCache,
    Toolchain,
    find_toolchain,
    host,
    resolve_platforms,
)
from build_fmus.generate import FIRST_INSTANCE, generate_c, identity
from build_fmus.package import build_fmu, source_files

needs_nm = pytest.mark.skipif(shutil.which("nm") is None, reason="needs nm of binutils")
needs_zig = pytest.mark.skipif(importlib.util.find_spec("ziglang") is None, reason="needs ziglang from PyPI")


@pytest.fixture
def no_compiler(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """A machine without any C compiler in PATH."""
    monkeypatch.setenv("PATH", str(tmp_path))
    monkeypatch.delenv("CC", raising=False)


def test_same_inputs_same_bytes(tmp_path: Path) -> None:
    """Twice from scratch, with different caches; the second time in another process with other hash seeds."""
    script = (
        "import sys, hashlib; from pathlib import Path; from components import MAKERS;"
        "from build_fmus.package import build_fmu; from build_fmus.compile import ObjectCache, resolve_platforms;"
        "cache = ObjectCache(Path(sys.argv[1]));"
        "build = lambda n, fmi: build_fmu(MAKERS[n](), fmi, resolve_platforms('host'), cache);"
        "print([hashlib.sha256(build(n, f)).hexdigest() for n, f in (('ProbeRk4', 2), ('ProbeDiscrete', 3))])"
    )
    done = subprocess.run(
        [sys.executable, "-c", script, str(tmp_path / "other")],
        capture_output=True,
        text=True,
        check=True,
        env={**os.environ, "PYTHONHASHSEED": "1", "PYTHONPATH": str(Path(__file__).parents[1])},
    )
    cache = ObjectCache(tmp_path / "own")
    archives = [
        build_fmu(make(), fmi, resolve_platforms("host"), cache) for make, fmi in ((oscillator, 2), (filter_bank, 3))
    ]
    assert str([hashlib.sha256(a).hexdigest() for a in archives]) == done.stdout.strip()


def test_identity_follows_content() -> None:
    """The instantiation token changes with anything that changes behavior or interface, and with nothing else."""

    def changed(**parameter: object) -> str:
        c = oscillator()
        told = {"start": 1.0, "unit": "m", "description": "extra", "source": "none", **parameter}
        c.parameter("extra", **told)  # type: ignore[arg-type]
        return identity(c.model(), arrays=False)

    tokens = {
        changed(),
        changed(start=2.0),
        changed(unit="s"),
        changed(description="other"),
        changed(max=3.0),
        changed(min=0.0),
        changed(tunable=True),
        changed(nominal=5.0),
        changed(display_unit="mm"),
        identity(oscillator().model(), arrays=False),
        identity(oscillator().model(), arrays=True),
        identity(oscillator(solver="am2").model(), arrays=False),
    }
    assert len(tokens) == 12
    assert changed() == changed() == changed(source="another")
    assert all(re.fullmatch(r"\{[0-9a-f]{8}(-[0-9a-f]{4}){3}-[0-9a-f]{12}\}", t) for t in tokens)


def objects(component, directory: Path) -> dict[str, str]:  # type: ignore[no-untyped-def]
    """Symbol listings of the objects of a component's FMUs."""
    toolchain = find_toolchain(host())
    found = {}
    for fmi in (2, 3):
        files = source_files(component, fmi)
        for name, data in files.items():
            (directory / name).parent.mkdir(exist_ok=True)
            (directory / name).write_bytes(data)
        for name in (n for n in files if n.endswith(".c")):
            compiled = OBJECTS.object(toolchain, directory / name, [directory])
            found[name] = subprocess.run(["nm", str(compiled)], capture_output=True, text=True, check=True).stdout
    return found


@needs_nm
@pytest.mark.parametrize("make", [oscillator, filter_bank])
def test_no_static_data_and_no_heap_in_the_model(make, tmp_path: Path) -> None:  # type: ignore[no-untyped-def]
    """Any number of instances: nothing writable is shared. Only instantiation and snapshots allocate.

    Of a sampled component, one instance at a time has its memory in the binary.
    """
    first = {FIRST_INSTANCE} if make is filter_bank else set()
    for name, listing in objects(make().model(), tmp_path).items():
        kinds = {line.split()[-1]: line.split()[-2] for line in listing.splitlines()}
        writable = {s for s, kind in kinds.items() if kind in "bBcC" or (kind in "dD" and not relocated(s))}
        assert writable == (first if name == "model.c" else set()), f"{name}: {writable}"
        heap = {s for s, kind in kinds.items() if kind == "U"} & {"malloc", "calloc", "realloc", "free"}
        assert heap <= ({"malloc", "calloc", "free"} if name == "fmu_core.c" else set()), name


def relocated(symbol: str) -> bool:
    """Constant tables of pointers, which position-independent code keeps in the section .data.rel.ro."""
    tables = ("variables", "fmu_model", "hidden", "check_messages", "categories", "points", "M")
    return symbol in tables or symbol.startswith("categories.")


def test_compiler_flags_fix_the_rounding() -> None:
    assert "-ffp-contract=off" in CFLAGS
    assert not any("fast" in f or "native" in f for f in CFLAGS)


def test_no_compiler_means_ziglang(no_compiler: None, raises) -> None:  # noqa: ARG001
    if importlib.util.find_spec("ziglang") is None:
        with raises(CompileError):
            find_toolchain(host())
    else:
        assert "ziglang" in find_toolchain(host()).command


def test_no_compiler_at_all_says_how_to_get_one(no_compiler: None, monkeypatch: pytest.MonkeyPatch) -> None:  # noqa: ARG001
    monkeypatch.setattr(compiling.importlib.util, "find_spec", lambda _: None)
    with pytest.raises(CompileError, match="pip install ziglang"):
        find_toolchain(host())


def test_a_named_compiler_that_is_not_there(monkeypatch: pytest.MonkeyPatch, raises) -> None:
    monkeypatch.setenv("CC", "no-such-compiler")
    with raises(CompileError):
        find_toolchain(host())
    monkeypatch.setenv("CC", "no-such-cache gcc")
    with raises(CompileError):
        find_toolchain(host())
    monkeypatch.setenv("CC", "gcc 'open")
    with raises(CompileError):
        find_toolchain(host())


@pytest.mark.skipif(shutil.which("cc") is None or os.name == "nt", reason="needs a C compiler named cc")
def test_a_compiler_with_arguments(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """As `ccache gcc`. Arguments are part of what compiled objects are kept by."""
    launcher = tmp_path / "my launcher"
    launcher.write_text('#!/bin/sh\necho "$@" >> "$(dirname "$0")/called"\nexec "$@"\n')
    launcher.chmod(0o755)
    monkeypatch.setenv("CC", f"'{launcher}' cc -DSIX=6")
    toolchain = find_toolchain(host())
    assert toolchain.command == (str(launcher), "cc", "-DSIX=6")
    (tmp_path / "six.c").write_text("int six[SIX];")
    toolchain.compile(tmp_path / "six.c", tmp_path / "six.o", [])
    assert "cc -DSIX=6 -O2" in (tmp_path / "called").read_text()
    monkeypatch.setenv("CC", f"'{launcher}' cc -DSIX=7")
    assert find_toolchain(host()).version != toolchain.version
    monkeypatch.setenv("CC", str(launcher))  # a path with a space
    assert find_toolchain(host()).command == (str(launcher),)


@pytest.mark.skipif(shutil.which("cc") is None or os.name == "nt", reason="needs a C compiler named cc")
def test_ziglang_has_one_working_folder(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """In another one it compiles its C libraries again. Paths that the builder gets may be relative."""
    launcher = tmp_path / "launcher"
    launcher.write_text('#!/bin/sh\npwd >> "$(dirname "$0")/folders"\nexec cc "$@"\n')
    launcher.chmod(0o755)
    toolchain = Toolchain(PLATFORMS[host()], (str(launcher),), "ziglang")
    for folder in (tmp_path / "one", tmp_path / "two"):
        folder.mkdir()
        monkeypatch.chdir(folder)
        Path("six.h").write_text("#define SIX 6")
        Path("sub").mkdir()
        Path("sub", "six.c").write_text('#include "six.h"\nint six[SIX];')
        toolchain.compile(Path("sub/six.c"), Path("six.o"), [Path()])
        toolchain.link([Path("six.o")], Path("six.so"))
        assert Path("six.so").is_file()
    assert len(set((tmp_path / "folders").read_text().splitlines())) == 1


def test_compiler_errors_carry_the_compilers_words(tmp_path: Path) -> None:
    (tmp_path / "broken.c").write_text("int f( { }")
    with pytest.raises(CompileError, match=r"broken\.c(.|\n)*error"):
        find_toolchain(host()).compile(tmp_path / "broken.c", tmp_path / "broken.o", [])


def test_unknown_platform(raises) -> None:
    with raises(CompileError):
        resolve_platforms("host,amiga")
    assert [p.name for p in resolve_platforms("all")] == list(PLATFORMS)
    assert [p.name for p in resolve_platforms("host, aarch64-darwin")] == [host(), "aarch64-darwin"]


@needs_zig
def test_ziglang_builds_for_the_host(no_compiler: None, tmp_path: Path) -> None:  # noqa: ARG001
    """One small component. The other platforms take minutes the first time and are left to `--platform all`."""
    target = resolve_platforms("host")[0]
    path = tmp_path / "ProbeDiscrete.fmu"
    path.write_bytes(build_fmu(filter_bank(), 3, [target], ObjectCache(FMUS / ".cache" / "ziglang")))
    result = fmpy.simulate_fmu(str(path), stop_time=0.1, start_values={"y[3]": 1.0}, output=["u[1]", "samples"])
    assert result["samples"][-1] == 19
    assert result["u[1]"][-1] == 3.0  # third gain times one


def test_generated_code_is_plain_c() -> None:
    code = generate_c(oscillator().model(), arrays=False, token="{x}")
    assert "malloc" not in code
    assert set(re.findall(r'#include [<"](.*)[">]', code)) == {"equations.h", "fmu_model.h"}
