"""What is in the archive: descriptions, documentation, sources, icon."""

from __future__ import annotations

import hashlib
import json
import re
import zipfile
from collections.abc import Callable
from pathlib import Path

import binaries
import lark
import pytest
from api import OK, Library, Model
from applies import applies_to
from fmpy.validation import validate_fmu
from lxml import etree

from build_fmus.base import units
from build_fmus.compile import PLATFORMS, find_toolchain, host
from build_fmus.generate import RUNTIME_DIR
from cosim.check import layered
from cosim.core.terminals import by_names, by_path
from cosim.fmu.file import FmuFile
from cosim.fmu.validation import Verdict

PNG = b"\x89PNG\r\n\x1a\n"
MATHEMATICS = {
    f"{n}{suffix}"
    for n in re.findall(r"^#define (\w+)\(", (RUNTIME_DIR / "fmu_math.h").read_text(), re.MULTILINE)
    for suffix in ("", "f", "l")
} | {"sqrt", "sincos", "round", "trunc", "rint", "exp2", "log2", "log10", "cbrt"}


PARSE = lark.Lark.parse
"""By which FMPy judges names: seconds for the variables of a large FMU."""
PARSED: set[tuple[str, str]] = set()
"""Grammar and name that it has accepted; most names are those of many FMUs."""


def parse_once(self: lark.Lark, name: str) -> None:
    if (self.source_grammar, name) not in PARSED:
        PARSE(self, name)
        PARSED.add((self.source_grammar, name))


def test_validates_without_finding(fmu: Library, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(lark.Lark, "parse", parse_once)
    assert validate_fmu(str(fmu.path)) == []
    assert FmuFile(fmu.path, strict=True).verdict == Verdict()


def test_further_descriptions_are_there(fmu: Library) -> None:
    """That these conform to their schemas is for `cosim check` to find (test_compliance)."""
    expected = {"modelDescription.xml", "fmi-ls-manifest.xml"}
    if fmu.fmi == 3:
        expected |= {"buildDescription.xml", "terminalsAndIcons.xml"}
    assert {p.name for p in fmu.folder.rglob("*.xml")} == expected


def test_sources_are_complete(fmu: Library) -> None:
    if fmu.fmi == 2:
        listed = [e.get("name") for e in fmu.xml.findall("CoSimulation/SourceFiles/File")]
        for interface in fmu.xml.findall("ModelExchange"):
            assert [e.get("name") for e in interface.findall("SourceFiles/File")] == listed
    else:
        first, *others = etree.parse(fmu.folder / "sources" / "buildDescription.xml").iterfind("BuildConfiguration")
        listed = [e.get("name") for e in first.iter("SourceFile")]
        for configuration in others:
            assert [e.get("name") for e in configuration.iter("SourceFile")] == listed
    assert listed == [*dict.fromkeys(listed)]
    sources = fmu.folder / "sources"
    assert set(listed) == {p.relative_to(sources).as_posix() for p in sources.rglob("*.c")}
    for path in (p for p in sources.iterdir() if p.is_file()):  # folders hold solvers of others
        for header in re.findall(r'^ *#include "(.*)"', path.read_text(), re.MULTILINE):
            assert (sources / header).is_file()


def test_build_options_are_for_compilers_that_know_them(name: str, load: Callable[[str, int], Library]) -> None:
    """One configuration without a platform, first, for any compiler.

    At most one for each platform (FMI 3.0, 2.5.1.4.1).
    """
    description = etree.parse(load(name, 3).folder / "sources" / "buildDescription.xml")
    configurations = list(description.iterfind("BuildConfiguration"))
    platforms = [c.get("platform") for c in configurations]
    assert platforms[0] is None
    assert len(platforms) == len(set(platforms))
    assert set(platforms[1:]) <= set(PLATFORMS)
    for configuration in configurations:
        (files,) = configuration.iterfind("SourceFileSet")
        assert (files.get("compiler") is None) == (files.get("compilerOptions") is None)
        if (platform := configuration.get("platform")) is None or platform.endswith("windows"):
            assert files.get("compilerOptions") is None
        else:
            assert files.get("compiler") in ("gcc", "clang")
            assert "-ffp-contract=off" in files.get("compilerOptions").split()


def test_documentation_and_icon(fmu: Library) -> None:
    page = fmu.folder / "documentation" / "index.html"
    parser = etree.HTMLParser(recover=False)
    tree = etree.fromstring(page.read_bytes(), parser)
    assert not [e for e in parser.error_log if e.type_name != "HTML_UNKNOWN_TAG"]
    text = "".join(tree.itertext())
    for name in fmu.inputs + fmu.outputs + fmu.names("parameter"):
        assert re.sub(r"\[[\d,]+\]$", "", name) in text
    icon = "model.png" if fmu.fmi == 2 else "terminalsAndIcons/icon.png"
    assert (fmu.folder / icon).read_bytes().startswith(PNG)


# What a text under a license contains at least, by SPDX identifier
LICENSES = {
    "BSD-2-Clause": (
        "Copyright (C) 2008-2011 MODELISAR",
        "Redistributions in binary form must reproduce the above copyright",
    ),
    "BSD-3-Clause": ("Copyright (c)", "3. Neither the name of the copyright holder"),
    "MIT-0": ("MIT No Attribution", "Copyright (C) 2010-2023 Joel Andersson", "Permission is hereby granted"),
    "MIT": ("Copyright", "Permission is hereby granted", 'THE SOFTWARE IS PROVIDED "AS IS"'),
    "Apache-2.0": ("Apache License", "Version 2.0", "END OF TERMS AND CONDITIONS"),
    "ZPL-2.1": ("Copyright (c)", "Redistributions in binary form"),
}


def test_every_file_by_others_has_its_license(fmu: Library) -> None:
    """Files that are neither of our runtime nor generated are listed with a license whose text is there.

    Nothing else is listed.
    """
    folder = fmu.folder / "documentation" / "licenses"
    entry = (folder / "license.txt").read_text()
    own, *parts = re.split(r"^(?=\S.*, [\w.-]+: \S+\.txt$)", entry, flags=re.MULTILINE)
    assert all(x in own for x in LICENSES["BSD-3-Clause"])
    listed: list[str] = []
    texts = {"license.txt"}
    for part in parts:
        license, text = re.search(r", ([\w.-]+): (\S+\.txt)$", part, re.MULTILINE).groups()
        content = (folder / text).read_text()
        assert all(x in content for x in LICENSES[license]), f"{text} is not {license}"
        texts.add(text)
        listed += re.findall(r"^    ((?:sources|binaries)/\S+)$", part, re.MULTILINE)
    assert {p.name for p in folder.iterdir()} == texts
    assert len(listed) == len(set(listed))
    files = {p.relative_to(fmu.folder).as_posix(): p for p in (fmu.folder / "sources").rglob("*") if p.is_file()}
    runtime = {f"sources/{p.name}" for p in RUNTIME_DIR.iterdir() if p.is_file()}
    generated = {f"sources/{n}" for n in ("model.c", "lanes.json", "qp_data.c", "buildDescription.xml")}
    helpers = {"sources/model.c"} & set(listed) if any(p.startswith("CasADi helpers") for p in parts) else set()
    assert {n for n in files if n not in runtime | generated} == set(listed) - helpers
    for name in files.keys() & runtime:
        assert files[name].read_bytes() == (RUNTIME_DIR / files[name].name).read_bytes()


def test_archive_is_reproducible_by_construction(fmu: Library) -> None:
    with zipfile.ZipFile(fmu.path) as z:
        entries = z.infolist()
    assert [e.filename for e in entries] == sorted(e.filename for e in entries)
    assert {e.date_time for e in entries} == {(1980, 1, 1, 0, 0, 0)}


def test_units_are_defined_by_base_units(fmu: Library) -> None:
    defined = {e.get("name"): e for e in fmu.xml.iterfind("UnitDefinitions/Unit")}
    for v in fmu.variables.values():
        assert v.unit is None or v.unit in defined
    for name, element in defined.items():
        base = element.find("BaseUnit")
        exponents = {k: int(x) for k, x in base.attrib.items() if k not in ("factor", "offset")}
        assert exponents == units.unit(name).powers
        assert exponents or name in ("1",)


def test_default_experiment_and_log_categories(fmu: Library) -> None:
    experiment = fmu.xml.find("DefaultExperiment")
    start, stop, step = (float(experiment.get(k)) for k in ("startTime", "stopTime", "stepSize"))
    assert start == 0 < step < stop
    categories = {e.get("name") for e in fmu.xml.iterfind("LogCategories/Category")}
    assert categories == {"logEvents", "logStatusWarning", "logStatusDiscard", "logStatusError", "logStatusFatal"}


def test_capabilities(fmu: Library) -> None:
    interfaces = {e.tag: e for tag in ("ModelExchange", "CoSimulation") for e in fmu.xml.iterfind(tag)}
    assert set(interfaces) == ({"ModelExchange", "CoSimulation"} if fmu.is_continuous else {"CoSimulation"})
    state = "FMUstate" if fmu.fmi == 2 else "FMUState"
    derivatives = "providesDirectionalDerivative" + ("s" if fmu.fmi == 3 else "")
    for e in interfaces.values():
        assert e.get(f"canGetAndSet{state}") == e.get(f"canSerialize{state}") == "true"
        assert e.get(derivatives, "false") == str(fmu.is_continuous).lower()
    assert interfaces["CoSimulation"].get("canHandleVariableCommunicationStepSize") == "true"


def test_names_are_structured_and_the_same_in_both_versions(pair: tuple[Library, Library]) -> None:
    two, three = pair
    assert two.order == three.order
    assert {f.xml.get("variableNamingConvention") for f in pair} == {"structured"}
    for name in two.order:
        a, b = two.variables[name], three.variables[name]
        assert "'" not in name
        assert (a.causality, a.variability, a.initial, a.unit, a.low, a.high) == (
            b.causality,
            b.variability,
            b.initial,
            b.unit,
            b.low,
            b.high,
        )
        assert a.start_value == b.start_value
    assert two.structure("Output") == three.structure("Output")
    assert two.structure("Derivative") == three.structure("Derivative")
    assert two.structure("InitialUnknown") == three.structure("InitialUnknown")


def test_dependencies_name_only_what_the_standard_allows(fmu: Library) -> None:
    knowns = {*fmu.inputs, *fmu.states}  # not time, which FMI allows: OMSimulator refuses FMUs of FMI 3.0 that list it
    for unknowns in (fmu.structure("Output"), fmu.structure("Derivative")):
        for depends in unknowns.values():
            assert set(depends) <= knowns
            assert [fmu.order.index(d) for d in depends] == sorted(fmu.order.index(d) for d in depends)
    exact = {v.name for v in fmu.variables.values() if v.initial == "exact"}
    for depends in fmu.structure("InitialUnknown").values():
        assert set(depends) <= {*fmu.inputs, *exact}


def independent(fmu: Model) -> bool:
    """Whether an output says that it does not depend on an input."""
    return any(set(fmu.inputs) - set(depends) for depends in fmu.structure("Output").values())


@applies_to(independent)
def test_dependencies_are_real(fmu: Library) -> None:
    """An output moves at a sample or evaluation with an input only if it says that it depends on it."""
    outputs = fmu.structure("Output")
    with fmu.instance() as a:
        a.initialize(fmu.stimulus.row(0))
        a.run(3)
        state = a.save()

        def after(values: dict[str, float]) -> dict[str, float]:
            a.restore(state)
            a.set(values)
            if not fmu.is_continuous:
                assert a.do_step(3 * fmu.step, fmu.step) == OK
            return dict(zip(fmu.outputs, a.get(fmu.outputs), strict=True))

        base_inputs = fmu.stimulus.row(3)
        base = after(base_inputs)
        for name in fmu.inputs:
            v = fmu.variables[name]
            value = 1 - base_inputs[name] if v.kind == "boolean" else base_inputs[name] + 1
            if not (v.low is None or value >= v.low) or not (v.high is None or value <= v.high):
                value = base_inputs[name] - 1
            if (v.low is not None and value < v.low) or (v.high is not None and value > v.high):
                continue
            moved = after({**base_inputs, name: value})
            for output, depends in outputs.items():
                if name not in depends:
                    assert moved[output] == base[output], f"{output} moves with {name}"
        a.free_state(state)


def test_terminals_hold_every_signal_once_under_its_name(pair: tuple[Library, Library]) -> None:
    """`road.fl.height` is the member `height` of `road`, `fl`.

    What is read from the file is what names alone say (of FMI 2.0).
    """
    fmu = pair[1]
    tree = etree.parse(fmu.folder / "terminalsAndIcons" / "terminalsAndIcons.xml")
    members = list(tree.iterfind(".//TerminalMemberVariable"))
    assert sorted(m.get("variableName") for m in members) == sorted(fmu.inputs + fmu.outputs)
    for member in members:
        around = [t.get("name") for t in reversed([*member.iterancestors("Terminal")])]
        name, own = member.get("variableName"), member.get("memberName")
        if "[" in name:
            own = re.sub(r".*\[", "[", own)
        assert name in (".".join(around) + own, ".".join([*around, own]), own)
    files = [FmuFile(f.path) for f in pair]
    assert files[0].terminals == ()
    declared, named = (
        {t.path: (t.rule, set(t.members)) for t in by_path(terminals).values()}
        for terminals in (files[1].terminals, by_names(files[0].description))
    )
    assert declared == named


SYSTEM_LIBRARIES = {"libc.so.6", "libdl.so.2", "/usr/lib/libSystem.B.dylib"}
"""Of glibc (libdl, of which systems with FMUs of others need dlopen, is empty from 2.34 on) and of macOS."""


def test_binaries_run_on_old_systems_and_share_nothing(fmu: Library) -> None:
    """FMI functions are all that is exported.

    No mathematical library is called, and no symbol is younger than glibc 2.17.
    """
    files = [p for p in (fmu.folder / "binaries").rglob("*") if p.is_file()]
    assert files
    header = (fmu.folder / "sources" / f"fmi{fmu.fmi}Functions.h").read_text()
    declared = set(re.findall(rf"^#define (fmi{fmu.fmi}[A-Z]\w+) +fmi{fmu.fmi}FullName\(", header, re.MULTILINE))
    assert len(declared) > 40
    for file in files:
        binary = binaries.read(file.read_bytes())
        assert binary.exported == declared
        assert binary.glibc <= (2, 17)
        assert binary.libraries <= SYSTEM_LIBRARIES or file.suffix == ".dll"
        assert not binary.imported & MATHEMATICS


def related_files(fmu: Library) -> dict[str, list[Path]]:
    """What the manifest of FMI-LS-REF names, by role."""
    base = fmu.folder / "extra" / "org.fmi-standard.fmi-ls-ref"
    manifest = etree.parse(base / "fmi-ls-manifest.xml").getroot()
    assert layered._attribute(manifest, "version") == layered.SCHEMAS[base.name][1]
    by_role: dict[str, list[Path]] = {}
    for related in manifest:
        path = (base / related.get("source")).resolve()
        assert path.is_file()
        by_role.setdefault(related.get("role"), []).append(path)
    return by_role


def test_related_files_are_there(fmu: Library) -> None:
    assert any(p.name.endswith(".cdx.json") for p in related_files(fmu)["meta-data"])


def test_other_validators_find_the_reference_result(fmu: Library) -> None:
    """FMI-LS-REF: the experiment is that of the documentation."""
    by_role = related_files(fmu)
    documentation = fmu.folder.resolve() / "documentation"
    assert by_role["result"] == [documentation / f"{fmu.name}_ref.csv"]
    (path,) = by_role["experiment/smoke-test"]
    (experiment,) = etree.parse(path).getroot()
    times = experiment.find("TransientSimulation")
    stop, step = float(times.get("stopTime")), float(times.get("stepSize"))
    assert float(times.get("startTime")) == 0.0
    assert step == pytest.approx(fmu.step, rel=1e-12)
    assert round(stop / step) == len(fmu.stimulus.time) - 1
    sources = {e.tag: (path.parent / e.get("source")).resolve() for e in experiment if e is not times}
    assert sources.pop("References") == documentation / f"{fmu.name}_ref.csv"
    assert sources == ({"Stimuli": documentation / f"{fmu.name}_in.csv"} if fmu.stimulus.names else {})


def test_bill_of_materials(fmu: Library) -> None:
    """CycloneDX: judged by its own library; it lists what the licenses list, and the binary with its compiler."""
    from cyclonedx.schema import SchemaVersion
    from cyclonedx.validation.json import JsonStrictValidator  # reads grammars for seconds, also where no test needs it

    text = (fmu.folder / "extra" / "org.fmi-standard.fmi-ls-ref" / "bill-of-materials.cdx.json").read_text()
    assert JsonStrictValidator(SchemaVersion.V1_6).validate_str(text) is None
    bill = json.loads(text)
    libraries = {c["name"]: c for c in bill["components"] if c["type"] == "library" and not c["name"].endswith(".fmu")}
    licenses = fmu.folder / "documentation" / "licenses"
    assert {n.replace(" ", "-") for n in libraries} - {"suspension-fmus"} == {
        p.stem for p in licenses.iterdir() if p.is_file() and p.name != "license.txt"
    }
    entry = (licenses / "license.txt").read_text()
    for name, library in libraries.items():
        (license,) = library["licenses"]
        assert license["license"]["id"] in entry
        assert name == "suspension-fmus" or f"{name} {library.get('version', library.get('description'))}, " in entry
    files = [f for c in libraries.values() for f in c.get("components", [])]
    binaries = [c for c in bill["components"] if c["type"] == "file"]
    for file in files + binaries:
        (digest,) = file["hashes"]
        assert hashlib.sha256((fmu.folder / file["name"]).read_bytes()).hexdigest() == digest["content"]
    assert {b["name"] for b in binaries} == {
        p.relative_to(fmu.folder).as_posix() for p in (fmu.folder / "binaries").rglob("*") if p.is_file()
    }
    for binary in binaries:
        about = {p["name"].rpartition(":")[2]: p["value"] for p in binary["properties"]}
        assert about["compiler"] == find_toolchain(host()).version
        assert "-ffp-contract=off" in about["flags"].split()
