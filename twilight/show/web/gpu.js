// WebGL 2: the sky into a float picture, the stars beside it, then both to the screen.
const canvas = byId("sky");
let gl, programs, targets = {}, slots = {}, starCount = 0;

function shader(kind, name) {
  const made = gl.createShader(kind);
  gl.shaderSource(made, SHADERS[name].replace(/\/\/#include (\S+)/g, (_, part) => SHADERS[part]));
  gl.compileShader(made);
  if (!gl.getShaderParameter(made, gl.COMPILE_STATUS)) throw new Error(`${name}: ${gl.getShaderInfoLog(made)}`);
  return made;
}

function program(vertex, fragment) {
  const made = gl.createProgram(), places = {};
  gl.attachShader(made, shader(gl.VERTEX_SHADER, vertex));
  gl.attachShader(made, shader(gl.FRAGMENT_SHADER, fragment));
  gl.linkProgram(made);
  if (!gl.getProgramParameter(made, gl.LINK_STATUS)) throw new Error(`${fragment}: ${gl.getProgramInfoLog(made)}`);
  return { made, at: (name) => (places[name] ??= gl.getUniformLocation(made, name)) };
}

// The texture of a name, without filtering, bound to a unit of its own.
function bind(name, kind) {
  const slot = (slots[name] ??= { unit: Object.keys(slots).length, made: gl.createTexture() });
  gl.activeTexture(gl.TEXTURE0 + slot.unit);
  gl.bindTexture(kind, slot.made);
  gl.texParameteri(kind, gl.TEXTURE_MIN_FILTER, gl.NEAREST);
  gl.texParameteri(kind, gl.TEXTURE_MAG_FILTER, gl.NEAREST);
  return slot;
}

// Data of 4 channels or 1 as a texture.
function texture(name, width, height, channels, data) {
  bind(name, gl.TEXTURE_2D);
  const [inside, outside] = channels === 4 ? [gl.RGBA32F, gl.RGBA] : [gl.R32F, gl.RED];
  gl.texImage2D(gl.TEXTURE_2D, 0, inside, width, height, 0, outside, gl.FLOAT, data);
}

// The same in three dimensions, of 4 channels; data null: one texel, so that its sampler has something to read.
function texture3d(name, width, height, depth, data) {
  bind(name, gl.TEXTURE_3D);
  gl.texImage3D(gl.TEXTURE_3D, 0, gl.RGBA32F, width, height, depth, 0, gl.RGBA, gl.FLOAT, data);
}

function target(name, width, height, half = false) {
  const there = targets[name];
  if (there && there.width === width && there.height === height) return there;
  const slot = bind(name, gl.TEXTURE_2D);
  gl.texImage2D(gl.TEXTURE_2D, 0, half ? gl.RGBA16F : gl.RGBA32F, width, height, 0, gl.RGBA, half ? gl.HALF_FLOAT : gl.FLOAT, null);
  const buffer = there?.buffer ?? gl.createFramebuffer();
  gl.bindFramebuffer(gl.FRAMEBUFFER, buffer);
  gl.framebufferTexture2D(gl.FRAMEBUFFER, gl.COLOR_ATTACHMENT0, gl.TEXTURE_2D, slot.made, 0);
  return (targets[name] = { buffer, width, height, unit: slot.unit });
}

function startGpu() {
  gl = canvas.getContext("webgl2", { alpha: false, antialias: false, depth: false, powerPreference: "high-performance" });
  if (!gl) throw new Error("this browser has no WebGL 2");
  if (!gl.getExtension("EXT_color_buffer_float")) throw new Error("this graphics card cannot draw floating-point pictures");
  programs = { sky: program("whole.vert", "sky.frag"), stars: program("stars.vert", "stars.frag"),
    linear: program("whole.vert", "linear.frag"), blur: program("whole.vert", "blur.frag"), tone: program("whole.vert", "tone.frag") };
  const [luminances, ratios] = HEAD.arrays.adaptation_coefficient.shape;
  texture("uAdaptation", ratios, luminances, 1, tables.adaptation_coefficient);
  const [n, m] = HEAD.arrays.zodiacal?.shape ?? [2, 2], flipped = new Float32Array(n * m);
  if (tables.zodiacal) for (let i = 0; i < n; i++) for (let j = 0; j < m; j++) flipped[j * n + i] = tables.zodiacal[i * m + j];
  texture("uZodiac", n, m, 1, flipped);
  texture3d("spaceTable", 1, 1, 1, null);
  texture("spaceLines", 1, 1, 4, null);
  if (tables.stars) {
    starCount = HEAD.arrays.stars.shape[0];
    gl.bindBuffer(gl.ARRAY_BUFFER, gl.createBuffer());
    gl.bufferData(gl.ARRAY_BUFFER, tables.stars, gl.STATIC_DRAW);
    gl.enableVertexAttribArray(0);
    gl.vertexAttribPointer(0, 4, gl.FLOAT, false, 0, 0);
  }
}

// The tables under this sun; they serve until the sun or the altitude is another.
let sliced = "";
function uploadTables(sun) {
  const moon = theMoon(sun), key = `${sun.shown} ${state.altitude} ${moon?.lights ? moon.shown : ""}`;
  if (key === sliced) return;
  sliced = key;
  if (inSpace()) uploadSpace();
  const lines = new Float32Array(HEAD.fields.length * 7 * 256 * 4);
  if (HEAD.kind === "field") {
    HEAD.fields.forEach((_, k) => {
      const put = (row, values) => lines.set(values, (7 * k + row) * 1024);
      put(0, atAltitude("beam", k));
      atAltitude("refraction_deg", k).forEach((v, i) => { lines[(7 * k + 1) * 1024 + 4 * i] = v * DEG; });
      put(2, atAltitude("night", k));
    });
  }
  texture("uLines", 256, HEAD.fields.length * 7, 4, lines);
  if (inSpace()) return;
  const bodies = moon?.lights ? [sun, moon] : [sun], parts = 2 * HEAD.fields.length * bodies.length;
  const [, , , rows, columns] = HEAD.arrays.sky0.shape, size = rows * columns * 4;
  const whole = new Float32Array(parts * size).fill(NO_LIGHT), nodes = new Float32Array(parts * LINE);
  bodies.forEach((body, i) => HEAD.fields.forEach((f, k) => {
    const first = 2 * (k + HEAD.fields.length * i), under = (name) => underSun(name, body.shown, f.sun_node_deg);
    whole.set(under(`sky${k}`), first * size);
    if (tables[`aureole${k}`]) whole.set(under(`aureole${k}`), (first + 1) * size);
    putNodes(nodes, first, [[0], rowsOf(k), HEAD.column_deg, [liftOf(k, body.shown)]], atAltitude("phase", k));
  }));
  texture3d("skyTable", columns, rows, parts, whole);
  texture("skyLines", LINE / 4, parts, 4, nodes);
}

const NO_LIGHT = -200, LINE = 4 * 1024;   // textures.py

// A table's nodes along each axis as a line of 4 channels, and its phase function as the next one.
function putNodes(lines, line, axes, phase) {
  axes.forEach((nodes, axis) => nodes.forEach((v, i) => { lines[line * LINE + 4 * i + axis] = v; }));
  if (phase) lines.set(phase, (line + 1) * LINE);
}

function setView(p, aspect) {
  gl.useProgram(p.made);
  const { right, forward, up } = camera();
  gl.uniform1i(p.at("uProjection"), ["perspective", "fisheye", "latlong"].indexOf(state.projection));
  gl.uniform1f(p.at("uFov"), state.fov * DEG);
  gl.uniform1f(p.at("uAspect"), aspect);
  gl.uniformMatrix3fv(p.at("uCamera"), false, [...right, ...forward, ...up]);
  gl.uniform2f(p.at("uLook"), state.azimuth * DEG, state.elevation * DEG);
  gl.uniform1f(p.at("uSplit"), 2 * splitAt() - 1);
  gl.uniform1i(p.at("uLines"), slots.uLines.unit);
  gl.uniform1fv(p.at("uHorizon"), twice((k) => horizonOf(k) * DEG));
  gl.uniform1f(p.at("uOrbit"), inSpace() ? orbitRadius(0) : 0);
  if (!HEAD.space) return;
  gl.uniform2fv(p.at("uEarth"), twice((k) => [HEAD.fields[k].grazing_km, HEAD.fields[k].top_radius_km]).flat());
  gl.uniform1f(p.at("uLinesTo"), HEAD.space.lines_to_km);
}

const splitAt = () => (HEAD.fields.length > 1 ? state.split : 2);
const twice = (f) => [0, 1].map((k) => f(Math.min(k, HEAD.fields.length - 1)));

// X, Y, Z and scotopic luminance into a target; discs: whether those of sun and moon are in it.
function drawLight(into, aspect, sun, sky, discs) {
  const p = programs.sky, moon = theMoon(sun), [place, name] = inSpace() ? ["space", "space_sky0"] : ["sky", "sky0"];
  const [, , suns, rows, columns] = HEAD.arrays[name].shape;
  setView(p, aspect);
  gl.uniform1i(p.at("skyTable"), slots[`${place}Table`].unit);
  gl.uniform1i(p.at("skyLines"), slots[`${place}Lines`].unit);
  gl.uniform3i(p.at("uCount"), inSpace() ? suns : 1, rows, columns);
  gl.uniform1i(p.at("uFields"), HEAD.fields.length);
  gl.uniform1i(p.at("uZodiac"), slots.uZodiac.unit);
  gl.uniform1f(p.at("uEdge"), HEAD.space?.edge_km ?? 1);
  gl.uniform1i(p.at("uGrid"), HEAD.kind !== "field" ? 1 : 0);
  gl.uniform3fv(p.at("uSun"), sun.direction);
  gl.uniform2f(p.at("uSunSide"), Math.sin(sun.azimuth * DEG), Math.cos(sun.azimuth * DEG));
  gl.uniform1f(p.at("uSunRadius"), 0.26656 / sun.distance * DEG);
  gl.uniform1f(p.at("uNear"), 1 / sun.distance ** 2);
  gl.uniform1i(p.at("uDisc"), discs && state.disc && HEAD.kind === "field" ? 1 : 0);
  gl.uniform1i(p.at("uMoonlit"), moon?.lights ? 1 : 0);
  gl.uniform1i(p.at("uMoonDisc"), moon && discs ? 1 : 0);
  if (moon) {
    gl.uniform3fv(p.at("uMoon"), moon.direction);
    gl.uniform3fv(p.at("uMoonSun"), moon.toSun);
    gl.uniform2f(p.at("uMoonSide"), Math.sin(moon.azimuth * DEG), Math.cos(moon.azimuth * DEG));
    gl.uniform1f(p.at("uMoonRadius"), moon.radius);
    gl.uniform1f(p.at("uMoonShape"), moonDiscIntegral(moon.phase));
    gl.uniformMatrix4fv(p.at("uMoonColour"), false, twice((k) => moonlight(moon, k, "moon_colours")).flat());
  }
  gl.uniform1i(p.at("uNight"), state.night && HEAD.kind === "field" ? 1 : 0);
  if (state.night && HEAD.kind === "field") {
    const mean = nightMeans(sky);
    gl.uniform3fv(p.at("uGalacticPole"), sky.galacticPole);
    gl.uniform3fv(p.at("uEclipticPole"), sky.eclipticPole);
    gl.uniform3fv(p.at("uEclipticSun"), sky.eclipticSun);
    gl.uniform2fv(p.at("uNightMean"), mean);
    const grounds = twice((k) => atAltitude("night_ground", k)).map((g) => [0, 1, 2, 3].map((c) => g[c] + g[4 + c] * mean[0] + g[8 + c] * mean[1]));
    gl.uniform4fv(p.at("uNightGround"), grounds.flat());
  }
  gl.bindFramebuffer(gl.FRAMEBUFFER, into.buffer);
  gl.viewport(0, 0, into.width, into.height);
  gl.drawArrays(gl.TRIANGLES, 0, 3);
}

// Light of the stars in units of 1 / unit cd m^-2: half floats hold it, which every card can add up.
function drawStars(aspect, sky, unit) {
  const into = target("stars", canvas.width, canvas.height, true), p = programs.stars;
  gl.bindFramebuffer(gl.FRAMEBUFFER, into.buffer);
  gl.viewport(0, 0, into.width, into.height);
  gl.clearColor(0, 0, 0, 0);
  gl.clear(gl.COLOR_BUFFER_BIT);
  if (!state.stars || !starCount) return;
  setView(p, aspect);
  const r = sky.rows;
  gl.uniformMatrix3fv(p.at("uToWorld"), false, [0, 1, 2].flatMap((j) => [r[0][j], r[1][j], r[2][j]]));
  gl.uniform1f(p.at("uUnit"), unit);
  gl.uniform1f(p.at("uPixel"), pixelAngle(aspect) ** 2);
  gl.enable(gl.BLEND);
  gl.blendFunc(gl.ONE, gl.ONE);
  gl.drawArrays(gl.POINTS, 0, starCount);
  gl.disable(gl.BLEND);
}

// Angle of a pixel in the picture's centre, rad.
function pixelAngle(aspect) {
  const w = canvas.width, fov = state.fov * DEG;
  if (state.projection === "perspective") return 2 * Math.tan(fov / 2) / w;
  return fov / (state.projection === "fisheye" ? Math.min(w, canvas.height) : w);
}

function drawInto(into, p) {
  gl.bindFramebuffer(gl.FRAMEBUFFER, into?.buffer ?? null);
  gl.viewport(0, 0, canvas.width, canvas.height);
  gl.drawArrays(gl.TRIANGLES, 0, 3);
}

// Light and stars as a tone shows them, blurred as an eye's acuity has it, to the screen; shot: of exposureNow.
function drawTone(shot) {
  const p = programs.linear, linear = target("linear", canvas.width, canvas.height);
  gl.useProgram(p.made);
  gl.uniform1i(p.at("uLight"), targets.light.unit);
  gl.uniform1i(p.at("uStars"), targets.stars.unit);
  gl.uniform1i(p.at("uAdaptation"), slots.uAdaptation.unit);
  gl.uniform1f(p.at("uExposed"), shot.exposed);
  gl.uniform1f(p.at("uStarUnit"), shot.exposed);
  gl.uniform1i(p.at("uEye"), state.tone === "eye" ? 1 : 0);
  drawInto(linear, p);
  if (shot.sigma > 0) blur(linear, shot.sigma);
  gl.useProgram(programs.tone.made);
  gl.uniform1i(programs.tone.at("uLinear"), linear.unit);
  drawInto(null, programs.tone);
}

// A Gaussian of sigma pixels.  A wide one is made of narrower ones whose variances sum to its own: what one has
// smoothed the next may read in larger steps.
function blur(picture, sigma) {
  const p = programs.blur, other = target("blurred", canvas.width, canvas.height);
  gl.useProgram(p.made);
  let left = sigma * sigma;
  for (let most = 8; left > 0; most *= 8) {
    const part = Math.min(Math.sqrt(left), most), step = Math.ceil(part / 8);
    left = part < most ? 0 : left - part * part;
    for (const [from, into, direction] of [[picture, other, [step, 0]], [other, picture, [0, step]]]) {
      gl.uniform1i(p.at("uLinear"), from.unit);
      gl.uniform2i(p.at("uStep"), ...direction);
      gl.uniform1f(p.at("uSigma"), part / step);
      drawInto(into, p);
    }
  }
}

// X, Y, Z, scotopic of pixels, rows from the bottom.
function readLight(from, x = 0, y = 0, width = from.width, height = from.height) {
  const out = new Float32Array(4 * width * height);
  gl.bindFramebuffer(gl.FRAMEBUFFER, from.buffer);
  gl.readPixels(x, y, width, height, gl.RGBA, gl.FLOAT, out);
  return out;
}
