#version 300 es
// From X, Y, Z and scotopic luminance [cd m^-2] to linear Rec. 709 on the scale of the curve; w < 0: outside the picture.
precision highp float;
precision highp sampler2D;
//#include tone.glsl
out vec4 linear;
uniform sampler2D uLight, uStars;
uniform sampler2D uAdaptation;   // m of CIE 191 over log10 of photopic (y) and of scotopic over photopic luminance (x)
uniform float uExposed;         // what 1 cd m^-2 becomes, mesopic for an eye
uniform float uStarUnit;        // 1 cd m^-2 in the unit of uStars
uniform bool uEye;

float log10(float x) { return log2(x) * 0.30102999566; }

float adaptationCoefficient(float photopic, float scotopic) {
  vec2 last = vec2(textureSize(uAdaptation, 0) - 1);
  float ratio = (log10(scotopic / photopic) - LOG10_RATIO_FROM) / (LOG10_RATIO_TO - LOG10_RATIO_FROM);
  float light = (log10(photopic) - LOG10_PHOTOPIC_FROM) / (LOG10_PHOTOPIC_TO - LOG10_PHOTOPIC_FROM);
  vec2 p = clamp(vec2(ratio, light), 0.0, 1.0) * last;
  ivec2 i = ivec2(min(floor(p), last - 1.0));
  vec2 t = p - vec2(i);
  float low = mix(texelFetch(uAdaptation, i, 0).r, texelFetch(uAdaptation, i + ivec2(1, 0), 0).r, t.x);
  float high = mix(texelFetch(uAdaptation, i + ivec2(0, 1), 0).r, texelFetch(uAdaptation, i + ivec2(1, 1), 0).r, t.x);
  return mix(low, high, t.y);
}

// X, Y, Z of what an eye sees between day and night vision (tone/eye.py: Eye.develop).
vec3 mesopic(vec4 light) {
  float photopic = max(light.y, 1e-12), scotopic = max(light.w, 1e-12), m = adaptationCoefficient(photopic, scotopic);
  float cones = m * photopic, rods = (1.0 - m) * scotopic * MESOPIC_RATIO;
  float seen = (cones + rods) / (m + (1.0 - m) * MESOPIC_RATIO);
  return seen * mix(NIGHT_BLUE, light.xyz / photopic, cones / (cones + rods));
}

void main() {
  ivec2 at = ivec2(gl_FragCoord.xy);
  vec4 light = texelFetch(uLight, at, 0);
  if (light.w < 0.0) { linear = vec4(0.0, 0.0, 0.0, -1.0); return; }
  light += texelFetch(uStars, at, 0) / uStarUnit;
  linear = vec4(RGB_OF_XYZ * (uEye ? mesopic(light) : light.xyz) * uExposed, 1.0);
}
