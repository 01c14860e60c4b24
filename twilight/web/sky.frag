#version 300 es
// X, Y, Z and scotopic luminance [cd m^-2] of every pixel.
precision highp float;
precision highp int;
precision highp sampler2D;
//#include projection.glsl
in vec2 place;
out vec4 light;

uniform sampler2D uSlice;    // logarithms under this sun: for each field the rows of sky, then those of aureole
uniform sampler2D uLines;    // rows of 256 for each field: phase, beam, lifted, 5 of the night
uniform sampler2D uZodiac;   // logarithm by longitude from the sun and latitude
uniform ivec3 uTexels;       // rows of ground, rows of sky, columns
uniform bool uGrid;          // one computed sky: uniform rows and columns all round
uniform float uAzimuthPower;
uniform float uHorizon[2];   // rad
uniform bool uAureole[2];
uniform float uSplit;        // where the second field begins, in place.x
uniform vec3 uSun;           // true direction
uniform vec2 uSunSide;       // east and north of its azimuth
uniform float uSunRadius;    // rad
uniform float uNear;         // distance_au^-2
uniform bool uDisc, uNight;
uniform vec3 uGalacticPole, uEclipticPole, uEclipticSun;
uniform vec2 uNightMean;     // starlight [S10], zodiacal light at 500 nm
uniform vec4 uNightGround[2];

const int LINES = 8, NODES = 256;

vec4 cubic(float t) {
  float t2 = t * t, t3 = t2 * t;
  return vec4(-0.5 * t + t2 - 0.5 * t3, 1.0 - 2.5 * t2 + 1.5 * t3, 0.5 * t + 2.0 * t2 - 1.5 * t3, 0.5 * (t3 - t2));
}

// Along a row, from the column before `i`; the sky is its own mirror image about the sun's vertical.
vec4 alongRow(int row, int i, vec4 w) {
  int n = uTexels.z;
  ivec4 c = uGrid ? ivec4((i + n - 1) % n, i % n, (i + 1) % n, (i + 2) % n)
                  : ivec4(abs(i - 1), i, i + 1, i + 2 < n ? i + 2 : 2 * n - 4 - i);
  return w.x * texelFetch(uSlice, ivec2(c.x, row), 0) + w.y * texelFetch(uSlice, ivec2(c.y, row), 0)
       + w.z * texelFetch(uSlice, ivec2(c.z, row), 0) + w.w * texelFetch(uSlice, ivec2(c.w, row), 0);
}

// Cubic in rows and columns; `first` is the row where the table begins.
vec4 table(int first, bool up, float y, float x) {
  int ground = uTexels.x, sky = uTexels.y, n = uTexels.z;
  int last = up ? sky : ground, begin = first + (up ? ground : 0);
  int j = clamp(int(floor(y)), 0, last - 2), i = clamp(int(floor(x)), 0, uGrid ? n - 1 : n - 2);
  vec4 wy = cubic(y - float(j)), wx = cubic(x - float(i));
  vec4 sum = vec4(0.0);
  for (int k = -1; k <= 2; k++) {
    int row = j + k, column = i;
    if (uGrid) {
      if (row >= last) { row = 2 * last - 2 - row; column = (i + n / 2) % n; }
      row = max(row, 0);
    } else if (up) {
      row = abs(row);            // even about the horizon; there is a row beyond the zenith
    } else {
      row = row >= last ? 2 * last - 2 - row : max(row, 0);
    }
    sum += wy[k + 1] * alongRow(begin + row, column, wx);
  }
  return sum;
}

vec4 line(int row, float x) {
  float p = clamp(x, 0.0, 1.0) * float(NODES - 1);
  int i = clamp(int(floor(p)), 0, NODES - 2);
  vec4 w = cubic(p - float(i));
  return w.x * texelFetch(uLines, ivec2(max(i - 1, 0), row), 0) + w.y * texelFetch(uLines, ivec2(i, row), 0)
       + w.z * texelFetch(uLines, ivec2(i + 1, row), 0)
       + w.w * texelFetch(uLines, ivec2(min(i + 2, NODES - 1), row), 0);
}

float between(vec3 a, vec3 b) { return 2.0 * asin(min(1.0, 0.5 * length(a - b))); }

// Light of the air, or of the ground through it.
vec4 scattered(int field, bool up, float e, float a, float angle) {
  float h = uHorizon[field];
  if (uGrid) {
    if (!up) return vec4(0.0);
    return exp(table(0, true, e / (0.5 * PI) * float(uTexels.y - 1), mod(a / (2.0 * PI), 1.0) * float(uTexels.z))) * uNear;
  }
  float u = sqrt(clamp(up ? (e - h) / (0.5 * PI - h) : (h - e) / (0.5 * PI + h), 0.0, 1.0));
  float y = up ? u * float(uTexels.y - 1) : (1.0 - u) * float(uTexels.x - 1);
  float x = pow(abs(a) / PI, 1.0 / uAzimuthPower) * float(uTexels.z - 1);
  int rows = uTexels.x + uTexels.y + 1, first = 2 * rows * field;
  vec4 sum = exp(table(first, up, y, x));
  if (uAureole[field]) sum += exp(table(first + rows, up, y, x) + line(LINES * field, sqrt(angle / PI)));
  return sum * uNear;
}

float zodiacal(vec3 d) {
  vec2 size = vec2(textureSize(uZodiac, 0) - 1);
  float latitude = abs(asin(clamp(dot(d, uEclipticPole), -1.0, 1.0)));
  float longitude = abs(atan(dot(d, cross(uEclipticPole, uEclipticSun)), dot(d, uEclipticSun)));
  vec2 p = vec2(longitude / PI, latitude / (0.5 * PI)) * size;
  ivec2 i = ivec2(clamp(floor(p), vec2(0.0), size - 1.0));
  vec2 t = p - vec2(i);
  float low = mix(texelFetch(uZodiac, i, 0).r, texelFetch(uZodiac, i + ivec2(1, 0), 0).r, t.x);
  float high = mix(texelFetch(uZodiac, i + ivec2(0, 1), 0).r, texelFetch(uZodiac, i + ivec2(1, 1), 0).r, t.x);
  return exp(mix(low, high, t.y));
}

// Starlight with diffuse galactic light [S10] by galactic latitude (night/light.py: starlight_s10).
float starlight(vec3 d) {
  float sine = max(abs(dot(d, uGalacticPole)), 1e-6);
  return 250.0 / 0.75 * (1.0 - exp(log(1.0 - 30.0 / 250.0) / sine));
}

vec4 nightLight(int field, bool up, float u, vec3 d) {
  if (!up) return uNightGround[field];
  int row = LINES * field + 3;
  return line(row, u) + line(row + 1, u) * starlight(d) + line(row + 2, u) * uNightMean.x
       + line(row + 3, u) * zodiacal(d) + line(row + 4, u) * uNightMean.y;
}

// The sun's disc through refracting air: flattened, limb darkened (Cox 2000, 550 nm).
vec4 disc(int field, float e, float u, vec3 d) {
  float lifted = line(LINES * field + 2, u).r, flat_ = length(d.xy);
  float there = e - lifted;
  vec3 straight = vec3(d.xy / max(flat_, 1e-9) * cos(there), sin(there));
  float rho = between(straight, uSun);
  float cover = clamp((uSunRadius - rho) / max(fwidth(rho), 1e-7) + 0.5, 0.0, 1.0);
  if (cover == 0.0) return vec4(0.0);
  float mu = sqrt(max(0.0, 1.0 - rho * rho / (uSunRadius * uSunRadius)));
  float limb = (0.30 + 0.93 * mu - 0.23 * mu * mu) / 0.805;
  return cover * limb * exp(line(LINES * field + 1, u)) / (PI * uSunRadius * uSunRadius) * uNear;
}

void main() {
  vec3 d;
  if (!rayOf(place, d)) { light = vec4(0.0, 0.0, 0.0, -1.0); return; }
  int field = place.x < uSplit ? 0 : 1;
  float across = length(d.xy), e = atan(d.z, across);
  float a = 0.0;
  if (across > 1e-7) a = atan(d.x * uSunSide.y - d.y * uSunSide.x, dot(d.xy, uSunSide));
  float h = uHorizon[field], angle = between(d, uSun);
  float above = clamp((e - h) / max(fwidth(e), 1e-7) + 0.5, 0.0, 1.0);
  float u = sqrt(clamp((e - h) / (0.5 * PI - h), 0.0, 1.0));
  light = vec4(0.0);
  if (above > 0.0) {
    light += above * scattered(field, true, e, a, angle);
    if (uNight) light += above * nightLight(field, true, u, d);
  }
  if (above < 1.0) {
    light += (1.0 - above) * scattered(field, false, e, a, angle);
    if (uNight) light += (1.0 - above) * nightLight(field, false, u, d);
  }
  if (uDisc) light += above * disc(field, e, u, d);
}
