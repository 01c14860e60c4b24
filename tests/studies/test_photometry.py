"""Illuminance and zenith luminance against measurements, and the pieces that the comparison is made of."""

import csv
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from airs import scene_of_field
from closed_sky import ClosedSky
from montecarlo_media import hazy_earth
from typer.testing import CliRunner

import twilight
from twilight.base.errors import TwilightError
from twilight.cli.app import app
from twilight.config import load
from twilight.engine import solve
from twilight.numerics.directions import hemisphere
from twilight.sky.ephemeris import sun_position
from twilight.sky.moon import Moon
from twilight.studies.validate.measured import meter as meters
from twilight.studies.validate.measured import photometry as work
from twilight.studies.validate.measured import report
from twilight.studies.validate.measured.meter import (
    KOOMEN_SITES,
    horizontal_illuminance_lux,
    level_ground_spectra,
    meter_moonlit,
    meter_zenith,
    zenith_luminance_cd_m2,
)

QUIET = {
    "night": {},
    "wavelengths.list_nm": [440, 490, 520, 550, 590, 650],
    "solver.quality": "draft",
    "solver.polarisation": False,
}


@pytest.fixture(scope="module")
def meter():
    return work.Photometer(load("continental-average", QUIET))


def test_janiczek_deyoung_is_the_published_table():
    """Values of the polynomials; AMS Glossary: civil twilight ends at 3.5 to 2 lx, the night begins near 6e-4."""
    found = horizontal_illuminance_lux(np.array([60.0, 10.0, 0.0, -6.0, -12.0, -18.0]))
    assert found == pytest.approx([1.0312e5, 11121.0, 758.58, 3.4116, 8.0565e-3, 6.447e-4], rel=1e-3)
    for joint, gap in ((20.0, 0.01), (5.0, 0.01), (-0.8, 0.01), (-5.0, 0.02), (-12.0, 0.01)):
        low, high = np.log10(horizontal_illuminance_lux([joint - 1e-6, joint + 1e-6]))
        assert abs(high - low) < gap
    with pytest.raises(TwilightError, match="-18 to 90"):
        horizontal_illuminance_lux(-19.0)


def test_koomen_falls_by_ten_in_two_degrees():
    """Koomen et al. 1952 state a factor 10 per 2 deg between -3 and -11 deg."""
    for site in KOOMEN_SITES:
        sun, luminance = zenith_luminance_cd_m2(site.name)
        inside = (sun <= -3) & (sun >= -12)
        assert np.polyfit(sun[inside], np.log10(luminance[inside]), 1)[0] == pytest.approx(0.5, abs=0.08)
    with pytest.raises(TwilightError, match="Maryland, Sacramento Peak"):
        zenith_luminance_cd_m2("Atlantis")


def test_evening_finds_the_sun():
    """Moments of measurements would be of other suns."""
    for site in KOOMEN_SITES:
        moment, azimuth = work.evening(site, -9.0)
        at = sun_position(moment, site.latitude_deg, site.longitude_deg, site.altitude_km)
        assert float(at.elevation_deg) == pytest.approx(-9.0, abs=1e-3)
        assert 180.0 < azimuth < 360.0


@pytest.mark.parametrize("sun", [-18.0, 3.0, 30.0, 85.0])
def test_hemisphere_integrates_cosines_exactly(sun):
    """Irradiances would be off by the quadrature."""
    elevation, azimuth, weight = hemisphere(sun)
    sine = np.sin(np.radians(elevation))
    assert weight.sum() == pytest.approx(np.pi, rel=1e-12)
    assert weight @ sine**2 == pytest.approx(np.pi / 2, rel=1e-12)
    # the cosine of the angle to a horizontal direction at azimuth 60 deg, squared: its mean over both mirror halves
    across = np.cos(np.radians(elevation)) * np.cos(np.radians(azimuth))
    assert weight @ across**2 == pytest.approx(np.pi / 4, rel=1e-6)


def test_disc_rises_over_the_horizon():
    """The disc would light the ground before it rises."""
    bare = replace(hazy_earth(), refractivity=0 * hazy_earth().refractivity)
    solved, refracted = (
        solve(scene_of_field(ClosedSky(medium, lambda sun: 1.0, lambda e, a: 0.0 * e)), cached=False)
        for medium in (bare, hazy_earth())
    )
    point = solved.direct(40.0).irradiance
    assert solved.disc_irradiance(40.0) == pytest.approx(point * np.sin(np.radians(40.0)), rel=1e-4)
    lux = [solved.disc_irradiance(h)[0] for h in (-0.3, -0.2, 0.0, 0.2, 0.5)]
    assert lux[0] == 0.0 and (np.diff(lux) > 0).all()
    assert refracted.disc_irradiance(-0.5)[0] > 0.0


def test_level_and_slope_of_made_up_points():
    """Level and slope would be stated of other suns."""
    suns = np.array([-12.0, -10.0, -8.0, -6.0])
    points = [
        work.PhotometricPoint("a", "illuminance", "s", "ground", 0.0, h, 10 ** (0.2 + 0.01 * (h + 9.0)), 0.0, 1.0)
        for h in suns
    ]
    (level,) = work.levels([*points, replace(points[0], measured=float("nan"))])
    assert (level.low_deg, level.high_deg, level.count) == (-12, -5, 4)
    assert level.level_dex == pytest.approx(0.2) and level.slope_difference == pytest.approx(0.01)
    assert level.factor == pytest.approx(10**0.2)


class Even:
    """A sky of the same factor in all directions."""

    def __init__(self, factor: float):
        self.factor, self.config = factor, SimpleNamespace(solar_spectrum="astm_g173_etr")
        self.medium = SimpleNamespace(wavelength_nm=np.array(meters.WAVELENGTHS_NM), bottom_km=0.0)
        self.solved = self

    def radiance(self, source_deg, elevation_deg, azimuth_deg, observer_altitude_km):
        return np.full((np.size(elevation_deg), self.medium.wavelength_nm.size), self.factor)


def test_the_meter_adds_light_and_not_magnitudes():
    """Five magnitudes are a factor of 100; a full moon is 14 fainter than the sun above the air."""
    bright = meters.SkyQualityMeter(Even(1e-10), None).twilight_mag(-9.0)
    assert meters.SkyQualityMeter(Even(1e-12), None).twilight_mag(-9.0) - bright == pytest.approx(5.0, abs=1e-6)
    assert meters.SkyQualityMeter(Even(1e-30), 21.92).twilight_mag(-18.0) == pytest.approx(21.92, abs=1e-3)
    both = meters.SkyQualityMeter(Even(1e-10), bright).twilight_mag(-9.0)
    assert bright - both == pytest.approx(2.5 * np.log10(2.0), abs=1e-6)
    even = meters.SkyQualityMeter(Even(1e-2), None)
    fainter = even.moonlit_mag(Moon(40.0, 0.0, 7.0)) - even.twilight_mag(40.0)
    assert fainter == pytest.approx(14.3, abs=0.3)  # -26.7 and -12.4 at 7 deg from opposition


def test_the_meter_sees_a_gaussian_about_the_zenith():
    """Its mean squared distance is that of the field of view: fails if rings were too near or too far."""
    elevation, azimuth, weight = meters.field_of_view()
    sigma = np.radians(meters.FIELD_DEG) / (2.0 * np.sqrt(2.0 * np.log(2.0)))
    r = np.radians(90.0 - elevation)
    assert weight.sum() == pytest.approx(1.0, rel=1e-12)
    assert weight @ r**2 == pytest.approx(2.0 * sigma**2, rel=1e-9)
    assert weight @ (r * np.cos(np.radians(azimuth))) == pytest.approx(0.0, abs=1e-12)


def test_the_measured_curves_are_those_of_their_sources():
    """A few figures by hand; all of them where the data lie beside the repository."""
    sun, mag = meter_zenith()
    assert (sun[0], mag[0], sun[-1], mag[-1]) == (-4.0, 10.582, -18.0, 21.91)
    suns, nm, spectra = level_ground_spectra(3)
    assert nm[0] == 380.0 and nm[-1] == 700.0
    assert spectra[suns == -4.0][0, nm == 550.0][0] == pytest.approx(0.000334, rel=0.05)
    assert meter_moonlit()[1] == (2.5, 30.0, 272, 18.32)
    folder = Path(__file__).resolve().parents[3] / "shared" / "data"
    if not folder.is_dir():
        pytest.skip("the sources are not beside the repository")
    with open(folder / "rural_twilight_spectra" / "sessions_2_3_4.csv", encoding="utf-8") as file:
        rows = [row for row in csv.DictReader(file) if row["run"] == "3"]
    assert np.array_equal(spectra, [[float(row[f"{w:g}"]) for w in nm] for row in rows])


def test_illuminance_by_day_and_in_twilight(meter):
    """Within a factor 1.5 of Janiczek and DeYoung from 60 to -4 deg, and 0.9 to 1.25 with his slope from -5 to -12."""
    for sun in (60.0, 20.0, 0.0, -4.0):
        lux, night = meter.illuminance_lux(sun)
        assert 1 / 1.5 < lux / horizontal_illuminance_lux(sun) < 1.5
        assert 3e-4 < night < 3e-3
    deep = np.arange(-5.0, -13.0, -1.0)
    ratio = np.array([meter.illuminance_lux(sun)[0] / horizontal_illuminance_lux(sun) for sun in deep])
    assert ratio.min() > 0.9 and ratio.max() < 1.25  # OPAC's stratosphere: 1.7 to 2.1
    assert abs(np.polyfit(deep, np.log10(ratio), 1)[0]) < 0.01


def test_zenith_luminance_at_maryland(meter):
    """Within a factor 1.5 of Koomen's site at 30 m; darker over land at 2800 m, as he found."""
    low, high = KOOMEN_SITES
    sun, measured = zenith_luminance_cd_m2(low.name)
    computed = np.array([meter.zenith_luminance(float(h), low)[0] for h in sun])
    assert np.abs(np.log10(computed / measured)).max() < np.log10(1.5)
    above = work.Photometer(load("continental-average", QUIET), ground_altitude_km=high.altitude_km)
    assert above.medium.bottom_km == high.altitude_km
    for h in sun[:4]:
        there, night = above.zenith_luminance(float(h), high)
        assert there < meter.zenith_luminance(float(h), low)[0] and night < there
    assert low.transmission[0] < meter.transmission(low.altitude_km) < low.transmission[1]


def test_tables_and_picture(tmp_path):
    """A table would have its columns exchanged."""
    rows = [("illuminance", "ground", 0.0, h, float(horizontal_illuminance_lux(h)), 0.0, 1.0) for h in (-6.0, -9.0)]
    for site in KOOMEN_SITES:
        for sun, computed, measured in ((-6.0, 0.5, 0.5), (-7.0, 0.1, np.nan)):
            rows.append(("zenith luminance", site.name, site.altitude_km, sun, computed, 1e-4, measured))
    rows.append((work.METER_QUANTITY, "Cosmic Campground", 1.6, -9.0, 0.02, 0.0, 0.02))
    rows += [(quantity, "session 3", 0.0, h, 1.5, 0.0, 1.0) for quantity in work.COLOURS for h in (-1.0, 1.0)]
    points = [work.PhotometricPoint("a", quantity, "s", *values) for quantity, *values in rows]
    moonlit = [meters.MoonlitPoint("a", 7.5, up, 100, 18.0, 18.2) for up in (20.0, 40.0)]
    report.write_moonlit(moonlit, tmp_path / "moonlit.csv")
    assert (tmp_path / "moonlit.csv").read_text().splitlines()[1] == "a,7.5,20,100,18.00,18.20,-0.20"
    report.write_points(points, tmp_path / "points.csv")
    report.write_levels(work.levels(points), tmp_path / "levels.csv")
    report.draw(points, moonlit, tmp_path / "picture.png")
    lines = (tmp_path / "points.csv").read_text().splitlines()
    assert lines[0].split(",") == list(report.POINT_COLUMNS) and len(lines) == 1 + len(points)
    assert sum(line.endswith(",,") for line in lines) == len(KOOMEN_SITES)
    assert (tmp_path / "picture.png").read_bytes()[:4] == b"\x89PNG"


@pytest.mark.slow
def test_the_mountains_sky_has_the_contrast_that_a_camera_saw_there():
    """Haze above a mountain would be that of the land around: twice as much, the contrast 10 % too large."""
    field = twilight.solve("mountain", solver="zones", wavelength_nm=[540.0], settings={"solver.quality": "draft"})
    towards, away = field.radiance(-14.0, np.full(2, 30.0), np.array([0.0, 180.0]))[:, 0]
    assert towards / away == pytest.approx(2.07, rel=0.03)  # all-sky camera, Chile, 2.7 km


@pytest.mark.slow
def test_command_writes_tables_and_picture(tmp_path):
    """The command would miss a file."""
    words = ["pure-air", "--quality", "draft", "--set", "night=null", "--output", str(tmp_path)]
    done = CliRunner().invoke(app, ["validate", "photometry", *words])
    assert done.exit_code == 0, done.output
    assert {p.name for p in tmp_path.iterdir()} == {"points.csv", "levels.csv", "moonlit.csv", "photometry.png"}
    assert "slope_difference" in done.output
