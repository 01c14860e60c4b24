// The model of all clear air: a port of twilight/transport/shells.py, diffuse.py and clear_air.py, by their names, of
// intensity without a screen.  One wavelength is an object of its own (`airAt`, `Skies.at[w]`); geometry serves all.
//
//   const model = new Model(await readNpz(bytes)), air = airOf(await readNpz(more));
//   new Skies(model, air, observerKm).sky(sun).light(elevations, azimuths)     // [w][row * azimuths + column] [sr^-1]

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
const ALTITUDE_KM = [0, 0.02, 0.06, 0.12, 0.25, 0.45, 0.7, 1, 1.35, 1.7, ...steps(2, 6, 0.5), ...steps(6, 16, 1), 16, 17.5, 19, 20.5, 22, 24, 26, 28, 30, 33, ...steps(36, 81, 3), 82, 86, 90, 95, 100];
const SUBLAYERS = 4, STEEPEST_DEG = 0.03, RAYS_FROM_ABOVE = 90, RAYS_FROM_BELOW = 100, LEAST_SPREAD = 0.05, MOST_DEGREE = 16;
const AIR = 0, ABSORPTION = 1, EXTINCTION = 2, LOW = 3, HIGH = 4, DARK_LOG = -700, DARK = 1e-35;

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

const sublayers = (boundary) => [...boundary.slice(0, -1).flatMap((z, i) => range(SUBLAYERS, (p) => z + p / SUBLAYERS * (boundary[i + 1] - z))), boundary.at(-1)];

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
    const own = ALTITUDE_KM.some((z) => Math.abs(z - observerKm) <= 1e-4);
    this.boundary = own ? ALTITUDE_KM : [...ALTITUDE_KM, observerKm].sort((a, b) => a - b);
    this.first = nearest(this.boundary, observerKm);
    const logs = Array.from(refractivity, (v) => Math.log(Math.max(v, 1e-30))), places = sublayers(this.boundary), known = sublayers(ALTITUDE_KM);
    this.parts = partsOf(places.map((z) => radiusKm + z), own ? Array.from(refractivity, (v) => 1 + v) : places.map((z) => 1 + Math.exp(interp(z, known, logs))));
    // of each layer its middle and the one of ALTITUDE_KM that it is in
    this.middle = range(this.boundary.length - 1, (i) => 0.5 * (this.boundary[i] + this.boundary[i + 1]));
    this.layer = this.middle.map((z) => searchsorted(ALTITUDE_KM, z) - 1);
    this._beams();
  }

  // Rays from the sun to each boundary, those to boundary k from start[k] on.
  _beams() {
    const layers = this.middle.length, right = Math.PI / 2, m = RAYS_FROM_BELOW / 4, { n, x } = this.parts, edge = x.filter((_, i) => i % SUBLAYERS === 0);
    const above = [...geomspace(STEEPEST_DEG, 90, RAYS_FROM_ABOVE).reverse().map((e) => right - e * RAD), right];
    const beside = [...new Set([...linspace(0, 1, 3 * m + 1).slice(1), ...geomspace(1e-4, 0.5, m).map((v) => 1 - v)])].sort((a, b) => a - b);
    const zenith = [], seen = [], factors = [], rows = [];
    this.start = [0];
    this.boundary.forEach((_, k) => {
      const below = k ? beside.map((v) => right + Math.acos(edge[0] / edge[k]) * v) : [], apparent = [...above, ...below];
      const angles = apparent.map((a, i) => {
        const b = edge[k] * Math.sin(a), path = new Float64Array(layers), down = i < above.length;
        let angle = Math.asin(Math.min(b / edge.at(-1), 1));
        throughParts(this.parts, down ? SUBLAYERS * k : 0, b, (part, s, phi) => {
          const twice = part < SUBLAYERS * k ? 2 : 1;   // layers below the point, down and up again
          path[Math.floor(part / SUBLAYERS)] += twice * s;
          angle += twice * phi;
        });
        rows.push(path);
        return angle;
      });
      gradient(angles, apparent).forEach((spread, i) => {
        const sine = Math.sin(apparent[i]);
        factors.push(sine < 1e-6 ? 0 : Math.log(n[SUBLAYERS * k] ** 2 * sine / Math.max(Math.sin(angles[i]), 1e-9) / Math.max(spread, LEAST_SPREAD)));
      });
      zenith.push(...angles);
      seen.push(...apparent);
      this.start.push(zenith.length);
    });
    Object.assign(this, { zenith, apparent: seen, logFactor: factors, path: rows });
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
    const j = SUBLAYERS * this.first;
    return elevations.map((e) => {
      const path = new Float64Array(this.middle.length - this.first), angle = new Float64Array(path.length);
      throughParts(this.parts, j, this.parts.x[j] * Math.cos(e * RAD), (part, s, phi) => {
        path[Math.floor((part - j) / SUBLAYERS)] += s;
        angle[Math.floor((part - j) / SUBLAYERS)] += phi;
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

// diffuse.py ---------------------------------------------------------------------------------------------------------
const BOUNDARY_KM = [0, 0.45, 1.35, 2, 3, 4.5, 6, 8, 10, 13, 16, 19, 24, 30, 39, 60, 100];
const ZENITH_DEG = [0, 25, 45, 60, 70, 76, 80, 83, 85.5, 87.5, ...steps(89, 113, 1), 115, 118, 122];
const POLAR = 7, POWER = 4, AZIMUTHS = 6, CUT = 8, DEGREE = 4, SCATTERINGS = 8, MOST_RATIO = 0.95, DECAY_DEG = 88, DECAY = 1.1, LEAST_PHASE = 0.02;
const FINE_DEG = 0.25, OPAQUE = 60, SCALE_HEIGHT_KM = 8, REFRACTIVITY = 2.8e-4, LONGEST = 0.1, LAYERS = BOUNDARY_KM.length, ANGLES = ZENITH_DEG.length;
const HARMONICS = (DEGREE + 1) * (DEGREE + 2) / 2, MOMENTS = HARMONICS + 3;

// Nodes and weights of Gauss's rule from 0 to 1 over the root of this power.
function gauss(count, power = 1) {
  const out = range(count, (k) => {
    let x = -Math.cos(Math.PI * (k + 0.75) / (count + 0.5)), slope = 1;
    for (let step = 0; step < 8; step++) {
      const p = legendre(x, count);
      slope = count * (x * p[count] - p[count - 1]) / (x * x - 1);
      x -= p[count] / slope;
    }
    return [0.5 * (x + 1), 1 / ((1 - x * x) * slope * slope)];
  });
  return [out.map(([root]) => root ** power), out.map(([root, w]) => power * root ** (power - 1) * w)];
}

// Legendre polynomials up to a degree.
function legendre(x, degree) {
  const p = [1, x];
  for (let n = 1; n < degree; n++) p.push(((2 * n + 1) * x * p[n] - n * p[n - 1]) / (n + 1));
  return p;
}

// Layer, length [km] and angle at the Earth's centre to the middle [rad] of a ray's parts; layer null: from the ground.
function segmentsOf(cosine, layer) {
  const places = sublayers(BOUNDARY_KM), parts = partsOf(places.map((z) => EARTH_RADIUS_KM + z), places.map((z) => 1 + REFRACTIVITY * Math.exp(-z / SCALE_HEIGHT_KM)));
  const first = layer === null ? 0 : SUBLAYERS * layer + SUBLAYERS / 2, b = parts.x[first] * Math.sqrt(1 - cosine * cosine), path = [], angle = [];
  throughParts(parts, 0, b, (i, s, phi) => { path[i] = s; angle[i] = phi; });
  const hit = cosine < 0 && b < parts.x[0], up = steps(first, path.length, 1), down = range(first, (i) => first - 1 - i).filter((i) => path[i] > 0);
  const passed = cosine >= 0 ? up : hit ? down : [...down, ...down.toReversed(), ...up], groups = [];
  let total = 0, spanned = 0;
  for (const i of passed) {
    const own = Math.floor(i / SUBLAYERS);
    if (groups.at(-1)?.layer !== own || spanned + angle[i] > LONGEST) { groups.push({ layer: own, length: 0, moment: 0 }); spanned = 0; }
    groups.at(-1).length += path[i];
    groups.at(-1).moment += path[i] * (total + 0.5 * angle[i]);
    spanned += angle[i];
    total += angle[i];
  }
  return [...groups.map((g) => [g.layer, g.length, g.moment / g.length]), ...(hit ? [[LAYERS - 1, 0, total]] : [])];
}

// Index of the zenith angle before one, and the part of the way to the next.
function betweenZeniths(degrees) {
  const d = Math.min(degrees, ZENITH_DEG[ANGLES - 1]);
  let i = ANGLES - 2;
  while (i > 0 && ZENITH_DEG[i] > d) i--;
  return [i, (d - ZENITH_DEG[i]) / (ZENITH_DEG[i + 1] - ZENITH_DEG[i])];
}

const logReference = (zenith) => { const d = Math.max(zenith - DECAY_DEG, 0); return -(d < 8 ? DECAY * d * d / 16 : DECAY * (d - 4)); };

// sqrt((2 or 1) (n - m)! / (n + m)!)
const SCALE = range(DEGREE + 1, (n) => range(n + 1, (m) => Math.sqrt((m ? 2 : 1) / range(2 * m, (i) => n - m + 1 + i).reduce((a, b) => a * b, 1))));

// Harmonics of a direction by its parts upwards and towards the sun, degree by degree, into out.
function harmonics(up, aside, out) {
  const y = Math.sqrt(Math.max(1 - up * up - aside * aside, 0));
  let cosine = 1, sine = 0, odd = 1;   // sin^m cos(m azimuth), sin^m sin(m azimuth), (2 m - 1)!!
  for (let m = 0; m <= DEGREE; m++) {
    for (let n = m, before = 0, now = odd; n <= DEGREE; n++) {
      out[n * (n + 1) / 2 + m] = SCALE[n][m] * now * cosine;
      [before, now] = [now, ((2 * n + 1) * up * now - (n + m) * before) / (n - m + 1)];
    }
    [cosine, sine] = [cosine * aside - sine * y, sine * aside + cosine * y];
    odd *= 2 * m + 1;
  }
}

// The rays between scatterings: segments n of rays r, seen under zenith angles c of the sun and azimuths a.
let made = null;
function rays() {
  if (made) return made;
  const [up, w] = gauss(POLAR, POWER), [aboveGround, of] = gauss(2 * POLAR), polar = 2 * POLAR, segment = { ray: [], layer: [], length: [], angle: [] }, cosine = [], weight = [], first = [];
  for (let k = 0; k < LAYERS; k++) for (let i = 0; i < polar; i++) {
    const ground = k === LAYERS - 1, side = i < POLAR ? POLAR - 1 - i : i - POLAR;
    cosine.push(ground ? aboveGround[i] : (i < POLAR ? -1 : 1) * up[side]);
    weight.push(ground ? 2 * aboveGround[i] * of[i] : 0.5 * w[side]);
    first.push(segment.ray.length);
    for (const [layer, length, angle] of segmentsOf(cosine.at(-1), ground ? null : k)) {
      segment.ray.push(polar * k + i);
      segment.layer.push(layer);
      segment.length.push(length);
      segment.angle.push(angle);
    }
  }
  const count = segment.ray.length, fineCount = Math.round(ZENITH_DEG.at(-1) / FINE_DEG) + 1;
  const sides = range(AZIMUTHS, (a) => Math.cos((a + 0.5) * Math.PI / AZIMUTHS));
  const fine = { below: [], one: [], other: [] };
  for (let i = 0; i < fineCount; i++) {
    const [below, f] = betweenZeniths(FINE_DEG * i), [one, other] = [below, below + 1].map((j) => Math.exp(logReference(FINE_DEG * i) - logReference(ZENITH_DEG[j])));
    fine.below.push(below);
    fine.one.push((1 - f) * one);
    fine.other.push(f * other);
  }
  const place = new Uint16Array(ANGLES * AZIMUTHS * count), pairs = { start: [0], column: [], place: [], segment: [], weight: [] }, slots = new Float64Array(ANGLES);
  for (let k = 0; k < LAYERS; k++) for (let c = 0; c < ANGLES; c++) {
    const cos = Math.cos(ZENITH_DEG[c] * RAD), sin = Math.sin(ZENITH_DEG[c] * RAD), entry = {};   // of each column in this row
    for (let n = first[polar * k]; n < (first[polar * (k + 1)] ?? count); n++) {
      const near = cos * Math.cos(segment.angle[n]), far = sin * Math.sin(segment.angle[n]), layer = segment.layer[n];
      let low = ANGLES, high = 0;
      for (let a = 0; a < AZIMUTHS; a++) {
        const i = Math.min(Math.round(Math.acos(within(near + far * sides[a], -1, 1)) / RAD / FINE_DEG), fineCount - 1), below = fine.below[i];
        place[(c * AZIMUTHS + a) * count + n] = layer * fineCount + i;
        slots[below] += fine.one[i];
        slots[below + 1] += fine.other[i];
        low = Math.min(low, below);
        high = Math.max(high, below + 1);
      }
      for (let i = low; i <= high; i++) {   // the matrix of mean light, row by row
        if (!slots[i]) continue;
        pairs.place.push(entry[layer * ANGLES + i] ??= pairs.column.push(layer * ANGLES + i) - 1);
        pairs.segment.push(n);
        pairs.weight.push(slots[i] / AZIMUTHS * weight[segment.ray[n]]);
        slots[i] = 0;
      }
    }
    pairs.start.push(pairs.column.length);
  }
  for (const key in pairs) pairs[key] = (key === "weight" ? Float32Array : Uint32Array).from(pairs[key]);
  // by zenith angle, azimuth and ray: Legendre polynomials of the angle to the sun, weights in the moments of radiance
  const polynomials = new Float32Array(ANGLES * AZIMUTHS * first.length * CUT), moments = new Float32Array(ANGLES * AZIMUTHS * first.length * MOMENTS), out = new Float64Array(HARMONICS);
  for (let c = 0, at = 0; c < ANGLES; c++) for (let a = 0; a < AZIMUTHS; a++) for (let r = 0; r < first.length; r++, at++) {
    const [cos, sin, u, s] = [Math.cos(ZENITH_DEG[c] * RAD), Math.sin(ZENITH_DEG[c] * RAD), cosine[r], Math.sqrt(1 - cosine[r] ** 2) * sides[a]];
    const towards = u * cos + s * sin, sine2 = 1 - towards * towards, [acrossU, acrossS] = [cos - u * towards, sin - s * towards];
    harmonics(u, s, out);
    polynomials.set(legendre(towards, CUT - 1), at * CUT);
    const parts = [...out, sine2 * (1 - u * u) - 2 * acrossU ** 2, -sine2 * u * s - 2 * acrossU * acrossS, sine2 * (1 - s * s) - 2 * acrossS ** 2];
    moments.set(parts.map((part) => weight[r] / AZIMUTHS * part), at * MOMENTS);
  }
  return (made = { ...segment, count, first: [...first, count], fine, fineCount, place, polynomials, moments, pairs });
}

// Light by layer and zenith angle, at the fine zenith angles.
function atFine({ fine, fineCount }, light) {
  const out = new Float64Array(LAYERS * fineCount);
  for (let l = 0; l < LAYERS; l++) for (let i = 0; i < fineCount; i++) out[l * fineCount + i] = fine.one[i] * light[l * ANGLES + fine.below[i]] + fine.other[i] * light[l * ANGLES + fine.below[i] + 1];
  return out;
}

// What comes along the rays of one share of light in each segment, or of three at once.
function along({ first, place }, at, [one, two, three]) {
  const lines = ANGLES * AZIMUTHS, out = [one, two, three].map((share) => share && new Float64Array(lines * (first.length - 1)));
  for (let line = 0, q = 0, p = 0; line < lines; line++) for (let i = 0, n = 0; i < first.length - 1; i++, q++) {
    const end = first[i + 1];
    let a = 0, b = 0, c = 0;
    if (!two) for (; n < end; n++, p++) a += at[place[p]] * one[n];
    else for (; n < end; n++, p++) { const v = at[place[p]]; a += v * one[n]; b += v * two[n]; c += v * three[n]; }
    out[0][q] = a;
    if (two) { out[1][q] = b; out[2][q] = c; }
  }
  return out;
}

// Adds to moments from one to another what a radiance along the rays has of them.
function addMoments({ first, moments }, radiance, from, to, out) {
  const rays = first.length - 1;
  for (let q = 0; q < radiance.length; q++) {
    const o = (Math.floor(q % rays / (2 * POLAR)) * ANGLES + Math.floor(q / rays / AZIMUTHS)) * MOMENTS;
    for (let m = from; m < to; m++) out[o + m] += moments[q * MOMENTS + m] * radiance[q];
  }
}

// What scatters in the layers between BOUNDARY_KM: extinction [km^-1], albedo of air and both aerosols, (2 l + 1) x moments.
function kindsOf(air) {
  const place = BOUNDARY_KM.map((z) => searchsorted(ALTITUDE_KM, z - 1e-9)), rows = air.depth.map((row) => { const below = cumulative(row); return range(LAYERS - 1, (l) => below[place[l + 1]] - below[place[l]]); });
  const peaks = air.mixedMoments.map((m) => Math.max(m[CUT], 0)), scattering = [rows[AIR], ...[LOW, HIGH].map((k, i) => rows[k].map((v) => (1 - peaks[i]) * v))];
  const depth = rows[AIR].map((v, l) => v + rows[ABSORPTION][l] + rows[EXTINCTION][l] - peaks[0] * rows[LOW][l] - peaks[1] * rows[HIGH][l]);
  return {
    extinction: [...depth.map((v, l) => v / (BOUNDARY_KM[l + 1] - BOUNDARY_KM[l])), 0],
    albedo: scattering.map((row) => [...row.map((v, l) => v / depth[l]), 0]),
    series: air.mixedMoments.map((m, k) => range(CUT, (l) => (2 * l + 1) * (m[l] - peaks[k]) / (1 - peaks[k]))),
  };
}

// Moments of light scattered at least once, over F0, the reference taken off: [layer][zenith angle][MOMENTS]; depth: of
// the beams, places: of all zenith angles at the boundaries.
function diffuseLight(air, depth, places) {
  const r = rays(), { extinction, albedo, series } = kindsOf(air), polarising = (1 - air.depolarisation) / (2 + air.depolarisation);
  const beam = places.map((row) => row.map((p) => logSunbeam(depth, p))), light = new Float64Array(LAYERS * ANGLES);
  for (let l = 0; l < LAYERS - 1; l++) for (let c = 0; c < ANGLES; c++) light[l * ANGLES + c] = logMean(beam[l][c], beam[l + 1][c]) * litFraction(places[l][c][2], places[l + 1][c][2]) / (4 * Math.PI);
  for (let c = 0; c < ANGLES; c++) if (places[0][c][2] > 0) light[(LAYERS - 1) * ANGLES + c] = air.groundAlbedo / Math.PI * Math.exp(beam[0][c]) * Math.max(Math.cos(ZENITH_DEG[c] * RAD), 0);
  // what comes from each segment to the start of its ray, and the parts of it that air and both aerosols scatter
  const every = new Float64Array(r.count), shares = albedo.map(() => new Float64Array(r.count));
  for (let n = 0, passed = 0; n < r.count; n++) {
    if (n === r.first[r.ray[n]]) passed = 0;
    const ground = r.layer[n] === LAYERS - 1, tau = ground ? OPAQUE : extinction[r.layer[n]] * r.length[n], reaching = -Math.exp(-passed) * Math.expm1(-tau);
    passed += tau;
    for (let k = 0; k < 3; k++) every[n] += shares[k][n] = albedo[k][r.layer[n]] * reaching;
    if (ground) every[n] = reaching;
  }
  // radiance along the rays, and its moments
  const at = atFine(r, light), [byAir, byLow, byHigh] = along(r, at, shares), radiance = new Float64Array(byAir.length), out = new Float64Array(LAYERS * ANGLES * MOMENTS), lines = r.first.length - 1;
  for (let q = 0; q < radiance.length; q++) {
    const end = r.first[q % lines + 1] - 1;   // the ground is the last segment of a ray
    let low = 0, high = 0;
    for (let l = 0; l < CUT; l++) { const p = r.polynomials[q * CUT + l]; low += p * series[0][l]; high += p * series[1][l]; }
    radiance[q] = byAir[q] * (1 + polarising * r.polynomials[q * CUT + 2]) + byLow[q] * Math.max(low, LEAST_PHASE) + byHigh[q] * Math.max(high, LEAST_PHASE);
    if (r.layer[end] === LAYERS - 1) radiance[q] += every[end] * at[r.place[Math.floor(q / lines) * r.count + end]];
  }
  addMoments(r, radiance, 0, 1, out);
  const first = light.map((_, i) => out[i * MOMENTS] * (i < (LAYERS - 1) * ANGLES ? 1 : air.groundAlbedo)), total = allOrders(r.pairs, every, air.groundAlbedo, first);
  along(r, atFine(r, total), [every])[0].forEach((v, q) => { radiance[q] += v; });
  addMoments(r, radiance, 1, HARMONICS, out);
  addMoments(r, byAir.map((v) => 0.75 * polarising * v), HARMONICS, MOMENTS, out);
  total.forEach((v, i) => { out[i * MOMENTS] = v; });
  const taken = ZENITH_DEG.map((z) => Math.exp(-logReference(z)));
  return out.map((v, i) => v * taken[Math.floor(i / MOMENTS) % ANGLES]);
}

// Mean light of all orders from the first one.
function allOrders({ start, column, place, segment, weight }, every, groundAlbedo, first) {
  const entries = new Float64Array(column.length), total = first.slice();
  for (let p = 0; p < weight.length; p++) entries[place[p]] += weight[p] * every[segment[p]];
  let before = first, now = first;
  for (let order = 1; order < SCATTERINGS; order++) {
    [before, now] = [now, new Float64Array(first.length)];
    for (let i = 0; i < now.length; i++) {
      let light = 0;
      for (let p = start[i]; p < start[i + 1]; p++) light += entries[p] * before[column[p]];
      now[i] = i < (LAYERS - 1) * ANGLES ? light : groundAlbedo * light;
      total[i] += now[i];
    }
  }
  return total.map((v, i) => { const ratio = within(now[i] / Math.max(before[i], 1e-30), 0, MOST_RATIO); return v + now[i] * ratio / (1 - ratio); });
}

// The sum of the first term of a series, at least 0, and further ones; never negative, without a kink.
const positive = (first, further) => { const ratio = further / Math.max(first, 1e-35); return first * (ratio > 0 ? 1 + ratio : Math.exp(ratio)); };

// M_0 under suns in directions along lines of sight, [w][(sun * elevations + elevation) * azimuths + azimuth].
function seenAlong(skies, suns, elevations, azimuths, line) {
  const { middle, first } = skies.geometry, own = middle.slice(first), layers = [...new Set(own.map((z) => searchsorted(BOUNDARY_KM, z) - 1))];
  const groupOf = own.map((z) => layers.indexOf(searchsorted(BOUNDARY_KM, z) - 1)), share = own.map((z) => Math.exp(-z / SCALE_HEIGHT_KM));
  const angles = line.map(({ path, angle }) => {
    const [top, bottom] = [new Float64Array(layers.length), new Float64Array(layers.length)];
    groupOf.forEach((g, k) => { top[g] += 0.5 * (angle[k] + angle[k + 1]) * path[k] * share[k]; bottom[g] += path[k] * share[k]; });
    return top.map((v, g) => v / bottom[g]);
  });
  const weights = skies.at.map((one) => lastScattering(one, skies.geometry, line, groupOf, layers.length));
  const out = skies.at.map(() => new Float64Array(suns.length * elevations.length * azimuths.length)), functions = new Float64Array(HARMONICS), of = new Float64Array(MOMENTS);
  suns.forEach((sun, i) => elevations.forEach((elevation, j) => azimuths.forEach((azimuth, k) => {
    const here = (i * elevations.length + j) * azimuths.length + k, [e, up] = [elevation * RAD, (90 - sun) * RAD];
    const fromSun = Math.cos(up) * Math.sin(e) + Math.sin(up) * Math.cos(e) * Math.cos(azimuth * RAD);
    angles[j].forEach((angle, g) => {
      const zenith = zenithAt(sun, angle, azimuth), [below, f] = betweenZeniths(zenith / RAD), scale = Math.exp(logReference(zenith / RAD)), u = Math.sin(e + angle);
      const s = within((fromSun - Math.cos(zenith) * u) / Math.max(Math.sin(zenith), 1e-3), -1, 1), beside = Math.max(1 - u * u - s * s, 0), start = (layers[g] * ANGLES + below) * MOMENTS;
      harmonics(u, s, functions);
      skies.at.forEach(({ diffuse }, w) => {
        for (let m = 0; m < MOMENTS; m++) of[m] = diffuse[start + m] * (1 - f) + diffuse[start + MOMENTS + m] * f;
        const by = weights[w][j], o = g * (DEGREE + 2), uu = of[HARMONICS], us = of[HARMONICS + 1], ss = of[HARMONICS + 2];
        let further = -3 * by[o + DEGREE + 1] * (u * u * uu + 2 * u * s * us + s * s * ss - beside * (uu + ss));
        for (let n = 1, m = 1; n <= DEGREE; n++) {
          let degree = 0;
          for (const end = m + n; m <= end; m++) degree += functions[m] * of[m];
          further += (n === 2 ? by[o + 2] + by[o + DEGREE + 1] : by[o + n]) * degree;
        }
        out[w][here] += positive(by[o] * of[0], further) * scale;
      });
    });
  })));
  return out.map((values) => values.map((v) => Math.max(v, DARK)));
}

// Of each line of sight and group of layers: what the last scattering of the moments of degree 0 to DEGREE by all, and of
// the second by air alone, adds.
function lastScattering({ air, extinction }, { layer, first }, line, groupOf, groups) {
  const { depth, mixedMoments: mixed } = air, cut = mixed.map((m) => peak(air.degree, m));
  const perKm = groupOf.map((_, k) => {
    const l = layer[first + k], height = ALTITUDE_KM[l + 1] - ALTITUDE_KM[l], [low, high] = [depth[LOW][l], depth[HIGH][l]];
    const by = range(DEGREE + 1, (n) => (2 * n + 1) * (low * (mixed[0][n] - cut[0]) + high * (mixed[1][n] - cut[1])));
    by[0] += depth[AIR][l];
    return [...by, depth[AIR][l] * (1 - air.depolarisation) / (2 + air.depolarisation)].map((v) => v / height);
  });
  return line.map(({ path }) => {
    const out = new Float64Array(groups * (DEGREE + 2));
    let before = 0;
    groupOf.forEach((g, k) => {
      const inside = path[k] * extinction[first + k], seen = Math.exp(-before) * (inside < 1e-6 ? path[k] : -Math.expm1(-inside) / extinction[first + k]);
      perKm[k].forEach((v, n) => { out[g * (DEGREE + 2) + n] += v * seen; });
      before += inside;
    });
    return out;
  });
}

// clear_air.py -------------------------------------------------------------------------------------------------------
const SUN_DEG = [-18, -16.5, -15, -13.5, ...steps(-12, 3, 1), 3.5, 5, 7.5, 10, 15, ...steps(20, 91, 10)];
const ELEVATION_DEG = [0, 1, 2.5, 5, 8, 12, 17, 23, 30, 38, 47, 57, 68, 79, 90], AZIMUTH_DEG = [0, 6, 12, 20, 30, 45, 60, 80, 100, 120, 140, 160, 180];
const NODES = ELEVATION_DEG.length * AZIMUTH_DEG.length, BASE_ELEVATION_DEG = [0, 3, 6, 10, 14].map((i) => ELEVATION_DEG[i]), BASE_AZIMUTH_DEG = [0, 6, 12].map((i) => AZIMUTH_DEG[i]);
const PEAK_DEGREE = 400, PEAK_ANGLES = 161, LEAST_PEAK_DEPTH = 1e-4, OUTERMOST = 5, NEGLIGIBLE = 1e-3, DARKEST_TERM = 1e-3;
const SLAB_KM = [0, 0.25, 0.7, 1.35, 2, 3, 4.5, 6, 8, 10, 12, 15, 19, 24, 30, 39, 60, 100], EVERY_SLAB = range(SLAB_KM.length), COARSE_SLABS = [0, 4, 8, 11, 13, 15, 17];
const ABSORPTION_SLABS = [...steps(0, 18, 2), 17], MOMENT_INPUTS = [1, 2, 3, 4, 6, 8, 12];

// Inputs of the network that name the air of one wavelength.
function networkInputs(air, observerKm) {
  const d = air.depth, f = air.mixedMoments.map((m) => peak(air.degree, m)), cell = (row) => Array.from(d[AIR], (_, l) => row(l));
  const absorbed = cell((l) => Math.max(d[EXTINCTION][l] - d[LOW][l] - d[HIGH][l], 0)), high = cell((l) => (1 - f[1]) * d[HIGH][l]), particles = cell((l) => (1 - f[0]) * d[LOW][l] + high[l]);
  const total = cell((l) => d[AIR][l] + d[ABSORPTION][l] + d[EXTINCTION][l] - f[0] * d[LOW][l] - f[1] * d[HIGH][l]);
  const slabs = (depth, some) => { const under = cumulative(depth), at = some.map((i) => under[nearest(ALTITUDE_KM, SLAB_KM[i])]); return at.slice(1).map((v, i) => v - at[i]); };
  const below = (depth) => { const k = within(searchsorted(ALTITUDE_KM, observerKm) - 1, 0, depth.length - 1); return cumulative(depth)[k] + (observerKm - ALTITUDE_KM[k]) / (ALTITUDE_KM[k + 1] - ALTITUDE_KM[k]) * depth[k]; };
  const roots = (values) => values.map((v) => Math.sqrt(Math.max(v, 0)));
  return [
    ...roots(slabs(particles, EVERY_SLAB)), ...roots(slabs(absorbed, ABSORPTION_SLABS)), ...roots(slabs(d[ABSORPTION], EVERY_SLAB)), ...slabs(d[AIR], COARSE_SLABS).map(Math.log),
    ...[sum(d[AIR]), sum(total), sum(d[ABSORPTION]) + 1e-4, sum(particles) + 1e-4, sum(absorbed) + 1e-4, sum(high) + 1e-5].map(Math.log),
    ...air.mixedPhase.flatMap(([first, ...phase], k) => [...MOMENT_INPUTS.map((l) => (air.mixedMoments[k][l] - f[k]) / (1 - f[k])), first, f[k], ...phase]),
    air.groundAlbedo, 1e4 * air.groundRefractivity, observerKm, Math.sqrt(observerKm), below(total), ...roots([below(d[AIR]), below(particles)]),
  ];
}

// What the file holds, of intensity.
class Model {
  constructor(file) {
    for (const key of ["input_mean", "input_scale", "base_mean", "base_vectors", "intensity_mean", "error"]) this[key] = file[key].data;
    const each = SUN_DEG.length * NODES;
    this.intensity = file.intensity.data.map((v, i) => v * file.intensity_scale.data[Math.floor(i / each)]);
    this.count = file.intensity.shape[0];
    const [members, depth] = file.layers.shape;
    let place = 0;
    const next = (n) => file.weights.data.subarray(place, place += n);
    this.members = range(members, (m) => range(depth - 1, (k) => { const [i, o] = file.layers.data.subarray(m * depth + k); return { weights: next(i * o), offsets: next(o) }; }));
  }

  // Coefficients of ln(M / M_0) by each network, from inputs that name the air and ln M_0 under all suns.
  coefficients(air, logBase) {
    const over = logBase.map((v, i) => v - this.base_mean[i]), size = logBase.length;
    const base = range(this.base_vectors.length / size, (k) => inner(over, this.base_vectors.subarray(k * size, (k + 1) * size)));
    const inputs = [...air, ...base].map((v, i) => within((v - this.input_mean[i]) / this.input_scale[i], -OUTERMOST, OUTERMOST));
    return this.members.map((layers) => layers.reduce((hidden, { weights, offsets }, n) => {
      const linear = offsets.slice(), o = offsets.length;
      for (let i = 0; i < hidden.length; i++) for (let k = 0; k < o; k++) linear[k] += hidden[i] * weights[i * o + k];
      if (n === layers.length - 1) return linear;
      return linear.map((v, k) => v / (1 + Math.exp(-v)) + (n ? hidden[k] : 0));
    }, inputs).subarray(0, this.count));
  }
}

// The skies of an air seen by one observer, under every sun.
class Skies {
  constructor(model, air, observerKm = 0) {
    Object.assign(this, { model, air, geometry: geometryOf(air, observerKm) });
    const g = this.geometry, perKm = g.layer.map((l) => 1 / (ALTITUDE_KM[l + 1] - ALTITUDE_KM[l])), heights = BOUNDARY_KM.map((z) => nearest(g.boundary, z));
    const places = heights.map((k) => ZENITH_DEG.map((z) => g.place(k, z * RAD))), layers = (row) => Float64Array.from(g.layer, (l, i) => row(l) * perKm[i]);
    this.at = air.at.map((one) => {
      const d = one.depth, fractions = one.moments.map((m) => peak(one.degree, m)), inPeaks = (l) => sum(fractions.map((f, k) => f * one.aerosolDepth[k][l]));
      const extinction = layers((l) => d[AIR][l] + d[ABSORPTION][l] + d[EXTINCTION][l] - inPeaks(l)), peaks = layers(inPeaks);
      const depth = Float64Array.from(g.path, (path, i) => inner(path, extinction) - g.logFactor[i]);
      const scattering = [d[AIR], ...one.aerosolDepth].map((row) => layers((l) => row[l]));
      return { air: one, fractions, extinction, peaks, scattering, depth, diffuse: diffuseLight(one, depth, places) };
    });
    const base = seenAlong(this, SUN_DEG, BASE_ELEVATION_DEG, BASE_AZIMUTH_DEG, g.line(BASE_ELEVATION_DEG));
    this.at.forEach((one, w) => { one.coefficients = model.coefficients(networkInputs(one.air, observerKm), base[w].map(Math.log)); });
    this.nodes = g.line(ELEVATION_DEG);
  }

  // The sky under one sun, from -18 to 90 deg.
  sky(sun) {
    const { model, geometry: g, nodes } = this, [suns] = splines(SUN_DEG, [sun]), under = (values, start = 0) => {
      const out = new Float64Array(NODES);
      suns.forEach((weight, s) => { for (let n = 0; n < NODES; n++) out[n] += weight * values[start + s * NODES + n]; });
      return out;
    };
    const mean = under(model.intensity_mean), vectors = range(model.count, (k) => under(model.intensity, k * SUN_DEG.length * NODES));
    const combined = (c, into) => { vectors.forEach((v, k) => { for (let n = 0; n < NODES; n++) into[n] += c[k] * v[n]; }); return into; };
    const base = seenAlong(this, [sun], ELEVATION_DEG, AZIMUTH_DEG, nodes), boundaries = range(g.boundary.length - g.first, (i) => g.first + i);
    const places = nodes.map(({ angle }) => AZIMUTH_DEG.map((azimuth) => boundaries.map((k, i) => g.place(k, zenithAt(sun, angle[i], azimuth)))));
    const at = this.at.map((one, w) => {
      const average = range(model.count, (k) => sum(one.coefficients.map((c) => c[k])) / one.coefficients.length), multiple = combined(average, mean.slice()).map((v, n) => v + Math.log(base[w][n]));
      const lit = nodes.map(({ path }, e) => places[e].map((row) => sunlit(one, g.first, path, row)));
      const once = one.scattering.map((row) => multiple.map((log, n) => {
        const e = Math.floor(n / AZIMUTH_DEG.length), light = lit[e][n % AZIMUTH_DEG.length], { path } = nodes[e];
        let integral = 0;
        for (let k = 0; k < path.length; k++) integral += path[k] * row[g.first + k] * light[k];
        return Math.log(Math.max(integral, DARK) + NEGLIGIBLE * Math.exp(log));
      }));
      // how far the networks are apart, in ln M
      const apart = one.coefficients.map((c) => combined(c.map((v, k) => v - average[k]), new Float64Array(NODES))), spread = multiple.map((_, n) => Math.sqrt(sum(apart.map((v) => v[n] ** 2)) / apart.length));
      return { air: one.air, logs: [multiple, ...once], spread, widened: one.fractions.length ? this._widened(one, nodes, places.map(([row]) => row), lit.map(([row]) => row)) : null };
    });
    return new Sky(g.apparentElevation(sun), at, sun, model.error);
  }

  // Light that forward peaks have scattered more than once, at the elevations of the nodes, from light in layers towards
  // the sun: depth of scattering in peaks on its way, and what is added to exp(-depth) P, [kind][elevation] by angle.
  _widened(one, nodes, places, lit) {
    const { first, path: ways } = this.geometry, { degree } = one.air, terms = legendreTerms(), whole = Math.ceil(degree), added = one.fractions.map(() => []);
    const followed = one.air.moments.map((m, k) => m.map((chi, l) => (l > whole ? 0 : chi - one.fractions[k])));
    const moments = one.air.moments.map((m, k) => { const f = one.fractions[k], [low, high] = f > 0.01 ? [-2, 2] : [0, 1]; return m.map((chi, l) => (l > whole ? within(chi / Math.max(f, 1e-6), low, high) : 1)); });
    const depth = nodes.map(({ path }, e) => {
      const before = places[e].map(([i, f]) => inner(ways[i], one.peaks) * (1 - f) + inner(ways[i + 1], one.peaks) * f), kinds = one.fractions.map(() => 0);
      let passed = 0, total = 0, weighted = 0;
      path.forEach((way, k) => {
        const inside = way * one.peaks[first + k], meanDepth = passed + 0.5 * (inside + before[k] + before[k + 1]);
        passed += inside;
        one.fractions.forEach((f, kind) => { const light = way * f * one.scattering[kind + 1][first + k] * lit[e][k]; kinds[kind] += light; total += light; weighted += light * meanDepth; });
      });
      const all = total > 0 ? total : 1, x = total > 0 && weighted / all >= LEAST_PEAK_DEPTH ? weighted / all : 0, none = Math.exp(-x);
      const g = new Float64Array(PEAK_DEGREE + 1);
      for (let l = 0; l <= PEAK_DEGREE && x; l++) {
        let mixed = 0;
        for (let k = 0; k < kinds.length; k++) mixed += kinds[k] / all * moments[k][l];
        g[l] = Math.abs(mixed) * x < 1e-6 ? 0.5 * none * x * mixed : (Math.exp(-x * (1 - mixed)) - none) / (mixed * x) - none;
      }
      one.fractions.forEach((f, k) => {
        const series = Float64Array.from(g, (v, l) => (f > 1e-6 ? f : 0) * moments[k][l] * v + (1 - none) * followed[k][l]);
        let end = series.length;
        while (end > 0 && Math.abs(series[end - 1]) < 1e-7) end--;   // moves light by 1e-5 at most
        added[k].push(Float64Array.from(terms, (row) => inner(series.subarray(0, end), row)));
      });
      return x;
    });
    return { depth, added };
  }
}

// Shells of the last observers, which sliders of the air leave alone.
const geometries = new Map();
function geometryOf({ refractivity, radiusKm }, observerKm) {
  const key = `${observerKm} ${radiusKm} ${refractivity.join()}`;
  if (!geometries.has(key)) {
    if (geometries.size > 7) geometries.delete(geometries.keys().next().value);
    geometries.set(key, new Geometry(refractivity, observerKm, radiusKm));
  }
  return geometries.get(key);
}

// Transmittance x sunbeam in the layers of a line of sight, by the `places` of its boundaries.
function sunlit({ extinction, depth }, first, path, places) {
  const out = new Float64Array(path.length);
  let before = 0, log = Math.max(logSunbeam(depth, places[0]), DARK_LOG);
  for (let k = 0; k < path.length; k++) {
    before += path[k] * extinction[first + k];
    const next = Math.max(logSunbeam(depth, places[k + 1]) - before, DARK_LOG);
    out[k] = logMean(log, next) * litFraction(places[k][2], places[k + 1][2]);
    log = next;
  }
  return out;
}

// (2 l + 1)/(4 pi) P_l at PEAK_ANGLES angles, [angle][l].
let peakTerms = null;
const legendreTerms = () => (peakTerms ??= range(PEAK_ANGLES, (i) => Float32Array.from(legendre(Math.cos(Math.PI * (i / (PEAK_ANGLES - 1)) ** 2), PEAK_DEGREE), (p, l) => (2 * l + 1) / (4 * Math.PI) * p)));

// The sky of one sun: its apparent elevation; of each wavelength ln of M and of Q_k at the nodes, and `_widened`.
class Sky {
  constructor(apparent, at, sun, error) {
    Object.assign(this, { apparent, at });
    this.spreads = this.light(ELEVATION_DEG, AZIMUTH_DEG, false).map(({ light }, w) => ({ brightest: Math.max(...light), of: at[w].spread.map((v, n) => v * Math.exp(at[w].logs[0][n]) / light[n]) }));
    this.relativeError = relativeError(this.spreads, sun, error);
  }

  // Of each wavelength: light over F0 [sr^-1] in rows times columns, and what aerosol scattered once of it.
  light(elevations, azimuths, widen = true) {
    const rows = splines(ELEVATION_DEG.map((e) => Math.log(e + 1.5)), elevations.map((e) => Math.log(e + 1.5))), columns = azimuthSplines(azimuths), [S, N] = [Math.sin(this.apparent * RAD), Math.cos(this.apparent * RAD)];
    const over = (values) => {
      const along = rows.map((row) => { const out = new Float64Array(AZIMUTH_DEG.length); row.forEach((v, e) => { for (let a = 0; a < out.length; a++) out[a] += v * values[e * out.length + a]; }); return out; });
      return Float64Array.from({ length: elevations.length * azimuths.length }, (_, i) => Math.exp(inner(along[Math.floor(i / azimuths.length)], columns[i % azimuths.length])));
    };
    const cosines = elevations.flatMap((e) => azimuths.map((a) => within(Math.sin(e * RAD) * S + Math.cos(e * RAD) * N * Math.cos(a * RAD), -1, 1)));
    const placed = (count) => cosines.map((c) => { const where = Math.sqrt(Math.acos(c) / Math.PI) * (count - 1), i = Math.min(Math.floor(where), count - 2); return [i, where - i]; });
    const fine = placed(this.at[0].air.logPhase[0]?.length ?? 2), wide = placed(PEAK_ANGLES), read = (table, [i, f]) => table[i] * (1 - f) + table[i + 1] * f;
    return this.at.map(({ air, logs, widened }) => {
      const [multiple, byAir, ...once] = logs.map(over), rho = air.depolarisation, aerosol = new Float64Array(cosines.length);
      const dimmed = rows.map((row) => (widened && widen ? Math.exp(-Math.max(inner(row, widened.depth), 0)) : 1));
      once.forEach((q, k) => {
        const added = widened && widen && rows.map((row) => { const out = new Float64Array(PEAK_ANGLES); widened.added[k].forEach((values, e) => { for (let i = 0; i < PEAK_ANGLES; i++) out[i] += row[e] * values[i]; }); return out; });
        q.forEach((v, i) => {
          const phase = Math.exp(read(air.logPhase[k], fine[i])), row = Math.floor(i / azimuths.length);
          aerosol[i] += v * (added ? Math.max(phase * dimmed[row] + read(added[row], wide[i]), 0) : phase);
        });
      });
      return { aerosol, light: aerosol.map((v, i) => v + multiple[i] + byAir[i] * 3 / (8 * Math.PI * (2 + rho)) * (1 + rho + (1 - rho) * cosines[i] ** 2)) };
    });
  }
}

// The error of radiance at 95 % of directions, from how far the networks are apart at each wavelength.
function relativeError(spreads, sun, error) {
  const least = DARKEST_TERM * Math.max(...spreads.map((one) => one.brightest)), counted = spreads.flatMap(({ brightest, of }) => (brightest > least ? Array.from(of) : [])).sort((a, b) => a - b);
  const [fixed, times] = [0, 1].map((row) => interp(sun, SUN_DEG, error.slice(row * SUN_DEG.length, (row + 1) * SUN_DEG.length)));
  return fixed + times * interp(0.95 * (counted.length - 1), range(counted.length), counted);
}

// The cubic spline (not-a-knot) through values at the nodes, as rows of a matrix that gives its values at x.
function splines(nodes, x) {
  const n = nodes.length, h = range(n - 1, (i) => nodes[i + 1] - nodes[i]), left = range(n, () => new Float64Array(n)), right = range(n, () => new Float64Array(n));
  for (let i = 1; i < n - 1; i++) {
    left[i].set([h[i - 1], 2 * (h[i - 1] + h[i]), h[i]], i - 1);
    right[i].set([6 / h[i - 1], -6 / h[i - 1] - 6 / h[i], 6 / h[i]], i - 1);
  }
  left[0].set([h[1], -(h[0] + h[1]), h[0]]);
  left[n - 1].set([h[n - 2], -(h[n - 3] + h[n - 2]), h[n - 3]], n - 3);
  const second = solve(left, right);
  return x.map((at) => {
    const j = within(nodes.findLastIndex((v) => v <= at), 0, n - 2), b = (at - nodes[j]) / h[j], a = 1 - b, bent = [a, b].map((p) => (p ** 3 - p) * h[j] ** 2 / 6);
    const out = second[j].map((v, i) => bent[0] * v + bent[1] * second[j + 1][i]);
    out[j] += a;
    out[j + 1] += b;
    return out;
  });
}

// Solutions of left @ out = right, by elimination; both are used up.
function solve(left, right) {
  const n = left.length, less = (row, other, factor) => { for (let k = 0; k < n; k++) row[k] -= factor * other[k]; };
  for (let i = 0; i < n; i++) {
    let best = i;
    for (let j = i + 1; j < n; j++) if (Math.abs(left[j][i]) > Math.abs(left[best][i])) best = j;
    for (const m of [left, right]) [m[i], m[best]] = [m[best], m[i]];
    for (let j = 0; j < n; j++) if (j !== i && left[j][i]) { const factor = left[j][i] / left[i][i]; less(left[j], left[i], factor); less(right[j], right[i], factor); }
  }
  return right.map((row, i) => row.map((v) => v / left[i][i]));
}

// Splines through the nodes and three mirror images on either side, of what is the same on both sides of the sun.
function azimuthSplines(azimuths) {
  const count = AZIMUTH_DEG.length, nodes = [...[3, 2, 1].map((i) => -AZIMUTH_DEG[i]), ...AZIMUTH_DEG, ...[2, 3, 4].map((i) => 360 - AZIMUTH_DEG[count - i])];
  return splines(nodes, azimuths.map((a) => Math.abs(((a + 180) % 360 + 360) % 360 - 180))).map((through) => {
    const out = through.slice(3, 3 + count);
    [3, 2, 1].forEach((i, k) => { out[i] += through[k]; });
    [2, 3, 4].forEach((i, k) => { out[count - i] += through[3 + count + k]; });
    return out;
  });
}
