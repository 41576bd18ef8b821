// Goal: a job's page works inside of a notebook's sandboxed frame. Method: the frame's canvas is looked at until it shows
// the layer: a twentieth of it in strong colours, which its script alone draws. A page that fails stays without and ends
// in the time limit, however slow the machine.
// Usage: node frame.mjs NOTEBOOK.html     with playwright-core and axe-core installed beside it
import { check, onPage } from "./driver.mjs";
import { pathToFileURL } from "node:url";
import path from "node:path";

const [, , file] = process.argv;
const TIMEOUT_MS = 60_000;

await onPage(pathToFileURL(path.resolve(file)).href, async (page, complaints, requests) => {
  const element = await page.waitForSelector("iframe", { timeout: TIMEOUT_MS });
  check((await element.getAttribute("sandbox")) === "allow-scripts", "the frame may run scripts and nothing else");
  const frame = await element.contentFrame();
  await frame.waitForFunction(() => {
    const canvas = document.getElementById("base");
    if (!canvas) return false;
    const { data } = canvas.getContext("2d").getImageData(0, 0, canvas.width, canvas.height);
    let coloured = 0;
    for (let i = 0; i < data.length; i += 4) {
      const colours = [data[i], data[i + 1], data[i + 2]];
      if (data[i + 3] > 0 && Math.max(...colours) - Math.min(...colours) > 64) coloured += 1;
    }
    return coloured > 0.05 * canvas.width * canvas.height;
  }, null, { timeout: TIMEOUT_MS, polling: 200 });
  check(true, "the layer is drawn in colours");
  check(complaints.length === 0, `no complaint ${complaints.join(", ")}`);
  check(requests.every((url) => url.startsWith("file:") || url.startsWith("about:")), `no request ${requests.join(", ")}`);
});
