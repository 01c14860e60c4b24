"""Layout `calcmysky`: its files read by a reader of their own, and its sky put together as the program's shaders do."""

from __future__ import annotations

import math
import re
import shutil

import numpy as np
import pytest
from typer.testing import CliRunner

from twilight.cli.app import app
from twilight.config import load_climate
from twilight.errors import TwilightError
from twilight.export import calcmysky, calcmysky_read, own
from twilight.export.folder import write_folder
from twilight.export.values import Source
from twilight.scene.medium import climate_medium
from twilight.spectrum import solar_at_visible

NM = np.array([400.0, 470.0, 540.0, 610.0])
SIZES = calcmysky.Sizes(96, 12, 64, 4, 16, 8, 12)
BETWEEN = own.Sizes(suns=48, sky=16, ground=8, azimuths=12)


class Smooth:
    """A sky over black ground that falls with the sun, redder and brighter towards the horizon."""

    sun_range_deg = (-90.0, 90.0)

    def radiance(self, sun_elevation_deg, elevation_deg, azimuth_deg, *, observer_altitude_km=0.0):
        e, a = np.broadcast_arrays(np.radians(elevation_deg), np.radians(azimuth_deg))
        shape = 1.0 + 0.3 * np.cos(e) * np.cos(a) + 0.3 * np.cos(2 * e)
        # brighter than what the aerosol scatters once
        fall = 30.0 * math.exp(0.2 * min(sun_elevation_deg, 0.0)) * math.exp(-observer_altitude_km / 40.0)
        return np.where(e < -1.5, 0.0, fall * shape)[..., None] * np.array([3.0, 2.0, 1.5, 1.0])


@pytest.fixture(scope="module")
def source():
    medium = climate_medium(load_climate("continental-average"), NM)
    return Source(Smooth(), medium, False)


@pytest.fixture(scope="module")
def folder(source, tmp_path_factory):
    solar = np.interp(NM, np.arange(360.0, 831.0), solar_at_visible())
    files = calcmysky.fill(
        source, solar, solar_at_visible(), facts={"program": "twilight"}, progress=lambda doing, share: None,
        sizes=SIZES, source_sizes=BETWEEN,
    )  # fmt: skip
    path = tmp_path_factory.mktemp("export") / "sky"
    write_folder(path, files)
    return path


def read(path, dimensions: int) -> np.ndarray:
    """A .f32 file: sizes in uint16, float32 RGBA, the first size fastest."""
    content = path.read_bytes()
    sizes = np.frombuffer(content[: 2 * dimensions], "<u2").astype(int)
    assert len(content) == 2 * dimensions + 16 * np.prod(sizes)
    return np.frombuffer(content[2 * dimensions :], "<f4").reshape(*sizes[::-1], 4)


def described(text: str) -> dict[str, str]:
    """params.atmo by the rules of its parser: key: value, comments after #, blocks in braces, code in backticks."""
    out: dict[str, str] = {}
    inside = prefix = ""
    for line in text.split("\n"):
        if line.strip() == "```":
            inside = "" if inside else "code"
        elif inside:
            out[prefix + "code"] = out.get(prefix + "code", "") + line
        elif plain := line.split("#")[0].rstrip():
            if plain in "{}":
                prefix = "" if plain == "}" else prefix
                continue
            parts = plain.split(":")
            if len(parts) == 1:
                assert plain == "no eclipsed double scattering textures"
                continue
            key, value = " ".join(parts[0].split()).lower(), parts[1].strip()
            assert len(parts) == 2
            if re.fullmatch('(scatterer|absorber) ".+"', key):
                prefix = key + " "
            out[prefix + key] = value
    return out


def test_the_description_says_what_the_files_hold(folder, source):
    text = (folder / "params.atmo").read_text()
    found = described(text)
    assert text.startswith("version: 6\n")
    assert found["wavelengths"] == "min=400nm,max=610nm,count=4"
    assert [float(v) for v in found["ground albedo"].split(",")] == pytest.approx(source.medium.ground_albedo.tolist())
    radius, unit = found["earth radius"].split()
    assert unit == "km" and float(radius) == pytest.approx(source.medium.earth_radius_km)
    sizes = [int(found[f"scattering texture size for {name}"]) for name in ("vza", "dot(view,sun)", "sza", "altitude")]
    for name in ("multiple-scattering-xyzw.f32", "single-scattering/aerosols-xyzw.f32"):
        values = read(folder / name, 4)
        assert values.shape == (*sizes[::-1], 4) and np.all(np.isfinite(values)) and np.all(values >= 0.0)
    assert read(folder / "light-pollution-xyzw.f32", 2).max() == 0.0
    for key in ('scatterer "aerosols" angstrom exponent', 'absorber "molecules" cross section'):
        assert key in found


def test_the_constituents_are_the_air(folder, source):
    """Number density times cross section, by the description's own code, is the extinction of the aerosol."""
    found = described((folder / "params.atmo").read_text())
    prefix = 'scatterer "aerosols" '
    numbers = [float(v) for v in re.findall(r"-?\d\.\d+e[+-]\d+", found[prefix + "code"])]
    density = np.exp(numbers[: calcmysky.DENSITY_NODES])
    section, unit = found[prefix + "cross section at 1 um"].split()
    assert unit == "um^2"
    at_540 = float(section) * 1e-12 * 0.54 ** -float(found[prefix + "angstrom exponent"])
    medium = source.medium
    z = medium.top_km * np.linspace(0.0, 1.0, density.size) ** 2
    extinction = medium.at(z).aerosol_extinction[:, 2]
    np.testing.assert_allclose(1000.0 * density * at_540, extinction, rtol=1e-4, atol=1e-12)


def sky(folder, source, height_km: float, sun_deg: float, elevation_deg, azimuth_deg) -> np.ndarray:
    """X, Y, Z, W as its shaders put them together: linear between texels, with the scatterer's phase function."""
    m = source.medium
    found = described((folder / "params.atmo").read_text())
    bottom, top = m.earth_radius_km, m.earth_radius_km + m.top_km
    horizontal = math.sqrt(top**2 - bottom**2)
    r = bottom + height_km
    rho = math.sqrt(r * r - bottom**2)
    e, a, s = np.radians(elevation_deg), np.radians(azimuth_deg), math.radians(sun_deg)
    mu, nu = np.sin(e), np.sin(e) * math.sin(s) + np.cos(e) * math.cos(s) * np.cos(a)
    far = -r * mu + np.sqrt((r * mu) ** 2 + top**2 - r * r)
    u_view = (far - (top - r)) / (rho + horizontal - (top - r))
    to_sun = -bottom * math.sin(s) + math.sqrt((bottom * math.sin(s)) ** 2 + horizontal**2)
    share = (to_sun - m.top_km) / (horizontal - m.top_km)
    u_sun = (1.0 - share / (2.0 * bottom / (horizontal - m.top_km))) / (1.0 + share)
    places = (
        rho / horizontal * (SIZES.altitude - 1),
        np.full(mu.size, u_sun * (SIZES.sza - 1)),
        0.5 * (1.0 + nu) * (SIZES.dot - 1),
        SIZES.vza // 2 + u_view * (SIZES.vza // 2 - 1),
    )
    total = np.zeros((mu.size, 4))
    code = [float(v) for v in re.findall(r"-?\d\.\d+e[+-]\d+", found['scatterer "aerosols" code'])]
    nodes = np.array(code[calcmysky.DENSITY_NODES :])
    phase = np.exp(np.interp(np.sqrt(np.arccos(nu) / np.pi), np.linspace(0.0, 1.0, nodes.size), nodes))
    for name, weight in (("multiple-scattering", 1.0), ("single-scattering/aerosols", phase[:, None])):
        table = read(folder / f"{name}-xyzw.f32", 4)
        part = np.zeros_like(total)
        for corner in range(16):
            index, share = [], np.ones(mu.size)
            for axis, place in enumerate(places):
                low = np.minimum(np.asarray(place).astype(int), table.shape[axis] - 2)
                up = corner >> axis & 1
                index.append(low + up)
                share = share * (place - low if up else low + 1 - place)
            part += share[:, None] * table[tuple(index)]
        total += weight * part
    return total


def test_the_sky_comes_back(folder, source):
    """At the ground; between the coarse texels of the test within a few percent."""
    solar = np.interp(NM, np.arange(360.0, 831.0), solar_at_visible())
    light = calcmysky.Luminances(source, solar, solar_at_visible())
    elevation, azimuth = np.array([8.0, 20.0, 45.0, 55.0, 30.0]), np.array([60.0, 100.0, 30.0, 0.0, 170.0])
    for sun in (20.0, 2.0, -3.0, -8.0):
        found = sky(folder, source, 0.0, sun, elevation, azimuth)
        exact = light.radiance(0.0, sun, elevation, azimuth)[:, ::-1]
        np.testing.assert_allclose(found, exact, rtol=0.05)


def test_the_reader_of_the_package_puts_together_the_same_sky(folder, source):
    elevation, azimuth = np.array([8.0, 20.0, 45.0, 55.0, 30.0]), np.array([60.0, 100.0, 30.0, 0.0, 170.0])
    tables = calcmysky_read.load(folder)
    assert "irradiance-wlset0.f32" in tables.others and tables.others["light-pollution-xyzw.f32"] == (96, 4)
    for height, sun in ((0.0, 20.0), (3.0, 2.0), (0.0, -8.0)):
        found = tables.luminance(height, sun, elevation, azimuth)
        np.testing.assert_allclose(found, sky(folder, source, height, sun, elevation, azimuth), rtol=1e-4)


def test_a_folder_that_is_not_whole_is_refused(folder, tmp_path):
    shutil.copytree(folder, tmp_path / "sky")
    path = tmp_path / "sky" / "multiple-scattering-xyzw.f32"
    path.write_bytes(path.read_bytes()[:-16])
    with pytest.raises(TwilightError, match=r"whole tables.*multiple-scattering"):
        calcmysky_read.load(tmp_path / "sky")
    with pytest.raises(TwilightError, match="whole tables"):
        calcmysky_read.load(tmp_path)


def test_optical_depth_and_irradiance_are_those_of_the_air(folder, source):
    medium = source.medium
    depth = read(folder / "transmittance-wlset0.f32", 2)
    z = np.linspace(0.0, medium.top_km, 20001)
    vertical = np.trapezoid(medium.at(z).extinction, z, axis=0)
    np.testing.assert_allclose(depth[0, 0], vertical, rtol=3e-3)
    ground = read(folder / "irradiance-wlset0.f32", 2)
    assert ground.shape == (2, SIZES.irradiance_sza, 4)
    solar = np.interp(NM, np.arange(360.0, 831.0), solar_at_visible())
    np.testing.assert_allclose(ground[1, -1], solar, rtol=1e-5)
    np.testing.assert_array_equal(ground[1, 0], 0.0)


def test_irradiance_is_what_the_ground_reflects(source):
    class Lit:
        sun_range_deg = (-90.0, 90.0)

        def radiance(self, sun_elevation_deg, elevation_deg, azimuth_deg, *, observer_altitude_km=0.0):
            shape = np.broadcast(elevation_deg, azimuth_deg).shape
            return np.full((*shape, NM.size), math.exp(0.1 * min(sun_elevation_deg, 0.0)))

    found = calcmysky.irradiance(Source(Lit(), source.medium, False), 3)
    np.testing.assert_allclose(found[0, 2], math.pi / source.medium.ground_albedo, rtol=1e-6)


def test_air_without_aerosol_is_refused(tmp_path):
    out = tmp_path / "out"
    result = CliRunner().invoke(app, ["export", "tables", "pure-air", "--layout", "calcmysky", "--output", str(out)])
    assert result.exit_code == 2 and "keep aerosol apart" in result.stderr and result.stderr.count("\n") == 1
    assert not out.exists()
