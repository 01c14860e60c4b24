"""An evening as a table: columns, the times at which they pass a value, presets, files."""

from __future__ import annotations

import re
from dataclasses import replace
from datetime import UTC, datetime, timedelta
from types import SimpleNamespace

import numpy as np
import pytest
import xarray
from typer.testing import CliRunner

from twilight.base.errors import TwilightError
from twilight.cli.app import app
from twilight.config import load
from twilight.engine.light_setup import field_for
from twilight.engine.visibility import NakedEye
from twilight.numerics import spectrum
from twilight.sky.ephemeris import sun_position
from twilight.sky.quantities.catalogue import quantity
from twilight.sky.quantities.measure import Spectra
from twilight.sky.quantities.responses import response
from twilight.studies.timeline import timeline as work
from twilight.studies.timeline.columns import Setup, column
from twilight.studies.timeline.files import draw, shades, write_dataset, write_table
from twilight.studies.timeline.flats import Flats
from twilight.studies.timeline.presets import PRESETS
from twilight.studies.visible.night import sightings

PLACE = (28.3, -16.5)
NM = np.arange(380.0, 721.0, 20.0)


class Slope:
    """A grey light that falls by e for every degree of the sun: a field with a closed form."""

    wavelength_nm = NM
    solved = SimpleNamespace(solar_spectrum=spectrum.DEFAULT_SOLAR_SPECTRUM, scene=SimpleNamespace(altitude_km=0.0))

    def spectra(self, light):
        return Spectra(light, NM, where="the field")

    def directions(self, moments, elevation, azimuth, sources=None):
        return np.exp(moments.sun_elevation_deg)[:, None, None] * np.ones((1, 1, NM.size))

    def surfaces(self, moments, surfaces, sources=None):
        return self.directions(moments, None, None)


def evening(step_s: float = 300.0) -> list[datetime]:
    start = datetime(2026, 3, 20, 18, 0, tzinfo=UTC)
    return work.rows(start, start + timedelta(hours=4), timedelta(seconds=step_s))


def test_a_crossing_is_found_to_the_second():
    level = float(column("luminance@zenith").values(Slope(), work.moments_at([28.3], [-16.5], evening()[:1]))[0])
    at_start = float(sun_position(evening()[0], *PLACE).elevation_deg)
    threshold = float(level * np.exp(-7.25 - at_start))
    made = work.timeline(Slope(), *PLACE, evening(), [column("luminance")],
                         [work.condition(f"luminance < {threshold!r}"), work.condition("luminance < 1e-30"),
                          work.condition("luminance > 1e-30")])  # fmt: skip
    crossing = made.outcomes[0].crossings[0]
    assert crossing.begins and len(made.outcomes[0].crossings) == 1
    # the sun sinks by 0.2 deg a minute: 0.004 deg a second
    assert float(sun_position(crossing.time, *PLACE).elevation_deg) == pytest.approx(-7.25, abs=0.004)
    assert [outcome.sentence for outcome in made.outcomes[1:]] == ["not reached", "all the time"]
    events = [mark.event for mark in made.marks]
    assert events == ["sunset", "civil dusk", "nautical dusk", "astronomical dusk"]


def test_a_day_without_dusk_says_so_once():
    start = datetime(2026, 6, 20, 0, 0, tzinfo=UTC)
    times = work.rows(start, start + timedelta(hours=30), timedelta(hours=1))
    made = work.timeline(Slope(), 80.0, 31.0, times, [column("illuminance")], [work.condition("illuminance < 1e-9")])
    assert made.outcomes[0].sentence == "not reached"
    never = [mark.event for mark in made.marks if mark.time is None]
    assert sorted(set(never)) == sorted(never) and "sunset" in never


@pytest.mark.parametrize(
    ("text", "sentence"),
    [("V", "is not QUANTITY"), ("V > dark", "'dark' is not a number"), ("Vx > 3", "'Vx' is not known"),
     ("illuminance@zenith > 3", "of a surface"), ("V@up > 3", "is none of zenith")],
)  # fmt: skip
def test_a_condition_that_is_none_is_refused(text, sentence):
    with pytest.raises(TwilightError, match=sentence):
        work.condition(text)


def test_steps_and_rows_are_checked():
    assert work.step_of("90s") == timedelta(seconds=90) and work.step_of("0.5h") == timedelta(minutes=30)
    for text in ("1", "0s", "2 days", "-1min"):
        with pytest.raises(TwilightError, match="is not a duration"):
            work.step_of(text)
    now = datetime(2026, 1, 1, tzinfo=UTC)
    with pytest.raises(TwilightError, match="is not after"):
        work.rows(now, now, timedelta(minutes=1))
    with pytest.raises(TwilightError, match="rows; allowed is 2 to"):
        work.rows(now, now + timedelta(days=9), timedelta(seconds=1))


def test_every_preset_has_columns_conditions_and_a_source():
    for preset in PRESETS.values():
        assert [column(text) for text in preset.columns] and [work.condition(text) for text in preset.conditions]
        assert any(f"({year}" in preset.about or f" {year}" in preset.about for year in range(1940, 2030))


def test_a_flat_takes_as_long_as_its_photons_say():
    flats = Flats("V", aperture_m=2.0, obstruction_m=1.0, pixel_arcsec=1.0, throughput=0.5, gain=2.0,
                  level_counts=1000.0)  # fmt: skip
    # 0.75 pi m^2, one square arcsecond 2.3504e-11 sr: 2.77e-11 electrons of one photon per s m^2 sr
    assert float(flats.electrons_per_s(np.array(1e12))) == pytest.approx(0.75 * np.pi * 2.35044e-11 * 0.5e12, rel=1e-5)
    assert float(flats.exposures_s(np.array(1e12))) == pytest.approx(2000.0 / 27.69, rel=1e-3)
    # an exposure of that length has the counts wanted, in a larger one the pixel saturates
    for exposure_s, counts in ((2000.0 / 27.69, 1000.0), (1e4, 5000.0)):
        fixed = replace(flats, exposure_s=exposure_s, saturation_counts=5000.0)
        assert float(fixed.counts(np.array(1e12))) == pytest.approx(counts, rel=1e-3)
    for wrong, sentence in (({"obstruction_m": 2.0}, "--obstruction-m"), ({"exposure_s": 0.0}, "--exposure-s"),
                            ({"level_counts": 7e4}, "is not below the saturation, 65535")):  # fmt: skip
        with pytest.raises(TwilightError, match=sentence):
            Flats(**wrong)


@pytest.mark.parametrize("band", ["V", "r"])
def test_the_throughput_of_flats_is_that_at_the_bands_maximum(band):
    """LSST's curves have optics, detector and air in them, Bessell's are of energy: a detector of the throughput 1 and
    the band's shape in photons counts a known light, by quadrature apart."""
    found = response(band)
    assert (found.per, round(found.value.max(), 2)) == {"V": ("energy", 1.0), "r": ("photon", 0.58)}[band]
    shape = found.value / (found.wavelength_nm if found.per == "energy" else 1.0)
    nm = np.arange(480.0, 721.0)
    seen = np.interp(nm, found.wavelength_nm, shape / shape.max(), left=0.0, right=0.0)
    photons = spectrum.solar_at(nm) * seen * nm / 1.98644586e-16  # h c [J nm]
    flats = Flats(band, throughput=1.0, saturation_counts=1e30)
    moments = work.moments_at([28.3], [-16.5], evening()[:1])
    light = float(np.exp(moments.sun_elevation_deg[0]))
    expected = light * photons.sum() * 0.25 * np.pi * 0.25 * 2.35044e-11
    counts = column("flat_counts", Setup(flats=flats)).values(Slope(), moments)[0]
    assert counts == pytest.approx(expected, rel=2e-3)


def test_flats_are_columns_with_conditions():
    """Exposures times counts of one second are the level; the light falls by e for a degree of the sun."""
    setup = Setup(flats=Flats("V", exposure_s=1.0, level_counts=100.0, saturation_counts=1e30))
    times = evening()
    columns = [column(text, setup) for text in ("flat_counts", "flat_exposure")]
    bright = work.timeline(Slope(), *PLACE, times, columns)
    assert bright.values[0] * bright.values[1] == pytest.approx(100.0)
    assert [one.variable for one in columns] == ["flat_counts_V_zenith", "flat_exposure_V_s_zenith"]
    level = float(bright.values[0][10])
    made = work.timeline(Slope(), *PLACE, times, [], [work.condition(f"flat_counts < {level!r}", setup)])
    assert abs((made.outcomes[0].crossings[0].time - times[10]).total_seconds()) <= 1.0
    with pytest.raises(TwilightError, match="goes with --for flats"):
        column("flat_exposure")


@pytest.fixture(scope="module")
def dusk():
    config = load("continental-average",
                  {"solver.quality": "draft", "wavelengths.list_nm": [440.0, 500.0, 550.0, 600.0, 660.0]})  # fmt: skip
    return field_for(config, [quantity("luminance")])


def test_stars_and_planets_come_out_to_the_second(dusk):
    """The limit of stars by the column is the eye's; where it passes Sirius's place, Sirius is seen."""
    place = (52.5, 13.4)
    start = datetime(2026, 3, 20, 16, 30, tzinfo=UTC)
    times = work.rows(start, start + timedelta(hours=2), timedelta(minutes=20))
    columns = [column("limiting_magnitude"), column("margin@sirius")]
    made = work.timeline(dusk, *place, times, columns, [work.condition("margin@sirius > 0")])
    limit, margin = made.values
    assert (np.diff(limit) > 0).all() and limit[0] < -2.0 and limit[-1] > 4.0
    [out] = made.outcomes[0].crossings
    found = sightings(NakedEye(dusk), *place, ["Sirius"], times[0], times[-1], 60.0)["Sirius"].sightings[0]
    assert out.begins and abs((out.time - found.first).total_seconds()) < 5.0
    assert np.isfinite(margin).all() and (np.diff(margin[:4]) > 0).all()
    keen = work.timeline(dusk, *place, times[:1] * 2, [column("limiting_magnitude", Setup(field_factor=1.0))])
    assert keen.values[0][0] - limit[0] == pytest.approx(2.5 * np.log10(2.0), abs=1e-3)


@pytest.mark.parametrize(
    ("text", "sentence"),
    [("margin@stars", "is of several objects"), ("margin@pluto", "'pluto' is not known"),
     ("limiting_magnitude@horizontal", "not of a surface"), ("dawn_contrast@zenith", "takes no @"),
     ("limitng_magnitude", "is not known; .* also dawn_contrast, limiting_magnitude and margin@OBJECT")],
)  # fmt: skip
def test_what_no_column_is(text, sentence):
    with pytest.raises(TwilightError, match=sentence):
        column(text)


def test_shades_begin_with_the_twilights_between_the_rows():
    """Rows an hour apart: sunset and dusks within two minutes of those of `twilight times`, for the sun's arc bends."""
    start = datetime(2026, 3, 20, 17, 0, tzinfo=UTC)
    times = work.rows(start, start + timedelta(hours=6), timedelta(hours=1))
    made = work.timeline(Slope(), *PLACE, times, [column("luminance")])
    marks = {mark.event: mark.time for mark in made.marks}
    found = shades(made)
    assert [depth for *_, depth in found] == [1, 2, 3, 4] and found[-1][1] == times[-1]
    for (first, *_), event in zip(found, ("sunset", "civil dusk", "nautical dusk", "astronomical dusk"), strict=True):
        assert abs((first - marks[event]).total_seconds()) < 120.0


def test_files_hold_what_the_table_holds(tmp_path):
    made = work.timeline(Slope(), *PLACE, evening(), [column("V@zenith"), column("CCT")], [work.condition("V > 5")])
    write_table(made, tmp_path / "a.csv", "a test")
    write_dataset(made, tmp_path / "a.nc", {"title": "a test"})
    draw(made, tmp_path / "a.png", "a test")
    _, head, *rows = (tmp_path / "a.csv").read_text().splitlines()
    assert head == "time,sun_elevation_deg,magnitude_V_per_arcsec2_zenith,cct_k" and len(rows) == len(made.times)
    with xarray.open_dataset(tmp_path / "a.nc") as data:
        assert np.allclose(data.magnitude_V_per_arcsec2_zenith, made.values[0]) and data.cct_k.attrs["units"] == "K"
    assert (tmp_path / "a.png").stat().st_size > 10_000


@pytest.mark.parametrize(
    ("change", "sentence"),
    [(["--at", "soon"], "--at: soon is not a date"), (["--for", "tea"], "--for: tea"), (["--step", "x"], "--step"),
     (["--when", "V"], "--when"), (["--gain", "2"], "--gain: belongs to --for flats"),
     (["--field-factor", "1.4"], "--field-factor: belongs to the columns limiting_magnitude"),
     (["--for", "darkness", "--aperture-m", "2"], "--aperture-m: belongs to --for flats"),
     (["--output", __file__ + "/night"], "is not a folder"),
     (["--quantity", "y"], "y: .* beyond the wavelengths of the air")],
)  # fmt: skip
def test_bad_input_is_one_sentence(change, sentence, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    done = CliRunner().invoke(
        app, ["timeline", "urban", "--at", "2026-03-20", "--latitude", "28", "--longitude", "0", *change]
    )
    assert done.exit_code == 2 and re.search(sentence, done.output)
