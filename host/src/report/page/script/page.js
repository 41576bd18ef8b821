"use strict";
// The report's page: what its buttons, sliders, keys and pointers do. No network, no storage.
const Page = (() => {
  const { data } = Job;
  if (!data.layers.length) return {};
  const { base, over, ratio } = View, stack = Job.stack.length ? Job.stack : [{ page: 0, seconds: data.duration_s, number: 0 }];
  const starts = stack.map(() => 0);
  stack.forEach((entry, k) => { if (k) starts[k] = starts[k - 1] + stack[k - 1].seconds; });
  let current = 0, pending = 0;

  // ---- drawing ----
  function moment() { View.moveMachine(); Panel.drawOver(); Panel.now(); Plots.drawCursor(); }
  function draw() {
    const flat = View.flat(), inSpace = !flat && Stack.works;
    for (const name of ["axis", "open", "twice", "outline", "ends", "centre"]) document.querySelector(`[data-show=${name}]`).disabled = inSpace || (!flat && name !== "outline" && name !== "ends");
    document.querySelector("[data-show=beads]").disabled = !flat && !Stack.works;
    document.querySelector("[data-show=turning]").disabled = !View.machineShown();
    $("lowest").hidden = !inSpace || stack.length < 2; $("nowebgl").hidden = flat || inSpace;
    View.resize(); View.moveMachine(); Flat.draw(); Stack.draw(); moment();
  }
  // Pointers report more often than the screen shows.
  function drawSoon() { pending ||= requestAnimationFrame(() => { pending = 0; draw(); }); }
  function go(i) {
    Ui.at = Math.min(Math.max(i, 0), Ui.layer.count - 1);
    Plots.follow();
    View.moveMachine();
    if (Ui.playing || !Ui.shown.future || View.onGround) { Flat.draw(); Stack.draw(); }
    moment();
  }
  function choose(k, keepView) {
    const entry = stack[k];
    current = k;
    Ui.layer = Job.layer(entry.page); Ui.number = entry.number; Ui.start = starts[k]; Ui.at = 0;
    const { label } = Ui.layer;
    $("layer").value = k; $("which").textContent = label; $("layer").setAttribute("aria-valuetext", label);
    if (Number($("low").value) > k) lowest(k);
    $("time").max = Ui.layer.count - 1;
    $("thinned").textContent = Ui.layer.every * data.servo_hz > 1.5 ? `Speeds are those at every ${Panel.number(1000 * Ui.layer.every)} ms.` : "";
    View.resize();
    if (!keepView) View.fit();
    Panel.legend(); draw(); Plots.whole();
  }
  function lowest(k) { $("low").value = k; Ui.lowest = stack[k].number; $("low").setAttribute("aria-valuetext", `layer ${Ui.lowest + 1}`); }

  // ---- view ----
  function zoomAt(factor, cx, cy) {
    const u = View.x + (cx - base.width / 2) / View.scale, v = View.y - (cy - base.height / 2) / View.scale;
    View.scale = Math.min(Math.max(View.scale * factor, 1e-3), 1e5);
    View.x = u - (cx - base.width / 2) / View.scale; View.y = v + (cy - base.height / 2) / View.scale;
    draw();
  }
  const zoom = (factor) => zoomAt(factor, base.width / 2, base.height / 2);
  function whole() { View.turn = { ...View.LOOK }; View.fit(); draw(); }
  // All layers are shown when space is entered.
  function inSpace() {
    if (!View.flat() && Stack.works && current + 1 < stack.length) return choose(stack.length - 1);
    View.fit(); Panel.legend(); draw();
  }
  // The moment of the layer's path that is nearest on the screen or, for `show`, on the bed.
  function nearest(distance) {
    const p = Ui.layer.path;
    let best = -1, least = Infinity, share = 0;
    for (let k = 0; k + 1 < p.count; k++) {
      if (!Job.prints(p.what[k])) continue;
      const [d, along] = distance(p, k);
      if (d < least) { least = d; best = k; share = along; }
    }
    return [best < 0 ? 0 : (p.t[best] + share * (p.t[best + 1] - p.t[best]) - Ui.layer.start) / Ui.layer.every, least];
  }
  function toSegment(x, y, [ax, ay], [bx, by]) {
    const dx = bx - ax, dy = by - ay, along = Math.min(Math.max(((x - ax) * dx + (y - ay) * dy) / (dx * dx + dy * dy || 1), 0), 1);
    return [(ax + along * dx - x) ** 2 + (ay + along * dy - y) ** 2, along];
  }
  function pick(x, y) {
    const px = (p, k) => View.px(p.x[k], p.y[k], p.z[k]);
    const [at, least] = nearest((p, k) => toSegment(x, y, px(p, k), px(p, k + 1)));
    if (least < (30 * ratio()) ** 2) go(at);
  }
  // A place of the lists: its layer, close by, the nozzle on it.
  function show(place) {
    $("three").checked = false;
    stop();
    const k = stack.findIndex((entry) => entry.number === place.layer);
    choose(k >= 0 ? k : current);
    View.x = place.x_mm; View.y = place.y_mm;
    View.scale = Math.min(base.width, base.height) / 4;
    go(nearest((p, k) => toSegment(place.x_mm, place.y_mm, [p.x[k], p.y[k]], [p.x[k + 1], p.y[k + 1]]))[0]);
    draw();
    over.focus({ preventScroll: true });
    $("stage").scrollIntoView({ block: "start" });
  }

  // ---- pointers ----
  const pointers = new Map();
  let moved = 0;
  over.addEventListener("pointerdown", (e) => { pointers.set(e.pointerId, [e.clientX, e.clientY]); moved = 0; over.setPointerCapture(e.pointerId); });
  over.addEventListener("pointermove", (e) => {
    const before = pointers.get(e.pointerId);
    if (!before) return;
    const now = [e.clientX, e.clientY], r = ratio(), dx = now[0] - before[0], dy = now[1] - before[1];
    moved += Math.abs(dx) + Math.abs(dy);
    if (pointers.size === 2) {
      const other = [...pointers].find(([id]) => id !== e.pointerId)[1];
      const length = (p) => Math.hypot(p[0] - other[0], p[1] - other[1]), box = over.getBoundingClientRect();
      pointers.set(e.pointerId, now);
      zoomAt(length(now) / (length(before) || 1), (other[0] - box.left) * r, (other[1] - box.top) * r);
      return;
    }
    pointers.set(e.pointerId, now);
    if (!View.flat() && !e.shiftKey) { View.turn.yaw += dx * 0.008; View.turn.pitch = Math.min(Math.max(View.turn.pitch + dy * 0.008, 0), Math.PI); }
    else { View.x -= dx * r / View.scale; View.y += dy * r / View.scale; }
    drawSoon();
  });
  const lift = (e) => {
    if (pointers.delete(e.pointerId) && moved < 5 && e.type === "pointerup") {
      const box = over.getBoundingClientRect();
      pick((e.clientX - box.left) * ratio(), (e.clientY - box.top) * ratio());
    }
  };
  over.addEventListener("pointerup", lift); over.addEventListener("pointercancel", lift);
  over.addEventListener("wheel", (e) => {
    e.preventDefault();
    const box = over.getBoundingClientRect();
    zoomAt(Math.exp(-e.deltaY * 0.002), (e.clientX - box.left) * ratio(), (e.clientY - box.top) * ratio());
  }, { passive: false });

  // ---- time ----
  const step = (by) => { stop(); go(Math.floor(Ui.at) + by); };
  let lastFrame = 0;
  function stop() { Ui.playing = false; $("play").textContent = "Play"; draw(); }
  function play() {
    if (Ui.playing) return stop();
    if (Ui.at >= Ui.layer.count - 1) Ui.at = 0;
    Ui.playing = true; $("play").textContent = "Pause"; lastFrame = 0;
    requestAnimationFrame(frame);
  }
  function frame(now) {
    if (!Ui.playing) return;
    const passed = lastFrame ? Math.min(now - lastFrame, 200) / 1000 : 0;
    lastFrame = now;
    go(Ui.at + passed * Number($("pace").value) / Ui.layer.every);
    if (Ui.at >= Ui.layer.count - 1) {
      if (current + 1 >= stack.length) return stop();
      choose(current + 1, true);
    }
    requestAnimationFrame(frame);
  }
  const turnTo = (k) => { if (k >= 0 && k < stack.length) { Ui.playing = false; $("play").textContent = "Play"; choose(k, true); } };

  // ---- begin ----
  function listen() {
    document.querySelectorAll("[data-show]").forEach((box) => {
      Ui.shown[box.dataset.show] = box.checked;
      box.addEventListener("change", () => {
        Ui.shown[box.dataset.show] = box.checked;
        // The machine is far larger than the part: the view goes there and back.
        if (box.dataset.show === "machine" || box.dataset.show === "turning") { if (Ui.shown.machine) $("three").checked = true; View.fit(); }
        draw();
      });
    });
    $("play").addEventListener("click", play);
    $("back").addEventListener("click", () => step(-1));
    $("ahead").addEventListener("click", () => step(1));
    // Stopping draws, and drawing sets the slider.
    $("time").addEventListener("input", () => { const to = Number($("time").value); stop(); go(to); });
    $("fit").addEventListener("click", whole);
    $("in").addEventListener("click", () => zoom(1.5));
    $("out").addEventListener("click", () => zoom(1 / 1.5));
    $("three").addEventListener("change", inSpace);
    $("colour").addEventListener("change", () => { Ui.colour = $("colour").value; Panel.legend(); draw(); });
    $("layer").addEventListener("input", () => turnTo(Number($("layer").value)));
    $("low").addEventListener("input", () => { lowest(Math.min(Number($("low").value), current)); draw(); });
    $("whole").addEventListener("click", Plots.whole);
    $("narrower").addEventListener("click", () => Plots.widen(0.5));
    $("wider").addEventListener("click", () => Plots.widen(2));
    $("near").addEventListener("click", Plots.near);
    document.addEventListener("keydown", (e) => {
      if (/^(INPUT|SELECT|BUTTON|SUMMARY|A)$/.test(e.target.tagName)) return;
      const tenth = Math.max(1, Math.round(0.1 / Ui.layer.every)), by = e.shiftKey ? tenth : 1;
      const act = { " ": play, ArrowLeft: () => step(-by), ArrowRight: () => step(by), "+": () => zoom(1.5), "=": () => zoom(1.5), "-": () => zoom(1 / 1.5), 0: whole,
        PageUp: () => turnTo(current + 1), PageDown: () => turnTo(current - 1) }[e.key];
      if (act) { e.preventDefault(); act(); }
    });
    // Where a print is, from the bar of a served page.
    document.addEventListener("print-at", (e) => {
      const { layer, time_s } = e.detail, k = stack.findIndex((entry) => entry.number === layer);
      if (Ui.playing || k < 0) return;
      if (current !== k) choose(k);
      go((time_s - Ui.layer.start) / Ui.layer.every);
    });
    new ResizeObserver(() => { if (View.resize()) { View.fit(); draw(); } Plots.draw(); }).observe(over.parentElement);
  }
  function begin() {
    Panel.rows("slow", data.slow_places, "None are known.");
    Panel.rows("left", data.left_out, "No single place is known.");
    for (const [key, mode] of Object.entries(Colours.modes)) $("colour").add(new Option(mode.name, key));
    $("layer").max = $("low").max = stack.length - 1;
    $("layers").hidden = stack.length < 2;
    ["stage", "plots", "places"].forEach((id) => { $(id).hidden = false; });
    const first = Job.layer(stack[0].page), tilts = Boolean(first.path.axis);
    $("axes").hidden = !tilts; $("machine").hidden = !data.machine;
    $("turning").hidden = !data.machine || !View.carriesPart();
    // What the report does not have cannot be switched.
    const outlined = data.outlines.length > 0, absent = { outline: !outlined, axis: !data.axis.length, open: !outlined, twice: !data.layers.some((l) => l.ground.length) };
    for (const name in absent) document.querySelector(`[data-show=${name}]`).parentElement.hidden = absent[name];
    // Kinds of bead say most of a part that has several.
    const kinds = new Set(data.layers.flatMap(({ path }) => path.runs.filter((_, k) => k % 2 === 0)).filter((what) => Job.prints(what)));
    Ui.colour = $("colour").value = kinds.size > 1 ? "what" : "speed";
    $("three").checked = tilts;
    listen();
    Ui.lowest = stack[0].number;
    choose(tilts ? stack.length - 1 : 0);
  }
  return { begin, go, show };
})();
Page.begin?.();
