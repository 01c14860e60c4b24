// Directions are unit vectors east, north, up; angles in degrees.
const DEG = Math.PI / 180;
const direction = (elevation, azimuth) => {
  const e = elevation * DEG, a = azimuth * DEG;
  return [Math.cos(e) * Math.sin(a), Math.cos(e) * Math.cos(a), Math.sin(e)];
};
const elevationOf = (d) => Math.atan2(d[2], Math.hypot(d[0], d[1])) / DEG;
const azimuthOf = (d) => (Math.atan2(d[0], d[1]) / DEG + 360) % 360;
const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
const cross = (a, b) => [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
const unit = (a) => { const n = Math.hypot(...a); return a.map((x) => x / n); };
const plus = (a, s, b) => a.map((x, i) => x + s * b[i]);
const clamp = (x, low, high) => Math.min(high, Math.max(low, x));
const around = (x, n) => ((x % n) + n) % n;
