"""Extreme air for the stability tests: many extremes at once, one for each wavelength, and odd levels."""

from dataclasses import dataclass, replace

import numpy as np

from twilight.atmosphere.levels import layer_mean
from twilight.atmosphere.medium import Medium
from twilight.numerics.phase import PhaseFunction

LEVELS_KM = np.concatenate([np.arange(0.0, 10.0, 1.0), np.linspace(10.0, 80.0, 15)])


@dataclass(frozen=True)
class Air:
    """Exponential air (scale height 8 km), aerosol (1.5 km) and an ozone layer (22 km) by their vertical depths."""

    air: float = 0.1
    aerosol: float = 0.1
    albedo: float = 0.95
    asymmetry: float = 0.7
    ozone: float = 0.0
    ground: float = 0.1


EXTREMES: dict[str, Air] = {
    "conservative pure air": Air(aerosol=0.0),
    "aerosol optical depth 20": Air(aerosol=20.0),
    "a white fog over snow": Air(aerosol=20.0, albedo=1.0, ground=1.0),
    "asymmetry 0.98": Air(aerosol=1.0, asymmetry=0.98),
    "soot that does not scatter": Air(aerosol=2.0, albedo=0.0),
    "isotropic and white, over snow": Air(asymmetry=0.0, albedo=1.0, ground=1.0),
    "300 nm": Air(air=1.2, ozone=3.0),  # optical depth 100 along the beam of a low sun
    "nothing": Air(air=0.0, aerosol=0.0, ground=1.0),
}
"""Each is one wavelength of `extremes()`, so that one solve serves all, and one cannot disturb its neighbours."""


def medium_of(*airs: Air, levels_km=LEVELS_KM, refractivity: float = 2.8e-4) -> Medium:
    """Air with one column of depths for each wavelength."""
    z = np.asarray(levels_km, dtype=float)
    ones = np.ones((z.size, len(airs)))

    def profile(shape, depths) -> np.ndarray:
        column = np.sum(layer_mean(shape[:-1], shape[1:]) * np.diff(z))
        return shape[:, None] / column * np.array(depths)

    return Medium(
        wavelength_nm=np.linspace(300.0, 1000.0, len(airs)) if len(airs) > 1 else np.array([550.0]),
        altitude_km=z,
        air_scattering_per_km=profile(np.exp(-z / 8.0), [a.air for a in airs]),
        absorption_per_km=profile(np.exp(-(((z - 22.0) / 6.0) ** 2)), [a.ozone for a in airs]),
        aerosol_extinction_per_km=profile(np.exp(-z / 1.5), [a.aerosol for a in airs]),
        aerosol_single_scattering_albedo=ones * [a.albedo for a in airs],
        aerosol_phase_fraction=ones[None],
        phase_functions=(PhaseFunction.henyey_greenstein([a.asymmetry for a in airs]),),
        refractivity=refractivity * np.exp(-z / 8.0)[:, None] * ones,
        depolarisation=np.zeros(len(airs)),
        ground_albedo=np.array([a.ground for a in airs]),
        overhead_absorption_optical_depth=np.zeros(len(airs)),
        name="test",
    )


def extremes() -> Medium:
    """Every one of EXTREMES at a wavelength of its own."""
    return medium_of(*EXTREMES.values())


def haze_layer() -> Medium:
    """A layer 10 m thick with an optical depth of 0.5 at an altitude of 1 km."""
    medium = medium_of(Air(), levels_km=[0.0, 0.5, 1.0, 1.0, 1.01, 1.01, 2.0, 5.0, 10.0, 20.0, 40.0, 80.0])
    aerosol = np.zeros_like(medium.aerosol_extinction_per_km)
    aerosol[3:5] = 50.0
    return replace(medium, aerosol_extinction_per_km=aerosol)


def ducting() -> Medium:
    """A refractive index that falls faster than 1 / radius in the lowest 100 m: rays there follow the ground."""
    medium = medium_of(Air(), levels_km=[0.0, 0.1, 1.0, 2.0, 4.0, 8.0, 12.0, 20.0, 30.0, 50.0, 80.0])
    refractivity = medium.refractivity.copy()
    refractivity[0] = refractivity[1] + 4e-5  # dn/dh = -4e-4 per km, 1 / radius is 1.6e-4
    return replace(medium, refractivity=refractivity)


STRUCTURES = {
    "two levels": lambda: medium_of(Air(), levels_km=[0.0, 60.0]),
    "ten metres of air": lambda: medium_of(Air(), levels_km=[0.0, 0.01]),
    "500 levels": lambda: medium_of(Air(), levels_km=np.linspace(0.0, 80.0, 500)),
    "a haze 10 m thick": haze_layer,
    "ducting": ducting,
    "nothing at all": lambda: medium_of(Air(air=0.0, aerosol=0.0, ground=1.0), refractivity=0.0),
    "next to nothing": lambda: medium_of(Air(air=1e-12, aerosol=1e-12)),
    "black": lambda: medium_of(Air(ozone=100.0)),
    "black as night": lambda: medium_of(Air(ozone=1e3)),  # exp(-1000) is 0 straight up too
}


def horizon_deg(altitude_km: float, radius_km: float = 6371.0) -> float:
    """Elevation of the geometric horizon [deg], not above 0."""
    return -float(np.degrees(np.arccos(radius_km / (radius_km + altitude_km))))


SUNS_DEG = (90.0, 30.0, 0.0, -0.57, -6.0, -18.0, -40.0, -90.0)
ELEVATION_DEG = np.array([-90.0, -10.0, -0.5, 0.0, 0.5, 5.0, 30.0, 60.0, 90.0])
AZIMUTH_DEG = np.array([0.0, 20.0, 0.0, 180.0, 0.0, 180.0, 0.0, 90.0, 0.0])


def assert_sane(radiance: np.ndarray, what: str, brightest: float | None = None) -> None:
    """Finite, not negative, not brighter than [sr^-1]."""
    assert np.all(np.isfinite(radiance)), f"{what}: not finite at {np.argwhere(~np.isfinite(radiance)).tolist()[:8]}"
    assert np.all(radiance >= 0.0), f"{what}: negative at {np.argwhere(radiance < 0).tolist()[:8]}"
    if brightest is not None:
        worst = np.unravel_index(np.argmax(radiance), radiance.shape)
        assert radiance[worst] <= brightest, f"{what}: {radiance[worst]:.3g} at {worst}"
