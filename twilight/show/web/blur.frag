#version 300 es
// A Gaussian along rows or columns, for the acuity of an eye; beyond the edges the outermost pixel goes on.
precision highp float;
precision highp sampler2D;
out vec4 blurred;
uniform sampler2D uLinear;
uniform ivec2 uStep;     // pixels from one sample to the next, along one axis
uniform float uSigma;    // in steps

void main() {
  ivec2 at = ivec2(gl_FragCoord.xy), last = textureSize(uLinear, 0) - 1;
  vec4 here = texelFetch(uLinear, at, 0);
  vec3 sum = here.rgb;
  float weights = 1.0;
  int radius = int(4.0 * uSigma + 0.5);
  for (int i = 1; i <= radius; i++) {
    float weight = exp(-0.5 * float(i * i) / (uSigma * uSigma));
    sum += weight * (texelFetch(uLinear, clamp(at - i * uStep, ivec2(0), last), 0).rgb + texelFetch(uLinear, clamp(at + i * uStep, ivec2(0), last), 0).rgb);
    weights += 2.0 * weight;
  }
  blurred = vec4(sum / weights, here.w);
}
