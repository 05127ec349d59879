"""The page's script without a page: V8, a canvas that notes what is drawn on it, and the colors of the style sheet."""

from __future__ import annotations

import json
import re
from typing import Any

from py_mini_racer import MiniRacer

from cosim.scenes.scene import Scene, scene_data, scene_script, scene_style

COLORS = dict(re.findall(r"--scene-([\w-]+): (#[0-9a-f]{6} #[0-9a-f]{6});", scene_style()))
"""Names with both colors, light and dark."""

_PAGE = """
var scheme = "light";
globalThis.getComputedStyle = () => ({
  getPropertyValue: (name) =>
    name === "--scene-scheme" ? scheme : name.startsWith("--scene-") ? COLORS[name.slice(8)] || "" : "Sans",
});
var notes = [], path = [], texts = [];
const finite = (...numbers) => numbers.forEach((n) => { if (!Number.isFinite(n)) throw new Error(`drawn at ${n}`); });
const pen = {
  setTransform: finite, save() {}, restore() {}, clip() {}, setLineDash() {}, rect: finite,
  fillRect(x, y, w, h) { finite(x, y, w, h); notes.push({ what: "rect", style: this.fillStyle, path: [x, y, w, h] }); },
  arc(x, y, r) { finite(x, y, r); if (r < 0) throw new Error("negative radius"); path.push(["arc", x, y, r]); },
  beginPath() { path = []; },
  moveTo(x, y) { finite(x, y); path.push(["move", x, y]); },
  lineTo(x, y) { finite(x, y); path.push(["line", x, y]); },
  closePath() { path.push(["close"]); },
  fill() { notes.push({ what: "fill", style: String(this.fillStyle), path }); },
  stroke() { notes.push({ what: "stroke", style: String(this.strokeStyle), width: this.lineWidth, path }); },
  fillText(text, x, y) { finite(x, y); texts.push(text); },
  strokeText() {},
  measureText: (text) => ({ width: 6.5 * text.length }),
  createLinearGradient(...at) { finite(...at); return { addColorStop() {} }; },
};
const canvas = { clientWidth: 800, clientHeight: 400, getContext: () => pen };
var values = {}, asked = [], road = () => null;
const show = (data, view) => {
  const seen = new SceneView(canvas, data, {
    value: (name) => values[name],
    ground: (side, x) => { asked.push([side, x]); return road(side, x); },
    reducedMotion: true,
  });
  seen.view = view;
  return seen;
};
"""


class Browser:
    """Runs the script; `see` makes a view, of which `run` reads what JavaScript says."""

    def __init__(self) -> None:
        self.engine = MiniRacer()
        self.engine.eval(f"const COLORS = {json.dumps(COLORS)};{_PAGE}{scene_script()}")

    def see(
        self, scene: Scene, values: dict[str, float] | None = None, view: str = "side", road: str = "() => null"
    ) -> None:
        """A view of a scene, as `view`, drawn once at time 0.

        With these values of its variables and a function for the road.
        """
        self.values(values or {})
        self.engine.eval(
            f"road = {road}; asked = []; var view = show({json.dumps(scene_data(scene))}, {json.dumps(view)})"
        )
        self.draw(0.0)

    def values(self, values: dict[str, float]) -> None:
        self.engine.eval(f"values = {json.dumps(values)}")

    def draw(self, time: float) -> None:
        self.engine.eval(f"notes = []; texts = []; view.draw({time})")

    def run(self, expression: str) -> Any:
        return json.loads(str(self.engine.eval(f"JSON.stringify({expression})")))
