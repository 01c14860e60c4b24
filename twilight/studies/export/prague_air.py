"""Airs and wavelengths of the Prague Sky Model: visibilities as aerosol, channels as a few wavelengths.

The transmittance of the Prague Sky Model: its root at places in the air, as factors.

Places are given by altitude and distance along the ground, on the reader's sphere, whose 50 m above the viewpoint are
the lowest 0 m of the air here: both ends of a line move up with it.  Lines of sight are straight.
"""

from dataclasses import replace
from functools import partial
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np

from twilight.atmosphere.medium import ON_LEVELS
from twilight.base.errors import TwilightError
from twilight.config.load import Series, load_axes
from twilight.config.scene import Config
from twilight.numerics.spectrum import solar_at
from twilight.scene.medium import climate_medium
from twilight.studies.export.prague_file import PragueTransmittance
from twilight.studies.export.prague_sky import RADIUS_M, SAFETY_M, altitude_nodes_m, distance_nodes_m
from twilight.transport.profile import prepare_profile
from twilight.transport.steps import chord_depth

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
    for name, case in zip(climates, series, strict=True):
        config = case.config({})
        if config.climate.medium is not None:
            raise TwilightError(f"{name}: the Prague model knows computed air, no table")
    if len(series) > 1:
        if visibility_km is not None:
            raise TwilightError("--visibility: is for one climate; several climates have visibilities of their own")
        own = [PragueAir(KOSCHMIEDER / ground_extinction_per_km(case.config({})), case, None) for case in series]
        own.sort(key=lambda air: air.visibility_km)
        for near, far in pairwise(own):
            if far.visibility_km < 1.001 * near.visibility_km:
                raise TwilightError(
                    f"{', '.join(climates)}: two of them have a visibility of {near.visibility_km:.4g} km"
                )
        return own
    first = series[0]
    if first.config({}).climate.aerosol is None:
        raise TwilightError(f"{climates[0]}: has no aerosol, so that no visibility can be set")
    depths = (0.1, 0.5)
    thin, thick = (ground_extinction_per_km(first.config({"aerosol.optical_depth_550nm": d})) for d in depths)
    slope = (thick - thin) / (depths[1] - depths[0])
    clear = ground_extinction_per_km(first.config({}), aerosol=False)
    airs = []
    for km in sorted(visibility_km or VISIBILITY_KM):
        depth = depths[0] + (KOSCHMIEDER / km - thin) / slope
        if not clear < KOSCHMIEDER / km or depth > 20.0:
            raise TwilightError(
                f"--visibility: {km:g} km is not allowed; {climates[0]} without aerosol is seen through for "
                f"{KOSCHMIEDER / clear:.0f} km, so that less than that is"
            )
        airs.append(PragueAir(km, first, float(f"{depth:.6g}")))
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
        before, polynomial = np.zeros(x.size), np.full(x.size, mass**-0.5)
        diagonal, beside = [], [0.0]
        for _ in range(nodes):
            diagonal.append(float((measure * x * polynomial**2).sum()))
            following = (x - diagonal[-1]) * polynomial - beside[-1] * before
            beside.append(float(np.sqrt((measure * following**2).sum())))
            before, polynomial = polynomial, following / beside[-1]
        jacobi = np.diag(diagonal) + np.diag(beside[1:-1], 1) + np.diag(beside[1:-1], -1)
        roots, vectors = np.linalg.eigh(jacobi)
        places.append(fine.mean() + width_nm * roots)
        weights.append(mass * vectors[0] ** 2)
    return ChannelNodes(np.concatenate(places), np.array(weights))


DISTANCES = 128
"""Places along the ground."""
ALTITUDES = 32
"""Places in height."""
DEPTH_KM = 2.0
"""How far below the ground the air of `_without_ground` goes; lines that sink deeper are dark, all in air of the
ground."""
ROOT_ERROR = 3e-4
"""Largest error of a stored root that the rank may leave."""


def transmittance_roots(field: Any, altitude_m: np.ndarray, nodes: ChannelNodes) -> np.ndarray:
    """Square roots of the transmittance (H, D, A, C) from altitudes (H,) to the places of the file.

    field: a `Field`, whose wavelengths are the nodes of the channels.
    """
    roots = []
    for altitude in altitude_m:
        passed = field.of_terms(partial(_passed, altitude_m=altitude))
        roots.append(np.sqrt(nodes.mean(passed) / nodes.irradiance.sum(axis=-1)))
    return np.array(roots)


def _passed(medium: Any, altitude_m: float) -> np.ndarray:
    """Transmittance (D, A, W) from `altitude_m`, the reader's 50 m included."""
    below = 1e-3 * SAFETY_M
    deep = _without_ground(medium, 1e-3 * RADIUS_M + below - medium.bottom_km)
    profile = prepare_profile(deep)
    high = medium.bottom_km - below + 1e-3 * altitude_nodes_m(ALTITUDES)
    altitude_km = medium.bottom_km - below + 1e-3 * altitude_m
    start = deep.earth_radius_km + altitude_km
    out, depth = np.ones((DISTANCES, ALTITUDES, medium.n_wavelengths)), np.zeros(medium.n_wavelengths)
    for d, angle in enumerate(distance_nodes_m(DISTANCES) / RADIUS_M):
        for a, altitude in enumerate(high):
            r = deep.earth_radius_km + altitude
            across, up = r * np.sin(angle), r * np.cos(angle) - start
            length = float(np.hypot(across, up))
            if length > 1e-9:
                mu = up / length
                to_top = -start * mu + np.sqrt(
                    (start * mu) ** 2 + (start + medium.top_km - altitude_km) ** 2 - start**2
                )
                length = min(length, to_top)
                free = chord_depth(profile, altitude_km, mu, length, depth)
                out[d, a] = np.exp(-depth if free else -length * medium.extinction_per_km[0])
    return out


def _without_ground(medium: Any, earth_radius_km: float) -> Any:
    """The medium on another sphere, with the air of the ground going on below it: lines that the ground hides are
    asked for beside those that it does not."""

    def continued(values: np.ndarray, axis: int = 0) -> np.ndarray:
        first = np.take(values, [0, 0], axis=axis)
        return np.concatenate([first, values], axis=axis)

    on_levels = {name: continued(getattr(medium, name)) for name in ON_LEVELS}
    for name in ("air_scattering_per_km", "refractivity"):  # a jump, so that the cubics above begin anew
        on_levels[name][:2] *= 1.0 + 1e-6
    return replace(
        medium,
        altitude_km=np.concatenate([[medium.bottom_km - DEPTH_KM], medium.altitude_km[:1], medium.altitude_km]),
        aerosol_phase_fraction=continued(medium.aerosol_phase_fraction, 1),
        earth_radius_km=earth_radius_km,
        grid_medium=None,
        **on_levels,
    )


def transmittance_of(roots: list[np.ndarray], altitude_m: np.ndarray, visibility_km: np.ndarray) -> PragueTransmittance:
    """Factors of the roots of all airs by singular values, of the least rank that keeps `ROOT_ERROR`."""
    stacked = np.array(roots)
    v, h, d, a, c = stacked.shape
    cut = []
    for k in range(h):
        table = stacked[:, k].transpose(1, 2, 0, 3).reshape(d * a, v * c)
        left, size, right = np.linalg.svd(table, full_matrices=False)
        cut.append((table, left * size, right))
    rank = next(
        r
        for r in range(1, v * c + 1)
        if all(np.abs(left[:, :r] @ right[:r] - table).max() < ROOT_ERROR for table, left, right in cut) or r == v * c
    )
    factors = np.array([left[:, :rank].reshape(d, a, rank) for _, left, _ in cut])
    weights = np.array([right[:rank].reshape(rank, v, c) for _, _, right in cut])
    return PragueTransmittance(altitude_m, visibility_km, factors, weights.transpose(2, 0, 3, 1))
