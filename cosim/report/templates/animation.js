"use strict";
// Plays recorded runs through the scene of a live page (SceneView), as cosim/report/animation.py describes them.
(() => {
  const PALETTES = {
    light: {
      ink: "#1a2330",
      muted: "#55606e",
      rule: "#aab3be",
      lines: ["#767676", "#0072b2", "#009e73", "#b5578f"],
    },
    dark: {
      ink: "#e4e8ee",
      muted: "#a7b0bc",
      rule: "#5d6875",
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
  const at = (series, place) => {
    const i = Math.min(Math.floor(place), series.length - 1),
      rest = place - i;
    return i + 1 < series.length ? series[i] + rest * (series[i + 1] - series[i]) : series[i];
  };

  // A recorded run: `value` is that of a variable at `place`, in samples, which `seek` sets.
  const prepare = (scene) => {
    const values = scene.values.map((packed) => (typeof packed === "number" ? packed : unpack(packed)));
    scene.place = 0;
    scene.value = (name) => {
      const series = values[scene.series[name]];
      return typeof series === "number" ? series : at(series, scene.place);
    };
    scene.duration = (scene.samples - 1) * scene.step;
    scene.seek = (time) => {
      scene.place = Math.min(time, scene.duration) / scene.step;
    };
    if (scene.phase) scene.phase.index = unpack(scene.phase.index);
    const reading = scene.scene.readings[0]; // is drawn over time
    if (reading) {
      const view = { raw: SceneView.prototype.raw, now: [] };
      const curve = new Float64Array(scene.samples);
      for (scene.place = 0; scene.place < scene.samples; scene.place += 1) {
        view.now = scene.scene.names.map(scene.value);
        curve[scene.place] = reading.factor * view.raw(reading.value);
      }
      scene.first = { label: reading.label, unit: reading.unit, values: curve };
    }
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

  const drawTrack = (canvas, take, time, duration) => {
    const row = canvas.clientWidth < 480 ? 16 : 0, // px, of a second row of words on a narrow page
      height = 116 + row,
      { pen, width } = surface(canvas, height);
    const left = 46,
      right = 10,
      top = 22 + row,
      bottom = 96 + row;
    const x = (t) => left + (t / duration) * (width - left - right);
    const series = take.scenes.map((s) => s.first).filter(Boolean);
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
      const reading = scene.first;
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
    const label = `${series[0].label} [${series[0].unit}]`;
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
    const [{ scene: first }] = data.takes[0].scenes, // one camera for all scenes
      camera = SceneView.from(first.views[0]);
    const reducedMotion = matchMedia("(prefers-reduced-motion: reduce)").matches;
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
    const looks = choose("view", first.views, 0, (i) => {
      views[0].view.view = first.views[i];
      moved();
    });
    const moved = () => {
      looks.value = first.views.indexOf(camera.view);
      draw();
      if (camera.turn && !playing) requestAnimationFrame(moved);
    };
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
        const box = make("section", "run", scenes),
          header = make("header", "", box);
        make("b", "", header).textContent = scene.title;
        if (scene.outcome) {
          const chip = make("span", `chip ${scene.good ? "yes" : "no"}`, header);
          chip.textContent = `${scene.good ? "\u2713" : "\u2717"} ${scene.outcome}`;
          chip.title = scene.outcome;
        }
        const phase = scene.phase ? make("span", "phase", header) : null;
        const canvas = make("canvas", "scene", box);
        canvas.setAttribute("role", "img");
        const view = new SceneView(canvas, scene.scene, {
          value: scene.value,
          reducedMotion,
          camera,
          changed: moved,
        });
        const list = make("dl", "", box);
        const cells = view.readings().map(({ label, unit }) => {
          const cell = make("div", "", list);
          make("dt", "", cell).textContent = label;
          const dd = make("dd", "", cell),
            number = document.createTextNode("");
          dd.append(number);
          if (unit) make("span", "", dd).textContent = ` ${unit}`;
          return number;
        });
        return { scene, canvas, view, phase, cells };
      });
      seek(when);
    };

    const draw = () => {
      const dark = isDark();
      paint = dark ? PALETTES.dark : PALETTES.light;
      for (const { scene, canvas, view, phase, cells } of views) {
        scene.seek(time);
        const scheme = dark ? "dark" : "light";
        if (canvas.dataset.scheme !== scheme) {
          canvas.dataset.scheme = scheme;
          canvas.style.setProperty("--scene-scheme", scheme);
          view.restyle();
        }
        view.draw(time);
        view.readings().forEach(({ text }, i) => {
          cells[i].data = text.replace("-", "\u2212");
        });
        canvas.setAttribute("aria-label", `${scene.title}: ${view.describe()}`);
        if (phase) {
          const index = scene.phase.index[Math.min(Math.floor(scene.place + 1e-6), scene.samples - 1)];
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
