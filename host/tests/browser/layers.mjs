// Goal: the page of a part of different layers says of each what it is. Method: Chromium on a page of a mesh with sparse
// infill; what is shown against the block of data and the figures. Usage: node layers.mjs PAGE REPORT.json
import { check, drawn, onPage, slide } from "./driver.mjs";
import { readFileSync } from "node:fs";
import { pathToFileURL } from "node:url";
import path from "node:path";

const [, , file, figuresFile] = process.argv;
const figures = JSON.parse(readFileSync(figuresFile));
// The rows of "Here".
const here = (page) => page.evaluate(() => Object.fromEntries([...document.querySelectorAll("#now dt")].map((dt) => [dt.textContent, dt.nextSibling.textContent])));
const inks = (page) => page.evaluate(() => {
  const { data } = View.base.getContext("2d").getImageData(0, 0, View.base.width, View.base.height);
  let black = 0, red = 0, inked = 0;
  for (let i = 0; i < data.length; i += 4) {
    black += data[i] < 60 && data[i + 1] < 60 && data[i + 2] < 70; red += data[i] > 200 && data[i + 1] < 40 && data[i + 2] < 40;
    inked += Math.max(data[i], data[i + 1], data[i + 2]) - Math.min(data[i], data[i + 1], data[i + 2]) > 60;
  }
  return { black, red, inked };
});

await onPage(pathToFileURL(path.resolve(file)).href, async (page, complaints) => {
  const data = await page.evaluate(() => ({ stack: Job.stack, slow: Job.data.slow_places, duration: Job.data.duration_s, rings: Job.data.layers.map((_, k) => Job.layer(k).rings.length),
    sparse: Job.data.layers.findIndex((_, k) => Job.layer(k).path.what.includes(Job.data.whats.indexOf("sparse"))) }));
  const layers = data.stack.length;
  check(layers > 4 && data.rings.every((rings) => rings > 0), `each of ${layers} layers has its outline`);
  await page.selectOption("#colour", "what");
  for (const name of ["centre", "travel", "ends"]) await page.uncheck(`[data-show=${name}]`);
  check(data.sparse > 0, `layer ${data.sparse + 1} is the first with sparse lines`);
  for (const k of [layers - 1, data.sparse]) {
    await slide(page, "layer", k);
    const with_ = await inks(page);
    await page.uncheck("[data-show=outline]");
    const without = await inks(page);
    await page.check("[data-show=outline]");
    check(with_.inked > 3000 && with_.black > without.black + 300, `layer ${k + 1} is drawn with its outline`);
    // A bead taken away leaves open ground on any layer; the ground of a sparse infill is none.
    const bare = await page.evaluate(() => {
      const { path } = Ui.layer, wall = Job.data.whats.indexOf("wall"), was = path.what.slice();
      for (let i = 0; i < path.count; i++) if (path.what[i] === wall) path.what[i] = Job.TRAVEL;
      Ui.colour = "order"; Flat.draw();
      const { data } = View.base.getContext("2d").getImageData(0, 0, View.base.width, View.base.height);
      path.what.set(was); Ui.colour = "what";
      let red = 0;
      for (let i = 0; i < data.length; i += 4) red += data[i] > 200 && data[i + 1] < 40 && data[i + 2] < 40;
      return red;
    });
    check(bare > 20 * with_.red + (k === data.sparse ? 300 : 1000), `layer ${k + 1} has ${with_.red} pixels of open ground, ${bare} without its walls`);
  }
  // Kinds with time and share.
  const kinds = await page.evaluate(() => [...document.querySelectorAll(".kinds tr")].map((row) => [...row.cells].map((cell) => cell.textContent)));
  const share = kinds.reduce((sum, row) => sum + parseFloat(row[2]), 0);
  check(["wall", "sparse", "travel"].every((kind) => kinds.some((row) => row[0] === kind)), `kinds: ${kinds.map((row) => row.join(" ")).join(", ")}`);
  check(Math.abs(share - 100) < 0.05 * kinds.length + 0.01, `their shares are ${share.toFixed(1)} %`);
  // One clock: the layers follow each other, the last ends when the job does.
  await slide(page, "layer", layers - 1);
  await slide(page, "time", 1e9);
  const clock = await page.textContent("#clock"), [, at, whole] = clock.match(/^([\d.]+) of ([\d.]+) s, layer ([\d.]+) of /) || [];
  // A sample of the speeds at the end may be missing.
  check(Math.abs(whole - data.duration) < 0.01 && whole - at < 0.1, `one clock for layer and job: ${clock}`);
  // Headings within a turn, though the nozzle winds.
  const raw = [], seen = [];
  for (let k = 0; k < 24; k++) {
    await slide(page, "layer", k % layers);
    await slide(page, "time", await page.evaluate((k) => Math.floor(document.getElementById("time").max * (k + 1) / 26), k));
    raw.push(await page.evaluate(() => Job.poseAt(Ui.layer, Ui.time).heading * 180 / Math.PI));
    seen.push(parseFloat((await here(page)).Heading));
  }
  check(raw.some((deg) => deg < 0 || deg >= 360) && seen.every((deg) => deg >= 0 && deg < 360), `headings of ${Math.min(...raw).toFixed(0)} to ${Math.max(...raw).toFixed(0)}° are within a turn`);
  check(raw.every((deg, k) => Math.abs(((deg - seen[k] + 540) % 360 + 360) % 360 - 180) < 0.051), "and are the path's");
  const segment = Number((await here(page)).Segment);
  check(segment > 1 && segment <= figures.segments, `segment ${segment} of ${figures.segments}`);
  // A place of another layer: its layer, close by, something to see, the nozzle on it.
  const number = data.slow.findIndex((place) => place.layer !== undefined);
  check(number >= 0 && figures.slow_places[number].layer === data.slow[number].layer, "slow places know their layers");
  const place = data.slow[number], other = place.layer > 1 ? 0 : layers - 1;
  await slide(page, "layer", other);
  await page.locator("#slow button").nth(number).click();
  check((await page.textContent("#which")).startsWith(`layer ${place.layer + 1} of`), `from layer ${other + 1} Show goes to layer ${place.layer + 1}`);
  const [x, y] = (await here(page)).Place.split(", ").map(Number);
  check((await inks(page)).inked > 3000 && Math.hypot(x - place.x_mm, y - place.y_mm) < 0.5, "and shows it, the nozzle on it");
  // Sparse and solid ground are told apart.
  const verdict = await page.textContent(".verdict");
  check(figures.covered_pct < 90 && figures.solid_covered_pct > 97 && figures.sparse_covered_pct < 60, `${figures.covered_pct.toFixed(1)} % of all, ${figures.solid_covered_pct.toFixed(1)} % of what is to be solid`);
  check(verdict.includes(`Covers ${figures.solid_covered_pct.toFixed(1)} % of what is to be solid`) && verdict.includes("are a sparse infill"), "and the verdict says so");
  // Time of the layer.
  await page.selectOption("#colour", "layer");
  check((await page.textContent("#legend")).includes("time of the layer"), "layers can be coloured by their time");
  await drawn(page);
  check(complaints.length === 0, `nothing on the console ${complaints.join(" | ")}`);
});
