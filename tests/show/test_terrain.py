"""Terrain: hits, shadows and dark light against closed forms; files that are refused."""

import math

import numpy as np
import pytest
from airs import pure_air, turbid
from hazy_zones import QUICK, SCALAR

from twilight.base.errors import TwilightError
from twilight.config import load_climate
from twilight.config.pictures import Terrain, View
from twilight.config.scene import Observer
from twilight.engine import solve
from twilight.engine.view import landscape, view_radiance
from twilight.scene import Scene
from twilight.scene.medium import climate_medium
from twilight.sky.lights import Sun
from twilight.solvers import zones
from twilight.solvers.analytic import preetham
from twilight.solvers.analytic.daylight import hemisphere
from twilight.terrain.aerial_perspective import AerialPerspective, sunlit_air
from twilight.terrain.heights import Heights, Standpoint, heights_of
from twilight.terrain.march import (
    Lines,
    ShadowGrid,
    SunlightSums,
    TerrainAir,
    first_hits,
    height_at,
    shadow_over,
    sunlight_on_lines,
)
from twilight.terrain.scene import FormulaField, SunlitAir, Viewpoint, add_terrain
from twilight.transport.beam import beam_at, prepare_beam
from twilight.transport.scaling import species_phase
from twilight.transport.steps import distance_to_sphere

RADIUS = 6371.0


def flat(altitude_km: float, size_km: float = 400.0) -> Heights:
    step = size_km / 50
    return Heights(np.full((51, 51), altitude_km, np.float32), -size_km / 2, -size_km / 2, step, step, 1.0, 0.0,
                   altitude_km)  # fmt: skip


def wall(distance_km: float, altitude_km: float, reach: int = 400) -> Heights:
    """A wall across, 4 km thick, its near edge so far towards the sun, on land that reaches so far [km]."""
    z = np.zeros((2 * reach + 1, 81), np.float32)
    z[reach + 1 + round(distance_km) : reach + 5 + round(distance_km)] = altitude_km
    return Heights(z, -40.0, -float(reach), 1.0, 1.0, 1.0, 0.0, altitude_km)


@pytest.mark.parametrize("elevation_deg", [-2.0, -10.0, -60.0])
def test_lines_end_on_a_plateau_where_the_sphere_is(elevation_deg):
    """Lines of sight would end before or behind the land."""
    e, a, out = np.radians([elevation_deg]), np.array([0.7]), np.empty(1)
    first_hits(flat(1.0), 0.0, Lines(RADIUS, 3.0, e, a, np.array([400.0])), out, 0, 1)
    assert out[0] == pytest.approx(distance_to_sphere(3.0, math.sin(e[0]), 1.0, RADIUS), rel=1e-5)
    first_hits(flat(1.0), 0.0, Lines(RADIUS, 3.0, -e, a, np.array([400.0])), out, 0, 1)
    assert np.isinf(out[0])


@pytest.mark.parametrize(("distance", "height", "sun_deg"), [(20.0, 2.0, 3.0), (100.0, 3.0, 1.0), (300.0, 9.0, -1.0)])
def test_the_shadow_of_a_wall(distance, height, sun_deg):
    """Also beyond the horizon: with the sun at -1 deg the light comes from below, over the bulge of the Earth."""
    made = wall(distance, height)
    slope = math.tan(math.radians(sun_deg))
    # over its near edge, to the steps of the search; also at -1 deg: the Earth falls away faster than the light rises
    t = np.array([distance, distance + 2.5])
    most, least = height - t * slope - t**2 / (2.0 * RADIUS)
    assert least - 0.01 < shadow_over(made, RADIUS, 0.3, 0.0, math.radians(sun_deg)) < most + 0.01
    # behind the wall towards the sun it does not reach
    assert shadow_over(made, RADIUS, 0.3, distance + 5.0, math.radians(sun_deg)) < 0.2


@pytest.fixture(scope="module")
def air():
    medium = pure_air(np.array([0.0, 4.0, 8.0, 12.0, 20.0, 40.0]))
    return medium, prepare_beam(medium)


def sunlight(shadow, table, beam, to_sun, elevation, azimuth, end_km, steps):
    """(whole, dark) (D, S, W) and the dark length (D,) of `sunlight_on_lines`."""
    shape = (elevation.size, table.scattering.shape[0], table.scattering.shape[2])
    sums = SunlightSums(np.zeros(shape), np.zeros(shape), np.zeros(elevation.size), steps, False)
    lines = Lines(RADIUS, 0.0, elevation, azimuth, end_km)
    sunlight_on_lines(shadow, table, beam, lines, to_sun, sums, 0, elevation.size)
    return sums[:3]


def test_dark_light_of_an_even_slab(air):
    """All in shadow: sigma E (1 - exp(-k s)) / k, here along a level line in even air."""
    _, beam = air
    table = TerrainAir(0.0, 0.1, np.full((400, 3), 0.03), np.full((1, 400, 3), 0.02))
    everywhere = ShadowGrid(np.full((3, 3), 50.0), -200.0, -200.0, 200.0, 50.0)
    sun = math.radians(40.0)
    to_sun = np.array([math.sin(sun), math.cos(sun)])
    e, a, end = np.zeros(1), np.array([0.5 * math.pi]), np.array([30.0])
    whole, dark, length = sunlight(everywhere, table, beam, to_sun, e, a, end, 300)
    light = np.empty(3)
    beam_at(beam, 0.02, math.sin(sun), light)
    expected = 0.02 * light * (1 - math.exp(-0.03 * 30.0)) / 0.03
    np.testing.assert_allclose(dark[0, 0], expected, rtol=0.01)
    np.testing.assert_array_equal(dark, whole)
    assert length[0] == pytest.approx(30.0)


def test_the_edge_of_a_shadow_is_found_within_a_step(air):
    """Shadows in the air would have steps."""
    _, beam = air
    table = TerrainAir(0.0, 0.1, np.zeros((400, 3)), np.full((1, 400, 3), 0.02))
    half = ShadowGrid(np.full((3, 3), 2.0), -200.0, -200.0, 200.0, 2.0)
    e, a, end = np.radians([30.0]), np.zeros(1), np.array([7.3])
    whole, dark, length = sunlight(half, table, beam, np.array([0.5, 0.8]), e, a, end, 9)
    assert length[0] == pytest.approx(4.0, rel=2e-3)
    assert (0.0 < dark).all() and (dark < whole).all()


class Even:
    """A field of even source: light scattered in is 1 - T everywhere."""

    def inscatter(self, sun, elevation, azimuth, distance, *, observer_altitude_km, peak_passes):
        passed = np.exp(-0.05 * np.broadcast_to(distance, np.broadcast(elevation, azimuth, distance).shape))
        passed = np.repeat(passed[..., None], 3, axis=-1)
        return 1.0 - passed, passed

    def radiance(self, sun, elevation, azimuth, *, observer_altitude_km):
        return np.ones((*np.broadcast(elevation, azimuth).shape, 3))


def test_even_light_hides_white_ground(air):
    """A white plain under an even sky, the sun down: the ground is as bright as the sky and the air, whatever T."""
    medium, beam = air
    rays = np.array([[[0.0, 1.0, -0.1], [0.6, 0.8, -0.5], [0.0, 0.8, 0.6]]])
    rays /= np.linalg.norm(rays, axis=-1, keepdims=True)
    place = Viewpoint(1.0, -10.0, 0.0)
    sky = np.ones((1, 3, 3), np.float32)
    made = add_terrain(sky, rays, flat(0.2), SunlitAir(Even(), medium, beam, place), 1.0, "none")
    np.testing.assert_allclose(made.radiance, 1.0, rtol=0.01)
    np.testing.assert_array_equal(np.isfinite(made.distance_km), [[True, True, False]])
    with pytest.raises(TwilightError, match="below the terrain"):
        add_terrain(sky, rays, flat(2.0), SunlitAir(Even(), medium, beam, place), 1.0, "none")


@pytest.mark.parametrize("shadows", ["exact", "segments"])
def test_shadows_only_take_light(air, shadows):
    """A shadow would brighten a pixel."""
    medium, beam = air
    rays = np.array([[[0.3, 0.9, 0.0], [0.3, 0.9, 0.05], [0.0, -1.0, 0.02]]])
    rays /= np.linalg.norm(rays, axis=-1, keepdims=True)
    place = Viewpoint(0.5, 2.0, 0.4)
    sky = np.ones((1, 3, 3), np.float32)
    mountain = wall(15.0, 3.0, reach=60)
    clear = add_terrain(sky, rays, mountain, SunlitAir(Even(), medium, beam, place), 0.2, "none").radiance
    dark = add_terrain(sky, rays, mountain, SunlitAir(Even(), medium, beam, place), 0.2, shadows).radiance
    assert (dark <= clear + 1e-6).all() and (dark < clear - 1e-3).any() and (dark >= 0).all()


def test_preethams_air_lies_before_terrain_that_his_sun_lights(air):
    """Terrain in Preetham's sky would be seen through another air, or lit by another sun."""
    medium, beam = air
    field = preetham.prepare(medium, preetham.PreethamSettings(turbidity=3.0), observer_altitude_km=0.5)
    elevation, azimuth = np.array([-3.0, -8.0, -20.0]), np.array([0.0, 70.0, 180.0])
    e, a = np.radians(elevation), np.radians(azimuth)
    rays = np.stack([np.cos(e) * np.sin(a), np.cos(e) * np.cos(a), np.sin(e)], axis=-1)[None]
    sky, place = np.zeros((1, 3, 3), np.float32), Viewpoint(0.5, 30.0, 0.0)
    lit = SunlitAir(FormulaField(field), medium, beam, place)
    dark, white = (add_terrain(sky, rays, flat(0.0), lit, albedo, "none").radiance[0] for albedo in (0.0, 1.0))
    light, passed = field.inscatter(30.0, elevation, azimuth, 0.4999 / -np.sin(e))
    np.testing.assert_allclose(dark, light, rtol=0.03)
    sky_e, sky_a, solid = hemisphere()
    irradiance = (np.sin(np.radians(sky_e)) * solid) @ field.radiance(30.0, sky_e, sky_a) + 0.5 * field.sunlight(30.0)
    np.testing.assert_allclose(white - dark, passed * irradiance / np.pi, rtol=0.03)


def test_a_plain_is_the_ground_that_the_solver_sees(tmp_path):
    """A solved field, from the scene to the picture: flat terrain at the ground's height with the ground's albedo."""
    medium = turbid(3.0, wavelength_nm=np.array([550.0]))
    sun, view = 12.0, View(kind="perspective", width=24, height=16, field_of_view_deg=30.0, elevation_deg=-16.0)
    solved = solve(Scene(medium, None, zones, SCALAR, observer=Observer(altitude_km=2.0)), cached=False)
    seen = view_radiance(solved, view, Sun(sun)).whole()
    np.save(tmp_path / "plain.npy", np.zeros((16, 16)))
    plain = Terrain(heights=str(tmp_path / "plain.npy"), size_km=200.0, albedo=float(medium.ground_albedo[0]))
    made = landscape(solved, seen, plain, Sun(sun))
    assert made.hidden is not None and made.hidden.all()
    np.testing.assert_allclose(made.radiance, seen.radiance, rtol=0.03)
    # mountains: their shadows in the air take light and give none
    crest = Terrain(heights="ridges", size_km=60.0, height_km=1.5, albedo=plain.albedo, count=64)
    shaded = landscape(solved, seen, crest, Sun(sun))
    open_ = landscape(solved, seen, crest.model_copy(update={"shadows": "none"}), Sun(sun))
    assert shaded.hidden is not None and shaded.hidden.any() and np.isfinite(shaded.radiance).all()
    assert (shaded.radiance <= open_.radiance * (1.0 + 1e-6)).all()


def test_heights_come_from_files_and_formulas(tmp_path):
    """Land would be mirrored, turned, stretched or of another height."""
    path = tmp_path / "z.npy"
    np.save(path, np.arange(12.0).reshape(3, 4) * 100.0)
    made = heights_of(Terrain(heights=str(path), size_km=8.0))
    assert made.highest_km == pytest.approx(1.1)
    # the first row is the far one, to the left of the observer the first column
    assert height_at(made, -3.0, 2.0) == pytest.approx(0.0) and height_at(made, 3.0, -2.0) == pytest.approx(1.1)
    turned = heights_of(Terrain(heights=str(path), size_km=8.0, azimuth_deg=90.0))
    assert height_at(turned, 2.0, 3.0) == pytest.approx(0.0)
    for name in ("ridges", "ridge", "peak"):
        made = heights_of(Terrain(heights=name, height_km=1.5, base_km=0.5, count=64))
        assert made.altitude_km.min() >= 0.5 - 1e-6 and made.highest_km == pytest.approx(2.0)
    made = heights_of(Terrain(heights="jacksboro"))
    assert made.altitude_km.min() == pytest.approx(0.245) and made.highest_km == pytest.approx(1.068)
    # 6 arc seconds of latitude, and of longitude at 36.6 deg
    assert made.step_y_km == pytest.approx(6371.0 * np.radians(6.0 / 3600.0), rel=0.01)
    assert made.step_x_km == pytest.approx(made.step_y_km * np.cos(np.radians(36.59)), rel=0.01)


def test_files_that_are_no_heights(tmp_path):
    """A damaged file would be land."""
    with pytest.raises(TwilightError, match="there is no file"):
        heights_of(Terrain(heights="nowhere.npy"))
    path = tmp_path / "bad.npy"
    path.write_bytes(b"nothing")
    with pytest.raises(TwilightError, match="is not a"):
        heights_of(Terrain(heights=str(path)))
    np.save(path, np.array([[0.0, np.nan], [1.0, 2.0]]))
    with pytest.raises(TwilightError, match="without gaps"):
        heights_of(Terrain(heights=str(path)))
    with pytest.raises(ValueError, match="must be ridges"):
        Terrain(heights="alps")
    np.save(path, np.zeros((2, 2)))
    raw = path.read_bytes()
    at = raw.index(b"(2, 2)")
    path.write_bytes(raw[:at] + b"(1000000, 1000000)" + raw[at + 6 :].replace(b" " * 12, b"", 1))
    with pytest.raises(TwilightError, match=r"is damaged: it says that it holds 8e\+03 GB"):
        heights_of(Terrain(heights=str(path)))


def air_before(field, medium, beam, place, elevation_deg, azimuth_deg, far_km):
    """The air before terrain at one distance, on lines of sight in one azimuth, and the peaks' fractions."""
    own, forward = sunlit_air(field, medium)
    azimuth, far = np.full(elevation_deg.size, azimuth_deg), np.full(elevation_deg.size, far_km)
    return AerialPerspective(SunlitAir(field, medium, beam, place), own, forward, elevation_deg, azimuth, far), forward


def test_air_before_terrain_is_even_across_the_horizon(air):
    """Lines that end on the ground beyond a hill at 20 km, and those above the horizon, see it through the same air."""

    class Smooth:
        def inscatter(self, sun, elevation, azimuth, distance, *, observer_altitude_km, peak_passes):
            light = 0.1 * (2.0 + np.sin(np.radians(elevation))) * -np.expm1(-0.02 * distance)
            return np.repeat(light[..., None], 3, axis=-1), np.repeat(np.exp(-0.02 * distance)[..., None], 3, axis=-1)

    medium, beam = air
    elevation = np.linspace(-8.0, 3.0, 2201)
    for altitude_km in (0.3, 0.6, 3.0):
        place = Viewpoint(altitude_km, -20.0, 0.0)
        aerial, forward = air_before(Smooth(), medium, beam, place, elevation, 0.0, 90.0)
        for distance in (0.5, 5.0, 20.0):
            far = np.minimum(distance, aerial._length_km(elevation))
            e = np.radians(elevation)
            phase = species_phase(medium, forward, np.cos(e))
            light, passed = aerial.at(e, np.zeros(2201), far, phase)
            exact = 0.1 * (2.0 + np.sin(np.radians(elevation))) * -np.expm1(-0.02 * far)
            np.testing.assert_allclose(light[:, 0], exact, rtol=0.012)
            np.testing.assert_allclose(passed[:, 0], np.exp(-0.02 * far), rtol=1e-3)


@pytest.fixture(scope="module")
def hazy_field():
    """Haze with coarse particles, whose phase function has a narrow peak at the sun."""
    medium = climate_medium(load_climate("continental-average"), np.array([450.0, 650.0]))
    return solve(Scene(medium, None, zones, QUICK, observer=Observer(altitude_km=0.4)), cached=False)


@pytest.mark.parametrize("seed", [0, *(pytest.param(n, marks=pytest.mark.slow) for n in range(1, 9))])
def test_no_pixel_is_black_beside_its_neighbours(hazy_field, seed):
    """Random mountains, some before the sun: shadows take no more sunlight than there is, at every wavelength.

    In a mountain no pixel lies below all its eight neighbours by more than 20 %: a black hole stood where the sun is.
    """
    random = np.random.default_rng(seed)
    sun = float(random.choice([0.5, 2.7, 5.0, 9.0, 14.0]))
    kind = ("peak", "ridge", "ridges")[seed % 3]
    mountain = Terrain(
        heights=kind, size_km=float(random.uniform(30, 70)), height_km=float(random.uniform(2.0, 4.0)), count=200,
        seed=seed, distance_km=0.0 if kind == "ridges" else float(random.uniform(8, 25)),
    )  # fmt: skip
    view = View(kind="perspective", width=96, height=64, field_of_view_deg=30.0, elevation_deg=sun)
    made = landscape(hazy_field, view_radiance(hazy_field, view, Sun(sun)).whole(), mountain, Sun(sun))
    assert made.hidden is not None and made.hidden.any()
    light = made.radiance.astype(float)
    assert (light > 0.0).all()
    near = [np.roll(light, (i, j), axis=(0, 1)) for i in (-1, 0, 1) for j in (-1, 0, 1) if i or j]
    dip = light / np.min(near, axis=0)
    inner = made.hidden.copy()
    for axis in (0, 1):
        inner &= np.roll(made.hidden, 1, axis) & np.roll(made.hidden, -1, axis)
    inner[[0, -1]] = inner[:, [0, -1]] = False
    assert kind == "ridges" or dip[inner].min() > 0.8


def test_haze_before_a_plain_has_no_bands(hazy_field):
    """Below the horizon the light of the haze falls smoothly: as the field itself has it, line by line."""
    block, sun = hazy_field.blocks[0], 4.0
    elevation = np.linspace(-6.0, -0.9, 120)
    beam = prepare_beam(block.field.grids.scaled.medium)
    aerial, forward = air_before(block.field, block.medium, beam, Viewpoint(0.4, sun, 0.0), elevation, 40.0, 120.0)
    far = 0.97 * aerial._length_km(elevation)
    e, a = np.radians(elevation), np.full(120, math.radians(40.0))
    cosine = np.sin(e) * math.sin(math.radians(sun)) + np.cos(e) * math.cos(math.radians(sun)) * np.cos(a)
    light, _ = aerial.at(e, a, far, species_phase(block.medium, forward, cosine))
    exact, _ = block.field.inscatter(sun, elevation, 40.0, far, observer_altitude_km=0.4, peak_passes=True)
    np.testing.assert_allclose(light, exact, rtol=0.03)


@pytest.mark.parametrize("crs", ["EPSG:4326", "EPSG:32632"])
def test_a_geotiff_lies_where_it_is(tmp_path, crs):
    """A summit 6 km north-east of the observer is found there, whatever the sun's azimuth and the file's grid."""
    rasterio = pytest.importorskip("rasterio")
    from rasterio.transform import from_bounds
    from rasterio.warp import transform

    latitude, longitude = 46.0, 10.5  # 1.08 deg of grid convergence in zone 32
    north_km = east_km = 6.0 * math.sqrt(0.5)
    per_degree = math.pi / 180.0 * RADIUS
    summit = (latitude + north_km / per_degree, longitude + east_km / per_degree / math.cos(math.radians(latitude)))
    n = 300
    if crs == "EPSG:4326":
        bounds = (10.3, 45.9, 10.8, 46.15)
        x, y = summit[1], summit[0]
    else:
        (x,), (y,) = transform("EPSG:4326", crs, [summit[1]], [summit[0]])
        bounds = (x - 12e3, y - 12e3, x + 8e3, y + 8e3)
    place = from_bounds(*bounds, n, n)
    column, row = (int(v) for v in ~place * (x, y))
    z = np.zeros((n, n), np.float32)
    z[row - 2 : row + 3, column - 2 : column + 3] = 1500.0
    path = tmp_path / "z.tif"
    with rasterio.open(
        path, "w", driver="GTiff", width=n, height=n, count=1, dtype="float32", crs=crs, transform=place
    ) as file:
        file.write(z, 1)
    for azimuth in (0.0, 100.0, 230.0):
        made = heights_of(Terrain(heights=str(path)), standpoint=Standpoint(latitude, longitude, azimuth))
        turn = math.radians(45.0 - azimuth)
        assert height_at(made, 6.0 * math.sin(turn), 6.0 * math.cos(turn)) == pytest.approx(1.5)
        assert height_at(made, 5.0 * math.sin(turn), 5.0 * math.cos(turn)) == pytest.approx(0.0)
    with pytest.raises(TwilightError, match="stands outside of it"):
        heights_of(Terrain(heights=str(path)), standpoint=Standpoint(47.0, longitude, 0.0))
    with pytest.raises(TwilightError, match="leave out distance_km"):
        heights_of(Terrain(heights=str(path), distance_km=3.0), standpoint=Standpoint(latitude, longitude, 0.0))
