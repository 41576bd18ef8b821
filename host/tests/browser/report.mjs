// Goal: the report's page works in a real browser. Method: Chromium opens the page from disk, driven
// by Playwright; every step changes what the page shows and that is asserted. Usage:
//   node report.mjs PAGE [SCREENSHOT]      with playwright-core and axe-core installed beside it
// Prints a line a check; exits 1 at the first that fails.
import { check, checkAccessibility, checkPhone, drawn, onPage, slide } from "./driver.mjs";
import { pathToFileURL } from "node:url";
import path from "node:path";

const [, , file, screenshot] = process.argv;
const url = pathToFileURL(path.resolve(file)).href;

await onPage(url, async (page, complaints, requests) => {
  const data = await page.evaluate(() => JSON.parse(document.getElementById("data").textContent));
  const clock = () => page.textContent("#clock");
  const now = () => page.textContent("#now");
  // A sum over the pixels: another picture, another number.
  const picture = (id = "base") => page.evaluate((id) => {
    const canvas = document.getElementById(id);
    const pixels = canvas.getContext("2d").getImageData(0, 0, canvas.width, canvas.height).data;
    let sum = 0;
    for (let i = 0; i < pixels.length; i += 4) sum = (sum * 31 + pixels[i] * 65536 + pixels[i + 1] * 256 + pixels[i + 2] + pixels[i + 3]) % 2147483647;
    return sum;
  }, id);
  const inked = () => page.evaluate(() => {
    const canvas = document.getElementById("base");
    const pixels = canvas.getContext("2d").getImageData(0, 0, canvas.width, canvas.height).data;
    let count = 0;
    for (let i = 0; i < pixels.length; i += 4) if (pixels[i] + pixels[i + 1] + pixels[i + 2] < 740) count++;
    return count;
  });

  // A page of 5 MB takes about a second; this many on a busy machine.
  const drawnMs = await drawn(page);
  check(drawnMs < 30000, `drawn ${Math.round(drawnMs)} ms after it was opened`);
  check(await page.isVisible("#stage"), "the drawing is there");
  check(await inked() > 2000, "the path is drawn");
  check((await page.textContent(".verdict")).startsWith("Takes "), "the verdict begins with the time");
  const first = await picture();

  await page.click("#ahead");
  const stepped = await clock();
  check(await page.inputValue("#time") === "1" && stepped.includes(` of ${data.duration_s.toFixed(2)} s`), `a step moves the clock: ${stepped}`);
  const nozzle = await picture("over");
  await slide(page, "time", await page.evaluate(() => Math.floor(document.getElementById("time").max / 2)));
  check(await clock() !== stepped, "the slider moves the clock");
  check(await picture("over") !== nozzle, "the nozzle moves with it");

  const before = await clock();
  await page.click("#play");
  await page.waitForTimeout(400);
  await page.click("#play");
  check(await clock() !== before, "it plays");
  const rested = await clock();
  await page.waitForTimeout(200);
  check(await clock() === rested, "it rests");
  await page.focus("#over");
  await page.keyboard.press("ArrowRight");
  await page.keyboard.press("Shift+ArrowRight");
  check(await clock() !== rested, "keys step");

  for (const key of ["width", "heading", "limit"]) {
    const was = await picture(), words = await page.textContent("#legend");
    await page.selectOption("#colour", key);
    check(await picture() !== was && await page.textContent("#legend") !== words, `colour by ${key} changes picture and legend`);
  }
  await page.selectOption("#colour", "speed");
  if (data.layers[0].path.axis) check(await page.isVisible("#nowebgl"), "without WebGL space is drawn as lines, and the page says so");
  for (const box of ["beads", "outline", "bed"]) {
    if (box === "outline" && !data.outlines.length) continue;
    if (box === "bed" && !data.bed_mm) continue;
    if (await page.isDisabled(`[data-show=${box}]`)) continue;
    const was = await picture();
    await page.click(`[data-show=${box}]`);
    check(await picture() !== was, `${box} can be switched`);
    await page.click(`[data-show=${box}]`);
  }

  const fitted = await picture();
  await page.click("#in");
  check(await picture() !== fitted, "it zooms");
  const box = await page.locator("#over").boundingBox();
  await page.mouse.move(box.x + 200, box.y + 200);
  await page.mouse.down();
  await page.mouse.move(box.x + 260, box.y + 230, { steps: 4 });
  await page.mouse.up();
  await page.mouse.wheel(0, -240);
  await page.waitForTimeout(100);
  await page.click("#fit");
  check(await picture() === fitted, "it fits again as it was");
  check(typeof first === "number", "a picture has a sum");

  const plots = await page.locator(".plot canvas").count();
  check(plots === 8, "four plots with a cursor each");
  const at = await clock();
  await page.locator(".plot").first().scrollIntoViewIfNeeded();
  const plot = await page.locator(".plot").first().boundingBox();
  await page.mouse.click(plot.x + 0.8 * plot.width, plot.y + 0.5 * plot.height);
  check(await clock() !== at, "a click in a plot goes there");

  const shows = page.locator("#slow button");
  check(await shows.count() === data.slow_places.length, "every slow place has its button");
  if (data.slow_places.length) {
    // From the beginning: the click above may have gone to the very place.
    await slide(page, "time", 0);
    const here = await now();
    await shows.first().click();
    check(await now() !== here && await picture() !== fitted, "a slow place is shown");
    const place = data.slow_places[0], told = (await now()).match(/(-?[\d.]+), (-?[\d.]+), /);
    const away = Math.hypot(Number(told[1]) - place.x_mm, Number(told[2]) - place.y_mm);
    check(away < 0.5, `the nozzle stands there, ${away.toFixed(3)} mm away`);
    await page.click("#fit");
  }
  // The plots tell what the curves reach, without the room above them.
  const [reaches, tells] = await page.evaluate(() => {
    const drawText = CanvasRenderingContext2D.prototype.fillText, texts = [];
    CanvasRenderingContext2D.prototype.fillText = function (text, ...at) { texts.push(text); drawText.call(this, text, ...at); };
    Plots.whole();
    CanvasRenderingContext2D.prototype.fillText = drawText;
    const at = texts.indexOf("Joint speeds, % of each limit");
    return [Math.max(...Ui.layer.joints.map((joint) => Math.max(...joint.value))), Number(texts[at + 1].split(" to ")[1])];
  });
  check(Math.abs(reaches - tells) < 0.01 * reaches && tells < 100, `joints reach ${tells} % of a limit`);
  if (data.layers.length > 1) {
    await page.evaluate(() => window.scrollTo(0, 0));
    const size = page.viewportSize();
    await page.setViewportSize({ width: 1400, height: 1000 });
    const slider = await page.locator("#layer").boundingBox();
    check(slider.y + slider.height < 1000, `the layers' slider is on the first screen, at ${Math.round(slider.y)}`);
    await page.setViewportSize(size);
    const was = await clock();
    await slide(page, "layer", data.layers.length - 1);
    check(await clock() !== was, "another layer has another time");
    const top = await page.textContent("#which");
    check(top.startsWith(`layer ${data.layers.length} of ${data.layers.length}`), `the slider says which layer: ${top}`);
    await page.focus("#over");
    await page.keyboard.press("PageDown");
    check((await page.textContent("#which")).startsWith(`layer ${data.layers.length - 1} of`), "a key changes the layer");
    await slide(page, "layer", 0);
  }
  if (data.layers[0].path.axis) {
    const was = await picture();
    await page.evaluate(() => window.scrollTo(0, 0));
    await page.mouse.move(box.x + 300, box.y + 200);
    await page.mouse.down();
    await page.mouse.move(box.x + 380, box.y + 240, { steps: 4 });
    await page.mouse.up();
    await drawn(page);
    check(await picture() !== was, "six axes turn around");
  }
  if (data.machine) {
    // The page's own links end where the pose has its tip. Half a step of 16 bits a joint, at most a metre
    // of lever each, and what the path may be off along itself at a moment (ALONG_MM).
    const off = await page.evaluate(() => {
      const data = JSON.parse(document.getElementById("data").textContent), layer = data.layers[0];
      const column = ({ min, max, b64 }) => {
        const raw = atob(b64), count = raw.length / 2;
        return Array.from({ length: count }, (_, i) => min + (max - min) * (raw.charCodeAt(2 * i) + 256 * raw.charCodeAt(2 * i + 1)) / 65535);
      };
      const joints = layer.joints_at.map(column), opened = Job.layer(0);
      const slides = joints.map((_, k) => data.machine.links.some(({ joint }) => joint && joint.number === k && joint.slides));
      const coarse = layer.joints_at.reduce((sum, { min, max }, k) => sum + (max - min) / 65535 * (slides[k] ? 0.5 : 500), 0.005 + 0.05);
      let most = 0;
      joints[0].forEach((_, key) => {
        const frames = Links.frames(data.machine.links, Links.joints(joints, layer.joints_every, key * layer.joints_every));
        const tool = Links.times(Links.inverse(frames[data.machine.part]), frames[data.machine.tool]);
        const { x, y, z } = Job.poseAt(opened, opened.start + Math.min(key * layer.joints_every, opened.count - 1) * opened.every);
        most = Math.max(most, Math.hypot(...[x, y, z].map((at, k) => at - tool[k][3])));
      });
      return { most, coarse, keys: joints[0].length };
    });
    check(off.keys > 100 && off.most < off.coarse, `the links end at the tip at ${off.keys} moments: ${off.most.toFixed(4)} mm off, ${off.coarse.toFixed(4)} mm of rounding`);
    const bare = await picture("over"), read = await now();
    await page.click("[data-show=machine]");
    check(await picture("over") !== bare && await now() !== read, "the machine's links can be switched on, with their joints' positions");
    if (screenshot) await page.screenshot({ path: screenshot.replace(".png", "-machine.png"), fullPage: false });
    if (await page.isVisible("[data-show=turning]")) {
      const still = await picture();
      await page.click("[data-show=turning]");
      check(await picture() !== still, "the part moves with its table");
      if (screenshot) await page.screenshot({ path: screenshot.replace(".png", "-turning.png"), fullPage: false });
      await page.click("[data-show=turning]");
    }
    await page.click("[data-show=machine]");
    await page.click("#fit");
  }

  await checkAccessibility(page);

  if (screenshot) await page.screenshot({ path: screenshot, fullPage: false });
  await checkPhone(page);
  check(await inked() > 300, "the path is drawn there");
  await page.emulateMedia({ media: "print" });
  check(!await page.isVisible("#play"), "print leaves the buttons out");
  check(complaints.length === 0, `nothing on the console ${complaints.join(" | ")}`);
  check(requests.length === 1 && requests[0] === url, `no request but the page (${requests.length})`);
});
