/* Variants of a page: a system each, with its settings, its history and the numbers of its run. */

const SQUARED = ["rms", "mean square"];
const PORTION = 100; // steps, between two looks whether a run is over

class Variant {
  constructor(module, system, data, number) {
    const interval = data.interval;
    Object.assign(this, { system, number, title: system.title, failure: null });
    this.variables = new Map(system.variables.map((v) => [v.name, v]));
    const shown = system.variables.filter((v) => v.role === "output").sort((a, b) => a.type - b.type);
    this.instance = new Instance(module, system.model, shown);
    this.interval = interval;
    const { place, width } = this.instance;
    // inputs that a person drives: beside what is shown, so that a run can be repeated
    this.driven = data.controls.flatMap((c) => (c.drive ? c.names.filter((n) => this.variables.has(n)) : []));
    const all = new Map([...place, ...this.driven.map((n, i) => [n, width + i])]);
    this.history = new History(all, width + this.driven.length, interval * data.keep);
    this.keep = data.keep;
    this.score = new Score(this, data);
    this.probe = system.road ? new Probe(module, system.road) : null;
    this.settings = new Map(Object.entries(system.values));
    this.fresh = true;
    this.cost = 0; // ms per step, smoothed
  }

  /** From the beginning, with the settings as they are. */
  restart() {
    this.failure = null;
    this.steps = 0;
    this.history.clear();
    try {
      if (!this.fresh) this.instance.reset();
      this.fresh = false;
      for (const [name, value] of this.settings) {
        const v = this.variables.get(name);
        this.instance.set(v.type, v.reference, [value]);
      }
      if (this.probe) this.probe.renew(this.roadSettings());
      this.instance.start(this.interval);
      const row = this.instance.look();
      this.record(row);
      this.score.restart(row);
    } catch (error) {
      this.fail(error);
    }
  }

  record(row) {
    this.history.add(row, this.driven.map((n) => this.value(n)));
    if (this.view) this.view.observe();
  }

  roadSettings() {
    const found = new Map();
    for (const [name, value] of this.settings) {
      const own = this.system.road.parameters[name];
      if (own) found.set(name, [own.type, own.reference, [value]]);
    }
    return found;
  }

  fail(error) {
    this.failure = error.message;
  }

  /** Dimensions that have been changed, which the picture does not follow. */
  get outdated() {
    const { scene, values } = this.system;
    return (scene ? scene.dimensions : []).filter(
      (n) => this.settings.has(n) && this.settings.get(n) !== (values[n] ?? this.variables.get(n).start),
    );
  }

  /** All that is shown, as it was at the last step that counts. */
  get row() {
    return this.score.verdict ? this.final : this.instance.look();
  }

  get over() {
    return Boolean(this.failure || this.instance.ended || this.score.verdict);
  }

  /** Whether this variable can be set while the system runs. */
  live(name) {
    const v = this.variables.get(name);
    return v.role === "input" || v.tunable;
  }

  /** Sets a variable; returns whether a restart is needed for it to count. */
  set(name, value) {
    if (!this.variables.has(name) || this.settings.get(name) === value) return false;
    this.settings.set(name, value);
    const v = this.variables.get(name);
    if (!this.live(name)) return true;
    if (this.failure) return false;
    try {
      this.instance.set(v.type, v.reference, [value]);
      if (this.probe && this.system.road.parameters[name]) {
        this.probe.renew(this.roadSettings());
        this.refreshed = true;
      }
    } catch (error) {
      this.fail(error);
    }
    return false;
  }

  /** The value of anything: an output as it is now, another variable as it is set. */
  value(name) {
    if (this.instance.place.has(name)) return this.history.value(name);
    return this.settings.has(name)
      ? this.settings.get(name)
      : this.variables.has(name)
        ? this.variables.get(name).start
        : NaN;
  }

  run(n) {
    if (this.over) return;
    const begun = performance.now();
    const before = this.steps;
    try {
      for (let left = n; left > 0 && !this.over; left -= PORTION) {
        this.instance.run(Math.min(left, PORTION), (row) => {
          if (this.score.verdict) return; // the rest of a portion after the end
          this.steps++;
          this.score.add(row);
          if (this.steps % this.keep === 0) this.record(row);
          if (this.score.verdict) this.final = row.slice();
        });
      }
    } catch (error) {
      this.fail(error);
    }
    const cost = (performance.now() - begun) / Math.max(1, this.steps - before);
    this.cost = this.cost ? 0.9 * this.cost + 0.1 * cost : cost;
  }
}

/** Numbers of a whole run, and whether it is over. */
class Score {
  constructor(variant, data) {
    this.variant = variant;
    this.interval = data.interval;
    const place = variant.instance.place;
    this.measures = data.measures.map((m) => ({
      ...m,
      places: m.names.filter((n) => place.has(n)).map((n) => place.get(n)),
    }));
    this.finish = data.finish;
  }

  restart(row) {
    this.n = 0;
    this.verdict = "";
    this.worst = this.measures.map((m) => (SQUARED.includes(m.how) ? m.places.map(() => 0) : -Infinity));
    this.see(row);
    if (!this.finish || !this.finish.when) return;
    const place = this.variant.instance.place;
    this.terms = []; // what moves; the rest is as it was set
    this.level = this.finish.when.offset;
    for (const [name, factor] of Object.entries(this.finish.when.terms)) {
      if (place.has(name)) this.terms.push([place.get(name), factor]);
      else this.level += factor * this.variant.value(name);
    }
  }

  see(row) {
    this.measures.forEach((m, i) => {
      m.places.forEach((p, j) => {
        const v = row[p];
        if (SQUARED.includes(m.how)) this.worst[i][j] += v * v;
        else this.worst[i] = Math.max(this.worst[i], m.how === "peak" ? Math.abs(v) : v);
      });
    });
  }

  /** Counts a row, until the run is over. */
  add(row) {
    if (this.verdict) return;
    this.n++;
    this.see(row);
    if (this.finish) {
      const time = this.n * this.interval,
        late = time >= this.finish.patience - this.interval / 2;
      if (!this.finish.when) this.verdict = late ? "over" : "";
      else if (this.terms.reduce((sum, [p, f]) => sum + f * row[p], this.level) >= 0)
        this.verdict = this.failed.length ? "failed" : "passed";
      else if (late) this.verdict = "stuck";
    }
  }

  /** The value of a measure in the unit in which it is shown; null where the system does not have it. */
  value(i) {
    const m = this.measures[i];
    if (!m.places.length || this.n === undefined) return null;
    if (!SQUARED.includes(m.how)) return m.factor * this.worst[i];
    const square = Math.max(...this.worst[i]) / (this.n + 1);
    return m.factor * (m.how === "rms" ? Math.sqrt(square) : square);
  }

  /** Labels of what is above its limit. */
  get failed() {
    return this.measures.filter((m, i) => m.limit !== null && this.value(i) > m.limit).map((m) => m.label);
  }
}
