"""Write the results of the studies into `results.md`, the README's table of papers and the tables of readings.

make studies
python docs/write_results.py [results]

Claims and results of each `summary.json` are stored in `docs/results/NAME.json`, with the tables that a page of the
study shows, verdicts under several readings of a paper in `docs/results/readings/NAME.json`, and their combinations
(`--full`) in `docs/results/combinations/NAME.json`. The pages are generated from these files, so every number on them
comes from a run. Tests compare the pages with these files, and the files with new runs of the studies.
"""

from __future__ import annotations

import json
import re
import sys
import textwrap
from collections.abc import Iterable, Sequence
from importlib import import_module
from pathlib import Path
from typing import Any

from cosim.cli import NAMES
from cosim.experiments import EXPERIMENTS
from cosim.report.claims import OUTCOMES
from cosim.study.readings_report import LEGEND, SHORT
from fmu_sources.catalog import PAPERS

HERE = Path(__file__).parent
README = HERE.parent / "README.md"
KEPT = HERE / "results"
TABLES = {"handling": ("control-ideal", "control-obstacle", "control-turns", "control-hydraulic", "control-designs")}
"""Experiment -> tables of its report that its page, `reference/NAME.md`, shows."""
PAPERS_PAGE = HERE / "explanation" / "what-the-papers-do-not-say.md"
_CLAIM = (
    "id",
    "claim",
    "published",
    "result",
    "value",
    "unit",
    "verdict",
    "own",
    "criterion",
    "fitted",
    "reason",
    "source",
    "share",
    "conditions",
)

FEATURED = {
    "000": ("Brown et al.", "GPC of a HMMWV", "response cut, sine road", "gpc", "sine-gain"),
    "001": ("Donahue, Hedrick", "preview MPC", "gain by preview, unlimited pump", "hmmwv", "bump-preview"),
    "002": ("Das, Vinodh Kumar", "MPC of a quarter car", "force", "bench", "force-limit"),
    "003": ("Kale", "6x6 over trenches", "crossings", "trench", "passive-verdicts"),
    "004": ("Marzbanrad et al.", "preview LQ", "comfort index", "preview-lq", "index-both-preview"),
}
"""The README's row of each paper: authors, subject, quantity, and the experiment and claim that the numbers are of."""

JUDGED = [n for n in NAMES if import_module(EXPERIMENTS[n]).EXPERIMENT.study.claims]
"""Experiments whose study judges claims."""

READINGS = [n for n in NAMES if n.endswith("-readings")]
"""Experiments whose study judges the claims of others under several readings of the paper."""

IN_FULL = {SHORT[v] for v in OUTCOMES[:2]}
Summary = dict[str, Any]


def missing(studies: list[Summary]) -> str:
    """A sentence that names the experiments whose verdicts are not kept yet; nothing when all are."""
    names = sorted(set(JUDGED) - {s["experiment"] for s in studies})
    commands = ", ".join(f"`cosim study {n}`" for n in names)
    return f"Not in this table, because they were not run with the current FMUs: {commands}." if names else ""


def condense(summary: Summary) -> Summary:
    """What is kept of a study's `summary.json`: its claims, and the figures at the top of its report."""
    kept = {k: summary[k] for k in ("experiment", "title", "results")}
    tables = {n: summary["tables"][n] for n in TABLES.get(summary["experiment"], ())}
    kept |= {"tables": tables} if tables else {}
    return {**kept, "claims": [{k: claim[k] for k in _CLAIM} for claim in summary["claims"]]}


def kept(kind: str = ".") -> list[Summary]:
    """The summaries in the repository; `kind`: readings or combinations."""
    return [json.loads(p.read_text(encoding="utf-8")) for p in sorted((KEPT / kind).glob("*.json"))]


def condense_readings(summary: Summary) -> Summary:
    """What is kept of a study under several readings: each verdict in a word, and how many claims hold in full.

    Both by reading, of which the first is that of the main study.
    """
    table = summary["tables"]["map"]
    first = 1 + ("sentence" in table["columns"])
    names = table["columns"][first:]
    claims = {}
    for claim, *cells in table["rows"]:
        if claim != "in full":
            words = [str(cell).removeprefix("→ ").split()[0] for cell in cells[first - 1 :]]
            claims[claim] = dict(zip(names, words, strict=True))
    counts = {n: sum(found[n] in IN_FULL for found in claims.values()) for n in names}
    return {"experiment": summary["experiment"], "in full": counts, "claims": claims}


def condense_combinations(summary: Summary) -> Summary:
    """What is kept of all combinations: of each with its hold-out seeds, how many claims hold, and of which block."""
    blocks = {reading: cells for reading, *cells in summary["tables"]["blocks"]["rows"]}
    rows = [
        [reading, *blocks[reading][:2], *counts]
        for reading, *counts in summary["tables"]["counts"]["rows"]
        if counts[-1] not in (None, "")
    ]
    columns = ["reading", *summary["tables"]["blocks"]["columns"][1:3], *summary["tables"]["counts"]["columns"][1:]]
    return {"experiment": summary["experiment"], "columns": columns, "rows": rows}


def combinations_section(study: Summary) -> str:
    """The table, and the most that any combination reaches on hold-out seeds, beside the first reading."""
    rows = study["rows"]
    best = max(int(row[-1]) for row in rows)
    names = [f'"{row[0]}"' for row in rows if int(row[-1]) == best]
    both = max(int(row[1]) for row in rows if int(row[2]) == max(int(r[2]) for r in rows))
    return "\n\n".join(
        [
            _table(study["columns"], rows),
            _wrapped(
                f'On hold-out seeds {rows[0][-1]} claims hold in the reading "{rows[0][0]}". The most are {best}, in'
                f" {' and '.join(names)}. Where all claims about smooth roads hold, at most {both} about the curb does."
            ),
        ]
    )


def turned(study: Summary, reading: str) -> str:
    """Claims on which the verdict in a reading is not the main study's, by what becomes of it."""
    changes: dict[str, list[str]] = {}
    for claim, found in study["claims"].items():
        before, after = next(iter(found.values())), found[reading]
        if before != after:
            changes.setdefault(f"{before} → {after}", []).append(f"`{claim}`")
    return "; ".join(f"{change}: {', '.join(claims)}" for change, claims in changes.items()) or "none"


def readings_section(study: Summary) -> str:
    """Of each reading how many claims hold in full and which turn, and the claims that no reading reaches."""
    counts = study["in full"]
    main = next(iter(counts))
    rows = [[n, count, turned(study, n) if n != main else "-"] for n, count in counts.items()]
    never = [f"`{c}`" for c, found in study["claims"].items() if not IN_FULL & set(found.values())]
    return "\n\n".join(
        [
            _table(["reading", "claims in full", "claims that turn"], rows),
            _wrapped(
                f"{LEGEND} Of {len(study['claims'])} claims {counts[main]} hold in full {main}. In none of the"
                f" {len(rows)} readings do these hold in full: {', '.join(never) or 'none'}."
            ),
        ]
    )


def count(study: Summary, verdict: str) -> int:
    """How many claims of a study have a verdict."""
    return sum(c["verdict"] == verdict for c in study["claims"])


def table(studies: list[Summary]) -> str:
    """Verdicts by experiment; additional checks are counted separately."""
    head = ["experiment", "published claims", *OUTCOMES, "additional checks passed"]
    rows = []
    for s in studies:
        own = [c for c in s["claims"] if c["own"]]
        held = sum(c["verdict"] == "holds" for c in own)
        verdicts = [count(s, v) for v in OUTCOMES]
        rows.append([f"`{s['experiment']}`", len(s["claims"]) - len(own), *verdicts, f"{held} of {len(own)}"])
    return _table(head, rows)


def section(studies: list[Summary]) -> str:
    """The README's section: for each paper its subject, one published number beside ours, and the reproduced claims."""
    reproduced = "[claims reproduced](docs/results.md)"
    head = ["paper", "subject", "example", "published", "this project", reproduced, "studies"]
    rows = []
    for number, (authors, subject, quantity, *which) in FEATURED.items():
        own = [s for s in studies if paper(s["experiment"]) == number]
        claims = [c for s in own for c in s["claims"] if not c["own"]]
        featured = [c for s in own for c in s["claims"] if [s["experiment"], c["id"]] == which]
        calibrated = sum(c["verdict"] == "calibrated" for c in claims)
        reproduced = f"{sum(c['verdict'] == 'reproduced' for c in claims)} of {len(claims)}"
        reproduced += f", {calibrated} calibrated" if calibrated else ""
        names = ", ".join(f"`{s['experiment']}`" for s in own)
        title = f"{number} {authors}"
        rows += [[title, subject, quantity, c["published"], _ours(c), reproduced, names] for c in featured]
    return "\n\n".join(filter(None, [_table(head, rows), missing(studies)]))


def page(studies: list[Summary]) -> str:
    """All claims of all papers with published number, number of this project, verdict and criterion."""
    parts = [
        "# Results of the studies",
        _wrapped(
            "This page lists every claim of the papers with its verdict. A claim is one published sentence. It is"
            " judged as the paper states it: whether the statement holds and, if the paper gives a number, whether"
            " the number of this project is in a tolerance band around it. A claim that holds because a parameter"
            " was chosen with it in view is calibrated, not reproduced. A claim that was judged under several"
            " conditions, of which none is the paper's, is open if it holds under one and not under another."
            " Additional checks, which no paper states, are counted separately."
            " `make studies` creates the reports with figures and tables."
        ),
        table(studies),
        *filter(None, [missing(studies)]),
    ]
    for s in studies:
        parts.append(f"## {_heading(s)}")
        if s["results"]:
            parts.append(_wrapped(_figures(s)))
        for own, title in ((False, "claim"), (True, "additional check")):
            claims = [c for c in s["claims"] if c["own"] == own]
            if claims:
                head = [title, "expected" if own else "published", "this project", "verdict", "reason"]
                rows = [[_judged(c), _source(c), _result(c), c["verdict"], _reason(c)] for c in claims]
                parts.append(_table(head, rows))
    return "\n\n".join(parts) + "\n"


CLAIM_COLUMNS = ("paper", "claim", "source", "published", "this project", "verdict", "details")


def paper(experiment: str) -> str:
    """The short name of the paper that an experiment is of; empty for one of no paper."""
    found = re.search(r"\(paper (\d+)\)", import_module(EXPERIMENTS[experiment]).EXPERIMENT.title)
    return found[1] if found else ""


def one_table(studies: list[Summary]) -> str:
    """A page of the site: every published claim of every paper in one table, which readers can filter."""
    claims = [(paper(s["experiment"]), s, c) for s in studies for c in s["claims"] if not c["own"]]
    claims.sort(key=lambda row: row[0])
    rows = []
    for number, s, c in claims:
        details = f"[{s['experiment']}](results.md#{_anchor(_heading(s))})"
        rows.append([number, c["claim"], c["source"], c["published"], _result(c), c["verdict"], details])
    said = "; ".join(f"{sum(c['verdict'] == v for *_, c in claims)} {v}" for v in OUTCOMES)
    papers = "\n".join(f"- {number}: {title}" for number, title in sorted(PAPERS.items()))
    return f"""---
hide: [toc]
---

# Claims of the papers

All {len(claims)} published claims that are judged: {said}. A claim is judged as the paper states it. If it concerns \
more than one run, it is judged on the distribution over seeds, speeds or places. The link in the last column leads to \
the criterion, the fitted parameters, and the reason if a claim is not reproduced.

<div class="claims" markdown>

{_table(CLAIM_COLUMNS, rows)}

</div>

The papers:

{papers}
"""


def _heading(s: Summary) -> str:
    return f"{s['title']} (`{s['experiment']}`)"


def _anchor(heading: str) -> str:
    """As GitHub and the site make it."""
    return re.sub(r"[^\w\- ]", "", heading.lower()).replace(" ", "-")


def with_section(page: str, text: str, name: str = "results") -> str:
    """A page with the section of this name replaced: in the README that on results."""
    begin, end = f"<!-- {name}: written by docs/write_results.py -->", f"<!-- end of {name} -->"
    before, rest = page.split(begin)
    _, after = rest.split(end)
    return f"{before}{begin}\n\n{text}\n\n{end}{after}"


def with_readings(page: str) -> str:
    """The page on what papers do not say, with the sections of all studies that are kept."""
    for s in kept("readings"):
        page = with_section(page, readings_section(s), s["experiment"])
    for s in kept("combinations"):
        page = with_section(page, combinations_section(s), f"{s['experiment']} combinations")
    return page


def with_tables(page: str, study: Summary) -> str:
    """The page of a study, with the tables of its report that are kept; control laws are columns."""
    for name, table in study["tables"].items():
        head, *rows = zip(table["columns"], *table["rows"], strict=True)
        page = with_section(page, _table(head, rows), name)
    return page


def page_of(experiment: str) -> Path:
    """The page of a study that has tables."""
    return HERE / "reference" / f"{experiment}.md"


def _figures(s: Summary) -> str:
    figures = [f"{name} {_number(r['value'])}{_unit(r['unit'])}" for name, r in s["results"].items()]
    return f"{'; '.join(figures)}." if figures else ""


def _wrapped(text: str) -> str:
    return textwrap.fill(text, 120, break_long_words=False, break_on_hyphens=False)


def _number(value: Any) -> str:
    return f"{value:.4g}" if isinstance(value, float) else str(value)


def _unit(unit: str) -> str:
    return f" {unit}" if unit and unit != "-" else ""


def _ours(c: dict[str, Any]) -> str:
    """Our number for a claim, or under its first condition; its words where it is not one number."""
    c = c["conditions"][0] if c["conditions"] else c
    return c["result"] if c["value"] is None else f"{c['value']:.3g}{_unit(c['unit'])}"


def _judged(c: dict[str, Any]) -> str:
    fitted = f" *Fitted: {c['fitted']}.*" if c["fitted"] else ""
    share = f" *The claim {c['share']}.*" if c["share"] else ""
    return f"{c['claim']}. *Criterion: {c['criterion']}.*{fitted}{share}"


def _result(c: dict[str, Any]) -> str:
    """What came out; under several conditions, each with its verdict."""
    parts = [f"<br>{p['name']}: {p['result']} ({p['verdict']})" for p in c["conditions"]]
    return "".join([c["result"], *parts])


def _reason(c: dict[str, Any]) -> str:
    parts = [f"{p['name']}: {p['reason']}" for p in c["conditions"] if p["reason"]]
    return "<br>".join(parts) if parts else c["reason"]


def _source(c: dict[str, Any]) -> str:
    return f"{c['published']} ({c['source']})" if c["source"] else c["published"]


def _table(head: Sequence[Any], rows: Iterable[Sequence[Any]]) -> str:
    return "\n".join(map(_row, [head, ["---"] * len(head), *rows]))


def _row(cells: Sequence[Any]) -> str:
    return f"| {' | '.join(str(c).replace('|', '/').replace(chr(10), ' ') for c in cells)} |"


def write(results: Path) -> None:
    """Keep the summaries below `results` and write the pages; experiments that were not run stay as they are."""
    for summary in (json.loads(p.read_text(encoding="utf-8")) for p in sorted(results.glob("*/summary.json"))):
        name = summary["experiment"]
        if name in JUDGED:
            _keep(KEPT / f"{name}.json", condense(summary), sort_keys=True)
        elif "combinations" in summary["tables"]:
            _keep(KEPT / "combinations" / f"{name}.json", condense_combinations(summary))
        elif name in READINGS:
            _keep(KEPT / "readings" / f"{name}.json", condense_readings(summary))
    studies = kept()
    PAPERS_PAGE.write_text(with_readings(PAPERS_PAGE.read_text(encoding="utf-8")), encoding="utf-8")
    for s in studies:
        if s["experiment"] in TABLES:
            own = page_of(s["experiment"])
            own.write_text(with_tables(own.read_text(encoding="utf-8"), s), encoding="utf-8")
    (HERE / "results.md").write_text(page(studies), encoding="utf-8")
    README.write_text(with_section(README.read_text(encoding="utf-8"), section(studies)), encoding="utf-8")


def _keep(path: Path, kept: Summary, **how: bool) -> None:
    path.parent.mkdir(exist_ok=True)
    path.write_text(json.dumps(kept, indent=1, ensure_ascii=False, **how) + "\n", encoding="utf-8")


if __name__ == "__main__":
    write(Path(sys.argv[1] if len(sys.argv) > 1 else "results"))
