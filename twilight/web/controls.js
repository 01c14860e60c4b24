// The panel, the pointer and the keys.
const clampState = () => {
  state.fov = clamp(state.fov, 0.2, widestFov());
  state.elevation = clamp(state.elevation, -90, 90);
  state.azimuth = around(state.azimuth, 360);
    state.altitude = clamp(state.altitude, HEAD.altitude_km[0], HEAD.highest_km);
  state.sun = clamp(state.sun, lowestSun(), HEAD.sun_deg[1]);
  state.hours = clamp(state.hours, 0, 24);
};

// Sliders whose position is not the value itself.
const SCALES = {
  fov: { to: Math.log10, from: (p) => 10 ** p },
  altitude: { to: (z) => Math.sqrt(z - HEAD.altitude_km[0]), from: (p) => p * p + HEAD.altitude_km[0] },
};
const SHOWN = {
  sun: (v) => `${v.toFixed(2)}°`, hours: (v) => clockText(v).slice(0, 5), fov: (v) => `${v < 10 ? v.toFixed(1) : v.toFixed(0)}°`,
  altitude: (v) => `${v.toFixed(v < 10 ? 2 : 0)} km`, split: (v) => `${Math.round(100 * v)} %`, ev: (v) => v.toFixed(2), bias: (v) => `${v.toFixed(2)} EV`,
};
const CONTROLS = ["mode", "sun", "latitude", "longitude", "zone", "hours", "speed", "path", "date", "projection", "fov", "altitude",
  "split", "labels", "exposure", "ev", "bias", "disc", "night", "stars"];

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
  byId("sun").min = lowestSun();
  for (const name of CONTROLS) {
    const c = byId(name), value = state[name];
    if (c.type === "checkbox") c.checked = value;
    else if (c !== document.activeElement || c.type === "range") c.value = SCALES[name] ? SCALES[name].to(value) : value;
    const out = c.parentElement.querySelector("output");
    if (out) out.textContent = SHOWN[name](value);
  }
  byId("run").textContent = state.running ? "stop" : "start";
  document.querySelectorAll("[data-mode]").forEach((e) => { e.hidden = e.dataset.mode !== state.mode; });
  document.querySelectorAll("[data-exposure]").forEach((e) => { e.hidden = !e.dataset.exposure.includes(state.exposure); });
  byId("divider").style.left = `${100 * state.split}%`;
}

function startControls() {
  byId("names").textContent = HEAD.names.join(" | ");
  document.querySelectorAll("[data-for]").forEach((e) => { e.hidden = e.dataset.for !== HEAD.kind; });
  document.querySelector('[data-if="altitudes"]').hidden = HEAD.highest_km === HEAD.altitude_km[0];
  document.querySelector('[data-if="two"]').hidden = byId("divider").hidden = HEAD.fields.length < 2;
  [byId("sun").min, byId("sun").max] = HEAD.sun_deg;
  byId("altitude").min = 0;
  byId("altitude").max = SCALES.altitude.to(HEAD.highest_km);
  for (const name of CONTROLS) {
    const c = byId(name);
    c.addEventListener("input", () => {
      if (c.type === "checkbox") set({ [name]: c.checked });
      else if (c.type === "range") set({ [name]: SCALES[name] ? SCALES[name].from(+c.value) : +c.value });
      else if (c.type === "number" || name === "speed") { if (c.value !== "" && c.checkValidity()) set({ [name]: +c.value }); }
      else if (c.value !== "" && c.checkValidity()) set({ [name]: c.value });
      if (name === "mode") set({ running: false, azimuth: theSun().azimuth });
    });
  }
  byId("run").onclick = () => set({ running: !state.running });
  byId("all").onclick = () => set({ projection: "fisheye", fov: 180, elevation: 90 });
  byId("to-sun").onclick = () => { const s = theSun(); set({ azimuth: s.azimuth, elevation: clamp(s.elevation, -5, 90) }); };
  byId("toggle").onclick = () => { byId("panel").hidden = !byId("panel").hidden; };
  byId("probe-close").onclick = () => { probed = null; byId("probe").hidden = true; };
  byId("screenshot").onclick = saveScreenshot;
  byId("copy").onclick = () => copyText(renderCommand());
  addEventListener("resize", redraw);
  startPointer();
  startKeys();
}

function startPointer() {
  const down = new Map();
  let moved = 0, spread = 0;
  canvas.addEventListener("pointerdown", (e) => {
    canvas.setPointerCapture(e.pointerId);
    canvas.focus();
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

function startKeys() {
  const step = () => state.fov / 12;
  const keys = {
    ArrowLeft: () => set({ azimuth: state.azimuth - step() }), ArrowRight: () => set({ azimuth: state.azimuth + step() }),
    ArrowUp: () => set({ elevation: state.elevation + step() }), ArrowDown: () => set({ elevation: state.elevation - step() }),
    "+": () => set({ fov: state.fov / 1.25 }), "-": () => set({ fov: state.fov * 1.25 }),
    ",": () => moveSun(-1), ".": () => moveSun(1),
    " ": () => { if (state.mode === "clock") set({ running: !state.running }); },
    a: () => byId("all").click(), g: () => byId("to-sun").click(), h: () => byId("toggle").click(), s: saveScreenshot,
    c: () => byId("copy").click(),
  };
  addEventListener("keydown", (e) => {
    if (e.ctrlKey || e.metaKey || e.altKey || e.target.closest?.("input, select, button")) return;
    const act = keys[e.key];
    if (act) { e.preventDefault(); act(); }
  });
}

// A quarter of a degree, or a minute.
function moveSun(sign) {
  if (HEAD.kind === "sky") return;
  if (state.mode === "clock") set({ hours: state.hours + sign / 60 });
  else set({ sun: state.sun + 0.25 * sign });
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
