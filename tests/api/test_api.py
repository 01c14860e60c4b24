"""`import twilight` alone suffices for a sky."""

import ast
from datetime import UTC, datetime, timedelta
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

import twilight

SMALL = {"texture.resolution_deg": 15, "wavelengths.list_nm": [450, 550, 650]}
FEW = {"solver": "preetham", "settings": SMALL}
BERLIN = {"latitude_deg": 52.5, "longitude_deg": 13.4}


def test_a_sky_in_one_line():
    """`import twilight` alone would not give a sky."""
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
    """A time of another library would be read in another zone."""
    for at, zone in times():
        sky = twilight.render("continental-average", at=at, time_zone=zone, **BERLIN, **FEW)
        assert (sky.sun_elevation_deg, sky.sun_azimuth_deg) == pytest.approx(noon, abs=1e-6), repr(at)


def test_places_are_those_of_pvlib_and_astropy_or_a_pair_of_numbers(noon):
    """Latitude and longitude would be swapped."""
    place = SimpleNamespace(latitude=52.5, longitude=13.4, tz="Europe/Berlin", altitude=34)  # as pvlib's Location
    sky = twilight.render("continental-average", at="2026-06-21T12:00", place=place, **FEW)
    assert (sky.sun_elevation_deg, sky.sun_azimuth_deg) == pytest.approx(noon, abs=1e-3)
    assert sky.observer_altitude_km == 0.034 and sky.latitude_deg == 52.5
    sky = twilight.render("continental-average", at="2026-06-21T12:00+02:00", place=(52.5, 13.4), **FEW)
    assert (sky.sun_elevation_deg, sky.sun_azimuth_deg) == pytest.approx(noon, abs=1e-9)
    coordinates = pytest.importorskip("astropy.coordinates")
    place = coordinates.EarthLocation.from_geodetic(lon=13.4, lat=52.5, height=0)
    sky = twilight.render("continental-average", at="2026-06-21T10:00Z", place=place, **FEW)
    assert (sky.sun_elevation_deg, sky.sun_azimuth_deg) == pytest.approx(noon, abs=1e-6)
    assert sky.observer_altitude_km == 0.0


def test_several_times_are_a_series(noon):
    """Times would lose their order or their zone."""
    begin = datetime(2026, 6, 21, 10, tzinfo=UTC)
    moments = [begin + timedelta(minutes=20 * i) for i in range(3)]
    several = [moments, np.array([m.replace(tzinfo=None) for m in moments], "datetime64[s]")]
    several.append(pytest.importorskip("pandas").date_range(begin, periods=3, freq="20min"))
    several.append(pytest.importorskip("astropy.time").Time(moments))
    several.append([m.isoformat() for m in moments])
    for at in several:
        skies = twilight.render("continental-average", at=at, time_zone="UTC", **BERLIN, **FEW)
        assert isinstance(skies, twilight.SkySeries) and list(skies.times) == moments
        assert [sky.time for sky in skies] == moments
        assert skies[0].sun_elevation_deg == pytest.approx(noon[0], abs=1e-6)
    uneven = [moments[0], moments[0] + timedelta(minutes=1), moments[2]]
    data = twilight.render("continental-average", at=uneven, **BERLIN, **FEW).to_xarray()
    assert data.sun_normalised_radiance.dims[0] == "time" and data.time.dtype.kind == "M"
    assert list(data.time.values) == [np.datetime64(m.replace(tzinfo=None)) for m in uneven]
    assert data.sky.magnitude("V").dims == ("time",)
    for wrong, says in (
        ([moments[0], moments[2], moments[1]], "in their order"),
        ([moments[1].isoformat(), moments[0].isoformat()], "times must be in their order"),
        ([moments[0], moments[1].replace(tzinfo=None)], "all with or all without"),
    ):
        with pytest.raises(twilight.TwilightError, match=says):
            twilight.render("continental-average", at=wrong, **BERLIN, **FEW)


def test_a_series_is_lazy_and_that_of_one_sun_is_a_series(monkeypatch):
    """A loop over suns would wait for all, or code for many break for one."""
    from twilight.api import calls

    suns, made = [5.0, 30.0, 60.0], []
    whole = calls.frames

    def counted(scene):
        for frame in whole(scene):
            made.append(frame.sky.sun_elevation_deg)
            yield frame

    monkeypatch.setattr(calls, "frames", counted)
    skies = twilight.render("urban", sun_elevation_deg=suns, **FEW)
    assert len(skies) == 3 and made == [] and "0 computed" in repr(skies)
    assert skies[1].sun_elevation_deg == 30.0 and made == suns[:2]
    assert [sky.sun_elevation_deg for sky in skies[::-1]] == suns[::-1] and made == suns
    assert skies[0] is skies[-3]
    with pytest.raises(IndexError):
        skies[3]
    data = skies.to_xarray()
    assert list(data.sun_elevation_deg.values) == suns
    assert np.array_equal(data.sel(sun_elevation_deg=30.0).sun_normalised_radiance, skies[1].sun_normalised_radiance)
    one = twilight.render("urban", sun_elevation_deg=[60.0], **FEW)
    assert isinstance(one, twilight.SkySeries) and len(one) == 1
    assert np.array_equal(one[0].radiance, skies[2].radiance)


def test_sample_and_luminance_agree_about_the_night():
    """One of two figures would forget the night."""
    settings = {**SMALL, "night.airglow": 1.0, "omit_negligible": False}
    sky = twilight.render("continental-average", sun_elevation_deg=0, solver="preetham", settings=settings)
    assert sky.night_radiance is not None
    at = sky.sample(37.0, 110.0)
    assert float(sky._luminous(at)) == pytest.approx(sky.luminance_at(37.0, 110.0), rel=1e-12)
    assert (at > sky._sample(sky.sun_normalised_radiance, 37.0, 110.0)).all()


def test_air_and_solvers_are_at_hand():
    """Air or a solver could not be had by its name."""
    air = twilight.medium("continental-average", [450, 550], {"ground.albedo": 0.5})
    assert air.wavelength_nm.tolist() == [450.0, 550.0] and air.ground_albedo[0] == 0.5
    assert np.array_equal(twilight.medium(twilight.load_climate("urban"), [550]).wavelength_nm, [550.0])
    preetham = twilight.solver("preetham")
    field = preetham.prepare(air, preetham.QUALITIES["standard"])
    assert field.radiance(30.0, 45.0, 90.0).shape == (2,)
    with pytest.raises(twilight.TwilightError, match="did you mean zones"):
        twilight.solver("zone")


def test_a_field_knows_the_air_before_an_object():
    """Bands would not be summed, or a solver of whole lines give nonsense."""
    field = twilight.solve("continental-average", wavelength_nm=[450, 550], solver="preetham")
    scattered, transmittance = field.inscatter(30.0, [5.0, 10.0], [90.0, 90.0], [5.0, 5.0])
    assert scattered.shape == transmittance.shape == (2, 2) and ((transmittance > 0) & (transmittance < 1)).all()
    with pytest.raises(twilight.TwilightError, match="whole lines of sight"):
        twilight.solve("continental-average", wavelength_nm=[550], solver="cie").inscatter(30.0, 5.0, 90.0, 5.0)


def test_a_field_answers_for_any_sun_and_is_that_of_render():
    """A field's sky would not be that of a render."""
    field = twilight.solve("continental-average", wavelength_nm=[450, 550, 650], solver="preetham")
    sky = twilight.render("continental-average", sun_elevation_deg=30, wavelength_nm=[450, 550, 650], **FEW)
    e, a = np.meshgrid(sky.elevation_deg, sky.azimuth_deg, indexing="ij")
    assert field.radiance(30.0, e, a) == pytest.approx(sky.sun_normalised_radiance, rel=1e-12)
    assert field.radiance(60.0, 45.0, 90.0).shape == (3,)
    assert np.array_equal(field.sky(30.0, sky.elevation_deg, sky.azimuth_deg).radiance, sky.radiance)
    config = twilight.load("continental-average", {"solver.name": "preetham", "ground.albedo": 0.7, **SMALL})
    assert twilight.solve(config).medium.ground_albedo[0] == 0.7
    assert twilight.solve(config, quality="standard").medium.ground_albedo[0] == 0.7
    twilight.render(config, sun_elevation_deg=20)


def test_what_is_offered_is_there_and_nothing_else():
    """The type stub would promise what is not there."""
    assert set(twilight.__all__) == set(dir(twilight)) and all(hasattr(twilight, name) for name in twilight.__all__)
    stub = Path(twilight.__file__).with_suffix(".pyi").read_text()
    assert ast.literal_eval(stub[stub.index("__all__ = ") + 10 :]) == twilight.__all__
    with pytest.raises(AttributeError):
        twilight.nothing  # noqa: B018


@pytest.mark.parametrize(
    ("question", "says"),
    [
        ({"sun_elevation_deg": 1, "at": "2026-06-21T12:00"}, "either sun_elevation_deg or at"),
        ({"sun_elevation_deg": "high"}, "sun_elevation_deg: must be a number"),
        ({"latitude_deg": 3}, "a place needs a time"),
        ({"at": "2026-06-21T12:00Z", "place": "Berlin"}, r"place: must be \(latitude, longitude\)"),
        ({"at": "2026-06-21T12:00Z", "place": "Berlin", "latitude_deg": 3}, "either place or latitude_deg"),
    ],
)
def test_a_wrong_question_is_one_sentence(question, says):
    """A wrong argument would be a traceback, or be ignored."""
    with pytest.raises(twilight.TwilightError, match=says):
        twilight.render("urban", **question)
