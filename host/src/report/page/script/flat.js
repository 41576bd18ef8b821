"use strict";
// One layer from above, on a canvas: bed, outline, beads as the ground that the aperture sweeps, open ground, travel. In
// space it draws the path as lines, where there is no WebGL.
const Flat = (() => {
  const { data } = Job, { base } = View, CHUNK = 250;
  // What the path's tolerance and the corners of the outline may leave between beads that touch, mm; seen from so many
  // pixels a millimetre on.
  const SLACK_MM = 0.012, CLOSE = 40;
  // Segments of one colour that follow each other, as the ground that they sweep.
  const kept = new Map();
  function chunks(l, key) {
    const id = `${l.page} ${key}`;
    if (kept.has(id)) return kept.get(id);
    // A few layers are kept: going back and forth costs nothing.
    if (kept.size > 6) kept.delete(kept.keys().next().value);
    const p = l.path, bin = Colours.binOf(l, key, [l]), out = [];
    let chunk = null;
    for (let k = 0; k + 1 < p.count; k++) {
      if (!Job.prints(p.what[k])) { chunk = null; continue; }
      if (!chunk || chunk.bin !== bin(k) || k - chunk.from >= CHUNK) { chunk = { bin: bin(k), from: k, path: new Path2D(), line: new Path2D(), box: [p.x[k], p.x[k], p.y[k], p.y[k]] }; chunk.line.moveTo(p.x[k], p.y[k]); out.push(chunk); }
      Sweep.segment(chunk.path, p, k);
      chunk.line.lineTo(p.x[k + 1], p.y[k + 1]);
      chunk.end = k + 1;
      const [x, y] = [p.x[k + 1], p.y[k + 1]], box = chunk.box;
      box[0] = Math.min(box[0], x); box[1] = Math.max(box[1], x); box[2] = Math.min(box[2], y); box[3] = Math.max(box[3], y);
    }
    kept.set(id, out);
    return out;
  }
  // Whether a piece reaches into what is on the screen.
  const REACH = Math.max(0, ...Sweep.nozzle.map(([u, v]) => Math.hypot(u, v)));
  const NARROW = Math.min(...Sweep.nozzle.map(([u, v]) => Math.hypot(u, v)));
  function inView({ box }) {
    const w = base.width / 2 / View.scale + REACH, h = base.height / 2 / View.scale + REACH;
    return box[0] < View.x + w && box[1] > View.x - w && box[2] < View.y + h && box[3] > View.y - h;
  }
  // Canvas coordinates become the input's.
  function inMillimetres(c) {
    c.setTransform(View.scale, 0, 0, -View.scale, base.width / 2 - View.x * View.scale, base.height / 2 + View.y * View.scale);
  }
  const inPixels = (c) => c.setTransform(1, 0, 0, 1, 0, 0);
  const spare = document.createElement("canvas");
  let drawnOpen = "";
  // The outline without what is swept: exact at every zoom. Ground between sparse lines is open on purpose.
  function drawOpen(c) {
    if (!View.flat() || !Ui.shown.open || !Ui.layer.rings.length) return;
    // A frame that has no size yet has no pixels.
    if (!base.width || !base.height) return;
    // The same as long as the view is: playing only moves the nozzle.
    const id = [Ui.layer.page, Ui.colour, View.x, View.y, View.scale, base.width, base.height].join();
    if (drawnOpen !== id) { sweepOpen(); drawnOpen = id; }
    c.drawImage(spare, 0, 0);
  }
  function sweepOpen() {
    if (spare.width !== base.width || spare.height !== base.height) { spare.width = base.width; spare.height = base.height; }
    const s = spare.getContext("2d", { willReadFrequently: true }), p = Ui.layer.path;
    inPixels(s); s.globalCompositeOperation = "source-over"; s.clearRect(0, 0, spare.width, spare.height);
    inMillimetres(s);
    s.beginPath(); rings(s, Ui.layer.rings);
    s.fillStyle = "#d51e1e"; s.fill("evenodd");
    const sparse = data.whats.indexOf("sparse"), hollow = data.is_hollow && !p.what.includes(data.whats.indexOf("solid"));
    if (hollow || (data.sparse_pitch_mm && p.what.includes(sparse))) {
      s.globalCompositeOperation = "destination-out";
      s.beginPath();
      if (hollow) { rings(s, Ui.layer.rings); s.fill("evenodd"); s.beginPath(); }
      for (let k = 0; k + 1 < p.count; k++) if (p.what[k] === sparse) { s.moveTo(p.x[k], p.y[k]); s.lineTo(p.x[k + 1], p.y[k + 1]); }
      s.lineWidth = 2.2 * (data.sparse_pitch_mm || 0); s.lineCap = "round"; s.stroke();
      // Along the outline there are walls: the narrowest bead's width is not left out there.
      s.globalCompositeOperation = "source-over";
      s.save(); s.beginPath(); rings(s, Ui.layer.rings); s.clip("evenodd");
      s.lineWidth = 4 * NARROW; s.lineCap = "butt"; s.strokeStyle = "#d51e1e"; s.stroke();
      s.restore();
    }
    s.globalCompositeOperation = "destination-out";
    s.lineWidth = SLACK_MM;
    for (const chunk of chunks(Ui.layer, Ui.colour)) {
      if (!inView(chunk)) continue;
      s.fill(chunk.path);
      if (View.scale > CLOSE) s.stroke(chunk.path);
    }
    inPixels(s);
    // Where two beads share a pixel's edge nothing is open.
    const image = s.getImageData(0, 0, spare.width, spare.height), all = new Uint32Array(image.data.buffer);
    for (let i = 0; i < all.length; i++) all[i] = all[i] >>> 24 > 140 ? 0xff1e1ed5 : 0;
    s.putImageData(image, 0, 0);
  }
  const images = new Map();
  // Ground that was laid twice, of layers whose cells are known.
  function groundImage(l, number) {
    const id = `${l.page} ${number}`;
    if (!images.has(id)) {
      const g = l.ground[number], ends = Job.steps(g.twice), canvas = document.createElement("canvas");
      canvas.width = g.columns; canvas.height = g.rows;
      const context = canvas.getContext("2d"), image = context.createImageData(g.columns, g.rows), all = new Uint32Array(image.data.buffer);
      for (let i = 0; i < ends.length; i += 2) all.fill(0xff009fe6, ends[i], ends[i + 1]);
      context.putImageData(image, 0, 0);
      images.set(id, canvas);
    }
    return images.get(id);
  }
  function drawTwice(c) {
    if (!View.flat() || !Ui.shown.twice) return;
    Ui.layer.ground.forEach((g, number) => {
      c.save();
      inMillimetres(c); c.transform(...g.matrix);
      c.imageSmoothingEnabled = g.cell_mm * View.scale < 1;
      c.drawImage(groundImage(Ui.layer, number), g.origin[0], g.origin[1], g.columns * g.cell_mm, g.rows * g.cell_mm);
      c.restore();
    });
  }
  function rings(c, all) {
    for (const ring of all) {
      for (let i = 0; i < ring.length; i += 2) i ? c.lineTo(ring[i], ring[i + 1]) : c.moveTo(ring[i], ring[i + 1]);
      c.closePath();
    }
  }
  function lines(c, all, ink, width, closed) {
    c.beginPath();
    for (const points of all) {
      for (let i = 0; i < points.length; i += 2) { const [x, y] = View.px(points[i], points[i + 1], View.middle[2]); i ? c.lineTo(x, y) : c.moveTo(x, y); }
      if (closed) c.closePath();
    }
    c.strokeStyle = ink; c.lineWidth = width * View.ratio(); c.stroke();
  }
  // The work area with a grid of centimetres, and the input's origin.
  function drawBed(c) {
    if (!Ui.shown.bed) return;
    const r = View.ratio(), z = data.bed_mm ? data.bed_mm[0][2] : 0, line = (a, b, ink, width) => {
      c.beginPath(); c.moveTo(...View.px(...a)); c.lineTo(...View.px(...b)); c.strokeStyle = ink; c.lineWidth = width * r; c.stroke();
    };
    if (data.bed_mm) {
      const [[x0, y0], [x1, y1]] = data.bed_mm, step = [10, 50, 100, 500].find((mm) => mm * View.scale > 12 * r) || 1000;
      for (let x = Math.ceil(x0 / step) * step; x <= x1; x += step) line([x, y0, z], [x, y1, z], "#e9edf2", 1);
      for (let y = Math.ceil(y0 / step) * step; y <= y1; y += step) line([x0, y, z], [x1, y, z], "#e9edf2", 1);
      lines(c, [[x0, y0, x1, y0, x1, y1, x0, y1]], "#a0aec0", 1.5, true);
    }
    drawOrigin(c);
  }
  // The input's origin, with its X and Y.
  function drawOrigin(c) {
    if (!Ui.shown.bed) return;
    const r = View.ratio(), z = data.bed_mm ? data.bed_mm[0][2] : 0, long = 24 * r / View.scale;
    const line = (a, b, ink, width) => { c.beginPath(); c.moveTo(...View.px(...a)); c.lineTo(...View.px(...b)); c.strokeStyle = ink; c.lineWidth = width * r; c.stroke(); };
    line([0, 0, z], [long, 0, z], "#c53030", 2); line([0, 0, z], [0, long, z], "#2f855a", 2);
    const [x, y] = View.px(0, 0, z);
    c.fillStyle = "#4a5568"; c.font = `${11 * r}px system-ui,sans-serif`; c.fillText("0, 0", x - 30 * r, y + 13 * r);
  }
  // Segments up to the cursor: those beyond it are faint while it plays, or not there.
  function parts(p) {
    const cut = !Ui.shown.future || Ui.playing, end = cut ? Job.poseAt(Ui.layer, Ui.time).k + 1 : p.count;
    return { end, faint: Ui.shown.future && cut };
  }
  function drawBeads(c) {
    const p = Ui.layer.path, { end, faint } = parts(p), all = chunks(Ui.layer, Ui.colour), lines = new Path2D();
    c.save(); inMillimetres(c);
    if (faint) { c.fillStyle = "#e2e8f0"; for (const chunk of all) if (chunk.end > end && inView(chunk)) c.fill(chunk.path); }
    // In their order, so that what is laid later lies on top.
    for (const chunk of all) {
      if (chunk.from >= end) break;
      if (!inView(chunk)) continue;
      c.fillStyle = Colours.css(Ui.colour, chunk.bin);
      let { path, line } = chunk;
      if (chunk.end > end) {
        path = new Path2D(); line = new Path2D(); line.moveTo(p.x[chunk.from], p.y[chunk.from]);
        const here = Job.poseAt(Ui.layer, Ui.time), last = end - 1, share = (Ui.time - p.t[last]) / ((p.t[end] - p.t[last]) || 1);
        for (let k = chunk.from; k < end; k++) { Sweep.segment(path, p, k, 0, k === last ? Math.min(Math.max(share, 0), 1) : 1); if (k < last) line.lineTo(p.x[k + 1], p.y[k + 1]); }
        line.lineTo(here.x, here.y);
      }
      c.fill(path);
      if (View.scale > CLOSE) { c.strokeStyle = c.fillStyle; c.lineWidth = SLACK_MM; c.stroke(path); }
      lines.addPath(line);
    }
    if (Ui.shown.centre) { c.strokeStyle = "#ffffffa0"; c.lineWidth = 0.8 * View.ratio() / View.scale; c.stroke(lines); }
    c.restore();
  }
  function drawLines(c, travels) {
    const p = Ui.layer.path, { end, faint } = parts(p), bin = Colours.binOf(Ui.layer, Ui.colour, [Ui.layer]), paths = new Map(), far = new Path2D(), way = new Path2D();
    let before = null, begun = -1;
    for (let k = 0; k < p.count; k++) {
      const here = View.px(p.x[k], p.y[k], p.z[k]), what = k ? p.what[k - 1] : Job.NONE;
      if (before && (travels ? what === Job.TRAVEL : Job.prints(what))) {
        // What a pixel cannot show is not drawn.
        if (Math.abs(here[0] - before[0]) + Math.abs(here[1] - before[1]) < 0.7 && p.what[k] === what && k !== end) continue;
        const path = travels ? (k > end && !Ui.shown.future ? null : way) : k <= end ? paths.get(bin(k - 1)) || paths.set(bin(k - 1), new Path2D()).get(bin(k - 1)) : faint ? far : null;
        if (path) { path.moveTo(...before); path.lineTo(...here); }
      }
      before = here; begun = k;
    }
    c.lineCap = c.lineJoin = "round";
    if (travels) { c.setLineDash([4 * View.ratio(), 4 * View.ratio()]); c.strokeStyle = "#9b2c2c"; c.lineWidth = View.ratio(); c.stroke(way); c.setLineDash([]); return; }
    c.lineWidth = 1.8 * View.ratio();
    c.strokeStyle = "#cbd5e0"; c.stroke(far);
    for (const [k, path] of paths) { c.strokeStyle = Colours.css(Ui.colour, k); c.stroke(path); }
  }
  function drawEnds(c) {
    const p = Ui.layer.path, r = 4 * View.ratio();
    let prints = false;
    for (let k = 0; k < p.count; k++) {
      // The end of a run is the beginning of the next.
      const now = Job.prints(p.what[k]) || (prints && p.what[k] === Job.NONE && Job.prints(p.what[k + 1] ?? Job.NONE));
      if (now === prints) continue;
      prints = now;
      const [x, y] = View.px(p.x[k], p.y[k], p.z[k]);
      c.beginPath();
      now ? c.arc(x, y, r, 0, 7) : c.rect(x - r, y - r, 2 * r, 2 * r);
      c.fillStyle = now ? "#009e73" : "#d55e00"; c.fill();
    }
  }
  function niceStep(v) {
    const p = Math.pow(10, Math.floor(Math.log10(v)));
    return [5, 2, 1].map((k) => k * p).find((k) => k <= v) || p;
  }
  function drawScale(c) {
    const r = View.ratio(), nice = niceStep(120 * r / View.scale);
    c.fillStyle = "#1a202c"; c.font = `${13 * r}px system-ui,sans-serif`;
    c.fillRect(12 * r, base.height - 14 * r, nice * View.scale, 3 * r);
    c.fillText(`${nice} mm`, 12 * r, base.height - 20 * r);
  }
  function draw() {
    const c = base.getContext("2d");
    c.fillStyle = "#fff"; c.fillRect(0, 0, base.width, base.height);
    if (!View.flat() && Stack.works) return;
    const { shown, layer } = Ui, flat = View.flat(), first = layer.like === data.layers[0].number;
    drawBed(c);
    if (data.keep_out.length) lines(c, data.keep_out, "#a0aec0", 3, true);
    if (flat && layer.rings.length) { c.save(); inMillimetres(c); c.beginPath(); rings(c, layer.rings); c.fillStyle = "#eef2f6"; c.fill("evenodd"); c.restore(); }
    if (shown.beads && flat) drawBeads(c); else drawLines(c, false);
    drawOpen(c);
    drawTwice(c);
    if (shown.axis && first) lines(c, data.axis, "#718096", 1, false);
    if (shown.travel) drawLines(c, true);
    if (shown.outline) { lines(c, layer.rings, "#1a202c", 1.2, true); if (first) lines(c, data.unreachable, "#d53f8c", 3, false); }
    if (shown.ends) drawEnds(c);
    drawScale(c);
  }
  return { draw, drawOrigin, drawScale, niceStep, drawEnds };
})();
