"""What a user holds beside the field it came from: every kind of file, read by somebody else's reader."""

import numpy as np
import pytest
import xarray
from scipy.interpolate import RegularGridInterpolator

import twilight
from twilight.engine.table import row_breaks
from twilight.io import write_outputs
from twilight.numerics.directions import scattering_angle_rad
from twilight.sky import colour
from twilight.sky.plain_grid import FAINT
from twilight.sky.sky import Sky
from twilight.transport.rays import horizon_dip_deg

USUAL, LARGEST = 0.005, 0.02
"""Relative error that 95 % of radiances may have, and the largest one (issue: 0.5 % and 2 %)."""

BESIDE_DEG = 0.3
"""Distance from the horizon and from the edge of the sun's disc within which nothing is asked."""

DISC_DEG = 0.27

AT_EDGE_DEG = 2e-3
"""Distance from rays that graze the ground or the edge of a layer within which nothing is asked from high up."""

SUNS_DEG = (60.0, 30.0, 2.0, -2.3, -4.0, -8.0, -14.0)
AIRS = ("pure-air", "continental-average", "urban", "desert", "maritime-clean")
QUICK = (("continental-average", -4.0),)
SMALL = {"wavelength_nm": [420.0, 490.0, 560.0, 630.0, 700.0], "settings": {"solver.polarisation": False}}
"""Of the quick tests: five wavelengths in scalar theory."""
EVERY = [(air, sun) for air in AIRS for sun in SUNS_DEG]
RAISED = (("continental-clean", -3.0, 1.03), ("continental-average", -4.0, 10.0))
EVERY_RAISED = [
    (air, (30.0, 2.0, -3.0, -8.0)[(a + h) % 4], height)
    for a, air in enumerate(AIRS)
    for h, height in enumerate((0.3, 1.03, 4.0, 10.0, 100.0, 400.0))
]
"""Each air at each altitude under one of the suns in turn; more of them: `benchmarks/tables.py raised`."""
MAP_WIDTH = 2048


def directions(sun_deg: float, count: int = 1000) -> tuple[np.ndarray, np.ndarray]:
    """Elevations and azimuths from the sun: over the sky, close to the horizon, round the sun and opposite to it."""
    random, third = np.random.default_rng(3), count // 4
    sine = np.sin(np.radians(0.1))
    elevation = np.concatenate(
        [
            np.degrees(np.arcsin(random.uniform(sine, 1.0, third))),
            0.1 * 10 ** random.uniform(0.0, 2.4, third),
            np.clip(max(sun_deg, 0.0) + random.normal(0.0, 5.0, third), 0.1, 90.0),
            np.clip(random.uniform(0.1, 15.0, third), 0.1, 90.0),
        ]
    )
    azimuth = np.concatenate(
        [
            random.uniform(0.0, 360.0, 2 * third),
            np.mod(random.normal(0.0, 6.0, third), 360.0),
            180.0 + random.normal(0.0, 25.0, third),
        ]
    )
    return np.minimum(elevation, 90.0), np.mod(azimuth, 360.0)


def at_horizon(sun_deg: float, dip_deg: float, count: int) -> tuple[np.ndarray, np.ndarray]:
    """Elevations and azimuths from the sun of a raised observer: from 0.02 deg above the visible horizon up, as close
    below it, to the nadir and the zenith."""
    random = np.random.default_rng(4)
    near = 10.0 ** random.uniform(np.log10(0.02), np.log10(5.0), 2 * count)
    rising = np.degrees(np.arcsin(random.uniform(-1.0, 1.0, count)))
    elevation = np.concatenate([-dip_deg + near, -dip_deg - near[:count], rising])
    azimuth = np.concatenate([random.normal(0.0, 20.0, count), random.uniform(0.0, 360.0, 2 * count),
                              180.0 + random.normal(0.0, 30.0, count)])  # fmt: skip
    keep = elevation >= -89.0
    return elevation[keep], np.mod(azimuth, 360.0)[keep]


@pytest.fixture(scope="module")
def any_observer():
    """Fields for every sun and observer, one after the other; `few`: of two wavelengths."""
    made = {}

    def field(air: str, few: bool):
        if (air, few) not in made:
            made.clear()
            more = {"wavelength_nm": [420.0, 700.0]} if few else {}
            made[air, few] = twilight.solve(air, quality="draft", **SMALL | more)
        return made[air, few]

    return field


@pytest.mark.parametrize(
    ("air", "sun", "altitude_km"),
    [*RAISED, *(pytest.param(*one, marks=pytest.mark.slow) for one in EVERY_RAISED if one not in RAISED)],
)
def test_a_sky_from_high_up_holds_the_field(any_observer, air, sun, altitude_km):
    """From a hill there were green rings above the horizon; from an airliner light was off by up to 458 %."""
    few = (air, sun, altitude_km) in RAISED
    field = any_observer(air, few)
    sky = field.sky(sun, observer_altitude_km=altitude_km)
    table = field.table(sun, altitude_km)
    elevation, azimuth = at_horizon(sun, horizon_dip_deg(field.medium, altitude_km), 200 if few else 400)
    away = np.degrees(scattering_angle_rad(sky.apparent_sun_elevation_deg, elevation, azimuth))
    breaks = np.array(row_breaks(field.scene, altitude_km)[1])
    wanted = (away > DISC_DEG + BESIDE_DEG) & (np.abs(elevation[:, None] - breaks).min(axis=1) > AT_EDGE_DEG)
    elevation, azimuth = elevation[wanted], azimuth[wanted]
    truth = field.radiance(sun, elevation, azimuth, altitude_km)
    # light below a thousandth of the brightest counts as so bright
    floor = FAINT * truth.max(axis=0)
    error = np.abs(sky.sample(elevation, azimuth) - truth) / np.maximum(truth, floor)
    usual, largest = np.percentile(error, 95), error.max()
    allowed = (0.003, 0.02) if altitude_km <= 12.0 else (0.005, 0.035)
    # where nodes end the table says so
    assert usual < max(allowed[0], 2.0 * table.error) and largest < max(allowed[1], 4.0 * table.worst), (
        f"{100 * usual:.2f} % at 95 %, {100 * largest:.2f} % at most; {100 * table.error:.2f}, {100 * table.worst:.2f}"
    )


def asked(sky: Sky, elevation: np.ndarray, azimuth: np.ndarray) -> np.ndarray:
    """Which directions count: away from the horizon and the disc."""
    sun = sky.sun_elevation_deg if sky.apparent_sun_elevation_deg is None else sky.apparent_sun_elevation_deg
    away = np.degrees(scattering_angle_rad(sun, elevation, azimuth))
    return (elevation > BESIDE_DEG) & (away > DISC_DEG + BESIDE_DEG)


def hold(found: np.ndarray, truth: np.ndarray, what: str) -> None:
    error = np.abs(found / truth - 1.0)
    usual, largest = np.percentile(error, 95), error.max()
    assert usual < USUAL and largest < LARGEST, f"{what}: {100 * usual:.2f} % at 95 %, {100 * largest:.2f} % at most"


def pixels(elevation: np.ndarray, azimuth: np.ndarray, width: int) -> tuple[np.ndarray, np.ndarray, tuple]:
    """Directions of the centres of the pixels that directions are in, and the pixels: u = 1/2 + azimuth / 360."""
    column = np.floor(np.mod(0.5 + azimuth / 360.0, 1.0) * width).astype(int)
    row = np.floor((90.0 - elevation) / 180.0 * (width // 2)).astype(int)
    return 90.0 - (row + 0.5) * 360.0 / width, np.mod((column + 0.5) / width - 0.5, 1.0) * 360.0, (row, column)


@pytest.fixture(scope="module")
def fields():
    """Fields of airs, solved once; `small`: under the suns of the quick tests alone."""
    made = {}

    def field(air: str, small: bool = False):
        if (air, small) not in made:
            made.clear()
            suns, more = ([-4.0, 10.0, 30.0, 33.0], SMALL) if small else (list(SUNS_DEG), {})
            made[air, small] = twilight.solve(air, quality="draft", sun_elevation_deg=suns, **more)
        return made[air, small]

    return field


@pytest.mark.parametrize(
    ("air", "sun"), [*QUICK, *(pytest.param(*one, marks=pytest.mark.slow) for one in EVERY if one not in QUICK)]
)
def test_files_hold_the_field(fields, tmp_path, air, sun):
    """A picture, an environment map or a data file would show a sky that was never computed."""
    field = fields(air, (air, sun) in QUICK)
    if (air, sun) in QUICK:
        sky = twilight.render(air, sun_elevation_deg=sun, quality="draft", **SMALL)
        assert sky.provenance["interpolation_error"] == pytest.approx(field.table(sun).error, abs=0.002)
    else:
        sky = field.sky(sun)
    write_outputs(sky, tmp_path, files=("rgb", "spectral", "h5"), width=MAP_WIDTH, spectral_width=MAP_WIDTH)
    elevation, azimuth = directions(sun)
    wanted = asked(sky, elevation, azimuth)
    elevation, azimuth = elevation[wanted], azimuth[wanted]
    truth = field.radiance(sun, elevation, azimuth)
    hold(sky.sample(elevation, azimuth), truth, "Sky.sample")
    hold(_netcdf(tmp_path / "sky.h5", elevation, azimuth) / sky.solar_irradiance, truth, "sky.h5, straight lines")
    e, a, where = pixels(elevation, azimuth, MAP_WIDTH)
    e, a, where = (x[asked(sky, e, a)] if isinstance(x, np.ndarray) else x for x in (e, a, where))
    inside = asked(sky, *pixels(elevation, azimuth, MAP_WIDTH)[:2])
    where = tuple(part[inside] for part in where)
    truth = field.radiance(sun, e, a)
    spectral = _spectral_exr(tmp_path / "sky.spectral.exr", sky.wavelength_nm)
    hold(spectral[where] / sky.solar_irradiance, truth, "sky.spectral.exr")
    rgb = _rgb_exr(tmp_path / "sky.rgb.exr")[where]
    xyz = colour.factor_to_xyz(truth, sky.wavelength_nm, sky.solar_spectrum, sky.distance_au, colour.DEFAULT_OBSERVER)
    expected = colour.xyz_to_linear_rgb(xyz) / 683.0
    scale = np.abs(expected).max(axis=1, keepdims=True)
    hold(1.0 + (rgb - expected) / scale, np.ones_like(rgb), "sky.rgb.exr")


def _netcdf(path, elevation: np.ndarray, azimuth: np.ndarray) -> np.ndarray:
    """Radiance by xarray, on straight lines between the file's rows and columns."""
    with xarray.open_dataset(path, engine="h5netcdf") as data:
        around = np.append(data.azimuth.values, data.azimuth.values[0] + 360.0)
        values = np.concatenate([data.radiance.values, data.radiance.values[:, :1]], axis=1)
        read = RegularGridInterpolator((data.elevation.values, around), values.astype(float))
    first = around[0]
    return read(np.stack([elevation, first + np.mod(azimuth - first, 360.0)], axis=-1))


def _spectral_exr(path, wavelength_nm: np.ndarray) -> np.ndarray:
    """Radiance (H, W, K) by OpenImageIO."""
    oiio = pytest.importorskip("OpenImageIO")
    image = oiio.ImageInput.open(str(path))
    spec, values = image.spec(), image.read_image("float")
    image.close()
    names = [f"S0.{nm:.6f}nm".replace(".", ",", 2).replace(",", ".", 1) for nm in wavelength_nm]
    return np.asarray(values)[..., [list(spec.channelnames).index(name) for name in names]]


def _rgb_exr(path) -> np.ndarray:
    """Red, green, blue (H, W, 3) by OpenEXR."""
    import OpenEXR

    with OpenEXR.File(str(path), separate_channels=True) as file:
        return np.stack([np.array(file.channels()[name].pixels) for name in "RGB"], axis=-1)


@pytest.mark.parametrize("sun", [-4.0, pytest.param(30.0, marks=pytest.mark.slow)])
def test_mitsuba_is_lit_by_the_field(fields, tmp_path, sun):
    """A renderer would be lit by another sky, or by one that is turned."""
    mitsuba = pytest.importorskip("mitsuba")
    mitsuba.set_variant("scalar_rgb")
    field = fields("continental-average", small=True)
    sky = field.sky(sun)
    write_outputs(sky, tmp_path, files=("rgb",), width=MAP_WIDTH, renderer="mitsuba")
    light = mitsuba.load_dict({"type": "envmap", "filename": str(tmp_path / "sky.rgb.exr")})
    elevation, azimuth = directions(sun)
    # a pixel is 0.18 deg high: between its centre and the ground's Mitsuba mixes both
    wanted = asked(sky, elevation, azimuth) & (elevation > 2 * BESIDE_DEG)
    away = np.degrees(scattering_angle_rad(sky.apparent_sun_elevation_deg, elevation, azimuth))
    elevation, azimuth = (x[wanted & (away > 3.0)] for x in (elevation, azimuth))
    e, a = np.radians(elevation), np.radians(azimuth)
    found = []
    for x, y, z in zip(-np.cos(e) * np.sin(a), np.sin(e), np.cos(e) * np.cos(a), strict=True):
        point = mitsuba.SurfaceInteraction3f()
        point.wi = mitsuba.Vector3f(-x, -y, -z)
        found.append(np.array(light.eval(point)).ravel()[:3])
    truth = field.radiance(sun, elevation, azimuth)
    xyz = colour.factor_to_xyz(truth, sky.wavelength_nm, sky.solar_spectrum, sky.distance_au, colour.DEFAULT_OBSERVER)
    expected = colour.xyz_to_linear_rgb(xyz) / 683.0
    scale = np.abs(expected).max(axis=1, keepdims=True)
    hold(1.0 + (np.array(found) - expected) / scale, np.ones_like(expected), "Mitsuba's envmap")


@pytest.mark.parametrize("sun", [10.0, *(pytest.param(sun, marks=pytest.mark.slow) for sun in (28.0, 30.0)), 33.0])
def test_the_aureole_is_round(fields, sun):
    """It stood upright, 1.6 times as high as wide, while rows were 3 deg apart."""
    sky = fields("continental-average", small=True).sky(sun)
    apparent = sky.apparent_sun_elevation_deg
    reference = sky.luminance_at(apparent + 1.0, 0.0)
    radius = np.linspace(0.3, 6.0, 2000)
    size = []
    for height, across in ((1.0, 0.0), (-1.0, 0.0), (0.0, 1.0), (0.0, -1.0)):
        light = sky.luminance_at(apparent + height * radius, across * radius / np.cos(np.radians(apparent)))
        size.append(radius[np.argmin(np.abs(light - reference))])
    assert size[0] + size[1] == pytest.approx(size[2] + size[3], rel=0.03)
