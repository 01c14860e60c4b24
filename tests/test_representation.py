"""How skies and models show themselves, and the accessor of xarray's datasets: the same figures everywhere."""

from __future__ import annotations

import base64
import io
import re
from dataclasses import replace
from datetime import UTC, datetime, timedelta
from importlib.resources import files

import numpy as np
import pytest
import xarray as xr
from toy_sky import glow_sky

from twilight.api.representation import SkySeries, open_dataset
from twilight.base.errors import TwilightError
from twilight.io.netcdf import write_sky
from twilight.solvers.compact.compact_sky import CompactSky


@pytest.fixture(scope="module")
def sky():
    made = glow_sky(step_deg=10.0, wavelength_nm=(450.0, 550.0, 650.0), direct_irradiance=np.full(3, 0.1))
    configuration = {"climate": {"name": "air"}}
    return replace(made, provenance={"solver": "toy", "quality": "draft", "configuration": configuration})


def test_representations_are_five_lines(sky):
    model = CompactSky.load(files("twilight") / "data/compact/continental-average.npz")
    for made in (sky, model):
        assert len(repr(made).splitlines()) == 5 and max(map(len, repr(made).splitlines())) <= 110
    assert "sun at +5.00 deg, by toy (draft)" in repr(sky) and "9 elevations 5 to 85 deg" in repr(sky)
    assert f"{sky.illuminance_lux():.4g} lx" in repr(sky) and f"{sky.magnitude():.2f} V mag" in repr(sky)
    assert "continental-average" in repr(model) and "-18 to 90 deg" in repr(model)


def test_a_notebook_sees_a_picture_and_figures(sky):
    from PIL import Image

    text = sky._repr_html_()
    data = re.search(r"base64,([^\"]+)", text)[1]
    picture = np.asarray(Image.open(io.BytesIO(base64.b64decode(data))))
    assert picture.shape[1] == 480 and picture.std() > 5
    assert "air" in text and "lx" in text and "V mag arcsec^-2" in text


@pytest.mark.parametrize("projection", ("wide", "panorama", "fisheye"))
def test_a_sky_draws_itself(sky, projection):
    import matplotlib

    matplotlib.use("Agg")
    from matplotlib import pyplot

    figure = sky.plot(projection, width=80)
    axes = figure.axes[0]
    figure.savefig(io.BytesIO(), format="png")
    assert axes.images[0].get_array().shape[1] == 80 and "sun +5.0" in axes.get_title()
    assert sky.plot(projection, ax=axes, width=80) is figure
    pyplot.close("all")


def test_magnitude_and_luminance_are_those_of_the_direction(sky):
    assert sky.luminance_at(45.0, 10.0) == pytest.approx(sky.luminance()[4, 1])
    assert sky.magnitude("V", 45.0, 10.0) == pytest.approx(-2.5 * np.log10(sky.luminance_at(45.0, 10.0) / 10.8e4))
    with pytest.raises(TwilightError, match="the band 'B' is not known"):
        sky.magnitude("B")


def test_one_dataset_says_what_its_sky_says(sky):
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
        sky,
        night_radiance=np.full(grid.shape, 1e-6),
        standard_error=0.01 * grid,
        polarisation=0.1 * np.stack([grid, -grid], axis=2),
        polarisation_error=0.01 * np.stack([grid, grid], axis=2),
        apparent_sun_elevation_deg=5.2,
        sun_azimuth_deg=280.0,
        latitude_deg=52.5,
        longitude_deg=13.4,
        observer_altitude_km=0.1,
        time=datetime(2026, 6, 21, 20, tzinfo=UTC),
    )


def test_axes_are_a_few_words_with_a_unit_and_time_is_a_time(sky, tmp_path):
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
