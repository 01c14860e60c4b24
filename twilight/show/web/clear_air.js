// The light of every clear sky: a port of model.py, skies.py and sky.py of twilight/clear_air (see shells.js).
const MODEL_NUMBER = 1;
const SUN_DEG = [-18, -16.5, -15, -13.5, ...steps(-12, 3, 1), 3.5, 5, 7.5, 10, 15, ...steps(20, 91, 10)];
const ELEVATION_DEG = [0, 1, 2.5, 5, 8, 12, 17, 23, 30, 38, 47, 57, 68, 79, 90], AZIMUTH_DEG = [0, 6, 12, 20, 30, 45, 60, 80, 100, 120, 140, 160, 180];
const NODES = ELEVATION_DEG.length * AZIMUTH_DEG.length, BASE_ELEVATION_DEG = [0, 3, 6, 10, 14].map((i) => ELEVATION_DEG[i]), BASE_AZIMUTH_DEG = [0, 6, 12].map((i) => AZIMUTH_DEG[i]);
const PEAK_DEGREE = 400, PEAK_ANGLES = 161, LEAST_PEAK_DEPTH = 1e-4, MOST_PEAK_DEPTH = 60, OUTERMOST = 5, NEGLIGIBLE = 0.01, SHADOWED_DEG = 2, DARKEST_TERM = 1e-3, LEAST_SHARE = 0.5, MANY_PARTICLES = 0.1, SCREEN_ERROR = 0.1, SPARED_DEG = 2.5;
const halved = (nodes, from = 0) => nodes.flatMap((v, i) => (i && nodes[i - 1] >= from ? [0.5 * (nodes[i - 1] + v), v] : [v])), FINER_ELEVATION_DEG = halved(ELEVATION_DEG), SHADOWED = FINER_ELEVATION_DEG.filter((e) => e <= 8);
// Elevations and azimuths at which light is computed: in the day, and where the shadow of the Earth crosses the sky.
const DAY = [FINER_ELEVATION_DEG, AZIMUTH_DEG], ROWS_DEG = [...halved(ELEVATION_DEG.filter((e) => e <= 12)), ...ELEVATION_DEG.filter((e) => e > 12)], TWILIGHT = [[...halved(SHADOWED), ...FINER_ELEVATION_DEG.slice(SHADOWED.length)], halved(AZIMUTH_DEG, AZIMUTH_DEG[3])];
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
  constructor(model, air, observerKm = 0, screen = null) {
    Object.assign(this, { model, air, screen, geometry: geometryOf(air, observerKm), taken: null });
    const g = this.geometry, perKm = g.layer.map((l) => 1 / (ALTITUDE_KM[l + 1] - ALTITUDE_KM[l]));
    this.places = g.boundary.map((_, k) => ZENITH_DEG.map((z) => g.place(k, z * RAD)));
    const layers = (row) => Float64Array.from(g.layer, (l, i) => row(l) * perKm[i]);
    this.at = air.at.map((one) => {
      const d = one.depth, fractions = one.moments.map((m) => peak(one.degree, m)), inPeaks = (l) => sum(fractions.map((f, k) => f * one.aerosolDepth[k][l]));
      const extinction = layers((l) => d[AIR][l] + d[ABSORPTION][l] + d[EXTINCTION][l] - inPeaks(l)), peaks = layers(inPeaks);
      const depth = Float64Array.from(g.path, (path, i) => inner(path, extinction) - g.logFactor[i]);
      const scattering = [d[AIR], ...one.aerosolDepth].map((row) => layers((l) => row[l]));
      const scattered = range(extinction.length, (l) => (g.boundary[l + 1] - g.boundary[l]) * sum(scattering.map((row) => row[l])));
      return { air: one, fractions, extinction, peaks, scattering, scattered, depth, diffuse: diffuseLight(one, depth, this.places, g.boundary, scattered) };
    });
    this.logBase = this._logBase();
    this.at.forEach((one, w) => { one.coefficients = model.coefficients(networkInputs(one.air, observerKm), this.logBase[w]); });
  }

  _logBase() { return seenAlong(SUN_DEG, BASE_AZIMUTH_DEG, lastScattering(this, BASE_ELEVATION_DEG)).map((base) => base.map(Math.log)); }

  // The skies of a sun behind the screen; these, where it takes nothing of them.
  behind(sun) {
    if (!this.screen) return this;
    const { geometry: g, places } = this, passed = (this.passed ??= g.passed(this.screen));
    const first = g.zenith.reduce((least, z, i) => (passed[i] < 0 && z < least ? z : least), Math.PI);
    if (sun >= 90 - first / RAD + SPARED_DEG) return this;
    if (this.screened) return this.screened;
    const made = (this.screened = Object.assign(Object.create(Skies.prototype), this, { screen: null, rows: undefined }));
    made.at = this.at.map((one) => {
      const depth = one.depth.map((v, i) => v - one.air.power * passed[i]);
      return { ...one, depth, diffuse: diffuseLight(one.air, depth, places, g.boundary, one.scattered) };
    });
    const log = made._logBase(), nodes = log[0].length / SUN_DEG.length;
    made.taken = log.map((row, w) => range(SUN_DEG.length, (s) => Array.from(row.subarray(s * nodes, (s + 1) * nodes), (v, n) => this.logBase[w][s * nodes + n] - v)));
    return made;
  }

  // The sky under one sun, from -18 to 90 deg.
  sky(sun) {
    const { model, geometry: g } = this, [elevations, azimuths] = sun < SHADOWED_DEG ? TWILIGHT : DAY, lines = g.line(elevations), A = AZIMUTH_DEG.length, [suns] = splines(SUN_DEG, [sun]), under = (values, start = 0) => {
      const out = new Float64Array(NODES);
      suns.forEach((weight, s) => { for (let n = 0; n < NODES; n++) out[n] += weight * values[start + s * NODES + n]; });
      return out;
    };
    const mean = under(model.intensity_mean), vectors = range(model.count, (k) => under(model.intensity, k * SUN_DEG.length * NODES));
    const combined = (c, into) => { vectors.forEach((v, k) => { for (let n = 0; n < NODES; n++) into[n] += c[k] * v[n]; }); return into; };
    const base = seenAlong([sun], AZIMUTH_DEG, (this.rows ??= lastScattering(this, ROWS_DEG))), boundaries = range(g.boundary.length - g.first, (i) => g.first + i);
    const places = lines.map(({ angle }) => azimuths.map((azimuth) => boundaries.map((k, i) => g.place(k, zenithAt(sun, angle[i], azimuth)))));
    const rows = elevationSplines(ELEVATION_DEG, elevations), ofBase = elevationSplines(ROWS_DEG, elevations), columns = azimuthSplines(AZIMUTH_DEG, azimuths);
    const at = this.at.map((one, w) => {
      const average = range(model.count, (k) => sum(one.coefficients.map((c) => c[k])) / one.coefficients.length), ratio = combined(average, mean.slice());
      const finer = rows.map((row, r) => Float64Array.from({ length: A }, (_, a) => { let log = 0; row.forEach((v, e) => { log += v * ratio[e * A + a]; }); ofBase[r].forEach((v, e) => { log += v * Math.log(base[w][e * A + a]); }); return log; }));
      const multiple = Float64Array.from(finer.flatMap((row) => columns.map((column) => inner(row, column))));
      const lit = lines.map(({ path }, r) => places[r].map((row) => sunlit(one, g.first, path, row)));
      const once = one.scattering.map((row) => multiple.map((log, n) => {
        const r = Math.floor(n / azimuths.length), light = lit[r][n % azimuths.length], { path } = lines[r];
        let integral = 0;
        for (let k = 0; k < path.length; k++) if (light[k]) integral += path[k] * row[g.first + k] * light[k];
        return Math.log(Math.max(integral, DARK) + NEGLIGIBLE * Math.exp(log));
      }));
      // how far the networks are apart, in ln M at the nodes
      const apart = one.coefficients.map((c) => combined(c.map((v, k) => v - average[k]), new Float64Array(NODES))), ofNodes = (list) => list.filter((_, r) => ELEVATION_DEG.includes(elevations[r]));
      const spread = ofNodes(finer).flatMap((row) => Array.from(row, Math.exp)).map((m, n) => m * Math.sqrt(sum(apart.map((v) => v[n] ** 2)) / apart.length));
      return { air: one.air, elevations, azimuths, logs: [multiple, ...once], spread, widened: one.fractions.length ? this._widened(one, ofNodes(lines), ofNodes(places).map(([row]) => row), ofNodes(lit).map(([row]) => row)) : null };
    });
    return new Sky(g.apparentElevation(sun), at, sun, model.error, this.taken);
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
      const all = total > 0 ? total : 1, x = total > 0 && weighted / all >= LEAST_PEAK_DEPTH ? Math.min(weighted / all, MOST_PEAK_DEPTH) : 0, none = Math.exp(-x);
      const g = new Float64Array(PEAK_DEGREE + 1);
      for (let l = 0; l <= PEAK_DEGREE && x; l++) {
        let mixed = 0;
        for (let k = 0; k < kinds.length; k++) mixed += kinds[k] / all * moments[k][l];
        g[l] = Math.abs(mixed) * x < 1e-6 ? 0.5 * none * x * mixed : (Math.exp(-x * (1 - mixed)) - none) / (mixed * x) - none;
      }
      one.fractions.forEach((f, k) => {
        const series = Float64Array.from(g, (v, l) => (f > 1e-6 ? f : 0) * moments[k][l] * v + (1 - none) * followed[k][l]);
        let end = series.length;
        while (end > 0 && Math.abs(series[end - 1]) < 1e-12) end--;
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
  for (let k = 0, before = 0; k < path.length; k++) {
    const after = before + path[k] * extinction[first + k], lit = litFraction(places[k][2], places[k + 1][2]);
    if (lit > 0) out[k] = lit * logMean(Math.max(logSunbeam(depth, places[k]) - before, DARK_LOG), Math.max(logSunbeam(depth, places[k + 1]) - after, DARK_LOG));
    before = after;
  }
  return out;
}

// (2 l + 1)/(4 pi) P_l at PEAK_ANGLES angles, [angle][l].
let peakTerms = null;
const legendreTerms = () => (peakTerms ??= range(PEAK_ANGLES, (i) => Float32Array.from(legendre(Math.cos(Math.PI * (i / (PEAK_ANGLES - 1)) ** 2), PEAK_DEGREE), (p, l) => (2 * l + 1) / (4 * Math.PI) * p)));

// The sky of one sun: its apparent elevation; of each wavelength ln of M and of Q_k at the nodes, and `_widened`.
class Sky {
  constructor(apparent, at, sun, error, taken) {
    Object.assign(this, { apparent, at });
    this.spreads = this.light(ELEVATION_DEG, AZIMUTH_DEG, false).map(({ light }, w) => ({ brightest: Math.max(...light), share: LEAST_SHARE + (1 - LEAST_SHARE) * Math.min(sum(at[w].air.depth[EXTINCTION]) / MANY_PARTICLES, 1), of: at[w].spread.map((v, n) => v / light[n]), taken: taken?.[w] ?? null }));
    this.relativeError = relativeError(this.spreads, sun, error);
  }

  // Of each wavelength: light over F0 [sr^-1] in rows times columns, and what aerosol scattered once of it.
  light(elevations, azimuths, widen = true) {
    const rows = elevationSplines(ELEVATION_DEG, elevations), finer = elevationSplines(this.at[0].elevations, elevations), columns = azimuthSplines(this.at[0].azimuths, azimuths), [S, N] = [Math.sin(this.apparent * RAD), Math.cos(this.apparent * RAD)];
    const over = (values) => {
      const along = finer.map((row) => { const out = new Float64Array(columns[0].length); row.forEach((v, e) => { for (let a = 0; a < out.length; a++) out[a] += v * values[e * out.length + a]; }); return out; });
      return Float64Array.from({ length: elevations.length * azimuths.length }, (_, i) => Math.exp(inner(along[Math.floor(i / azimuths.length)], columns[i % azimuths.length])));
    };
    const cosines = elevations.flatMap((e) => azimuths.map((a) => within(Math.sin(e * RAD) * S + Math.cos(e * RAD) * N * Math.cos(a * RAD), -1, 1)));
    const placed = (count) => cosines.map((c) => { const where = Math.sqrt(Math.acos(c) / Math.PI) * (count - 1), i = Math.min(Math.floor(where), count - 2); return [i, where - i]; });
    const fine = placed(this.at[0].air.logPhase[0]?.length ?? 2), wide = placed(PEAK_ANGLES), read = (table, [i, f]) => table[i] * (1 - f) + table[i + 1] * f;
    return this.at.map(({ air, logs, widened }) => {
      const [multiple, ...added] = logs.map(over), [byAir, ...once] = added.map((q) => q.map((v, i) => Math.max(v - NEGLIGIBLE * multiple[i], 0))), rho = air.depolarisation, aerosol = new Float64Array(cosines.length);
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

const percentile95 = (values) => { const sorted = values.sort((a, b) => a - b); return interp(0.95 * (sorted.length - 1), range(sorted.length), sorted); };

// The error of radiance at 95 % of directions, from how far the networks are apart at each wavelength, and from what a
// screen takes.
function relativeError(spreads, sun, error) {
  const least = DARKEST_TERM * Math.max(...spreads.map((one) => one.brightest)), bright = spreads.filter(({ brightest }) => brightest > least), counted = bright.flatMap(({ of }) => Array.from(of));
  const [fixed, times] = [0, 1].map((row) => interp(sun, SUN_DEG, error.slice(row * SUN_DEG.length, (row + 1) * SUN_DEG.length)));
  const ofScreen = spreads[0].taken ? interp(sun, SUN_DEG, SUN_DEG.map((_, s) => percentile95(spreads.flatMap(({ taken }) => taken[s])))) : 0;
  return Math.hypot(sum(bright.map(({ share }) => share)) / bright.length * (fixed + times * percentile95(counted)), SCREEN_ERROR * ofScreen);
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

// Splines through nodes that are close to each other along the horizon.
const elevationSplines = (nodes, elevations) => splines(nodes.map((e) => Math.log(e + 1.5)), elevations.map((e) => Math.log(e + 1.5)));

// Splines through nodes from 0 to 180 deg and three mirror images on either side, of what is the same on both sides of the sun.
function azimuthSplines(known, azimuths) {
  const count = known.length, nodes = [...[3, 2, 1].map((i) => -known[i]), ...known, ...[2, 3, 4].map((i) => 360 - known[count - i])];
  return splines(nodes, azimuths.map((a) => Math.abs(((a + 180) % 360 + 360) % 360 - 180))).map((through) => {
    const out = through.slice(3, 3 + count);
    [3, 2, 1].forEach((i, k) => { out[i] += through[k]; });
    [2, 3, 4].forEach((i, k) => { out[count - i] += through[3 + count + k]; });
    return out;
  });
}
