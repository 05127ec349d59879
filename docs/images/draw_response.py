"""Draw `response.svg`, the result figure of the README, from the tables of the study.

cosim study gpc
python docs/images/draw_response.py [results/gpc]
"""

from __future__ import annotations

import csv
import sys
from pathlib import Path

import matplotlib as mpl
import matplotlib.pyplot as plt

STYLES = {  # as in the report
    "passive": {"color": "#777777", "linestyle": "-"},
    "implicit": {"color": "#d55e00", "linestyle": ":"},
    "explicit": {"color": "#0072b2", "linestyle": "--"},
    "preview": {"color": "#009e73", "linestyle": "-"},
}


def draw(results: Path, target: Path) -> None:
    """Left the response over speed, right the power the laws spend on it; both as the study's figure 7 has them."""
    with (results / "tables" / "comparison-sine.csv").open(newline="", encoding="utf-8") as file:
        rows = sorted(csv.DictReader(file), key=lambda r: float(r["speed [km/h]"]))
    mpl.rcParams.update({"svg.fonttype": "none", "svg.hashsalt": "suspension-fmus", "font.family": "sans-serif"})
    figure, (left, right) = plt.subplots(1, 2, figsize=(9.0, 3.4), layout="constrained")
    for law, style in STYLES.items():
        own = [r for r in rows if r["law"] == law and r["J [-]"]]
        look = {**style, "marker": "o", "markersize": 4, "linewidth": 1.8, "label": law}
        left.plot([float(r["speed [km/h]"]) for r in own], [float(r["J [-]"]) for r in own], **look)
        matched = [r for r in own if law != "passive" and r["matched"] != "not found"]
        if matched:
            right.plot(
                [float(r["speed [km/h]"]) for r in matched], [float(r["power [W]"]) / 1e3 for r in matched], **look
            )
    left.set(title="Response", xlabel="speed [km/h]", ylabel="response objective J (g, deg) [-]", ylim=(0, None))
    right.set(title="Power spent on it", xlabel="speed [km/h]", ylabel="actuator power [kW]", ylim=(0, None))
    left.legend(frameon=False)
    for axes in (left, right):
        axes.grid(color="#dddddd", linewidth=0.8)
        axes.spines[["top", "right"]].set_visible(False)
    figure.savefig(target, metadata={"Date": None})
    target.write_text("\n".join(line.rstrip() for line in target.read_text().splitlines()) + "\n")


if __name__ == "__main__":
    draw(Path(sys.argv[1] if len(sys.argv) > 1 else "results/gpc"), Path(__file__).with_name("response.svg"))
