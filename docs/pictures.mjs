// Takes pictures of pages in Chromium: node pictures.mjs MODULES JOBS, a JSON list of {page, out, width, scheme,
// element, seconds, held: keys and for how long [s] each}.
import { createRequire } from "node:module";
import { join, resolve } from "node:path";
import { pathToFileURL } from "node:url";

const [modules, jobs] = process.argv.slice(2);
const require = createRequire(join(resolve(modules), "node_modules", "here.js"));
const { chromium } = require("playwright-core");

const browser = await chromium.launch({ executablePath: process.env.CHROMIUM, args: ["--no-sandbox"] });
for (const { page: file, out, width, height, scheme, element, seconds, held = [] } of JSON.parse(jobs)) {
  const context = await browser.newContext({ viewport: { width, height }, colorScheme: scheme });
  const page = await context.newPage();
  await page.goto(pathToFileURL(resolve(file)).href);
  await page.waitForFunction(
    () => [...document.querySelectorAll("[data-plot]")].every((plot) => plot.querySelector(".main-svg")),
    null,
    { timeout: 60000 },
  );
  await page.waitForFunction(() => document.documentElement.dataset.state !== "loading", null, { timeout: 60000 });
  await page.waitForTimeout(1000 * seconds);
  for (const [key, time] of held) {
    if (key) await page.keyboard.down(key);
    await page.waitForTimeout(1000 * time);
    if (key) await page.keyboard.up(key);
  }
  const what = element ? page.locator(element).first() : page;
  await what.screenshot({ path: out, type: "jpeg", quality: 82 });
  await context.close();
}
await browser.close();
console.log("null");
