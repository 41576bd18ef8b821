"use strict";
// The state of the page and where things are on the screen: from above or aslant, in space. Nothing is drawn here.
const $ = (id) => document.getElementById(id);
const Ui = {
  layer: null, at: 0, playing: false, colour: "speed", shown: {}, lowest: 0,
  // The moment at the cursor, in the job.
  get time() { return this.layer.start + this.at * this.layer.every; },
};
const View = (() => {
  const { data } = Job, LOOK = { yaw: -0.6, pitch: 1.0 };
  const base = $("base"), over = $("over");
  const v = { x: 0, y: 0, scale: 10, turn: { ...LOOK }, middle: [0, 0, 0], links: [], fixed: null, onGround: null };
  const ratio = () => Math.min(window.devicePixelRatio || 1, 2);
  const flat = () => !$("three").checked;
  const machineShown = () => Ui.shown.machine && data.machine && !flat();
  // The machine at the cursor: frames of its links, and how the part lies when the ground is at rest.
  function moveMachine() {
    const { layer } = Ui;
    v.links = machineShown() ? Links.frames(data.machine.links, Links.joints(layer.jointsAt, layer.jointsEvery, Ui.at)) : [];
    const part = v.links[data.machine?.part];
    // Either the part keeps still and the ground moves about it, or the other way round.
    v.onGround = part && Ui.shown.turning ? part : null;
    v.fixed = part && !Ui.shown.turning ? Links.inverse(part) : null;
  }
  // Seen from the side, by coordinates that keep still; the third is how far away.
  function slanted([x, y, z]) {
    const cx = x - v.middle[0], cy = y - v.middle[1], cz = z - v.middle[2], { yaw, pitch } = v.turn;
    const u = cx * Math.cos(yaw) - cy * Math.sin(yaw), w = cx * Math.sin(yaw) + cy * Math.cos(yaw);
    return [u + v.middle[0], w * Math.cos(pitch) + cz * Math.sin(pitch) + v.middle[1], w * Math.sin(pitch) - cz * Math.cos(pitch)];
  }
  const project = (x, y, z) => flat() ? [x, y] : slanted(v.onGround ? Links.placed(v.onGround, [x, y, z]) : [x, y, z]);
  const onScreen = ([x, y]) => [(x - v.x) * v.scale + base.width / 2, base.height / 2 - (y - v.y) * v.scale];
  const px = (x, y, z) => onScreen(project(x, y, z));
  // Every solid of the machine: corners as they keep still, and the joint that moves it.
  function solids() {
    const out = [], moves = [];
    data.machine.links.forEach((link, number) => {
      moves.push(link.joint ? link.joint.number : moves[link.parent] ?? -1);
      const frame = v.fixed ? Links.times(v.fixed, v.links[number]) : v.links[number];
      for (const solid of link.solids) out.push({ joint: moves[number], corners: solid.map((corner) => Links.placed(frame, corner)) });
    });
    return out;
  }
  // The box of what a layer prints.
  function box(l) {
    if (l.box) return l.box;
    const { x, y, z, what, count } = l.path, ends = [0, 1, 2].map(() => [Infinity, -Infinity]);
    for (let k = 0; k < count; k++) {
      if (!Job.prints(what[k]) && !(k && Job.prints(what[k - 1]))) continue;
      [x[k], y[k], z[k]].forEach((at, i) => { if (at < ends[i][0]) ends[i][0] = at; if (at > ends[i][1]) ends[i][1] = at; });
    }
    return (l.box = ends);
  }
  // The stack's boxes: of the layer that is shown alone, or of all that are shown.
  function boxes() {
    if (flat() || !Stack.works) return [box(Ui.layer)];
    return Stack.entries().map((entry) => box(Job.layer(entry.page)));
  }
  function fit() {
    let ends = [0, 1, 2].map(() => [Infinity, -Infinity]);
    for (const of of boxes()) ends = ends.map(([low, high], i) => [Math.min(low, of[i][0]), Math.max(high, of[i][1])]);
    if (ends[0][0] > ends[0][1]) ends = [[0, 10], [0, 10], [0, 0]];
    v.middle = ends.map(([low, high]) => (low + high) / 2);
    moveMachine();
    let x0 = Infinity, x1 = -Infinity, y0 = Infinity, y1 = -Infinity;
    const add = ([x, y]) => { x0 = Math.min(x0, x); x1 = Math.max(x1, x); y0 = Math.min(y0, y); y1 = Math.max(y1, y); };
    for (let k = 0; k < 8; k++) add(project(...ends.map((end, i) => end[(k >> i) & 1])));
    if (flat()) for (const ring of Ui.layer.rings) for (let i = 0; i < ring.length; i += 2) add([ring[i], ring[i + 1]]);
    if (machineShown()) for (const { corners } of solids()) for (const corner of corners) add(slanted(corner));
    v.x = (x0 + x1) / 2; v.y = (y0 + y1) / 2;
    v.scale = 0.94 * Math.min(base.width / (x1 - x0 || 1), base.height / (y1 - y0 || 1));
  }
  function resize() {
    let changed = false;
    for (const canvas of [base, over]) {
      const w = Math.round(over.clientWidth * ratio()), h = Math.round(over.clientHeight * ratio());
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
  return Object.assign(v, { LOOK, ratio, flat, machineShown, moveMachine, slanted, project, onScreen, px, solids, box, fit, resize, carriesPart, base, over });
})();
