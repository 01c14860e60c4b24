"""One table of types, and every public function with it: numbers, times and places of all libraries are one thing."""

import inspect
from datetime import UTC, datetime
from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest
import xarray as xr
from astropy import units as u
from astropy.time import Time
from astropy.utils.masked import Masked
from closed_sky import closed
from threadpoolctl import threadpool_info, threadpool_limits
from toy_sky import glow_sky

import twilight
import twilight.api.accessor
from twilight import solvers
from twilight.api.arguments import places_of, times_of
from twilight.base.arguments import unit_in
from twilight.base.errors import TwilightError
from twilight.sky.sky import Sky
from twilight.solvers.analytic import preetham

FAST = {"solver": "preetham", "settings": {"texture.resolution_deg": 15, "wavelengths.list_nm": [450, 550, 650]}}
ASTROPY = {"deg": u.deg, "km": u.km, "nm": u.nm}
OTHER = {"deg": u.rad, "km": u.m, "nm": u.um}
WORDS = {"deg": "rad", "km": "m", "nm": "um"}


def test_products_of_matrices_take_one_thread_in_all_that_people_call(monkeypatch):
    """On a busy machine each of the products below would wait twenty times as long for a second thread."""
    counts = {}
    deep = {
        "resolve": (solvers, "load"),
        "solve": (preetham, "prepare"),
        "ask": (preetham.PreethamField, "radiance"),
        "read": (Sky, "_sample"),
    }

    def watched(name, function):
        def called(*arguments, **more):
            counts[name] = max(one["num_threads"] for one in threadpool_info() if one["user_api"] == "blas")
            return function(*arguments, **more)

        return called

    for name, (where, attribute) in deep.items():
        monkeypatch.setattr(where, attribute, watched(name, getattr(where, attribute)))
    with threadpool_limits(2, user_api="blas"):
        twilight.solve("pure-air", sun_elevation_deg=20.0, **FAST).radiance(20.0, 30.0, 10.0)
        twilight.render("pure-air", sun_elevation_deg=20.0, **FAST).sample(30.0, 10.0)
    assert counts == dict.fromkeys(deep, 1)


def same(value, unit):
    """A number as it comes from elsewhere."""
    yield np.float64(value)
    yield np.array(value)
    yield np.ma.masked_array(value, mask=False)
    yield xr.DataArray(value)
    yield xr.DataArray(value).chunk()
    yield xr.DataArray(value, attrs={"units": unit})
    yield value * ASTROPY[unit]
    yield (value * ASTROPY[unit]).to(OTHER[unit])
    yield Masked((value * ASTROPY[unit]).to(OTHER[unit]))
    there = (value * ASTROPY[unit]).to_value(OTHER[unit])
    yield xr.DataArray(there, attrs={"units": WORDS[unit]})
    yield xr.DataArray(there * OTHER[unit])


def same_of_several(values, unit):
    """Several numbers as they come from elsewhere."""
    yield np.array(values)
    yield pd.Series(values)
    yield pd.Series(values, index=range(7, 7 + len(values)), dtype="Float64")
    yield pd.Index(values)
    yield np.ma.masked_array(values, mask=[False] * len(values))
    yield xr.DataArray(values, dims="n").chunk(1)
    yield (values * ASTROPY[unit]).to(OTHER[unit])
    yield [(one * ASTROPY[unit]).to(OTHER[unit]) for one in values]


def refused(value, unit):
    """What is no number of the unit."""
    yield Masked(value * ASTROPY[unit], mask=True)
    yield np.ma.masked_array(value, mask=True)
    yield value * u.s
    yield xr.DataArray(value, attrs={"units": "furlong"})
    yield np.nan
    yield pd.NA
    yield pd.Series([value, None], dtype="Float64")
    yield True
    yield "low"
    yield 1j
    yield np.datetime64("2026-06-21")
    yield pd.NaT
    yield {"deg": value}


SKY = glow_sky(step_deg=10.0, sun_elevation_deg=5.0, night_radiance=None)
DATA = SKY.to_xarray()
FIELD = closed("closed air")
PLACE = (52.5, 13.4)
EVENING = "2026-06-21T20:00Z"
ONE = {
    "Sky.sample elevation": ("deg", 20.0, lambda v: SKY.sample(v, 10.0)),
    "Sky.sample azimuth": ("deg", 20.0, lambda v: SKY.sample(10.0, v)),
    "Sky.luminance_at": ("deg", 20.0, lambda v: SKY.luminance_at(v, 10.0)),
    "Sky.radiance_in": ("deg", 20.0, lambda v: SKY.radiance_in("photopic", 30.0, v)),
    "Sky.measure": ("deg", 20.0, lambda v: SKY.measure("luminance", v)),
    "Sky.resample": ("deg", 20.0, lambda v: SKY.resample(v, [0.0, 120.0, 240.0]).radiance),
    "SkySeries.radiance_in": ("deg", 20.0, lambda v: twilight.SkySeries([SKY]).radiance_in("photopic", v)),
    "Sky": ("deg", 20.0, lambda v: glow_sky(step_deg=30.0, sun_elevation_deg=v).sun_elevation_deg),
    "accessor.luminance_at": ("deg", 20.0, lambda v: DATA.sky.luminance_at(v, 10.0)),
    "accessor.measure": ("deg", 20.0, lambda v: DATA.sky.measure("luminance", 30.0, v)),
    "accessor.interp": ("deg", 20.0, lambda v: DATA.sky.interp(elevation=30.0, azimuth=v).luminance),
    "Field.radiance sun": ("deg", 20.0, lambda v: FIELD.radiance(v, 30.0, 10.0)),
    "Field.radiance": ("deg", 20.0, lambda v: FIELD.radiance(5.0, v, 10.0)),
    "Field.radiance observer": ("km", 2.0, lambda v: FIELD.radiance(5.0, 30.0, 10.0, v)),
    "Field.measure": ("deg", 20.0, lambda v: FIELD.measure("luminance", 5.0, 30.0, v)),
    "Field.direct": ("deg", 20.0, lambda v: FIELD.direct(v).irradiance),
    "Field.illuminance_lux": ("deg", 20.0, lambda v: FIELD.illuminance_lux(v)),
    "Direction": ("deg", 20.0, lambda v: twilight.Direction(v).elevation_deg),
    "Surface": ("deg", 20.0, lambda v: twilight.Surface("plane", v).tilt_deg),
    "render": ("deg", 20.0, lambda v: twilight.render("pure-air", sun_elevation_deg=v, **FAST).radiance),
    "render altitude": (
        "km", 0.5,
        lambda v: twilight.render("pure-air", sun_elevation_deg=9, altitude_km=v, **FAST).observer_altitude_km,
    ),
    "render latitude": (
        "deg", 20.0,
        lambda v: twilight.render(
            "pure-air", at="2026-06-21T10:00Z", latitude_deg=v, longitude_deg=9.0, **FAST).sun_elevation_deg,
    ),
    "light towards": ("deg", 20.0, lambda v: twilight.light(PLACE, EVENING, (v, 10.0), "luminance")),
    "light place": ("deg", 50.0, lambda v: twilight.light((v, 13.4), EVENING, "zenith", "luminance")),
    "medium": ("nm", 550.0, lambda v: twilight.medium("pure-air", v).optical_depth()),
}  # fmt: skip
"""The unit of an argument, a number, and what a public function finds for it."""
SEVERAL = {
    "Sky.sample": ("deg", [20.0, 50.0], lambda v: SKY.sample(v, 10.0)),
    "Sky.magnitude": ("deg", [20.0, 50.0], lambda v: SKY.magnitude("V", 30.0, v)),
    "Sky.magnitude response": ("nm", [500.0, 600.0], lambda v: SKY.magnitude((v, [1.0, 1.0]))),
    "Field.stokes": ("deg", [20.0, 50.0], lambda v: FIELD.radiance(5.0, v, 10.0)),
    "accessor.interp": ("deg", [20.0, 50.0], lambda v: DATA.sky.interp(elevation=v).luminance),
    "render": ("deg", [20.0, 50.0], lambda v: twilight.render("pure-air", sun_elevation_deg=v, **FAST)[1].radiance),
    "render wavelengths": (
        "nm", [450.0, 550.0],
        lambda v: twilight.render("pure-air", sun_elevation_deg=9, solver="preetham", wavelength_nm=v).radiance,
    ),
    "solve": (
        "deg", [20.0, 50.0],
        lambda v: twilight.solve("pure-air", sun_elevation_deg=v, **FAST).radiance(20.0, 30.0, 10.0),
    ),
    "skies": ("deg", [20.0, 50.0], lambda v: twilight.skies(["pure-air"], v, [30.0], 0.0).radiance),
    "light": ("deg", [20.0, 50.0], lambda v: twilight.light(PLACE, EVENING, (v, [10.0, 20.0]), "luminance")),
    "light places": ("deg", [20.0, 50.0, 60.0], lambda v: twilight.light((np.array([1.0, 2.0, 3.0]), v), EVENING)),
    "medium": ("nm", [450.0, 550.0], lambda v: twilight.medium("pure-air", v).optical_depth()),
}  # fmt: skip


def numbers(found):
    return np.asarray(found, float)


@pytest.mark.parametrize("name", ONE)
def test_a_number_of_any_library_is_that_number(name):
    """Radians would be read as degrees."""
    unit, value, asked = ONE[name]
    right = numbers(asked(value))
    for given in same(value, unit):
        np.testing.assert_allclose(numbers(asked(given)).reshape(right.shape), right, rtol=1e-9, err_msg=repr(given))


@pytest.mark.parametrize("name", SEVERAL)
def test_several_numbers_of_any_library_are_those_numbers(name):
    """An array of another library would be read in another unit or order."""
    unit, values, asked = SEVERAL[name]
    right = numbers(asked(values))
    for given in same_of_several(values, unit):
        np.testing.assert_allclose(numbers(asked(given)).reshape(right.shape), right, rtol=1e-9, err_msg=repr(given))
    last = [False] * (len(values) - 1) + [True]
    masked = np.ma.masked_array(values, mask=last)
    for given in (masked, Masked(values * ASTROPY[unit], mask=last), [*values[1:], np.nan], [*values[1:], None]):
        with pytest.raises(TwilightError) as error:
            asked(given)
        assert "\n" not in str(error.value)


@pytest.mark.parametrize("name", ONE)
def test_what_is_no_number_of_the_unit_is_one_sentence(name):
    """Masked or missing numbers would count, or end in a traceback."""
    unit, value, asked = ONE[name]
    for given in refused(value, unit):
        with pytest.raises(TwilightError) as error:
            asked(given)
        assert "\n" not in str(error.value) and len(str(error.value)) < 400, repr(given)


def test_numbers_of_single_precision_are_nearly_the_same():
    """float32 would be refused."""
    for unit, value, asked in (ONE["Sky.sample elevation"], ONE["render"], ONE["light towards"], ONE["Direction"]):
        np.testing.assert_allclose(numbers(asked(np.float32(value))), numbers(asked(value)), rtol=1e-5)
        assert unit == "deg"


def test_data_arrays_go_together_by_their_dimensions():
    """Directions would be paired by their place in arrays of other dimensions."""
    rows, columns = xr.DataArray([20.0, 50.0], dims="row"), xr.DataArray([0.0, 90.0], dims="column")
    right = SKY.sample([[20.0, 20.0], [50.0, 50.0]], [[0.0, 90.0], [0.0, 90.0]])
    np.testing.assert_allclose(SKY.sample(rows, columns), right)
    assert SKY.sample(rows, columns.rename(column="row")).shape == (2, 7)
    assert FIELD.radiance(5.0, rows, columns).shape == (2, 2, 8)


def test_every_public_function_takes_its_numbers_by_the_rule():
    """A public function with angles would be forgotten."""
    own = {"Climate", "Config", "Medium", "TwilightError", "TwilightWarning"}  # sections of YAML, results
    public = [getattr(twilight, name) for name in twilight.__all__ if name not in own]
    methods = [m for c in public if inspect.isclass(c) and c.__name__ != "Estimate" for m in vars(c).values()]
    with_units = [
        f for f in (*public, *methods, *vars(twilight.api.accessor.SkyAccessor).values())
        if inspect.isfunction(f) and f.__name__[:1] != "_" and any(map(unit_in, inspect.signature(f).parameters))
    ]  # fmt: skip
    passed_on = {"luminance_at", "magnitude", "measure", "radiance_in"}  # of Sky, by Sky.sample
    assert len(with_units) > 25
    assert {f.__name__ for f in with_units if not hasattr(f, "__wrapped__")} <= passed_on


UTC_TIMES = [datetime(2026, 6, 21, hour, tzinfo=UTC) for hour in (10, 11)]
NAIVE = np.array(["2026-06-21T12:00", "2026-06-21T13:00"], "datetime64[ns]")
TIMES = {
    "datetimes": UTC_TIMES,
    "text": ["2026-06-21T10:00Z", "2026-06-21T13:00+02:00"],
    "pandas": pd.DatetimeIndex(UTC_TIMES).tz_convert("Europe/Berlin"),
    "series": pd.Series(pd.DatetimeIndex(UTC_TIMES).tz_convert("Asia/Tokyo")),
    "astropy": Time([t.replace(tzinfo=None) for t in UTC_TIMES], scale="utc").tai,
    "numpy": NAIVE,
    "xarray": xr.DataArray(NAIVE, dims="time"),
    "dask": xr.DataArray(NAIVE, dims="time").chunk(1),
    "each of xarray's": list(xr.DataArray(NAIVE, dims="t")),
}


@pytest.mark.parametrize("name", TIMES)
def test_times_of_any_library_are_those_times(name):
    """A time of another library would be refused with its repr, or read in another zone."""
    options = {"time_zone": "Europe/Berlin"}
    right = twilight.light(PLACE, UTC_TIMES, "zenith", "luminance")
    for given, several in ((TIMES[name], True), (next(iter(TIMES[name])), False)):
        found = twilight.light(PLACE, given, "zenith", "luminance", **options)
        assert (found.dims == ("time",)) == several
        np.testing.assert_allclose(np.atleast_1d(found), right[: np.size(found)], rtol=1e-9)
        sky = twilight.render("pure-air", at=given, place=PLACE, **FAST, **options)
        assert len(sky) == 2 if several else sky.time == UTC_TIMES[0]


@pytest.mark.parametrize(
    "at",
    [
        pd.NaT,
        np.datetime64("NaT"),
        None,
        pd.DatetimeIndex(["2026-06-21T20:00Z", None]),
        pd.Series(pd.to_datetime(["2026-06-21T20:00Z", None])),
        np.array(["2026-06-21T20:00", "NaT"], "datetime64[s]"),
        np.ma.masked_array(np.array(["2026-06-21T20:00"] * 2, "datetime64[s]"), mask=[0, 1]),
        Time(Masked(["2026-06-21T20:00", "2026-06-21T21:00"], mask=[False, True])),
        Time(Masked(2461213.3, mask=True), format="jd"),
        xr.DataArray(np.array([["2026-06-21T20:00"]], "datetime64[s]"), dims=("x", "y")),
        np.datetime64(10**12, "Y"),
        5.0,
        b"2026",
        [],
    ],
)
def test_a_missing_time_is_one_sentence(at):
    """NaT, a masked time or a table of times would be a traceback."""
    for asked in (
        lambda: twilight.light(PLACE, at, time_zone="UTC"),
        lambda: twilight.render("pure-air", at=at, place=PLACE, time_zone="UTC", **FAST),
    ):
        with pytest.raises(TwilightError) as error:
            asked()
        assert "\n" not in str(error.value) and "DataArray" not in str(error.value)


MUNICH, SYDNEY = (48.1, 11.5), (-33.9, 151.2)


ONE_AIR = {"gases.ozone.column_du": 320.0}
"""Unset, ozone is interpolated between the columns of several places."""


def test_what_depends_on_a_place_is_that_of_each_place():
    """Several places would have the dusk of the first."""
    for time, several in (("2026-06-21 civil dusk", False), (["2026-06-21 sunrise", "2026-06-21 dusk -4"], True)):
        asked = "horizontal", ["illuminance", "cct"]
        both = twilight.light([MUNICH, SYDNEY], time, *asked, settings=ONE_AIR)
        for one, place in enumerate((MUNICH, SYDNEY)):
            alone = twilight.light(place, time, *asked, settings=ONE_AIR)
            here = both.isel(place=one)
            np.testing.assert_allclose(here.illuminance_lux, alone.illuminance_lux, rtol=1e-9)
            np.testing.assert_array_equal(here["moment" if several else "time"], alone.time)
            np.testing.assert_allclose(here.solar_elevation_angle, alone.solar_elevation_angle)


def test_every_place_and_month_has_its_own_ozone():
    """A year or a map would have the ozone of its first line: 20 % of the light of dusk."""
    times = [f"2026-{month:02d}-15 civil dusk" for month in (2, 8)]
    places = [MUNICH, (8.0, 30.0)]
    asked = ["horizontal", "plane:90/180"], ["illuminance", "cct"]
    year = twilight.light(places, times, *asked)
    near = twilight.light(MUNICH, ["2026-02-15 civil dusk", "2026-02-17 civil dusk"], *asked)  # of their mean
    np.testing.assert_allclose(near.isel(time=0).illuminance_lux, year.isel(place=0, time=0).illuminance_lux, rtol=3e-3)
    for one, time in ((0, 1), (1, 1)):
        alone = twilight.light(places[one], times[time], *asked)
        here = year.isel(place=one, time=time)
        np.testing.assert_allclose(here.illuminance_lux, alone.illuminance_lux, rtol=3e-3)
        np.testing.assert_allclose(here.cct_k, alone.cct_k, rtol=2e-2)


def test_a_clock_is_that_of_its_place():
    """A time without an offset would be that of the first place's zone at all."""
    places = [SimpleNamespace(latitude=a, longitude=b, tz=zone, altitude=0.0)  # as pvlib's Location
              for (a, b), zone in ((MUNICH, "Europe/Berlin"), (SYDNEY, "Australia/Sydney"))]  # fmt: skip
    both = twilight.light(places, datetime(2026, 6, 21, 12), "horizontal", "illuminance", settings=ONE_AIR)
    for one, place in enumerate(places):
        alone = twilight.light(place, "2026-06-21T12:00", "horizontal", "illuminance", settings=ONE_AIR)
        np.testing.assert_allclose(both[one], alone, rtol=1e-9)
    with pytest.raises(TwilightError, match="has no time zone"):
        twilight.light([places[0], SYDNEY], datetime(2026, 6, 21, 12))


@pytest.mark.parametrize(
    "several",
    [
        [MUNICH, SYDNEY],
        (MUNICH, SYDNEY),
        [[48.1, 11.5], [-33.9, 151.2]],
        np.array([MUNICH, SYDNEY]),
        (np.array([48.1, -33.9]), np.array([11.5, 151.2])),
        (pd.Series([48.1, -33.9]), pd.Series([11.5, 151.2])),
        (np.radians([48.1, -33.9]) * u.rad, [11.5, 151.2] * u.deg),
        [(48.1 * u.deg, 11.5 * u.deg), SYDNEY],
    ],
)
def test_several_places_are_pairs_or_columns(several):
    """Two pairs would be read as latitudes and longitudes."""
    many, found = places_of(several, None)
    assert many and np.allclose([one[:2] for one in found], [MUNICH, SYDNEY])


@pytest.mark.parametrize(
    ("place", "words"),
    [
        (([48.1, -33.9], [11.5, 151.2]), "may be two places or latitudes and longitudes"),
        ([], "none is given"),
        (None, "none is given"),
        ("Berlin", "must be"),
        ((48.1,), "must be"),
        ((48.1, np.nan), "finite"),
        ((np.ma.masked, 11.5), "place"),
        ((np.array([1.0, 2.0, 3.0]), np.array([1.0, 2.0])), "as many"),
        ((95.0, 11.5), "not a latitude"),
        ((48.1 * u.km, 11.5), "takes deg"),
    ],
)
def test_what_is_no_place_is_one_sentence(place, words):
    """A place that may be read in two ways would be read in one of them."""
    with pytest.raises(TwilightError, match=words):
        places_of(place, None)


def test_a_list_of_two_numbers_is_one_place_and_one_time_is_one():
    """[48.1, 11.5] would be two places."""
    assert places_of([48.1, 11.5], None)[0] is False and places_of(np.array(MUNICH), None)[0] is False
    assert times_of(np.datetime64("2026-06-21T20:00"))[0] is False and times_of(np.array(["2026-06-21T20:00"]))[0]
