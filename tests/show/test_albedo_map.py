"""Albedo maps: what files say, where land lies, what the ground of a map adds to a view, and what is refused."""

from dataclasses import replace

import numpy as np
import pytest
import xarray
from airs import turbid
from hazy_zones import QUICK
from PIL import Image

from twilight.base.errors import TwilightError, TwilightWarning
from twilight.config import load
from twilight.config.pictures import Terrain, View
from twilight.config.scene import Observer
from twilight.engine import solve
from twilight.engine.mapped_ground import Land, MappedGround
from twilight.engine.view import check_view, landscape, view_radiance
from twilight.io.albedo_map import AlbedoMap, read_albedo_map
from twilight.io.exr import write_channels
from twilight.numerics import spectrum
from twilight.numerics.directions import azimuth_elevation
from twilight.scene import Scene, resolve
from twilight.sky.lights import Sun
from twilight.solvers import compact, zones
from twilight.terrain.heights import Standpoint

LAT = np.arange(-87.5, 90.0, 5.0)
LON = np.arange(-177.5, 180.0, 5.0)
NM = np.array([450.0, 650.0])
PLACE = Standpoint(20.0, 170.0, 90.0)
PLACED = {"sun": {"at": "2026-03-20T12:00Z", "latitude_deg": 20.0, "longitude_deg": 170.0}}


def netcdf(path, albedo=None, lat=LAT, lon=LON, dims=("lat", "lon"), **coordinates):
    """A file of albedo; unset: 0.1 in the south, 0.5 in the north."""
    if albedo is None:
        albedo = np.where(lat > 0.0, 0.5, 0.1)[:, None] * np.ones(len(lon))
    known = {"lat": lat, "lon": lon, **coordinates}
    xarray.DataArray(albedo, known, dims, name="albedo").to_netcdf(path, engine="h5netcdf")
    return path


def uniform(albedo: float) -> AlbedoMap:
    return AlbedoMap(LAT, np.append(LON, 182.5), np.full((36, 73, 1), albedo), np.array([550.0]), np.eye(1))


def test_every_order_of_coordinates_is_the_same_map(tmp_path):
    """Latitudes from the north, longitudes from 0 to 360, other units or dimensions would put land elsewhere."""
    x, y, nm = np.meshgrid(LON, LAT, NM)
    albedo = 0.5 + 0.2 * np.sin(np.radians(y)) + 0.1 * np.cos(np.radians(x - 30.0)) * nm / 650.0
    plain = read_albedo_map(netcdf(tmp_path / "a.nc", albedo, dims=("lat", "lon", "wavelength"), wavelength=NM))
    other = albedo[::-1][:, np.argsort(np.mod(LON, 360.0))][..., ::-1].transpose(2, 0, 1)
    micron = xarray.DataArray(NM[::-1] / 1e3, dims="wavelength", attrs={"units": "um"})
    turned = read_albedo_map(
        netcdf(tmp_path / "b.nc", other, LAT[::-1], np.sort(np.mod(LON, 360.0)), ("wavelength", "lat", "lon"),
               wavelength=micron)
    )  # fmt: skip
    lat, lon = np.array([90.0, -90.0, 12.3, 12.3, -40.0]), np.array([0.0, 5.0, 179.9, -180.1, 359.0])
    at = np.array([400.0, 500.0, 700.0])
    assert turned.at(lat, lon, at) == pytest.approx(plain.at(lat, lon, at), abs=1e-12)
    exact = 0.5 + 0.2 * np.sin(np.radians(12.3)) + 0.1 * np.cos(np.radians(149.9)) * 500.0 / 650.0
    assert plain.at(lat, lon, at)[2, 1] == pytest.approx(exact, abs=2e-3)


def test_a_part_of_the_earth_across_180_deg(tmp_path):
    """A map across the date line would be cut."""
    part = read_albedo_map(netcdf(tmp_path / "a.nc", lat=np.arange(-10.0, 11.0), lon=np.r_[170:181, -179:-169]))
    found = part.at(np.array([5.0, 5.0, -5.0, 5.0, 10.6]), np.array([172.0, -171.0, 180.0, 0.0, 180.0]), NM)[:, 0]
    assert found == pytest.approx([0.5, 0.5, 0.1, np.nan, np.nan], nan_ok=True)
    assert part.mean(0.0, 180.0, 5.0) == pytest.approx(0.3 - 0.4 / 2 / 11, abs=0.01)  # the row at 0 deg is of the south
    assert np.isnan(part.mean(50.0, 0.0, 5.0)).all()


def test_a_grey_picture_of_16_bits_keeps_its_values(tmp_path):
    """An albedo of 0.53 would be clipped to 1, as whole numbers beyond 255 were; snow would be over-exposed."""
    code = np.full((10, 20), round(0.755 * 65535), np.uint16)
    code[:5] = 65535
    Image.fromarray(code).save(tmp_path / "a.png")
    north, south = read_albedo_map(tmp_path / "a.png").at(np.array([45.0, -45.0]), np.zeros(2), np.array([550.0]))[:, 0]
    assert north == pytest.approx(1.0, abs=1e-4)
    assert south == pytest.approx(((0.755 + 0.055) / 1.055) ** 2.4, abs=1e-4)


@pytest.mark.parametrize("name", ["a.png", "a.exr"])
def test_pictures_have_north_above_and_keep_their_colours(tmp_path, name):
    """A spectrum of another colour than the picture's, or an Earth upside down."""
    code = np.full((10, 20, 3), [40, 90, 200], np.uint8)
    code[:5, 10:] = [200, 120, 60]  # north east
    rgb = np.where(code <= 10, code / 3294.6, ((code / 255.0 + 0.055) / 1.055) ** 2.4)
    if name.endswith("png"):
        Image.fromarray(code).save(tmp_path / name)
    else:
        write_channels(tmp_path / name, {c: rgb[..., i].astype(np.float32) for i, c in enumerate("RGB")})
    found = read_albedo_map(tmp_path / name)
    nm = spectrum.VISIBLE_NM
    albedo = found.at(np.array([45.0, -45.0]), np.array([90.0, 90.0]), nm)
    from colour import SDS_ILLUMINANTS

    daylight = np.interp(nm, SDS_ILLUMINANTS["D65"].wavelengths, SDS_ILLUMINANTS["D65"].values)
    matching = daylight[:, None] * spectrum.colour_matching_functions("cie1931_2deg")
    shown = albedo @ matching / matching[:, 1].sum() @ spectrum.xyz_to_rgb_matrix("cie1931_2deg").T
    assert shown == pytest.approx(rgb[[2, 8], [15, 15]], abs=2e-3)
    assert albedo.min() >= 0.0 and albedo.max() <= 1.0


@pytest.mark.parametrize(
    ("place", "azimuth_deg", "turn_deg", "lands_at"),
    [
        ((0.0, 10.0, 0.0), 0.0, 30.0, (30.0, 10.0)),
        ((0.0, 10.0, 90.0), 0.0, 30.0, (0.0, 40.0)),
        ((0.0, 10.0, 90.0), 180.0, 30.0, (0.0, -20.0)),
        ((50.0, 170.0, 45.0), -45.0, 80.0, (50.0, -10.0)),  # over the pole
    ],
)
def test_places_lie_where_one_looks(place, azimuth_deg, turn_deg, lands_at):
    """Land would lie in another azimuth or distance."""
    y, x = np.meshgrid(LAT, np.append(LON, 182.5), indexing="ij")
    channels = np.stack([(y + 90.0) / 180.0, 0.5 + 0.5 * np.cos(np.radians(x))], axis=-1)
    land = Land(AlbedoMap(LAT, np.append(LON, 182.5), channels, NM, np.eye(2)), Standpoint(*place))
    found = land.albedo(np.array([azimuth_deg]), np.radians([turn_deg]), NM)[0]
    expected = (lands_at[0] + 90.0) / 180.0, 0.5 + 0.5 * np.cos(np.radians(lands_at[1]))
    assert found == pytest.approx(expected, abs=3e-3)


@pytest.fixture(scope="module")
def fields():
    """A thin air, by whether its ground is black or of albedo 0.3, from 3000 km."""
    air = {a: turbid(1.02, wavelength_nm=np.array([700.0]), albedo=a) for a in (0.0, 0.3)}
    return {
        a: solve(Scene(one, None, zones, QUICK, observer=Observer(altitude_km=3000.0)), cached=False)
        for a, one in air.items()
    }


VIEW = View(kind="perspective", width=12, height=12, field_of_view_deg=100.0, elevation_deg=-90.0)


def test_uniform_map_is_uniform_ground(fields):
    """A map of the ground's own albedo changes nothing; one over black ground is that ground, but for the light that
    the air scatters between ground and eye and back to the ground, up to 5 % of it here."""
    e, a = np.array([-90.0, -75.0, -60.0, -52.0, -40.0, 10.0]), np.array([0.0, 0.0, 90.0, 180.0, 0.0, 0.0])
    land = Land(uniform(0.3), PLACE)
    assert not MappedGround.of(fields[0.3], 40.0, land).light(e, a).any()
    seen = fields[0.0].radiance(40.0, e, a) + MappedGround.of(fields[0.0], 40.0, land).light(e, a)
    np.testing.assert_allclose(seen, fields[0.3].radiance(40.0, e, a), rtol=0.05)


def test_land_of_two_colours_lies_where_it_is(fields):
    """The sun's azimuth, above in the picture, is east of 20 N 170 E; white land lies in the north, to the left."""
    white_north = np.where(LAT > 20.0, 0.9, 0.3)[:, None, None] * np.ones((1, 73, 1))
    land = Land(AlbedoMap(LAT, np.append(LON, 182.5), white_north, np.array([550.0]), np.eye(1)), PLACE)
    mapped = view_radiance(fields[0.3], VIEW, Sun(40.0), land=land)
    seen = replace(mapped, ground=None).whole().radiance[..., 0]
    ratio = mapped.whole().radiance[..., 0] / np.maximum(seen, 1e-9)
    assert (ratio[4:8, 4:5] > 2.0).all() and np.allclose(ratio[4:8, 7:9], 1.0, atol=0.02)
    # under the moon, light counts from another azimuth and lies on the same land
    by_moon = Land(land.map, PLACE._replace(sun_azimuth_deg=60.0))
    turned = MappedGround.of(fields[0.3], 40.0, by_moon)
    azimuth, elevation = azimuth_elevation(VIEW.rays())
    added = turned.light(elevation.ravel(), azimuth.ravel() + 30.0).reshape(seen.shape)
    assert np.array_equal(added[3:9, 3:9] > 0.01, ratio[3:9, 3:9] > 1.1)


def test_terrain_has_the_map_s_albedo(fields, tmp_path):
    """Terrain would have another albedo than its map."""
    np.save(tmp_path / "plain.npy", np.zeros((16, 16)))
    view, sun = View(kind="perspective", width=12, height=8, field_of_view_deg=30.0, elevation_deg=-20.0), 12.0
    plain = Terrain(heights=str(tmp_path / "plain.npy"), size_km=200.0, albedo=0.6, shadows="none")
    scene = Scene(fields[0.3].medium, None, zones, QUICK, observer=Observer(altitude_km=2.0))
    solved = solve(scene, cached=False)
    sky = view_radiance(solved, view, Sun(sun)).whole()
    made = landscape(solved, sky, plain, Sun(sun))
    mapped = landscape(
        solved, sky, plain.model_copy(update={"albedo": 0.1}), Sun(sun), PLACE, land=Land(uniform(0.6), PLACE)
    )
    np.testing.assert_allclose(mapped.radiance, made.radiance, rtol=1e-6)


def test_the_air_is_lit_by_the_map_s_mean(tmp_path):
    """The air would be lit by another ground than the picture shows."""
    path = str(netcdf(tmp_path / "a.nc"))
    asked = {**PLACED, "ground.albedo_map": path, "wavelengths": {"list_nm": [500.0]}}
    assert resolve(load("pure-air", asked)).medium.ground_albedo == pytest.approx(0.5)
    with pytest.warns(TwilightWarning, match="the sun has no place"):
        without = resolve(load("pure-air", {**asked, "sun": {"elevation_deg": 5.0}}))
    assert without.medium.ground_albedo == pytest.approx(0.15)
    high = resolve(load("pure-air", {**asked, "observer.altitude_km": 35786.0})).medium.ground_albedo
    assert 0.3 < high[0] < 0.5
    part = str(netcdf(tmp_path / "b.nc", lat=np.arange(-10.0, 11.0), lon=np.arange(0.0, 11.0)))
    elsewhere = load("pure-air", {**asked, "ground.albedo_map": part, "ground.albedo": 0.2})
    assert resolve(elsewhere).medium.ground_albedo == pytest.approx(0.2)


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"sun": {"elevation_deg": 20.0}, "observer.view.kind": "latlong"}, "ground.albedo_map: needs to know"),
        ({"ground.albedo_map": "nowhere.nc"}, "there is no file"),
        ({"ground.albedo_map_sha256": "0" * 64}, "is not the table of this climate"),
        ({"terrain.albedo": 0.2, "observer.view.kind": "perspective"}, "leave one of them out"),
    ],
)
def test_what_a_map_needs(tmp_path, settings, message):
    """A map of no place would be laid anywhere."""
    path = str(netcdf(tmp_path / "a.nc"))
    with pytest.raises(TwilightError, match=message):
        resolve(load("pure-air", {**PLACED, "ground.albedo_map": path, **settings}))


def test_a_solver_of_the_sky_alone_is_refused():
    """Land would be drawn by a solver that sees no ground."""
    with pytest.raises(TwilightError, match="goes below the horizon"):
        check_view(VIEW, compact.CAPABILITIES, "x", mapped=True)


def _per_cent(path):
    return netcdf(path, 30.0 * np.ones((36, 72)))


def _no_place(path):
    xarray.DataArray(np.zeros((4, 4)), dims=("y", "x"), name="albedo").to_netcdf(path, engine="h5netcdf")
    return path


def _two(path):
    one = xarray.DataArray(np.zeros((36, 72)), {"lat": LAT, "lon": LON}, ("lat", "lon"))
    xarray.Dataset({"vis": one, "nir": one}).to_netcdf(path, engine="h5netcdf")
    return path


def _square(path):
    Image.new("RGB", (20, 20)).save(path.with_suffix(".png"))
    return path.with_suffix(".png")


def _text(path):
    path.write_text("no map")
    return path


def _months(path):
    return netcdf(path, np.zeros((12, 36, 72)), dims=("month", "lat", "lon"))


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (_per_cent, "albedo must be from 0 to 1; it has 30 to 30"),
        (_no_place, "has no latitude and longitude"),
        (_two, "must have one variable over latitude and longitude, or one named .* it has vis, nir"),
        (_square, "twice as wide as high; it has 20 x 20 pixels"),
        (_text, "is no map of albedo"),
        (_months, r"it has month \(12\)"),
        (lambda path: netcdf(path, lat=np.arange(-175.0, 180.0, 10.0)), "latitude must be from -90 to 90; it has -175"),
        (lambda path: netcdf(path, np.full((36, 72), np.nan)), "every value is missing"),
        (lambda path: netcdf(path, lat=LAT[:1]), "latitude must have two values or more"),
    ],
)
def test_files_that_are_no_map(tmp_path, make, message):
    """Per cent, or no latitudes, would be taken for albedo."""
    with pytest.raises(TwilightError, match=message):
        read_albedo_map(make(tmp_path / "a.nc"))
