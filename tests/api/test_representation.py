"""How skies and models show themselves, and the accessor of xarray's datasets: the same figures everywhere."""

import base64
import io
import re
from dataclasses import replace
from datetime import UTC, datetime, timedelta

import numpy as np
import pytest
import xarray as xr
from toy_sky import glow_sky

from twilight.api.representation import SkySeries, open_dataset
from twilight.base.errors import TwilightError
from twilight.io.netcdf import write_sky
from twilight.io.picture import render_view, view_directions
from twilight.numerics.directions import direction
from twilight.numerics.projections import PROJECTIONS
from twilight.sky.disc import Disc


@pytest.fixture(scope="module")
def sky():
    made = glow_sky(step_deg=10.0, wavelength_nm=(450.0, 550.0, 650.0), direct_irradiance=np.full(3, 0.1))
    configuration = {"climate": {"name": "air"}}
    return replace(made, provenance={"solver": "toy", "quality": "draft", "configuration": configuration})


def test_representations_are_five_lines(sky):
    """`repr` would flood a console or tell other figures, or a notebook show no picture."""
    assert len(repr(sky).splitlines()) == 5 and max(map(len, repr(sky).splitlines())) <= 110
    assert "sun at +5.00 deg, by toy (draft)" in repr(sky) and "9 elevations 5 to 85 deg" in repr(sky)
    assert f"{sky.illuminance_lux():.4g} lx" in repr(sky) and f"{sky.magnitude():.2f} V mag" in repr(sky)
    from PIL import Image

    text = sky._repr_html_()
    data = re.search(r"base64,([^\"]+)", text)[1]
    picture = np.asarray(Image.open(io.BytesIO(base64.b64decode(data))))
    assert picture.shape[1] == 480 and picture.std() > 5
    assert "air" in text and "lx" in text and "V mag arcsec^-2" in text


@pytest.fixture
def drawing():
    """matplotlib without a window, whose figures are closed after the test."""
    import matplotlib

    matplotlib.use("Agg")
    yield
    matplotlib.pyplot.close("all")


@pytest.mark.parametrize("projection", ("wide", *PROJECTIONS))
def test_a_sky_draws_itself(sky, projection, drawing):
    """`plot` would fail for a projection."""
    figure = sky.plot(projection, width=80)
    axes = figure.axes[0]
    figure.savefig(io.BytesIO(), format="png")
    assert axes.images[0].get_array().shape[1] == 80 and "sun +5.0" in axes.get_title()
    assert sky.plot(projection, ax=axes, width=80) is figure


def test_a_sky_is_drawn_in_any_azimuth(sky, drawing):
    """A picture away from the sun would show the sun."""
    towards, away = (render_view(sky, view="panorama", width=80, azimuth_deg=a)[0] for a in (0.0, 90.0))
    assert np.allclose(np.roll(towards, -20, axis=1), away, atol=1e-6) and not np.allclose(towards, away, atol=0.01)
    for projection in ("wide", "perspective", "cylinder", "fisheye"):
        front, back = (
            render_view(sky, view=projection, width=80, azimuth_deg=a, exposure=12.0)[0] for a in (0.0, 180.0)
        )
        # the glow of the sun is in the middle of the one, and of the fisheye's lower edge
        middle = np.s_[60:, 30:50] if projection == "fisheye" else np.s_[:, 30:50]
        assert np.nanmax(front[middle]) > 1.2 * np.nanmax(back[middle]), projection
    assert sky.plot("wide", width=80, azimuth_deg=180).axes[0].images[0].get_array().shape[1] == 80


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"projection": 3}, "projection 3 is not known, choose one of wide"),
        ({"ax": 5}, "ax must be axes of matplotlib's, got 5"),
        ({"azimuth": 180}, "azimuth is no argument; allowed are projection, ax, azimuth_deg"),
        ({"azimuth_deg": "east"}, "azimuth_deg must be a finite number, got 'east'"),
        ({"width": 0}, "width must be a whole number of pixels, 4 or more, got 0"),
        ({"exposure": None}, "exposure: None must be 'auto' or a finite"),
    ],
)
def test_wrong_arguments_of_a_plot_are_one_sentence(sky, arguments, message):
    """A wrong argument would be a traceback of matplotlib."""
    with pytest.raises(TwilightError, match=message):
        sky.plot(**arguments)


def test_magnitude_and_luminance_are_those_of_the_direction(sky):
    """A figure would be of another direction."""
    assert sky.luminance_at(45.0, 10.0) == pytest.approx(sky.luminance()[4, 1])
    # the conversion in common use is 0.1 mag off for spectra that are not Vega's
    of_luminance = -2.5 * np.log10(sky.luminance_at(45.0, 10.0) / 10.8e4)
    assert sky.magnitude("V", 45.0, 10.0) == pytest.approx(of_luminance, abs=0.1)
    assert sky.magnitude("V", [45.0, 90.0], 10.0) == pytest.approx([sky.magnitude("V", 45, 10), sky.magnitude()])
    with pytest.raises(TwilightError, match=r"B: \d+% of its light is beyond .* 450 to 650 nm; wavelengths from 3\d\d"):
        sky.magnitude("B")
    with pytest.raises(TwilightError, match="the band 'W' is not known"):
        sky.magnitude("W")


def test_one_dataset_says_what_its_sky_says(sky):
    """A dataset's figures would differ from the sky's."""
    night = replace(sky, night_radiance=np.full(sky.sun_normalised_radiance.shape, 1e-3))
    for one in (sky, night):
        data = one.to_xarray()
        again = data.sky.scene()
        for name in ("radiance", "direct_irradiance", "ground_albedo", "azimuth_deg"):
            assert np.array_equal(getattr(again, name), getattr(one, name)), name
        assert float(data.sky.magnitude(elevation_deg=30)) == pytest.approx(one.magnitude(elevation_deg=30))
        assert float(data.sky.illuminance_lux()) == pytest.approx(one.illuminance_lux())
        assert np.allclose(data.sky.luminance(), one.luminance())
    assert night.illuminance_lux() > 1.001 * sky.illuminance_lux()


def test_half_skies_and_sequences_say_the_same_lazily(sky):
    """A sweep's figures would differ from the skies', or be computed at once."""
    suns = (5.0, -4.0, -9.0)
    skies = [replace(sky, sun_elevation_deg=s, distance_au=0.99,
                     sun_normalised_radiance=sky.sun_normalised_radiance * (s + 10)) for s in suns]  # fmt: skip
    half = xr.concat([s.to_xarray().isel(azimuth=slice(0, 19)) for s in skies], "sun").drop_vars("radiance")
    half["sun_normalised_radiance"][2] = np.nan
    half = half.assign_attrs(azimuth_count="36").chunk(sun=1)
    for figure in ("luminance_at", "magnitude", "illuminance_lux"):
        lazy = getattr(half.sky, figure)()
        assert lazy.dims == ("sun",) and lazy.chunks is not None and lazy.attrs["units"]
        expected = [getattr(s, figure)() for s in skies[:2]]
        assert np.allclose(lazy[:2], expected, rtol=1e-9) and np.isnan(lazy[2])
    assert half.sky.luminance().shape == (3, 9, 19)
    assert np.allclose(half.sky.scene(sun=1).radiance, skies[1].radiance)
    with pytest.raises(TwilightError, match="select also along sun"):
        half.sky.scene()
    with pytest.raises(TwilightError, match="holds no radiance"):
        half.sky.scene(sun=2)
    with pytest.raises(TwilightError, match="has no sun_normalised_radiance"):
        xr.Dataset().sky.scene()


def every_layer(sky):
    """The sky with all that a file can hold of one."""
    grid = sky.sun_normalised_radiance
    return replace(
        sky, night_radiance=np.full(grid.shape, 1e-6), standard_error=0.01 * grid,
        polarisation=0.1 * np.stack([grid, -grid], axis=2), polarisation_error=0.01 * np.stack([grid, grid], axis=2),
        apparent_sun_elevation_deg=5.2, sun_azimuth_deg=280.0, latitude_deg=52.5, longitude_deg=13.4,
        observer_altitude_km=0.1, time=datetime(2026, 6, 21, 20, tzinfo=UTC),
    )  # fmt: skip


def test_axes_are_a_few_words_with_a_unit_and_time_is_a_time(sky, tmp_path):
    """A plot's axis would have no unit, or a time be a number."""
    full = every_layer(sky)
    write_sky(full, tmp_path / "sky.h5")
    later = replace(full, time=full.time + timedelta(minutes=5), sun_elevation_deg=4.0)
    several = [SkySeries([full, later]), SkySeries([sky, replace(sky, sun_elevation_deg=4.0)])]
    for data in (full.to_xarray(), open_dataset(tmp_path / "sky.h5"), *(series.to_xarray() for series in several)):
        named = {str(n): v for n, v in data.variables.items() if not str(n).endswith("_bnds")}
        assert len(named) > 10
        for name, variable in named.items():
            text = variable.attrs["long_name"]
            assert 1 < len(text) <= 36 and not set(text) & set(";:"), (name, text)
            # of a decoded time xarray keeps the unit in the encoding
            assert "units" in (variable.encoding if name == "time" else variable.attrs), name
        if "time" in data.variables:
            assert data.time.dtype.kind == "M" and data.time.values.flat[0] == np.datetime64("2026-06-21T20:00")
    assert several[1].to_xarray().sun_elevation_deg.values.tolist() == [5.0, 4.0]
    assert np.array_equal(several[0].to_xarray().sun_normalised_radiance_u[1], later.polarisation[:, :, 1])


def test_azimuth_is_a_circle_and_the_zenith_a_point(sky):
    """Interpolation would be NaN beside azimuth 0 and in the zenith."""
    full = every_layer(sky)
    data = full.to_xarray()
    assert np.isnan(data.interp(azimuth=358.5, elevation=20.0).radiance).all()  # the means of the dataset stay right
    found = data.sky.interp(azimuth=[33.0, 71.0], elevation=[20.0, 60.0])
    sun = replace(full, night_radiance=None)  # layers are interpolated each for itself
    for azimuth, elevation, there in (
        ([33.0, 71.0], [20.0, 60.0], found),
        *((a, 15.0, data.sky.interp(azimuth=a, elevation=15.0)) for a in (358.5, -1.5, 718.5)),
        (data.azimuth.values, 90.0, data.sky.interp(elevation=90.0)),
    ):
        right = sun.sample(*np.meshgrid(elevation, azimuth, indexing="ij")).reshape(there.sun_normalised_radiance.shape)
        assert np.allclose(there.sun_normalised_radiance, right, rtol=1e-5)
        assert np.array_equal(there.azimuth, azimuth)
    zenith = data.sky.interp(elevation=90.0)
    right = full.sample_fractional_stokes(np.full(36, 90.0), full.azimuth_deg)
    total = zenith.radiance / zenith.solar_irradiance
    assert np.allclose(zenith.sun_normalised_radiance_q / total, right[:, 0], atol=1e-4)
    assert np.allclose(zenith.sun_normalised_radiance_u / total, right[:, 1], atol=1e-4)
    horizon = data.sky.interp(elevation=0.0, azimuth=0.0).radiance
    assert np.allclose(horizon, full.sample(0.0, 0.0) * full.solar_irradiance, rtol=0.05)
    assert np.isnan(data.sky.interp(elevation=-1.0, azimuth=0.0).radiance).all()
    # a path over the sky, and other coordinates with it
    path = {n: xr.DataArray(v, dims="step") for n, v in (("elevation", [10.0, 50.0]), ("azimuth", [355.0, 365.0]))}
    assert data.sky.interp(**path, wavelength=600.0).radiance.dims == ("step",)


def test_half_skies_are_whole_ones_where_they_are_interpolated(sky):
    """U would have the same sign on both sides of the sun."""
    data = every_layer(sky).to_xarray()
    even = replace(sky, sun_normalised_radiance=0.5 * (sky.sun_normalised_radiance
                   + np.roll(sky.sun_normalised_radiance[:, ::-1], 1, axis=1))).to_xarray()  # fmt: skip
    half = even.isel(azimuth=slice(0, 19)).assign_attrs(azimuth_count="36")
    for azimuth in (3.0, 183.0, 358.5):
        right = even.sky.interp(azimuth=azimuth, elevation=22.0).sun_normalised_radiance
        assert np.allclose(half.sky.interp(azimuth=azimuth, elevation=22.0).sun_normalised_radiance, right)
    u = "sun_normalised_radiance_u"
    one_side = data.isel(azimuth=slice(0, 19)).assign_attrs(azimuth_count="36")
    assert np.allclose(one_side.sky.interp(azimuth=-20, elevation=15)[u], -data[u].sel(azimuth=20, elevation=15))


METHODS = {
    "interp": lambda d: d.sky.interp(elevation=22.0, azimuth=[-40.0, 3.0, 200.0]).luminance,
    "luminance_at": lambda d: d.sky.luminance_at(22.0, 200.0),
    "magnitude": lambda d: d.sky.magnitude("V", 22.0, 200.0),
    "radiance_in": lambda d: d.sky.radiance_in("photopic", 22.0, 200.0),
    "illuminance_lux": lambda d: d.sky.illuminance_lux(),
    "measure": lambda d: d.sky.measure("luminance", 22.0, 200.0),
    "scene": lambda d: d.sky.scene().luminance_at(22.0, 200.0),
}
"""Every method that reads a sky between its samples."""


@pytest.mark.parametrize("method", METHODS)
def test_every_method_knows_the_whole_sky_of_a_dataset_or_refuses(sky, method):
    """Azimuths from -180 to 180, rows downwards or chunks would be another sky, a part of it the whole."""
    asked, whole = METHODS[method], sky.to_xarray()
    right = np.asarray(asked(whole), float)
    turned = whole.assign_coords(azimuth=(whole.azimuth + 180) % 360 - 180)
    foreign = whole.drop_vars(["azimuth_bnds", "elevation_bnds"])
    same = {
        "turned": turned,
        "turned and sorted": turned.sortby("azimuth"),
        "rolled": whole.roll(azimuth=5, roll_coords=True),
        "downwards": whole.sortby("elevation", ascending=False),
        "without bounds": foreign.assign_coords(azimuth=(foreign.azimuth + 180) % 360 - 180).sortby("azimuth"),
        "in radians": whole.assign_coords(azimuth=("azimuth", np.radians(whole.azimuth.data), {"units": "radian"})),
        "chunks": whole.chunk(elevation=2, azimuth=7, wavelength=1),
    }
    for name, data in same.items():
        np.testing.assert_allclose(np.asarray(asked(data), float), right, rtol=1e-6, err_msg=name)
    half = whole.isel(azimuth=slice(0, 19)).assign_attrs(azimuth_count="36")
    parts = (
        whole.isel(azimuth=[0]), whole.isel(azimuth=[0, 18]), whole.isel(azimuth=slice(0, 30)),
        whole.isel(azimuth=slice(None, None, 2)), whole.isel(elevation=slice(0, 4)), whole.isel(elevation=[3]),
        whole.sel(elevation=slice(20, 90)), half.isel(azimuth=slice(0, 12)), foreign.isel(azimuth=slice(0, 30)),
        foreign.isel(azimuth=[0]), foreign.isel(elevation=slice(3, 6)),
    )  # fmt: skip
    for data in parts:
        with pytest.raises(TwilightError, match="a part of its sky"):
            asked(data)
    with pytest.raises(TwilightError, match="are its angles degrees"):
        asked(whole.assign_coords(azimuth=np.radians(whole.azimuth.data)))


def test_luminance_is_that_of_each_sample(sky):
    """A part of a sky would have no luminance in its own directions."""
    whole = sky.to_xarray()
    np.testing.assert_allclose(whole.sky.luminance(), sky.luminance())
    np.testing.assert_allclose(whole.isel(azimuth=[3, 5]).sky.luminance(), sky.luminance()[:, [3, 5]])


def test_skies_are_subtracted_and_divided(sky, drawing):
    """A difference would be labelled, drawn or interpolated wrongly."""
    brighter = replace(sky, sun_normalised_radiance=2.0 * sky.sun_normalised_radiance, sun_elevation_deg=7.0)
    difference, ratio = brighter - sky, brighter / sky
    assert np.allclose(difference.radiance, sky.radiance) and np.allclose(difference.luminance(), sky.luminance())
    assert np.allclose(ratio.radiance, 2.0) and np.allclose((sky / brighter).luminance(), 0.5)
    assert "difference of skies, suns at +7.00 and +5.00 deg" in repr(difference)
    data = difference.to_xarray()
    assert data.radiance.attrs == {"long_name": "difference of radiance", "units": "W m-2 nm-1 sr-1"}
    assert ratio.to_xarray().luminance.attrs["units"] == "1" and np.allclose(data.luminance, sky.luminance())
    for made, label in ((difference, "difference of luminance"), (ratio, "ratio of luminance")):
        for projection in ("fisheye", "wide", "cube"):
            picture, scale = made.plot(projection, width=80).axes
            assert label in scale.get_ylabel() and "minus sun +5.0" in picture.get_title().replace("over", "minus")
            shown = np.asarray(picture.images[0].get_array(), float)
            assert np.isfinite(shown).mean() > 0.2 and np.isnan(shown[-1, 0])
    assert np.nanmin(np.ma.filled(ratio.plot(wavelength_nm=550).axes[0].images[0].get_array(), np.nan)) > 1.99
    with pytest.raises(TwilightError, match=r"600 is none of the skies' \(450, 550, 650\)"):
        ratio.plot(wavelength_nm=600)
    with pytest.raises(TwilightError, match=r"different wavelengths \(3 from 450 to 650 nm and 7 from 400 to 700 nm\)"):
        sky - glow_sky(step_deg=10.0)
    other = glow_sky(step_deg=15.0, wavelength_nm=(450.0, 550.0, 650.0))
    read = other.sample(sky.elevation_deg[:, None], sky.azimuth_deg) * other.solar_irradiance
    assert np.allclose((sky / other).radiance, sky.radiance / read)
    with pytest.raises(TypeError):
        sky - 1.0


def test_every_projection_draws_the_sky_with_the_sun_where_it_is():
    """A picture would show the sun elsewhere, or a ground brighter than it."""
    sky = glow_sky(step_deg=3.0, glow_elevation_deg=20.0, width_deg=4.0, sun_elevation_deg=20.0)
    rows, flat = np.linspace(19.7, 20.3, 61), np.ones(sky.wavelength_nm.size)
    disc = Disc(sky.wavelength_nm, rows, rows[:, None] * flat, np.ones((61, 7)), 20.0, 0.2665)
    for name in ("wide", *PROJECTIONS):
        light = render_view(sky, view=name, width=400)[0].sum(axis=2)
        elevation, azimuth = (np.broadcast_to(v, light.shape) for v in view_directions(name, 400))
        glow = direction(azimuth, elevation) @ direction(0.0, 20.0)
        assert np.nanmax(np.where(glow > np.cos(np.radians(3.0)), light, np.nan)) == np.nanmax(light), name
        dark = {"view": name, "width": 400, "exposure": 20.0}
        changed = np.abs(render_view(replace(sky, disc=disc), **dark)[0] - render_view(sky, **dark)[0]).sum(axis=2)
        assert np.nanmax(changed) > 0.5 and np.degrees(np.arccos(glow[changed > 1e-3].min())) < 2.0, name
