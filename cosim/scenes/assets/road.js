// The ground of a scene: road with its section, open ground, the floor of a rig, shadows and traces.
class SceneRoad extends SceneCamera {
  static SAMPLES = 150; // of the road in view
  static SEAM = 0.7; // px, by which neighbors overlap

  // Height under the wheels of a side at a place along the road; of what is unknown, the nearest that is known.
  sampled(side, k) {
    const cells = this.cells[side];
    let found = cells.get(k);
    if (found === undefined) {
      const given = this.probe(side, k * this.step);
      found = given === null || given === undefined || !Number.isFinite(given) ? null : given;
      if (found !== null) cells.set(k, found);
    }
    return found;
  }

  profile() {
    const { data } = this,
      first = Math.floor((this.center[0] - this.span) / this.step),
      last = Math.ceil((this.center[0] + this.span) / this.step);
    const sides = new Set(data.grounds.map((g) => g.side));
    for (const w of this.wheels) {
      // what the wheels have met stays drawn, where nobody knows the road
      const side = w.y >= 0 ? "left" : "right",
        k = Math.round(w.x / this.step);
      if (w.pressed > 0 && !this.carved && !this.cells[side].has(k) && this.probe(side, w.x) === null) {
        this.cells[side].set(k, (w.z - w.wheel.radius + w.pressed) / this.exaggeration);
      }
    }
    const xs = [];
    for (let k = first; k <= last; k += 1) xs.push(k * this.step);
    const outlines = [
      ...data.reliefs.map((r) => ({ side: r.side, points: r.points.map((p) => p.map((v) => this.raw(v))) })),
      ...data.trenches.map((t) => {
        const start = this.raw(t.start),
          end = start + this.raw(t.length),
          depth = this.raw(t.depth);
        return {
          side: t.side,
          points: [
            [start, 0],
            [start, -depth],
            [end, -depth],
            [end, 0],
          ],
        };
      }),
    ];
    const edges = [...new Set(outlines.flatMap((o) => o.points.map((p) => p[0])))].filter(
      (x) => x > xs[0] && x < xs[xs.length - 1],
    );
    const all = [
      ...xs.map((x) => [x, 0]),
      ...edges.flatMap((x) => [
        [x, -1],
        [x, 1],
      ]),
    ].sort((a, b) => a[0] - b[0] || a[1] - b[1]);
    const points = [],
      held = { left: 0, right: 0 },
      deepest = Math.abs(this.right[0]) < 0.97 ? -0.12 * data.width : -Infinity; // as the block of ground
    for (const [x, beside] of all) {
      const heights = { left: null, right: null };
      for (const side of ["left", "right"]) {
        if (sides.has(side)) heights[side] = this.sampled(side, Math.round(x / this.step));
        const own = outlines.find((o) => o.side === "both" || o.side === side);
        if (own) heights[side] = SceneView.along(own.points, x, beside);
        else if (heights[side] === null) heights[side] = this.cells[side].get(Math.round(x / this.step)) ?? null;
      }
      held.left = heights.left ?? heights.right ?? held.left;
      held.right = heights.right ?? heights.left ?? held.right;
      points.push([
        x,
        Math.max(deepest, this.exaggeration * held.left),
        Math.max(deepest, this.exaggeration * held.right),
      ]);
    }
    for (const cells of Object.values(this.cells))
      if (cells.size > 8 * SceneView.SAMPLES)
        for (const k of cells.keys()) if (k < first - 4 * SceneView.SAMPLES) cells.delete(k);
    return points;
  }

  // Height of an outline at x; at a wall, that of the side `beside`.
  static along(points, x, beside) {
    let last = null;
    for (const p of points) {
      if (p[0] > x || (p[0] === x && beside < 0)) {
        if (!last) return p[1];
        return p[0] > last[0] ? last[1] + ((p[1] - last[1]) * (x - last[0])) / (p[0] - last[0]) : last[1];
      }
      last = p;
    }
    return last[1];
  }

  // Height at a place, between the tracks as the road is drawn.
  heightAt(x, y) {
    if (!this.onRoad) return 0;
    const points = this.road,
      n = points.length;
    let low = 0,
      high = n - 1;
    while (high - low > 1) {
      const middle = (low + high) >> 1;
      if (points[middle][0] <= x) low = middle;
      else high = middle;
    }
    const a = points[low],
      b = points[high],
      share = b[0] > a[0] ? Math.max(0, Math.min(1, (x - a[0]) / (b[0] - a[0]))) : 0;
    const left = a[1] + share * (b[1] - a[1]),
      right = a[2] + share * (b[2] - a[2]);
    const part = Math.max(0, Math.min(1, 0.5 + (0.5 * y) / this.trackHalf));
    return right + part * (left - right);
  }

  drawRoad() {
    const { halfWidth: w } = this;
    const points = (this.road = this.profile());
    const lines = this.data.grounds
      .map((g) => Math.abs(g.y))
      .concat(this.data.wheels.map((g) => Math.abs(this.rest(g.y))));
    const track = (this.trackHalf = Math.max(0.05, Math.min(...lines)));
    this.center[2] += 0.5 * this.mean(points);
    const near = this.toward[1] < 0 ? -w : w,
      alike = points.every((p) => p[1] === p[2]);
    const lanes = alike
      ? [[-near, 1, near, 1]]
      : [
          [w, 1, track, 1],
          [track, 1, -track, 2],
          [-track, 2, -w, 2],
        ];
    if (!alike && this.toward[1] > 0)
      lanes.reverse().forEach((lane) => lane.splice(0, 4, lane[2], lane[3], lane[0], lane[1]));
    const order = this.toward[0] < 0 ? [...points].reverse() : points;
    lanes.forEach((lane, i) => this.drawLane(order, i > 0, ...lane));
    this.drawTracks();
    this.drawMarks(near);
    this.drawSection(near);
    this.drawShadow();
  }

  // The road from the far line y1, with the heights of column c1, to the near one; `points` from back to front. What is
  // lit alike, and is seen from the same face, is one path: browsers take their time for each. Each reaches a little
  // over the one before, so that no seam shines through.
  drawLane(points, covers, y1, c1, y2, c2) {
    const { pen, scale, right: r, up: u } = this,
      count = points.length;
    const left = this.width / 2 - scale * (this.center[0] * r[0] + this.center[1] * r[1]);
    const top = this.height / 2 + scale * (this.center[0] * u[0] + this.center[1] * u[1] + this.center[2] * u[2]);
    const far = new Float64Array(2 * count),
      close = new Float64Array(2 * count); // x, y on the screen
    const back = covers ? (Math.sign(y1 - y2) * SceneView.SEAM) / (scale * Math.hypot(r[1], u[1])) : 0;
    points.forEach((p, i) => {
      far[2 * i] = left + scale * (p[0] * r[0] + (y1 + back) * r[1]);
      far[2 * i + 1] = top - scale * (p[0] * u[0] + (y1 + back) * u[1] + p[c1] * u[2]);
      close[2 * i] = left + scale * (p[0] * r[0] + y2 * r[1]);
      close[2 * i + 1] = top - scale * (p[0] * u[0] + y2 * u[1] + p[c2] * u[2]);
    });
    const along = Math.hypot(r[0], u[0]),
      sign = points[0][0] < points[count - 1][0] ? 1 : -1;
    const over = [(-SceneView.SEAM * sign * r[0]) / along, (SceneView.SEAM * sign * u[0]) / along];
    const paint = (from, to, level) => {
      pen.fillStyle = this.shade("road", level / SceneView.LEVELS);
      pen.beginPath();
      if (from) {
        pen.moveTo(close[2 * from] + over[0], close[2 * from + 1] + over[1]);
        pen.lineTo(far[2 * from] + over[0], far[2 * from + 1] + over[1]);
      }
      for (let i = from; i <= to; i += 1) pen.lineTo(far[2 * i], far[2 * i + 1]);
      for (let i = to; i >= from; i -= 1) pen.lineTo(close[2 * i], close[2 * i + 1]);
      pen.fill();
    };
    let begin = 0,
      level = null,
      face = null;
    for (let i = 1; i < count; i += 1) {
      const a = points[i - 1],
        b = points[i],
        k = 2 * i,
        j = k - 2;
      const slope = Math.atan2(0.5 * sign * (b[c1] - a[c1] + b[c2] - a[c2]), Math.max(1e-9, sign * (b[0] - a[0])));
      const light = Math.max(0, -Math.sin(slope) * SceneView.LIGHT[0] * 1.6 + Math.cos(slope) * SceneView.LIGHT[2]);
      const own = Math.round(SceneView.LEVELS * light);
      let seen = 0; // 4 or -4: all of it from one face; else it is folded on the screen, and a path of its own
      for (const ahead of [far, close])
        for (const m of [j, k]) {
          seen += Math.sign(
            (ahead[k] - ahead[j]) * (close[m + 1] - far[m + 1]) - (ahead[k + 1] - ahead[j + 1]) * (close[m] - far[m]),
          );
        }
      if (
        Math.min(far[j], far[k], close[j], close[k]) > this.width ||
        Math.max(far[j], far[k], close[j], close[k]) < 0
      ) {
        // out of sight
        if (level !== null) paint(begin, i - 1, level);
        level = null;
      } else if (level === null || Math.abs(own - level) > 1 || seen !== face || Math.abs(seen) < 4) {
        if (level !== null) paint(begin, i - 1, level);
        [begin, level, face] = [i - 1, own, seen];
      }
    }
    if (level !== null) paint(begin, count - 1, level);
  }

  mean(points) {
    let sum = 0;
    for (const p of points) sum += Math.max(-0.3, p[1]) + Math.max(-0.3, p[2]);
    return sum / (2 * points.length);
  }

  // Where the wheels have been.
  drawTracks() {
    const { pen, color, road } = this;
    pen.fillStyle = color.track;
    pen.globalAlpha = 0.3;
    for (const side of [1, -1]) {
      const wheels = this.wheels.filter((w) => w.y * side > 0);
      if (!wheels.length) continue;
      const front = wheels.reduce((a, b) => (b.x > a.x ? b : a)),
        half = 0.42 * front.wheel.width;
      this.ribbon(road[0][0], front.x, front.y + half, front.y - half, side > 0 ? 1 : 2);
    }
    pen.globalAlpha = 1;
  }

  // A strip that lies on the road from x1 to x2, interrupted by walls and what is deep; heights of the left (1) or the
  // right track (2), 0: in between.
  ribbon(x1, x2, y1, y2, column) {
    const { pen, road } = this,
      deep = -0.4;
    let piece = [];
    const flush = () => {
      if (piece.length > 1) {
        this.path([...piece.map(([x, a]) => [x, y1, a]), ...piece.reverse().map(([x, , b]) => [x, y2, b])]);
        pen.fill();
      }
      piece = [];
    };
    const height = (p, y) =>
      column ? p[column] : p[2] + (p[1] - p[2]) * Math.max(0, Math.min(1, 0.5 + (0.5 * y) / this.trackHalf));
    const ends = [x1, x2].map((x) => [x, this.heightAt(x, this.halfWidth), this.heightAt(x, -this.halfWidth)]);
    for (const p of [ends[0], ...road.filter((q) => q[0] > x1 && q[0] < x2), ends[1]]) {
      const a = height(p, y1),
        b = height(p, y2),
        before = piece[piece.length - 1];
      if (before && Math.abs(a - before[1]) > 2 * (p[0] - before[0]) + 1e-9) flush();
      if (Math.min(a, b) < deep) flush();
      else piece.push([p[0], a, b]);
    }
    flush();
  }

  // A line across the road every meter, which moves by; every fifth has its distance.
  drawMarks(near) {
    const { pen, color, road } = this,
      first = road[0][0],
      last = road[road.length - 1][0];
    const unit = this.scale < 22 ? 5 : 1,
      far = this.scale < 40 ? 10 : 5;
    pen.strokeStyle = color["road-mark"];
    this.labels = [];
    for (let x = Math.ceil(first / unit) * unit; x <= last; x += unit) {
      const strong = x % far === 0,
        w = this.halfWidth;
      pen.globalAlpha = strong ? 0.75 : 0.28;
      pen.lineWidth = strong ? 1.3 : 1;
      this.path(
        [
          [x, w, this.heightAt(x, w)],
          [x, this.trackHalf, this.heightAt(x, w)],
          [x, -this.trackHalf, this.heightAt(x, -w)],
          [x, -w, this.heightAt(x, -w)],
        ],
        false,
      );
      pen.stroke();
      if (strong) this.labels.push([x, near, this.heightAt(x, near)]);
    }
    pen.globalAlpha = 1;
  }

  // The ground cut open at the side that is seen, and at the end.
  drawSection(near) {
    const { pen, color, road } = this,
      w = this.halfWidth,
      deepest = this.carved ? 0.13 * this.data.width : 0.05 * this.data.width;
    const column = near > 0 ? 1 : 2,
      flat = Math.abs(this.right[0]) > 0.97,
      depth = flat ? this.height / this.scale : deepest;
    const fill = (top, a, b) => {
      const level = Math.max(...top.map((p) => p[2])),
        base =
          Math.min(-deepest, ...top.map((p) => p[2] - 0.3 * deepest).filter((z) => z > -0.6 * deepest)) -
          (flat ? depth : 0);
      const [ax, ay] = this.screen([a[0], a[1], level]),
        [bx, by] = this.screen([b[0], b[1], level]);
      const length = Math.hypot(bx - ax, by - ay) || 1,
        nx = -(by - ay) / length,
        ny = (bx - ax) / length,
        sign = ny < 0 ? -1 : 1;
      const reach =
        Math.abs(ny) * this.scale * this.up[2] * (deepest + level + 0.12 * this.data.width * (flat ? 1 : 0));
      const gradient = pen.createLinearGradient(ax, ay, ax + sign * nx * reach, ay + sign * ny * reach);
      gradient.addColorStop(0, color.soil);
      gradient.addColorStop(1, color["soil-deep"]);
      pen.fillStyle = gradient;
      this.path([...top.map((p) => [p[0], p[1], Math.max(p[2], base)]), [b[0], b[1], base], [a[0], a[1], base]]);
      pen.fill();
      pen.strokeStyle = color["road-mark"];
      pen.lineWidth = 1.4;
      this.path(
        top.map((p) => [p[0], p[1], Math.max(p[2], base)]),
        false,
      );
      pen.stroke();
    };
    const end = this.toward[0] > 0 ? road[road.length - 1] : road[0],
      t = this.trackHalf;
    if (Math.abs(this.toward[0]) > 0.12) {
      fill(
        [
          [end[0], w, end[1]],
          [end[0], t, end[1]],
          [end[0], -t, end[2]],
          [end[0], -w, end[2]],
        ],
        [end[0], w, 0],
        [end[0], -w, 0],
      );
    }
    if (Math.abs(this.toward[1]) > 0.12) {
      const a = road[0],
        b = road[road.length - 1];
      fill(
        road.map((p) => [p[0], near, p[column]]),
        [a[0], near, 0],
        [b[0], near, 0],
      );
    }
    pen.fillStyle = color.muted;
    pen.font = `11px ${this.font}`;
    pen.textAlign = "center";
    pen.textBaseline = "top";
    for (const p of this.labels) {
      const [x, y] = this.screen(p);
      if (Math.abs(this.toward[1]) > 0.3 && x > 12 && x < this.width - 12)
        pen.fillText(`${p[0]} m`, x, Math.min(y + 6, this.height - 14));
    }
  }

  drawShadow() {
    const { pen, color, data } = this;
    pen.fillStyle = color.shadow;
    const xs = this.wheels.map((w) => w.x),
      r = this.wheels.length ? this.wheels[0].wheel.radius : 0;
    if (this.open) {
      const [rear, front, half] = data.footprint,
        m = this.poses[data.follow];
      pen.globalAlpha = 0.25;
      this.path(
        [
          [rear, half],
          [front, half],
          [front, -half],
          [rear, -half],
        ].map(([x, y]) => [...SceneView.level(this.yaw, x, y, m[3], m[7]), 0]),
      );
      pen.fill();
    } else if (xs.length > 1) {
      const half = Math.max(...this.wheels.map((w) => Math.abs(w.y))) + 0.1;
      pen.globalAlpha = 0.2;
      this.ribbon(Math.min(...xs) - 1.15 * r, Math.max(...xs) + r, half, -half, 0);
    }
    pen.globalAlpha = 0.34;
    for (const w of this.wheels) {
      const points = [],
        z = this.heightAt(w.x, w.y),
        long = 0.62 * w.wheel.radius,
        wide = 0.62 * w.wheel.width;
      if (w.z - z > 1.6 * w.wheel.radius) continue; // over a trench
      for (let i = 0; i < 14; i += 1) {
        const [c, s] = [Math.cos(i * 0.4488), Math.sin(i * 0.4488)];
        points.push([...SceneView.level(this.yaw, long * c, wide * s, w.x, w.y), z]);
      }
      this.path(points);
      pen.fill();
    }
    pen.globalAlpha = 1;
  }

  // Level ground in all directions: lines across both ways, and where the wheels have been.
  drawPlain() {
    const { pen, color, data, scale } = this,
      [cx, cy] = this.center,
      reach = this.distant ? (0.75 * (this.width + this.height / this.toward[2])) / scale : 1.2 * data.width;
    const [back, ahead, right, left] = [cx - reach, cx + reach, cy - reach, cy + reach];
    pen.fillStyle = this.shade("road", 0.8);
    this.path([
      [back, right, 0],
      [ahead, right, 0],
      [ahead, left, 0],
      [back, left, 0],
    ]);
    pen.fill();
    const unit = scale < 40 ? 5 : 1,
      strong = 5 * unit;
    pen.strokeStyle = color["road-mark"];
    pen.lineWidth = 1;
    const line = (at, from, to) => {
      pen.globalAlpha = at % strong === 0 ? 0.5 : 0.22;
      this.path([from, to], false);
      pen.stroke();
    };
    for (let x = Math.ceil(back / unit) * unit; x <= ahead; x += unit) line(x, [x, right, 0], [x, left, 0]);
    for (let y = Math.ceil(right / unit) * unit; y <= left; y += unit) line(y, [back, y, 0], [ahead, y, 0]);
    pen.strokeStyle = color.track;
    pen.globalAlpha = 0.55;
    this.wheels.forEach((w, i) => {
      pen.lineWidth = Math.max(1.2, 0.6 * w.wheel.width * scale * Math.min(1, 0.3 + this.toward[2]));
      this.path([...this.trail.map((point) => point.wheels[i]), [w.x, w.y, 0]], false);
      pen.stroke();
    });
    pen.globalAlpha = 1;
    this.drawShadow();
  }

  // What a rig stands on.
  drawFloor() {
    const { pen, color, data } = this,
      z = this.bottom,
      w = 0.5 * data.width,
      deep = 0.22 * data.width;
    pen.fillStyle = this.shade("road", 0.8);
    this.path([
      [-w, deep, z],
      [w, deep, z],
      [w, -deep, z],
      [-w, -deep, z],
    ]);
    pen.fill();
    pen.strokeStyle = color["road-mark"];
    pen.globalAlpha = 0.4;
    pen.lineWidth = 1;
    pen.stroke();
    pen.globalAlpha = 1;
  }

  // Heights over the past, on paper that moves away.
  drawTraces(time) {
    const { pen, color, data } = this;
    const seen = Math.abs(this.right[0]) > 0.3; // not along the paper
    data.traces.forEach((trace, i) => {
      const past = this.history[i],
        z = this.raw(trace.z),
        length = 0.5 * data.width + trace.x; // to the left edge
      if (!past.length || time - past[past.length - 1][0] > length / trace.speed / 300) past.push([time, z]);
      while (past.length && (time - past[0][0]) * trace.speed > length) past.shift();
      if (!seen) return;
      const points = [...past, [time, z]].map(([t, h]) => [
        trace.x - trace.speed * (time - t),
        trace.y,
        this.rest(trace.z) + this.exaggeration * (h - this.rest(trace.z)),
      ]);
      pen.lineWidth = trace.role === "ground" ? 2 : 1.6;
      pen.strokeStyle = { ground: color["road-mark"], wheel: color.muted, body: color.mass }[trace.role];
      this.path(points, false);
      pen.stroke();
      const [x, y] = this.screen(points[points.length - 1]);
      pen.fillStyle = pen.strokeStyle;
      pen.beginPath();
      pen.arc(x, y, 2.6, 0, 2 * Math.PI);
      pen.fill();
    });
  }
}
