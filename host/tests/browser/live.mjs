// Goal: the bar of a served page shows a print and commands it, and asks nobody but its own server.
// Method: Chromium on the page while a simulated board prints. Usage: node live.mjs URL
import { check, checkAccessibility, checkPhone, onPage } from "./driver.mjs";

const [, , url, screenshot] = process.argv;

await onPage(url, async (page, complaints, requests) => {
  const state = (word) => page.waitForFunction((word) => document.getElementById("live-state").textContent.startsWith(word), word, { timeout: 20000 });
  const done = () => page.evaluate(() => document.getElementById("live-done").value);
  const clock = () => page.textContent("#clock");
  await state("running");
  check(true, "the page says that it runs");
  await page.click("[data-order=pause]");
  await state("paused");
  await page.waitForFunction(() => document.getElementById("live-tiles").textContent.includes("resting"));
  const at = await done();
  check(at > 0 && at < 1, `it rests on the way, at ${(100 * at).toFixed(1)} %`);
  check(!(await clock()).startsWith("0.00 of"), "the drawing follows the print");
  await page.fill("#live-feed", "150");
  await page.click("[data-percent=live-feed]");
  await page.waitForFunction(() => document.getElementById("live-tiles").textContent.includes("150, 100 %"));
  check(true, "the feed is what was set");
  await page.fill("#live-flow", "5");
  const before = requests.filter((r) => r.endsWith("/order")).length;
  await page.click("[data-percent=live-flow]");
  check(requests.filter((r) => r.endsWith("/order")).length === before, "a flow out of range is not asked for");
  await page.fill("#live-flow", "100");
  page.once("dialog", (dialog) => dialog.dismiss());
  await page.click("[data-order=abort]");
  check(await page.textContent("#live-state") === "paused", "the end of a job is asked about, and can be declined");
  await checkAccessibility(page);
  if (screenshot) await page.screenshot({ path: screenshot });
  await checkPhone(page);
  await page.click("[data-order=resume]");
  await state("running");
  check(complaints.length === 0, `nothing on the console ${complaints.join(" | ")}`);
  // Browsers ask for an icon of their own accord; without the key it gets nothing.
  check(requests.every((r) => r.startsWith(url) || r === new URL("/favicon.ico", url).href), "no request but to its own server");
});
