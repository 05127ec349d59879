/* Strip charts: signals of all variants over the last seconds. */

class StripChart {
  /**
   * @param {HTMLCanvasElement} canvas
   * @param {{name: string, unit: string, factor: number, offset: number}} signal
   */
  constructor(canvas, signal) {
    this.canvas = canvas;
    this.signal = signal;
    this.range = null;
    this.restyle();
  }

  /** Reads the colors again, after the page has changed its scheme. */
  restyle() {
    const style = getComputedStyle(this.canvas);
    [this.ink, this.rule] = ["--muted", "--rule"].map((name) => style.getPropertyValue(name));
  }

  /**
   * @param {{history: History, color: string, dash: number[], ahead: object}[]} lines  ahead: what is planned, by
   *   signal
   * @param {number} seconds  how much is shown
   */
  draw(lines, seconds) {
    const box = this.canvas.getBoundingClientRect(),
      ratio = window.devicePixelRatio || 1;
    const width = Math.max(1, Math.round(box.width * ratio)),
      height = Math.max(1, Math.round(box.height * ratio));
    if (this.canvas.width !== width || this.canvas.height !== height) Object.assign(this.canvas, { width, height });
    const c = this.canvas.getContext("2d");
    c.setTransform(ratio, 0, 0, ratio, 0, 0);
    c.clearRect(0, 0, box.width, box.height);
    const { ink, rule } = this,
      left = 52,
      right = box.width - 6,
      top = 8,
      bottom = box.height - 18;
    const { factor, offset } = this.signal;
    const futures = lines.map((l) => StripChart.future(l.history, l.ahead[this.signal.name]));
    const now = Math.max(0, ...lines.map((l) => l.history.time));
    const end = Math.max(seconds, now + Math.max(0, ...futures.map((f) => f.reach)));
    const begin = end - seconds;
    let low = Infinity,
      high = -Infinity;
    const series = lines.map((l) =>
      l.history.series(this.signal.name, begin, Math.max(2, Math.round((right - left) / 2))),
    );
    for (const s of [...series, ...futures])
      for (const v of s.values) {
        const y = v * factor + offset;
        if (y < low) low = y;
        if (y > high) high = y;
      }
    if (!(high >= low)) [low, high] = [-1, 1];
    this.range = StripChart.eased(this.range, low, high);
    const [from, to, tick] = StripChart.ticks(this.range[0], this.range[1]);
    const px = (t) => left + ((right - left) * (t - begin)) / seconds;
    const py = (y) => bottom - ((bottom - top) * (y - from)) / (to - from);
    c.font = "11px system-ui, sans-serif";
    c.lineWidth = 1;
    c.strokeStyle = rule;
    c.fillStyle = ink;
    c.textAlign = "right";
    c.textBaseline = "middle";
    for (let y = Math.ceil(from / tick - 1e-9) * tick; y <= to + tick * 1e-9; y += tick) {
      c.beginPath();
      c.moveTo(left, py(y));
      c.lineTo(right, py(y));
      c.stroke();
      c.fillText(StripChart.number(y, tick), left - 5, py(y));
    }
    c.textAlign = "center";
    c.textBaseline = "top";
    const apart = StripChart.ticks(0, 0.5 * seconds)[2];
    for (let t = Math.ceil(begin / apart - 1e-9) * apart; t <= end + 1e-9; t += apart) {
      if (t >= 0) c.fillText(`${StripChart.number(t, apart)} s`, Math.min(px(t), right - 12), bottom + 4);
    }
    c.lineWidth = 1.6;
    c.lineJoin = "bevel";
    c.save();
    c.beginPath();
    c.rect(left, top - 3, right - left, bottom - top + 6);
    c.clip();
    series.forEach((s, i) => {
      c.strokeStyle = lines[i].color;
      c.setLineDash(lines[i].dash);
      c.beginPath();
      for (let k = 0; k < s.values.length; k++) c.lineTo(px(s.times[k]), py(s.values[k] * factor + offset));
      c.stroke();
      const future = futures[i];
      if (!future.values.length) return;
      c.globalAlpha = 0.6;
      c.setLineDash([2, 2]);
      c.beginPath();
      for (let k = 0; k < future.values.length; k++) {
        if (future.held && k) c.lineTo(px(future.times[k]), py(future.values[k - 1] * factor + offset));
        c.lineTo(px(future.times[k]), py(future.values[k] * factor + offset));
      }
      c.stroke();
      c.globalAlpha = 1;
    });
    if (futures.some((f) => f.values.length)) {
      // what lies ahead
      c.setLineDash([]);
      c.strokeStyle = rule;
      c.beginPath();
      c.moveTo(px(now), top);
      c.lineTo(px(now), bottom);
      c.stroke();
    }
    c.restore();
  }

  /** What a controller expects of a signal: commands are held from sample to sample, outputs are true at samples. */
  static future(history, ahead) {
    if (!ahead || !history.count) return { times: [], values: [], reach: 0 };
    const sample = (Math.ceil(history.time / ahead.step - 1e-6) - 1) * ahead.step; // the last one that is shown
    const times = ahead.names.map((_, i) => sample + (i + ahead.first) * ahead.step);
    return {
      times,
      values: ahead.names.map((n) => history.value(n)),
      held: ahead.first === 0,
      reach: ahead.names.length * ahead.step,
    };
  }

  /** A range that opens at once and closes slowly, so that the scale does not jump. */
  static eased(before, low, high) {
    const middle = Math.max(Math.abs(low), Math.abs(high)) * 1e-3,
      least = 1e-6;
    if (high - low < 2 * Math.max(middle, least)) {
      low -= Math.max(middle, least);
      high += Math.max(middle, least);
    }
    if (!before) return [low, high];
    return [
      low < before[0] ? low : before[0] + 0.03 * (low - before[0]),
      high > before[1] ? high : before[1] + 0.03 * (high - before[1]),
    ];
  }

  /** Rounded ends and the distance of the lines between. */
  static ticks(low, high) {
    const most = (high - low) / 2,
      power = 10 ** Math.floor(Math.log10(most) + 1e-9); // two lines at least
    const tick = [5, 2, 1].find((m) => m * power <= most * (1 + 1e-9)) * power;
    return [low - 0.04 * (high - low), high + 0.04 * (high - low), tick];
  }

  static number(y, tick) {
    const decimals = Math.min(6, Math.max(0, -Math.floor(Math.log10(tick) + 1e-9)));
    return (Math.abs(y) < tick * 1e-6 ? 0 : y).toFixed(decimals);
  }
}

/** The rows of the last seconds of one variant. */
class History {
  /**
   * @param {Map<string, number>} place  of each name in a row  @param {number} width  of a row  @param {number} step
   * [s] between rows
   */
  constructor(place, width, step, seconds = 60) {
    Object.assign(this, { place, width, step });
    this.capacity = Math.ceil(seconds / step) + 1;
    this.data = new Float64Array(this.capacity * width);
    this.clear();
  }

  clear() {
    this.count = 0;
  }
  /** A row, in two parts. */
  add(row, more = []) {
    const begin = (this.count++ % this.capacity) * this.width;
    this.data.set(row, begin);
    this.data.set(more, begin + row.length);
  }
  /** Time of the newest row [s]. */
  get time() {
    return Math.max(0, this.count - 1) * this.step;
  }
  get oldest() {
    return Math.max(0, this.count - this.capacity);
  }
  at(index, name) {
    return this.data[(index % this.capacity) * this.width + this.place.get(name)];
  }
  has(name) {
    return this.place.has(name);
  }

  /** The newest value of a variable. */
  value(name) {
    return this.count && this.place.has(name) ? this.at(this.count - 1, name) : NaN;
  }

  /** Values since a time, smallest and largest of each of `n` columns, so that no peak is lost. */
  series(name, begin, n) {
    const times = [],
      values = [];
    if (!this.place.has(name) || !this.count) return { times, values };
    const first = Math.max(this.oldest, Math.ceil(begin / this.step - 1e-9)),
      last = this.count - 1;
    const stride = Math.max(1, Math.floor((last - first + 1) / n));
    for (let k = first - (first % stride); k <= last; k += stride) {
      let low = -1,
        high = -1,
        least = Infinity,
        most = -Infinity;
      for (let j = Math.max(k, first); j < Math.min(k + stride, last + 1); j++) {
        const v = this.at(j, name);
        if (v < least) {
          least = v;
          low = j;
        }
        if (v > most) {
          most = v;
          high = j;
        }
      }
      for (const j of low <= high ? [low, high] : [high, low]) {
        if (j < 0 || (low === high && j === times.last)) continue;
        times.push(j * this.step);
        values.push(this.at(j, name));
        if (low === high) break;
      }
    }
    if (last >= first && times[times.length - 1] !== last * this.step) {
      // the newest, so that no line lags behind
      times.push(last * this.step);
      values.push(this.at(last, name));
    }
    return { times, values };
  }

  /** Rows as text, for a file. */
  csv(names) {
    const lines = [["time [s]", ...names].join(",")];
    for (let k = this.oldest; k < this.count; k++)
      lines.push([k * this.step, ...names.map((n) => this.at(k, n))].join(","));
    return lines.join("\n") + "\n";
  }
}
