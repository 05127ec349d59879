// Bodies, wheels, struts and cones of a scene.
class SceneBodies extends SceneRoad {
  // A cone, standing, or lying where it has been hit: then it has another color, too.
  drawCone(cone, way) {
    const { pen, color } = this,
      circle = (at, radius, z) =>
        Array.from({ length: 16 }, (_, i) => [
          at[0] + radius * Math.cos((i * Math.PI) / 8),
          at[1] + radius * Math.sin((i * Math.PI) / 8),
          z,
        ]);
    const lies = way !== undefined,
      ground = this.heightAt(cone.x, cone.y),
      [c, s] = lies ? [Math.cos(way), Math.sin(way)] : [0, 0];
    // across its axis, at a part of its height
    const section = (part) => {
      const [radius, far] = [cone.radius * Math.max(0.15, 1 - part), part * cone.height];
      if (!lies) return circle([cone.x, cone.y], radius, ground + far);
      const [x, y] = [cone.x + far * c, cone.y + far * s];
      return circle([0, 0], radius, 0).map(([a, b]) => [x - a * s, y + a * c, ground + b]);
    };
    const paint = (from, to, style) => {
      pen.fillStyle = pen.strokeStyle = style;
      pen.lineWidth = this.distant ? 1.5 : 0.6; // seen from afar
      pen.beginPath();
      for (const p of SceneView.convex([...section(from), ...section(to)].map((q) => this.screen(q)))) pen.lineTo(...p);
      pen.closePath();
      pen.fill();
      pen.stroke();
    };
    const style = lies ? color.limit : color.cone;
    if (!lies) paint(0, 0.04, SceneView.mixed(style, 0.7));
    paint(0, 1, style);
    if (!lies) paint(0.4, 0.65, color["cone-band"]);
  }

  drawBodies() {
    const { data, poses } = this,
      host = data.follow,
      m = poses[host];
    const inFrame = (p) => SceneView.turned(m, [p[0] - m[3], p[1] - m[7], p[2] - m[11]]);
    const items = this.wheels.map((w) => ({ at: inFrame([w.x, w.y, w.z]), draw: () => this.drawWheel(w) }));
    data.bodies.forEach((body, i) => {
      if (i !== host)
        items.push({ at: inFrame([poses[i][3], poses[i][7], poses[i][11]]), draw: () => this.drawFaces(i, []) });
    });
    data.cones.forEach((cone, i) => {
      const at = [cone.x, cone.y, this.heightAt(cone.x, cone.y)],
        [x, y] = this.screen(at);
      if (x < -50 || y < -50 || x > this.width + 50 || y > this.height + 50) return;
      items.push({ at: inFrame(at), draw: () => this.drawCone(cone, this.fallen.get(i)) });
    });
    this.drawFaces(host, items);
  }

  drawFaces(index, items) {
    const m = this.poses[index],
      { pen } = this,
      light = SceneView.turned(m, SceneView.LIGHT),
      toward = SceneView.turned(m, this.toward);
    let style = null; // faces of one color that follow each other are one path
    const flush = () => {
      if (!style) return;
      pen.fillStyle = pen.strokeStyle = style;
      pen.lineWidth = 0.7;
      pen.fill();
      pen.stroke(); // hides the seams between faces
      style = null;
    };
    SceneView.walk(
      this.trees[index],
      toward,
      items,
      (face) => {
        const facing = SceneView.dot(face.normal, toward) < 0 ? -1 : 1;
        const own = this.shade(face.material, Math.max(0, facing * SceneView.dot(face.normal, light)));
        if (own !== style) {
          flush();
          pen.beginPath();
          style = own;
        }
        this.outline(
          face.points.map((point) => SceneView.placed(m, point)),
          facing < 0,
        );
      },
      (item) => {
        flush();
        item.draw();
      },
    );
    flush();
  }

  // A ring of a wheel's tire: points at `radius` (in parts of the tire's) and `across` (in half widths), pressed in by
  // the ground.
  ring(w, radius, across, count, from = 0) {
    const { wheel } = w,
      c = Math.cos(w.heading),
      s = Math.sin(w.heading),
      points = [];
    const flat = wheel.radius - w.pressed,
      y = (across * wheel.width) / 2;
    for (let i = 0; i < count; i += 1) {
      const angle = from + (i * 2 * Math.PI) / count,
        off = Math.cos(angle - w.toward);
      let r = radius * wheel.radius;
      if (off > 0 && r * off > flat) r = flat / off;
      const along = r * Math.cos(angle);
      points.push([w.x + along * c - y * s, w.y + along * s + y * c, w.z + r * Math.sin(angle)]);
    }
    return points;
  }

  drawWheel(w) {
    const { pen, color } = this,
      count = Math.max(20, Math.min(48, 2 * Math.round(0.4 * w.wheel.radius * this.scale))),
      axis = [-Math.sin(w.heading), Math.cos(w.heading), 0];
    const near = SceneView.dot(axis, this.toward) > 0 ? 1 : -1;
    const rings = [
      [0.9, -1],
      [1, -0.72],
      [1, 0.72],
      [0.9, 1],
    ].map(([r, a]) => this.ring(w, r, near * a, count));
    pen.lineWidth = 0.6;
    pen.fillStyle = pen.strokeStyle = color.tire;
    this.path(rings[0]);
    pen.fill();
    if (Math.abs(SceneView.dot(axis, this.toward)) < 0.995) {
      for (let k = 0; k < 3; k += 1) {
        pen.beginPath();
        for (let i = 0; i < count; i += 1) {
          const j = (i + 1) % count,
            quad = [rings[k][i], rings[k][j], rings[k + 1][j], rings[k + 1][i]];
          const area = this.turning(quad);
          if (area * near > 0) this.outline(quad, area < 0); // that looks at the camera
        }
        pen.fill();
        pen.stroke();
      }
      this.drawTread(w);
    }
    this.path(rings[3]);
    pen.fill();
    pen.stroke();
    if (Math.abs(SceneView.dot(axis, this.toward)) > 0.04) this.drawRim(w, near, count); // not from its edge
  }

  // Sidewall, rim, spokes that turn, and a ring where a limit is active.
  drawRim(w, near, count) {
    const { pen, color } = this;
    const disc = (radius, style) => {
      pen.fillStyle = style;
      this.path(this.ring(w, radius, near, radius > 0.7 ? count : 28));
      pen.fill();
    };
    disc(0.86, color.tread);
    disc(0.8, color.tire);
    disc(0.6, color.rim);
    disc(0.53, SceneView.mixed(color.rim, 0.86));
    pen.strokeStyle = color.rim;
    pen.lineWidth = Math.max(1, 0.085 * w.wheel.radius * this.scale);
    const center = this.ring(w, 0, near, 1)[0],
      spokes = this.ring(w, 0.55, near, 6, -w.turn);
    pen.beginPath();
    for (const p of spokes) {
      pen.moveTo(this.px(center), this.py(center));
      pen.lineTo(this.px(p), this.py(p));
    }
    pen.stroke();
    disc(0.2, color.hub);
    const valve = this.ring(w, 0.68, near, 1, -w.turn + 0.5)[0]; // one mark, by which a turn can be seen
    pen.fillStyle = color.rim;
    pen.beginPath();
    pen.arc(this.px(valve), this.py(valve), Math.max(1, 0.035 * w.wheel.radius * this.scale), 0, 2 * Math.PI);
    pen.fill();
    const at = this.data.wheels.indexOf(w.wheel);
    if (this.data.limits.some((limit, i) => limit.at === at && this.lit[i])) {
      pen.strokeStyle = color.limit;
      pen.lineWidth = 2.5;
      this.path(this.ring(w, 0.97, near, count));
      pen.stroke();
    }
  }

  // Blocks on the tread that is seen, which turn.
  drawTread(w) {
    const { pen, color } = this,
      blocks = 24;
    pen.fillStyle = color.tread;
    pen.beginPath();
    for (let i = 0; i < blocks; i += 1) {
      const angle = -w.turn + (i * 2 * Math.PI) / blocks;
      const normal = [Math.cos(angle) * Math.cos(w.heading), Math.cos(angle) * Math.sin(w.heading), Math.sin(angle)];
      if (SceneView.dot(normal, this.toward) < 0.02) continue;
      const a = this.ring(w, 1.004, -0.7, 1, angle)[0],
        b = this.ring(w, 1.004, -0.7, 1, angle + 0.13)[0];
      const c = this.ring(w, 1.004, 0.7, 1, angle + 0.13)[0],
        d = this.ring(w, 1.004, 0.7, 1, angle)[0];
      this.outline([a, b, c, d], this.turning([a, b, c, d]) < 0);
    }
    pen.fill();
  }

  // Spring and damper, drawn through the sheet that hides them, but not through wheels.
  drawStruts() {
    if (this.distant) return;
    const { pen, data, color } = this,
      seen = data.struts.filter((s) => this.isNear(this.wheels[s.wheel].x, this.wheels[s.wheel].y));
    if (!seen.length) return;
    pen.save();
    pen.beginPath();
    pen.rect(0, 0, this.width, this.height);
    for (const w of this.wheels) {
      if (!this.isNear(w.x, w.y)) continue;
      const side = Math.sign(SceneView.dot([-Math.sin(w.heading), Math.cos(w.heading), 0], this.toward)) || 1;
      const outer = this.ring(w, 0.985, side, 32);
      outer.forEach((p, i) => (i ? pen.lineTo(this.px(p), this.py(p)) : pen.moveTo(this.px(p), this.py(p))));
      pen.closePath();
    }
    if (data.wheels.length > 1) pen.clip("evenodd");
    for (const strut of seen) {
      const w = this.wheels[strut.wheel];
      if (Math.abs(this.facing[0]) < 0.9 && data.wheels.length > 1 && this.besides(w.x, w.y) * this.facing[1] < 0)
        continue; // behind the body
      const from = SceneView.placed(this.poses[strut.body], strut.at);
      this.drawStrut(from, [w.x + strut.to[0], w.y + strut.to[1], w.z + strut.to[2]], w.wheel.radius);
    }
    pen.restore();
    pen.globalAlpha = 1;
    pen.strokeStyle = color.ink;
  }

  drawStrut(from, to, radius) {
    const { pen, color } = this,
      line = (a, b, wide, style) => {
        pen.strokeStyle = style;
        pen.lineWidth = wide;
        this.path([a, b], false);
        pen.stroke();
      };
    const at = (share) => from.map((c, k) => c + share * (to[k] - c)),
      unit = radius * this.scale;
    const tube = Math.max(3, 0.15 * unit),
      length = Math.hypot(...from.map((c, k) => to[k] - c));
    // the tube keeps its length, the rod shows
    const body = Math.min(0.75, (0.62 * radius) / Math.max(0.1 * radius, length));
    line(from, to, Math.max(1.5, 0.07 * unit), color.rim);
    // a helix about the strut: what is behind first
    const coils = 7,
      steps = 8,
      axis = from.map((c, k) => (to[k] - c) / (length || 1));
    let across = [axis[2], 0, -axis[0]];
    const norm = Math.hypot(...across) || 1;
    across = across.map((c) => c / norm);
    const third = [
      axis[1] * across[2] - axis[2] * across[1],
      axis[2] * across[0] - axis[0] * across[2],
      axis[0] * across[1] - axis[1] * across[0],
    ];
    const flat = [across, third].map((d) => [
      SceneView.dot(d, this.right),
      -SceneView.dot(d, this.up),
      SceneView.dot(d, this.toward),
    ]);
    const size = 0.17 * unit,
      [x1, y1] = this.screen(from),
      [x2, y2] = this.screen(to);
    const draw = (front, wide, style) => {
      pen.strokeStyle = style;
      pen.lineWidth = wide;
      pen.beginPath();
      let drawing = false;
      for (let i = 0; i <= coils * steps; i += 1) {
        const angle = (i * 2 * Math.PI) / steps,
          share = 0.06 + (0.88 * i) / (coils * steps),
          c = Math.cos(angle),
          s = Math.sin(angle);
        const x = x1 + share * (x2 - x1) + size * (c * flat[0][0] + s * flat[1][0]),
          y = y1 + share * (y2 - y1) + size * (c * flat[0][1] + s * flat[1][1]);
        if (drawing) pen.lineTo(x, y);
        drawing = c * flat[0][2] + s * flat[1][2] > 0 === front;
        if (drawing) pen.moveTo(x, y);
      }
      pen.stroke();
    };
    draw(false, Math.max(1.2, 0.06 * unit), SceneView.mixed(color.spring, 0.6));
    line(from, at(body), tube, color.damper);
    draw(true, Math.max(2.6, 0.115 * unit), color.halo);
    draw(true, Math.max(1.6, 0.075 * unit), color.spring);
  }
}
