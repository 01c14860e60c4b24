"""Tables of layout `takram` in a headless browser: @takram/three-atmosphere loads them and its sky's pixels are read.

The packages come with `npm install --prefix tests/npm`; without them the tests skip.
"""

from __future__ import annotations

import base64
import io
import json
import math
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from airs import turbid
from browser import open_page
from hazy_zones import QUICK
from PIL import Image

from twilight.base.progress import silent
from twilight.solvers import zones
from twilight.solvers.tables.mapping import grid
from twilight.studies.export import bruneton
from twilight.studies.export.field_values import FieldSource
from twilight.studies.export.folder import write_folder

PACKAGES = Path(__file__).parent / "npm" / "node_modules"
MODULES = {
    "three": "three/build/three.module.js",
    "three/addons/": "three/examples/jsm/",
    "postprocessing": "postprocessing/build/index.js",
    "@takram/three-atmosphere": "@takram/three-atmosphere/build/index.js",
    "@takram/three-geospatial": "@takram/three-geospatial/build/index.js",
    "@takram/three-geospatial/shaders": "@takram/three-geospatial/build/shaders.js",
    "@petamoriken/float16": "@petamoriken/float16/src/index.mjs",
    "tiny-invariant": "tiny-invariant/dist/esm/tiny-invariant.js",
    "url-join": "url-join/lib/url-join.js",
    "astronomy-engine": "astronomy-engine/esm/astronomy.js",
}
SIZE = 48
"""Side of the picture that the browser draws [px]."""
FIELD_OF_VIEW_DEG = 100.0
"""Across that picture [deg]."""
PAGE = """<!doctype html><p id="message"></p>
<script type="importmap">IMPORTS</script>
<script type="module">
import { Camera, DataTexture, FloatType, HalfFloatType, Mesh, NearestFilter,
  PerspectiveCamera, PlaneGeometry, RedFormat, Scene, Vector3,
  WebGLRenderer, WebGLRenderTarget } from "three";
import { AtmosphereParameters, PrecomputedTexturesLoader, SkyMaterial } from "@takram/three-atmosphere";
window.onerror = message => { document.querySelector("#message").innerText = "cannot: " + message; };
try {
  const facts = await (await fetch("sky/tables.json")).json();
  const renderer = new WebGLRenderer();
  const loader = new PrecomputedTexturesLoader({
    format: FORMAT, type: HalfFloatType, higherOrderScattering: HIGHER, combinedScattering: COMBINED });
  const textures = await loader.loadAsync("sky");
  const atmosphere = new AtmosphereParameters({
    solarIrradiance: new Vector3(...facts.solar_irradiance),
    bottomRadius: 1000 * facts.bottom_radius_km,
    topRadius: 1000 * facts.top_radius_km,
    rayleighScattering: new Vector3(...facts.rayleigh_scattering_per_km),
    mieScattering: new Vector3(...facts.mie_scattering_per_km),
    miePhaseFunctionG: facts.mie_phase_function_g,
    muSMin: facts.mu_s_min,
  });
  const material = new SkyMaterial({ ...textures, sun: false, moon: false, correctAltitude: false }, atmosphere);
  material.uniforms.ATMOSPHERE = atmosphere.toUniform();
  material.uniforms.SKY_SPECTRAL_RADIANCE_TO_LUMINANCE.value.set(1, 1, 1);
  const sky = new Mesh(new PlaneGeometry(2, 2), material), scene = new Scene();
  sky.frustumCulled = false;
  scene.add(sky);
  const nearest = { minFilter: NearestFilter, magFilter: NearestFilter };
  const target = new WebGLRenderTarget(SIZE, SIZE, { type: FloatType, ...nearest });
  const camera = new PerspectiveCamera(FIELD, 1, 1, 1e6);
  camera.up.set(0, 0, 1);
  const shade = new DataTexture(new Float32Array(1), 1, 1, RedFormat, FloatType);
  window.twilight = { halves: name => {
    const data = textures[name + "Texture"].image.data;
    let text = "";
    const bytes = new Uint8Array(data.buffer, data.byteOffset, data.byteLength);
    for (let i = 0; i < bytes.length; i += 8192) text += String.fromCharCode(...bytes.subarray(i, i + 8192));
    return btoa(text);
  }, look: (sun, forward, shadow) => {
    shade.image.data[0] = shadow;
    shade.needsUpdate = true;
    material.shadowLength = shadow > 0 ? { map: shade } : null;
    camera.position.set(0, 0, atmosphere.bottomRadius);
    camera.lookAt(forward[0], forward[1], atmosphere.bottomRadius + forward[2]);
    camera.updateMatrixWorld();
    material.sunDirection.set(Math.cos(sun), 0, Math.sin(sun));
    renderer.setRenderTarget(target);
    renderer.render(scene, camera);  // the first one may still have the shaders of the last shadow
    renderer.render(scene, camera);
    const out = new Float32Array(SIZE * SIZE * 4);
    renderer.readRenderTargetPixels(target, 0, 0, SIZE, SIZE, out);
    return [Array.from(out), renderer.getContext().getError()];
  } };
} catch (error) {
  document.querySelector("#message").innerText = "cannot: " + error.message;
}
</script>
"""


@pytest.fixture
def show(tmp_path):
    """A function that opens tables in the browser: (radiance (D, 3) of a sun, elevations, azimuths [deg] of pixels)."""
    if not PACKAGES.is_dir():
        pytest.skip("needs @takram/three-atmosphere: npm install --prefix tests/npm")

    def opened(tables: bruneton.BrunetonTables, suffix: str = "bin"):
        write_folder(tmp_path / "sky", tables.files(suffix, True))
        (tmp_path / "node_modules").symlink_to(PACKAGES)
        imports = json.dumps({"imports": {name: f"./node_modules/{path}" for name, path in MODULES.items()}})
        combined = "true" if tables.single_mie is None else "false"
        page = (
            PAGE.replace("IMPORTS", imports)
            .replace("COMBINED", combined)
            .replace("HIGHER", "false" if tables.higher_order is None else "true")
            .replace("FORMAT", '"exr"' if suffix == "exr" else '"binary"')
            .replace("SIZE", str(SIZE))
            .replace("FIELD", str(FIELD_OF_VIEW_DEG))
        )
        (tmp_path / "page.html").write_text(page)
        return open_page(tmp_path / "page.html")

    return opened


def pixels(azimuth_deg: float, elevation_deg: float) -> tuple[list[float], np.ndarray, np.ndarray]:
    """Where a camera looks (3,), and elevations and azimuths [deg] of its pixels, the lowest row first."""
    a, e = math.radians(azimuth_deg), math.radians(elevation_deg)
    forward = np.array([math.cos(e) * math.cos(a), math.cos(e) * math.sin(a), math.sin(e)])
    right = np.cross(forward, [0.0, 0.0, 1.0])
    right /= np.linalg.norm(right)
    up = np.cross(right, forward)
    across = np.tan(np.radians(FIELD_OF_VIEW_DEG / 2.0)) * (2.0 * (np.arange(SIZE) + 0.5) / SIZE - 1.0)
    rays = forward + across[None, :, None] * right + across[:, None, None] * up
    rays /= np.linalg.norm(rays, axis=-1, keepdims=True)
    elevation, azimuth = np.arcsin(rays[..., 2]), np.arctan2(rays[..., 1], rays[..., 0])
    return forward.tolist(), np.degrees(elevation).ravel(), np.degrees(azimuth).ravel()


def looked(page, sun_deg: float, azimuth_deg: float, elevation_deg: float, scale: float, shadow_km: float = 0.0):
    """(radiance (D, 3), elevations, azimuths) of the pixels that see the sky."""
    forward, elevation, azimuth = pixels(azimuth_deg, elevation_deg)
    question = [math.radians(sun_deg), forward, shadow_km]
    found, error = page.evaluate("([sun, forward, shadow]) => twilight.look(sun, forward, shadow)", question)
    assert error == 0
    sky = elevation > 0.5
    return np.array(found).reshape(-1, 4)[sky, :3] / scale, elevation[sky], azimuth[sky]


def random_tables(separate: bool = False, higher_order: bool = False) -> bruneton.BrunetonTables:
    """Texels at random within a factor of 1.5 from one to the next; the same at every altitude, of which the shader's
    float32 knows no more than a tenth of a texel at the ground.  Transmittance falls with the way up."""
    mapping = bruneton.make_mapping(6360.0, 6420.0)
    random = np.random.default_rng(8)
    scattering = random.uniform(1.0, 1.5, (1, 32, 8, 128, 4)) * np.array([1.0, 0.8, 0.6, 0.1])
    scattering = np.repeat(scattering, 32, axis=0)
    constants = {
        "bottom_radius_km": 6360.0,
        "top_radius_km": 6420.0,
        "mu_s_min": mapping.mu_s_min,
        "mie_phase_function_g": 0.72,
        "rayleigh_scattering_per_km": [0.006, 0.013, 0.032],
        "mie_scattering_per_km": [0.004, 0.005, 0.007],
        "solar_irradiance": [1.5, 1.8, 1.9],
        "ground_albedo": [0.1, 0.1, 0.1],
        "sun_angular_radius_rad": 0.00465,
        "sky_radiance_to_luminance": [28000.0, 18000.0, 17000.0],
        "sun_radiance_to_luminance": [98000.0, 70000.0, 70000.0],
        "scale": 4.0,
    }
    passed = np.linspace(0.6, 1.0, 64)[:, None, None] * np.ones((1, 256, 3))
    tables = bruneton.BrunetonTables(mapping, constants, scattering, passed, np.ones((16, 64, 3)))
    if separate:
        tables = replace(tables, single_mie=np.repeat(random.uniform(0.1, 0.15, (1, 32, 8, 128, 3)), 32, axis=0))
    if higher_order:
        fraction = np.repeat(random.uniform(0.3, 0.45, (1, 32, 8, 128, 3)), 32, axis=0)
        tables = replace(tables, higher_order=fraction * scattering[..., :3])
    return tables


SEEN = ((10.0, 0.0, 30.0), (0.0, 60.0, 50.0), (-6.0, 200.0, 20.0), (-12.0, 90.0, 40.0))
"""(sun, azimuth, elevation) [deg] that a camera looks at."""


@pytest.mark.parametrize(("separate", "higher_order"), [(False, False), (True, False), (False, True)])
def test_the_package_reads_what_python_reads(show, separate, higher_order):
    """@takram/three-atmosphere would show another sky than the reader in Python."""
    tables = random_tables(separate, higher_order)
    shadows = (0.0, 12.0) if higher_order else (0.0,)
    with show(tables) as (page, errors):
        assert page.inner_text("#message") == ""
        for sun, azimuth, elevation in SEEN:
            for shadow in shadows:
                found, e, a = looked(page, sun, azimuth, elevation, 4.0, shadow)
                expected = bruneton.sky_radiance(tables, 0.0, sun, e, a, shadow_km=shadow)
                off = np.abs(found / expected - 1.0)
                assert np.median(off) < 2e-3 and np.percentile(off, 95) < 0.03 and off.max() < 0.1, (sun, off.max())
        if higher_order:
            # what the texture is for: with it the shadow takes less than the transmittance does of everything
            without = bruneton.sky_radiance(replace(tables, higher_order=None), 0.0, sun, e, a, shadow_km=shadow)
            assert np.median(expected / without) > 1.02
        assert errors == []


def test_the_package_reads_open_exr_as_it_reads_halves(show):
    """Every number of every texture, as the package hands it to the graphics card."""
    tables = random_tables(separate=True, higher_order=True)
    with show(tables, "exr") as (page, errors):
        assert page.inner_text("#message") == "" and errors == []
        for name, texture in tables.rgba().items():
            key = "".join(part.capitalize() for part in name.split("_"))
            content = base64.b64decode(page.evaluate("name => twilight.halves(name)", key[0].lower() + key[1:]))
            np.testing.assert_array_equal(np.frombuffer(content, "<f2"), texture.astype("<f2").ravel())


def test_the_page_of_the_docs_shows_a_sky(tmp_path):
    """A number of tables.json or an argument of the package that docs/tables.md has wrong leaves the picture black."""
    if not PACKAGES.is_dir():
        pytest.skip("needs @takram/three-atmosphere: npm install --prefix tests/npm")
    text = (Path(__file__).parents[1] / "docs" / "tables.md").read_text(encoding="utf-8")
    [page] = re.findall(r"^```html\n(.*?)^```", text, flags=re.MULTILINE | re.DOTALL)
    imports = json.dumps({name: f"./node_modules/{path}" for name, path in MODULES.items()})
    drawn = "setInterval(() => { if (document.querySelector('canvas')) window.twilight = true; }, 50)"
    page = page.replace("IMPORTS", imports) + f'<p id="message"></p><script>{drawn}</script>'
    write_folder(tmp_path / "sky", random_tables().files("bin", True))
    (tmp_path / "node_modules").symlink_to(PACKAGES)
    (tmp_path / "page.html").write_text(page)
    with open_page(tmp_path / "page.html", 120, 80) as (shown, errors):
        shown.wait_for_timeout(2000)
        picture = np.array(Image.open(io.BytesIO(shown.screenshot())).convert("RGB"), dtype=float)
        assert errors == []
    sky = picture[:20]
    assert sky.mean() > 20.0 and np.ptp(sky.mean(axis=(0, 1))) > 5.0


BETWEEN_SUNS = {-6.0: (0.39, 0.68), -9.0: (0.76, 0.43)}
"""95th percentiles of the relative error, towards azimuths 20 and 150, of suns [deg] between two of the layout's, which
are 1.3 to 1.7 deg apart there: straight lines between values that fall by a factor of up to five."""
AT_ITS_SUNS = {23: (0.116, 0.038), 14: (0.127, 0.036), 7: (0.096, 0.18), 5: (0.075, 0.115)}
"""The same at texels of mu_s, suns of 10.1, 0.4, -6.5 and -9.6 deg: what eight scattering angles leave, 44 deg apart
beside the sun.  Half floats add nothing.  All are a tenth more than was measured."""


@pytest.mark.slow
def test_the_package_shows_the_sky_of_zones(show):
    """As near as eight texels of the scattering angle and 32 suns allow, and as Python's reader has it."""
    medium = turbid(3.0, wavelength_nm=np.array([440.0, 550.0, 680.0]))
    field = zones.prepare(medium, QUICK)
    source = FieldSource(field, medium, medium.has_refraction)
    mapping = bruneton.make_mapping(6360.0, 6420.0)
    tables = bruneton.fill(source, np.ones(3), mapping=mapping, scale=4096.0, facts={}, progress=silent, rows=2)
    suns = np.degrees(np.arcsin(grid(mapping)[2]))
    allowed = BETWEEN_SUNS | {float(suns[texel]): most for texel, most in AT_ITS_SUNS.items()}
    with show(replace(tables, irradiance=np.zeros_like(tables.irradiance))) as (page, errors):
        for sun, both in allowed.items():
            for azimuth, most in zip((20.0, 150.0), both, strict=True):
                found, e, a = looked(page, sun, azimuth, 40.0, 4096.0)
                off = np.abs(found / field.radiance(sun, e, a)[:, ::-1] - 1.0)
                assert np.percentile(off, 95) < most, (sun, azimuth, np.percentile(off, 95))
                read = np.abs(found / bruneton.sky_radiance(tables, 0.0, sun, e, a) - 1.0)
                assert np.percentile(read, 95) < 0.03, (sun, azimuth)
        assert errors == []
