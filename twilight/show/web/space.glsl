// Above the air: a line of sight by where it passes the Earth (twilight/viewer/space.py).
uniform float uOrbit;        // distance of the observer from the Earth's centre, km; 0: within the air
uniform vec2 uEarth[2];      // p of the ray that grazes the ground, radius of the top of the air, km
uniform float uLinesTo;      // km above p_h that the lines of 256 nodes reach

// Place among the nodes of `uLines`, 0 to 1: by elevation e over the horizon h, or by height over the grazing ray.
float linePlace(int field, float e, float h, float across) {
  if (uOrbit > 0.0) {
    if (e >= 0.0) return 1.0;
    return pow(clamp((uOrbit * across - uEarth[field].x) / uLinesTo, 0.0, 1.0), 1.0 / 1.5);
  }
  return sqrt(clamp((e - h) / (1.57079632679 - h), 0.0, 1.0));
}
