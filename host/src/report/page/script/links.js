"use strict";
// The machine's links: frames from joint positions, and the outlines of convex solids on the screen. Pure
// functions; what is drawn when is page.js's. A frame is three rows of rotation with the origin (mm) at
// the end of each.
const Links = {
  times(a, b) {
    return [0, 1, 2].map((i) => [0, 1, 2, 3].map((k) => a[i][0] * b[0][k] + a[i][1] * b[1][k] + a[i][2] * b[2][k] + (k === 3 ? a[i][3] : 0)));
  },
  inverse(a) {
    return [0, 1, 2].map((i) => [a[0][i], a[1][i], a[2][i], -(a[0][i] * a[0][3] + a[1][i] * a[1][3] + a[2][i] * a[2][3])]);
  },
  placed: (a, [x, y, z]) => a.map((row) => row[0] * x + row[1] * y + row[2] * z + row[3]),
  // A joint's motion: along or about an axis of its link.
  moved({ axis, slides, sign, zero }, joint) {
    const by = sign * joint - zero, out = [[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0]];
    if (slides) { out[axis][3] = by; return out; }
    const [i, k] = [(axis + 1) % 3, (axis + 2) % 3], c = Math.cos(by), s = Math.sin(by);
    out[i][i] = out[k][k] = c; out[i][k] = -s; out[k][i] = s;
    return out;
  },
  // Frames of all links in the input's coordinates, the ground at rest; every link comes after its parent.
  frames(links, joints) {
    const out = [];
    links.forEach((link, number) => {
      const rest = link.rotation.map((row, k) => [...row, link.origin_mm[k]]);
      const own = link.joint ? Links.times(rest, Links.moved(link.joint, joints[link.joint.number])) : rest;
      out.push(link.parent < number ? Links.times(out[link.parent], own) : own);
    });
    return out;
  },
  // Joint positions at a sample that may lie between two that are known.
  joints(columns, every, at) {
    return columns.map((column) => {
      const place = Math.min(at / every, column.length - 1), k = Math.floor(place);
      return column[k] + (place - k) * ((column[k + 1] ?? column[k]) - column[k]);
    });
  },
  // The convex hull of points in a plane, in order (Andrew's monotone chain).
  hull(points) {
    const sorted = [...points].sort((p, q) => p[0] - q[0] || p[1] - q[1]);
    const half = (list) => {
      const chain = [];
      for (const p of list) {
        const left = (a, b) => (b[0] - a[0]) * (p[1] - a[1]) - (b[1] - a[1]) * (p[0] - a[0]) > 0;
        while (chain.length > 1 && !left(chain.at(-2), chain.at(-1))) chain.pop();
        chain.push(p);
      }
      return chain.slice(0, -1);
    };
    return [...half(sorted), ...half(sorted.reverse())];
  },
};
