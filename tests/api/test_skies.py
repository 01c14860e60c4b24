"""`skies`: many airs, observers and suns at once."""

import numpy as np
import pytest

import twilight

E, A = np.array([[2.0], [40.0]]), np.array([0.0, 90.0, 180.0])


def test_they_are_the_skies_of_fields():
    """A sweep in one call would mix airs, observers or suns."""
    airs = [twilight.load("urban", {"climate.aerosol.optical_depth_550nm": depth}) for depth in (0.1, 0.3)]
    light, error = twilight.skies(airs, [-5.0, 3.0], E, A, altitude_km=[0.0, 2.5], wavelength_nm=[450.0, 650.0])
    assert light.shape == (2, 2, 2, 2, 3, 2) and error.shape == (2, 2, 2)
    assert ((error > 0.001) & (error < 0.3)).all()
    for n, air in enumerate(airs):
        field = twilight.solve(air, wavelength_nm=[450.0, 650.0], solver="compact")
        for o, altitude in enumerate((0.0, 2.5)):
            for s, sun in enumerate((-5.0, 3.0)):
                exact = field.radiance(sun, *np.broadcast_arrays(E, A), altitude)
                np.testing.assert_allclose(light[n, o, s], exact, rtol=1e-6)


@pytest.mark.parametrize(
    ("scenes", "more", "words"),
    [
        ([], {}, "scenes is empty"),
        (["urban"], {"sun_elevation_deg": [-20.0]}, "is -20; the compact solver allows -18 to 90"),
        (["urban"], {"elevation_deg": [-3.0]}, "above the horizon only"),
        (["urban"], {"altitude_km": [30.0]}, "up to 15 km above the ground"),
        (["urban", "overcast-stratus"], {}, "air without clouds"),
        (["urban", "bruneton2008"], {}, "air of 95 to 100.5 km"),
    ],
)
def test_what_one_of_them_cannot_have_is_refused_before_any_is_computed(scenes, more, words):
    """An hour of skies would be lost at the last one."""
    with pytest.raises(twilight.TwilightError, match=words):
        twilight.skies(scenes, **{"sun_elevation_deg": [-4.0], "elevation_deg": 90.0, "azimuth_deg": 0.0, **more})
