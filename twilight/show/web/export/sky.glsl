// The sky of one air for one observer, for every sun (`twilight export shader`): GLSL ES 3.00, GLSL 3.30.
//
//   skyTable   sky.bin: a 3-D texture RGBA32F of COLUMNS x ROWS x (2 SUNS), not filtered
//   skyLines   lines.bin: a texture RGBA32F of 1024 x 2, not filtered
//
// view, sun: unit vectors, z up, the sun's without refraction. Results: cd m^-2 with the sun at 1 au; without its disc.
#ifdef GL_ES
precision highp float;
precision highp int;
precision highp sampler2D;
precision highp sampler3D;
#endif
const int SUNS = {{SUNS}}, ROWS = {{ROWS}}, COLUMNS = {{COLUMNS}};
const mat3 RGB_OF_XYZ = mat3({{RGB}});

//#include table.glsl
// X, Y, Z and scotopic luminance.
vec4 skyXyz(vec3 view, vec3 sun) {
  float e = degrees(atan(view.z, length(view.xy))), t = degrees(atan(sun.z, length(sun.xy)));
  float across = view.x * sun.y - view.y * sun.x, along = dot(view.xy, sun.xy);
  float beside = abs(across) + abs(along) > 1e-12 ? degrees(abs(atan(across, along))) : 0.0;
  float lifted = radians(skyApparent(0, SUNS, t)), flat_ = length(sun.xy);
  vec3 seen = vec3((flat_ > 1e-9 ? sun.xy / flat_ : vec2(0.0, 1.0)) * cos(lifted), sin(lifted));
  float angle = 2.0 * atan(length(view - seen), length(view + seen));
  return skyLight(0, 0, ivec3(SUNS, ROWS, COLUMNS), vec3(t, e, beside), angle);
}

// Linear Rec. 709; blues outside its gamut have negative red.
vec3 skyRgb(vec3 view, vec3 sun) { return RGB_OF_XYZ * skyXyz(view, sun).xyz; }
