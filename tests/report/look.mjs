// Looks at a page in Chromium: node look.mjs MODULES PAGE FOLDER. Prints what it found as JSON, leaves pictures and
// files in FOLDER.
import { mkdirSync } from "node:fs";
import { createRequire } from "node:module";
import { join, resolve } from "node:path";
import { pathToFileURL } from "node:url";

const [modules, file, folder] = process.argv.slice(2);
const require = createRequire(join(resolve(modules), "node_modules", "here.js"));
const { chromium } = require("playwright-core");
const axe = require("axe-core");
const address = file.includes("://") ? file : pathToFileURL(resolve(file)).href;
mkdirSync(folder, { recursive: true });

const browser = await chromium.launch({ executablePath: process.env.CHROMIUM, args: ["--no-sandbox"] });
const found = { errors: [], views: [], files: [] };
const open = async (context) => {
  const page = await context.newPage();
  page.on("pageerror", (error) => found.errors.push(error.message));
  page.on("console", (message) => {
    if (message.type() === "error") found.errors.push(message.text());
  });
  await page.goto(address);
  await page.waitForFunction(
    () => [...document.querySelectorAll("[data-plot]")].every((plot) => plot.querySelector(".main-svg")),
    null,
    { timeout: 60000 },
  );
  return page;
};

// in the page: what a reader would see
const seen = () => ({
  overflow: document.documentElement.scrollWidth - innerWidth,
  page: getComputedStyle(document.body).backgroundColor,
  figures: [...document.querySelectorAll("[data-plot]")].map((plot) => {
    const box = plot.getBoundingClientRect();
    const frame = plot.querySelector(".legend")?.getBoundingClientRect();
    const panels = [...plot.querySelectorAll(".plotbg, .xy > .gridlayer, .bg")].length;
    const tops = [...plot.querySelectorAll(".cartesianlayer .plot")].map((panel) => panel.getBoundingClientRect().top);
    return {
      id: plot.id,
      paper: getComputedStyle(plot.querySelector(".main-svg")).background,
      names: [...plot.querySelectorAll(".legendtext")].map((text) => text.textContent),
      clipped: [...plot.querySelectorAll(".legendtext, .xtitle, .ytitle, .annotation-text, .xtick text, .ytick text")]
        .filter((text) => {
          const { left, right, top, bottom } = text.getBoundingClientRect();
          return left < box.left - 1 || right > box.right + 1 || top < box.top - 1 || bottom > box.bottom + 1;
        })
        .map((text) => text.textContent),
      covered: Boolean(frame) && tops.some((top) => frame.bottom > top + 1),
      panels,
    };
  }),
});

for (const colorScheme of ["light", "dark"]) {
  for (const width of [390, 1400]) {
    const context = await browser.newContext({ viewport: { width, height: 900 }, colorScheme });
    const page = await open(context);
    await page.screenshot({ path: join(folder, `${width}-${colorScheme}.png`), fullPage: true });
    const view = { width, scheme: colorScheme, ...(await page.evaluate(seen)) };
    await page.evaluate(axe.source);
    const { violations } = await page.evaluate(() => window.axe.run());
    view.violations = violations.map(({ id, impact, help, nodes }) => ({
      id,
      impact,
      help,
      nodes: nodes.slice(0, 3).map((n) => n.html.slice(0, 200)),
    }));
    found.views.push(view);
    await context.close();
  }
}

// the reader's choice of colours, kept when the page is read again
const context = await browser.newContext({
  viewport: { width: 1400, height: 900 },
  colorScheme: "light",
  acceptDownloads: true,
});
const page = await open(context);
const toggle = page.locator("button.theme");
if (await toggle.count()) {
  await toggle.click();
  found.chosen = await page.evaluate(seen);
  await page.reload();
  await page.waitForTimeout(500);
  found.kept = await page.evaluate(() => getComputedStyle(document.body).backgroundColor);
}

// every file that the page offers, not so soon one after the other that Chromium drops one
for (const link of await page.locator("a[data-csv], .files button").all()) {
  const [download] = await Promise.all([page.waitForEvent("download"), link.click()]);
  const path = join(folder, download.suggestedFilename());
  await download.saveAs(path);
  found.files.push(path);
  await page.waitForTimeout(300);
}
await page.pdf({ path: join(folder, "page.pdf"), preferCSSPageSize: true }); // chosen dark: paper is white all the same
await browser.close();
console.log(JSON.stringify(found));
