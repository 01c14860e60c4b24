"""Irradiance in the columns of pvlib: its closure, its planes, and pvlib's own clear sky in light."""

from __future__ import annotations

import numpy as np
import pytest

import twilight
from twilight.base.errors import TwilightError

pandas = pytest.importorskip("pandas")
pvlib = pytest.importorskip("pvlib")

AIR = {
    "version": 1,
    "climate": "continental-clean",
    "wavelengths": {"list_nm": [400, 450, 500, 550, 600, 650, 700]},
    "solver": {"quality": "draft"},
}
PLACE = pvlib.location.Location(28.3, -16.5, altitude=0.0)
TIMES = pandas.DatetimeIndex(["2026-03-20T13:05Z", "2026-03-20T16:30Z", "2026-03-20T19:43Z"])


@pytest.fixture(scope="module")
def frame():
    return twilight.irradiance(TIMES, PLACE, AIR, surface_tilt=35.0, surface_azimuth=180.0)


def test_it_closes_as_pvlib_has_it(frame):
    """ghi = dni cos z + dhi at the refracted sun; the plane's parts add up; in twilight there is no beam."""
    zenith = np.radians(PLACE.get_solarposition(TIMES)["apparent_zenith"])
    sums = (frame.dni * np.cos(zenith) + frame.dhi).to_numpy()
    assert frame.ghi.to_numpy()[:2] == pytest.approx(sums[:2], rel=2e-3)
    parts = frame.poa_direct + frame.poa_sky_diffuse + frame.poa_ground_diffuse
    assert frame.poa_global.to_numpy() == pytest.approx(parts.to_numpy(), rel=1e-4)
    assert frame.dni.iloc[2] == 0.0 and frame.ghi.iloc[2] == frame.dhi.iloc[2] > 0.5  # the sun at -6.5 deg
    aoi = pvlib.irradiance.aoi(35.0, 180.0, np.degrees(zenith), PLACE.get_solarposition(TIMES)["azimuth"])
    beam = (frame.dni * np.cos(np.radians(aoi))).to_numpy()
    assert frame.poa_direct.to_numpy()[:2] == pytest.approx(beam[:2], rel=2e-3)
    assert frame.attrs["units"] == "lx" and frame.index.equals(TIMES)


def test_solar_positions_and_trackers_serve_as_well(frame):
    """pvlib's solar positions in place of times, a tracker's Series in place of numbers."""
    positions = PLACE.get_solarposition(TIMES)
    tilts = pandas.Series([0.0, 35.0, 35.0], TIMES)
    made = twilight.irradiance(positions, climate=AIR, surface_tilt=tilts, surface_azimuth=180.0)
    assert made.ghi.to_numpy() == pytest.approx(frame.ghi.to_numpy(), rel=5e-3)
    assert made.poa_global.iloc[0] == pytest.approx(made.ghi.iloc[0])
    assert made.poa_global.iloc[1] == pytest.approx(frame.poa_global.iloc[1], rel=5e-3)


def test_it_is_the_light_of_light(frame):
    """The same plane by `twilight.light`, whose night adds nothing by day."""
    targets = ["horizontal", "plane:35/180"]
    lux = twilight.light((28.3, -16.5), TIMES, targets, "illuminance", AIR, sources=["sun", "sky", "ground"]).values
    assert lux[:, 0] == pytest.approx(frame.ghi.to_numpy(), rel=1e-3)
    assert lux[:, 1] == pytest.approx(frame.poa_global.to_numpy(), rel=1e-3)


def test_a_clear_noon_is_that_of_pvlib(frame):
    """Lux over the broadband of pvlib's simplified Solis at the same aerosol: between sunlight above the air (133334 lx
    over 1361 W m^-2) and a quarter more, for water takes infrared; the diffuse fraction is the same."""
    noon = frame.iloc[0]
    solis = PLACE.get_clearsky(TIMES[:1], model="simplified_solis", aod700=0.05, precipitable_water=2.0)
    assert 98.0 < noon.ghi / solis.ghi.iloc[0] < 122.0
    assert noon.dhi / noon.ghi == pytest.approx(solis.dhi.iloc[0] / solis.ghi.iloc[0], abs=0.08)


@pytest.mark.parametrize(
    ("change", "sentence"),
    [
        ({"place": None}, "needs a place"),
        ({"quantity": "cct"}, "does not add up"),
        ({"quantity": "luminance"}, "is of a direction"),
        ({"surface_tilt": 10.0}, "go together"),
        ({"surface_tilt": [1.0, 2.0], "surface_azimuth": 0.0}, "one for each time"),
        ({"times": pandas.DataFrame({"zenith": [1.0, 2.0, 3.0]}, TIMES)}, "elevation and azimuth"),
        ({"times": TIMES[:0]}, "none is given"),
        ({"times": ["soon"]}, "must be a DatetimeIndex, a list of times"),
        ({"times": TIMES.append(pandas.DatetimeIndex([pandas.NaT], tz="UTC"))}, "one is NaT"),
        ({"times": pandas.DataFrame({"elevation": [1.0, np.nan, 3.0], "azimuth": 0.0}, TIMES)}, "elevation must be"),
        ({"times": pandas.DataFrame({"elevation": [1.0, 2.0, 3.0], "azimuth": "south"}, TIMES)}, "azimuth must be"),
        ({"quantity": "in:I"}, "beyond the wavelengths"),
    ],
)
def test_bad_input_is_one_sentence(change, sentence):
    asked = {"times": TIMES, "place": PLACE, "climate": AIR} | change
    with pytest.raises(TwilightError, match=sentence) as error:
        twilight.irradiance(**asked)
    assert "\n" not in str(error.value)
