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

/// Gives `steps` the page of `url`, its complaints and its requests so far.
export async function onPage(url, steps) {
  const browser = await chromium.launch({
    executablePath: process.env.CHROMIUM || "/usr/bin/chromium",
    args: ["--no-sandbox", "--disable-gpu", "--disable-quic", "--no-first-run",
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
