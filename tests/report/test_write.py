"""The files of a report: its page, tables and plots."""

import csv
import hashlib
import json
import math
import os
import re
from base64 import b64decode, b64encode
from html.parser import HTMLParser
from importlib import resources

import numpy as np
import pytest
from packed import packed_texts
from py_mini_racer import MiniRacer

from cosim.core.errors import CosimError
from cosim.report import Claim, Figure, Panel, Parameter, Report, Result, Section, Series, Table, write_report
from cosim.report.write import Packed, number, render, summary

LOADING = {"src", "srcset", "data", "poster", "background", "action", "formaction", "xlink:href"}
HOSTILE = "</script><script>alert(1)</script><img src=x onerror=alert(1)> \"'&{{ 7*7 }} <!-- ]]>"


class Page(HTMLParser):
    """Tags with their attributes, the text of scripts and styles, and all other text."""

    def __init__(self, text):
        super().__init__()
        self.tags, self.scripts, self.styles, self.text = [], [], [], ""
        self.texts = packed_texts(text)
        self.feed(text)

    def handle_starttag(self, tag, attrs):
        self.tags.append((tag, dict(attrs)))
        if tag in ("script", "style"):
            getattr(self, tag + "s").append((dict(attrs), ""))

    def handle_data(self, data):
        kept = {"script": self.scripts, "style": self.styles}.get(self.lasttag)
        if kept and self.cdata_elem:
            kept[-1] = (kept[-1][0], kept[-1][1] + data)
        else:
            self.text += data


@pytest.fixture
def page(make_report):
    return Page(render(make_report()))


def read(path):
    with path.open(newline="", encoding="utf-8") as file:
        return list(csv.reader(file))


def column(stored):
    """Numbers of a column, as the page's script reads them."""
    _, kind, text, *line = stored
    numbers = np.frombuffer(b64decode(text), "<" + kind)
    return (line[0] + line[1] * np.cumsum(numbers, dtype=float)).tolist() if line else numbers.tolist()


@pytest.mark.parametrize(
    ("values", "kind"),
    [
        ([0.1, -3e30, 0.0, math.nan, math.inf], "f4"),
        ([0.0, 1.0, math.inf], "f4"),
        ([0.0, 1.0, math.nan], "f4"),
        ([0.5, 0.501, 0.502, 0.512], "u1"),  # instants of a thinned curve
        ([0.0, 0.1, 0.25], "f4"),
        ([0.0, 1.0, 257.0], "f4"),  # further than a byte counts
        ([0.0, 1.0, 1.0], "f4"),
        ([1.0, 0.0], "f4"),
        ([7.0], "f4"),
        ([1.0, 1e39], "f8"),  # beyond single precision
        ([1.0, 1e-42], "f8"),  # where it loses digits
    ],
)
def test_numbers_in_the_page_have_seven_digits_at_least(values, kind):
    x = [float(i) for i in range(len(values))]
    figure = Figure("f", "F", "", [Panel("", "time [s]", "force [N]", [Series("a", x, values)])])
    page = Page(render(Report("e", "T", "", sections=[Section("S", figures=[figure])])))
    columns = json.loads(page.texts["data-f"])["columns"]
    assert columns[1][1] == kind
    assert column(columns[1]) == pytest.approx(values, rel=1.2e-7, abs=0.0, nan_ok=True)


def contents(directory):
    return {p.relative_to(directory).as_posix(): p.read_bytes() for p in directory.rglob("*") if p.is_file()}


def test_the_files_and_nothing_else(make_report, tmp_path):
    assert write_report(make_report(), tmp_path / "deep" / "er") == tmp_path / "deep" / "er" / "report.html"
    assert set(contents(tmp_path / "deep" / "er")) == {
        "report.html",
        "summary.json",
        "figures/histories.csv",
        "figures/speeds.csv",
        "tables/matched.csv",
    }


def test_the_summary_begins_with_what_it_is_of(make_report):
    found = summary(make_report())
    assert (found["experiment"], found["title"], found["lead"]) == ("gpc", "A car on three roads", "Three laws.")


def test_figures_and_tables_are_counted_from_one(page):
    text = " ".join(page.text.split())
    for words in ("Figure 1 Body motion", "Figure 2 Over speed", "Table 1 Matched"):
        assert words in text


def test_the_page_begins_with_its_message(make_report):
    """The sentence, the figure that shows it, the verdicts, whose details unfold, and then the rest."""
    bars = Series("MPC", [0, 1], [5.1, 2.8], mode="bar")
    first = Figure("message", "Power by road", "", [Panel("", "road [?]", "power [W]", [bars], x_names=["a", "b"])])
    report = make_report(figure=first)
    text = render(report)
    places = [
        text.index(words)
        for words in (
            '<p class="lead">Three laws.</p>',
            '<figure id="figure-message"',
            '<dl class="strip">',
            '<table class="claims"',
            "<details>",
            "<dt>Why</dt><dd>other road</dd>",
            '<figure id="figure-histories"',
        )
    ]
    assert places == sorted(places)
    assert report.figures[0] is first
    assert " ".join(Page(text).text.split()).index("Figure 1 Power by road") > 0
    assert text.count("<details>") == len(report.claims) + 1  # and the parameters


def test_two_writes_are_the_same_bytes(make_report, tmp_path):
    write_report(make_report(), tmp_path / "a")
    write_report(make_report(), tmp_path / "b")
    first = contents(tmp_path / "a")
    assert first == contents(tmp_path / "b")
    write_report(make_report(), tmp_path / "a")
    assert first == contents(tmp_path / "a")
    assert str(tmp_path).encode() not in b"".join(first.values())


class TestSelfContained:
    def test_nothing_is_loaded(self, page):
        for tag, attributes in page.tags:
            assert tag not in ("link", "iframe", "object", "embed", "base")
            assert not LOADING & set(attributes), tag
            assert not re.match(r"(?i)\s*(https?:)?//|javascript:", attributes.get("href") or "")
            assert not any(name.startswith("on") for name in attributes)
        for _, style in page.styles:
            assert not re.search(r"(?i)@import|url\(", style)

    def test_the_policy_forbids_the_rest_and_allows_exactly_its_scripts(self, page):
        policy = next(a["content"] for t, a in page.tags if a.get("http-equiv") == "Content-Security-Policy")
        assert policy.startswith("default-src 'none'; ")
        allowed = {b64decode(d) for d in re.findall(r"'sha256-([^']+)'", policy)}
        scripts = [s for a, s in page.scripts if "type" not in a] + [page.texts["plotly"]]
        assert {hashlib.sha256(s.encode()).digest() for s in scripts} == allowed
        assert "'unsafe-inline'" not in policy.split("style-src")[0]

    def test_plotly_is_inlined_once_and_offers_no_upload(self, page):
        scripts = [s for a, s in page.scripts if "type" not in a]
        assert not any("Plotly, Inc." in s for s in scripts)
        assert page.texts["plotly"].count("Plotly, Inc.") == 1
        assert "showSendToCloud: false" in scripts[-1]

    def test_what_others_wrote_is_the_file_that_was_released(self):
        """The hash that stands beside it, which anybody can take from the package on npm."""
        third_party = resources.files("cosim.report").joinpath("third_party")
        said = re.findall(r"SHA-256 of (\S+): (\w{64})", third_party.joinpath("COPYRIGHT").read_text(encoding="utf-8"))
        files = {
            f.name: hashlib.sha256(f.read_bytes()).hexdigest() for f in third_party.iterdir() if f.name.endswith(".js")
        }
        assert dict(said) == files

    @pytest.mark.parametrize("text", ["", "a", "abc" * 1000, "Größe ≤ 1 \N{KANGAROO}", "plotly", "noise"])
    def test_the_script_unpacks_what_was_packed(self, text):
        plain = {
            "plotly": lambda: (
                resources.files("cosim.report")
                .joinpath("third_party", "plotly-cartesian.min.js")
                .read_text(encoding="utf-8")
            ),
            "noise": lambda: b64encode(np.random.default_rng(0).bytes(200_000)).decode(),
        }.get(text, lambda: text)()
        packed = Packed.text(plain)
        script = MiniRacer()
        script.eval(
            "var module = {};"
            + resources.files("cosim.report").joinpath("third_party", "tiny-inflate.js").read_text(encoding="utf-8")
        )
        source = list(b64decode(packed.content))
        found = script.eval(
            f"JSON.stringify(Array.from(module.exports(Uint8Array.from({source}), new Uint8Array({packed.size}))))"
        )
        assert bytes(json.loads(found)).decode() == plain

    def test_a_page_weighs_a_megabyte_less_than_plotly_with_sixty_thousand_samples_in_it(self):
        x = np.arange(10_000) / 1000
        noise = np.random.default_rng(0).normal(size=(6, len(x)))
        figure = Figure(
            "f", "F", "", [Panel("", "time [s]", "force [N]", [Series(f"{i}", x, y) for i, y in enumerate(noise)])]
        )
        assert len(render(Report("e", "T", "", sections=[Section("S", figures=[figure])])).encode()) < 1.1e6

    def test_without_figures_there_is_no_plotly(self, make_report):
        assert len(render(make_report(sections=[Section("S", ["Text."])]))) < 50_000


def test_the_plots_hold_the_curves(page):
    plots = {id_: json.loads(text) for id_, text in page.texts.items() if id_ != "plotly"}
    assert set(plots) == {"data-histories", "data-speeds"}
    assert [t["name"] for t in plots["data-histories"]["data"]] == ["passive", "explicit", "explicit"]
    columns = plots["data-histories"]["columns"]
    assert [c[0] for c in columns][:2] == ["time [s]", "passive: pitch [deg]"]
    drawn = [[column(columns[t[axis]]) for axis in "xy"] for t in plots["data-histories"]["data"]]
    assert drawn[1] == [[0.0, 1.0, 2.0], pytest.approx([0.1, 0.2, 0.3])]
    assert drawn[2] == [[0.0, 1.0, 2.0], [1.0, 2.0, 3.0]]
    assert plots["data-speeds"]["data"][0]["y"] != plots["data-speeds"]["data"][1]["y"]  # the ends of the band
    assert [column(columns[plots["data-histories"]["data"][0]["y"]])[k] for k in (0, 1)] == [0.0, 0.5]
    assert plots["data-histories"]["narrow"]["height"] > 0


class TestSummary:
    def test_says_what_the_report_says(self, make_report, tmp_path):
        report = make_report()
        write_report(report, tmp_path)
        data = json.loads((tmp_path / "summary.json").read_text(encoding="utf-8"))
        assert (data["claims_reproduced"], data["claims_total"]) == (1, 2)
        assert data["claims"][0]["value"] == 52.5
        assert data["claims"][0]["result"] == "52.5 km/h"
        assert data["claims"][1]["reason"] == "other road"
        assert data["parameters"]["body.mass"] == {"value": 2813.0, "unit": "kg", "source": "Table 1"}
        assert data["provenance"] == {"versions": {"casadi": "3.8.2"}, "seeds": [0, 1]}
        assert data["results"]["Runs"]["value"] == 192

    def test_keys_are_sorted_and_nan_is_null(self, make_report, tmp_path):
        write_report(make_report(), tmp_path)
        text = (tmp_path / "summary.json").read_text(encoding="utf-8")
        data = json.loads(text, parse_constant=pytest.fail)
        assert list(data) == sorted(data)
        assert data["results"]["Best"]["value"] is None
        assert data["tables"]["matched"]["rows"][1] == ["curb", 72, None]

    def test_json_csv_and_page_hold_the_same_table(self, make_report, tmp_path):
        report = make_report()
        page = Page(write_report(report, tmp_path).read_text(encoding="utf-8"))
        table = json.loads((tmp_path / "summary.json").read_text(encoding="utf-8"))["tables"]["matched"]
        header, *rows = read(tmp_path / table["csv"])
        assert header == table["columns"] == ["road", "speed [km/h]", "gain [-]"]
        assert rows[0] == ["sine", "50", "0.123456789"]
        assert table["rows"][0] == ["sine", 50, 0.123456789]
        assert math.isnan(float(rows[1][2]))
        assert "0.123456789" in [a.get("value") for t, a in page.tags if t == "data"]
        assert "0.1235" in page.text


class TestCsv:
    def test_headers_have_units_and_values_read_back(self, make_report, tmp_path):
        write_report(make_report(), tmp_path)
        header, *rows = read(tmp_path / "figures" / "histories.csv")
        assert all(re.fullmatch(r".+ \[[^\[\]]+\]", name) for name in header)
        assert [float(v) for v in rows[1]] == [1.0, 0.5, 0.2, 2.0]

    def test_short_columns_end_in_empty_cells(self, make_report, tmp_path):
        write_report(make_report(), tmp_path)
        rows = read(tmp_path / "figures" / "speeds.csv")
        assert rows[-1] == ["", "", "", "", "30.0", "3.0", ""]


def test_hostile_text_stays_text(make_report, tmp_path):
    x = HOSTILE
    report = make_report(
        experiment=x,
        title=x,
        lead=x,
        claims=[Claim("c", x, x, x, "not reproduced", x, x)],
        sections=[
            Section(
                x,
                [x],
                [Figure("f", x, x, [Panel(x, f"{x} [s]", f"{x} [m]", [Series(x, [0, 1], [0, 1])])])],
                [Table("t", x, [x], [[x]], x)],
            )
        ],
        parameters=[Parameter(x, x, x, x)],
        provenance={x: {x: x}},
        results=[Result(x, x, x)],
    )
    clean = Page(render(make_report(sections=[Section("S", [], [*make_report().figures[:1]])])))
    page = Page(write_report(report, tmp_path).read_text(encoding="utf-8"))
    assert not [tag for tag, _ in page.tags if tag == "img"]
    assert len(page.scripts) == len(clean.scripts)
    assert page.text.count(x) > 15
    plot = json.loads(page.texts["data-f"])
    assert plot["data"][0]["name"].startswith("&lt;/script&gt;")  # plotly reads names as markup
    assert json.loads((tmp_path / "summary.json").read_text(encoding="utf-8"))["title"] == x
    assert read(tmp_path / "tables" / "t.csv") == [[x], [x]]


class TestUnwritable:
    def test_a_file_in_the_way(self, make_report, tmp_path, raises):
        (tmp_path / "taken").write_text("mine")
        with raises(CosimError):
            write_report(make_report(), tmp_path / "taken")
        assert (tmp_path / "taken").read_text() == "mine"

    def test_no_permission(self, make_report, tmp_path, monkeypatch, raises):
        write_report(make_report(title="before"), tmp_path)
        before = contents(tmp_path)

        def refuse(*_):
            raise PermissionError(13, "Permission denied")

        monkeypatch.setattr(os, "replace", refuse)
        with raises(CosimError):
            write_report(make_report(title="after"), tmp_path)
        assert contents(tmp_path) == before


@pytest.mark.parametrize(
    ("value", "text"),
    [
        (0.55123, "0.5512"),
        (52.5, "52.5"),
        (0.0, "0"),
        (-0.0, "0"),
        (-1.5, "−1.5"),
        (1234.56, "1235"),
        (12345.6, "12\u202f346"),
        (7, "7"),
        (1234567, "1\u202f234\u202f567"),
        (1e-7, "10⁻⁷"),
        (-3.2e-8, "−3.2×10⁻⁸"),
        (9.99996, "10"),
        (2.5e9, "2.5×10⁹"),
        (float("nan"), "–"),
        (float("-inf"), "−∞"),
        (None, "–"),
        (True, "yes"),
        ("text", "text"),
    ],
)
def test_numbers_on_the_page(value, text):
    assert number(value) == text


def test_the_floats_of_a_column_share_their_decimals(make_report):
    rows = [[412.7, 1e-9], [1043.94, 0.5], [0.0, 2.0], [98.0, 3.0]]
    report = make_report(sections=[Section("S", [], [], [Table("t", "T", ["a [W]", "b [-]"], rows)])])
    text = Page(render(report)).text.split()
    assert [text[text.index("413") + k] for k in range(0, 8, 2)] == ["413", "1044", "0", "98"]
    assert "10⁻⁹" in text


def test_small_numbers_of_a_column_keep_four_digits(make_report):
    """0.5123 has four decimals, so 0.25 has them too."""
    report = make_report(sections=[Section("S", [], [], [Table("t", "T", ["a [W]"], [[0.51234], [0.25]])])])
    text = Page(render(report)).text.split()
    assert {"0.5123", "0.2500"} <= set(text)


def test_columns_of_numbers_are_set_to_the_right():
    table = Table("t", "T", ["name", "value [m]", "gaps", "mixed"], [["a", 1.0, None, 1.0], ["b", 2.0, 3, "x"]])
    page = Page(render(Report("demo", "Demo", "Lead.", sections=[Section("S", tables=[table])])))
    heads = [attributes.get("class") for tag, attributes in page.tags if tag == "th"]
    assert heads == [None, "num", "num", None]
    empty = Table("t", "T", ["name", "value [m]"], [])
    page = Page(render(Report("demo", "Demo", "Lead.", sections=[Section("S", tables=[empty])])))
    assert [attributes.get("class") for tag, attributes in page.tags if tag == "th"] == [None, None]


def test_very_small_numbers_have_powers_of_ten():
    shown = {}
    for values in ([2e-5, 3e-4], [2e-4, 3e-3]):
        table = Table("t", "T", ["value [m]"], [[v] for v in values])
        text = Page(render(Report("demo", "Demo", "Lead.", sections=[Section("S", tables=[table])]))).text
        shown[values[0]] = "10⁻⁵" in text
    assert shown == {2e-5: True, 2e-4: False}


@pytest.mark.parametrize(("rows", "whole"), [(12, True), (13, False)])
def test_a_short_table_is_not_broken_across_pages(rows, whole):
    table = Table("t", "T", ["value [m]"], [[float(i)] for i in range(rows)])
    page = Page(render(Report("demo", "Demo", "Lead.", sections=[Section("S", tables=[table])])))
    assert (("div", {"class": "whole"}) in page.tags) is whole
