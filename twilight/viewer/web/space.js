// Above the air: lines of sight by where they pass the Earth. The same as space.glsl and sky.frag, for clicks.
const inSpace = () => !!HEAD.space && state.altitude > HEAD.space.from_km;
// An observer above the air sees the sun rise far below his horizontal.
const lowestSun = () => (inSpace() ? -60 : HEAD.sun_deg[0]);
const orbitRadius = (field) => HEAD.fields[field].radius_km + state.altitude;

// Rows of the tables above the air of one field: ground, limb.
const spaceRows = () => HEAD.texels.ground + HEAD.texels.haze + HEAD.space.limb;

// The sun's elevation and azimuth [deg] at a line's foot and the line's place among the rows; null: it misses the air.
function footOf(d, field, sun) {
  const { grazing_km: low, top_radius_km: top } = HEAD.fields[field], r = orbitRadius(field), p = r * Math.hypot(d[0], d[1]);
  if (d[2] >= 0 || p >= top) return null;
  const ground = p < low, t = -r * d[2] - (ground ? Math.sqrt(low * low - p * p) : 0);
  const n = unit(plus([0, 0, r], t, d)), level = plus(d, -dot(d, n), n), size = Math.hypot(...level);
  const f = size > 1e-6 ? level.map((x) => x / size) : [1, 0, 0];
  const up = clamp(dot(sun.direction, n), -1, 1), along = dot(sun.direction, f);
  const across = Math.sqrt(Math.max(0, 1 - up * up - along * along));
  const y = ground ? (1 - Math.sqrt(1 - Math.asin(p / low) / (Math.PI / 2))) * (HEAD.texels.ground - 1)
    : HEAD.texels.ground + rowAbove(p, low, [HEAD.fields[field].haze_km, HEAD.fields[field].haze_km], top, HEAD.space.limb_power, HEAD.texels.haze, HEAD.space.limb);
  const edge = ground ? 1 : Math.sqrt(1 - Math.exp((p - top) / HEAD.space.edge_km));   // space.py
  return { sun: Math.asin(up) / DEG, azimuth: Math.atan2(across, along) / DEG, y, ground, edge };
}

// A line's place among the nodes of the lines above the air, 0 to 1.
function lineHeight(d, field) {
  const over = orbitRadius(field) * Math.hypot(d[0], d[1]) - HEAD.fields[field].grazing_km;
  return d[2] >= 0 ? 1 : clamp(over / HEAD.space.lines_to_km, 0, 1) ** (1 / HEAD.space.limb_power);
}

// All suns of the tables above the air, as layers of a texture: columns x rows of each field's sky, then its aureole.
let spaceSent = false;
function uploadSpace() {
  if (spaceSent || !HEAD.space) return;
  spaceSent = true;
  const columns = HEAD.texels.azimuth, rows = spaceRows(), suns = HEAD.texels.sun, size = rows * columns;
  const parts = HEAD.fields.flatMap((_, k) => [tables[`space_sky${k}`], tables[`space_aureole${k}`]]);
  const out = new Float32Array(suns * parts.length * size * 4);
  parts.forEach((values, part) => {
    if (!values) return;
    for (let c = 0; c < 4; c++) {
      for (let s = 0; s < suns; s++) {
        const from = (c * suns + s) * size, to = (s * parts.length + part) * size;
        for (let q = 0; q < size; q++) out[(to + q) * 4 + c] = values[from + q];
      }
    }
  });
  texture3d("uSpace", columns, rows * parts.length, suns, out);
}
