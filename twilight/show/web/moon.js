// Where the moon stands, how much of it is lit, and how bright it is.
// Meeus, Astronomical Algorithms (1998), ch. 47, its larger terms: 0.02 deg from 1950 to 2100.
// Multiples of D, M, M', F; 1e-6 deg of longitude with the sine, m of distance with the cosine.
const MOON_LONGITUDE = [
  [0, 0, 1, 0, 6288774, -20905355], [2, 0, -1, 0, 1274027, -3699111], [2, 0, 0, 0, 658314, -2955968], [0, 0, 2, 0, 213618, -569925],
  [0, 1, 0, 0, -185116, 48888], [0, 0, 0, 2, -114332, -3149], [2, 0, -2, 0, 58793, 246158], [2, -1, -1, 0, 57066, -152138],
  [2, 0, 1, 0, 53322, -170733], [2, -1, 0, 0, 45758, -204586], [0, 1, -1, 0, -40923, -129620], [1, 0, 0, 0, -34720, 108743],
  [0, 1, 1, 0, -30383, 104755], [2, 0, 0, -2, 15327, 10321], [0, 0, 1, 2, -12528, 0], [0, 0, 1, -2, 10980, 79661],
  [4, 0, -1, 0, 10675, -34782], [0, 0, 3, 0, 10034, -23210], [4, 0, -2, 0, 8548, -21636], [2, 1, -1, 0, -7888, 24208],
  [2, 1, 0, 0, -6766, 30824], [1, 0, -1, 0, -5163, -8379], [1, 1, 0, 0, 4987, -16675], [2, -1, 1, 0, 4036, -12831],
  [2, 0, 2, 0, 3994, -10445], [4, 0, 0, 0, 3861, -11650], [2, 0, -3, 0, 3665, 14403], [0, 1, -2, 0, -2689, -7003],
  [2, 0, -1, 2, -2602, 0], [2, -1, -2, 0, 2390, 10056], [1, 0, 1, 0, -2348, 6322], [2, -2, 0, 0, 2236, -9884],
  [0, 1, 2, 0, -2120, 5751], [0, 2, 0, 0, -2069, 0],
];
// Multiples of D, M, M', F; 1e-6 deg of latitude with the sine.
const MOON_LATITUDE = [
  [0, 0, 0, 1, 5128122], [0, 0, 1, 1, 280602], [0, 0, 1, -1, 277693], [2, 0, 0, -1, 173237], [2, 0, -1, 1, 55413],
  [2, 0, -1, -1, 46271], [2, 0, 0, 1, 32573], [0, 0, 2, 1, 17198], [2, 0, 1, -1, 9266], [0, 0, 2, -1, 8822],
  [2, -1, 0, -1, 8216], [2, 0, -2, -1, 4324], [2, 0, 1, 1, 4200], [2, 1, 0, -1, -3359], [2, -1, -1, 1, 2463],
  [2, -1, 0, 1, 2211], [2, -1, -1, -1, 2065],
];
const MEAN_MOON_KM = 384400, MOON_RADIUS_DEG = 0.25896, AU_KM = 1.495978707e8;
const TT_DAYS = 69 / 86400;   // terrestrial time less UTC
const LOWEST_MOON_DEG = -18;  // below, the moon lights no air

// Ecliptic longitude and latitude [deg] and distance [km] from the Earth's centre.
function lunarPlace(days) {
  const t = (days + TT_DAYS) / 36525;
  const d = 297.8501921 + 445267.1114034 * t - 0.0018819 * t * t, m = 357.5291092 + 35999.0502909 * t - 0.0001536 * t * t;
  const mp = 134.9633964 + 477198.8675055 * t + 0.0087414 * t * t, f = 93.272095 + 483202.0175233 * t - 0.0036539 * t * t;
  const e = 1 - 0.002516 * t - 0.0000074 * t * t, node = (125.04 - 1934.136 * t) * DEG;
  let longitude = 218.3164477 + 481267.88123421 * t - 0.0015786 * t * t - 0.00478 * Math.sin(node), latitude = 0, metres = 385000560;
  for (const [a, b, c, g, l, r] of MOON_LONGITUDE) {
    const angle = (a * d + b * m + c * mp + g * f) * DEG, less = e ** Math.abs(b);
    longitude += 1e-6 * less * l * Math.sin(angle);
    metres += less * r * Math.cos(angle);
  }
  for (const [a, b, c, g, l] of MOON_LATITUDE) latitude += 1e-6 * e ** Math.abs(b) * l * Math.sin((a * d + b * m + c * mp + g * f) * DEG);
  return { longitude, latitude, distance: metres / 1000 };
}

// The moon from a place on the ground: km east, north, up; whether it waxes.
function moonAt(days, latitude, longitude) {
  const moon = lunarPlace(days), sun = solarLongitude(days), p = latitude * DEG;
  const equator = eclipticToEquator(direction(moon.latitude, 90 - moon.longitude), sun.obliquity);
  const seen = turned(equatorToWorld(siderealTime(days, longitude), latitude), equator);
  const flat = 0.00669438, curve = 6378.137 / Math.sqrt(1 - flat * Math.sin(p) ** 2);
  const here = [0, -curve * flat * Math.sin(p) * Math.cos(p), curve * (1 - flat * Math.sin(p) ** 2)];
  return { km: seen.map((x, i) => moon.distance * x - here[i]), waxing: Math.sin((moon.longitude - sun.longitude) * DEG) > 0 };
}

// The moon of the state beside its sun: elevation and azimuth (true, deg), distance [km], phase angle [deg]; null: none.
function theMoon(sun) {
  if (!state.moon || HEAD.kind !== "field") return null;
  const found = state.mode === "clock" ? moonAt(daysNow(), state.latitude, state.longitude)
    : { km: direction(state.moonElevation, sun.azimuth + state.moonAzimuth).map((x) => MEAN_MOON_KM * x), waxing: null };
  const distance = Math.hypot(...found.km), toSun = plus(sun.direction.map((x) => AU_KM * sun.distance * x), -1, found.km);
  const sunDistance = Math.hypot(...toSun), towards = unit(found.km), s = unit(toSun);
  const phase = Math.atan2(Math.hypot(...cross(towards, s)), -dot(towards, s)) / DEG;
  const elevation = elevationOf(towards), near = (MEAN_MOON_KM / distance) ** 2 / (sunDistance / AU_KM) ** 2;
  return {
    elevation, azimuth: azimuthOf(towards), direction: towards, toSun: s, distance, phase, waxing: found.waxing,
    radius: MOON_RADIUS_DEG * DEG * MEAN_MOON_KM / distance, shown: clamp(elevation, HEAD.sun_deg[0], HEAD.sun_deg[1]),
    lights: inSpace() || elevation >= LOWEST_MOON_DEG, level: moonLevel(phase, found.waxing) * near,
  };
}

// Place of a value among nodes: index and fraction.
function among(nodes, value) {
  let i = 0;
  while (i < nodes.length - 2 && value > nodes[i + 1]) i++;
  return [i, clamp((value - nodes[i]) / (nodes[i + 1] - nodes[i]), 0, 1)];
}

// Irradiance over the sun's at 550 nm and the mean distances.
function moonLevel(phase, waxing) {
  const { phase_deg: nodes, log_level: logs } = HEAD.moon, [i, f] = among(nodes, phase), row = logs[waxing === null ? 0 : waxing ? 1 : 2];
  return Math.exp((1 - f) * row[i] + f * row[i + 1]);
}

// What makes moonlight of a field's sunlight: 16 numbers by columns, and one for each wavelength (viewer/moonlight.py).
function moonlight(moon, field, name) {
  const [i, f] = among(HEAD.moon.colours_at_deg, moon.phase), rows = HEAD.fields[field][name];
  return rows[i].map((v, k) => moon.level * ((1 - f) * v + f * rows[i + 1][k]));
}

// Integral over the disc of mu0 / (mu0 + mu) (sky/moon/disc.py: disc_integral).
function moonDiscIntegral(phase) {
  const g = clamp(phase, 1e-4, 179.9) * DEG;
  return Math.PI / 2 * (1 - Math.sin(g / 2) * Math.tan(g / 2) * Math.log(1 / Math.tan(g / 4)));
}
