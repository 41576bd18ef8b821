// Goal: beads are drawn as the ground that the aperture sweeps, without cracks, and what is red is open. Method: the
// page's own outline and sweep on a finer canvas against the figures, which the host measured by another way (a raster of
// cells); then the pixels of the drawing itself. Usage: node sweep.mjs PAGE REPORT.json
import { check, onPage } from "./driver.mjs";
import { readFileSync } from "node:fs";
import { pathToFileURL } from "node:url";
import path from "node:path";

const [, , file, figuresFile] = process.argv;
const figures = JSON.parse(readFileSync(figuresFile));

await onPage(pathToFileURL(path.resolve(file)).href, async (page, complaints) => {
  const swept = await page.evaluate(() => {
    const scale = 40, l = Job.layer(0), p = l.path, [[x0, x1], [y0, y1]] = View.box(l), canvas = document.createElement("canvas");
    canvas.width = (x1 - x0 + 3) * scale; canvas.height = (y1 - y0 + 3) * scale;
    const c = canvas.getContext("2d");
    c.setTransform(scale, 0, 0, scale, (1.5 - x0) * scale, (1.5 - y0) * scale);
    const area = () => { const { data } = c.getImageData(0, 0, canvas.width, canvas.height); let sum = 0; for (let i = 3; i < data.length; i += 4) sum += data[i] > 127; return sum / scale ** 2; };
    c.beginPath();
    for (const ring of l.rings) { for (let i = 0; i < ring.length; i += 2) i ? c.lineTo(ring[i], ring[i + 1]) : c.moveTo(ring[i], ring[i + 1]); c.closePath(); }
    c.fill("evenodd");
    const outline = area(), beads = new Path2D();
    for (let k = 0; k + 1 < p.count; k++) if (Job.prints(p.what[k])) Sweep.segment(beads, p, k);
    c.globalCompositeOperation = "destination-out"; c.fill(beads);
    return { outline, open: area(), points: p.count };
  });
  check(Math.abs(swept.outline / figures.area_mm2 - 1) < 1e-3, `the outline has ${swept.outline.toFixed(2)} mm²`);
  // Pixels of 0.025 mm on some 200 mm of edges between beads and to the outline, each off by a tenth of a pixel at most in the
  // mean; chords of 8 ms were 1 to 3 mm² off.
  const open = figures.area_mm2 * (1 - figures.covered_pct / 100);
  check(Math.abs(swept.open - open) < 0.3, `${swept.open.toFixed(3)} mm² of the sweep are open, ${open.toFixed(3)} in the figures`);
  check(swept.points < 5000, `${swept.points} points suffice`);
  // Beads are on from the start; nothing but them inside the outline, but where it is open.
  check(await page.isChecked("[data-show=beads]"), "beads are drawn from the start");
  for (const box of ["centre", "travel", "ends", "bed", "outline", "open"]) await page.uncheck(`[data-show=${box}]`);
  const cracks = () => page.evaluate(() => {
    const c = View.base.getContext("2d"), { width, height } = View.base, { data } = c.getImageData(0, 0, width, height);
    let white = 0, red = 0;
    const mask = document.createElement("canvas"); mask.width = width; mask.height = height;
    const m = mask.getContext("2d"), path = new Path2D();
    for (const ring of Ui.layer.rings) { for (let i = 0; i < ring.length; i += 2) { const at = View.px(ring[i], ring[i + 1], 0); i ? path.lineTo(...at) : path.moveTo(...at); } path.closePath(); }
    m.fill(path, "evenodd");
    // Pixels that lie inside as a whole.
    m.globalCompositeOperation = "destination-out"; m.lineWidth = 2; m.stroke(path);
    const inside = m.getImageData(0, 0, width, height).data;
    for (let i = 0; i < data.length; i += 4) {
      if (inside[i + 3] < 255) continue;
      if (data[i] > 225 && data[i + 1] > 228 && data[i + 2] > 230) white++;
      if (data[i] > 200 && data[i + 1] < 40 && data[i + 2] < 40) red++;
    }
    return { white: white / View.scale ** 2, red: red / View.scale ** 2 };
  });
  const hidden = await cracks();
  check(hidden.white < open + 0.3 && hidden.red === 0, `${hidden.white.toFixed(3)} mm² of the drawing are bare`);
  await page.check("[data-show=open]");
  const told = await cracks();
  // What shares a pixel with a bead's edge is neither.
  check(told.red > 0.2 * open && told.red < open + 0.3 && told.white < 0.1, `${told.red.toFixed(3)} mm² are red, ${told.white.toFixed(3)} bare`);
  check(complaints.length === 0, `nothing on the console ${complaints.join(" | ")}`);
});
