"""FMU files that contradict themselves.

Each is refused in one sentence that names the thing, before anything is made big.
"""

import ast
import contextlib
import os
import re
import subprocess
import sys
import tempfile
import zipfile
import zlib
from fractions import Fraction
from functools import partial
from pathlib import Path

import pytest
from awkward import archive, description, library
from rich.console import Console

from cosim import Fmu, FmuError, FmuWarning, System, TimeError, WiringError, describe, wiring
from cosim.core.time import rational
from cosim.fmu.calls import platform_folder

pytestmark = pytest.mark.filterwarnings("ignore::cosim.UnconnectedInputsWarning", "ignore::cosim.FmuWarning")
VERSIONS = pytest.mark.parametrize("version", [2, 3])


def real(name="x", reference="0", inner="<Real/>", more=""):
    return f'<ScalarVariable name="{name}" valueReference="{reference}" {more}>{inner}</ScalarVariable>'


def float64(name="x", reference="0", inner="", more=""):
    return f'<Float64 name="{name}" valueReference="{reference}" {more}>{inner}</Float64>'


# -------------------------------------------------------------------------------------------------------- description


UNREADABLE_VARIABLES = (
    (2, real("wheel", inner="")),
    (2, real("wheel", inner="<Float64/>")),
    (3, '<Real name="wheel" valueReference="0"/>'),
    (3, '<Quaternion name="wheel" valueReference="0"/>'),
    (2, real("wheel", "-1")),
    (2, real("wheel", str(2**32))),
    (3, float64("wheel", "-1")),
    (3, float64("wheel", str(2**32))),
    (2, real("wheel", "1.5")),
    (2, real("wheel", "9" * 5000)),
    (2, '<ScalarVariable name="wheel"><Real/></ScalarVariable>'),
    (2, '<ScalarVariable valueReference="1"><Real/></ScalarVariable>'),
    (2, real("wheel", inner='<Real start="one"/>')),
    (2, real("wheel", inner='<Integer start="1.0"/>')),
    (2, real("wheel", inner='<Real min="low"/>')),
    (2, real("wheel", inner='<Real derivative="x"/>')),
    (3, float64("wheel", inner='<Dimension start="1000000000"/>')),
    (3, float64("wheel", inner='<Dimension start="100000"/>' * 4)),
    (3, float64("wheel", inner='<Dimension start="-3"/>')),
    (3, float64("wheel", inner='<Dimension start="two"/>')),
    (3, float64("wheel", inner='<Dimension valueReference="7"/>')),
    (3, float64("wheel", inner="<Dimension/>")),
    (
        3,
        '<UInt64 name="n" valueReference="7" causality="structuralParameter" start=" "/>'
        + float64("wheel", inner='<Dimension valueReference="7"/>'),
    ),
)


def test_variables_that_cannot_be_read(tmp_path, refused):
    paths = [
        archive(tmp_path / f"odd{i}.fmu", description(version, variables))
        for i, (version, variables) in enumerate(UNREADABLE_VARIABLES)
    ]
    for message in refused(FmuError, *(partial(Fmu, path) for path in paths)):
        assert "\n" not in message
        assert len(message) < 400


UNREADABLE = (
    description(2, experiment='stepSize="1e999999999"'),
    description(2, experiment='stepSize="1e-99"'),
    description(3, experiment='stepSize="1e99"'),
    description(2, experiment=f'stepSize="{"1" * 5000}"'),
    description(2, experiment='stepSize="0.1" tolerance="small"'),
    description(2, identifier=""),
    description(2, identifier="../../../evil"),
    description(2, more='<UnitDefinitions><Unit name="N"><BaseUnit kg="a"/></Unit></UnitDefinitions>'),
    description(2, structure='<Outputs><Unknown index="9"/></Outputs>'),
    description(3, structure='<Output valueReference="1" dependencies="77"/>'),
    description(3, structure="<Output/>"),
    b'<!DOCTYPE a [<!ENTITY b "&c;">]>' + description(2).split(b"\n", 1)[1],
    ('<!DOCTYPE a [<!ENTITY b "&c;">]>' + description(2).decode().split("\n", 1)[1]).encode("utf-16"),
    b"<a>" * 300,
    b"",
)


def test_descriptions_that_cannot_be_read(tmp_path, refused):
    paths = [archive(tmp_path / f"odd{i}.fmu", xml) for i, xml in enumerate(UNREADABLE)]
    refused(FmuError, *(partial(Fmu, path) for path in paths))


def test_derivatives_of_arrays_of_different_size(tmp_path, raises):
    variables = float64("x", "0", '<Dimension start="2"/>') + float64(
        "der(x)", "1", '<Dimension start="3"/>', 'derivative="0"'
    )
    structure = '<ContinuousStateDerivative valueReference="1"/>'
    with raises(FmuError):
        Fmu(archive(tmp_path / "a.fmu", description(3, variables, structure=structure)))


def test_what_is_odd_but_harmless_is_read(tmp_path):
    """A step of 0 means none, and a unit without a factor has no conversion.

    Names may end in brackets that are no index.
    """
    unit = '<UnitDefinitions><Unit name="N"><BaseUnit kg="1" factor="0"/></Unit></UnitDefinitions>'
    xml = description(
        2, real("x]", "0") + real("y[a]", "1") + real("z[1]", "2"), experiment='stepSize="0" tolerance="0"', more=unit
    )
    about = Fmu(archive(tmp_path / "a.fmu", xml)).description
    assert about.default_step is None
    assert about.tolerance is None
    assert about.arrays == {"z": ["z[1]"]}


@pytest.mark.parametrize("stop", ["INF", "NaN", "1e300"])
def test_a_stop_time_that_is_no_time_is_ignored(tmp_path, stop):
    path = archive(tmp_path / "a.fmu", description(2, experiment=f'stopTime="{stop}"'))
    with pytest.warns(FmuWarning, match="DefaultExperiment: stopTime is not a time; it is ignored"):
        assert Fmu(path).description.default_stop is None


@pytest.mark.parametrize(
    ("written", "exact"),
    [("0.03333333333333333", "1/30"), ("0.0333333333333333", "1/30"), ("0.001", "1/1000"), ("0.0333", "333/10000")],
)
def test_steps_are_exact(tmp_path, written, exact):
    fmu = Fmu(archive(tmp_path / "a.fmu", description(2, experiment=f'stepSize="{written}"')))
    assert fmu.description.default_step == Fraction(exact)
    assert f'step="{exact}"' in wiring(fmu)


def test_times_that_nobody_means():
    for text in (
        "1e999999999",
        "1e-999999999 ms",
        "1" * 200,
        "1e-20",
        "1e20",
        1e-20,
        1e300,
        Fraction(1, 10**20),
        10**20,
    ):
        with pytest.raises(TimeError, match="step of 'a'"):
            rational(text, "step of 'a'")
    assert rational("0") == rational("0e5") == 0


def test_steps_without_a_practicable_common_divisor(awkward_fmus, raises):
    with System() as system:
        system.add("a", awkward_fmus[2], step="1 s")
        system.add("b", awkward_fmus[2], step=Fraction(10**14 + 1, 10**14) * Fraction(1, 7))
        with raises(TimeError):
            system.run(1000)


def test_values_that_do_not_fit_their_type(awkward_fmus, refused):
    with System() as system:
        component = system.add("a", awkward_fmus[3])
        refused(WiringError, lambda: component.set(trouble=2**31), lambda: component.set(at=10**400))


# ------------------------------------------------------------------------------------------------- archives and sizes


def sized(path, name, size):
    """Let the directory of an archive say that a member has `size` bytes."""
    data = bytearray(path.read_bytes())
    at = data.rindex(name.encode()) - 46  # its entry in the central directory
    assert data[at : at + 4] == b"PK\x01\x02"
    data[at + 24 : at + 28] = size.to_bytes(4, "little")
    path.write_bytes(data)
    return path


def test_a_description_of_many_bytes_is_not_read(tmp_path):
    path = tmp_path / "bomb.fmu"
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as file, file.open("modelDescription.xml", "w") as xml:
        for _ in range(140):
            xml.write(b" " * 2**20)
    with pytest.raises(
        FmuError, match=r"bomb\.fmu: its modelDescription\.xml has 147 MB; .*Limits\(xml_bytes=146800640\)"
    ):
        Fmu(path)
    folder = tmp_path / "folder"
    folder.mkdir()
    with (folder / "modelDescription.xml").open("wb") as xml:
        xml.truncate(140 * 2**20)
    with pytest.raises(FmuError, match="has 147 MB"):
        Fmu(folder)


def test_an_archive_that_would_unpack_to_gigabytes(tmp_path, awkward_fmus):
    path = tmp_path / "bomb.fmu"
    with zipfile.ZipFile(awkward_fmus[2]) as old:
        components = {n: old.read(n) for n in old.namelist()}
    binary = components.pop(Fmu(awkward_fmus[2]).binary)
    archive(path, components["modelDescription.xml"], binary=binary, **{"resources/zeros": b"0"})
    system = System()
    system.add("a", sized(path, "resources/zeros", 2**32 - 2))
    with pytest.raises(FmuError, match=r"bomb\.fmu .* 4,29\d MB, .*Limits\(unpacked_bytes=4\d+\)"):
        system.run(0.1)


def test_an_archive_larger_than_the_disk(awkward_fmus, monkeypatch):
    monkeypatch.setattr("shutil.disk_usage", lambda _: type("Usage", (), {"free": 1000}))
    system = System()
    system.add("a", awkward_fmus[2])
    with pytest.raises(FmuError, match=r"cannot unpack .*awkward2\.fmu: it needs 0 MB, and .* has 0 MB free"):
        system.run(0.1)


@pytest.mark.parametrize("name", ["../outside.txt", "a/../../outside.txt", "/outside.txt", "C:/outside.txt"])
def test_names_that_lead_out_of_the_archive(tmp_path, name, raises):
    path = archive(tmp_path / "a.fmu", description(2), binary=library(2, tmp_path), **{name: b"x"})
    system = System()
    system.add("a", path)
    with raises(FmuError):
        system.run(0.1)


def test_encrypted_and_unknown_contents(tmp_path):
    plain = archive(tmp_path / "plain.fmu", description(2)).read_bytes()
    local, central = plain.index(b"PK\x03\x04"), plain.index(b"PK\x01\x02")
    for offsets, value in (((6, 8), 1), ((8, 10), 97)):  # flags: encrypted; method: unknown
        data = bytearray(plain)
        data[local + offsets[0]], data[central + offsets[1]] = value, value
        path = tmp_path / "odd.fmu"
        path.write_bytes(data)
        with pytest.raises(FmuError, match=r"odd\.fmu"):
            Fmu(path)


def test_every_damaged_byte_gives_a_sentence(tmp_path):
    """One byte after the other is flipped in an archive's description and directory."""
    whole = archive(tmp_path / "small.fmu", zlib.compress(b"x") + description(2)[:200]).read_bytes()
    path = tmp_path / "flipped.fmu"
    for at in range(len(whole)):
        data = bytearray(whole)
        data[at] ^= 0xFF
        path.write_bytes(data)
        with pytest.raises(FmuError, match=r"flipped\.fmu"):
            Fmu(path)


def test_files_are_those_of_the_unpacked_folder(tmp_path, awkward_fmus, raises):
    path, folder = tmp_path / "one.fmu", tmp_path / "unpacked"
    path.write_bytes(awkward_fmus[3].read_bytes())
    with zipfile.ZipFile(path) as z:
        z.extractall(folder)
    fmu = Fmu(path)
    files = fmu.files()
    assert files["modelDescription.xml"] == (folder / "modelDescription.xml").read_bytes()
    assert Fmu(folder).files() == files
    assert fmu.files("binaries/") == {
        n.removeprefix("binaries/"): d for n, d in files.items() if n.startswith("binaries/")
    }
    path.write_bytes(path.read_bytes()[:-30])
    with raises(FmuError):
        fmu.files()


def test_names_too_long_for_a_file(raises):
    with raises(FmuError):
        Fmu("a" * 300 + ".fmu")


# ---------------------------------------------------------------------------------------------------------- libraries


@VERSIONS
def test_a_library_without_do_step(tmp_path, version, raises):
    binary = library(version, tmp_path, "WITHOUT_DO_STEP")
    system = System()
    system.add("a", archive(tmp_path / "a.fmu", description(version), binary=binary))
    with raises(FmuError, match=f"fmi{version}DoStep"):
        system.run(0.1)


def test_a_function_that_is_missing_when_it_is_called(tmp_path, raises):
    """No FMU needs all functions; which one was called and is not there is said."""
    xml = description(2, real("s", "0", '<String start="a"/>', 'causality="parameter" variability="fixed"'))
    system = System()
    system.add("a", archive(tmp_path / "a.fmu", xml, binary=library(2, tmp_path)), parameters={"s": "b"})
    with raises(FmuError):
        system.run(0.1)


@pytest.mark.skipif(sys.platform != "linux", reason="other loaders check this themselves")
def test_part_of_a_library(tmp_path):
    """In a process of its own: loading half a library ends it with SIGBUS, not with an exception."""
    whole = library(2, tmp_path)
    for part in (1, 3, 5, 7):
        path = archive(tmp_path / f"part{part}.fmu", description(2), binary=whole[: len(whole) * part // 10])
        code = (
            "import sys, cosim\nsystem = cosim.System()\nsystem.add('a', sys.argv[1])\n"
            "try:\n    system.run(0.1)\nexcept cosim.FmuError as error:\n    print(error)\n"
        )
        done = subprocess.run([sys.executable, "-c", code, path], capture_output=True, text=True, check=False)
        assert done.returncode == 0, done
        assert f"part{part}.fmu: its library cannot be loaded: Awkward.so is cut short" in done.stdout
    for junk in (b"", b"\x7fELF", b"\x7fELF" + b"\xff" * 60, whole[:70]):
        system = System()
        system.add("a", archive(tmp_path / "junk.fmu", description(2), binary=junk))
        with pytest.raises(FmuError, match=r"junk\.fmu"):
            system.run(0.1)


@VERSIONS
def test_platforms_are_those_whose_library_is_there(tmp_path, version):
    others = {
        "binaries/win64/Awkward.dll": b"",
        "binaries/darwin64/": b"",
        "binaries/x86_64-darwin/readme.txt": b"",
        "binaries/linux32/libother.so": b"",
    }
    path = archive(tmp_path / "a.fmu", description(version), binary=library(version, tmp_path), **others)
    here = platform_folder(str(version))[0]
    assert Fmu(path).platforms() == sorted([here, "win64"])
    folder = tmp_path / "folder"
    with zipfile.ZipFile(path) as file:
        file.extractall(folder)
    assert Fmu(folder).platforms() == sorted([here, "win64"])


def libraries_of(folder):
    """Libraries below a folder that this process has mapped."""
    return [line for line in Path("/proc/self/maps").read_text().splitlines() if str(folder) in line]


@pytest.mark.skipif(sys.platform != "linux", reason="reads /proc")
@VERSIONS
@pytest.mark.parametrize("once", ["", 'canBeInstantiatedOnlyOncePerProcess="true"'])
def test_libraries_and_folders_go_with_the_last_system(tmp_path, monkeypatch, version, once):
    folder = tmp_path / "unpacked"
    folder.mkdir()
    monkeypatch.setattr(tempfile, "tempdir", str(folder))
    path = archive(tmp_path / "a.fmu", description(version, simulation=once), binary=library(version, tmp_path))
    shared = Fmu(path)
    first, second = System(), System()
    for system in (first, second):
        system.add("own", path)
        system.add("shared", shared)
        system.run(0.2)
    (own,) = folder.iterdir()  # of this process
    assert len(list(own.iterdir())) == (4 if once else 3)
    first.close()
    first.close()
    assert len(list(own.iterdir())) == 2
    assert second.run(0.2)["shared.y"][-1] == pytest.approx(0.2)
    second.close()
    assert not libraries_of(folder)
    with System() as third:  # a library that was closed is opened again
        third.add("shared", shared)
        assert third.run(0.2)["shared.y"][-1] == pytest.approx(0.2)
        assert libraries_of(folder)
    shared.close()
    assert not libraries_of(folder)
    assert not list(own.iterdir())


# ------------------------------------------------------------------------------------------------------ ready to paste


HOSTILE = 'x"); import os; os.abort(); ("'


@VERSIONS
def test_what_is_ready_to_paste_is_python_whatever_the_names_are(tmp_path, version):
    name = HOSTILE.replace('"', "&quot;")
    make = real if version == 2 else float64
    variables = make(name, "0", more='causality="input"') + make("a&#10;b\\", "1", more='causality="output"')
    path = archive(tmp_path / f"{HOSTILE.replace('/', '')}.fmu", description(version, variables, name=f"a.{name}"))
    tree = ast.parse(wiring(path))
    calls = [node.func.attr for node in ast.walk(tree) if isinstance(node, ast.Call)]
    assert calls == ["add", "connect", "run"]
    texts = [node.value for node in ast.walk(tree) if isinstance(node, ast.Constant)]
    assert f"OTHER.{HOSTILE}" in texts
    assert str(path) in texts
    assert any(str(t).endswith(".a\nb\\") for t in texts)


def test_what_is_ready_to_paste_runs(awkward_fmus):
    with System() as system:
        code = wiring(awkward_fmus[2]).replace("system.connect", "#")
        names = {"system": system}
        exec(code, names)
        assert names["recording"]["awkward.y"][-1] == pytest.approx(5.0)


@pytest.mark.skipif(sys.platform == "win32", reason="has no pseudo-terminals")
@pytest.mark.parametrize("columns", ["20", "80", "300"])
def test_the_command_prints_it_in_lines_of_any_length(tmp_path, columns):
    """`cosim fmu` in a terminal of any width: the block after "ready to paste" is the code."""
    import pty

    long = archive(tmp_path / f"{'long' * 40}.fmu", description(2, name="M"), binary=library(2, tmp_path))
    environment = {"PATH": "/usr/bin", "COLUMNS": columns, "TERM": "dumb", "PYTHONPATH": str(Path(__file__).parents[2])}
    ours, theirs = pty.openpty()
    command = [sys.executable, "-c", "from cosim.cli import main; main()", "fmu", long]
    process = subprocess.Popen(command, stdout=theirs, stderr=subprocess.STDOUT, env=environment)
    os.close(theirs)
    shown = b""
    with contextlib.suppress(OSError):  # EIO: the terminal's other end is closed
        while part := os.read(ours, 4096):
            shown += part
    os.close(ours)
    assert process.wait() == 0, shown
    code = shown.decode().replace("\r\n", "\n").split("ready to paste:\n")[1].rstrip("\n")
    assert code == wiring(long)


def test_a_tool_that_is_needed_is_shown(tmp_path):
    path = archive(tmp_path / "a.fmu", description(2, simulation='needsExecutionTool="true"'))
    for fmu, shown in ((path, True), (archive(tmp_path / "b.fmu", description(2)), False)):
        console = Console(width=100)
        with console.capture() as captured:
            console.print(describe(fmu))
        assert ("needsExecutionTool" in captured.get()) is shown


def test_sources_are_shown_where_there_are_any(tmp_path):
    """As they are: no markup of the terminal's."""
    said = '<Component kind="continuous"><Variable name="value" source="[bold]Table 2[/bold]"/></Component>'
    more = f'<VendorAnnotations><Tool name="suspension-fmus">{said}</Tool></VendorAnnotations>'
    lines = {}
    for name, annotation in (("a", more), ("b", "")):
        console = Console(width=150)
        with console.capture() as captured:
            console.print(describe(archive(tmp_path / f"{name}.fmu", description(2, more=annotation))))
        lines[name] = captured.get()
    assert re.search(r"^ *value .*Real.* \[bold\]Table 2\[/bold\] *$", lines["a"], re.MULTILINE)
    assert lines["a"].count("source") == 1  # at the parameters alone
    assert "source" not in lines["b"]
