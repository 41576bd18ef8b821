// A browser with one page for the tests: Chromium driven by Playwright, and what the page complains of.
// $NODE_TOOLS names the folder whose node_modules has playwright-core and axe-core; the browser is $CHROMIUM
// or /usr/bin/chromium.
import { createRequire } from "node:module";
import { readFileSync } from "node:fs";
import path from "node:path";

const require = createRequire(path.join(process.env.NODE_TOOLS || process.cwd(), "x.js"));
const { chromium } = require("playwright-core");
const axe = readFileSync(require.resolve("axe-core/axe.min.js"), "utf8");

/// Prints a line a check; throws at the first that fails.
export function check(holds, what) {
  if (!holds) throw new Error(`does not hold: ${what}`);
  console.log(`ok ${what}`);
}

// WebGL by the processor, where there is no other; canvases stay drawn as without it.
const WEBGL = ["--use-gl=angle", "--use-angle=swiftshader", "--enable-unsafe-swiftshader", "--ignore-gpu-blocklist", "--disable-accelerated-2d-canvas"];

/// Gives `steps` the page of `url`, its complaints and its requests so far; with or without WebGL.
export async function onPage(url, steps, { webgl = false } = {}) {
  const browser = await chromium.launch({
    executablePath: process.env.CHROMIUM || "/usr/bin/chromium",
    args: ["--no-sandbox", ...(webgl ? WEBGL : ["--disable-gpu", "--disable-3d-apis"]), "--disable-quic", "--no-first-run",
      "--disable-background-networking", "--disable-component-update", "--disable-sync"],
  });
  try {
    const page = await browser.newPage({ viewport: { width: 1280, height: 900 } });
    const complaints = [], requests = [];
    page.on("console", (message) => { if (message.type() === "error") complaints.push(message.text()); });
    page.on("pageerror", (error) => complaints.push(String(error)));
    page.on("request", (request) => requests.push(request.url()));
    await page.goto(url);
    await steps(page, complaints, requests);
  } finally {
    await browser.close();
  }
}

/// When two frames are through: what was drawn is on the screen then. Milliseconds since the page was opened.
export const drawn = (page) => page.evaluate(() => new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(() => done(performance.now())))));

/// Sets a slider.
export const slide = (page, id, to) => page.evaluate(([id, to]) => { const it = document.getElementById(id); it.value = to; it.dispatchEvent(new Event("input")); }, [id, to]);

/// No serious accessibility fault, by axe-core.
export async function checkAccessibility(page) {
  await page.evaluate(axe);
  const faults = await page.evaluate(async () => (await window.axe.run()).violations.map((v) => ({ id: v.id, impact: v.impact, nodes: v.nodes.map((n) => n.html).slice(0, 3) })));
  const serious = faults.filter((fault) => ["serious", "critical"].includes(fault.impact));
  check(serious.length === 0, `no serious accessibility fault${serious.length ? JSON.stringify(serious) : ""}`);
}

/// A phone's width holds the page.
export async function checkPhone(page) {
  await page.setViewportSize({ width: 390, height: 800 });
  await page.waitForTimeout(300);
  const wide = await page.evaluate(() => document.documentElement.scrollWidth);
  check(wide <= 390, `a phone's width holds it (${wide} px)`);
}
