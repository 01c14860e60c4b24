// From linear Rec. 709 to the screen, as colour.py and tone/__init__.py have it: gamut, curve of a photograph, sRGB.
//#include constants.glsl

vec3 intoGamut(vec3 c) {
  float grey = max(dot(c, Y709), 0.0), low = min(c.r, min(c.g, c.b));
  return low < 0.0 ? max(vec3(grey) + grey / (grey - low) * (c - grey), 0.0) : c;
}

vec3 sigmoid(vec3 x) {
  float c = pow(MIDDLE_GREY, CONTRAST) * (1.0 / MIDDLE_GREY - 1.0);
  return 1.0 / (1.0 + c * pow(max(x, 1e-12), vec3(-CONTRAST)));
}

vec3 photographic(vec3 x) {
  x = max(x, 0.0);
  float largest = max(max(x.r, max(x.g, x.b)), 1e-12);
  float t = clamp((log2(largest) - BURNT_FROM) / (BURNT_TO - BURNT_FROM), 0.0, 1.0);
  float each = mix(EACH_CHANNEL, 1.0, t * t * (3.0 - 2.0 * t));
  vec3 mixed = each * sigmoid(x + BURNT_LEAK * t * (largest - x)) + x * ((1.0 - each) * sigmoid(vec3(largest)).x / largest);
  float grey = dot(mixed, Y709);
  return max(grey + SATURATION * (mixed - grey), 0.0);
}

vec3 srgb(vec3 x) {
  x = clamp(x, 0.0, 1.0);
  return mix(1.055 * pow(max(x, 1e-12), vec3(1.0 / 2.4)) - 0.055, 12.92 * x, lessThanEqual(x, vec3(0.0031308)));
}
