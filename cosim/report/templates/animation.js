"use strict";
(() => {
  const PALETTES = {
    light: {
      ink: "#1a2330",
      muted: "#55606e",
      rule: "#aab3be",
      soil: "#d9cdb8",
      soilEdge: "#7a6647",
      sky: "#fbfcfd",
      mark: "rgba(26,35,48,.28)",
      outline: "#7f9a72",
      outlineEdge: "#3c5233",
      tire: "#2b2f36",
      rim: "#c9ced6",
      spoke: "#8a929e",
      strut: "#0b4f8a",
      halo: "#ffffff",
      ground: "#d55e00",
      body: "#c2185b",
      lines: ["#767676", "#0072b2", "#009e73", "#b5578f"],
    },
    dark: {
      ink: "#e4e8ee",
      muted: "#a7b0bc",
      rule: "#5d6875",
      soil: "#4a4030",
      soilEdge: "#a8906a",
      sky: "#161c25",
      mark: "rgba(228,232,238,.35)",
      outline: "#5f7a55",
      outlineEdge: "#b3cda6",
      tire: "#0b0d10",
      rim: "#8a929e",
      spoke: "#4a515c",
      strut: "#7db9ee",
      halo: "#12171e",
      ground: "#f2803d",
      body: "#ff7fab",
      lines: ["#9aa3ad", "#4a9ede", "#2fc49a", "#e08cc0"],
    },
  };
  const DASHES = [[6, 4], [], [2, 3], [9, 3, 2, 3]];
  const PHASES = ["#55606e", "#0072b2", "#9a5b00", "#7b3fa0", "#00705a", "#a3341f"];
  let paint = PALETTES.light,
    printing = false;
  const isDark = () =>
    !printing &&
    (document.documentElement.dataset.theme
      ? document.documentElement.dataset.theme === "dark"
      : matchMedia("(prefers-color-scheme: dark)").matches);
  const FONT = "12px 'Helvetica Neue', Helvetica, Arial, sans-serif";
  const SPEEDS = [0.1, 0.25, 0.5, 1, 2, 4];
  const LOW = -1.2,
    HIGH = 3.05; // m, what is in view
  const make = (tag, className, parent) => {
    const element = document.createElement(tag);
    if (className) element.className = className;
    if (parent) parent.append(element);
    return element;
  };

  const unpack = ({ decimals, steps }) => {
    const values = new Float64Array(steps.length),
      unit = 10 ** decimals;
    let sum = 0;
    steps.forEach((step, i) => {
      sum += step;
      values[i] = sum / unit;
    });
    return values;
  };
  const SERIES = ["x", "z", "angle", "turn", "fx", "fz", "values"];
  const unpackParts = (parts) =>
    parts.forEach((part) => {
      SERIES.forEach((name) => {
        if (part[name]) part[name] = unpack(part[name]);
      });
    });
  const at = (series, place) => {
    const i = Math.min(Math.floor(place), series.length - 1),
      rest = place - i;
    return i + 1 < series.length ? series[i] + rest * (series[i + 1] - series[i]) : series[i];
  };

  const prepare = (scene) => {
    [scene.bodies, scene.wheels, scene.forces, scene.readings].forEach(unpackParts);
    if (scene.phase) scene.phase.index = unpack(scene.phase.index);
    scene.duration = (scene.samples - 1) * scene.step;
    return scene;
  };

  // a canvas as sharp as the screen, its units CSS pixels
  const surface = (canvas, height) => {
    const width = canvas.clientWidth,
      ratio = printing ? 4 : window.devicePixelRatio || 1;
    if (canvas.width !== Math.round(width * ratio) || canvas.height !== Math.round(height * ratio)) {
      canvas.width = Math.round(width * ratio);
      canvas.height = Math.round(height * ratio);
      canvas.style.height = `${height}px`;
    }
    const pen = canvas.getContext("2d");
    pen.setTransform(ratio, 0, 0, ratio, 0, 0);
    pen.clearRect(0, 0, width, height);
    pen.font = FONT;
    pen.lineJoin = pen.lineCap = "round";
    return { pen, width, height };
  };

  const arrow = (pen, x, y, dx, dy, color) => {
    const length = Math.hypot(dx, dy);
    if (length < 3) return;
    const head = Math.min(9, 0.5 * length),
      ux = dx / length,
      uy = dy / length;
    const tip = [x + dx, y + dy],
      neck = [tip[0] - head * ux, tip[1] - head * uy];
    for (const [style, wide] of [
      [paint.halo, 6],
      [color, 3],
    ]) {
      pen.strokeStyle = style;
      pen.lineWidth = wide;
      pen.beginPath();
      pen.moveTo(x, y);
      pen.lineTo(...neck);
      pen.stroke();
    }
    pen.fillStyle = color;
    pen.beginPath();
    pen.moveTo(...tip);
    pen.lineTo(neck[0] - 0.6 * head * uy, neck[1] + 0.6 * head * ux);
    pen.lineTo(neck[0] + 0.6 * head * uy, neck[1] - 0.6 * head * ux);
    pen.fill();
  };

  const drawScene = (canvas, scene, time, options) => {
    const height = Math.round((canvas.clientWidth * (HIGH - LOW)) / options.width);
    const { pen, width } = surface(canvas, height);
    const scale = width / options.width,
      place = Math.min(time, scene.duration) / scene.step;
    const center = at(scene.bodies[0].x, place);
    const px = (x) => width / 2 + (x - center) * scale,
      py = (z) => (HIGH - z) * scale;

    pen.fillStyle = paint.sky;
    pen.fillRect(0, 0, width, height);
    // ground, level beyond its ends
    const ground = scene.ground,
      last = ground[ground.length - 1];
    pen.beginPath();
    pen.moveTo(-10, py(ground[0][1]));
    ground.forEach(([x, z]) => pen.lineTo(px(x), py(z)));
    pen.lineTo(Math.max(width + 10, px(last[0])), py(last[1]));
    pen.lineTo(Math.max(width + 10, px(last[0])), height + 10);
    pen.lineTo(Math.min(-10, px(ground[0][0])), height + 10);
    pen.lineTo(Math.min(-10, px(ground[0][0])), py(ground[0][1]));
    pen.closePath();
    pen.fillStyle = paint.soil;
    pen.fill();
    pen.strokeStyle = paint.soilEdge;
    pen.lineWidth = 2;
    pen.stroke();
    // a mark every meter along the road
    pen.textAlign = "center";
    pen.textBaseline = "alphabetic";
    for (let x = Math.ceil(center - options.width / 2); x <= center + options.width / 2; x += 1) {
      pen.strokeStyle = paint.mark;
      pen.lineWidth = 1;
      pen.beginPath();
      pen.moveTo(px(x), height - 16);
      pen.lineTo(px(x), height - (x % 5 ? 20 : 24));
      pen.stroke();
      pen.fillStyle = paint.muted;
      if (scale > 42 || x % 2 === 0) pen.fillText(`${x}${x % 5 ? "" : " m"}`, px(x), height - 4);
    }

    const onBody = (body, [bx, bz]) => {
      const angle = at(body.angle, place),
        c = Math.cos(angle),
        s = Math.sin(angle);
      return [at(body.x, place) + bx * c + bz * s, at(body.z, place) - bx * s + bz * c];
    };
    // struts: a cylinder from the body, a rod to the wheel
    for (const strut of scene.struts) {
      const wheel = scene.wheels[strut.wheel],
        [x1, z1] = onBody(scene.bodies[strut.body], strut.at);
      const x2 = at(wheel.x, place),
        z2 = at(wheel.z, place),
        length = Math.hypot(x2 - x1, z2 - z1) || 1;
      const share = Math.min(1, strut.length / length);
      const middle = [x1 + share * (x2 - x1), z1 + share * (z2 - z1)];
      strut.drawn = [
        [px(x1), py(z1)],
        [px(middle[0]), py(middle[1])],
        [px(x2), py(z2)],
      ];
    }
    for (const body of scene.bodies) {
      pen.beginPath();
      body.outline.forEach((point, i) => {
        const [x, z] = onBody(body, point);
        pen[i ? "lineTo" : "moveTo"](px(x), py(z));
      });
      pen.closePath();
      pen.fillStyle = paint.outline;
      pen.fill();
      pen.strokeStyle = paint.outlineEdge;
      pen.lineWidth = 2;
      pen.stroke();
    }
    for (const wheel of scene.wheels) {
      const x = px(at(wheel.x, place)),
        y = py(at(wheel.z, place)),
        r = wheel.radius * scale,
        turn = at(wheel.turn, place);
      const disc = (radius, fill) => {
        pen.beginPath();
        pen.arc(x, y, radius, 0, 2 * Math.PI);
        pen.fillStyle = fill;
        pen.fill();
      };
      disc(r, paint.tire);
      disc(0.58 * r, paint.rim);
      pen.strokeStyle = paint.spoke;
      pen.lineWidth = Math.max(1.5, 0.06 * r);
      pen.beginPath();
      for (let k = 0; k < 6; k += 1) {
        const a = turn + (k * Math.PI) / 3;
        pen.moveTo(x, y);
        pen.lineTo(x + 0.52 * r * Math.cos(a), y + 0.52 * r * Math.sin(a));
      }
      pen.stroke();
      disc(0.16 * r, paint.tire);
    }
    for (const strut of scene.struts) {
      for (const [from, to, wide, style] of [
        [1, 2, 7, paint.halo],
        [0, 1, 10, paint.halo],
        [1, 2, 3.5, paint.strut],
        [0, 1, 7, paint.strut],
      ]) {
        pen.strokeStyle = style;
        pen.lineWidth = wide * Math.min(1.3, scale / 48);
        pen.beginPath();
        pen.moveTo(...strut.drawn[from]);
        pen.lineTo(...strut.drawn[to]);
        pen.stroke();
      }
    }
    for (const force of scene.forces) {
      const fx = (at(force.fx, place) / options.forceScale) * scale,
        fz = (at(force.fz, place) / options.forceScale) * scale;
      const x = px(at(force.x, place)),
        y = py(at(force.z, place));
      arrow(pen, x, y, fx, -fz, paint[force.role]);
      const length = Math.hypot(fx, fz);
      // at its true length, out of the picture
      const leaves = x + fx < 0 || x + fx > width || y - fz < 0 || y - fz > height;
      if ((force.role === "body" && length > 3) || leaves) {
        const text = `${Math.round(((length / scale) * options.forceScale) / 1e3)} kN`;
        const where = [
          Math.min(Math.max(x + fx + 6, 4), width - pen.measureText(text).width - 6),
          Math.min(Math.max(y - fz + 4, 34), height - 30),
        ];
        pen.textAlign = "left";
        pen.lineWidth = 3;
        pen.strokeStyle = paint.halo;
        pen.strokeText(text, ...where);
        pen.fillStyle = paint[force.role];
        pen.fillText(text, ...where);
      }
    }
    // scales
    const label = (text, x, color) => {
      pen.textAlign = "left";
      pen.lineWidth = 3;
      pen.strokeStyle = paint.sky;
      pen.strokeText(text, x, 20);
      pen.fillStyle = color;
      pen.fillText(text, x, 20);
      return x + pen.measureText(text).width + 18;
    };
    pen.strokeStyle = paint.ink;
    pen.lineWidth = 1.5;
    pen.beginPath();
    pen.moveTo(10, 12);
    pen.lineTo(10, 16);
    pen.lineTo(10 + scale, 16);
    pen.lineTo(10 + scale, 12);
    pen.stroke();
    let x = label("1 m", 16 + scale, paint.ink);
    // a round force, as long as half a meter or more, stands for both kinds
    const roles = new Set(scene.forces.map((force) => force.role));
    const decade = 10 ** Math.floor(Math.log10(0.5 * options.forceScale));
    const sample = [1, 2, 5, 10].map((k) => k * decade).find((size) => size >= 0.5 * options.forceScale);
    const long = (sample / options.forceScale) * scale;
    for (const [role, text] of [
      ["ground", "on wheels"],
      ["body", "on body"],
    ]) {
      if (!roles.has(role)) continue;
      arrow(pen, x, 16, long, 0, paint[role]);
      x = label(`${sample / 1e3} kN ${text}`, x + long + 6, paint[role]);
    }
  };

  const drawTrack = (canvas, take, time, duration) => {
    const row = canvas.clientWidth < 480 ? 16 : 0, // px, of a second row of words on a narrow page
      height = 116 + row,
      { pen, width } = surface(canvas, height);
    const left = 46,
      right = 10,
      top = 22 + row,
      bottom = 96 + row;
    const x = (t) => left + (t / duration) * (width - left - right);
    const series = take.scenes.map((s) => s.readings[0]).filter(Boolean);
    if (!series.length) return;
    let low = 0,
      high = 0;
    series.forEach((s) =>
      s.values.forEach((v) => {
        low = Math.min(low, v);
        high = Math.max(high, v);
      }),
    );
    if (high === low) high = low + 1;
    const y = (v) => bottom - ((v - low) / (high - low)) * (bottom - top);
    // phases of the last scene that has any
    const phased = take.scenes.findLast((s) => s.phase);
    if (phased) {
      const { index, names } = phased.phase;
      for (let i = 0; i < index.length;) {
        let k = i;
        while (k < index.length && index[k] === index[i]) k += 1;
        if (index[i] > 0) {
          const from = x(i * phased.step),
            to = x(Math.min(k, index.length - 1) * phased.step);
          pen.globalAlpha = 0.16;
          pen.fillStyle = PHASES[index[i] % PHASES.length];
          pen.fillRect(from, top, to - from, bottom - top);
          pen.globalAlpha = 1;
          const name = names[index[i]].split(":")[0];
          pen.textAlign = "center";
          if (pen.measureText(name).width < to - from) pen.fillText(name, (from + to) / 2, top + 12);
        }
        i = k;
      }
    }
    pen.strokeStyle = paint.rule;
    pen.lineWidth = 1;
    pen.strokeRect(left, top, width - left - right, bottom - top);
    pen.beginPath();
    pen.moveTo(left, y(0));
    pen.lineTo(width - right, y(0));
    pen.stroke();
    pen.fillStyle = paint.muted;
    pen.textAlign = "right";
    pen.textBaseline = "middle";
    [...new Set([low, 0, high])].forEach((v) => {
      if (v === 0 || Math.abs(y(v) - y(0)) > 12)
        pen.fillText(v.toFixed(Math.abs(v) < 10 ? 1 : 0).replace("-", "\u2212"), left - 6, y(v));
    });
    pen.textAlign = "center";
    pen.textBaseline = "alphabetic";
    const tick = [0.5, 1, 2, 5, 10, 20, 50, 100].find((d) => duration / d <= 12) || 200;
    for (let t = 0; t <= duration + 1e-9; t += tick)
      pen.fillText(`${+t.toFixed(1)}${t === 0 ? " s" : ""}`, x(t), height - 4);
    take.scenes.forEach((scene, n) => {
      const reading = scene.readings[0];
      if (!reading) return;
      pen.strokeStyle = paint.lines[n % paint.lines.length];
      pen.setLineDash(DASHES[n % DASHES.length]);
      pen.lineWidth = 1.8;
      pen.beginPath();
      reading.values.forEach((v, i) => pen[i ? "lineTo" : "moveTo"](x(i * scene.step), y(v)));
      pen.stroke();
      pen.setLineDash([]);
    });
    let place = left;
    pen.textAlign = "left";
    pen.fillStyle = paint.ink;
    const label = `${series[0].quantity} [${series[0].unit}]`;
    pen.fillText(label, place, 14);
    if (!row) place += pen.measureText(label).width + 18;
    take.scenes.forEach((scene, n) => {
      pen.strokeStyle = paint.lines[n % paint.lines.length];
      pen.setLineDash(DASHES[n % DASHES.length]);
      pen.beginPath();
      pen.moveTo(place, 10 + row);
      pen.lineTo(place + 26, 10 + row);
      pen.stroke();
      pen.setLineDash([]);
      pen.fillStyle = paint.ink;
      pen.fillText(scene.title, place + 31, 14 + row);
      place += 31 + pen.measureText(scene.title).width + 18;
    });
    pen.strokeStyle = paint.ink;
    pen.lineWidth = 1.5;
    pen.beginPath();
    pen.moveTo(x(time), top - 4);
    pen.lineTo(x(time), bottom + 3);
    pen.stroke();
    pen.fillStyle = paint.ink;
    pen.beginPath();
    pen.arc(x(time), top - 4, 4, 0, 2 * Math.PI);
    pen.fill();
    canvas.timeAt = (clientX) =>
      ((clientX - canvas.getBoundingClientRect().left - left) / (width - left - right)) * duration;
  };

  const start = (stage) => {
    const data = JSON.parse(unpacked(document.getElementById(stage.dataset.animation)));
    data.takes.forEach((take) => take.scenes.forEach(prepare));
    const title = stage.closest("figure").querySelector("h3").textContent.trim();
    let take,
      duration,
      views,
      time = 0,
      playing = false,
      speed = 1,
      before = 0;

    stage.replaceChildren();
    stage.tabIndex = 0;
    stage.setAttribute("role", "group");
    stage.setAttribute("aria-label", `Animation: ${title}`);
    const scenes = make("div", "scenes", stage),
      controls = make("div", "controls", stage);
    const button = make("button", "", controls);
    button.type = "button";
    const slider = make("input", "", controls);
    Object.assign(slider, { type: "range", min: 0, step: 0.01, value: 0 });
    slider.setAttribute("aria-label", "time [s]");
    const clock = make("output", "", controls);
    const choose = (text, values, chosen, changed) => {
      const label = make("label", "", controls),
        select = make("select", "", label);
      label.prepend(`${text} `);
      values.forEach((value, i) => {
        const option = make("option", "", select);
        option.value = i;
        option.textContent = value;
        option.selected = i === chosen;
      });
      select.addEventListener("change", () => changed(Number(select.value)));
      return select;
    };
    choose(
      "speed",
      SPEEDS.map((s) => `${s}\u00d7`),
      SPEEDS.indexOf(1),
      (i) => {
        speed = SPEEDS[i];
      },
    );
    const takes = choose(
      "run",
      data.takes.map((t) => t.title),
      0,
      (i) => load(i, 0),
    );
    if (data.takes.length < 2) takes.parentElement.hidden = true;
    const track = make("canvas", "track", stage);
    track.setAttribute("aria-hidden", "true");
    make("p", "keys", stage).textContent =
      "Space plays and pauses; left and right arrow move by 0.05 s, with Shift by 0.5 s; Home and End go to the ends.";

    const load = (number, when) => {
      take = data.takes[number];
      takes.value = number;
      duration = Math.max(...take.scenes.map((s) => s.duration));
      slider.max = duration;
      scenes.replaceChildren();
      views = take.scenes.map((scene) => {
        const box = make("section", "scene", scenes),
          header = make("header", "", box);
        make("b", "", header).textContent = scene.title;
        if (scene.outcome) {
          const chip = make("span", `chip ${scene.good ? "yes" : "no"}`, header);
          chip.textContent = `${scene.good ? "\u2713" : "\u2717"} ${scene.outcome}`;
          chip.title = scene.outcome;
        }
        const phase = scene.phase ? make("span", "phase", header) : null;
        const canvas = make("canvas", "", box);
        canvas.setAttribute("role", "img");
        canvas.setAttribute("aria-label", `${scene.title}, seen from the side`);
        const list = make("dl", "", box);
        const cells = scene.readings.map((reading) => {
          const cell = make("div", "", list);
          make("dt", "", cell).textContent = reading.quantity;
          const dd = make("dd", "", cell),
            number = document.createTextNode("");
          dd.append(number);
          if (reading.unit !== "-") make("span", "", dd).textContent = ` ${reading.unit}`;
          return number;
        });
        scene.struts.forEach((strut) => {
          // cylinders as long as the shortest strut of the run, nearly
          const wheel = scene.wheels[strut.wheel],
            body = scene.bodies[strut.body];
          let least = Infinity;
          for (let i = 0; i < scene.samples; i += 1) {
            const c = Math.cos(body.angle[i]),
              s = Math.sin(body.angle[i]),
              [bx, bz] = strut.at;
            least = Math.min(
              least,
              Math.hypot(body.x[i] + bx * c + bz * s - wheel.x[i], body.z[i] - bx * s + bz * c - wheel.z[i]),
            );
          }
          strut.length = 0.75 * least;
        });
        return { scene, canvas, phase, cells };
      });
      seek(when);
    };

    const draw = () => {
      paint = isDark() ? PALETTES.dark : PALETTES.light;
      for (const { scene, canvas, phase, cells } of views) {
        drawScene(canvas, scene, time, data);
        const place = Math.min(time, scene.duration) / scene.step;
        scene.readings.forEach((reading, i) => {
          cells[i].data = at(reading.values, place)
            .toFixed(reading.decimals)
            .replace(/^-(?=0\.?0*$)/, "")
            .replace("-", "\u2212");
        });
        if (phase) {
          const index = scene.phase.index[Math.min(Math.floor(place + 1e-6), scene.samples - 1)];
          phase.textContent = scene.phase.names[index];
          phase.style.background = PHASES[index % PHASES.length];
        }
      }
      drawTrack(track, take, time, duration);
      slider.value = time;
      clock.textContent = `${time.toFixed(2)} / ${duration.toFixed(1)} s`;
      button.textContent = playing ? "\u275a\u275a Pause" : "\u25b6 Play";
    };
    const seek = (when) => {
      time = Math.max(0, Math.min(duration, when));
      draw();
    };
    let request = 0;
    const next = () => {
      // one loop, also after a pause within a frame
      cancelAnimationFrame(request);
      request = requestAnimationFrame(frame);
    };
    const frame = (now) => {
      if (!playing) return;
      time += Math.min(0.1, (now - before) / 1000) * speed;
      before = now;
      if (time >= duration) {
        time = duration;
        playing = false;
      }
      draw();
      if (playing) next();
    };
    const toggle = () => {
      playing = !playing;
      if (playing) {
        if (time >= duration) time = 0;
        before = performance.now();
        next();
      }
      draw();
    };
    const pause = (when) => {
      playing = false;
      seek(when);
    };

    button.addEventListener("click", toggle);
    slider.addEventListener("input", () => pause(Number(slider.value)));
    track.addEventListener("pointerdown", (event) => {
      track.setPointerCapture(event.pointerId);
      pause(track.timeAt(event.clientX));
    });
    track.addEventListener("pointermove", (event) => {
      if (event.buttons) pause(track.timeAt(event.clientX));
    });
    stage.addEventListener("keydown", (event) => {
      if (event.target.tagName === "SELECT" || event.altKey || event.ctrlKey || event.metaKey) return;
      const step = event.shiftKey ? 0.5 : 0.05;
      const moves = {
        ArrowLeft: () => pause(time - step),
        ArrowRight: () => pause(time + step),
        Home: () => pause(0),
        End: () => pause(duration),
      };
      if (event.key === " ") {
        if (event.target === button) return;
        toggle();
      } else if (moves[event.key]) moves[event.key]();
      else return;
      event.preventDefault();
    });
    // #t=3.2&take=2 shows that instant of that run
    const fromHash = () => {
      const asked = new URLSearchParams(location.hash.slice(1));
      if (!asked.has("t") && !asked.has("take")) return false;
      const number = Math.max(1, Math.min(data.takes.length, Number(asked.get("take")) || 1));
      playing = false;
      load(number - 1, Number(asked.get("t")) || 0);
      return true;
    };
    window.addEventListener("hashchange", fromHash);
    if (!fromHash()) load(0, 0);
    new ResizeObserver(() => draw()).observe(stage);
    window.addEventListener("recolored", draw);
    window.addEventListener("beforeprint", () => {
      printing = true;
      draw();
    });
    window.addEventListener("afterprint", () => {
      printing = false;
      draw();
    });
  };

  document.querySelectorAll("[data-animation]").forEach(start);
})();
