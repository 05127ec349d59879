"""The page's script where it computes: histories that lose no peak, measures and verdicts, what is planned ahead.

In V8, without a page.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from py_mini_racer import MiniRacer

from cosim.export.web import page as web_page
from cosim.export.web.page import Measure

ASSETS = Path(web_page.__file__).parent / "assets"
RNG = np.random.default_rng(20)


@pytest.fixture(scope="module")
def script() -> MiniRacer:
    engine = MiniRacer()
    classes = (ASSETS / "page.js").read_text().partition("\n(async () =>")[0]
    engine.eval("".join((ASSETS / name).read_text() for name in ("plot.js", "drive.js", "variant.js")) + classes)
    return engine


def evaluated(script: MiniRacer, code: str) -> Any:
    """What the code returns."""
    return json.loads(script.eval(f"JSON.stringify((() => {{ {code} }})())"))


def history(values: np.ndarray, seconds: float, step: float = 0.01) -> str:
    rows = json.dumps([[v, -v] for v in values.tolist()])
    return (
        f"const h = new History(new Map([['a', 0], ['b', 1]]), 2, {step}, {seconds});"
        f"for (const row of {rows}) h.add(Float64Array.from(row));"
    )


def test_a_chart_loses_no_peak(script: MiniRacer) -> None:
    values = RNG.standard_normal(4000)
    values[1234], values[1235] = 50.0, -60.0
    series = evaluated(script, history(values, 100.0) + "return h.series('a', 5, 150);")
    times, drawn = np.array(series["times"]), np.array(series["values"])
    assert len(drawn) <= 2 * 200
    assert (drawn.max(), drawn.min()) == (50.0, -60.0)
    assert np.all(np.diff(times) >= 0)
    assert times[0] >= 5.0
    index = np.rint(times / 0.01).astype(int)
    assert np.array_equal(drawn, values[index])  # at its own time
    assert times[-1] > 39.9


def test_few_samples_are_all_drawn(script: MiniRacer) -> None:
    values = RNG.standard_normal(50)
    series = evaluated(script, history(values, 100.0) + "return h.series('b', 0, 400);")
    assert np.array_equal(series["values"], -values)


def test_old_samples_make_room(script: MiniRacer) -> None:
    values = np.arange(1000.0)
    found = evaluated(
        script,
        history(values, 2.0) + "return [h.time, h.oldest, h.value('a'), h.series('a', 0, 500).values, h.csv(['b'])];",
    )
    time, oldest, newest, drawn, csv = found
    assert (time, newest) == (9.99, 999.0)
    assert oldest == 1000 - 201
    assert drawn == values[oldest:].tolist()
    lines = csv.strip().split("\n")
    assert lines[0] == "time [s],b"
    assert len(lines) == 202
    assert [float(x) for x in lines[-1].split(",")] == pytest.approx([9.99, -999.0])


@pytest.mark.parametrize(
    ("low", "high", "tick"), [(0.0, 9.0, 2.0), (-1.0, 1.0, 1.0), (0.0, 0.061, 0.02), (-3e4, 2e4, 2e4), (1.0, 1.2, 0.1)]
)
def test_lines_at_round_numbers(script: MiniRacer, low: float, high: float, tick: float) -> None:
    bottom, top, found = evaluated(script, f"return StripChart.ticks({low}, {high});")
    assert found == pytest.approx(tick)
    assert bottom < low < high < top
    assert (top - bottom) / found >= 2


def test_what_is_planned_lies_ahead(script: MiniRacer) -> None:
    """Shown at 0.06 s is the command of the sample at 0.03 s.

    Its plan begins there, its prediction one sample later.
    """
    code = (
        "const names = ['c[1]', 'c[2]', 'c[3]'], h = new History(new Map(names.map((n, i) => [n, i])), 3, 0.01, 10);"
        "for (let k = 0; k <= 6; k++) h.add(Float64Array.from([k, 10 + k, 20 + k]));"
        "const of = first => StripChart.future(h, {names, step: 0.03, first});"
        "return [of(0), of(1), StripChart.future(h, undefined)];"
    )
    planned, predicted, nothing = evaluated(script, code)
    assert planned["times"] == pytest.approx([0.03, 0.06, 0.09])
    assert predicted["times"] == pytest.approx([0.06, 0.09, 0.12])
    assert planned["values"] == predicted["values"] == [6, 16, 26]
    assert planned["held"]
    assert not predicted["held"]
    assert nothing == {"times": [], "values": [], "reach": 0}


def test_dimensions_that_a_picture_does_not_follow(script: MiniRacer) -> None:
    code = (
        "const v = Object.create(Variant.prototype);"
        "v.system = {scene: {dimensions: ['car.a', 'car.b', 'car.c']}, values: {'car.b': 2}};"
        "v.variables = new Map([['car.a', {start: 1}], ['car.b', {start: 1}], ['car.c', {start: 3}]]);"
        "v.settings = new Map([['car.b', 2]]); const first = v.outdated;"
        "v.settings.set('car.a', 1.5); v.settings.set('car.b', 1); v.settings.set('car.c', 3); const then = v.outdated;"
        "v.system = {scene: null, values: {}}; return [first, then, v.outdated];"
    )
    assert evaluated(script, code) == [[], ["car.a", "car.b"], []]


def scored(
    script: MiniRacer, rows: np.ndarray, measures: list[Measure], finish: Any = None, interval: float = 0.001
) -> Any:
    data = {"interval": interval, "measures": [m.__dict__ for m in measures], "finish": finish}
    return evaluated(
        script,
        f"const place = new Map([['x.a', 0], ['x.b', 1]]), data = {json.dumps(data)}, rows ="
        f" {json.dumps(rows.tolist())};const score = new Score({{instance: {{place}}, value: name => ({{'x.length':"
        " 2.5})[name]}, data); score.restart(rows[0]);for (const row of rows.slice(1)) score.add(row);return"
        " {values: data.measures.map((m, i) => score.value(i)), verdict: score.verdict, failed: score.failed, n:"
        " score.n};",
    )


def test_measures(script: MiniRacer) -> None:
    rows = RNG.standard_normal((500, 2)) * [1.0, 3.0] - [0.0, 2.0]
    both = ["x.a", "x.b"]
    found = scored(
        script,
        rows,
        [
            Measure("peak", both),
            Measure("largest", both, "largest", "mm", 1e3),
            Measure("rms", both, "rms"),
            Measure("square", ["x.a"], "mean square"),
            Measure("absent", ["y.c"]),
        ],
    )
    expected = [np.abs(rows).max(), 1e3 * rows.max(), np.sqrt((rows**2).mean(axis=0)).max(), (rows[:, 0] ** 2).mean()]
    assert found["values"] == [*(pytest.approx(v, rel=1e-12) for v in expected), None]
    assert (found["verdict"], found["n"]) == ("", 499)


@pytest.mark.parametrize(
    ("limit", "far", "verdict", "failed"),
    [(10.0, 300, "passed", []), (1.0, 300, "failed", ["height"]), (10.0, 240, "stuck", [])],
)
def test_verdicts(script: MiniRacer, limit: float, far: int, verdict: str, failed: list[str]) -> None:
    """Over where x.a - x.length >= 0, or after 0.4 s; what comes later does not count."""
    rows = np.column_stack([np.minimum(0.01 * np.arange(600), 0.01 * far), np.full(600, 2.0)])
    rows[500:, 1] = 1e6
    finish = {"when": {"terms": {"x.a": 1.0, "x.length": -1.0}, "offset": 0.0}, "patience": 0.4}
    found = scored(script, rows, [Measure("height", ["x.b"], limit=limit)], finish)
    assert (found["verdict"], found["failed"]) == (verdict, failed)
    assert found["n"] == (400 if verdict == "stuck" else 250)
    assert found["values"] == [2.0]


def test_a_run_of_given_length_is_over_then(script: MiniRacer) -> None:
    found = scored(script, np.zeros((600, 2)), [], {"when": None, "patience": 0.3})
    assert (found["verdict"], found["n"]) == ("over", 300)


STEERING = {
    "rate": 4.0,
    "back": 8.0,
    "rest": 0.0,
    "low": -3.0,
    "high": 3.0,
    "raised_by": ["ArrowLeft", "a"],
    "lowered_by": ["ArrowRight"],
    "axis": [0, -1],
    "button": None,
}
PEDAL = STEERING | {"low": 0.0, "high": 1.0, "lowered_by": [], "axis": None, "button": 7}


def driven(script: MiniRacer, spec: dict[str, Any], *hands: tuple[list[str], Any], value: float = 0.0) -> list[float]:
    """Values after steps of 0.1 s with these keys, and a gamepad (axis 0, button 7) or None."""
    code = (
        f"const d = new Drive({json.dumps(spec)}); let v = {value}; return {json.dumps(hands)}.map(([keys, pad]) => {{"
        "const buttons = []; if (pad) buttons[7] = { value: pad[1] };"
        "v = d.next(v, 0.1, new Set(keys), pad && { axes: [pad[0]], buttons }); return v; });"
    )
    return evaluated(script, code)


def test_a_held_key_moves_at_its_rate_and_what_is_released_returns(script: MiniRacer) -> None:
    left, right, none = (["a"], None), (["ArrowRight"], None), ([], None)
    found = driven(script, STEERING, left, left, left, none, none, none)
    assert found == pytest.approx([0.4, 0.8, 1.2, 0.4, 0.0, 0.0])
    assert driven(script, STEERING, *[left] * 20)[-1] == 3.0  # its end
    found = driven(script, STEERING, left, left, right, right, right)
    assert found == pytest.approx([0.4, 0.8, 0.0, -0.4, -0.8])  # back to rest it is as fast as released
    assert driven(script, STEERING, (["a", "ArrowRight"], None), value=1.0) == [1.0]


def test_what_nobody_holds_stays_where_the_slider_has_it(script: MiniRacer) -> None:
    assert driven(script, STEERING, ([], None), ([], [0.05, 0.0]), value=1.7) == [1.7, 1.7]


def test_a_gamepad_gives_places_and_keys_come_first(script: MiniRacer) -> None:
    full = driven(script, STEERING, *[([], [-1.0, 0.0])] * 9)
    assert full[:2] == pytest.approx([0.8, 1.6])  # no faster than a hand
    assert full[-1] == 3.0
    half = driven(script, STEERING, *[([], [0.56, 0.0])] * 9)  # half of the way beyond the dead zone
    assert half[-1] == pytest.approx(-1.5)
    assert driven(script, STEERING, (["a"], [1.0, 0.0])) == pytest.approx([0.4])
    assert driven(script, PEDAL, *[([], [0.0, 0.6])] * 3)[-1] == pytest.approx(0.6)


def test_a_lost_gamepad_has_released_everything(script: MiniRacer) -> None:
    found = driven(script, STEERING, ([], [-1.0, 0.0]), ([], [-1.0, 0.0]), ([], None), ([], None), ([], None))
    assert found == pytest.approx([0.8, 1.6, 0.8, 0.0, 0.0])
    assert driven(script, PEDAL, ([], [0.0, 1.0]), ([], None), ([], None)) == pytest.approx([0.8, 0.0, 0.0])


def test_gamepads_that_come_and_go(script: MiniRacer) -> None:
    code = (
        "globalThis.navigator = {}; const hands = new Hands(), words = [];"
        "const look = (pads) => { navigator.getGamepads = pads && (() => pads);"
        "words.push([Boolean(hands.pad()), hands.word]); };"
        "const pad = { connected: true, mapping: 'standard', id: 'P' };"
        "look(null); look([null, { ...pad, mapping: '' }]); look([pad]); look([null]); look([pad]);"
        "return words;"
    )
    nothing, strange, there, lost, again = evaluated(script, code)
    assert nothing == [False, ""]
    assert strange == [False, 'The browser does not know the layout of "P", so it cannot drive.']
    assert there == again == [True, "A gamepad drives."]
    assert lost == [False, "The gamepad is lost: what it held returns to rest."]


def test_keys_and_parts_of_a_gamepad_in_words(script: MiniRacer) -> None:
    code = "return [{}, {}].map((spec) => new Drive(spec).words);"
    specs = iter(json.dumps(s) for s in (STEERING, PEDAL))
    words = evaluated(script, "".join(part + next(specs, "") for part in code.split("{}")))
    assert words == ["\u2190 A / \u2192, left stick", "\u2190 A, right trigger"]


FRAMES = """
let waiting = new Map(), requests = 0, runs = 0;
globalThis.performance = { now: () => 0 };
globalThis.requestAnimationFrame = f => (waiting.set(++requests, f), requests);
globalThis.cancelAnimationFrame = id => waiting.delete(id);
const tick = now => {
  const due = [...waiting.values()];
  waiting.clear();
  for (const f of due) f(now);
  return due.length;
};
const page = Object.create(Page.prototype, { time: { value: 0 }, pace: { value: 1 } });
const variant = { over: false, cost: 0, run() { runs += 1; } };
Object.assign(page, { data: { interval: 0.001 }, drives: [], credit: 0, variants: [variant], $: () => ({}) });
Object.assign(page, { draw() {}, describe() {}, report() {}, tell() {} });
"""


def test_one_loop_draws_however_often_it_is_paused(script: MiniRacer) -> None:
    """Pause and play within one frame; then a run takes one frame at a time, and a pause ends it."""
    found = evaluated(
        script,
        FRAMES
        + "page.play(); tick(0); page.pause(); page.play(); page.pause(); page.play(); page.play();"
        + "const counts = [tick(16), tick(32), tick(48)]; page.pause(); return { counts, steps: runs, after: [tick(64),"
        " tick(80)] };",
    )
    assert found == {"counts": [1, 1, 1], "steps": 2, "after": [1, 0]}
