// The sky of one air from the ground, for every sun (`twilight export shader`): GLSL ES 3.00, GLSL 3.30.
//
//   skyTable   sky.bin: a 3-D texture RGBA16F of AZIMUTHS x (GROUND + SKY) x (2 SUNS), filtered linearly, clamped
//   skyLines   lines.bin: a texture RGBA32F of 256 x 3, not filtered
//
// view, sun: unit vectors, z up, the sun's without refraction. Results: cd m^-2 with the sun at 1 au; without its disc.
#ifdef GL_ES
precision highp float;
precision highp int;
precision highp sampler2D;
precision highp sampler3D;
#endif
uniform sampler3D skyTable;
uniform sampler2D skyLines;
const int SUNS = {{SUNS}}, GROUND = {{GROUND}}, SKY = {{SKY}}, AZIMUTHS = {{AZIMUTHS}};
const float HORIZON = {{HORIZON}}, LOWEST_SUN = {{LOWEST}};   // deg
const mat3 RGB_OF_XYZ = mat3({{RGB}});

vec4 skyLine(int row, float place, int count) {
  int i = clamp(int(place), 0, count - 2);
  return mix(texelFetch(skyLines, ivec2(i, row), 0), texelFetch(skyLines, ivec2(i + 1, row), 0), place - float(i));
}

// X, Y, Z and scotopic luminance.
vec4 skyXyz(vec3 view, vec3 sun) {
  float e = degrees(atan(view.z, length(view.xy))), t = degrees(atan(sun.z, length(sun.xy)));
  // place of the sun: even in asinh((t + 8) / 8)
  float low = asinh((LOWEST_SUN + 8.0) / 8.0), high = asinh(98.0 / 8.0);
  float s = clamp((asinh((t + 8.0) / 8.0) - low) / (high - low), 0.0, 1.0) * float(SUNS - 1);
  // place of the direction: ground and sky do not mix, rows end at the horizon
  float y = e >= HORIZON ? float(GROUND) + sqrt(min((e - HORIZON) / (90.0 - HORIZON), 1.0)) * float(SKY - 1)
                         : (1.0 - sqrt(min((HORIZON - e) / (90.0 + HORIZON), 1.0))) * float(GROUND - 1);
  float across = view.x * sun.y - view.y * sun.x, along = dot(view.xy, sun.xy);
  float beside = abs(across) + abs(along) > 1e-12 ? abs(atan(across, along)) : 0.0;
  float x = pow(beside / 3.14159265358979, 1.0 / 1.5) * float(AZIMUTHS - 1);
  vec3 size = vec3(AZIMUTHS, GROUND + SKY, 2 * SUNS), at = vec3(x, y, s) + 0.5;
  vec4 sky = texture(skyTable, at / size), aureole = texture(skyTable, (at + vec3(0.0, 0.0, SUNS)) / size);
  float angle = 2.0 * atan(length(view - sun), length(view + sun));
  vec4 phase = skyLine(2, sqrt(angle / 3.14159265358979) * 255.0, 256);
  return exp(sky + skyLine(0, s, SUNS)) + exp(aureole + skyLine(1, s, SUNS) + phase);
}

// Linear Rec. 709; blues outside its gamut have negative red.
vec3 skyRgb(vec3 view, vec3 sun) { return RGB_OF_XYZ * skyXyz(view, sun).xyz; }
