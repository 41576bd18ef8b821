"use strict";
// The report's page: draws what the JSON block of this page holds. No network, no storage.
(() => {
  const data = JSON.parse(document.getElementById("data").textContent);
  const $ = (id) => document.getElementById(id);
  if (!data.layers.length) return;

  // ---- data: numbers of 16 bits over a range, in base64 ----
  const bytes = (text) => Uint8Array.from(atob(text), (c) => c.charCodeAt(0));
  function values(channel) {
    const raw = bytes(channel.b64);
    const view = new DataView(raw.buffer);
    const step = (channel.max - channel.min) / 65535;
    const out = new Float32Array(raw.length / 2);
    for (let i = 0; i < out.length; i++) out[i] = channel.min + step * view.getUint16(2 * i, true);
    return out;
  }
  const STATES = ["print", "travel", "prime", "retract", "hold"];
  const PRINT = 0;
  const opened = new Map();
  function layerOf(number) {
    if (!opened.has(number)) opened.set(number, open(data.layers[number]));
    return opened.get(number);
  }
  function open(source) {
    const l = { label: source.label, bare: source.bare, start: source.start_s, every: source.every_s, ground: source.ground };
    for (const name of ["x", "y", "z", "heading", "speed", "flow"]) l[name] = values(source[name]);
    if (source.nx) for (const name of ["nx", "ny", "nz"]) l[name] = values(source[name]);
    l.joints = source.joints.map((joint) => ({ name: joint.name, value: values(joint) }));
    l.jointsAt = source.joints_at.map(values); l.jointsEvery = source.joints_every;
    l.state = bytes(source.state);
    l.limit = bytes(source.limit);
    l.count = l.x.length;
    // The limits that bind most get colours of their own; nothing has the last one, grey.
    const often = new Array(256).fill(0);
    l.limit.forEach((k) => often[k]++);
    l.ink = new Uint8Array(256).fill(NAMED.length - 2);
    often.map((n, k) => [n, k]).filter(([n, k]) => n && k !== 255).sort((a, b) => b[0] - a[0])
      .slice(0, NAMED.length - 1).forEach(([, k], rank) => { l.ink[k] = rank; });
    l.ink[255] = NAMED.length - 1;
    l.width = new Float32Array(l.count);
    l.cost = new Float32Array(l.count);
    for (let i = 0; i < l.count; i++) {
      const [dx, dy] = direction(l, i), moved = Math.hypot(dx, dy);
      l.width[i] = moved > 0 ? extent(l.heading[i], -dy / moved, dx / moved) : i ? l.width[i - 1] : 0;
      l.cost[i] = 1 / Math.max(l.speed[i] * l.width[i], 0.05);
    }
    return l;
  }
  // The chord about a sample, long enough that the rounding of places does not turn it, mm.
  function direction(l, i) {
    let a = i, b = i;
    for (let tries = 0; tries < 60; tries++) {
      if (Math.hypot(l.x[b] - l.x[a], l.y[b] - l.y[a]) > 0.12) break;
      if (a > 0 && l.state[a - 1] === l.state[i]) a--;
      if (b + 1 < l.count && l.state[b + 1] === l.state[i]) b++;
    }
    return [l.x[b] - l.x[a], l.y[b] - l.y[a]];
  }
  // Width of the nozzle across a unit normal, mm.
  function extent(degrees, nx, ny) {
    const a = degrees * Math.PI / 180, c = Math.cos(a), s = Math.sin(a);
    const u = nx * c + ny * s, v = -nx * s + ny * c;
    let least = Infinity, most = -Infinity;
    for (const [x, y] of data.nozzle) {
      const d = x * u + y * v;
      if (d < least) least = d;
      if (d > most) most = d;
    }
    return most - least;
  }

  // ---- colours ----
  const VIRIDIS = [[68, 1, 84], [70, 50, 127], [54, 92, 141], [39, 127, 142], [31, 161, 135], [74, 194, 109], [159, 218, 58], [253, 231, 37]];
  const ROUND = [[226, 217, 226], [112, 140, 190], [85, 51, 140], [47, 20, 54], [140, 40, 80], [190, 120, 100], [226, 217, 226]];
  const NAMED = ["#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00", "#56b4e9", "#8a6d00", "#000000", "#7f3c8d", "#6b7280"];
  const BINS = 24;
  function ramp(stops, t) {
    const at = Math.min(Math.max(t, 0), 1) * (stops.length - 1), k = Math.min(Math.floor(at), stops.length - 2);
    const part = stops[k].map((v, i) => Math.round(v + (at - k) * (stops[k + 1][i] - v)));
    return `rgb(${part.join()})`;
  }
  const modes = {
    speed: { name: "speed", unit: "mm/s", of: (l, i) => l.speed[i] },
    width: { name: "bead width", unit: "mm", of: (l, i) => l.width[i] },
    heading: { name: "heading", unit: "°", turn: data.period_deg, of: (l, i) => l.heading[i] },
    flow: { name: "flow", unit: "mm³/s", of: (l, i) => l.flow[i] },
    cost: { name: "time for each mm²", unit: "s", of: (l, i) => l.cost[i], most: 0.98 },
    order: { name: "order", unit: "s", of: (l, i) => l.start + i * l.every },
    limit: { name: "what limits it", of: (l, i) => l.limit[i] },
  };
  const mod = (v, period) => ((v % period) + period) % period;
  const rangeOf = new Map();
  function range(l, key) {
    const mode = modes[key];
    if (mode.turn) return [0, mode.turn];
    const id = l.label + key;
    if (!rangeOf.has(id)) {
      let found = [];
      for (let i = 0; i < l.count; i++) if (l.state[i] === PRINT) found.push(mode.of(l, i));
      found = Float32Array.from(found).sort();
      const last = Math.floor((found.length - 1) * (mode.most || 1));
      rangeOf.set(id, found.length ? [found[0], found[last]] : [0, 1]);
    }
    return rangeOf.get(id);
  }
  function binOf(l, key) {
    if (key === "limit") return (i) => l.ink[l.limit[i]];
    const [low, high] = range(l, key), mode = modes[key];
    const scale = (BINS - 1) / ((high - low) || 1);
    return (i) => {
      const v = mode.turn ? mod(mode.of(l, i), mode.turn) : mode.of(l, i);
      return Math.min(BINS - 1, Math.max(0, Math.round((v - low) * scale)));
    };
  }
  const colourOf = (key) => key === "limit" ? (bin) => NAMED[bin]
    : (bin) => ramp(modes[key].turn ? ROUND : VIRIDIS, bin / (BINS - 1));

  // ---- view ----
  const base = $("base"), over = $("over");
  const shown = {};
  document.querySelectorAll("[data-show]").forEach((box) => {
    shown[box.dataset.show] = box.checked;
    box.addEventListener("change", () => {
      shown[box.dataset.show] = box.checked;
      // The machine is far larger than the part: the view goes there and back.
      if (box.dataset.show === "machine" || box.dataset.show === "turning") { if (shown.machine) $("three").checked = true; fit(); }
      draw();
    });
  });
  let layer = layerOf(0), at = 0, playing = false, colour = "speed";
  const LOOK = { yaw: -0.6, pitch: 1.0 };
  let view = { x: 0, y: 0, scale: 10 }, turn = { ...LOOK }, middle = [0, 0, 0];
  const ratio = () => Math.min(window.devicePixelRatio || 1, 2);
  const flat = () => !$("three").checked;
  // The machine at the cursor: frames of its links, and how the part lies when the ground is at rest.
  let linkFrames = [], fixed = null, onGround = null;
  const machineShown = () => shown.machine && data.machine && !flat();
  function moveMachine() {
    linkFrames = machineShown() ? Links.frames(data.machine.links, Links.joints(layer.jointsAt, layer.jointsEvery, at)) : [];
    const part = linkFrames[data.machine?.part];
    // Either the part keeps still and the ground moves about it, or the other way round.
    onGround = part && shown.turning ? part : null;
    fixed = part && !shown.turning ? Links.inverse(part) : null;
  }
  function project(x, y, z) {
    if (flat()) return [x, y];
    return slanted(onGround ? Links.placed(onGround, [x, y, z]) : [x, y, z]);
  }
  // Seen from the side, by coordinates that keep still.
  function slanted([x, y, z]) {
    const cx = x - middle[0], cy = y - middle[1], cz = z - middle[2];
    const c = Math.cos(turn.yaw), s = Math.sin(turn.yaw);
    const u = cx * c - cy * s, v = cx * s + cy * c;
    return [u + middle[0], v * Math.cos(turn.pitch) + cz * Math.sin(turn.pitch) + middle[1]];
  }
  const onScreen = ([u, v]) => [(u - view.x) * view.scale + base.width / 2, base.height / 2 - (v - view.y) * view.scale];
  const px = (x, y, z) => onScreen(project(x, y, z));
  // Every solid of the machine: corners as they keep still, and the joint that moves it.
  function solids() {
    const out = [], moves = [];
    data.machine.links.forEach((link, number) => {
      moves.push(link.joint ? link.joint.number : moves[link.parent] ?? -1);
      const frame = fixed ? Links.times(fixed, linkFrames[number]) : linkFrames[number];
      for (const solid of link.solids) out.push({ joint: moves[number], corners: solid.map((corner) => Links.placed(frame, corner)) });
    });
    return out;
  }
  function fit() {
    moveMachine();
    let x0 = Infinity, x1 = -Infinity, y0 = Infinity, y1 = -Infinity;
    const add = (x, y) => { x0 = Math.min(x0, x); x1 = Math.max(x1, x); y0 = Math.min(y0, y); y1 = Math.max(y1, y); };
    const z = [Infinity, -Infinity];
    const plane = [[Infinity, -Infinity], [Infinity, -Infinity]];
    for (let i = 0; i < layer.count; i++) if (layer.state[i] === PRINT) {
      [layer.x[i], layer.y[i]].forEach((v, k) => { plane[k] = [Math.min(plane[k][0], v), Math.max(plane[k][1], v)]; });
      z[0] = Math.min(z[0], layer.z[i]); z[1] = Math.max(z[1], layer.z[i]);
    }
    if (z[0] <= z[1]) middle = [(plane[0][0] + plane[0][1]) / 2, (plane[1][0] + plane[1][1]) / 2, (z[0] + z[1]) / 2];
    for (let i = 0; i < layer.count; i++) if (layer.state[i] === PRINT) add(...project(layer.x[i], layer.y[i], layer.z[i]));
    if (!layer.bare) for (const ring of data.outline) for (let i = 0; i < ring.length; i += 2) add(...project(ring[i], ring[i + 1], middle[2]));
    if (machineShown()) for (const { corners } of solids()) for (const corner of corners) add(...slanted(corner));
    if (x0 > x1) { x0 = y0 = 0; x1 = y1 = 10; }
    const room = 0.94;
    view = { x: (x0 + x1) / 2, y: (y0 + y1) / 2, scale: room * Math.min(base.width / (x1 - x0 || 1), base.height / (y1 - y0 || 1)) };
  }
  function resize() {
    let changed = false;
    for (const canvas of [base, over]) {
      const w = Math.round(canvas.clientWidth * ratio()), h = Math.round(canvas.clientHeight * ratio());
      if (canvas.width !== w || canvas.height !== h) { canvas.width = w; canvas.height = h; changed = true; }
    }
    return changed;
  }

  // True if a joint moves what the part lies on.
  function carriesPart() {
    const { links, part } = data.machine;
    for (let k = part; k > 0; k = links[k].parent) if (links[k].joint) return true;
    return false;
  }

  // ---- the layer ----
  const images = new Map();
  function groundImage(l, number) {
    const id = l.label + number + shown.open + shown.twice;
    if (!images.has(id)) {
      const g = l.ground[number], runs = bytes(g.rle);
      const canvas = document.createElement("canvas");
      canvas.width = g.columns; canvas.height = g.rows;
      const context = canvas.getContext("2d"), image = context.createImageData(g.columns, g.rows);
      const inks = { 1: [144, 205, 244, 90], 2: [160, 174, 192, 255], 3: [230, 159, 0, 255], 4: [213, 30, 30, 255], 5: [204, 40, 140, 255] };
      let cell = 0;
      for (let i = 0; i < runs.length; i += 3) {
        const ink = inks[runs[i]], length = runs[i + 1] | (runs[i + 2] << 8);
        const hidden = (runs[i] === 4 || runs[i] === 2) ? !shown.open : runs[i] === 3 ? !shown.twice : runs[i] === 1;
        for (let k = 0; k < length; k++, cell++) if (ink && !hidden) image.data.set(ink, 4 * cell);
      }
      context.putImageData(image, 0, 0);
      images.set(id, canvas);
    }
    return images.get(id);
  }
  function drawGround(c) {
    if (!flat() || !(shown.open || shown.twice)) return;
    layer.ground.forEach((g, number) => {
      const image = groundImage(layer, number);
      c.save();
      c.translate(base.width / 2 - view.x * view.scale, base.height / 2 + view.y * view.scale);
      c.scale(view.scale, -view.scale);
      c.transform(...g.matrix);
      c.imageSmoothingEnabled = g.cell_mm * view.scale < 1;
      c.drawImage(image, g.origin[0], g.origin[1], g.columns * g.cell_mm, g.rows * g.cell_mm);
      c.restore();
    });
  }
  function polyline(c, points, closed) {
    for (let i = 0; i < points.length; i += 2) {
      const [x, y] = px(points[i], points[i + 1], middle[2]);
      i ? c.lineTo(x, y) : c.moveTo(x, y);
    }
    if (closed) c.closePath();
  }
  function lines(c, all, ink, width, closed) {
    c.beginPath();
    all.forEach((points) => polyline(c, points, closed));
    c.strokeStyle = ink; c.lineWidth = width * ratio(); c.stroke();
  }
  function drawPath(c) {
    const bin = binOf(layer, colour), ink = colourOf(colour);
    const count = colour === "limit" ? NAMED.length : BINS;
    const paths = Array.from({ length: count }, () => new Path2D());
    const faint = new Path2D(), travel = new Path2D(), marks = [];
    let last = null, begun = -1;
    for (let i = 0; i < layer.count; i++) {
      const state = layer.state[i];
      const prints = state === PRINT;
      if (prints !== (i > 0 && layer.state[i - 1] === PRINT)) marks.push([prints ? i : i - 1, prints]);
      if (!prints && state !== 1) { last = null; continue; }
      const here = px(layer.x[i], layer.y[i], layer.z[i]);
      if (last && layer.state[begun] === state) {
        // What a pixel cannot show is not drawn.
        if (Math.abs(here[0] - last[0]) + Math.abs(here[1] - last[1]) < 0.7 && i + 1 < layer.count && layer.state[i + 1] === state) continue;
        const path = !prints ? travel : i > at && !shown.future ? null : i > at && playing ? faint : paths[bin(i)];
        if (path && prints && shown.beads && flat()) bead(path, begun, i);
        else if (path) { path.moveTo(...last); path.lineTo(...here); }
      }
      last = here; begun = i;
    }
    c.lineCap = c.lineJoin = "round";
    if (shown.travel) { c.setLineDash([4 * ratio(), 4 * ratio()]); c.strokeStyle = "#9b2c2c"; c.lineWidth = ratio(); c.stroke(travel); c.setLineDash([]); }
    c.lineWidth = (shown.beads && flat() ? 0.6 : 1.8) * ratio();
    c.strokeStyle = "#cbd5e0"; c.stroke(faint);
    paths.forEach((path, k) => {
      c.strokeStyle = c.fillStyle = ink(k);
      if (shown.beads && flat()) { c.globalAlpha = 0.75; c.fill(path); c.globalAlpha = 1; } else c.stroke(path);
    });
    if (shown.ends) for (const [i, starts] of marks) {
      const [x, y] = px(layer.x[i], layer.y[i], layer.z[i]), r = 4 * ratio();
      c.beginPath();
      starts ? c.arc(x, y, r, 0, 7) : c.rect(x - r, y - r, 2 * r, 2 * r);
      c.fillStyle = starts ? "#009e73" : "#d55e00"; c.fill();
    }
  }
  function bead(path, from, to) {
    const dx = layer.x[to] - layer.x[from], dy = layer.y[to] - layer.y[from], d = Math.hypot(dx, dy) || 1;
    const side = (i, sign) => px(layer.x[i] - sign * dy / d * layer.width[i] / 2, layer.y[i] + sign * dx / d * layer.width[i] / 2, 0);
    path.moveTo(...side(from, 1)); path.lineTo(...side(to, 1)); path.lineTo(...side(to, -1)); path.lineTo(...side(from, -1)); path.closePath();
  }
  function drawAxes(c) {
    if (!layer.nx || flat() || !shown.axes) return;
    const every = Math.max(1, Math.floor(layer.count / 400)), length = 40 * ratio() / view.scale;
    c.beginPath();
    for (let i = 0; i < layer.count; i += every) if (layer.state[i] === PRINT) {
      c.moveTo(...px(layer.x[i], layer.y[i], layer.z[i]));
      c.lineTo(...px(layer.x[i] + length * layer.nx[i], layer.y[i] + length * layer.ny[i], layer.z[i] + length * layer.nz[i]));
    }
    c.strokeStyle = "#71809688"; c.lineWidth = ratio(); c.stroke();
  }
  function drawBase() {
    const c = base.getContext("2d");
    c.fillStyle = "#fff"; c.fillRect(0, 0, base.width, base.height);
    drawGround(c);
    if (data.keep_out.length) lines(c, data.keep_out, "#a0aec0", 3, true);
    if (shown.axis && !layer.bare) lines(c, data.axis, "#718096", 1, false);
    drawPath(c);
    drawAxes(c);
    if (shown.outline && !layer.bare) { lines(c, data.outline, "#1a202c", 1.2, true); lines(c, data.unreachable, "#d53f8c", 3, false); }
    const nice = niceStep(120 * ratio() / view.scale);
    c.fillStyle = "#1a202c"; c.font = `${13 * ratio()}px system-ui,sans-serif`;
    c.fillRect(12 * ratio(), base.height - 14 * ratio(), nice * view.scale, 3 * ratio());
    c.fillText(`${nice} mm`, 12 * ratio(), base.height - 20 * ratio());
  }
  function niceStep(v) {
    const p = Math.pow(10, Math.floor(Math.log10(v)));
    return [5, 2, 1].map((k) => k * p).find((k) => k <= v) || p;
  }
  // Links as outlines of their solids, the far ones first; in the colour that the plots give their joint.
  function drawMachine(c) {
    if (!machineShown()) return;
    const depth = ([x, y, z]) => ((x - middle[0]) * Math.sin(turn.yaw) + (y - middle[1]) * Math.cos(turn.yaw)) * Math.sin(turn.pitch) - (z - middle[2]) * Math.cos(turn.pitch);
    const mean = (corners) => corners.reduce((sum, corner) => sum + depth(corner), 0) / corners.length;
    const far = solids().map((solid) => [mean(solid.corners), solid]).sort((a, b) => b[0] - a[0]);
    c.lineJoin = "round";
    for (const [, { joint, corners }] of far) {
      c.beginPath();
      Links.hull(corners.map((corner) => onScreen(slanted(corner)))).forEach(([x, y], k) => { k ? c.lineTo(x, y) : c.moveTo(x, y); });
      c.closePath();
      const ink = joint < 0 ? "#718096" : INKS[joint % INKS.length];
      c.fillStyle = `${ink}30`; c.fill();
      c.strokeStyle = `${ink}b0`; c.lineWidth = ratio(); c.stroke();
    }
  }
  function drawOver() {
    const c = over.getContext("2d");
    c.clearRect(0, 0, over.width, over.height);
    drawMachine(c);
    const i = Math.floor(at), a = layer.heading[i] * Math.PI / 180, cos = Math.cos(a), sin = Math.sin(a);
    c.beginPath();
    data.nozzle.forEach(([u, v], k) => {
      const [x, y] = px(layer.x[i] + u * cos - v * sin, layer.y[i] + u * sin + v * cos, layer.z[i]);
      k ? c.lineTo(x, y) : c.moveTo(x, y);
    });
    c.closePath();
    c.fillStyle = layer.state[i] === PRINT ? "#d55e0088" : "#ffffffaa"; c.fill();
    c.strokeStyle = "#1a202c"; c.lineWidth = 1.5 * ratio(); c.stroke();
    const [x, y] = px(layer.x[i], layer.y[i], layer.z[i]);
    c.beginPath(); c.arc(x, y, 9 * ratio(), 0, 7); c.strokeStyle = "#1a202c88"; c.stroke();
    if (layer.nx) {
      const l = 60 * ratio() / view.scale;
      c.beginPath(); c.moveTo(x, y); c.lineTo(...px(layer.x[i] + l * layer.nx[i], layer.y[i] + l * layer.ny[i], layer.z[i] + l * layer.nz[i]));
      c.strokeStyle = "#000"; c.lineWidth = 2 * ratio(); c.stroke();
    }
  }
  const number = (v, digits = 3) => Number(v.toPrecision(digits)).toString();
  function drawNow() {
    const i = Math.floor(at), limit = layer.limit[i];
    const rows = [["Head", STATES[layer.state[i]]], ["Place", `${layer.x[i].toFixed(2)}, ${layer.y[i].toFixed(2)}, ${layer.z[i].toFixed(2)} mm`],
      ["Speed", `${number(layer.speed[i])} mm/s`], ["Bead", layer.state[i] === PRINT ? `${layer.width[i].toFixed(2)} mm` : "none"],
      ["Heading", `${layer.heading[i].toFixed(1)}°`], ["Flow", `${number(layer.flow[i])} mm³/s`],
      ["Limited by", limit === 255 ? "nothing" : data.limits[limit]]];
    if (machineShown()) Links.joints(layer.jointsAt, layer.jointsEvery, at).forEach((position, k) => {
      const slides = data.machine.links.some(({ joint }) => joint && joint.number === k && joint.slides);
      rows.push([layer.joints[k].name, slides ? `${position.toFixed(2)} mm` : `${(position * 180 / Math.PI).toFixed(1)}°`]);
    });
    $("now").replaceChildren(...rows.flatMap(([what, value]) => {
      const dt = document.createElement("dt"), dd = document.createElement("dd");
      dt.textContent = what; dd.textContent = value;
      return [dt, dd];
    }));
    $("clock").textContent = `${(layer.start + at * layer.every).toFixed(2)} of ${(layer.start + (layer.count - 1) * layer.every).toFixed(2)} s`;
    $("time").value = Math.floor(at);
  }
  function drawLegend() {
    const box = $("legend"), mode = modes[colour], title = document.createElement("div");
    title.textContent = `Colour: ${mode.name}${mode.unit ? `, ${mode.unit}` : ""}`;
    if (colour === "limit") {
      const list = document.createElement("div");
      list.className = "legend";
      const used = new Set(layer.limit);
      [...data.limits.map((name, k) => [k, name]), [255, "nothing"]].filter(([k]) => used.has(k)).forEach(([k, name]) => {
        const item = document.createElement("span"), swatch = document.createElement("i");
        swatch.style.background = NAMED[layer.ink[k]];
        item.append(swatch, name);
        list.append(item);
      });
      box.replaceChildren(title, list);
      return;
    }
    const [low, high] = range(layer, colour), strip = document.createElement("div"), ends = document.createElement("div");
    strip.className = "ramp"; ends.className = "ends";
    const stops = Array.from({ length: 12 }, (_, k) => ramp(mode.turn ? ROUND : VIRIDIS, k / 11));
    strip.style.background = `linear-gradient(90deg,${stops.join()})`;
    ends.append(...[low, high].map((v, k) => Object.assign(document.createElement("span"), { textContent: number(v) + (k && mode.most ? " and more" : "") })));
    box.replaceChildren(title, strip, ends);
  }

  // ---- plots ----
  const INKS = ["#0072b2", "#d55e00", "#009e73", "#cc79a7", "#8a6d00", "#56b4e9", "#000000"];
  const panels = [
    { title: "Tip speed, mm/s", curves: () => [{ name: "", value: layer.speed }] },
    { title: "Joint speeds, % of each limit", curves: () => layer.joints, limit: 100 },
    { title: "Heading, °", curves: () => [{ name: "", value: layer.heading }] },
    { last: true, title: "Flow, mm³/s", curves: () => [{ name: "", value: layer.flow }], limit: data.flow_limit_mm3_s },
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
      if (from && !from.moved) go(span[0] + (e.clientX - panel.over.getBoundingClientRect().left) / panel.over.clientWidth * (span[1] - span[0]));
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
    const length = Math.min(Math.max(to - from, 20), layer.count - 1);
    const start = Math.min(Math.max(from, 0), layer.count - 1 - length);
    span = [start, start + length];
    drawPlots();
  }
  function drawPlot(panel) {
    const { base: canvas } = panel;
    for (const each of [canvas, panel.over]) { each.width = Math.round(each.clientWidth * ratio()); each.height = Math.round(each.clientHeight * ratio()); }
    const c = canvas.getContext("2d"), w = canvas.width, h = canvas.height;
    const curves = panel.curves();
    let low = Infinity, high = -Infinity;
    for (const curve of curves) for (let i = Math.floor(span[0]); i <= span[1]; i++) { if (curve.value[i] < low) low = curve.value[i]; if (curve.value[i] > high) high = curve.value[i]; }
    if (panel.limit && high > 0.6 * panel.limit) high = Math.max(high, 1.05 * panel.limit);
    if (!(high > low)) { high = low + 1; }
    const top = 24 * ratio(), foot = panel.last ? h - 20 * ratio() : h, r = ratio();
    const y = (v) => foot - 5 * r - (v - low) / (high - low) * (foot - top - 10 * r);
    c.fillStyle = "#fff"; c.fillRect(0, 0, w, h);
    // What the head does, behind the curves.
    const inks = ["#ebf8ff", "#fff", "#c6f6d5", "#fed7d7", "#edf2f7"];
    let begun = Math.floor(span[0]);
    for (let i = begun + 1; i <= Math.floor(span[1]) + 1; i++) if (layer.state[i] !== layer.state[begun] || i > span[1]) {
      c.fillStyle = inks[layer.state[begun]] || "#fff";
      const x0 = (begun - span[0]) / (span[1] - span[0]) * w, x1 = (i - span[0]) / (span[1] - span[0]) * w;
      c.fillRect(x0, top, x1 - x0, foot - top);
      begun = i;
    }
    const seconds = (i) => layer.start + i * layer.every, long = (span[1] - span[0]) * layer.every;
    const tick = niceStep(long / Math.max(2, w / r / 110)), digits = Math.max(0, -Math.floor(Math.log10(tick)));
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
      c.strokeStyle = INKS[k % INKS.length]; c.lineWidth = 1.2 * ratio(); c.globalAlpha = curves.length > 1 ? 0.8 : 1;
      c.beginPath();
      const each = (span[1] - span[0]) / w;
      for (let x = 0; x < w; x++) {
        const from = Math.floor(span[0] + x * each), to = Math.max(from + 1, Math.floor(span[0] + (x + 1) * each));
        let least = Infinity, most = -Infinity;
        for (let i = from; i < to && i < layer.count; i++) { if (curve.value[i] < least) least = curve.value[i]; if (curve.value[i] > most) most = curve.value[i]; }
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
    const between = `${number(low)} to ${number(high)}`;
    c.fillText(between, right, 16 * r);
    const named = curves.map((curve, k) => [curve.name, INKS[k % INKS.length]]).filter(([name]) => name);
    let left = w - named.reduce((sum, [name]) => sum + c.measureText(name).width + 24 * r, 4 * r);
    if (left > right + c.measureText(between).width) for (const [name, ink] of named) {
      c.fillStyle = ink; c.fillRect(left, 11 * r, 12 * r, 3 * r);
      c.fillStyle = "#1a202c"; c.fillText(name, left + 15 * r, 16 * r);
      left += c.measureText(name).width + 24 * r;
    }
  }
  function drawCursor() {
    for (const panel of panels) {
      const c = panel.over.getContext("2d"), x = (at - span[0]) / (span[1] - span[0]) * panel.over.width;
      c.clearRect(0, 0, panel.over.width, panel.over.height);
      c.fillStyle = "#1a202c"; c.fillRect(x - ratio() / 2, 24 * ratio(), 1.5 * ratio(), panel.over.height);
    }
  }
  function drawPlots() { panels.forEach(drawPlot); drawCursor(); }

  // ---- moving about ----
  function drawMoment() { moveMachine(); drawOver(); drawNow(); drawCursor(); }
  function draw() {
    for (const name of ["beads", "open", "twice"]) document.querySelector(`[data-show=${name}]`).disabled = !flat();
    document.querySelector("[data-show=turning]").disabled = !machineShown();
    resize(); moveMachine(); drawBase(); drawMoment();
  }
  function go(i) {
    at = Math.min(Math.max(i, 0), layer.count - 1);
    if (at < span[0] || at > span[1]) setSpan(at - (span[1] - span[0]) / 2, at + (span[1] - span[0]) / 2);
    moveMachine();
    if (playing || !shown.future || onGround) drawBase();
    drawMoment();
  }
  function choose(k) {
    layer = layerOf(k);
    at = 0;
    $("layer").value = k; $("which").textContent = layer.label;
    $("layer").setAttribute("aria-valuetext", layer.label);
    $("bare").textContent = layer.bare ? "Outline and ground are drawn on the first layer that is shown alone." : "";
    $("time").max = layer.count - 1;
    $("thinned").textContent = layer.every * data.servo_hz > 1.5 ? `Drawn every ${number(1000 * layer.every)} ms of the motion.` : "";
    resize(); fit(); span = [0, layer.count - 1];
    drawLegend(); draw(); drawPlots();
  }
  function zoomAt(factor, cx, cy) {
    const u = view.x + (cx - base.width / 2) / view.scale, v = view.y - (cy - base.height / 2) / view.scale;
    view.scale = Math.min(Math.max(view.scale * factor, 1e-3), 1e5);
    view.x = u - (cx - base.width / 2) / view.scale; view.y = v + (cy - base.height / 2) / view.scale;
    draw();
  }
  const zoom = (factor) => zoomAt(factor, base.width / 2, base.height / 2);
  function pick(x, y) {
    let best = -1, least = Infinity;
    for (let i = 0; i < layer.count; i++) {
      if (layer.state[i] !== PRINT) continue;
      const p = px(layer.x[i], layer.y[i], layer.z[i]), d = (p[0] - x) ** 2 + (p[1] - y) ** 2;
      if (d < least) { least = d; best = i; }
    }
    if (best >= 0 && least < (30 * ratio()) ** 2) go(best);
  }
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
    if (!flat() && !e.shiftKey) { turn.yaw += dx * 0.008; turn.pitch = Math.min(Math.max(turn.pitch + dy * 0.008, 0), Math.PI); }
    else { view.x -= dx * r / view.scale; view.y += dy * r / view.scale; }
    draw();
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
  const step = (by) => { stop(); go(Math.floor(at) + by); };
  let lastFrame = 0;
  function stop() { playing = false; $("play").textContent = "Play"; draw(); }
  function play() {
    if (playing) return stop();
    if (at >= layer.count - 1) at = 0;
    playing = true; $("play").textContent = "Pause"; lastFrame = 0;
    requestAnimationFrame(frame);
  }
  function frame(now) {
    if (!playing) return;
    const passed = lastFrame ? Math.min(now - lastFrame, 200) / 1000 : 0;
    lastFrame = now;
    go(at + passed * Number($("pace").value) / layer.every);
    if (at >= layer.count - 1) return stop();
    requestAnimationFrame(frame);
  }
  $("play").addEventListener("click", play);
  $("back").addEventListener("click", () => step(-1));
  $("ahead").addEventListener("click", () => step(1));
  // Stopping draws, and drawing sets the slider.
  $("time").addEventListener("input", () => { const to = Number($("time").value); stop(); go(to); });
  const whole = () => { turn = { ...LOOK }; fit(); draw(); };
  $("fit").addEventListener("click", whole);
  $("in").addEventListener("click", () => zoom(1.5));
  $("out").addEventListener("click", () => zoom(1 / 1.5));
  $("three").addEventListener("change", () => { fit(); draw(); });
  $("colour").addEventListener("change", () => { colour = $("colour").value; drawLegend(); draw(); });
  const turnTo = (k) => { if (k >= 0 && k < data.layers.length) { playing = false; $("play").textContent = "Play"; choose(k); } };
  $("layer").addEventListener("input", () => turnTo(Number($("layer").value)));
  $("whole").addEventListener("click", () => setSpan(0, layer.count - 1));
  const widen = (factor) => { const middle = at >= span[0] && at <= span[1] ? at : (span[0] + span[1]) / 2; setSpan(middle + (span[0] - middle) * factor, middle + (span[1] - middle) * factor); };
  $("narrower").addEventListener("click", () => widen(0.5));
  $("wider").addEventListener("click", () => widen(2));
  $("near").addEventListener("click", () => setSpan(at - 1 / layer.every, at + 1 / layer.every));
  document.addEventListener("keydown", (e) => {
    if (/^(INPUT|SELECT|BUTTON|SUMMARY|A)$/.test(e.target.tagName)) return;
    const tenth = Math.max(1, Math.round(0.1 / layer.every)), by = e.shiftKey ? tenth : 1;
    const act = { " ": play, ArrowLeft: () => step(-by), ArrowRight: () => step(by), "+": () => zoom(1.5), "=": () => zoom(1.5), "-": () => zoom(1 / 1.5), 0: whole,
      PageUp: () => turnTo(Number($("layer").value) + 1), PageDown: () => turnTo(Number($("layer").value) - 1) }[e.key];
    if (act) { e.preventDefault(); act(); }
  });

  // ---- tables ----
  function showPlace(x, y) {
    view.x = x; view.y = y;
    if (!flat()) { $("three").checked = false; }
    view.scale = Math.min(base.width, base.height) / 4;
    let best = 0, least = Infinity;
    for (let i = 0; i < layer.count; i++) {
      const d = (layer.x[i] - x) ** 2 + (layer.y[i] - y) ** 2;
      if (layer.state[i] === PRINT && d < least) { least = d; best = i; }
    }
    stop(); go(best); draw();
    over.focus({ preventScroll: true });
    $("stage").scrollIntoView({ block: "start" });
  }
  function rows(table, places, none) {
    const body = $(table).tBodies[0];
    if (!places.length) { body.insertRow().insertCell().textContent = none; return; }
    places.forEach((place) => {
      const row = body.insertRow(), button = document.createElement("button");
      row.insertCell().textContent = place.what;
      row.insertCell().textContent = `${place.x_mm.toFixed(2)}, ${place.y_mm.toFixed(2)} mm`;
      button.type = "button"; button.textContent = "Show";
      button.setAttribute("aria-label", `Show ${place.what} at ${place.x_mm.toFixed(2)}, ${place.y_mm.toFixed(2)}`);
      button.addEventListener("click", () => showPlace(place.x_mm, place.y_mm));
      row.insertCell().append(button);
    });
  }
  rows("slow", data.slow_places, "None are known.");
  rows("left", data.left_out, "Nothing that is known.");

  // ---- begin ----
  for (const [key, mode] of Object.entries(modes)) $("colour").add(new Option(mode.name, key));
  $("layer").max = data.layers.length - 1;
  $("layers").hidden = data.layers.length < 2;
  ["stage", "plots", "places"].forEach((id) => { $(id).hidden = false; });
  const tilts = Boolean(data.layers[0].nx), spatial = tilts || Boolean(data.machine);
  $("spatial").hidden = !spatial; $("axes").hidden = !tilts; $("machine").hidden = !data.machine;
  $("turning").hidden = !data.machine || !carriesPart();
  // What the report does not have cannot be switched.
  const absent = { outline: !data.outline.length, axis: !data.axis.length, open: !data.layers.some((l) => l.ground.length), twice: !data.layers.some((l) => l.ground.length) };
  for (const name in absent) document.querySelector(`[data-show=${name}]`).parentElement.hidden = absent[name];
  $("three").checked = tilts;
  choose(0);
  // Where a print is, from the bar of a served page.
  document.addEventListener("print-at", (e) => {
    const { layer: k, time_s } = e.detail;
    if (playing || !data.layers[k]) return;
    if (Number($("layer").value) !== k || layer !== layerOf(k)) choose(k);
    go((time_s - layer.start) / layer.every);
  });
  new ResizeObserver(() => { if (resize()) { fit(); draw(); } drawPlots(); }).observe(over.parentElement);
})();
