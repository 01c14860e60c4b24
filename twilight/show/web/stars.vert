#version 300 es
precision highp float;
//#include projection.glsl
//#include space.glsl
layout(location = 0) in vec4 star;   // direction in the equator's frame, magnitude
uniform mat3 uToWorld;
uniform sampler2D uLines;
uniform float uHorizon[2];
uniform float uSplit, uUnit, uPixel;   // uPixel: solid angle of a pixel in the centre, sr; uUnit: 1 cd m^-2
out vec4 colour;   // X, Y, Z and scotopic
const float SIZE = 7.0;
void main() {
  vec3 d = uToWorld * star.xyz;
  vec2 p;
  gl_PointSize = SIZE;
  bool there = placeOf(d, p);
  int field = p.x < uSplit ? 0 : 1;
  float e = atan(d.z, length(d.xy)), h = uHorizon[field];
  gl_Position = there && e > h && max(abs(p.x), abs(p.y)) < 1.05 ? vec4(p, 0.0, 1.0) : vec4(2.0, 2.0, 2.0, 1.0);
  float u = linePlace(field, e, h, length(d.xy));
  // light of one star of magnitude 10 per square degree, as it comes through the air
  vec4 through = texelFetch(uLines, ivec2(int(u * 255.0), 7 * field + 3), 0);
  vec4 lux = through * 3.04617e-4 * exp(-0.921034 * (star.w - 10.0));
  colour = min(lux / (uPixel * 6.2832 * 1.1) * uUnit, 6e4);
}
