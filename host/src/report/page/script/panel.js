"use strict";
// Words beside the drawing: what is at the cursor, what the colours mean, lists of places; and what is drawn over the
// layer: nozzle, tool axes, the machine's links.
const Panel = (() => {
  const { data } = Job, INKS = ["#0072b2", "#d55e00", "#009e73", "#cc79a7", "#8a6d00", "#56b4e9", "#000000"];
  const number = (v, digits = 3) => Number(v.toPrecision(digits)).toString();
  const element = (tag, text, className) => Object.assign(document.createElement(tag), { textContent: text, className: className || "" });
  // Seconds for the eye; two of one clock are written alike.
  function time(s, whole = s) {
    if (whole < 100) return s.toFixed(2);
    const tenths = Math.round(s * 10), minutes = Math.floor(tenths / 600), rest = ((tenths % 600) / 10).toFixed(1).padStart(4, "0");
    return whole < 6000 ? `${minutes}:${rest}` : `${Math.floor(minutes / 60)}:${String(minutes % 60).padStart(2, "0")}:${rest}`;
  }
  function now() {
    const { layer } = Ui, i = Math.min(Math.floor(Ui.at), layer.count - 1), pose = Job.poseAt(layer, Ui.time), limit = layer.limit[i];
    const prints = Job.prints(pose.what), what = data.whats[pose.what] || "hold";
    const rows = [["Head", what === "bead" ? "print" : prints ? `print, ${what}` : what], ["Place", `${pose.x.toFixed(2)}, ${pose.y.toFixed(2)}, ${pose.z.toFixed(2)} mm`],
      ["Speed", `${number(layer.speed[i])} mm/s`], ["Bead", prints ? `${Colours.widths(layer)[pose.k].toFixed(2)} mm` : "none"],
      ["Heading", `${(Colours.mod(pose.heading * 180 / Math.PI, 360) % 359.95).toFixed(1)}°`], ["Flow", `${number(layer.flow[i])} mm³/s`],
      ["Limited by", limit === 255 ? "nothing" : data.limits[limit]]];
    if (pose.line) rows.push([data.line_name, String(pose.line)]);
    for (const key of Object.keys(Colours.modes)) {
      const { heat, name, unit } = Colours.modes[key];
      if (heat) rows.push([name[0].toUpperCase() + name.slice(1), `${number(Colours.heatAt(heat, Ui.time))} ${unit}`]);
    }
    if (View.machineShown()) Links.joints(layer.jointsAt, layer.jointsEvery, Ui.at).forEach((position, k) => {
      const slides = data.machine.links.some(({ joint }) => joint && joint.number === k && joint.slides);
      rows.push([layer.joints[k].name, slides ? `${position.toFixed(2)} mm` : `${(position * 180 / Math.PI).toFixed(1)}°`]);
    });
    $("now").replaceChildren(...rows.flatMap(([what, value]) => [element("dt", what), element("dd", value)]));
    const of = (s) => time(s, data.duration_s), here = Ui.start + Ui.at * layer.every;
    const inLayer = Job.stack.length > 1 ? `, layer ${time(Ui.at * layer.every, layer.seconds)} of ${time(layer.seconds)}` : "";
    $("clock").textContent = `${of(here)} of ${of(data.duration_s)} ${data.duration_s < 100 ? "s" : data.duration_s < 6000 ? "min" : "h"}${inLayer}`;
    $("time").value = Math.floor(Ui.at);
  }
  // How long each kind takes on the layer, or on all layers of the stack.
  function times() {
    const all = new Map(), add = (l) => l.path.what.forEach((what, k) => { if (what !== Job.NONE && k + 1 < l.path.count) all.set(what, (all.get(what) || 0) + l.path.t[k + 1] - l.path.t[k]); });
    if (View.flat() || !Stack.works) add(Ui.layer);
    else for (const entry of Job.stack) add(Job.layer(entry.page));
    return all;
  }
  function swatches(items) {
    const list = element("div", "", "legend");
    for (const [ink, name] of items) {
      const item = document.createElement("span"), swatch = document.createElement("i");
      swatch.style.background = ink;
      item.append(swatch, name); list.append(item);
    }
    return list;
  }
  function kinds() {
    const all = times(), sum = [...all.values()].reduce((a, b) => a + b, 0), table = element("table", "", "kinds"), body = table.createTBody();
    for (const [what, seconds] of [...all].sort((a, b) => b[1] - a[1])) {
      const row = body.insertRow(), name = row.insertCell(), swatch = document.createElement("i");
      swatch.style.background = Colours.WHATS[what];
      name.append(swatch, data.whats[what] === "bead" ? "print" : data.whats[what]);
      row.insertCell().textContent = sum < 100 ? `${seconds.toFixed(1)} s` : time(seconds, sum);
      row.insertCell().textContent = `${(100 * seconds / sum).toFixed(1)} %`;
    }
    return table;
  }
  function legend() {
    const mode = Colours.modes[Ui.colour], whole = !View.flat() && Stack.works;
    const title = element("div", `Colour: ${mode.name}${mode.unit ? `, ${mode.unit}` : ""}${Job.stack.length > 1 ? whole ? "; all layers" : "; this layer" : ""}`);
    if (Ui.colour === "what") return $("legend").replaceChildren(title, kinds());
    if (Ui.colour === "limit") {
      const used = new Set(Ui.layer.limit), ink = Colours.limitInks(Ui.layer);
      const items = [...data.limits.map((name, k) => [k, name]), [255, "nothing"]].filter(([k]) => used.has(k)).map(([k, name]) => [Colours.NAMED[ink[k]], name]);
      return $("legend").replaceChildren(title, swatches(items));
    }
    const [low, high] = Colours.range(whole ? Stack.pages() : [Ui.layer], Ui.colour), strip = element("div", "", "ramp"), ends = element("div", "", "ends");
    strip.style.background = `linear-gradient(90deg,${Array.from({ length: 12 }, (_, k) => Colours.ramp(mode, k / 11)).join()})`;
    ends.append(...[low, high].map((v, k) => element("span", number(v) + (k && mode.most ? " and more" : ""))));
    $("legend").replaceChildren(title, strip, ends);
  }
  function rows(table, places, none) {
    const body = $(table).tBodies[0];
    if (!places.length) { body.insertRow().insertCell().textContent = none; return; }
    places.forEach((place) => {
      const row = body.insertRow(), button = element("button", "Show"), at = `${place.x_mm.toFixed(2)}, ${place.y_mm.toFixed(2)}`;
      const layer = place.layer !== undefined && Job.stack.length > 1 ? `, layer ${place.layer + 1}` : "";
      row.insertCell().textContent = place.what;
      row.insertCell().textContent = `${at} mm${layer}`;
      button.type = "button";
      button.setAttribute("aria-label", `Show ${place.what} at ${at}${layer}`);
      button.addEventListener("click", () => Page.show(place));
      row.insertCell().append(button);
    });
  }
  // Links as outlines of their solids, the far ones first; in the colour that the plots give their joint.
  function drawMachine(c) {
    if (!View.machineShown()) return;
    const mean = (corners) => corners.reduce((sum, corner) => sum + View.slanted(corner)[2], 0) / corners.length;
    const far = View.solids().map((solid) => [mean(solid.corners), solid]).sort((a, b) => b[0] - a[0]);
    c.lineJoin = "round";
    for (const [, { joint, corners }] of far) {
      c.beginPath();
      Links.hull(corners.map((corner) => View.onScreen(View.slanted(corner)))).forEach(([x, y], k) => { k ? c.lineTo(x, y) : c.moveTo(x, y); });
      c.closePath();
      const ink = joint < 0 ? "#718096" : INKS[joint % INKS.length];
      c.fillStyle = `${ink}30`; c.fill();
      c.strokeStyle = `${ink}b0`; c.lineWidth = View.ratio(); c.stroke();
    }
  }
  function drawAxes(c) {
    const p = Ui.layer.path;
    if (!p.axis || View.flat() || !Ui.shown.axes) return;
    const every = Math.max(1, Math.floor(p.count / 400)), long = 40 * View.ratio() / View.scale;
    c.beginPath();
    for (let k = 0; k < p.count; k += every) if (Job.prints(p.what[k])) {
      c.moveTo(...View.px(p.x[k], p.y[k], p.z[k]));
      c.lineTo(...View.px(p.x[k] + long * p.axis[0][k], p.y[k] + long * p.axis[1][k], p.z[k] + long * p.axis[2][k]));
    }
    c.strokeStyle = "#71809688"; c.lineWidth = View.ratio(); c.stroke();
  }
  function drawOver() {
    const c = View.over.getContext("2d"), r = View.ratio(), pose = Job.poseAt(Ui.layer, Ui.time), cos = Math.cos(pose.heading), sin = Math.sin(pose.heading);
    const at = [pose.x, pose.y, pose.z], px = (v, by = 1) => View.px(...at.map((a, i) => a + by * v[i]));
    c.clearRect(0, 0, View.over.width, View.over.height);
    drawMachine(c); drawAxes(c);
    c.beginPath();
    data.nozzle.forEach(([u, v], k) => {
      const [x, y] = px(Job.tilted([u * cos - v * sin, u * sin + v * cos, 0], pose.axis));
      k ? c.lineTo(x, y) : c.moveTo(x, y);
    });
    c.closePath();
    c.fillStyle = Job.prints(pose.what) ? "#d55e0088" : "#ffffffaa"; c.fill();
    c.strokeStyle = "#1a202c"; c.lineWidth = 1.5 * r; c.stroke();
    const [x, y] = px([0, 0, 0]);
    c.beginPath(); c.arc(x, y, 9 * r, 0, 7); c.strokeStyle = "#1a202c88"; c.stroke();
    if (Ui.layer.path.axis) {
      c.beginPath(); c.moveTo(x, y); c.lineTo(...px(pose.axis, 60 * r / View.scale));
      c.strokeStyle = "#000"; c.lineWidth = 2 * r; c.stroke();
    }
    if (!View.flat() && Stack.works) { Flat.drawOrigin(c); Flat.drawScale(c); }
  }
  return { now, legend, rows, drawOver, number, INKS, time };
})();
