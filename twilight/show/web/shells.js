// The model of all clear air, in three files: this port of twilight/clear_air/shells.py, diffuse.js and clear_air.js, by the
// names of Python, of intensity.  One wavelength is an object of its own (`Skies.at[w]`); geometry serves all.
//
//   const model = new Model(await readNpz(bytes)), air = airOf(await readNpz(more));
//   new Skies(model, air, observerKm, screen).sky(sun).light(elevations, azimuths)     // [w][row * azimuths + column] [sr^-1]

// Arrays -------------------------------------------------------------------------------------------------------------
const range = (n, f = (i) => i) => Array.from({ length: n }, (_, i) => f(i));
const steps = (from, to, step) => range(Math.ceil((to - from) / step - 1e-9), (i) => from + i * step);
const linspace = (from, to, n) => range(n, (i) => from + (to - from) * i / (n - 1));
const geomspace = (from, to, n) => linspace(Math.log(from), Math.log(to), n).map(Math.exp);
const sum = (values) => values.reduce((a, b) => a + b, 0);
const inner = (a, b) => { let out = 0; for (let i = 0; i < a.length; i++) out += a[i] * b[i]; return out; };
const cumulative = (values) => { const out = new Float64Array(values.length + 1); for (let i = 0; i < values.length; i++) out[i + 1] = out[i] + values[i]; return out; };
const within = (x, low, high) => Math.min(Math.max(x, low), high);
const nearest = (nodes, x) => nodes.reduce((best, z, i) => (Math.abs(z - x) < Math.abs(nodes[best] - x) ? i : best), 0);
const RAD = Math.PI / 180;

// The first of increasing values, between two places, that is at least x.
function searchsorted(values, x, low = 0, high = values.length) {
  while (low < high) { const middle = (low + high) >> 1; if (values[middle] < x) low = middle + 1; else high = middle; }
  return low;
}

// Linear between nodes, held beyond.
function interp(x, nodes, values) {
  const i = within(searchsorted(nodes, x) - 1, 0, nodes.length - 2), f = within((x - nodes[i]) / (nodes[i + 1] - nodes[i]), 0, 1);
  return values[i] + f * (values[i + 1] - values[i]);
}

// Files of numpy -----------------------------------------------------------------------------------------------------
const HALF = Float32Array.from({ length: 65536 }, (_, h) => { const e = (h >> 10) & 31, m = h & 1023; return (h & 32768 ? -1 : 1) * (e ? (1 + m / 1024) * 2 ** (e - 15) : m * 2 ** -24); });
const KINDS = { f2: (b) => { const h = new Uint16Array(b), out = new Float64Array(h.length); for (let i = 0; i < h.length; i++) out[i] = HALF[h[i]]; return out; },
  f4: (b) => Float64Array.from(new Float32Array(b)), f8: (b) => new Float64Array(b), i8: (b) => Float64Array.from(new BigInt64Array(b), Number) };

// { name: { shape, data } } of the arrays of numbers in an .npz, in C order; other kinds are left out.
async function readNpz(bytes) {
  const view = new DataView(bytes.buffer, bytes.byteOffset, bytes.length), out = {};
  let end = bytes.length - 22;
  while (view.getUint32(end, true) !== 0x06054b50) end--;
  for (let n = view.getUint16(end + 10, true), at = view.getUint32(end + 16, true); n > 0; n--) {
    const [method, size, from] = [view.getUint16(at + 10, true), view.getUint32(at + 20, true), view.getUint32(at + 42, true)];
    const [name, extra, comment] = [28, 30, 32].map((k) => view.getUint16(at + k, true));
    const start = from + 30 + view.getUint16(from + 26, true) + view.getUint16(from + 28, true), packed = bytes.slice(start, start + size);
    const stream = () => new Blob([packed]).stream().pipeThrough(new DecompressionStream("deflate-raw"));
    const content = method ? await new Response(stream()).arrayBuffer() : packed.buffer;
    const data = 10 + new DataView(content).getUint16(8, true), header = new TextDecoder().decode(content.slice(10, data));
    const [, kind, shape] = header.match(/'descr': '[<|]?(\w+)'.*'shape': \(([^)]*)\)/), key = new TextDecoder().decode(bytes.slice(at + 46, at + 46 + name));
    if (KINDS[kind]) out[key.replace(/\.npy$/, "")] = { shape: shape.split(",").filter((s) => s.trim()).map(Number), data: KINDS[kind](content.slice(data)) };
    at += 46 + name + extra + comment;
  }
  return out;
}

// shells.py ----------------------------------------------------------------------------------------------------------
const EARTH_RADIUS_KM = 6371;
const ALTITUDE_KM = [0, 0.02, 0.06, 0.12, 0.25, 0.45, 0.7, 1, 1.35, 1.7, ...steps(2, 15, 0.5), ...steps(15, 24, 0.25), ...steps(24, 28, 0.5), ...steps(28, 42, 1), ...steps(42, 60, 1.5), ...steps(60, 101, 1)];
const SHELLS_KM = [6, 2].reduce((boundary, highest) => boundary.flatMap((z, i) => i && z <= highest ? [0.5 * (boundary[i - 1] + z), z] : [z]), ALTITUDE_KM);   // layers up to there are halved
const SUBLAYERS = 4, PARTS = 2, STEEPEST_DEG = 0.03, RAYS_FROM_ABOVE = 90, RAYS_FROM_BELOW = 30, RAYS_AT_GROUND = 25, LEAST_APART = 0.015, LEAST_SPREAD = 0.05, MOST_DEGREE = 16;
const LOWEST_POINTS_KM = [...steps(0.5, 26, 0.5), ...steps(26, 30, 1), ...steps(30, 100, 2)];
const AIR = 0, ABSORPTION = 1, EXTINCTION = 2, LOW = 3, HIGH = 4, DARK_LOG = -700, DARK = 1e-35, DARKEST_PASSED = 1e-6;

// `Air` of an .npz of its fields: at[w] is one wavelength.
function airOf(file) {
  const { depth, aerosol_depth: kinds, moments, mixed_moments: mixed, mixed_phase: phase, log_phase: table } = file, [, layers, count] = depth.shape;
  const many = (a, n, size, w, last) => range(n, (k) => Float64Array.from({ length: size }, (_, i) => a.data[last ? (k * size + i) * count + w : (k * count + w) * size + i]));
  const at = range(count, (w) => ({
    depth: many(depth, 5, layers, w, true), aerosolDepth: many(kinds, kinds.shape[0], layers, w, true), logPhase: many(table, table.shape[0], table.shape[1], w, true),
    moments: many(moments, moments.shape[0], moments.shape[2], w), mixedMoments: many(mixed, 2, mixed.shape[2], w), mixedPhase: many(phase, 2, phase.shape[2], w),
    degree: file.degree.data[w], depolarisation: file.depolarisation.data[w], groundAlbedo: file.ground_albedo.data[w], groundRefractivity: file.ground_refractivity.data[w],
  }));
  return { at, refractivity: file.refractivity.data, radiusKm: file.radius_km.data[0] };
}

// Fraction of a phase function in its forward peak.
function peak(degree, moments) {
  const whole = Math.floor(degree), rest = degree - whole;
  return within((1 - rest) * moments[whole + 1] + rest * moments[Math.min(whole + 2, MOST_DEGREE + 1)], 0, 0.999);
}

const sublayers = (boundary, count = SUBLAYERS) => [...boundary.slice(0, -1).flatMap((z, i) => range(count, (p) => z + p / count * (boundary[i + 1] - z))), boundary.at(-1)];

// n r and n at the boundaries of parts of layers, d(n r)/d r and mean n of the parts.
function partsOf(radius, n) {
  const x = n.map((v, i) => v * radius[i]), between = range(n.length - 1);
  return { n, x, slope: between.map((i) => (x[i + 1] - x[i]) / (radius[i + 1] - radius[i])), index: between.map((i) => 0.5 * (n[i + 1] + n[i])) };
}

// Path and angle at the Earth's centre of a ray in each part from part j on, on one side of its lowest point.
function throughParts({ x, slope, index }, j, b, each) {
  let root = 0, arc = 0;
  for (let i = j; i <= slope.length; i++) {
    const beyond = Math.max(x[i], b), nextRoot = Math.sqrt(beyond * beyond - b * b), nextArc = Math.acos(Math.min(b / beyond, 1));
    if (i > j) each(i - 1, (nextRoot - root) / slope[i - 1], (nextArc - arc) * index[i - 1] / slope[i - 1]);
    [root, arc] = [nextRoot, nextArc];
  }
}

// The derivative of values by x, as numpy.gradient has it.
function gradient(y, x) {
  const last = y.length - 1, slope = (i) => (y[i + 1] - y[i]) / (x[i + 1] - x[i]);
  return range(y.length, (i) => {
    if (i === 0 || i === last) return slope(Math.min(i, last - 1));
    const before = x[i] - x[i - 1], after = x[i + 1] - x[i];
    return (after * slope(i - 1) + before * slope(i)) / (before + after);
  });
}

// Shells seen by an observer: the geometry that all wavelengths share.
class Geometry {
  constructor(refractivity, observerKm, radiusKm) {
    const own = SHELLS_KM.some((z) => Math.abs(z - observerKm) <= 1e-4);
    this.boundary = own ? SHELLS_KM : [...SHELLS_KM, observerKm].sort((a, b) => a - b);
    this.first = nearest(this.boundary, observerKm);
    const logs = Array.from(refractivity, (v) => Math.log(Math.max(v, 1e-30))), places = sublayers(this.boundary, PARTS), known = sublayers(ALTITUDE_KM);
    this.parts = partsOf(places.map((z) => radiusKm + z), places.map((z) => 1 + Math.exp(interp(z, known, logs))));
    // of each layer its middle and the one of ALTITUDE_KM that it is in
    this.middle = range(this.boundary.length - 1, (i) => 0.5 * (this.boundary[i] + this.boundary[i + 1]));
    this.layer = this.middle.map((z) => searchsorted(ALTITUDE_KM, z) - 1);
    this._beams();
  }

  // Rays from the sun to each boundary, those to boundary k from start[k] on.
  _beams() {
    const layers = this.middle.length, right = Math.PI / 2, { n, x } = this.parts, edge = x.filter((_, i) => i % PARTS === 0);
    const above = [...geomspace(STEEPEST_DEG, 90, RAYS_FROM_ABOVE).reverse().map((e) => right - e * RAD), right];
    const beside = [...linspace(0, 1, RAYS_FROM_BELOW + 1).slice(1), ...geomspace(1e-4, 0.5, RAYS_AT_GROUND).map((v) => 1 - v)];
    const fromBelow = (k) => {
      const horizon = Math.acos(edge[0] / edge[k]), lowest = LOWEST_POINTS_KM.filter((z) => z < this.boundary[k]).map((z) => Math.acos(interp(z, this.boundary, edge) / edge[k]) / horizon);
      return [...beside, ...lowest].sort((a, b) => a - b).filter((v, i, all) => v - (i && all[i - 1]) > LEAST_APART * (1 - v)).map((v) => right + horizon * v);
    };
    const zenith = [], seen = [], factors = [], rows = [];
    this.start = [0];
    this.boundary.forEach((_, k) => {
      const below = k ? fromBelow(k) : [], apparent = [...above, ...below];
      const angles = apparent.map((a, i) => {
        const b = edge[k] * Math.sin(a), path = new Float64Array(layers), down = i < above.length;
        let angle = Math.asin(Math.min(b / edge.at(-1), 1));
        throughParts(this.parts, down ? PARTS * k : 0, b, (part, s, phi) => {
          const twice = part < PARTS * k ? 2 : 1;   // layers below the point, down and up again
          path[Math.floor(part / PARTS)] += twice * s;
          angle += twice * phi;
        });
        rows.push(path);
        return angle;
      });
      gradient(angles, apparent).forEach((spread, i) => {
        const sine = Math.sin(apparent[i]);
        factors.push(sine < 1e-6 ? 0 : Math.log(n[PARTS * k] ** 2 * sine / Math.max(Math.sin(angles[i]), 1e-9) / Math.max(spread, LEAST_SPREAD)));
      });
      zenith.push(...angles);
      seen.push(...apparent);
      this.start.push(zenith.length);
    });
    Object.assign(this, { zenith, apparent: seen, logFactor: factors, path: rows });
  }

  // ln of what a screen { altitude, transmission, from, to } lets pass of each ray, by its least altitude on the way that
  // counts.
  passed({ altitude, transmission, from, to }) {
    const { x } = this.parts, places = sublayers(this.boundary, PARTS);
    let top = 0;
    const highest = x.map((v) => (top = Math.max(top, v)));
    return this.boundary.flatMap((_, k) => this.apparent.slice(this.start[k], this.start[k + 1]).map((angle) => {
      const end = x[PARTS * k], [near, far] = [from, to].map((s) => end * Math.cos(angle) + s), along = near > 0 ? near : Math.min(far, 0);
      return Math.log(Math.max(interp(interp(Math.hypot(end * Math.sin(angle), along), highest, places), altitude, transmission), DARKEST_PASSED));
    }));
  }

  // The ray before a true solar zenith angle at boundary k, the part of the way to the next, and how far the angle is
  // from the shadow of the ground [rad].
  place(k, zenith) {
    const i = within(searchsorted(this.zenith, zenith, this.start[k], this.start[k + 1]) - 1, this.start[k], this.start[k + 1] - 2);
    return [i, within((zenith - this.zenith[i]) / (this.zenith[i + 1] - this.zenith[i]), 0, 1), this.zenith[this.start[k + 1] - 1] - zenith];
  }

  apparentElevation(sun) {
    const own = [this.start[this.first], this.start[this.first + 1]], zenith = this.zenith.slice(...own), lift = zenith.map((z, i) => z - this.apparent[own[0] + i]);
    return sun + interp((90 - sun) * RAD, zenith, lift) / RAD;
  }

  // Lines of sight through the layers above the observer: way [km] in each, angle at the Earth's centre at each boundary.
  line(elevations) {
    const j = PARTS * this.first;
    return elevations.map((e) => {
      const path = new Float64Array(this.middle.length - this.first), angle = new Float64Array(path.length);
      throughParts(this.parts, j, this.parts.x[j] * Math.cos(e * RAD), (part, s, phi) => {
        path[Math.floor((part - j) / PARTS)] += s;
        angle[Math.floor((part - j) / PARTS)] += phi;
      });
      return { path, angle: cumulative(angle) };
    });
  }
}

// True solar zenith angle [rad] where a line of sight has gone through an angle [rad] at the Earth's centre.
const zenithAt = (sun, angle, azimuth) => Math.acos(within(Math.cos(angle) * Math.sin(sun * RAD) + Math.sin(angle) * Math.cos(azimuth * RAD) * Math.cos(sun * RAD), -1, 1));

// ln of the sunbeam over F0 at a `place`, by the depths of all beams.
const logSunbeam = (depth, [i, f]) => Math.max((depth[i] - depth[i + 1]) * f - depth[i], DARK_LOG);

// Mean of an exponential between two points, from its logarithms at both, and 1e-3 apart their mean.
const logMean = (a, b) => (Math.abs(a - b) < 1e-3 ? 0.5 * (Math.exp(a) + Math.exp(b)) : (Math.exp(a) - Math.exp(b)) / (a - b));

// Fraction of a segment outside a shadow, from the distances of its ends to the edge.
const litFraction = (a, b) => { const high = Math.max(a, b); return high > 0 ? within(high / Math.max(Math.abs(a - b), 1e-12), 0, 1) : 0; };
