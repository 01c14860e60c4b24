"""Computed skies as luminance and chromaticity: what formulae are fitted to."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from twilight import solvers
from twilight.base.errors import TwilightError
from twilight.base.progress import Progress, silent
from twilight.config.scene import Config
from twilight.engine.field import solve
from twilight.numerics import spectrum
from twilight.numerics.phase import PhaseFunction
from twilight.scene import Scene
from twilight.scene.medium import climate_medium, wavelengths_of
from twilight.scene.plan import make_plan
from twilight.sky.colour import colour_is_defined
from twilight.sky.sky import Sky
from twilight.solvers.analytic import aerial

if TYPE_CHECKING:
    from twilight.atmosphere.medium import Medium

AUREOLE_DEG = 2.5
"""Directions this close to the sun are left out: five parameters cannot follow the forward peak of an aerosol."""
HAZES = ("climate", "preetham1999")
"""Aerosols of the skies: that of the climate, or that of Preetham 1999."""


@dataclass(frozen=True)
class ColourSky:
    """One sky in the CIE 1931 system, by direction (D,).

    elevation_deg, azimuth_deg (from the sun); weight: of the solid angle, sums to 1; luminance [cd m^-2]; x, y.
    """

    sun_elevation_deg: float
    turbidity: float
    elevation_deg: np.ndarray
    azimuth_deg: np.ndarray
    weight: np.ndarray
    luminance: np.ndarray
    x: np.ndarray
    y: np.ndarray

    def quantity(self, name: str) -> np.ndarray:
        """`luminance`, `x` or `y`."""
        return getattr(self, name)


@dataclass(frozen=True)
class Truth:
    """Skies of several turbidities and suns, and the time that they took [s], of the processor and by the clock."""

    skies: tuple[ColourSky, ...]
    cpu_s: float
    wall_s: float


def spiral(count: int) -> tuple[np.ndarray, np.ndarray]:
    """Elevation and azimuth from the sun [deg] of directions that divide half of the sky evenly, (count,).

    A Fibonacci spiral in sin(elevation), folded onto azimuths of 0 to 180 deg: the other half is its mirror image.
    """
    i = np.arange(count) + 0.5
    azimuth = np.mod(i * 180.0 * (3.0 - np.sqrt(5.0)), 360.0)
    return np.degrees(np.arcsin(1.0 - i / count)), np.minimum(azimuth, 360.0 - azimuth)


def colour_sky(
    factor: np.ndarray,
    wavelength_nm: np.ndarray,
    elevation_deg: np.ndarray,
    azimuth_deg: np.ndarray,
    weight: np.ndarray,
    sun_elevation_deg: float,
    turbidity: float = float("nan"),
) -> ColourSky:
    """Luminance and chromaticity of sun-normalised radiance (D, W); directions in the aureole are left out.

    Raises TwilightError where the wavelengths do not define a colour or a direction is black.
    """
    if not colour_is_defined(wavelength_nm):
        raise TwilightError("wavelengths must reach from 480 to 600 nm: the fit needs luminance and chromaticity")
    sun, e = np.radians(sun_elevation_deg), np.radians(elevation_deg)
    cosine = np.sin(sun) * np.sin(e) + np.cos(sun) * np.cos(e) * np.cos(np.radians(azimuth_deg))
    keep = cosine < np.cos(np.radians(AUREOLE_DEG))
    weights = spectrum.colour_matching_functions("cie1931_2deg") * spectrum.solar_at_visible()[:, None]
    xyz = spectrum.LUMINOUS_EFFICACY_LM_PER_W * spectrum.integrate(factor[keep], wavelength_nm, weights)
    total = xyz.sum(axis=1)
    if not (total > 0).all():
        raise TwilightError("a direction of the sky is black: there is nothing to fit")
    return ColourSky(
        sun_elevation_deg,
        turbidity,
        elevation_deg[keep],
        azimuth_deg[keep],
        weight[keep] / weight[keep].sum(),
        xyz[:, 1],
        xyz[:, 0] / total,
        xyz[:, 1] / total,
    )


def from_sky(sky: Sky) -> ColourSky:
    """A sky on its grid, at or above the horizon."""
    rows = sky.elevation_deg >= 0
    factor = sky.sun_normalised_radiance[rows]
    e, a = np.meshgrid(sky.elevation_deg[rows], sky.azimuth_deg, indexing="ij")
    weight = sky.solid_angle_sr()[rows].ravel()
    flat = factor.reshape(-1, factor.shape[-1])
    return colour_sky(flat, sky.wavelength_nm, e.ravel(), a.ravel(), weight, sky.sun_elevation_deg)


def air_of_turbidity(config: Config, turbidity: float, haze: str = "climate") -> Medium:
    """The air of a configuration's climate with as much aerosol as makes that turbidity at 550 nm.

    haze: 'climate' scales the climate's own aerosol; 'preetham1999' takes the paper's instead: exponential with its
    scale height and spectrum, phase function of its table 1, no absorption.
    """
    climate = make_plan(config).climate
    if climate.medium is not None:
        raise TwilightError(f"{climate.name}: a tabulated medium has no aerosol that could be scaled to a turbidity")
    wavelength_nm = wavelengths_of(config)
    assert wavelength_nm is not None
    if haze == "preetham1999":
        clean = climate.model_copy(update={"aerosol": None, "stratosphere": None})
        return _with_paper_haze(climate_medium(clean, wavelength_nm), turbidity)
    if haze not in HAZES:
        raise TwilightError(f"haze: {haze} is not known; allowed are {', '.join(HAZES)}")
    if climate.aerosol is None:
        raise TwilightError(
            f"{climate.name}: has no aerosol that could be scaled to a turbidity; haze preetham1999 has"
        )
    at_550 = climate_medium(climate.model_copy(update={"aerosol": None, "stratosphere": None}), np.array([550.0]))
    depth = (turbidity - 1.0) * float(at_550.optical_depth("air")[0])
    aerosol = climate.aerosol.model_copy(update={"optical_depth_550nm": depth})
    return climate_medium(climate.model_copy(update={"aerosol": aerosol}), wavelength_nm)


def _with_paper_haze(clean: Medium, turbidity: float) -> Medium:
    wavelength = clean.wavelength_nm
    relative = aerial.haze_scattering_per_km(np.append(wavelength, 550.0), turbidity)
    air = np.exp(np.interp(np.log(550.0), np.log(wavelength), np.log(clean.optical_depth("air"))))
    # the paper's own coefficient keeps the definition of turbidity within 7 % only; here it is exact
    surface = (turbidity - 1.0) * air * aerial.HAZE_DECAY_PER_KM * relative[:-1] / relative[-1]
    angle = np.radians(np.linspace(0.0, 180.0, 1441))
    phase = PhaseFunction.from_samples(angle, aerial.haze_phase(angle, wavelength).T, "haze of Preetham 1999")
    extinction = np.exp(-aerial.HAZE_DECAY_PER_KM * (clean.altitude_km - clean.bottom_km))[:, None] * surface
    return replace(
        clean,
        aerosol_extinction_per_km=extinction,
        aerosol_single_scattering_albedo=np.ones_like(extinction),
        aerosol_phase_fraction=np.ones((1, *extinction.shape)),
        phase_functions=(phase,),
    )


def compute_truth(
    config: Config,
    turbidities: Sequence[float],
    sun_zenith_deg: Sequence[float],
    directions: int,
    haze: str = "climate",
    progress: Progress | None = None,
) -> Truth:
    """Skies of all turbidities and suns by the configuration's solver, `directions` each."""
    tell = progress or silent
    begin = time.process_time(), time.perf_counter()
    name, _, settings = config.chosen_solver
    elevation, azimuth = spiral(directions)
    weight = np.full(directions, 1.0 / directions)
    steps = len(turbidities) * (1 + len(sun_zenith_deg))
    done, skies = 0, []
    for turbidity in turbidities:
        label = f"turbidity {turbidity:g}"
        tell(label, done / steps)
        medium = air_of_turbidity(config, turbidity, haze)
        scene = Scene(medium, None, solvers.load(name), settings, observer=config.observer, title=config.title)
        solved = solve(scene, cached=False)
        done += 1
        for zenith in sun_zenith_deg:
            tell(f"{label}, sun {90 - zenith:g} deg", done / steps)
            factor = solved.radiance(90.0 - zenith, elevation, azimuth)
            done += 1
            about = medium.wavelength_nm, elevation, azimuth, weight, 90.0 - zenith, turbidity
            skies.append(colour_sky(factor, *about))
    return Truth(tuple(skies), time.process_time() - begin[0], time.perf_counter() - begin[1])
