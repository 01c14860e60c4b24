"""What lay beyond the horizon, from spectra of level ground: `twilight validate spectra`."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
import yaml
from typer.testing import CliRunner

from twilight.atmosphere.screen import Screen
from twilight.base.errors import TwilightError
from twilight.cli.app import app
from twilight.config import load
from twilight.numerics.directions import hemisphere
from twilight.scene import resolve
from twilight.solvers import zones
from twilight.studies.validate.measured import spectra
from twilight.studies.validate.measured.spectra import HEIGHTS_KM, WAVELENGTHS_NM, Basis, Recorded, fit, read_spectra

SUNS = np.arange(0.0, -9.0, -1.0)
RISES = np.array([0.3, 0.0, 0.0, 0.1, 0.4, 0.2, 0.0, 0.0, 0.0])
RISES = np.concatenate([RISES, [1.0 - RISES.sum()]])


def smooth_basis() -> Basis:
    """Light that comes from the higher the lower the sun, the redder the lower: made up, of full rank."""
    nm, top = np.array(WAVELENGTHS_NM), np.array([0.0, *HEIGHTS_KM[1:]])
    from_height = 5.0 - 1.2 * SUNS[:, None] + np.linspace(3.0, -3.0, nm.size)[None]
    passed = 1.0 / (1.0 + np.exp((top[:, None, None] - from_height[None]) / 2.5))
    level = np.exp(0.9 * SUNS)[:, None] * (1.0 + 0.3 * np.sin(nm / 40.0))
    passed[0] = 1.0
    return Basis(150.0, passed * level, passed[:, :, 5] * level[:, 5])


def recorded_under(basis: Basis, rises: np.ndarray, factor=1.0) -> Recorded:
    levels = np.linspace(0.4, 2.0, SUNS.size)[:, None]
    return Recorded(SUNS, np.array(WAVELENGTHS_NM), factor * levels * np.tensordot(rises, basis.ground, 1))


def test_a_known_screen_comes_back():
    """Fails if levels were fitted as colours, the rises were not those of T, or the derivatives were wrong."""
    basis = smooth_basis()
    found = fit(recorded_under(basis, RISES), basis, np.inf)
    assert found.rms < 1e-3 and np.allclose(found.transmission, np.cumsum(RISES), atol=0.03)
    assert np.all(found.stderr < 0.1)
    cover, top, spread = found.clouds
    middle = 0.5 * (np.array(HEIGHTS_KM[1:]) + np.array(HEIGHTS_KM[:-1]))
    mean = RISES[1:] @ middle / 0.7
    assert (cover, top) == (pytest.approx(0.7, abs=0.03), pytest.approx(mean, abs=0.3))
    assert spread == pytest.approx(np.sqrt(RISES[1:] @ (middle - mean) ** 2 / 0.7), abs=0.5)
    assert found.screen().at(HEIGHTS_KM) == pytest.approx(found.transmission)


def test_a_wrong_calibration_is_distinguished_from_a_screen():
    """A sensor that counts red low at all suns would be taken for clouds."""
    basis = smooth_basis()
    factor = np.linspace(1.2, 0.8, len(WAVELENGTHS_NM))
    spoilt = recorded_under(basis, RISES, factor)
    free, fixed = (fit(spoilt, basis, np.inf, freed) for freed in (True, False))
    assert free.rms < 1e-3 < fixed.rms
    assert np.allclose(free.calibration / free.calibration[5], factor / factor[5], rtol=2e-2)


def test_the_zenith_keeps_its_light():
    """The colours alone would darken a zenith that nobody saw dark."""
    basis = smooth_basis()
    light = recorded_under(basis, RISES)
    low = light.sun_deg <= spectra.ZENITH_BELOW_DEG
    assert fit(light, basis, np.inf).zenith_mag[low].max() > 0.02
    assert fit(light, basis, 0.01).zenith_mag[low].max() <= 0.01 + 1e-6


def test_light_under_a_screen_is_that_of_its_parts():
    """T(h) of any shape is a sum of rises: fails if the light were not linear in it, or the parts were cut wrongly."""
    coarse = {"altitude_density": 0.5, "zenith_density": 0.6, "polar_directions": 6, "beam_density": 0.5}
    solver = {"quality": "draft", "max_orders": 1, "polarisation": False, "expert": coarse}
    config = load(
        {"version": 1, "climate": "pure-air", "sun": {"elevation_deg": -4}, "solver": solver, "horizon": "clean"}
    )
    suns = np.array([0.0, -4.0])
    (basis,) = spectra.bases(config, Recorded(suns, np.array([450.0, 550.0]), np.ones((2, 2))), (150.0,))
    scene = resolve(config, wavelength_nm=np.array([450.0, 550.0]))
    screen = Screen(HEIGHTS_KM, tuple(np.cumsum(RISES).clip(0.0, 1.0)), 150.0)
    field = zones.prepare(replace(scene.medium, screen=screen), scene.settings)
    passed, zenith = np.tensordot(RISES, basis.ground, 1), RISES @ basis.zenith
    e, a, weight = hemisphere(-4.0)
    colour = weight @ field.radiance(-4.0, e, a)
    bare = basis.ground[0, 1] / (weight @ zones.prepare(scene.medium, scene.settings).radiance(-4.0, e, a))
    assert np.allclose(passed[1], colour * bare, rtol=2e-3)
    assert np.allclose(zenith, [field.radiance(s, [90.0], [0.0])[0, 1] for s in suns], rtol=2e-3)
    assert len(basis.ground) == 1 + len(list(pairwise(HEIGHTS_KM)))


def test_files(tmp_path, monkeypatch):
    """The whole command on a made-up evening; `evening.yaml` is a configuration with that screen."""
    basis = smooth_basis()
    monkeypatch.setattr(spectra, "bases", lambda *_: [basis])
    light = recorded_under(basis, RISES)
    file = tmp_path / "evening.csv"
    lines = [",".join(["run", "sun_elevation_deg", *(f"{nm:g}" for nm in light.wavelength_nm)])]
    lines += [
        ",".join([run, f"{sun:g}", *(f"{x:.8g}" for x in row)])
        for run in ("a", "b")
        for sun, row in zip(SUNS, light.irradiance, strict=True)
    ]
    file.write_text("\n".join(["# made up", *lines]) + "\n")
    out = tmp_path / "out"
    words = ["validate", "spectra", str(file), "--output", str(out), "--zenith", "inf", "--set", "ground.albedo=0.31"]
    done = CliRunner().invoke(app, [*words, "--series", "b"])
    assert done.exit_code == 0, done.output
    assert "from 150 km on: clouds that stop 7" in done.output and "wrote fits.csv" in done.output
    assert {p.name for p in out.iterdir()} == {"fits.csv", "residuals.csv", "spectra.png", "evening.yaml"}
    text = yaml.safe_load((out / "evening.yaml").read_text())
    medium = resolve(load(text)).medium
    screen = medium.screen
    assert np.allclose(medium.ground_albedo, 0.31)
    assert screen.from_km == 150.0 and np.allclose(screen.transmission, np.cumsum(RISES), atol=0.03)
    done = CliRunner().invoke(app, words)
    assert done.exit_code == 2 and "--series must be one of a, b" in done.output + done.stderr
    wrong = {
        ("--suns", "-8,0"): "the higher one first",
        ("--suns", "0"): "--suns: 0 must be two elevations",
        ("--from-km", "x"): "--from-km: x must be numbers",
        ("--suns", "-7,-8"): "needed are 3 suns",
    }
    for more, said in wrong.items():
        done = CliRunner().invoke(app, [*words, "--series", "b", *more])
        assert done.exit_code == 2 and said in (done.output + done.stderr).replace("\n", " ")


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("", "needs a first line with sun_elevation_deg"),
        ("sun_elevation_deg,550\n0,1\n", "two wavelengths"),
        ("sun_elevation_deg,450,550\n0,1,dark\n", "line 2: .* must be numbers"),
        ("sun_elevation_deg,450,550\n-95,1,1\n", "line 2: sun_elevation_deg is -95"),
    ],
)
def test_a_broken_file_is_one_sentence(tmp_path, text, said):
    """A file that means nothing would be fitted."""
    file = tmp_path / "broken.csv"
    file.write_text(text)
    with pytest.raises(TwilightError, match=f"broken.csv: .*{said}"):
        read_spectra(file)


def test_a_screen_of_the_configuration_is_refused():
    """It would be fitted on top of itself."""
    config = load({"version": 1, "climate": "pure-air", "horizon": {"screen": {"clouds": {}}}})
    with pytest.raises(TwilightError, match="what is fitted"):
        spectra.bases(config, Recorded(SUNS, np.array([450.0, 550.0]), np.ones((9, 2))))
