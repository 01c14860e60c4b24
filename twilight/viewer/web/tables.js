// The arrays of the page, and what is left of the tables under one sun at one altitude.
const tables = {};

function bytesOf(text) {
  const out = new Uint8Array(text.length);
  for (let i = 0; i < text.length; i++) out[i] = text.charCodeAt(i);
  return out;
}

async function readTables() {
  const text = document.getElementById("data").textContent.trim();
  const bytes = Uint8Array.fromBase64 ? Uint8Array.fromBase64(text) : bytesOf(atob(text));
  const stream = new Blob([bytes]).stream().pipeThrough(new DecompressionStream("gzip"));
  const buffer = await new Response(stream).arrayBuffer();
  for (const [name, a] of Object.entries(HEAD.arrays)) {
    tables[name] = a.kind === "log16" ? logarithms(new Uint8Array(buffer, a.start, a.bytes), a) : new Float32Array(buffer, a.start, a.bytes / 4);
  }
  document.getElementById("data").remove();
}

// High bytes, then low bytes, of differences along the last axis modulo 65536.
function logarithms(bytes, a) {
  const n = bytes.length / 2, last = a.shape[a.shape.length - 1], out = new Float32Array(n);
  for (let start = 0; start < n; start += last) {
    let value = 0;
    for (let i = start; i < start + last; i++) {
      value = (value + 256 * bytes[i] + bytes[n + i]) & 65535;
      out[i] = a.low + a.step * value;
    }
  }
  return out;
}

const cubicWeights = (t) => {
  const t2 = t * t, t3 = t2 * t;
  return [-0.5 * t + t2 - 0.5 * t3, 1 - 2.5 * t2 + 1.5 * t3, 0.5 * t + 2 * t2 - 1.5 * t3, 0.5 * (t3 - t2)];
};

// Place of a sun among n suns.
function sunPlace(elevation, n) {
  if (n === 1) return 0;
  const [low, centre, width] = HEAD.sun_axis;
  const t = (e) => Math.asinh((e - centre) / width);
  return clamp((t(elevation) - t(low)) / (t(90) - t(low)), 0, 1) * (n - 1);
}

// Suns and their weights for a cubic; beyond the ends the table goes on as a straight line.
function sunWeights(place, n) {
  if (n === 1) return [[0, 1]];
  const i = clamp(Math.floor(place), 0, n - 2), w = cubicWeights(place - i);
  const weights = new Map();
  const add = (j, v) => weights.set(j, (weights.get(j) ?? 0) + v);
  w.forEach((v, k) => {
    const j = i - 1 + k;
    if (j < 0) { add(0, 2 * v); add(1, -v); } else if (j > n - 1) { add(n - 1, 2 * v); add(n - 2, -v); } else add(j, v);
  });
  return [...weights];
}

// Altitudes and their weights: linear in the square root of the height above the ground.
function altitudeWeights(altitude) {
  const root = (a) => Math.sqrt(a - HEAD.ground_km), z = HEAD.altitude_km.map(root), n = z.length;
  if (n === 1) return [[0, 1]];
  const x = root(clamp(altitude, HEAD.altitude_km[0], HEAD.altitude_km[n - 1]));
  let i = 0;
  while (i < n - 2 && x > z[i + 1]) i++;
  const t = (x - z[i]) / (z[i + 1] - z[i]);
  return [[i, 1 - t], [i + 1, t]].filter(([, w]) => w > 0);
}

// Apparent elevation of the horizon [deg].
const horizonOf = (field) => inSpace() ? -Math.acos(HEAD.fields[field].grazing_km / orbitRadius(field)) / DEG : altitudeWeights(state.altitude).reduce((sum, [i, w]) => sum + w * HEAD.fields[field].horizon_deg[i], 0);

// The same of the top of the haze: 0 for an observer below it, linear in the square root of the height above it; and what
// the rows have for it between two altitudes, which are mixed like the horizon.
function hazeOf(field) {
  const { haze_deg: at, haze_top_km: top } = HEAD.fields[field], [[i, w], next] = altitudeWeights(state.altitude);
  if (inSpace() || !next) return [at[i], at[i]];
  const j = next[0], root = (z) => Math.sqrt(Math.max(0, z - top)), low = root(HEAD.altitude_km[i]);
  const t = clamp((root(state.altitude) - low) / Math.max(root(HEAD.altitude_km[j]) - low, 1e-9), 0, 1);
  return [at[i] + (at[j] - at[i]) * t, at[i] * w + at[j] * (1 - w)];
}

// Place among the rows of the sky of a line at x from the horizon by the top of the haze to `high`. As in sky.frag.
const NEAR = 0.03;
function rowAbove(x, low, [haze, rowsHaze], high, power, steps, rows) {
  if (x < haze) return Math.asin(Math.sqrt(clamp((x - low) / Math.max(haze - low, 1e-9), 0, 1))) / (Math.PI / 2) * steps;
  const far = rowsHaze + NEAR * (high - rowsHaze);
  const fraction = x < far ? NEAR * (x - haze) / (far - haze) : (x - rowsHaze) / (high - rowsHaze);
  return steps + clamp(fraction, 0, 1) ** (1 / power) * (rows - 1);
}

// One array of shape (C, altitude, sun, ...rest) under a sun: (rest, C), channels last.
function underSun(name, elevation) {
  const values = tables[name], [c, nz, ns, ...rest] = HEAD.arrays[name].shape;
  const size = rest.reduce((p, n) => p * n, 1), out = new Float32Array(size * c);
  const suns = sunWeights(sunPlace(elevation, ns), ns), altitudes = nz > 1 ? altitudeWeights(state.altitude) : [[0, 1]];
  for (let k = 0; k < c; k++) {
    for (const [i, wz] of altitudes) {
      for (const [j, ws] of suns) {
        const start = ((k * nz + i) * ns + j) * size, w = wz * ws;
        for (let p = 0; p < size; p++) out[p * c + k] += w * values[start + p];
      }
    }
  }
  return out;
}

// Rows by altitude ("beam0_2" ...) at the altitude of the state.
function atAltitude(name, field) {
  if (inSpace()) return tables[`${name}${field}_space`];
  let out = null;
  for (const [i, w] of altitudeWeights(state.altitude)) {
    const values = tables[`${name}${field}_${i}`];
    out ??= new Float32Array(values.length);
    for (let p = 0; p < values.length; p++) out[p] += w * values[p];
  }
  return out;
}
