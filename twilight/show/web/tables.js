// The arrays of the page, and what is left of the tables under one sun at one altitude.
const tables = {};

function bytesOf(text) {
  const out = new Uint8Array(text.length);
  for (let i = 0; i < text.length; i++) out[i] = text.charCodeAt(i);
  return out;
}

const READERS = {
  log16: (buffer, a) => logarithms(new Uint8Array(buffer, a.start, a.bytes), a),
  float32: (buffer, a) => new Float32Array(buffer, a.start, a.bytes / 4),
  file: (buffer, a) => new Uint8Array(buffer.slice(a.start, a.start + a.bytes)),
};

async function readTables() {
  const text = document.getElementById("data").textContent.trim();
  const bytes = Uint8Array.fromBase64 ? Uint8Array.fromBase64(text) : bytesOf(atob(text));
  const stream = new Blob([bytes]).stream().pipeThrough(new DecompressionStream("gzip"));
  const buffer = await new Response(stream).arrayBuffer();
  for (const [name, a] of Object.entries(HEAD.arrays)) {
    tables[name] = READERS[a.kind](buffer, a);
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

// Four of nodes about x and their weights, as skyStencil of table.glsl has them: for suns, and for clicks.
function stencil(nodes, x) {
  const last = nodes.length - 1;
  if (last === 0) return [[0, 1]];
  x = clamp(x, nodes[0], nodes[last]);
  let low = 0, high = last;
  while (high - low > 1) {
    const middle = (low + high) >> 1;
    if (nodes[middle] <= x) low = middle; else high = middle;
  }
  const at = [-1, 0, 1, 2].map((k) => clamp(low + k, 0, last)), n = at.map((i) => nodes[i]), h = n[2] - n[1];
  const b = n[1] > n[0] ? h / (n[1] - n[0]) : 0, a = n[3] > n[2] ? h / (n[3] - n[2]) : 0, l = 1 / (1 + b), r = 1 / (1 + a);
  const u = (x - n[1]) / h, p = u * (1 - u) ** 2, q = u * u * (1 - u), inner = p * l - q * r, left = p * (1 - l) * b, right = q * (1 - r) * a;
  const w = [-left, (1 + 2 * u) * (1 - u) ** 2 - inner + left, u * u * (3 - 2 * u) + inner + right, -right];
  return at.map((i, k) => [i, w[k]]).filter(([, v]) => v !== 0);
}

// The same of suns: below the first one logarithms fall on straight.
function sunStencil(nodes, sun) {
  const below = nodes.length > 1 ? (nodes[0] - sun) / (nodes[1] - nodes[0]) : 0;
  return below > 0 ? [[0, 1 + below], [1, -below]] : stencil(nodes, sun);
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

// The same of the top of the haze: at the horizon for an observer below it, linear in the root of the height above it.
function hazeOf(field) {
  const { haze_deg: at, haze_top_km: top } = HEAD.fields[field], [[i], next] = altitudeWeights(state.altitude), least = horizonOf(field) + HEAD.least_haze_deg;
  if (!next) return Math.max(at[i], least);
  const j = next[0], root = (z) => Math.sqrt(Math.max(0, z - top)), low = root(HEAD.altitude_km[i]);
  const t = clamp((root(state.altitude) - low) / Math.max(root(HEAD.altitude_km[j]) - low, 1e-9), 0, 1);
  return Math.max(at[i] + (at[j] - at[i]) * t, least);
}

// Nodes of the rows [deg] of a field's tables at the altitude of the state: at fractions of ground, haze and sky.
function rowsOf(field) {
  if (HEAD.kind !== "field") return HEAD.row_deg;
  if (inSpace()) return HEAD.fields[field].space_row;
  const edges = [-90, horizonOf(field), hazeOf(field), 90];
  return HEAD.rise.flatMap((part, k) => part.map((f) => edges[k] * (1 - f) + edges[k + 1] * f));
}

// What refraction lifts a sun [deg].
function liftOf(field, elevation) {
  const { lift_deg: lifts, sun_node_deg: nodes } = HEAD.fields[field];
  return altitudeWeights(state.altitude).reduce((sum, [i, w]) => sum + w * sunStencil(nodes, elevation).reduce((s, [j, v]) => s + v * lifts[i][j], 0), 0);
}

// One array of shape (C, altitude, sun, ...rest) under a sun, its suns being `nodes`: (rest, C), channels last.
function underSun(name, elevation, nodes) {
  const values = tables[name], [c, nz, ns, ...rest] = HEAD.arrays[name].shape;
  const size = rest.reduce((p, n) => p * n, 1), out = new Float32Array(size * c);
  const suns = sunStencil(nodes, elevation), altitudes = nz > 1 ? altitudeWeights(state.altitude) : [[0, 1]];
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

// Rows by altitude ("beam0_2" ...) at the altitude of the state; null: there are none.
function atAltitude(name, field) {
  if (inSpace()) return tables[`${name}${field}_space`];
  let out = null;
  for (const [i, w] of altitudeWeights(state.altitude)) {
    const values = tables[`${name}${field}_${i}`];
    if (!values) return null;
    out ??= new Float32Array(values.length);
    for (let p = 0; p < values.length; p++) out[p] += w * values[p];
  }
  return out;
}
