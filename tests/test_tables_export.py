"""Tables for real-time renderers: read back with the inverse mapping of their shaders, and what they refuse."""

from __future__ import annotations

import json
import math
from dataclasses import replace

import numpy as np
import pytest
from typer.testing import CliRunner

from twilight.base.errors import TwilightError
from twilight.base.progress import silent
from twilight.cli.app import app
from twilight.config import load_climate
from twilight.scene.medium import climate_medium
from twilight.solvers.tables.mapping import grid
from twilight.studies.export import bruneton, sky_tables
from twilight.studies.export.field_values import FieldSource
from twilight.studies.export.folder import write_folder
from twilight.studies.export.single_scattering import SingleScattering
from twilight.studies.export.texel_light import SKY_ROWS, texel_light

SIZES = sky_tables.SkyTableSizes(suns=12, sky=6, ground=3, azimuths=5, altitude_km=(0.0, 5.0, 60.0))


class Smooth:
    """A sky that falls with the sun and rises towards the horizon; brighter than what aerosol scatters once."""

    sun_range_deg = (-90.0, 90.0)

    def radiance(self, sun_elevation_deg, elevation_deg, azimuth_deg, *, observer_altitude_km=0.0):
        e, a = np.broadcast_arrays(np.radians(elevation_deg), np.radians(azimuth_deg))
        shape = 1.0 + 0.4 * np.cos(e) * np.cos(a) + 0.3 * np.cos(2 * e) + 0.01 * observer_altitude_km
        return math.exp(0.4 * min(sun_elevation_deg, 0.0)) * shape[..., None] * np.array([3.0, 2.0, 1.0])


@pytest.fixture(scope="module")
def source():
    return FieldSource(Smooth(), climate_medium(load_climate("bruneton2008"), None), False)


@pytest.fixture(scope="module")
def made(source):
    return sky_tables.fill(source, SIZES, {"climate": "bruneton2008"}, silent)


def filled(source, mapping, **options):
    """Tables of Bruneton's layout from the ground."""
    sun = np.array([1.9, 1.8, 1.5])
    return bruneton.fill(source, sun, mapping=mapping, scale=4096.0, facts={}, progress=silent, rows=1, **options)


@pytest.fixture(scope="module")
def his(source):
    return filled(source, bruneton.make_mapping(6360.0, 6420.0))


def test_texels_of_the_own_layout_are_the_field(source, made):
    """An exported texel would not be the field's radiance there."""
    suns, azimuths = sky_tables.sun_nodes(SIZES.suns), sky_tables.azimuth_nodes(SIZES.azimuths)
    assert suns[0] == pytest.approx(sky_tables.LOWEST_SUN_DEG) and suns[-1] == pytest.approx(90.0)
    for altitude in SIZES.altitude_km:
        horizon = source.horizon_deg(altitude)
        assert horizon == pytest.approx(-math.degrees(math.acos(6360.0 / (6360.0 + altitude))), abs=1e-9)
        elevation = sky_tables.elevation_nodes(horizon, SIZES.ground, SIZES.sky)
        assert np.all(np.diff(elevation) > 0.0)
        for sun in (suns[2], suns[7]):
            grid_ = np.meshgrid(elevation, azimuths, indexing="ij")
            found = made.radiance(float(sun), *grid_, observer_altitude_km=altitude)
            exact = source.radiance(altitude, float(sun), *grid_)[..., ::-1]
            np.testing.assert_allclose(found, exact, rtol=0.02)  # 1e-3 deg off the horizon are 0.017 texels


def test_between_texels_the_own_layout_follows_the_field(source, made):
    """The logarithm of this sky is linear in the sun; between texels 4 deg apart its values would be 25 % off."""
    a, b = (made.radiance(sun, 40.0, 60.0)[1] for sun in (-8.0, -14.0))
    exact = [source.radiance(0.0, sun, 40.0, 60.0)[1] for sun in (-8.0, -14.0)]
    np.testing.assert_allclose([a, b], exact, rtol=0.1)


def test_the_own_layout_is_read_as_it_was_written(made, tmp_path):
    """A folder would not be read back as written, or be overwritten."""
    write_folder(tmp_path / "sky", made.files())
    again = sky_tables.load(tmp_path / "sky")
    np.testing.assert_array_equal(again.sky, made.sky)
    np.testing.assert_array_equal(again.aureole, made.aureole)
    assert sum(f.stat().st_size for f in (tmp_path / "sky").glob("*.bin")) == made.n_bytes
    with pytest.raises(TwilightError, match="is there already"):
        write_folder(tmp_path / "sky", made.files())
    (tmp_path / "sky" / "sky.bin").write_bytes(b"half")
    with pytest.raises(TwilightError, match="whole tables"):
        sky_tables.load(tmp_path / "sky")


def test_the_own_layout_says_what_it_does_not_hold(made):
    """A reader would extrapolate below the lowest sun or above the highest altitude."""
    with pytest.raises(TwilightError, match="hold -20 to 90"):
        made.radiance(-25.0, 10.0, 0.0)
    with pytest.raises(TwilightError, match="hold 0 to 60"):
        made.radiance(5.0, 10.0, 0.0, observer_altitude_km=400.0)


def test_between_altitudes_the_root_of_the_height_above_the_ground_counts():
    """Also where the tables begin above the ground, on a plain above sea level."""
    header = {
        "texels": {"sun": 2, "ground": 2, "sky": 2, "azimuth": 2},
        "altitude_km": [2.0, 10.0, 60.0],
        "ground_km": 0.5,
        "horizon_deg": [-1.2, -3.1, -7.8],
        "lowest_sun_deg": sky_tables.LOWEST_SUN_DEG,
    }
    sky = np.broadcast_to(np.array([-1.0, -3.0, -9.0])[:, None, None, None, None], (3, 2, 4, 2, 3))
    made = sky_tables.SkyTables(header, sky, None, None)
    fraction = (math.sqrt(4.5) - math.sqrt(1.5)) / (math.sqrt(9.5) - math.sqrt(1.5))
    np.testing.assert_allclose(
        made.radiance(5.0, 30.0, 20.0, observer_altitude_km=5.0), math.exp(-1.0 - 2.0 * fraction), rtol=1e-12
    )


def test_the_ground_is_in_the_header(made, tmp_path):
    """A reader would take heights from sea level for heights above the ground."""
    assert made.header["ground_km"] == 0.0
    write_folder(tmp_path / "sky", {**made.files(), "sky.json": json.dumps(made.header | {"ground_km": 3.0}).encode()})
    with pytest.raises(TwilightError, match="begins below ground_km, 3"):
        sky_tables.load(tmp_path / "sky")


def test_a_folder_that_cannot_be_written_leaves_nothing(tmp_path):
    """A failed export would leave half a folder."""
    (tmp_path / "file").write_text("in the way")
    with pytest.raises(TwilightError):
        write_folder(tmp_path / "file" / "sky", {"a": b"1"})
    with pytest.raises(TwilightError):
        write_folder(tmp_path / "sky", {"a": b"1", "a/b": b"2"})
    assert [f.name for f in tmp_path.iterdir()] == ["file"]


@pytest.mark.parametrize("separate", [False, True])
def test_his_shader_finds_the_field_at_the_texels(source, his, separate):
    """Bruneton's shader would find another sky than the field's."""
    if separate:
        few = his.mapping._replace(n_mu_s=4, n_nu=4, n_mu=12)
        his = filled(source, few, separate=True, higher_order=True)
        assert his.single_mie is not None and his.single_mie.max() > 0.0
        assert "single_mie_scattering.bin" in his.files("bin", False)
        # the shader's higher order and the rest: what air scattered once
        assert his.higher_order is not None
        once = his.scattering[..., :3] - his.higher_order
        assert np.all(once >= 0.0) and np.all(his.higher_order >= 0.0)
    heights, view, sun, nus = grid(his.mapping)
    solar = np.array([1.5, 1.8, 1.9])
    for j in (1, 2) if separate else (4, 12, 20, 28):
        sun_deg = math.degrees(math.asin(sun[j]))
        if abs(sun[j]) < 0.02:
            continue  # where the shader fades single Mie scattering
        # texels at which the field itself is evaluated
        for m in (7, 9, 10) if separate else (64 + SKY_ROWS[5], 64 + SKY_ROWS[8], 64 + SKY_ROWS[17]):
            mu = view[0, m]
            across = math.sqrt((1.0 - mu**2) * (1.0 - sun[j] ** 2))
            inside = [nu for nu in nus[:-1] if abs(nu - mu * sun[j]) < across]
            for nu in inside:
                azimuth = math.degrees(math.acos((nu - mu * sun[j]) / across))
                elevation = math.degrees(math.asin(mu))
                found = bruneton.sky_radiance(his, 0.0, sun_deg, np.array([elevation]), np.array([azimuth]))[0]
                exact = source.radiance(0.0, sun_deg, elevation, azimuth)[::-1] * solar
                np.testing.assert_allclose(found, exact, rtol=1e-3)
    assert heights[0] == 0.0


def test_his_files_have_his_sizes(his):
    """His program could not load the files."""
    files = his.files("dat", False)
    assert {name: len(content) for name, content in files.items() if name != "tables.json"} == {
        "transmittance.dat": 256 * 64 * 16,
        "scattering.dat": 256 * 128 * 32 * 16,
        "irradiance.dat": 64 * 16 * 16,
    }
    volume = np.frombuffer(files["scattering.dat"], "<f4").reshape(32, 128, 256, 4)
    # x = nu index * 32 + mu_s index, y = mu, z = r
    np.testing.assert_allclose(volume[0, 80, 3 * 32 + 20], his.scattering[0, 20, 3, 80], rtol=1e-6)
    constants = json.loads(files["tables.json"])
    for name, texture in constants["textures"].items():
        assert len(files[f"{name}.dat"]) == math.prod(texture["size"]) * 16 and len(texture["axes"]) == len(
            texture["size"]
        )
    assert set(constants["textures"]) == {"transmittance", "scattering", "irradiance"}
    assert constants["mu_s_min"] == pytest.approx(math.cos(math.radians(120.0)))
    faint = replace(his, scattering=his.scattering / 100.0, irradiance=his.irradiance / 100.0)
    assert len(faint.files("bin", True)["scattering.bin"]) == 256 * 128 * 32 * 8
    with pytest.raises(TwilightError, match="half floats hold up to"):
        his.files("bin", True)


def test_luminance_factors_are_those_of_the_package():
    """Numbers of AtmosphereParameters of @takram/three-atmosphere 0.19.1, whose solar spectrum is another one."""
    for exponent, his in (
        (bruneton.SKY_EXPONENT, (114974.916437, 71305.954816, 65310.548555)),
        (0.0, (98242.786222, 69954.398112, 66475.012354)),
    ):
        found = bruneton.luminance_factors((680.0, 550.0, 440.0), exponent)
        np.testing.assert_allclose(found, his, rtol=0.06)
        np.testing.assert_allclose(found[:2], his[:2], rtol=0.01)


def test_a_layout_higher_than_the_air_is_refused(source):
    """Tables would be filled above the top of the air."""
    with pytest.raises(TwilightError, match="reaches up to 100 km"):
        filled(source, bruneton.make_mapping(6360.0, 6460.0))


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["pure-air", "--half"], "--half and --scale: are for bruneton2017"),
        (["pure-air", "--layout", "takram", "--scale", "0"], "--scale: 0 is not allowed"),
        (["pure-air", "--single-mie"], "--single-mie: is for takram"),
        (["pure-air", "--higher-order"], "--higher-order: is for takram"),
        (["pure-air", "--layout", "bruneton2017", "--exr"], "--exr: is for takram"),
        (["pure-air", "--quality", "best"], "quality"),
        (["nowhere"], "nowhere"),
    ],
)
def test_the_command_refuses_in_one_sentence(arguments, words, tmp_path):
    """A wrong option of the command would end in a traceback or leave files."""
    result = CliRunner().invoke(app, ["export", "tables", *arguments, "--output", str(tmp_path / "out")])
    assert result.exit_code == 2
    assert words in result.stderr and result.stderr.count("\n") == 1
    assert not (tmp_path / "out").exists()


def test_light_that_air_scattered_once_is_the_integral_of_its_scattering(source):
    """Straight up under a sun in the zenith, in closed form: T^2 of the air below integrates to the whole."""
    zenith, azimuth = np.array([0.5 * math.pi]), np.zeros((1, 1, 1))
    found = SingleScattering(source.medium, source.scaled, source.beam)(0.0, zenith, azimuth, zenith).air[0, 0, 0]
    medium = source.scaled.medium
    z = np.linspace(medium.bottom_km, medium.top_km, 40001)
    at = medium.at(z)
    above = np.zeros_like(at.extinction)
    steps = 0.5 * (at.extinction[1:] + at.extinction[:-1]) * np.diff(z)[:, None]
    above[1:] = np.cumsum(steps, axis=0)
    # the beam comes down through what the light goes down through again
    depth_below, total = above, above[-1]
    integrand = at.air_scattering * np.exp(-depth_below) * np.exp(-(total - depth_below))
    np.testing.assert_allclose(found, np.trapezoid(integrand, z, axis=0), rtol=2e-3)


@pytest.mark.parametrize("altitude_km", [0.0, 1.9, 30.0])
def test_light_looked_up_is_that_of_the_sunbeam(altitude_km):
    """A table of sunlight that is too coarse would move the edge of the Earth's shadow in every texel; refracted."""
    medium = climate_medium(load_climate("continental-average"), np.array([440.0, 680.0]))
    source = FieldSource(Smooth(), medium, True)
    elevation_deg, azimuth_deg = np.array([-5.0, 0.3, 3.0, 40.0]), np.array([0.0, 60.0, 170.0])
    suns_deg = np.array([-8.0, -4.0, -1.0, 0.3, 5.0, 40.0])
    azimuth = np.broadcast_to(np.radians(azimuth_deg), (6, 4, 3))
    many = SingleScattering(medium, source.scaled, source.beam)
    found = many(altitude_km, np.radians(elevation_deg), azimuth, np.radians(suns_deg))
    exactly = source.single_aerosol(altitude_km, elevation_deg, azimuth_deg, suns_deg)
    for mine, exact in zip((found.aerosol, found.bare), exactly, strict=True):
        seen = exact > 1e-9
        off = np.abs(mine[seen] / exact[seen] - 1.0)
        assert np.percentile(off, 90) < 4e-3
        assert off.max() < 0.02  # 1.4 % where a level beam grazes the haze's top


def test_between_the_texels_at_which_the_field_is_evaluated():
    """Texels of mu or r too far apart, or in the wrong places, would put bands into the sky."""

    class Twice(Smooth):
        """The sky that `SingleScattering` sums, and smooth light."""

        def radiance(self, sun_elevation_deg, elevation_deg, azimuth_deg, *, observer_altitude_km=0.0):
            e, a = np.broadcast_arrays(np.radians(elevation_deg), np.radians(azimuth_deg))
            rows, back = np.unique(e.ravel(), return_inverse=True)
            azimuth = np.tile(a.ravel(), (1, rows.size, 1))
            once = many(observer_altitude_km, rows, azimuth, np.radians([sun_elevation_deg])).total[0]
            return once[back, np.arange(e.size)].reshape(*e.shape, -1) + rest(e, observer_altitude_km)[..., None]

    def rest(e, altitude_km):
        return 1e-3 * (1.5 - np.sin(e)) / (1.0 + 0.1 * altitude_km)

    few = bruneton.make_mapping(6360.0, 6420.0)._replace(n_mu_s=3, n_nu=2)
    source = FieldSource(Twice(), climate_medium(load_climate("bruneton2008"), None), False)
    many = SingleScattering(source.medium, source.scaled, source.beam)
    heights, view, _, _ = grid(few)
    light = list(texel_light(source, few, 14, lambda fraction: None))
    for i in (0, 8, 9, 11, 13):
        _, found, once = light[i]
        expected = once.total + rest(np.arcsin(view[i]), heights[i])[:, None, None]
        np.testing.assert_allclose(found[:, 64:], expected[:, 64:], rtol=6e-3)
