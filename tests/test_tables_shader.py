"""`sky.glsl`, which an export of tables holds, in a headless browser against the reader in Python."""

from __future__ import annotations

import numpy as np
import pytest
from browser import open_page

from twilight.studies.export import sky_tables
from twilight.studies.export.folder import write_folder

PAGE = """<!doctype html><p id="message"></p><script>
const FRAME = `
uniform sampler2D questions;  // sun, elevation, azimuth, altitude
out vec4 answer;
void main() {
  vec4 q = texelFetch(questions, ivec2(gl_FragCoord.xy), 0);
  answer = vec4(skyRadiance(q.x, q.y, q.z, q.w), 1.0);
}`;
async function start() {
  const header = await (await fetch("sky.json")).json(), reader = await (await fetch("sky.glsl")).text();
  const floats = async name => new Float32Array(await (await fetch(name)).arrayBuffer());
  const gl = document.createElement("canvas").getContext("webgl2");
  for (const name of ["EXT_color_buffer_float", "OES_texture_float_linear"])
    if (!gl.getExtension(name)) throw new Error("cannot: " + name);
  const program = gl.createProgram();
  for (const [kind, text] of [
    [gl.VERTEX_SHADER, "#version 300 es\\nvoid main() {" +
      "gl_Position = vec4(float(gl_VertexID & 1) * 4.0 - 1.0, float(gl_VertexID >> 1) * 4.0 - 1.0, 0.0, 1.0); }"],
    [gl.FRAGMENT_SHADER, "#version 300 es\\n" + reader + FRAME],
  ]) {
    const shader = gl.createShader(kind);
    gl.shaderSource(shader, text);
    gl.compileShader(shader);
    if (!gl.getShaderParameter(shader, gl.COMPILE_STATUS)) throw new Error("cannot: " + gl.getShaderInfoLog(shader));
    gl.attachShader(program, shader);
  }
  gl.linkProgram(program);
  gl.useProgram(program);
  let unit = 0;
  const texture = (name, target, size, values, format, inner, filter) => {
    gl.activeTexture(gl.TEXTURE0 + unit);
    gl.bindTexture(target, gl.createTexture());
    if (size.length == 3) gl.texImage3D(target, 0, inner, ...size, 0, format, gl.FLOAT, values);
    else gl.texImage2D(target, 0, inner, ...size, 0, format, gl.FLOAT, values);
    for (const key of [gl.TEXTURE_MIN_FILTER, gl.TEXTURE_MAG_FILTER]) gl.texParameteri(target, key, filter);
    for (const key of [gl.TEXTURE_WRAP_S, gl.TEXTURE_WRAP_T, gl.TEXTURE_WRAP_R])
      gl.texParameteri(target, key, gl.CLAMP_TO_EDGE);
    gl.uniform1i(gl.getUniformLocation(program, name), unit++);
  };
  const n = header.texels, z = header.altitude_km, aureole = header.phase_angles > 0;
  const size = [n.azimuth, n.ground + n.sky, n.sun * z.length];
  const place = name => gl.getUniformLocation(program, name);
  texture("skyTable", gl.TEXTURE_3D, size, await floats("sky.bin"), gl.RGB, gl.RGB32F, gl.LINEAR);
  const peak = aureole ? await floats("aureole.bin") : new Float32Array(3);
  texture("aureoleTable", gl.TEXTURE_3D, aureole ? size : [1, 1, 1], peak, gl.RGB, gl.RGB32F, gl.LINEAR);
  const phase = aureole ? await floats("phase.bin") : new Float32Array(3);
  texture("phaseTable", gl.TEXTURE_2D, [phase.length / 3, 1], phase, gl.RGB, gl.RGB32F, gl.NEAREST);
  gl.uniform2i(place("skyRows"), n.ground, n.sky);
  gl.uniform1i(place("skyAltitudes"), z.length);
  gl.uniform1fv(place("skyAltitude"), z);
  gl.uniform1fv(place("skyHorizon"), header.horizon_deg);
  gl.uniform1f(place("skyGround"), header.ground_km);
  gl.uniform1f(place("skyLowestSun"), header.lowest_sun_deg);
  gl.uniform1i(place("skyAureole"), aureole);
  window.twilight = { read: questions => {
    const count = questions.length / 4;
    gl.canvas.width = count;
    texture("questions", gl.TEXTURE_2D, [count, 1], new Float32Array(questions), gl.RGBA, gl.RGBA32F, gl.NEAREST);
    const target = gl.createTexture();
    gl.activeTexture(gl.TEXTURE0 + unit);
    gl.bindTexture(gl.TEXTURE_2D, target);
    gl.texStorage2D(gl.TEXTURE_2D, 1, gl.RGBA32F, count, 1);
    gl.bindFramebuffer(gl.FRAMEBUFFER, gl.createFramebuffer());
    gl.framebufferTexture2D(gl.FRAMEBUFFER, gl.COLOR_ATTACHMENT0, gl.TEXTURE_2D, target, 0);
    gl.viewport(0, 0, count, 1);
    gl.drawArrays(gl.TRIANGLES, 0, 3);
    const out = new Float32Array(count * 4);
    gl.readPixels(0, 0, count, 1, gl.RGBA, gl.FLOAT, out);
    return [Array.from(out), gl.getError()];
  } };
}
start().catch(error => { document.querySelector("#message").innerText = "cannot: " + error.message; });
</script>
"""


def any_tables(aerosol: bool, first_km: float = 0.0) -> sky_tables.SkyTables:
    """Tables whose every texel differs from the next by up to a factor of e."""
    random = np.random.default_rng(5)
    ground, sky, suns, azimuths, altitudes = 5, 9, 13, 7, (first_km, 2.0, 10.0, 60.0)
    shape = (len(altitudes), suns, ground + sky, azimuths, 3)
    header = {
        "layout": "twilight",
        "version": 1,
        "texels": {"sun": suns, "ground": ground, "sky": sky, "azimuth": azimuths},
        "altitude_km": list(altitudes),
        "ground_km": 0.0,
        "horizon_deg": [0.0, -1.4, -3.2, -7.8],
        "lowest_sun_deg": sky_tables.LOWEST_SUN_DEG,
        "phase_angles": 40 if aerosol else 0,
    }
    table, peak = (random.uniform(-6.0, -5.0, shape).astype(np.float32) for _ in range(2))
    if not aerosol:
        return sky_tables.SkyTables(header, table, None, None)
    phase = np.exp(np.linspace(4.0, -3.0, 40))[:, None] * np.array([1.0, 1.1, 1.3])
    return sky_tables.SkyTables(header, table, peak, phase.astype(np.float32))


@pytest.mark.parametrize(("aerosol", "first_km"), [(True, 0.0), (False, 1.0)])
def test_the_shader_reads_what_python_reads(aerosol, first_km, tmp_path):
    """The GLSL reader would show another sky than the one in Python."""
    folder = tmp_path / "sky"
    write_folder(folder, any_tables(aerosol, first_km).files())
    (folder / "page.html").write_text(PAGE)
    tables = sky_tables.load(folder)
    random = np.random.default_rng(2)
    count = 400
    sun = random.uniform(sky_tables.LOWEST_SUN_DEG, 90.0, count)
    elevation, azimuth = random.uniform(-90.0, 90.0, count), random.uniform(-400.0, 400.0, count)
    altitude = random.choice([first_km, first_km + 0.01, 1.3, 2.0, 7.0, 30.0, 60.0], count)
    elevation[:100] = random.uniform(-3.0, 3.0, 100)  # where rows are narrow and the sky meets the ground
    sun[:4], elevation[:4], azimuth[:4] = (-20.0, 90.0, 10.0, 0.0), (90.0, -90.0, 10.0, 0.5), (0.0, 180.0, 0.0, 360.0)
    # in float32, as the shader gets them: azimuth 180 u^1.5 is steep at the sun's
    asked = np.stack([sun, elevation, azimuth, altitude], axis=1).astype(np.float32).astype(float)
    expected = np.array([tables.radiance(s, e, a, observer_altitude_km=z) for s, e, a, z in asked])
    with open_page(folder / "page.html") as (page, errors):
        assert page.inner_text("#message") == ""
        found, error = page.evaluate("questions => twilight.read(questions)", asked.ravel().tolist())
        assert error == 0 and errors == []
    found = np.array(found).reshape(count, 4)[:, :3]
    # a software filter, measured 5e-4; of 8 bits between texels that differ by a factor of e: 2e-3 in each direction
    np.testing.assert_allclose(found, expected, rtol=2e-3)
