#version 300 es
precision highp float;
in vec4 colour;
out vec4 light;
void main() {
  vec2 q = (gl_PointCoord - 0.5) * 7.0;
  light = colour * exp(-dot(q, q) / (2.0 * 1.1));
}
