// The panel, the pointer and the keys.
const clampState = () => {
  state.fov = clamp(state.fov, 0.2, widestFov());
  state.elevation = clamp(state.elevation, -90, 90);
  state.azimuth = around(state.azimuth, 360);
  state.altitude = clamp(state.altitude, HEAD.altitude_km[0], HEAD.highest_km);
  state.sun = clamp(state.sun, lowestSun(), HEAD.sun_deg[1]);
  for (const name of AMOUNTS) state[name] = clamp(state[name], 0, HEAD.air?.most[name] ?? 0);
  state.hours = clamp(state.hours, 0, 24);
  state.moonElevation = clamp(state.moonElevation, -18, 90);
  state.moonAzimuth = clamp(state.moonAzimuth, -180, 180);
};

// Sliders whose position is not the value itself.  Half of the sun's is twilight and the low sun.
const SUN_SCALE_DEG = 4;
const SCALES = {
  sun: { to: (e) => Math.asinh(e / SUN_SCALE_DEG), from: (p) => SUN_SCALE_DEG * Math.sinh(p) },
  fov: { to: Math.log10, from: (p) => 10 ** p },
  aerosol: { to: Math.sqrt, from: (p) => p * p }, stratosphere: { to: Math.sqrt, from: (p) => p * p },
  altitude: { to: (z) => Math.sqrt(z - HEAD.altitude_km[0]), from: (p) => p * p + HEAD.altitude_km[0] },
};
const positionOf = (name, value) => (SCALES[name] ? SCALES[name].to(value) : value);
const valueAt = (name, position) => (SCALES[name] ? SCALES[name].from(position) : position);

// A fine and a coarse step of every slider: arrow keys, Page Up and Page Down.  `move`: where a step leads from a value.
const byPosition = (name) => (value, step) => valueAt(name, positionOf(name, value) + step);
const STEPS = {
  sun: { fine: 0.1, coarse: 1 }, hours: { fine: 1 / 60, coarse: 0.5 }, split: { fine: 0.01, coarse: 0.1 },
  ev: { fine: 0.1, coarse: 1 }, bias: { fine: 0.1, coarse: 1 }, moonElevation: { fine: 0.1, coarse: 1 }, moonAzimuth: { fine: 1, coarse: 10 },
  aerosol: { fine: 0.01, coarse: 0.1, move: byPosition("aerosol") }, stratosphere: { fine: 0.005, coarse: 0.05, move: byPosition("stratosphere") }, ozone: { fine: 1, coarse: 20 }, albedo: { fine: 0.01, coarse: 0.1 },
  fov: { fine: 0.01, coarse: 0.1, move: byPosition("fov") }, altitude: { fine: 0.1, coarse: 1, move: byPosition("altitude") },
};
// Values in steps of a tenth or a minute stay on them.
const ROUND = { sun: 1e3, moonElevation: 1e3, moonAzimuth: 1e3, hours: 3600, ev: 1e3, bias: 1e3, split: 1e3 };
function stepBy(name, step) {
  const value = (STEPS[name].move ?? ((v, d) => v + d))(state[name], step);
  set({ [name]: ROUND[name] ? Math.round(value * ROUND[name]) / ROUND[name] : value });
}

const minus = (text) => text.replace("-", "\u2212");
const SHOWN = {
  sun: (v) => minus(`${v.toFixed(2)}°`), hours: (v) => clockText(v).slice(0, 5), fov: (v) => `${v < 10 ? v.toFixed(1) : v.toFixed(0)}°`,
  moonElevation: (v) => minus(`${v.toFixed(1)}°`), moonAzimuth: (v) => minus(`${v.toFixed(0)}°`),
  aerosol: (v) => v.toFixed(3), stratosphere: (v) => v.toFixed(4), ozone: (v) => `${v.toFixed(0)} DU`, albedo: (v) => v.toFixed(2),
  altitude: (v) => `${v.toFixed(v < 10 ? 2 : 0)} km`, split: (v) => `${Math.round(100 * v)} %`, ev: (v) => minus(v.toFixed(2)), bias: (v) => minus(`${v.toFixed(2)} EV`),
};
const CONTROLS = [...AMOUNTS, "mode", "sun", "latitude", "longitude", "zone", "hours", "speed", "path", "date", "projection", "fov", "altitude",
  "split", "labels", "tone", "exposure", "ev", "bias", "disc", "night", "stars", "moon", "moonElevation", "moonAzimuth"];

function set(changes) {
  const horizon = horizonOf(0);
  Object.assign(state, changes);
  clampState();
  // whoever rises keeps the horizon where it is in the picture
  if ("altitude" in changes && !("elevation" in changes)) state.elevation = clamp(state.elevation + horizonOf(0) - horizon, -90, 90);
  showState();
  redraw();
}

function showState() {
  byId("sun").min = positionOf("sun", lowestSun());
  for (const name of CONTROLS) {
    const c = byId(name), value = state[name];
    if (c.type === "checkbox") c.checked = value;
    else if (c !== document.activeElement || c.type === "range") c.value = positionOf(name, value);
    if (!SHOWN[name]) continue;
    (c.parentElement.querySelector("output")).textContent = SHOWN[name](value);
    c.setAttribute("aria-valuetext", SHOWN[name](value));
  }
  byId("run").textContent = state.running ? "stop the clock" : "run the clock";
  document.querySelectorAll("[data-mode]").forEach((e) => { e.hidden = HEAD.kind === "sky" || e.dataset.mode !== state.mode; });
  byId("moon-place").hidden = !state.moon || state.mode === "clock" || HEAD.kind !== "field";
  document.querySelectorAll("[data-tone]").forEach((e) => {
    e.hidden = e.dataset.tone !== state.tone || (e.dataset.exposure !== undefined && e.dataset.exposure !== state.exposure);
  });
  byId("divider").style.left = `${100 * state.split}%`;
}

// Whether all controls are open, or the sun's alone.
const SMALL = matchMedia("(max-width: 699px), (max-height: 520px)");
function open(all) {
  byId("more").hidden = !all;
  byId("panel").classList.toggle("open", all);
  const toggle = byId("toggle");
  toggle.textContent = all ? "\u2715" : "\u2630";
  toggle.setAttribute("aria-expanded", all);
  toggle.setAttribute("aria-label", all ? "Fewer controls" : "All controls");
}

// The sun's slider is coloured like the sky, from night to day.
function paintSun() {
  const stops = [[-18, "#0a0e22"], [-12, "#131d40"], [-6, "#2c4a86"], [-2, "#b4694f"], [0, "#f0a05a"], [5, "#e6d3ae"], [15, "#9cc6ea"], [90, "#5e9be0"]];
  const low = +byId("sun").min, span = +byId("sun").max - low;
  const at = stops.map(([e, colour]) => `${colour} ${clamp(100 * (positionOf("sun", e) - low) / span, 0, 100).toFixed(1)}%`);
  byId("sun").style.setProperty("--track", `linear-gradient(to right, ${at.join(", ")})`);
}

function startControls() {
  byId("names").textContent = HEAD.names.join(" | ");
  document.querySelectorAll("[data-for]").forEach((e) => { e.hidden = !e.dataset.for.split(" ").includes(HEAD.kind); });
  document.querySelector('[data-if="altitudes"]').hidden = HEAD.highest_km === HEAD.altitude_km[0];
  document.querySelector('[data-if="two"]').hidden = byId("divider").hidden = HEAD.fields.length < 2;
  byId("copy").hidden = byId("command").hidden = !HEAD.scenes.length;
  [byId("sun").min, byId("sun").max] = HEAD.sun_deg.map((e) => positionOf("sun", e));
  byId("altitude").min = 0;
  byId("altitude").max = positionOf("altitude", HEAD.highest_km);
  startSliders();
  paintSun();
  for (const name of CONTROLS) {
    const c = byId(name);
    c.addEventListener("input", () => {
      if (c.type === "checkbox") set({ [name]: c.checked });
      else if (c.type === "range") set({ [name]: valueAt(name, +c.value) });
      else if (c.type === "number" || name === "speed") { if (c.value !== "" && c.checkValidity()) set({ [name]: +c.value }); }
      else if (c.value !== "" && c.checkValidity()) set({ [name]: c.value });
      if (name === "mode") set({ running: false, azimuth: theSun().azimuth });
    });
    if (c.type === "range") c.addEventListener("keydown", (e) => stepWithKeys(e, name, c));
  }
  document.querySelectorAll("[data-step]").forEach((button) => {
    const [name, step] = button.dataset.step.split(" ");
    button.onclick = () => stepBy(name, +step);
  });
  byId("run").onclick = () => set({ running: !state.running });
  byId("all").onclick = () => set({ projection: "fisheye", fov: 180, elevation: 90 });
  byId("to-sun").onclick = () => { const s = theSun(); set({ azimuth: s.azimuth, elevation: clamp(s.elevation, -5, 90) }); };
  byId("toggle").onclick = () => open(byId("more").hidden);
  byId("probe-close").onclick = () => { probed = null; byId("probe").hidden = true; canvas.focus(); };
  byId("screenshot").onclick = saveScreenshot;
  byId("copy").onclick = () => copyText(renderCommand());
  addEventListener("resize", redraw);
  open(!SMALL.matches);
  SMALL.addEventListener("change", () => open(!SMALL.matches));
  startPointer();
  startKeys();
}

function stepWithKeys(e, name, slider) {
  if (e.ctrlKey || e.metaKey || e.altKey) return;
  const { fine, coarse } = STEPS[name];
  const step = { ArrowLeft: -fine, ArrowDown: -fine, ArrowRight: fine, ArrowUp: fine, PageDown: -coarse, PageUp: coarse }[e.key];
  if (step !== undefined) stepBy(name, step);
  else if (e.key === "Home") set({ [name]: valueAt(name, +slider.min) });
  else if (e.key === "End") set({ [name]: valueAt(name, +slider.max) });
  else return;
  e.preventDefault();
}

function startPointer() {
  const down = new Map();
  let moved = 0, spread = 0;
  canvas.addEventListener("pointerdown", (e) => {
    canvas.setPointerCapture(e.pointerId);
    down.set(e.pointerId, [e.clientX, e.clientY]);
    moved = spread = 0;
  });
  canvas.addEventListener("pointermove", (e) => {
    const before = down.get(e.pointerId);
    if (!before) return;
    down.set(e.pointerId, [e.clientX, e.clientY]);
    if (down.size === 2) {
      const [a, b] = [...down.values()], now = Math.hypot(a[0] - b[0], a[1] - b[1]);
      if (spread) set({ fov: state.fov * spread / now });
      spread = now;
      moved = 99;
      return;
    }
    const dx = e.clientX - before[0], dy = e.clientY - before[1];
    moved += Math.abs(dx) + Math.abs(dy);
    if (moved < 4) return;
    const step = pixelAngle(canvas.width / canvas.height) * (canvas.width / canvas.clientWidth) / DEG;
    const level = state.projection === "latlong" ? 1 : Math.max(0.15, Math.cos(state.elevation * DEG));
    set({ azimuth: state.azimuth - dx * step / level, elevation: state.elevation + dy * step });
  });
  const up = (e) => {
    if (down.delete(e.pointerId) && e.type === "pointerup" && moved < 4 && down.size === 0) {
      const box = canvas.getBoundingClientRect();
      probe(2 * (e.clientX - box.left) / box.width - 1, 1 - 2 * (e.clientY - box.top) / box.height);
    }
    spread = 0;
  };
  canvas.addEventListener("pointerup", up);
  canvas.addEventListener("pointercancel", up);
  canvas.addEventListener("wheel", (e) => { e.preventDefault(); set({ fov: state.fov * 2 ** (e.deltaY / 600) }); }, { passive: false });
  const line = byId("divider");
  line.addEventListener("pointerdown", (e) => line.setPointerCapture(e.pointerId));
  line.addEventListener("pointermove", (e) => { if (e.buttons) set({ split: clamp(e.clientX / canvas.clientWidth, 0, 1) }); });
}

// Keys of the sky: while it has the focus.
function startKeys() {
  const step = () => state.fov / 12;
  const keys = {
    ArrowLeft: () => set({ azimuth: state.azimuth - step() }), ArrowRight: () => set({ azimuth: state.azimuth + step() }),
    ArrowUp: () => set({ elevation: state.elevation + step() }), ArrowDown: () => set({ elevation: state.elevation - step() }),
    "+": () => set({ fov: state.fov / 1.25 }), "-": () => set({ fov: state.fov * 1.25 }),
    ",": () => moveSun(-1, "fine"), ".": () => moveSun(1, "fine"), PageDown: () => moveSun(-1, "coarse"), PageUp: () => moveSun(1, "coarse"),
    " ": () => { if (state.mode === "clock") set({ running: !state.running }); },
    Enter: () => probe(0, 0),
    a: () => byId("all").click(), g: () => byId("to-sun").click(), h: () => { byId("panel").hidden = !byId("panel").hidden; }, s: saveScreenshot,
    c: () => byId("copy").click(),
  };
  canvas.addEventListener("keydown", (e) => {
    if (e.ctrlKey || e.metaKey || e.altKey) return;
    const act = keys[e.key];
    if (act) { e.preventDefault(); act(); }
  });
}

// The sun's elevation, or the clock.
function moveSun(sign, size) {
  const name = state.mode === "clock" ? "hours" : "sun";
  if (HEAD.kind !== "sky") stepBy(name, sign * STEPS[name][size]);
}

function saveScreenshot() {
  draw(null);
  canvas.toBlob((blob) => {
    const link = document.createElement("a");
    link.href = URL.createObjectURL(blob);
    link.download = `${HEAD.names.join("-")}_${theSun().elevation.toFixed(2)}.png`.replace(/[^\w.+-]+/g, "-");
    link.click();
    setTimeout(() => URL.revokeObjectURL(link.href), 1000);
  }, "image/png");
}

// The clipboard of pages from disk may be closed; then a selection does it.
async function copyText(text) {
  try {
    await navigator.clipboard.writeText(text);
  } catch {
    const range = document.createRange();
    range.selectNodeContents(byId("command"));
    getSelection().removeAllRanges();
    getSelection().addRange(range);
    document.execCommand("copy");
  }
}
