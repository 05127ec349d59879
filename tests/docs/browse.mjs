// Looks at pages of a site in Chromium: node browse.mjs MODULES FOLDER PAGE... Prints what it found as JSON, leaves
// pictures in FOLDER.
import { mkdirSync } from "node:fs";
import { createRequire } from "node:module";
import { basename, join, resolve } from "node:path";
import { pathToFileURL } from "node:url";

const [modules, folder, ...files] = process.argv.slice(2);
const require = createRequire(join(resolve(modules), "node_modules", "here.js"));
const { chromium } = require("playwright-core");
const axe = require("axe-core");
mkdirSync(folder, { recursive: true });

const browser = await chromium.launch({ executablePath: process.env.CHROMIUM, args: ["--no-sandbox"] });
const found = [];
for (const colorScheme of ["light", "dark"]) {
  for (const width of [390, 1400]) {
    const context = await browser.newContext({ viewport: { width, height: 900 }, colorScheme });
    for (const file of files) {
      const page = await context.newPage();
      const errors = [],
        asked = [];
      page.on("pageerror", (error) => errors.push(error.message));
      page.on("console", (message) => {
        if (message.type() === "error") errors.push(message.text());
      });
      page.on("request", (request) => {
        if (!/^(file|data|blob):/.test(request.url())) asked.push(request.url());
      });
      await page.goto(pathToFileURL(resolve(file)).href);
      await page.waitForTimeout(200);
      await page.screenshot({ path: join(folder, `${basename(file, ".html")}-${width}-${colorScheme}.png`) });
      const overflow = await page.evaluate(() => document.documentElement.scrollWidth - innerWidth);
      const dark = await page.evaluate(() => getComputedStyle(document.body).getPropertyValue("--md-default-bg-color"));
      await page.evaluate(axe.source);
      const { violations } = await page.evaluate(() => window.axe.run({ preload: false }));
      const harms = violations
        .filter(({ impact }) => ["serious", "critical"].includes(impact))
        .map(({ id, help, nodes }) => ({
          id,
          help,
          count: nodes.length,
          nodes: nodes.slice(0, 3).map((n) => n.html.slice(0, 200)),
        }));
      found.push({ page: basename(file), width, scheme: colorScheme, errors, asked, overflow, dark, harms });
      await page.close();
    }
    await context.close();
  }
}

// how many screens of a phone the first page takes
const phone = await (await browser.newContext({ viewport: { width: 390, height: 900 } })).newPage();
await phone.goto(pathToFileURL(resolve(files[0])).href);
const screens = await phone.evaluate(() => document.documentElement.scrollHeight / innerHeight);

// search without a network, and the choices above the table of claims
const page = await (await browser.newContext({ viewport: { width: 1400, height: 900 } })).newPage();
await page.goto(pathToFileURL(resolve(files[0])).href);
await page.locator(".md-search__input").click();
await page.locator(".md-search__input").pressSequentially("bump stop");
await page.waitForSelector(".md-search-result__link", { timeout: 20000 });
const hits = await page.locator(".md-search-result__link").evaluateAll((links) => links.map((link) => link.href));
const claims = files.find((file) => basename(file) === "claims.html");
let narrowed = null;
if (claims) {
  await page.goto(pathToFileURL(resolve(claims)).href);
  const shown = () =>
    page
      .locator(".claims tbody tr:visible")
      .evaluateAll((rows) => rows.map((row) => [row.cells[0].textContent, row.cells[5].textContent]));
  narrowed = { all: await shown() };
  await page.getByLabel("paper").selectOption("003");
  narrowed.paper = await shown();
  await page.getByLabel("verdict").selectOption("not reproduced");
  narrowed.both = await shown();
  narrowed.said = await page.locator(".claims output").textContent();
}
await browser.close();
console.log(JSON.stringify({ views: found, screens, hits, narrowed }));
