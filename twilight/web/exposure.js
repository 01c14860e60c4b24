// How bright the picture is: by hand, as a camera meters it, or as an eye that adapts.
const GREY = 0.18, GREY_LUMINANCE = 0.125;   // ISO 2720: luminance that EV100 = 0 puts on middle grey
const METER = { width: 64, height: 36 };
let adapted = null, metered = { ev: 0, mean: 1 };

const exposedAt = (ev) => GREY / (GREY_LUMINANCE * 2 ** ev);

// Log-mean and highlights of the picture as io.view.view_exposure_ev100 takes them, every pixel alike, without the sun's disc.
const DARKEST_SHARE = 1e-3;
function meter(aspect, sun, sky) {
  const into = target("meter", METER.width, METER.height);
  drawLight(into, aspect, sun, sky, false);
  const light = readLight(into), all = [];
  for (let i = 0; i < light.length; i += 4) if (light[i + 3] >= 0 && light[i + 1] > 0) all.push(light[i + 1]);
  if (!all.length) return { ev: 0, mean: 1e-6 };
  all.sort((a, b) => a - b);
  // what is darker than a share of the highlights counts as space
  const found = all.filter((v) => v >= DARKEST_SHARE * all[Math.floor(0.995 * (all.length - 1))]);
  const mean = Math.exp(found.reduce((sum, v) => sum + Math.log(v), 0) / found.length);
  const bright = found[Math.min(Math.ceil(0.995 * found.length), found.length - 1)];
  return { ev: Math.log2(Math.max(mean, bright / 16) / (1.5 * GREY_LUMINANCE)), mean };
}

// What 1 cd m^-2 becomes; seconds: since the last picture, null: at once.
function exposureNow(aspect, sun, sky, seconds) {
  if (state.exposure === "manual") { adapted = null; return exposedAt(state.ev); }
  metered = meter(aspect, sun, sky);
  // an eye adapts over some 0.3 s to more light and seconds to less, a camera over a second, both in the logarithm
  const goal = metered.ev;
  if (adapted === null || seconds === null || !state.running) adapted = goal;
  else {
    const time = state.exposure === "camera" ? 1 : goal > adapted ? 0.3 : 3;
    adapted += (goal - adapted) * (1 - Math.exp(-seconds / time));
  }
  if (state.exposure === "camera") return exposedAt(adapted - state.bias);
  // what is dark looks dark: per factor of ten below 1000 cd m^-2 the picture loses a sixth of its brightness
  const stops = Math.log2(1000 / GREY_LUMINANCE) - adapted;
  return exposedAt(adapted - state.bias + 0.08 * Math.max(0, stops));
}
