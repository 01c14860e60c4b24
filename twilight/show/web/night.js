// Means over the sky that the scattered part of the night's light needs, as night.night_radiance takes them.
const STARLIGHT_PLANE = 250 / 0.75, DEPTH = -Math.log(1 - 30 / 250);
const starlight = (d, sky) => STARLIGHT_PLANE * (1 - Math.exp(-DEPTH / Math.max(Math.abs(dot(d, sky.galacticPole)), 1e-6)));

function zodiacal(d, sky) {
  const [n, m] = HEAD.arrays.zodiacal.shape, table = tables.zodiacal;
  const latitude = Math.abs(Math.asin(clamp(dot(d, sky.eclipticPole), -1, 1)));
  const longitude = Math.abs(Math.atan2(dot(d, cross(sky.eclipticPole, sky.eclipticSun)), dot(d, sky.eclipticSun)));
  const x = longitude / Math.PI * (n - 1), y = latitude / (Math.PI / 2) * (m - 1);
  const i = Math.min(Math.floor(x), n - 2), j = Math.min(Math.floor(y), m - 2), u = x - i, v = y - j;
  const at = (a, b) => table[a * m + b];
  return Math.exp((1 - u) * ((1 - v) * at(i, j) + v * at(i, j + 1)) + u * ((1 - v) * at(i + 1, j) + v * at(i + 1, j + 1)));
}

// Weighted by cosine and solid angle.
function nightMeans(sky) {
  let stars = 0, zodiac = 0, sum = 0;
  for (let i = 0; i < 15; i++) {
    const e = 3 + 6 * i, w = Math.sin(2 * e * DEG);
    for (let k = 0; k < 12; k++) {
      const d = direction(e, 30 * k);
      stars += w * starlight(d, sky);
      zodiac += w * zodiacal(d, sky);
      sum += w;
    }
  }
  return [stars / sum, zodiac / sum];
}

// Spectrum of the night in a direction [W m^-2 nm^-1 sr^-1]; u: place among the nodes of elevation, 0 to 1.
function nightSpectrum(field, up, u, d, sky) {
  const bands = HEAD.fields[field].wavelength_nm.length, mean = nightMeans(sky);
  const out = new Array(bands).fill(0);
  if (!up) {
    const rows = atAltitude("night_ground_spectrum", field);
    for (let b = 0; b < bands; b++) out[b] = rows[b] + rows[bands + b] * mean[0] + rows[2 * bands + b] * mean[1];
    return out;
  }
  const rows = atAltitude("night_spectrum", field), factors = [1, starlight(d, sky), mean[0], zodiacal(d, sky), mean[1]];
  const node = Math.round(u * 255);
  for (let b = 0; b < bands; b++) factors.forEach((f, k) => { out[b] += f * rows[(k * 256 + node) * bands + b]; });
  return out;
}
