// Starts all, and draws when something has changed.
let shot = null;         // what the last picture was drawn with: exposureNow
let lastTime = null;

function draw(seconds) {
  const ratio = Math.min(devicePixelRatio || 1, 2);
  const width = Math.max(1, Math.round(canvas.clientWidth * ratio)), height = Math.max(1, Math.round(canvas.clientHeight * ratio));
  if (canvas.width !== width || canvas.height !== height) [canvas.width, canvas.height] = [width, height];
  const aspect = width / height, sun = theSun(), sky = HEAD.kind === "field" ? celestial(sun) : null;
  if (HEAD.kind === "air" && followSliders() && shot) return;   // its answer is drawn
  uploadTables(sun);
  drawLight(target("light", width, height), aspect, sun, sky, true);
  shot = exposureNow(aspect, sun, sky, seconds);
  drawStars(aspect, sky, shot.exposed);
  drawTone(shot);
  drawOverlay(sun);
  drawProbe();
  byId("status").textContent = statusOf(sun);
  byId("command").textContent = renderCommand();
}

function statusOf(sun) {
  const words = [];
  if (state.mode === "clock") words.push(`sun ${minus(sun.elevation.toFixed(2))}°, ${azimuthText(sun.azimuth)}`);
  const moon = state.mode === "clock" && theMoon(sun);
  if (moon) words.push(`moon ${minus(moon.elevation.toFixed(2))}°, ${azimuthText(moon.azimuth)}`);
  if (sun.shown !== sun.elevation && !inSpace()) words.push(`light of ${minus(sun.shown.toFixed(0))}°`);
  words.push(shot.adapted === undefined ? `EV100 ${minus(shot.ev.toFixed(1))}` : `eye adapted to ${shot.adapted.toPrecision(2)} cd m⁻²`);
  if (HEAD.kind === "air") words.push(`radiance ±${(100 * sliders.error).toFixed(1)} %`, `model ${HEAD.air.model}`);
  return words.join(", ");
}

function frame(now) {
  const seconds = lastTime === null ? 0 : Math.min((now - lastTime) / 1000, 0.5);
  lastTime = now;
  if (state.running && state.mode === "clock") {
    let hours = state.hours + seconds * state.speed / 3600;
    if (hours >= 24) {
      const next = new Date(Date.parse(`${state.date}T00:00:00Z`) + 864e5);
      hours -= 24;
      state.date = next.toISOString().slice(0, 10);
    }
    set({ hours });
  }
  if (wanted) {
    wanted = false;
    draw(seconds);
  }
  requestAnimationFrame(frame);
}

// When the tables were read and the first picture drawn, in ms since the page began to load.
const loaded = {};

async function start() {
  try {
    await readTables();
    if (HEAD.kind === "air") await startAir();
    loaded.tables_ms = performance.now();
    startGpu();
    if (HEAD.start.azimuth === undefined) state.azimuth = theSun().azimuth;
    // an upright screen shows as much sky in its height as a wide one does across
    if (innerHeight > innerWidth && HEAD.start.fov === undefined) Object.assign(state, UPRIGHT, HEAD.start);
    clampState();
    startControls();
    showState();
    draw(null);
    gl.finish();
    loaded.drawn_ms = performance.now();
    wanted = false;
    byId("message").hidden = true;
    byId("panel").hidden = false;
    window.twilight = {
      state, head: HEAD, loaded, sliders, set, draw: () => draw(null), sunAt, daysSince, theSun, theMoon: () => theMoon(theSun()), command: renderCommand,
      light: () => ({ width: canvas.width, height: canvas.height, values: readLight(targets.light) }),
      at: (elevation, azimuth) => { draw(null); return figuresOf(direction(elevation, azimuth)); },
      horizon: () => (1 - placeOf(direction(horizonOf(0), state.azimuth), canvas.width / canvas.height)[1]) / 2,
    };
    canvas.addEventListener("webglcontextlost", (e) => { e.preventDefault(); byId("message").textContent = "the graphics card was reset: reload the page"; byId("message").hidden = false; });
    requestAnimationFrame(frame);
  } catch (error) {
    byId("message").textContent = `This sky cannot be shown: ${error.message}`;
    throw error;
  }
}
start();
