"""The polarised sky in closed form: light scattered once by molecules vibrates across the plane of scattering."""

import sys
from dataclasses import replace
from types import ModuleType

import numpy as np
import pytest
from hazy_zones import QUICK

from twilight import solvers
from twilight.base.errors import TwilightError
from twilight.base.sections import option, settings
from twilight.config import load
from twilight.engine import parts, plan, solve
from twilight.io import read_latlong_exr, read_sky, read_spectral_exr, write_outputs, write_sky, write_spectral_exr
from twilight.io.picture import polarisation_maps, view_directions
from twilight.numerics.directions import texture_centres
from twilight.scene import resolve
from twilight.sky.sky import Sky
from twilight.solvers.base import BareField, Capabilities

SUN_DEG = 20.0
NM = np.array([450.0, 550.0, 650.0])


def rayleigh(sun_elevation_deg, elevation_deg, azimuth_deg):
    """I, Q, U (..., 3) of light scattered once by molecules without depolarisation, by geometry alone.

    The vibration is along k_sun x k_view; its angle from the vertical of the line of sight, clockwise, gives Q and U.
    """
    s, e, a = np.broadcast_arrays(*(np.radians(v) for v in (sun_elevation_deg, elevation_deg, azimuth_deg)))
    view = np.stack([np.cos(e) * np.cos(a), np.cos(e) * np.sin(a), np.sin(e)], axis=-1)
    sun = np.stack([np.cos(s), np.zeros_like(s), np.sin(s)], axis=-1)
    up = np.stack([-np.sin(e) * np.cos(a), -np.sin(e) * np.sin(a), np.cos(e)], axis=-1)
    right = np.stack([-np.sin(a), np.cos(a), np.zeros_like(a)], axis=-1)  # larger azimuth
    cosine = (view * sun).sum(axis=-1)
    vibration = np.cross(sun, view)
    angle = np.arctan2((vibration * right).sum(axis=-1), (vibration * up).sum(axis=-1))
    intensity, polarised = 1.0 + cosine**2, 1.0 - cosine**2
    return np.stack([intensity, polarised * np.cos(2 * angle), polarised * np.sin(2 * angle)], axis=-1)


class RayleighField(BareField):
    polarised = True

    def __init__(self, medium):
        self.medium = medium

    def stokes(self, sun_elevation_deg, elevation_deg, azimuth_deg):
        assert np.max(azimuth_deg) <= 180.0
        values = rayleigh(sun_elevation_deg, elevation_deg, azimuth_deg)
        return values[..., None] * (self.medium.wavelength_nm / 550.0) ** -4

    def radiance(self, sun_elevation_deg, elevation_deg, azimuth_deg):
        return self.stokes(sun_elevation_deg, elevation_deg, azimuth_deg)[..., 0, :]


class RayleighSolver:
    CAPABILITIES = Capabilities(wavelengths_at_once=2)

    @staticmethod
    def prepare(medium, settings=None, *, observer_altitude_km=0.0, progress=None):
        return RayleighField(medium)


@pytest.fixture(scope="module")
def solved():
    plain = {"version": 1, "climate": {"version": 1, "name": "air"}, "horizon": "clean"}
    config = load(plain | {"wavelengths": {"list_nm": NM.tolist()}})
    scene = replace(resolve(config), solver=RayleighSolver, settings=None)
    assert len(parts(plan(scene))) == 2
    return solve(scene, cached=False)


@pytest.fixture(scope="module")
def sky(solved) -> Sky:
    return solved.sky(SUN_DEG, *texture_centres((30, 120)))


def test_the_other_half_has_the_same_q_and_the_opposite_u(sky):
    """The mirrored half would have U of the wrong sign, or the night be polarised."""
    expected = rayleigh(SUN_DEG, sky.elevation_deg[:, None], sky.azimuth_deg[None, :])
    np.testing.assert_allclose(sky.stokes[..., 1], expected, atol=1e-12)
    assert np.abs(sky.stokes[:, 1:60, 2]).max() > 0.1
    dim = replace(sky, night_radiance=sky.radiance)
    np.testing.assert_allclose(dim.degree_of_linear_polarisation, 0.5 * sky.degree_of_linear_polarisation)
    np.testing.assert_allclose(dim.angle_of_linear_polarisation_deg, sky.angle_of_linear_polarisation_deg)


def test_stokes_of_all_wavelengths_come_from_all_blocks(solved):
    """Q and U of the second block would be lost."""
    found = solved.stokes(SUN_DEG, [30.0], [70.0])
    np.testing.assert_allclose(found[0, :, 1], rayleigh(SUN_DEG, 30.0, 70.0), rtol=1e-12)
    np.testing.assert_allclose(found[0, 0] / found[0, 0, 1], (NM / 550.0) ** -4)


def test_degree_and_angle_are_those_of_the_scattering_plane(sky):
    """Degree or angle would be off closed forms."""
    e, a = np.radians(sky.elevation_deg)[:, None], np.radians(sky.azimuth_deg)[None, :]
    s = np.radians(SUN_DEG)
    cosine = np.sin(s) * np.sin(e) + np.cos(s) * np.cos(e) * np.cos(a)
    degree = (1 - cosine**2) / (1 + cosine**2)
    np.testing.assert_allclose(sky.degree_of_linear_polarisation[..., 0], degree, atol=1e-12)
    angle = sky.angle_of_linear_polarisation_deg
    assert np.abs(np.abs(angle[:, 0]) - 90.0).max() < 1e-6  # in the sun's vertical it vibrates horizontally


def test_a_polariser_puts_out_the_light_that_vibrates_across_it(sky):
    """90 deg from the sun, in its vertical, all light vibrates horizontally."""
    row, column = int(np.argmin(np.abs(sky.elevation_deg - 70.0))), 60
    vertical, horizontal = (sky.through_polariser(t).sun_normalised_radiance for t in (0.0, 90.0))
    at = np.s_[row, column, 1]
    total = sky.sun_normalised_radiance[at]
    assert vertical[at] < 1e-3 * total and horizontal[at] == pytest.approx(total, rel=1e-3)
    np.testing.assert_allclose(vertical + horizontal, sky.sun_normalised_radiance, rtol=1e-12)
    mean = np.mean([sky.through_polariser(t).sun_normalised_radiance for t in (0.0, 45.0, 90.0, 135.0)], axis=0)
    np.testing.assert_allclose(mean, 0.5 * sky.sun_normalised_radiance, rtol=1e-12)


@pytest.mark.parametrize("elevation_deg", [0.5, 33.3, 88.0, 89.5, 90.0])
def test_between_rows_and_up_to_the_zenith_polarisation_is_interpolated_with_its_plane(sky, elevation_deg):
    """Q and U would be interpolated across turning planes."""
    azimuth = np.linspace(0.0, 360.0, 41)
    expected = rayleigh(SUN_DEG, elevation_deg, azimuth)
    found = sky.sample_fractional_stokes(elevation_deg, azimuth)[..., 1]
    np.testing.assert_allclose(found, expected[:, 1:] / expected[:, :1], atol=4e-3 if elevation_deg > 1 else 0.03)
    fine = sky.resample([elevation_deg], np.arange(40) * 9.0)
    np.testing.assert_allclose(fine.stokes[0, :, 1:, 1] / fine.stokes[0, :, :1, 1], found[:-1], atol=1e-9)


def test_files_hold_q_and_u_with_their_convention(sky, tmp_path):
    """A reader would take another sign convention."""
    import xarray

    with_error = replace(
        sky, standard_error=0.01 * sky.sun_normalised_radiance, polarisation_error=0.01 + 0 * sky.polarisation
    )
    path = write_sky(with_error, tmp_path / "sky.h5")
    again = read_sky(path)
    np.testing.assert_array_equal(again.polarisation, sky.polarisation)
    np.testing.assert_array_equal(again.polarisation_error, with_error.polarisation_error)
    with xarray.open_dataset(path) as data:
        q, u = data.sun_normalised_radiance_q.values, data.sun_normalised_radiance_u.values
        degree = np.hypot(q, u) / data.sun_normalised_radiance.values
        np.testing.assert_allclose(data.degree_of_linear_polarisation.values, degree, atol=1e-12)
        np.testing.assert_allclose(data.angle_of_linear_polarisation.values, 0.5 * np.degrees(np.arctan2(u, q)))
        for name in ("sun_normalised_radiance_q", "sun_normalised_radiance_u", "angle_of_linear_polarisation"):
            assert "vertical plane through the line of sight" in data[name].attrs["comment"]
        assert data.angle_of_linear_polarisation.units == "degree"


def test_colour_science_reads_the_stokes_components_of_a_spectral_exr(sky, tmp_path):
    """Others would read other Stokes parameters."""
    colour = pytest.importorskip("colour")
    path = write_spectral_exr(sky, tmp_path / "sky.exr", width=64)
    components, about = colour.read_spectral_image_Fichet2021(str(path), additional_data=True)
    assert set(components) == {"S0", "S1", "S2"} and about.is_polarised and about.is_emissive
    attributes = {a.name: a.value for a in about.attributes}
    assert attributes["polarisationHandedness"] == "right"
    i, q, u = (components[name][1] for name in ("S0", "S1", "S2"))
    assert i.shape == (32, 64, 3)
    elevation, azimuth = 90.0 - 360.0 * (np.arange(16) + 0.5) / 64, 360.0 * (np.arange(64) + 0.5) / 64 - 180.0
    expected = rayleigh(SUN_DEG, elevation[:, None], azimuth[None, :])
    np.testing.assert_allclose(q[1:15, :, 1] / i[1:15, :, 1], (expected[..., 1] / expected[..., 0])[1:15], atol=5e-3)
    np.testing.assert_allclose(u[1:15, :, 1] / i[1:15, :, 1], (expected[..., 2] / expected[..., 0])[1:15], atol=5e-3)
    assert not q[16:].any() and not u[16:].any()  # the ground
    wavelength, total, _ = read_spectral_exr(path)
    np.testing.assert_allclose(wavelength, NM)
    np.testing.assert_allclose(total, i)


def test_the_picture_shows_degree_and_angle_over_the_whole_sky(sky, tmp_path):
    """The picture of polarisation would be turned or mirrored."""
    from PIL import Image

    degree, angle, wavelength = polarisation_maps(sky, 200)
    assert wavelength == 550.0 and np.isnan(degree[0, 0]) and degree.shape == (200, 200)
    elevation, azimuth = view_directions("fisheye", 200)
    inside = elevation > 5.0
    expected = rayleigh(SUN_DEG, elevation[inside], azimuth[inside])
    found = degree[inside] * np.exp(2j * np.radians(angle[inside]))
    right = (expected[:, 1] + 1j * expected[:, 2]) / expected[:, 0]
    assert np.abs(found - right).max() < 0.01
    paths = write_outputs(sky, tmp_path, files=("polarisation", "h5"))
    assert {path.name for path in paths} == {"sky.polarisation.png", "sky.h5"}
    picture = Image.open(tmp_path / "sky.polarisation.png")
    assert picture.size[0] > 800 and "configuration_hash" in picture.text


def test_a_polariser_changes_the_pictures_and_not_the_radiance(sky, tmp_path):
    """The data file would be dimmed too."""
    plain = write_outputs(sky, tmp_path / "plain", files=("rgb", "h5"), width=32)
    behind = write_outputs(sky, tmp_path / "behind", files=("rgb", "h5"), width=32, polariser_deg=0.0)
    np.testing.assert_array_equal(*(read_sky(paths[1]).stokes for paths in (plain, behind)))
    ratio = read_latlong_exr(behind[0]).rgb[:8] / read_latlong_exr(plain[0]).rgb[:8]
    elevation, azimuth = 90.0 - 360.0 * (np.arange(8) + 0.5) / 32, 360.0 * (np.arange(32) + 0.5) / 32 - 180.0
    expected = rayleigh(SUN_DEG, elevation[:, None], azimuth[None, :])
    passed = 0.5 * (1.0 + expected[..., 1] / expected[..., 0])
    np.testing.assert_allclose(ratio[1:, :, 1], passed[1:], atol=0.03)


@settings
class RayleighSettings:
    polarisation: bool = option("Q and U too", default=True)


def test_a_sweep_keeps_q_and_u_and_gives_them_back_for_both_halves(tmp_path, monkeypatch):
    """A sweep would lose Q and U, or their signs."""
    import xarray

    import twilight.api.accessor  # noqa: F401
    from twilight.config.load import load_axes
    from twilight.studies.sweep.store import open_store
    from twilight.studies.sweep.sweep import Sweep
    from twilight.studies.sweep.work import compute, forget

    module = ModuleType("rayleigh_toy")
    module.CAPABILITIES, module.prepare = RayleighSolver.CAPABILITIES, RayleighSolver.prepare
    module.QUALITIES = {"standard": RayleighSettings()}
    monkeypatch.setitem(sys.modules, "rayleigh_toy", module)
    monkeypatch.setitem(solvers.SOLVERS, "rayleigh", "rayleigh_toy")
    scene = {
        "version": 1, "climate": {"version": 1, "name": "air"}, "solver": {"name": "rayleigh"},
        "wavelengths": {"list_nm": NM.tolist()}, "texture": {"azimuth_count": 12, "elevation_count": 3},
        "vary": {"sun.elevation_deg": [5.0, 40.0]},
    }  # fmt: skip
    made = Sweep(load_axes(scene))
    assert list(made.layers) == ["sun_normalised_radiance_q", "sun_normalised_radiance_u"]
    with open_store(tmp_path / "sweep.zarr", made) as store:
        for task in made.tasks:
            store.write(task, compute(made.payload(task), threads=1))
    forget()
    data = xarray.open_zarr(tmp_path / "sweep.zarr")
    assert "vertical plane" in data.sun_normalised_radiance_u.attrs["comment"]
    back = data.sky.scene(sun_elevation_deg=40.0)
    expected = rayleigh(40.0, back.elevation_deg[:, None], back.azimuth_deg[None, :])
    np.testing.assert_allclose(back.stokes[..., 1], expected, atol=1e-6)


def test_a_sky_without_polarisation_says_so(sky):
    """Zeros would be taken for unpolarised light."""
    plain = replace(sky, polarisation=None)
    for ask in (
        lambda: plain.stokes,
        lambda: plain.through_polariser(0.0),
        lambda: plain.degree_of_linear_polarisation,
    ):
        with pytest.raises(TwilightError, match=r"solver\.polarisation"):
            ask()


def test_zones_keeps_the_same_convention():
    """Thin air without aerosol, scattered once: Q / I and U / I of the solver are those of geometry, both sides."""
    from twilight.solvers import zones

    config = load(
        {"version": 1, "climate": {"version": 1, "name": "air"}, "wavelengths": {"list_nm": [700.0]}},
        {"refraction.model": "none"},
    )
    settings = replace(QUICK, polarisation=True, max_orders=1)
    field = solve(resolve(config, solver=(zones, settings)), cached=False)
    sky = field.sky(SUN_DEG, np.array([15.0, 75.0, 90.0]), np.arange(8) * 45.0)
    expected = rayleigh(SUN_DEG, sky.elevation_deg[:, None], sky.azimuth_deg[None, :])
    found = sky.fractional_stokes[..., 0]
    # depolarisation takes a few per cent of the degree
    np.testing.assert_allclose(found, expected[..., 1:] / expected[..., :1], atol=0.06)
