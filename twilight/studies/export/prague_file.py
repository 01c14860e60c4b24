"""The file of the Prague Sky Model: its layout, and what writes it.

Little-endian, without padding (`PragueSkyModel.cpp` of github.com/PetrVevoda/pragueskymodel, Apache-2.0):

    visibilities [km], albedos, altitudes [m], elevations [deg]       each a count (int32) and its float64
    channels (int32), start and width [nm] (float64)
    rank (int32); breaks of sun angle, zenith angle and emphasis [rad], each a count and its float64
    for each visibility, albedo, altitude, elevation and channel      `radiance_record`, the channel fastest
    distances, altitudes, visibilities, altitudes of observers, rank  int32 each, of the transmittance
    altitudes of observers [m], visibilities [km]                     float32
    factors U (observer, distance, altitude, rank), V (visibility, observer, channel, rank)   float32
    of the polarisation, which may be missing: rank, breaks of sun and zenith angle as above, `polarisation_record`s

Wilkie et al. 2021, A fitted radiance and attenuation model for realistic atmospheres, doi:10.1145/3450626.3459758;
Vévoda et al. 2022, A wide spectral range sky radiance model, doi:10.1111/cgf.14677.
"""

import struct
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from twilight.base.whole_files import whole_file


@dataclass(frozen=True)
class PragueAxes:
    """What the coefficients of a file run over.

    visibility_km (V,), albedo (B,), altitude_m (H,), elevation_deg (S,) of the sun; channels of one width [nm].
    altitude_m counts from the ground and holds the 50 m that the reader adds to that of the viewpoint.
    """

    visibility_km: np.ndarray
    albedo: np.ndarray
    altitude_m: np.ndarray
    elevation_deg: np.ndarray
    channels: int
    start_nm: float
    width_nm: float

    @property
    def shape(self) -> tuple[int, int, int, int, int]:
        """Numbers of visibilities, albedos, altitudes, elevations and channels."""
        of = (self.visibility_km, self.albedo, self.altitude_m, self.elevation_deg)
        return (*(len(axis) for axis in of), self.channels)  # type: ignore[return-value]


@dataclass(frozen=True)
class PragueTerms:
    """Sums of products of a function of the sun angle and one of the zenith (or shadow) angle.

    sun_break_rad (G,), zenith_break_rad (A,), emphasis_break_rad (E,), empty for polarisation; records (V, B, H, S, C)
    of `radiance_record` or `polarisation_record`.
    """

    sun_break_rad: np.ndarray
    zenith_break_rad: np.ndarray
    emphasis_break_rad: np.ndarray
    records: np.ndarray

    @property
    def rank(self) -> int:
        """Number of products."""
        return int(self.records.dtype["term"].shape[0])


@dataclass(frozen=True)
class PragueTransmittance:
    """altitude_m (H,) of observers, visibility_km (V,); factors (H, D, A, R), weights (V, H, C, R) of its root."""

    altitude_m: np.ndarray
    visibility_km: np.ndarray
    factors: np.ndarray
    weights: np.ndarray


@dataclass(frozen=True)
class PragueFile:
    """All that a file holds; polarisation may be None."""

    axes: PragueAxes
    radiance: PragueTerms
    transmittance: PragueTransmittance
    polarisation: PragueTerms | None


def radiance_record(rank: int, sun: int, zenith: int, emphasis: int) -> np.dtype:
    """Coefficients of one sky in one channel; a zenith value is what is stored over the term's scale."""
    term = np.dtype([("sun", "<f2", (sun,)), ("scale", "<f8"), ("zenith", "<f2", (zenith,))])
    return np.dtype([("term", term, (rank,)), ("emphasis", "<f2", (emphasis,))])


def polarisation_record(rank: int, sun: int, zenith: int) -> np.dtype:
    """Coefficients of the polarisation of one sky in one channel."""
    return np.dtype([("term", np.dtype([("sun", "<f4", (sun,)), ("zenith", "<f4", (zenith,))]), (rank,))])


def write_prague(path: str | Path, data: PragueFile) -> int:
    """Write a file whole or not at all; its size in bytes.  Errors: TwilightError where the system refuses."""
    axes, sky, passed = data.axes, data.radiance, data.transmittance
    parts = [_counted(axis) for axis in (axes.visibility_km, axes.albedo, axes.altitude_m, axes.elevation_deg)]
    parts += [struct.pack("<iddi", axes.channels, axes.start_nm, axes.width_nm, sky.rank)]
    parts += [_counted(breaks) for breaks in (sky.sun_break_rad, sky.zenith_break_rad, sky.emphasis_break_rad)]
    parts += [sky.records.tobytes()]
    observers, distances, altitudes, rank = passed.factors.shape
    parts += [struct.pack("<5i", distances, altitudes, len(passed.visibility_km), observers, rank)]
    for array in (passed.altitude_m, passed.visibility_km, passed.factors, passed.weights):
        parts += [np.ascontiguousarray(array, "<f4").tobytes()]
    if data.polarisation is not None:
        pol = data.polarisation
        parts += [struct.pack("<i", pol.rank), _counted(pol.sun_break_rad), _counted(pol.zenith_break_rad)]
        parts += [pol.records.tobytes()]
    with whole_file(path) as temporary, temporary.open("wb") as stream:
        stream.writelines(parts)
    return sum(len(part) for part in parts)


def _counted(values: np.ndarray) -> bytes:
    return struct.pack("<i", len(values)) + np.asarray(values, "<f8").tobytes()
