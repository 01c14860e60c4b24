// The tables of a sky and the one rule by which they are read (twilight/sky/table.py):
//
//   light = exp(S) + P(angle) exp(A)
//
// S, A: local cubics through the nodes of sun, row and column; P: linear in its logarithm and the root of the angle.
//
//   skyTable   RGBA32F, columns x rows x layers: S of every sun, then A of every sun
//   skyLines   RGBA32F: a line of nodes, of sun, row and column, and what refraction lifts the sun [deg]; then one of ln P
uniform sampler3D skyTable;
uniform sampler2D skyLines;

float skyNode(int line, int axis, int i) { return texelFetch(skyLines, ivec2(i, line), 0)[axis]; }

// Four of n nodes about x and their weights. A slope is that of the parabola through three nodes, at either end and at a
// node that stands twice that of one pair.
void skyStencil(int line, int axis, int n, float x, out ivec4 at, out vec4 weight) {
  at = ivec4(0);
  weight = vec4(1.0, 0.0, 0.0, 0.0);
  if (n == 1) return;
  int low = 0, high = n - 1;
  while (high - low > 1) {
    int middle = (low + high) / 2;
    if (skyNode(line, axis, middle) <= x) low = middle; else high = middle;
  }
  at = clamp(low + ivec4(-1, 0, 1, 2), 0, n - 1);
  float first = skyNode(line, axis, at.y), last = skyNode(line, axis, at.z), h = last - first;
  float before = first - skyNode(line, axis, at.x), after = skyNode(line, axis, at.w) - last;
  float b = before > 0.0 ? h / before : 0.0, a = after > 0.0 ? h / after : 0.0, l = 1.0 / (1.0 + b), r = 1.0 / (1.0 + a);
  float u = clamp((x - first) / h, 0.0, 1.0), p = u * (1.0 - u) * (1.0 - u), q = u * u * (1.0 - u);
  float inner = p * l - q * r, left = p * (1.0 - l) * b, right = q * (1.0 - r) * a;
  weight = vec4(-left, (1.0 + 2.0 * u) * (1.0 - u) * (1.0 - u) - inner + left, u * u * (3.0 - 2.0 * u) + inner + right, -right);
}

// The same of suns: below the first one logarithms fall on straight.
void skySuns(int line, int n, float sun, out ivec4 at, out vec4 weight) {
  skyStencil(line, 0, n, sun, at, weight);
  float first = skyNode(line, 0, 0), below = n > 1 ? (first - sun) / (skyNode(line, 0, 1) - first) : 0.0;
  if (below > 0.0) weight = vec4(0.0, 1.0 + below, -below, 0.0);
}

// Where refraction shows a sun [deg], or would.
float skyApparent(int line, int suns, float sun) {
  ivec4 at;
  vec4 w;
  skySuns(line, suns, sun, at, w);
  return sun + dot(w, vec4(skyNode(line, 3, at.x), skyNode(line, 3, at.y), skyNode(line, 3, at.z), skyNode(line, 3, at.w)));
}

vec4 skyLayers(int layer, ivec4 s, vec4 ws, ivec4 r, vec4 wr, ivec4 c, vec4 wc) {
  vec4 sum = vec4(0.0);
  for (int i = 0; i < 4; i++) {
    if (ws[i] == 0.0) continue;
    for (int j = 0; j < 4; j++) {
      if (wr[j] == 0.0) continue;
      int row = r[j], z = layer + s[i];
      sum += ws[i] * wr[j] * (wc.x * texelFetch(skyTable, ivec3(c.x, row, z), 0) + wc.y * texelFetch(skyTable, ivec3(c.y, row, z), 0)
           + wc.z * texelFetch(skyTable, ivec3(c.z, row, z), 0) + wc.w * texelFetch(skyTable, ivec3(c.w, row, z), 0));
    }
  }
  return sum;
}

// X, Y, Z and scotopic luminance at a place (sun, row, column), seen at an angle [rad] from the apparent sun.
// line, layer: first ones of the table; count: its suns, rows and columns.
vec4 skyLight(int line, int layer, ivec3 count, vec3 place, float angle) {
  ivec4 s, r, c;
  vec4 ws, wr, wc;
  skySuns(line, count.x, place.x, s, ws);
  skyStencil(line, 1, count.y, place.y, r, wr);
  skyStencil(line, 2, count.z, place.z, c, wc);
  int last = textureSize(skyLines, 0).x - 1;
  float u = sqrt(angle / 3.14159265358979) * float(last);
  int i = clamp(int(u), 0, last - 1);
  vec4 phase = mix(texelFetch(skyLines, ivec2(i, line + 1), 0), texelFetch(skyLines, ivec2(i + 1, line + 1), 0), u - float(i));
  return exp(skyLayers(layer, s, ws, r, wr, c, wc)) + exp(skyLayers(layer + count.x, s, ws, r, wr, c, wc) + phase);
}
