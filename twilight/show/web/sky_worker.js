// A worker of a page whose sliders change the air: from their values to light at some of the wavelengths, and from the
// light that all workers found to the sky's table, S and A of table.glsl.
let given = null, lastAir = "", skies = null, phase = null, done = null;

// First what the page holds, then questions, one after the other; an error is the worker's, not a promise's.
onmessage = ({ data }) => {
  done = data.model ? prepare(data) : done.then(() => postMessage(data.answers ? tableOf(data) : answer(data)));
  done.catch((error) => setTimeout(() => { throw error; }));
};

async function prepare(data) {
  const [model, below, above] = await Promise.all([data.model, data.below, data.above].map(readNpz));
  given = { ...data, model: new Model(model), below: airOf(below), above: airOf(above) };
}

// Light at each `parts`-th wavelength from one on.
function answer({ part, parts, sun, ...question }) {
  const key = JSON.stringify(question);
  if (key !== lastAir) {
    const air = changedAir(question);
    skies = new Skies(given.model, { ...air, at: air.at.filter((_, w) => w % parts === part) }, question.observer, given.screen);
    phase = part === 0 && air.at[0].aerosolDepth.length ? meanPhase(air) : null;
    lastAir = key;
  }
  const sky = skies.behind(sun).sky(sun);
  return { part, apparent: sky.apparent, spreads: sky.spreads, light: sky.light(given.rows, given.columns) };
}

// The air of sliders: sums of what is below the stratosphere and what is in it, as clear_air/of_medium.py has it.
// aerosol, stratosphere, ozone: factors of what the page was made of; albedo: likewise, or itself over black ground
function changedAir({ aerosol, stratosphere, ozone, albedo }) {
  const mixed = (a, b) => a.map((v, l) => aerosol * v + stratosphere * b[l]), count = given.below.at.length;
  const at = given.below.at.map((low, w) => {
    const high = given.above.at[w], power = given.screen?.powers[w], depth = low.depth.map((row, k) => (k < EXTINCTION ? row.slice() : mixed(row, high.depth[k])));
    depth[ABSORPTION] = depth[ABSORPTION].map((v, l) => v + (ozone - 1) * given.ozone[l * count + w]);
    const parts = [LOW, HIGH].map((k) => [aerosol * sum(low.depth[k]), stratosphere * sum(high.depth[k])]);
    const mean = (name, through, back, none) => parts.map(([a, b], k) => low[name][k].map((v, i) => (a + b > 0 ? back((a * through(v, i) + b * through(high[name][k][i], i)) / (a + b), i) : none(i))));
    const asLog = (f, i) => (i ? f : 0), one = { ...low, depth, power, aerosolDepth: low.aerosolDepth.map((row, k) => mixed(row, high.aerosolDepth[k])) };
    one.mixedMoments = mean("mixedMoments", (v) => v, (v) => v, (i) => (i ? 0 : 1));
    one.mixedPhase = mean("mixedPhase", (v, i) => (i ? Math.exp(v) : v), (v, i) => (i ? Math.log(v) : v), (i) => asLog(-Math.log(4 * Math.PI), i));
    one.groundAlbedo = within(given.albedo > 0 ? low.groundAlbedo * albedo / given.albedo : albedo, 0, 1);
    return one;
  });
  const degree = degreeOf(at);
  at.forEach((one) => { one.degree = degree; });
  return { ...given.below, at };
}

// The degree to which phase functions are followed, `_degree` of clear_air/of_medium.py.
const LEAST_DEGREE = 12, MOST_PEAK = 0.055, HAZE_DEPTHS = [3, 5], LAYER_DEPTH = 0.02, NEGLIGIBLE_AIR = 0.01;
function degreeOf(at) {
  const peaks = range(MOST_DEGREE - LEAST_DEGREE + 1, () => 0);
  let most = 0, aloft = 0;
  for (const { depth, mixedMoments: m } of at) {
    const scattered = depth[LOW].map((v, l) => v + depth[HIGH][l]), all = scattered.map((v, l) => v + depth[AIR][l]), perKm = all.map((v, l) => v / (ALTITUDE_KM[l + 1] - ALTITUDE_KM[l]));
    const least = NEGLIGIBLE_AIR * Math.max(...perKm);
    all.forEach((v, l) => { if (v > 0 && perKm[l] >= least) peaks.forEach((p, i) => { peaks[i] = Math.max(p, sum([LOW, HIGH].map((row, k) => depth[row][l] / v * m[k][LEAST_DEGREE + i + 1]))); }); });
    most = Math.max(most, sum(all));
    aloft = Math.max(aloft, sum(scattered.filter((_, l) => ALTITUDE_KM[l] >= 10)));
  }
  if (aloft > LAYER_DEPTH) return MOST_DEGREE;
  const last = peaks.findLastIndex((p) => p > MOST_PEAK), grows = within((HAZE_DEPTHS[1] - most) / (HAZE_DEPTHS[1] - HAZE_DEPTHS[0]), 0, 1);
  if (last < 0) return LEAST_DEGREE;
  return LEAST_DEGREE + grows * (last + (last + 1 < peaks.length ? (peaks[last] - MOST_PEAK) / (peaks[last] - peaks[last + 1]) : 0));
}

// X, Y, Z and scotopic luminance of a spectrum at the page's wavelengths, or of parts of it: these are interpolated, not
// their logarithms, for in the shadow of the Earth some are 0.
function channelsOf(spectrum, parts = null) {
  const logs = spectrum.map((v) => Math.log(Math.max(v, 1e-37))), bands = logs.length, sums = [0, 0, 0, 0, 0];
  for (let t = 0; t < given.colour.length / 5; t++) {
    let log = 0, part = 0;
    for (let w = 0; w < bands; w++) {
      log += given.logSpectrum[t * bands + w] * logs[w];
      if (parts) part += given.logSpectrum[t * bands + w] * parts[w];
    }
    const light = Math.exp(log) * (parts ? within(part, 0, 1) : 1);
    for (let c = 0; c < 5; c++) sums[c] += given.colour[5 * t + c] * light;
  }
  const [x, y, z, luminance, scotopic] = sums.map((v) => Math.max(v, 0)), scale = y > 0 ? luminance / y : 0;
  return [scale * x, luminance, scale * z, scotopic];
}

// ln of the aerosol's mean phase function in the four channels, at `phaseCount` angles.
function meanPhase({ at }) {
  const n = given.phaseCount, whole = channelsOf(at.map(() => 1)), out = new Float32Array(4 * n), last = at[0].logPhase[0].length - 1;
  const weights = at.map(({ aerosolDepth }) => aerosolDepth.map(sum)), totals = weights.map((each) => Math.max(sum(each), 1e-30));
  for (let i = 0; i < n; i++) {
    const where = i / (n - 1) * last, j = Math.min(Math.floor(where), last - 1), f = where - j;
    const spectrum = at.map(({ logPhase }, w) => sum(logPhase.map((table, k) => weights[w][k] / totals[w] * Math.exp(table[j] * (1 - f) + table[j + 1] * f))));
    channelsOf(spectrum).forEach((v, c) => { out[4 * i + c] = Math.log(Math.max(v / whole[c], 1e-30)); });
  }
  return out;
}

// Of sky/table.py, `split`: how much of the light A holds at most, and the part of all else that it holds at least.
const LARGEST_FRACTION = 0.98, REST = 0.01;
function tableOf({ answers, sun }) {
  const { rows, columns, column, phaseCount } = given, { apparent } = answers[0], light = given.below.at.map((_, w) => answers[w % answers.length].light[Math.floor(w / answers.length)]), wide = column.length, size = rows.length * wide;
  const smooth = new Float32Array(4 * size), aureole = phase && new Float32Array(4 * size), spectrum = new Float32Array(light.length * size), s = apparent * RAD;
  for (let r = 0; r < rows.length; r++) for (let c = 0; c < columns.length; c++) {
    const i = r * columns.length + c, spectral = light.map((one) => one.light[i]), all = channelsOf(spectral), once = phase && channelsOf(spectral, light.map((one, w) => one.aerosol[i] / Math.max(spectral[w], 1e-37))), e = rows[r] * RAD;
    const angle = Math.acos(within(Math.sin(e) * Math.sin(s) + Math.cos(e) * Math.cos(s) * Math.cos(columns[c] * RAD), -1, 1)), where = Math.sqrt(angle / Math.PI) * (phaseCount - 1), j = Math.min(Math.floor(where), phaseCount - 2);
    column.forEach((own, k) => {
      if (own !== c) return;
      const at = r * wide + k;
      for (let w = 0; w < light.length; w++) spectrum[w * size + at] = Math.log(Math.max(light[w].light[i], 1e-37));
      for (let q = 0; q < 4; q++) {
        const whole = Math.max(all[q], 1e-37), most = phase ? Math.min(once[q], LARGEST_FRACTION * whole) : 0, part = phase ? most + REST * (whole - most) : 0;
        smooth[q * size + at] = Math.log(whole - part);
        if (phase) aureole[q * size + at] = Math.log(part) - phase[4 * j + q] - (where - j) * (phase[4 * j + 4 + q] - phase[4 * j + q]);
      }
    });
  }
  return { smooth, aureole, phase, spectrum, apparent, error: relativeError(answers.flatMap((one) => one.spreads), sun, given.model.error) };
}
