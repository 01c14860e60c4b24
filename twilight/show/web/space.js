// Above the air: lines of sight by where they pass the Earth. The same as space.glsl and sky.frag, for clicks.
const inSpace = () => !!HEAD.space && state.altitude > HEAD.space.from_km;
// An observer above the air sees the sun rise far below his horizontal.
const lowestSun = () => (inSpace() ? -60 : HEAD.sun_deg[0]);
const orbitRadius = (field) => HEAD.fields[field].radius_km + state.altitude;

// The sun's elevation and azimuth [deg] at a line's foot and the line's place among the rows; null: it misses the air.
function footOf(d, field, sun) {
  const { grazing_km: low, top_radius_km: top } = HEAD.fields[field], r = orbitRadius(field), p = r * Math.hypot(d[0], d[1]);
  if (d[2] >= 0 || p >= top) return null;
  const ground = p < low, t = -r * d[2] - (ground ? Math.sqrt(low * low - p * p) : 0);
  const n = unit(plus([0, 0, r], t, d)), level = plus(d, -dot(d, n), n), size = Math.hypot(...level);
  const f = size > 1e-6 ? level.map((x) => x / size) : [1, 0, 0];
  const up = clamp(dot(sun.direction, n), -1, 1), along = dot(sun.direction, f);
  const across = Math.sqrt(Math.max(0, 1 - up * up - along * along));
  const row = ground ? Math.min(Math.asin(p / low) / DEG, 90 - 1e-6) : 90 + p - low;
  const edge = ground ? 1 : Math.sqrt(1 - Math.exp((p - top) / HEAD.space.edge_km));   // space.py
  return { sun: Math.asin(up) / DEG, azimuth: Math.atan2(across, along) / DEG, row, edge };
}

// A line's place among the nodes of the lines above the air, 0 to 1.
function lineHeight(d, field) {
  const over = orbitRadius(field) * Math.hypot(d[0], d[1]) - HEAD.fields[field].grazing_km;
  return d[2] >= 0 ? 1 : clamp(over / HEAD.space.lines_to_km, 0, 1) ** (1 / HEAD.space.line_power);
}

// All suns of the tables above the air, as layers of a texture: of each field those of S, then those of A.
let spaceSent = false;
function uploadSpace() {
  if (spaceSent || !HEAD.space) return;
  spaceSent = true;
  const [, , suns, rows, columns] = HEAD.arrays.space_sky0.shape, size = rows * columns, parts = 2 * HEAD.fields.length;
  const out = new Float32Array(suns * parts * size * 4).fill(NO_LIGHT), lines = new Float32Array(parts * LINE);
  HEAD.fields.forEach((f, k) => {
    [`space_sky${k}`, `space_aureole${k}`].forEach((name, part) => {
      const values = tables[name], first = (2 * k + part) * suns * size;
      if (!values) return;
      for (let c = 0; c < 4; c++) for (let q = 0; q < suns * size; q++) out[(first + q) * 4 + c] = values[c * suns * size + q];
    });
    putNodes(lines, 2 * k, [f.space_sun_deg, f.space_row, HEAD.space.column_deg, []], tables[`phase${k}_space`]);
  });
  texture3d("spaceTable", columns, rows, parts * suns, out);
  texture("spaceLines", LINE / 4, parts, 4, lines);
}
