"""GeoTIFFs as people have them: what a file says of place, size, order, nodata, scale and unit is used or refused."""

import math

import numpy as np
import pytest

from twilight.base.errors import TwilightError, TwilightWarning
from twilight.config.pictures import Terrain
from twilight.terrain.heights import Standpoint, heights_of
from twilight.terrain.march import height_at, shadow_over

rasterio = pytest.importorskip("rasterio")
from rasterio.transform import Affine, from_bounds  # noqa: E402

RADIUS = 6371.0
UTM = "EPSG:32632"
FOOT = 1200.0 / 3937.0


def write(path, values, transform, crs=UTM, *, scale=1.0, offset=0.0, unit=None, nodata=None):
    """A GeoTIFF of values (rows, columns) or (bands, rows, columns)."""
    bands = values.reshape(-1, *values.shape[-2:])
    with rasterio.open(
        path, "w", driver="GTiff", width=bands.shape[2], height=bands.shape[1], count=len(bands),
        dtype=values.dtype, crs=crs, transform=transform, nodata=nodata,
    ) as file:  # fmt: skip
        file.write(bands)
        if (scale, offset) != (1.0, 0.0):
            file.scales, file.offsets = [scale], [offset]
        if unit:
            file.units = [unit]
    return str(path)


def slope_land(n=60):
    """Heights [m] that rise to the north (rows) and a little to the east: no two directions are alike."""
    north, east = np.meshgrid(np.arange(n)[::-1], np.arange(n), indexing="ij")
    return 500.0 + 10.0 * north + 2.0 * east


UP = Affine(100.0, 0.0, 500_000.0, 0.0, -100.0, 5_300_000.0)
"""Of 60 x 60 pixels of 100 m on the central meridian, north up."""
PLACES = [(0.0, 0.0), (2.0, 1.0), (-1.5, 2.0), (1.0, -2.2)]


def profile(name):
    made = heights_of(Terrain(heights=name))
    return np.array([height_at(made, x, y) for x, y in PLACES])


@pytest.fixture(scope="module")
def plain(tmp_path_factory):
    return profile(write(tmp_path_factory.mktemp("land") / "up.tif", slope_land().astype("float32"), UP))


def test_the_plain_land_is_where_it_is(plain):
    """The middle pixel's height is in the middle, 1 km north is 100 m higher, 1 km east 20 m."""
    middle = (500.0 + 10.0 * 29.5 + 2.0 * 29.5) / 1000.0
    expected = [middle + 0.1 * y + 0.02 * x for x, y in PLACES]
    np.testing.assert_allclose(plain, expected, atol=2e-3)


@pytest.mark.parametrize("kind", ["south-up", "west-first", "quarter-turn", "integer", "scale", "feet", "feet-both"])
def test_one_land_in_every_shape(tmp_path, plain, kind):
    """Order of rows and columns, rotation, whole numbers, scale and offset, and units: the same land."""
    land, path, n = slope_land(), tmp_path / "z.tif", 60
    if kind == "south-up":
        up = UP @ Affine.translation(0.0, n) @ Affine.scale(1.0, -1.0)
        name = write(path, land[::-1].astype("float32"), up)
    elif kind == "west-first":
        name = write(path, land[:, ::-1].astype("float32"), UP @ Affine.translation(n, 0) @ Affine.scale(-1.0, 1.0))
    elif kind == "quarter-turn":
        # the file's rows run to the east and its columns to the north
        name = write(path, land.T[:, ::-1].copy().astype("float32"), UP @ Affine(0, 1, 0, -1, 0, n))
    elif kind == "integer":
        name = write(path, land.astype("int16"), UP, nodata=-32768)
    elif kind == "scale":
        name = write(path, ((land - 300.0) / 0.5).astype("uint16"), UP, scale=0.5, offset=300.0)
    elif kind == "feet":
        name = write(path, (land / FOOT).astype("float32"), UP, unit="US survey foot")
    else:
        # the same zone of UTM, its axes in feet
        feet = "+proj=utm +zone=32 +datum=WGS84 +units=us-ft"
        name = write(path, (land / FOOT).astype("float32"), Affine.scale(1 / FOOT) @ UP, feet, unit="ftUS")
    np.testing.assert_allclose(profile(name), plain, atol=2e-3)


def test_heights_of_a_vertical_coordinate_system_in_feet(tmp_path, plain):
    """A compound coordinate system says the unit of heights where the band has none."""
    name = write(tmp_path / "z.tif", (slope_land() / FOOT).astype("float32"), UP, "EPSG:32632+6360")
    np.testing.assert_allclose(profile(name), plain, atol=2e-3)


@pytest.mark.parametrize("first", [179.9, -180.1, 539.9])
@pytest.mark.parametrize("observer", [179.98, 180.02, -179.98])
def test_longitudes_modulo_360(tmp_path, first, observer):
    """Across the date line, however the file counts its longitudes and whichever the observer's is."""
    z = np.full((200, 200), 100.0, np.float32)
    z[97:103, 97:103] = 1100.0  # on the date line
    name = write(tmp_path / "z.tif", z, from_bounds(first, -20.1, first + 0.2, -19.9, 200, 200), "EPSG:4326")
    made = heights_of(Terrain(heights=name), standpoint=Standpoint(-20.0, observer, 0.0))
    away = (180.0 - observer + 180.0) % 360.0 - 180.0
    x = math.radians(away) * RADIUS * math.cos(math.radians(20.0))
    assert height_at(made, x, 0.0) == pytest.approx(1.1, abs=1e-3)
    assert height_at(made, x + 1.0, 0.0) == pytest.approx(0.1, abs=1e-3)


def test_the_globe_from_0_to_360(tmp_path):
    """A file of the whole Earth: an observer at its seam has land on either side, and far land is left out."""
    z = np.full((180, 360), 200.0, np.float32)
    z[:, :3] = 700.0
    name = write(tmp_path / "z.tif", z, from_bounds(0.0, -90.0, 360.0, 90.0, 360, 180), "EPSG:4326")
    made = heights_of(Terrain(heights=name), standpoint=Standpoint(0.0, 0.0, 0.0))
    found = [height_at(made, x, 0.0) for x in (-300.0, -150.0, 150.0, 250.0, 500.0)]
    np.testing.assert_allclose(found, [0.2, 0.2, 0.7, 0.7, 0.2], atol=0.02)
    assert made.step_x_km * made.altitude_km.shape[1] <= 2000.0 + 2.0 * made.step_x_km


def test_nodata_is_no_land(tmp_path):
    """A gap is neither land at the height that stands for it nor smeared into its neighbours; nobody stands in it."""
    z = slope_land().astype("int16")
    z[:, 45:] = -9999  # 1.5 km east of the middle, on
    name = write(tmp_path / "z.tif", z, UP, nodata=-9999)
    made = heights_of(Terrain(heights=name))
    assert height_at(made, 1.0, 0.0) == pytest.approx(0.854 + 0.02, abs=3e-3)
    assert height_at(made, 2.5, 0.0) < -1e8
    on_land = made.altitude_km[made.altitude_km > -1e8]
    assert on_land.min() >= 0.49 and made.highest_km < 1.3
    latitude, longitude = 47.83, 9.075  # in the gap
    with pytest.raises(TwilightError, match="has no height"):
        heights_of(Terrain(heights=name), standpoint=Standpoint(latitude, longitude, 0.0))
    z[:] = -9999
    with pytest.raises(TwilightError, match="every pixel is nodata"):
        heights_of(Terrain(heights=write(tmp_path / "z.tif", z, UP, nodata=-9999)))


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda z: z - 3000.0, r"altitudes must be from -500 to 9000 m.* it has -2500"),
        (lambda z: z * 10.0, "is its unit or its scale another one"),
        (lambda z: np.where(z > 1000.0, np.inf, z), "must be finite"),
        (lambda z: np.stack([z, z, z]), "one band, has 3 bands"),
    ],
)
def test_heights_that_no_land_has(tmp_path, change, message):
    """Decimetres or feet would be taken for metres."""
    with pytest.raises(TwilightError, match=message):
        heights_of(Terrain(heights=write(tmp_path / "z.tif", change(slope_land()).astype("float32"), UP)))


def test_what_a_file_says_is_refused_where_it_is_not_known(tmp_path):
    """An unknown unit would be taken for metres."""
    z = slope_land().astype("float32")
    with pytest.raises(TwilightError, match="are in 'fathom'; known are m, km"):
        heights_of(Terrain(heights=write(tmp_path / "z.tif", z, UP, unit="fathom")))
    with pytest.raises(TwilightError, match="leave out size_km"):
        heights_of(Terrain(heights=write(tmp_path / "z.tif", z, UP), size_km=20.0))
    # without any coordinates it is as large as size_km says
    with pytest.warns(rasterio.errors.NotGeoreferencedWarning):
        name = write(tmp_path / "z.tif", z, None, None)
    assert heights_of(Terrain(heights=name, size_km=12.0)).step_x_km == pytest.approx(0.2)


def test_searches_end_whatever_the_steps_are(plain):
    """Steps of a field that never pass the end: the searches along lines are bounded."""
    from twilight.terrain.heights import Heights
    from twilight.terrain.march import Lines, first_hits

    for step in (-0.1, 0.0, math.nan):
        made = Heights(np.zeros((4, 4), np.float32), -0.2, -0.2, 0.1, step, 1.0, 0.0, 1.0)
        out = np.empty(1)
        lines = Lines(RADIUS, 0.5, np.array([-0.001]), np.zeros(1), np.array([600.0]))
        first_hits(made, 0.0, lines, out, 0, 1)
        shadow_over(made, RADIUS, 0.0, 0.0, 0.1)


DEGREES = from_bounds(8.9, 47.8, 9.1, 47.9, 60, 60)
LOCAL = 'LOCAL_CS["mine",UNIT["metre",1]]'


@pytest.mark.filterwarnings("ignore::rasterio.errors.NotGeoreferencedWarning")
@pytest.mark.parametrize(
    ("transform", "crs", "message"),
    [
        (DEGREES, None, r"pixels are 0.00333 m large .* if they are degrees, say so"),
        (None, UTM, "not where its pixels lie in it"),
        (UP, LOCAL, "is none of places on Earth"),
    ],
)
def test_half_a_place_is_refused(tmp_path, transform, crs, message):
    """Degrees would be taken for metres."""
    with pytest.raises(TwilightError, match=message):
        heights_of(Terrain(heights=write(tmp_path / "z.tif", slope_land().astype("float32"), transform, crs)))


def test_what_a_file_leaves_open_is_warned_of(tmp_path, plain):
    """Coordinates without a system beside an observer's place; axes in feet and heights in nobody says what."""
    z = slope_land().astype("float32")
    with pytest.warns(TwilightWarning, match="not laid where its coordinates are"):
        name = write(tmp_path / "a.tif", z, UP, None)
        heights_of(Terrain(heights=name), standpoint=Standpoint(47.8, 9.0, 0.0))
    name = write(tmp_path / "b.tif", z, Affine.scale(1 / FOOT) @ UP, "+proj=utm +zone=32 +datum=WGS84 +units=us-ft")
    with pytest.warns(TwilightWarning, match="in US survey foot.*taken for metres"):
        np.testing.assert_allclose(profile(name), plain, atol=2e-3)
