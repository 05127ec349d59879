"""Write a report: `report.html`, `summary.json`, one CSV file per figure and per table.

The three forms are written from the same objects. Nothing depends on time, machine or order of hashing: the same
report gives the same bytes. What is large in the page (plotly, curves, motion) is compressed. The page loads nothing:
its scripts and styles are inside, and its content security policy forbids the rest.
"""

from __future__ import annotations

import base64
import csv
import hashlib
import io
import json
import math
import os
import zlib
from collections.abc import Iterable, Sequence
from dataclasses import asdict, dataclass
from importlib import resources
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from build_fmus.base import escape, extras, safe_files
from cosim.core.content_checks import Array, Scalar
from cosim.core.errors import CosimError
from cosim.report.animation import animation_data
from cosim.report.claims import Claim, Verdict
from cosim.report.maps import Map, map_plot
from cosim.report.model import Figure, Report, Table
from cosim.report.plots import Palette, dark_colors, placed_columns, plotly_figure, series_columns
from cosim.scenes.scene import scene_script, scene_style

with extras.needed("reports", extras.WRITING):
    import jinja2
    from markupsafe import Markup

SIGNIFICANT = 4  # digits shown on the page; JSON and CSV carry every digit
WHOLE = 12  # rows of a table that is not broken across pages of paper
_LOOK: dict[Verdict, dict[str, str]] = {
    "reproduced": {"style": "yes", "mark": "✓"},
    "calibrated": {"style": "fit", "mark": "="},
    "trend reproduced, magnitude differs": {"style": "order", "mark": "≈"},
    "open": {"style": "open", "mark": "?"},
    "not reproduced": {"style": "no", "mark": "✗"},
    "holds": {"style": "yes", "mark": "✓"},
    "does not hold": {"style": "no", "mark": "✗"},
}
_SUPERSCRIPT = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")


class ReportError(CosimError):
    """The report cannot be written where it should be."""


def write_report(report: Report, directory: str | os.PathLike[str]) -> Path:
    """Write the report into `directory` (made if missing) and return the path of `report.html`.

    Each file appears complete or not at all; `report.html` comes last. Raises ReportError naming the path.
    """
    root = Path(directory)
    files: dict[str, str] = {}
    for figure in report.figures:
        columns = figure.columns() if isinstance(figure, Map) else series_columns(figure)
        length = max(len(values) for _, values in columns)
        padded = [[*values.tolist(), *[None] * (length - len(values))] for _, values in columns]
        files[figure_csv(figure.id)] = _csv([header for header, _ in columns], zip(*padded, strict=True))
    for table in report.tables:
        files[table_csv(table.id)] = _csv(table.columns, table.rows)
    files["summary.json"] = _json(summary(report), indent=2, ensure_ascii=False) + "\n"
    files["report.html"] = render(report)
    for name, text in files.items():
        _write(root, name, text)
    return root / "report.html"


def figure_csv(identifier: str) -> str:
    """Path of a figure's data below the folder of the report."""
    return f"figures/{identifier}.csv"


def table_csv(identifier: str) -> str:
    """Path of a table's data below the folder of the report."""
    return f"tables/{identifier}.csv"


def summary(report: Report) -> dict[str, Any]:
    """Everything in the report but its curves, as plain data."""
    counts = report.counts
    return {
        "experiment": report.experiment,
        "title": report.title,
        "lead": report.lead,
        "claims_total": counts.published,
        "claims_reproduced": counts.reproduced,
        "verdicts": counts.verdicts,
        "checks_total": counts.checks,
        "checks_held": counts.checks_held,
        "claims": [asdict(c) | {"result": shown(c), "own": c.own} for c in report.claims],
        "results": {r.name: {"value": r.value, "unit": r.unit} for r in report.results},
        "tables": {
            t.id: {"title": t.title, "columns": t.columns, "rows": t.rows, "csv": table_csv(t.id)}
            for t in report.tables
        },
        "figures": {f.id: {"title": f.title, "csv": figure_csv(f.id)} for f in report.figures},
        "animations": {a.id: {"title": a.title, "takes": [t.title for t in a.takes]} for a in report.animations},
        "parameters": {p.name: {"value": p.value, "unit": p.unit, "source": p.source} for p in report.parameters},
        "provenance": report.provenance,
    }


def render(report: Report) -> str:
    """The page."""
    palette = Palette(report.drawn)
    plots = {f.id: Packed.json(_plot(f, palette)) for f in report.figures}
    scripts = [_script(_asset("report.js"))]
    style = _asset("report.css")
    motions = {a.id: Packed.json(animation_data(a)) for a in report.animations}
    if motions:
        scripts.append(_script(f"{scene_script()}\n{_asset('animation.js')}"))
        style += scene_style() + _asset("animation.css")
    if plots or motions:
        inflate = _asset("tiny-inflate.js", "third_party")  # made for Node.js: a module
        inflate = f"const inflate = ((module) => {{\n{inflate}\nreturn module.exports; }})({{}});"
        scripts.insert(0, _script(f"{inflate}\n{_asset('packed.js')}"))
    library = _script(_asset("plotly-cartesian.min.js", "third_party")) if plots else None
    environment = jinja2.Environment(
        loader=jinja2.FunctionLoader(_asset),
        autoescape=True,
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=True,
    )
    environment.filters.update(number=number, is_number=_is_number, exact=_exact)
    return environment.get_template("report.html").render(
        report=report,
        plots=plots,
        scripts=scripts,
        library=Packed.text(library) if library else None,
        style=Markup(style),
        motions=motions,
        dark=Markup(escape.script(dark_colors())) if plots else None,
        policy=_policy([*scripts, *([library] if library else [])]),
        shown=shown,
        counts=report.counts,
        look=_LOOK,
        cells=_cells,
        numeric=_numeric_columns,
        figure_csv=figure_csv,
        table_csv=table_csv,
        figure_number={f.id: i for i, f in enumerate(report.figures, start=1)},
        whole=WHOLE,
        table_number={t.id: i for i, t in enumerate(report.tables, start=1)},
    )


def shown(claim: Claim) -> str:
    """Our result as text."""
    return claim.result if claim.result.strip() else f"{number(claim.value)} {claim.unit}".strip()


def number(value: Scalar, decimals: int | None = None) -> str:
    """A value as a reader likes it: four significant digits (or `decimals`), a real minus, powers of ten."""
    if value is None:
        return "–"
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, str):
        return value
    if isinstance(value, int):
        return _grouped(str(value))
    if math.isnan(value):
        return "–"
    if math.isinf(value):
        return "∞" if value > 0 else "−∞"
    if decimals is not None:
        return _grouped(f"{value:.{decimals}f}")
    if value == 0:
        return "0"
    mantissa, exponent = f"{value:.{SIGNIFICANT - 1}e}".split("e")
    power = int(exponent)
    if -4 <= power <= 6:
        text = f"{value:.{max(0, SIGNIFICANT - 1 - power)}f}"
        return _grouped(text.rstrip("0").rstrip(".") if "." in text else text)
    mantissa = mantissa.rstrip("0").rstrip(".")
    times = "" if mantissa in ("1", "-1") else f"{mantissa}×"
    sign = "-" if mantissa == "-1" else ""
    return f"{sign}{times}10{str(power).translate(_SUPERSCRIPT)}".replace("-", "−", 1)


def _grouped(text: str) -> str:
    whole, point, fraction = text.partition(".")
    if len(whole.lstrip("-")) > 4:
        whole = f"{int(whole):,}".replace(",", "\u202f")
    text = whole + point + fraction
    if not text.strip("-0."):
        text = text.lstrip("-")
    return text.replace("-", "−")


def _is_number(value: object) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool)


def _exact(value: Scalar) -> str | None:
    """A cell as the CSV file has it, where the page shows something else."""
    return None if isinstance(value, str) else "" if value is None else str(value)


def _numeric_columns(table: Table) -> list[bool]:
    """Which columns hold numbers (or gaps) only: they are set to the right."""
    columns = list(zip(*table.rows, strict=True)) or [()] * len(table.columns)
    return [
        any(map(_is_number, column)) and all(value is None or _is_number(value) for value in column)
        for column in columns
    ]


def _cells(table: Table) -> list[list[tuple[Scalar, str]]]:
    """(value, text) of every cell; the floats of a column share their decimals where their sizes allow it."""
    columns = []
    for column in zip(*table.rows, strict=True):
        decimals = _decimals([v for v in column if isinstance(v, float) and math.isfinite(v)])
        columns.append([(v, number(v, decimals if isinstance(v, float) else None)) for v in column])
    return [list(row) for row in zip(*columns, strict=True)]


def _decimals(values: Sequence[float]) -> int | None:
    """Decimals that give the largest value four digits, None if that leaves the smallest with fewer than two."""
    sizes = [math.floor(math.log10(abs(v))) for v in values if v]
    if not sizes or min(sizes) < -4 or max(sizes) > 6:
        return None
    decimals = max(0, SIGNIFICANT - 1 - max(sizes))
    if min(sizes) + decimals < 1:
        return None
    return max(len(f"{v:.{decimals}f}".rstrip("0").partition(".")[2]) for v in values)


def _plot(figure: Figure | Map, palette: Palette) -> dict[str, Any]:
    """What the page draws a figure from: `columns`, the numbers of its CSV file, traces that name them, two layouts."""
    if isinstance(figure, Map):
        wide, narrow = (map_plot(figure, narrow=n) for n in (False, True))
        columns = figure.columns()
    else:
        wide, narrow = (json.loads(plotly_figure(figure, palette, narrow=n).to_json()) for n in (False, True))
        columns, places = placed_columns(figure)
        for trace, (x, y) in zip(wide["data"], places, strict=True):
            trace["x"], trace["y"] = x, y
    return {
        "columns": [[header, *_stored(values)] for header, values in columns],
        "data": wide["data"],
        "wide": wide["layout"],
        "narrow": narrow["layout"],
    }


def _stored(values: Array) -> list[Any]:
    """A column as the page keeps it; seven digits at least, while the files beside the page carry every digit.

    ["u1", base64, first, step]: multiples of a step, such as instants, by how many steps each is after the one before.
    ["f4", base64], little-endian; ["f8", base64] where single precision cannot hold the numbers.
    """
    with np.errstate(over="ignore", invalid="ignore"):
        single = values.astype("<f4")
        steps = np.diff(values)
    if not np.isclose(single, values, rtol=1.2e-7, atol=0.0, equal_nan=True).all():  # infinities are themselves
        return ["f8", _base64(values.astype("<f8"))]
    if len(steps) and steps.min() > 0:
        first, step = float(values[0]), float(steps.min())
        counts = np.rint(steps / step)
        if counts.max() < 256 and (single == (first + step * np.cumsum([0.0, *counts])).astype("<f4")).all():
            return ["u1", _base64(np.array([0, *counts], dtype=np.uint8)), first, step]
    return ["f4", _base64(single)]


def _base64(array: npt.NDArray[Any]) -> str:
    return base64.b64encode(array.tobytes()).decode()


def _finite(value: Any) -> Any:
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    if isinstance(value, dict):
        return {key: _finite(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_finite(item) for item in value]
    return value


def _json(value: Any, **how: Any) -> str:
    return json.dumps(_finite(value), sort_keys=True, allow_nan=False, **how)


def _csv(headers: Iterable[str], rows: Iterable[Sequence[Scalar]]) -> str:
    """Floats read back to bit-identical values; an empty cell is no value."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(headers)
    writer.writerows(rows)
    return text.getvalue()


@dataclass(frozen=True)
class Packed:
    """A text as the page holds it compressed: base64 of deflated UTF-8, and its length [bytes] before that."""

    content: str
    size: int

    @classmethod
    def text(cls, text: str) -> Packed:
        """Pack a text."""
        plain = text.encode()
        deflate = zlib.compressobj(9, zlib.DEFLATED, -zlib.MAX_WBITS)
        return cls(base64.b64encode(deflate.compress(plain) + deflate.flush()).decode(), len(plain))

    @classmethod
    def json(cls, value: Any) -> Packed:
        """Pack a value as JSON."""
        return cls.text(_json(value, separators=(",", ":")))


def _script(source: str) -> Markup:
    if "</script" in source.lower() or "<!--" in source:
        raise AssertionError("a script must not contain its own end tag")
    return Markup(source.replace("\r\n", "\n").replace("\r", "\n"))


def _policy(scripts: Iterable[str]) -> str:
    """Only the scripts that were put in run; nothing is fetched. plotly sets styles and draws exports as blobs."""
    digests = (base64.b64encode(hashlib.sha256(s.encode()).digest()).decode() for s in scripts)
    allowed = " ".join(f"'sha256-{d}'" for d in digests)
    return (
        f"default-src 'none'; script-src {allowed}; style-src 'unsafe-inline'; img-src data: blob:; "
        "base-uri 'none'; form-action 'none'"
    )


def _asset(name: str, folder: str = "templates") -> str:
    return resources.files("cosim.report").joinpath(folder, name).read_text(encoding="utf-8")


def _write(root: Path, name: str, text: str) -> None:
    path = root / name
    try:
        safe_files.write(path, text)
    except OSError as error:
        raise ReportError(
            f"cannot write {path}: {error.strerror or error}; make '{root}' a directory you may write to, "
            "or choose another one"
        ) from error
