"use strict";
// What the page's JSON block holds, decoded: layers with their path, samples, outline. Data only, nothing drawn.
// A path is columns of points with what is done from each point on; between two points of a run it is straight in
// place and heading. Samples are at even times.
const Job = (() => {
  const data = JSON.parse(document.getElementById("data").textContent);
  const NONE = 255, TRAVEL = data.whats?.indexOf("travel") ?? 0;
  const bytes = (text) => Uint8Array.from(atob(text), (c) => c.charCodeAt(0));
  // Numbers of 16 bits over a range.
  function values(channel) {
    const raw = bytes(channel.b64), view = new DataView(raw.buffer), out = new Float32Array(raw.length / 2);
    const step = (channel.max - channel.min) / 65535;
    for (let i = 0; i < out.length; i++) out[i] = channel.min + step * view.getUint16(2 * i, true);
    return out;
  }
  // What each number adds to the one before, zigzag, seven bits a byte.
  function steps(column) {
    const raw = atob(column.b64), out = [];
    let sum = 0, value = 0, scale = 1;
    for (let i = 0; i < raw.length; i++) {
      const byte = raw.charCodeAt(i);
      value += (byte & 127) * scale; scale *= 128;
      if (byte > 127) continue;
      sum += value % 2 ? -(value + 1) / 2 : value / 2;
      out.push(sum * column.unit);
      value = 0; scale = 1;
    }
    return Float64Array.from(out);
  }
  function path(source) {
    const p = { t: steps(source.ticks).map((tick) => (tick + source.start_tick) / data.servo_hz) };
    for (const name of ["x", "y", "z", "heading", "line"]) p[name] = steps(source[name]);
    if (source.axis) p.axis = source.axis.map(steps);
    p.count = p.t.length;
    p.what = new Uint8Array(p.count);
    let at = 0;
    for (let k = 0; k < source.runs.length; k += 2) {
      const end = at + source.runs[k + 1];
      p.what.fill(source.runs[k], at, end);
      p.what[end - 1] = NONE;
      at = end;
    }
    return p;
  }
  const opened = new Map();
  function layer(number) {
    if (!opened.has(number)) opened.set(number, open(data.layers[number], number));
    return opened.get(number);
  }
  function open(source, page) {
    const l = { page, label: source.label, number: source.number, like: source.like ?? source.number, start: source.start_s, every: source.every_s, ground: source.like === undefined ? source.ground : data.layers.find(({ number }) => number === source.like).ground, path: path(source.path) };
    for (const name of ["speed", "flow"]) l[name] = values(source[name]);
    l.joints = source.joints.map((joint) => ({ name: joint.name, value: values(joint) }));
    l.jointsAt = source.joints_at.map(values); l.jointsEvery = source.joints_every;
    l.limit = bytes(source.limit);
    l.count = l.limit.length;
    if (source.laid) { l.laid = values(source.laid); l.path = asLaid(l); }
    l.rings = source.outline === undefined ? [] : outline(source.outline);
    l.seconds = (l.count - 1) * l.every;
    // At even times, for the plots.
    l.heading = new Float32Array(l.count); l.what = new Uint8Array(l.count);
    for (let i = 0, k = 0; i < l.count; i++) {
      const t = l.start + i * l.every;
      while (k + 2 < l.path.count && l.path.t[k + 1] <= t) k++;
      l.heading[i] = between(l.path, "heading", k, t) * 180 / Math.PI;
      l.what[i] = l.path.what[k] === NONE ? data.whats.length - 1 : l.path.what[k];
    }
    return l;
  }
  // Where a known material lays another share than was asked for: the path with a point wherever that share changes,
  // and what of the bead's width each segment has.
  function asLaid(l) {
    const p = l.path, names = ["t", "x", "y", "z", "heading"], out = { line: [], what: [], wide: [] }, kept = (p.axis || []).map(() => []);
    for (const name of names) out[name] = [];
    const sample = (t) => l.laid[Math.min(Math.max(Math.floor((t - l.start) / l.every), 0), l.count - 1)];
    const push = (k, t, wide) => {
      for (const name of names) out[name].push(name === "t" ? t : t > p.t[k] ? between(p, name, k, t) : p[name][k]);
      out.line.push(p.line[k]); out.what.push(p.what[k]); out.wide.push(wide);
      kept.forEach((column, n) => column.push(p.axis[n][k]));
    };
    for (let k = 0; k < p.count; k++) {
      const end = p.what[k] !== NONE && prints(p.what[k]) && k + 1 < p.count ? p.t[k + 1] : p.t[k];
      let wide = end > p.t[k] ? sample(p.t[k]) : 1;
      push(k, p.t[k], wide);
      for (let t = l.start + l.every * (Math.floor((p.t[k] - l.start) / l.every) + 1); t < end; t += l.every) {
        if (Math.abs(sample(t) - wide) > 0.01) push(k, t, wide = sample(t));
      }
    }
    for (const name of [...names, "line"]) out[name] = Float64Array.from(out[name]);
    out.what = Uint8Array.from(out.what); out.wide = Float32Array.from(out.wide); out.count = out.t.length;
    if (p.axis) out.axis = kept.map((column) => Float64Array.from(column));
    return out;
  }
  const outlines = new Map();
  function outline(number) {
    if (!outlines.has(number)) outlines.set(number, data.outlines[number].map((ring) => {
      const x = steps(ring.x), y = steps(ring.y), flat = new Float64Array(2 * x.length);
      x.forEach((v, k) => { flat[2 * k] = v; flat[2 * k + 1] = y[k]; });
      return flat;
    }));
    return outlines.get(number);
  }
  function between(p, name, k, t) {
    const a = p[name][k], b = p[name][k + 1] ?? a, long = p.t[k + 1] - p.t[k];
    return long > 0 ? a + (b - a) * Math.min(Math.max((t - p.t[k]) / long, 0), 1) : a;
  }
  // The last point that is not behind a time.
  function pointAt(p, t) {
    let low = 0, high = p.count - 1;
    while (low < high) { const k = (low + high + 1) >> 1; if (p.t[k] <= t) low = k; else high = k - 1; }
    return Math.min(low, Math.max(p.count - 2, 0));
  }
  // Where the nozzle is: place, heading (rad), tool axis, the point before it.
  function poseAt(l, t) {
    const p = l.path, k = pointAt(p, t), of = (name) => between(p, name, k, t);
    const axis = p.axis ? p.axis.map((column) => column[k]) : [0, 0, 1];
    return { x: of("x"), y: of("y"), z: of("z"), heading: of("heading"), axis, k, what: p.what[k], line: p.line[k] };
  }
  // A vector from a tool that stands upright into one along an axis (the smallest turn), and back.
  function tilted([x, y, z], [a, b, c]) {
    const by = (a * x + b * y + (c + 1) * z) / (1 + c);
    return [x - a * by + 2 * a * z, y - b * by + 2 * b * z, z - (c + 1) * by + 2 * c * z];
  }
  function upright([x, y, z], [a, b, c]) {
    const by = (a * x + b * y + (c + 1) * z) / (1 + c), along = a * x + b * y + c * z;
    return [x - a * by, y - b * by, z - (c + 1) * by + 2 * along];
  }
  const prints = (what) => what < TRAVEL;
  // The layers of the job that have something.
  const stack = data.layers.map(({ number, seconds }, page) => ({ page, number, seconds })).filter((entry) => entry.seconds > 0);
  return { data, NONE, TRAVEL, layer, steps, pointAt, poseAt, prints, stack, tilted, upright };
})();
