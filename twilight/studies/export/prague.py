"""The Prague Sky Model's file from solved fields: for every air, albedo, altitude and sun a sum of products.

A field of all suns makes the skies of an air over a ground: tables of suns (`twilight.sky.table`), below -2 deg of
every second sun of the file, between which the tables' rule goes.

A folder of files that is written whole or not at all.

Skies as sums of few products, by alternating least squares: a sky is sum_r f_r(gamma) g_r(alpha), each f and g linear
between its breaks.  With the g known, the best values of the f at their breaks solve linear equations in which only
neighbouring breaks meet: blocks of R x R along a diagonal and beside it.  Weights of one over the squared radiance make
the sum of squared relative errors least.  What few directions decide is held near the step before.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from scipy import sparse

from twilight.base.conventions import TINY
from twilight.base.errors import TwilightError
from twilight.base.progress import Progress, part_of
from twilight.base.whole_files import whole_folder
from twilight.engine.sun_tables import AUREOLE_SUN_DEG, COLUMN_COUNT, ROW_COUNT
from twilight.engine.table import shared_columns, shared_rows
from twilight.sky.table import DARKEST, SkyTable, stack
from twilight.studies.export import prague_file
from twilight.studies.export.prague_air import ChannelNodes, transmittance_of, transmittance_roots
from twilight.studies.export.prague_sky import SAFETY_M, PragueAngles, angles_of, elevation_of, index_and_fraction
from twilight.transport.rays import horizon_dip_deg

Buffer = bytes | bytearray | memoryview


def write_folder(folder: str | Path, files: Mapping[str, Buffer]) -> None:
    """Write the files into a new folder; a name may stand in a folder of its own.

    Errors: TwilightError where there is something already, and where the system refuses; nothing is left behind then.
    """
    folder = Path(folder)
    check_new(folder)
    with whole_folder(folder) as temporary:
        for name, content in files.items():
            path = temporary / name
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_bytes(content)


def check_new(folder: Path) -> None:
    """Raise TwilightError where there is something other than an empty folder."""
    if folder.exists() and not (folder.is_dir() and not any(folder.iterdir())):
        raise TwilightError(f"{folder}: is there already; tables are written into a new folder")


def _numbers(text: str) -> np.ndarray:
    return np.array(text.split(), dtype=float)


SUN_DEG = (
    *np.arange(-18.0, 0.25, 0.25).tolist(),
    *(0.5, 1, 1.5, 2, 2.5, 3, 4, 5, 6, 8, 10, 13, 16, 20, 25, 30, 37, 45, 55, 65, 75, 82, 90),
)
"""Elevations of the sun in a file [deg]."""
EVERY_SUN_DEG = -2.0
"""Elevation of the sun [deg] below which every second sun of the file has a table."""
EMPHASIS_DEG = 90.0 - _numbers(
    "90 81 72 64 56 48 40 33 27 22 18 15 12.5 10 8 6 4.5 3.5 2.7 2 1.4 1 0.75 0.5 0.35 0.2269"
)
"""Breaks of the emphasis: zenith angles [deg], down to the horizon of a viewpoint on the ground."""
GAMMA_DEG = _numbers(
    "0 0.5 1 1.5 2 3 4 5 6.5 8 10 12.5 15 18 21 25 30 35 40 46 52 58 65 72 79 86 93 100 107 114 121 128 135 "
    "142 149 156 162 168 172 176 180"
)
"""Breaks of the angle from the sun."""
ALPHA_DEG = _numbers(
    "0 9 18 26 34 41 48 54 60 65 69 72 75 78 80 82 83.5 85 86 87 88 89 89.78 91 92.5 94 96 98 100 102 105 108.5"
)
"""Breaks of the zenith angle, or below the horizon of the shadow angle."""
_AZIMUTH_DEG = _numbers(
    "0 0.4 0.8 1.3 2 3 4 5 6.5 8 10 12.5 15 18 22 26 31 37 44 52 61 70 80 90 100 110 120 130 139 148 156 163 "
    "169 174 178 180"
)
_AROUND_DEG = (0, 0.25, 0.6, 1, 1.5, 2.2, 3, 4, 5.5, 7, 9, 12, 15)
"""Distances in height from a sun above the horizon at which the sums of products are fitted to its aureole too."""
FIRST_STEPS = 40
"""Rounds of the least squares of the first sun, which begin from nothing."""
STEPS = 5
"""Rounds of the least squares of every other sun, which begin from the sun before."""
ZENITH_SIZE = 1000.0
"""Largest stored value of a function of the zenith angle: half floats keep 11 bits up to 65504."""


@dataclass(frozen=True)
class PragueMaker:
    """axes: of the file; nodes: wavelengths of its channels; rank: products of each sky; polarised: with Q and U."""

    axes: prague_file.PragueAxes
    nodes: ChannelNodes
    rank: int
    polarised: bool

    def make(self, field_of: Callable[[int, int, Progress], Any], progress: Progress) -> prague_file.PragueFile:
        """The file; field_of(visibility, albedo, progress): a `Field` by the indices of its air and its ground."""
        axes, terms = self.axes, (len(GAMMA_DEG), len(ALPHA_DEG))
        sky = np.zeros(axes.shape, prague_file.radiance_record(self.rank, *terms, len(EMPHASIS_DEG)))
        pol = np.zeros(axes.shape, prague_file.polarisation_record(self.rank, *terms)) if self.polarised else None
        roots: list[np.ndarray] = []
        count = axes.shape[0] * axes.shape[1]
        for done in range(count):
            v, b = divmod(done, axes.shape[1])
            where = f"visibility {axes.visibility_km[v]:g} km, albedo {axes.albedo[b]:g}"
            field = field_of(v, b, part_of(progress, done / count, 0.3 / count, f"{where}:"))
            if b == 0:
                roots.append(transmittance_roots(field, axes.altitude_m, self.nodes))
            for h, altitude in enumerate(axes.altitude_m):
                progress(where, (done + 0.3 + 0.7 * h / axes.shape[2]) / count)
                self._altitude(field, altitude, sky[v, b, h], None if pol is None else pol[v, b, h])
            del field
        breaks = np.radians(GAMMA_DEG), np.radians(ALPHA_DEG)
        return prague_file.PragueFile(
            axes,
            prague_file.PragueTerms(*breaks, np.radians(EMPHASIS_DEG), sky),
            transmittance_of(roots, axes.altitude_m, axes.visibility_km),
            None if pol is None else prague_file.PragueTerms(*breaks, np.empty(0), pol),
        )

    def _altitude(self, field: Any, altitude_m: float, sky: np.ndarray, pol: np.ndarray | None) -> None:
        """Fill the records (S, C) of one viewpoint."""
        skies = _Skies(field, self, altitude_m)
        start = [first_guess(len(GAMMA_DEG), len(ALPHA_DEG), self.axes.channels, self.rank)] * 2
        for s, sun in enumerate(self.axes.elevation_deg):
            zero_deg, light, degree = skies.at(float(sun))
            e, a = np.meshgrid(elevation_of(zero_deg, altitude_m), _with_midpoints(_AZIMUTH_DEG), indexing="ij")
            angles = PragueAngles(*(angle.ravel() for angle in angles_of(float(sun), e, a, altitude_m)))
            gamma, zero = _basis(angles.gamma, GAMMA_DEG), _basis(angles.zero, ALPHA_DEG)
            alpha = _basis(angles.shadow, ALPHA_DEG) if sun < 0.0 else zero
            steps = FIRST_STEPS if s == 0 else STEPS
            emphasis, level = _emphasis(zero_deg, light)
            i, of_i = index_and_fraction(angles.zero, np.radians(EMPHASIS_DEG))
            stressed = emphasis[:, i] * (1.0 - of_i) + emphasis[:, i + 1] * of_i
            target = light.reshape(-1, light.shape[-1]).T / (level[:, None] * stressed)
            start[0] = alternate(gamma, alpha, target, target**-2, start[0], steps)
            _store(sky[s], start[0], emphasis, level, gamma, alpha, target)
            if pol is not None and degree is not None:
                wanted = degree.reshape(-1, degree.shape[-1]).T
                start[1] = alternate(gamma, zero, wanted, np.ones_like(wanted), start[1], steps)
                for name, values in zip(("sun", "zenith"), start[1], strict=True):
                    pol[s]["term"][name] = values.swapaxes(1, 2)


def _basis(angle_rad: np.ndarray, breaks_deg: np.ndarray) -> LinearBasis:
    return linear_basis(*index_and_fraction(angle_rad, np.radians(breaks_deg)), len(breaks_deg))


def _emphasis(zero_deg: np.ndarray, light: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Rounded means over the azimuth (C, E) beside the largest, which is the level (C,), of light (rows, A, C)."""
    mean = np.log(light).mean(axis=1)
    order = np.argsort(zero_deg)
    emphasis = np.stack([np.interp(EMPHASIS_DEG, zero_deg[order], column[order]) for column in mean.T])
    top = emphasis.max(axis=1)
    return np.exp(emphasis - top[:, None]).astype(np.float16).astype(float), np.exp(top)


def _store(
    records: np.ndarray,
    found: tuple[np.ndarray, np.ndarray],
    emphasis: np.ndarray,
    level: np.ndarray,
    gamma: LinearBasis,
    alpha: LinearBasis,
    target: np.ndarray,
) -> None:
    """One sky in all channels (C,) as half floats; functions of the zenith angle are fitted to the rounded others."""
    sun = found[0].astype(np.float16).astype(float)
    zenith = solve_half(alpha, at_directions(gamma, sun), target, target**-2, found[1])
    size = ZENITH_SIZE / np.maximum(np.abs(zenith).max(axis=1), TINY)
    records["term"]["sun"] = sun.swapaxes(1, 2)
    records["term"]["scale"] = size / level[:, None]
    records["term"]["zenith"] = (zenith * size[:, None]).swapaxes(1, 2)
    records["emphasis"] = emphasis


class _Skies:
    """The skies of one field from one altitude, as tables of suns."""

    def __init__(self, field: Any, maker: PragueMaker, altitude_m: float):
        self.maker, self.altitude_m = maker, altitude_m
        altitude_km = field.medium.bottom_km + 1e-3 * (altitude_m - SAFETY_M)
        self._horizon_deg = -horizon_dip_deg(field.medium, altitude_km)
        rows = shared_rows(field.scene, altitude_km, ROW_COUNT)
        columns = shared_columns(COLUMN_COUNT)

        def table(sun: float) -> SkyTable:
            nodes = {"rows_deg": rows, "columns_deg": columns}
            return field.table(sun, altitude_km, **nodes, aureole_sun_deg=AUREOLE_SUN_DEG, refine=False)

        suns = [float(sun) for sun in maker.axes.elevation_deg]
        low = [sun for sun in suns if sun < EVERY_SUN_DEG]
        every_second = low[::2] if len(low) % 2 else [*low[::2], low[-1]]
        self._tables = stack([table(sun) for sun in suns if sun >= EVERY_SUN_DEG or sun in every_second])

    def at(self, sun: float) -> tuple[np.ndarray, np.ndarray, np.ndarray | None]:
        """Zenith angles [deg] of the rows, mean radiance (rows, A, C) of each channel and, if polarised, polarisation.

        There must be several times as many directions as unknowns, or the sum of products goes astray between them.
        Directions below the horizon's refracted image have the sky just above it.
        """
        zero_deg, table, nodes = EMPHASIS_DEG, self._tables.under(sun), self.maker.nodes
        if sun > 0.0:
            around = 90.0 - sun + np.concatenate([_AROUND_DEG, np.negative(_AROUND_DEG)])
            zero_deg = np.union1d(EMPHASIS_DEG, around[(around >= 0.0) & (around <= EMPHASIS_DEG[-1])])
        zero_deg, azimuth = _with_midpoints(zero_deg), _with_midpoints(_AZIMUTH_DEG)
        elevation = np.clip(elevation_of(zero_deg, self.altitude_m), self._horizon_deg, 90.0)
        radiance = table.on_grid(elevation, azimuth).astype(float)
        light = nodes.mean(radiance)
        light = np.maximum(light, DARKEST * light.max(axis=(0, 1)))
        if not self.maker.polarised:
            return zero_deg, light, None
        fraction = table.fractional_stokes(elevation[:, None], azimuth)
        along = along_scattering(sun, elevation[:, None], azimuth, fraction[..., 0, :], fraction[..., 1, :])
        return zero_deg, light, nodes.mean(along * radiance) / light


def along_scattering(sun_deg: float, elevation_deg, azimuth_deg, q: np.ndarray, u: np.ndarray) -> np.ndarray:
    """Q (..., C) for the plane through sun and view, of Q and U for the vertical plane; directions (...) [deg].

    The tangent of the sphere towards the sun stands at an angle t from the vertical, clockwise where the sun is to the
    right as seen along the line of sight; turning the frame by t gives Q cos 2t + U sin 2t.
    """
    e, a, s = np.radians(elevation_deg), np.radians(azimuth_deg), np.radians(sun_deg)
    right = -np.cos(s) * np.sin(a)  # the sun's azimuth from the view's is -a, clockwise
    up = np.sin(s) * np.cos(e) - np.cos(s) * np.sin(e) * np.cos(a)
    turn = 2.0 * np.arctan2(right, up)[..., None]
    return q * np.cos(turn) + u * np.sin(turn)


def _with_midpoints(values: np.ndarray) -> np.ndarray:
    """The values and the middles between them."""
    return np.sort(np.concatenate([values, 0.5 * (values[1:] + values[:-1])]))


HOLD = 1e-6
"""Weight of the step before, beside the mean weight of a break."""
SLOPE = 1e-5
"""Weight of the difference between neighbouring breaks."""


class LinearBasis(NamedTuple):
    """Linear basis functions ("hats") of a number of breaks, 1 at their own and 0 at all others, at N directions.

    below, fraction (N,): the break below a direction, and the fraction of the way to the next; matrices (breaks, N):
    value of each function, square of it, and product with the next break's function.
    """

    breaks: int
    below: np.ndarray
    fraction: np.ndarray
    value: sparse.csr_array
    square: sparse.csr_array
    product: sparse.csr_array


def linear_basis(index: np.ndarray, fraction: np.ndarray, count: int) -> LinearBasis:
    """Of N directions, of which each lies a fraction behind the break of that index."""
    rows_of = np.arange(index.size)

    def matrix(low: np.ndarray, high: np.ndarray | None) -> sparse.csr_array:
        if high is None:
            return sparse.csr_array((low, (index, rows_of)), shape=(count, index.size))
        places = (np.concatenate([index, index + 1]), np.concatenate([rows_of, rows_of]))
        return sparse.csr_array((np.concatenate([low, high]), places), shape=(count, index.size))

    low, high = 1.0 - fraction, fraction
    return LinearBasis(count, index, fraction, matrix(low, high), matrix(low**2, high**2), matrix(low * high, None))


def at_directions(of: LinearBasis, values: np.ndarray) -> np.ndarray:
    """Functions with values (C, breaks, R), at the directions: (C, N, R)."""
    f = of.fraction[:, None]
    return values[:, of.below] * (1.0 - f) + values[:, np.minimum(of.below + 1, of.breaks - 1)] * f


def solve_half(
    of: LinearBasis, others: np.ndarray, target: np.ndarray, weight: np.ndarray, before: np.ndarray
) -> np.ndarray:
    """The best values (C, breaks, R) of one of the two functions.

    others (C, N, R): the other one at the directions; target, weight (C, N); before (C, breaks, R).
    """
    channels, n, rank = others.shape
    weighted = others * weight[..., None]
    outer = (weighted[..., :, None] * others[..., None, :]).transpose(1, 0, 2, 3).reshape(n, -1)
    shape = (of.breaks, channels, rank, rank)
    diagonal = (of.square @ outer).reshape(shape)
    beside = (of.product @ outer).reshape(shape)
    right = (of.value @ (weighted * target[..., None]).transpose(1, 0, 2).reshape(n, -1)).reshape(shape[:3])
    hold = HOLD * np.einsum("bcrr->c", diagonal) / (of.breaks * rank)
    diagonal += hold[:, None, None] * np.eye(rank)
    right += hold[:, None] * before.transpose(1, 0, 2)
    slope = SLOPE * np.einsum("bcrr->c", diagonal) / (of.breaks * rank)
    ends = np.full(of.breaks, 2.0)
    ends[[0, -1]] = 1.0
    diagonal += slope[:, None, None] * ends[:, None, None, None] * np.eye(rank)
    beside -= slope[:, None, None] * np.eye(rank)
    # forward: each break without the one before it; then back
    follow = np.empty(shape)
    solved = np.empty((of.breaks, channels, rank))
    for b in range(of.breaks):
        block, side = diagonal[b], right[b]
        if b > 0:
            turned = beside[b - 1].swapaxes(-1, -2)
            block = block - turned @ follow[b - 1]
            side = side - (turned @ solved[b - 1][..., None])[..., 0]
        both = np.linalg.solve(block, np.concatenate([beside[b], side[..., None]], axis=-1))
        follow[b], solved[b] = both[..., :-1], both[..., -1]
    for b in range(of.breaks - 2, -1, -1):
        solved[b] -= (follow[b] @ solved[b + 1][..., None])[..., 0]
    return solved.transpose(1, 0, 2)


def first_guess(sun_breaks: int, zenith_breaks: int, channels: int, rank: int) -> tuple[np.ndarray, np.ndarray]:
    """Term r is cos(pi r u), with u from 0 to 1 over the breaks: (C, G, R) and (C, A, R)."""

    def cosines(count: int) -> np.ndarray:
        basis = np.cos(np.pi * np.arange(rank) * np.linspace(0.0, 1.0, count)[:, None])
        return np.repeat(basis[None], channels, axis=0)

    return cosines(sun_breaks), cosines(zenith_breaks)


def alternate(
    gamma: LinearBasis,
    alpha: LinearBasis,
    target: np.ndarray,
    weight: np.ndarray,
    start: tuple[np.ndarray, np.ndarray],
    steps: int,
) -> tuple[np.ndarray, np.ndarray]:
    """Values (C, G, R) and (C, A, R) after `steps` rounds from `start`; each f has 1 as its largest absolute value."""
    sun, zenith = start
    for _ in range(steps):
        sun = solve_half(gamma, at_directions(alpha, zenith), target, weight, sun)
        size = np.maximum(np.abs(sun).max(axis=1, keepdims=True), TINY)
        sun, zenith = sun / size, zenith * size
        zenith = solve_half(alpha, at_directions(gamma, sun), target, weight, zenith)
    return sun, zenith
