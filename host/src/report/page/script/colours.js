"use strict";
// What beads are coloured by: a value of each segment of a path, ranges over a layer or all, colours.
const Colours = (() => {
  const { data } = Job;
  const VIRIDIS = [[68, 1, 84], [70, 50, 127], [54, 92, 141], [39, 127, 142], [31, 161, 135], [74, 194, 109], [159, 218, 58], [253, 231, 37]];
  const ROUND = [[226, 217, 226], [112, 140, 190], [85, 51, 140], [47, 20, 54], [140, 40, 80], [190, 120, 100], [226, 217, 226]];
  const NAMED = ["#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00", "#56b4e9", "#8a6d00", "#000000", "#7f3c8d", "#6b7280"];
  // wall, solid, sparse, bridge, skirt, support, bead, travel and standing.
  const WHATS = ["#2f6db5", "#56b4e9", "#e69f00", "#c2568f", "#009e73", "#8a6d00", "#2f6db5", "#9b2c2c", "#6b7280", "#6b7280", "#6b7280"];
  const BINS = 24;
  const mod = (v, period) => ((v % period) + period) % period;
  const modes = {
    what: { name: "kind of bead", inks: WHATS },
    speed: { name: "speed", unit: "mm/s" },
    width: { name: "bead width", unit: "mm" },
    heading: { name: "heading", unit: "°", turn: data.period_deg },
    flow: { name: "flow", unit: "mm³/s" },
    ...(data.layers[0]?.laid ? { laid: { name: "bead area, off by", unit: "%", most: 0.98 } } : {}),
    cost: { name: "time for each mm²", unit: "s", most: 0.98 },
    order: { name: "order", unit: "s" },
    limit: { name: "what limits it", inks: NAMED },
  };
  if (Job.stack.length > 1) modes.layer = { name: "time of the layer", unit: "s" };
  for (const name of new Set((data.heat || []).map((step) => step.name))) modes[`heat ${name}`] = { name: name.split(",")[0], unit: name.split(", ")[1], heat: name };
  // The limits that bind most get colours of their own; nothing has the last one, grey.
  function limitInks(l) {
    if (l.ink) return l.ink;
    const often = new Array(256).fill(0);
    l.limit.forEach((k) => often[k]++);
    l.ink = new Uint8Array(256).fill(NAMED.length - 2);
    often.map((n, k) => [n, k]).filter(([n, k]) => n && k !== 255).sort((a, b) => b[0] - a[0]).slice(0, NAMED.length - 1).forEach(([, k], rank) => { l.ink[k] = rank; });
    l.ink[255] = NAMED.length - 1;
    return l.ink;
  }
  // Width of the bead on each segment; where nothing moves that of the one before.
  function widths(l) {
    if (l.width) return l.width;
    const p = l.path;
    l.width = new Float32Array(p.count);
    for (let k = 0; k + 1 < p.count; k++) {
      let way = [p.x[k + 1] - p.x[k], p.y[k + 1] - p.y[k], p.z[k + 1] - p.z[k]];
      if (p.axis) way = Job.upright(way, p.axis.map((column) => column[k]));
      const long = Math.hypot(way[0], way[1]);
      l.width[k] = long > 0.005 ? Sweep.extent((p.heading[k] + p.heading[k + 1]) / 2, -way[1] / long, way[0] / long) * (p.wide ? p.wide[k] : 1) : k ? l.width[k - 1] : 0;
    }
    return l.width;
  }
  function heatAt(name, t) {
    let to = 0;
    for (const step of data.heat) if (step.name === name && step.at_s <= t) to = step.to;
    return to;
  }
  // Values of all segments; those that do not print are left at 0.
  const known = new Map();
  function valuesOf(l, key) {
    const id = `${l.page} ${key}`;
    if (known.has(id)) return known.get(id);
    const p = l.path, out = new Float32Array(p.count), width = key === "width" || key === "cost" ? widths(l) : null;
    const ink = key === "limit" ? limitInks(l) : null;
    for (let k = 0; k + 1 < p.count; k++) {
      if (!Job.prints(p.what[k])) continue;
      const long = p.t[k + 1] - p.t[k], sample = Math.min(Math.max(Math.round(((p.t[k] + p.t[k + 1]) / 2 - l.start) / l.every), 0), l.count - 1);
      const way = () => Math.hypot(p.x[k + 1] - p.x[k], p.y[k + 1] - p.y[k], p.z[k + 1] - p.z[k]);
      out[k] = key === "what" ? p.what[k] : key === "limit" ? ink[l.limit[sample]] : key === "speed" ? (long > 0 ? way() / long : 0)
        : key === "width" ? width[k] : key === "heading" ? (p.heading[k] + p.heading[k + 1]) * 90 / Math.PI : key === "flow" ? l.flow[sample]
        : key === "laid" ? 100 * (p.wide[k] - 1)
        : key === "cost" ? long / Math.max(way() * width[k], 0.05 * long) : key === "order" ? p.t[k] : key === "layer" ? data.layers[l.page].seconds
        : heatAt(modes[key].heat, p.t[k]);
    }
    known.set(id, out);
    return out;
  }
  // Least and greatest value of layers; the costliest are left out.
  const ranges = new Map();
  function range(layers, key) {
    const mode = modes[key];
    if (mode.turn) return [0, mode.turn];
    const id = `${layers.map((l) => l.page).join()} ${key}`;
    if (!ranges.has(id)) {
      const found = [];
      for (const l of layers) valuesOf(l, key).forEach((v, k) => { if (Job.prints(l.path.what[k])) found.push(v); });
      const sorted = Float32Array.from(found).sort();
      ranges.set(id, sorted.length ? [sorted[0], sorted[Math.floor((sorted.length - 1) * (mode.most || 1))]] : [0, 1]);
    }
    return ranges.get(id);
  }
  // The number of each segment's colour.
  function binOf(l, key, layers) {
    const values = valuesOf(l, key), mode = modes[key];
    if (mode.inks) return (k) => values[k];
    const [low, high] = range(layers, key), scale = (BINS - 1) / ((high - low) || 1);
    return (k) => Math.min(BINS - 1, Math.max(0, Math.round(((mode.turn ? mod(values[k], mode.turn) : values[k]) - low) * scale)));
  }
  function ramp(stops, t) {
    const at = Math.min(Math.max(t, 0), 1) * (stops.length - 1), k = Math.min(Math.floor(at), stops.length - 2);
    return stops[k].map((v, i) => Math.round(v + (at - k) * (stops[k + 1][i] - v)));
  }
  const stopsOf = (mode) => mode.turn ? ROUND : VIRIDIS;
  function rgb(key, bin) {
    const { inks } = modes[key];
    if (inks) return [1, 3, 5].map((at) => parseInt(inks[bin].slice(at, at + 2), 16));
    return ramp(stopsOf(modes[key]), bin / (BINS - 1));
  }
  const css = (key, bin) => `rgb(${rgb(key, bin).join()})`;
  return { modes, NAMED, WHATS, mod, limitInks, widths, heatAt, range, binOf, rgb, css, ramp: (mode, t) => `rgb(${ramp(stopsOf(mode), t).join()})` };
})();
