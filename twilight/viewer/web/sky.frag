#version 300 es
// X, Y, Z and scotopic luminance [cd m^-2] of every pixel.
precision highp float;
precision highp int;
precision highp sampler2D;
precision highp sampler3D;
//#include projection.glsl
//#include space.glsl
in vec2 place;
out vec4 light;

uniform sampler2D uSlice;    // logarithms under this sun: for each field the rows of sky, then those of aureole
uniform sampler3D uSpace;     // above the air: logarithms, layers by the sun at the foot, rows as of uSlice
uniform int uLimb;           // its rows of the limb
uniform float uEdge;         // km over which light falls towards the top of the air
uniform vec3 uSunAxis;       // lowest sun of the tables, centre and width of their axis, deg
uniform sampler2D uLines;    // rows of 256 for each field: phase, beam, refraction, 5 of the night
uniform sampler2D uZodiac;   // logarithm by longitude from the sun and latitude
uniform ivec4 uTexels;       // rows of ground, of haze, of sky, columns
uniform bool uGrid;          // one computed sky: uniform rows and columns all round
uniform float uAzimuthPower;
uniform float uHorizon[2];   // rad
uniform vec2 uHaze[2];       // apparent elevation of the haze's top, rad, and what is its among the rows (tables.js)
uniform bool uAureole[2];
uniform float uSplit;        // where the second field begins, in place.x
uniform vec3 uSun;           // true direction
uniform vec2 uSunSide;       // east and north of its azimuth
uniform float uSunRadius;    // rad
uniform float uNear;         // distance_au^-2
uniform bool uDisc, uNight, uMoonlit, uMoonDisc;
uniform vec3 uMoon, uMoonSun;  // true direction of the moon, and from it to the sun
uniform vec2 uMoonSide;        // east and north of its azimuth
uniform float uMoonRadius, uMoonShape;  // rad; integral of its surface over a disc of radius 1
uniform mat4 uMoonColour[2];   // moonlight of sunlight
uniform int uMoonFirst;        // row of uSlice where the tables under the moon begin
uniform vec3 uGalacticPole, uEclipticPole, uEclipticSun;
uniform vec2 uNightMean;     // starlight [S10], zodiacal light at 500 nm
uniform vec4 uNightGround[2];

const int LINES = 8, NODES = 256;
const float NEAR = 0.03;

vec4 cubic(float t) {
  float t2 = t * t, t3 = t2 * t;
  return vec4(-0.5 * t + t2 - 0.5 * t3, 1.0 - 2.5 * t2 + 1.5 * t3, 0.5 * t + 2.0 * t2 - 1.5 * t3, 0.5 * (t3 - t2));
}

// Along a row, from the column before `i`; the sky is its own mirror image about the sun's vertical.
vec4 alongRow(int row, int i, vec4 w) {
  int n = uTexels.w;
  ivec4 c = uGrid ? ivec4((i + n - 1) % n, i % n, (i + 1) % n, (i + 2) % n)
                  : ivec4(abs(i - 1), i, i + 1, i + 2 < n ? i + 2 : 2 * n - 4 - i);
  return w.x * texelFetch(uSlice, ivec2(c.x, row), 0) + w.y * texelFetch(uSlice, ivec2(c.y, row), 0)
       + w.z * texelFetch(uSlice, ivec2(c.z, row), 0) + w.w * texelFetch(uSlice, ivec2(c.w, row), 0);
}

// Place of a line among the rows of the sky: x from the horizon `low` by the top of the haze to `high` (tables.py).
// haze.y: where the rows have that top; what is NEAR it moves with it, what is far is where the rows have it.
float rowAbove(float x, float low, vec2 haze, float high, float power, int rows) {
  if (x < haze.x) return asin(sqrt(clamp((x - low) / max(haze.x - low, 1e-9), 0.0, 1.0))) / (0.5 * PI) * float(uTexels.y);
  float far = haze.y + NEAR * (high - haze.y);
  float fraction = x < far ? NEAR * (x - haze.x) / (far - haze.x) : (x - haze.y) / (high - haze.y);
  return float(uTexels.y) + pow(clamp(fraction, 0.0, 1.0), 1.0 / power) * float(rows - 1);
}

// Rows of a cubic at the place y among those of the ground or of the sky, of which `last` is the last one, and weights.
ivec4 rowsAt(bool up, float y, int last, bool beyond, out vec4 w) {
  int haze = uTexels.y, j = clamp(int(floor(y)), 0, last - 1), low = up && j >= haze ? haze : 0;
  ivec4 rows = ivec4(j - 1, j, j + 1, j + 2);
  w = cubic(y - float(j));
  if (up) {
    if (j - 1 < low) rows.x = low + 1;            // even about the horizon, and above the haze's top
    if (j == haze - 1 || (j == last - 1 && !beyond)) {   // a straight line
      w = vec4(w.x, w.y - w.w, w.z + 2.0 * w.w, 0.0);
      rows.w = j + 1;
    }
    return rows + uTexels.x;
  }
  rows.x = max(rows.x, 0);
  if (rows.w > last) rows.w = 2 * last - rows.w;
  return rows;
}

// Cubic in rows and columns; `first` is the row where the table begins.
vec4 table(int first, bool up, float y, float x) {
  int i = clamp(int(floor(x)), 0, uTexels.w - 2);
  vec4 wy, wx = cubic(x - float(i));
  ivec4 rows = first + rowsAt(up, y, up ? uTexels.y + uTexels.z - 1 : uTexels.x - 1, true, wy);
  return wy.x * alongRow(rows.x, i, wx) + wy.y * alongRow(rows.y, i, wx)
       + wy.z * alongRow(rows.z, i, wx) + wy.w * alongRow(rows.w, i, wx);
}

// The same of one computed sky, whose rows and columns are even steps all round.
vec4 gridTable(float y, float x) {
  int last = uTexels.z, n = uTexels.w, j = clamp(int(floor(y)), 0, last - 2), i = clamp(int(floor(x)), 0, n - 1);
  vec4 wy = cubic(y - float(j)), wx = cubic(x - float(i)), sum = vec4(0.0);
  for (int k = -1; k <= 2; k++) {
    int row = j + k, column = i;
    if (row >= last) { row = 2 * last - 2 - row; column = (i + n / 2) % n; }
    sum += wy[k + 1] * alongRow(max(row, 0), column, wx);
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

// Cubic in sun, row and column of the tables above the air; `first` is the row where a table begins.
vec4 spaceTable(int first, bool up, float s, float y, float x) {
  int n = uTexels.w, suns = textureSize(uSpace, 0).z;
  int l = clamp(int(floor(s)), 0, suns - 2), i = clamp(int(floor(x)), 0, n - 2);
  vec4 ws = cubic(s - float(l)), wx = cubic(x - float(i)), sum = vec4(0.0), wy;
  ivec4 rows = first + rowsAt(up, y, up ? uTexels.y + uLimb - 1 : uTexels.x - 1, false, wy);
  // beyond the first and the last sun the table goes on as a straight line
  if (l == 0) ws = vec4(0.0, ws.y + 2.0 * ws.x, ws.z - ws.x, ws.w);
  if (l == suns - 2) ws = vec4(ws.x, ws.y - ws.w, ws.z + 2.0 * ws.w, 0.0);
  ivec4 c = ivec4(abs(i - 1), i, i + 1, i + 2 < n ? i + 2 : 2 * n - 4 - i);
  for (int a = 0; a < 4; a++) {
    int layer = clamp(l + a - 1, 0, suns - 1);
    for (int b = 0; b < 4; b++) {
      int row = rows[b];
      sum += ws[a] * wy[b] * (wx.x * texelFetch(uSpace, ivec3(c.x, row, layer), 0) + wx.y * texelFetch(uSpace, ivec3(c.y, row, layer), 0)
           + wx.z * texelFetch(uSpace, ivec3(c.z, row, layer), 0) + wx.w * texelFetch(uSpace, ivec3(c.w, row, layer), 0));
    }
  }
  return sum;
}

// Light of the limb (up), or of the ground through the air, from above it; to: the direction of the source of light.
vec4 fromSpace(int field, bool up, vec3 d, float angle, vec3 to) {
  float low = uEarth[field].x, top = uEarth[field].z, p = uOrbit * length(d.xy);
  if (up && (d.z >= 0.0 || p >= top)) return vec4(0.0);
  p = up ? max(p, low) : min(p, low);
  float t = -uOrbit * d.z - (up ? 0.0 : sqrt(max(0.0, low * low - p * p)));
  vec3 n = normalize(vec3(0.0, 0.0, uOrbit) + t * d), level = d - dot(d, n) * n;
  float size = length(level), above = clamp(dot(to, n), -1.0, 1.0);
  float along = size > 1e-6 ? dot(to, level) / size : 0.0;
  float azimuth = atan(sqrt(max(0.0, 1.0 - above * above - along * along)), along);
  float y = up ? rowAbove(p, low, uEarth[field].yy, top, 1.5, uLimb)
               : (1.0 - sqrt(1.0 - asin(min(1.0, p / low)) / (0.5 * PI))) * float(uTexels.x - 1);
  float x = pow(azimuth / PI, 1.0 / uAzimuthPower) * float(uTexels.w - 1);
  float sun = degrees(asin(above)), first = asinh((uSunAxis.x - uSunAxis.y) / uSunAxis.z);
  float s = (asinh((sun - uSunAxis.y) / uSunAxis.z) - first) / (asinh((90.0 - uSunAxis.y) / uSunAxis.z) - first);
  s = clamp(s, 0.0, 1.0) * float(textureSize(uSpace, 0).z - 1);
  int rows = uTexels.x + uTexels.y + uLimb, begin = 2 * rows * field;
  vec4 sum = exp(spaceTable(begin, up, s, y, x));
  if (uAureole[field]) sum += exp(spaceTable(begin + rows, up, s, y, x) + line(LINES * field, sqrt(angle / PI)));
  if (up) sum *= sqrt(1.0 - exp((p - top) / uEdge));   // space.py
  // below the lowest sun of the tables the light falls by e per degree
  return sum * exp(min(0.0, sun - uSunAxis.x));
}

// Light of the air, or of the ground through it, of a source at 1 au in the direction `to`; a, angle: of d from there;
// begin: row of uSlice with its tables.
vec4 scattered(int field, bool up, vec3 d, float e, float a, float angle, vec3 to, int begin) {
  if (uOrbit > 0.0) return fromSpace(field, up, d, angle, to);
  float h = uHorizon[field];
  if (uGrid) {
    if (!up) return vec4(0.0);
    return exp(gridTable(e / (0.5 * PI) * float(uTexels.z - 1), mod(a / (2.0 * PI), 1.0) * float(uTexels.w)));
  }
  float y = up ? rowAbove(e, h, uHaze[field], 0.5 * PI, 2.0, uTexels.z)
               : (1.0 - sqrt(clamp((h - e) / (0.5 * PI + h), 0.0, 1.0))) * float(uTexels.x - 1);
  float x = pow(abs(a) / PI, 1.0 / uAzimuthPower) * float(uTexels.w - 1);
  int rows = uTexels.x + uTexels.y + uTexels.z + 1, first = begin + 2 * rows * field;
  vec4 sum = exp(table(first, up, y, x));
  if (uAureole[field]) sum += exp(table(first + rows, up, y, x) + line(LINES * field, sqrt(angle / PI)));
  return sum;
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
  float refraction = line(LINES * field + 2, u).r, flat_ = length(d.xy);
  float there = e - refraction;
  vec3 straight = vec3(d.xy / max(flat_, 1e-9) * cos(there), sin(there));
  float rho = between(straight, uSun);
  float cover = clamp((uSunRadius - rho) / max(fwidth(rho), 1e-7) + 0.5, 0.0, 1.0);
  if (cover == 0.0) return vec4(0.0);
  float mu = sqrt(max(0.0, 1.0 - rho * rho / (uSunRadius * uSunRadius)));
  float limb = (0.30 + 0.93 * mu - 0.23 * mu * mu) / 0.805;
  return cover * limb * exp(line(LINES * field + 1, u)) / (PI * uSunRadius * uSunRadius) * uNear;
}

// The moon's, whose surface reflects by the law of Lommel and Seeliger (sky/moon/disc.py): the mean of n x n points.
vec4 moonDisc(int field, float e, float u, vec3 d) {
  float refraction = line(LINES * field + 2, u).r, flat_ = length(d.xy), there = e - refraction, sum = 0.0;
  vec3 straight = vec3(d.xy / max(flat_, 1e-9) * cos(there), sin(there)), across = dFdx(straight), along = dFdy(straight);
  float size = length(across) + length(along);
  if (between(straight, uMoon) > uMoonRadius + size) return vec4(0.0);
  int n = clamp(int(8.0 * size / uMoonRadius), 2, 24);
  for (int i = 0; i < n * n; i++) {
    vec2 q = (vec2(i % n, i / n) + 0.5) / float(n) - 0.5;
    vec3 s = straight - uMoon + q.x * across + q.y * along;
    vec3 p = (s - dot(s, uMoon) * uMoon) / uMoonRadius;
    float mu = sqrt(max(1.0 - dot(p, p), 0.0)), lit = dot(p - mu * uMoon, uMoonSun);
    if (dot(p, p) < 1.0 && lit > 0.0) sum += lit / (lit + mu) / float(n * n);
  }
  vec4 beam = max(uMoonColour[field] * exp(line(LINES * field + 1, u)), 0.0);
  return sum * beam / (uMoonShape * uMoonRadius * uMoonRadius);
}

float azimuthFrom(vec2 side, vec2 d) { return length(d) > 1e-7 ? atan(d.x * side.y - d.y * side.x, dot(d, side)) : 0.0; }

// Light of air or ground under sun and moon, and the night's.
vec4 lightOf(int field, bool up, vec3 d, float e, float u) {
  vec4 sum = scattered(field, up, d, e, azimuthFrom(uSunSide, d.xy), between(d, uSun), uSun, 0) * uNear;
  if (uMoonlit) {
    vec4 lit = scattered(field, up, d, e, azimuthFrom(uMoonSide, d.xy), between(d, uMoon), uMoon, uMoonFirst);
    sum += max(uMoonColour[field] * lit, 0.0);
  }
  return uNight ? sum + nightLight(field, up, u, d) : sum;
}

void main() {
  vec3 d;
  if (!rayOf(place, d)) { light = vec4(0.0, 0.0, 0.0, -1.0); return; }
  int field = place.x < uSplit ? 0 : 1;
  float across = length(d.xy), e = atan(d.z, across);
  float h = uHorizon[field];
  float above = clamp((e - h) / max(fwidth(e), 1e-7) + 0.5, 0.0, 1.0);
  float u = linePlace(field, e, h, across);
  light = vec4(0.0);
  if (above > 0.0) light += above * lightOf(field, true, d, e, u);
  if (above < 1.0) light += (1.0 - above) * lightOf(field, false, d, e, u);
  if (uDisc) light += above * disc(field, e, u, d);
  if (uMoonDisc) light += above * moonDisc(field, e, u, d);
}
