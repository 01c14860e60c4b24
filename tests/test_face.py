"""`import twilight` alone suffices for a sky."""

from __future__ import annotations

from datetime import UTC, datetime, timedelta

import numpy as np
import pytest

import twilight

SMALL = {"texture.resolution_deg": 15, "wavelengths.list_nm": [450, 550, 650]}
FEW = {"solver": "preetham", "settings": SMALL}
BERLIN = {"latitude_deg": 52.5, "longitude_deg": 13.4}


def test_a_sky_in_one_line():
    sky = twilight.render("continental-average", sun_elevation_deg=30, **FEW)
    assert isinstance(sky, twilight.Sky) and sky.sun_elevation_deg == 30 and sky.illuminance_lux() > 1000
    several = twilight.render("continental-average", sun_elevation_deg=[30, 60], **FEW)
    assert [one.sun_elevation_deg for one in several] == [30, 60]
    assert np.array_equal(several[0].radiance, sky.radiance)


@pytest.fixture(scope="module")
def noon():
    """Elevation and azimuth of the sun in Berlin at 12:00 of its clocks, from a time with its offset."""
    sky = twilight.render("continental-average", at="2026-06-21T12:00+02:00", **BERLIN, **FEW)
    assert 55 < sky.sun_elevation_deg < 62
    return sky.sun_elevation_deg, sky.sun_azimuth_deg


def times():
    naive = datetime(2026, 6, 21, 12)
    yield naive, "Europe/Berlin"
    yield naive.isoformat(), "Europe/Berlin"
    yield naive.replace(tzinfo=UTC) - timedelta(hours=2), None
    yield np.datetime64("2026-06-21T10:00:00.000000000"), "UTC"
    pandas = pytest.importorskip("pandas")
    yield pandas.Timestamp(naive, tz="Europe/Berlin"), None
    yield pandas.Timestamp(naive), "Europe/Berlin"
    time = pytest.importorskip("astropy.time")
    yield time.Time("2026-06-21T10:00:00", scale="utc"), None
    yield time.Time("2026-06-21T10:00:00", scale="utc").tai, None


def test_a_time_of_any_kind_is_the_same_sun(noon):
    for at, zone in times():
        sky = twilight.render("continental-average", at=at, time_zone=zone, **BERLIN, **FEW)
        assert (sky.sun_elevation_deg, sky.sun_azimuth_deg) == pytest.approx(noon, abs=1e-6), repr(at)


def test_places_of_pvlib_and_astropy(noon):
    from pvlib.location import Location

    place = Location(52.5, 13.4, tz="Europe/Berlin", altitude=34)
    sky = twilight.render("continental-average", at="2026-06-21T12:00", place=place, **FEW)
    assert (sky.sun_elevation_deg, sky.sun_azimuth_deg) == pytest.approx(noon, abs=1e-3)
    assert sky.observer_altitude_km == 0.034 and sky.latitude_deg == 52.5
    coordinates = pytest.importorskip("astropy.coordinates")
    place = coordinates.EarthLocation.from_geodetic(lon=13.4, lat=52.5, height=0)
    sky = twilight.render("continental-average", at="2026-06-21T10:00Z", place=place, **FEW)
    assert (sky.sun_elevation_deg, sky.sun_azimuth_deg) == pytest.approx(noon, abs=1e-6)
    assert sky.observer_altitude_km == 0.0


def test_several_times_at_equal_steps_are_a_series(noon):
    begin = datetime(2026, 6, 21, 10, tzinfo=UTC)
    moments = [begin + timedelta(minutes=20 * i) for i in range(3)]
    several = [moments, np.array([m.replace(tzinfo=None) for m in moments], "datetime64[s]")]
    several.append(pytest.importorskip("pandas").date_range(begin, periods=3, freq="20min"))
    several.append(pytest.importorskip("astropy.time").Time(moments))
    for at in several:
        skies = twilight.render("continental-average", at=at, time_zone="UTC", **BERLIN, **FEW)
        assert [sky.time for sky in skies] == moments
        assert skies[0].sun_elevation_deg == pytest.approx(noon[0], abs=1e-6)
    with pytest.raises(twilight.TwilightError, match="equally far"):
        twilight.render("continental-average", at=[moments[0], moments[2], moments[1]], **BERLIN, **FEW)
    with pytest.raises(twilight.TwilightError, match="must be datetimes"):
        twilight.render("continental-average", at=["2026-06-21T10:00Z", "2026-06-21T11:00Z"], **BERLIN, **FEW)


def test_a_field_answers_for_any_sun_and_is_that_of_render():
    field = twilight.solve("continental-average", wavelength_nm=[450, 550, 650], solver="preetham")
    sky = twilight.render("continental-average", sun_elevation_deg=30, wavelength_nm=[450, 550, 650], **FEW)
    e, a = np.meshgrid(sky.elevation_deg, sky.azimuth_deg, indexing="ij")
    assert field.radiance(30.0, e, a) == pytest.approx(sky.sun_normalised_radiance, rel=1e-12)
    assert field.radiance(60.0, 45.0, 90.0).shape == (3,)
    assert np.array_equal(field.sky(30.0, sky.elevation_deg, sky.azimuth_deg).radiance, sky.radiance)
    config = twilight.load("continental-average", {"solver.name": "preetham", "ground.albedo": 0.7, **SMALL})
    assert twilight.solve(config).problem.medium.ground_albedo[0] == 0.7
    assert twilight.solve(config, quality="standard").problem.medium.ground_albedo[0] == 0.7
    twilight.render(config, sun_elevation_deg=20)


def test_what_is_offered_is_there_and_nothing_else():
    assert set(twilight.__all__) == set(dir(twilight)) and all(hasattr(twilight, name) for name in twilight.__all__)
    with pytest.raises(AttributeError):
        twilight.nothing  # noqa: B018


@pytest.mark.parametrize(
    ("question", "says"),
    [
        ({"sun_elevation_deg": 1, "at": "2026-06-21T12:00"}, "either sun_elevation_deg or at"),
        ({"sun_elevation_deg": "high"}, "sun_elevation_deg: must be a number"),
        ({"latitude_deg": 3}, "a place needs a time"),
        ({"at": "2026-06-21T12:00Z", "place": "Berlin"}, "place: must be pvlib's Location"),
        ({"at": "2026-06-21T12:00Z", "place": "Berlin", "latitude_deg": 3}, "either place or latitude_deg"),
        ({"at": "noon", **BERLIN}, "must be a date and time"),
        ({"at": "2026-06-21T12:00", **BERLIN}, "time_zone"),
    ],
)
def test_a_wrong_question_is_one_sentence(question, says):
    with pytest.raises(twilight.TwilightError, match=says):
        twilight.render("urban", **question)
