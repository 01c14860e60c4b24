// Reads the tables of `twilight export tables`; for GLSL ES 3.00 and GLSL 3.30 or later.
//
//   skyTable, aureoleTable  sky.bin, aureole.bin: 3-D textures RGB32F of azimuths x rows x (suns * altitudes), where
//                           rows = ground + sky, filtered linearly (WebGL 2: OES_texture_float_linear), clamped to the
//                           edge; the default sizes are 24 x 44 x 480
//   phaseTable              phase.bin: a texture RGB32F of phase_angles x 1
//   skyRows                 ground and sky of `texels` in sky.json
//   skyAltitudes            how many altitudes there are
//   skyAltitude, skyHorizon altitude_km and horizon_deg of sky.json
//   skyGround               ground_km of sky.json
//   skyLowestSun            lowest_sun_deg of sky.json
//   skyAureole              false where phase_angles is 0 (air without aerosol)
//
// skyRadiance times solar_irradiance of sky.json is W m^-2 nm^-1 sr^-1 at 680, 550 and 440 nm.
#ifdef GL_ES
precision highp float;
precision highp int;
precision highp sampler2D;
precision highp sampler3D;
#endif

uniform sampler3D skyTable, aureoleTable;
uniform sampler2D phaseTable;
uniform ivec2 skyRows;
uniform int skyAltitudes;
uniform float skyAltitude[8], skyHorizon[8];
uniform float skyGround, skyLowestSun;
uniform bool skyAureole;

// Position in texels of a sun [deg]; below the lowest it stays there.
float skySun(float sun, int suns) {
  float low = asinh((skyLowestSun + 8.0) / 8.0), high = asinh(98.0 / 8.0);
  return clamp((asinh((sun + 8.0) / 8.0) - low) / (high - low), 0.0, 1.0) * float(suns - 1);
}

// The phase function of the column's aerosol at a scattering angle [rad].
vec3 skyPhase(float angle) {
  int n = textureSize(phaseTable, 0).x;
  float u = sqrt(angle / 3.14159265358979) * float(n - 1);
  int i = clamp(int(u), 0, n - 2);
  vec3 a = log(texelFetch(phaseTable, ivec2(i, 0), 0).rgb), b = log(texelFetch(phaseTable, ivec2(i + 1, 0), 0).rgb);
  return exp(mix(a, b, u - float(i)));
}

// Radiance over the sun's irradiance above the air [sr^-1], red, green, blue.
// sun, elevation, azimuth [deg], azimuth from the sun; altitude of the observer [km], kept within those of the tables.
vec3 skyRadiance(float sun, float elevation, float azimuth, float altitude) {
  ivec3 size = textureSize(skyTable, 0);
  int suns = size.z / skyAltitudes;
  float s = skySun(sun, suns);
  float beside = abs(mod(azimuth + 180.0, 360.0) - 180.0);
  float x = pow(beside / 180.0, 1.0 / 1.5) * float(size.x - 1);

  // between altitudes: linear in the square root of the height above the ground
  float root = sqrt(clamp(altitude, skyAltitude[0], skyAltitude[skyAltitudes - 1]) - skyGround);
  int first = 0;
  while (first < skyAltitudes - 2 && root >= sqrt(skyAltitude[first + 1] - skyGround)) first++;
  int second = min(first + 1, skyAltitudes - 1);
  float r0 = sqrt(skyAltitude[first] - skyGround), r1 = sqrt(skyAltitude[second] - skyGround);
  float above = second > first ? (root - r0) / (r1 - r0) : 0.0;

  // ground and sky do not mix: rows end at the horizon
  float horizon = mix(skyHorizon[first], skyHorizon[second], above);
  float y = elevation >= horizon
    ? float(skyRows.x) + sqrt(min((elevation - horizon) / (90.0 - horizon), 1.0)) * float(skyRows.y - 1)
    : (1.0 - sqrt(min((horizon - elevation) / (90.0 + horizon), 1.0))) * float(skyRows.x - 1);

  vec3 texels = vec3(size);
  vec3 low = vec3(x + 0.5, y + 0.5, float(first * suns) + s + 0.5) / texels;
  vec3 high = vec3(x + 0.5, y + 0.5, float(second * suns) + s + 0.5) / texels;
  vec3 light = exp(mix(texture(skyTable, low).rgb, texture(skyTable, high).rgb, above));
  if (skyAureole) {
    vec3 e = radians(vec3(sun, elevation, azimuth));
    // the angle between two directions, sharp at 0 and at 180 deg
    vec3 a = vec3(cos(e.x), 0.0, sin(e.x)), b = vec3(cos(e.y) * cos(e.z), cos(e.y) * sin(e.z), sin(e.y));
    float angle = 2.0 * atan(length(a - b), length(a + b));
    vec3 aureole = mix(texture(aureoleTable, low).rgb, texture(aureoleTable, high).rgb, above);
    light += skyPhase(angle) * exp(aureole);
  }
  return light;
}
