// The same as projection.glsl, for clicks and for what is drawn over the sky.
function camera() {
  const forward = direction(state.elevation, state.azimuth);
  const right = [Math.cos(state.azimuth * DEG), -Math.sin(state.azimuth * DEG), 0];
  return { right, forward, up: cross(right, forward) };
}

// Direction at (x, y), each -1 to 1; null: nothing is there.
function rayAt(x, y, aspect) {
  const fov = state.fov * DEG;
  if (state.projection === "latlong") {
    const e = state.elevation + 0.5 * state.fov * y / aspect;
    return Math.abs(e) <= 90 && Math.abs(x) * state.fov <= 360 ? direction(e, state.azimuth + 0.5 * state.fov * x) : null;
  }
  const { right, forward, up } = camera();
  const mixed = (a, b, c) => right.map((_, i) => a * right[i] + b * forward[i] + c * up[i]);
  if (state.projection === "fisheye") {
    const q = aspect > 1 ? [x * aspect, y] : [x, y / aspect], r = Math.hypot(...q), angle = 0.5 * fov * r;
    if (angle > Math.PI) return null;
    const s = r > 0 ? Math.sin(angle) / r : 0;
    return mixed(q[0] * s, Math.cos(angle), q[1] * s);
  }
  const t = Math.tan(0.5 * fov);
  return unit(mixed(x * t, 1, y * t / aspect));
}

// Where a direction is, in -1 to 1; null: nowhere.
function placeOf(d, aspect) {
  const half = 0.5 * state.fov * DEG;
  if (state.projection === "latlong") {
    const a = around(azimuthOf(d) - state.azimuth + 180, 360) - 180;
    return [a * DEG / half, (elevationOf(d) - state.elevation) * DEG * aspect / half];
  }
  const { right, forward, up } = camera();
  const c = [dot(d, right), dot(d, forward), dot(d, up)];
  if (state.projection === "fisheye") {
    const s = Math.hypot(c[0], c[2]), angle = Math.atan2(s, c[1]);
    const q = s > 0 ? [c[0] / s * angle / half, c[2] / s * angle / half] : [0, 0];
    return aspect > 1 ? [q[0] / aspect, q[1]] : [q[0], q[1] * aspect];
  }
  return c[1] > 0.01 ? [c[0] / (c[1] * Math.tan(half)), c[2] * aspect / (c[1] * Math.tan(half))] : null;
}

const widestFov = () => ({ perspective: 150, fisheye: 360, latlong: 360 })[state.projection];
