"""Untrusted texts in everything that this project writes.

Names, units, titles and descriptions, and vehicle, weights and road files that hold them.

A case is the name of a writer and texts, as JSON. What is written must be read back as these texts, and apart from them
be what plain texts give: the same tokens of C, the same elements of XML and HTML, the same words of a command line.
"""

from __future__ import annotations

import json
import random
import re
import shlex
import tomllib
from collections.abc import Callable
from contextlib import suppress
from functools import cache
from html.parser import HTMLParser
from pathlib import Path
from types import SimpleNamespace
from xml.sax.saxutils import quoteattr

import numpy as np
from lxml import etree

from build_fmus import generate, package
from build_fmus.base import escape
from build_fmus.component import Component, DeclarationError
from build_fmus.description_xml import model_description
from cosim import CosimError, Recording, System
from cosim.check import report as checked
from cosim.check.page import to_html
from cosim.check.rules import Check, Finding
from cosim.export.code import SystemCode, exported_schedule
from cosim.export.variables import choose
from cosim.ssp.write import export_ssp
from cosim.study import FmuSet
from fmu_sources.controllers.lq.preview_weights import WeightsError, load_weights
from fmu_sources.plants.quarter_car import quarter_car
from fmu_sources.roads.errors import RoadError
from fmu_sources.roads.layout import RoadLayout, WheelPosition
from fmu_sources.roads.user_file import road_from_file
from fmu_sources.vehicles.loader import VehicleError, load_quarter_car

from . import mutate

ALLOWED = (CosimError, DeclarationError, VehicleError, WeightsError, RoadError)
SOURCES = Path(__file__).parents[2] / "fmu_sources"
PLAIN = "plain"
HOSTILE = (
    "??/",
    "??!",
    "sure??!",
    "*??/\n/",
    "*/",
    "/*",
    "//",
    "\\",
    "\\\n",
    "\\0",
    '"',
    '";',
    "'",
    "';",
    "#define x",
    "%s%n",
    "\t",
    "\n",
    "\r",
    "\x00",
    "\x01",
    "\x1b[31m",
    "\x7f",
    "\x85",
    "\ud800",
    "\udcff",
    "\ufffe",
    "\u2028",
    "\u202e",
    "é",
    "😀",
    "<",
    "&",
    "]]>",
    "</script>",
    "<!--",
    "<script>alert(1)</script>",
    "&lt;",
    "{{ 7 * 7 }}",
    "{% raw %}",
    "$(id)",
    "`id`",
    "$HOME",
    "~",
    "-rf",
    "[red]x[/red]",
    "[/]",
    "a b",
    "1",
    "int main(void) {",
    "}",
    "0.0}; int x = {",
    "'''",
    '"""',
    "\nsource = 1\n",
    "[table]",
    "a=b",
    "km/h",
    "N.m",
    "U[red]x[/red]",
)


def text(rng: random.Random) -> str:
    """A text that some language takes for more than a text."""
    return "".join(rng.choice((*HOSTILE, mutate.odd(rng)[:50])) for _ in range(rng.randint(1, 4)))


def make(rng: random.Random) -> bytes:
    return json.dumps([rng.choice(list(WRITERS)), *(text(rng) for _ in range(3))]).encode()


def run(case: bytes, folder: Path) -> None:
    writer, *texts = json.loads(case)
    WRITERS[writer](folder, *texts)


def held(given: str) -> str:
    """A text as XML holds it."""
    return escape.NO_XML.sub("\ufffd", given)


# -------------------------------------------------------------------------------------------------------------------- C

_TRIGRAPHS = dict(zip("=/'()!<>-", "#\\^[]|{}~", strict=True))
_TOKEN = re.compile(r'/\*.*?\*/|//[^\n]*|"(?:\\.|[^"\\\n])*"|\S', re.DOTALL)


def tokens(code: str) -> tuple[list[str], list[str]]:
    """What a compiler of C99 reads: all tokens, with `""` for strings, and the strings.

    Whatever is left of a string is a token, too.
    """
    code = re.sub(r"\?\?([=/'()!<>-])", lambda m: _TRIGRAPHS[m[1]], code).replace("\\\n", "")
    found = [m[0] for m in _TOKEN.finditer(code) if not m[0].startswith(("/*", "//"))]
    return [t if t[0] != '"' else '""' for t in found], [value(t) for t in found if t[0] == '"']


def value(literal: str) -> str:
    """What a string literal stands for."""
    content = re.sub(
        rb"\\([0-7]{1,3}|.)", lambda m: bytes([int(m[1], 8)]) if m[1].isdigit() else m[1], literal[1:-1].encode()
    )
    return content.decode()


def _same_but_for_strings(write: Callable[..., str], *texts: str) -> list[str]:
    """The strings of code that is written with texts, which is otherwise that of plain ones."""
    code, strings = tokens(write(*texts))
    plain, _ = tokens(write(*(f"{PLAIN}{i}" for i in range(len(texts)))))
    assert code == plain, next((a, b) for a, b in zip(code, plain, strict=False) if a != b)
    return strings


def _follower(folder: Path, name: str) -> Path:
    from foreign import followers

    described = followers.description(3, "NAME").replace('"NAME"', quoteattr(held(name).replace("\r", " ")))
    return followers.unpacked(3, folder / f"follower{len(list(folder.iterdir()))}", described)


def _name(component: str) -> str:
    """What of a text a component may be called."""
    return "".join(component.replace(".", "").split()) or "m"


def _system(folder: Path, component: str, model: str, group: str) -> System:
    system = System()
    fmu = _follower(folder, model)
    for name in (component, "other"):
        system.add(name, fmu, step="1 ms")
    system.connect(f"{component}.y", "other.u")
    system.group(group, [component, "other"])
    return system


def _plan(folder: Path, component: str, model: str, group: str) -> None:
    component = _name(component)

    def write(component: str, model: str, group: str) -> str:
        with _system(folder, component, model, group) as system:
            schedule = exported_schedule(system, ())
            return SystemCode("System", schedule, choose(schedule, None, None, "*"), 3).plan_c("{token}")

    strings = _same_but_for_strings(write, component, model, group)
    assert f"{component}.y" in strings


def _component(_folder: Path, about: str, note: str, message: str) -> None:
    def declared(about: str, note: str, message: str) -> Component:
        c = Component("Written", kind="continuous", description=about, source=note or "assumed", notes=(note,))
        k = c.parameter("gain", 1.0, "1/s", about, min=0.0, source=message or "assumed")
        u = c.input("u", "1", message)
        x = c.state("x", "1", about, output=True)
        c.derivative(x, k * (u - x), source=note)
        c.check(k, message)
        return c

    def write(about: str, note: str, message: str) -> str:
        return generate.generate_c(declared(about, note, message).model(), arrays=False, token="{token}")

    strings = _same_but_for_strings(write, about, note, message)
    assert message.replace("\0", "\ufffd").encode("utf-8", "replace").decode() in strings
    model = declared(about, note, message).model()
    for fmi in (2, 3):
        root = etree.fromstring(model_description(model, fmi, token="{token}", sources=["model.c"]))
        assert root.get("description") == about
        assert root.find(".//Variable[@name='gain']").get("source") == message
    reference = SimpleNamespace(input_csv=str, output_csv=str)
    files = package._documentation(model, 3, reference)  # type: ignore[arg-type]
    page = files["documentation/index.html"].decode()
    assert "<script" not in page.lower()
    assert about in seen(page) or not about.isprintable()


def _literals(_folder: Path, *texts: str) -> None:
    for given in texts:
        literal = escape.c_string(given)
        assert tokens(literal) == (['""'], [given.replace("\0", "\ufffd").encode("utf-8", "replace").decode()])
        assert tokens(f"a /* {escape.c_comment(given)} */ b")[0] == ["a", "b"]
        assert re.fullmatch(r"[A-Za-z_]\w*", escape.c_identifier(given, [PLAIN]), re.ASCII)
        assert re.fullmatch(r'"(?:[ !#-\[\]-~]|\\[ -~])*"', escape.a2l(given))


# ------------------------------------------------------------------------------------------------------- XML, SVG, HTML


def _tags(root: etree._Element) -> list[str]:
    return [e.tag for e in root.iter()]


def _picture(folder: Path, component: str, model: str, title: str) -> None:
    component = _name(component)
    with _system(folder, component, model, "group") as system:
        root = etree.fromstring(system.draw(title))
    with _system(folder, PLAIN, PLAIN, "group") as system:
        assert _tags(etree.fromstring(system.draw(PLAIN))) == _tags(root)
    texts = [e.text for e in root.iter("{*}text")]
    assert held(component) in texts
    assert {held(title), title.replace("\r", "\n")} & {*texts, ""}


def _ssp(folder: Path, component: str, group: str, about: str) -> None:
    component = _name(component)
    with _system(folder, component, "Model", group) as system:
        path = export_ssp(
            system.components.values(),
            system.schedule(),
            folder / "Case.ssp",
            version="2.0",
            stop_time=None,
            inputs=[],
            initial={},
            text=about,
        )
    with System.from_ssp(path) as again:
        assert list(again.components) == [component, "other"]
        assert group in again.groups


class _Seen(HTMLParser):
    """Elements and texts of a page, as a browser has them."""

    def __init__(self) -> None:
        super().__init__(convert_charrefs=True)
        self.tags: list[str] = []
        self.texts: list[str] = []

    def handle_starttag(self, tag: str, attrs: object) -> None:  # noqa: ARG002
        self.tags.append(tag)

    def handle_data(self, data: str) -> None:
        self.texts.append(data)


def parsed(page: str) -> _Seen:
    reader = _Seen()
    reader.feed(page)
    reader.close()
    return reader


def seen(page: str) -> str:
    return "".join(parsed(page).texts)


def _found(name: str, finding: str) -> checked.Report:
    check = Check("archive.layout", "a check", {"2": "", "3": ""}, "do it", ("2", "3"), (), "warning", None)  # type: ignore[arg-type]
    return checked.Report(
        Path("a.fmu"),
        name=name,
        fmi="3.0",
        tool=finding,
        results=[checked.Result(check, "", (Finding(finding, "warning"),))],
    )


def _compliance(_folder: Path, name: str, finding: str, _: str) -> None:
    page = parsed(to_html([_found(name, finding)]))
    assert page.tags == parsed(to_html([_found(PLAIN, PLAIN)])).tags
    assert finding in "".join(page.texts)
    root = etree.fromstring(checked.to_junit([_found(name, finding)]))
    assert root.findtext(".//system-out") == held(f"warning: {finding}").replace("\r\n", "\n")
    assert json.loads(checked.to_json([_found(name, finding)]))[0]["name"] == name


def _notebook(_folder: Path, name: str, unit: str, title: str) -> None:
    def page(name: str, unit: str) -> str:
        return Recording(np.arange(3.0), [name], np.zeros((3, 1)), {name: unit})._repr_html_()

    assert parsed(page(name, unit)).tags == parsed(page(PLAIN, PLAIN)).tags
    assert held(name) in seen(page(name, unit))
    with suppress(UnicodeEncodeError):  # of a lone surrogate
        assert json.loads(parsed(f"<script>{escape.script([name, unit, title])}</script>").texts[0]) == [
            name,
            unit,
            title,
        ]
    assert seen(f"<p>{escape.html(title)}</p>") == title


# ------------------------------------------------------------------------------------------------ shell, files of users


def _shell(_folder: Path, *texts: str) -> None:
    texts = tuple(t.replace("\0", "") for t in texts)
    assert shlex.split(" ".join(map(escape.shell, texts))) == list(texts)
    command = FmuSet(Path(texts[0] or "fmus")).build_command()
    assert shlex.split(command) == ["build-fmus", "--out", str(Path(texts[0] or "fmus"))]


@cache
def _bundled(kind: str) -> str:
    return next(p for p in sorted(SOURCES.rglob("*.toml")) if kind in p.read_text(encoding="utf-8")).read_text(
        encoding="utf-8"
    )


def toml(given: str) -> str:
    """A string of TOML, which may hold control characters as escapes, but no surrogates."""
    found = json.dumps(given.encode("utf-8", "replace").decode(), ensure_ascii=False).replace("\x7f", "\\u007f")
    assert tomllib.loads(f"a = {found}")["a"] == given.encode("utf-8", "replace").decode()
    return found


def _vehicle(folder: Path, name: str, about: str, source: str) -> None:
    """A vehicle file becomes the same C as the values that it was written from.

    So does a description that holds its texts.
    """
    original = _bundled('kind = "quarter_car"')
    changed = re.sub(r'(?m)^name = ".*"', lambda _: f"name = {toml(name)}", original)
    changed = re.sub(r'(?m)^description = ".*"', lambda _: f"description = {toml(about)}", changed)
    changed = re.sub(r'source = "[^"]*"', lambda _: f"source = {toml(source)}", changed, count=1)
    codes = []
    for content in (changed, original):
        (folder / "my.toml").write_text(content, encoding="utf-8")
        vehicle = load_quarter_car(folder / "my.toml")
        model = quarter_car(vehicle).model()
        codes.append(tokens(generate.generate_c(model, arrays=False, token="{token}"))[0])
        described = etree.fromstring(model_description(model, 2, token="{token}", sources=[]))
        assert vehicle.name in described.get("description")
    assert codes[0] == codes[1]


def _weights(folder: Path, key: str, name: str, source: str) -> None:
    """Texts that can be loaded can stand in an FMU; a key that there is not is refused."""
    path = folder / "my.toml"
    original = _bundled('name = "ride comfort"')
    changed = re.sub(r'(?m)^name = ".*"', lambda _: f"name = {toml(name)}", original)
    path.write_text(re.sub(r'(?m)^source = ".*"', lambda _: f"source = {toml(source)}", changed), encoding="utf-8")
    with suppress(WeightsError):
        read = load_weights(path)
        Component("Law", kind="continuous", description=read.name, source=read.source)
    path.write_text(original.replace("[force]", f"{toml(key)} = 1.0\n[force]"), encoding="utf-8")
    load_weights(path)


def _road(folder: Path, name: str, unit: str, column: str) -> None:
    """The file's name stands in what is made of it; columns and units are refused or understood."""
    name = re.sub("[/\0]", "", name.encode("utf-8", "replace").decode())[:40]
    path = folder / f"my{name}.csv"
    path.write_text(
        "distance [m],left [m],right [m]\n0,0,0\n1,0,0.01\n2,0,0\n3,0.01,0\n", encoding="utf-8", errors="replace"
    )
    layout = RoadLayout((WheelPosition("fl", 0.0, 0.9),), 2, 0.01)
    with suppress(RoadError):
        road = road_from_file(path, layout).model()
        assert path.name in etree.fromstring(model_description(road, 3, token="{token}", sources=[])).get("description")
        tokens(generate.generate_c(road, arrays=False, token="{token}"))
    path.write_text(f"distance [{unit}],{column},right [m]\n0,0,0\n1,0,0\n", encoding="utf-8", errors="replace")
    road_from_file(path, layout)


WRITERS: dict[str, Callable[..., None]] = {
    "plan": _plan,
    "component": _component,
    "literals": _literals,
    "picture": _picture,
    "ssp": _ssp,
    "compliance": _compliance,
    "notebook": _notebook,
    "shell": _shell,
    "vehicle": _vehicle,
    "weights": _weights,
    "road": _road,
}
