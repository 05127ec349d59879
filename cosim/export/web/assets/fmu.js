/* The WebAssembly module behind the page: instances of its models, by the functions of web.c. */

const TYPES = ["Float64", "Int32", "Boolean"];

/** Bytes of what was packed with gzip and written as base64. */
async function unpacked(text) {
  const packed = Uint8Array.from(atob(text), (c) => c.charCodeAt(0));
  const stream = new Blob([packed]).stream().pipeThrough(new DecompressionStream("gzip"));
  return new Uint8Array(await new Response(stream).arrayBuffer());
}

class Instance {
  /**
   * @param {WebAssembly.Module} module
   * @param {number} model     which of its models
   * @param {{name: string, type: number, reference: number}[]} shown  what a row holds, sorted by type
   */
  constructor(module, model, shown) {
    this.x = new WebAssembly.Instance(module, {}).exports;
    this.x._initialize();
    this.width = shown.length;
    this.place = new Map(shown.map((v, i) => [v.name, i]));
    this.one = this.x.web_memory(8);
    this.values = this.x.web_memory(8 * 4096);
    this.most = 256;
    this.rows = this.x.web_memory(8 * this.most * Math.max(1, this.width));
    const references = this.x.web_memory(4 * Math.max(1, this.width));
    new Uint32Array(this.x.memory.buffer, references, this.width).set(shown.map((v) => v.reference));
    const count = (t) => shown.filter((v) => v.type === t).length;
    this.handle = this.x.web_open(model, references, count(0), count(1), count(2));
    if (!this.handle) throw new Error(this.message || "the model cannot be instantiated");
  }

  get message() {
    const bytes = new Uint8Array(this.x.memory.buffer, this.x.web_message(), 1024);
    // without names of C
    return new TextDecoder().decode(bytes.slice(0, bytes.indexOf(0))).replace(/\b\w+_fmi3\w+: /g, "");
  }

  check(status) {
    if (status > 1) throw new Error(this.message || `status ${status}`);
  }

  /** One variable, or all elements of an array. */
  set(type, reference, values) {
    new Uint32Array(this.x.memory.buffer, this.one, 1)[0] = reference;
    new Float64Array(this.x.memory.buffer, this.values, values.length).set(values);
    this.check(this.x.web_set(this.handle, type, this.one, 1, this.values, values.length));
  }

  start(step, time = 0) {
    this.check(this.x.web_start(this.handle, time, step));
  }
  reset() {
    this.check(this.x.web_reset(this.handle));
  }

  /** What is shown now. */
  look() {
    this.check(this.x.web_look(this.handle, this.rows));
    return new Float64Array(this.x.memory.buffer, this.rows, this.width).slice();
  }

  /**
   * Up to n steps; calls back with each row, which is valid until the next call. Throws where a step fails, after its
   * rows.
   */
  run(n, row) {
    while (n > 0) {
      const asked = Math.min(n, this.most);
      const done = this.x.web_run(this.handle, asked, this.width, this.rows);
      const data = new Float64Array(this.x.memory.buffer, this.rows, done * this.width);
      for (let k = 0; k < done; k++) row(data.subarray(k * this.width, (k + 1) * this.width));
      if (this.ended) return;
      if (done < asked) throw new Error(this.message || "a step failed");
      n -= asked;
    }
  }

  get ended() {
    return this.x.web_ended(this.handle) !== 0;
  }
}

/** Heights of a road by distance, from an instance of the road alone: what lies ahead, before anything is there. */
class Probe {
  /** @param {object} road  model, x (reference), starts, sides: {left: {place, ahead}} and the step of the road */
  constructor(module, road) {
    const shown = Object.entries(road.sides).map(([name, s]) => ({ name, type: 0, reference: s.reference }));
    this.road = road;
    this.instance = new Instance(module, road.model, shown);
    this.settings = new Map();
    this.renew();
  }

  /** After a parameter has changed: name of the road's variable -> [type, reference, values]. */
  renew(settings = this.settings) {
    this.settings = settings;
    this.instance.reset();
    for (const [type, reference, values] of [...this.road.starts, ...settings.values()])
      this.instance.set(type, reference, values);
    this.instance.start(this.road.step);
    this.heights = Object.fromEntries(Object.keys(this.road.sides).map((side) => [side, new Map()]));
  }

  /** Height [m] at a distance [m] along the road; null on a side that the road does not have. */
  height(side, x) {
    const known = this.heights[side];
    if (!known) return null;
    const cell = Math.round(x / Probe.GRID);
    if (!known.has(cell)) {
      const s = this.road.sides[side];
      this.instance.set(0, this.road.x, [cell * Probe.GRID - s.ahead]);
      let height = null;
      this.instance.run(1, (row) => {
        height = row[this.instance.place.get(side)];
      });
      known.set(cell, height);
      if (known.size > 50000) known.clear();
    }
    return known.get(cell);
  }
}
Probe.GRID = 0.025; // m
