"""What a solver found: an `Answer` for some directions, joined over blocks of wavelengths, and made a `Sky`."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from twilight.atmosphere.bands import GasBands
from twilight.atmosphere.medium import Medium
from twilight.engine.sunbeam import Direct
from twilight.sky.sky import Sky
from twilight.sky.table import SkyTable


@dataclass(frozen=True)
class Answer:
    """What was found for some directions; sun-normalised [sr^-1].

    radiance: shape of the directions plus (W,), and its standard error where there is one.
    polarisation: the Stokes parameters Q and U, shape of the directions plus (2, W), where they were asked for and the
        field has them (signs: `twilight.base.conventions`), and their standard error.
    """

    radiance: np.ndarray
    standard_error: np.ndarray | None = None
    polarisation: np.ndarray | None = None
    polarisation_error: np.ndarray | None = None


def join(answers: Sequence[Answer], axis: int = -1) -> Answer:
    """One answer from those of all blocks of wavelengths; axis 0: from those of some rows of a texture each."""
    if len(answers) == 1:
        return answers[0]
    parts = zip(*(vars(answer).values() for answer in answers), strict=True)
    return Answer(*(None if part[0] is None else np.concatenate(part, axis=axis) for part in parts))  # type: ignore[arg-type]


def answer_of_stokes(stokes: np.ndarray, error: np.ndarray | None = None) -> Answer:
    """The answer that holds Stokes parameters (..., 3, W)."""
    found = Answer(stokes[..., 0, :], None, stokes[..., 1:, :])
    if error is None:
        return found
    return replace(found, standard_error=error[..., 0, :], polarisation_error=error[..., 1:, :])


def sum_terms(answer: Answer, bands: GasBands) -> Answer:
    """The answer for wavelengths from that for the terms of their exponential sums."""
    return Answer(*(None if part is None else bands.sum_terms(part) for part in vars(answer).values()))  # type: ignore[arg-type]


def answer_of_table(table: SkyTable, elevation_deg: np.ndarray, azimuth_deg: np.ndarray) -> Answer:
    """The answer on rows (E,) and columns (A,) [deg] that a table of one sun gives."""
    radiance = table.on_grid(elevation_deg, azimuth_deg)
    if table.stokes is None:
        return Answer(radiance)
    fraction = table.fractional_stokes(elevation_deg[:, None], azimuth_deg)
    return Answer(radiance, None, fraction * radiance[..., None, :])


def make_sky(
    medium: Medium,
    grid: tuple[np.ndarray, np.ndarray],
    answer: Answer,
    direct: Direct,
    sun_elevation_deg: float,
    observer_altitude_km: float,
    **facts: Any,
) -> Sky:
    """What was found on a grid (elevation (E,), azimuth (A,)) [deg] at all wavelengths of a medium, as a `Sky`."""
    return Sky(
        wavelength_nm=medium.wavelength_nm,
        elevation_deg=grid[0],
        azimuth_deg=grid[1],
        sun_normalised_radiance=answer.radiance,
        standard_error=answer.standard_error,
        polarisation=answer.polarisation,
        polarisation_error=answer.polarisation_error,
        sun_elevation_deg=sun_elevation_deg,
        observer_altitude_km=observer_altitude_km,
        ground_albedo=medium.ground_albedo,
        direct_irradiance=direct.irradiance,
        apparent_sun_elevation_deg=sun_elevation_deg + direct.bending_deg,
        **facts,
    )
