// Pictures' coordinates are -1 to 1 across each side; directions are east, north, up.
uniform int uProjection;   // 0 perspective, 1 fisheye (equidistant), 2 latitude-longitude
uniform float uFov;        // rad: across the width; of a fisheye across the shorter side
uniform float uAspect;     // width over height
uniform mat3 uCamera;      // columns: right, forward, up
uniform vec2 uLook;        // azimuth, elevation of the centre, rad

const float PI = 3.14159265358979;

bool rayOf(vec2 p, out vec3 d) {
  if (uProjection == 2) {
    float e = uLook.y + 0.5 * uFov * p.y / uAspect, a = uLook.x + 0.5 * uFov * p.x;
    d = vec3(cos(e) * sin(a), cos(e) * cos(a), sin(e));
    return abs(e) <= 0.5 * PI && abs(p.x) * uFov <= 2.0 * PI;
  }
  if (uProjection == 1) {
    vec2 q = uAspect > 1.0 ? vec2(p.x * uAspect, p.y) : vec2(p.x, p.y / uAspect);
    float r = length(q), angle = 0.5 * uFov * r;
    vec2 side = r > 0.0 ? q / r * sin(angle) : vec2(0.0);
    d = uCamera * vec3(side.x, cos(angle), side.y);
    return angle <= PI;
  }
  float t = tan(0.5 * uFov);
  d = normalize(uCamera * vec3(p.x * t, 1.0, p.y * t / uAspect));
  return true;
}

// Where a direction is in the picture; false: nowhere.
bool placeOf(vec3 d, out vec2 p) {
  if (uProjection == 2) {
    float a = atan(d.x, d.y) - uLook.x;
    a -= 2.0 * PI * round(a / (2.0 * PI));
    p = vec2(a, (atan(d.z, length(d.xy)) - uLook.y) * uAspect) / (0.5 * uFov);
    return true;
  }
  vec3 c = d * uCamera;
  if (uProjection == 1) {
    float s = length(c.xz), angle = atan(s, c.y);
    vec2 q = (s > 0.0 ? c.xz / s : vec2(0.0)) * angle / (0.5 * uFov);
    p = uAspect > 1.0 ? vec2(q.x / uAspect, q.y) : vec2(q.x, q.y * uAspect);
    return true;
  }
  if (c.y <= 0.0) return false;
  p = vec2(c.x, c.z * uAspect) / (c.y * tan(0.5 * uFov));
  return true;
}
