// Where the sun and the stars stand: Meeus, Astronomical Algorithms (1998), ch. 12, 13, 25; 0.01 deg from 1950 to 2100.
const J2000 = Date.UTC(2000, 0, 1, 12);

// Days since J2000 of a date "YYYY-MM-DD" and hours of a clock that is `zone` hours ahead of UTC.
function daysSince(date, hours, zone) {
  const [y, m, d] = date.split("-").map(Number);
  return (Date.UTC(y, m - 1, d) - J2000) / 864e5 + (hours - zone) / 24;
}

// Ecliptic longitude [deg], distance [au], obliquity [deg] of the sun.
function solarLongitude(days) {
  const t = days / 36525;
  const mean = 280.46646 + 36000.76983 * t + 0.0003032 * t * t;
  const m = (357.52911 + 35999.05029 * t - 0.0001537 * t * t) * DEG;
  const centre = (1.914602 - 0.004817 * t - 0.000014 * t * t) * Math.sin(m)
    + (0.019993 - 0.000101 * t) * Math.sin(2 * m) + 0.000289 * Math.sin(3 * m);
  const e = 0.016708634 - 0.000042037 * t - 0.0000001267 * t * t;
  const node = (125.04 - 1934.136 * t) * DEG;
  return {
    longitude: mean + centre - 0.00569 - 0.00478 * Math.sin(node),
    distance: 1.000001018 * (1 - e * e) / (1 + e * Math.cos(m + centre * DEG)),
    obliquity: 23.4392911 - 0.0130042 * t + 0.00256 * Math.cos(node),
  };
}

// Local mean sidereal time [deg]; longitude east positive.
const siderealTime = (days, longitude) => around(280.46061837 + 360.98564736629 * days + longitude, 360);

// Rows that take a vector of the equator's frame (x to the equinox, z to the pole) to east, north, up.
function equatorToWorld(sidereal, latitude) {
  const t = sidereal * DEG, p = latitude * DEG;
  const [st, ct, sp, cp] = [Math.sin(t), Math.cos(t), Math.sin(p), Math.cos(p)];
  return [[-st, ct, 0], [-sp * ct, -sp * st, cp], [cp * ct, cp * st, sp]];
}

const turned = (rows, v) => rows.map((row) => dot(row, v));
const eclipticToEquator = (v, obliquity) => {
  const s = Math.sin(obliquity * DEG), c = Math.cos(obliquity * DEG);
  return [v[0], c * v[1] - s * v[2], s * v[1] + c * v[2]];
};

// True elevation and azimuth [deg], distance [au] from a place.
function sunAt(days, latitude, longitude) {
  const s = solarLongitude(days), l = s.longitude * DEG;
  const equator = eclipticToEquator([Math.cos(l), Math.sin(l), 0], s.obliquity);
  const d = turned(equatorToWorld(siderealTime(days, longitude), latitude), equator);
  const e = elevationOf(d);
  return { elevation: e - 0.0024428 * Math.cos(e * DEG) / s.distance, azimuth: azimuthOf(d), distance: s.distance };
}

const daysNow = () => daysSince(state.date, state.hours, state.zone);

// The sun of the state: elevation, azimuth, distance, true direction.
function theSun() {
  let sun;
  if (HEAD.kind === "sky") sun = { elevation: HEAD.sun_deg[0], azimuth: HEAD.sun_azimuth_deg ?? 0, distance: 1 };
  else if (state.mode === "clock") sun = sunAt(daysNow(), state.latitude, state.longitude);
  else sun = { elevation: state.sun, azimuth: 0, distance: 1 };
  sun.shown = clamp(sun.elevation, HEAD.sun_deg[0], HEAD.sun_deg[1]);
  return { ...sun, direction: direction(sun.elevation, sun.azimuth) };
}

// What the night sky is oriented by: the equator's frame, the ecliptic's pole, the sun along the ecliptic.
// Without a place the ecliptic stands at 60 deg to the horizon, on the evening's side.
function celestial(sun) {
  const s = solarLongitude(daysNow());
  const l = s.longitude * DEG;
  const pole = eclipticToEquator([0, 0, 1], s.obliquity);
  const sunEquator = eclipticToEquator([Math.cos(l), Math.sin(l), 0], s.obliquity);
  let rows;
  if (state.mode === "clock") {
    rows = equatorToWorld(siderealTime(daysNow(), state.longitude), state.latitude);
  } else {
    const side = direction(0, sun.azimuth + 90), tilt = 30 * DEG;
    // of the vectors across the sun: the level one, turned by the tilt about the sun
    let axis = plus(side.map((x) => Math.cos(tilt) * x), Math.sin(tilt), cross(sun.direction, side));
    if (cross(axis, sun.direction)[2] < 0) axis = axis.map((x) => -x);
    const ahead = cross(axis, sun.direction), aheadEquator = cross(pole, sunEquator);
    rows = [0, 1, 2].map((i) => [0, 1, 2].map((j) =>
      sun.direction[i] * sunEquator[j] + ahead[i] * aheadEquator[j] + axis[i] * pole[j]));
  }
  const galactic = [192.8595 * DEG, 27.1283 * DEG];
  const galacticPole = [Math.cos(galactic[1]) * Math.cos(galactic[0]), Math.cos(galactic[1]) * Math.sin(galactic[0]), Math.sin(galactic[1])];
  return {
    rows,
    galacticPole: turned(rows, galacticPole),
    eclipticPole: turned(rows, pole),
    eclipticSun: turned(rows, sunEquator),
  };
}
