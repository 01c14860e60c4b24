"""A sky that clouds cover in part: the mean of the sky under them and of the one between them."""

from __future__ import annotations

from datetime import UTC, datetime

import numpy as np
import pytest

import twilight
from twilight.base.errors import TwilightError
from twilight.config.load import load, load_climate
from twilight.engine.light import LightField, Moments
from twilight.engine.memory import full_cost
from twilight.engine.surfaces import Surface
from twilight.scene import resolve
from twilight.scene.medium import climate_medium
from twilight.sky.night import NightLevels, Place

CLOUDS = [
    {"kind": "altostratus", "optical_depth": 0.5, "cover": 0.3},
    {"kind": "altostratus", "base_km": 5, "optical_depth": 0.2},
]
FAST = {
    f"solver.expert.{key}": value
    for key, value in {"altitude_density": 0.3, "zenith_density": 0.3, "polar_directions": 4, "degree": 8,
                       "max_degree": 8, "late_degree": 4, "late_polar_directions": 4, "early_orders": 1}.items()
}  # fmt: skip
NM = (450.0, 650.0)
SUN = 12.0


def settings_of(cover: float, **more) -> dict:
    first = {**CLOUDS[0], "cover": cover}
    return {"clouds": [first, CLOUDS[1]], **FAST, **more}


@pytest.fixture(scope="module")
def fields():
    """Fields of cover 0.3, 1 and 0."""
    return [
        twilight.solve("pure-air", sun_elevation_deg=SUN, wavelength_nm=NM, quality="draft", settings=settings_of(c))
        for c in (0.3, 1.0, 0.0)
    ]


def mean(values):
    return 0.3 * values[1] + 0.7 * values[2]


def test_all_light_is_the_mean_of_two_skies(fields):
    """A partly covered sky would not be what it says: radiance, Stokes parameters, the sunbeam, its disc, what stands
    before an object, and illuminance."""
    elevation, azimuth = np.array([5.0, 12.0, 40.0, 90.0, -20.0]), np.array([170.0, 10.0, 60.0, 0.0, 0.0])
    for ask in (
        lambda field: field.radiance(SUN, elevation, azimuth, 2.0),
        lambda field: field.stokes(SUN, elevation, azimuth),
        lambda field: field.direct(SUN).irradiance,
        lambda field: field.horizontal_irradiance(SUN, direct=True),
        lambda field: np.array(field.inscatter(SUN, elevation, azimuth, 20.0)),
        lambda field: field.sky(SUN, elevation[:4], np.arange(0.0, 360.0, 90.0)).radiance,
    ):
        found = [ask(field) for field in fields]
        assert np.all(np.isfinite(found[0])) and not np.allclose(found[1], found[2])
        np.testing.assert_allclose(found[0], mean(found), rtol=1e-12, atol=1e-30)
    discs = [field.disc(SUN) for field in fields]
    np.testing.assert_allclose(discs[0].transmittance, mean([d.transmittance for d in discs]), rtol=1e-9, atol=1e-12)


def test_a_render_is_the_mean_of_two_renders():
    """Its pictures and files would show another sky than the field; the night behind the clouds would be left out."""
    night = {"night.airglow": 1.0, "moon": {"elevation_deg": 30.0, "azimuth_deg": 120.0, "phase_angle_deg": 20.0}}
    skies = [
        twilight.render(
            "pure-air", sun_elevation_deg=SUN, wavelength_nm=NM, quality="draft",
            settings=settings_of(c, **night, **{"texture.resolution_deg": 30, "sun.disc": True}),
        )
        for c in (0.3, 1.0, 0.0)
    ]  # fmt: skip
    for name in ("sun_normalised_radiance", "night_radiance", "direct_irradiance", "polarisation"):
        values = [getattr(sky, name) for sky in skies]
        np.testing.assert_allclose(values[0], mean(values), rtol=1e-9, atol=1e-30)
    assert skies[0].provenance["configuration"]["climate"]["clouds"][0]["cover"] == 0.3


def test_light_at_a_place_is_the_mean(fields):
    """Illuminance would be that of the overcast sky."""
    place = Place(50.0, 10.0, datetime(2026, 6, 21, 6, tzinfo=UTC))
    moment = Moments((place,), np.array([SUN]), np.array([80.0]), np.array([1.0]))
    lights = [LightField(field, NightLevels()) for field in fields]
    for source in ("sun", "sky", "airglow"):
        found = [light.surfaces(moment, [Surface.horizontal()], [source]) for light in lights]
        np.testing.assert_allclose(found[0], mean(found), rtol=1e-9)


def test_its_plan_holds_both_fields():
    """A render would take twice the time and memory that its plan says."""
    cost = [
        full_cost(resolve(load("pure-air", {**settings_of(c), "sun.elevation_deg": SUN}), for_plan=True, mixed=True))
        for c in (0.3, 1.0, 0.0)
    ]
    assert cost[0].field_bytes == cost[1].field_bytes + cost[2].field_bytes
    assert max(cost[1].cpu_s, cost[2].cpu_s) < cost[0].cpu_s < cost[1].cpu_s + cost[2].cpu_s


def test_two_covers_are_refused_and_so_is_one_air_of_a_mixture(fields):
    """What is not a mean of two skies would pass for one."""
    two = [{"kind": "stratus", "cover": 0.3}, {"kind": "cirrus", "cover": 0.6}]
    with pytest.raises(TwilightError, match=r"cover is 0\.3, 0\.6: all clouds"):
        load_climate("pure-air", {"clouds": two})
    with pytest.raises(TwilightError, match=r"clouds\[0\]\.cover.*0 to 1.*1\.5"):
        load_climate("pure-air", {"clouds": [{"kind": "stratus", "cover": 1.5}]})
    half = load_climate("pure-air", {"clouds": [{"kind": "stratus", "cover": 0.5}]})
    with pytest.raises(TwilightError, match=r"a cover of 0\.5 is the mean of two skies"):
        climate_medium(half, np.array([550.0]))
    with pytest.raises(TwilightError, match="clouds cover a part of the sky"):
        fields[0].view()
