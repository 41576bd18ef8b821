// Goal: the page looks as it did. Method: its drawing and the one in a picture that is kept in the docs are both made 64 x 45
// points small and held against each other: a lost canvas or colour shows, a font does not. The words above the drawing
// may be a line more or less than they were: the kept one is looked for up and down.
// Usage: node picture.mjs PAGE KEPT.png [take]     with playwright-core and axe-core installed beside it
import { check, drawn, onPage, slide } from "./driver.mjs";
import { readFileSync } from "node:fs";
import { pathToFileURL } from "node:url";
import path from "node:path";

const [, , file, kept, take] = process.argv;

await onPage(pathToFileURL(path.resolve(file)).href, async (page) => {
  // As the kept picture was taken: the nozzle at three fifths of the way.
  await slide(page, "time", await page.evaluate(() => Math.floor(0.6 * document.getElementById("time").max)));
  await drawn(page);
  const shown = await page.screenshot({ fullPage: false, ...(take ? { path: kept } : {}) });
  const box = await page.locator(".drawing").boundingBox();
  // The page's own policy lets no picture in: they are compared on an empty one.
  await page.goto("about:blank");
  const apart = await page.evaluate(async ([pictures, box]) => {
    const [wide, high, UP_MAX] = [64, 45, 100];
    const opened = await Promise.all(pictures.map(async (base64) => {
      const picture = new Image();
      picture.src = `data:image/png;base64,${base64}`;
      await picture.decode();
      return picture;
    }));
    const small = (picture, up) => {
      const canvas = document.createElement("canvas");
      [canvas.width, canvas.height] = [wide, high];
      const context = canvas.getContext("2d");
      context.imageSmoothingQuality = "high";
      context.drawImage(picture, box.x, box.y + up, box.width, box.height - UP_MAX, 0, 0, wide, high);
      return context.getImageData(0, 0, wide, high).data;
    };
    const here = small(opened[0], 0);
    const apart = (of) => here.reduce((sum, at, i) => sum + Math.abs(at - of[i]), 0) / here.length;
    let least = Infinity;
    for (let up = -UP_MAX; up <= UP_MAX; up += 2) least = Math.min(least, apart(small(opened[1], up)));
    // What an empty drawing would differ by: the measure must see it.
    return { sizes: opened.map((picture) => [picture.width, picture.height]), off: least, empty: apart(here.map(() => 255)) };
  }, [[shown.toString("base64"), readFileSync(kept).toString("base64")], box]);
  check(String(apart.sizes[0]) === String(apart.sizes[1]), `the same size, ${apart.sizes[0]}`);
  check(apart.off < 0.15 * apart.empty, `${apart.off.toFixed(2)} of 255 off the kept picture, an empty drawing ${apart.empty.toFixed(2)}`);
});
