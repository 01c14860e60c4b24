"""The eye and the camera: CIE 191, thresholds, colour at low light; exposure, white balance, noise; dither."""

import json

import numpy as np
import pytest
from PIL import Image
from toy_sky import glow_sky

from twilight.base.errors import TwilightError
from twilight.io.folder import write_outputs
from twilight.io.picture import to_bytes
from twilight.numerics import spectrum
from twilight.sky import colour
from twilight.sky.quantities.measure import adaptation_coefficient
from twilight.sky.quantities.responses import SCOTOPIC_EFFICACY_LM_PER_W, scotopic_efficiency
from twilight.sky.tone import (
    SENSORS,
    Camera,
    Eye,
    Light,
    Shot,
    acuity_cycles_per_deg,
    adapt,
    balance,
    cone_threshold,
    illuminant,
    rod_threshold,
    tone_of,
)

SUN = Light(spectrum.DEFAULT_SOLAR_SPECTRUM, 1.0)
NM = np.arange(380.0, 721.0, 20.0)


def of_spectrum(tone, radiance):
    """What a tone sees of a radiance [W m^-2 sr^-1 nm^-1] at VISIBLE_NM."""
    factor = np.interp(NM, spectrum.VISIBLE_NM, radiance) / spectrum.solar_irradiance(NM)
    return tone.see(factor, NM, SUN)


@pytest.mark.parametrize("ratio", (0.65, 1.0, 2.05, 3.5))
def test_mesopic_luminance_solves_the_equations_of_cie_191(ratio):
    """Dim light would be seen brighter or darker than CIE 191 says."""
    photopic = np.geomspace(6e-3, 4.0, 9)
    m, mesopic = adaptation_coefficient(photopic, ratio * photopic)
    assert np.allclose(m, np.clip(0.7670 + 0.3334 * np.log10(mesopic), 0.0, 1.0), atol=1e-6)
    v = 683.0 / 1699.0
    assert np.allclose(mesopic * (m + (1 - m) * v), m * photopic + (1 - m) * v * ratio * photopic)
    # bluish light (S/P over 1) looks brighter, reddish darker, the more so the darker it is
    gain = mesopic / photopic
    if ratio != 1.0:
        assert ((gain > 1) == (ratio > 1)).all() and (np.diff(np.abs(np.log(gain))) < 0).all()
    else:
        assert np.allclose(gain, 1.0)


def test_day_and_night_vision_are_the_ends():
    """Cones would see at night, or rods by day."""
    m, mesopic = adaptation_coefficient(np.array([50.0, 1e-4]), np.array([100.0, 3e-4]))
    assert m.tolist() == [1.0, 0.0] and np.allclose(mesopic, [50.0, 3e-4])
    m, _ = adaptation_coefficient(np.geomspace(1e-4, 20, 60), 2 * np.geomspace(1e-4, 20, 60))
    assert (np.diff(m) >= 0).all()
    # 683 lm/W at 555 nm for rods too, and the maximum at 507 nm
    assert SCOTOPIC_EFFICACY_LM_PER_W * scotopic_efficiency()[555 - 360] == pytest.approx(683.0, rel=2e-3)
    assert spectrum.VISIBLE_NM[np.argmax(scotopic_efficiency())] == pytest.approx(507, abs=1)


def test_thresholds_and_acuity_are_continuous_and_end_where_published():
    """An eye's picture would jump as it gets dark."""
    for threshold, joints in ((cone_threshold, (-2.6, 1.9)), (rod_threshold, (-3.94, -1.44))):
        for x in joints:
            assert threshold(10 ** (x - 1e-6)) == pytest.approx(threshold(10 ** (x + 1e-6)), rel=0.04)
        assert threshold(1e-6) == pytest.approx(threshold(1e-5))  # the dark light of the eye
    assert cone_threshold(2000.0) / cone_threshold(1000.0) == pytest.approx(2.0)  # Weber's law
    assert rod_threshold(1e-4) < cone_threshold(1e-4) and cone_threshold(10.0) < rod_threshold(10.0)
    assert acuity_cycles_per_deg(1000.0) == pytest.approx(49.0, abs=1.0)  # Shlaer 1937: some 50
    assert 2.0 < acuity_cycles_per_deg(1e-3) < 5.0


def test_colour_goes_with_the_light_and_turns_blue():
    """A night would be as colourful as a day."""
    eye = Eye(acuity=False)
    orange = np.tile(of_spectrum(eye, 1e-3 * np.exp(-(((spectrum.VISIBLE_NM - 610.0) / 60.0) ** 2))), (4, 4, 1))

    def shown(dimming):
        display, facts = eye.develop(orange * dimming, Shot(0.0, 0.1))
        return display[0, 0], facts

    day, _ = shown(1e4)
    dusk, _ = shown(3e-1)
    night, facts = shown(1e-5)
    assert day[0] > 1.5 * day[2] and night[2] > night[0]
    assert (day[0] - day[2]) > (dusk[0] - dusk[2]) > (night[0] - night[2])
    assert facts["adaptation_coefficient"] == 0.0 and night.max() < 0.6 * day.max()
    # an eye that is still adapted to brighter light sees less
    late, _ = Eye(acuity=False, adapted_cd_per_m2=1.0).develop(orange * 1e-2, Shot(0.0, 0.1))
    assert late.max() < shown(1e-2)[0].max()


def test_fine_details_are_lost_at_night_alone():
    """An eye would see as sharply at night."""
    rows = np.arange(64)[:, None, None]
    eye = Eye()
    grating = np.where(rows % 8 < 4, 1.2, 0.8) * np.ones((1, 8, 4))  # 8 pixels of 0.02 deg: 6.25 cycles/deg

    def contrast(level):
        display, _ = eye.develop(level * grating, Shot(0.0, 0.02))
        return np.ptp(display[16:48, :, 2]) / display[16:48, :, 2].mean()

    assert contrast(1e-3) < 0.25 * contrast(1e3)


def test_adaptation_follows_light_at_once_and_the_dark_slowly():
    """An eye would adapt to the dark at once."""
    t = np.arange(0.0, 4000.0, 10.0)
    light = np.where(t < 1000.0, 100.0, 1e-3)
    state = adapt(t, light)
    assert state[50] == pytest.approx(100.0) and 1e-3 < state[110] < 50.0 and state[-1] < 2e-3
    assert (np.diff(state) <= 1e-9).all()
    assert adapt([0.0, 10.0], [1.0, 50.0])[1] == pytest.approx(50.0)
    ten_minutes = np.interp(1600.0, t, np.log10(state))
    assert -3.0 < ten_minutes < 0.5  # dark adaptation takes longer than that


@pytest.mark.parametrize("sensor", SENSORS)
@pytest.mark.parametrize("kelvin", (3000.0, 5500.0, 9000.0))
def test_the_light_of_the_white_balance_is_white_at_its_luminance(sensor, kelvin):
    """A white balance would tint white."""
    light = 1e-3 * illuminant(kelvin) / illuminant(kelvin).mean()
    tone = Camera(sensor=sensor, white_balance_k=kelvin, noise=False)
    gains, matrix = balance(sensor, kelvin)
    assert np.allclose(matrix.sum(axis=1), 1.0) and (gains > 0).all()
    seen = of_spectrum(tone, light)
    assert np.allclose(seen[[0, 2, 3]], seen[1], rtol=0.03)
    display, _ = tone.develop(np.tile(seen, (2, 2, 1)), Shot(float(np.log2(seen[1] / 0.125)), 0.1))
    assert np.ptp(display) < 0.02
    # metered mean light is middle grey
    grey = colour.srgb_encode(colour.photographic(np.full(3, 0.18)))[0]
    assert display.mean() == pytest.approx(float(grey), abs=0.02)


def test_exposure_follows_time_aperture_and_iso():
    """An exposure would not be that of its time, aperture and ISO."""
    seen = np.full((2, 2, 4), 100.0)

    def brightness(**settings):
        return Camera(noise=False, **settings).develop(seen, Shot(0.0, 0.1))[0].mean()

    base = brightness(seconds=0.01, f_number=4.0, iso=100.0)
    assert brightness(seconds=0.02, f_number=4.0, iso=50.0) == pytest.approx(base)
    assert brightness(seconds=0.04, f_number=8.0, iso=100.0) == pytest.approx(base)
    assert brightness(seconds=0.02, f_number=4.0, iso=100.0) > base
    metered = Camera(noise=False).develop(seen, Shot(9.0, 0.1))[1]
    assert metered["seconds"] == pytest.approx(16.0 / 512.0) and metered["exposure_ev100"] == pytest.approx(9.0)
    dark = Camera(noise=False).develop(seen, Shot(-9.0, 0.1))[1]
    assert dark["seconds"] == 30.0 and dark["exposure_ev100"] > -9.0  # the meter's longest


@pytest.mark.parametrize("sensor", SENSORS)
@pytest.mark.parametrize("power", (-4.0, -1.0, 2.0, 5.0))
def test_highlights_reach_white_without_a_fringe(sensor, power):
    """From blue or orange light ever brighter to white: the order of the channels stays, and colour only fades."""
    camera = Camera(sensor=sensor, noise=False, seconds=1.0)
    seen = of_spectrum(camera, 1e-3 * (spectrum.VISIBLE_NM / 550.0) ** power)
    light = seen / seen[1] * 19.2 * 2.0 ** np.linspace(-3.0, 4.0, 300)[:, None]  # 19.2 cd m^-2 saturate it
    display, _ = camera.develop(light[None], Shot(0.0, 0.1))
    shown = display[0]
    assert np.allclose(shown[-1], 1.0) and (np.diff(shown, axis=0) > -0.003).all()
    assert np.diff(shown, axis=0).max() < 0.05  # no edge
    order = np.argsort(shown[0])
    assert (np.diff(shown[:, order], axis=1) > -1e-9).all()


def test_noise_is_that_of_photons_and_grows_with_iso():
    """Noise would be no photon noise, or another in every run."""
    seen = np.full((200, 200, 4), 10.0)

    def spread(iso):
        tone = Camera(iso=iso)
        signal = tone._with_noise(np.full((200, 200, 3), 0.2), 1.0)
        return signal.std(), signal.mean()

    low, mean = spread(100.0)
    high, _ = spread(1600.0)
    assert mean == pytest.approx(0.2, rel=1e-3)
    assert low == pytest.approx(np.sqrt(0.2 * 60000 + 9) / 60000, rel=0.03)
    assert high / low == pytest.approx(4.0, rel=0.03)
    one, two = (Camera(iso=3200.0).develop(seen, Shot(3.0, 0.1))[0] for _ in range(2))
    assert (one == two).all() and one.std() > 0


def test_a_camera_needs_colours():
    """A camera would make colours of two wavelengths."""
    with pytest.raises(TwilightError, match="needs wavelengths"):
        Camera().see(np.ones((1, 2)), np.array([550.0, 600.0]), SUN)
    with pytest.raises(TwilightError, match="not known"):
        tone_of("film noir", "cie1931_2deg")


@pytest.mark.parametrize("tone", ("eye", "camera"))
def test_luminances_lie_beside_the_picture(tone, tmp_path):
    """A picture of an eye would not say how bright its sky is."""
    sky = glow_sky(step_deg=15.0)
    written = write_outputs(sky, tmp_path, files=("png",), tone_mapping=tone, tone_settings={"camera": {"iso": 800.0}})
    assert [p.name for p in written] == ["sky.png", "sky.luminance.json"]
    facts = json.loads(written[1].read_text())
    assert facts["luminance_cd_per_m2"]["zenith"]["photopic"] == pytest.approx(sky.luminance_at(90.0), rel=0.02)
    assert facts["sky_illuminance_lux"] == pytest.approx(sky.illuminance_lux())
    picture = Image.open(written[0])
    assert picture.info["tone_mapping"] == tone
    if tone == "camera":
        assert facts["iso"] == 800.0 and picture.info["sensor"] == "Nikon 5100 (NPL)"
    else:
        assert 0.0 <= facts["adaptation_coefficient"] <= 1.0
    plain = write_outputs(sky, tmp_path / "plain", files=("png",))
    assert [p.name for p in plain] == ["sky.png"]
    assert (np.asarray(Image.open(plain[0])) != np.asarray(picture)).any()


def test_eight_bits_show_no_bands():
    """A ramp over less than three steps: its local means are the ramp, and no two columns of a step look alike."""
    ramp = np.linspace(0.400, 0.410, 1024)[None, :, None] * np.ones((64, 1, 3))
    pixels = to_bytes(ramp).astype(float) / 255.0
    means = pixels.reshape(4, 16, 64, 16, 3).mean(axis=(1, 3))
    assert np.abs(means - ramp.reshape(4, 16, 64, 16, 3).mean(axis=(1, 3))).max() < 0.15 / 255
    assert len(np.unique(pixels)) <= 5 and (to_bytes(ramp) == to_bytes(ramp)).all()
    assert to_bytes(np.array([[[0.0, 1.0, np.nan]]])).ravel().tolist()[1:] == [255, 0]
    channels = to_bytes(np.full((64, 64, 3), 0.4021)).reshape(-1, 3)
    assert (channels[:, 0] != channels[:, 2]).any()  # not the same pattern in all


def test_a_notebook_is_dithered_too():
    """A notebook's sky would show bands."""
    from twilight.api.representation import _bytes

    grey = np.full((32, 32, 3), 0.5 + 0.4 / 255)
    assert len(np.unique(_bytes(grey))) == 2
