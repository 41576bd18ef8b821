"use strict";
// The ground that the aperture sweeps: its true outline moved from pose to pose. A turn is divided, so that between
// two placements the hull of both is what is swept (the outline is convex). Canvas paths in millimetres; all pieces
// run the same way around, so that filled without even-odd they are their union, without cracks.
const Sweep = (() => {
  const TURN = 6 * Math.PI / 180;
  const ring = Job.data.nozzle || [];
  const area = ring.reduce((sum, [x, y], k) => { const [u, v] = ring[(k + 1) % ring.length]; return sum + x * v - y * u; }, 0);
  const nozzle = area < 0 ? [...ring].reverse() : ring;
  // What a corner looks to: across the chord between its neighbours.
  const looks = nozzle.map((_, k) => { const [a, b] = [nozzle.at(k - 1), nozzle[(k + 1) % nozzle.length]]; return [b[1] - a[1], a[0] - b[0]]; });
  function placement(path, x, y, c, s) {
    nozzle.forEach(([u, v], k) => { const at = [x + u * c - v * s, y + u * s + v * c]; k ? path.lineTo(...at) : path.moveTo(...at); });
    path.closePath();
  }
  // The hull of two placements that differ little in heading: corners that look ahead are those of the second.
  function hull(path, a, b) {
    const middle = (a.heading + b.heading) / 2, c = Math.cos(middle), s = Math.sin(middle);
    const du = (b.x - a.x) * c + (b.y - a.y) * s, dv = (b.y - a.y) * c - (b.x - a.x) * s;
    let begun = false, before = null;
    const add = (k, ahead) => {
      const [u, v] = nozzle[k], at = ahead ? b : a, x = at.x + u * at.c - v * at.s, y = at.y + u * at.s + v * at.c;
      begun ? path.lineTo(x, y) : path.moveTo(x, y);
      begun = true;
    };
    for (let k = 0; k < nozzle.length; k++) {
      const ahead = looks[k][0] * du + looks[k][1] * dv > 0;
      if (before !== null && ahead !== before) add(k, before);
      add(k, ahead);
      before = ahead;
    }
    // The turn-over that lies between the last corner and the first.
    if (before !== (looks[0][0] * du + looks[0][1] * dv > 0)) add(0, before);
    path.closePath();
  }
  // What is swept on a segment of a path, or on a part of it.
  function segment(path, p, k, from = 0, to = 1) {
    const turn = p.heading[k + 1] - p.heading[k], wide = p.wide ? p.wide[k] : 1;
    const parts = Math.max(1, Math.ceil(Math.abs(turn) * (to - from) / TURN));
    let last = null;
    for (let i = 0; i <= parts; i++) {
      const share = from + (to - from) * i / parts, heading = p.heading[k] + share * turn;
      const x = p.x[k] + share * (p.x[k + 1] - p.x[k]), y = p.y[k] + share * (p.y[k + 1] - p.y[k]);
      const here = { x, y, heading, c: wide * Math.cos(heading), s: wide * Math.sin(heading) };
      placement(path, x, y, here.c, here.s);
      if (last && Math.hypot(x - last.x, y - last.y) > 1e-4) hull(path, last, here);
      last = here;
    }
  }
  // Width of the nozzle across a unit normal, mm.
  function extent(heading, nx, ny) {
    const c = Math.cos(heading), s = Math.sin(heading), u = nx * c + ny * s, v = -nx * s + ny * c;
    let least = Infinity, most = -Infinity;
    for (const [x, y] of nozzle) { const d = x * u + y * v; if (d < least) least = d; if (d > most) most = d; }
    return most - least;
  }
  // The corner of the outline that reaches farthest to each of so many directions.
  function support(count) {
    const out = new Float32Array(2 * count);
    for (let i = 0; i < count; i++) {
      const c = Math.cos(2 * Math.PI * i / count), s = Math.sin(2 * Math.PI * i / count);
      const best = nozzle.reduce((a, b) => b[0] * c + b[1] * s > a[0] * c + a[1] * s ? b : a, nozzle[0] || [0, 0]);
      out.set(best, 2 * i);
    }
    return out;
  }
  return { nozzle, placement, segment, extent, support };
})();
