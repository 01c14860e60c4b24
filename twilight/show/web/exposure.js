// How bright the picture is: by hand, as a camera meters it, or as an eye that adapts.  Numbers: HEAD.tone (tones.py).
const TONE = HEAD.tone;
const METER = { width: 64, height: 36 };
const exposedAt = (ev) => TONE.middle_grey / (TONE.grey_luminance * 2 ** ev);
const mean = (values) => values.reduce((sum, v) => sum + v, 0) / values.length;

// Exposure value as io.view.view_exposure_ev100 has it, and log-means of photopic and scotopic luminance as the tone
// "eye" takes them, of the picture without discs.
function meter(aspect, sun, sky) {
  const into = target("meter", METER.width, METER.height);
  drawLight(into, aspect, sun, sky, false);
  const light = readLight(into), all = [], rods = [];
  for (let i = 0; i < light.length; i += 4) {
    if (light[i + 3] < 0) continue;
    if (light[i + 1] > 0) all.push(light[i + 1]);
    if (light[i + 3] > 0) rods.push(Math.log(light[i + 3]));
  }
  if (!all.length) return { ev: Math.log2(1e-6 / (TONE.metered_greys * TONE.grey_luminance)), photopic: 1e-6, scotopic: 1e-6 };
  all.sort((a, b) => a - b);
  const last = all.length - 1, logs = all.map(Math.log);
  const found = all.findIndex((v) => v >= TONE.darkest_fraction * all[Math.floor(TONE.highlight_quantile * last)]);
  const lit = all.slice(found), grey = Math.exp(mean(logs.slice(found)));
  const bright = lit[Math.min(Math.ceil(TONE.highlight_quantile * lit.length), lit.length - 1)];
  return {
    ev: Math.log2(Math.max(grey, bright / TONE.highlights_over_mean) / (TONE.metered_greys * TONE.grey_luminance)),
    photopic: Math.exp(mean(logs)),
    scotopic: rods.length ? Math.exp(mean(rods)) : 1e-6,
  };
}

let metered = null;    // exposure value of the last picture, followed over a second while the clock runs
let adapted = null;    // logarithm of the luminance that an eye is adapted to

// What the picture is drawn with.  seconds: since the last picture, null: at once.
function exposureNow(aspect, sun, sky, seconds) {
  const now = state.tone === "eye" || state.exposure === "metered" ? meter(aspect, sun, sky) : null;
  const follows = seconds !== null && state.running;
  if (state.tone === "eye") {
    metered = null;
    adapted = adaptedTo(Math.log(now.photopic), follows ? seconds * state.speed : null);
    const day = Math.exp(adapted), night = day * now.scotopic / now.photopic;
    const exposed = Math.exp(eyeTable("display_gain", day, night)) / TONE.display_white;
    return { exposed, adapted: day, sigma: TONE.sigma_cycles / acuityOf(day) / (pixelAngle(aspect) / DEG) };
  }
  adapted = null;
  if (!now) { metered = null; return { exposed: exposedAt(state.ev), ev: state.ev, sigma: 0 }; }
  metered = metered === null || !follows ? now.ev : metered + (now.ev - metered) * (1 - Math.exp(-seconds));
  const ev = metered - state.bias;
  return { exposed: exposedAt(ev), ev, sigma: 0 };
}

// tone/eye.py, adapt: at once to more light, to less with the pigments' time, in the sky's seconds.
function adaptedTo(light, seconds) {
  if (adapted === null || seconds === null || light > adapted) return light;
  const fraction = clamp((adapted - Math.log(TONE.night)) / Math.log(TONE.day / TONE.night), 0, 1);
  const slow = TONE.rods_s * (TONE.cones_s / TONE.rods_s) ** fraction;
  return adapted + (light - adapted) * (1 - Math.exp(-seconds / slow));
}

const alongAxis = (value, [from, to], nodes) => clamp((value - from) / (to - from), 0, 1) * (nodes - 1);

// Linear in a table over the logarithms of photopic and of scotopic over photopic luminance.
function eyeTable(name, photopic, scotopic) {
  const [n, m] = HEAD.arrays[name].shape, table = tables[name];
  const y = alongAxis(Math.log10(photopic), TONE.log10_photopic, n), x = alongAxis(Math.log10(scotopic / photopic), TONE.log10_ratio, m);
  const i = Math.min(Math.floor(y), n - 2), j = Math.min(Math.floor(x), m - 2), v = y - i, u = x - j;
  const row = (k) => (1 - u) * table[k * m + j] + u * table[k * m + j + 1];
  return (1 - v) * row(i) + v * row(i + 1);
}

function acuityOf(photopic) {
  const y = alongAxis(Math.log10(photopic), TONE.log10_photopic, tables.acuity.length), i = Math.min(Math.floor(y), tables.acuity.length - 2);
  return tables.acuity[i] + (y - i) * (tables.acuity[i + 1] - tables.acuity[i]);
}
