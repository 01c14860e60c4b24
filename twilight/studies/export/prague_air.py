"""Airs and wavelengths of the Prague Sky Model: visibilities as aerosol, channels as a few wavelengths."""

from __future__ import annotations

from itertools import pairwise
from typing import NamedTuple

import numpy as np

from twilight.base.errors import TwilightError
from twilight.config.load import Series, load_axes
from twilight.config.scene import Config
from twilight.numerics.spectrum import solar_at
from twilight.scene.medium import climate_medium

KOSCHMIEDER = 3.912
"""ln 50: visibility times the extinction at 550 nm where the eye sees contrasts of 2 % (meteorological range)."""
VISIBILITY_KM = (20.0, 32.0, 51.0, 82.0, 131.8)
"""Of one climate, each 1.6 times the one before; from and to as in the published files."""


class PragueAir(NamedTuple):
    """The air of a visibility [km]: a climate, and the aerosol's optical depth at 550 nm, None: the climate's own."""

    visibility_km: float
    series: Series
    depth: float | None

    def config(self, albedo: float, quality: str) -> Config:
        """The configuration over a ground of that albedo."""
        point = {"ground.albedo": albedo, "solver": {"name": "zones", "quality": quality}}
        if self.depth is not None:
            point["aerosol.optical_depth_550nm"] = self.depth
        return self.series.config(point)


def ground_extinction_per_km(config: Config, aerosol: bool = True) -> float:
    """Extinction of the air at the ground at 550 nm [km^-1]; molecules and gases alone without the aerosol."""
    medium = climate_medium(config.climate, np.array([550.0]))
    hazy = medium.aerosol_extinction_per_km if aerosol else 0.0
    return float((medium.air_scattering_per_km + medium.absorption_per_km + hazy)[0, 0])


def airs_of(climates: list[str], visibility_km: tuple[float, ...] | None) -> list[PragueAir]:
    """The airs of a file, by increasing visibility.

    Of one climate, its aerosol scaled so that `KOSCHMIEDER` over the extinction at the ground is each visibility; of
    several climates, each as it is.
    Errors: TwilightError for what cannot be scaled, and for two climates of the same visibility.
    """
    series = [load_axes(name, None, None, ("climates",)) for name in climates]
    for name, one in zip(climates, series, strict=True):
        config = one.config({})
        if config.climate.medium is not None:
            raise TwilightError(f"{name}: the Prague model knows computed air, no table")
    if len(series) > 1:
        if visibility_km is not None:
            raise TwilightError("--visibility: is for one climate; several climates have visibilities of their own")
        own = [PragueAir(KOSCHMIEDER / ground_extinction_per_km(one.config({})), one, None) for one in series]
        own.sort(key=lambda air: air.visibility_km)
        for near, far in pairwise(own):
            if far.visibility_km < 1.001 * near.visibility_km:
                raise TwilightError(
                    f"{', '.join(climates)}: two of them have a visibility of {near.visibility_km:.4g} km"
                )
        return own
    found = series[0]
    if found.config({}).climate.aerosol is None:
        raise TwilightError(f"{climates[0]}: has no aerosol, so that no visibility can be set")
    depths = (0.1, 0.5)
    thin, thick = (ground_extinction_per_km(found.config({"aerosol.optical_depth_550nm": d})) for d in depths)
    slope = (thick - thin) / (depths[1] - depths[0])
    clear = ground_extinction_per_km(found.config({}), aerosol=False)
    airs = []
    for km in sorted(visibility_km or VISIBILITY_KM):
        depth = depths[0] + (KOSCHMIEDER / km - thin) / slope
        if not clear < KOSCHMIEDER / km or depth > 20.0:
            raise TwilightError(
                f"--visibility: {km:g} km is not allowed; {climates[0]} without aerosol is seen through for "
                f"{KOSCHMIEDER / clear:.0f} km, so that less than that is"
            )
        airs.append(PragueAir(km, found, float(f"{depth:.6g}")))
    return airs


class ChannelNodes(NamedTuple):
    """wavelength_nm (C N,) at which light is computed, and the solar irradiance of each [W m^-2 nm^-1], (C, N)."""

    wavelength_nm: np.ndarray
    irradiance: np.ndarray

    def mean(self, factor: np.ndarray) -> np.ndarray:
        """Mean over each channel (..., C) of what sunlight makes of a factor (..., C N)."""
        return (factor.reshape(*factor.shape[:-1], *self.irradiance.shape) * self.irradiance).sum(axis=-1)


def channel_nodes(channels: int, start_nm: float, width_nm: float, nodes: int) -> ChannelNodes:
    """Gauss's rule of the solar spectrum over each channel, so that sun-normalised radiance may be a polynomial.

    N nodes are exact for degree 2 N - 1.  Golub and Welsch 1969; recurrence by Stieltjes's procedure.
    """
    places, weights = [], []
    for c in range(channels):
        fine = start_nm + width_nm * (c + (np.arange(200) + 0.5) / 200)
        measure = solar_at(fine) / fine.size
        x, mass = (fine - fine.mean()) / width_nm, measure.sum()
        before, here = np.zeros(x.size), np.full(x.size, mass**-0.5)
        diagonal, beside = [], [0.0]
        for _ in range(nodes):
            diagonal.append(float((measure * x * here**2).sum()))
            following = (x - diagonal[-1]) * here - beside[-1] * before
            beside.append(float(np.sqrt((measure * following**2).sum())))
            before, here = here, following / beside[-1]
        jacobi = np.diag(diagonal) + np.diag(beside[1:-1], 1) + np.diag(beside[1:-1], -1)
        found, vectors = np.linalg.eigh(jacobi)
        places.append(fine.mean() + width_nm * found)
        weights.append(mass * vectors[0] ** 2)
    return ChannelNodes(np.concatenate(places), np.array(weights))
