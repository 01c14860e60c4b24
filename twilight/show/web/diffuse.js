// M_0, light that is scattered more than once: a port of rays.py and diffuse.py of twilight/clear_air (see shells.js).
// Sums over azimuths go by waves, cos(m azimuth): scattering turns each into itself, and harmonics of order m are sums over
// the m-th alone.
const BOUNDARY_KM = [0, 0.02, 0.12, 0.25, 0.45, 0.7, 1, 1.35, 2, 2.5, 3.5, 5, 6, 8, 10, 12, 14, 16, 17.5, 19, 20, 21, 22, 24, 26, 30, 36, 45, 60, 78, 100];
const ZENITH_DEG = [0, 25, 45, 60, 70, 76, 80, 83, 85.5, 87.5, ...steps(89, 92, 0.5), ...steps(92, 113, 1), 115, 118, 122], LEAVING_DEG = [-60, -27, -12, -4, 4, 12, 27, 60];
const ABOVE = 10, GRAZING = 9, BELOW = 5, RAYS = ABOVE + GRAZING + BELOW, POWER = 4, POWER_BELOW = 2, CUT = 12, DEGREE = 8, FOLLOWED = 6, MOST_RATIO = 0.95, LEAST_PHASE = 0.02, LEAST_PART = 0.1, MOST_CHANGE = 1;
const DECAY_DEG = 88, DECAY = 1.1, FINE_DEG = 0.5, OPAQUE = 60, SCALE_HEIGHT_KM = 8, REFRACTIVITY = 2.8e-4, NEAR_KM = 1e-6, LAYERS = BOUNDARY_KM.length, ANGLES = ZENITH_DEG.length, LEAVING = LEAVING_DEG.length;
const HARMONICS = (DEGREE + 1) * (DEGREE + 2) / 2, MOMENTS = HARMONICS + 3, LINES = ANGLES * LAYERS * RAYS;   // of one azimuth
const WAVE_OF = range(DEGREE + 1).flatMap((n) => range(n + 1));   // of harmonics
const MIDDLE_KM = range(LAYERS - 1, (k) => 0.5 * (BOUNDARY_KM[k] + BOUNDARY_KM[k + 1])), FINE = Math.round(ZENITH_DEG.at(-1) / FINE_DEG) + 1;

// Azimuths over half a turn, and layers between boundaries, through which rays go: of the sunbeam, and of light scattered before.
const gridOf = (azimuths, boundary) => {
  const azimuth = range(azimuths, (a) => (a + 0.5) * Math.PI / azimuths);
  return { azimuths, boundary, azimuth, waves: range(azimuths, (m) => azimuth.map((a) => Math.cos(m * a))) };
};
const SUNLIT = gridOf(7, [...BOUNDARY_KM, 1.7, 3, 4, 4.5, 5.5, 28, 33, 42, 48, 54, 66, 72, 82, 90].sort((a, b) => a - b)), DIFFUSE = gridOf(4, BOUNDARY_KM);

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

// Layer of the grid, length [km] and angle at the Earth's centre to the middle [rad] of a ray's parts; start: where it does,
// one of the boundaries of parts; own: layers of these.
function segmentsOf(parts, own, start, cosine) {
  const b = parts.x[start] * Math.sqrt(1 - cosine * cosine), path = [], angle = [];
  throughParts(parts, 0, b, (i, s, phi) => { path[i] = s; angle[i] = phi; });
  const hit = cosine < 0 && b < parts.x[0], up = steps(start, path.length, 1), down = range(start, (i) => start - 1 - i).filter((i) => path[i] > 0);
  const passed = cosine >= 0 ? up : hit ? down : [...down, ...down.toReversed(), ...up], groups = [];
  let total = 0;
  for (const i of passed) {
    if (groups.at(-1)?.layer !== own[i]) groups.push({ layer: own[i], length: 0, moment: 0 });
    groups.at(-1).length += path[i];
    groups.at(-1).moment += path[i] * (total + 0.5 * angle[i]);
    total += angle[i];
  }
  return [...groups.map((g) => [g.layer, g.length, g.moment / g.length]), ...(hit ? [[own.at(-1) + 1, 0, total]] : [])];
}

// Index of the zenith angle before one, and the part of the way to the next.
function betweenZeniths(degrees) {
  const d = Math.min(degrees, ZENITH_DEG[ANGLES - 1]);
  let i = ANGLES - 2;
  while (i > 0 && ZENITH_DEG[i] > d) i--;
  return [i, (d - ZENITH_DEG[i]) / (ZENITH_DEG[i + 1] - ZENITH_DEG[i])];
}

const referenceSlope = (zenith) => -DECAY * within((zenith - DECAY_DEG) / 8, 0, 1);
const logReference = (zenith) => { const d = Math.max(zenith - DECAY_DEG, 0); return -(d < 8 ? DECAY * d * d / 16 : DECAY * (d - 4)); };

// sqrt((2 or 1) (n - m)! / (n + m)!)
const SCALE = range(DEGREE + 1, (n) => range(n + 1, (m) => Math.sqrt((m ? 2 : 1) / range(2 * m, (i) => n - m + 1 + i).reduce((a, b) => a * b, 1))));

// What harmonics of a degree and order are over the waves of this order, degree by degree, into out.
function legendreFunctions(up, out) {
  for (let m = 0, odd = 1; m <= DEGREE; odd *= 2 * m + 1, m++) for (let n = m, before = 0, now = odd; n <= DEGREE; n++) {   // odd: (2 m - 1)!!
    out[n * (n + 1) / 2 + m] = SCALE[n][m] * now;
    [before, now] = [now, ((2 * n + 1) * up * now - (n + m) * before) / (n - m + 1)];
  }
}

// sin^m(zenith angle) cos(m azimuth) of a direction by its parts upwards and towards the sun, into out.
function waves(up, aside, out) {
  const across = Math.sqrt(Math.max(1 - up * up - aside * aside, 0));
  for (let m = 0, cosine = 1, sine = 0; m <= DEGREE; m++) {
    out[m] = cosine;
    [cosine, sine] = [cosine * aside - sine * across, sine * aside + cosine * across];
  }
}

// Cosines of the zenith angles of the rays from a layer, or null for the ground, and their weights in means.
function directions(layer) {
  if (layer === null) { const [up, weight] = gauss(RAYS); return [up, up.map((u, i) => 2 * u * weight[i])]; }
  const [ground, own] = [0, MIDDLE_KM[layer]].map((z) => (1 + REFRACTIVITY * Math.exp(-z / SCALE_HEIGHT_KM)) * (EARTH_RADIUS_KM + z));
  const horizon = Math.sqrt(1 - (ground / own) ** 2), beyond = 1 - horizon, up = gauss(ABOVE, POWER), grazing = gauss(GRAZING), down = gauss(BELOW, POWER_BELOW);
  return [[...down[0].map((c) => -horizon - beyond * c).reverse(), ...grazing[0].map((c) => -horizon * c).reverse(), ...up[0]],
    [...down[1].map((w) => 0.5 * beyond * w).reverse(), ...grazing[1].map((w) => 0.5 * horizon * w).reverse(), ...up[1].map((w) => 0.5 * w)]];
}

// The rays of a grid, seen under azimuths a and zenith angles c of the sun: segments n of rays r, RAYS from each layer k.
// place: [a][c][n], of each segment in light by layer and fine zenith angle; leaving: how much further it is in light by
// layer, elevation and fine zenith angle; turned, means: see `turning`.
function rays(grid) {
  if (grid.made) return grid.made;
  const { boundary, azimuths } = grid, known = sublayers(boundary), heights = [...known, ...MIDDLE_KM.filter((z) => !known.some((other) => Math.abs(z - other) <= NEAR_KM))].sort((a, b) => a - b), segment = { ray: [], layer: [], length: [], angle: [], leaving: [] }, cosine = [], weight = [], first = [];
  const parts = partsOf(heights.map((z) => EARTH_RADIUS_KM + z), heights.map((z) => 1 + REFRACTIVITY * Math.exp(-z / SCALE_HEIGHT_KM)));
  const own = range(heights.length - 1, (i) => searchsorted(boundary, 0.5 * (heights[i] + heights[i + 1])) - 1);
  for (let k = 0; k < LAYERS; k++) {
    const from = k < LAYERS - 1 ? k : null, start = nearest(heights, from === null ? 0 : MIDDLE_KM[k]), [cosines, weights] = directions(from);
    cosines.forEach((c, i) => {
      first.push(segment.ray.length);
      for (const [layer, length, angle] of segmentsOf(parts, own, start, c)) {
        const near = nearest(LEAVING_DEG, (Math.asin(c) + angle) / RAD), values = { ray: RAYS * k + i, layer, length, angle, leaving: ((LEAVING - 1) * layer + near) * FINE };
        for (const key in values) segment[key].push(values[key]);
      }
    });
    cosine.push(...cosines);
    weight.push(...weights);
  }
  for (const key in segment) segment[key] = (key === "length" || key === "angle" ? Float64Array : Int32Array).from(segment[key]);
  const count = segment.ray.length;
  first.push(count);
  return (grid.made = { ...segment, grid, ground: boundary.length - 1, count, first: Int32Array.from(first), cosine, weight, place: placesOf(segment, grid), ...turning(cosine, weight),
    last: new Float64Array(azimuths * LINES), all: new Float64Array(azimuths * LINES), sent: new Float64Array(azimuths * LAYERS * LEAVING * ANGLES), table: new Float64Array(Math.max(LAYERS * LEAVING, boundary.length) * FINE) });
}

// `place` of segments.
function placesOf({ layer, angle }, { azimuths, azimuth }) {
  const count = layer.length, out = new Uint16Array(azimuths * ANGLES * count);
  for (let a = 0, p = 0; a < azimuths; a++) for (let c = 0; c < ANGLES; c++) {
    const cos = Math.cos(ZENITH_DEG[c] * RAD), aside = Math.sin(ZENITH_DEG[c] * RAD) * Math.cos(azimuth[a]);
    for (let n = 0; n < count; n++, p++) {
      const local = Math.acos(within(cos * Math.cos(angle[n]) + aside * Math.sin(angle[n]), -1, 1)) / RAD;
      out[p] = layer[n] * FINE + Math.min(Math.round(local / FINE_DEG), FINE - 1);
    }
  }
  return out;
}

// turned: [layer][wave][leaving][ray][CUT], weights of waves of rays in those of light that leaves, times Legendre
// polynomials of the angles between them; means: [layer][harmonic][ray], weights of waves of rays in the harmonics.
function turning(cosine, weight) {
  const count = DIFFUSE.azimuths, turned = new Float32Array((LAYERS - 1) * count * LEAVING * RAYS * CUT), means = new Float64Array(LAYERS * HARMONICS * RAYS), out = new Float64Array(HARMONICS), around = new Float64Array(DEGREE + 1);
  const apart = range(2 * CUT, (j) => (j + 0.5) * Math.PI / (2 * CUT)), by = range(count, (m) => apart.map((angle) => (m ? 2 : 1) * Math.cos(m * angle) / apart.length));
  for (let r = 0; r < LAYERS * RAYS; r++) {
    const k = Math.floor(r / RAYS), i = r % RAYS, aside = Math.sqrt(1 - cosine[r] ** 2);
    legendreFunctions(cosine[r], out);
    waves(cosine[r], aside, around);
    for (let m = 0; m < HARMONICS; m++) means[(k * HARMONICS + m) * RAYS + i] = weight[r] * out[m] * around[WAVE_OF[m]];
    for (let o = 0; o < LEAVING && k < LAYERS - 1; o++) apart.forEach((angle, j) => {
      const e = LEAVING_DEG[o] * RAD, p = legendre(within(Math.sin(e) * cosine[r] + Math.cos(e) * aside * Math.cos(angle), -1, 1), CUT - 1);
      for (let m = 0; m < count; m++) for (let l = 0, at = (((k * count + m) * LEAVING + o) * RAYS + i) * CUT; l < CUT; l++) turned[at + l] += weight[r] * by[m][j] * p[l];
    });
  }
  return { turned, means };
}

// How light at the fine zenith angles is made of that at ZENITH_DEG.
const AT_FINE = range(FINE, (i) => {
  const [below, f] = betweenZeniths(FINE_DEG * i), [one, other] = [below, below + 1].map((j) => Math.exp(logReference(FINE_DEG * i) - logReference(ZENITH_DEG[j])));
  return { below, one: (1 - f) * one, other: f * other };
}), FINE_BELOW = Uint8Array.from(AT_FINE, (v) => v.below), FINE_ONE = Float64Array.from(AT_FINE, (v) => v.one), FINE_OTHER = Float64Array.from(AT_FINE, (v) => v.other);

// Light by layer and zenith angle, from one layer on, at the fine zenith angles.
function atFine(light, from, count, out) {
  for (let l = 0, o = 0, j = from * ANGLES; l < count; l++, j += ANGLES) for (let i = 0; i < FINE; i++, o++) out[o] = FINE_ONE[i] * light[j + FINE_BELOW[i]] + FINE_OTHER[i] * light[j + FINE_BELOW[i] + 1];
}

// The first waves of light along the rays from a layer under a zenith angle, which starts at `at`: [wave][ray].
function wavesOf({ grid: { azimuths, waves } }, radiance, at, count, out) {
  for (let m = 0, o = 0; m < count; m++) for (let i = 0; i < RAYS; i++, o++) {
    let wave = 0;
    for (let a = 0, q = at + i; a < azimuths; a++, q += LINES) wave += waves[m][a] * radiance[q];
    out[o] = wave / azimuths;
  }
}

// What scatters in the layers of a grid: extinction [km^-1], albedo of air and each aerosol, (2 l + 1) x moments.
function kindsOf(air, { boundary }) {
  const place = boundary.map((z) => searchsorted(ALTITUDE_KM, z - 1e-9)), inLayers = (row) => { const below = cumulative(row); return range(boundary.length - 1, (l) => below[place[l + 1]] - below[place[l]]); };
  const peaks = air.moments.map((m) => Math.max(m[CUT], 0)), aerosols = air.aerosolDepth.map(inLayers), rows = air.depth.map(inLayers), all = rows[AIR].map((v, l) => v + rows[ABSORPTION][l] + rows[EXTINCTION][l]);
  const depth = all.map((v, l) => v - sum(aerosols.map((row, k) => peaks[k] * row[l]))), scattering = [rows[AIR], ...aerosols.map((row, k) => row.map((v) => (1 - peaks[k]) * v))];
  return {
    polarising: (1 - air.depolarisation) / (2 + air.depolarisation),
    extinction: [...depth.map((v, l) => v / (boundary[l + 1] - boundary[l])), 0],
    albedo: scattering.map((row) => [...row.map((v, l) => v / depth[l]), 0]),
    series: air.moments.map((m, k) => range(CUT, (l) => (2 * l + 1) * (m[l] - peaks[k]) / (1 - peaks[k]))),
  };
}

// Coefficients of powers in a Legendre series.
const POWERS = range(CUT).reduce((rows, l) => [...rows, range(CUT, (p) => (l < 2 ? +(l === p) : ((2 * l - 1) * (rows[l - 1][p - 1] ?? 0) - (l - 1) * rows[l - 2][p]) / l))], []);
const inPowers = (series) => Float64Array.from({ length: CUT }, (_, p) => sum(series.map((s, l) => s * POWERS[l][p])));

// Moments of light scattered at least once, over F0, the reference taken off: [layer][zenith angle][MOMENTS]; depth: of
// the beams, places: of all zenith angles at the boundaries of shells, scattered: by each shell.
function diffuseLight(air, depth, places, boundary, scattered) {
  const once = rays(SUNLIT), again = rays(DIFFUSE), kinds = kindsOf(air, DIFFUSE), { last, all } = again, layers = SUNLIT.boundary.length - 1;
  const beam = places.map((row) => row.map((p) => logSunbeam(depth, p))), light = new Float64Array((layers + 1) * ANGLES), layer = scattered.map((_, k) => searchsorted(SUNLIT.boundary, 0.5 * (boundary[k] + boundary[k + 1])) - 1);
  const whole = new Float64Array(layers);
  layer.forEach((l, k) => { whole[l] += scattered[k]; });
  layer.forEach((l, k) => {
    const share = scattered[k] / whole[l] / (4 * Math.PI);
    for (let c = 0; c < ANGLES; c++) light[l * ANGLES + c] += share * logMean(beam[k][c], beam[k + 1][c]) * litFraction(places[k][c][2], places[k + 1][c][2]);
  });
  for (let c = 0; c < ANGLES; c++) if (places[0][c][2] > 0) light[layers * ANGLES + c] = air.groundAlbedo / Math.PI * Math.exp(beam[0][c]) * Math.max(Math.cos(ZENITH_DEG[c] * RAD), 0);
  const out = new Float64Array(LAYERS * ANGLES * MOMENTS), into = intoLeaving(again, kinds), reaching = reachingStart(again, kinds);
  scatteredOnce(once, light, kindsOf(air, SUNLIT), out);
  addMoments(once, once.last, HARMONICS, out, MOMENTS);
  all.fill(0);
  let before = null;
  for (let order = 1; order < FOLLOWED; order++) {
    if (order === FOLLOWED - 1) before = meanLight(again, last);
    scatteredAgain(order > 1 ? again : once, again, into, air.groundAlbedo);
    arriving(again, reaching);
    for (let q = 0; q < all.length; q++) all[q] += last[q];
  }
  // the rest, a geometric series; where the sun is low its ratio falls later towards that of a high one
  const ratio = meanLight(again, last).map((v, i) => within(v / Math.max(before[i], 1e-30), 0, MOST_RATIO));
  const times = ratio.map((v, i) => { const mean = 0.5 * (v + Math.min(v, ratio[i - i % ANGLES])); return mean / (1 - mean); });
  for (let q = 0; q < all.length; q++) all[q] += last[q] * times[(Math.floor(q / RAYS) % LAYERS) * ANGLES + Math.floor(q / (LAYERS * RAYS)) % ANGLES];
  addMoments(again, all, HARMONICS, out, MOMENTS);
  const taken = ZENITH_DEG.map((z) => Math.exp(-logReference(z)));
  for (let i = 0; i < out.length; i++) out[i] *= taken[Math.floor(i / MOMENTS) % ANGLES];
  return out;
}

// What comes from each segment to the start of its ray if nothing is absorbed.
function reachingStart(r, { extinction }) {
  const out = new Float64Array(r.count);
  for (let n = 0, passed = 0; n < r.count; n++) {
    if (n === r.first[r.ray[n]]) passed = 0;
    const tau = r.layer[n] === r.ground ? OPAQUE : extinction[r.layer[n]] * r.length[n];
    out[n] = -Math.exp(-passed) * Math.expm1(-tau);
    passed += tau;
  }
  return out;
}

// Into `last` what comes along the rays of light in segments; out: adds its polarisation by air.
function scatteredOnce(r, light, kinds, out) {
  const { albedo, series, polarising } = kinds, { first, layer, place, cosine, table, last, grid } = r, powers = series.map(inPowers), scattered = new Float64Array(series.length);
  const reaching = reachingStart(r, kinds), [byAir, ...byAerosols] = albedo.map((row) => reaching.map((v, n) => v * row[layer[n]]));
  atFine(light, 0, r.ground + 1, table);
  for (let a = 0, q = 0, p = 0; a < grid.azimuths; a++) for (let c = 0; c < ANGLES; c++) {
    const cos = Math.cos(ZENITH_DEG[c] * RAD), sin = Math.sin(ZENITH_DEG[c] * RAD), side = Math.cos(grid.azimuth[a]);
    for (let i = 0, n = 0; i < LAYERS * RAYS; i++, q++) {
      let air = 0, ground = 0, aerosols = 0;
      scattered.fill(0);
      for (const end = first[i + 1]; n < end; n++, p++) {
        const v = table[place[p]];
        air += v * byAir[n];
        for (let k = 0; k < scattered.length; k++) scattered[k] += v * byAerosols[k][n];
      }
      if (layer[n - 1] === r.ground) ground = reaching[n - 1] * table[place[p - 1]];   // the last segment of a ray
      const u = cosine[i], s = Math.sqrt(1 - u * u) * side, x = u * cos + s * sin, sine2 = 1 - x * x, acrossU = cos - u * x, acrossS = sin - s * x;
      for (let k = 0; k < scattered.length; k++) {
        let phase = 0;
        for (let l = CUT - 1; l >= 0; l--) phase = phase * x + powers[k][l];
        aerosols += scattered[k] * Math.max(phase, LEAST_PHASE);
      }
      last[q] = air * (1 + polarising * (1.5 * x * x - 0.5)) + aerosols + ground;
      const o = (Math.floor(i / RAYS) * ANGLES + c) * MOMENTS + HARMONICS, by = 0.75 * polarising * r.weight[i] / grid.azimuths * air;
      out[o] += by * (sine2 * (1 - u * u) - 2 * acrossU * acrossU);
      out[o + 1] += by * (-sine2 * u * s - 2 * acrossU * acrossS);
      out[o + 2] += by * (sine2 * (1 - s * s) - 2 * acrossS * acrossS);
    }
  }
}

// How much of waves along the rays a layer scatters into LEAVING_DEG, [layer][wave][leaving][ray].
function intoLeaving({ turned }, { albedo, series, polarising }) {
  const each = DIFFUSE.azimuths * LEAVING * RAYS, out = new Float64Array((LAYERS - 1) * each);
  for (let k = 0, o = 0; k < LAYERS - 1; k++) {
    const by = Float64Array.from({ length: CUT }, (_, l) => sum(series.map((s, kind) => albedo[kind + 1][k] * s[l])));
    by[0] += albedo[0][k];
    by[2] += albedo[0][k] * polarising;
    for (const end = o + each; o < end; o++) for (let l = 0; l < CUT; l++) out[o] += by[l] * turned[o * CUT + l];
  }
  return out;
}

// Into `sent`, [azimuth][layer][leaving][zenith angle], what layers and the ground send of the last light along some rays,
// over what they take out of a ray.
function scatteredAgain(from, { sent, grid: { azimuths, waves: turns } }, into, groundAlbedo) {
  const waves = new Float64Array(azimuths * RAYS), leaving = new Float64Array(azimuths * LEAVING);
  for (let k = 0; k < LAYERS; k++) for (let c = 0; c < ANGLES; c++) {
    wavesOf(from, from.last, (c * LAYERS + k) * RAYS, azimuths, waves);
    if (k === LAYERS - 1) {
      let mean = 0;
      for (let i = 0; i < RAYS; i++) mean += from.means[k * HARMONICS * RAYS + i] * waves[i];
      leaving.fill(0).fill(groundAlbedo * mean, 0, LEAVING);
    } else for (let m = 0, o = 0, p = k * azimuths * LEAVING * RAYS; m < azimuths; m++) for (let e = 0; e < LEAVING; e++, o++) {
      let wave = 0;
      for (let i = 0; i < RAYS; i++, p++) wave += into[p] * waves[m * RAYS + i];
      leaving[o] = wave;
    }
    for (let a = 0; a < azimuths; a++) for (let e = 0; e < LEAVING; e++) {
      let light = 0;
      for (let m = 0; m < azimuths; m++) light += turns[m][a] * leaving[m * LEAVING + e];
      sent[((a * LAYERS + k) * LEAVING + e) * ANGLES + c] = light > 0 ? light : 0;
    }
  }
}

// Into `last` what comes along the rays of what is `sent`.
function arriving({ first, place, leaving, table, last, sent, grid }, reaching) {
  for (let a = 0, q = 0, p = 0; a < grid.azimuths; a++) {
    atFine(sent, a * LAYERS * LEAVING, LAYERS * LEAVING, table);
    for (let c = 0; c < ANGLES; c++) for (let i = 0, n = 0; i < LAYERS * RAYS; i++, q++) {
      let light = 0;
      for (const end = first[i + 1]; n < end; n++, p++) light += table[place[p] + leaving[n]] * reaching[n];
      last[q] = light;
    }
  }
}

// Mean light of radiance along the rays, [layer][zenith angle].
function meanLight(r, radiance) {
  const out = new Float64Array(LAYERS * ANGLES);
  addMoments(r, radiance, 1, out, 1);
  return out;
}

// Adds the first moments of radiance along the rays to out, [layer][zenith angle], `apart` apart.  Waves shorter than twice
// the distance of azimuths look like longer ones: those moments are left out.
function addMoments(r, radiance, many, out, apart) {
  const count = many > 1 ? Math.min(DEGREE + 1, r.grid.azimuths) : 1, waves = new Float64Array(count * RAYS);
  for (let k = 0, o = 0; k < LAYERS; k++) for (let c = 0; c < ANGLES; c++, o += apart) {
    wavesOf(r, radiance, (c * LAYERS + k) * RAYS, count, waves);
    for (let m = 0; m < many; m++) {
      if (WAVE_OF[m] >= count) continue;
      const p = (k * HARMONICS + m) * RAYS, w = WAVE_OF[m] * RAYS;
      let moment = 0;
      for (let i = 0; i < RAYS; i++) moment += r.means[p + i] * waves[w + i];
      out[o + m] += moment;
    }
  }
}

// The sum of the first term of a series, at least 0, and further ones; never negative, without a kink.
const positive = (first, further) => { const whole = 1 + further / Math.max(first, 1e-35); return first * (whole > LEAST_PART ? whole : LEAST_PART * Math.exp(whole / LEAST_PART - 1)); };

// What of diffuse light is scattered along lines of sight towards the observer: of each line the angles at the Earth's centre to
// the layers' mean points; seen: [w][line], by layer and zenith angle, its mean light and further moments by waves around the
// zenith, the change of ln(mean light) a degree, and by layer how much nearer the light is [rad].
function lastScattering(skies, elevations) {
  const lines = skies.geometry.line(elevations), shared = betweenMiddles(skies.geometry), { layers } = shared, angles = lines.map(({ path, angle }) => {
    const [top, bottom] = [new Float64Array(layers.length), new Float64Array(layers.length)];
    shared.each((g, k, part, z) => { const share = part * path[k] * Math.exp(-z / SCALE_HEIGHT_KM); top[g] += share * 0.5 * (angle[k] + angle[k + 1]); bottom[g] += share; });
    return top.map((v, g) => v / bottom[g]);
  });
  const seen = skies.at.map((one) => {
    const byDegree = scatteringByDegree(one.air), log = (g, c) => Math.log(Math.max(one.diffuse[(layers[g] * ANGLES + c) * MOMENTS], DARK));
    const slope = Float64Array.from({ length: layers.length * ANGLES }, (_, i) => { const g = Math.floor(i / ANGLES), c = i % ANGLES; return c < ANGLES - 1 ? (log(g, c + 1) - log(g, c)) / (ZENITH_DEG[c + 1] - ZENITH_DEG[c]) : 0; });
    return lines.map((way, j) => {
      const { by, nearer } = weightsAlong(byDegree, one.extinction, skies.geometry, way, shared, angles[j]);
      return { slope, nearer, light: byWaves(one.diffuse, layers, by, angles[j].map((angle) => Math.sin(elevations[j] * RAD + angle))) };
    });
  });
  return { elevations, angles, seen };
}

// Of a line of sight, [layer][zenith angle][SEEN]: mean light and, times waves that SUNLIT tells apart, that of its further moments; by:
// of `weightsAlong`; up: sines of the elevations at the layers.
const SEEN = SUNLIT.azimuths + 1;
function byWaves(diffuse, layers, by, up) {
  const out = new Float64Array(layers.length * ANGLES * SEEN), functions = new Float64Array(HARMONICS);
  layers.forEach((layer, g) => {
    const o = g * (DEGREE + 2), u = up[g], byAir = -3 * by[o + DEGREE + 1];
    legendreFunctions(u, functions);
    for (let n = 1, m = 1; n <= DEGREE; n++) for (const end = m + n, of = by[o + n] + (n === 2 ? by[o + DEGREE + 1] : 0); m <= end; m++) functions[m] *= of;
    for (let c = 0, p = layer * ANGLES * MOMENTS, q = g * ANGLES * SEEN; c < ANGLES; c++, p += MOMENTS, q += SEEN) {
      const uu = byAir * diffuse[p + HARMONICS], us = byAir * diffuse[p + HARMONICS + 1], ss = byAir * diffuse[p + HARMONICS + 2];
      out[q] = by[o] * diffuse[p];
      for (let m = 0; m < SEEN - 1; m++) {
        let wave = 0;
        for (let n = Math.max(m, 1), h = n * (n + 1) / 2 + m; n <= DEGREE; n++, h += n) wave += functions[h] * diffuse[p + h];
        out[q + 1 + m] = wave;
      }
      out[q + 1] += (1.5 * u * u - 0.5) * uu;
      out[q + 2] += 2 * u * us;
      out[q + 3] += 0.5 * uu + ss;
    }
  });
  return out;
}

// M_0 under suns along lines of sight of `lastScattering`, [w][(sun * elevations + elevation) * azimuths + azimuth].
function seenAlong(suns, azimuths, { elevations, angles, seen }) {
  const out = seen.map(() => new Float64Array(suns.length * elevations.length * azimuths.length)), around = new Float64Array(DEGREE + 1);
  suns.forEach((sun, i) => elevations.forEach((elevation, j) => azimuths.forEach((azimuth, k) => {
    const here = (i * elevations.length + j) * azimuths.length + k, [e, up] = [elevation * RAD, (90 - sun) * RAD], side = Math.cos(azimuth * RAD);
    const fromSun = Math.cos(up) * Math.sin(e) + Math.sin(up) * Math.cos(e) * side;
    angles[j].forEach((angle, g) => {
      const zenith = zenithAt(sun, angle, azimuth), sine = Math.max(Math.sin(zenith), 1e-3), [below, f] = betweenZeniths(zenith / RAD), reference = logReference(zenith / RAD), u = Math.sin(e + angle);
      // an angle at the Earth's centre towards the sun takes as much from that between the sun and the zenith
      const towards = (Math.cos(angle) * side * Math.sin(up) - Math.sin(angle) * Math.cos(up)) / sine / RAD, slope = referenceSlope(zenith / RAD), cell = g * ANGLES + below;
      waves(u, within((fromSun - Math.cos(zenith) * u) / sine, -1, 1), around);
      for (let w = 0; w < seen.length; w++) {
        const { light, slope: slopes, nearer } = seen[w][j], p = cell * SEEN, q = p + SEEN;
        let first = 0, last = 0;
        for (let m = 0; m < SEEN - 1; m++) { first += around[m] * light[p + 1 + m]; last += around[m] * light[q + 1 + m]; }
        const change = within((slope + slopes[cell]) * towards * nearer[g], -MOST_CHANGE, MOST_CHANGE);
        out[w][here] += positive(light[p] * (1 - f) + light[q] * f, first * (1 - f) + last * f) * Math.exp(reference + change);
      }
    });
  })));
  return out.map((values) => values.map((v) => Math.max(v, DARK)));
}

// The layers whose light is seen, linear in altitude between their middles; each(f): f(layer's place, k, its share, altitude)
// of the middle of every shell k above the observer.
function betweenMiddles({ middle, first }) {
  const shares = middle.slice(first).map((z) => {
    const i = within(searchsorted(MIDDLE_KM, z) - 1, 0, MIDDLE_KM.length - 2), part = within((z - MIDDLE_KM[i]) / (MIDDLE_KM[i + 1] - MIDDLE_KM[i]), 0, 1);
    return [[i, 1 - part, z], [i + 1, part, z]].filter(([, share]) => share > 0);
  });
  const layers = [...new Set(shares.flat().map(([layer]) => layer))].sort((a, b) => a - b);
  const placed = shares.map((row) => row.map(([layer, share, z]) => [layers.indexOf(layer), share, z]));
  return { layers, each: (f) => placed.forEach((row, k) => row.forEach(([g, share, z]) => f(g, k, share, z))) };
}

// Scattering of the moments of degree 0 to DEGREE by all, and of the second by air alone, by layer of ALTITUDE_KM [km^-1].
function scatteringByDegree({ depth, aerosolDepth, moments, degree, depolarisation }) {
  const cut = moments.map((m) => peak(degree, m));
  return Array.from(depth[AIR], (air, l) => {
    const by = range(DEGREE + 1, (n) => (2 * n + 1) * sum(moments.map((m, i) => aerosolDepth[i][l] * (m[n] - cut[i]))) + (n ? 0 : air));
    return Float64Array.from([...by, air * (1 - depolarisation) / (2 + depolarisation)], (v) => v / (ALTITUDE_KM[l + 1] - ALTITUDE_KM[l]));
  });
}

// Of a line of sight: what the last scattering `byDegree` adds, by layer; and how much nearer than an angle [rad] the light is
// seen.
function weightsAlong(byDegree, extinction, { layer, first }, { path, angle }, shared, angles) {
  const size = DEGREE + 2, count = shared.layers.length, by = new Float64Array(count * size), top = new Float64Array(count), bottom = new Float64Array(count);
  const seen = new Float64Array(path.length), near = new Float64Array(path.length);
  for (let k = 0, before = 0; k < path.length; k++) {
    const inside = path[k] * extinction[first + k];
    seen[k] = Math.exp(-before) * (inside < 1e-6 ? path[k] : -Math.expm1(-inside) / extinction[first + k]);
    near[k] = angle[k] + (angle[k + 1] - angle[k]) * (inside < 1e-3 ? 0.5 - inside / 12 : 1 / inside - 1 / Math.expm1(inside));
    before += inside;
  }
  shared.each((g, k, part) => {
    const of = byDegree[layer[first + k]], some = part * seen[k];
    for (let n = 0; n < size; n++) by[g * size + n] += some * of[n];
    const share = some * of[0] + 1e-20 * part * path[k];
    top[g] += share * near[k];
    bottom[g] += share;
  });
  return { by, nearer: top.map((v, g) => angles[g] - v / bottom[g]) };
}
