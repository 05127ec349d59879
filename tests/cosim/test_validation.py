"""The gate at opening: what is refused, what is warned of, what is a known quirk of its tool, and what that costs."""

import os
import re
import sys
import warnings
import zipfile

import pytest
from awkward import archive, description
from rich.console import Console

from build_fmus.base.safe_files import DamagedWarning
from cosim import Fmu, FmuError, FmuWarning, Limits, System, describe
from cosim.fmu import validation
from cosim.fmu.model_description import parse

VERSIONS = pytest.mark.parametrize("version", [2, 3])
OUTPUT = {2: '<Outputs><Unknown index="{0}" {1}/></Outputs>', 3: '<Output valueReference="{0}" {1}/>'}


def variable(version, name, reference, attributes="", inner="", kind="Real"):
    """A variable on a line of its own.

    `attributes` of the value stand where the version has them, `inner` says what it is.
    """
    if version == 2:
        return (
            f'\n<ScalarVariable name="{name}" valueReference="{reference}" {inner}><{kind}'
            f" {attributes}/></ScalarVariable>"
        )
    kind = {"Real": "Float64", "Integer": "Int32"}.get(kind, kind)
    return f'\n<{kind} name="{name}" valueReference="{reference}" {inner} {attributes}/>'


def xml(version, variables, structure="", *, tool="", more="", head=""):
    """A description that follows the schema, with what is given."""
    text = description(version, variables, experiment='stepSize="0.1"', more=more, structure=structure).decode()
    return text.replace("<fmiModelDescription ", f'<fmiModelDescription generationTool="{tool}" {head} ').encode()


def input_(version, reference="0", name="u"):
    return variable(version, name, reference, 'start="0"', 'causality="input"')


def findings(path):
    return [str(f) for f in Fmu(path, quiet=True).verdict.findings]


# ------------------------------------------------------------------------------------------------------------- warned


@VERSIONS
@pytest.mark.parametrize(
    ("attributes", "words"),
    [
        ('min="2" max="1"', "min is 2 and max is 1"),
        ('min="0" max="1" start="1.5"', "start is 1.5, outside of its range 0 to 1"),
        ('start="-1" min="0"', "start is -1, outside of its range 0 to inf"),
        ('declaredType="Length"', "type 'Length' is not among the TypeDefinitions"),
        ('nominal="INF"', "nominal is inf; 1 is used"),
        ('nominal="NaN"', "nominal is nan; 1 is used"),
        ('nominal="0"', "nominal is 0; 1 is used"),
        ('nominal="-20"', "nominal is -20; 20 is used"),
        ('unit="furlong"', "unit 'furlong' is not among the UnitDefinitions"),
        ('colour="red"', "attribute 'colour': The attribute 'colour' is not allowed"),
    ],
)
def test_values_that_contradict_each_other(tmp_path, version, attributes, words, refused):
    path = archive(tmp_path / "odd.fmu", xml(version, input_(version) + variable(version, "wheel", "1", attributes)))
    with pytest.warns(
        FmuWarning, match=rf"odd\.fmu: modelDescription\.xml deviates from FMI {version}\.0: line 4: variable 'wheel': "
    ) as told:
        Fmu(path)
    assert words in str(told[0].message)
    assert len(told) == 1
    refused(FmuError, lambda: Fmu(path, strict=True), lambda: System().add("a", path, strict=True))


def length(version, nominal):
    """The definition of a type with a nominal value, on a line of its own."""
    element = (
        f'<SimpleType name="Length"><Real nominal="{nominal}"/></SimpleType>'
        if version == 2
        else f'<Float64Type name="Length" nominal="{nominal}"/>'
    )
    return f"\n<TypeDefinitions>{element}</TypeDefinitions>"


@VERSIONS
@pytest.mark.parametrize(("nominal", "used"), [("INF", 1.0), ("NaN", 1.0), ("0", 1.0), ("-20", 20.0), ("20", 20.0)])
def test_the_nominal_value_of_a_type_is_looked_at(tmp_path, version, nominal, used):
    wheel = variable(version, "wheel", "0", 'declaredType="Length"')
    text = xml(version, wheel, more=length(version, nominal))
    expected = f"line 3: type 'Length': nominal is {float(nominal):g}; {used:g} is used"
    assert findings(archive(tmp_path / "typed.fmu", text)) == [expected] * (nominal != "20")
    assert parse(text, "typed.fmu", Limits()).variables["wheel"].nominal == used


@VERSIONS
def test_a_nominal_value_of_a_type_that_is_no_number_is_told_once(tmp_path, version):
    text = xml(version, variable(version, "wheel", "0"), more=length(version, "large"))
    (told,) = findings(archive(tmp_path / "typed.fmu", text))
    assert "'large' is not a valid value" in told


@VERSIONS
def test_findings_come_in_one_warning(tmp_path, version, warns):
    many = "".join(variable(version, f"x{i}", i, 'min="2" max="1"') for i in range(300))
    path = archive(tmp_path / "many.fmu", xml(version, many))
    with warns(FmuWarning) as told:
        verdict = Fmu(path).verdict
    assert len(told) == 1
    assert (len(verdict.findings), verdict.more_findings) == (validation.MOST, 300 - validation.MOST)


@VERSIONS
def test_outputs_that_depend_on_themselves(tmp_path, version):
    both = (
        input_(version)
        + variable(version, "y", "1", "", 'causality="output"')
        + variable(version, "z", "2", "", 'causality="output"')
    )
    y, z, first = ("2", "3", "1") if version == 2 else ("1", "2", "0")
    entry = (
        '<Unknown index="{}" dependencies="{}"/>' if version == 2 else '<Output valueReference="{}" dependencies="{}"/>'
    )

    def told(*pairs):
        listed = "".join(entry.format(*pair) for pair in pairs)
        return findings(
            archive(tmp_path / "a.fmu", xml(version, both, f"<Outputs>{listed}</Outputs>" if version == 2 else listed))
        )

    assert told((y, first), (z, first)) == []
    assert told((y, first), (z, y)) == []
    assert [t.split(": ", 1)[1] for t in told((y, y), (z, first))] == ["output 'y' depends on itself: y -> y"]
    assert [t.split(": ", 1)[1] for t in told((y, z), (z, y))] == ["output 'y' depends on itself: y -> z -> y"]


def test_an_output_that_is_a_state_may_depend_on_itself(tmp_path):
    variables = variable(3, "x", "1", 'start="0"', 'causality="output" initial="exact"') + variable(
        3, "der(x)", "2", 'derivative="1"'
    )
    structure = '<Output valueReference="1" dependencies="1"/><ContinuousStateDerivative valueReference="2"/>'
    assert findings(archive(tmp_path / "a.fmu", xml(3, variables, structure))) == []


@VERSIONS
def test_lists_of_outputs(tmp_path, version):
    variables = input_(version) + variable(version, "y", "1", "", 'causality="output"')
    path = archive(tmp_path / "a.fmu", xml(version, variables, OUTPUT[version].format(1 if version == 2 else 0, "")))
    assert sorted(f.split(": ", 1)[1] for f in findings(path)) == [
        "'u' is listed as an output in ModelStructure, but has another causality",
        "output 'y' is not in ModelStructure; it is taken to depend on all inputs",
    ]


@pytest.mark.parametrize(
    ("kind", "inner", "words"),
    [
        ("Integer", 'causality="input"', "an Integer is continuous, which only Real may be"),
        ("Real", 'causality="parameter" variability="fixed"', "a parameter has no start value"),
        (
            "Real",
            'causality="calculatedParameter" variability="fixed" initial="approx"',
            "a calculatedParameter has no start value",
        ),
    ],
)
def test_what_fmi_2_wants_to_be_said(tmp_path, kind, inner, words):
    path = archive(tmp_path / "a.fmu", xml(2, variable(2, "n", "0", "", inner, kind)))
    assert f"line 3: variable 'n': {words}" in findings(path)


def test_inputs_that_share_a_place(tmp_path):
    path = archive(tmp_path / "a.fmu", xml(2, input_(2, "5", "u") + input_(2, "5", "v")))
    assert findings(path) == [
        "line 4: variable 'v': it shares the value reference of 'u'; both have the value that is set last"
    ]


def test_aliases_of_fmi_2_are_legal(tmp_path):
    """Outputs of the same type with the same reference, and the same reference for another type."""
    variables = (
        input_(2, "7")
        + variable(2, "a", "7", "", 'causality="local"')
        + variable(2, "b", "7", "", 'causality="local"')
        + variable(2, "n", "7", 'start="1"', 'causality="input" variability="discrete"', "Integer")
    )
    assert findings(archive(tmp_path / "a.fmu", xml(2, variables))) == []


# ------------------------------------------------------------------------------------------------------------ refused


@VERSIONS
def test_names_that_are_not_unique(tmp_path, version, raises):
    path = archive(tmp_path / "two.fmu", xml(version, input_(version) + input_(version, "9")))
    with raises(FmuError):
        Fmu(path)


@pytest.mark.parametrize(
    "variables",
    [
        '<Float64 name="a" valueReference="1"/>\n<Float64 name="b" valueReference="1"/>',
        (
            '<Float64 name="a" valueReference="1"><Dimension start="2"/></Float64>\n<Float64 name="a[2]"'
            ' valueReference="2"/>'
        ),
        '<Float64 name="a" valueReference="1"><Alias name="c"/></Float64>\n<Float64 name="c" valueReference="2"/>',
        (
            '<Float64 name="a" valueReference="1"><Dimension start="0"/></Float64>\n<Float64 name="a"'
            ' valueReference="2"/>'
        ),
        '<Float64 name="a" valueReference="1">' + '<Dimension start="1"/>' * 17 + "</Float64>",
        f'<Float64 name="{"a" * 10**6}" valueReference="1"><Dimension start="100000"/></Float64>',
        '<Float64 name="a&#10;b&#27;[31m" valueReference="-1"/>',
    ],
)
def test_what_cannot_be_run_safely_in_fmi_3(tmp_path, variables, raises):
    variables = variables.replace("&#27;", "&#155;")
    with raises(FmuError) as caught:
        Fmu(archive(tmp_path / "a.fmu", description(3, variables)))
    assert str(caught.value).isprintable()
    assert len(str(caught.value)) < 500


@pytest.mark.parametrize(
    ("name", "number", "make"),
    [
        ("variables", 3, lambda: xml(2, "".join(input_(2, i, f"u{i}") for i in range(3)))),
        (
            "variables",
            4,
            lambda: xml(
                3, '<Float64 name="u" valueReference="0"><Dimension start="2"/><Dimension start="2"/></Float64>'
            ),
        ),
        (
            "dimensions",
            2,
            lambda: xml(
                3, '<Float64 name="u" valueReference="0"><Dimension start="2"/><Dimension start="2"/></Float64>'
            ),
        ),
        (
            "dependencies",
            2,
            lambda: xml(
                2,
                input_(2) + input_(2, "1", "v") + variable(2, "y", "2", "", 'causality="output"'),
                OUTPUT[2].format(3, 'dependencies="1 2"'),
            ),
        ),
        ("xml_bytes", 1000, lambda: xml(2, input_(2)).ljust(1000)),
        ("xml_nodes", 60, lambda: xml(2, input_(2) + "<a/>" * 31)),
    ],
)
def test_limits_can_be_raised(tmp_path, name, number, make, raises):
    made = make()
    if name == "xml_nodes":
        number = made.count(b"<") + made.count(b"=")
    path = archive(tmp_path / "large.fmu", made)
    with raises(FmuError, match=rf"(?s){number - 1}.*Limits\({name}={number}\)"):
        Fmu(path, limits=Limits(**{name: number - 1}), quiet=True)
    assert Fmu(path, limits=Limits(**{name: number}), quiet=True).description.variables


@pytest.mark.parametrize("wrong", [{"variables": 0}, {"variables": -1}, {"files": 1.5}, {"files": True}])
def test_limits_are_whole_numbers(wrong, refused):
    refused(FmuError, lambda: Limits(**wrong), lambda: Limits.of(["variable=3"]), lambda: Limits.of(["files=many"]))
    assert Limits.of(["files=3", "variables=5"]) == Limits(files=3, variables=5)


@pytest.mark.parametrize(
    "made",
    [
        b'<?xml version="1.0" encoding="UTF-7"?>+ADwAIQ-DOCTYPE a+AD4-<a/>',
        '<?xml version="1.0" encoding="cp037"?><!DOCTYPE a [<!ENTITY b "c">]><a b="&b;"/>'.encode("cp037"),
    ],
)
def test_encodings_that_hide_a_document_type(tmp_path, made, raises):
    with raises(FmuError):
        Fmu(archive(tmp_path / "a.fmu", made))


@VERSIONS
def test_schemas_that_a_description_names_are_not_opened(tmp_path, version, raises):
    trap = tmp_path / "trap.xsd"
    if sys.platform == "win32":
        trap.write_text("no schema")
    else:
        os.mkfifo(trap)  # who opens it waits forever
    head = f'xmlns:xsi="http://www.w3.org/2001/XMLSchema-instance" xsi:noNamespaceSchemaLocation="{trap.as_uri()}"'
    path = archive(tmp_path / "a.fmu", xml(version, input_(version), head=head))
    assert findings(path) == []
    if sys.platform != "win32":
        with raises(FmuError):
            Fmu(trap)


# ------------------------------------------------------------------------------------------------------------- quirks

_VENDOR = '<VendorAnnotations><Tool name="Dymola"/></VendorAnnotations>'
_UNIT = variable(2, "a", "1", 'unit="{}"')
_DATE = {"head": 'generationDateAndTime="2019-05-10_16_10"'}
KNOWN = {
    "element 'VendorAnnotations'": ("Dymola Version 2023x", 3, {"more": _VENDOR}),
    "attribute 'order'": (
        "Dymola Version 2024x",
        3,
        {
            "variables": (
                '<Float64 name="a" valueReference="1"><Annotations><Annotation type="t"'
                ' order="1"/></Annotations></Float64>'
            )
        },
    ),
    "element 'Annotations'": (
        "Dymola Version 2024x",
        3,
        {
            "variables": (
                '<Float64 name="a" valueReference="1"><Alias name="b"/><Annotations><Annotation'
                ' type="t"/></Annotations></Float64>'
            )
        },
    ),
    "element 'Outputs'": ("OpenModelica Compiler 1.9.4", 2, {"structure": "<Outputs></Outputs>"}),
    "unit * is": ("OpenModelica Compiler OpenModelica v1.15.0 (64-bit)", 2, {"variables": _UNIT.format("A")}),
    "unit '' is": ("MapleSim 2015.1", 2, {"variables": _UNIT.format("")}),
    "unit 'user-defined'": ("MSC Easy5 2017.1", 2, {"variables": _UNIT.format("user-defined")}),
    "attribute 'needsExecutionTool'": ("JModelica.org", 2, {"head": 'needsExecutionTool="true"'}),
    "Hopsan": ("HOPSAN 2.11", 2, _DATE),
    "qfmu": ("qfmu", 2, _DATE),
    "PythonFMU * is continuous": (
        "PythonFMU 0.6.9",
        2,
        {"variables": variable(2, "n", "1", "", 'causality="output"', "Integer"), "structure": OUTPUT[2].format(2, "")},
    ),
    "MWorks": ("MWorks 2016", 2, {"variables": variable(2, "b", "1", "", "", "Boolean")}),
    "element 'ModelVariables'": ("PythonFMU 0.6.9", 2, {"without": True}),
    "element 'SourceFiles'": ("FMPy 0.3.1 FMU Container", 2, {"sources": True}),
    "no start value": (
        "Simulink with FMI Kit 2.8",
        2,
        {"variables": variable(2, "p", "1", "", 'causality="parameter" variability="tunable"')},
    ),
}


def test_every_quirk_has_a_case_and_a_source():
    assert len(KNOWN) == len(validation.quirks())
    for quirk, key in zip(validation.quirks(), KNOWN, strict=True):
        assert key.split(" ")[0].lower() in f"{quirk.tool} {quirk.finding}".lower()
        assert re.match(r"https://\S+/\d+$", quirk.source)
        assert quirk.reason


@pytest.mark.parametrize("key", KNOWN)
def test_quirks_are_listed_and_not_warned_of(tmp_path, key):
    tool, version, given = KNOWN[key]
    given = dict(given)
    variables = "" if given.pop("without", False) else input_(version) + given.pop("variables", "")
    sources = given.pop("sources", False)

    def made(tool):
        text = xml(version, variables, **{**given, "tool": tool})
        if sources:
            text = re.sub(rb"(<CoSimulation [^>]*)/>", rb"\1><SourceFiles/></CoSimulation>", text)
        return archive(tmp_path / "a.fmu", text)

    path = made(tool)
    with warnings.catch_warnings():
        warnings.simplefilter("error", FmuWarning)
        fmu = Fmu(path, strict=True)
    assert len(fmu.verdict.quirks) == 1
    console = Console(width=200)
    with console.capture() as captured:
        console.print(describe(fmu))
    assert "known quirks of its tool, harmless (1)" in captured.get()
    with pytest.warns(FmuWarning):
        assert Fmu(made("Somebody's")).verdict.quirks == ()


# -------------------------------------------------------------------------------------------------------------- cache


def test_verdicts_are_kept(tmp_path, monkeypatch):
    monkeypatch.setenv("BUILD_FMUS_CACHE", str(tmp_path / "cache"))
    many = "".join(variable(2, f"x{i}", i, 'min="2" max="1"') for i in range(300))
    path = archive(tmp_path / "a.fmu", xml(2, many))
    first = Fmu(path, quiet=True).verdict
    (kept,) = (tmp_path / "cache" / "verdicts").iterdir()
    with monkeypatch.context() as patch:
        patch.setattr(validation, "judge", None)
        assert Fmu(path, quiet=True).verdict == first
    kept.write_text(kept.read_text().replace("min is 2", "min is 3", 1))
    with pytest.warns(DamagedWarning):
        assert Fmu(path, quiet=True).verdict == first
    kept.unlink()
    kept.mkdir()  # nothing can be kept there
    assert Fmu(path, quiet=True).verdict == first


# ----------------------------------------------------------------------------------------------------------- archives


@pytest.mark.parametrize("method", [zipfile.ZIP_BZIP2, zipfile.ZIP_LZMA])
def test_methods_of_compression_without_bounds(tmp_path, method, raises):
    path = tmp_path / "a.fmu"
    with zipfile.ZipFile(path, "w", method) as file:
        file.writestr("modelDescription.xml", description(2))
    with raises(FmuError, match=f"{method}"):
        Fmu(path)


def test_two_descriptions(tmp_path, raises):
    path = tmp_path / "a.fmu"
    with zipfile.ZipFile(path, "w") as file:
        file.writestr("modelDescription.xml", description(2))
        with pytest.warns(UserWarning, match="Duplicate name"):
            file.writestr("modelDescription.xml", description(2, name="Other"))
    with raises(FmuError):
        Fmu(path)


def test_a_directory_of_many_files(tmp_path, raises):
    path = tmp_path / "a.fmu"
    with zipfile.ZipFile(path, "w") as file:
        file.writestr("modelDescription.xml", xml(2, input_(2)))
        for i in range(40):
            file.writestr(f"resources/{'x' * 60}{i}", b"")
    with raises(FmuError):
        Fmu(path, limits=Limits(files=10))
    assert Fmu(path, limits=Limits(files=50), quiet=True).description.inputs


def test_a_description_larger_than_it_says(tmp_path, raises):
    """What is unpacked is never more than the size that was compared with the limit."""
    path = archive(tmp_path / "a.fmu", description(2).ljust(50 * 2**20))
    data = bytearray(path.read_bytes())
    for at, offset in ((data.index(b"PK\x03\x04"), 22), (data.index(b"PK\x01\x02"), 24)):
        data[at + offset : at + offset + 4] = (1000).to_bytes(4, "little")
    path.write_bytes(data)
    with raises(FmuError):
        Fmu(path)


def test_parse_takes_limits():
    with pytest.raises(FmuError, match="Limits"):
        parse(xml(2, input_(2)), "a.fmu", Limits(xml_bytes=10))


def test_an_element_of_many_attributes(tmp_path, raises):
    attributes = " ".join(f'a{i}=""' for i in range(1001))
    with raises(FmuError):
        Fmu(archive(tmp_path / "a.fmu", xml(2, variable(2, "x", "0", attributes))))


@VERSIONS
def test_long_descriptions_are_compared_in_parts(tmp_path, version):
    """The same is found in parts as at once, with the same lines; when there is more than is told, the rest is left."""
    right = "".join(variable(version, f"x{i}", i) for i in range(3000))
    wrong = variable(version, "odd", 9000, 'colour="red"')
    assert findings(archive(tmp_path / "a.fmu", xml(version, right))) == []
    (one,) = findings(archive(tmp_path / "b.fmu", xml(version, right + wrong)))
    assert one.startswith("line 3003: variable 'odd': element")
    many = right + "".join(variable(version, f"odd{i}", 9000 + i, 'colour="red"') for i in range(1000))
    verdict = Fmu(archive(tmp_path / "c.fmu", xml(version, many)), quiet=True).verdict
    assert verdict.findings[0].line == 3003
    assert len(verdict.findings) == validation.MOST
    assert verdict.more_findings < 1000


def test_an_array_that_depends_on_itself_as_a_whole(tmp_path):
    """Each of its elements has the same dependencies, and so has each state of an array of states."""
    output = '\n<Float64 name="y" valueReference="1" causality="output"><Dimension start="1000"/></Float64>'
    told = findings(archive(tmp_path / "a.fmu", xml(3, output, OUTPUT[3].format(1, 'dependencies="1"'))))
    assert told == ["line 3: output 'y' depends on itself: y -> y"]


@pytest.mark.parametrize("identifier", ["x" * 201, "ä" * 101])
def test_an_identifier_longer_than_names_of_files(tmp_path, identifier, raises):
    with raises(FmuError):
        Fmu(archive(tmp_path / "a.fmu", description(2, identifier=identifier)))


def test_a_kind_that_there_is_not(tmp_path, raises):
    own = '<VendorAnnotations><Tool name="suspension-fmus"><Component kind="hybrid"/></Tool></VendorAnnotations>'
    with raises(FmuError):
        Fmu(archive(tmp_path / "a.fmu", xml(2, input_(2), more=own)))
