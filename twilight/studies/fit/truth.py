"""Computed skies as luminance and chromaticity, the file of coefficients fitted to them, and its errors."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import yaml

from twilight import solvers
from twilight.base.errors import TwilightError
from twilight.base.progress import Progress, silent
from twilight.base.whole_files import whole_file
from twilight.config.scene import Config
from twilight.engine.field import solve
from twilight.numerics import spectrum
from twilight.numerics.phase import PhaseFunction
from twilight.scene import Scene
from twilight.scene.medium import climate_medium, wavelengths_of
from twilight.scene.plan import make_plan
from twilight.sky.colour import colour_is_defined, uv_of_xy
from twilight.sky.sky import Sky
from twilight.solvers.analytic import aerial
from twilight.solvers.analytic.coefficients import SkyCoefficients, parse_coefficients

if TYPE_CHECKING:
    from twilight.atmosphere.medium import Medium

HEAD = """\
# Coefficients of Perez's five-parameter sky in the form of Preetham, Shirley and Smits 1999, for
#     twilight render CLIMATE --solver preetham --set solver.coefficients=THIS_FILE
# Lists are polynomials in the turbidity T at 550 nm, highest power first.
# luminance, x and y (CIE 1931) in a direction at zenith angle theta and at the angle gamma from the sun are
#     zenith * F(theta, gamma) / F(0, z),  F = (1 + A exp(B / cos theta)) (1 + C exp(D gamma) + E cos^2 gamma)
# with z the zenith angle of the sun.  Zenith luminance: slope tan(chi (pi - 2 z)) + constant [kcd m^-2];
# zenith x and y: polynomials in z [rad] whose coefficients, z^3 first, are the four lists.
"""


def write_set(coefficients: SkyCoefficients, facts: dict[str, Any], path: Path) -> None:
    """Write a set as YAML, whole or not at all, with the facts about its fit under `fit`.

    Raises TwilightError where it cannot be written, or what is written would not be accepted by the solver.
    """
    text = HEAD + yaml.safe_dump(
        coefficients.as_document() | {"fit": facts}, sort_keys=False, default_flow_style=None, width=118
    )
    parse_coefficients(text, str(path))
    with whole_file(path) as temporary:
        temporary.write_text(text, encoding="utf-8")


@dataclass(frozen=True)
class SetError:
    """Errors over all directions of some skies.

    luminance_*: |model / truth - 1| of the absolute luminance; distribution_*: with the best scale for every sky;
    chromaticity_*: distance in CIE 1976 u', v'.  bias: mean of ln(model / truth).
    """

    luminance_bias: float
    luminance_median: float
    luminance_p95: float
    distribution_median: float
    distribution_p95: float
    chromaticity_median: float
    chromaticity_p95: float


def error_of(coefficients: SkyCoefficients, skies: Sequence[ColourSky]) -> SetError:
    """Errors of a set over skies whose turbidity and sun it covers."""
    bias, absolute, distribution, chromaticity = [], [], [], []
    for sky in skies:
        luminance, x, y = coefficients.sky(sky.turbidity, sky.sun_elevation_deg, sky.elevation_deg, sky.azimuth_deg)
        ratio = luminance / sky.luminance
        bias.append(np.log(ratio))
        absolute.append(np.abs(ratio - 1.0))
        scale = np.exp(-np.sum(sky.weight * np.log(ratio)))
        distribution.append(np.abs(scale * ratio - 1.0))
        chromaticity.append(np.linalg.norm(uv_of_xy(x, y) - uv_of_xy(sky.x, sky.y), axis=-1))
    errors = [np.concatenate(e) for e in (absolute, distribution, chromaticity)]
    quantiles = [float(np.percentile(e, q)) for e in errors for q in (50, 95)]
    return SetError(float(np.mean(np.concatenate(bias))), *quantiles)


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
