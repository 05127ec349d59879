/* The page: systems run in step with the clock, controls set their variables, scenes and charts show them. */

const COLORS = 4; // --line-0 to --line-3 of the style sheet
const DASHES = [[], [6, 3], [2, 2], [8, 3, 2, 3]];
const SECONDS = 10; // in a chart, where runs have no length of their own
const BUDGET = 0.7; // of the time that passes, for computing
const LONGEST = 0.1; // s of it that count: a page that was out of sight does not catch up
const FIRST = 20; // steps, before their cost is known
const SMOOTH = 1; // s, window of the displayed pace
const DRIVEN = 0.01; // s of simulated time, for which what a person drives keeps its value
const TOLD = 100; // ms between two updates of the displayed numbers of a running system
// frames, of what need not be drawn in each: in turn, so that no frame is long
const EVERY = { chart: 3, hidden: 6, hiddenChart: 18 };

class Page {
  constructor(data, module) {
    Object.assign(this, {
      data,
      module,
      variants: [],
      views: [],
      charts: [],
      drives: [],
      hands: new Hands(),
      running: false,
      credit: 0,
      last: null,
      factor: null,
    });
    this.reduced = matchMedia("(prefers-reduced-motion: reduce)").matches;
    this.shared = new Map(); // settings that a person made: they outlive a change of course
    this.$ = (id) => document.getElementById(id);
    this.build();
    this.choose(0);
  }

  get time() {
    return Math.max(...this.variants.map((v) => v.steps)) * this.data.interval;
  }

  /* ---------------------------------------------------------------- what there is */

  build() {
    const { data, $ } = this;
    this.seconds = data.finish && !data.finish.when ? data.finish.patience : SECONDS;
    const groups = $("group");
    data.groups.forEach((name, i) => groups.add(new Option(name, i)));
    groups.closest("label").hidden = data.groups.length < 2;
    groups.addEventListener("change", () => this.choose(Number(groups.value)));
    $("run").addEventListener("click", () => this.toggle());
    $("step").addEventListener("click", () => {
      this.pause();
      this.advance(Math.max(1, Math.round(0.01 / data.interval)));
      this.draw();
    });
    $("reset").addEventListener("click", () => this.restart());
    this.pace = Number($("pace").value);
    $("pace").addEventListener("change", () => {
      this.pace = Number($("pace").value);
      this.last = this.factor = null;
    });
    $("defaults").addEventListener("click", () => this.defaults());
    $("csv").addEventListener("click", () => this.save());
    $("filter").addEventListener("input", () => this.filter());
    document.addEventListener("keydown", (e) => this.key(e));
    document.addEventListener("keyup", (e) => this.hands.keys.delete(Hands.name(e.key)));
    document.addEventListener("visibilitychange", () => {
      this.last = this.factor = null;
    });
    addEventListener("blur", () => this.hands.keys.clear());
    // who has chosen with a pointer drives with the keys again
    for (const event of ["pointerdown", "keydown"])
      addEventListener(event, () => (this.pointed = event === "pointerdown"), { capture: true });
    document.addEventListener("change", ({ target }) => {
      if (this.drives.length && this.pointed && target.type !== "number") target.blur();
    });
    for (const event of ["gamepadconnected", "gamepaddisconnected"])
      addEventListener(event, () => {
        this.hands.pad();
        this.tell();
      });
    new ResizeObserver(() => this.draw()).observe(document.body);
    this.seen = new Set(); // canvases in sight
    this.watch = new IntersectionObserver((entries) => {
      for (const e of entries) e.isIntersecting ? this.seen.add(e.target) : this.seen.delete(e.target);
    });
    matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => {
      for (const { view } of this.views) view.restyle();
      this.restyle();
      this.draw();
    });
    this.restyle();
    const views = [...new Set(data.systems.flatMap((s) => (s.scene ? s.scene.views : [])))];
    if (views.length) this.camera = SceneView.from(views[0]); // one for all scenes
    for (const name of views) $("view").add(new Option(name, name));
    $("view").addEventListener("change", () => {
      for (const { view } of this.views.slice(0, 1)) view.view = $("view").value;
      this.moved();
    });
    $("heights").addEventListener("change", () => {
      for (const { view } of this.views) view.exaggeration = Number($("heights").value);
      this.draw();
    });
    $("measures").closest("section").hidden = !data.measures.length;
    this.controls = data.controls.map((c) => this.control(c, $("controls")));
    this.drives = this.controls.filter((c) => c.drive);
    $("controls").closest("section").hidden = !data.controls.length;
  }

  /** Reads the colors of lines again. */
  restyle() {
    const style = getComputedStyle(document.documentElement);
    this.colors = Array.from({ length: COLORS }, (_, i) => style.getPropertyValue(`--line-${i}`));
    for (const chart of this.charts) chart.restyle();
  }

  /** The systems of a group, on one road and one clock. */
  choose(group) {
    this.watch.disconnect();
    this.seen.clear();
    const chosen = this.data.systems.filter((s) => s.group === group);
    this.variants = chosen.map((s, i) => new Variant(this.module, s, this.data, i));
    for (const variant of this.variants)
      for (const [name, value] of this.shared) if (variant.variables.has(name)) variant.settings.set(name, value);
    this.scenes();
    this.plots();
    this.table();
    for (const { canvas } of [...this.views, ...this.charts]) this.watch.observe(canvas);
    this.parameters();
    this.restart();
    for (const c of this.controls) c.show();
  }

  scenes() {
    const room = this.$("scenes");
    room.replaceChildren();
    this.views = [];
    for (const variant of this.variants) {
      const figure = document.getElementById("scene").content.firstElementChild.cloneNode(true);
      const [title, canvas] = [figure.querySelector("figcaption b"), figure.querySelector("canvas")];
      title.textContent = variant.title;
      title.style.setProperty("--swatch", `var(--line-${variant.number % COLORS})`);
      variant.figure = figure;
      variant.status = figure.querySelector(".status");
      room.append(figure);
      if (!variant.system.scene) {
        canvas.remove();
        continue;
      }
      const ground = (side, x) => (variant.probe ? variant.probe.height(side, x) : null);
      const view = new SceneView(canvas, variant.system.scene, {
        value: (name) => variant.value(name),
        ground,
        reducedMotion: this.reduced,
        camera: this.camera,
        changed: () => this.moved(),
      });
      view.exaggeration = Number(this.$("heights").value);
      variant.view = view;
      variant.readings = view.readings().map(({ label, unit }) => {
        const item = document.createElement("div");
        item.append(Object.assign(document.createElement("dt"), { textContent: unit ? `${label} [${unit}]` : label }));
        const number = item.appendChild(document.createElement("dd"));
        figure.querySelector("dl").append(item);
        return number;
      });
      this.views.push({ view, canvas, variant });
    }
    room.classList.toggle("several", this.variants.length > 1);
    for (const id of ["view", "heights"]) this.$(id).closest("label").hidden = !this.views.length;
  }

  /** Measures by system. */
  table() {
    const head = this.$("measures").tHead,
      body = this.$("measures").tBodies[0];
    head.replaceChildren();
    body.replaceChildren();
    const cell = (row, tag, text, scope) => {
      const e = document.createElement(tag);
      e.textContent = text;
      if (scope) e.scope = scope;
      row.append(e);
      return e;
    };
    const title = head.insertRow();
    cell(title, "th", "", "col");
    for (const v of this.variants) cell(title, "th", v.title, "col");
    const limits = this.data.measures.some((m) => m.limit !== null);
    if (limits) cell(title, "th", "limit", "col");
    this.cells = this.data.measures.map((m) => {
      const row = body.insertRow();
      const unit = m.relative ? `% of ${this.variants[0].title.toLowerCase()}` : m.unit;
      cell(row, "th", unit ? `${m.label} [${unit}]` : m.label, "row");
      const cells = this.variants.map(() => cell(row, "td", ""));
      if (limits) cell(row, "td", m.limit === null ? "" : m.limit.toString());
      return cells;
    });
    if (!this.data.finish || !this.data.finish.when) return;
    const row = body.insertRow();
    cell(row, "th", "outcome", "row");
    this.outcomes = this.variants.map(() => cell(row, "td", ""));
    if (limits) cell(row, "td", "");
  }

  fill() {
    this.variants.forEach((v, j) => {
      this.data.measures.forEach((m, i) => {
        const own = v.score.value(i),
          first = m.relative ? this.variants[0].score.value(i) : 100;
        const value = own === null ? null : (100 * own) / first,
          over = m.limit !== null && value > m.limit;
        const text =
          value === null || !Number.isFinite(value) ? "–" : `${value.toFixed(m.decimals)}${over ? " ✗" : ""}`;
        if (this.cells[i][j].textContent !== text) this.cells[i][j].textContent = text;
        this.cells[i][j].classList.toggle("over", over);
      });
      if (!this.data.finish || !this.data.finish.when) return;
      const { verdict, failed } = v.score;
      const outcome = v.failure ? "stopped" : verdict || (v.instance.ended ? "ended" : "on its way");
      this.outcomes[j].textContent = outcome === "failed" ? `failed: ${failed.join(", ")}` : outcome;
      this.outcomes[j].className = { "on its way": "", passed: "good" }[outcome] ?? "over";
    });
  }

  /** The value of a control: of the first variant that has it. */
  control(spec, room) {
    const row = document.getElementById("control").content.firstElementChild.cloneNode(true);
    const [label, range, number, unit] = ["label", "input[type=range]", "input[type=number]", ".unit"].map((s) =>
      row.querySelector(s),
    );
    const check = row.querySelector("input[type=checkbox]"),
      select = row.querySelector("select");
    const id = `c${(Page.ids = (Page.ids || 0) + 1)}`;
    label.textContent = spec.label;
    label.title = spec.text || spec.label;
    const main = spec.kind === "check" ? check : spec.kind === "choice" ? select : number;
    main.id = id;
    label.htmlFor = id;
    range.setAttribute("aria-label", spec.label);
    for (const e of [range, number, unit, check, select]) e.hidden = true;
    const shown = (v) => v * spec.factor + spec.offset,
      meant = (y) => (y - spec.offset) / spec.factor;
    const apply = (y) => {
      this.say("");
      if (drive) drive.held = false; // it stays where it is put
      const restart = this.set(spec.names, meant(y), spec.follows);
      for (const c of [...this.controls, ...(this.all || [])]) c.show();
      if (restart) this.restartSoon();
    };
    const all = () => this.variants.flatMap((v) => spec.names.filter((n) => v.variables.has(n)).map((n) => v.value(n)));
    const present = () => all()[0] ?? NaN;
    const show = () => {
      const value = present();
      row.hidden = Number.isNaN(value);
      row.classList.toggle(
        "differs",
        all().some((v) => v !== value),
      );
      if (spec.kind === "check") check.checked = value !== 0;
      else if (spec.kind === "choice") select.value = String(value);
      else {
        const y = Number(shown(value).toPrecision(6));
        number.value = y;
        range.value = y;
        range.setAttribute("aria-valuetext", `${y} ${spec.unit}`);
      }
    };
    if (spec.kind === "check") {
      check.hidden = false;
      check.addEventListener("change", () => apply(check.checked ? 1 : 0));
    } else if (spec.kind === "choice") {
      select.hidden = false;
      spec.choices.forEach(([text, value]) => select.add(new Option(text, value)));
      select.addEventListener("change", () => apply(Number(select.value)));
    } else {
      number.hidden = false;
      unit.hidden = !spec.unit;
      unit.textContent = spec.unit;
      const bounded = spec.min !== null && spec.max !== null;
      range.hidden = !bounded;
      for (const e of [range, number]) {
        if (spec.min !== null) e.min = spec.min;
        if (spec.max !== null) e.max = spec.max;
        e.step = e === number ? "any" : spec.step;
      }
      range.addEventListener("input", () => apply(Number(range.value)));
      number.addEventListener("change", () => {
        const y = Number(number.value);
        const outside = (spec.min !== null && y < spec.min) || (spec.max !== null && y > spec.max);
        if (number.value === "" || !Number.isFinite(y) || outside || (spec.whole && !Number.isInteger(y))) {
          const limits = bounded
            ? ` from ${spec.min} to ${spec.max}`
            : spec.min !== null
              ? ` of ${spec.min} or more`
              : spec.max !== null
                ? ` of ${spec.max} or less`
                : "";
          show();
          this.say(
            `${spec.label}: give a ${spec.whole ? "whole " : ""}number${limits}${spec.unit ? ` ${spec.unit}` : ""}.`,
          );
        } else apply(y);
      });
    }
    const drive = spec.drive ? new Drive(spec.drive) : null,
      keys = drive ? drive.words : spec.keys.map((k) => Page.KEYS[k] || k).join(" ");
    if (keys) label.append(Object.assign(document.createElement("kbd"), { textContent: keys }));
    room.append(row);
    return {
      spec,
      show,
      row,
      drive,
      // over a time that is simulated next
      move: (seconds, pad) => {
        const before = present(),
          value = drive.next(before, seconds, this.hands.keys, pad);
        if (!row.hidden && value !== before) this.set(spec.names, value, spec.follows);
      },
      // at the start of a run, unless it was put elsewhere
      release: () => {
        if (drive.held) this.set(spec.names, spec.drive.rest, spec.follows);
        drive.held = false;
      },
      nudge: (by) => {
        const y = shown(present()) + by * spec.step * (spec.whole ? 1 : 2);
        apply(Math.min(spec.max, Math.max(spec.min, y)));
      },
    };
  }

  /** A control for each parameter and input, component by component. */
  parameters() {
    const room = this.$("parameters");
    room.replaceChildren();
    this.all = [];
    const components = new Map();
    for (const variant of this.variants)
      for (const v of variant.variables.values()) {
        if (v.role === "output") continue;
        const component = v.name.slice(0, v.name.indexOf("."));
        if (!components.has(component)) components.set(component, new Map());
        components.get(component).set(v.name, v);
      }
    for (const [component, variables] of components) {
      const box = document.createElement("details");
      box.append(Object.assign(document.createElement("summary"), { textContent: `${component} (${variables.size})` }));
      box.addEventListener("toggle", () => {
        // made when they are first looked at
        if (!box.open || box.childElementCount > 1) return;
        for (const v of variables.values()) this.all.push(this.control(Page.plain(v, component), box));
        this.filter();
        for (const c of this.all) c.show();
      });
      room.append(box);
    }
    this.$("filter").value = "";
  }

  static plain(v, component) {
    const d = v.display || { unit: v.unit, factor: 1, offset: 0 };
    const shown = (x) => (x === null ? null : Number((x * d.factor + d.offset).toPrecision(9)));
    const narrow =
      v.min !== null && v.max !== null && Math.abs(v.max - v.min) <= 1e3 * Math.max(Math.abs(v.start), 1e-3);
    return {
      label: v.name.slice(component.length + 1),
      text: v.text,
      names: [v.name],
      unit: d.unit,
      factor: d.factor,
      offset: d.offset,
      keys: [],
      kind: v.type === 2 ? "check" : "number",
      min: shown(v.min),
      max: shown(v.max),
      choices: [],
      whole: v.type === 1,
      follows: {},
      step: v.type === 1 ? 1 : narrow ? Number(((shown(v.max) - shown(v.min)) / 200).toPrecision(2)) : "any",
    };
  }

  filter() {
    const words = this.$("filter").value.toLowerCase().split(/\s+/).filter(Boolean);
    if (words.length) for (const box of this.$("parameters").children) box.open = true;
    for (const c of this.all || []) {
      const text = `${c.spec.names[0]} ${c.spec.text}`.toLowerCase();
      c.row.classList.toggle("out", !words.every((w) => text.includes(w)));
    }
  }

  plots() {
    const room = this.$("plots"),
      chosen = this.charts.map((c) => c.signal.name);
    room.replaceChildren();
    const outputs = new Map();
    for (const variant of this.variants)
      for (const v of variant.variables.values())
        if (v.role === "output" || variant.driven.includes(v.name)) outputs.set(v.name, v);
    const names = (chosen.length ? chosen : this.data.plots).filter((n) => outputs.has(n));
    while (names.length < Math.min(3, outputs.size)) names.push([...outputs.keys()].find((n) => !names.includes(n)));
    this.charts = names.map((name, i) => {
      const figure = document.getElementById("plot").content.firstElementChild.cloneNode(true);
      const select = figure.querySelector("select"),
        canvas = figure.querySelector("canvas");
      select.setAttribute("aria-label", `signal of chart ${i + 1}`);
      for (const n of outputs.keys()) select.add(new Option(n, n));
      select.value = name;
      room.append(figure);
      const chart = new StripChart(canvas, this.signal(outputs.get(name)));
      chart.unit = figure.querySelector(".unit");
      chart.unit.textContent = chart.signal.unit;
      select.addEventListener("change", () => {
        chart.signal = this.signal(outputs.get(select.value));
        chart.range = null;
        chart.unit.textContent = chart.signal.unit;
        this.draw();
      });
      return chart;
    });
  }

  signal(v) {
    const d = v.display || { unit: v.unit, factor: 1, offset: 0 };
    return { name: v.name, unit: d.unit, factor: d.factor, offset: d.offset };
  }

  /* ---------------------------------------------------------------- what happens */

  /**
   * Sets variables, and those that follow them, in every variant that has them; returns whether they count only after a
   * restart.
   */
  set(names, value, follows = {}) {
    let restart = false;
    for (const name of names) {
      this.shared.set(name, value);
      for (const variant of this.variants) restart = variant.set(name, value) || restart;
    }
    for (const [name, sums] of Object.entries(follows)) {
      const [variant] = this.variants.filter((v) => v.variables.has(name));
      if (!variant) continue;
      const of = (sum) =>
        Object.entries(sum.terms).reduce((total, [n, factor]) => total + factor * variant.value(n), sum.offset);
      restart = this.set([name], Math.max(...sums.map(of))) || restart;
    }
    return restart;
  }

  /** Resets all parameters. */
  defaults() {
    this.shared.clear();
    this.choose(Number(this.$("group").value));
  }

  restartSoon() {
    clearTimeout(this.soon);
    this.soon = setTimeout(() => this.restart(), 150);
  }

  restart() {
    clearTimeout(this.soon);
    for (const c of this.drives) c.release();
    for (const { view } of this.views) view.reset();
    for (const variant of this.variants) variant.restart();
    for (const chart of this.charts) chart.range = null;
    this.credit = 0;
    this.say("");
    this.report();
    this.draw();
  }

  toggle() {
    this.running ? this.pause() : this.play();
  }

  play() {
    if (this.variants.every((v) => v.over)) this.restart();
    this.running = true;
    this.last = this.factor = null;
    this.$("run").textContent = "Pause";
    this.nextFrame();
  }

  /** Requests the next frame; a request that is still open, of a run that was paused since, is withdrawn. */
  nextFrame() {
    cancelAnimationFrame(this.request);
    this.request = requestAnimationFrame((t) => this.frame(t));
  }

  pause() {
    this.running = false;
    this.$("run").textContent = "Run";
    this.draw();
    this.describe();
  }

  /** Steps of all variants, under what a person drives. */
  advance(n) {
    const piece = this.drives.length ? Math.max(1, Math.round(DRIVEN / this.data.interval)) : n,
      pad = this.drives.length ? this.hands.pad() : null;
    for (let left = n; left > 0; left -= piece) {
      const steps = Math.min(piece, left);
      for (const c of this.drives) c.move(steps * this.data.interval, pad);
      for (const variant of this.variants) variant.run(steps);
    }
    this.report();
    if (this.running && this.variants.every((v) => v.over)) this.pause();
  }

  frame(now) {
    if (!this.running) return;
    if (this.last !== null) {
      const passed = (now - this.last) / 1000,
        before = this.time;
      this.credit += (passed * this.pace) / this.data.interval;
      const cost = this.variants.reduce((sum, v) => sum + v.cost, 0);
      const most = cost ? Math.max(1, Math.floor((BUDGET * Math.min(passed, LONGEST) * 1000) / cost)) : FIRST;
      const n = Math.min(Math.floor(this.credit + 1e-9), most);
      this.credit = Math.min(this.credit - n, 1); // what cannot be computed in time is not owed
      if (n) this.advance(n);
      const weight = Math.exp(-passed / SMOOTH),
        factor = (this.time - before) / passed;
      this.factor = this.factor === null ? factor : weight * this.factor + (1 - weight) * factor;
    }
    this.last = now;
    if (!this.running) return; // all has come to its end, and is drawn
    this.draw(true);
    if (performance.now() - this.told > TOLD) this.tell();
    this.nextFrame();
  }

  /** All that is shown; between two looks (`partly`) only pictures, those that can wait in turn. */
  draw(partly = false) {
    this.frames = (this.frames ?? 0) + 1;
    const due = (canvas, number, seen, hidden) =>
      !partly || (this.frames + number) % (this.seen.has(canvas) ? seen : hidden) === 0;
    this.views.forEach(({ view, canvas, variant }, i) => {
      if (variant.refreshed) view.refresh();
      variant.refreshed = false;
      if (due(canvas, i, 1, EVERY.hidden)) view.draw(this.time);
    });
    const lines = this.variants.map((v, i) => ({
      history: v.history,
      ahead: v.system.ahead,
      dash: DASHES[i % DASHES.length],
      color: this.colors[i % COLORS],
    }));
    this.charts.forEach((chart, i) => {
      if (due(chart.canvas, i, EVERY.chart, EVERY.hiddenChart)) chart.draw(lines, this.seconds);
    });
    if (!partly) this.tell();
  }

  /** The camera has been moved, or turns: a system that stands is drawn again, until it has come to rest. */
  moved() {
    this.$("view").value = this.camera.view;
    if (this.running || this.moving) return;
    this.moving = true;
    requestAnimationFrame(() => {
      this.moving = false;
      const turning = this.camera.turn !== null;
      this.draw(turning); // at last what is out of sight, too
      if (turning) this.moved();
    });
  }

  /** Numbers and words. */
  tell() {
    this.told = performance.now();
    this.$("time").textContent = `${this.time.toFixed(2)} s`;
    for (const { view, variant } of this.views) {
      view.readings().forEach(({ text }, i) => {
        if (variant.readings[i].textContent !== text) variant.readings[i].textContent = text;
      });
    }
    this.fill();
    if (this.drives.length) {
      for (const c of this.drives) c.show();
      if (this.$("pad").textContent !== this.hands.word) this.$("pad").textContent = this.hands.word;
    }
    const slow = this.running && this.factor !== null && this.factor < 0.9 * this.pace;
    this.$("factor").textContent = slow
      ? `this device runs it at ${this.factor.toFixed(2)} times the clock, not ${this.pace}`
      : "";
    if (!this.described || this.told - this.described > 2000) this.describe();
  }

  /** Words for those who do not see the pictures. */
  describe() {
    this.described = performance.now();
    for (const { view, canvas, variant } of this.views)
      canvas.setAttribute("aria-label", `${variant.title}. ${view.describe()}`);
    for (const chart of this.charts) {
      const { name, unit, factor, offset } = chart.signal;
      const parts = this.variants
        .filter((v) => v.history.has(name))
        .map((v) => `${v.title} ${(v.history.value(name) * factor + offset).toPrecision(4)} ${unit}`);
      chart.canvas.setAttribute("aria-label", `${name} over the last ${this.seconds} s; now ${parts.join(", ")}`);
    }
  }

  /** What has failed or ended. */
  report() {
    for (const v of this.variants) {
      const old = v.outdated,
        text = v.failure
          ? `Run stopped: ${v.failure}`
          : v.instance.ended
            ? "The system has ended the run."
            : old.length
              ? `The picture keeps ${old.join(", ")} as it was at the start.`
              : "";
      if (v.status.textContent !== text) v.status.textContent = text;
    }
  }

  say(text) {
    this.$("message").textContent = text;
  }

  key(e) {
    if (e.defaultPrevented || e.ctrlKey || e.metaKey || e.altKey) return;
    const held = Hands.name(e.key),
      { tagName, type } = e.target,
      arrow = e.key.startsWith("Arrow");
    // which take letters
    if (tagName === "SELECT" || (tagName === "INPUT" && !["range", "checkbox"].includes(type))) return;
    if (arrow && (type === "range" || e.target.id === "parameters")) return;
    if (e.key === " " && /^(BUTTON|SUMMARY|A|INPUT)$/.test(tagName)) return; // they take it
    const actions = { " ": () => this.toggle(), ".": () => this.$("step").click(), r: () => this.restart() };
    let action = actions[e.key];
    for (const c of this.controls) {
      const which = c.spec.keys.indexOf(e.key);
      if (which >= 0 && !c.row.hidden) action = () => c.nudge(which ? 1 : -1);
    }
    if (this.drives.some((c) => c.drive.has(held) && !c.row.hidden)) action = () => this.hands.keys.add(held);
    if (action) {
      e.preventDefault();
      action();
    }
  }

  /** What the charts show of all variants, as a file. */
  save() {
    for (const v of this.variants) {
      const link = document.createElement("a");
      link.href = URL.createObjectURL(new Blob([v.history.csv([...v.history.place.keys()])], { type: "text/csv" }));
      link.download = `${v.title.replace(/\W+/g, "-")}.csv`;
      link.click();
      setTimeout(() => URL.revokeObjectURL(link.href), 1000);
    }
  }
}
Page.KEYS = { ArrowUp: "↑", ArrowDown: "↓", ArrowLeft: "←", ArrowRight: "→" };

(async () => {
  try {
    const data = JSON.parse(new TextDecoder().decode(await unpacked(document.getElementById("data").textContent)));
    const module = await WebAssembly.compile(await unpacked(document.getElementById("module").textContent));
    window.page = new Page(data, module);
    document.documentElement.dataset.state = "ready";
    performance.mark("ready");
    if (!window.page.reduced && !/[?&#]paused/.test(location.href)) window.page.play();
  } catch (error) {
    document.documentElement.dataset.state = "failed";
    document.getElementById("message").textContent =
      typeof DecompressionStream === "undefined" || typeof WebAssembly === "undefined"
        ? "This browser is too old for the page: it needs WebAssembly and DecompressionStream " +
          "(Chrome 80, Firefox 113, Safari 16.4)."
        : `The page cannot start: ${error.message}`;
  }
})();
