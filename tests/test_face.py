"""`import twilight` alone suffices for a sky."""

from __future__ import annotations

from datetime import datetime

import numpy as np
import pytest

import twilight

SMALL = {"texture.resolution_deg": 15, "wavelengths.list_nm": [450, 550, 650]}


def test_a_sky_in_one_line():
    sky = twilight.render("continental-average", sun_elevation_deg=30, solver="preetham", settings=SMALL)
    assert isinstance(sky, twilight.Sky) and sky.sun_elevation_deg == 30 and sky.illuminance_lux() > 1000
    several = twilight.render("continental-average", sun_elevation_deg=[30, 60], solver="preetham", settings=SMALL)
    assert [one.sun_elevation_deg for one in several] == [30, 60]
    assert np.array_equal(several[0].radiance, sky.radiance)


@pytest.mark.parametrize("at", ("2026-06-21T12:00", datetime(2026, 6, 21, 12)))
def test_a_time_and_a_place(at):
    where = {"latitude_deg": 52.5, "longitude_deg": 13.4, "time_zone": "Europe/Berlin"}
    sky = twilight.render("continental-average", at=at, **where, solver="preetham", settings=SMALL)
    assert 55 < sky.sun_elevation_deg < 62


def test_what_is_offered_is_there_and_nothing_else():
    assert set(twilight.__all__) == set(dir(twilight)) and all(hasattr(twilight, name) for name in twilight.__all__)
    with pytest.raises(AttributeError):
        twilight.nothing  # noqa: B018
    with pytest.raises(twilight.TwilightError, match="either sun_elevation_deg or at"):
        twilight.render("urban", sun_elevation_deg=1, at="2026-06-21T12:00")
