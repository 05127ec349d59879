"""Take the pictures of the live pages and of the reports: `images/live` and `images/reports`.

make pictures

In Chromium, at the widths and color schemes in which people read; pages and reports have to be there (`build/live`,
`results`). What is missing is named, and its picture stays as it was.
"""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import Any

from cosim.experiments import EXPERIMENTS
from cosim.experiments.live_pages import shown

HERE = Path(__file__).parent
ROOT = HERE.parent
IMAGES = HERE / "images"
WIDTHS = {390: 844, 1400: 900}
"""Width of a window -> its height [px]."""
SCHEMES = ("light", "dark")
REPORT_WIDTH = 900
DRIVEN = {"handling": 3.9, "hmmwv": 8.0, "preview-lq": 6.5, "ride": 8.0, "semi-active": 7.0, "trench": 4.0}
"""Live page -> seconds until there is something to see."""
HELD = {"handling": [("ArrowLeft", 0.35), ("", 0.4), ("ArrowRight", 0.25), ("", 0.6)]}
"""Live page -> keys that are held then, one after the other, and for how long [s]; "": none."""
FIGURES = {"hmmwv": "figure-1-9", "three-axle": "figures-5-5-to-5-10"}
"""Report -> the figure that is shown of it; of others it is the first."""


def live_picture(name: str, width: int, scheme: str) -> Path:
    """Where the picture of a live page is."""
    return IMAGES / "live" / f"{name}-{width}-{scheme}.jpg"


def report_picture(name: str) -> Path:
    """Where the picture of a report is: one of its figures."""
    return IMAGES / "reports" / f"{name}.jpg"


def jobs(live: Path, results: Path) -> list[dict[str, Any]]:
    """What is to be taken of which file."""
    pages: list[dict[str, Any]] = [
        {
            "page": live / f"{name}.html",
            "out": live_picture(name, width, scheme),
            "width": width,
            "height": height,
            "scheme": scheme,
            "seconds": DRIVEN[name],
            "held": HELD.get(name, []),
        }
        for name in shown()
        for width, height in WIDTHS.items()
        for scheme in SCHEMES
    ]
    reports: list[dict[str, Any]] = [
        {
            "page": results / name / "report.html",
            "out": report_picture(name),
            "width": REPORT_WIDTH,
            "height": 1200,
            "scheme": "light",
            "seconds": 1.0,
            "element": f'[data-plot="data-{FIGURES[name]}"]' if name in FIGURES else "[data-plot]",
        }
        for name in EXPERIMENTS
    ]
    return [*pages, *reports]


def take(live: Path, results: Path) -> None:
    """Take those of the files that there are."""
    sys.path.insert(0, str(ROOT / "tests"))
    from browsers import script_output

    found = jobs(live, results)
    for missing in sorted({str(job["page"]) for job in found if not job["page"].is_file()}):
        print(
            f"{missing} is not there: its pictures stay as they are (make studies, python -m"
            " cosim.experiments.live_pages build/live)"
        )
    there = [job for job in found if job["page"].is_file()]
    for job in there:
        job["out"].parent.mkdir(parents=True, exist_ok=True)
    script_output(HERE / "pictures.mjs", json.dumps(there, default=str))
    print(f"{len(there)} pictures")


if __name__ == "__main__":
    take(ROOT / "build" / "live", Path(sys.argv[1]) if len(sys.argv) > 1 else ROOT / "results")
