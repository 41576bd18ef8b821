"use strict";
// Curves over time below the drawing: speed, joints, heading, flow, with what the head does behind them.
const Plots = (() => {
  const { data } = Job, { ratio } = View, number = Panel.number;
  const panels = [
    { title: "Tip speed, mm/s", curves: () => [{ name: "", value: Ui.layer.speed }] },
    { title: "Joint speeds, % of each limit", curves: () => Ui.layer.joints, limit: 100 },
    { title: "Heading with whole turns, °", curves: () => [{ name: "", value: Ui.layer.heading }] },
    { last: true, title: "Flow, mm³/s", curves: () => [{ name: "", value: Ui.layer.flow }], limit: data.flow_limit_mm3_s },
  ];
  let span = [0, 1];
  panels.forEach((panel) => {
    const box = document.createElement("div");
    box.className = panel.last ? "plot last" : "plot";
    panel.base = document.createElement("canvas"); panel.over = document.createElement("canvas");
    panel.base.setAttribute("role", "img"); panel.base.setAttribute("aria-label", panel.title);
    panel.over.setAttribute("aria-hidden", "true");
    box.append(panel.base, panel.over);
    $("panels").append(box);
    let from = null;
    panel.over.addEventListener("pointerdown", (e) => { from = { x: e.clientX, span: [...span], moved: false }; panel.over.setPointerCapture(e.pointerId); });
    panel.over.addEventListener("pointermove", (e) => {
      if (!from) return;
      const by = (from.x - e.clientX) / panel.over.clientWidth * (from.span[1] - from.span[0]);
      if (Math.abs(e.clientX - from.x) > 3) from.moved = true;
      if (from.moved) setSpan(from.span[0] + by, from.span[1] + by);
    });
    panel.over.addEventListener("pointerup", (e) => {
      if (from && !from.moved) Page.go(span[0] + (e.clientX - panel.over.getBoundingClientRect().left) / panel.over.clientWidth * (span[1] - span[0]));
      from = null;
    });
    panel.over.addEventListener("wheel", (e) => {
      // The page scrolls over the plots; only with a key held down the wheel is theirs.
      if (!e.ctrlKey && !e.shiftKey) return;
      e.preventDefault();
      const middle = span[0] + (e.clientX - panel.over.getBoundingClientRect().left) / panel.over.clientWidth * (span[1] - span[0]);
      const factor = Math.exp((e.deltaY || e.deltaX) * 0.002);
      setSpan(middle + (span[0] - middle) * factor, middle + (span[1] - middle) * factor);
    }, { passive: false });
  });
  function setSpan(from, to) {
    const length = Math.min(Math.max(to - from, 20), Ui.layer.count - 1);
    const start = Math.min(Math.max(from, 0), Ui.layer.count - 1 - length);
    span = [start, start + length];
    draw();
  }
  function drawPlot(panel) {
    const { base: canvas } = panel;
    for (const each of [canvas, panel.over]) { each.width = Math.round(each.clientWidth * ratio()); each.height = Math.round(each.clientHeight * ratio()); }
    const c = canvas.getContext("2d"), w = canvas.width, h = canvas.height;
    const curves = panel.curves();
    let low = Infinity, high = -Infinity;
    for (const curve of curves) for (let i = Math.floor(span[0]); i <= span[1]; i++) { if (curve.value[i] < low) low = curve.value[i]; if (curve.value[i] > high) high = curve.value[i]; }
    const between = `${number(low)} to ${number(high)}`;
    // Room for the line of the limit.
    if (panel.limit && high > 0.6 * panel.limit) high = Math.max(high, 1.05 * panel.limit);
    if (!(high > low)) { high = low + 1; }
    const top = 24 * ratio(), foot = panel.last ? h - 20 * ratio() : h, r = ratio();
    const y = (v) => foot - 5 * r - (v - low) / (high - low) * (foot - top - 10 * r);
    c.fillStyle = "#fff"; c.fillRect(0, 0, w, h);
    // What the head does, behind the curves.
    const inkOf = (what) => Job.prints(what) ? "#ebf8ff" : ["#fff", "#c6f6d5", "#fed7d7", "#edf2f7"][what - Job.TRAVEL] || "#fff";
    const does = (i) => { const what = Ui.layer.what[i]; return Job.prints(what) ? 0 : what; };
    let begun = Math.floor(span[0]);
    for (let i = begun + 1; i <= Math.floor(span[1]) + 1; i++) if (does(i) !== does(begun) || i > span[1]) {
      c.fillStyle = inkOf(Ui.layer.what[begun]);
      const x0 = (begun - span[0]) / (span[1] - span[0]) * w, x1 = (i - span[0]) / (span[1] - span[0]) * w;
      c.fillRect(x0, top, x1 - x0, foot - top);
      begun = i;
    }
    const seconds = (i) => Ui.start + i * Ui.layer.every, long = (span[1] - span[0]) * Ui.layer.every;
    const tick = Flat.niceStep(long / Math.max(2, w / r / 110)), digits = Math.max(0, -Math.floor(Math.log10(tick)));
    c.font = `${11 * r}px system-ui,sans-serif`; c.fillStyle = "#4a5568";
    for (let t = Math.ceil(seconds(span[0]) / tick) * tick; t <= seconds(span[1]); t += tick) {
      const x = (t - seconds(span[0])) / long * w, words = `${t.toFixed(digits)} s`;
      c.globalAlpha = 0.12; c.fillRect(x, top, r, foot - top); c.globalAlpha = 1;
      const room = c.measureText(words).width;
      if (panel.last && x - room / 2 > 0 && x + room / 2 < w) c.fillText(words, x - room / 2, h - 6 * r);
    }
    if (panel.limit && panel.limit <= high) {
      c.setLineDash([5, 4]); c.strokeStyle = "#9b2c2c"; c.beginPath(); c.moveTo(0, y(panel.limit)); c.lineTo(w, y(panel.limit)); c.stroke(); c.setLineDash([]);
    }
    curves.forEach((curve, k) => {
      c.strokeStyle = Panel.INKS[k % Panel.INKS.length]; c.lineWidth = 1.2 * ratio(); c.globalAlpha = curves.length > 1 ? 0.8 : 1;
      c.beginPath();
      const each = (span[1] - span[0]) / w;
      for (let x = 0; x < w; x++) {
        const from = Math.floor(span[0] + x * each), to = Math.max(from + 1, Math.floor(span[0] + (x + 1) * each));
        let least = Infinity, most = -Infinity;
        for (let i = from; i < to && i < Ui.layer.count; i++) { if (curve.value[i] < least) least = curve.value[i]; if (curve.value[i] > most) most = curve.value[i]; }
        if (least > most) continue;
        x ? c.lineTo(x, y(least)) : c.moveTo(x, y(least));
        if (most !== least) c.lineTo(x, y(most));
      }
      c.stroke(); c.globalAlpha = 1;
    });
    c.fillStyle = "#1a202c"; c.font = `600 ${12.5 * r}px system-ui,sans-serif`;
    c.fillText(panel.title, 8 * r, 16 * r);
    const right = c.measureText(panel.title).width + 20 * r;
    c.font = `${12 * r}px system-ui,sans-serif`; c.fillStyle = "#4a5568";
    c.fillText(between, right, 16 * r);
    const named = curves.map((curve, k) => [curve.name, Panel.INKS[k % Panel.INKS.length]]).filter(([name]) => name);
    let left = w - named.reduce((sum, [name]) => sum + c.measureText(name).width + 24 * r, 4 * r);
    if (left > right + c.measureText(between).width) for (const [name, ink] of named) {
      c.fillStyle = ink; c.fillRect(left, 11 * r, 12 * r, 3 * r);
      c.fillStyle = "#1a202c"; c.fillText(name, left + 15 * r, 16 * r);
      left += c.measureText(name).width + 24 * r;
    }
  }
  function drawCursor() {
    for (const panel of panels) {
      const c = panel.over.getContext("2d"), x = (Ui.at - span[0]) / (span[1] - span[0]) * panel.over.width;
      c.clearRect(0, 0, panel.over.width, panel.over.height);
      c.fillStyle = "#1a202c"; c.fillRect(x - ratio() / 2, 24 * ratio(), 1.5 * ratio(), panel.over.height);
    }
  }
  function draw() { panels.forEach(drawPlot); drawCursor(); }
  // Holds the cursor in what is shown.
  function follow() { if (Ui.at < span[0] || Ui.at > span[1]) setSpan(Ui.at - (span[1] - span[0]) / 2, Ui.at + (span[1] - span[0]) / 2); }
  const whole = () => setSpan(0, Ui.layer.count - 1);
  function widen(factor) {
    const middle = Ui.at >= span[0] && Ui.at <= span[1] ? Ui.at : (span[0] + span[1]) / 2;
    setSpan(middle + (span[0] - middle) * factor, middle + (span[1] - middle) * factor);
  }
  const near = () => setSpan(Ui.at - 1 / Ui.layer.every, Ui.at + 1 / Ui.layer.every);
  return { draw, drawCursor, follow, whole, widen, near };
})();
