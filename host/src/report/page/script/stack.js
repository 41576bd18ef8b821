"use strict";
// All layers as one stack in space, by WebGL2 (PicoGL): each segment of a path is the hull of the aperture at both its
// ends in the plane, a bead's height thick, narrower on top. Poses and colours are textures; an instance is a batch of
// segments (so few corners a segment would leave a renderer idle if each were an instance of its own). One call draws
// the beads of all layers that are shown, one the travel, one the bed. The view is view.js's, so that what is drawn
// over it fits.
const Stack = (() => {
  const { data } = Job, SUPPORT = 256, NODES_MAX = 1.6e6, TURN = 15 * Math.PI / 180, HEIGHT_UNIT = 0.01, BATCH = 256, CORNERS = 48, WIDE = 2048;
  const stats = { segments: 0, calls: 0, scriptMs: 0, renderer: "", left: "" };
  const tilts = Boolean(data.layers[0]?.path.axis), narrows = Boolean(data.layers[0]?.laid);
  const HEAD = `#version 300 es
precision highp float;
uniform vec4 look; uniform vec4 screen; uniform vec3 middle; uniform mat4 place; uniform float reach;
vec4 seen(vec3 at) {
  vec3 p = (place * vec4(at, 1.0)).xyz - middle;
  float u = p.x * look.x - p.y * look.y, w = p.x * look.y + p.y * look.x;
  return vec4((u + middle.x - screen.x) * screen.z, (w * look.z + p.z * look.w + middle.y - screen.y) * screen.w, (w * look.w - p.z * look.z) / reach, 1.0);
}`;
  // A ring of corners: which end, across and along the way. Triangles of the top, then of the sides: each corner with
  // 0 for the top's, 1 for a side's upper one, 2 for a lower one.
  const RING = [[0, 1, 0], [0, 0, -1], [0, -1, 0], [1, -1, 0], [1, 0, 1], [1, 1, 0]];
  const TOP = [1, 2, 3, 4].flatMap((k) => [[0, 0], [k, 0], [k + 1, 0]]);
  const SIDES = RING.flatMap((_, k) => { const n = (k + 1) % 6; return [[k, 1], [k, 2], [n, 1], [n, 1], [k, 2], [n, 2]]; });
  const BEADS = `${HEAD}
uniform highp sampler2D support, corners, nodes, inks, axes, wides; uniform float height, ghost; uniform int first, count, cut;
out vec3 colour;
vec3 tilted(vec3 v, vec3 n) { return v - (n + vec3(0.0, 0.0, 1.0)) * (dot(n, v) + v.z) / (1.0 + n.z) + 2.0 * n * v.z; }
vec3 upright(vec3 v, vec3 n) { return v - (n + vec3(0.0, 0.0, 1.0)) * (dot(n, v) + v.z) / (1.0 + n.z) + vec3(0.0, 0.0, 2.0 * dot(n, v)); }
ivec2 spot(int k) { return ivec2(k % ${WIDE}, k / ${WIDE}); }
void main() {
  int own = gl_InstanceID * ${BATCH} + gl_VertexID / ${CORNERS}, number = gl_VertexID % ${CORNERS};
  // The last first: what is laid on top hides the rest.
  own = count - 1 - own;
  int k = first + own;
  vec4 ink = texelFetch(inks, spot(max(k, 0)), 0);
  bool later = own >= cut;
  if (own < 0 || ink.a == 0.0 || (later && ghost == 0.0)) { gl_Position = vec4(2.0, 2.0, 2.0, 1.0); return; }
  vec4 corner = texelFetch(corners, ivec2(number, 0), 0);
  bool side = corner.w > 0.5, top = corner.w < 1.5;
  vec4 from = texelFetch(nodes, spot(k), 0), to = texelFetch(nodes, spot(k + 1), 0), at = corner.x > 0.5 ? to : from;
  vec3 n = ${tilts ? "normalize(texelFetch(axes, spot(corner.x > 0.5 ? k + 1 : k), 0).xyz)" : "vec3(0.0, 0.0, 1.0)"};
  vec3 way = ${tilts ? "upright(to.xyz - from.xyz, n)" : "to.xyz - from.xyz"};
  vec2 along = length(way.xy) > 1e-4 ? normalize(way.xy) : vec2(cos(at.w), sin(at.w));
  vec2 u = corner.y * vec2(-along.y, along.x) + corner.z * along;
  float c = cos(at.w), s = sin(at.w);
  float angle = atan(u.y * c - u.x * s, u.x * c + u.y * s);
  vec2 local = texelFetch(support, ivec2(int(mod(angle / 6.283185307 * ${SUPPORT}.0 + ${SUPPORT}.5, ${SUPPORT}.0)), 0), 0).xy${narrows ? " * texelFetch(wides, spot(k), 0).x" : ""};
  vec2 edge = vec2(local.x * c - local.y * s, local.x * s + local.y * c);
  float high = ink.a * 255.0 * ${HEIGHT_UNIT} * height, slope = 0.35;
  vec3 apart = vec3(edge - (top ? slope * high * u : vec2(0.0)), top ? 0.0 : -high);
  vec3 look3 = side ? normalize(vec3(u, slope)) : vec3(0.0, 0.0, 1.0);
  ${tilts ? "apart = tilted(apart, n); look3 = tilted(look3, n);" : ""}
  vec3 r = mat3(place) * look3;
  vec2 flat2 = vec2(r.x * look.x - r.y * look.y, r.x * look.y + r.y * look.x);
  vec3 eye = vec3(flat2.x, flat2.y * look.z + r.z * look.w, -(flat2.y * look.w - r.z * look.z));
  float light = 0.5 + 0.5 * max(dot(eye, normalize(vec3(-0.35, 0.55, 0.75))), 0.0);
  light *= top ? 1.0 : 0.72;
  colour = (later ? mix(ink.rgb, vec3(0.93), 0.85) : ink.rgb) * light;
  gl_Position = seen(at.xyz + apart);
}`;
  const PLAIN = `#version 300 es
precision mediump float; in vec3 colour; out vec4 ink; void main() { ink = vec4(colour, 1.0); }`;
  const LINES = `${HEAD}
uniform vec3 tint; layout(location=0) in vec3 at; out vec3 colour;
void main() { colour = tint; gl_Position = seen(at); }`;
  let sharp = 1, app, beads, lines, support, corners, built = null;
  // Begins when it is first looked at: compiling takes a moment.
  function works() {
    if (app === undefined) { app = null; start(); }
    return Boolean(app);
  }
  function renderer(gl) {
    if (!gl) return "none";
    const info = gl.getExtension("WEBGL_debug_renderer_info"), name = gl.getParameter(info ? info.UNMASKED_RENDERER_WEBGL : gl.RENDERER);
    gl.getExtension("WEBGL_lose_context")?.loseContext();
    return name;
  }
  function start() {
    try {
      stats.renderer = renderer(document.createElement("canvas").getContext("webgl2"));
      // A processor that draws has no time for smooth edges and every pixel.
      const soft = /swiftshader|llvmpipe|software|basic render/i.test(stats.renderer), smooth = View.ratio() < 2 && !soft;
      sharp = soft ? 0.6 : 1;
      const gl = $("deep").getContext("webgl2", { antialias: smooth, alpha: false, powerPreference: "high-performance" });
      if (gl && data.nozzle?.length) {
        app = PicoGL.createApp(gl).clearColor(1, 1, 1, 1).enable(PicoGL.DEPTH_TEST);
        beads = app.createProgram(BEADS, PLAIN); lines = app.createProgram(LINES, PLAIN);
        corners = texture(new Float32Array([...TOP, ...SIDES].flatMap(([k, face]) => [...RING[k], face])), PicoGL.RGBA32F, CORNERS);
        support = texture(Sweep.support(SUPPORT), PicoGL.RG32F, SUPPORT);
      }
    } catch (problem) { app = null; stats.renderer = String(problem); }
  }
  // Rows of texels, as many as there are values for.
  function texture(values, internalFormat, wide = WIDE) {
    const rows = Math.max(1, Math.ceil(values.length / (internalFormat === PicoGL.RG32F ? 2 : 4) / wide));
    return app.createTexture2D(values, wide, rows, { internalFormat, minFilter: PicoGL.NEAREST, magFilter: PicoGL.NEAREST });
  }
  // Room for so many texels of four values and one more.
  const room = (count) => 4 * WIDE * Math.ceil((count + 1) / WIDE);
  // The nodes of a layer's path: a turn is divided; the segment of each, or -1 where nothing is laid from it on.
  function nodesOf(l) {
    if (l.nodes) return l.nodes;
    const p = l.path, at = [], segment = [], axis = [], travel = [];
    for (let k = 0; k < p.count; k++) {
      const prints = Job.prints(p.what[k]), before = k > 0 && Job.prints(p.what[k - 1]);
      if (p.what[k] === Job.TRAVEL && k + 1 < p.count) travel.push(p.x[k], p.y[k], p.z[k], p.x[k + 1], p.y[k + 1], p.z[k + 1]);
      if (!prints && !before) continue;
      const parts = prints ? Math.max(1, Math.ceil(Math.abs(p.heading[k + 1] - p.heading[k]) / TURN)) : 1;
      for (let i = 0; i < parts; i++) {
        const share = i / parts, of = (column) => share ? column[k] + share * (column[k + 1] - column[k]) : column[k];
        at.push(of(p.x), of(p.y), of(p.z), of(p.heading)); segment.push(prints ? k : -1);
        if (tilts) axis.push(...p.axis.map(of), 0);
      }
    }
    return (l.nodes = { at: Float32Array.from(at), segment: Int32Array.from(segment), axis: Float32Array.from(axis), travel: Float32Array.from(travel), wide: narrows ? Float32Array.from(segment, (k) => (k < 0 ? 1 : p.wide[k])) : null });
  }
  // Every layer of the job, or so many of them that the nodes stay below their limit.
  function chosen() {
    const all = Job.stack, count = all.reduce((sum, entry) => sum + nodesOf(Job.layer(entry.page)).segment.length, 0);
    const every = Math.ceil(count / NODES_MAX);
    stats.layers = all.length; stats.left = every > 1 ? `Every ${every}th layer of the stack is drawn.` : "";
    return all.filter((_, k) => k % every === 0);
  }
  function build() {
    const entries = chosen(), places = [];
    let nodes = 0, ways = 0;
    for (const entry of entries) {
      const of = nodesOf(Job.layer(entry.page));
      places.push({ ...entry, node: nodes, way: ways, nodes: of.segment.length, ways: of.travel.length / 3 });
      nodes += of.segment.length; ways += of.travel.length / 3;
    }
    const at = new Float32Array(room(nodes)), axis = tilts ? new Float32Array(room(nodes)) : null, wide = narrows ? new Float32Array(room(nodes)) : null, travel = new Float32Array(3 * Math.max(ways, 2));
    let below = null;
    for (const entry of places) {
      const of = nodesOf(Job.layer(entry.page)), top = View.box(Job.layer(entry.page))[2][1];
      at.set(of.at, 4 * entry.node); axis?.set(of.axis, 4 * entry.node); wide && of.wide.forEach((share, k) => { wide[4 * (entry.node + k)] = share; }); travel.set(of.travel, 3 * entry.way);
      const step = below === null ? (data.bed_mm ? top - data.bed_mm[0][2] : data.bead_mm) : top - below;
      entry.height = step > 0.02 && step < 2.5 * data.bead_mm && places.length > 1 ? step : data.bead_mm;
      below = top;
    }
    const path = app.createVertexArray().vertexAttributeBuffer(0, app.createVertexBuffer(PicoGL.FLOAT, 3, travel));
    stats.whole = nodes;
    built = { places, nodes, at: texture(at, PicoGL.RGBA32F), axis: axis && texture(axis, PicoGL.RGBA32F), wide: wide && texture(wide, PicoGL.RGBA32F), key: null, ink: null, bed: bed(),
      travel: app.createDrawCall(lines, path).primitive(PicoGL.LINES).uniform("tint", [0.6, 0.17, 0.17]) };
  }
  function bed() {
    const at = [], line = (...ends) => at.push(...ends);
    if (!data.bed_mm) return null;
    const [[x0, y0, z], [x1, y1]] = data.bed_mm;
    for (let x = Math.ceil(x0 / 10) * 10; x <= x1; x += 10) line(x, y0, z, x, y1, z);
    for (let y = Math.ceil(y0 / 10) * 10; y <= y1; y += 10) line(x0, y, z, x1, y, z);
    line(x0, y0, z, x1, y0, z, x1, y0, z, x1, y1, z, x1, y1, z, x0, y1, z, x0, y1, z, x0, y0, z);
    const array = app.createVertexArray().vertexAttributeBuffer(0, app.createVertexBuffer(PicoGL.FLOAT, 3, new Float32Array(at)));
    return app.createDrawCall(lines, array).primitive(PicoGL.LINES).uniform("tint", [0.82, 0.86, 0.9]);
  }
  // All layers that are in the stack; the pages that they show.
  const pages = () => [...new Set(built.places.map((entry) => entry.page))].map(Job.layer);
  function paint() {
    if (built.key === Ui.colour) return;
    const ink = new Uint8Array(room(built.nodes)), all = pages();
    for (const entry of built.places) {
      const l = Job.layer(entry.page), { segment } = nodesOf(l), bin = Colours.binOf(l, Ui.colour, all), height = Math.max(1, Math.min(255, Math.round(entry.height / HEIGHT_UNIT))), known = [];
      for (let k = 0; k < segment.length; k++) {
        if (segment[k] < 0) continue;
        const number = bin(segment[k]), [r, g, b] = known[number] ||= Colours.rgb(Ui.colour, number), to = 4 * (entry.node + k);
        ink[to] = r; ink[to + 1] = g; ink[to + 2] = b; ink[to + 3] = height;
      }
    }
    built.ink?.delete();
    built.ink = texture(ink, PicoGL.RGBA8);
    built.key = Ui.colour;
    built.beads = app.createDrawCall(beads).texture("support", support).texture("corners", corners).texture("nodes", built.at).texture("inks", built.ink);
    if (tilts) built.beads.texture("axes", built.axis);
    if (narrows) built.beads.texture("wides", built.wide);
  }
  // The layers from the lower end of the slider to the current one.
  function entries() {
    if (!built) build();
    const { places } = built, [low, high] = ends();
    const shown = places.filter((entry) => entry.number >= low && entry.number <= high);
    return shown.length ? shown : places.slice(0, 1);
  }
  const ends = () => [Math.min(Ui.lowest, Ui.number), Ui.number];
  // How many segments are laid at the cursor.
  function laid(shown) {
    if (!Ui.playing && Ui.shown.future) return 2 ** 30;
    const { k } = Job.poseAt(Ui.layer, Ui.time), { segment } = nodesOf(Ui.layer), last = shown.at(-1);
    let count = 0;
    while (count < segment.length && segment[count] < k) count++;
    return last.node - shown[0].node + count;
  }
  function draw() {
    $("deep").hidden = View.flat() || !works();
    if ($("deep").hidden) return;
    const begun = performance.now();
    const shown = entries();
    paint();
    const first = shown[0], last = shown.at(-1), count = last.node + last.nodes - first.node, { yaw, pitch } = View.turn, { base } = View, g = View.onGround;
    const place = g ? [g[0][0], g[1][0], g[2][0], 0, g[0][1], g[1][1], g[2][1], 0, g[0][2], g[1][2], g[2][2], 0, g[0][3], g[1][3], g[2][3], 1] : [1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1];
    const view = (call, at = place) => call.uniform("look", [Math.cos(yaw), Math.sin(yaw), Math.cos(pitch), Math.sin(pitch)]).uniform("middle", View.middle)
      .uniform("screen", [View.x, View.y, 2 * View.scale / base.width, 2 * View.scale / base.height]).uniform("place", at).uniform("reach", 2000);
    const deep = $("deep"), [wide, high] = [base.width, base.height].map((side) => Math.round(side * sharp));
    if (deep.width !== wide || deep.height !== high) { deep.width = wide; deep.height = high; }
    app.viewport(0, 0, wide, high); app.clear();
    stats.calls = 0;
    if (Ui.shown.bed && built.bed) { view(built.bed).draw(); stats.calls++; }
    view(built.beads).uniform("height", Ui.shown.beads ? 1 : 0.02).uniform("ghost", Ui.shown.future ? 1 : 0).uniform("first", first.node).uniform("count", count).uniform("cut", laid(shown))
      .drawRanges([0, CORNERS * BATCH, Math.ceil(count / BATCH)]).draw();
    stats.calls++;
    const ways = [first.way, last.way + last.ways - first.way];
    if (Ui.shown.travel && ways[1] > 0) { view(built.travel).drawRanges(ways).draw(); stats.calls++; }
    stats.segments = count; stats.scriptMs = performance.now() - begun;
  }
  // Frames a second of a turn, each waited for: what the renderer can do; and the script of a frame that nothing else held up.
  function measure(frames) {
    const gl = $("deep").getContext("webgl2"), pixel = new Uint8Array(4), begun = performance.now(), script = [];
    for (let k = 0; k < frames; k++) { View.turn.yaw += 0.02; draw(); script.push(stats.scriptMs); gl.readPixels(0, 0, 1, 1, gl.RGBA, gl.UNSIGNED_BYTE, pixel); }
    return { ...stats, scriptMs: Math.min(...script), fps: 1000 * frames / (performance.now() - begun) };
  }
  return { get works() { return works(); }, draw, entries, pages: () => { if (!built) build(); return pages(); }, measure, forget: () => { built = null; }, stats };
})();
