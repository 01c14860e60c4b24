// The sky of one air from the ground, for every sun (`twilight export shader`).
//
//   skyTable   sky.bin: texture_3d rgba16float of AZIMUTHS x (GROUND + SKY) x (2 SUNS); skySampler: linear, clamped
//   skyLines   lines.bin: texture_2d rgba32float of 256 x 3
//
// view, sun: unit vectors, z up, the sun's without refraction. Results: cd m^-2 with the sun at 1 au; without its disc.
@group(0) @binding(0) var skyTable: texture_3d<f32>;
@group(0) @binding(1) var skySampler: sampler;
@group(0) @binding(2) var skyLines: texture_2d<f32>;
const SUNS = {{SUNS}};
const GROUND = {{GROUND}};
const SKY = {{SKY}};
const AZIMUTHS = {{AZIMUTHS}};
const HORIZON: f32 = {{HORIZON}};     // deg
const LOWEST_SUN: f32 = {{LOWEST}};   // deg
const RGB_OF_XYZ = mat3x3<f32>({{RGB}});

fn skyLine(row: i32, place: f32, count: i32) -> vec4<f32> {
  let i = clamp(i32(place), 0, count - 2);
  return mix(textureLoad(skyLines, vec2<i32>(i, row), 0), textureLoad(skyLines, vec2<i32>(i + 1, row), 0), place - f32(i));
}

// X, Y, Z and scotopic luminance.
fn skyXyz(view: vec3<f32>, sun: vec3<f32>) -> vec4<f32> {
  let e = degrees(atan2(view.z, length(view.xy)));
  let t = degrees(atan2(sun.z, length(sun.xy)));
  // place of the sun: even in asinh((t + 8) / 8)
  let low = asinh((LOWEST_SUN + 8.0) / 8.0);
  let high = asinh(98.0 / 8.0);
  let s = clamp((asinh((t + 8.0) / 8.0) - low) / (high - low), 0.0, 1.0) * f32(SUNS - 1);
  // place of the direction: ground and sky do not mix, rows end at the horizon
  let up = f32(GROUND) + sqrt(clamp((e - HORIZON) / (90.0 - HORIZON), 0.0, 1.0)) * f32(SKY - 1);
  let down = (1.0 - sqrt(clamp((HORIZON - e) / (90.0 + HORIZON), 0.0, 1.0))) * f32(GROUND - 1);
  let y = select(down, up, e >= HORIZON);
  let across = view.x * sun.y - view.y * sun.x;
  let along = dot(view.xy, sun.xy);
  let beside = select(0.0, abs(atan2(across, along)), abs(across) + abs(along) > 1e-12);
  let x = pow(beside / 3.14159265358979, 1.0 / 1.5) * f32(AZIMUTHS - 1);
  let size = vec3<f32>(f32(AZIMUTHS), f32(GROUND + SKY), f32(2 * SUNS));
  let at = vec3<f32>(x, y, s) + 0.5;
  let sky = textureSampleLevel(skyTable, skySampler, at / size, 0.0);
  let aureole = textureSampleLevel(skyTable, skySampler, (at + vec3<f32>(0.0, 0.0, f32(SUNS))) / size, 0.0);
  let angle = 2.0 * atan2(length(view - sun), length(view + sun));
  let phase = skyLine(2, sqrt(angle / 3.14159265358979) * 255.0, 256);
  return exp(sky + skyLine(0, s, SUNS)) + exp(aureole + skyLine(1, s, SUNS) + phase);
}

// Linear Rec. 709; blues outside its gamut have negative red.
fn skyRgb(view: vec3<f32>, sun: vec3<f32>) -> vec3<f32> { return RGB_OF_XYZ * skyXyz(view, sun).xyz; }
