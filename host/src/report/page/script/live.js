
// The bar of a page that is served while the job prints. It asks its own server some times a second.
(() => {
  const $ = (id) => document.getElementById(id);
  const EVERY_MS = 300, PATIENCE_MS = 3000;
  const told = { feed: null, flow: null };
  let over = false;
  const ask = (path, options) => fetch(path, { cache: "no-store", signal: AbortSignal.timeout(PATIENCE_MS), ...options });
  async function order(text) {
    try {
      const answer = await ask("order", { method: "POST", body: text });
      $("live-said").textContent = answer.ok ? `asked: ${text}` : await answer.text() || `refused (${answer.status})`;
    } catch { $("live-said").textContent = `${text}: no answer; is the command still running?`; }
  }
  document.querySelectorAll("[data-order]").forEach((button) => button.addEventListener("click", () => {
    if (!button.dataset.ask || window.confirm(button.dataset.ask)) order(button.dataset.order);
  }));
  document.querySelectorAll("[data-percent]").forEach((button) => button.addEventListener("click", () => {
    const box = $(button.dataset.percent);
    if (box.reportValidity()) order(`${button.dataset.name} ${Math.round(box.valueAsNumber)}`);
  }));
  function tiles(rows) {
    $("live-tiles").replaceChildren(...rows.map(([what, value]) => {
      const tile = document.createElement("div");
      for (const [tag, text] of [["dt", what], ["dd", value]]) {
        const element = document.createElement(tag);
        element.textContent = text;
        tile.append(element);
      }
      return tile;
    }));
  }
  const minutes = (s) => `${Math.floor(s / 60)}:${String(Math.floor(s % 60)).padStart(2, "0")}`;
  // The boxes follow the board, until somebody types.
  function follow(id, name, value) {
    if (told[name] !== value && document.activeElement !== $(id)) $(id).value = value;
    told[name] = value;
  }
  function show({ print: p, age_s: age }) {
    const stale = age > 2 && !p.ended;
    over = Boolean(p.ended);
    $("live-state").textContent = p.ended ? `ended: ${p.ended}` : !p.line_open ? "the line is lost; waiting" : !p.state ? "waiting for the board"
      : p.state + (stale ? `, nothing new for ${Math.round(age)} s` : "");
    document.querySelectorAll("#live button, #live input[type=number]").forEach((b) => { b.disabled = over; });
    if (p.said) $("live-said").textContent = p.said;
    if (p.log_problem && $("live-log").hidden) {
      $("live-log").textContent = p.log_problem;
      $("live-log").hidden = false;
    }
    if (!p.state) return;
    $("live-done").value = p.done;
    follow("live-feed", "feed", p.override_percent);
    follow("live-flow", "flow", p.flow_percent);
    const heaters = p.heaters.map((h, k) => [["Hot end", "Bed"][k] || `Heater ${k}`,
      (h.celsius === null ? "no sensor" : `${h.celsius.toFixed(1)} °C`) + (h.target_celsius ? ` of ${h.target_celsius.toFixed(0)}` : "")]);
    tiles([["Done", `${(100 * p.done).toFixed(1)} %`], ["Left", p.left_s === null ? "resting" : minutes(p.left_s)], ["Layer", `${p.layer + 1} of ${p.layers}`],
      ["Tip", `${p.tip_mm_s.toFixed(0)} mm/s`], ["Feed, flow", `${p.override_percent}, ${p.flow_percent} %${p.flow_correction ? ` × ${p.flow_correction.toFixed(3)}` : ""}`], ...heaters]);
    if ($("live-follow").checked) document.dispatchEvent(new CustomEvent("print-at", { detail: { layer: p.layer, time_s: p.done * Job.data.duration_s } }));
  }
  async function look() {
    try { show(await (await ask("status")).json()); }
    catch { $("live-state").textContent = "no answer; has the command ended?"; }
    if (!over) setTimeout(look, EVERY_MS);
  }
  // Whoever takes the slider looks elsewhere.
  for (const id of ["time", "layer"]) $(id).addEventListener("input", () => { $("live-follow").checked = false; });
  look();
})();
