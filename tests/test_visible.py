"""What the naked eye sees: thresholds, magnitudes of planets, and when objects come out."""

from __future__ import annotations

import datetime as dt
from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_allclose
from typer.testing import CliRunner

from twilight.base.errors import TwilightError
from twilight.cli.app import app
from twilight.config import load
from twilight.engine.light_setup import field_for
from twilight.engine.visibility import NakedEye
from twilight.sky.eye_limit import (
    illuminance_magnitude,
    limiting_magnitude,
    magnitudes_above,
    threshold_contrast,
    threshold_illuminance_lux,
)
from twilight.sky.moon.disc import lit_parts, surface
from twilight.sky.objects import names_of, tracks
from twilight.sky.planets import planet_magnitude
from twilight.sky.quantities.catalogue import quantity
from twilight.studies.visible.night import sightings

QUICK = {"solver.quality": "draft", "wavelengths.list_nm": [440.0, 500.0, 550.0, 600.0, 660.0]}
"""The photopic band needs no more."""


def luminance(mag_per_arcsec2):
    """Crumey 2014 sec. 1.2: V = 12.58 - 2.5 log B."""
    return 10.0 ** ((12.58 - mag_per_arcsec2) / 2.5)


def test_limit_of_a_dark_night():
    """Sec. 3.1: 6.93 mag at 2e-4 cd m^-2 with F = 1, and 6.18 with F = 2; eq. 34 is within 0.03 of eq. 53."""
    assert limiting_magnitude(2e-4, 1.0) == pytest.approx(6.93, abs=0.03)
    assert limiting_magnitude(2e-4, 2.0) == pytest.approx(6.18, abs=0.03)


@pytest.mark.parametrize(
    ("mag", "loss"), [(22.0, 0.0), (21.5, 0.20), (21.0, 0.40), (20.5, 0.59), (20.0, 0.77), (19.5, 0.93), (19.25, 1.01)]
)
def test_loss_by_a_brighter_sky(mag, loss):
    """Crumey's table 1: magnitudes lost from a sky of 22 mag arcsec^-2."""
    assert limiting_magnitude(luminance(22.0)) - limiting_magnitude(luminance(mag)) == pytest.approx(loss, abs=0.05)


def test_darkness_and_daylight():
    """No background: 1.15e-9 lx (eq. 52). By day, 3e3 cd m^-2: eq. 24 of the cones, and Venus at -4.4 stands out."""
    assert threshold_illuminance_lux([0.0, 1e-5], 1.0) == pytest.approx([1.150e-9] * 2, rel=0.01)
    day = (1.772e-4 * 3000.0**0.25 + 7.167e-5 * 3000.0**0.5) ** 2
    assert threshold_illuminance_lux(3000.0, 1.0) == pytest.approx(day, rel=0.05)
    assert -4.4 < limiting_magnitude(3000.0, 2.0) < -2.5
    bright = limiting_magnitude(np.logspace(-5, 3.5, 60))
    assert (np.diff(bright) < 0.031).all()  # monotone but for the fit's dip
    with pytest.raises(TwilightError, match="field factor"):
        limiting_magnitude(1.0, 0.0)


def test_extended_targets():
    """A small target is a point, a large one has a contrast of its own: 2.72e-3 by day (eq. 38), eq. 37 at night."""
    b = 1e-3
    tiny = 1e-12
    assert threshold_contrast(tiny, b) * tiny * b == pytest.approx(float(threshold_illuminance_lux(b)), rel=0.02)
    assert threshold_contrast(1.0, 100.0, 1.0) == pytest.approx(2.72e-3, rel=0.05)
    assert threshold_contrast(1.0, b, 1.0) == pytest.approx(7.633e-3 * b**-0.25 - 7.174e-3, rel=0.07)
    assert np.all(np.diff(threshold_contrast(np.logspace(-10, -2, 20), b)) < 0)


@pytest.mark.parametrize("background", [1e-3, 1.0, 30.0])
def test_a_kernel_sums_discs_as_their_law_has_it_and_lines_less(background):
    """Even discs at their threshold contrast are at the limit; a line that is longer than what the eye sums up is seen
    less well than a disc of its area and light."""
    for radius in np.radians(np.array([0.3, 2.0, 15.0, 60.0]) / 60.0):
        area = np.pi * radius**2
        x, w = np.polynomial.legendre.leggauss(200)
        d = 0.5 * radius * (x + 1.0)
        luminance = background * float(threshold_contrast(area, background))
        lux = luminance * np.pi * radius * w * d
        assert magnitudes_above(lux, d, background) == pytest.approx(0.0, abs=1e-6)
    along = np.linspace(-0.5, 0.5, 201)
    share = np.full(201, 1e-4 / 201)
    short, long = (magnitudes_above(share, np.abs(along) * length, background) for length in (1e-6, 0.02))
    assert short == pytest.approx(float(limiting_magnitude(background)) - float(illuminance_magnitude(1e-4)), abs=1e-3)
    disc = 2.5 * np.log10(1e-4 / 1e-7 / background / float(threshold_contrast(1e-7, background)))
    assert long < disc - 0.3 and long > -2.5 * np.log10(201) + short


@pytest.mark.parametrize("phase", [0.0, 60.0, 130.0, 170.0])
def test_parts_of_the_moon_are_those_of_its_disc(phase):
    """Weights of the lit parts against a fine grid of the disc: the mean place of the light."""
    x, y, share = lit_parts(phase)
    fine = (np.arange(1600) + 0.5) / 1600 * 2.0 - 1.0
    gx, gy = np.meshgrid(fine, fine)
    light = surface(gx, gy, (1.0, 0.0), phase)
    assert (share * x).sum() == pytest.approx((light * gx).sum() / light.sum(), abs=3e-3)
    assert (share * y**2).sum() == pytest.approx((light * gy**2).sum() / light.sum(), abs=3e-3)


@pytest.mark.parametrize(
    ("name", "r", "distance", "phase", "magnitude"),
    [
        ("mercury", 0.310295423552, 1.32182643625754, 1.1677, -2.477),
        ("mercury", 0.413629222334, 0.92644808718613, 90.1662, 0.181),
        ("venus", 0.722722540169, 1.71607489554051, 1.3232, -3.917),
        ("venus", 0.721480714554, 0.37762511206278, 124.1348, -4.916),
        ("venus", 0.726166592736, 0.28889582420642, 179.1845, -3.090),
        ("jupiter", 5.446231815414, 6.44985867459088, 0.2446, -1.667),
        ("jupiter", 4.957681473205, 3.95393078136013, 0.3431, -2.934),
    ],
)
def test_planets_are_those_of_the_paper(name, r, distance, phase, magnitude):
    """The worked rows of the paper's program Ap_Mag (2018)."""
    assert planet_magnitude(name, r, distance, phase) == pytest.approx(magnitude, abs=5e-4)


def test_planets_of_a_night():
    """Venus on 2014-09-22 had V = -3.93 (skyfield with JPL's ephemeris), Saturn near +0.6; a star keeps its own."""
    moment = [dt.datetime(2014, 9, 22, 23, 22, tzinfo=dt.UTC)]
    venus, saturn, sirius = tracks(["venus", "saturn", "Sirius"], moment, 0.0, 0.0)
    assert venus.magnitude[0] == pytest.approx(-3.93, abs=0.02)
    assert saturn.magnitude[0] == pytest.approx(0.6, abs=0.1)
    assert sirius.magnitude[0] == -1.46
    with pytest.raises(TwilightError, match="'pluto' is not known"):
        names_of("pluto")
    assert names_of("SIRIUS") == ["Sirius"] and "Vega" in names_of("stars")


BERLIN = (52.5, 13.4)


def eye_in(**more):
    return NakedEye(field_for(load("continental-average", {**QUICK, **more}), [quantity("luminance")]))


@pytest.fixture(scope="module")
def berlin():
    return eye_in()


def test_extinction_and_refraction(berlin):
    """In the zenith the air's optical depth, at the horizon refraction of half a degree and many magnitudes."""
    shown, lost = berlin.seen_at(np.array([90.0, 30.0, 0.0, -2.0]))
    assert 0.2 < lost[0] < 0.4 and lost[1] == pytest.approx(2.0 * lost[0], rel=0.02)
    assert 0.35 < shown[2] < 0.65 and lost[2] > 6.0
    assert np.isnan(shown[3]) and lost[3] == np.inf


def test_evening(berlin):
    """20 March 2026: Venus at -3.9 comes out about sunset, Sirius in the first degrees after, a faint star later."""
    noon = dt.datetime(2026, 3, 20, 15, tzinfo=dt.UTC)
    found = sightings(
        berlin, *BERLIN, ["venus", "Sirius", "Alioth", "saturn"], noon, noon + dt.timedelta(hours=5), 300.0
    )
    [venus], [sirius], [alioth] = (found[name].sightings for name in ("venus", "Sirius", "Alioth"))
    assert venus.first < sirius.first < alioth.first
    assert -2.0 < venus.sun_deg[0] < 3.0 and -4.0 < sirius.sun_deg[0] < 0.0 and -9.0 < alioth.sun_deg[0] < -4.0
    assert venus.elevation_deg[1] < 3.0  # it fades as it sets
    assert not found["saturn"].sightings and found["saturn"].best_margin_mag < -1.0  # beside the sun


def test_limit_over_the_sky(berlin):
    """A dark evening's limit in the zenith and near the horizon; light pollution and a bright moon take from it."""
    moment = dt.datetime(2026, 3, 19, 22, tzinfo=dt.UTC)  # new moon
    where = np.array([[90.0, 10.0]]), np.zeros((1, 2))
    new, full = (berlin.moments(*BERLIN, [t]) for t in (moment, dt.datetime(2026, 4, 2, 0, tzinfo=dt.UTC)))
    [dark] = berlin.limit(new, *where)
    assert 5.4 < dark[0] < 6.2 and dark[1] < dark[0] - 0.8
    city = eye_in(**{"night.light_pollution": {"bortle_class": 8}})
    assert 3.4 < city.limit(new, *where)[0, 0] < 4.7  # 4.1 to 4.5 in charts of Bortle 8
    assert berlin.limit(full, *where)[0, 0] < dark[0] - 1.0
    assert berlin.limit(full, *where, moonlight=False)[0, 0] == pytest.approx(dark[0], abs=0.15)


def test_magnitude_of_an_illuminance():
    """The full moon's 0.27 lx are V = -12.6."""
    assert illuminance_magnitude(0.267) == pytest.approx(-12.55, abs=0.05)
    assert_allclose(illuminance_magnitude([2.54e-6, 0.0]), [0.0, np.inf])


def command(*words):
    place = ["--latitude", "52.5", "--longitude", "13.4"]
    light = ["--set", "solver.quality=draft", "--set", "wavelengths.list_nm=[440, 500, 550, 600, 660]"]
    return CliRunner().invoke(app, ["visible", *words, *place, *light])


def test_command(tmp_path: Path):
    """A table of spans; a map as a PNG."""
    made = command("saturn", "--at", "2026-03-20")
    assert made.exit_code == 0 and "is not seen" in made.output
    target = tmp_path / "limit.png"
    made = command("--map", str(target), "--at", "2026-03-20T22:00Z")
    assert made.exit_code == 0 and "in the zenith" in made.output
    assert target.read_bytes()[:4] == b"\x89PNG"


@pytest.mark.parametrize(
    ("words", "sentence"),
    [
        (["pluto"], "'pluto' is not known"),
        (["venus", "--at", "20 March"], "--at: 20 March is not a date"),
        (["--map", "limit.jpg", "--at", "2026-03-20T22:00Z"], "must end in .png"),
        (["--map", "limit.png"], "--map: needs --at with a time"),
        (["venus", "--map", "limit.png", "--at", "2026-03-20T22:00Z"], "takes no objects"),
        (["venus", "--field-factor", "0"], "--field-factor"),
    ],
)
def test_what_is_refused(words, sentence):
    """One sentence, exit code 2."""
    made = command(*words)
    assert made.exit_code == 2 and sentence in " ".join((made.output + str(made.stderr)).split())
