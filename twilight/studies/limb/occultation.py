"""The sun seen through the limb: transmittance of bent rays, how far they are bent, and how thin that spreads sunlight.

An observer above the air follows a line of sight at the angle psi from the Earth's centre back to psi' = psi - bending.
Refraction does not change radiance, so an instrument that resolves the sun's disc measures T alone.  The irradiance of
a source too small to resolve is T times

    beam spreading = sin(psi) dpsi / (sin(psi') dpsi'),

the solid angle of a small patch of the source with the air over that without, as in `twilight.studies.eclipse.shadow`.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from twilight.atmosphere.bands import GasBands
from twilight.atmosphere.medium import Medium
from twilight.studies.limb.geometry import field_of_view, limb_elevation_deg, tangent_altitudes
from twilight.studies.limb.limb import TANGENT, coordinates_of, instrument_attributes
from twilight.transport.apparent_rays import ApparentRays

if TYPE_CHECKING:
    from xarray import Dataset

STEP_KM = 0.02
"""Step of tangent altitude [km], to either side, of the difference quotient dpsi / dpsi'."""


def occultation(
    medium: Medium,
    tangent_km: ArrayLike,
    *,
    bands: GasBands | None = None,
    observer_altitude_km: float = 600.0,
    field_of_view_km: float | None = None,
    field_of_view_shape: str = "box",
    title: str = "",
) -> Dataset:
    """Transmittance of the limb for sunlight.

    Parameters
    ----------
    medium
        The air.
    tangent_km : (T,) or one
        Apparent tangent altitudes [km]: of the straight lines of sight.
    bands
        Exponential sums of gases in the medium.
    observer_altitude_km
        Above sea level [km]; above the air.
    field_of_view_km, field_of_view_shape
        Width in tangent altitude [km] over which `transmittance` alone is a mean: of a box, or of a Gaussian at half
        maximum.

    Returns
    -------
    xarray.Dataset
        Over apparent_tangent_altitude and wavelength: `transmittance`, 0 where the ray meets the ground; `bending`
        [deg], `beam_spreading` and `irradiance` of a source too small to resolve, over that without the Earth, nan
        there; tangent_altitude [km] of the bent ray.

    Raises
    ------
    TwilightError
        For an observer within the air, and tangent altitudes outside it.
    """
    import xarray  # start-up

    tangent = tangent_altitudes(medium, tangent_km, observer_altitude_km)
    offset, weight = field_of_view(field_of_view_km, field_of_view_shape)
    lines = tangent[:, None] + np.concatenate([offset, [-STEP_KM, 0.0, STEP_KM]])
    apparent = limb_elevation_deg(medium, lines, observer_altitude_km)
    whole = medium if bands is None else bands.expand(medium)
    all_terms = np.arange(whole.n_wavelengths)
    true, transmittance = ApparentRays(whole).follow(observer_altitude_km, apparent.ravel(), all_terms)
    if bands is not None:
        true = true[:, np.unique(bands.wavelength_index, return_index=True)[1]]
        transmittance = bands.sum_terms(transmittance)
    shape = (*lines.shape, medium.n_wavelengths)
    true, transmittance = true.reshape(shape), transmittance.reshape(shape)
    # psi and psi' of the three lines for the difference quotient, the middle one of which has the tangent altitude
    psi, psi_true = np.radians(apparent[:, -3:] + 90.0), np.radians(true[:, -3:] + 90.0)
    with np.errstate(invalid="ignore", divide="ignore"):
        rate = (psi[:, 2] - psi[:, 0])[:, None] / np.abs(psi_true[:, 2] - psi_true[:, 0])
        spreading = rate * np.sin(psi[:, 1])[:, None] / np.abs(np.sin(psi_true[:, 1]))
    spreading = np.where(np.all(transmittance[:, -3:] > 0.0, axis=1), spreading, np.nan)
    bending = np.where(transmittance[:, -2] > 0.0, apparent[:, -2, None] - true[:, -2], np.nan)
    dims = (TANGENT, "wavelength")
    return xarray.Dataset(
        {
            "transmittance": (
                dims, np.einsum("n,tnw->tw", weight, transmittance[:, :-3]),
                {"long_name": "transmittance", "units": "1"},
            ),
            "bending": (dims, bending, {"long_name": "angle by which the ray is bent", "units": "degree"}),
            "beam_spreading": (dims, spreading, {"long_name": "dilution of sunlight by refraction", "units": "1"}),
            "irradiance": (
                dims, spreading * transmittance[:, -2],
                {"long_name": "irradiance of a source too small to resolve, over that without the Earth", "units": "1"},
            ),
        },
        coordinates_of(medium, tangent),
        {"title": title, **instrument_attributes(observer_altitude_km, field_of_view_km, field_of_view_shape)},
    )  # fmt: skip
