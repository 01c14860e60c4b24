"""Bands, eyes and skins: every quantity against a number that somebody else published."""

import numpy as np
import pytest
from toy_sky import glow_sky

import twilight
from twilight.base.errors import TwilightError
from twilight.numerics import spectrum
from twilight.sky.night import night_radiance
from twilight.sky.quantities import measure, responses
from twilight.sky.quantities.measure import (
    QUANTITIES,
    Spectra,
    check_covered,
    check_of,
    quantity,
    samples_for,
    unit_of,
    zero_point,
)
from twilight.sky.quantities.responses import ALPHA_OPIC, Response, correlated_colour_temperature, erythema, response

SUN = Spectra(np.ones(2), np.array([300.0, 1000.0]))


def star_magnitude(band: str, system: str | None = None) -> float:
    """Of the sun above the air."""
    found = response(band)
    return float(-2.5 * np.log10(SUN.weighted(found) / zero_point(found, system)))


def d65_factor() -> tuple[np.ndarray, np.ndarray]:
    """D65 over the solar spectrum at every nanometre: an irradiance that is daylight's."""
    from colour import SDS_ILLUMINANTS

    d65 = SDS_ILLUMINANTS["D65"]
    nm = np.arange(360.0, 831.0)
    values = np.interp(nm, d65.wavelengths, d65.values)
    return values / spectrum.solar_at(nm), nm


@pytest.mark.parametrize(
    ("band", "ab_of_vega_zero"),
    [  # f_nu of magnitude 0 over 3631 Jy: Bessell, Castelli & Plez 1998, table A2: 1790, 4063, 3636, 3064, 2416 Jy
        ("U", -2.5 * np.log10(1790 / 3631)),
        ("B", -2.5 * np.log10(4063 / 3631)),
        ("V", -2.5 * np.log10(3636 / 3631)),
        ("R", -2.5 * np.log10(3064 / 3631)),
        ("I", -2.5 * np.log10(2416 / 3631)),
        # zero points AB less Vega, documentation of Gaia DR3, table 5.2
        ("gaia-G", 25.8010 - 25.6874),
        ("gaia-BP", 25.3540 - 25.3385),
        ("gaia-RP", 25.1040 - 24.7479),
    ],
)
def test_vega_and_ab_differ_as_published(band, ab_of_vega_zero):
    """A band's zero point would be off."""
    found = response(band)
    made = -2.5 * np.log10(zero_point(found, "Vega") / zero_point(found, "AB"))
    assert made == pytest.approx(ab_of_vega_zero, abs=0.035)


@pytest.mark.parametrize(
    ("band", "system", "published"),
    [  # apparent magnitudes of the sun, Willmer 2018 (ApJS 236, 47), table 3; the last five are LSST's
        ("U", "Vega", -25.97),
        ("B", "Vega", -26.13),
        ("V", "Vega", -26.76),
        ("R", "Vega", -27.15),
        ("I", "Vega", -27.47),
        ("V", "AB", -26.77),
        ("sdss-g", "AB", -26.47),
        ("sdss-r", "AB", -26.93),
        ("sdss-i", "AB", -27.05),
        ("sdss-z", "AB", -27.07),
        ("u", "AB", -25.30),
        ("g", "AB", -26.52),
        ("r", "AB", -26.93),
        ("i", "AB", -27.05),
        ("z", "AB", -27.07),
    ],
)
def test_the_sun_above_the_air_has_its_magnitudes(band, system, published):
    """A band's response or zero point would be off (Willmer 2018)."""
    assert star_magnitude(band, system) == pytest.approx(published, abs=0.06)


def test_receptors_have_the_efficacies_of_daylight_that_the_cie_gives():
    """A receptor of the eye would have another response."""
    factor, nm = d65_factor()
    light = Spectra(factor, nm)
    lux = float(light.photopic())
    for receptor in ALPHA_OPIC:
        # by definition the equivalent daylight illuminance of daylight is its illuminance
        assert float(light.alpha_opic_edi(receptor)) == pytest.approx(lux, rel=2e-4), receptor
    assert measure.ALPHA_OPIC_D65_W_PER_LM["melanopic"] == 1.3262e-3


def test_daylight_and_lamps_have_their_colour_temperatures():
    """Colour temperatures would be off those of CIE illuminants."""
    from colour import MSDS_CMFS, SDS_ILLUMINANTS, UCS_to_uv, XYZ_to_UCS, sd_to_XYZ
    from colour.temperature import uv_to_CCT_Ohno2013

    functions = MSDS_CMFS["CIE 1931 2 Degree Standard Observer"]
    xyz = np.stack([sd_to_XYZ(SDS_ILLUMINANTS[name], functions) for name in ("A", "D50", "D65", "FL2", "FL11")])
    cct, duv = correlated_colour_temperature(xyz)
    # their names' temperatures, by the second radiation constant of today (1.4388e-2 m K) over that of their time
    assert cct[:3] == pytest.approx(1.4388 * np.array([2848 / 1.435, 5000 / 1.438, 6500 / 1.438]), abs=1.5)
    others = np.array([uv_to_CCT_Ohno2013(UCS_to_uv(XYZ_to_UCS(one))) for one in xyz])
    assert np.allclose(cct, others[:, 0], rtol=1e-4) and np.allclose(duv, others[:, 1], atol=2e-6)
    none, _ = correlated_colour_temperature(np.array([[0.0, 0.0, 0.0], [0.1, 1.0, 0.1], [0.0, 0.0, 1.0]]))
    assert np.isnan(none).all()


def test_sunlight_above_the_air_as_eyes_and_leaves_see_it():
    """Lux, photons or S/P of sunlight would be off published values."""
    assert float(SUN.photopic()) == pytest.approx(133_334, rel=0.005)  # Darula, Kittler & Gueymard 2005
    # 4.6 umol/J of sunlight from 400 to 700 nm, as R's bigleaf has it; of green light exactly 550 / 119.627
    par = float(SUN.within(([400.0, 700.0], [1.0, 1.0])))
    assert float(SUN.ppfd()) / par == pytest.approx(4.6, rel=0.02)
    line = ([549.0, 550.0, 551.0], [0.0, 1.0, 0.0])
    assert float(SUN.photons(line) / SUN.within(line)) * 1e6 / 6.02214e23 == pytest.approx(550 / 119.627, rel=1e-5)
    # S/P of daylight D65 by the curves of another library, 683 lm/W at 555 nm and 1700 lm/W at 507 nm
    from colour import SDS_ILLUMINANTS, SDS_LEFS

    factor, nm = d65_factor()
    light = Spectra(factor, nm)
    curves = (SDS_ILLUMINANTS["D65"], SDS_LEFS["cie_1951"], SDS_LEFS["cie_2_1924"])
    d65, scotopic, photopic = (np.interp(nm, one.wavelengths, one.values, 0.0, 0.0) for one in curves)
    expected = 1700.06 / 683.002 * (d65 @ scotopic) / (d65 @ photopic)
    assert float(light.scotopic() / light.photopic()) == pytest.approx(expected, rel=1e-3)


def test_mesopic_luminance_is_that_of_the_standard():
    """CIE 191:2010: photopic from 5 cd/m2 on, scotopic below 0.005 cd/m2."""
    factor, nm = d65_factor()
    light = Spectra(factor, nm)
    bright = Spectra(factor * 6.0 / float(light.photopic()), nm)
    assert float(bright.mesopic()) == pytest.approx(6.0)
    dim = Spectra(factor * 1e-4 / float(light.photopic()), nm)
    # night vision: V' scaled to 683 lm/W at 555 nm
    assert float(dim.mesopic()) == pytest.approx(float(dim.scotopic()), rel=1e-9)


def test_erythema_is_continuous_and_one_in_the_far_ultraviolet():
    """The ultraviolet index would be off."""
    assert erythema(np.array([250.0, 298.0, 328.0, 400.0, 401.0])) == pytest.approx(
        [1.0, 1.0, 10 ** (0.094 * -30), 10 ** (0.015 * -260), 0.0]
    )
    assert float(erythema(np.array([328.0001]))[0]) == pytest.approx(10 ** (0.094 * -30), rel=0.01)


def test_the_meter_of_night_skies_is_fainter_than_v_by_its_zero_alone():
    """With Vega's zero 0.24 mag in all light; Cinzano 2005 (ISTIL 9, sec. 5) found 0.06 to a lamp."""
    from colour import SDS_ILLUMINANTS

    nm = np.arange(350.0, 1000.1, 10.0)
    night = night_radiance(twilight.medium("continental-clean", nm), np.array([90.0]), np.array([0.0]))[0, 0]
    light = Spectra(night / spectrum.solar_irradiance(nm), nm)
    lamp = np.interp(nm, SDS_ILLUMINANTS["A"].wavelengths, SDS_ILLUMINANTS["A"].values)
    fainter = [float(one.magnitude("SQM") - one.magnitude("V"))
               for one in (light, SUN, Spectra(lamp / spectrum.solar_irradiance(nm), nm))]  # fmt: skip
    assert fainter == pytest.approx([0.235] * 3, abs=0.015)
    assert float(light.magnitude("V")) == pytest.approx(21.61, abs=0.3)  # Paranal at solar maximum, Patat 2003
    assert float(light.magnitude("B") - light.magnitude("V")) == pytest.approx(22.64 - 21.61, abs=0.25)  # ibid.


def test_a_sky_is_as_bright_in_every_way_of_asking():
    """Two ways of asking would give two brightnesses."""
    sky = glow_sky(step_deg=10.0, floor=0.02)
    assert sky.radiance_in("photopic", 40.0, 20.0) * 683.002 == pytest.approx(sky.luminance_at(40.0, 20.0), rel=1e-5)
    assert sky.measure("luminance", 40.0, 20.0) == pytest.approx(sky.luminance_at(40.0, 20.0), rel=1e-5)
    assert sky.measure("V", 40.0, 20.0) == sky.magnitude("V", 40.0, 20.0)
    assert sky.measure("illuminance") == pytest.approx(sky.illuminance_lux(), rel=1e-5)
    assert sky.measure("melanopic") == pytest.approx(sky.illuminance_lux(eye="melanopic"))
    assert sky.measure("in:photopic") * 683.002 == pytest.approx(sky.illuminance_lux(), rel=1e-5)
    # AB and Vega differ by the zero points alone
    offset = -2.5 * np.log10(zero_point(response("V"), "Vega") / zero_point(response("V"), "AB"))
    assert sky.magnitude("V", system="AB") - sky.magnitude("V") == pytest.approx(offset)
    # a fainter sky by a factor of 100 is 5 magnitudes fainter, whatever the band
    from dataclasses import replace

    dim = replace(sky, sun_normalised_radiance=sky.sun_normalised_radiance * 0.01)
    for band in ("V", "g", "camera-green", "SQM"):
        if sky.covers(band):
            assert dim.magnitude(band) - sky.magnitude(band) == pytest.approx(5.0)


def test_a_curve_of_ones_own_is_taken_from_arrays_files_and_speclite(tmp_path):
    """A user's curve would be read otherwise."""
    nm = np.arange(500.0, 601.0)
    triangle = 1.0 - np.abs(nm - 550.0) / 50.0
    path = tmp_path / "mine.csv"
    path.write_text("nm,response\n" + "".join(f"{a},{b}\n" for a, b in zip(nm, triangle, strict=True)))
    assert float(SUN.within((nm, triangle))) == pytest.approx(float(SUN.within(str(path))))
    level, sun = np.interp(nm, *spectrum.solar_spectrum()), triangle
    assert float(SUN.within((nm, triangle))) == pytest.approx((level * sun).sum(), rel=1e-3)
    pytest.importorskip("speclite")
    # the package's own V is a response to photons: 0.02 mag from the energies of Bessell
    assert star_magnitude("bessell-V", "AB") == pytest.approx(star_magnitude("V", "AB"), abs=0.03)
    assert float(SUN.magnitude("decam2014-g")) == pytest.approx(float(SUN.magnitude("g")), abs=0.1)


@pytest.mark.parametrize(
    ("which", "sentence"),
    [
        ("Vv", "the band 'Vv' is not known"),
        ("nowhere-x", "neither one of .* nor one of speclite's"),
        ("missing.csv", "missing.csv: cannot read the table"),
        (([500, 400], [1, 1]), "must increase"),
        (([400, 500], [0, 0]), "not all 0"),
        (([0.4, 0.5], [1, 1]), "wavelengths are in nm"),
        (3, "must be a name, a CSV file"),
    ],
)
def test_what_is_no_response_is_refused_in_one_sentence(which, sentence):
    """A curve that means nothing would be used."""
    with pytest.raises(TwilightError, match=sentence):
        response(which)


def test_what_wavelengths_do_not_cover_is_refused_with_those_that_would():
    """A band would be cut off in silence."""
    with pytest.raises(TwilightError, match=r"U: 96% .* 400 to 700 nm; wavelengths from 3\d\d to 4\d\d nm would"):
        check_covered(response("U"), np.array([400.0, 700.0]))
    with pytest.raises(TwilightError, match=r"y: \d\d% .*\(twilight computes 300 to 1000 nm\)"):
        samples_for([response("y")])
    for name in (*QUANTITIES, "U", "z", "gaia-G", "SQM"):
        chosen = samples_for(quantity(name).responses())
        for one in quantity(name).responses():
            check_covered(one, np.array(chosen))
    with pytest.raises(TwilightError, match=r"illuminance is of a surface .*luminance is the one of a direction"):
        check_of(quantity("illuminance"), "direction")
    assert unit_of(quantity("in:V"), "direction") == "W m-2 sr-1" and quantity("CCT").variable == "cct_k"
    with pytest.raises(TwilightError, match="system 'ST'"):
        quantity("V:ST")


def test_every_response_has_a_source_and_a_maximum_of_about_one():
    """A shipped curve would be of nobody, or in per cent."""
    for name in responses.names():
        found: Response = response(name)
        assert found.source and 0.0 < found.value.max() <= 1.001


def test_the_ultraviolet_index_of_a_high_sun_is_that_of_the_formula():
    """Madronich 2007 (Photochem. Photobiol. 83, 1537): 12.5 mu^2.42 (O3 / 300 DU)^-1.23 over dark ground in clean
    air, to 10 % for suns above 30 deg and 200 to 400 DU."""
    ozone_du, sun_deg = 300.0, 60.0
    settings = {"gases.ozone.column_du": ozone_du, "ground.albedo": 0.05, "solver.polarisation": False}
    field = twilight.solve(
        "pure-air", sun_elevation_deg=sun_deg, quality="draft", settings=settings,
        wavelength_nm=samples_for([response("erythema")]),
    )  # fmt: skip
    formula = 12.5 * np.sin(np.radians(sun_deg)) ** 2.42 * (ozone_du / 300.0) ** -1.23
    assert float(field.measure("uv_index", sun_deg, direct=True)) == pytest.approx(formula, rel=0.12)
    # a field and the ground under it: one quantity, two ways
    assert float(field.measure("in:erythema", sun_deg, direct=True)) * 40.0 == pytest.approx(
        float(field.measure("uv_index", sun_deg, direct=True))
    )


@pytest.mark.parametrize("sun_deg", [2.0, -5.0, -8.5])
def test_the_chosen_wavelengths_have_the_light_of_fine_spectra(sun_deg):
    """Nine that missed ozone's peak had 4 % too much illuminance in twilight."""
    fine = np.arange(392.0, 760.0, 8.0)
    sky = {
        name: twilight.solve(
            "continental-average", sun_elevation_deg=sun_deg, solver="compact", wavelength_nm=nm,
            settings={"gases.water_vapour.column_mm": 0.0, "gases.oxygen": False},
        )
        for name, nm in {"few": samples_for([response("photopic")]), "fine": fine}.items()
    }  # fmt: skip
    few, true = (float(sky[name].measure("illuminance", sun_deg)) for name in ("few", "fine"))
    assert few == pytest.approx(true, rel=0.008)
