// Points and faces of bodies: turned and moved, and the order in which faces are drawn. x ahead, y left, z up [m].
class SceneFaces {
  static placed(m, p) {
    return [
      m[0] * p[0] + m[1] * p[1] + m[2] * p[2] + m[3],
      m[4] * p[0] + m[5] * p[1] + m[6] * p[2] + m[7],
      m[8] * p[0] + m[9] * p[1] + m[10] * p[2] + m[11],
    ];
  }

  // Of a direction from the world into the body's frame.
  static turned(m, d) {
    return [
      m[0] * d[0] + m[4] * d[1] + m[8] * d[2],
      m[1] * d[0] + m[5] * d[1] + m[9] * d[2],
      m[2] * d[0] + m[6] * d[1] + m[10] * d[2],
    ];
  }

  static face({ points, material }) {
    let normal = [0, 0, 0];
    for (let i = 0; i < points.length; i += 1) {
      // Newell: for any flat polygon
      const a = points[i],
        b = points[(i + 1) % points.length];
      normal = [
        normal[0] + (a[1] - b[1]) * (a[2] + b[2]),
        normal[1] + (a[2] - b[2]) * (a[0] + b[0]),
        normal[2] + (a[0] - b[0]) * (a[1] + b[1]),
      ];
    }
    const size = Math.hypot(...normal);
    normal = normal.map((c) => c / size);
    return { points, material, normal, at: SceneView.dot(normal, points[0]), area: size / 2 };
  }

  static dot(a, b) {
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
  }

  // A binary space partition: from any direction its faces can be drawn back to front. What crosses a plane is cut by
  // it. Large sheets at the sides come first: what is beside them, such as a wheel, is then beside the whole vehicle.
  static tree(faces, large = 0.08 * Math.max(0, ...faces.filter(SceneView.isUpright).map((f) => f.area))) {
    if (!faces.length) return null;
    let best = null;
    for (let i = 0; i < faces.length; i += 1) {
      let cuts = 0,
        balance = 0;
      for (const face of faces) {
        const side = SceneView.sideOf(faces[i], face);
        if (side === "both") cuts += 1;
        else if (side !== "on") balance += side === "front" ? 1 : -1;
      }
      const first = SceneView.isUpright(faces[i]) && faces[i].area > large ? -1e6 : 0;
      const cost = first + 8 * cuts + Math.abs(balance);
      if (!best || cost < best.cost) best = { cost, plane: faces[i] };
    }
    const { plane } = best,
      on = [],
      front = [],
      back = [];
    for (const face of faces) {
      const side = SceneView.sideOf(plane, face);
      if (side === "on") on.push(face);
      else if (side === "front") front.push(face);
      else if (side === "back") back.push(face);
      else {
        const halves = SceneView.cut(plane, face);
        front.push(halves[0]);
        back.push(halves[1]);
      }
    }
    return { plane, on, front: SceneView.tree(front, large), back: SceneView.tree(back, large) };
  }

  static isUpright(face) {
    return Math.abs(face.normal[1]) > 0.999;
  }

  static sideOf(plane, face) {
    let front = false,
      back = false;
    for (const point of face.points) {
      const over = SceneView.dot(plane.normal, point) - plane.at;
      if (over > 1e-4) front = true;
      if (over < -1e-4) back = true;
    }
    return front ? (back ? "both" : "front") : back ? "back" : "on";
  }

  static cut(plane, face) {
    const halves = [[], []],
      count = face.points.length;
    for (let i = 0; i < count; i += 1) {
      const a = face.points[i],
        b = face.points[(i + 1) % count];
      const da = SceneView.dot(plane.normal, a) - plane.at,
        db = SceneView.dot(plane.normal, b) - plane.at;
      if (da >= -1e-4) halves[0].push(a);
      if (da <= 1e-4) halves[1].push(a);
      if ((da > 1e-4 && db < -1e-4) || (da < -1e-4 && db > 1e-4)) {
        const share = da / (da - db),
          point = a.map((c, k) => c + share * (b[k] - c));
        halves[0].push(point);
        halves[1].push(point);
      }
    }
    return halves.map((points) => ({ ...face, points }));
  }

  // Calls `face` for each face and `item` for each item ({at}, in the same frame), back to front as seen from
  // `toward`.
  static walk(node, toward, items, face, item) {
    if (!node) {
      items.sort((a, b) => SceneView.dot(a.at, toward) - SceneView.dot(b.at, toward));
      items.forEach(item);
      return;
    }
    const { plane } = node,
      ahead = [],
      behind = [];
    for (const one of items) (SceneView.dot(plane.normal, one.at) > plane.at ? ahead : behind).push(one);
    const seen = SceneView.dot(plane.normal, toward) > 0;
    SceneView.walk(seen ? node.back : node.front, toward, seen ? behind : ahead, face, item);
    node.on.forEach(face);
    SceneView.walk(seen ? node.front : node.back, toward, seen ? ahead : behind, face, item);
  }

  // The smallest convex polygon around points on the screen.
  static convex(points) {
    const sorted = [...points].sort((a, b) => a[0] - b[0] || a[1] - b[1]),
      half = (list) => {
        const chain = [];
        for (const p of list) {
          for (;;) {
            const [a, b] = chain.slice(-2);
            if (!b || (b[0] - a[0]) * (p[1] - a[1]) - (b[1] - a[1]) * (p[0] - a[0]) > 0) break;
            chain.pop();
          }
          chain.push(p);
        }
        return chain.slice(0, -1);
      };
    return [...half(sorted), ...half(sorted.reverse())];
  }

  // A point (x, y) turned by an angle, and moved.
  static level(angle, x, y, x0 = 0, y0 = 0) {
    const [c, s] = [Math.cos(angle), Math.sin(angle)];
    return [x0 + c * x - s * y, y0 + s * x + c * y];
  }
}
