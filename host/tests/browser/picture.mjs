// Goal: the page looks as it did. Method: a picture of it and one that is kept in the docs are both made 64 x 45
// points small and held against each other: a lost column, canvas or colour shows, a font or a new figure does not.
// Usage: node picture.mjs PAGE KEPT.png [take]     with playwright-core and axe-core installed beside it
import { check, onPage } from "./driver.mjs";
import { readFileSync } from "node:fs";
import { pathToFileURL } from "node:url";
import path from "node:path";

const [, , file, kept, take] = process.argv;

await onPage(pathToFileURL(path.resolve(file)).href, async (page) => {
  // As the kept picture was taken: beads at their width, the nozzle at three fifths of the way.
  await page.click("[data-show=beads]");
  await page.evaluate(() => { const time = document.getElementById("time"); time.value = Math.floor(0.6 * time.max); time.dispatchEvent(new Event("input")); });
  await page.waitForTimeout(200);
  const shown = await page.screenshot({ fullPage: false, ...(take ? { path: kept } : {}) });
  // The page's own policy lets no picture in: they are compared on an empty one.
  await page.goto("about:blank");
  const apart = await page.evaluate(async (pictures) => {
    const [wide, high] = [64, 45];
    const small = async (base64) => {
      const picture = new Image();
      picture.src = `data:image/png;base64,${base64}`;
      await picture.decode();
      const canvas = document.createElement("canvas");
      [canvas.width, canvas.height] = [wide, high];
      const context = canvas.getContext("2d");
      context.imageSmoothingQuality = "high";
      context.drawImage(picture, 0, 0, wide, high);
      return { size: [picture.width, picture.height], points: context.getImageData(0, 0, wide, high).data };
    };
    const [a, b] = [await small(pictures[0]), await small(pictures[1])];
    const mean = (of) => of.points.reduce((sum, at, i) => sum + Math.abs(at - b.points[i]), 0) / b.points.length;
    // What an empty page would differ by: the measure must see it.
    const empty = { points: b.points.map(() => 255) };
    return { sizes: [a.size, b.size], off: mean(a), empty: mean(empty) };
  }, [shown.toString("base64"), readFileSync(kept).toString("base64")]);
  check(String(apart.sizes[0]) === String(apart.sizes[1]), `the same size, ${apart.sizes[0]}`);
  check(apart.off < 0.3 * apart.empty, `${apart.off.toFixed(2)} of 255 off the kept picture, an empty page ${apart.empty.toFixed(2)}`);
});
