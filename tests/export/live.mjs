// Runs a live page in Chromium: node live.mjs MODULES PAGE FOLDER SECONDS. Prints what it found as JSON, leaves
// pictures in FOLDER.
import { mkdirSync } from "node:fs";
import { createRequire } from "node:module";
import { join, resolve } from "node:path";
import { pathToFileURL } from "node:url";

const [modules, file, folder, seconds] = process.argv.slice(2);
const require = createRequire(join(resolve(modules), "node_modules", "here.js"));
const { chromium } = require("playwright-core");
const axe = require("axe-core");
mkdirSync(folder, { recursive: true });

const browser = await chromium.launch({
  executablePath: process.env.CHROMIUM,
  args: ["--no-sandbox", "--js-flags=--expose-gc", "--enable-precise-memory-info"],
});
const found = { errors: [], asked: [], views: [], groups: [] };
const open = async (context, more = "") => {
  const page = await context.newPage();
  page.on("pageerror", (error) => found.errors.push(error.message));
  page.on("console", (message) => {
    if (["error", "warning"].includes(message.type())) found.errors.push(message.text());
  });
  page.on("request", (request) => {
    if (!/^(file|data|blob):/.test(request.url())) found.asked.push(request.url());
  });
  await page.goto(pathToFileURL(resolve(file)).href + more);
  await page.waitForFunction(() => document.documentElement.dataset.state !== "loading", null, { timeout: 60000 });
  return page;
};

for (const colorScheme of ["light", "dark"]) {
  for (const width of [390, 1400]) {
    const context = await browser.newContext({ viewport: { width, height: 900 }, colorScheme });
    const page = await open(context);
    const clock = () =>
      page.evaluate(() => new Promise((done) => requestAnimationFrame((now) => done([page.time, now / 1000]))));
    await page.waitForTimeout(1000); // until the browser has compiled what runs often
    const from = await clock();
    const frames = await page.evaluate(
      () =>
        new Promise((done) => {
          // drawn in three seconds
          const before = page.frames,
            begun = performance.now();
          const look = (now) =>
            now - begun < 3000 ? requestAnimationFrame(look) : done(((page.frames - before) / (now - begun)) * 1000);
          requestAnimationFrame(look);
        }),
    );
    const to = await clock();
    const view = await page.evaluate(() => ({
      state: document.documentElement.dataset.state,
      ready: performance.getEntriesByName("ready")[0].startTime / 1000,
      overflow: document.documentElement.scrollWidth - innerWidth,
      running: page.running,
      labels: [...document.querySelectorAll("canvas")].map((c) => c.getAttribute("aria-label")),
    }));
    await page.screenshot({ path: join(folder, `${width}-${colorScheme}.png`), fullPage: true });
    await page.evaluate(axe.source);
    const { violations } = await page.evaluate(() => window.axe.run());
    view.violations = violations.map(({ id, impact, help, nodes }) => ({
      id,
      impact,
      help,
      nodes: nodes.slice(0, 3).map((n) => n.html.slice(0, 200)),
    }));
    found.views.push({ width, scheme: colorScheme, frames, pace: (to[0] - from[0]) / (to[1] - from[1]), ...view });
    await context.close();
  }
}

// a system that stands can be looked at from all sides
{
  const context = await browser.newContext({ viewport: { width: 1400, height: 900 } });
  const page = await open(context, "#paused");
  const seen = () =>
    page.evaluate(() => ({
      view: document.getElementById("view").value,
      azimuth: page.camera.azimuth,
      zoom: page.camera.zoom,
      time: page.time,
      running: page.running,
      picture: page.views[0].canvas.toDataURL(),
      label: page.views[0].canvas.getAttribute("aria-label"),
    }));
  const box = await page.locator("#scenes canvas").first().boundingBox();
  const drag = async (far) => {
    await page.mouse.move(box.x + 200, box.y + 80);
    await page.mouse.down();
    await page.mouse.move(box.x + 200 + far, box.y + 80, { steps: 8 });
    await page.mouse.up();
    await page.waitForTimeout(300);
  };
  found.looks = { first: await seen() };
  await drag(2);
  found.looks.pressed = await seen();
  await drag(80);
  found.looks.dragged = await seen();
  await page.keyboard.press("+");
  await page.waitForTimeout(300);
  found.looks.zoomed = await seen();
  await page.selectOption("#view", "rear");
  await page.waitForTimeout(1000);
  found.looks.rear = await seen();
  await context.close();
}

// what keys and gamepads drive: each key for a while, then a gamepad, which is lost; all rows of that run
{
  const context = await browser.newContext({ viewport: { width: 1400, height: 900 } });
  const page = await open(context, "#paused");
  const driven = await page.evaluate(() => page.drives.map((c) => [c.spec.names[0], c.spec.drive]));
  const advance = (time) =>
    page.evaluate((s) => {
      page.advance(Math.round(s / page.data.interval));
      page.draw();
      return { step: page.variants[0].steps, values: page.drives.map((c) => page.variants[0].value(c.spec.names[0])) };
    }, time);
  const gamepad = (pad) =>
    page.evaluate((p) => {
      navigator.getGamepads = () => [p];
      dispatchEvent(new Event(p ? "gamepadconnected" : "gamepaddisconnected"));
      return document.getElementById("pad").textContent;
    }, pad && { connected: true, mapping: "standard", id: "pad", ...pad });
  if (driven.length) {
    const keys = [];
    for (const [name, { raised_by, lowered_by }] of driven)
      for (const key of [...raised_by, ...lowered_by]) {
        const { step: from } = await advance(0);
        await page.keyboard.down(key);
        const { step: to, values: held } = await advance(0.3);
        await page.keyboard.up(key);
        keys.push({ name, key, from, to, held, released: (await advance(1)).values });
      }
    const there = await gamepad({ axes: [-1, 0, 0, 0], buttons: Array.from({ length: 17 }, () => ({ value: 1 })) });
    const { values: held } = await advance(0.5);
    const lost = await gamepad(null);
    const { values: released } = await advance(1);
    await page.screenshot({ path: join(folder, "driven.png") });
    found.driven = await page.evaluate(() => {
      const { history, instance, steps, driven, row } = page.variants[0],
        rows = (n) => Array.from({ length: steps + 1 }, (_, k) => history.at(k, n));
      return {
        names: [...instance.place.keys()],
        bits: [...new BigInt64Array(row.buffer)].map(String),
        rows: Object.fromEntries([...history.place.keys()].map((n) => [n, rows(n)])),
        inputs: driven,
        scrolled: scrollY,
        readings: page.views[0].view.readings(),
      };
    });
    Object.assign(found.driven, { keys, pad: { there, held, lost, released } });
  }
  await context.close();
}

// without a picture: the numbers, group by group, and what they cost
const context = await browser.newContext({ reducedMotion: "reduce" });
const page = await open(context);
found.waits = await page.evaluate(() => !page.running);
const groups = await page.evaluate(() => page.data.groups.length);
const memory = async () => {
  await page.waitForTimeout(500); // pictures that are due hold on to what they show
  return page.evaluate(() => {
    gc();
    gc();
    return performance.memory.usedJSHeapSize;
  });
};
const first = await memory();
for (let k = 1; k <= 4; k++) await page.evaluate((g) => page.choose(g), k % groups);
found.memory = (await memory()) / first;
for (let group = 0; group < groups; group++) {
  found.groups.push(
    await page.evaluate(
      ([g, end]) => {
        page.choose(g);
        const begun = performance.now();
        page.advance(Math.round(end / page.data.interval));
        return {
          seconds: (performance.now() - begun) / 1000,
          systems: page.variants.map((v) => {
            const row = v.row;
            return {
              title: v.title,
              failure: v.failure,
              verdict: v.score.verdict,
              steps: v.steps,
              names: [...v.instance.place.keys()],
              bits: [...new BigInt64Array(row.buffer)].map(String), // JSON has no -0
              measures: v.score.measures.map((m, i) => v.score.value(i)),
            };
          }),
        };
      },
      [group, Number(seconds)],
    ),
  );
}
await browser.close();
console.log(JSON.stringify(found));
