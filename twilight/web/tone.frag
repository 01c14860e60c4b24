#version 300 es
// From X, Y, Z to the screen: exposure, gamut, the photographic curve of colour.py, sRGB, dither.
precision highp float;
precision highp sampler2D;
in vec2 place;
out vec4 shown;
uniform sampler2D uLight, uStars;
uniform float uExposed;   // what a luminance of 1 cd m^-2 becomes; middle grey is 0.18
uniform bool uEye;
uniform float uSeed;

const vec3 Y709 = vec3(0.2126390059, 0.7151686788, 0.0721923154);
const mat3 RGB = mat3(3.2409699419, -0.9692436363, 0.0556300797,
                      -1.5373831776, 1.8759675015, -0.2039769589,
                      -0.4986107603, 0.0415550574, 1.0569715142);

vec3 intoGamut(vec3 c) {
  float grey = max(dot(c, Y709), 0.0), low = min(c.r, min(c.g, c.b));
  return low < 0.0 ? max(vec3(grey) + grey / (grey - low) * (c - grey), 0.0) : c;
}

vec3 sigmoid(vec3 x) {
  const float n = 1.25;
  float c = pow(0.18, n) * (1.0 / 0.18 - 1.0);
  vec3 power = pow(max(x, 1e-12), vec3(n));
  return power / (power + c);
}

vec3 photographic(vec3 x) {
  x = max(x, 0.0);
  float most = max(max(x.r, max(x.g, x.b)), 1e-12);
  vec3 mixed = sigmoid(x) / 3.0 + 2.0 / 3.0 * x * (sigmoid(vec3(most)).x / most);
  float grey = dot(mixed, Y709);
  return max(grey + 1.15 * (mixed - grey), 0.0);
}

vec3 srgb(vec3 x) {
  x = clamp(x, 0.0, 1.0);
  return mix(1.055 * pow(max(x, 1e-12), vec3(1.0 / 2.4)) - 0.055, 12.92 * x, lessThanEqual(x, vec3(0.0031308)));
}

// Rods take over between 5 and 0.005 cd m^-2 (CIE 191:2010): colour goes, blue light gains.
vec3 mesopic(vec3 c, float luminance, float scotopic) {
  const float rods = 683.0 / 1699.0;   // V'(555 nm)
  float m = clamp(0.767 + 0.3334 * log2(max(luminance, 1e-9)) * 0.30103, 0.0, 1.0);
  float seen = (m * luminance + (1.0 - m) * scotopic * rods) / (m + (1.0 - m) * rods);
  vec3 colourless = vec3(0.86, 0.99, 1.47);   // bluish grey with a luminance of 1
  return mix(colourless * seen, c * (seen / max(luminance, 1e-12)), m);
}

float hash(vec2 p) {
  vec3 q = fract(vec3(p.xyx) * 0.1031);
  q += dot(q, q.yzx + 33.33);
  return fract((q.x + q.y) * q.z);
}

void main() {
  ivec2 at = ivec2(gl_FragCoord.xy);
  vec4 light = texelFetch(uLight, at, 0);
  if (light.w < 0.0) { shown = vec4(0.0, 0.0, 0.0, 1.0); return; }
  vec3 c = RGB * light.xyz;
  if (uEye) c = mesopic(c, light.y, light.w);
  c = intoGamut(c * uExposed) + texelFetch(uStars, at, 0).rgb;
  // from 4 to 12 stops above white everything goes to white: the sun's disc is not duller than what is round it
  float most = max(c.r, max(c.g, c.b));
  c = mix(c, vec3(most), smoothstep(4.0, 12.0, log2(max(most, 1e-6))));
  vec3 noise = vec3(hash(gl_FragCoord.xy + uSeed), hash(gl_FragCoord.xy + uSeed + 71.7), hash(gl_FragCoord.xy + uSeed + 151.3))
             + vec3(hash(gl_FragCoord.xy + uSeed + 211.1), hash(gl_FragCoord.xy + uSeed + 293.9), hash(gl_FragCoord.xy + uSeed + 367.7)) - 1.0;
  shown = vec4(srgb(photographic(c)) + noise / 255.0, 1.0);
}
