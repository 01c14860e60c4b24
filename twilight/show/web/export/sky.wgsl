// The sky of one air for one observer, for every sun (`twilight export shader`), by the rule of sky.glsl.
//
//   skyTable   sky.bin: texture_3d rgba32float of COLUMNS x ROWS x (2 SUNS)
//   skyLines   lines.bin: texture_2d rgba32float of 1024 x 2
//
// view, sun: unit vectors, z up, the sun's without refraction. Results: cd m^-2 with the sun at 1 au; without its disc.
@group(0) @binding(0) var skyTable: texture_3d<f32>;
@group(0) @binding(1) var skyLines: texture_2d<f32>;
const SUNS = {{SUNS}};
const ROWS = {{ROWS}};
const COLUMNS = {{COLUMNS}};
const RGB_OF_XYZ = mat3x3<f32>({{RGB}});

struct SkyStencil { at: vec4<i32>, weight: vec4<f32> }

fn skyNode(axis: i32, i: i32) -> f32 { return textureLoad(skyLines, vec2<i32>(i, 0), 0)[axis]; }

// Four of n nodes about x and their weights. A slope is that of the parabola through three nodes, at either end and at a
// node that stands twice that of one pair.
fn skyStencil(axis: i32, n: i32, x: f32) -> SkyStencil {
  var low = 0;
  var high = n - 1;
  while (high - low > 1) {
    let middle = (low + high) / 2;
    if (skyNode(axis, middle) <= x) { low = middle; } else { high = middle; }
  }
  let at = clamp(low + vec4<i32>(-1, 0, 1, 2), vec4<i32>(0), vec4<i32>(n - 1));
  let first = skyNode(axis, at.y);
  let last = skyNode(axis, at.z);
  let h = last - first;
  let before = first - skyNode(axis, at.x);
  let after = skyNode(axis, at.w) - last;
  var b = 0.0;
  var a = 0.0;
  if (before > 0.0) { b = h / before; }
  if (after > 0.0) { a = h / after; }
  let l = 1.0 / (1.0 + b);
  let r = 1.0 / (1.0 + a);
  let u = clamp((x - first) / h, 0.0, 1.0);
  let p = u * (1.0 - u) * (1.0 - u);
  let q = u * u * (1.0 - u);
  let inner = p * l - q * r;
  let left = p * (1.0 - l) * b;
  let right = q * (1.0 - r) * a;
  return SkyStencil(at, vec4<f32>(-left, (1.0 + 2.0 * u) * (1.0 - u) * (1.0 - u) - inner + left, u * u * (3.0 - 2.0 * u) + inner + right, -right));
}

// The same of suns: below the first one logarithms fall on straight.
fn skySuns(sun: f32) -> SkyStencil {
  let found = skyStencil(0, SUNS, sun);
  let first = skyNode(0, 0);
  let below = (first - sun) / (skyNode(0, 1) - first);
  if (below > 0.0) { return SkyStencil(found.at, vec4<f32>(0.0, 1.0 + below, -below, 0.0)); }
  return found;
}

fn skyLayers(layer: i32, s: SkyStencil, r: SkyStencil, c: SkyStencil) -> vec4<f32> {
  var sum = vec4<f32>(0.0);
  for (var i = 0; i < 4; i++) {
    for (var j = 0; j < 4; j++) {
      for (var k = 0; k < 4; k++) {
        sum += s.weight[i] * r.weight[j] * c.weight[k] * textureLoad(skyTable, vec3<i32>(c.at[k], r.at[j], layer + s.at[i]), 0);
      }
    }
  }
  return sum;
}

// X, Y, Z and scotopic luminance.
fn skyXyz(view: vec3<f32>, sun: vec3<f32>) -> vec4<f32> {
  let t = degrees(atan2(sun.z, length(sun.xy)));
  let across = view.x * sun.y - view.y * sun.x;
  let along = dot(view.xy, sun.xy);
  let beside = select(0.0, degrees(abs(atan2(across, along))), abs(across) + abs(along) > 1e-12);
  let s = skySuns(t);
  let r = skyStencil(1, ROWS, degrees(atan2(view.z, length(view.xy))));
  let c = skyStencil(2, COLUMNS, beside);
  // where refraction shows the sun, or would
  let lifts = vec4<f32>(skyNode(3, s.at.x), skyNode(3, s.at.y), skyNode(3, s.at.z), skyNode(3, s.at.w));
  let lifted = radians(t + dot(s.weight, lifts));
  let side = select(vec2<f32>(0.0, 1.0), sun.xy / max(length(sun.xy), 1e-9), length(sun.xy) > 1e-9);
  let seen = vec3<f32>(side * cos(lifted), sin(lifted));
  let u = sqrt(2.0 * atan2(length(view - seen), length(view + seen)) / 3.14159265358979) * 1023.0;
  let i = clamp(i32(u), 0, 1022);
  let phase = mix(textureLoad(skyLines, vec2<i32>(i, 1), 0), textureLoad(skyLines, vec2<i32>(i + 1, 1), 0), u - f32(i));
  return exp(skyLayers(0, s, r, c)) + exp(skyLayers(SUNS, s, r, c) + phase);
}

// Linear Rec. 709; blues outside its gamut have negative red.
fn skyRgb(view: vec3<f32>, sun: vec3<f32>) -> vec3<f32> { return RGB_OF_XYZ * skyXyz(view, sun).xyz; }
