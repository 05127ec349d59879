"""The output of `cosim check`: severities, exit codes, and files for programs and people.

Also the message where nothing can be checked.
"""

from __future__ import annotations

import json
import zipfile
from collections.abc import Callable
from pathlib import Path

import pytest
from click.testing import CliRunner
from lxml import etree

from cosim.check import Options, Workers, check
from cosim.check.page import to_html
from cosim.check.report import to_json, to_junit
from cosim.check.runner import Unchecked
from cosim.cli import app

FAST = ("--only", "description", "--only", "states.life")


def run(*arguments: object) -> tuple[int, str]:
    """Exit code and everything that the command says."""
    done = CliRunner().invoke(app, ["check", *map(str, arguments)])
    return done.exit_code, done.output


def test_clean_faulty_and_not_checked(faulty: Callable[..., Path], tmp_path: Path, sentence) -> None:
    code, text = run(faulty(2), *FAST)
    assert (code, "no finding" in text) == (0, True)
    code, text = run(faulty(2, "no-start"), *FAST)
    assert code == 1
    assert "an input with initial=exact has no start value" in text
    assert "FMI 2.0, 2.2.7 Definition of Model Variables (start)" in text
    for wrong in (
        (tmp_path / "none.fmu",),
        (faulty(2), "--fmi", "3"),
        (),
        (faulty(2), "--only", "runs.rest"),
        (faulty(2), "--timeout", "0"),
        (faulty(2), "--interface", "se"),
        (faulty(2), "--limit", "cows=1"),
    ):
        code, text = run(*wrong)
        assert code == 2, wrong
        sentence(text)


def test_warnings_fail_when_asked(faulty: Callable[..., Path], workers: Workers) -> None:
    report = check(faulty(3, "wrong-steps"), Options(only=("states",)), workers=workers)
    assert (report.exit_code(), report.exit_code(strict=True)) == (0, 1)


def test_an_fmu_for_other_platforms_is_not_called_clean(
    faulty: Callable[..., Path], tmp_path: Path, workers: Workers
) -> None:
    """What it says is checked, and that it was not run is said."""
    path = tmp_path / "Elsewhere.fmu"
    with zipfile.ZipFile(faulty(3)) as old, zipfile.ZipFile(path, "w") as new:
        for name in old.namelist():
            new.writestr(
                name if not name.startswith("binaries/") else "binaries/riscv64-linux/faulty.so", old.read(name)
            )
    report = check(path, workers=workers)
    assert "there is no binary for this platform" in report.not_run
    assert "it has binaries for riscv64-linux" in report.not_run
    assert {r.check.id for r, _ in report.findings()} == {"binary.header"}
    assert all(r.inapplicable == report.not_run for r in report.results if r.kind)


def test_files(faulty: Callable[..., Path], tmp_path: Path) -> None:
    code, _ = run(
        faulty(3, "start"),
        faulty(2),
        "--junit",
        tmp_path / "j.xml",
        "--html",
        tmp_path / "h.html",
        "--json",
        tmp_path / "r.json",
        "--only",
        "values",
    )
    assert code == 1
    suites = etree.parse(tmp_path / "j.xml").getroot()
    assert [(s.get("name"), s.get("failures")) for s in suites] == [
        ("Faulty3_start.fmu", "2"),
        ("Faulty2_none.fmu", "0"),
    ]
    failure, _ = suites.iter("failure")
    assert failure.get("message") == "'d' is 0.5 in initialization mode; its start is 0.4"
    assert "Write the same start values" in failure.text
    data = json.loads((tmp_path / "r.json").read_text())
    assert [d["fmi"] for d in data] == ["3.0", "2.0"]
    page = (tmp_path / "h.html").read_text()
    assert "is 0.5 in initialization mode" in page
    assert "script" not in page.split("<style>")[0]


def test_layered_standards_are_named(faulty: Callable[..., Path], tmp_path: Path) -> None:
    code, text = run(
        faulty(2, "related-role"), "--json", tmp_path / "r.json", "--html", tmp_path / "h.html", "--only", "archive"
    )
    assert code == 0
    words = " ".join(text.split())
    assert "layered standards: org.fmi-standard.fmi-ls-ref 1.0.0-beta.1" in words
    assert "fmi-ls-manifest.xml, line 1" in words
    assert json.loads((tmp_path / "r.json").read_text())[0]["layered_standards"] == [
        "org.fmi-standard.fmi-ls-ref 1.0.0-beta.1"
    ]
    assert "Layered standards: org.fmi-standard.fmi-ls-ref 1.0.0-beta.1." in (tmp_path / "h.html").read_text()


def test_a_manifest_of_another_version_is_measured_with_a_note(
    faulty: Callable[..., Path], tmp_path: Path, workers: Workers
) -> None:
    """Drafts differ, and only one has its schema here: what another one may allow is no warning."""
    path = tmp_path / "Older.fmu"
    with zipfile.ZipFile(faulty(3, "related-role")) as old, zipfile.ZipFile(path, "w") as new:
        for name in old.namelist():
            new.writestr(name, old.read(name).replace(b"1.0.0-beta.1", b"1.0.0-alpha.1"))
    ((_, finding),) = check(path, Options(only=("archive",)), workers=workers).findings()
    assert finding.severity == "note"
    assert "the schema is that of version 1.0.0-beta.1; the manifest declares 1.0.0-alpha.1" in finding.text


def test_names_of_strangers_are_no_markup(faulty: Callable[..., Path], tmp_path: Path, workers: Workers) -> None:
    """Neither in the page nor in XML nor on the screen."""
    path = tmp_path / "Odd.fmu"
    with zipfile.ZipFile(faulty(2)) as old, zipfile.ZipFile(path, "w") as new:
        for name in old.namelist():
            text = old.read(name)
            new.writestr(
                name, text.replace(b'name="force"', b'name="&lt;script&gt;[red]"') if name.endswith(".xml") else text
            )
    report = check(path, Options(only=("description",)), workers=workers)
    assert [f.text for _, f in report.findings()] == ["variable '<script>[red]' is not a valid structured name"]
    assert "<script>" not in to_html([report])
    assert b"<script>" not in to_junit([report])
    assert "[red]" in to_json([report])
    assert "[red]" in run(path, "--only", "description.names")[1]


@pytest.mark.parametrize("content", [b"no archive", b""])
def test_what_is_no_fmu_cannot_be_checked(content: bytes, tmp_path: Path, raises) -> None:
    path = tmp_path / "wrong.fmu"
    path.write_bytes(content)
    with raises(Unchecked):
        check(path)


def test_a_description_that_is_no_xml_is_an_error(tmp_path: Path) -> None:
    path = tmp_path / "wrong.fmu"
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr("modelDescription.xml", "<fmiModelDescription")
    report = check(path)
    assert [f"{r.check.id}: {f.severity}" for r, f in report.findings()] == ["archive.readable: error"]
    assert report.exit_code() == 1
