"""Write the documentation as a site that needs no server and no network: `build/site/html/index.html`.

make docs

The pages are those of this folder, the README and what is made of the sources: a page for each FMU from the FMUs
themselves, for each module from its docstrings, and the tutorials run as notebooks, whose outputs stand below their
code. Links to other files of the repository lead to copies of them. Whatever leads nowhere, and a page that has no
place in `mkdocs.yml`, ends this with an error.
"""

from __future__ import annotations

import argparse
import logging
import os
import posixpath
import re
import runpy
import shutil
import sys
import tempfile
from collections.abc import Callable, Iterator, Mapping, Sequence
from importlib.util import find_spec
from pathlib import Path
from typing import Any

from build_fmus.base import safe_files
from build_fmus.base.interpreters import environment

HERE = Path(__file__).parent
ROOT = HERE.parent
SITE = ROOT / "build" / "site"
NOTEBOOKS = ("tutorials/first-component", "how-to/control-design")
"""Pages whose code a reader runs from top to bottom."""
MODULES = (
    "cosim",
    "cosim.study",
    "cosim.study.design",
    "cosim.study.sweep",
    "cosim.study.optimise",
    "cosim.study.calibration",
    "cosim.batch",
    "cosim.gym",
    "cosim.check",
    "build_fmus.component",
    "fmu_sources.catalog",
    "fmu_sources.own_catalog",
    "fmu_sources.registration",
    "fmu_sources.vehicles",
)
OTHERS = {"README.md": "index.md", "benchmarks/README.md": "benchmarks.md", "docs/reference/fmus.md": "fmus/index.md"}
"""Pages of the site whose file is elsewhere in the repository, or has another name."""
_SHIM = (  # what the theme would fetch for search without a server; ours does the same
    "https://unpkg.com/iframe-worker/shim"
)
_START_ENDS = (
    "## Run an experiment\n"  # what follows in the README is a page of its own: the start page fits three screens
)
_SEARCH = (  # a dialog needs a name, which the theme does not give
    '<div class="md-search" data-md-component="search" role="dialog"'
)
PICTURES = runpy.run_path(str(HERE / "write_pictures.py"))
_FENCE = re.compile(r"^```.*?^```", re.MULTILINE | re.DOTALL)
_LINK = re.compile(r"(\]\()([^)\s#]*)(#[^)\s]*)?(\))")
_SHOWN = {
    ".py": "python",
    ".toml": "toml",
    ".c": "c",
    ".h": "c",
    ".csv": "text",
    ".txt": "text",
    ".json": "json",
    "": "text",
}


class Pages:
    """Pages by their place in the site, and the files of the repository that they lead to."""

    def __init__(self) -> None:
        self.texts: dict[str, str] = {}
        self.images: dict[str, Path] = {}
        self._sources: dict[str, str] = {}

    def add(self, source: str, text: str) -> None:
        """A Markdown file of the repository, by its path there: links lead to where their targets are in the site."""
        place = _place(source)
        parts, last = [], 0
        for block in [*_FENCE.finditer(text), None]:
            prose = text[last : block.start() if block else len(text)]
            parts.append(_LINK.sub(lambda m: m[1] + self._target(m[2], m[3] or "", source, place) + m[4], prose))
            if block:
                parts.append(block[0])
                last = block.end()
        self.texts[place] = "".join(parts)

    def _target(self, target: str, anchor: str, source: str, place: str) -> str:
        if not target or "://" in target or target.startswith("mailto:"):
            return target + anchor
        path = posixpath.normpath(posixpath.join(posixpath.dirname(source), target))
        file = ROOT / path
        if not file.exists():
            raise FileNotFoundError(f"{source}: the link {target} leads nowhere")
        if file.suffix in (".svg", ".png", ".jpg"):
            found = file.relative_to(HERE).as_posix()
            self.images[found] = file
        elif file.suffix == ".md":
            found = _place(path)
        else:
            found = self._copy(path)
        return posixpath.relpath(found, posixpath.dirname(place) or ".") + anchor

    def _copy(self, path: str) -> str:
        """The page that shows a file, or what is in a folder."""
        found, file = f"sources/{path}.md", ROOT / path
        if found not in self.texts:
            if file.is_dir():
                names = sorted(
                    p.name for p in file.iterdir() if p.suffix in _SHOWN and not p.name.startswith((".", "__pycache__"))
                )
                shown = "\n".join(f"- `{n}`" for n in names)
            else:
                shown = f"````{_SHOWN.get(file.suffix, 'text')}\n{file.read_text(encoding='utf-8')}\n````"
            self.texts[found] = f"---\nsearch: {{exclude: true}}\n---\n\n# {path}\n\n{shown}\n"
        return found


def _place(source: str) -> str:
    if source in OTHERS:
        return OTHERS[source]
    if not source.startswith("docs/"):
        raise FileNotFoundError(f"{source} is no page of the site")
    return source.removeprefix("docs/")


def fmu_pages(fmus: Path) -> dict[str, str]:
    """A page for each FMU, and the first one, which lists them (`write_fmus.py`)."""
    written = runpy.run_path(str(HERE / "write_fmus.py"))
    pages = {f"fmus/{name}.md": f"# {name}\n\n{text}" for name, text in written["sections"](fmus).items()}
    return {"fmus/index.md": written["index"](fmus, "[{0}]({0}.md)".format), **pages}


def module_pages(modules: Sequence[str] = MODULES) -> dict[str, str]:
    """A page for each module, made of its docstrings when the site is built."""
    pages = {f"python/{m}.md": f"# `{m}`\n\n::: {m}\n    options: {{show_root_heading: false}}\n" for m in modules}
    listed = "\n".join(f"- [`{m}`]({m}.md)" for m in modules)
    return {"python/index.md": f"# Python\n\nThe names for users, by module.\n\n{listed}\n", **pages}


def claims_page() -> str:
    """The claims of the papers as one table (`write_results.py`)."""
    written = runpy.run_path(str(HERE / "write_results.py"))
    return str(written["one_table"](written["kept"]()))


def _cards(cards: Sequence[tuple[str, str, str, Mapping[str, Path]]], files: dict[str, Path], root: str = "") -> str:
    """Links with pictures: (target, title, text, pictures by what follows their address).

    The last may say the scheme of colors that each picture is for. `root` leads from the page to the root of the
    site: "" or "../".
    """
    parts = []
    for target, title, text, pictures in cards:
        shown = []
        for only, picture in pictures.items():
            place = picture.relative_to(HERE).as_posix()
            files[place] = picture
            shown.append(f'<img src="{root}{place}{only}" alt="" loading="lazy">')
        parts.append(
            '<a class="card"'
            f' href="{root}{target}">{"".join(shown)}<b>{title}</b>{f" <span>{text}</span>" if text else ""}</a>'
        )
    return "\n".join(['<div class="cards">', *parts, "</div>"])


def report_page(results: Path, files: dict[str, Path]) -> str:
    """The gallery: each report that a study has left in `results`, which is copied beside it (into `files`)."""
    cards = []
    for report in sorted(results.glob("*/report.html")):
        name = report.parent.name
        files[f"reports/{name}.html"] = report
        title = re.search(r"<title>(.*?)</title>", report.read_text(encoding="utf-8"), re.DOTALL)
        picture = PICTURES["report_picture"](name)
        cards.append(
            (
                f"reports/{name}.html",
                title[1].strip() if title else name,
                "",
                {"": picture} if picture.is_file() else {},
            )
        )
    none = "This site was built without any: `make studies` makes them, `make docs` then brings them here."
    return (
        "# Reports\n\nEvery study writes one: figures, tables, claims with their verdicts, parameters.\n\n"
        + (_cards(cards, files) if cards else none)
        + "\n"
    )


def live_cards(live: Path, files: dict[str, Path]) -> str:
    """Links from `how-to/` to the live pages in `live`, which are copied (into `files`); empty without any."""
    cards = []
    for page in sorted(live.glob("*.html")):
        files[f"live/{page.name}"] = page
        title, about = (
            re.search(p, page.read_text(encoding="utf-8"), re.DOTALL)
            for p in (r"<title>(.*?)</title>", r'name="description" content="(.*?)"')
        )
        assert title, page
        assert about, page
        pictures = {
            f"#only-{scheme}": PICTURES["live_picture"](page.stem, 1400, scheme) for scheme in PICTURES["SCHEMES"]
        }
        cards.append(
            (f"live/{page.name}", title[1], about[1], pictures if all(p.is_file() for p in pictures.values()) else {})
        )
    return _cards(cards, files, "../") if cards else ""


def start_pages(readme: str) -> dict[str, str]:
    """The start page, which is the beginning of the README, and a page with the rest of it."""
    start, heading, rest = readme.partition(_START_ENDS)
    more = "[Run an experiment; the papers, further features, limits and how to cite](about.md)"
    about = "# Experiments, papers and limits"
    return {"index.md": f"{start}{more}\n", "about.md": f"{about}\n\n{heading}{rest}"} if rest else {"index.md": readme}


def with_cards(text: str, cards: str, said: str) -> str:
    """A page with what it shows below its heading."""
    if not cards:
        return text
    heading, _, rest = text.partition("\n")
    return "\n".join([heading, "", said, "", cards, rest])


def executed(name: str, text: str) -> tuple[str, str]:
    """A page as a notebook that was run (JSON), and the page with what its code printed and drew.

    Raises:
        CellExecutionError: a block of code failed; it says which.
    """
    import nbformat
    from nbclient import NotebookClient

    title = posixpath.basename(name)
    book = nbformat.v4.new_notebook()
    book.cells = [
        (nbformat.v4.new_code_cell if code else nbformat.v4.new_markdown_cell)(part, id=f"{title}-{i}")
        for i, (code, part) in enumerate(_cells(text))
    ]
    with tempfile.TemporaryDirectory() as folder:
        Path(folder, "fmus").symlink_to(ROOT / "fmus", target_is_directory=True)
        client = NotebookClient(book, timeout=600, kernel_name="python3", record_timing=False)
        client.create_kernel_manager()
        client.execute(cwd=folder, env=environment())
    parts = []
    for cell in book.cells:
        if cell.cell_type == "markdown":
            parts.append(cell.source)
        else:
            parts += [f"```python\n{cell.source}\n```\n", *_outputs(cell.outputs)]
    heading, _, rest = "\n".join(parts).partition("\n")
    note = (
        f'\n<a href="{title}.ipynb" download>This page as a notebook</a>; what stands below its code is what it printed'
        " when the site was built.\n"
    )
    return nbformat.writes(book), f"{heading}\n{note}\n{rest}"


def _cells(text: str) -> Iterator[tuple[bool, str]]:
    last = 0
    for block in re.finditer(r"^```python\n(.*?)^```\n?", text, re.MULTILINE | re.DOTALL):
        yield False, text[last : block.start()]
        yield True, block[1].rstrip("\n")
        last = block.end()
    yield False, text[last:]


def _outputs(outputs: Sequence[Any]) -> Iterator[str]:
    for output in outputs:
        if output.output_type == "stream" and output.name == "stdout":
            yield f"```{{.text .out}}\n{output.text.rstrip()}\n```\n"


def gather(
    fmus: Path, results: Path, live: Path, run: Callable[[str, str], tuple[str, str]] = executed
) -> tuple[dict[str, str], dict[str, Path]]:
    """All pages by their place, and the files that are copied as they are."""
    pages = Pages()
    files = {name: HERE / name for name in ("site.css", "site.js", "iframe_worker.js")}
    for file in (ROOT / "README.md", ROOT / "benchmarks" / "README.md", *sorted(HERE.rglob("*.md"))):
        source = file.relative_to(ROOT).as_posix()
        if source != "docs/reference/fmus.md":
            pages.add(source, file.read_text(encoding="utf-8"))
    for name in NOTEBOOKS:
        book, pages.texts[f"{name}.md"] = run(name, pages.texts[f"{name}.md"])
        pages.texts[f"{name}.ipynb"] = book
    pages.texts |= fmu_pages(fmus)
    pages.texts |= module_pages()
    pages.texts["claims.md"] = claims_page()
    pages.texts["reports.md"] = report_page(results, files)
    pages.texts |= start_pages(pages.texts["index.md"])
    how_to = "how-to/live.md"
    pages.texts[how_to] = with_cards(pages.texts[how_to], live_cards(live, files), "Open one of these pages:")
    return pages.texts, files | pages.images


def build(fmus: Path, results: Path, live: Path, site: Path = SITE) -> None:
    """The whole site, anew.

    Raises:
        FileNotFoundError: a link of a page leads nowhere.
        Abort: something else does, or a page has no place; it was said what.
    """
    from mkdocs.commands.build import build as mkdocs_build
    from mkdocs.config import load_config

    texts, files = gather(fmus, results, live)
    shutil.rmtree(site, ignore_errors=True)
    for place, text in texts.items():
        (site / "pages" / place).parent.mkdir(parents=True, exist_ok=True)
        safe_files.write(site / "pages" / place, text)
    for place, file in files.items():
        (site / "pages" / place).parent.mkdir(parents=True, exist_ok=True)
        shutil.copyfile(file, site / "pages" / place)
    logging.basicConfig(level=logging.WARNING, format="%(levelname)s: %(message)s")  # what mkdocs has to say
    os.environ.setdefault("SOURCE_DATE_EPOCH", "0")  # of the dates in its list of pages
    config = load_config(str(HERE / "mkdocs.yml"), docs_dir=str(site / "pages"), site_dir=str(site / "html"))
    config["nav"] = _filled(config["nav"], [p for p in texts if p.endswith(".md")])
    mkdocs_build(config)
    (site / "html" / "404.html").unlink()  # of a server's root; a folder has none
    for page in (site / "html").rglob("*.html"):
        ours = posixpath.relpath("iframe_worker.js", page.parent.relative_to(site / "html").as_posix())
        text = page.read_text(encoding="utf-8").replace(_SHIM, ours)
        safe_files.write(page, text.replace(_SEARCH, f'{_SEARCH} aria-label="Search"'))


def _filled(nav: Any, places: Sequence[str]) -> Any:
    """Folders in the list of pages become the pages that they have, the first one first."""
    if isinstance(nav, str):
        if not nav.endswith("/"):
            return nav
        return sorted((p for p in places if p.startswith(nav)), key=lambda p: (not p.endswith("/index.md"), p))
    if isinstance(nav, dict):
        return {title: _filled(entry, places) for title, entry in nav.items()}
    return [_filled(entry, places) for entry in nav]


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--fmus", type=Path, default=ROOT / "fmus", help="folder with fmi3/")
    parser.add_argument("--results", type=Path, default=ROOT / "results", help="folder with the reports of studies")
    parser.add_argument(
        "--live", type=Path, default=ROOT / "build" / "live", help="folder with pages in which systems run"
    )
    arguments = parser.parse_args()
    if find_spec("mkdocs") is None or find_spec("nbclient") is None:
        sys.exit("the documentation site needs more packages: pip install -e '.[docs]', or `make docs`")
    build(arguments.fmus, arguments.results, arguments.live)
    print(SITE / "html" / "index.html")
