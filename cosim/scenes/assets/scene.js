// Draws a live scene, as cosim/scenes/scene.py describes it: orthographic views of bodies, wheels, struts, forces
// and road. x ahead, y left, z up [m]. It reads values when it draws, and nothing else; colors are CSS custom
// properties (scene.css).
class SceneView {
  static VIEWS = {
    // from where the camera looks: angles [rad] about z, from x ahead to the left, and above the road; from `far` as
    // many times as much is in view, and what `turns` counts its azimuth from where the vehicle heads
    side: { azimuth: -Math.PI / 2, elevation: 0.075 },
    "three-quarter": { azimuth: -0.98, elevation: 0.3 },
    rear: { azimuth: Math.PI, elevation: 0.13 },
    chase: { azimuth: Math.PI, elevation: 0.5, far: 3.5, turns: true },
    top: { azimuth: -Math.PI / 2, elevation: 1.5, far: 4.5 },
  };
  static LIGHT = [0.38, -0.44, 0.81];
  static COLORS = [
    "sky",
    "soil",
    "soil-deep",
    "road",
    "road-mark",
    "track",
    "ink",
    "muted",
    "halo",
    "body",
    "panel",
    "glass",
    "dark",
    "steel",
    "lamp",
    "tail",
    "mass",
    "paint",
    "bonnet",
    "tire",
    "tread",
    "rim",
    "hub",
    "spring",
    "damper",
    "ground-force",
    "actuator-force",
    "body-force",
    "preview",
    "sensed",
    "predicted",
    "limit",
    "shadow",
    "cone",
    "cone-band",
  ];
  static WORDS = {
    ground: "ground on tire",
    actuator: "actuator on body",
    body: "ground on body",
    preview: "preview",
    sensed: "sensed road",
    predicted: "predicted travel",
  };
  static SAMPLES = 150; // of the road in view
  static TRAIL = 0.3; // m between two points of where the wheels have been on open ground
  static TRAILED = 2000; // points of it that are kept
  static LEVELS = 24; // of light
  static SEAM = 0.7; // px, by which neighbors overlap
  static NARROW = 520; // px
  static DRAG = 5; // px, until a press is a drag
  static TURN = 350; // ms, from one view to another

  constructor(canvas, data, { value, ground = () => null, reducedMotion = false, camera = null, changed = () => {} }) {
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

  // A camera that looks from where a view does.
  static from(view) {
    const { azimuth, elevation } = SceneView.VIEWS[view];
    return { view, azimuth, elevation, zoom: 1, turn: null };
  }

  get view() {
    return this.camera.view;
  }

  set view(name) {
    const to = SceneView.VIEWS[name],
      camera = this.camera;
    if (!this.data.views.includes(name)) throw new Error(`no view '${name}'; there are ${this.data.views.join(", ")}`);
    const from = { azimuth: camera.azimuth, elevation: camera.elevation };
    if (SceneView.VIEWS[camera.view].turns) from.azimuth += this.yaw;
    if (to.turns) from.azimuth -= this.yaw;
    camera.view = name;
    camera.turn = null;
    if (this.reducedMotion) Object.assign(camera, { azimuth: to.azimuth, elevation: to.elevation });
    else {
      let way = (to.azimuth - from.azimuth) % (2 * Math.PI); // the shorter way round
      if (way > Math.PI) way -= 2 * Math.PI;
      if (way < -Math.PI) way += 2 * Math.PI;
      camera.turn = { from, way, elevation: to.elevation, begin: null };
    }
  }

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

  // Reads the colors again, after the page has changed its scheme.
  restyle() {
    const style = getComputedStyle(this.canvas);
    this.color = {};
    const dark = style.getPropertyValue("--scene-scheme").trim() === "dark" ? 1 : 0;
    for (const name of SceneView.COLORS) {
      const both = style.getPropertyValue(`--scene-${name}`).trim().split(/\s+/);
      this.color[name] = both[Math.min(dark, both.length - 1)] || "#888888";
    }
    this.font = style.getPropertyValue("font-family") || "sans-serif";
    this.shades.clear();
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

  // ------------------------------------------------------------------------------------------------------------ values

  read() {
    const { names } = this.data;
    for (let i = 0; i < names.length; i += 1) {
      const v = Number(this.value(names[i]));
      this.now[i] = Number.isFinite(v) ? v : 0;
    }
  }

  raw(packed) {
    if (typeof packed === "number") return packed;
    let sum = packed[0];
    for (let i = 2; i < packed.length; i += 2) sum += packed[i + 1] * this.now[packed[i]];
    return sum;
  }

  rest(packed) {
    return typeof packed === "number" ? packed : packed[1];
  }

  // A height or an angle, its distance from rest exaggerated.
  tall(packed) {
    if (typeof packed === "number") return packed;
    return packed[1] + this.exaggeration * (this.raw(packed) - packed[1]);
  }

  pose(body) {
    const roll = this.tall(body.roll),
      pitch = this.tall(body.pitch),
      yaw = this.raw(body.yaw);
    const [cr, sr, cp, sp, cy, sy] = [
      Math.cos(roll),
      Math.sin(roll),
      Math.cos(pitch),
      Math.sin(pitch),
      Math.cos(yaw),
      Math.sin(yaw),
    ];
    return [
      // yaw, then pitch, then roll; the fourth column is where the origin is
      cy * cp,
      cy * sp * sr - sy * cr,
      cy * sp * cr + sy * sr,
      this.raw(body.x),
      sy * cp,
      sy * sp * sr + cy * cr,
      sy * sp * cr - cy * sr,
      this.raw(body.y),
      -sp,
      cp * sr,
      cp * cr,
      this.tall(body.z),
    ];
  }

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

  wheelAt(wheel) {
    let x = this.raw(wheel.x),
      y = this.raw(wheel.y),
      heading = this.raw(wheel.heading);
    const z = this.tall(wheel.z);
    if (wheel.on !== null) {
      const body = this.data.bodies[wheel.on],
        yaw = this.raw(body.yaw);
      [x, y] = SceneView.level(yaw, x, y, this.raw(body.x), this.raw(body.y));
      heading += yaw;
    }
    let pressed = this.tall(wheel.squash),
      toward = -Math.PI / 2; // of the contact, in the wheel's plane from x to z
    if (wheel.contact && pressed > 0) {
      const dx = this.raw(wheel.contact[0]) - x,
        dz = this.raw(wheel.contact[1]) - z;
      if (Math.hypot(dx, dz) > 0.5 * wheel.radius) toward = Math.atan2(dz, dx);
    }
    pressed = Math.max(0, Math.min(pressed, 0.6 * wheel.radius));
    return { wheel, x, y, z, pressed, toward, turn: this.raw(wheel.turn), heading };
  }

  // -------------------------------------------------------------------------------- the order in which faces are drawn

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

  // ----------------------------------------------------------------------------------------------------------- drawing

  // What stands where on the screen: sets the camera for this frame.
  aim() {
    const { camera, data } = this;
    if (camera.turn) {
      const clock = performance.now();
      camera.turn.begin ??= clock;
      const part = Math.min(1, (clock - camera.turn.begin) / SceneView.TURN),
        eased = part * part * (3 - 2 * part);
      camera.azimuth = camera.turn.from.azimuth + eased * camera.turn.way;
      camera.elevation = camera.turn.from.elevation + eased * (camera.turn.elevation - camera.turn.from.elevation);
      if (part === 1) camera.turn = null;
    }
    const { elevation } = camera,
      { far = 1, turns } = SceneView.VIEWS[camera.view],
      body = data.bodies[data.follow];
    this.distant = far > 1;
    this.yaw = this.raw(body.yaw);
    const azimuth = camera.azimuth + (turns ? this.yaw : 0);
    const [ca, sa, ce, se] = [Math.cos(azimuth), Math.sin(azimuth), Math.cos(elevation), Math.sin(elevation)];
    this.toward = [ce * ca, ce * sa, se];
    this.facing = this.inFrame(this.toward[0], this.toward[1]);
    this.right = [-sa, ca, 0];
    this.up = [-se * ca, -se * sa, ce];
    const ratio = (typeof devicePixelRatio === "number" && devicePixelRatio) || 1;
    const width = this.canvas.clientWidth,
      height = this.canvas.clientHeight;
    if (this.canvas.width !== Math.round(width * ratio) || this.canvas.height !== Math.round(height * ratio)) {
      this.canvas.width = Math.round(width * ratio);
      this.canvas.height = Math.round(height * ratio);
    }
    const pen = this.canvas.getContext("2d", { alpha: false }); // every picture covers all of it
    pen.setTransform(ratio, 0, 0, ratio, 0, 0);
    pen.lineJoin = pen.lineCap = "round";
    this.pen = pen;
    this.width = width;
    this.height = height;
    const along = Math.abs(Math.sin(camera.azimuth)),
      across = Math.abs(Math.cos(camera.azimuth)),
      depth = 2 * this.halfWidth;
    const tall = this.top - this.bottom,
      below = this.onRoad ? 0.16 * data.width * (this.carved ? 1 : 0.5) : 0;
    const shown = data.width * (width < SceneView.NARROW ? 0.8 : 1); // a phone shows less of the road, and larger
    const wide = shown * along + 1.5 * depth * across,
      high = (1.28 * tall + below) * ce + (0.4 * shown * across + depth) * se;
    this.scale = (camera.zoom / far) * Math.min(width / wide, height / high);
    const ahead = this.onRoad ? 0.07 * data.width : 0;
    this.center = [this.raw(body.x) + ahead, 0, 0.5 * (this.top + this.bottom) + 0.08 * tall - 0.5 * below];
    if (this.open) this.center[1] = this.raw(body.y);
    if (this.distant) {
      // more of what lies ahead than of what lies behind
      const [c, s] = [Math.cos(this.yaw), Math.sin(this.yaw)],
        tallest = (0.25 * height) / (this.scale * se);
      this.center[0] += c * (turns ? tallest : (0.25 * width) / this.scale);
      this.center[1] += s * tallest;
    }
    this.span = this.onRoad
      ? Math.max(
          0.62 * data.width,
          along > 0.02 ? Math.min((0.62 * width) / (this.scale * along), 1.1 * data.width) : 0,
        )
      : 0;
  }

  px(p) {
    const { center: c, right: r } = this;
    return this.width / 2 + this.scale * ((p[0] - c[0]) * r[0] + (p[1] - c[1]) * r[1]);
  }

  py(p) {
    const { center: c, up: u } = this;
    return this.height / 2 - this.scale * ((p[0] - c[0]) * u[0] + (p[1] - c[1]) * u[1] + (p[2] - c[2]) * u[2]);
  }

  // A point of the road's frame on the screen [CSS pixels]: of the camera of the last frame.
  screen(p) {
    return [this.px(p), this.py(p)];
  }

  path(points, close = true) {
    const { pen } = this;
    pen.beginPath();
    points.forEach((p, i) => (i ? pen.lineTo(this.px(p), this.py(p)) : pen.moveTo(this.px(p), this.py(p))));
    if (close) pen.closePath();
  }

  // A further polygon of a path. All of one path must turn one way, or they would cut holes into each other.
  outline(points, backwards) {
    const { pen } = this,
      count = points.length;
    for (let i = 0; i < count; i += 1) {
      const p = points[backwards ? count - 1 - i : i];
      if (i) pen.lineTo(this.px(p), this.py(p));
      else pen.moveTo(this.px(p), this.py(p));
    }
    pen.closePath();
  }

  // Twice the area of a polygon on the screen, positive where it turns as faces do that are seen.
  turning(points) {
    let sum = 0;
    points.forEach((p, i) => {
      const q = points[(i + 1) % points.length];
      sum += this.py(p) * this.px(q) - this.px(p) * this.py(q);
    });
    return sum;
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

  shade(material, light) {
    const level = Math.round(SceneView.LEVELS * light),
      key = `${material}${level}`;
    let found = this.shades.get(key);
    if (!found) {
      found = SceneView.mixed(this.color[material], 0.58 + 0.5 * (level / SceneView.LEVELS));
      this.shades.set(key, found);
    }
    return found;
  }

  // A color, darker or lighter.
  static mixed(color, factor) {
    const parts = /^#(..)(..)(..)$/.exec(color);
    if (!parts) return color;
    return `rgb(${parts
      .slice(1)
      .map((p) => Math.max(0, Math.min(255, Math.round(parseInt(p, 16) * factor))))
      .join(",")})`;
  }

  // ---------------------------------------------------------------------------------------------------------- the road

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

  // ------------------------------------------------------------------------------------------------- bodies and wheels

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
      this.drawTread(w, near);
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
  drawTread(w, near) {
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
    return near;
  }

  // Whether what is on a line y, or on an axle, is on the side that is seen.
  isNear(x, y) {
    const [ahead, left] = this.facing;
    if (Math.abs(left) > 0.9) return this.besides(x, y) * left >= 0;
    if (Math.abs(ahead) > 0.9) return this.wheels.every((w) => this.inFrame(w.x - x, w.y - y)[0] * ahead < 0.5);
    return true;
  }

  // A level direction in the frame of the vehicle: ahead and to the left.
  inFrame(x, y) {
    return SceneView.level(-this.yaw, x, y);
  }

  // How far a place is to the left of the vehicle's middle plane.
  besides(x, y) {
    const { x: bx, y: by } = this.data.bodies[this.data.follow];
    return this.inFrame(x - this.raw(bx), y - this.raw(by))[1];
  }

  // A point (x, y) turned by an angle, and moved.
  static level(angle, x, y, x0 = 0, y0 = 0) {
    const [c, s] = [Math.cos(angle), Math.sin(angle)];
    return [x0 + c * x - s * y, y0 + s * x + c * y];
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

  // -------------------------------------------------------------------------------------------------- pointer and keys

  orbit(dx, dy) {
    const { camera } = this;
    if (SceneView.VIEWS[camera.view].turns) camera.azimuth += this.yaw;
    camera.view = "three-quarter"; // the one that is free
    camera.turn = null;
    camera.azimuth -= 0.008 * dx;
    camera.elevation = Math.max(0.02, Math.min(1.2, camera.elevation + 0.006 * dy));
  }

  zoom(factor) {
    this.camera.zoom = Math.max(0.5, Math.min(6, this.camera.zoom * factor));
  }

  listen() {
    const { canvas } = this,
      held = new Map();
    const apart = () => {
      const [a, b] = [...held.values()];
      return Math.hypot(a.x - b.x, a.y - b.y);
    };
    canvas.addEventListener("pointerdown", (event) => {
      held.set(event.pointerId, { x: event.clientX, y: event.clientY, still: true });
      if (canvas.setPointerCapture) canvas.setPointerCapture(event.pointerId);
    });
    canvas.addEventListener("pointermove", (event) => {
      const before = held.get(event.pointerId);
      if (!before || (before.still && Math.hypot(event.clientX - before.x, event.clientY - before.y) < SceneView.DRAG))
        return;
      const distance = held.size === 2 ? apart() : 0;
      held.set(event.pointerId, { x: event.clientX, y: event.clientY, still: false });
      if (held.size === 1) this.orbit(event.clientX - before.x, event.clientY - before.y);
      else if (held.size === 2 && distance) this.zoom(apart() / distance);
      this.changed();
    });
    for (const end of ["pointerup", "pointercancel", "lostpointercapture"])
      canvas.addEventListener(end, (event) => held.delete(event.pointerId));
    canvas.addEventListener(
      "wheel",
      (event) => {
        // a page still scrolls over a scene that nobody has chosen
        if (!event.ctrlKey && !event.metaKey && document.activeElement !== canvas) return;
        event.preventDefault();
        this.zoom(Math.exp(-0.0015 * event.deltaY));
        this.changed();
      },
      { passive: false },
    );
    canvas.addEventListener("keydown", (event) => {
      const turn = { ArrowLeft: [-20, 0], ArrowRight: [20, 0], ArrowUp: [0, 15], ArrowDown: [0, -15] }[event.key];
      if (event.ctrlKey || event.metaKey || event.altKey) return;
      if (turn && this.view === "three-quarter")
        this.orbit(...turn); // elsewhere the page drives with them
      else if (event.key === "+" || event.key === "=") this.zoom(1.2);
      else if (event.key === "-") this.zoom(1 / 1.2);
      else if (event.key === "0") this.camera.zoom = 1;
      else return;
      event.preventDefault();
      this.changed();
    });
  }
}
