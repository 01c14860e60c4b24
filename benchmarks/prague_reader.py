"""A file of the Prague Sky Model, read and evaluated as the published reader does, with the angles of `prague_sky`:
it judges what `twilight export prague` writes, in `prague.py` and in tests, which hold it to the published reader.
"""

from __future__ import annotations

import itertools
import math
import struct
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from twilight.base.errors import TwilightError
from twilight.base.reading import reading
from twilight.studies.export import prague_file as layout
from twilight.studies.export import prague_sky as model
from twilight.studies.export.prague_sky import SAFETY_M, PragueAngles, angles_of, index_and_fraction


@dataclass(frozen=True)
class PragueSky:
    """A file, evaluated as the published reader does."""

    file: layout.PragueFile

    @classmethod
    def load(cls, path: str | Path) -> PragueSky:
        """Of a path.  Errors: as `read_prague`."""
        return cls(read_prague(path))

    def radiance(
        self, sun_elevation_deg: float, elevation_deg: ArrayLike, azimuth_deg: ArrayLike, wavelength_nm: float,
        **air: float,
    ) -> np.ndarray:  # fmt: skip
        """Radiance of the sky [W m^-2 sr^-1 nm^-1] in directions [deg], azimuth from the sun; 0 outside the channels.

        air: visibility_km, albedo and observer_altitude_m, which counts from the ground.
        """
        state, angles = _state(sun_elevation_deg, elevation_deg, azimuth_deg, **air)
        alpha = angles.shadow if sun_elevation_deg < 0.0 else angles.zero
        return self._mixed(self.file.radiance, state, wavelength_nm, angles, alpha)

    def polarisation(
        self, sun_elevation_deg: float, elevation_deg: ArrayLike, azimuth_deg: ArrayLike, wavelength_nm: float,
        **air: float,
    ) -> np.ndarray:  # fmt: skip
        """Degree of polarisation across the plane through sun and view, below 0 along it; arguments as `radiance`."""
        assert self.file.polarisation is not None
        state, angles = _state(sun_elevation_deg, elevation_deg, azimuth_deg, **air)
        return -self._mixed(self.file.polarisation, state, wavelength_nm, angles, angles.zero)

    def _mixed(self, terms: Any, state: Sequence[float], wavelength_nm: float, angles: Any, alpha: Any) -> np.ndarray:
        axes = self.file.axes
        channel = math.floor((wavelength_nm - axes.start_nm) / axes.width_nm)
        out = np.zeros(np.shape(alpha))
        if not 0 <= channel < axes.channels:
            return out
        places = [
            index_and_fraction(value, axis)
            for value, axis in zip(
                state, (axes.visibility_km, axes.albedo, axes.altitude_m, axes.elevation_deg), strict=True
            )
        ]
        for corner in itertools.product((0, 1), repeat=4):
            weight = math.prod(float(f) if c else 1.0 - float(f) for c, (_, f) in zip(corner, places, strict=True))
            if weight > 0.0:
                index = tuple(int(i) + c for c, (i, _) in zip(corner, places, strict=True))
                out += weight * evaluated(terms, terms.records[(*index, channel)], angles, alpha)
        return out

    def transmittance(
        self,
        elevation_deg: float,
        wavelength_nm: float,
        distance_m: float = math.inf,
        *,
        visibility_km: float,
        observer_altitude_m: float = 0.0,
    ) -> float:
        """Transmittance of the air along a direction [deg] up to a distance or to the edge of the air."""
        axes, stored = self.file.axes, self.file.transmittance
        channel = math.floor((wavelength_nm - axes.start_nm) / axes.width_nm)
        if not 0 <= channel < axes.channels:
            return 0.0
        altitude = observer_altitude_m + SAFETY_M
        place = _place(elevation_deg, distance_m, altitude, *stored.factors.shape[1:3])
        total = 0.0
        (v, of_v), (h, of_h) = (
            index_and_fraction(visibility_km, stored.visibility_km),
            index_and_fraction(altitude, stored.altitude_m),
        )
        for dv, dh in itertools.product((0, 1), repeat=2):
            weight = float((of_v if dv else 1.0 - of_v) * (of_h if dh else 1.0 - of_h))
            if weight > 0.0:
                weights = stored.weights[v + dv, h + dh, channel].astype(float)
                roots = stored.factors[h + dh].astype(float) @ weights
                total += weight * _bilinear(roots, place)
        return total * total


def _state(
    sun_deg: float, elevation_deg: ArrayLike, azimuth_deg: ArrayLike, visibility_km: float, albedo: float,
    observer_altitude_m: float = 0.0,
) -> tuple[tuple[float, ...], PragueAngles]:  # fmt: skip
    state = (visibility_km, albedo, observer_altitude_m + SAFETY_M, sun_deg)
    return state, angles_of(sun_deg, elevation_deg, azimuth_deg, state[2])


def evaluated(terms: layout.PragueTerms, record: np.void, angles: PragueAngles, alpha: np.ndarray) -> np.ndarray:
    """The sum of products of one record at angles [rad]; of radiance with the emphasis, not below 0."""
    (g, of_g), (a, of_a) = (
        index_and_fraction(angles.gamma, terms.sun_break_rad),
        index_and_fraction(alpha, terms.zenith_break_rad),
    )
    sun, zenith = record["term"]["sun"].astype(float), record["term"]["zenith"].astype(float)
    if "scale" in record["term"].dtype.names:
        zenith /= record["term"]["scale"][:, None]
    rows = sun[:, g] * (1.0 - of_g) + sun[:, g + 1] * of_g
    columns = zenith[:, a] * (1.0 - of_a) + zenith[:, a + 1] * of_a
    total = (rows * columns).sum(axis=0)
    if not terms.emphasis_break_rad.size:
        return total
    e, of_e = index_and_fraction(angles.zero, terms.emphasis_break_rad)
    emphasis = record["emphasis"].astype(float)
    return np.maximum(total * (emphasis[e] * (1.0 - of_e) + emphasis[e + 1] * of_e), 0.0)


def _place(elevation_deg: float, distance_m: float, altitude_m: float, distances: int, altitudes: int):
    """(index, fraction) along the distances and along the altitudes of what is looked at."""
    across, up = math.cos(math.radians(elevation_deg)), math.sin(math.radians(elevation_deg))
    start = model.RADIUS_M + altitude_m

    def meets(radius: float) -> float:
        inside = (start * up) ** 2 - start * start + radius * radius
        if inside <= 0.0:
            return -1.0
        near, far = -start * up - math.sqrt(inside), -start * up + math.sqrt(inside)
        return near if near > 0.0 else far

    length = meets(model.RADIUS_M)
    length = min(distance_m, meets(model.RADIUS_M + model.TOP_M) if length < 0.0 else length)
    x, y = across * length, up * length + start
    r = math.hypot(x, y)
    high = min(max((r - model.RADIUS_M) / model.TOP_M, 0.0), 1.0) ** (1.0 / 3.0)
    far = min(math.acos(min(1.0, y / r)) * model.RADIUS_M / model.EDGE_M, 1.0) ** 0.25
    return _step(far, distances, 4), _step(high, altitudes, 3)


def _step(value: float, count: int, power: int) -> tuple[int, float]:
    index = min(int(value * count), count - 1)
    if index == count - 1:
        return index, 0.0
    low, high = (index / count) ** power, ((index + 1) / count) ** power
    return index, min(max((value**power - low) / (high - low), 0.0), 1.0)


def _bilinear(roots: np.ndarray, place: tuple[tuple[int, float], tuple[int, float]]) -> float:
    (d, of_d), (a, of_a) = place
    line = roots[d] if of_d == 0.0 else (1.0 - of_d) * roots[d] + of_d * roots[d + 1]
    low = max(float(line[a]), 0.0)
    return low if of_a == 0.0 else (1.0 - of_a) * low + of_a * max(float(line[a + 1]), 0.0)


def read_prague(path: str | Path) -> layout.PragueFile:
    """Read a file: of this program, or a published one.

    Errors: TwilightError where there is none, and for one that ends early or goes on behind its end.
    """
    path = Path(path)
    with reading(path, "a file that can be read"):
        content = memoryview(path.read_bytes())
    take = _Reader(path, content)
    visibility, albedo, altitude, elevation = (take.counted() for _ in range(4))
    channels, start, width, rank = take.numbers("<iddi")
    axes = layout.PragueAxes(visibility, albedo, altitude, elevation, channels, start, width)
    sun, zenith, emphasis = (take.counted() for _ in range(3))
    record = layout.radiance_record(rank, len(sun), len(zenith), len(emphasis))
    sky = layout.PragueTerms(sun, zenith, emphasis, take.array(record, axes.shape))
    distances, altitudes, visibilities, observers, rank = take.numbers("<5i")
    passed = layout.PragueTransmittance(
        take.array("<f4", (observers,)),
        take.array("<f4", (visibilities,)),
        take.array("<f4", (observers, distances, altitudes, rank)),
        take.array("<f4", (visibilities, observers, channels, rank)),
    )
    pol = None
    if take.place < len(content):
        (rank,) = take.numbers("<i")
        sun, zenith = (take.counted() for _ in range(2))
        records = take.array(layout.polarisation_record(rank, len(sun), len(zenith)), axes.shape)
        pol = layout.PragueTerms(sun, zenith, np.empty(0), records)
    if take.place < len(content):
        raise TwilightError(f"{path}: goes on for {len(content) - take.place} bytes behind its end")
    return layout.PragueFile(axes, sky, passed, pol)


@dataclass
class _Reader:
    path: Path
    content: memoryview
    place: int = 0

    def array(self, dtype: Any, shape: tuple[int, ...]) -> np.ndarray:
        kind = np.dtype(dtype)
        count = int(np.prod([max(n, 0) for n in shape], dtype=object))
        end = self.place + count * kind.itemsize
        if min(shape, default=1) < 1 or end > len(self.content):
            raise TwilightError(f"{self.path}: is no whole file of the Prague Sky Model")
        values = np.frombuffer(self.content[self.place : end], kind).reshape(shape)
        self.place = end
        return values

    def numbers(self, layout: str) -> tuple[Any, ...]:
        size = struct.calcsize(layout)
        return struct.unpack(layout, self.array("u1", (size,)).tobytes())

    def counted(self) -> np.ndarray:
        (count,) = self.numbers("<i")
        return self.array("<f8", (count,)).astype(float)
