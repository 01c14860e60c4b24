#version 300 es
// From linear Rec. 709 to the screen, dithered.
precision highp float;
precision highp sampler2D;
//#include tone.glsl
out vec4 shown;
uniform sampler2D uLinear;

float hash(vec2 p) {
  vec3 q = fract(vec3(p.xyx) * 0.1031);
  q += dot(q, q.yzx + 33.33);
  return fract((q.x + q.y) * q.z);
}

// Noise from -1 to 1 of one channel, triangular.
float dither(float seed) { return hash(gl_FragCoord.xy + seed) + hash(gl_FragCoord.xy + seed + 211.1) - 1.0; }

void main() {
  vec4 linear = texelFetch(uLinear, ivec2(gl_FragCoord.xy), 0);
  if (linear.w < 0.0) { shown = vec4(0.0, 0.0, 0.0, 1.0); return; }
  vec3 noise = vec3(dither(0.0), dither(71.7), dither(151.3));
  shown = vec4(srgb(photographic(intoGamut(linear.rgb))) + noise / 255.0, 1.0);
}
