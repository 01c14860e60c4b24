#version 300 es
// X, Y, Z and scotopic luminance [cd m^-2] of every pixel.
precision highp float;
precision highp int;
precision highp sampler2D;
precision highp sampler3D;
//#include projection.glsl
//#include space.glsl
//#include table.glsl
in vec2 place;
out vec4 light;

uniform ivec3 uCount;        // suns, rows and columns of the tables
uniform int uFields;         // of the page
uniform float uEdge;         // km over which light falls towards the top of the air
uniform sampler2D uLines;    // rows of 256 for each field: beam, refraction, 5 of the night
uniform sampler2D uZodiac;   // logarithm by longitude from the sun and latitude
uniform bool uGrid;          // one computed sky, whose columns go all round
uniform float uHorizon[2];   // rad
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
uniform vec3 uGalacticPole, uEclipticPole, uEclipticSun;
uniform vec2 uNightMean;     // starlight [S10], zodiacal light at 500 nm
uniform vec4 uNightGround[2];

const int LINES = 7, NODES = 256;
const float BESIDE = 2e-5;   // deg from the horizon, where rows of sky and of ground meet

vec4 cubic(float t) {
  float t2 = t * t, t3 = t2 * t;
  return vec4(-0.5 * t + t2 - 0.5 * t3, 1.0 - 2.5 * t2 + 1.5 * t3, 0.5 * t + 2.0 * t2 - 1.5 * t3, 0.5 * (t3 - t2));
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

// Light of the limb (up), or of the ground through the air, from above it; to: the direction of the source of light.
vec4 fromSpace(int field, bool up, vec3 d, float angle, vec3 to) {
  float low = uEarth[field].x, top = uEarth[field].y, p = uOrbit * length(d.xy);
  if (up && (d.z >= 0.0 || p >= top)) return vec4(0.0);
  p = up ? max(p, low) : min(p, low);
  float t = -uOrbit * d.z - (up ? 0.0 : sqrt(max(0.0, low * low - p * p)));
  vec3 n = normalize(vec3(0.0, 0.0, uOrbit) + t * d), level = d - dot(d, n) * n;
  float size = length(level), above = clamp(dot(to, n), -1.0, 1.0);
  float along = size > 1e-6 ? dot(to, level) / size : 0.0;
  float azimuth = atan(sqrt(max(0.0, 1.0 - above * above - along * along)), along);
  float row = up ? 90.0 + BESIDE + p - low : min(degrees(asin(min(1.0, p / low))), 90.0 - BESIDE);
  vec4 sum = skyLight(2 * field, 2 * uCount.x * field, uCount, vec3(degrees(asin(above)), row, degrees(azimuth)), angle);
  return up ? sum * sqrt(1.0 - exp((p - top) / uEdge)) : sum;   // space.py
}

// Light of the air, or of the ground through it, of a source at 1 au in the direction `to`; a: azimuth of d from there;
// body: 0 the sun, 1 the moon.
vec4 scattered(int field, int body, bool up, vec3 d, float e, float a, vec3 to) {
  if (uOrbit > 0.0) return fromSpace(field, up, d, between(d, to), to);
  if (uGrid && !up) return vec4(0.0);
  int first = 2 * (field + uFields * body);
  float h = degrees(uHorizon[field]), row = up ? max(degrees(e), h + BESIDE) : min(degrees(e), h - BESIDE);
  float column = uGrid ? mod(degrees(a), 360.0) : degrees(abs(a));
  float lifted = atan(to.z, length(to.xy)) + radians(skyNode(first, 3, 0)), flat_ = length(to.xy);
  vec3 seen = vec3((flat_ > 1e-7 ? to.xy / flat_ : vec2(0.0, 1.0)) * cos(lifted), sin(lifted));
  return skyLight(first, first, uCount, vec3(0.0, row, column), between(d, seen));
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
  int row = LINES * field + 2;
  return line(row, u) + line(row + 1, u) * starlight(d) + line(row + 2, u) * uNightMean.x
       + line(row + 3, u) * zodiacal(d) + line(row + 4, u) * uNightMean.y;
}

// The sun's disc through refracting air: flattened, limb darkened (Cox 2000, 550 nm).
vec4 disc(int field, float e, float u, vec3 d) {
  float refraction = line(LINES * field + 1, u).r, flat_ = length(d.xy);
  float there = e - refraction;
  vec3 straight = vec3(d.xy / max(flat_, 1e-9) * cos(there), sin(there));
  float rho = between(straight, uSun);
  float cover = clamp((uSunRadius - rho) / max(fwidth(rho), 1e-7) + 0.5, 0.0, 1.0);
  if (cover == 0.0) return vec4(0.0);
  float mu = sqrt(max(0.0, 1.0 - rho * rho / (uSunRadius * uSunRadius)));
  float limb = (0.30 + 0.93 * mu - 0.23 * mu * mu) / 0.805;
  return cover * limb * exp(line(LINES * field, u)) / (PI * uSunRadius * uSunRadius) * uNear;
}

// The moon's, whose surface reflects by the law of Lommel and Seeliger (sky/moon/disc.py): the mean of n x n points.
vec4 moonDisc(int field, float e, float u, vec3 d) {
  float refraction = line(LINES * field + 1, u).r, flat_ = length(d.xy), there = e - refraction, sum = 0.0;
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
  vec4 beam = max(uMoonColour[field] * exp(line(LINES * field, u)), 0.0);
  return sum * beam / (uMoonShape * uMoonRadius * uMoonRadius);
}

float azimuthFrom(vec2 side, vec2 d) { return length(d) > 1e-7 ? atan(d.x * side.y - d.y * side.x, dot(d, side)) : 0.0; }

// Light of air or ground under sun and moon, and the night's.
vec4 lightOf(int field, bool up, vec3 d, float e, float u) {
  vec4 sum = scattered(field, 0, up, d, e, azimuthFrom(uSunSide, d.xy), uSun) * uNear;
  if (uMoonlit) {
    vec4 lit = scattered(field, 1, up, d, e, azimuthFrom(uMoonSide, d.xy), uMoon);
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
