"""Where values and equations come from: the FMU says what its declaration says.

Its C code says nothing that is not needed.
"""

from __future__ import annotations

import os
import re
import shutil
import subprocess
from collections.abc import Callable
from functools import cache

import components
import pytest
from api import Library
from built import FMUS, BuiltFmus

from build_fmus.builder import Options
from build_fmus.component import Model
from cosim import Fmu
from fmu_sources.catalog import Context, default_catalog


@cache
def declared(name: str) -> Model:
    """The component that an FMU under test is made of."""
    if name in components.MAKERS:
        return components.MAKERS[name]().model()
    options = Options(FMUS)
    return default_catalog()[name].make(Context(options.out, options.cache)).model()


def test_every_parameter_has_the_source_that_was_declared(name: str, built_fmus: BuiltFmus) -> None:
    files = [built_fmus.path(name, 2), built_fmus.path(name, 3)]
    if name in components.MAKERS:
        files.append(built_fmus.path(name, 3, arrays=True))
    sources = {n: v.source for v in declared(name).variables if v.role == "parameter" for n in v.element_names()}
    for file in files:
        about = Fmu(file).description
        assert {n: p.source for n, p in about.parameters.items()} == sources
        assert not any(v.source for n, v in about.variables.items() if n not in about.parameters)


SECTIONS = {
    True: ("outputs", "directional derivatives"),
    False: ("sample",),
}  # of continuous components, of discrete ones


def test_each_section_of_the_code_says_where_its_equations_come_from(
    name: str, load: Callable[[str, int], Library]
) -> None:
    fmu, component = load(name, 3), declared(name)
    code = (fmu.folder / "sources" / "model.c").read_text()
    code = code.replace("CALLED_ONCE\nstatic", "static")
    sections = re.findall(r"^/\* -+ (\w[^\n]*)\n \* (.*?) \*/\nstatic void", code, re.MULTILINE | re.DOTALL)
    titles = [title for title, _ in sections]
    assert len(titles) == len(re.findall(r"^static void \w+\(const FmuArguments", code, re.MULTILINE))
    for wanted in (
        *SECTIONS[fmu.is_continuous],
        *(["derivatives"] if fmu.is_continuous and component.size("state") else []),
    ):
        assert any(t.startswith(wanted) for t in titles)
    assert {re.sub(r"\s*\n \*", "", source) for _, source in sections} == {" ".join(component.source.split())}
    assert "casadi" not in code.lower() or name in components.MAKERS


@pytest.mark.skipif(shutil.which("gcc") is None, reason="needs gcc")
def test_nothing_in_the_code_is_unused(name: str, load: Callable[[str, int], Library]) -> None:
    """The code of the equations has no unused functions, constants, arguments, macros or types.

    With -flto the compiler ends where it has seen all of them, before it writes instructions.
    """
    sources = load(name, 3).folder / "sources"
    flags = ["-std=c99", "-Wall", "-Wextra", "-Wunused", "-Wunused-macros", "-Werror", "-flto", f"-I{sources}"]
    command = ["gcc", *flags, "-S", str(sources / "model.c"), "-o", os.devnull]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
