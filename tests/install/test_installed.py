"""The project as pip installs it.

What the wheel holds, what runs without the repository, with which extras, beside whom.
"""

from __future__ import annotations

import base64
import csv
import hashlib
import importlib
import io
import os
import re
import subprocess
import sys
import tomllib
import zipfile
from collections.abc import Iterator
from pathlib import Path

import pytest
from built import ROOT
from environments import NAME, Environment, make

from build_fmus.base import extras

PACKAGES = ("build_fmus", "cosim", "fmu_sources")
TOP = {"suspension_fmus", "suspension_fmus.pth", "suspension_fmus-{}.dist-info"}
FMU = "QuarterCarHmmwv.fmu"
HEIGHTS = (0.02, 0.05)
EXPERIMENT = """
'A quarter car that is set on a step.'
from cosim import System
from cosim.study import option

STOP_TIME = 8.0
RECORD = ["car.body.z"]

def system(height: float = option(0.05, unit="m", help="height of the step")):
    made = System()
    made.add("car", "QuarterCarHmmwv.fmu", start={"road.height": height})
    return made

def measure(run):
    return {"end": float(run.recording["car.body.z"][-1])}
"""


# ------------------------------------------------------------------------------------------------------- what is there


@pytest.fixture(scope="module")
def place(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder outside of the repository."""
    folder = tmp_path_factory.mktemp("installed")
    assert not folder.is_relative_to(ROOT)
    return folder


def build(source: Path, folder: Path) -> Path:
    """The wheel of the repository or of a source distribution, made with the setuptools that is here."""
    command = [
        "pip",
        "--disable-pip-version-check",
        "wheel",
        "--quiet",
        "--no-deps",
        "--no-build-isolation",
        "--wheel-dir",
    ]
    done = subprocess.run([sys.executable, "-m", *command, folder, source], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    (wheel,) = folder.glob("*.whl")
    return wheel


@pytest.fixture(scope="module")
def wheel(place: Path) -> Path:
    return build(ROOT, place / "wheel")


@pytest.fixture(scope="module")
def contents(wheel: Path) -> dict[str, bytes]:
    with zipfile.ZipFile(wheel) as z:
        return {name: z.read(name) for name in z.namelist()}


@pytest.fixture(scope="module")
def core(place: Path, wheel: Path) -> Environment:
    """What `pip install suspension-fmus` brings."""
    return make(place / "core", wheel)


@pytest.fixture(scope="module")
def with_reports(place: Path, wheel: Path) -> Environment:
    return make(place / "reports", wheel, "reports")


@pytest.fixture(scope="module")
def fmu(place: Path, wheel: Path) -> Path:
    """One FMU, built by what [build] brings; beside it a user's experiment with it."""
    builder = make(place / "build", wheel, "build", "zig")
    said = builder.run("suspension-fmus", "build", "QuarterCarHmmwv", "--fmi", "3")
    assert "1 built, 0 up to date in fmus/" in said
    assert "0 built, 1 up to date" in builder.run("build-fmus", "QuarterCarHmmwv", "--fmi", "3")
    (place / "fmus" / "fmi3" / FMU).rename(place / FMU)
    (place / "step.py").write_text(EXPERIMENT)
    return place / FMU


# ---------------------------------------------------------------------------------------------------------- the wheel


def test_the_wheel_has_one_name_and_every_file_of_the_packages(contents: dict[str, bytes]) -> None:
    """Compared with what git knows, so that a kind of file that setuptools is not told of is missed."""
    listed = ["git", "ls-files", "--cached", "--others", "--exclude-standard", "-z", *PACKAGES, ".ci/suspension_fmus"]
    names = subprocess.run(listed, cwd=ROOT, capture_output=True, text=True, check=True).stdout.split("\0")
    expected = {
        f"suspension_fmus/{n.removeprefix('.ci/suspension_fmus/')}": (ROOT / n).read_bytes()
        for n in names
        if n and (ROOT / n).is_file()
    }
    assert {n: data for n, data in contents.items() if n.startswith("suspension_fmus/")} == expected
    assert {n.partition("/")[0] for n in contents} == top()
    assert contents["suspension_fmus.pth"] == b"suspension_fmus\n"


def top() -> set[str]:
    """What lies at the top of the wheel."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    return {name.format(project["version"]) for name in TOP}


def test_the_record_has_every_file_with_its_hash(contents: dict[str, bytes]) -> None:
    (record,) = (n for n in contents if n.endswith("/RECORD"))
    rows = {name: (digest, size) for name, digest, size in csv.reader(io.StringIO(contents[record].decode()))}
    assert rows.pop(record) == ("", "")
    assert rows == {
        n: (f"sha256={base64.urlsafe_b64encode(hashlib.sha256(data).digest()).rstrip(b'=').decode()}", str(len(data)))
        for n, data in contents.items()
        if n != record
    }


def test_two_builds_are_alike_and_so_is_the_one_from_the_source_distribution(wheel: Path, tmp_path: Path) -> None:
    code = "import sys; sys.path.insert(0, '.ci'); import backend; print(backend.build_sdist(sys.argv[1]))"
    for name in ("one", "two"):
        (tmp_path / name).mkdir()
        subprocess.run([sys.executable, "-c", code, tmp_path / name], cwd=ROOT, check=True, capture_output=True)
    (one,), (two,) = ((tmp_path / n).glob("*.tar.gz") for n in ("one", "two"))
    assert one.read_bytes() == two.read_bytes()
    assert build(one, tmp_path).read_bytes() == wheel.read_bytes()


def test_extras_are_those_of_the_distribution() -> None:
    """The table that messages go by, and what pip installs."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    offered = project["optional-dependencies"]

    def modules(extra: str) -> set[str]:
        found: set[str] = set()
        for text in offered[extra]:
            name = re.match(r"[\w.-]+", text)[0]  # type: ignore[index]
            inner = re.search(r"\[(.*)\]", text)
            found |= set().union(*map(modules, inner[1].split(","))) if name == NAME and inner else {name}
        return found

    every = extras.EXTRAS | extras.OUTSIDE
    assert {extra: modules(extra) for extra in every} == {e: set(m) for e, m in every.items()}
    with pytest.raises(ModuleNotFoundError, match="no_such_module"), extras.needed("build", "this"):
        importlib.import_module("no_such_module")
    assert modules("all") == set().union(*extras.EXTRAS.values()) <= modules("test")
    assert not modules("test") & set().union(*extras.OUTSIDE.values())


# ------------------------------------------------------------------------------------------------------ what installs


def test_one_name_lies_among_those_of_others(core: Environment) -> None:
    assert core.own == top()
    found = core.execute("import cosim, build_fmus; print(cosim.__file__); print(build_fmus.__file__)").splitlines()
    assert found == [str(core.site / "suspension_fmus" / p / "__init__.py") for p in ("cosim", "build_fmus")]


def test_names_of_cosim_are_those_of_the_distribution(core: Environment) -> None:
    core.execute(
        "from suspension_fmus import System, build_fmus\n"
        "import cosim, suspension_fmus, sys\n"
        "assert System is cosim.System and suspension_fmus.cosim is cosim and build_fmus is sys.modules['build_fmus']\n"
        "assert set(dir(suspension_fmus)) > {*cosim.__all__, 'fmu_sources'}\n"
        "from suspension_fmus import *\n"
        "assert Recording is cosim.Recording\n"
        "assert not hasattr(suspension_fmus, 'Nothing')"
    )
    assert "No module named 'suspension_fmus.cosim'" in core.execute("import suspension_fmus.cosim", code=1)


def test_fmus_run_with_what_is_always_installed(core: Environment, fmu: Path) -> None:
    for module in ("casadi", "plotly"):
        assert core.execute(f"from importlib.util import find_spec; print(find_spec('{module}'))") == "None\n"
    code = """
from suspension_fmus import System
with System() as system:
    system.add("car", "QuarterCarHmmwv.fmu", start={"road.height": 0.05})
    print(system.run(8.0, record=["car.body.z"])["car.body.z"][-1])
"""
    printed = core.execute(code).split()
    assert float(printed[-1]) == pytest.approx(0.05, rel=0.01)
    assert "suspension.deflection" in core.run("suspension-fmus", "fmu", fmu)
    for program in ("suspension-fmus", "cosim"):
        assert "run  Run one case" in " ".join(core.run(program, "--help").split()).replace("run Run", "run  Run")
        said = core.run(program, "run", "step.py", "--height", "0.02")
        assert re.search(r"end +0\.0(2|199|201)", said), said


MISSING = {
    "build-fmus": ("building FMUs", "build"),
    "build-fmus --list": ("building FMUs", "build"),
    "suspension-fmus build QuarterCarHmmwv": ("building FMUs", "build"),
    "suspension-fmus identify gpc": ("building FMUs", "build"),
    "suspension-fmus study step.py --height 0.02": ("writing a report", "reports"),
    "cosim run gpc": ("the experiment gpc", "studies"),
    "suspension-fmus study bench": ("the experiment bench", "studies"),
}


@pytest.mark.parametrize("line", MISSING)
def test_a_command_names_the_extra_that_it_lacks(line: str, core: Environment, fmu: Path) -> None:  # noqa: ARG001
    what, extra = MISSING[line]
    said = core.run(*line.split(), code=1)
    assert (
        said == f"{line.partition(' ')[0]}: {what} needs the extra [{extra}]: pip install 'suspension-fmus[{extra}]'\n"
    )


def test_first_steps_are_those_that_work_with_what_is_installed(core: Environment, fmu: Path) -> None:  # noqa: ARG001
    """Without extras nothing is proposed that needs one; what is proposed runs."""
    for said in (core.run("cosim", "list"), core.run("cosim", "--help")):
        steps = re.findall(r"(?m)^ +cosim (\w+) (\S+)", said.partition("First steps:")[2])
        assert steps == [
            ("fmu", "MyModel.fmu"),
            ("check", "MyModel.fmu"),
            ("run", "my_experiment.py"),
            ("run", "Any.ssp"),
        ]
        assert "need the extra [studies]: pip install 'suspension-fmus[studies]'" in " ".join(said.split())
    for command in (["fmu", FMU], ["check", FMU], ["run", "step.py"]):
        core.run("cosim", *command)


def test_an_fmu_that_is_not_built_names_the_extra_that_builds_it(core: Environment) -> None:
    said = core.run("cosim", "fmu", "FullCarHmmwv", code=1)
    assert "run `build-fmus FullCarHmmwv`, which needs the extra [build]" in said


def test_a_wrong_name_is_answered_with_those_there_are_and_the_extra_that_they_need(core: Environment) -> None:
    said = " ".join(core.run("cosim", "run", "gcp", code=2).split())
    assert "did you mean 'gpc'? (there are: bench, gpc, " in said
    assert "), which need the extra [studies]: pip install 'suspension-fmus[studies]'; or a file of yours" in said


def test_packages_run_as_their_commands_do(core: Environment) -> None:
    for package in ("cosim", "suspension_fmus"):
        assert core.run("python", "-m", package, "--help").startswith(f"Usage: python -m {package} ")
    said = core.run("python", "-m", "build_fmus", "--list", code=1)
    assert said.startswith("python -m build_fmus: building FMUs needs the extra [build]")


def test_every_module_can_be_imported_or_names_the_extra_that_it_lacks(core: Environment) -> None:
    code = """
import importlib, pathlib, suspension_fmus
root = pathlib.Path(suspension_fmus.__file__).parent
for file in sorted(root.rglob("*.py")):
    parts = file.relative_to(root).with_suffix("").parts
    if parts[0] != "__init__":
        name = ".".join(parts).removesuffix(".__init__")
        try:
            importlib.import_module(name)
        except suspension_fmus.build_fmus.base.extras.MissingExtraError as error:
            print(name, str(error).partition("[")[2].partition("]")[0])
"""
    code = code.replace("import importlib,", "import build_fmus.base.extras, importlib,")
    lacking = dict(line.split() for line in core.execute(code).splitlines())
    for free in (
        "cosim",
        "cosim.cli",
        "cosim.study.commands",
        "cosim.study.pages",
        "cosim.report",
        "build_fmus.base.terminal",
    ):
        assert free not in lacking
    assert {name: lacking[name] for name in ("fmu_sources.cli", "build_fmus.package", "cosim.report.write")} == {
        "fmu_sources.cli": "build",
        "build_fmus.package": "build",
        "cosim.report.write": "reports",
    }
    assert "writing a report needs the extra [reports]" in core.execute("from cosim.report import write_report", code=1)


def test_a_study_of_ones_own_needs_reports_alone(with_reports: Environment, fmu: Path) -> None:
    study(with_reports, fmu)


def study(environment: Environment, fmu: Path, *options: str) -> None:
    """Run a small study and look at its page."""
    given = [text for h in HEIGHTS for text in ("--height", str(h))]
    said = environment.run("suspension-fmus", "study", "step.py", *given, "--processes", "2", *options)
    folder = fmu.parent / "results" / "step"
    assert f"report: {Path('results', 'step', 'report.html')}" in said
    page = (folder / "report.html").read_text(encoding="utf-8")
    assert "A quarter car that is set on a step." in page
    assert "plotly" in page
    rows = list(csv.reader((folder / "tables" / "runs.csv").read_text(encoding="utf-8").splitlines()))[1:]
    assert [float(h) for h, _ in rows] == list(HEIGHTS)
    assert [float(end) for _, end in rows] == pytest.approx(HEIGHTS, rel=0.01)


# ------------------------------------------------------------------------------------------------ beside other people's


@pytest.fixture
def foreign(with_reports: Environment) -> Iterator[Path]:
    """Another project's package `cosim` in the same environment."""
    package = with_reports.site / "cosim" / "__init__.py"
    package.parent.mkdir()
    package.write_text("WHOSE = 'not ours'\n")
    yield package
    for file in (package, *package.parent.glob("__pycache__/*")):
        file.unlink()
    for folder in sorted(package.parent.rglob("*"), reverse=True):
        folder.rmdir()
    package.parent.rmdir()


def test_another_cosim_is_left_alone(with_reports: Environment, foreign: Path) -> None:
    assert with_reports.execute("import cosim; print(cosim.WHOSE)") == "not ours\n"
    assert foreign.read_text() == "WHOSE = 'not ours'\n"


@pytest.mark.usefixtures("foreign")
def test_another_cosim_does_not_get_in_the_way(with_reports: Environment, fmu: Path) -> None:
    """In our commands, in their workers, and in a script that imports the distribution first."""
    study(with_reports, fmu, "--force")
    assert "suspension.deflection" in with_reports.run("cosim", "fmu", fmu)
    printed = with_reports.execute("import suspension_fmus, cosim; from cosim import System; print(cosim.__file__)")
    assert printed == f"{with_reports.site / 'suspension_fmus' / 'cosim' / '__init__.py'}\n"
    with_reports.execute("from suspension_fmus import System; from cosim.study import Case")


def test_who_came_first_is_named(with_reports: Environment, foreign: Path) -> None:
    sentence = (
        "a package of another project was imported before suspension_fmus and has a name of ours: cosim"
        f" ({with_reports.site}); import suspension_fmus first, or keep the two projects in environments of their own"
    )
    said = with_reports.execute("import cosim; import suspension_fmus", code=1)
    assert said.splitlines()[-1] == f"ImportError: {sentence}"
    early = foreign.parents[1] / "early.pth"  # what Python runs before any program
    early.write_text("import cosim\n")
    try:
        assert with_reports.run("suspension-fmus", "list", code=1) == f"suspension-fmus: {sentence}\n"
    finally:
        early.unlink()


def test_what_others_have_stays_when_ours_is_removed(wheel: Path, tmp_path: Path) -> None:
    environment = make(tmp_path / "removed", wheel)
    (environment.site / "cosim").mkdir()
    (environment.site / "cosim" / "__init__.py").write_text("WHOSE = 'not ours'\n")
    environment.execute("import suspension_fmus, cosim")  # leaves compiled files
    environment.pip("uninstall", "--quiet", "--yes", NAME)
    assert environment.own == {"cosim"}
    assert environment.execute("import cosim; print(cosim.WHOSE)") == "not ours\n"


def test_the_repository_beside_another_cosim(tmp_path: Path) -> None:
    """An editable install has the packages where they are, and the distribution's name finds them too."""
    (tmp_path / "cosim.py").write_text("WHOSE = 'not ours'\n")
    code = "import suspension_fmus, cosim; print(cosim.__file__)"
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join([str(tmp_path), str(ROOT / ".ci")])}
    done = subprocess.run(
        [sys.executable, "-c", code], cwd=tmp_path, env=environment, capture_output=True, text=True, check=True
    )
    assert done.stdout == f"{ROOT / 'cosim' / '__init__.py'}\n"
