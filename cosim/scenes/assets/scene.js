// Draws a live scene, as cosim/scenes/scene.py describes it: orthographic views of bodies, wheels, struts, forces
// and road. x ahead, y left, z up [m]. It reads values when it draws, and nothing else; colors are CSS custom
// properties (scene.css).
class SceneView extends SceneBodies {
  static WORDS = {
    ground: "ground on tire",
    actuator: "actuator on body",
    body: "ground on body",
    preview: "preview",
    sensed: "sensed road",
    predicted: "predicted travel",
  };
  static TRAIL = 0.3; // m between two points of where the wheels have been on open ground
  static TRAILED = 2000; // points of it that are kept

  constructor(canvas, data, { value, ground = () => null, reducedMotion = false, camera = null, changed = () => {} }) {
    super();
    this.canvas = canvas;
    this.data = data;
    this.value = value;
    this.probe = ground;
    this.changed = changed; // is called when a person has moved the camera
    this.reducedMotion = reducedMotion;
    this.exaggeration = 1; // of motion and of heights of the road
    this.camera = camera || SceneView.from(data.views[0]);
    this.now = new Float64Array(data.names.length);
    this.trees = data.bodies.map((body) => SceneView.tree(body.faces.map(SceneView.face)));
    this.step = data.width / SceneView.SAMPLES;
    this.halfWidth = Math.max(
      (0.6 * data.width) / 12,
      ...data.wheels.map((w) => Math.abs(this.rest(w.y)) + w.width / 2 + 1.3 * w.radius),
    );
    this.carved = data.trenches.length + data.reliefs.length > 0; // the ground is known as a whole
    this.onRoad = data.grounds.length > 0 || this.carved;
    this.open = !this.onRoad && typeof data.bodies[data.follow].x !== "number"; // it drives where there is no road
    this.observed = this.open || data.cones.length > 0 || data.readings.some((r) => r.largest);
    this.top = Math.max(
      ...data.bodies.map((b) => this.rest(b.z) + Math.max(...b.faces.flatMap((f) => f.points.map((p) => p[2])))),
    );
    this.bottom = Math.min(
      ...data.bodies.map((b) => this.rest(b.z) + Math.min(...b.faces.flatMap((f) => f.points.map((p) => p[2])))),
    );
    this.shades = new Map();
    this.yaw = 0;
    this.reset();
    this.restyle();
    if (canvas.addEventListener) this.listen();
  }

  // ----------------------------------------------------------------------------------------------- what the page calls

  // Forgets what was driven: for a run that begins again.
  reset() {
    this.cells = { left: new Map(), right: new Map() };
    this.history = this.data.traces.map(() => []);
    this.last = -Infinity;
    this.fallen = new Map(); // cone -> which way [rad]
    this.largest = this.data.readings.map(() => 0);
    this.trail = [];
  }

  // What must not be missed between two pictures, at every sample: largest values, the way of the wheels on open
  // ground, cones that the vehicle touches.
  observe() {
    if (!this.observed) return;
    this.read();
    const { readings, cones, bodies, follow, footprint, wheels } = this.data;
    readings.forEach((r, i) => {
      if (r.largest) this.largest[i] = Math.max(this.largest[i], Math.abs(this.quotient(r)));
    });
    const [x, y, yaw] = ["x", "y", "yaw"].map((name) => this.raw(bodies[follow][name])),
      [rear, front, half] = footprint,
      last = this.trail[this.trail.length - 1];
    if (this.open && !(last && Math.hypot(x - last.x, y - last.y) < SceneView.TRAIL)) {
      this.trail.push({ x, y, wheels: wheels.map((wheel) => this.wheelAt(wheel)).map((w) => [w.x, w.y, 0]) });
      if (this.trail.length > SceneView.TRAILED) this.trail.shift();
    }
    cones.forEach((cone, i) => {
      const [ahead, left] = SceneView.level(-yaw, cone.x - x, cone.y - y),
        beyond = Math.hypot(Math.max(rear - ahead, 0, ahead - front), Math.max(0, Math.abs(left) - half));
      if (!this.fallen.has(i) && beyond < cone.radius) this.fallen.set(i, yaw + Math.atan2(left, front));
    });
  }

  // Asks again for the road ahead of the vehicle, after a parameter has changed; what lies behind stays as it was
  // driven.
  refresh() {
    this.read();
    const x = this.raw(this.data.bodies[this.data.follow].x) / this.step;
    for (const cells of Object.values(this.cells)) for (const k of cells.keys()) if (k > x) cells.delete(k);
  }

  readings() {
    this.read();
    const { readings, cones } = this.data;
    const found = readings.map((reading, i) => {
      const { label, unit, decimals, factor, largest } = reading,
        number = factor * (largest ? this.largest[i] : this.quotient(reading)),
        text = number.toFixed(decimals);
      return { label, unit, text: Number(text) === 0 ? (0).toFixed(decimals) : text };
    });
    if (cones.length) found.push({ label: "cones hit", unit: "", text: `${this.fallen.size} of ${cones.length}` });
    return found;
  }

  // The value of a reading; 0 where what it is divided by is.
  quotient({ value, per }) {
    const by = this.raw(per);
    return by ? this.raw(value) / by : 0;
  }

  // Labels of the limits that are active.
  active() {
    this.read();
    return this.data.limits.filter((limit) => this.raw(limit.value) > 0).map((limit) => limit.label);
  }

  // One sentence about what is seen, for those who do not see it.
  describe() {
    // nobody has turned it
    const still = this.camera.azimuth === SceneView.VIEWS[this.view].azimuth || this.camera.turn;
    const from = still
      ? {
          side: "from the side",
          "three-quarter": "from ahead and the right",
          rear: "from behind",
          chase: "from behind and above",
          top: "from above",
        }[this.view]
      : "from a view of your own";
    const parts = this.readings().map(({ label, unit, text }) => `${label} ${text}${unit ? ` ${unit}` : ""}`);
    const pushing = this.data.arrows.filter((a) => a.role === "actuator").map((a) => this.raw(a.fz));
    if (pushing.length) {
      const largest = pushing.reduce((a, b) => (Math.abs(b) > Math.abs(a) ? b : a));
      parts.push(Math.abs(largest) < 0.5 ? "no actuator force" : `actuator force up to ${SceneView.force(largest)}`);
    }
    const active = this.active();
    if (active.length) parts.push(active.join(", "));
    const what = this.data.what.charAt(0).toUpperCase() + this.data.what.slice(1);
    return `${what} ${from}${parts.length ? `: ${parts.join("; ")}` : ""}.`;
  }

  draw(time) {
    if (!this.canvas.clientWidth || !this.canvas.clientHeight) return;
    this.read();
    if (time < this.last) this.reset();
    this.last = time;
    this.aim();
    const { pen, data, color } = this;
    pen.globalAlpha = 1;
    pen.fillStyle = color.sky;
    pen.fillRect(0, 0, this.width, this.height);
    this.wheels = data.wheels.map((wheel) => this.wheelAt(wheel));
    this.poses = data.bodies.map((body) => this.pose(body));
    this.lit = data.limits.map((limit) => this.raw(limit.value) > 0);
    this.observe();
    if (this.onRoad) this.drawRoad();
    else if (this.open) this.drawPlain();
    else this.drawFloor();
    this.drawTraces(time);
    this.drawBodies();
    this.drawStruts();
    this.drawPoints();
    this.drawArrows();
    this.drawWords();
  }

  // --------------------------------------------------------------------------------------------- what is known, forces

  drawPoints() {
    const { pen, color, data } = this;
    if (Math.abs(this.facing[1]) < 0.15 * Math.hypot(...this.facing)) return; // from behind, what is ahead is hidden
    for (const points of data.points) {
      const x = this.raw(points.x),
        y = this.raw(points.y),
        spacing = this.raw(points.spacing);
      const used = Math.max(0, Math.round(this.raw(points.count)));
      const there = points.heights.slice(0, used).map((h, i) => [x + i * spacing, y, this.tall(h)]),
        near = this.isNear(x, y);
      pen.strokeStyle = pen.fillStyle = color[points.role];
      pen.globalAlpha = near ? 1 : 0.4;
      for (const [wide, style] of [
        [4.5, color.halo],
        [2, color[points.role]],
      ]) {
        if (wide > 4 && !near) continue;
        pen.strokeStyle = style;
        pen.lineWidth = wide;
        pen.setLineDash(points.role === "sensed" && wide < 4 ? [5, 3] : []);
        this.path(there, false);
        pen.stroke();
      }
      pen.setLineDash([]);
      let last = -Infinity;
      for (const p of there) {
        // dots, as far as they stand apart
        const [sx, sy] = this.screen(p);
        if (Math.abs(sx - last) < 6) continue;
        last = sx;
        pen.beginPath();
        pen.arc(sx, sy, 2.6, 0, 2 * Math.PI);
        pen.fill();
      }
    }
    pen.globalAlpha = 1;
  }

  arrowsNow() {
    const { data } = this,
      found = [];
    for (const arrow of data.arrows) {
      const at = arrow.at.map((v, k) => (k === 2 ? this.tall(v) : this.raw(v)));
      let from = at;
      if (arrow.body !== null) from = SceneView.placed(this.poses[arrow.body], at);
      else if (arrow.wheel !== null) {
        const w = this.wheels[arrow.wheel];
        from = [w.x + at[0], w.y + at[1], w.z + at[2]];
      }
      found.push({ role: arrow.role, from, force: [this.raw(arrow.fx), this.raw(arrow.fy), this.raw(arrow.fz)] });
    }
    return found;
  }

  drawArrows() {
    if (this.distant) return;
    const { pen, color, data } = this,
      longest = 0.34 * this.height;
    for (const { role, from, force } of this.arrowsNow()) {
      const hidden =
        // behind the vehicle
        data.wheels.length > 1 &&
        role !== "body" &&
        Math.abs(this.facing[1]) > 0.3 &&
        this.besides(from[0], from[1]) * this.facing[1] < 0;
      if (data.wheels.length > 1 && role !== "body" && !this.isNear(from[0], from[1])) continue;
      const tip = from.map((c, k) => c + force[k] / data.forceScale);
      const [ax, ay] = this.screen(from);
      let [bx, by] = this.screen(tip);
      const length = Math.hypot(bx - ax, by - ay);
      if (length < 3) continue;
      const ux = (bx - ax) / length,
        uy = (by - ay) / length,
        cut = length > longest;
      if (cut) [bx, by] = [ax + longest * ux, ay + longest * uy];
      const head = Math.min(9, 0.5 * length),
        style = color[`${role}-force`];
      const neck = [bx - head * ux, by - head * uy];
      pen.globalAlpha = hidden ? 0.4 : 1;
      for (const [line, wide] of [
        [color.halo, 6],
        [style, 3.2],
      ]) {
        pen.strokeStyle = line;
        pen.lineWidth = wide;
        pen.beginPath();
        pen.moveTo(ax, ay);
        pen.lineTo(...neck);
        pen.stroke();
      }
      pen.fillStyle = style;
      pen.strokeStyle = color.halo;
      pen.lineWidth = 1;
      pen.beginPath();
      pen.moveTo(bx, by);
      pen.lineTo(neck[0] - 0.6 * head * uy, neck[1] + 0.6 * head * ux);
      pen.lineTo(neck[0] + 0.6 * head * uy, neck[1] - 0.6 * head * ux);
      pen.closePath();
      pen.stroke();
      pen.fill();
      if (cut || role === "body") {
        const words = `${SceneView.force(Math.hypot(...force))}${cut ? ", cut" : ""}`;
        this.text(words, bx + 8, Math.max(14, by), style);
      }
      if (cut) {
        // a break across the shaft, as drawings have it
        const mx = ax + 0.6 * (bx - ax),
          my = ay + 0.6 * (by - ay);
        for (const along of [-2, 2]) {
          pen.strokeStyle = style;
          pen.lineWidth = 1.5;
          pen.beginPath();
          pen.moveTo(mx + along * ux - 6 * uy, my + along * uy + 6 * ux);
          pen.lineTo(mx + along * ux + 6 * uy, my + along * uy - 6 * ux);
          pen.stroke();
        }
      }
    }
    pen.globalAlpha = 1;
  }

  // ------------------------------------------------------------------------------------------------------------- words

  static force(newtons) {
    const size = Math.abs(newtons);
    if (size >= 1e5) return `${(newtons / 1e3).toFixed(0)} kN`;
    if (size >= 1e3) return `${(newtons / 1e3).toFixed(1)} kN`;
    return `${newtons.toFixed(size < 10 ? 1 : 0)} N`;
  }

  text(words, x, y, style, align = "left") {
    const { pen, color } = this;
    pen.font = `600 12px ${this.font}`;
    pen.textAlign = align;
    pen.textBaseline = "middle";
    pen.lineWidth = 3;
    pen.strokeStyle = color.halo;
    pen.strokeText(words, x, y);
    pen.fillStyle = style;
    pen.fillText(words, x, y);
  }

  // Legend: colors with their words, and forces as long as they are drawn, where they are upright.
  legend() {
    const { data } = this,
      roles = new Set(this.distant ? [] : data.arrows.map((a) => a.role)),
      perPixel = data.forceScale / (this.scale * this.up[2]);
    const entries = [...roles].map((role) => ({
      kind: "force",
      color: this.color[`${role}-force`],
      words: SceneView.WORDS[role],
    }));
    for (const role of new Set(data.points.map((p) => p.role)))
      entries.push({ kind: role, color: this.color[role], words: SceneView.WORDS[role] });
    let newtons = null;
    if (roles.size) {
      const power = 10 ** Math.floor(Math.log10(56 * perPixel));
      newtons = [5, 2, 1].map((step) => step * power).find((n) => n <= 56 * perPixel) ?? power;
    }
    return { entries, newtons, pixels: newtons === null ? 0 : newtons / perPixel };
  }

  drawWords() {
    const { pen, color, data } = this,
      { entries, newtons, pixels } = this.legend();
    pen.font = `12px ${this.font}`;
    pen.textAlign = "left";
    pen.textBaseline = "middle";
    const scale = newtons === null ? "" : SceneView.force(newtons).replace(".0", "");
    const begin = newtons === null ? 12 : 32 + pen.measureText(scale).width;
    let x = begin,
      y = 16,
      right = begin - 12;
    const placed = entries.map((entry) => {
      const wide = 26 + pen.measureText(entry.words).width + 12;
      if (x + wide > this.width && x > begin) {
        x = begin;
        y += 17;
      }
      x += wide;
      right = Math.max(right, x - 12);
      return { entry, x: x - wide, y };
    });
    if (right > 12) {
      // a backing, since drawings may reach below the words
      pen.globalAlpha = 0.85;
      pen.fillStyle = color.halo;
      pen.fillRect(4, 3, right + 2, Math.max(y + 10, 14 + pixels) - 3);
      pen.globalAlpha = 1;
    }
    if (newtons !== null) {
      // an upright bar
      pen.strokeStyle = color.ink;
      pen.lineWidth = 1.5;
      pen.beginPath();
      for (const end of [0, pixels]) {
        pen.moveTo(9, 10 + end);
        pen.lineTo(15, 10 + end);
      }
      pen.moveTo(12, 10);
      pen.lineTo(12, 10 + pixels);
      pen.stroke();
      pen.fillStyle = color.ink;
      pen.fillText(scale, 20, 10 + pixels / 2);
    }
    for (const { entry, x, y } of placed) {
      pen.strokeStyle = pen.fillStyle = entry.color;
      pen.lineWidth = entry.kind === "force" ? 3.2 : 2;
      pen.setLineDash(entry.kind === "sensed" ? [5, 3] : []);
      pen.beginPath();
      pen.moveTo(x, y);
      pen.lineTo(x + 18, y);
      pen.stroke();
      pen.setLineDash([]);
      if (entry.kind === "force") {
        pen.beginPath();
        pen.moveTo(x + 22, y);
        pen.lineTo(x + 14, y - 4.5);
        pen.lineTo(x + 14, y + 4.5);
        pen.fill();
      }
      pen.fillStyle = color.muted;
      pen.fillText(entry.words, x + 26, y);
    }
    if (this.exaggeration !== 1) {
      pen.fillStyle = color.muted;
      pen.textAlign = "right";
      pen.fillText(`motion and heights × ${this.exaggeration}`, this.width - 10, this.height - 12);
    }
    // limits that are active
    let line = 0;
    data.limits.forEach((limit, i) => {
      if (!this.lit[i] || line > 4) return;
      pen.font = `600 12px ${this.font}`;
      const wide = pen.measureText(limit.label).width + 16,
        top = this.width < SceneView.NARROW ? this.height - 26 - 24 * line : y + 16 + 24 * line;
      pen.fillStyle = color.limit;
      pen.beginPath();
      pen.rect(this.width - wide - 8, top, wide, 20);
      pen.fill();
      pen.fillStyle = color.halo;
      pen.textAlign = "left";
      pen.textBaseline = "middle";
      pen.fillText(limit.label, this.width - wide, top + 10.5);
      line += 1;
    });
  }
}
