// The camera of a scene and what it looks at: values now, poses, colors, and where a point is on the screen.
class SceneCamera extends SceneFaces {
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
  static COLORS = (
    "sky soil soil-deep road road-mark track ink muted halo body panel glass dark steel lamp tail mass " +
    "paint bonnet tire tread rim hub spring damper ground-force actuator-force body-force preview sensed " +
    "predicted limit shadow cone cone-band"
  ).split(" ");
  static LEVELS = 24; // of light
  static NARROW = 520; // px
  static DRAG = 5; // px, until a press is a drag
  static TURN = 350; // ms, from one view to another

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
